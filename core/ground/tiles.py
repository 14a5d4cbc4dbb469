"""Rasters computed tile by tile, side by side, and written in order as tiled GeoTIFFs."""

from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from affine import Affine
from jaxtyping import Shaped
from rasterio.windows import Window

from core.geometry.grid import Grid
from core.progress import Progress, Silent

NODATA = 0
"""Gray value of what is not seen; whatever is seen is at least 1."""
SILENT = Silent()
Tile = tuple[int, int, int, int]
"""Column, row, columns, rows of a part of a grid."""
Pixels = Shaped[np.ndarray, "rows columns"]
"""Gray values in the type of the scans."""


def tiles_of(grid: Grid, tile_px: int) -> Iterator[Tile]:
    """The tiles of a grid, row by row."""
    for row in range(0, grid.rows, tile_px):
        for column in range(0, grid.columns, tile_px):
            columns, rows = min(tile_px, grid.columns - column), min(tile_px, grid.rows - row)
            yield column, row, columns, rows


def write_tiles(
    path: Path,
    profile: dict[str, Any],
    tags: dict[str, str],
    compute: Callable[[Tile], Pixels | None],
    tiles: Sequence[Tile],
    threads: int,
    progress: Progress,
    what: str,
) -> int:
    """Compute tiles and write them; the number of pixels that are not nodata."""
    covered = 0
    with rasterio.open(path, "w", **profile) as out:
        out.update_tags(**tags)
        with closing(_in_order(compute, tiles, threads)) as results:
            for done, (tile, values) in enumerate(results, start=1):
                if values is not None:
                    covered += int(np.count_nonzero(values))
                    out.write(values, 1, window=window_of(tile))
                progress.report(float(done), float(len(tiles)), what)
    return covered


def window_of(tile: Tile) -> Window:
    """A tile as rasterio's window."""
    return Window(*tile)  # pyright: ignore[reportCallIssue]


def tiled_profile(grid: Grid, crs: str, dtype: str) -> dict[str, Any]:
    """One band of gray values in blocks of 512, empty blocks left out."""
    return {
        "driver": "GTiff",
        "width": grid.columns,
        "height": grid.rows,
        "count": 1,
        "dtype": dtype,
        "crs": crs,
        "transform": Affine.from_gdal(*grid.geotransform),
        "nodata": NODATA,
        "tiled": True,
        "blockxsize": 512,
        "blockysize": 512,
        "bigtiff": "if_safer",
        "sparse_ok": True,
    }


def _in_order(
    compute: Callable[[Tile], Pixels | None], tiles: Sequence[Tile], threads: int
) -> Generator[tuple[Tile, Pixels | None], None, None]:
    """Tiles in their order, computed side by side, with few waiting to be written."""
    with ThreadPoolExecutor(threads) as pool:
        waiting: deque[tuple[Tile, Future[Pixels | None]]] = deque()
        try:
            for tile in tiles:
                waiting.append((tile, pool.submit(compute, tile)))
                if len(waiting) > 2 * threads:
                    first, future = waiting.popleft()
                    yield first, future.result()
            while waiting:
                first, future = waiting.popleft()
                yield first, future.result()
        finally:
            for _, future in waiting:
                future.cancel()
