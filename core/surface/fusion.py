"""Parallaxes become object points, object points the heights of cells, and pairs one surface."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64, UInt8

from core.arrays import Mask, ObjectPoints, Scalars
from core.frames import HALF_PIXEL
from core.raster.grid import Grid
from core.surface.matching import WINDOW_SIGMA_PX, Parallaxes
from core.surface.rectified import LaidPhoto, Picture, RectifiedPair

# design: half of the pixels of a cell are seen by the left photo on a slope of 60 degrees.
LEAST_SHARE = 0.25
"""Of the pixels of a cell so many must have a parallax."""
# design: no division by nought.
NOTHING = np.float32(1e-6)
# source: three standard deviations, the usual limit of gross errors
AGREEMENT = 3.0
"""Pairs agree with the median within so many standard deviations."""

Deviations = Float64[np.ndarray, "n 2"]
"""Standard deviations by what is a pair's own, and by what windows round off in every pair."""


@dataclass(frozen=True, slots=True, eq=False)
class PairHeights:
    """Heights of the cells of a grid by one pair, metres; NaN in cells without."""

    heights: Picture
    """Metres."""
    own: Picture
    """Standard deviations by what is this pair's own."""
    rounding: Picture
    """Standard deviations by what the window rounds off, the same in every pair."""


@dataclass(frozen=True, slots=True, eq=False)
class CellHeights:
    """The surface on a grid."""

    heights: Picture
    """Metres; NaN in holes."""
    sigmas: Picture
    """Standard deviations, metres; NaN in holes."""
    pairs: UInt8[np.ndarray, "rows columns"]
    """Pairs that agree; nought in holes."""

    def without(self, cells: Mask) -> "CellHeights":
        """The surface with more holes."""
        nothing = np.float32(np.nan)
        heights, sigmas = (np.where(cells, nothing, one) for one in (self.heights, self.sigmas))
        return CellHeights(heights, sigmas, np.where(cells, np.uint8(0), self.pairs))


def object_points(pair: RectifiedPair, found: Parallaxes) -> tuple[ObjectPoints, Deviations]:
    """Where the rays of both photos meet, and the standard deviations of the heights, metres.

    Each ray goes through the perspective centre and the place of the start surface that the photo
    shows there, so collinearity with all corrections is in both.
    """
    grid, px = pair.grid, pair.grid.ground_sample_distance_m
    rows, columns = np.nonzero(found.found)
    parallax = found.parallax_px[rows, columns].astype(np.float64)
    u_left = grid.west + (columns + HALF_PIXEL) * px
    v = grid.north - (rows + HALF_PIXEL) * px
    u_right = u_left - parallax * px
    z_left = pair.start[rows, columns].astype(np.float64)
    z_right = _heights_at(pair.start, columns - parallax, rows)
    lean_left = _lean(pair.left, u_left, v, z_left)
    lean_right = _lean(pair.right, u_right, v, z_right)
    apart = lean_left[0] - lean_right[0]
    height = (u_right - u_left + z_left * lean_left[0] - z_right * lean_right[0]) / apart
    place = np.column_stack(
        [u_left + (height - z_left) * lean_left[0], v + (height - z_left) * lean_left[1]]
    )
    sigma_px = np.column_stack([found.sigma_px[rows, columns], found.rounding_px[rows, columns]])
    sigma = sigma_px * (px / np.abs(apart))[:, None]
    # Beyond the edge of the DEM there is no start surface, and no height from it.
    known = np.isfinite(height)
    points = np.column_stack([pair.frame.to_object(place[known]), height[known]])
    return points, sigma[known]


def _heights_at(start: Picture, columns: Scalars, rows: np.ndarray) -> Scalars:
    """Of the start surface between pixels of a row."""
    place = np.clip(columns, 0, start.shape[1] - 1.001)  # design: the last pixel has a neighbour
    left = place.astype(np.int64)
    share = place - left
    return start[rows, left] * (1 - share) + start[rows, left + 1] * share


def _lean(laid: LaidPhoto, u: Scalars, v: Scalars, z: Scalars) -> tuple[Scalars, Scalars]:
    """How far a ray goes along both axes for each metre that it rises."""
    down = z - laid.centre[2]
    return (u - laid.centre[0]) / down, (v - laid.centre[1]) / down


def cell_heights(
    points: ObjectPoints, sigmas: Deviations, cells: Grid, pixel_m: float
) -> PairHeights:
    """Heights of the cells of a grid from the points of one pair: their weighted means."""
    place = np.floor(cells.grid_from_object(points[:, :2])).astype(np.int64)
    inside = ((place >= 0) & (place < (cells.columns, cells.rows))).all(axis=1)
    cell = place[inside, 1] * cells.columns + place[inside, 0]
    own, rounding = sigmas[inside].T ** 2
    weight = 1 / (own + rounding)
    level = float(points[0, 2]) if len(points) else 0.0
    size = cells.columns * cells.rows
    total, sums, owns, roundings = (
        np.bincount(cell, values, size)
        for values in (
            weight,
            weight * (points[inside, 2] - level),
            weight**2 * own,
            weight * rounding,
        )
    )
    count = np.bincount(cell, minlength=size)
    # Neighbouring points share their windows: a cell no larger than one is one measurement.
    in_cell = (cells.ground_sample_distance_m / pixel_m) ** 2
    shared = min(4 * np.pi * WINDOW_SIGMA_PX**2, max(in_cell, 1.0))
    known = count >= max(LEAST_SHARE * in_cell, 1.0)
    safe = np.where(known, total, 1.0)
    alike = np.minimum(shared, np.maximum(count, 1))

    def picture(values: Scalars) -> Picture:
        shown = np.where(known, values, np.nan).astype(np.float32)
        return shown.reshape(cells.rows, cells.columns)

    return PairHeights(
        picture(sums / safe + level),
        picture(np.sqrt(alike * owns) / safe),
        picture(np.sqrt(roundings / safe)),
    )


def fuse_pairs(
    found: Sequence[PairHeights], photos: Sequence[tuple[str, str]], cells: Grid
) -> CellHeights:
    """One surface of all pairs: the weighted mean of those that agree with the weighted median.

    Where no two of several pairs agree, and where no majority of weight agrees, there is a hole.

    Args:
        found: The cells by each pair.
        photos: Names of the photos of each pair.
        cells: Where the cells lie.
    """
    shape = (cells.rows, cells.columns)
    if not found:
        empty = np.full(shape, np.nan, dtype=np.float32)
        return CellHeights(empty, empty, np.zeros(shape, dtype=np.uint8))
    heights = np.stack([one.heights for one in found])
    known = np.isfinite(heights)
    own, rounding = (
        np.where(known, np.stack(values) ** 2, 1)
        for values in ([one.own for one in found], [one.rounding for one in found])
    )
    weights = np.where(known, 1 / (own + rounding), 0)
    middle = _weighted_median(heights, weights)
    agree = known & (np.abs(heights - middle) <= AGREEMENT * np.sqrt(own + rounding))
    used = np.where(agree, weights, 0)
    total, count = used.sum(axis=0), agree.sum(axis=0)
    # The majority: what contradicts may not weigh as much as what agrees, nor one pair as a second.
    confirmed = count >= np.minimum(known.sum(axis=0), 2)
    sound = confirmed & (total > 0) & (2 * total > weights.sum(axis=0))
    safe = np.where(sound, total, 1)
    mean = (used * np.where(agree, heights, 0)).sum(axis=0) / safe
    # Three pairs of three photos say no more than two of them.
    alike = np.maximum(count / np.maximum(_photos_in(agree, photos) - 1, 1), 1)
    scatter = _scatter(np.where(agree & sound, (heights - mean) ** 2 / own, 0), count, sound)
    variance = alike * scatter * (used**2 * own).sum(axis=0) / safe**2
    variance += (used * rounding).sum(axis=0) / safe
    return CellHeights(
        np.where(sound, mean, np.nan).astype(np.float32),
        np.where(sound, np.sqrt(variance), np.nan).astype(np.float32),
        np.where(sound, count, 0).astype(np.uint8),
    )


def _photos_in(
    agree: Bool[np.ndarray, "pairs r c"], photos: Sequence[tuple[str, str]]
) -> Int64[np.ndarray, "r c"]:
    """How many photos the pairs that agree are made of."""
    found = np.zeros(agree.shape[1:], dtype=np.int64)
    for name in {name for pair in photos for name in pair}:
        found += agree[[number for number, pair in enumerate(photos) if name in pair]].any(axis=0)
    return found


def _scatter(squares: Float32[np.ndarray, "pairs r c"], count: np.ndarray, sound: Mask) -> Picture:
    """How much farther pairs scatter than their own standard deviations say, squared; at least 1.

    A few pairs say little of one cell, so those of all cells around are taken.

    Args:
        squares: Squared residuals over squared standard deviations; nought where pairs disagree.
        count: Pairs that agree.
        sound: Cells that have a height.
    """
    around = (4 * int(WINDOW_SIGMA_PX) + 1,) * 2
    freedom = np.where(sound, np.maximum(count - 1, 0), 0).astype(np.float32)
    total = cv2.blur(squares.sum(axis=0).astype(np.float32), around)
    return np.maximum(total / np.maximum(cv2.blur(freedom, around), NOTHING), 1)


def _weighted_median(
    heights: Float32[np.ndarray, "pairs r c"], weights: Float32[np.ndarray, "pairs r c"]
) -> Float32[np.ndarray, "r c"]:
    """The height below and above which half of the weight lies, the nearest of the pairs'."""
    order = np.argsort(heights, axis=0)
    sorted_heights = np.take_along_axis(heights, order, axis=0)
    total = np.cumsum(np.take_along_axis(weights, order, axis=0), axis=0)
    first = np.argmax(total >= total[-1] / 2, axis=0)
    return np.take_along_axis(sorted_heights, first[None], axis=0)[0]
