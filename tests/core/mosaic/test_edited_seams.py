"""Seams edited in a GIS are obeyed; what is broken in them is mended and told, or refused."""

import numpy as np
import pyogrio.raw
import pytest
import shapely
from pyproj import Transformer

from core.errors import ReferenceDataError
from core.mosaic.edited_seams import EditedSeams, fill_gaps, read_edited
from core.mosaic.seams import Seam
from tests.core.mosaic.conftest import CRS

WEST, SOUTH = 500_000.0, 4_100_000.0
NAMES = ("a", "b")


def box(west, south, east, north):
    return shapely.box(WEST + west, SOUTH + south, WEST + east, SOUTH + north)


def written(path, scans, areas, crs=CRS, layer="seams", column="scan"):
    pyogrio.raw.write(
        path,
        geometry=shapely.to_wkb(np.array(areas, dtype=object)),
        field_data=[np.array(scans, dtype=object)],
        fields=[column],
        geometry_type="Polygon",
        crs=crs,
        driver="GPKG",
        layer=layer,
    )
    return path


def test_edited_seams_are_read_as_drawn__law(tmp_path):
    path = written(tmp_path / "seams.gpkg", ["b", "a"], [box(50, 0, 100, 80), box(0, 0, 50, 80)])
    found = read_edited(path, CRS, NAMES)
    assert [seam.photo_id for seam in found.seams] == ["b", "a"]
    assert found.seams[0].area.equals(box(50, 0, 100, 80))
    assert found.notes == ()


def test_the_later_of_two_overlapping_seams_holds_and_is_told__truth(tmp_path):
    path = written(tmp_path / "seams.gpkg", ["a", "b"], [box(0, 0, 60, 80), box(40, 0, 100, 80)])
    found = read_edited(path, CRS, NAMES)
    assert [seam.area.area for seam in found.seams] == [40 * 80, 60 * 80]
    assert found.notes == (
        "Edited seams overlapped over 1600 m²; the later one in the file holds.",
    )


def test_gaps_are_filled_and_told__truth(tmp_path):
    path = written(tmp_path / "seams.gpkg", ["a"], [box(0, 0, 40, 80)])
    drawn = (Seam("a", "1938", box(0, 0, 50, 80)), Seam("b", "1938", box(50, 0, 100, 80)))
    filled = fill_gaps(read_edited(path, CRS, NAMES), drawn)
    assert {seam.photo_id: seam.area.area for seam in filled.seams} == {"a": 4000, "b": 4000}
    assert "4800 m² open" in filled.notes[0]
    assert fill_gaps(EditedSeams(drawn, ()), drawn).notes == ()


def test_scans_without_an_ortho_are_left_out_and_told__truth(tmp_path):
    path = written(tmp_path / "seams.gpkg", ["a", "x"], [box(0, 0, 50, 80), box(50, 0, 100, 80)])
    found = read_edited(path, CRS, NAMES)
    assert [seam.photo_id for seam in found.seams] == ["a"]
    assert found.notes == ("Edited seams of scans without an ortho were left out: x.",)


def test_a_crossed_polygon_is_mended_and_told__truth(tmp_path):
    corners = np.array([(0, 0), (10, 10), (10, 0), (0, 10)])
    bow = shapely.Polygon(np.add(corners, (WEST, SOUTH)))
    found = read_edited(written(tmp_path / "seams.gpkg", ["a"], [bow]), CRS, NAMES)
    assert found.seams[0].area.is_valid
    assert found.seams[0].area.area == pytest.approx(50)
    assert found.notes == ("1 edited seam was not valid and mended.",)


def test_seams_in_another_system_are_transformed_and_told__oracle(tmp_path):
    area = box(0, 0, 400, 300)
    there = shapely.transform(area, _to_degrees)
    found = read_edited(written(tmp_path / "s.gpkg", ["a"], [there], "EPSG:4326"), CRS, NAMES)
    assert found.seams[0].area.symmetric_difference(area).area < 0.01
    assert found.notes == ("Edited seams were transformed from EPSG:4326.",)


def _to_degrees(points):
    transformer = Transformer.from_crs(CRS, "EPSG:4326", always_xy=True)
    return np.column_stack(transformer.transform(points[:, 0], points[:, 1]))


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"column": "photo"}, 'no attribute "scan". It has photo'),
        ({"scans": ["x"]}, "no polygon of it belongs to a photo of the block"),
        ({"scans": [], "areas": []}, "has no polygons"),
    ],
)
def test_seams_that_cannot_be_used_are_refused__truth(tmp_path, how, said):
    given = {"scans": ["a"], "areas": [box(0, 0, 50, 80)]} | how
    path = written(tmp_path / "seams.gpkg", **given)
    with pytest.raises(ReferenceDataError) as refused:
        read_edited(path, CRS, NAMES)
    assert said in str(refused.value)
    assert str(path) in str(refused.value)


def test_a_damaged_file_is_refused__truth(tmp_path):
    path = tmp_path / "seams.gpkg"
    path.write_bytes(b"SQLite format 3\0 cut off")
    with pytest.raises(ReferenceDataError, match="delete or rename the file"):
        read_edited(path, CRS, NAMES)
