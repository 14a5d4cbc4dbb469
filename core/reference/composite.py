"""All sheets on one grid: finest first, coarser ones where those end, blended within a pixel."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from core.geometry.grid import Grid
from core.reference.cells import EXACT_TO, Cells, CellWindow, Content, read_cells, sheets_under
from core.reference.resampling import RADIUS, Kernel, Sampled, sample_separable, sample_warped
from core.reference.sheets import Lattice, SheetSet, block_outline

TILE_CELLS = 3072
"""Edge of the largest piece worked on at once, original pixels: bounds the memory."""
NODE_STEP = 16
"""Coordinates of other CRS are computed at every so many pixels and interpolated between: over
this distance map projections are straight to far below a millimetre."""


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """How a grid is read."""

    content: Content = "gray"
    """Gray, colour or heights."""
    kernel: Kernel = "cubic"
    """Interpolation between pixels."""
    exact_to: int = EXACT_TO
    """Reductions up to this read every original pixel; beyond it overviews may serve."""


def read_onto(sheets: SheetSet, grid: Grid, options: ReadOptions) -> Sampled:
    """The sheets on a grid in the block's CRS, anti-aliased, whatever its pixel size."""
    bands = 3 if options.content == "colour" else 1
    values = np.zeros((bands, grid.rows, grid.columns), dtype=np.float32)
    coverage = np.zeros((grid.rows, grid.columns), dtype=np.float32)
    finest = sheets.lattices[0].ground_sample_distance_m
    reduction = grid.ground_sample_distance_m / finest
    # Exact reading holds original pixels, otherwise up to four cells to a pixel each way.
    across = max(1.0, reduction) if reduction <= options.exact_to else 4.0
    step = int(np.clip(TILE_CELLS / across, 64, 2048))
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
    bands = 3 if options.content == "colour" else 1
    values = np.zeros((bands, grid.rows, grid.columns), dtype=np.float32)
    coverage = np.zeros((grid.rows, grid.columns), dtype=np.float32)
    for index, lattice in enumerate(lattices):
        found = _read_lattice(lattice, lattices[index + 1 :], grid, options)
        if found is None:
            continue
        # The finest lattice has its say; the next fills what it leaves open.
        room = np.minimum(found.coverage, 1 - coverage)
        values += found.values * room
        coverage += room
        if coverage.min() >= 1:
            break
    np.divide(values, coverage, out=values, where=coverage > 0)
    return Sampled(values, coverage)


def _read_lattice(
    lattice: Lattice, coarser: Sequence[Lattice], grid: Grid, options: ReadOptions
) -> Sampled | None:
    """One lattice on the grid; None where it has nothing there."""
    if lattice.north_up:
        return _read_north_up(lattice, coarser, grid, options)
    return _read_slanted(lattice, grid, options)


def _read_north_up(
    lattice: Lattice, coarser: Sequence[Lattice], grid: Grid, options: ReadOptions
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
    if abs(a + e) < 1e-9 * a and cells.weight.min() < 1:
        west, top = c + window.column * size * a, f + window.row * size * e
        place = Grid(float(west), float(top), float(a * size), window.columns, window.rows)
        cells = _continued(cells, coarser, place, options)
    return sample_separable(
        cells, columns / size - window.column, rows / size - window.row, scale, options.kernel
    )


def _continued(
    cells: Cells, coarser: Sequence[Lattice], place: Grid, options: ReadOptions
) -> Cells:
    """Cells with coarser lattices going on where this one ends, so that kernels cross the join."""
    reaching = [lattice for lattice in coarser if _reaches(lattice, place)]
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


def _lattice_places(
    lattice: Lattice, grid: Grid
) -> tuple[Float64[np.ndarray, "rows columns"], Float64[np.ndarray, "rows columns"], float]:
    """Lattice column and row of every pixel centre, and lattice pixels per grid pixel."""
    across, down = _nodes(grid.columns), _nodes(grid.rows)
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
    columns = _between(places[0], across, down, grid)
    return columns, _between(places[1], across, down, grid), scale


def _nodes(count: int) -> Float64[np.ndarray, "nodes"]:
    """Grid coordinates from before the first to after the last pixel centre."""
    return np.linspace(0, count, max(2, count // NODE_STEP + 2))


def _between(
    nodes: Float64[np.ndarray, "n m"],
    across: Float64[np.ndarray, "m"],
    down: Float64[np.ndarray, "n"],
    grid: Grid,
) -> Float64[np.ndarray, "rows columns"]:
    """Bilinear interpolation of the nodes at the pixel centres."""
    column = (np.arange(grid.columns) + 0.5 - across[0]) / (across[1] - across[0])
    row = (np.arange(grid.rows) + 0.5 - down[0]) / (down[1] - down[0])
    left = np.minimum(column.astype(int), len(across) - 2)
    above = np.minimum(row.astype(int), len(down) - 2)
    column, row = column - left, (row - above)[:, None]
    line = nodes[above] * (1 - row) + nodes[above + 1] * row
    return line[:, left] * (1 - column) + line[:, left + 1] * column


def _cell_size(reduction: float) -> int:
    """Largest power of two that leaves at least two cells to a target pixel.

    With two the kernel, not the cell, decides what is smoothed, wherever the pixel lies.
    """
    return 1 << max(0, int(np.floor(np.log2(max(reduction, 2.0) + 1e-9))) - 1)


def _window(
    columns: Float64[np.ndarray, "*c"], rows: Float64[np.ndarray, "*r"], size: int, reach: float
) -> CellWindow:
    """The cells that kernels at these places touch."""
    margin = int(np.ceil(reach)) + 1
    left, right = int(np.floor(columns.min())) - margin, int(np.ceil(columns.max())) + margin
    top, bottom = int(np.floor(rows.min())) - margin, int(np.ceil(rows.max())) + margin
    return CellWindow(left, top, right - left, bottom - top, size)
