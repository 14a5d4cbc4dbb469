"""Contour lines of a surface."""

from pathlib import Path
from typing import Any, cast

import numpy as np
import rasterio
import shapely
from contourpy import LineType, contour_generator

from core.formats.vectors import write_layer
from core.progress import Work
from core.raster.grid import BLOCK_PX, Grid, Tile, tiles_of
from core.surface.ground import read_smooth

LAYER = "contours"
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
    smooth = read_smooth(heights, (column, row, columns, rows))
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
