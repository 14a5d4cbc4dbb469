"""Orthos in small: means over square cells that all orthos of a block share."""

from dataclasses import dataclass

import cv2
import numpy as np
import rasterio
from jaxtyping import Float32, Float64

from core.arrays import Mask, Scalars, locked
from core.orthos.rectification import OrthoProduct
from core.raster.grid import Grid, window_of

# design: some tens of megabytes of the widest orthos
STRIP_CELLS = 128
"""Rows of cells that are read at once."""


@dataclass(frozen=True, slots=True, eq=False)
class Overview:
    """One ortho as means over cells; cells of different orthos coincide."""

    photo_id: str
    """The photo."""
    nadir: tuple[float, float]
    """Easting and northing below the perspective centre, metres."""
    grid: Grid
    """Where its cells lie, on multiples of their size."""
    values: Float32[np.ndarray, "rows columns"]
    """Mean gray value of what is valid in each cell; NaN where nothing is."""
    share: Float32[np.ndarray, "rows columns"]
    """Valid share of each cell, 0 to 1."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", locked(self.values, np.float32))
        object.__setattr__(self, "share", locked(self.share, np.float32))

    @property
    def full(self) -> Mask:
        """Cells without a single invalid pixel."""
        # design: rounding in single precision
        return np.asarray(self.share > 1 - 1e-6)

    @property
    def touched(self) -> Mask:
        """Cells with at least one valid pixel."""
        return np.asarray(self.share > 0)

    def coarser(self, factor: int) -> "Overview":
        """The same in cells `factor` times as large; cells still coincide between orthos."""
        step = self.grid.ground_sample_distance_m * factor
        grid = Grid.over(self.grid.bounds, step)
        corner = grid.grid_from_object(np.array([[self.grid.west, self.grid.north]]))[0] * factor
        column, row = round(float(corner[0])), round(float(corner[1]))
        sums = np.zeros((grid.rows * factor, grid.columns * factor), dtype=np.float32)
        shares = np.zeros_like(sums)
        part = np.s_[row : row + self.grid.rows, column : column + self.grid.columns]
        sums[part] = np.where(self.touched, self.values * self.share, 0)
        shares[part] = self.share
        cells = (grid.rows, factor, grid.columns, factor)
        total, share = (band.reshape(cells).sum(axis=(1, 3)) for band in (sums, shares))
        # design: no division by nought
        values = np.where(share > 0, total / np.maximum(share, 1e-6), np.nan)
        return Overview(self.photo_id, self.nadir, grid, values, share / factor**2)


def read_overview(ortho: OrthoProduct, pixels_per_cell: int) -> Overview:
    """Means over cells of an ortho, read strip by strip."""
    gsd = ortho.grid.ground_sample_distance_m
    grid = Grid.over(ortho.grid.bounds, gsd * pixels_per_cell)
    corner = np.array([[ortho.grid.west, ortho.grid.north]])
    offset = np.rint(grid.grid_from_object(corner)[0] * pixels_per_cell)
    column, row = int(offset[0]), int(offset[1])
    sums = np.zeros((grid.rows, grid.columns), dtype=np.float32)
    counts = np.zeros_like(sums)
    columns_in_cells = grid.columns * pixels_per_cell
    with rasterio.open(ortho.path) as file:
        for top in range(0, grid.rows, STRIP_CELLS):
            cells = np.s_[top : min(top + STRIP_CELLS, grid.rows)]
            tall = (cells.stop - top) * pixels_per_cell
            first = max(top * pixels_per_cell - row, 0)
            last = min(top * pixels_per_cell + tall - row, ortho.grid.rows)
            strip = np.zeros((tall, columns_in_cells), dtype=np.float32)
            begin = first + row - top * pixels_per_cell
            window = window_of((0, first, ortho.grid.columns, last - first))
            place = np.s_[begin : begin + last - first, column : column + ortho.grid.columns]
            strip[place] = file.read(1, window=window)
            sums[cells] = _sums(strip, pixels_per_cell)
            counts[cells] = np.rint(_sums((strip > 0).astype(np.float32), pixels_per_cell))
    values = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
    return Overview(ortho.photo_id, ortho.nadir, grid, values, counts / pixels_per_cell**2)


def _sums(strip: Float32[np.ndarray, "_ _"], side: int) -> Float32[np.ndarray, "_ _"]:
    """Sums over square cells."""
    size = (strip.shape[1] // side, strip.shape[0] // side)
    means = cv2.resize(strip, size, interpolation=cv2.INTER_AREA)
    return np.asarray(means, np.float32) * np.float32(side**2)


@dataclass(frozen=True, slots=True, eq=False)
class CommonCells:
    """What two photos show of the same cells, as parallel arrays."""

    first: Scalars
    """Means of the first."""
    second: Scalars
    """Means of the second."""
    places: Float64[np.ndarray, "n 2"]
    """Easting and northing of the middles of the cells, metres."""


def common_cells(first: Overview, second: Overview) -> CommonCells:
    """Values of both overviews in the cells that are full in both."""
    west = max(first.grid.bounds[0], second.grid.bounds[0])
    south = max(first.grid.bounds[1], second.grid.bounds[1])
    east = min(first.grid.bounds[2], second.grid.bounds[2])
    north = min(first.grid.bounds[3], second.grid.bounds[3])
    if west >= east or south >= north:
        return CommonCells(np.zeros(0), np.zeros(0), np.zeros((0, 2)))
    parts: list[tuple[slice, slice]] = []
    for overview in (first, second):
        corners = overview.grid.grid_from_object(np.array([[west, north], [east, south]]))
        (column, row), (end_column, end_row) = np.rint(corners).astype(int)
        parts.append((slice(row, end_row), slice(column, end_column)))
    both = first.full[parts[0]] & second.full[parts[1]]
    eastings, northings = first.grid.centres()
    rows, columns = np.nonzero(both)
    places = np.column_stack([eastings[parts[0][1]][columns], northings[parts[0][0]][rows]])
    values = (first.values[parts[0]][both], second.values[parts[1]][both])
    return CommonCells(values[0].astype(np.float64), values[1].astype(np.float64), places)
