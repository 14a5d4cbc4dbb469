"""What a lesson is: sliders in, a drawing with figures, formula and plot out, and a question.

A lesson is a module of this folder with a `LESSON`. Its texts stand in `ui/words` under its name,
or in the lesson itself (`texts`), so that one file is enough.
"""

from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import cv2
import numpy as np
from jaxtyping import Float64
from numpy.typing import ArrayLike

from core.errors import PhotogrammetryError

State = Mapping[str, float]
"""The value of every slider by its name, in the slider's unit."""
Math = str | list[Any]
"""A symbol, number or sign, or a list that begins with what is done to the rest."""
Look = Literal[
    "truth", "estimate", "given", "ray", "ground", "film", "faint", "bad", "error", "axis", "second"
]
"""What a shape means; the page gives it its colour. `truth` can be hidden."""
Kind = Literal["line", "area", "dots", "crosses", "arrow", "text"]
Places = ArrayLike
"""Rows of x and y; of x, y and height in a drawing in space."""


class LessonError(PhotogrammetryError):
    """A lesson that is not there, or cannot be shown so."""


@dataclass(frozen=True, slots=True)
class Slider:
    """One thing that is moved."""

    name: str
    """Its key in the state and in the texts; `step` is moved by two buttons as well."""
    low: float
    """Least value, in its unit."""
    high: float
    """Greatest value."""
    start: float
    """Value the lesson opens with."""
    step: float
    """What one step of the slider changes."""
    unit: str = ""
    """As it is written behind the number."""
    symbol: str = ""
    """How the formula writes it; empty where no formula has it."""
    moved_in: str = ""
    """Canvas in which a handle moves it; empty for a slider beside the drawing."""

    @property
    def is_switch(self) -> bool:
        """Whether it is only on or off."""
        return (self.low, self.high, self.step) == (0, 1, 1)


@dataclass(frozen=True, slots=True)
class Number:
    """A figure on screen."""

    value: float
    """In its unit."""
    digits: int = 2
    """Decimal places shown."""
    unit: str = ""
    """As it is written behind the number."""
    truth: float | None = None
    """What was put in, where the figure is an estimate of it; it can be hidden."""
    secret: bool = False
    """Whether the figure itself would tell, and is hidden with the truth."""


Block = list[list[Number]]
"""A matrix of the formula: rows of figures; a vector is a column."""


@dataclass(frozen=True, slots=True)
class Equation:
    """A formula, shown with symbols and again with the present numbers."""

    left: str
    """The symbol it gives."""
    right: Math
    """Made by `row`, `over`, `power`, `root`, `fence` and `named`."""


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A part of a drawing."""

    kind: Kind
    """How its points are drawn."""
    points: list[list[float]]
    """x right, y up, units of the canvas; in space east, north, height."""
    look: Look
    """What it means."""
    label: str = ""
    """A text of the lesson (`label.NAME`), or the text itself."""
    number: Number | None = None
    """Stands in the label's place `{number}`, or alone."""
    handle: tuple[str, str] | None = None
    """Sliders that are moved with its only point: by x and by y."""
    below: bool = False
    """Whether its label stands below instead of above."""


@dataclass(frozen=True, slots=True, eq=False)
class CanvasPicture:
    """A picture beneath the shapes of a drawing."""

    address: str
    """The picture itself, as a data address."""
    window: tuple[float, float, float, float]
    """Where it lies: left, lower, right, upper edge."""


@dataclass(frozen=True, slots=True, eq=False)
class Canvas:
    """A drawing to scale, flat or in space."""

    name: str
    """Its title in the texts (`canvas.NAME`)."""
    window: tuple[float, float, float, float] | tuple[float, float, float, float, float, float]
    """Left, lower, right, upper edge; in space, where the page turns it, the corners of a box:
    west, south, lowest, east, north, highest."""
    shapes: tuple[Shape, ...]
    """Drawn in this order."""
    unit: str = "m"
    """Of its coordinates."""
    equal: bool = True
    """Whether both axes have one scale."""
    picture: CanvasPicture | None = None
    """What lies beneath."""


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """One line of a plot."""

    name: str
    """Its name in the texts (`curve.NAME`)."""
    points: list[list[float]]
    """x, y."""
    look: Look = "estimate"
    """What it means."""


@dataclass(frozen=True, slots=True, eq=False)
class Plot:
    """Curves over one quantity, with the present value marked."""

    x: str
    """Name of the axis in the texts (`axis.NAME`)."""
    y: str
    """The same of the other."""
    curves: tuple[Curve, ...]
    """At least one."""
    at: tuple[float, float] | None = None
    """Where the sliders stand now."""
    kinds: str = ""
    """Slider whose choices are the places along x (`choice.NAME.VALUE`), which have no order."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """What a lesson shows in one state."""

    figures: Mapping[str, Number]
    """By name (`figure.NAME` in the texts)."""
    canvases: tuple[Canvas, ...]
    """One or two drawings."""
    symbols: Mapping[str, Number | Block] = field(default_factory=dict[str, Number | Block])
    """Values of the formula's symbols that are no sliders, or have another unit there."""
    plot: Plot | None = None
    """What follows, as a curve."""
    step: str = ""
    """Of a lesson in steps: its texts are `step.STEP` and `source_of.STEP`."""
    equations: tuple[Equation, ...] = ()
    """Those of the step, in the place of the lesson's."""
    idle: Mapping[str, str] = field(default_factory=dict[str, str])
    """Sliders that move nothing in this state, each with the name of its reason (`idle.REASON`)."""
    in_force: Mapping[str, float] = field(default_factory=dict[str, float])
    """What idle sliders show in this state instead of where they stand."""
    warning: str = ""
    """What to beware of in this state (`warning.WARNING`)."""


@dataclass(frozen=True, slots=True)
class Asked:
    """A question with its numbers."""

    values: Mapping[str, float]
    """What stands in the places of its text."""
    answer: float
    """The right one, in the question's unit."""
    tolerance: float | None = None
    """Where it depends on the numbers; None for the question's."""


@dataclass(frozen=True, slots=True)
class Question:
    """A question whose numbers are new each time."""

    name: str
    """Its texts: `question.NAME`, `hint.NAME`, and `sign.NAME` where the answer has a sign."""
    unit: str
    """Of the answer."""
    tolerance: float
    """An answer is right within this, in its unit."""
    ask: Callable[[np.random.Generator], Asked]
    """Draws the numbers; the answer comes from the engine."""
    digits: int = 1
    """Decimal places of the answer told in the end."""
    signed: bool = False
    """Whether the answer has a sign; its text `sign.NAME` says which is which."""


@dataclass(frozen=True, slots=True, eq=False)
class Lesson:
    """One idea that can be moved."""

    name: str
    """As `--lesson` and the page's address have it."""
    letter: str
    """Its place among the lessons; they are listed by it."""
    sliders: tuple[Slider, ...]
    """What is moved."""
    view: Callable[[State], View]
    """What is shown; a pure function."""
    equations: tuple[Equation, ...]
    """At least one."""
    questions: tuple[Question, ...]
    """At least one."""
    hides_truth: bool = False
    """Whether something was put in that is to be found, and can be hidden."""
    order: int = 0
    """Among lessons of one letter."""
    prepare: Callable[[], None] | None = None
    """What takes long before the first view, done once while the page is open already."""
    texts: Mapping[str, Mapping[str, str]] = field(default_factory=dict[str, Mapping[str, str]])
    """Texts by language and key, of a lesson that brings its own."""

    @property
    def start(self) -> dict[str, float]:
        """The state it opens in."""
        return {slider.name: float(slider.start) for slider in self.sliders}


NOISE = Slider("noise", 0, 30, 5, 1, "µm")
"""Standard deviation of what is measured on film."""
SEED = Slider("seed", 1, 99, 1, 1)
"""Another draw of the same noise, and of what is hidden."""


def row(*parts: Math) -> Math:
    """Parts side by side; `*` between two of them is a product."""
    return ["row", *parts]


def over(above: Math, below: Math) -> Math:
    """A fraction."""
    return ["over", above, below]


def power(base: Math, exponent: Math) -> Math:
    """A power."""
    return ["power", base, exponent]


def root(inside: Math) -> Math:
    """A square root."""
    return ["root", inside]


def fence(inside: Math) -> Math:
    """Parts in parentheses."""
    return ["fence", inside]


def named(symbol: str, inside: Math) -> Math:
    """Parts that have one value, of that symbol: the numbers show it in their place."""
    return ["named", symbol, inside]


def block(values: ArrayLike, digits: int, unit: str = "") -> Block:
    """A matrix of the formula; a vector becomes a column."""
    rows = np.asarray(values, dtype=np.float64)
    columns = rows if rows.ndim > 1 else rows[:, None]
    return [[Number(one, digits, unit) for one in row] for row in columns.tolist()]


def shape(
    kind: Kind,
    points: Places,
    look: Look,
    label: str = "",
    *,
    number: Number | None = None,
    handle: tuple[str, str] | None = None,
    below: bool = False,
) -> Shape:
    """A part of a drawing; points that are not finite are left out."""
    places = np.asarray(points, dtype=np.float64)
    places = places.reshape(-1, places.shape[-1] if places.size else 2)
    kept = places[np.isfinite(places).all(axis=1)]
    # A micrometre of a millimetre, a millimetre of a metre: no screen shows less.
    return Shape(kind, np.round(kept, 3).tolist(), look, label, number, handle, below)


def curve(name: str, x: ArrayLike, y: ArrayLike, look: Look = "estimate") -> Curve:
    """A line of a plot."""
    points = np.column_stack([np.asarray(x, np.float64), np.asarray(y, np.float64)])
    return Curve(name, points[np.isfinite(points).all(axis=1)].tolist(), look)


def picture(
    values: np.ndarray, window: tuple[float, float, float, float], suffix: str = ".jpg"
) -> CanvasPicture:
    """A picture of grey values or of colours (blue, green, red), 0 to 255."""
    _, coded = cv2.imencode(suffix, np.clip(np.rint(values), 0, 255).astype(np.uint8))
    kind = "png" if suffix == ".png" else "jpeg"
    return CanvasPicture(f"data:image/{kind};base64,{b64encode(coded.tobytes()).decode()}", window)


def frame_of(half: float) -> list[list[float]]:
    """Corners of a square frame about the origin."""
    return [[-half, -half], [half, -half], [half, half], [-half, half]]


def ellipse(
    centre: Sequence[float] | np.ndarray, covariance: Float64[np.ndarray, "2 2"], times: float = 1.0
) -> Float64[np.ndarray, "n 2"]:
    """The error ellipse of a covariance, so many times its size, closed."""
    values, axes = np.linalg.eigh(covariance)
    turn = np.linspace(0, 2 * np.pi, 41)
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    return np.asarray(centre) + times * (circle * np.sqrt(np.maximum(values, 0))) @ axes.T
