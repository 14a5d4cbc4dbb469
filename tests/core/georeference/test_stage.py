"""Photos placed by what the archive says, and by another source where that is missing."""

from dataclasses import replace

import numpy as np
import pytest
import rasterio

from core.errors import CrsError, OrientationError, ReferenceDataError
from core.formats.world_file import read_world_file, write_world_file
from core.georeference.stage import check_coverage
from core.raster.dem import open_dem
from core.raster.ortho import open_ortho
from tests.core.georeference.placing import georeference
from tests.core.raster_files import CRS, NORTH, WEST, place, write_raster


def test_photos_lie_where_their_world_files_put_them__truth(tiny, placed):
    """Good ones are five to ten metres off, and know nothing of tilts."""
    for name, photo in placed.block.photos.items():
        away = photo.exterior.centre - tiny.truth.photos[name].exterior.centre
        above = photo.exterior.centre[2] - photo.ground_height_m
        assert np.hypot(*away[:2]) < 12 + above * np.radians(3.0)
        assert not photo.oriented
        assert photo.approximate is photo.exterior
        assert photo.ground_height_m == pytest.approx(tiny.reference.dem.mean_height(), abs=15.0)


def bare(scans, folder):
    """The scans in a folder of their own, without the world files beside them."""
    found = {}
    for name, scan in scans.oriented.items():
        path = folder / scan.scan.path.name
        path.symlink_to(scan.scan.path)
        found[name] = replace(scan, scan=replace(scan.scan, path=path))
    return replace(scans, oriented=found)


def test_without_any_source_there_is_nothing_to_begin_with__truth(given, scan_set, tmp_path):
    nowhere = replace(given, georeference=replace(given.georeference, footprints=None))
    with pytest.raises(OrientationError) as told:
        georeference(nowhere, bare(scan_set, tmp_path))
    assert "world file" in told.value.remedy


def test_another_source_stands_in_with_a_doubt__truth(given, scan_set, tmp_path):
    found = georeference(given, bare(scan_set, tmp_path))
    said = [d.message for d in found.doubts if d.kind == "georeference-missing"]
    assert (
        said
        == ["There is no world file for this scan; it was placed by its footprint instead."] * 6
    )


def test_points_in_map_units_place_a_scan_with_a_world_file__truth(
    given, scan_set, placed, tmp_path
):
    """QGIS counts so where a scan has one; here every point lies where the world file has it."""
    scans = bare(scan_set, tmp_path)
    for scan in scans.oriented.values():
        path = scan.scan.path
        world = read_world_file(path.resolve().with_suffix(".tfw"))
        write_world_file(path.with_suffix(".tfw"), world.object_from_pixel)
        pixels = np.array([[10, 20, 1], [900, 30, 1], [800, 850, 1]])
        rows = [",".join(map(str, [*at, *at, 1])) for at in pixels @ world.object_from_pixel.T]
        text = "\n".join(["mapX,mapY,sourceX,sourceY,enable", *rows])
        path.with_name(path.name + ".points").write_text(text)
    found = georeference(given, scans)
    for name, photo in placed.block.photos.items():
        away = found.block.photos[name].exterior.centre - photo.exterior.centre
        assert np.abs(away).max() < 10


def test_a_map_far_from_scale_one_is_refused__truth(given, scan_set):
    alone = replace(given.reference, crs="EPSG:6933", ortho=(), dem=(), level_m=250.0)
    far = replace(given, reference=alone)
    with pytest.raises(CrsError, match="draws a metre of ground as"):
        georeference(far, scan_set)


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


def test_holes_of_the_dem_under_the_photos_are_told_with_size_and_place__truth(
    given, scan_set, placed, tmp_path
):
    with rasterio.open(given.reference.dem[0]) as file:
        heights, profile = file.read(1), file.profile
    assert "dem-holes" not in [doubt.kind for doubt in placed.doubts]
    west, south, east, north = placed.block.bounds
    column, row = map(int, ~profile["transform"] @ ((west + east) / 2, (south + north) / 2))
    heights[row : row + 20, column : column + 30] = -9999
    holed = tmp_path / "holed.tif"
    with rasterio.open(holed, "w", **(profile | {"nodata": -9999})) as file:
        file.write(heights, 1)
    files = replace(given.reference, dem=(holed,))
    found = georeference(replace(given, reference=files), scan_set)
    (doubt,) = (doubt for doubt in found.doubts if doubt.kind == "dem-holes")
    assert doubt.subject == str(holed)
    ((at_east, at_north, area),) = doubt.evidence["holes"]
    assert area == 20 * 30 * profile["transform"].a ** 2
    middle = profile["transform"] @ (column + 15, row + 10)
    assert (at_east, at_north) == pytest.approx(middle)
    told = "holed.tif has no heights in 1 place under the photos, 15\u202f000 m² together"
    assert told in str(doubt.message)
    there = f"about E {at_east:.0f} N {at_north:.0f}".replace("-", "\N{MINUS SIGN}")
    assert there in str(doubt.message)
    heights[heights == -9999] = 0
    with rasterio.open(holed, "w", **(profile | {"nodata": None})) as file:
        file.write(heights, 1)
    found = georeference(replace(given, reference=files), scan_set)
    (doubt,) = (doubt for doubt in found.doubts if doubt.kind == "dem-noughts")
    assert doubt.evidence["holes"][0] == pytest.approx((*middle, area))
