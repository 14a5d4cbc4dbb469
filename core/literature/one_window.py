"""A template sought in one window, by any operator and in any way of the thesis's Table 2."""

from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np

from core.arrays import Scalars
from core.frames import HALF_PIXEL
from core.literature.baselines import OPERATORS
from core.literature.common_grid import GridPair, Places
from core.literature.detectors import (
    SIDES,
    described,
    described_everywhere,
    detector_named,
    distances_to,
    eight_bits,
    places_of,
)
from core.literature.operator_variants import Land, Sizes
from core.matching.peaks import Image, ScoreMap

Way = Literal["hand", "d", "dd", "vd", "vdd", "k"]
"""Those of `operator_variants`, and a template of the scan that was laid by hand."""
FROM_SCAN: tuple[Way, ...] = ("hand", "d", "dd")
"""Ways whose template is of the scan, and whose window of the ortho; otherwise it is vice versa."""
SNAPPED: tuple[Way, ...] = ("d", "dd", "k")
"""Ways whose template is a detected point."""
AT_POINTS: tuple[Way, ...] = ("dd", "vdd")
"""Ways that compare detected points of the window only."""


@dataclass(frozen=True, slots=True, eq=False)
class Template:
    """What is sought, and where."""

    place: Places
    """Its middle on the grid, (1, 2); of a detected point, where that lies."""
    side: float
    """Pixels it spans."""
    point: Any = None
    """The detected point, else None."""


@dataclass(frozen=True, slots=True, eq=False)
class Likeness:
    """How alike places of a window are."""

    spots: Places
    """Places that were compared."""
    scores: Scalars
    """Their likeness; of descriptors less their distance."""
    surface: ScoreMap | None
    """The same at every pixel of the window, where all were compared."""

    @property
    def best(self) -> Places:
        """The most alike place, (1, 2); none where nothing was compared."""
        return self.spots[[int(np.argmax(self.scores))]] if len(self.spots) else self.spots


def template_at(
    name: str, way: Way, pair: GridPair, place: Places, sizes: Sizes, within: Land | None = None
) -> Template | None:
    """The template nearest to a place: there, or the nearest detected point; None without any.

    Args:
        name: Of the operator; SIFT detects for those that only compare.
        way: How it is taken.
        pair: Scan and ortho.
        place: On the grid, (1, 2).
        sizes: Patch and search.
        within: Where points may be detected; everywhere without it.
    """
    side = 2 * sizes.inner + 1
    if way not in SNAPPED:
        return Template(np.floor(place) + HALF_PIXEL, float(side))
    describes = name in SIDES and way != "k"
    image = eight_bits(pair.archival if way in FROM_SCAN else pair.reference)
    land = None if within is None else within.astype(np.uint8)
    made = detector_named(name if describes else "sift")
    points = [
        one
        for one in made.detect(image, land)
        if _fits(one, SIDES[name] * one.size / 2 if describes else sizes.inner, len(image))
    ]
    points.sort(key=lambda one: float(np.linalg.norm(places_of([one]) - place)))
    # Turned to its own direction a square reaches further: not every point can be described.
    usable = (one for one in points if not describes or made.compute(image, [one])[1] is not None)
    point = next(usable, None)
    if point is None:
        return None
    middle = np.floor(places_of([point])) + HALF_PIXEL
    if describes:
        return Template(places_of([point]), SIDES[name] * float(point.size), point)
    return Template(middle, float(side), point)


def _fits(point: Any, reach: float, side: int) -> bool:
    """Whether a square about a point lies within a square picture."""
    return reach + 1 < min(point.pt) and max(point.pt) < side - 2 - reach


def likeness_in(
    name: str,
    way: Way,
    images: tuple[Image, Image, Image],
    template: Template,
    centre: Places,
    *,
    sizes: Sizes,
    within: Land | None = None,
) -> Likeness:
    """How alike the places of a window are to the template.

    Args:
        name: Of the operator: one of `OPERATORS`, or `surf`.
        way: How places are chosen.
        images: What the template is of, what the window is of, and the drawn roads of the first.
        template: What is sought.
        centre: Middle of the window, (1, 2).
        sizes: Patch and search.
        within: Where points may be detected; everywhere without it.
    """
    own, searched, roads = images
    land = None if within is None else within.astype(np.uint8)
    if name in SIDES and (name == "surf" or way in ("d", "dd", "vdd")):
        return _by_descriptors(name, way, (own, searched), template, centre, sizes, land)
    surface = _everywhere(name, (own, searched, roads), template, centre, sizes=sizes)
    low = np.floor(centre[0]) - sizes.half + HALF_PIXEL
    if way not in AT_POINTS:
        return _of_surface(surface, low)
    spots = places_of(detector_named("sift").detect(eight_bits(searched), land))
    spots = spots[(np.abs(spots - centre) <= sizes.half).all(axis=1)]
    columns, rows = np.rint(spots - low).astype(int).clip(0, 2 * sizes.half).T
    return Likeness(spots, surface[rows, columns].astype(np.float64), None)


def _of_surface(surface: ScoreMap, low: np.ndarray) -> Likeness:
    rows, columns = np.indices(surface.shape)
    spots = np.column_stack([columns.ravel(), rows.ravel()]) + low
    return Likeness(spots, surface.ravel().astype(np.float64), surface)


def _everywhere(
    name: str,
    images: tuple[Image, Image, Image],
    template: Template,
    centre: Places,
    *,
    sizes: Sizes,
) -> ScoreMap:
    """An operator of ours at every place; the template is its reference, with the roads there."""
    own, searched, roads = images
    operator = OPERATORS[name]
    around = _cut(operator.of_scan(searched, sizes.inner), centre, sizes.inner + sizes.half)
    patch = _cut(operator.of_reference(own, roads, sizes.inner), template.place, sizes.inner)
    return operator.scores(around, patch)


def _cut(layers: tuple[np.ndarray, ...], place: Places, reach: int) -> tuple[np.ndarray, ...]:
    column, row = np.floor(place[0]).astype(int).tolist()
    part = np.s_[row - reach : row + reach + 1, column - reach : column + reach + 1]
    return tuple(np.ascontiguousarray(layer[part]) for layer in layers)


def _by_descriptors(
    name: str,
    way: Way,
    images: tuple[Image, Image],
    template: Template,
    centre: Places,
    sizes: Sizes,
    land: Any,
) -> Likeness:
    """Descriptors of detected points, or upright ones as large as the patch."""
    made, nothing = detector_named(name), Likeness(np.zeros((0, 2)), np.zeros(0), None)
    own, searched = (eight_bits(image) for image in images)
    size = template.side / SIDES[name]
    if template.point is not None and way != "k":
        wanted = made.compute(own, [template.point])[1]
    else:
        wanted = described(made, own, template.place, size)[1]
    if wanted is None or not len(wanted):
        return nothing
    if way == "dd":
        kept, offered = made.compute(searched, made.detect(searched, land))
        spots = places_of(kept)
    elif way == "vdd":
        found = places_of(made.detect(searched, land))
        spots, offered = described(made, searched, found, size)
    else:
        upright = cv2.KeyPoint(0.0, 0.0, size, 0.0)
        point = template.point if way == "d" else upright
        spots, offered = described_everywhere(made, searched, point, np.floor(centre), sizes.half)
    near = (np.abs(spots - centre) <= sizes.half + HALF_PIXEL).all(axis=1)
    if not near.any():
        return nothing
    scores = -distances_to(wanted[0], offered[near]).astype(np.float64)
    surface = _as_surface(spots[near], scores, centre, sizes) if way not in AT_POINTS else None
    return Likeness(spots[near], scores, surface)


def _as_surface(spots: Places, scores: Scalars, centre: Places, sizes: Sizes) -> ScoreMap:
    """Scores of a dense grid of spots; places without a descriptor are as unlike as the worst."""
    side = 2 * sizes.half + 1
    surface = np.full((side, side), scores.min(), np.float32)
    low = np.floor(centre[0]) - sizes.half
    columns, rows = np.rint(spots - HALF_PIXEL - low).astype(int).clip(0, side - 1).T
    surface[rows, columns] = scores
    return surface
