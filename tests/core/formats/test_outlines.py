"""Footprints of any vector file, matched to scans by name."""

from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely
from shapely.geometry import MultiPolygon, Polygon, box

from core.errors import ProjectError
from core.formats.outlines import Footprint, read_footprints
from tests.core.raster_files import write_footprints


@pytest.mark.parametrize("ending", ["gpkg", "shp", "geojson"])
def test_written_and_read_in_any_format__law(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"f.{ending}"
    squares = {f"LMSA08.1938.HUST25.0085{i}.tif": box(i, 0, i + 2.5, 2.5) for i in range(3)}
    write_footprints(path, squares, "LMS_TIF_UP", "EPSG:32633")
    found = read_footprints(path, "LMS_TIF_UP", ["LMSA08.1938.HUST25.00851", "unknown"])
    assert list(found.by_photo) == ["LMSA08.1938.HUST25.00851"]
    assert found.by_photo["LMSA08.1938.HUST25.00851"].polygon.equals(box(1, 0, 3.5, 2.5))
    assert found.crs == ("EPSG:32633" if ending != "geojson" else found.crs)


@pytest.mark.parametrize(
    "written", ["a.b.001.tif", "A.B.001.TIF", "a.b.001", "x/y/a.b.001.jp2", "C:\\x\\A.b.001.tif"]
)
def test_names_match_however_they_are_written__truth(tmp_path: Path, written: str) -> None:
    write_footprints(tmp_path / "f.gpkg", {written: box(0, 0, 1, 1)}, "Name", "EPSG:5514")
    assert "a.B.001" in read_footprints(tmp_path / "f.gpkg", "name", ["a.B.001"]).by_photo


def test_largest_part_of_a_multipolygon__truth(tmp_path: Path) -> None:
    parts = MultiPolygon([box(0, 0, 1, 1), box(5, 5, 9, 9)])
    pyogrio.raw.write(
        tmp_path / "f.gpkg", geometry=shapely.to_wkb([parts]), fields=["n"],
        field_data=[np.array(["a"], dtype=object)], geometry_type="MultiPolygon", crs="EPSG:5514",
    )  # fmt: skip
    found = read_footprints(tmp_path / "f.gpkg", "n", ["a"])
    assert found.by_photo["a"].polygon.equals(box(5, 5, 9, 9))


def test_corners_are_the_rectangle__truth() -> None:
    turn = np.radians(30)
    turned = np.array([[0, 0], [3, 0], [3, 2], [0, 2]]) @ np.array(
        [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
    )
    corners = Footprint(Path("f"), "a", Polygon(turned)).corners
    assert (
        shapely.Polygon(corners).equals_exact(Polygon(turned), 1e-9)
        or shapely.Polygon(corners).symmetric_difference(Polygon(turned)).area < 1e-9
    )
    assert shapely.Polygon(corners).exterior.is_ccw


def test_unusable_footprints_say_why__truth(tmp_path: Path) -> None:
    with pytest.raises(ProjectError, match="missing"):
        read_footprints(tmp_path / "none.gpkg", "n", ["a"])
    (tmp_path / "text.gpkg").write_text("nothing")
    with pytest.raises(ProjectError, match="not a vector file"):
        read_footprints(tmp_path / "text.gpkg", "n", ["a"])
    write_footprints(tmp_path / "f.gpkg", {"a": box(0, 0, 1, 1)}, "NAME", "EPSG:5514")
    with pytest.raises(ProjectError, match=r"no attribute 'LMS_TIF_UP', only NAME.*footprint_name"):
        read_footprints(tmp_path / "f.gpkg", "LMS_TIF_UP", ["a"])


def test_a_name_that_is_no_text_is_told_as_a_spoilt_file__truth(tmp_path: Path) -> None:
    path = tmp_path / "f.gpkg"
    write_footprints(path, {"scan-name": box(0, 0, 900, 900)}, "NAME", "EPSG:5514")
    path.write_bytes(path.read_bytes().replace(b"scan-name", b"scan\xf4(ame"))
    with pytest.raises(ProjectError, match="not a vector file"):
        read_footprints(path, "NAME", ["scan-name"])
