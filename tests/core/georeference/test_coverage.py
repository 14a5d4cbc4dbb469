"""What is said of a reference that does not cover the block."""

import numpy as np
import pytest

from core.errors import ReferenceDataError
from core.georeference.coverage import check_coverage
from core.raster.dem import open_dem
from core.raster.ortho import open_ortho
from tests.core.raster_files import CRS, NORTH, WEST, place, write_raster


@pytest.fixture
def reference(tmp_path):
    heights = np.full((100, 100), 200, np.float32)
    dem = open_dem(write_raster(tmp_path / "dem.tif", heights, place(4.0)), CRS)
    picture = np.full((400, 400), 90, np.uint8)
    return dem, open_ortho([write_raster(tmp_path / "ortho.tif", picture, place(1.0))], CRS)


def test_full_coverage_is_no_news__truth(reference):
    assert check_coverage(*reference, (WEST + 20, NORTH - 380, WEST + 380, NORTH - 20)) == ()


def test_partial_coverage_is_a_doubt_with_its_share__truth(reference):
    doubts = check_coverage(*reference, (WEST + 200, NORTH - 400, WEST + 600, NORTH))
    assert [doubt.kind for doubt in doubts] == ["dem-coverage", "ortho-coverage"]
    assert "50 % of the block" in doubts[0].message
    assert doubts[0].evidence["share"] == pytest.approx(0.5, abs=0.02)


def test_no_overlap_is_an_error_that_names_both_places__truth(reference):
    with pytest.raises(ReferenceDataError) as caught:
        check_coverage(*reference, (WEST + 5000, NORTH - 400, WEST + 6000, NORTH))
    assert "covers 0 % of the block" in caught.value.cause
    assert "E 625000 to 626000" in caught.value.cause
    assert caught.value.file.endswith("dem.tif")


def test_a_dem_with_nodata_under_the_block_is_told__truth(tmp_path, reference):
    heights = np.full((100, 100), -9999, np.float32)
    heights[:5] = 200
    dem = open_dem(write_raster(tmp_path / "e.tif", heights, place(4.0), nodata=-9999), CRS)
    with pytest.raises(ReferenceDataError, match=r"nodata over 9[56] % of the block"):
        check_coverage(dem, reference[1], (WEST, NORTH - 400, WEST + 400, NORTH))
