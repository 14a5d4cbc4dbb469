"""Sheets together: which share a raster, in which order they speak, what is told of them."""

import numpy as np
import pytest
from pyproj import CRS as Crs
from rasterio.transform import Affine

from core.raster.lattices import open_sheets
from tests.core.raster_files import CRS, NORTH, WEST, place, write_raster

PICTURE = np.full((40, 50), 120, np.uint8)


def sheets_of(*files, crs=CRS):
    return open_sheets(files, Crs(crs), "ortho")


def test_sheets_of_one_raster_share_a_lattice__truth(tmp_path):
    one = write_raster(tmp_path / "a.tif", PICTURE, place(0.5))
    two = write_raster(tmp_path / "b.tif", PICTURE, place(0.5, 50.01, -39.995))
    (lattice,) = sheets_of(two, one, one).lattices
    np.testing.assert_array_equal(lattice.offsets, [[0, 0], [50, -40]])
    assert [sheet.path for sheet in lattice.sheets] == [str(one), str(two)]
    assert lattice.ground_sample_distance_m == pytest.approx(0.5)
    assert lattice.north_up


@pytest.mark.parametrize(
    "other",
    [place(0.5, 50.1), place(0.501, 50), Affine(0.5, 0.01, WEST + 25, 0.01, -0.5, NORTH)],
    ids=["phase", "size", "turned"],
)
def test_what_does_not_fit_has_its_own_lattice__truth(tmp_path, other):
    one = write_raster(tmp_path / "a.tif", PICTURE, place(0.5))
    two = write_raster(tmp_path / "b.tif", PICTURE, other)
    assert len(sheets_of(one, two).lattices) == 2


def test_the_finest_lattice_comes_first_and_bounds_hold_all__truth(tmp_path):
    coarse = write_raster(tmp_path / "a.tif", PICTURE, place(2.0))
    fine = write_raster(tmp_path / "b.tif", PICTURE, place(0.5, -10, -20))
    sheets = sheets_of(coarse, fine)
    sizes = [lattice.ground_sample_distance_m for lattice in sheets.lattices]
    assert sizes == pytest.approx([0.5, 2.0])
    assert sheets.bounds == pytest.approx((WEST - 5, NORTH - 80, WEST + 100, NORTH + 10))
    assert sheets.notes == ()


def test_turned_and_foreign_lattices_are_not_north_up__truth(tmp_path):
    turned = Affine(0.3, 0.4, WEST, 0.4, -0.3, NORTH)
    (lattice,) = sheets_of(write_raster(tmp_path / "t.tif", PICTURE, turned)).lattices
    assert not lattice.north_up
    assert lattice.ground_sample_distance_m == pytest.approx(0.5)
    path = write_raster(tmp_path / "u.tif", PICTURE, place(0.5))
    foreign = sheets_of(path, crs="EPSG:32634")
    assert not foreign.lattices[0].north_up
    (note,) = foreign.notes
    assert note.kind == "reference-reprojected"


def test_the_key_changes_with_any_file__law(tmp_path):
    path = write_raster(tmp_path / "a.tif", PICTURE, place(0.5))
    before = sheets_of(path).key
    assert sheets_of(path).key == before
    write_raster(path, PICTURE + 1, place(0.5))
    assert sheets_of(path).key != before
