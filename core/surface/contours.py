"""Contour lines of a surface."""

from pathlib import Path
from typing import Any, cast

import numpy as np
import rasterio
import shapely
from contourpy import LineType, contour_generator
from jaxtyping import Float64
from scipy.ndimage import gaussian_filter

from core.formats.vectors import write_layer
from core.progress import Work
from core.raster.grid import BLOCK_PX, Grid, Tile, tiles_of, window_of
from core.surface.ground import NODATA_M

LAYER = "contours"
# design: lines through single cells show their errors, not the ground.
SMOOTH_CELLS = 3.0
"""Standard deviation of the smoothing before lines are drawn, cells."""
# design: beyond three deviations a Gaussian weighs nothing that a line would show.
MARGIN_CELLS = 10
"""Cells read around each tile, so that lines meet at its edges."""
# design: half of what was smoothed away is missing: there a height is a guess.
LEAST_KNOWN = 0.5
"""Weight of known cells in a smoothed one, at least."""
# design: cells that a line must cross to be one; the rest are rings about bushes.
SHORTEST_CELLS = 30
# source: CSN 01 3411, as on most topographic maps: every fifth line is drawn bold.
BOLD_EVERY = 5
# design: millimetres: ends of two tiles' lines that differ as numbers alone are the same.
SAME_DECIMALS = 3


def write_contours(
    path: Path, surface: Path, grid: Grid, interval_m: float, *, crs: str, work: Work
) -> int:
    """Write contour lines of the known part of a surface, smoothed over a few cells.

    Args:
        path: The GeoPackage.
        surface: Heights, metres.
        grid: Where their cells lie.
        interval_m: Heights between two lines, metres.
        crs: The block's CRS.
        work: Told tile by tile.

    Returns:
        Number of lines. Attributes are `height` (m) and `bold`, 1 for every fifth line.

    Raises:
        OSError: The disk is full.
    """
    pieces: dict[int, list[shapely.LineString]] = {}
    with rasterio.open(surface) as heights:
        tiles = list(tiles_of(grid, BLOCK_PX))
        for done, tile in enumerate(tiles, start=1):
            for number, lines in _lines_of(heights, grid, tile, interval_m).items():
                pieces.setdefault(number, []).extend(lines)
            work.progress.report(done, len(tiles), "contour lines")
    lines, numbers = list[shapely.LineString](), list[int]()
    shortest = SHORTEST_CELLS * grid.ground_sample_distance_m
    for number, parts in sorted(pieces.items()):
        merged = shapely.line_merge(shapely.MultiLineString(parts))
        whole = [one for one in shapely.get_parts(merged) if one.length >= shortest]
        lines += whole
        numbers += [number] * len(whole)
    levels = np.array(numbers, dtype=np.int64)
    fields = {
        "height": levels * interval_m,
        "bold": (levels % BOLD_EVERY == 0).astype(np.int32),
    }
    write_layer(path, LAYER, lines, fields, crs=crs, kind="LineString")
    return len(lines)


def _lines_of(
    heights: Any, grid: Grid, tile: Tile, interval_m: float
) -> dict[int, list[shapely.LineString]]:
    """Lines of a tile by their number, up to the centres of the cells beside it."""
    column, row, columns, rows = tile
    # The neighbour's first cells belong to both: there the lines of both end.
    columns, rows = min(columns + 1, grid.columns - column), min(rows + 1, grid.rows - row)
    smooth = _smoothed(heights, (column, row, columns, rows))
    if smooth.shape[0] < 2 or smooth.shape[1] < 2 or not np.isfinite(smooth).any():
        return {}
    window = grid.window(column, row, columns, rows)
    east, north = window.centres()
    drawn = contour_generator(
        east, north, np.ma.masked_invalid(smooth), name="serial", line_type=LineType.Separate
    )
    first, last = np.ceil(np.nanmin(smooth) / interval_m), np.nanmax(smooth) / interval_m
    found: dict[int, list[shapely.LineString]] = {}
    for number in np.arange(first, last + 1).astype(int).tolist():
        # Of the kind `Separate` each line is an array of its vertices.
        lines = cast("list[np.ndarray]", drawn.lines(number * interval_m))
        found[number] = [shapely.LineString(np.round(line, SAME_DECIMALS)) for line in lines]
    return found


def _smoothed(heights: Any, tile: Tile) -> Float64[np.ndarray, "rows columns"]:
    """Heights of a tile, of each cell a weighted mean of the known ones about it; NaN in holes."""
    column, row, columns, rows = tile
    left, top = max(column - MARGIN_CELLS, 0), max(row - MARGIN_CELLS, 0)
    right = min(column + columns + MARGIN_CELLS, heights.width)
    bottom = min(row + rows + MARGIN_CELLS, heights.height)
    values = heights.read(1, window=window_of((left, top, right - left, bottom - top)))
    known = values != NODATA_M
    reach = MARGIN_CELLS / SMOOTH_CELLS
    weight = gaussian_filter(
        known.astype(np.float64), SMOOTH_CELLS, mode="constant", truncate=reach
    )
    filled = np.where(known, values, 0.0).astype(np.float64)
    total = gaussian_filter(filled, SMOOTH_CELLS, mode="constant", truncate=reach)
    sure = known & (weight >= LEAST_KNOWN)
    smooth = np.where(sure, total / np.where(sure, weight, 1.0), np.nan)
    return smooth[row - top : row - top + rows, column - left : column - left + columns]
