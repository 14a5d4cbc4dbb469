"""What became of the heights between two surfaces: their difference, and where it is significant.

Errors of both orientations bend whole surfaces against each other: shift, tilt and bowl are taken
out first, as against the DEM. What is left is smoothed, and its scatter over all ground tells how
many of the standard deviations that both surfaces state it amounts to: errors of cells beside each
other hang together, nobody knows how far. An area is ground beyond three times that scatter, with a
place in it that chance would hardly reach anywhere on all the ground that was compared.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rasterio
import rasterio.features
from affine import Affine
from scipy.stats import norm
from shapely.geometry import shape
from shapely.geometry.base import BaseGeometry

from core.arrays import Mask, Matrix
from core.geometry.crs import Bounds
from core.geometry.robust import nmad
from core.orthos.rectification import COMPRESSION_LEVEL
from core.progress import SILENT, Progress
from core.raster.dem import Dem
from core.raster.grid import (
    BLOCK_PX,
    RASTERIZING,
    Grid,
    tell_full_disk,
    tiled_profile,
    tiles_of,
    window_of,
)
from core.surface.ground import (
    LIMIT,
    MEDIAN_CELLS,
    NODATA_M,
    SystematicPart,
    bridged,
    fit_trend,
    read_coarser,
)
from core.surface.rectified import Picture

# design: what the median takes together is one place.
LEAST_CELLS = MEDIAN_CELLS**2
"""Heights have changed over so many connected cells at least."""
# design: some hundred thousand cells fix four coefficients, and a scatter.
SAMPLE_CELLS = 400
"""Cells along the longer side that the systematic part is fitted to."""
# design: what the median of cells whose errors are each their own leaves; nothing scatters less.
LEAST_SCATTER = 1 / MEDIAN_CELLS
"""Scatter of smoothed differences at least, in standard deviations of a cell."""
# design: one of twenty comparisons without any change shows one.
RISK = 0.05
"""Chance that any place of a comparison passes for changed that is not."""
# source: TIFF, predictor of floating numbers
PREDICTOR = 3


@dataclass(frozen=True, slots=True, eq=False)
class DatedSurface:
    """A surface and its standard deviations."""

    heights: Dem
    """Metres."""
    sigmas: Dem
    """Standard deviations of the heights, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class ChangedArea:
    """Connected ground whose height has changed."""

    outline: BaseGeometry
    """Along the edges of cells."""
    area_m2: float
    """Its area."""
    mean_m: float
    """Mean height difference, later minus earlier, metres."""
    sigma_m: float
    """Median standard deviation of a cell's difference, metres."""

    @property
    def volume_m3(self) -> float:
        """What was filled up (or, below nought, taken away)."""
        return self.area_m2 * self.mean_m


@dataclass(frozen=True, slots=True, eq=False)
class HeightChange:
    """The heights of two epochs compared."""

    areas: tuple[ChangedArea, ...]
    """Ground that was raised or lowered, the largest first."""
    compared_m2: float
    """Ground of which both know the height."""
    trend: SystematicPart
    """Systematic part of the difference, which was taken out."""
    scatter: float
    """Scatter of smoothed differences, over the standard deviation of a cell that both state."""


def compare_surfaces(
    earlier: DatedSurface,
    later: DatedSurface,
    bounds: Bounds,
    path: Path,
    crs: str,
    progress: Progress = SILENT,
) -> HeightChange | None:
    """Compare two surfaces, and write their difference and its standard deviation.

    Args:
        earlier: The first.
        later: The second.
        bounds: West, south, east, north that both cover, metres.
        path: The raster to write: later minus earlier less the systematic part, and its standard
            deviation, metres, in the cells of the coarser surface.
        crs: CRS of both.
        progress: Told per tile; may raise `Cancelled`.

    Returns:
        What has changed; None where no place has a height in both, and the file says nothing.

    Raises:
        OSError: The disk is full.
    """
    cell = max(one.heights.ground_sample_distance_m for one in (earlier, later))
    grid = Grid.over(bounds, cell)
    trend = _trend(earlier, later, grid)
    known = _write_difference(earlier, later, grid, trend, path, crs, progress)
    if not known:
        return None
    areas, scatter = _changed_areas(path)
    return HeightChange(areas, known * cell**2, trend, scatter)


def _trend(earlier: DatedSurface, later: DatedSurface, grid: Grid) -> SystematicPart:
    """The systematic part, from means of cells."""
    cell = grid.ground_sample_distance_m * max(1, max(grid.columns, grid.rows) // SAMPLE_CELLS)
    coarse = Grid.over(grid.bounds, cell)
    away = later.heights.measured_on(coarse) - earlier.heights.measured_on(coarse)
    known, plan = np.isfinite(away), _centres(coarse)
    return fit_trend(plan[known.ravel()], away[known].astype(np.float64), grid.bounds)


def _write_difference(
    earlier: DatedSurface,
    later: DatedSurface,
    grid: Grid,
    trend: SystematicPart,
    path: Path,
    crs: str,
    progress: Progress,
) -> int:
    """Write it; the number of cells with a height in both."""
    profile: dict[str, Any] = tiled_profile(grid, crs, "float32", 2) | {
        "nodata": NODATA_M,
        "compress": "deflate",
        "zlevel": COMPRESSION_LEVEL,
        "predictor": PREDICTOR,
        "interleave": "band",
        "sparse_ok": False,
    }
    tiles, known = list(tiles_of(grid, BLOCK_PX)), 0
    with tell_full_disk(path), rasterio.open(path, "w", **profile) as file:
        for band, said in enumerate(("later minus earlier", "standard deviation"), 1):
            file.set_band_description(band, said)
            file.set_band_unit(band, "m")
        for done, tile in enumerate(tiles, start=1):
            away, sigma = _difference(earlier, later, grid.window(*tile), trend)
            known += int(np.isfinite(away).sum())
            values = np.nan_to_num(np.stack([away, sigma]), nan=NODATA_M).astype(np.float32)
            file.write(values, window=window_of(tile))
            progress.report(done, len(tiles), "difference of heights")
    return known


def _difference(
    earlier: DatedSurface, later: DatedSurface, cells: Grid, trend: SystematicPart
) -> tuple[Matrix, Matrix]:
    """Difference less the trend, and its standard deviation, NaN where one is not known."""
    first, second, *sigmas = (
        one.measured_on(cells).astype(np.float64)
        for one in (earlier.heights, later.heights, earlier.sigmas, later.sigmas)
    )
    sigma = np.hypot(*sigmas)
    away = second - first - trend.at(_centres(cells)).reshape(first.shape)
    known = np.isfinite(away) & np.isfinite(sigma)
    return np.where(known, away, np.nan), np.where(known, sigma, np.nan)


def _changed_areas(path: Path) -> tuple[tuple[ChangedArea, ...], float]:
    """Connected cells that were raised or lowered, in cells that fit into memory; the scatter."""
    away, grid, _ = read_coarser(path)
    sigma = read_coarser(path, 2)[0]
    known = np.isfinite(away) & np.isfinite(sigma)
    # The median keeps edges where they are; holes are bridged, for it knows none.
    whole = np.where(known, away, bridged(np.where(known, away, np.float32(np.nan))))
    smooth = np.asarray(cv2.medianBlur(whole, MEDIAN_CELLS))
    ratio = np.where(known, smooth / np.where(known, sigma, 1), np.float32(0))
    scatter = max(nmad(ratio[known].astype(np.float64)), LEAST_SCATTER)
    ratio /= np.float32(scatter)
    # Both signs may be reached by chance, at every place that the median makes one.
    places = max(int(known.sum()) / LEAST_CELLS, 1.0)
    sure = max(float(norm.isf(RISK / (2 * places))), LIMIT)
    found = [
        area
        for signed in (ratio, -ratio)
        for area in _areas(signed > LIMIT, signed > sure, away, sigma, grid)
    ]
    return tuple(sorted(found, key=lambda one: -one.area_m2)), scatter


def _areas(
    mask: Mask, sure: Mask, away: Picture, sigma: Picture, grid: Grid
) -> Sequence[ChangedArea]:
    """The connected parts of a mask that are large enough and hold something sure."""
    _, labels, figures, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    large = np.flatnonzero(figures[:, cv2.CC_STAT_AREA] >= LEAST_CELLS)
    kept = np.isin(labels, np.intersect1d(large, labels[sure & mask]))
    with RASTERIZING:
        shapes = list(
            rasterio.features.shapes(
                np.asarray(labels, np.int32),
                mask=kept,
                transform=Affine.from_gdal(*grid.geotransform),
            )
        )
    cell_m2 = grid.ground_sample_distance_m**2
    areas: list[ChangedArea] = []
    for outline, number in shapes:
        left, top, wide, high = figures[int(number), : cv2.CC_STAT_AREA].tolist()
        at = np.s_[top : top + high, left : left + wide]
        part = labels[at] == int(number)
        areas.append(
            ChangedArea(
                shape(outline),
                float(part.sum()) * cell_m2,
                float(np.mean(away[at][part])),
                float(np.median(sigma[at][part])),
            )
        )
    return areas


def _centres(cells: Grid) -> np.ndarray:
    east, north = np.meshgrid(*cells.centres())
    return np.column_stack([east.ravel(), north.ravel()])
