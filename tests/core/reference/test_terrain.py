"""Rays and the terrain."""

import numpy as np
import pytest

from core.reference.dem import open_dem
from core.reference.terrain import object_on_terrain

from .conftest import CRS, NORTH, WEST, place, write_raster


def test_rays_end_where_they_were_aimed_on_a_plane__truth(tmp_path):
    y, x = np.mgrid[:200, :200]
    plane = (250 + 0.5 * x - 0.25 * y).astype(np.float32)
    dem = open_dem(write_raster(tmp_path / "d.tif", plane, place(5.0)), CRS)
    rng = np.random.default_rng(0)
    plane_points = np.column_stack(
        [WEST + rng.uniform(20, 980, 400), NORTH - rng.uniform(20, 980, 400)]
    )
    targets = np.column_stack([plane_points, dem.heights(plane_points)])
    centre = np.array([WEST + 500, NORTH - 500, 1500.0])
    found = object_on_terrain(centre, (targets - centre) * rng.uniform(0.01, 3, (400, 1)), dem)
    np.testing.assert_allclose(found, targets, atol=1e-6)


def test_a_ridge_hides_what_lies_behind__truth(tmp_path):
    heights = np.full((100, 200), 100, np.float32)
    heights[:, 100:104] = 300
    dem = open_dem(write_raster(tmp_path / "d.tif", heights, place(5.0)), CRS)
    centre = np.array([WEST + 100, NORTH - 250, 400.0])
    target = np.array([[WEST + 700, NORTH - 250, 100.0]])
    (found,) = object_on_terrain(centre, target - centre, dem)
    assert found[0] == pytest.approx(WEST + 499, abs=3)
    assert 150 < found[2] < 320


def test_rays_that_find_nothing__truth(tmp_path):
    heights = np.full((100, 100), 100, np.float32)
    heights[:, 50:80] = np.nan
    dem = open_dem(write_raster(tmp_path / "d.tif", heights, place(5.0), nodata=np.nan), CRS)
    centre = np.array([WEST + 100, NORTH - 250, 1000.0])
    rays = np.array([[0, 0, 1.0], [1, 0, 0], [0.25, 0, -1], [1.5, 0, -1], [0, 0, -1]])
    found = object_on_terrain(centre, rays, dem)
    assert np.isnan(found[:4]).all()
    np.testing.assert_allclose(found[4], [centre[0], centre[1], 100])


def test_steep_relief_seen_from_low__real(shared_data):
    dem = open_dem(shared_data / "vovcha-film" / "dem.tif", "EPSG:26918")
    rng = np.random.default_rng(0)
    west, south, east, north = dem.bounds
    plane = np.column_stack(
        [rng.uniform(west + 5, east - 5, 2000), rng.uniform(south + 5, north - 5, 2000)]
    )
    targets = np.column_stack([plane, dem.heights(plane)])
    centre = np.array([622200.0, 4693900.0, 1030.0])
    found = object_on_terrain(centre, targets - centre, dem)
    away = np.linalg.norm(found - targets, axis=1)
    nearer = np.linalg.norm(found - centre, axis=1) <= np.linalg.norm(targets - centre, axis=1)
    # Every ray ends on its target, or on a slope before it.
    assert (nearer | (away < 1e-3)).all()
    assert (away < 1e-3).mean() > 0.98
    np.testing.assert_allclose(dem.heights(found[:, :2]), found[:, 2], atol=1e-3)
