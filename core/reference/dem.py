"""The terrain: heights at exact places, bilinear, from one DEM file or many."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float32, Float64

from core.arrays import Scalars, locked
from core.doubts import Doubt
from core.errors import ReferenceDataError
from core.geometry.crs import Bounds, parse_crs, shared_bounds
from core.geometry.grid import Grid
from core.reference.composite import ReadOptions, read_onto
from core.reference.gaps import LARGEST_GAP_PX, fill_gaps, small_gaps
from core.reference.resampling import Kernel
from core.reference.sheets import SheetSet, damage_told, open_raster, open_sheets

MARGIN_PX = LARGEST_GAP_PX + 2
"""Read round every window, so that a gap at its edge is filled as it would be in its middle."""
PIECE_PX = 1024
"""Points are looked up in pieces of this size, so that a large DEM is never read whole."""
MOST_PIECES = 40
"""Pieces kept in memory: 200 MB."""
AT_ONCE = 1_000_000
"""Heights looked up at once, which bounds the memory they need."""
LOOKED_THROUGH_PX = 40_000_000
"""Files up to this size are looked through for heights when they are opened."""

PlanePoints = Float64[np.ndarray, "n 2"]
"""Easting and northing, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class HeightWindow:
    """Heights held in memory."""

    grid: Grid
    """Where they lie."""
    heights: Float32[np.ndarray, "rows columns"]
    """Metres; NaN outside and in gaps."""
    filled: Bool[np.ndarray, "rows columns"]
    """True where a small gap was closed by interpolation."""


@dataclass(frozen=True, slots=True, eq=False)
class Dem:
    """A terrain model of the block's CRS; holds no open file, may be pickled and shared."""

    sheets: SheetSet
    """The files and how they lie together."""
    grid: Grid
    """Pixels of the finest file, over all files."""
    window: HeightWindow | None = None
    """What was cropped into memory; then nothing beyond it is known."""
    recent: dict[tuple[int, int], HeightWindow] = field(
        default_factory=dict[tuple[int, int], HeightWindow], repr=False
    )
    """Pieces that were read lately, by column and row: a memory that changes no answer."""

    def __reduce__(self) -> tuple[type["Dem"], tuple[SheetSet, Grid, HeightWindow | None]]:
        """A copy in another process reads its own pieces."""
        return Dem, (self.sheets, self.grid, self.window)

    @property
    def bounds(self) -> Bounds:
        """West, south, east, north of the outer pixel edges, metres."""
        return self.grid.bounds

    @property
    def ground_sample_distance_m(self) -> float:
        """Pixel size, metres."""
        return self.grid.ground_sample_distance_m

    @property
    def notes(self) -> tuple[Doubt, ...]:
        """What the operator should know, such as files reprojected on the fly."""
        return self.sheets.notes

    @property
    def filled(self) -> int:
        """Pixels of small gaps that were closed in the part held in memory."""
        return int(self.window.filled.sum()) if self.window else 0

    def cropped(self, bounds: Bounds) -> "Dem":
        """The DEM within bounds (and a margin), held in memory: for many look-ups."""
        if self.window is not None:
            return self
        part = _covering(self.grid, bounds, 2)
        return Dem(self.sheets, part, self._read(part))

    def heights(self, points: PlanePoints) -> Scalars:
        """Heights at easting and northing, metres; NaN outside the DEM and in gaps.

        Bilinear between pixel centres; within the outer half pixel the edge goes on level.
        """
        result = np.full(len(points), np.nan)
        for rows, window in self._windows(points):
            result[rows] = _bilinear(window.heights, window.grid.grid_from_object(points[rows]))
        return result

    def filled_at(self, points: PlanePoints) -> Bool[np.ndarray, "n"]:
        """Whether the height at a place rests on a small gap that was closed."""
        result = np.zeros(len(points), dtype=bool)
        for rows, window in self._windows(points):
            share = window.filled.astype(np.float32)
            place = window.grid.grid_from_object(points[rows])
            result[rows] = _bilinear(share, place) > 0
        return result

    def slopes(self, points: PlanePoints) -> PlanePoints:
        """Rise of the terrain to the east and to the north (metres per metre); NaN in gaps.

        Central differences over two pixels about the place.
        """
        step = self.ground_sample_distance_m
        moves = step * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]], dtype=np.float64)
        around = (points[:, None, :] + moves).reshape(-1, 2)
        east, west, north, south = self.heights(around).reshape(-1, 4).T
        return np.column_stack([east - west, north - south]) / (2 * step)

    def on(self, grid: Grid, kernel: Kernel = "linear") -> Float64[np.ndarray, "rows columns"]:
        """Heights on a grid, metres, NaN in gaps; averaged where the grid is coarser.

        Args:
            grid: Any grid in the block's CRS.
            kernel: `linear`, or `cubic` for a surface without kinks, as for hill shading.
        """
        if grid.ground_sample_distance_m > 2 * self.ground_sample_distance_m or kernel == "cubic":
            heights = self._resampled(grid, kernel).astype(np.float64)
            return np.where(self._inside(grid), heights, np.nan)
        east, north = grid.centres()
        heights = np.empty((grid.rows, grid.columns))
        step = max(1, AT_ONCE // grid.columns)
        for row in range(0, grid.rows, step):
            points = np.stack(np.meshgrid(east, north[row : row + step]), axis=-1)
            heights[row : row + step] = self.heights(points.reshape(-1, 2)).reshape(-1, len(east))
        return heights

    def mean_height(self, bounds: Bounds | None = None) -> float:
        """Mean of the heights within bounds, metres; NaN where the DEM has none there."""
        low, high = self.height_range(bounds, mean=True)
        return (low + high) / 2

    def height_range(self, bounds: Bounds | None = None, mean: bool = False) -> tuple[float, float]:
        """Lowest and highest height within bounds, metres, of a few hundred pixels each way.

        Peaks narrower than that are averaged; with `mean`, both are the mean. NaN without heights.
        """
        west, south, east, north = shared_bounds(self.bounds, bounds or self.bounds)
        if east <= west or north <= south:
            return float("nan"), float("nan")
        gsd = max(self.ground_sample_distance_m, max(east - west, north - south) / 400)
        columns, rows = max(1, int((east - west) / gsd)), max(1, int((north - south) / gsd))
        heights = self.on(Grid(west, north, gsd, columns, rows))
        known = heights[np.isfinite(heights)]
        if not len(known):
            return float("nan"), float("nan")
        average = float(known.mean(dtype=np.float64))
        return (average, average) if mean else (float(known.min()), float(known.max()))

    def _windows(self, points: PlanePoints) -> Iterator[tuple[np.ndarray, HeightWindow]]:
        """Which points lie in which piece, with the piece."""
        place = self.grid.grid_from_object(points)
        inside = ((place >= 0) & (place <= (self.grid.columns, self.grid.rows))).all(axis=1)
        if self.window is not None:
            yield np.flatnonzero(inside), self.window
            return
        rows = np.flatnonzero(inside)
        # The far edge itself belongs to the last piece.
        last = (self.grid.columns - 1, self.grid.rows - 1)
        piece = np.minimum(np.floor(place[rows]), last).astype(np.int64) // PIECE_PX
        for key in np.unique(piece, axis=0):
            yield rows[(piece == key).all(axis=1)], self._piece(int(key[0]), int(key[1]))

    def _piece(self, column: int, row: int) -> HeightWindow:
        """A square piece of the DEM and a rim of two pixels, kept for the next question."""
        held = self.recent.get((column, row))
        if held is not None:
            return held
        # Another thread may add or drop pieces meanwhile; at worst one is read twice.
        for old in list(self.recent)[: max(0, len(self.recent) - MOST_PIECES + 1)]:
            self.recent.pop(old, None)
        first = np.maximum(0, np.array([column, row]) * PIECE_PX - 2)
        size = np.array([self.grid.columns, self.grid.rows])
        last = np.minimum(size, (np.array([column, row]) + 1) * PIECE_PX + 2)
        held = self._read(self.grid.window(*first.tolist(), *(last - first).tolist()))
        self.recent[(column, row)] = held
        return held

    def _read(self, part: Grid) -> HeightWindow:
        """The pixels of a part of the DEM's own grid, small gaps closed."""
        column, row = np.rint(self.grid.grid_from_object(np.array([[part.west, part.north]])))[0]
        left, top = max(0, int(column) - MARGIN_PX), max(0, int(row) - MARGIN_PX)
        right = min(self.grid.columns, int(column) + part.columns + MARGIN_PX)
        bottom = min(self.grid.rows, int(row) + part.rows + MARGIN_PX)
        wide = self.grid.window(left, top, right - left, bottom - top)
        heights = self._resampled(wide, "linear")
        gaps = small_gaps(heights)
        heights = fill_gaps(heights, gaps)
        down = slice(int(row) - top, int(row) - top + part.rows)
        across = slice(int(column) - left, int(column) - left + part.columns)
        return HeightWindow(
            part, locked(heights[down, across], np.float32), locked(gaps[down, across], bool)
        )

    def _resampled(self, grid: Grid, kernel: Kernel) -> Float32[np.ndarray, "rows columns"]:
        """The files on a grid, gaps left open."""
        sampled = read_onto(self.sheets, grid, ReadOptions("heights", kernel, exact_to=4))
        known = sampled.coverage >= (1 - 1e-4 if kernel == "linear" else 0.5)
        coarse = grid.ground_sample_distance_m > self.ground_sample_distance_m * (1 + 1e-9)
        known = sampled.coverage >= 0.5 if coarse else known
        return np.where(known, sampled.values[0], np.float32(np.nan))

    def _inside(self, grid: Grid) -> Bool[np.ndarray, "rows columns"]:
        """Which pixels of a grid lie within the bounds."""
        east, north = grid.centres()
        west, south, right, top = self.bounds
        down = (north >= south) & (north <= top)
        return down[:, None] & ((east >= west) & (east <= right))


def open_dem(paths: Sequence[str | Path] | str | Path, crs: str) -> Dem:
    """Look at the files once and lay them together.

    Args:
        paths: One file or several, of any raster format, pixel size and CRS.
        crs: The block's CRS; files without one are taken to be in it, files in another are
            reprojected while reading, which `notes` tells.

    Raises:
        ReferenceDataError: A file is missing, damaged, has no place or no heights at all.
        CrsError: A file's coordinates do not fit its CRS, or no CRS can be found for it.
    """
    block = parse_crs(crs, "block.toml [block] crs")
    files = [paths] if isinstance(paths, str | Path) else list(paths)
    sheets = open_sheets(files, block, "DEM")
    for path in files:
        _refuse_empty(path)
    return Dem(sheets, _own_grid(sheets))


def _own_grid(sheets: SheetSet) -> Grid:
    """The finest file's pixels, extended over all files."""
    finest = sheets.lattices[0]
    gsd = finest.ground_sample_distance_m
    west, south, east, north = sheets.bounds
    if finest.north_up:
        # On its own pixels, heights are read, not interpolated.
        (a, _, c), (_, e, f) = finest.plane_from_lattice
        if abs(a + e) < 1e-9 * a:
            gsd = float(a)
            west = float(c) + np.floor((west - c) / gsd + 1e-6) * gsd
            north = float(f) + np.ceil((north - f) / gsd - 1e-6) * gsd
    columns = int(np.ceil((east - west) / gsd - 1e-6))
    rows = int(np.ceil((north - south) / gsd - 1e-6))
    return Grid(float(west), float(north), gsd, columns, rows)


def _refuse_empty(path: str | Path) -> None:
    """A DEM file of nothing but nodata was cut in the wrong place."""
    with open_raster(path) as raster, damage_told(path):
        if raster.width * raster.height > LOOKED_THROUGH_PX:
            return
        shape = (min(raster.height, 500), min(raster.width, 500))
        heights = raster.read(1, out_shape=shape, masked=True)
        if np.isfinite(heights.compressed()).any():
            return
        # A few scattered pixels may fall between those that were looked at.
        if np.isfinite(raster.read(1, masked=True).compressed()).any():
            return
    raise ReferenceDataError(
        path,
        "the DEM holds no height at all: every pixel is nodata.",
        "Export it again over the block, or check its nodata value.",
    )


def _covering(grid: Grid, bounds: Bounds, margin: int) -> Grid:
    """The part of a grid over bounds and a margin of pixels; at least one pixel."""
    west, south, east, north = bounds
    corners = grid.grid_from_object(np.array([[west, north], [east, south]]))
    size = np.array([grid.columns, grid.rows])
    low = np.clip(np.floor(corners[0]).astype(int) - margin, 0, size - 1)
    high = np.clip(np.ceil(corners[1]).astype(int) + margin, low + 1, size)
    columns, rows = (high - low).tolist()
    return grid.window(int(low[0]), int(low[1]), columns, rows)


def _bilinear(raster: Float32[np.ndarray, "rows columns"], places: PlanePoints) -> Scalars:
    """Values at raster places (column, row, corner origin) between the four pixel centres."""
    rows, columns = raster.shape
    column = np.clip(places[:, 0] - 0.5, 0, columns - 1)
    row = np.clip(places[:, 1] - 0.5, 0, rows - 1)
    left = np.minimum(column.astype(np.int64), max(columns - 2, 0))
    above = np.minimum(row.astype(np.int64), max(rows - 2, 0))
    right, below = np.minimum(left + 1, columns - 1), np.minimum(above + 1, rows - 1)
    u, v = column - left, row - above
    total = np.zeros(len(places))
    for r, c, weight in (
        (above, left, (1 - u) * (1 - v)),
        (above, right, u * (1 - v)),
        (below, left, (1 - u) * v),
        (below, right, u * v),
    ):
        # A neighbour that has no say must not make the height unknown.
        total += np.where(weight > 1e-9, weight * raster[r, c], 0.0)
    return total
