"""Orthos in small: means over square cells that all orthos of a block share.

Seams are sought in a pyramid of them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import rasterio
from jaxtyping import Bool, Float16, Float32, Float64, Shaped

from core.arrays import Mask, Scalars, locked
from core.orthos.rectification import OrthoProduct
from core.raster.files import gray_from_colour
from core.raster.grid import NODATA, Grid, sums_over_cells, window_of

# design: some tens of megabytes of the widest orthos
STRIP_CELLS = 128
"""Rows of cells that are read at once."""
Bands = Shaped[np.ndarray, "_ rows columns"]
"""Pixels band by band."""


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

    @property
    def shown(self) -> Mask:
        """Cells of which anything is shown, small holes closed."""
        return self.touched | _without_small_holes(self.full)

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
        size = (grid.columns, grid.rows)
        total, share = (
            np.asarray(cv2.resize(band, size, interpolation=cv2.INTER_AREA), np.float32)
            for band in (sums, shares)
        )
        # design: no division by nought
        values = np.where(share > 0, total / np.maximum(share, 1e-6), np.nan)
        return Overview(self.photo_id, self.nadir, grid, values, share)


Cells = Float32[np.ndarray, "rows columns"]
Part = tuple[slice, slice]
"""Rows and columns of the block's cells."""
# design: a flow through so many cells a side takes a few tenths of a second
COARSEST_CELLS = 80
"""Cells along the longest side of a photo in the coarsest level, at most."""
# design: eight by eight cells; smaller ones are marks and scratches that the composition fills
SMALLEST_HOLE_CELLS = 64
"""Holes in a photo smaller than this are left to the composition, cells."""


@dataclass(frozen=True, slots=True, eq=False)
class SeamView:
    """One photo in the cells of a level."""

    photo_id: str
    """The photo."""
    nadir: tuple[float, float]
    """Easting and northing below the perspective centre, metres."""
    grid: Grid
    """Where its cells lie, on multiples of their size."""
    gray: Float16[np.ndarray, "rows columns"]
    """Balanced gray values of 255, half precision; 0 where nothing is shown."""
    full: Mask
    """Cells that are shown wholly, small holes closed."""
    touched: Mask
    """Cells of which anything is shown."""
    inner: Mask
    """Full cells away from the edge of the picture."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "gray", locked(self.gray, np.float16))

    def coarser(self) -> "SeamView":
        """The same in cells twice as large; rows and columns must be even."""
        grid = self.grid
        rows, columns = grid.rows // 2, grid.columns // 2
        gray = cv2.resize(
            self.gray.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA
        )
        step = 2 * grid.ground_sample_distance_m
        return replace(
            self,
            grid=Grid(grid.west, grid.north, step, columns, rows),
            gray=np.asarray(gray).astype(np.float16),
            full=_fourfold(self.full, np.logical_and),
            touched=_fourfold(self.touched, np.logical_or),
            inner=_fourfold(self.inner, np.logical_and),
        )


@dataclass(frozen=True, slots=True, eq=False)
class SeamLevel:
    """All photos of a block in cells of one size."""

    grid: Grid
    """The block's cells."""
    views: tuple[SeamView, ...]
    """The photos."""
    places: tuple[Part, ...]
    """Where the cells of each photo lie among those of the block."""

    def window(self, number: int, part: Part) -> "tuple[Cells, Mask, Mask, Mask]":
        """Gray values, and what is full, touched and inner, of a photo over a part of the block."""
        view, place = self.views[number], self.places[number]
        shape = tuple(side.stop - side.start for side in part)
        gray = np.zeros(shape, np.float32)
        masks = np.zeros((3, *shape), np.bool_)
        low = [max(a.start, b.start) for a, b in zip(part, place, strict=True)]
        high = [min(a.stop, b.stop) for a, b in zip(part, place, strict=True)]
        if low[0] < high[0] and low[1] < high[1]:
            here = tuple(
                slice(a - side.start, b - side.start)
                for a, b, side in zip(low, high, part, strict=True)
            )
            there = tuple(
                slice(a - side.start, b - side.start)
                for a, b, side in zip(low, high, place, strict=True)
            )
            gray[here] = view.gray[there]
            for kind, its in enumerate((view.full, view.touched, view.inner)):
                masks[kind][here] = its[there]
        return gray, masks[0], masks[1], masks[2]

    def view_cost(self, number: int, part: Part) -> Cells:
        """Squared distance to a photo's nadir over a part of the block, in half its width."""
        view, cell = self.views[number], self.grid.ground_sample_distance_m
        half = max(view.grid.columns, view.grid.rows) * cell / 2
        eastings, northings = self.grid.centres()
        east = ((eastings[part[1]] - view.nadir[0]) / half).astype(np.float32)
        north = ((northings[part[0]] - view.nadir[1]) / half).astype(np.float32)
        return (north**2)[:, None] + (east**2)[None, :]


def read_overview(
    ortho: OrthoProduct, pixels_per_cell: int, full_scale: float | None = None
) -> Overview:
    """Means over cells of an ortho, read strip by strip, with its own full scale or another.

    Colours are turned into gray.
    """
    return _means_of(ortho, pixels_per_cell, full_scale, _gray_of)[0]


def read_band_overviews(
    ortho: OrthoProduct, pixels_per_cell: int, full_scale: float
) -> tuple[Overview, ...]:
    """The same of each band."""
    return _means_of(ortho, pixels_per_cell, full_scale, lambda bands: bands)


def _gray_of(bands: Bands) -> Bands:
    """One band; what shows something stays at least 1."""
    if len(bands) < 3:
        return bands[:1]
    gray = np.rint(gray_from_colour(bands[:3])).astype(bands.dtype)
    return np.where(bands[:1] == NODATA, NODATA, np.maximum(gray, 1))


def _means_of(
    ortho: OrthoProduct,
    pixels_per_cell: int,
    full_scale: float | None,
    wanted: Callable[[Bands], Bands],
) -> tuple[Overview, ...]:
    """Means over cells of what is made of the bands of an ortho."""
    gsd = ortho.grid.ground_sample_distance_m
    grid = Grid.over(ortho.grid.bounds, gsd * pixels_per_cell)
    corner = np.array([[ortho.grid.west, ortho.grid.north]])
    offset = np.rint(grid.grid_from_object(corner)[0] * pixels_per_cell)
    column, row = int(offset[0]), int(offset[1])
    columns_in_cells = grid.columns * pixels_per_cell
    parts: list[list[Cells]] = []
    counts = np.zeros((grid.rows, grid.columns), dtype=np.float32)
    with rasterio.open(ortho.path) as file:
        for top in range(0, grid.rows, STRIP_CELLS):
            cells = np.s_[top : min(top + STRIP_CELLS, grid.rows)]
            tall = (cells.stop - top) * pixels_per_cell
            first = max(top * pixels_per_cell - row, 0)
            last = min(top * pixels_per_cell + tall - row, ortho.grid.rows)
            begin = first + row - top * pixels_per_cell
            bands = wanted(
                file.read(window=window_of((0, first, ortho.grid.columns, last - first)))
            )
            strip = np.zeros((len(bands), tall, columns_in_cells), dtype=bands.dtype)
            strip[:, begin : begin + last - first, column : column + ortho.grid.columns] = bands
            parts.append(
                [sums_over_cells(one, pixels_per_cell).astype(np.float32) for one in strip]
            )
            counts[cells] = sums_over_cells((strip[0] != NODATA).view(np.uint8), pixels_per_cell)
        own_scale = np.float32(np.iinfo(file.dtypes[0]).max)
    found: list[Overview] = []
    for sums in map(np.concatenate, zip(*parts, strict=True)):
        values = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
        if full_scale is not None:
            values *= np.float32(full_scale) / own_scale
        share = counts / pixels_per_cell**2
        found.append(Overview(ortho.photo_id, ortho.nadir, grid, values, share))
    return tuple(found)


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


def _fourfold(mask: Bool[np.ndarray, "_ _"], joined: np.ufunc) -> Bool[np.ndarray, "_ _"]:
    """Cells twice as large, of four each."""
    pairs = joined(mask[::2], mask[1::2])
    return joined(pairs[:, ::2], pairs[:, 1::2])


def seam_view(overview: Overview, gray: Cells, keep_inside_m: float) -> SeamView:
    """One photo on the finest level.

    Args:
        overview: The ortho in small.
        gray: Its balanced values, of 255; anything where nothing is shown.
        keep_inside_m: What is nearer to the edge of the picture is its rim, metres.
    """
    full = _without_small_holes(overview.full)
    padded = np.pad(full, 1).astype(np.uint8)
    away = np.asarray(cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_5))[1:-1, 1:-1]
    return SeamView(
        overview.photo_id,
        overview.nadir,
        overview.grid,
        np.where(overview.touched, gray, np.float32(0)).astype(np.float16),
        full,
        overview.touched | full,
        away > keep_inside_m / overview.grid.ground_sample_distance_m,
    )


def _without_small_holes(full: Mask) -> Mask:
    """A mask with its small holes closed; what is open to the outside is no hole."""
    count, found, figures, _ = cv2.connectedComponentsWithStats(
        (~full).astype(np.uint8), connectivity=4
    )
    if count < 2:
        return full
    numbers = np.asarray(found, dtype=np.int32)
    small = np.asarray(figures)[:, cv2.CC_STAT_AREA] < SMALLEST_HOLE_CELLS
    small[0] = False
    for edge in (numbers[0], numbers[-1], numbers[:, 0], numbers[:, -1]):
        small[edge] = False
    return full | small[numbers]


def seam_levels(views: Sequence[SeamView]) -> list[SeamLevel]:
    """All photos in cells of growing size, finest first; each level has half the cells a side."""
    longest = max(max(view.grid.columns, view.grid.rows) for view in views)
    count = 1
    while longest > COARSEST_CELLS << (count - 1):
        count += 1
    side = 1 << (count - 1)
    step = views[0].grid.ground_sample_distance_m * side
    bounds = np.array([view.grid.bounds for view in views])
    low, high = bounds.min(axis=0).tolist(), bounds.max(axis=0).tolist()
    whole = Grid.over((low[0], low[1], high[2], high[3]), step)
    level = [_padded(view, side) for view in views]
    levels: list[SeamLevel] = []
    for number in range(count):
        if number:
            level = [view.coarser() for view in level]
        cell = step / (side >> number)
        rows, columns = whole.rows * side >> number, whole.columns * side >> number
        grid = Grid(whole.west, whole.north, cell, columns, rows)
        levels.append(SeamLevel(grid, tuple(level), tuple(_place(v.grid, grid) for v in level)))
    return levels


def _padded(view: SeamView, side: int) -> SeamView:
    """A photo with empty cells about it, so that all levels have whole cells."""
    cell = view.grid.ground_sample_distance_m
    outer = Grid.over(view.grid.bounds, cell * side)
    grid = Grid(outer.west, outer.north, cell, outer.columns * side, outer.rows * side)
    place = _place(view.grid, grid)

    def put(values: np.ndarray) -> np.ndarray:
        wide = np.zeros((grid.rows, grid.columns), values.dtype)
        wide[place] = values
        return wide

    return replace(
        view,
        grid=grid,
        gray=put(view.gray),
        full=put(view.full),
        touched=put(view.touched),
        inner=put(view.inner),
    )


def _place(part: Grid, whole: Grid) -> Part:
    """Where the cells of a grid lie in another of the same cells."""
    corner = whole.grid_from_object(np.array([[part.west, part.north]]))[0]
    column, row = round(float(corner[0])), round(float(corner[1]))
    return slice(row, row + part.rows), slice(column, column + part.columns)
