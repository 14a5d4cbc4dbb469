"""Holes: ground inside a raster product that no photo covers, or whose height a DEM lacks."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import rasterio
from jaxtyping import Float32, Int64, Shaped
from shapely.geometry.base import BaseGeometry

from core.arrays import Mask, Scalars
from core.frames import HALF_PIXEL
from core.geometry.areas import Area
from core.geometry.crs import shared_bounds
from core.raster.dem import HELD_PX, LARGEST_GAP_PX, Dem
from core.raster.grid import Grid, burn, burn_area, sums_over_cells

# design: some megabytes, and a cell of two metres on a block of ten kilometres.
LATTICE = 2048
"""Cells along the longer side in which holes are told apart."""
# design: a band of 64 MB at most on the widest mosaics.
BAND_CELLS = 64
"""Rows of cells that are read at once."""
# design: 63 degrees; no ground stands like that all around a place of ten cells and more.
WALL = 2.0
"""Rise over run of every edge of what a DEM has at exactly nought, that is then no height."""

Counts = Int64[np.ndarray, "rows columns"]


@dataclass(frozen=True, slots=True)
class Hole:
    """A connected part without data that the raster surrounds."""

    area_m2: float
    """Its area."""
    east: float
    """Easting of its middle, or of its cell nearest to that, metres in the raster's CRS."""
    north: float
    """Northing likewise."""
    masked_in: tuple[str, ...] = ()
    """Photos whose picture reaches over its middle, where it is left out; none reaches if empty."""
    without_height: bool = False
    """Whether the DEM has no height at its middle, so that no photo can be laid there."""
    hidden_in: tuple[str, ...] = ()
    """Photos that reach over it, and from which something higher hides ground of it."""

    @property
    def why(self) -> Literal["no-height", "hidden", "masked", "unreached"]:
        """Why nothing is shown."""
        if self.without_height:
            return "no-height"
        if self.hidden_in:
            return "hidden"
        return "masked" if self.masked_in else "unreached"

    @property
    def told_photos(self) -> tuple[str, ...]:
        """The photos that the reason names."""
        return self.hidden_in or self.masked_in


def find_holes(path: Path, area: Area | None = None) -> tuple[Hole, ...]:
    """Holes of a raster, largest first; what is open towards its edge is none.

    Of an area, everything is a hole that has no data within it, and nothing else.

    They are told apart on a lattice, whose cells are empty as soon as one pixel of theirs is: two
    empty places nearer than a cell are one. Areas count pixels.

    Args:
        path: A raster whose first band has a nodata value or a mask; axes along the CRS, metres.
        area: What data are asked for, in the raster's CRS.
    """
    with rasterio.open(path) as file:
        side = max(1, -(-max(file.width, file.height) // LATTICE))
        missing = missing_in_cells(file, side, area)
        transform, pixel_m2 = file.transform, abs(file.res[0] * file.res[1])
    # Outside lies all round, so that what reaches the edge is one with it.
    empty = np.pad(missing > 0, 1, constant_values=area is None).astype(np.uint8)
    count, numbers, _, middles = cv2.connectedComponentsWithStats(empty, connectivity=4)
    pixels = np.bincount(numbers.ravel(), np.pad(missing, 1).ravel(), count)
    found: list[Hole] = []
    for number in range(1, count):
        if area is None and number == numbers[0, 0]:
            continue
        place = _within(numbers, number, middles[number])
        column, row = ((place - 0.5) * side).tolist()
        east, north = transform @ (column, row)
        found.append(Hole(float(pixels[number]) * pixel_m2, float(east), float(north)))
    return tuple(sorted(found, key=lambda hole: (-hole.area_m2, hole.east, hole.north)))


def _within(numbers: Shaped[np.ndarray, "r c"], number: int, middle: Scalars) -> Scalars:
    """The middle of a part, or the middle of its cell nearest to it where it is bent."""
    column, row = np.rint(middle).astype(int).tolist()
    if numbers[row, column] == number:
        return middle
    cells = np.argwhere(numbers == number)[:, ::-1].astype(np.float64)
    return cells[np.argmin(np.hypot(*(cells - middle).T))]


def missing_in_cells(file: Any, side: int, area: Area | None = None) -> Counts:
    """Pixels without data in each cell; those beyond the last row and column are without.

    Args:
        file: Open raster with square pixels.
        side: Side of a cell, pixels.
        area: Nothing is missing outside of it.
    """
    gsd, _, west, _, _, north = tuple(file.transform)[:6]
    grid = Grid(west, north, gsd, file.width, file.height)
    rows, columns = -(-file.height // side), -(-file.width // side)
    found = np.zeros((rows, columns), dtype=np.int64)
    for first in range(0, rows, BAND_CELLS):
        top = first * side
        tall = min(BAND_CELLS * side, file.height - top)
        seen = file.read_masks(1, window=((top, top + tall), (0, file.width))) > 0
        cells = np.zeros((-(-tall // side) * side, columns * side), dtype=np.uint8)
        if area is None:
            cells[:tall, : file.width] = seen
        else:
            cells[:] = 1
            part = grid.window(0, top, file.width, tall)
            cells[:tall, : file.width] = seen | ~burn_area(area, part)
        shown = sums_over_cells(cells, side)
        found[first : first + len(shown)] = side * side - shown
    return found


def find_height_holes(dem: Dem, area: BaseGeometry) -> tuple[Hole, ...]:
    """Ground in an area within the DEM whose height is not known, largest first.

    Small gaps, which the DEM closes, are none. A DEM too large to be held is looked at in coarser
    cells, each of them known where most of it is.

    Args:
        dem: Terrain.
        area: Ground that heights are needed for, in the block's CRS.
    """
    found = _cells_within(dem, area)
    if found is None:
        return ()
    grid, heights, closed = found
    unknown = np.isnan(heights)
    if not unknown.any():
        return ()
    return _parts_of(unknown & (burn([(area, 1)], grid, empty=0) == 1), grid, closed)


def find_noughts(dem: Dem, area: BaseGeometry) -> tuple[Hole, ...]:
    """Ground in an area to which a DEM gives exactly nought between walls, largest first.

    So programs write what they do not know if they declare no nodata. The sea has no walls all
    around. Arguments as of `find_height_holes`.
    """
    found = _cells_within(dem, area)
    if found is None or not (found[1] == 0).any():
        return ()
    grid, heights, closed = found
    count, numbers = cv2.connectedComponents((heights == 0).astype(np.uint8), connectivity=4)
    rim = np.where((heights == 0) | np.isnan(heights), np.inf, heights).astype(np.float32)
    lowest = cv2.erode(rim, np.ones((3, 3), np.uint8))
    step = WALL * grid.ground_sample_distance_m
    for number in range(1, count):
        part = numbers == number
        if not step < lowest[part].min() < np.inf:
            numbers[part] = 0
    return _parts_of((numbers > 0) & (burn([(area, 1)], grid, empty=0) == 1), grid, closed)


def _cells_within(
    dem: Dem, area: BaseGeometry
) -> tuple[Grid, Float32[np.ndarray, "rows columns"], int] | None:
    """Heights of cells about an area, and how many cells of a gap are closed; None outside."""
    west, south, east, north = shared_bounds(dem.bounds, area.bounds)
    if area.is_empty or east <= west or north <= south:
        return None
    part = dem.cropped((west, south, east, north))
    if part.window is not None:
        return part.window.grid, part.window.heights, 0
    # Up to twice the pixel size heights are interpolated from pixels that are all held.
    side = max(3, int(np.ceil(np.sqrt(part.grid.columns * part.grid.rows / HELD_PX))))
    cell_m = side * dem.ground_sample_distance_m
    grid = Grid(west, north, cell_m, int((east - west) / cell_m), int((north - south) / cell_m))
    return grid, dem.on(grid).astype(np.float32), -(-LARGEST_GAP_PX // side)


def _parts_of(missing: Mask, grid: Grid, closed: int) -> tuple[Hole, ...]:
    """Connected parts of more than `closed` cells across or down, largest first."""
    _, _, figures, middles = cv2.connectedComponentsWithStats(
        missing.astype(np.uint8), connectivity=4
    )
    sides = figures[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1)
    kept = np.flatnonzero(sides > closed)
    # The first is what is not missing.
    kept = kept[kept > 0]
    east, north = grid.object_from_grid(middles[kept] + HALF_PIXEL).T.tolist()
    areas = figures[kept, cv2.CC_STAT_AREA] * grid.ground_sample_distance_m**2
    found = [Hole(*figures) for figures in zip(areas.tolist(), east, north, strict=True)]
    return tuple(sorted(found, key=lambda hole: (-hole.area_m2, hole.east, hole.north)))
