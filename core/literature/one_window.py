"""A template sought in one window, by any operator and in any way of the thesis's Table 2."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import cv2
import numpy as np

from core.arrays import Mask, Scalars
from core.frames import HALF_PIXEL
from core.literature.baselines import OPERATORS
from core.literature.common_grid import GridPair, Places
from core.literature.dense_descriptors import AKAZE_BITS, BITS
from core.literature.detectors import (
    SIDES,
    Detector,
    Grey8,
    describe_places,
    describe_window,
    detector_named,
    distances_to,
    eight_bits,
    places_of,
)
from core.matching.peaks import Image, ScoreMap

Way = Literal["hand", "d", "dd", "vd", "vdd", "k"]
"""How points are paired, in the thesis's letters.

`d` detects in the scan, and describes every place of a window in the ortho; `dd` detects in both.
`vd` describes a junction's patch of the ortho, and every place of a window in the scan; `vdd`
describes that patch, and detects in the scan. `k` is what the thesis proposes (6.2): SIFT detects
in the ortho, and the patch there is compared with every place of a window in the scan. `hand` is
the lesson's: a template of the scan, compared with every place of a window in the ortho.
"""
FROM_SCAN: tuple[Way, ...] = ("hand", "d", "dd")
"""Ways whose template is of the scan, and whose window of the ortho; otherwise it is vice versa."""
SNAPPED: tuple[Way, ...] = ("d", "dd", "k")
"""Ways whose template is a detected point."""
AT_POINTS: tuple[Way, ...] = ("dd", "vdd")
"""Ways that compare detected points of the window only."""
BY_DETECTOR: tuple[Way, ...] = ("d", "dd", "vdd")
"""Ways in which an operator describes what it detects itself; elsewhere it compares patches."""
Kind = Literal["likeness", "distance", "bits"]
"""A likeness, of which more is better; a distance of descriptors of length one, or differing bits,
of which less is."""
# source: OpenCV's SIFT makes descriptors of this length, in whole numbers.
SIFT_LENGTH = 512.0


def measure_of(name: str, described: bool = False) -> tuple[Kind, float]:
    """What an operator measures, and by what its scores are multiplied to be that.

    Args:
        name: One of `OPERATORS`, or `surf`.
        described: Whether the descriptors of the detector are compared, point by point.
    """
    kinds: dict[str, tuple[Kind, float]] = {
        "sift": ("distance", -1 / SIFT_LENGTH if described else -1.0),
        "surf": ("distance", -1.0),
        "orb": ("bits", -1.0 if described else -float(BITS)),
        "akaze": ("bits", -AKAZE_BITS),
    }
    return kinds.get(name, ("likeness", 1.0))


@dataclass(frozen=True, slots=True)
class Sizes:
    """How far is searched, and with what, pixels of the grid."""

    inner: int
    """Half the patch of a junction."""
    half: int
    """How far a point may lie from where it is expected, per axis."""


@dataclass(frozen=True, slots=True, eq=False)
class GridPatch:
    """What is sought, and where."""

    place: Places
    """Its middle on the grid, (1, 2); of a detected point, where that lies."""
    side: float
    """Pixels it spans."""
    point: Any = None
    """The detected point, else None."""
    descriptor: Any = None
    """What describes it, where descriptors are compared."""


@dataclass(frozen=True, slots=True, eq=False)
class WindowScores:
    """How alike places of a window are."""

    places: Places
    """Places that were compared."""
    scores: Scalars
    """Their likeness; of descriptors less their distance."""
    surface: ScoreMap | None
    """The same at every pixel of the window, where all were compared."""

    @property
    def best(self) -> Places:
        """The most alike place, (1, 2); none where nothing was compared."""
        return self.places[[int(np.argmax(self.scores))]] if len(self.places) else self.places


@dataclass(frozen=True, eq=False)
class OperatorSearch:
    """One operator on one pair, in one way; what serves every template is made once."""

    name: str
    """Of the operator: one of `OPERATORS`, or `surf`."""
    way: Way
    """How points are chosen."""
    pair: GridPair
    """Scan and ortho."""
    sizes: Sizes
    """Patch and search."""
    within: Mask | None = None
    """Where points may be detected, such as built-up land; everywhere without it."""
    roads: Image | None = None
    """Drawn roads, for operators that take them beside the ortho."""

    def template_at(self, place: Places) -> GridPatch | None:
        """The template nearest to a place: there, or the nearest detected point; None without any.

        Args:
            place: On the grid, (1, 2).
        """
        if self.way not in SNAPPED:
            return next(iter(self.templates_at(np.floor(place) + HALF_PIXEL)), None)
        points = [
            one
            for one in self.detecting.detect(self.own, self._land)
            if _fits(one, self._side_of(one) / 2, len(self.own))
        ]
        points.sort(key=lambda one: float(np.linalg.norm(places_of([one]) - place)))
        # Turned to its own direction a square reaches further: not every point can be described.
        return next((template for one in points for template in self._snapped(one)), None)

    def templates_at(self, places: Places) -> list[GridPatch]:
        """Upright patches at places; without those that cannot be described, if that is needed."""
        side = float(2 * self.sizes.inner + 1)
        if not self._by_descriptors:
            return [GridPatch(place[None], side) for place in places]
        # How both pictures lie, and how large a patch is, the georeference tells.
        known, wanted = describe_places(self._describing, self.own, places, side / SIDES[self.name])
        return [
            GridPatch(place[None], side, None, own)
            for place, own in zip(known, wanted, strict=True)
        ]

    def templates_of(self, points: Sequence[Any]) -> list[GridPatch]:
        """Templates of points detected in what templates are of."""
        if not self._describes_points:
            return self.templates_at(places_of(points))
        kept, wanted = self._describing.compute(self.own, list(points))
        return [
            GridPatch(places_of([point]), self._side_of(point), point, own)
            for point, own in zip(kept, () if wanted is None else wanted, strict=True)
        ]

    def likeness(self, template: GridPatch, centre: Places) -> WindowScores:
        """How alike the places of a window are to the template.

        Args:
            template: What is sought.
            centre: Middle of the window, (1, 2).
        """
        half, low = self.sizes.half, centre[0] - self.sizes.half
        if self._by_descriptors:
            places, scores = self._described_likeness(template, centre)
            dense = len(places) and self.way not in AT_POINTS
            surface = _as_surface(places - low, scores, 2 * half + 1) if dense else None
            return WindowScores(places, scores, surface)
        scan, ortho = self._layers
        around = _cut(scan, centre, self.sizes.inner + half)
        patch = _cut(ortho, template.place, self.sizes.inner)
        surface = OPERATORS[self.name].scores(around, patch)
        if self.way not in AT_POINTS:
            rows, columns = np.indices(surface.shape)
            places = np.column_stack([columns.ravel(), rows.ravel()]) + low
            return WindowScores(places, surface.ravel().astype(np.float64), surface)
        places = places_of(self._offered_points)
        places = places[(np.abs(places - centre) <= half).all(axis=1)]
        columns, rows = np.rint(places - low).astype(int).clip(0, 2 * half).T
        return WindowScores(places, surface[rows, columns].astype(np.float64), None)

    @property
    def measure(self) -> tuple[Kind, float]:
        """What is measured, and by what scores are multiplied to be that."""
        return measure_of(self.name, self._by_descriptors)

    @cached_property
    def own(self) -> Grey8:
        """What templates are of, as detectors take it."""
        return eight_bits(self.pair.archival if self.way in FROM_SCAN else self.pair.reference)

    @cached_property
    def searched(self) -> Grey8:
        """What windows are of, as detectors take it."""
        return eight_bits(self.pair.reference if self.way in FROM_SCAN else self.pair.archival)

    @property
    def _by_descriptors(self) -> bool:
        """Whether descriptors are compared; `OPERATORS` compares at every place, SURF but here."""
        return self.name in SIDES and (self.name == "surf" or self.way in BY_DETECTOR)

    @property
    def _describes_points(self) -> bool:
        """Whether a template is described as it was detected, in its own size and direction."""
        return self.name in SIDES and self.way in BY_DETECTOR and self.way in SNAPPED

    @cached_property
    def detecting(self) -> Detector:
        """SIFT detects for operators that only compare, and always in way K."""
        own = self.name in SIDES and self.way in BY_DETECTOR
        return detector_named(self.name if own else "sift")

    @cached_property
    def _describing(self) -> Detector:
        return detector_named(self.name)

    @property
    def _land(self) -> Any:
        return None if self.within is None else self.within.astype(np.uint8)

    def _side_of(self, point: Any) -> float:
        if self._describes_points:
            return SIDES[self.name] * float(point.size)
        return float(2 * self.sizes.inner + 1)

    def _snapped(self, point: Any) -> list[GridPatch]:
        """The template of a point; a patch lies on whole pixels."""
        if self._describes_points:
            return self.templates_of([point])
        middle = np.floor(places_of([point])) + HALF_PIXEL
        return [replace(template, point=point) for template in self.templates_at(middle)]

    @cached_property
    def _layers(self) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
        """What an operator of ours compares: of the window's picture, and of the template's."""
        operator, scan, ortho = OPERATORS[self.name], self.pair.archival, self.pair.reference
        if self.way in FROM_SCAN:
            own, searched, roads = scan, ortho, None
        else:
            own, searched, roads = ortho, scan, self.roads
        drawn = np.zeros_like(own) if roads is None else roads
        inner = self.sizes.inner
        return operator.of_scan(searched, inner), operator.of_reference(own, drawn, inner)

    @cached_property
    def _offered_points(self) -> Sequence[Any]:
        return self.detecting.detect(self.searched, self._land)

    @cached_property
    def _offered(self) -> tuple[Places, np.ndarray]:
        """Detected points of the window's picture, described as the templates are."""
        if not self._describes_points:
            size = (2 * self.sizes.inner + 1) / SIDES[self.name]
            points = places_of(self._offered_points)
            return describe_places(self._describing, self.searched, points, size)
        kept, offered = self._describing.compute(self.searched, self._offered_points)
        return places_of(kept), np.zeros((0, 1)) if offered is None else offered

    def _described_likeness(self, template: GridPatch, centre: Places) -> tuple[Places, Scalars]:
        """Places of a window that have a descriptor, and less its distance."""
        half = self.sizes.half
        if self.way in AT_POINTS:
            places, offered = self._offered
        else:
            upright = cv2.KeyPoint(0.0, 0.0, template.side / SIDES[self.name], 0.0)
            point = template.point if self._describes_points else upright
            places, offered = describe_window(
                self._describing, self.searched, point, centre - HALF_PIXEL, half
            )
        near = (np.abs(places - centre) <= half + HALF_PIXEL).all(axis=1)
        if not near.any():
            return np.zeros((0, 2)), np.zeros(0)
        away = distances_to(template.descriptor, offered[near])
        return places[near], -away.astype(np.float64)


def _fits(point: Any, reach: float, side: int) -> bool:
    """Whether a square about a point lies within a square picture."""
    return reach + 1 < min(point.pt) and max(point.pt) < side - 2 - reach


def _cut(layers: tuple[np.ndarray, ...], place: Places, reach: int) -> tuple[np.ndarray, ...]:
    column, row = np.floor(place[0]).astype(int).tolist()
    part = np.s_[row - reach : row + reach + 1, column - reach : column + reach + 1]
    return tuple(np.ascontiguousarray(layer[part]) for layer in layers)


def _as_surface(offsets: Places, scores: Scalars, side: int) -> ScoreMap:
    """Scores of a dense grid; places without a descriptor are as unlike as the worst."""
    surface = np.full((side, side), scores.min(), np.float32)
    columns, rows = np.rint(offsets).astype(int).clip(0, side - 1).T
    surface[rows, columns] = scores
    return surface
