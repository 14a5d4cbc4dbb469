"""The layers of the session file, read by GDAL."""

import math
import sqlite3
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pyogrio.raw
import pytest
import shapely
from pyproj import CRS

from core.adjustment.adjusted import AdjustmentReport, NewPoint
from core.block import Block
from core.errors import CrsError
from core.geometry.drawn_mask import DrawnMask
from core.mosaic.misfit import MisfitVectors
from core.mosaic.misfit_places import Misfit
from sessions.decisions import Recorded, Remark
from sessions.layers import write_layers
from sessions.remarks import Fault
from sessions.store import Store

ReportOf = Callable[[Block], AdjustmentReport]
FOOTPRINTS = {
    "A": shapely.box(-743_500, -1_043_500, -742_500, -1_042_500),
    "B": shapely.Polygon(
        [(-742_600, -1_043_500, 250), (-741_600, -1_043_500, 250), (-742_000, -1_042_500, 260)]
    ),
}


@pytest.fixture
def written(tmp_path: Path, block: Block, report_of: ReportOf) -> Path:
    path = tmp_path / "session.gpkg"
    file = Store.open(path)
    file.append("2026-01-01", "ada", [("Accept", "{}")])
    write_layers(file, block, report_of(block), FOOTPRINTS)
    file.close()
    return path


def read(path: Path, layer: str) -> tuple[dict[str, Any], np.ndarray, Mapping[str, np.ndarray]]:
    """Meta, geometries and attributes of a layer, as GDAL sees them."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        meta, _, geometry, fields = pyogrio.raw.read(path, layer=layer)
    shapes = shapely.from_wkb(geometry)
    return meta, shapes, dict(zip(meta["fields"], fields, strict=True))


def test_gdal_lists_every_layer_with_its_kind_and_no_other__oracle(written: Path) -> None:
    assert dict(map(tuple, pyogrio.list_layers(written))) == {
        "photos": "Point Z",
        "footprints": "Polygon",
        "points": "Point Z",
        "measurements": "Point Z",
        "points_from_photos": "Point Z",
        "residual_vectors": "LineString",
        "masks": "Polygon",
        "decisions": None,
        "misfit": "LineString",
        "faults": "Point",
    }


def test_new_points_have_a_layer_of_their_own__oracle(
    tmp_path: Path, block: Block, report_of: ReportOf
) -> None:
    place, sigma = np.array([500.0, 600.0, 310.0]), np.array([0.1, 0.2, 0.4])
    report = replace(report_of(block), new_points=(NewPoint("N001", place, sigma, 3, 0.7),))
    file = Store.open(tmp_path / "new.gpkg")
    write_layers(file, block, report, FOOTPRINTS)
    file.close()
    _, shapes, told = read(tmp_path / "new.gpkg", "points_from_photos")
    assert shapely.get_coordinates(shapes, include_z=True).tolist() == [place.tolist()]
    assert {name: value.tolist() for name, value in told.items()} == {
        "point_id": ["N001"], "X": [500.0], "Y": [600.0], "Z": [310.0], "sigma_X": [0.1],
        "sigma_Y": [0.2], "sigma_Z": [0.4], "rays": [3], "max_residual_px": [0.7],
    }  # fmt: skip


def test_layers_lie_in_the_blocks_crs__oracle(written: Path) -> None:
    for layer in ("photos", "footprints", "points", "measurements", "residual_vectors"):
        info = pyogrio.read_info(written, layer=layer)
        assert CRS(info["crs"]) == CRS("EPSG:5514")
        assert info["features"] > 0


def test_extent_in_the_contents_is_the_extent_of_the_features__oracle(written: Path) -> None:
    for layer in ("photos", "footprints", "points", "residual_vectors"):
        _, shapes, _ = read(written, layer)
        told = pyogrio.read_info(written, layer=layer)["total_bounds"]
        assert told == pytest.approx(shapely.total_bounds(shapes))


def test_photos_carry_orientation_and_sigmas_in_degrees__truth(written: Path, block: Block) -> None:
    meta, shapes, fields = read(written, "photos")
    assert meta["geometry_type"] == "Point Z"
    exterior = block.photos["A"].exterior
    assert shapely.get_coordinates(shapes, include_z=True)[0] == pytest.approx(exterior.centre)
    assert fields["kappa_deg"][0] == pytest.approx(math.degrees(1.5))
    assert fields["sigma_omega_deg"][0] == pytest.approx(math.degrees(1e-4))
    assert list(fields["control_used"]) == [2, 2]
    assert list(fields["tie_points"]) == [2, 2]
    assert bool(fields["oriented"][0]) is True


def test_footprints_are_valid_flat_polygons__oracle(written: Path) -> None:
    _, shapes, fields = read(written, "footprints")
    assert shapely.is_valid(shapes).all()
    assert not shapely.has_z(shapes).any()
    assert shapely.equals(shapes[0], FOOTPRINTS["A"])
    assert fields["area_m2"][0] == pytest.approx(1e6)


def test_points_tell_role_state_and_fit__truth(written: Path) -> None:
    _, _, fields = read(written, "points")
    assert list(fields["role"]) == ["control", "control", "check"]
    assert list(fields["status"]) == ["auto"] * 3
    assert list(fields["worst_residual_px"]) == [5.0] * 3
    assert list(fields["dZ"]) == pytest.approx([0.3, 0.3, -0.3])


def test_measurements_tell_what_the_adjustment_left_out__truth(written: Path) -> None:
    _, _, fields = read(written, "measurements")
    names = list(zip(fields["point_id"], fields["photo_id"], strict=True))
    left_out = names.index(("P2", "B"))
    assert fields["status"][left_out] == "unused"
    assert fields["reason"][left_out] == "residual of 9 sigma"
    assert len(names) == 6


def test_measurements_of_a_photo_that_takes_no_part_are_unused__law(
    tmp_path: Path, block: Block, report_of: ReportOf
) -> None:
    aside = block.with_photos({**block.photos, "A": replace(block.photos["A"], oriented=False)})
    file = Store.open(tmp_path / "session.gpkg")
    write_layers(file, aside, report_of(aside), FOOTPRINTS)
    file.close()
    _, _, fields = read(tmp_path / "session.gpkg", "measurements")
    assert {*fields["status"][fields["photo_id"] == "A"]} == {"unused"}


def test_residual_vectors_begin_at_the_point_and_are_drawn_to_scale__truth(
    written: Path, block: Block
) -> None:
    _, shapes, fields = read(written, "residual_vectors")
    assert len(shapes) == 5
    start = shapely.get_coordinates(shapes[0])[0]
    assert start == pytest.approx(block.surveyed["P1"].position[:2])
    # 5 px of 15 micrometres at (3000 - 250) m over 211.59 mm
    expected = 5 * 15e-6 * 2750 / 0.21159
    assert fields["residual_m"][0] == pytest.approx(expected, rel=0.03)
    assert shapely.length(shapes[0]) == pytest.approx(100 * fields["residual_m"][0])
    assert list(fields["residual_px"]) == [5.0] * 5


def test_writing_again_replaces_the_layers_and_leaves_the_decisions__law(
    written: Path, block: Block, report_of: ReportOf
) -> None:
    file = Store.open(written)
    fewer = replace(block, surveyed={"P1": block.surveyed["P1"]})
    write_layers(file, fewer, report_of(fewer), {})
    assert len(file.rows()) == 1
    file.close()
    assert pyogrio.read_info(written, layer="points")["features"] == 1
    assert pyogrio.read_info(written, layer="footprints")["features"] == 0
    connection = sqlite3.connect(written)
    assert connection.execute("PRAGMA foreign_key_check").fetchall() == []
    connection.close()


def test_a_file_that_gdal_has_edited_is_written_again__oracle(
    written: Path, block: Block, report_of: ReportOf
) -> None:
    """GDAL hangs feature counts and a spatial index on the tables, which only it can keep up."""
    _, _, geometry, _ = pyogrio.raw.read(written, layer="points")
    extra = np.array([shapely.to_wkb(shapely.Point(1, 2, 3))], object)
    pyogrio.raw.write(
        written,
        extra,
        [np.array(["X"], object)],
        ["point_id"],
        layer="points",
        append=True,
        driver="GPKG",
        geometry_type="Point Z",
        crs="EPSG:5514",
    )
    assert pyogrio.read_info(written, layer="points")["features"] == len(geometry) + 1
    connection = sqlite3.connect(written)
    connection.executescript(
        "CREATE VIRTUAL TABLE rtree_points_geom USING rtree(id, minx, maxx, miny, maxy);"
        "INSERT INTO gpkg_extensions VALUES"
        " ('points', 'geom', 'gpkg_rtree_index', 'http://example.org', 'write-only');"
        "CREATE TRIGGER rtree_points_geom_insert AFTER INSERT ON points"
        " WHEN NOT ST_IsEmpty(NEW.geom) BEGIN SELECT 1; END;"
    )
    connection.close()
    file = Store.open(written)
    write_layers(file, block, report_of(block), FOOTPRINTS)
    file.close()
    assert pyogrio.read_info(written, layer="points", force_feature_count=True)["features"] == 3


def test_layers_are_all_replaced_or_none__law(
    written: Path, block: Block, report_of: ReportOf
) -> None:
    file = Store.open(written)
    wrong = replace(block, crs="EPSG:99999999")
    with pytest.raises(CrsError, match="does not know the CRS"):
        write_layers(file, wrong, report_of(wrong), {})
    file.close()
    assert pyogrio.read_info(written, layer="footprints")["features"] == 2


def test_a_crs_without_a_code_is_kept__oracle(
    tmp_path: Path, block: Block, report_of: ReportOf
) -> None:
    proj = "+proj=tmerc +lat_0=0 +lon_0=25 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs"
    own = replace(block, crs=proj)
    file = Store.open(tmp_path / "session.gpkg")
    write_layers(file, own, report_of(own), {})
    file.close()
    found = pyogrio.read_info(tmp_path / "session.gpkg", layer="photos")["crs"]
    operation = CRS(found).coordinate_operation
    assert operation is not None
    assert [item.value for item in operation.params if item.name.startswith("Longitude")] == [25]


def test_an_unadjusted_block_has_layers_too__truth(
    tmp_path: Path, block: Block, report_of: ReportOf
) -> None:
    bare = replace(block, measurements={})
    report = replace(
        report_of(block), exterior_sigmas={}, residuals_px={}, checks=(), surveyed_positions={}
    )
    file = Store.open(tmp_path / "session.gpkg")
    write_layers(file, bare, report, FOOTPRINTS)
    file.close()
    _, _, fields = read(tmp_path / "session.gpkg", "points")
    assert list(fields["status"]) == ["unused"] * 3
    assert np.isnan(fields["dX"]).all()


def test_masks_are_polygons_on_the_ground_with_their_outline_in_pixels__oracle(
    tmp_path: Path, block: Block, report_of: ReportOf
) -> None:
    hidden = shapely.box(1000, 2000, 3000, 2500)
    photo = replace(block.photos["A"], mask=DrawnMask(hidden))
    masked = block.with_photos({**block.photos, "A": photo})
    file = Store.open(tmp_path / "session.gpkg")
    write_layers(file, masked, report_of(masked), FOOTPRINTS)
    file.close()
    _, shapes, fields = read(tmp_path / "session.gpkg", "masks")
    assert fields["photo_id"].tolist() == ["A"]
    assert fields["kind"].tolist() == ["hidden"]
    assert shapely.equals(shapely.from_wkt(fields["pixels"][0]), hidden)
    pixel_m = photo.ground_pixel_m(masked.camera_of("A"))
    assert shapes[0].area == pytest.approx(hidden.area * pixel_m**2, rel=0.05)


def test_misfit_vectors_are_drawn_longer__law(
    tmp_path: Path, block: Block, report_of: ReportOf
) -> None:
    vectors = MisfitVectors(
        np.array([[100.0, 200.0]]),
        np.array([[0.5, -1.0]]),
        0.4**2 * np.eye(2)[None],
        np.array([0.9]),
        ("a",),
        np.eye(2)[None],
        np.zeros((1, 2, 6)),
        0.5,
        60.0,
        1,
    )
    path = tmp_path / "session.gpkg"
    file = Store.open(path)
    write_layers(file, block, report_of(block), FOOTPRINTS, Misfit(vectors, None, (), 0))
    file.close()
    _, shapes, fields = read(path, "misfit")
    assert shapely.get_coordinates(shapes[0]).tolist() == [[100, 200], [110, 180]]
    assert fields["probability"].tolist() == [0.9]


def test_faults_are_points_with_what_was_answered__oracle(
    tmp_path: Path, block: Block, report_of: ReportOf
) -> None:
    path = tmp_path / "faults.gpkg"
    said = Remark("place", "", "too dark", (1.0, 2.0), "tone", "ada")
    answer = Remark("decision", "3", "balanced", closes=True)
    when = "2026-01-01T10:00"
    fault = Fault(
        Recorded(3, when, "bob", said), said, ((Recorded(4, when, "ada", answer), answer),)
    )
    file = Store.open(path)
    write_layers(file, block, report_of(block), FOOTPRINTS, None, (fault,))
    file.close()
    _, shapes, fields = read(path, "faults")
    assert shapes[0].coords[0] == (1.0, 2.0)
    assert (fields["fault"][0], fields["answers"][0]) == ("tone", "ada: balanced")
    assert not fields["is_open"][0]
