"""GeoJSON with the thesis's attributes: its printed table, GDAL, round trips, broken layers."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pytest
import shapely
from hypothesis import given, settings
from pyogrio import raw

from core.errors import ProjectError
from core.formats.exchange import ExchangeBlock
from core.formats.geojson import read_geojson, write_geojson
from core.formats.outlines import ground_outline, off_nadir, read_footprints, write_footprints
from core.geometry.exterior import ExteriorOrientation
from tests.exchanged import (
    RECIPES,
    Recipe,
    assert_same_measurements,
    assert_same_points,
    block_of,
)

THESIS = (
    (659, 197, 0.47, -707199.61, -1032405.86, 2111.001, 3410.003, 9, 0),
    (1343, 191, 0.663, -708107.69, -1031988.29, 1228.595, 2991.197, 85, 0),
    (1255, 194, 0.544, -707875.17, -1031827.11, 1460.801, 2845.6, 57, 0.51),
)
"""Rows of figure 27: cross_id, Z, quality, X_ref, Y_ref, x_col, y_row, id, RAN_dist_pix."""
HEADS = ("cross_id", "Z", "quality", "X_ref", "Y_ref", "x_col", "y_row", "id", "RAN_dist_pix")


def layer(rows: list[dict[str, Any]], crs: str = "urn:ogc:def:crs:EPSG::5514") -> str:
    features = [{"type": "Feature", "properties": row, "geometry": None} for row in rows]
    return json.dumps(
        {"type": "FeatureCollection", "crs": {"type": "name", "properties": {"name": crs}},
         "features": features}
    )  # fmt: skip


def thesis_rows() -> list[dict[str, Any]]:
    return [dict(zip(HEADS, row, strict=True)) for row in THESIS]


def test_the_table_of_the_thesis_is_read__paper(tmp_path: Path) -> None:
    (tmp_path / "1938_12.geojson").write_text(layer(thesis_rows()))
    block = read_geojson(tmp_path)
    assert block.crs == "EPSG:5514"
    assert set(block.points) == {"659", "1343", "1255"}
    assert block.points["1343"].position == (-708107.69, -1031988.29, 191)
    first = block.measurements[0]
    # Its pixels come from rows and columns of rasterio: centres of pixels.
    assert (first.photo_id, first.column, first.row) == ("1938_12", 2111.501, 3410.503)


def test_pixels_of_a_resampled_copy_are_not_those_of_the_scan__paper(tmp_path: Path) -> None:
    (tmp_path / "1m_1938_12.geojson").write_text(layer(thesis_rows()))
    block = read_geojson(tmp_path)
    assert set(block.photos) == {"1938_12"}
    assert len(block.points) == 3
    assert not block.measurements
    assert "resampled copy" in block.notes[0]


def test_the_better_of_two_candidates_stands__truth(tmp_path: Path) -> None:
    rows = [*thesis_rows(), {**thesis_rows()[0], "quality": 0.9, "x_col": 7.0}]
    (tmp_path / "a.geojson").write_text(layer(rows))
    block = read_geojson(tmp_path)
    assert next(m.column for m in block.measurements if m.point_id == "659") == 7.5
    assert "1 candidate of lower quality" in block.notes[0]


@settings(max_examples=12)
@given(RECIPES)
def test_points_and_orientations_come_back__law(
    tmp_path_factory: pytest.TempPathFactory, recipe: Recipe
) -> None:
    block = block_of(recipe)
    folder = tmp_path_factory.mktemp("geojson")
    write_geojson(folder, block)
    again = read_geojson(folder)
    assert again.crs == block.crs
    assert_same_points(block, again)
    assert_same_measurements(block, again)
    for name, point in block.points.items():
        assert (again.points[name].sigma_m, again.points[name].role) == (point.sigma_m, point.role)
    for one, same in zip(
        sorted(again.measurements, key=str), sorted(block.measurements, key=str), strict=True
    ):
        assert one.sigma_px == pytest.approx(same.sigma_px)
    for name, photo in block.photos.items():
        other = again.photos[name]
        assert (other.file, other.camera) == (photo.file, photo.camera)
        np.testing.assert_array_equal(other.orientation.centre, photo.orientation.centre)
        turned = other.orientation.object_from_image - photo.orientation.object_from_image
        assert np.abs(turned).max() < 1e-12
        assert other.sigma_centre_m == photo.sigma_centre_m
        assert other.sigma_angles == pytest.approx(photo.sigma_angles)


def test_gdal_reads_layers_footprints_and_their_crs__oracle(tmp_path: Path) -> None:
    block = block_of((5, 3, 0, False))
    write_geojson(tmp_path, block)
    meta, _, geometry, _ = raw.read(tmp_path / "photos.geojson")
    assert meta["crs"] == "EPSG:5514"
    areas = shapely.area(shapely.from_wkb(geometry))
    assert len(areas) == 3
    # 9000 x 8800 px at about 3 km over 9000 px.
    assert (np.abs(areas - 3000 * 2933) < 0.35 * 3000 * 2933).all()
    info = pyogrio.read_info(tmp_path / f"{next(iter(block.photos))}.geojson")
    assert set(HEADS) <= set(info["fields"].tolist())


@pytest.mark.parametrize("ending", ["gpkg", "geojson", "fgb", "shp"])
def test_footprints_are_read_by_our_own_reader__truth(tmp_path: Path, ending: str) -> None:
    block = block_of((6, 2, 0, False))
    path = tmp_path / f"f.{ending}"
    assert write_footprints(path, block) == ()
    found = read_footprints(path, "LMS_TIF_UP", list(block.photos))
    assert set(found.by_photo) == set(block.photos)
    for name, one in found.by_photo.items():
        expected = shapely.Polygon(ground_outline(block, block.photos[name]))
        assert one.polygon.symmetric_difference(expected).area < 1


def test_footprints_need_ground_and_a_known_ending__truth(tmp_path: Path) -> None:
    block = block_of((6, 1, 0, False))
    with pytest.raises(ProjectError, match="No photo has a footprint"):
        write_footprints(tmp_path / "a.gpkg", replace(block, points={}, ties=block.ties))
    with pytest.raises(ProjectError, match="No vector format"):
        write_footprints(tmp_path / "a.xyz", block)


def test_a_photo_that_sees_the_horizon_has_no_footprint__truth(tmp_path: Path) -> None:
    block = block_of((6, 1, 0, False))
    name, photo = next(iter(block.photos.items()))
    steep = replace(photo, exterior=ExteriorOrientation(photo.orientation.centre, 1.3, 0.0, 0.0))
    assert off_nadir(steep) == pytest.approx(np.degrees(1.3))
    oblique = replace(block, photos={name: steep})
    assert ground_outline(oblique, steep) is None
    assert "1 photo has no footprint" in write_geojson(tmp_path, oblique)[0]
    assert "no footprint" in write_geojson(tmp_path, replace(oblique, measurements=()))[0]


ROW = thesis_rows()[0]


@pytest.mark.parametrize(
    ("text", "words"),
    [("{", "is no JSON"), ("[]", "is no GeoJSON layer"),
     (layer([{**ROW, "x_col": None}]), "Feature 1 has no x_col"),
     (layer([{"a": 1}]), "Feature 1 has no cross_id"),
     (layer([{**ROW, "Z": "high"}]), "Z is 'high', not 1 number"),
     (layer([{**ROW, "Y_ref": float("nan")}]), "Y_ref is 'nan', not 1 number"),
     (layer([{"LMS_TIF_UP": "a.tif"}, {"LMS_TIF_UP": "a.tif"}]), "the scan a stands twice"),
     (layer([{"LMS_TIF_UP": ""}]), "names no scan"),
     (layer([ROW, {**ROW, "X_ref": 1.0}]), "lies elsewhere than in another layer")],
)  # fmt: skip
def test_broken_layers_are_named__truth(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "a.geojson").write_text(text)
    with pytest.raises(ProjectError, match=words):
        read_geojson(tmp_path)


def test_layers_in_two_crs_are_refused__truth(tmp_path: Path) -> None:
    (tmp_path / "a.geojson").write_text(layer(thesis_rows()))
    (tmp_path / "b.geojson").write_text(layer(thesis_rows(), "urn:ogc:def:crs:EPSG::32633"))
    with pytest.raises(ProjectError, match="EPSG:32633, other layers are in EPSG:5514"):
        read_geojson(tmp_path)
    with pytest.raises(ProjectError, match="holds no GeoJSON"):
        write_and_read_nothing(tmp_path)


def write_and_read_nothing(folder: Path) -> ExchangeBlock:
    (folder / "empty").mkdir()
    return read_geojson(folder / "empty")
