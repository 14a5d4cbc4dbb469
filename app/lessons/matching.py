"""Matching: a patch sought in its window by several operators, on ground that has changed."""

from functools import lru_cache

import cv2
import numpy as np

from app.lessons import sheet
from core.literature.baselines import OPERATORS
from core.literature.one_window import Kind, measure_of
from core.matching.operators import Operator
from core.matching.peaks import Image, ScoreMap, detect_peaks

NAMES = ("ncc", "gradient", "cfog", "sift", "orb")
"""Operators by the number of the slider."""
SIDE = 360
"""Ground of so many metres at 1 m a pixel."""
FIELD_M, ROAD_M = 60, 6
APART_PX, SHOWN = 5, 5
LEVELS: tuple[tuple[float, sheet.Look], ...] = ((0.8, "faint"), (0.9, "second"), (0.97, "error"))
"""Outlined share of the window that is less alike, and how."""
HIT_M = 2.0
"""A peak this near to the truth is right."""


@lru_cache(maxsize=32)
def pictures(changed: float, noise: float, turn_deg: float, seed: int) -> tuple[Image, Image]:
    """The ground on the ortho and on the old photo, whose fields had other tones.

    Args:
        changed: Share of the fields with another tone.
        noise: Grain of the photo, grey values.
        turn_deg: How far the georeference is turned.
        seed: Of the ground.
    """
    rng = np.random.default_rng(seed)
    count = SIDE // FIELD_M
    new = rng.uniform(70, 190, (count, count))
    old = np.where(rng.random(new.shape) < changed, rng.uniform(70, 190, new.shape), new)
    texture = cv2.GaussianBlur(rng.normal(0, 1, (SIDE, SIDE)), (0, 0), 2)
    painted: list[Image] = []
    for tones in (new, old):
        image = np.kron(tones, np.ones((FIELD_M, FIELD_M))) + 25 * texture
        for line in junction_lines():
            image[line - ROAD_M // 2 : line + ROAD_M // 2] = 215
            image[:, line - ROAD_M // 2 : line + ROAD_M // 2] = 215
        painted.append(cv2.GaussianBlur(image, (0, 0), 1.0).astype(np.float32))
    middle = (SIDE / 2 - 0.5, SIDE / 2 - 0.5)
    turned = cv2.warpAffine(
        painted[1], cv2.getRotationMatrix2D(middle, turn_deg, 1.0), (SIDE, SIDE),
        borderMode=cv2.BORDER_REFLECT,
    )  # fmt: skip
    grain = rng.normal(0, 1, turned.shape) * noise
    return painted[0], (turned + grain).astype(np.float32)


def junction_lines() -> list[int]:
    """Where roads run, in both directions."""
    return list(range(FIELD_M, SIDE, FIELD_M))


def cut_out(state: sheet.State, place: tuple[int, int]) -> tuple[Image, Image]:
    """The old photo as far as the patch is moved over it, and the patch."""
    ortho, photo = pictures(
        state["changed"] / 100, state["grain"], state["turn"], int(state["seed"])
    )
    inner, half = int(state["size"]) // 2, int(state["half"])
    reach = inner + half
    padded = cv2.copyMakeBorder(photo, reach, reach, reach, reach, cv2.BORDER_REFLECT)
    around = padded[place[1] : place[1] + 2 * reach + 1, place[0] : place[0] + 2 * reach + 1]
    wide = cv2.copyMakeBorder(ortho, inner, inner, inner, inner, cv2.BORDER_REFLECT)
    patch = wide[place[1] : place[1] + 2 * inner + 1, place[0] : place[0] + 2 * inner + 1]
    return np.ascontiguousarray(around), np.ascontiguousarray(patch)


def surface(operator: Operator, around: Image, patch: Image) -> ScoreMap:
    """Likeness of the patch at every place of its window in the old photo."""
    inner = patch.shape[0] // 2
    return operator.scores(
        operator.of_scan(around, inner),
        operator.of_reference(patch, np.zeros_like(patch), inner),
    )


def true_shift(state: sheet.State, place: tuple[int, int]) -> np.ndarray:
    """Where the photo shows the junction, from where the georeference puts it, metres."""
    turn = np.radians(state["turn"])
    middle = np.full(2, SIDE / 2 - 0.5)
    arm = np.array(place) - middle
    cosine, sine = np.cos(turn), np.sin(turn)
    return np.array([cosine * arm[0] + sine * arm[1], cosine * arm[1] - sine * arm[0]]) - arm


def view(state: sheet.State) -> sheet.View:
    """Both pictures of one junction, the likeness as levels, its best peaks and its profile."""
    line = junction_lines()
    number = int(state["junction"]) - 1
    place = line[1 + number % 3], line[1 + number // 3]
    name, half = NAMES[int(state["operator"]) - 1], int(state["half"])
    around, patch = cut_out(state, place)
    scores = surface(OPERATORS[name], around, patch)
    shift = true_shift(state, place)
    peaks = detect_peaks(scores, SHOWN, APART_PX)
    spots = np.array([[p.column - half, half - p.row] for p in peaks]).reshape(-1, 2)
    best = np.array(np.unravel_index(int(np.argmax(scores)), scores.shape))[::-1] - half
    truth = np.array([[shift[0], -shift[1]]])
    edge = 1.06 * half
    shapes = (
        *levels(scores, half),
        sheet.shape("crosses", spots, "estimate"),
        sheet.shape("dots", [(best[0], -best[1])], "bad", "best"),
        sheet.shape("line", sheet.ellipse(truth[0], np.eye(2) * HIT_M**2), "truth"),
    )
    heights = [float(scores[round(p.row), round(p.column)]) for p in peaks]
    measure = measure_of(name)
    figures = likeness_told("best", float(scores.max()), measure) | {
        "miss": sheet.Number(float(np.hypot(*(best - shift))), 1, "m", secret=True),
    }
    if len(heights) > 1:
        figures |= likeness_told("second", heights[1], measure)
    row = int(np.clip(half + np.rint(shift[1]), 0, 2 * half))
    kind, times = measure
    profile = sheet.curve("row", np.arange(-half, half + 1), times * scores[row])
    symbols = {
        "n": sheet.Number(len(patch), 0, "px"),
        "p": sheet.Number(chance(half), 4),
        "s": sheet.Number(half, 0, "m"),
        "d": sheet.Number(HIT_M, 0, "m"),
    }
    equations = (CHANCE,)
    if name == "ncc":
        symbols |= correlated(around, patch, best + half) | {"q": figures["best"]}
        equations = (NCC, CHANCE)
    canvases = (
        pictured("patch", patch, (sheet.shape("crosses", [(0, 0)], "given"),)),
        pictured("photo", around, seen_at(best, len(patch) / 2, truth[0])),
        sheet.Canvas("surface", (-edge, -edge, edge, edge), shapes),
    )
    plot = sheet.Plot("x", kind, (profile,))
    return sheet.View(figures, canvases, symbols, plot, equations=equations)


def correlated(around: Image, patch: Image, corner: np.ndarray) -> dict[str, sheet.Number]:
    """What the correlation coefficient at a place is made of: covariance and deviations."""
    column, row = corner.tolist()
    part = around[row : row + len(patch), column : column + len(patch)]
    (own, both), (_, other) = np.cov(patch.ravel(), part.ravel())
    return {
        "σ_oi": sheet.Number(float(both), 0),
        "σ_o": sheet.Number(float(np.sqrt(own)), 1),
        "σ_i": sheet.Number(float(np.sqrt(other)), 1),
    }


def pictured(name: str, image: Image, shapes: tuple[sheet.Shape, ...]) -> sheet.Canvas:
    """A picture of a metre a pixel about its middle."""
    half = len(image) / 2
    window = (-half, -half, half, half)
    return sheet.Canvas(name, window, shapes, picture=sheet.picture(image, window))


def seen_at(best: np.ndarray, reach: float, truth: np.ndarray) -> tuple[sheet.Shape, ...]:
    """Where the patch is most alike, and where it truly lies."""
    middle = best * [1.0, -1.0]
    rim = middle + reach * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    return (
        sheet.shape("line", rim, "bad"),
        sheet.shape("dots", [middle], "bad", "best"),
        sheet.shape("line", sheet.ellipse(truth, np.eye(2) * HIT_M**2), "truth"),
    )


def likeness_told(rank: str, score: float, measure: tuple[Kind, float]) -> dict[str, sheet.Number]:
    """The figure of a place: its likeness, or the distance or differing bits that it is told by.

    Args:
        rank: `best` or `second`.
        score: As the operator gives it.
        measure: What that is, and by what it is multiplied to be that.
    """
    kind, times = measure
    digits = 0 if kind == "bits" else 3
    name = rank if kind == "likeness" else f"{rank}_{kind}"
    return {name: sheet.Number(times * score, digits)}


def levels(scores: ScoreMap, half: int) -> list[sheet.Shape]:
    """Outlines of what is more alike than four fifths, nine tenths and more of the window."""
    found: list[sheet.Shape] = []
    for share, look in LEVELS:
        above = (scores > np.quantile(scores, share)).astype(np.uint8)
        outlines, _ = cv2.findContours(above, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        for one in outlines:
            ring = one.reshape(-1, 2).astype(np.float64)
            ring = np.vstack([ring, ring[:1]])
            spots = np.column_stack([ring[:, 0] - half, half - ring[:, 1]])
            found.append(sheet.shape("line", spots, look))
    return found


def chance(half: float) -> float:
    """Share of the window that counts as right."""
    return float(np.pi * HIT_M**2 / (2 * half) ** 2)


def ask(rng: np.random.Generator) -> sheet.Asked:
    """How many of so many wrong matches chance makes right."""
    half, count = float(rng.integers(10, 41)), float(rng.integers(10, 31) * 10)
    return sheet.Asked({"s": half, "d": HIT_M, "n": count}, count * chance(half))


NCC = sheet.Equation("q", sheet.over("σ_oi", sheet.row("σ_o", "*", "σ_i")))
CHANCE = sheet.Equation(
    "p",
    sheet.over(
        sheet.row("π", "*", sheet.power("d", "2")),
        sheet.power(["fence", sheet.row("2", "*", "s")], "2"),
    ),
)
LESSON = sheet.Lesson(
    "matching",
    "j",
    (
        sheet.Slider("operator", 1, len(NAMES), 1, 1),
        sheet.Slider("size", 11, 101, 51, 2, "px"),
        sheet.Slider("half", 10, 40, 30, 1, "m", "s"),
        sheet.Slider("changed", 0, 100, 60, 5, "%"),
        sheet.Slider("grain", 0, 60, 12, 2),
        sheet.Slider("turn", -10, 10, 1, 0.5, "°"),
        sheet.Slider("junction", 1, 9, 1, 1),
        sheet.SEED,
    ),
    view,
    (NCC, CHANCE),
    (sheet.Question("chance", "", 0.3, ask),),
    hides_truth=True,
)
