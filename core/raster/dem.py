"""The terrain: heights at exact places, bilinear, from one DEM file or several.

Small gaps are closed by the smoothest surface through their surroundings. A block without a DEM
uses level ground.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from core.arrays import Indices, Scalars, locked
from core.doubts import Doubt
from core.frames import HALF_PIXEL
from core.geometry.crs import Bounds, parse_crs, shared_bounds
from core.raster.files import TILES
from core.raster.grid import Grid
from core.raster.lattices import SheetSet, laid_over, no_sheets, open_sheets
from core.raster.sampling import Kernel, ReadOptions, read_onto
from core.raster.sheets import label_parts

# design: houses and ponds that laser scans leave open; over more, the slope at the rim says little.
LARGEST_GAP_PX = 10
"""Gaps up to this size in rows and in columns are closed; larger ones stay gaps."""
# design: the largest gap and the rim its second differences reach into.
MARGIN_PX = LARGEST_GAP_PX + 2
"""Read round every window, so that a gap at its edge is filled as it would be in its middle."""
# design: central differences reach one pixel, bilinear interpolation another.
RIM_PX = 2
"""Kept round every part, so that slopes and interpolation at its edge find their neighbours."""
# design: five megabytes, the ground of one photo on a DEM of one to five metres.
PIECE_PX = 1024
"""Points are looked up in pieces of this size, so that a large DEM is never read whole."""
# design: 0.9 GB while it is read, 36 bytes a pixel, a fifth of the memory a stage may take.
HELD_PX = 25_000_000
"""A part of no more pixels is held in memory."""
# design: coarser ones are only asked for mean heights and hill shading.
EXACT_TO = 4
"""Up to this reduction heights are means of original pixels."""
# design: the majority.
LEAST_SHARE = 0.5
"""A coarser pixel is known where the files know this share of it."""
# design: a hill of a photo's hundredth counts; a spike of a pixel does not.
RANGE_PX = 400
"""The range of heights is taken from so many pixels a side."""
# design: rounding of coordinates, a millionth of a millimetre on a DEM of one metre.
NO_WEIGHT = 1e-9
"""A neighbour with less weight has no say, so that its gap makes no height unknown."""
# design: whatever is drawn on it needs no finer nodes.
LEVEL_PIXEL_M = 10.0
"""Pixel that level ground counts as having, metres."""

PlanePoints = Float64[np.ndarray, "n 2"]
"""Easting and northing, metres."""


@runtime_checkable
class HeightSource(Protocol):
    """Whatever knows the height of the ground."""

    def heights(self, points: PlanePoints) -> Scalars:
        """Height of each place, metres; NaN where it is not known."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class HeightWindow:
    """Heights held in memory."""

    grid: Grid
    """Where they lie."""
    heights: Float32[np.ndarray, "rows columns"]
    """Metres; NaN outside and in gaps."""
    filled: Bool[np.ndarray, "rows columns"]
    """True where a small gap was closed by interpolation."""

    @property
    def nbytes(self) -> int:
        """Memory it takes."""
        return self.heights.nbytes + self.filled.nbytes


@dataclass(frozen=True, slots=True, eq=False)
class Dem:
    """A terrain model of the block's CRS; holds no open file, may be pickled and shared."""

    sheets: SheetSet
    """The files and how they lie together."""
    grid: Grid
    """Pixels of the finest file, over all files."""
    window: HeightWindow | None = None
    """What was cropped into memory; then nothing beyond it is known."""

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
        """The DEM within bounds (and a margin), held in memory if it fits: for many look-ups."""
        if self.window is not None:
            return self
        part = self.grid.covering(bounds, RIM_PX)
        held = self._read(part) if part.columns * part.rows <= HELD_PX else None
        return Dem(self.sheets, part, held)

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
            heights = self.measured_on(grid, kernel).astype(np.float64)
            return np.where(self._inside(grid), heights, np.nan)
        window = self.window or self._read(self.grid.covering(grid.bounds, RIM_PX))
        east, north = grid.centres()
        corners = np.column_stack([east[[0, -1]], north[[0, -1]]])
        (first, top), (last, bottom) = window.grid.grid_from_object(corners)
        columns = _neighbours(np.linspace(first, last, grid.columns), window.grid.columns)
        rows = _neighbours(np.linspace(top, bottom, grid.rows), window.grid.rows)
        lines = _mix(window.heights[rows[0]], window.heights[rows[1]], rows[2][:, None])
        heights = _mix(lines[:, columns[0]], lines[:, columns[1]], columns[2])
        return np.where(self._inside(grid), heights, np.nan)

    def measured_on(
        self, grid: Grid, kernel: Kernel = "linear"
    ) -> Float32[np.ndarray, "rows columns"]:
        """Heights on a grid, metres; NaN where the files have none, however small the gap."""
        sampled = read_onto(self.sheets, grid, ReadOptions("heights", kernel, EXACT_TO))
        # design: rounding of pixel sizes
        coarse = grid.ground_sample_distance_m > self.ground_sample_distance_m * (1 + 1e-9)
        # On the files' own pixels each is known or not, give or take the sum of the weights.
        # design: the sum of a thousand single-precision weights rounds by less
        least = LEAST_SHARE if coarse or kernel == "cubic" else 1 - 1e-4
        return np.where(sampled.coverage >= least, sampled.values[0], np.float32(np.nan))

    def mean_height(self, bounds: Bounds | None = None) -> float:
        """Mean of the heights within bounds, metres; NaN where the DEM has none there."""
        known = self._overview(bounds)
        return float(known.mean()) if len(known) else float("nan")

    def _overview(self, bounds: Bounds | None) -> Scalars:
        """The heights known within bounds, of a few hundred pixels each way."""
        west, south, east, north = shared_bounds(self.bounds, bounds or self.bounds)
        if east <= west or north <= south:
            return np.zeros(0)
        gsd = max(self.ground_sample_distance_m, max(east - west, north - south) / RANGE_PX)
        columns, rows = max(1, int((east - west) / gsd)), max(1, int((north - south) / gsd))
        heights = self.on(Grid(west, north, gsd, columns, rows))
        return heights[np.isfinite(heights)]

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
        number = piece[:, 1] * (1 + last[0] // PIECE_PX) + piece[:, 0]
        for one in np.unique(number):
            members = number == one
            column, row = piece[np.argmax(members)].tolist()
            yield rows[members], self._piece(column, row)

    def _piece(self, column: int, row: int) -> HeightWindow:
        """A square piece of the DEM and a rim of two pixels, kept for the next question."""
        grid = self.grid
        bounds = grid.window(column * PIECE_PX, row * PIECE_PX, PIECE_PX, PIECE_PX).bounds
        # A part that was cut out counts its pieces from its own corner.
        return TILES.get(
            (self.sheets.key, "piece", grid.west, grid.north, column, row, PIECE_PX),
            lambda: self._read(self.grid.covering(bounds, RIM_PX)),
        )

    def _read(self, part: Grid) -> HeightWindow:
        """The pixels of a part of the DEM's own grid, small gaps closed."""
        wide = self.grid.covering(part.bounds, MARGIN_PX)
        heights = self.measured_on(wide, "linear")
        gaps = small_gaps(heights)
        heights = fill_gaps(heights, gaps)
        corner = wide.grid_from_object(np.array([[part.west, part.north]]))[0]
        left, top = np.rint(corner).astype(int).tolist()
        down, across = slice(top, top + part.rows), slice(left, left + part.columns)
        return HeightWindow(
            part, locked(heights[down, across], np.float32), locked(gaps[down, across], bool)
        )

    def _inside(self, grid: Grid) -> Bool[np.ndarray, "rows columns"]:
        """Which pixels of a grid lie within the bounds, of what is held in memory if it is."""
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
    return Dem(sheets, sheets.grid)


def dems_laid_over(dems: Sequence[Dem]) -> Dem:
    """DEMs of one CRS as one: each has a say where those before it know no height."""
    sheets = laid_over([dem.sheets for dem in dems])
    return Dem(sheets, sheets.grid)


@dataclass(frozen=True, slots=True, eq=False)
class LevelGround(Dem):
    """Level ground without any file: one height wherever it is asked for."""

    level_m: float = 0.0
    """The height, metres."""

    @property
    def bounds(self) -> Bounds:
        """It has no end."""
        return (-np.inf, -np.inf, np.inf, np.inf)

    def cropped(self, bounds: Bounds) -> "LevelGround":
        """The same."""
        return self

    def heights(self, points: PlanePoints) -> Scalars:
        """The height at every place, metres."""
        return np.full(len(points), self.level_m)

    def filled_at(self, points: PlanePoints) -> Bool[np.ndarray, "n"]:
        """Nothing was closed."""
        return np.zeros(len(points), dtype=bool)

    def slopes(self, points: PlanePoints) -> PlanePoints:
        """It does not rise."""
        return np.zeros((len(points), 2))

    def on(self, grid: Grid, kernel: Kernel = "linear") -> Float64[np.ndarray, "rows columns"]:
        """The height on a grid, metres."""
        return np.full((grid.rows, grid.columns), self.level_m)

    def mean_height(self, bounds: Bounds | None = None) -> float:
        """The height, metres."""
        return self.level_m


def level_ground(level_m: float, crs: str) -> LevelGround:
    """Ground of which only a mean height is known.

    Args:
        level_m: The height, metres.
        crs: The block's CRS.
    """
    # One pixel stands for all of it, for those who ask how fine it is.
    grid = Grid(0.0, 0.0, LEVEL_PIXEL_M, 1, 1)
    return LevelGround(no_sheets(crs, grid.bounds), grid, level_m=level_m)


def _bilinear(raster: Float32[np.ndarray, "rows columns"], places: PlanePoints) -> Scalars:
    """Values at raster places (column, row, corner origin) between the four pixel centres."""
    left, right, u = _neighbours(places[:, 0], raster.shape[1])
    above, below, v = _neighbours(places[:, 1], raster.shape[0])
    upper = _mix(raster[above, left], raster[above, right], u)
    return _mix(upper, _mix(raster[below, left], raster[below, right], u), v)


def _neighbours(places: Scalars, size: int) -> tuple[Indices, Indices, Scalars]:
    """The pixels before and after places along an axis, and the share of the second."""
    centred = np.clip(places - HALF_PIXEL, 0, size - 1)
    before = np.minimum(centred.astype(np.int64), max(size - 2, 0))
    return before, np.minimum(before + 1, size - 1), centred - before


def _mix(
    one: Float[np.ndarray, "*n"], other: Float[np.ndarray, "*n"], share: Float64[np.ndarray, "..."]
) -> Float64[np.ndarray, "*n"]:
    """Linear between two; where one has no say its gap does not matter."""
    mixed = one * (1 - share) + other * share
    mixed = np.where(share < NO_WEIGHT, one, mixed)
    return np.where(share > 1 - NO_WEIGHT, other, mixed)


def small_gaps(
    heights: Float32[np.ndarray, "rows columns"],
) -> Bool[np.ndarray, "rows columns"]:
    """The gaps (NaN) that may be closed: small ones that do not reach the raster's edge."""
    empty = np.isnan(heights)
    if not empty.any() or empty.all():
        return np.zeros_like(empty)
    labels, count = label_parts(empty)
    small = np.zeros(count + 1, dtype=bool)
    for label, (down, across) in enumerate(ndimage.find_objects(labels), start=1):
        inside = (
            down.start > 0
            and across.start > 0
            and down.stop < heights.shape[0]
            and across.stop < heights.shape[1]
        )
        size = max(down.stop - down.start, across.stop - across.start)
        small[label] = inside and size <= LARGEST_GAP_PX
    return small[labels]


def fill_gaps(
    heights: Float32[np.ndarray, "rows columns"], gaps: Bool[np.ndarray, "rows columns"]
) -> Float32[np.ndarray, "rows columns"]:
    """The raster with these gaps closed.

    The squares of all second differences that touch a gap are made least: the surface goes on
    with the slope it has at the rim, so a plane with holes becomes the plane.
    """
    if not gaps.any():
        return heights
    number = np.full(heights.shape, -1, dtype=np.int64)
    number[gaps] = np.arange(np.count_nonzero(gaps))
    open_gap = np.isnan(heights) & ~gaps
    rows, columns, weights, constants = [], [], [], []
    first = 0
    for offsets, factors in _SECOND_DIFFERENCES:
        cells = _stencils(gaps, open_gap, offsets)
        if not len(cells):
            continue
        constant = np.zeros(len(cells))
        for offset, factor in zip(offsets, factors, strict=True):
            down, across = (cells + offset).T
            unknown = number[down, across]
            free = unknown >= 0
            rows.append(first + np.flatnonzero(free))
            columns.append(unknown[free])
            weights.append(np.full(int(free.sum()), factor))
            constant[~free] -= factor * heights[down[~free], across[~free]]
        constants.append(constant)
        first += len(cells)
    entries = (np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns)))
    design = coo_array(entries, shape=(first, int(gaps.sum()))).tocsc()
    filled = heights.copy()
    normal = (design.T @ design).tocsc()
    filled[gaps] = splu(normal).solve(design.T @ np.concatenate(constants))
    return filled


# source: definition: central second differences
_SECOND_DIFFERENCES = (
    (((0, -1), (0, 0), (0, 1)), (1.0, -2.0, 1.0)),
    (((-1, 0), (0, 0), (1, 0)), (1.0, -2.0, 1.0)),
    (((0, 0), (0, 1), (1, 0), (1, 1)), (1.0, -1.0, -1.0, 1.0)),
)
"""Row and column offsets, and factors, of d2/dc2, d2/dr2 and d2/dcdr."""


def _stencils(
    gaps: Bool[np.ndarray, "rows columns"],
    open_gap: Bool[np.ndarray, "rows columns"],
    offsets: tuple[tuple[int, int], ...],
) -> Int[np.ndarray, "n 2"]:
    """Where a difference touches a gap and meets neither the edge nor a gap that stays."""
    touched = np.unique(np.vstack([np.argwhere(gaps) - offset for offset in offsets]), axis=0)
    sound = np.ones(len(touched), dtype=bool)
    for offset in offsets:
        place = touched + offset
        sound &= ((place >= 0) & (place < gaps.shape)).all(axis=1)
    touched = touched[sound]
    whole = np.ones(len(touched), dtype=bool)
    for offset in offsets:
        whole &= ~open_gap[tuple((touched + offset).T)]
    return touched[whole]
