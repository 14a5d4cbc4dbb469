"""All sheets on one grid: each where those before it end, blended within a pixel.

Where the axes of a lattice agree with the grid's, rows and columns are resampled one after the
other; rotated sheets and those of another CRS are warped.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, cast

import cv2
import numpy as np
from jaxtyping import Float32, Float64
from scipy.sparse import csr_array

from core.frames import HALF_PIXEL
from core.raster.files import TILES
from core.raster.grid import Grid
from core.raster.lattices import (
    BANDS,
    TILE_CELLS,
    Cells,
    CellWindow,
    Content,
    Lattice,
    SheetSet,
    halve_cells,
    read_cells,
    sheets_under,
)
from core.raster.sheets import block_outline

Kernel = Literal["cubic", "linear"]
# source: Keys 1981, table I; its definition
RADIUS: dict[Kernel, float] = {"cubic": 2.0, "linear": 1.0}
"""Reach of a kernel on either side, source cells, at no reduction."""
# design: photos of a fifth of the ortho's resolution are still measured on it; what is coarser only
# searches, and would read the whole ortho for that.
EXACT_TO = 10
"""Up to this reduction original pixels are read; beyond it overviews may serve."""
# design: bounds the memory, 17 MB a band and some 25 bands at work.
PIECE_PX = 2048
"""Edge of the largest piece worked on at once, original pixels."""
# design: over this distance map projections are straight to far below a millimetre.
NODE_STEP = 16
"""Coordinates of other CRS are computed at every so many pixels and interpolated between."""


@dataclass(frozen=True, slots=True, eq=False)
class Sampled:
    """Values on a target raster."""

    values: Float32[np.ndarray, "bands rows columns"]
    """Resampled values; meaningless where the coverage is nought."""
    coverage: Float32[np.ndarray, "rows columns"]
    """Share of the kernel that found usable cells, 0 to 1."""

    @property
    def nbytes(self) -> int:
        """Memory it takes."""
        return self.values.nbytes + self.coverage.nbytes


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """How a grid is read."""

    content: Content = "gray"
    """Gray, colour or heights."""
    kernel: Kernel = "cubic"
    """Interpolation between pixels."""
    exact_to: int = EXACT_TO
    """Reductions up to this read every original pixel; beyond it overviews may serve."""
    over_joins: bool = True
    """Whether kernels reach over the rim of one lattice into the next, or each ends at its own."""


def read_kept(sheets: SheetSet, grid: Grid, options: ReadOptions) -> Sampled:
    """The same as `read_onto`, from pieces that are kept where others may ask for them again.

    Grids on multiples of their pixel size share their pixels: all photos of a scale, in all rounds,
    look at the same ground.
    """
    origin = grid.on_multiples
    if origin is None:
        return read_onto(sheets, grid, options)
    values = np.empty((BANDS[options.content], grid.rows, grid.columns), dtype=np.float32)
    coverage = np.empty((grid.rows, grid.columns), dtype=np.float32)
    gsd = grid.ground_sample_distance_m
    for row in range(origin[1] // TILE_CELLS, -(-(origin[1] + grid.rows) // TILE_CELLS)):
        for column in range(origin[0] // TILE_CELLS, -(-(origin[0] + grid.columns) // TILE_CELLS)):
            # Placed by its own number, so that no rounding hangs on who asks first.
            left, top = column * TILE_CELLS, row * TILE_CELLS
            place = Grid(left * gsd, -top * gsd, gsd, TILE_CELLS, TILE_CELLS)
            key = (*sheets.key, options, gsd, column, row)
            piece = TILES.get(key, partial(read_onto, sheets, place, options))
            left, top = left - origin[0], top - origin[1]
            across = slice(max(left, 0), min(left + TILE_CELLS, grid.columns))
            down = slice(max(top, 0), min(top + TILE_CELLS, grid.rows))
            own = np.s_[
                down.start - top : down.stop - top, across.start - left : across.stop - left
            ]
            values[:, down, across] = piece.values[:, *own]
            coverage[down, across] = piece.coverage[own]
    return Sampled(values, coverage)


def read_onto(sheets: SheetSet, grid: Grid, options: ReadOptions) -> Sampled:
    """The sheets on a grid in the block's CRS, anti-aliased, whatever its pixel size."""
    values = np.zeros((BANDS[options.content], grid.rows, grid.columns), dtype=np.float32)
    coverage = np.zeros((grid.rows, grid.columns), dtype=np.float32)
    if not sheets.lattices:
        return Sampled(values, coverage)
    finest = sheets.finest.ground_sample_distance_m
    reduction = grid.ground_sample_distance_m / finest
    # Exact reading holds original pixels, otherwise up to four cells to a pixel each way.
    across = max(1.0, reduction) if reduction <= options.exact_to else 4.0
    # design: pieces neither so small that their rims outweigh them nor larger than a screen
    step = int(np.clip(PIECE_PX / across, 64, 2048))
    for row in range(0, grid.rows, step):
        for column in range(0, grid.columns, step):
            part = grid.window(
                column, row, min(step, grid.columns - column), min(step, grid.rows - row)
            )
            place = (slice(row, row + part.rows), slice(column, column + part.columns))
            sampled = _read_part(sheets.lattices, part, options)
            values[(slice(None), *place)] = sampled.values
            coverage[place] = sampled.coverage
    return Sampled(values, coverage)


def _read_part(lattices: Sequence[Lattice], grid: Grid, options: ReadOptions) -> Sampled:
    """One piece of the grid from every lattice that reaches it."""
    values = np.zeros((BANDS[options.content], grid.rows, grid.columns), dtype=np.float32)
    coverage = np.zeros((grid.rows, grid.columns), dtype=np.float32)
    for index, lattice in enumerate(lattices):
        found = _read_lattice(lattice, lattices[index + 1 :], grid, options)
        if found is None:
            continue
        # The first lattice has its say; the next fills what it leaves open.
        room = np.minimum(found.coverage, 1 - coverage)
        values += found.values * room
        coverage += room
        if coverage.min() >= 1:
            break
    np.divide(values, coverage, out=values, where=coverage > 0)
    return Sampled(values, coverage)


def _read_lattice(
    lattice: Lattice, after: Sequence[Lattice], grid: Grid, options: ReadOptions
) -> Sampled | None:
    """One lattice on the grid; None where it has nothing there."""
    if lattice.north_up:
        return _read_north_up(lattice, after, grid, options)
    return _read_slanted(lattice, grid, options)


def _read_north_up(
    lattice: Lattice, after: Sequence[Lattice], grid: Grid, options: ReadOptions
) -> Sampled | None:
    """Axes agree: rows and columns are resampled one after the other, in double precision."""
    (a, _, c), (_, e, f) = lattice.plane_from_lattice
    east, north = grid.centres()
    columns, rows = (east - c) / a, (north - f) / e
    gsd = grid.ground_sample_distance_m
    size = _cell_size(min(gsd / a, gsd / -e))
    scale = (gsd / a / size, gsd / -e / size)
    window = _window(columns / size, rows / size, size, RADIUS[options.kernel] * max(1.0, *scale))
    if not sheets_under(lattice, window):
        return None
    exact = bool(min(gsd / a, gsd / -e) <= options.exact_to)
    cells = read_cells(lattice, window, options.content, exact)
    if not cells.weight.any():
        return None
    if options.over_joins and lattice.square and cells.weight.min() < 1:
        west, top = c + window.column * size * a, f + window.row * size * e
        place = Grid(float(west), float(top), float(a * size), window.columns, window.rows)
        cells = _continue_cells(cells, after, place, options)
    return _sample_separable(
        cells, columns / size - window.column, rows / size - window.row, scale, options.kernel
    )


def _continue_cells(
    cells: Cells, after: Sequence[Lattice], place: Grid, options: ReadOptions
) -> Cells:
    """Cells with the next lattices going on where this one ends, so that kernels cross the join."""
    reaching = [lattice for lattice in after if _reaches(lattice, place)]
    if not reaching:
        return cells
    rest = _read_part(reaching, place, options)
    room = np.minimum(rest.coverage, 1 - cells.weight)
    weight = cells.weight + room
    values = cells.values * cells.weight + rest.values * room
    np.divide(values, weight, out=values, where=weight > 0)
    return Cells(values, weight)


def _reaches(lattice: Lattice, grid: Grid) -> bool:
    """Whether any sheet's outer bounds touch the grid."""
    west, south, east, north = grid.bounds
    outlines = [block_outline(sheet) for sheet in lattice.sheets]
    return any(
        bool((line.max(axis=0) > (west, south)).all() and (line.min(axis=0) < (east, north)).all())
        for line in outlines
    )


def _read_slanted(lattice: Lattice, grid: Grid, options: ReadOptions) -> Sampled | None:
    """Rotated sheets, south-up sheets, sheets in another CRS."""
    columns, rows, scale = _lattice_places(lattice, grid)
    if not np.isfinite(columns).all():
        return None
    size, exact = _cell_size(scale), scale <= options.exact_to
    columns, rows, scale = columns / size, rows / size, scale / size
    window = _window(columns, rows, size, RADIUS[options.kernel] * max(1.0, scale))
    if not sheets_under(lattice, window):
        return None
    cells = read_cells(lattice, window, options.content, exact)
    if not cells.weight.any():
        return None
    across = (columns - window.column).astype(np.float32)
    down = (rows - window.row).astype(np.float32)
    return sample_warped(cells, across, down, scale, options.kernel)


def sample_part(
    values: Float32[np.ndarray, "bands _ _"],
    corner: tuple[int, int],
    whole: Grid,
    grid: Grid,
    kernel: Kernel = "cubic",
) -> Float32[np.ndarray, "bands rows columns"]:
    """A part of a raster on another grid, as a file is read that is nought beside the part.

    Reading is linear: what is added to a part of a file adds this to what is read of the file.

    Args:
        values: The part.
        corner: Its first column and row, pixels of the raster.
        whole: The raster.
        grid: Where values are wanted.
        kernel: Interpolation between pixels.
    """
    gsd = whole.ground_sample_distance_m
    ratio = grid.ground_sample_distance_m / gsd
    size = _cell_size(ratio)
    scale = ratio / size
    reach = RADIUS[kernel] * max(1.0, scale)
    east, north = grid.centres()
    places = (east - whole.west) / gsd / size, (whole.north - north) / gsd / size
    bands, height, width = values.shape
    across, down = (
        np.flatnonzero((at > first / size - reach) & (at < (first + count) / size + reach))
        for at, first, count in zip(places, corner, (width, height), strict=True)
    )
    result = np.zeros((bands, grid.rows, grid.columns), dtype=np.float32)
    if not len(across) or not len(down):
        return result
    columns, rows = places[0][across], places[1][down]
    window = _window(columns, rows, size, reach)
    laid = np.zeros((bands, window.rows * size, window.columns * size), dtype=np.float32)
    left, top = corner[0] - window.column * size, corner[1] - window.row * size
    own = np.s_[max(-top, 0) : laid.shape[1] - top, max(-left, 0) : laid.shape[2] - left]
    laid[:, max(top, 0) : top + height, max(left, 0) : left + width] = values[:, *own]
    cells = Cells(laid, np.ones(laid.shape[1:], dtype=np.float32))
    while cells.weight.shape[0] > window.rows:
        cells = halve_cells(cells)
    sampled = _sample_separable(
        cells, columns - window.column, rows - window.row, (scale, scale), kernel
    )
    result[:, down[0] : down[-1] + 1, across[0] : across[-1] + 1] = sampled.values
    return result


def _lattice_places(
    lattice: Lattice, grid: Grid
) -> tuple[Float64[np.ndarray, "rows columns"], Float64[np.ndarray, "rows columns"], float]:
    """Lattice column and row of every pixel centre, and lattice pixels per grid pixel."""
    across, down = node_places(grid.columns), node_places(grid.rows)
    nodes = np.stack(np.meshgrid(across, down), axis=-1)
    plane = grid.object_from_grid(nodes.reshape(-1, 2))
    if lattice.operation is not None:
        plane = lattice.operation.backward(plane)
    linear, shift = lattice.plane_from_lattice[:, :2], lattice.plane_from_lattice[:, 2]
    places = np.linalg.solve(linear, (plane - shift).T).reshape(2, len(down), len(across))
    # Area of one grid pixel, from the diagonals of the whole grid.
    one, other = places[:, -1, -1] - places[:, 0, 0], places[:, -1, 0] - places[:, 0, -1]
    extent = (across[-1] - across[0]) * (down[-1] - down[0])
    scale = float(np.sqrt(abs(one[0] * other[1] - one[1] * other[0]) / 2 / extent))
    columns = between_nodes(places[0], across, down, grid)
    return columns, between_nodes(places[1], across, down, grid), scale


def node_places(count: int) -> Float64[np.ndarray, "nodes"]:
    """Grid coordinates from before the first to after the last pixel centre."""
    return np.linspace(0, count, max(2, count // NODE_STEP + 2))


def between_nodes(
    nodes: Float64[np.ndarray, "n m"],
    across: Float64[np.ndarray, "m"],
    down: Float64[np.ndarray, "n"],
    grid: Grid,
) -> Float64[np.ndarray, "rows columns"]:
    """Bilinear interpolation of the nodes at the pixel centres."""
    column = (np.arange(grid.columns) + HALF_PIXEL - across[0]) / (across[1] - across[0])
    row = (np.arange(grid.rows) + HALF_PIXEL - down[0]) / (down[1] - down[0])
    left = np.minimum(column.astype(int), len(across) - 2)
    above = np.minimum(row.astype(int), len(down) - 2)
    column, row = column - left, (row - above)[:, None]
    line = nodes[above] * (1 - row) + nodes[above + 1] * row
    return line[:, left] * (1 - column) + line[:, left + 1] * column


def _cell_size(reduction: float) -> int:
    """Largest power of two that leaves at least two cells to a target pixel.

    With two the kernel, not the cell, decides what is smoothed, wherever the pixel lies.
    """
    # design: rounding; a reduction of exactly four is four
    return 1 << max(0, int(np.floor(np.log2(max(reduction, 2.0) + 1e-9))) - 1)


def _window(
    columns: Float64[np.ndarray, "*c"], rows: Float64[np.ndarray, "*r"], size: int, reach: float
) -> CellWindow:
    """The cells that kernels at these places touch."""
    margin = int(np.ceil(reach)) + 1
    left, right = int(np.floor(columns.min())) - margin, int(np.ceil(columns.max())) + margin
    top, bottom = int(np.floor(rows.min())) - margin, int(np.ceil(rows.max())) + margin
    return CellWindow(left, top, right - left, bottom - top, size)


def _sample_separable(
    cells: Cells,
    columns: Float64[np.ndarray, "width"],
    rows: Float64[np.ndarray, "height"],
    scale: tuple[float, float],
    kernel: Kernel,
) -> Sampled:
    """Values where source columns and source rows cross.

    Args:
        cells: Source cells; their margin holds the kernel's reach.
        columns: Source column of every target column (corner origin).
        rows: Source row of every target row (corner origin).
        scale: Source cells per target pixel across and down; above 1 the kernel is widened by
            it, which keeps patterns finer than the target from aliasing.
        kernel: `cubic` (Keys, a = -1/2, the one GDAL uses) or `linear`.
    """
    height, width = cells.weight.shape
    across = _weights(columns, width, scale[0], kernel)
    down = _weights(rows, height, scale[1], kernel)
    reach = int(np.ceil(RADIUS[kernel] * max(1.0, *scale))) + 1
    filled = _fill_holes(cells, reach)
    values = np.stack([_multiply(down, band, across) for band in filled])
    if cells.weight.min() >= 1:
        return Sampled(values, np.ones(values.shape[1:], dtype=np.float32))
    smooth = (
        _weights(rows, height, scale[1], "linear"),
        _weights(columns, width, scale[0], "linear"),
    )
    return Sampled(values, np.clip(_multiply(smooth[0], cells.weight, smooth[1]), 0, 1))


def sample_warped(
    cells: Cells,
    columns: Float32[np.ndarray, "height width"],
    rows: Float32[np.ndarray, "height width"],
    scale: float,
    kernel: Kernel,
) -> Sampled:
    """Values at any source places; good to 1/64 of a cell, OpenCV's step.

    Args:
        cells: Source cells with margin.
        columns: Source column of every target pixel (corner origin).
        rows: Source row of every target pixel (corner origin).
        scale: Source cells per target pixel; above 1 the source is smoothed first.
        kernel: `cubic` or `linear`.
    """
    filled, weight = _fill_holes(cells, 3), cells.weight
    if scale > 1:
        # What is missing to the width of a target pixel, a source cell being one wide.
        sigma = 0.5 * float(np.sqrt(scale**2 - 1))
        filled = np.stack([cv2.GaussianBlur(band, (0, 0), sigma) for band in filled])
        weight = cv2.GaussianBlur(weight, (0, 0), sigma)
    flag = cv2.INTER_CUBIC if kernel == "cubic" else cv2.INTER_LINEAR
    across, down = (places - np.float32(HALF_PIXEL) for places in (columns, rows))
    values = [
        cv2.remap(band, across, down, flag, borderMode=cv2.BORDER_REPLICATE) for band in filled
    ]
    coverage = cv2.remap(weight, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    return Sampled(np.stack(values), np.clip(coverage, 0, 1))


def _weights(
    places: Float64[np.ndarray, "target"], source: int, scale: float, kernel: Kernel
) -> csr_array:
    """Sparse matrix (target, source) of kernel weights, rows adding up to one."""
    widening = max(1.0, scale)
    radius = RADIUS[kernel] * widening
    first = np.ceil(places - HALF_PIXEL - radius).astype(np.int64)
    taps = first[:, None] + np.arange(int(np.ceil(2 * radius)) + 1)
    distance = np.abs(taps + HALF_PIXEL - places[:, None]) / widening
    weight = _cubic(distance) if kernel == "cubic" else np.maximum(0, 1 - distance)
    weight /= weight.sum(axis=1, keepdims=True)
    begin = np.arange(len(places) + 1) * taps.shape[1]
    columns = np.clip(taps, 0, source - 1).ravel()
    matrix = csr_array(
        (weight.astype(np.float32).ravel(), columns, begin), shape=(len(places), source)
    )
    matrix.sum_duplicates()
    matrix.eliminate_zeros()
    return matrix


def _cubic(t: Float64[np.ndarray, "*shape"]) -> Float64[np.ndarray, "*shape"]:
    """Keys' cubic convolution with a = -1/2, of the distance t >= 0."""
    # source: Keys 1981, the kernel of cubic convolution with a = -1/2
    return np.where(
        t < 1,
        (1.5 * t - 2.5) * t * t + 1,
        np.where(t < 2, ((-0.5 * t + 2.5) * t - 4) * t + 2, 0.0),
    )


def _multiply(
    down: csr_array, band: Float32[np.ndarray, "rows columns"], across: csr_array
) -> Float32[np.ndarray, "height width"]:
    """Product down @ band @ across', the shorter product first."""
    height = cast(tuple[int, int], down.shape)[0]
    if height <= band.shape[0]:
        return np.ascontiguousarray((across @ np.ascontiguousarray((down @ band).T)).T)
    return np.ascontiguousarray(down @ np.ascontiguousarray((across @ band.T).T))


def _fill_holes(cells: Cells, reach: int) -> Float32[np.ndarray, "bands rows columns"]:
    """Cells without value get the mean of their neighbours, so that no kernel drags in a nought."""
    if cells.weight.min() > 0:
        return cells.values
    window = (2 * reach + 1, 2 * reach + 1)
    weight = cv2.boxFilter(cells.weight, -1, window, normalize=False)
    filled = cells.values.copy()
    # design: rounding of the box filter
    hole = (cells.weight == 0) & (weight > 1e-6)
    for band in filled:
        sums = cv2.boxFilter(band * cells.weight, -1, window, normalize=False)
        band[hole] = sums[hole] / weight[hole]
    return filled
