"""Holes of a raster: what is put in is what is found, what is open to the edge is none."""

import numpy as np
import pytest
import rasterio
from affine import Affine
from shapely.geometry import box

from core.raster import dem as dem_module
from core.raster import holes as holes_module
from core.raster.dem import open_dem
from core.raster.holes import LATTICE, find_height_holes, find_holes, find_noughts
from tests.core.raster_files import CRS, place, write_raster
from tests.core.raster_files import NORTH as TOP
from tests.core.raster_files import WEST as LEFT

GSD = 0.5
WEST, NORTH = -578_000.0, -1_190_000.0


def written(path, values):
    rows, columns = values.shape
    profile = {"width": columns, "height": rows, "count": 1, "dtype": "uint8", "nodata": 0}
    transform = Affine(GSD, 0, WEST, 0, -GSD, NORTH)
    with rasterio.open(
        path, "w", driver="GTiff", crs="EPSG:5514", transform=transform, tiled=True, **profile
    ) as file:
        file.write(values, 1)
    return path


def test_five_holes_are_found_with_size_and_place__truth(tmp_path):
    values = np.full((600, 800), 90, dtype=np.uint8)
    values[:40] = 0
    sizes = [(10, 12), (20, 30), (7, 7), (40, 25), (3, 50)]
    for number, (tall, wide) in enumerate(sizes):
        values[100 + 80 * number :, 60 + 120 * number :][:tall, :wide] = 0
    found = find_holes(written(tmp_path / "mosaic.tif", values))
    assert [hole.area_m2 for hole in found] == sorted(
        (tall * wide * GSD**2 for tall, wide in sizes), reverse=True
    )
    largest = found[0]
    assert largest.east == pytest.approx(WEST + GSD * (60 + 360 + 12.5))
    assert largest.north == pytest.approx(NORTH - GSD * (100 + 240 + 20))


def test_what_is_open_to_the_edge_is_no_hole__truth(tmp_path):
    values = np.full((300, 300), 90, dtype=np.uint8)
    values[100:150, 250:] = 0
    values[:30, 10:20] = 0
    assert find_holes(written(tmp_path / "open.tif", values)) == ()
    values[:] = 0
    assert find_holes(written(tmp_path / "empty.tif", values)) == ()


def test_of_an_area_all_is_a_hole_that_lacks_data_within_and_nothing_else__truth(tmp_path):
    """An area with a gap of its own, beside which the raster ends: edges cut middles of pixels."""
    values = np.full((300, 300), 90, dtype=np.uint8)
    values[100:150, 250:] = 0
    values[200:220, 100:130] = 0
    values[20:40, 20:40] = 0

    def there(left, top, right, bottom):
        return box(WEST + left * GSD, NORTH - bottom * GSD, WEST + right * GSD, NORTH - top * GSD)

    area = there(50, 50.5, 280.5, 280).difference(there(90, 190, 115.5, 230))
    found = find_holes(written(tmp_path / "area.tif", values), area)
    # A middle on an edge belongs to the pixel's left or upper side.
    assert [hole.area_m2 / GSD**2 for hole in found] == [50 * 30, 20 * 15]
    assert find_holes(written(tmp_path / "whole.tif", values), there(150, 150, 240, 240)) == ()


def test_a_large_raster_is_told_on_a_lattice_with_the_same_areas__truth(tmp_path):
    values = np.full((400, LATTICE + 301), 90, dtype=np.uint8)
    values[100:133, 501:548] = 0
    values[300:320, LATTICE + 100 : LATTICE + 111] = 0
    found = find_holes(written(tmp_path / "wide.tif", values))
    assert [hole.area_m2 for hole in found] == [33 * 47 * GSD**2, 20 * 11 * GSD**2]
    assert found[0].east == pytest.approx(WEST + GSD * 524.5, abs=2 * GSD)


@pytest.fixture
def holed(tmp_path):
    """A DEM of 2 m with a hole of 80 by 60 m, a gap of 10 cells, and a hole beside the photos."""
    heights = np.full((300, 400), 250, dtype=np.float32)
    heights[100:130, 200:240] = heights[50:60, 50:60] = heights[200:240, 350:390] = -9999
    return write_raster(tmp_path / "dem.tif", heights, place(2.0), nodata=-9999)


GROUND = box(LEFT + 20, TOP - 580, LEFT + 680, TOP - 20)


def test_ground_without_height_is_found_with_size_and_place__truth(holed):
    (hole,) = find_height_holes(open_dem(holed, CRS), GROUND)
    assert hole.area_m2 == 30 * 40 * 4
    assert (hole.east, hole.north) == pytest.approx((LEFT + 440, TOP - 230))


def test_a_dem_too_large_to_be_held_shows_the_same_hole__truth(holed, monkeypatch):
    for module in (dem_module, holes_module):
        monkeypatch.setattr(module, "HELD_PX", 15_000)
    (hole,) = find_height_holes(open_dem(holed, CRS), GROUND)
    # A cell of three pixels is known or not.
    assert hole.area_m2 == pytest.approx(30 * 40 * 4, rel=0.2)
    assert (hole.east, hole.north) == pytest.approx((LEFT + 440, TOP - 230), abs=6)


def test_a_coarser_dem_fills_what_the_finer_leaves_open__truth(holed, tmp_path):
    coarse = np.full((30, 40), 249, dtype=np.float32)
    both = [holed, write_raster(tmp_path / "coarse.tif", coarse, place(20.0))]
    dem = open_dem(both, CRS)
    assert find_height_holes(dem, GROUND) == ()
    assert dem.heights(np.array([[LEFT + 440.0, TOP - 230.0]])) == pytest.approx(249)


def test_noughts_between_walls_are_no_heights_and_the_sea_is_one__truth(tmp_path):
    columns = np.tile(np.arange(400, dtype=np.float32), (300, 1))
    # A coast: land rises from the sea, one cell in twenty, cliffs of 40 m behind a bay.
    heights = np.maximum(0, (columns - 100) / 10)
    heights[:40, 150:] += 40
    heights[20:40, 100:250] = 0
    assert (
        find_noughts(open_dem(write_raster(tmp_path / "sea.tif", heights, place(2.0)), CRS), GROUND)
        == ()
    )
    heights[150:180, 200:240] = 0
    (hole,) = find_noughts(
        open_dem(write_raster(tmp_path / "dem.tif", heights, place(2.0)), CRS), GROUND
    )
    assert hole.area_m2 == 30 * 40 * 4
    assert (hole.east, hole.north) == pytest.approx((LEFT + 440, TOP - 330))


def test_photos_beside_a_dem_leave_no_hole_in_it__truth(holed):
    assert find_height_holes(open_dem(holed, CRS), box(LEFT - 900, TOP, LEFT - 10, TOP + 9)) == ()
