"""A north-up raster product: where its pixels lie on the ground, and its file, tile by tile.

Tiles are computed side by side and written in order as tiled GeoTIFFs. Shapes are burnt into its
cells.
"""

import errno
import os
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
import rasterio
import rasterio.features
from affine import Affine
from jaxtyping import Float64, Int32, Int64, Shaped
from rasterio._err import CPLE_BaseError
from rasterio.errors import RasterioError
from rasterio.windows import Window
from shapely.geometry import box
from shapely.geometry.base import BaseGeometry

from core.arrays import Mask
from core.frames import HALF_PIXEL
from core.geometry.areas import Area, only_areas
from core.geometry.crs import Bounds
from core.progress import Progress

# design: the one value that 8 and 16 bit have in common and photographs do not need.
NODATA = 0
"""Gray value of what is not seen; whatever is seen is at least 1."""
# source: GDAL's driver for Cloud Optimized GeoTIFF, default of BLOCKSIZE
BLOCK_PX = 512
"""Side of the blocks of a file, pixels."""
# design: what is left of nine digits of metres in double precision at a pixel of a millimetre.
ROUNDING_PX = 1e-6
"""An edge nearer than this to the edge of a pixel lies on it."""
# design: in no direction that an edge between corners of cells has
ASIDE_PX = (1.37e-3, 0.71e-3)
"""Shapes are burnt that far aside: an edge through middles of pixels falls alike in all tiles."""
Tile = tuple[int, int, int, int]
"""Column, row, columns, rows of a part of a grid."""
Pixels = Shaped[np.ndarray, "rows columns *bands"]
"""Values in the type of the scans: gray, or band by band last."""


@dataclass(frozen=True, slots=True)
class Grid:
    """A north-up raster: row 0 at the top, square pixels."""

    west: float
    """Easting of the outer left edge, metres."""
    north: float
    """Northing of the outer top edge, metres."""
    ground_sample_distance_m: float
    """Size of a pixel on the ground, metres."""
    columns: int
    """Number of columns."""
    rows: int
    """Number of rows."""

    @staticmethod
    def over(bounds: Bounds, ground_sample_distance_m: float) -> "Grid":
        """Smallest grid on multiples of the pixel size that covers west, south, east, north."""
        gsd = ground_sample_distance_m
        west, south = (int(np.floor(edge / gsd + ROUNDING_PX)) for edge in bounds[:2])
        east, north = (int(np.ceil(edge / gsd - ROUNDING_PX)) for edge in bounds[2:])
        return Grid(west * gsd, north * gsd, gsd, east - west, north - south)

    @property
    def bounds(self) -> Bounds:
        """West, south, east, north, metres."""
        gsd = self.ground_sample_distance_m
        east, south = self.west + self.columns * gsd, self.north - self.rows * gsd
        return self.west, south, east, self.north

    @property
    def geotransform(self) -> tuple[float, float, float, float, float, float]:
        """GDAL geotransform: outer corner of the first pixel, x size, 0, north, 0, -y size."""
        gsd = self.ground_sample_distance_m
        return self.west, gsd, 0.0, self.north, 0.0, -gsd

    def window(self, column: int, row: int, columns: int, rows: int) -> "Grid":
        """A part of this grid."""
        gsd = self.ground_sample_distance_m
        return Grid(self.west + column * gsd, self.north - row * gsd, gsd, columns, rows)

    def covering(self, bounds: Bounds, margin: int = 0) -> "Grid":
        """The part of this grid over bounds and a margin of pixels; at least one pixel."""
        west, south, east, north = bounds
        corners = self.grid_from_object(np.array([[west, north], [east, south]]))
        size = np.array([self.columns, self.rows])
        low = np.clip(np.floor(corners[0] + ROUNDING_PX).astype(int) - margin, 0, size - 1)
        high = np.clip(np.ceil(corners[1] - ROUNDING_PX).astype(int) + margin, low + 1, size)
        columns, rows = (high - low).tolist()
        return self.window(int(low[0]), int(low[1]), columns, rows)

    @property
    def aside(self) -> "Grid":
        """The same a little aside, to burn shapes in: no middle of a pixel lies on an edge."""
        gsd = self.ground_sample_distance_m
        west, north = self.west + ASIDE_PX[0] * gsd, self.north + ASIDE_PX[1] * gsd
        return replace(self, west=west, north=north)

    @property
    def on_multiples(self) -> tuple[int, int] | None:
        """Column and row of the first pixel where pixels are counted from (0, 0) of the CRS.

        None unless the edges of pixels lie on multiples of their size.
        """
        gsd = self.ground_sample_distance_m
        column, row = self.west / gsd, -self.north / gsd
        if max(abs(column - round(column)), abs(row - round(row))) > ROUNDING_PX:
            return None
        return round(column), round(row)

    def object_from_grid(self, points: Float64[np.ndarray, "n 2"]) -> Float64[np.ndarray, "n 2"]:
        """Easting and northing of grid points (column, row; the outer corner is (0, 0))."""
        gsd = self.ground_sample_distance_m
        return np.array([self.west, self.north]) + points * np.array([gsd, -gsd])

    def grid_from_object(self, points: Float64[np.ndarray, "n 2"]) -> Float64[np.ndarray, "n 2"]:
        """Grid points (column, row) of easting and northing."""
        gsd = self.ground_sample_distance_m
        return (points - np.array([self.west, self.north])) / np.array([gsd, -gsd])

    def centres(self) -> tuple[Float64[np.ndarray, "columns"], Float64[np.ndarray, "rows"]]:
        """Eastings of the column centres and northings of the row centres, metres."""
        gsd = self.ground_sample_distance_m
        return (
            self.west + (np.arange(self.columns) + HALF_PIXEL) * gsd,
            self.north - (np.arange(self.rows) + HALF_PIXEL) * gsd,
        )


RASTERIZING = Lock()
"""rasterio silences a warning of its own while it rasterizes, which is one thread's business."""


def tiles_of(grid: Grid, tile_px: int) -> Iterator[Tile]:
    """The tiles of a grid, row by row."""
    for row in range(0, grid.rows, tile_px):
        for column in range(0, grid.columns, tile_px):
            columns, rows = min(tile_px, grid.columns - column), min(tile_px, grid.rows - row)
            yield column, row, columns, rows


def tiles_on_multiples(grid: Grid, tile_px: int) -> Iterator[Tile]:
    """The tiles of a grid, cut where pixels counted from (0, 0) of the CRS are multiples.

    They stay the same when the grid grows.
    """
    corner = grid.on_multiples or (0, 0)
    edges: list[list[int]] = []
    for start, size in zip(corner, (grid.columns, grid.rows), strict=True):
        first = tile_px - start % tile_px
        edges.append([0, *range(first, size, tile_px), size])
    for row, below in zip(edges[1], edges[1][1:], strict=False):
        for column, right in zip(edges[0], edges[0][1:], strict=False):
            yield column, row, right - column, below - row


def write_tiles(
    path: Path,
    profile: dict[str, Any],
    tags: dict[str, str],
    compute: Callable[[Tile], Pixels | None],
    *,
    tiles: Sequence[Tile],
    threads: int,
    progress: Progress,
    what: str,
) -> int:
    """Compute tiles and write them; the number of pixels that are not nodata.

    Raises:
        OSError: The disk is full.
    """
    covered, filled = 0, set[tuple[int, int]]()
    with rasterio.open(path, "w", **profile) as out:
        out.update_tags(**tags)
        with closing(_compute_in_order(compute, tiles, threads)) as results:
            for done, (tile, values) in enumerate(results, start=1):
                if values is not None:
                    bands = values[None] if values.ndim == 2 else np.moveaxis(values, -1, 0)
                    covered += int(np.count_nonzero(bands[0]))
                    filled.update(_filled_blocks(tile, bands[0]))
                    with tell_full_disk(path):
                        out.write(bands, window=window_of(tile))
                progress.report(float(done), float(len(tiles)), what)
    refuse_incomplete(path, len(filled))
    return covered


@contextmanager
def tell_full_disk(path: Path) -> Generator[None]:
    """What GDAL says when a raster cannot be written, as an OSError: the disk is full."""
    try:
        yield
    except (RasterioError, CPLE_BaseError) as error:
        raise disk_full(path) from error


def refuse_incomplete(path: Path, blocks: int) -> None:
    """Make sure that a TIFF is whole: on a full disk GDAL writes behind, and closes without a word.

    Its overviews are looked at too.

    Args:
        path: A file that was just written and closed.
        blocks: How many of the blocks hold something.

    Raises:
        OSError: Blocks are missing, or lie beyond the end of the file.
    """
    with tell_full_disk(path), rasterio.open(path) as file:
        size, present = path.stat().st_size, 0
        height, width = file.block_shapes[0]
        for level, factor in enumerate([1, *file.overviews(1)], start=-1):
            of_level = {} if level < 0 else {"ovr": level}
            for i in range(-(-file.height // (factor * height))):
                for j in range(-(-file.width // (factor * width))):
                    offset, length = (
                        int(file.get_tag_item(f"{what}_{j}_{i}", "TIFF", bidx=1, **of_level) or 0)
                        for what in ("BLOCK_OFFSET", "BLOCK_SIZE")
                    )
                    present += level < 0 < offset
                    if offset + length > size:
                        raise disk_full(path)
        if present < blocks:
            raise disk_full(path)


def disk_full(path: Path) -> OSError:
    """What a full disk says of a file."""
    return OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


def _filled_blocks(tile: Tile, values: Pixels) -> Iterator[tuple[int, int]]:
    """Blocks of the file, by row and column, in which a tile has more than nodata."""
    column, row, columns, rows = tile
    for i in range(row // BLOCK_PX, -(-(row + rows) // BLOCK_PX)):
        for j in range(column // BLOCK_PX, -(-(column + columns) // BLOCK_PX)):
            top, left = max(i * BLOCK_PX - row, 0), max(j * BLOCK_PX - column, 0)
            part = values[top : (i + 1) * BLOCK_PX - row, left : (j + 1) * BLOCK_PX - column]
            if (part != NODATA).any():
                yield i, j


def window_of(tile: Tile) -> Window:
    """A tile as rasterio's window."""
    return Window(*tile)  # pyright: ignore[reportCallIssue]


def tiled_profile(grid: Grid, crs: str, dtype: str, bands: int = 1) -> dict[str, Any]:
    """One band of gray values, or colours, in blocks of 512, empty blocks left out."""
    # Left to itself GDAL takes a fourth band for how opaque pixels are.
    colour = {"photometric": "rgb", "interleave": "pixel"} if bands > 2 else {}
    more = {"alpha": "no"} if bands > 3 else {}
    return {
        "driver": "GTiff",
        "width": grid.columns,
        "height": grid.rows,
        "count": bands,
        "dtype": dtype,
        "crs": crs,
        "transform": Affine.from_gdal(*grid.geotransform),
        "nodata": NODATA,
        "tiled": True,
        "blockxsize": BLOCK_PX,
        "blockysize": BLOCK_PX,
        "bigtiff": "if_safer",
        "sparse_ok": True,
        **colour,
        **more,
    }


def _compute_in_order(
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


def sums_over_cells(values: Pixels, side: int) -> Int64[np.ndarray, "_ _"]:
    """Exact sums over square cells of whole numbers.

    Args:
        values: Whole numbers from 0; rows and columns are multiples of the side.
        side: Side of a cell, pixels.
    """
    # The narrowest type is the fastest, and no sum overflows it.
    tall = values[::side].astype(np.min_scalar_type(int(np.iinfo(values.dtype).max) * side**2))
    for row in range(1, side):
        tall += values[row::side]
    wide = tall[:, ::side].copy()
    for column in range(1, side):
        wide += tall[:, column::side]
    return wide.astype(np.int64)


def burn(
    shapes: Iterable[tuple[BaseGeometry, int]], grid: Grid, *, empty: int, touched: bool = False
) -> Int32[np.ndarray, "rows columns"]:
    """The number of the last shape in each cell.

    Args:
        shapes: Shapes in the block's CRS, each with its number.
        grid: The cells.
        empty: What stands where there is none.
        touched: Whether a cell counts that a shape only touches; else its middle must lie inside.
    """
    kept = [(shape, number) for shape, number in shapes if not shape.is_empty]
    if not kept:
        return np.full((grid.rows, grid.columns), empty, dtype=np.int32)
    transform = Affine.from_gdal(*grid.geotransform)
    with RASTERIZING:
        burnt = rasterio.features.rasterize(
            kept,
            (grid.rows, grid.columns),
            empty,
            transform=transform,
            all_touched=touched,
            dtype="int32",
        )
    return np.asarray(burnt, dtype=np.int32)


def burn_area(area: Area, grid: Grid) -> Mask:
    """True for the pixels whose middle lies in an area, alike in whatever part of a raster."""
    around = box(*grid.bounds).buffer(grid.ground_sample_distance_m, join_style="mitre")
    if area.covers(around):
        return np.ones((grid.rows, grid.columns), dtype=np.bool_)
    # Burning costs time for every vertex, wherever it lies.
    return burn([(only_areas(area.intersection(around)), 1)], grid.aside, empty=0) == 1
