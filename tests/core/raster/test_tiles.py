"""Tiles on disk: what GDAL could not write to the end is never taken for whole."""

from functools import partial

import numpy as np
import pytest
import rasterio

from core.progress import Silent
from core.raster.grid import Grid
from core.raster.tiles import refuse_incomplete, tiled_profile, tiles_of, write_tiles

GRID = Grid(-577_000.0, -1_192_000.0, 1.0, 1300, 900)


def noise(rng: np.random.Generator, tile: tuple[int, int, int, int]) -> np.ndarray | None:
    """Something everywhere but in the second tile."""
    column, row, columns, rows = tile
    if (column, row) == (512, 0):
        return None
    return rng.integers(1, 255, (rows, columns), dtype=np.uint8)


def written(path, **options) -> int:
    profile = tiled_profile(GRID, "EPSG:5514", "uint8") | options
    tiles = list(tiles_of(GRID, 512))
    compute = partial(noise, np.random.default_rng(1))
    return write_tiles(path, profile, {}, compute, tiles, 1, Silent(), "noise")


@pytest.mark.parametrize("options", [{}, {"compress": "deflate"}])
def test_tiles_come_back_and_empty_ones_stay_empty__truth(tmp_path, options):
    covered = written(tmp_path / "noise.tif", **options)
    with rasterio.open(tmp_path / "noise.tif") as file:
        values = file.read(1)
    assert covered == np.count_nonzero(values) == 1300 * 900 - 512 * 512
    refuse_incomplete(tmp_path / "noise.tif", blocks=5)


@pytest.mark.parametrize("options", [{}, {"compress": "deflate"}])
def test_a_raster_that_ends_early_is_refused__truth(tmp_path, options):
    path = tmp_path / "noise.tif"
    written(path, **options)
    content = path.read_bytes()
    path.write_bytes(content[:-20_000])
    with pytest.raises(OSError, match="No space left"):
        refuse_incomplete(path, blocks=0)


def test_a_raster_that_lacks_a_block_is_refused__truth(tmp_path):
    written(tmp_path / "noise.tif")
    with pytest.raises(OSError, match="No space left"):
        refuse_incomplete(tmp_path / "noise.tif", blocks=6)
