"""One sheet: what it is, where it lies, what of it is margin."""

from contextlib import nullcontext

import numpy as np
import pytest
import rasterio
from pyproj import CRS as Crs
from rasterio.transform import Affine

from core.errors import ReferenceDataError
from core.raster.sheets import block_outline, open_sheet
from tests.core.raster_files import CRS, NORTH, WEST, place, smooth_picture, write_raster

BLOCK = Crs(CRS)


def test_a_sheet_lies_where_its_file_says__truth(tmp_path):
    path = write_raster(tmp_path / "a.tif", np.ones((30, 40), np.uint8), place(0.5, 10, 20))
    sheet = open_sheet(path, BLOCK, "ortho")
    assert (sheet.columns, sheet.rows, sheet.bands, sheet.crs) == (40, 30, (1,), "")
    west, north = WEST + 5, NORTH - 10
    expected = [[west, north], [west + 20, north], [west + 20, north - 15], [west, north - 15]]
    np.testing.assert_allclose(sheet.corners(), expected)
    np.testing.assert_allclose(block_outline(sheet), expected)


@pytest.mark.parametrize(
    ("count", "profile", "bands", "masked"),
    [
        (1, {}, (1,), False),
        (2, {"photometric": "MINISBLACK", "alpha": "YES"}, (1,), True),
        (3, {"photometric": "RGB"}, (1, 2, 3), False),
        (4, {"photometric": "RGB", "alpha": "YES"}, (1, 2, 3), True),
        (1, {"nodata": 0}, (1,), True),
    ],
)
def test_bands_and_mask__truth(tmp_path, count, profile, bands, masked):
    values = np.full((count, 20, 20), 90, np.uint8)
    sheet = open_sheet(
        write_raster(tmp_path / "a.tif", values, place(1.0), **profile), BLOCK, "ortho"
    )
    assert (sheet.bands, sheet.masked, sheet.white) == (bands, masked, 255.0)


def test_white_of_more_than_8_bits_is_a_high_value_of_the_sheet__truth(tmp_path):
    values = np.linspace(0, 4000, 90_000).reshape(300, 300).astype(np.uint16)
    sheet = open_sheet(write_raster(tmp_path / "a.tif", values, place(1.0)), BLOCK, "ortho")
    assert sheet.white == pytest.approx(0.995 * 4000, rel=0.01)


@pytest.mark.parametrize("fill", [0, 255])
def test_a_collar_is_found_where_it_is_and_nowhere_else__truth(tmp_path, fill):
    picture = smooth_picture(400, 400).astype(np.uint8)[0]
    rows, columns = np.mgrid[:400, :400]
    margin = columns + 0.2 * rows < 90
    picture[margin] = fill
    picture[200:230, 250:280] = fill
    sheet = open_sheet(write_raster(tmp_path / "c.tif", picture, place(0.5)), BLOCK, "ortho")
    assert sheet.collar is not None
    assert sheet.collar.value == fill
    shares = (np.arange(400) + 0.5) / 400
    found = sheet.collar.within(picture[None], (shares, shares), whole=True)
    assert found[margin].all()
    assert not found[columns + 0.2 * rows > 95].any()
    plain = smooth_picture(400, 400).astype(np.uint8)[0]
    path = write_raster(tmp_path / "p.tif", plain, place(0.5))
    assert open_sheet(path, BLOCK, "ortho").collar is None


def test_heights_are_metres_or_refused__truth(tmp_path):
    path = write_raster(tmp_path / "d.tif", np.full((9, 9), 250.0, np.float32), place(5.0))
    assert open_sheet(path, BLOCK, "DEM").collar is None

    with rasterio.open(path, "r+") as file:
        file.units = ("US survey foot",)
    with pytest.raises(ReferenceDataError, match="heights are not in metres"):
        open_sheet(path, BLOCK, "DEM")


@pytest.mark.parametrize(
    ("crs", "unit", "words"),
    [
        ("EPSG:2263", "", "map counts in US survey foot"),
        ("EPSG:2263+6360", "", "heights are not in metres"),
        ("EPSG:2263", "metre", ""),
        ("EPSG:2263+5703", "", ""),
    ],
)
def test_a_map_in_feet_says_the_unit_of_its_heights_or_is_refused__truth(
    tmp_path, crs, unit, words
):
    heights = np.full((9, 9), 328.084, np.float32)
    corner = Affine(15.0, 0, 980_000.0, 0, -15.0, 200_000.0)
    path = write_raster(tmp_path / "d.tif", heights, corner, crs=crs)
    with rasterio.open(path, "r+") as file:
        file.units = (unit,)
    with pytest.raises(ReferenceDataError, match=words) if words else nullcontext():
        open_sheet(path, Crs("EPSG:32618"), "DEM")


def test_a_colour_table_is_refused__truth(tmp_path):
    path = write_raster(tmp_path / "p.tif", np.ones((9, 9), np.uint8), place(5.0))

    with rasterio.open(path, "r+") as file:
        file.write_colormap(1, {0: (0, 0, 0), 1: (9, 200, 3)})
    with pytest.raises(ReferenceDataError, match="colour table"):
        open_sheet(path, BLOCK, "ortho")


def test_a_few_heights_between_nodata_are_found__truth(tmp_path):
    heights = np.full((1500, 1500), -9999, np.int16)
    path = write_raster(tmp_path / "e.tif", heights, place(1.0), nodata=-9999)
    with pytest.raises(ReferenceDataError, match="every pixel is nodata"):
        open_sheet(path, BLOCK, "DEM")
    heights[700, 701] = 300
    path = write_raster(tmp_path / "f.tif", heights, place(1.0), nodata=-9999)
    assert open_sheet(path, BLOCK, "DEM").masked


@pytest.mark.parametrize("top", [0, 700, 1933])
def test_strays_of_a_large_file_are_seen_without_reading_it_through__law(
    tmp_path, monkeypatch, top
):
    """A national DEM without overviews was read from end to end, for five hundred rows of it."""
    monkeypatch.setattr("core.raster.sheets.LOOKED_THROUGH_PX", 1000)
    monkeypatch.setattr("core.raster.sheets.EMPTY_SAMPLE_PX", 100)
    heights = np.full((2000, 2100), 250, np.int16)
    path = write_raster(tmp_path / "sound.tif", heights, place(1.0))
    assert not open_sheet(path, BLOCK, "DEM").strays
    heights[top : top + 110, 1200:1320] = -32768
    path = write_raster(tmp_path / "strays.tif", heights, place(1.0))
    assert open_sheet(path, BLOCK, "DEM").strays


def test_a_sheet_is_looked_at_once_while_it_does_not_change__law(tmp_path):
    path = write_raster(tmp_path / "a.tif", np.ones((30, 40), np.uint8), place(0.5))
    first = open_sheet(path, BLOCK, "ortho")
    assert open_sheet(path, BLOCK, "ortho") is first
    write_raster(path, np.ones((30, 50), np.uint8), place(0.5))
    assert open_sheet(path, BLOCK, "ortho").columns == 50
