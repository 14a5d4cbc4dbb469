"""Heights: bilinear at exact places, gaps, pieces, and reprojected files."""

import pickle

import numpy as np
import pytest
import rasterio
from scipy.interpolate import RegularGridInterpolator

from core.errors import ReferenceDataError
from core.raster import dem as dem_module
from core.raster.dem import level_ground, open_dem
from core.raster.grid import Grid
from tests.core.raster_files import CRS, NORTH, WEST, place, write_raster


def hills(rows: int, columns: int) -> np.ndarray:
    y, x = np.mgrid[:rows, :columns]
    return (300 + 40 * np.sin(x / 17) * np.cos(y / 23) + 0.3 * x).astype(np.float32)


@pytest.fixture
def somewhere() -> np.ndarray:
    rng = np.random.default_rng(4)
    return np.column_stack([WEST + rng.uniform(1, 399, 500), NORTH - rng.uniform(1, 299, 500)])


def test_heights_are_bilinear_at_exact_places__oracle(tmp_path, somewhere):
    heights = hills(150, 200)
    dem = open_dem(write_raster(tmp_path / "d.tif", heights, place(2.0)), CRS)
    centres = NORTH - (np.arange(150) + 0.5) * 2, WEST + (np.arange(200) + 0.5) * 2
    oracle = RegularGridInterpolator((centres[0][::-1], centres[1]), heights[::-1].astype(float))
    np.testing.assert_allclose(dem.heights(somewhere), oracle(somewhere[:, ::-1]), atol=1e-9)
    np.testing.assert_allclose(
        dem.cropped(dem.bounds).heights(somewhere), dem.heights(somewhere), atol=1e-12
    )


def test_the_outer_half_pixel_belongs_to_the_dem_and_nothing_beyond__truth(tmp_path):
    dem = open_dem(write_raster(tmp_path / "d.tif", hills(150, 200), place(2.0)), CRS)
    west, south, east, north = dem.bounds
    at = np.array(
        [[west, north], [east, south], [west - 0.01, north - 5], [east - 5, south - 0.01]]
    )
    heights = dem.heights(at)
    assert heights[0] == pytest.approx(hills(150, 200)[0, 0])
    assert heights[1] == pytest.approx(hills(150, 200)[-1, -1])
    assert np.isnan(heights[2:]).all()


def test_a_plane_is_the_same_plane_through_small_gaps__law(tmp_path, somewhere):
    y, x = np.mgrid[:150, :200]
    plane = (250 + 0.25 * x - 0.5 * y).astype(np.float32)
    holed = plane.copy()
    rng = np.random.default_rng(1)
    for row, column in rng.integers(12, 130, (20, 2)):
        holed[row : row + 5, column : column + 4] = -9999
    holed[100:110, 150:160] = -9999
    dem = open_dem(write_raster(tmp_path / "d.tif", holed, place(2.0), nodata=-9999), CRS)
    window = dem.cropped(dem.bounds)
    assert window.filled == np.count_nonzero(holed == -9999)
    np.testing.assert_allclose(dem.on(dem.grid), plane, atol=1e-3)
    assert np.isfinite(dem.heights(somewhere)).all()
    inside = np.array([[WEST + 310.0, NORTH - 210.0], [WEST + 5.0, NORTH - 290.0]])
    np.testing.assert_array_equal(dem.filled_at(inside), [True, False])


def test_large_gaps_stay_gaps__truth(tmp_path):
    heights = hills(150, 200)
    heights[40:60, 50:53] = np.nan  # longer than ten pixels
    heights[0:4, 100:104] = np.nan  # at the rim: the ground ends there
    dem = open_dem(write_raster(tmp_path / "d.tif", heights, place(2.0), nodata=np.nan), CRS)
    on = dem.on(dem.grid)
    np.testing.assert_array_equal(np.isnan(on), np.isnan(heights))
    assert dem.cropped(dem.bounds).filled == 0


def test_a_gap_is_filled_alike_wherever_the_window_ends__law(tmp_path):
    heights = hills(150, 200)
    heights[70:78, 96:104] = np.nan
    dem = open_dem(write_raster(tmp_path / "d.tif", heights, place(2.0), nodata=np.nan), CRS)
    whole = dem.on(dem.grid)
    for column in range(92, 106, 3):
        part = dem.grid.window(column, 60, 40, 40)
        np.testing.assert_allclose(
            dem.cropped(part.bounds).on(part), whole[60:100, column : column + 40], atol=1e-4
        )


def test_a_part_too_large_for_memory_is_read_in_pieces_and_tells_the_same__law(
    tmp_path, monkeypatch
):
    dem = open_dem(write_raster(tmp_path / "d.tif", hills(150, 200), place(2.0)), CRS)
    part = dem.grid.window(37, 21, 120, 100)
    at = np.column_stack([WEST + np.linspace(70, 320, 400), NORTH - np.linspace(40, 250, 400)])
    held = dem.cropped(part.bounds)
    monkeypatch.setattr(dem_module, "HELD_PX", 1000)
    monkeypatch.setattr(dem_module, "PIECE_PX", 32)
    pieces = dem.cropped(part.bounds)
    assert held.window is not None
    assert pieces.window is None
    assert pieces.bounds == held.bounds
    dem.heights(at)
    np.testing.assert_allclose(pieces.heights(at), held.heights(at), atol=1e-9)
    np.testing.assert_allclose(pieces.on(part), held.on(part), atol=1e-4)


def test_pieces_join_without_seam__law(tmp_path, somewhere, monkeypatch):
    path = write_raster(tmp_path / "d.tif", hills(150, 200), place(2.0))
    whole = open_dem(path, CRS).heights(somewhere)
    monkeypatch.setattr(dem_module, "PIECE_PX", 16)
    dem = open_dem(path, CRS)
    np.testing.assert_allclose(dem.heights(somewhere), whole, atol=1e-9)
    copy = pickle.loads(pickle.dumps(dem))
    np.testing.assert_allclose(copy.heights(somewhere), whole, atol=1e-9)


def test_several_files_are_one_terrain__law(tmp_path, somewhere):
    heights = hills(150, 200)
    whole = open_dem(write_raster(tmp_path / "w.tif", heights, place(2.0)), CRS)
    parts = [
        write_raster(tmp_path / "a.tif", heights[:, :90].copy(), place(2.0)),
        write_raster(tmp_path / "b.tif", heights[:, 90:].copy(), place(2.0, 90)),
    ]
    dem = open_dem(parts, CRS)
    np.testing.assert_allclose(dem.heights(somewhere), whole.heights(somewhere), atol=1e-4)


def test_slopes_and_means__truth(tmp_path):
    y, x = np.mgrid[:150, :200]
    plane = (250 + 0.5 * x - 1.0 * y).astype(np.float32)
    dem = open_dem(write_raster(tmp_path / "d.tif", plane, place(2.0)), CRS)
    slopes = dem.slopes(np.array([[WEST + 100.0, NORTH - 90.0]]))
    np.testing.assert_allclose(slopes, [[0.25, 0.5]], atol=1e-4)
    assert dem.mean_height() == pytest.approx(float(plane.mean()), abs=0.1)
    east = dem.mean_height((WEST + 200, NORTH - 100, WEST + 300, NORTH - 50))
    assert east == pytest.approx(float(plane[25:50, 100:150].mean()), abs=0.5)
    assert np.isnan(dem.mean_height((0.0, 0.0, 1.0, 1.0)))


def test_a_coarser_grid_averages__truth(tmp_path):
    rng = np.random.default_rng(0)
    rough = (300 + rng.normal(0, 5, (200, 200))).astype(np.float32)
    dem = open_dem(write_raster(tmp_path / "d.tif", rough, place(1.0)), CRS)
    coarse = dem.on(Grid(WEST + 20, NORTH - 20, 10.0, 16, 16))
    assert coarse.std() < 1.0


def test_a_dem_in_another_crs_keeps_its_heights__truth(tmp_path):
    heights = hills(150, 200)
    here = open_dem(write_raster(tmp_path / "d.tif", heights, place(2.0)), CRS)
    there = open_dem(tmp_path / "d.tif", "EPSG:32634")
    (note,) = there.notes
    assert "32634" in note.message
    rng = np.random.default_rng(3)
    points = np.column_stack([WEST + rng.uniform(20, 380, 99), NORTH - rng.uniform(20, 280, 99)])
    operation = there.sheets.lattices[0].operation
    heights_there = there.heights(operation.forward(points))
    # Twice bilinear: within the curvature of the hills over a pixel.
    np.testing.assert_allclose(heights_there, here.heights(points), atol=0.25)


def test_a_dem_of_nodata_is_told__truth(tmp_path):
    empty = np.full((50, 50), -32768, np.int16)
    path = write_raster(tmp_path / "e.tif", empty, place(2.0), nodata=-32768)
    with pytest.raises(ReferenceDataError, match="every pixel is nodata"):
        open_dem(path, CRS)


@pytest.mark.parametrize("stray", [-9999, 9999])
def test_nodata_that_is_not_declared_lowers_no_mean__truth(tmp_path, stray):
    """Seen from afar, it was mixed into the ground around it."""
    heights = np.full((800, 800), 300, np.int16)
    heights[::12, ::12] = stray
    dem = open_dem(write_raster(tmp_path / "d.tif", heights, place(1.0)), CRS)
    np.testing.assert_allclose(dem.on(Grid(WEST, NORTH, 8.0, 100, 100)), 300.0, atol=1e-3)
    assert dem.mean_height() == pytest.approx(300.0)


def test_real_dems__real(shared_data):
    dem = open_dem(shared_data / "vovcha-film" / "dem.tif", "EPSG:26918")
    assert 225 < dem.mean_height() < 415
    folder = shared_data / "ngi-baviaanskloof"
    # A compound CRS, whose plane part is the block's under another name.
    lo25 = open_dem(folder / "frames" / "dem.tif", (folder / "io" / "ngi_xyz_opk.prj").read_text())
    assert not lo25.notes
    assert lo25.ground_sample_distance_m == 24.0
    assert np.isfinite(lo25.on(lo25.grid)).all()


def test_scaled_heights_are_metres_and_feet_are_refused__truth(tmp_path):
    path = write_raster(tmp_path / "s.tif", np.full((20, 20), 2500, np.int16), place(2.0))
    with rasterio.open(path, "r+") as file:
        file.scales, file.offsets = (0.1,), (-10.0,)
    dem = open_dem(path, CRS)
    assert dem.heights(np.array([[WEST + 20, NORTH - 20]]))[0] == pytest.approx(240.0)
    with rasterio.open(path, "r+") as file:
        file.units = ("ft",)
    with pytest.raises(ReferenceDataError, match="not in metres"):
        open_dem(path, CRS)


def test_level_ground_has_one_height_everywhere__law():
    ground = level_ground(312.5, "EPSG:5514")
    places = np.array([[-7e5, -1e6], [0.0, 0.0], [1e7, 1e7]])
    assert (ground.heights(places) == 312.5).all()
    assert (ground.slopes(places) == 0).all()
    assert ground.mean_height((-1.0, -1.0, 1.0, 1.0)) == 312.5
    grid = Grid(-7e5, -1e6, 0.5, 30, 20)
    assert ground.cropped(grid.bounds).on(grid).shape == (20, 30)
    assert (ground.on(grid, "cubic") == 312.5).all()
