"""The photos' own surface against the DEM, and on which of the two orthos stand.

The choice is a raster of classes, and a correction of the DEM that is nought where the DEM holds.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import rasterio
from jaxtyping import Float64, UInt8
from rasterio.enums import Resampling
from scipy.ndimage import gaussian_filter

from core.arrays import Mask, Matrix, Scalars, locked
from core.frames import HALF_PIXEL
from core.geometry.crs import Bounds
from core.geometry.robust import huber_weights, nmad, solve_robustly
from core.orthos.rectification import COMPRESSION_LEVEL
from core.orthos.scan_places import Heights
from core.raster.dem import HeightSource
from core.raster.grid import Grid, Tile, tell_full_disk, tiled_profile, window_of
from core.surface.rectified import Picture

# source: Huber 1981, k for 95 % efficiency on normal errors
HUBER = 1.345
ROUNDS = 15  # design: it settles before.
"""Passes of the robust fit at most."""
# source: cartographic convention: light from the north-west, 45 degrees high
SUN_AZIMUTH_DEG, SUN_HEIGHT_DEG = 315.0, 45.0
TERMS = 4  # source: definition of the trend
"""Shift, tilt to the east and to the north, and bowl."""


@dataclass(frozen=True, slots=True, eq=False)
class SystematicPart:
    """Systematic part of surface minus DEM: a + b x + c y + d (x^2 + y^2)."""

    bounds: Bounds
    """x and y run from -1 to 1 along the longer side of these."""
    coefficients: Float64[np.ndarray, "4"]
    """a, b, c, d, metres."""
    nmad_m: float
    """Normalised median deviation of what is left, metres."""
    cells: int
    """Cells that it was fitted to."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients", locked(self.coefficients))

    @property
    def size_m(self) -> float:
        """Root mean square of it over a square of the longer side, metres."""
        x, y = np.meshgrid(*[np.linspace(-1, 1, 9)] * 2)  # design: exact to a hundredth
        a, b, c, d = self.coefficients.tolist()
        return float(np.sqrt(np.mean((a + b * x + c * y + d * (x**2 + y**2)) ** 2)))

    def at(self, plan: Float64[np.ndarray, "n 2"]) -> Scalars:
        """Of places, easting and northing, metres."""
        return _design(plan, self.bounds) @ self.coefficients


Window = tuple[slice, slice]
"""Rows and columns of a part of a raster."""
GroundKind = Literal["dem", "surface", "auto"]
# source: three standard deviations, METHODS 8
LIMIT = 3.0
"""Surface and DEM differ if they lie further apart, in standard deviations of the difference."""
# design: a large farmhouse; what is wider is a wood, a hall or the ground itself.
OBJECT_M = 25.0
"""What is higher than its surroundings over no more than this stands on the ground."""
# design: a fifth of a sports ground; a hall of this size is taken out by its edges.
LEAST_AREA_M2 = 2000.0
"""Ground has changed over a connected area of this size at least."""
# design: loose earth and gravel rest at 30 to 37 degrees; chosen on the blocks for developing
STEEPEST = 0.75
"""Rise over run, beyond which an edge is a wall, and what ends in one stands on the ground."""
# design: bare ground has one by definition, a canopy of crowns and gaps has several.
ROUGHEST = 1.7
"""Roughness over standard deviation, beyond which what is higher is a wood."""
# design: 64 MB, whatever the block.
MOST_CELLS = 4096
"""Cells along the longer side of the correction at most."""
# design: a hole is bridged from all around; far from anything the DEM holds.
NEAR_CELLS, FAR_CELLS = 1.5, 6.0
"""Widths of the bells that smooth differences and bridge their holes, cells."""
# design: less says nothing of the middle.
LEAST_KNOWN = 0.05
"""Share of a bell with heights that bridges a hole."""
MEDIAN_CELLS = 5  # source: OpenCV, the largest of floats
"""Side of the window of the median that differences are smoothed by, cells."""
# design: two dozen cells fix a scatter to a seventh.
AROUND = (5, 5)
"""Cells that roughness is taken over."""
# design: the slope from the limit down to nought, at 1 : 3 and cells of a metre.
EDGE_CELLS = 6
"""Changed ground is followed so far beyond its limit."""
# source: OpenCV, remap takes no more than 32767 places in a row
ROW = 8192
# design: single cells show their errors, not the ground; the slopes of hills stay.
SMOOTH_CELLS = 3.0
"""Standard deviation of the smoothing before lines and relief are drawn, cells."""
# design: beyond three deviations a Gaussian weighs nothing that a line would show.
MARGIN_CELLS = 10
"""Cells read around each tile, so that lines meet at its edges."""
# design: half of what was smoothed away is missing: there a height is a guess.
LEAST_SMOOTHED = 0.5
"""Weight of known cells in a smoothed one, at least."""
NODATA_M = -9999.0  # source: the value that GIS programs use for heights without data
"""Of heights that are not known."""


class Ground(IntEnum):
    """What orthos stand on at a place."""

    NONE = 0
    DEM = 1
    SURFACE = 2
    DEM_UNDER_SURFACE = 3
    DEM_ALONE = 4


@dataclass(frozen=True, slots=True, eq=False)
class CorrectedHeights:
    """A DEM and what is added to it."""

    dem: HeightSource
    """The DEM."""
    grid: Grid
    """Where the corrections lie."""
    corrections: Picture
    """Metres to be added; bilinear between the middles of cells, nought beyond."""

    @property
    def ground_sample_distance_m(self) -> float:
        """Spacing of the finer of the two, metres."""
        own = self.grid.ground_sample_distance_m
        return min(own, self.dem.ground_sample_distance_m) if isinstance(self.dem, Heights) else own

    def heights(self, points: Float64[np.ndarray, "n 2"]) -> Scalars:
        """Heights at easting and northing, metres; NaN where the DEM has none."""
        place = (self.grid.grid_from_object(points) - HALF_PIXEL).astype(np.float32)
        lines = -(-len(place) // ROW)
        padded = np.zeros((lines * ROW, 2), dtype=np.float32)
        padded[: len(place)] = place
        maps = padded.reshape(lines, ROW, 2)
        more = cv2.remap(self.corrections, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR)
        return self.dem.heights(points) + np.asarray(more).ravel()[: len(place)]

    def on(self, grid: Grid) -> Matrix:
        """Heights at the pixel centres of a grid, metres; NaN where there is none."""
        east, north = grid.centres()
        if not isinstance(self.dem, Heights):
            plan = np.column_stack([part.ravel() for part in np.meshgrid(east, north)])
            return self.heights(plan).reshape(grid.rows, grid.columns)
        cell = self.grid.ground_sample_distance_m
        columns = ((east - self.grid.west) / cell - HALF_PIXEL).astype(np.float32)
        rows = ((self.grid.north - north) / cell - HALF_PIXEL).astype(np.float32)
        maps = np.meshgrid(columns, rows)
        more = cv2.remap(self.corrections, maps[0], maps[1], cv2.INTER_LINEAR)
        return self.dem.on(grid) + np.asarray(more)


@dataclass(frozen=True, slots=True)
class GroundProduct:
    """The choice on disk."""

    classes: Path
    """One byte a cell: 1 the DEM agrees, 2 own surface, 3 the DEM though the surface is another
    (woods, houses), 4 the DEM without a surface."""
    corrections: Path
    """Metres that are added to the DEM."""
    changed_m2: float
    """Area that stands on its own surface."""


def choose_ground(
    difference: Path,
    sigma: Path,
    kind: GroundKind,
    dem_sigma_m: float,
    *,
    classes: Path,
    corrections: Path,
) -> GroundProduct:
    """Choose for every cell, and write classes and corrections.

    Args:
        difference: Surface minus DEM without its systematic part, metres.
        sigma: Standard deviations of the surface, metres.
        kind: `surface` takes it wherever it is known, `auto` where ground has changed.
        dem_sigma_m: Standard deviation of a height of the DEM, metres.
        classes: File to write.
        corrections: File to write.

    Raises:
        OSError: The disk is full.
    """
    away, grid, crs = read_coarser(difference)
    sigmas, _, _ = read_coarser(sigma)
    known = np.isfinite(away) & np.isfinite(sigmas)
    away[~known] = np.nan
    if kind == "surface":
        more = bridged(away)
        chosen = np.where(known, Ground.SURFACE, Ground.DEM_ALONE).astype(np.uint8)
    else:
        more, chosen = _choose(away, sigmas, known, dem_sigma_m, grid.ground_sample_distance_m)
    _write(classes, grid, crs, chosen, Ground.NONE)
    _write(corrections, grid, crs, more, NODATA_M)
    area = float(np.count_nonzero(chosen == Ground.SURFACE)) * grid.ground_sample_distance_m**2
    return GroundProduct(classes, corrections, area)


def read_ground(corrections: Path, dem: HeightSource) -> CorrectedHeights:
    """The chosen ground as heights."""
    values, grid, _ = read_coarser(corrections)
    return CorrectedHeights(dem, grid, np.nan_to_num(values, nan=0.0))


def bridged(differences: Picture) -> Picture:
    """Smoothed; holes from what lies around, nought far from everything."""
    known = np.isfinite(differences).astype(np.float32)
    values = np.where(known > 0, differences, np.float32(0))
    result = np.zeros_like(values)
    for width in (FAR_CELLS, NEAR_CELLS):
        share = np.asarray(cv2.GaussianBlur(known, (0, 0), width))
        mean = np.asarray(cv2.GaussianBlur(values, (0, 0), width))
        # The narrower bell goes before where it finds something.
        result = np.where(share > LEAST_KNOWN, mean / np.maximum(share, LEAST_KNOWN), result)
    return result.astype(np.float32)


def _choose(
    away: Picture, sigmas: Picture, known: Mask, dem_sigma_m: float, cell_m: float
) -> tuple[Picture, UInt8[np.ndarray, "rows columns"]]:
    """Corrections and classes where the DEM holds unless connected ground has changed."""
    smooth = np.asarray(cv2.medianBlur(bridged(away), MEDIAN_CELLS))
    limit = LIMIT * np.hypot(np.where(known, sigmas, 0), dem_sigma_m)
    agrees = known & (np.abs(smooth) <= limit)
    ground = _without_objects(smooth, agrees, cell_m)
    excess = _roughness(smooth, away) / np.where(known, sigmas, np.inf)
    high = known & (ground > limit)
    low = known & (ground < -limit)

    beside = low | ~known
    slope, wall = (np.hypot(*np.gradient(one, cell_m)) for one in (smooth, ground))

    def is_bare(part: Mask, at: Window) -> bool:
        rough = float(np.median(excess[at][part]))
        gently = _ends_gently(part, smooth[at], slope[at], limit[at], beside[at])
        return rough <= ROUGHEST and gently

    # A wood beside changed ground is parted from it by its wall.
    own = _parts(high & (wall <= STEEPEST), cell_m, is_bare) | _parts(low, cell_m)
    wide = cv2.dilate(own.astype(np.uint8), _disc(EDGE_CELLS))
    share = np.asarray(cv2.GaussianBlur(wide.astype(np.float32), (0, 0), NEAR_CELLS))
    stands = (high | low) & ~own
    ground = np.where(stands, bridged(np.where(stands, np.nan, ground)), ground)
    chosen = np.where(agrees, Ground.DEM, Ground.DEM_UNDER_SURFACE)
    chosen = np.where(known, chosen, Ground.DEM_ALONE)
    chosen = np.where(own, Ground.SURFACE, chosen)
    return (share * ground).astype(np.float32), chosen.astype(np.uint8)


def _parts(
    mask: Mask, cell_m: float, holds: Callable[[Mask, Window], bool] = lambda part, at: True
) -> Mask:
    """The connected parts of a mask that are large enough, and of which something holds."""
    count, numbers, figures, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    accepted = np.zeros(count, dtype=bool)
    for number, (left, top, wide, high, cells) in enumerate(figures.tolist()):
        if number == 0 or cells * cell_m**2 < LEAST_AREA_M2:
            continue
        # With the cells that tell how it ends.
        row, column = (max(side - 2 * EDGE_CELLS, 0) for side in (top, left))
        at = np.s_[row : top + high + 2 * EDGE_CELLS, column : left + wide + 2 * EDGE_CELLS]
        accepted[number] = holds(numbers[at] == number, at)
    return accepted[np.asarray(numbers, dtype=np.int64)]


def _ends_gently(part: Mask, smooth: Picture, slope: Picture, limit: Picture, beside: Mask) -> bool:
    """Whether less than half of the edge of a part that is higher is a wall.

    Only the edge to unchanged ground counts: not where something higher begins, such as a wood on
    its slope, nor where it lies beside ground that is lower than the DEM or not known.
    """
    inner, near = part.astype(np.uint8), _disc(2)
    edge = (cv2.dilate(inner, _disc(1)) > 0) & (cv2.erode(inner, _disc(1)) == 0)
    edge &= cv2.dilate(beside.astype(np.uint8), _disc(EDGE_CELLS)) == 0
    edge &= cv2.dilate(smooth, near) <= float(np.median(smooth[part])) + limit
    steepest = cv2.dilate(slope.astype(np.float32), near)[edge]
    return steepest.size > 0 and float(np.median(steepest)) <= STEEPEST


def _without_objects(smooth: Picture, agrees: Mask, cell_m: float) -> Picture:
    """What is left of differences when houses and trees on them are taken off."""
    opened = np.asarray(
        cv2.morphologyEx(smooth, cv2.MORPH_OPEN, _disc(round(OBJECT_M / cell_m / 2)))
    )
    # Opening takes the lowest of the noise; where nothing differs, that is all it takes.
    bias = float(np.median((smooth - opened)[agrees])) if agrees.any() else 0.0
    return opened + np.float32(bias)


def _roughness(smooth: Picture, away: Picture) -> Picture:
    """Scatter of single cells about what is smooth."""
    squares = np.where(np.isfinite(away), (away - smooth) ** 2, np.float32(0))
    share = cv2.blur(np.isfinite(away).astype(np.float32), AROUND)
    mean = np.asarray(cv2.blur(squares, AROUND)) / np.maximum(share, LEAST_KNOWN)
    # Sums that run along the rows come out below nought by their rounding.
    return np.sqrt(np.maximum(mean, 0))


def _disc(radius: int) -> UInt8[np.ndarray, "side side"]:
    side = 2 * max(radius, 1) + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)))


def read_coarser(path: Path, band: int = 1) -> tuple[Picture, Grid, str]:
    """A raster in cells that are few enough for memory, NaN where nothing is known.

    Returns:
        Values, their cells, and the CRS as WKT.
    """
    with rasterio.open(path) as file:
        step = -(-max(file.width, file.height) // MOST_CELLS)
        columns, rows = max(file.width // step, 1), max(file.height // step, 1)
        values: Any = file.read(
            band,
            window=((0, min(rows * step, file.height)), (0, min(columns * step, file.width))),
            out_shape=(rows, columns),
            resampling=Resampling.average,
            masked=True,
        )
        cell, corner = file.transform.a * step, (file.transform.c, file.transform.f)
        crs = file.crs.to_wkt()
    return values.astype(np.float32).filled(np.nan), Grid(*corner, cell, columns, rows), crs


def _write(path: Path, grid: Grid, crs: str, values: np.ndarray, nodata: float) -> None:
    profile = tiled_profile(grid, crs, values.dtype.name)
    profile |= {"nodata": nodata, "compress": "deflate", "zlevel": COMPRESSION_LEVEL}
    with tell_full_disk(path), rasterio.open(path, "w", **profile) as file:
        file.write(values, 1)


def fit_trend(
    plan: Float64[np.ndarray, "n 2"], differences: Scalars, bounds: Bounds
) -> SystematicPart:
    """Fit the systematic part robustly; buildings, woods and changed ground hardly count.

    Args:
        plan: Easting and northing of cells.
        differences: Surface minus DEM there, metres.
        bounds: West, south, east, north of the surface.
    """
    if len(differences) < 10 * TERMS:
        return SystematicPart(bounds, np.zeros(TERMS), float("nan"), len(differences))
    design = _design(plan, bounds)

    def solve(weights: Scalars) -> tuple[Float64[np.ndarray, "4"], Scalars]:
        side = design * weights[:, None]
        found = np.linalg.lstsq(side.T @ design, side.T @ differences, rcond=None)[0]
        return found, np.abs(differences - design @ found)

    found = solve_robustly(
        solve,
        np.abs(differences - np.median(differences)),
        # Squared: what is far off counts for nothing much.
        lambda lengths: huber_weights(lengths, HUBER) ** 2,
        passes=ROUNDS,
    )
    return SystematicPart(bounds, found, nmad(differences - design @ found), len(differences))


def _design(plan: Float64[np.ndarray, "n 2"], bounds: Bounds) -> Float64[np.ndarray, "n 4"]:
    west, south, east, north = bounds
    half = max(east - west, north - south) / 2
    x = (plan[:, 0] - (west + east) / 2) / half
    y = (plan[:, 1] - (south + north) / 2) / half
    return np.column_stack([np.ones(len(plan)), x, y, x**2 + y**2])


def hillshade(heights: Picture | Matrix, cell_m: float) -> UInt8[np.ndarray, "rows columns"]:
    """Relief under light from the north-west, 1 to 255; 0 in holes and beside them."""
    down, right = np.gradient(heights, cell_m)
    azimuth, high = np.radians([SUN_AZIMUTH_DEG, SUN_HEIGHT_DEG])
    light = (
        np.sin(high) - np.cos(high) * (right * np.sin(azimuth) - down * np.cos(azimuth))
    ) / np.sqrt(1 + right**2 + down**2)
    shown = 1 + 254 * np.clip(light, 0, 1)  # source: eight bits without nodata
    known = np.isfinite(light) & np.isfinite(heights)
    return np.where(known, shown, 0).astype(np.uint8)


def read_smooth(surface: Any, tile: Tile, beyond: int = 0) -> Matrix:
    """Heights of a tile and cells beyond it, each a weighted mean of the known ones about it.

    Args:
        surface: Open raster of heights, metres.
        tile: Column, row, columns, rows.
        beyond: Cells on each side that come with it.

    Returns:
        Metres; NaN in holes and beyond the raster.
    """
    column, row, columns, rows = tile
    wide = MARGIN_CELLS + beyond
    left, top = max(column - wide, 0), max(row - wide, 0)
    right = min(column + columns + wide, surface.width)
    bottom = min(row + rows + wide, surface.height)
    values = surface.read(1, window=window_of((left, top, right - left, bottom - top)))
    known = values != NODATA_M
    reach = MARGIN_CELLS / SMOOTH_CELLS
    weight = gaussian_filter(
        known.astype(np.float64), SMOOTH_CELLS, mode="constant", truncate=reach
    )
    filled = np.where(known, values, 0.0).astype(np.float64)
    total = gaussian_filter(filled, SMOOTH_CELLS, mode="constant", truncate=reach)
    sure = known & (weight >= LEAST_SMOOTHED)
    smooth = np.full((rows + 2 * beyond, columns + 2 * beyond), np.nan)
    first, above = max(column - beyond, 0), max(row - beyond, 0)
    last = min(column + columns + beyond, surface.width)
    below = min(row + rows + beyond, surface.height)
    inner = np.s_[above - top : below - top, first - left : last - left]
    at = np.s_[
        above - row + beyond : below - row + beyond,
        first - column + beyond : last - column + beyond,
    ]
    smooth[at] = np.where(sure, total / np.where(sure, weight, 1.0), np.nan)[inner]
    return smooth
