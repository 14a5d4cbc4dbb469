"""Places of a grid; tiles on disk, of which what GDAL did not finish is never taken for whole."""

from functools import partial

import numpy as np
import pytest
import rasterio

from core.progress import Silent
from core.raster.grid import (
    Grid,
    refuse_incomplete,
    sums_over_cells,
    tiled_profile,
    tiles_of,
    write_tiles,
)

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
    work = {"tiles": tiles, "threads": 1, "progress": Silent(), "what": "noise"}
    return write_tiles(path, profile, {}, compute, **work)


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


def test_places_of_a_grid_are_those_of_gdal__oracle():
    transform = rasterio.Affine.from_gdal(*GRID.geotransform)
    places = np.array([[0.0, 0.0], [0.5, 0.5], [1300.0, 900.0], [-7.25, 3.0]])
    columns, rows = places.T
    ground = np.column_stack(rasterio.transform.xy(transform, rows, columns, offset="ul"))
    np.testing.assert_allclose(GRID.object_from_grid(places), ground)
    np.testing.assert_allclose(GRID.grid_from_object(ground), places, atol=1e-9)
    east, north = GRID.centres()
    assert (east[0], north[0]) == rasterio.transform.xy(transform, 0, 0)
    assert GRID.bounds == rasterio.transform.array_bounds(900, 1300, transform)


def test_a_grid_over_bounds_covers_them_and_no_more__law():
    grid = Grid.over((10.1, 20.0, 14.0, 25.3), 0.5)
    assert grid.bounds == (10.0, 20.0, 14.0, 25.5)
    assert grid == Grid.over(grid.bounds, 0.5)
    assert GRID.covering(GRID.window(7, 5, 30, 20).bounds) == GRID.window(7, 5, 30, 20)
    assert GRID.covering(GRID.window(7, 5, 30, 20).bounds, 2) == GRID.window(5, 3, 34, 24)
    assert GRID.covering(GRID.window(-9, -9, 30, 20).bounds) == GRID.window(0, 0, 21, 11)


@pytest.mark.parametrize(("dtype", "side"), [("uint8", 3), ("uint8", 17), ("uint16", 4)])
def test_sums_over_cells_are_exact__law(dtype, side):
    values = np.full((5 * side, 7 * side), np.iinfo(dtype).max, dtype)
    values[:side, :side] = np.arange(side * side).reshape(side, side) % 251
    sums = sums_over_cells(values, side)
    assert sums[0, 0] == values[:side, :side].astype(np.int64).sum()
    assert (sums.ravel()[1:] == int(np.iinfo(dtype).max) * side**2).all()
