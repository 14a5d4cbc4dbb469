"""Joint search of a point in all photos that see it: the mean of their score maps.

Chance peaks of two photos seldom lie at the same place of the ground; right ones do. Once the block
agrees to a pixel, the score maps of a point in other photos, each in its own robust deviations, are
resampled through the ground into one photo's frame. Their mean shows which candidate is right, and
how high chance makes such means. The place of that candidate is still measured on the photo's own
score map, so that the rays of a point stay independent.
"""

from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float32, Float64

from core.arrays import Mask, PixelPoints
from core.block import Block, Peak
from core.control.search import (
    CANDIDATES,
    Chance,
    Search,
    decoys_outside,
    plan_search,
    sigma_on_ground_m,
)
from core.kept_arrays import KeptArray, KeptArrays
from core.localisation.initial_orientation import Site
from core.localisation.photo_orientation import OrientationOptions
from core.matching.local_search import DULL, MATCH_FLOOR_PX, SEPARATION_PX, predict_pixels
from core.matching.patches import OpenPhoto
from core.matching.peaks import ScoreMap, ScorePeak, detect_peaks, nearest_peak

# design: the narrowest pair of peaks that a mean over photos still parts.
APART_PX = 2
"""No two peaks of the mean are closer than this (pixels of the pass): a row of trees beside a road
would hide the road's own peak, which the mean of all photos shows sharply enough."""
# design: what blur and noise of one photo move its peak by at most.
OWN_PX = 1.5
"""The peak of a photo's own surface that is meant lies no further from that of all together
(pixels of the pass); where it has none, the place is that of all together."""

Heights = Float32[np.ndarray, "..."]
"""A surface of whichever photo."""
Elsewhere = Float32[np.ndarray, "other_rows other_columns"]
"""A surface in the frame of another photo."""
Covered = tuple[ScoreMap, Mask]
"""A surface, and where it is known."""


class KeptSurfaces:
    """The latest surface of every point in every photo; threads may share it.

    Half precision keeps a hundredth of its spread.
    """

    def __init__(self, store: KeptArrays) -> None:
        self._store = store
        self._kept: dict[tuple[str, str], KeptArray] = {}

    def keep(self, point_id: str, photo_id: str, surface: ScoreMap) -> None:
        """Lay a surface by; an earlier one of the same point and photo gives way.

        Raises:
            PhotogrammetryError: The file cannot be written.
        """
        key = point_id, photo_id
        self._kept[key] = self._store.keep(surface.astype(np.float16), self._kept.get(key))

    def surface(self, point_id: str, photo_id: str) -> ScoreMap:
        """A surface that was laid by."""
        return self._kept[point_id, photo_id].read().astype(np.float32)


@contextmanager
def keeping_surfaces() -> Generator[KeptSurfaces]:
    """A place for surfaces while the work lasts."""
    store = KeptArrays()
    try:
        yield KeptSurfaces(store)
    finally:
        store.close()


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """A point searched in one photo, with what leads from there to the others."""

    search: Search
    """The search by itself; its surface lies about the place that was expected then."""
    pixel: tuple[float, float]
    """Where the point is expected now, scan pixels."""
    moves: Float64[np.ndarray, "2 2"]
    """Scan pixels (column, row) by which a metre of ground east and north moves it."""
    reduction: int
    """Scan pixels to one pixel of the surface."""
    inner: int
    """Half-width of the part where a peak may be right, pixels of the surface."""
    sigma_m: float
    """Standard deviation per axis of the point's distance from its prediction, metres."""
    operator: str
    """What was compared."""


def joint_searches(
    block: Block,
    site: Site,
    orientation: OrientationOptions,
    searches: Sequence[Search],
    kept: KeptSurfaces,
    mapper: Callable[..., Iterable[Any]] = map,
) -> tuple[Search, ...]:
    """The same searches with candidates, heights and chance as all photos together tell them.

    Args:
        block: The adjusted block.
        site: Reference, scans and reference points.
        orientation: Sizes of the searches.
        searches: What single photos found.
        kept: Their surfaces.
        mapper: Runs a function over photos, and over points.
    """
    rows: dict[str, list[int]] = {}
    for row, search in enumerate(searches):
        rows.setdefault(search.photo_id, []).append(row)

    def sighted(photo_id: str) -> list[Sight]:
        photo = block.photos[photo_id]
        opened = OpenPhoto(photo, block.cameras[photo.camera], site.scans[photo_id])
        own = [searches[row] for row in rows[photo_id]]
        return sights_in(opened, site, orientation, own)

    points: dict[str, list[tuple[int, Sight]]] = {}
    for photo_id, sights in zip(rows, mapper(sighted, rows), strict=True):
        for row, sight in zip(rows[photo_id], sights, strict=True):
            points.setdefault(sight.search.point_id, []).append((row, sight))

    def together(point_id: str) -> list[Search]:
        return judge_jointly([sight for _, sight in points[point_id]], kept)

    found = list(searches)
    for point_id, results in zip(points, mapper(together, points), strict=True):
        for (row, _), result in zip(points[point_id], results, strict=True):
            found[row] = result
    return tuple(found)


def sights_in(
    opened: OpenPhoto,
    site: Site,
    orientation: OrientationOptions,
    searches: Sequence[Search],
) -> list[Sight]:
    """The searches of one photo seen from its orientation now."""
    number = {name: point for point, name in enumerate(site.points.ids)}
    chosen = np.array([number[search.point_id] for search in searches], dtype=np.int64)
    points = replace(
        site.points,
        ids=tuple(search.point_id for search in searches),
        positions=site.points.positions[chosen],
        sigma_m=site.points.sigma_m[chosen],
    )
    plan = plan_search(opened, site.reference, points, orientation)
    prediction = predict_pixels(opened, np.zeros((6, 6)), points.positions, points.sigma_m)
    moves = moves_of(opened, points.positions)
    return [
        Sight(
            search,
            (float(pixel[0]), float(pixel[1])),
            move,
            plan.matching.reduction,
            plan.inner,
            float(sigma_m),
            plan.matching.operators[0].name,
        )
        for search, pixel, move, sigma_m in zip(
            searches, prediction.pixels, moves, plan.point_sigma_m, strict=True
        )
    ]


def moves_of(
    opened: OpenPhoto, positions: Float64[np.ndarray, "n 3"]
) -> Float64[np.ndarray, "n 2 2"]:
    """Scan pixels by which a metre of level ground east and north moves each point."""
    columns: list[PixelPoints] = []
    for axis in range(2):
        step = np.zeros(3)
        step[axis] = 0.5
        ahead = opened.photo.pixel_from_object(positions + step, opened.camera)
        columns.append(ahead - opened.photo.pixel_from_object(positions - step, opened.camera))
    return np.stack(columns, axis=-1)


def judge_jointly(sights: Sequence[Sight], kept: KeptSurfaces) -> list[Search]:
    """The searches of one point in all its photos."""
    heights = [heights_of(sight, kept) for sight in sights]
    return [in_photo(own, sights, heights) for own in range(len(sights))]


def heights_of(sight: Sight, kept: KeptSurfaces) -> ScoreMap:
    """A surface in robust deviations of its own above its middle."""
    search = sight.search
    surface = kept.surface(search.point_id, search.photo_id)
    middle, spread = np.float32(search.chance.middle), np.float32(search.chance.spread)
    return np.asarray((surface - middle) / spread, dtype=np.float32)


def in_photo(own: int, sights: Sequence[Sight], heights: Sequence[Heights]) -> Search:
    """One photo's search with what all say together; its own where it was not looked far enough."""
    sight, shape = sights[own], heights[own].shape
    column, row = (round(value) for value in expected_in(sight, shape))
    rim = sight.inner + SEPARATION_PX
    if not (rim <= row < shape[0] - rim and rim <= column < shape[1] - rim):
        return sight.search
    near = np.s_[row - rim : row + rim + 1, column - rim : column + rim + 1]
    others = [
        (number, resample_surface(sights[number], height, sight, shape))
        for number, height in enumerate(heights)
        if number != own
    ]
    others = [surface for _, surface in others if surface[1][near].all()]
    joint, known = mean_of(heights[own], others)
    inner = np.s_[
        row - sight.inner : row + sight.inner + 1, column - sight.inner : column + sight.inner + 1
    ]
    known[inner] = False
    chance = chance_in(joint, known, sight)
    peaks = detect_peaks(np.ascontiguousarray(joint[near]), CANDIDATES, APART_PX)
    places = [(peak.column + column - rim, peak.row + row - rim) for peak in peaks]
    return search_with_joint_candidates(sight, heights[own], peaks, places, chance, 1 + len(others))


def expected_in(sight: Sight, shape: tuple[int, ...]) -> tuple[float, float]:
    """Column and row of a surface where its point is expected now."""
    away = np.subtract(sight.pixel, sight.search.predicted) / sight.reduction
    return float(away[0]) + shape[1] // 2, float(away[1]) + shape[0] // 2


def resample_surface(
    other: Sight, heights: Elsewhere, own: Sight, shape: tuple[int, ...]
) -> Covered:
    """Another photo's surface in the frame of a photo's own.

    A place of the own frame and one of the other are the same where they are as far from the
    point on level ground.
    """
    turn = other.moves @ np.linalg.inv(own.moves) * (own.reduction / other.reduction)
    there, here = expected_in(other, heights.shape), expected_in(own, shape)
    matrix = np.column_stack([turn, np.array(there) - turn @ np.array(here)])
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    across = matrix[0, 0] * columns + matrix[0, 1] * rows + matrix[0, 2]
    down = matrix[1, 0] * columns + matrix[1, 1] * rows + matrix[1, 2]
    known = (across >= 0) & (across <= heights.shape[1] - 1)
    known &= (down >= 0) & (down <= heights.shape[0] - 1)
    surface = cv2.remap(
        heights,
        across.astype(np.float32),
        down.astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(surface, np.float32), known


def mean_of(own: ScoreMap, others: Sequence[Covered]) -> Covered:
    """Mean of surfaces in one frame; nought, which is their middle, where one is not known."""
    total, known = own.copy(), np.ones(own.shape, bool)
    for surface, covered in others:
        total += surface
        known &= covered
    total[~known] = 0
    return total / np.float32(1 + len(others)), known


def chance_in(joint: ScoreMap, outside: Mask, sight: Sight) -> Chance:
    """What the mean says of chance, where it is known and nothing can be right."""
    decoys, middle, spread = decoys_outside(joint, outside, APART_PX)
    pixel_m2 = (sight.search.pixel_m * sight.reduction) ** 2
    inner = float((2 * sight.inner + 1) ** 2)
    return Chance(decoys, float(outside.sum()) * pixel_m2, middle, spread, inner * pixel_m2)


def search_with_joint_candidates(
    sight: Sight,
    heights: ScoreMap,
    peaks: Sequence[ScorePeak],
    places: Sequence[tuple[float, float]],
    chance: Chance,
    photos: int,
) -> Search:
    """A photo's search with candidates of the mean, each where the photo's own surface has it.

    Where it has none the place is that of all together. As each of so many photos then tells the
    same, its standard deviation grows by their root: together they know no more than it does.
    """
    search, reduction = sight.search, sight.reduction
    sigma_px = search.peaks[0].sigma_px if search.peaks else DULL * MATCH_FLOOR_PX * reduction
    candidates: list[Peak] = []
    for peak, place in zip(peaks, places, strict=True):
        own = nearest_peak(heights, *place, OWN_PX)
        column, row = place if own is None else (own.column, own.row)
        shared = np.sqrt(photos) if own is None else 1.0
        candidates.append(
            Peak(
                (column - heights.shape[1] // 2) * reduction + search.predicted[0],
                (row - heights.shape[0] // 2) * reduction + search.predicted[1],
                float(sigma_px * shared),
                (peak.value - chance.middle) / chance.spread,
                sight.operator,
            )
        )
    off = np.array(places).reshape(-1, 2) - np.array(expected_in(sight, heights.shape))
    return replace(
        search,
        peaks=tuple(candidates),
        distance_m=np.hypot(*off.T) * reduction * search.pixel_m,
        sigma_m=sigma_on_ground_m(candidates, reduction, search.pixel_m, sight.sigma_m),
        chance=chance,
    )
