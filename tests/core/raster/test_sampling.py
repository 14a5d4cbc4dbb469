"""Grids between the pixels: polynomials come out where they lie, whatever the reduction."""

import numpy as np
import pytest
from pyproj import CRS as Crs
from rasterio.transform import Affine

from core.raster.grid import Grid
from core.raster.lattices import open_sheets
from core.raster.sampling import ReadOptions, read_onto
from tests.core.raster_files import CRS, NORTH, WEST, place, write_raster


def plane(east, north):
    return 100 + 0.8 * (east - WEST) - 0.5 * (north - NORTH)


STEEPEST = float(np.hypot(0.8, 0.5))


def plane_file(path, transform, shape=(400, 500)):
    rows, columns = np.mgrid[: shape[0], : shape[1]] + 0.5
    a, b, c, d, e, f = transform[:6]
    east, north = a * columns + b * rows + c, d * columns + e * rows + f
    return write_raster(path, plane(east, north).astype(np.float32), transform)


def read(paths, grid, kernel, what="DEM", crs=CRS):
    sheets = open_sheets(paths, Crs(crs), what)
    return read_onto(sheets, grid, ReadOptions("heights", kernel))


@pytest.mark.parametrize("kernel", ["linear", "cubic"])
@pytest.mark.parametrize("gsd", [0.11, 0.2, 0.37, 0.5, 1.0, 1.7, 3.1])
def test_a_plane_stays_where_it_is_at_every_reduction__law(tmp_path, gsd, kernel):
    path = plane_file(tmp_path / "p.tif", place(0.2))
    grid = Grid(WEST + 20.3, NORTH - 20.1, gsd, int(40 / gsd), int(30 / gsd))
    east, north = grid.centres()
    sampled = read([path], grid, kernel)
    shift_px = (sampled.values[0] - plane(east[None], north[:, None])) / (STEEPEST * gsd)
    # Widened kernels ripple by a few hundredths, to either side alike: nothing is moved.
    assert np.abs(shift_px).max() < 0.05
    assert abs(shift_px.mean()) < 1e-3
    if gsd in (0.2, 1.0):
        assert np.abs(shift_px).max() < 1e-3
    np.testing.assert_array_equal(sampled.coverage, 1)


@pytest.mark.parametrize("gsd", [0.2, 0.5, 1.7])
def test_a_turned_sheet_keeps_the_plane__law(tmp_path, gsd):
    c, s = 0.2 * np.cos(0.44), 0.2 * np.sin(0.44)
    path = plane_file(tmp_path / "t.tif", Affine(c, s, WEST, s, -c, NORTH))
    grid = Grid(WEST + 38, NORTH - 10, gsd, int(20 / gsd), int(20 / gsd))
    east, north = grid.centres()
    values = read([path], grid, "cubic").values[0]
    cell_m = 0.2 * 2 ** max(0, int(np.log2(gsd / 0.2)) - 1)
    shift_cells = (values - plane(east[None], north[:, None])) / (STEEPEST * cell_m)
    # OpenCV's cubic is no straight line between pixels, but it sways to either side alike.
    assert np.abs(shift_cells).max() < 0.1
    assert abs(shift_cells.mean()) < 5e-3


def test_a_parabola_is_kept_by_the_cubic_kernel__law(tmp_path):
    rows, columns = np.mgrid[:200, :200] + 0.5
    parabola = (0.01 * columns**2 - 0.02 * rows * columns).astype(np.float32)
    path = write_raster(tmp_path / "q.tif", parabola, place(1.0))
    grid = Grid(WEST + 50.3, NORTH - 60.7, 0.31, 200, 150)
    east, north = grid.centres()
    x, y = east[None] - WEST, NORTH - north[:, None]
    # Pixels are points here, not means, as in every cubic convolution.
    np.testing.assert_allclose(
        read([path], grid, "cubic").values[0], 0.01 * x**2 - 0.02 * x * y, atol=2e-3
    )


def test_coverage_falls_linearly_across_a_rim__truth(tmp_path):
    path = plane_file(tmp_path / "p.tif", place(0.2))
    grid = Grid(WEST - 1.0, NORTH - 20, 0.2, 10, 5)
    coverage = read([path], grid, "cubic").coverage
    np.testing.assert_allclose(coverage[:, :5], 0, atol=1e-6)
    np.testing.assert_allclose(coverage[:, 5:], 1, atol=1e-6)
    half = read([path], Grid(WEST - 1.1, NORTH - 20, 0.2, 10, 5), "cubic").coverage
    np.testing.assert_allclose(half[0], [0] * 5 + [0.5] + [1] * 4, atol=1e-4)


def test_a_large_grid_is_read_in_pieces_that_join__law(tmp_path, monkeypatch):
    path = plane_file(tmp_path / "p.tif", place(0.2))
    grid = Grid(WEST + 1, NORTH - 1, 0.25, 300, 280)
    whole = read([path], grid, "cubic")
    monkeypatch.setattr("core.raster.sampling.PIECE_PX", 64)
    np.testing.assert_allclose(read([path], grid, "cubic").values, whole.values, atol=1e-4)
