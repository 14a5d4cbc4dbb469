"""Vector files: formats, layers, encodings, CRS, attributes, and what is said of bad ones."""

import numpy as np
import pyogrio.raw
import pytest
import shapely
from pyproj import CRS

from core.errors import CrsError, ReferenceDataError
from core.formats.roads import read_roads
from core.formats.vectors import read_mask_polygons

BLOCK = "EPSG:5514"
EAST, NORTH = -576_000.0, -1_195_000.0
LINES = [
    shapely.LineString([(EAST, NORTH), (EAST + 100, NORTH)]),
    shapely.LineString([(EAST + 50, NORTH - 50, 200), (EAST + 50, NORTH + 50, 210)]),
    shapely.MultiLineString(
        [[(EAST, NORTH + 9), (EAST + 9, NORTH + 9)], [(EAST, NORTH + 20), (EAST + 9, NORTH + 20)]]
    ),
]


def write_layer(path, geometries, fields=None, crs=BLOCK, layer=None, encoding=None, driver=None):
    fields = fields or {}
    kinds = {g.geom_type for g in geometries if g is not None}
    kind = kinds.pop() if len(kinds) == 1 else "Unknown"
    pyogrio.raw.write(
        path, np.array(shapely.to_wkb(geometries), dtype=object),
        field_data=[np.array(values, dtype=object) for values in fields.values()],
        fields=list(fields), crs=crs or BLOCK, layer=layer, encoding=encoding, driver=driver,
        geometry_type=kind,
    )  # fmt: skip
    if crs is None:
        path.with_suffix(".prj").unlink()
    return path


@pytest.mark.parametrize("suffix", ["gpkg", "geojson", "fgb", "gml", "shp"])
def test_any_format_gives_the_same_flat_lines__law(tmp_path, suffix):
    crs = BLOCK
    lines = LINES if suffix == "gpkg" else [shapely.force_2d(line) for line in LINES[:2]]
    path = write_layer(tmp_path / f"r.{suffix}", lines, {"TYP": ["a", "b", "c"][: len(lines)]}, crs)
    roads = read_roads(path, BLOCK)
    assert len(roads) == len(lines) + (suffix == "gpkg")
    assert not shapely.has_z(roads.lines).any()
    np.testing.assert_allclose(
        shapely.get_coordinates(roads.lines[:2]),
        shapely.get_coordinates(shapely.force_2d(np.array(LINES[:2]))),
        atol=2e-3 if suffix == "geojson" else 1e-6,
    )
    assert roads.kind[0] == "a"


def test_layers_are_joined_or_chosen__truth(tmp_path):
    path = tmp_path / "r.gpkg"
    write_layer(path, LINES[:1], layer="SilniceDalnice")
    write_layer(path, [shapely.force_2d(LINES[1])], layer="Cesta")
    both = read_roads([path], BLOCK)
    assert sorted(both.layer) == ["Cesta", "SilniceDalnice"]
    assert list(read_roads(f"{path}|layername=Cesta", BLOCK).layer) == ["Cesta"]
    with pytest.raises(ReferenceDataError, match="no layer"):
        read_roads(f"{path}|layername=Ulice", BLOCK)


def test_windows_1250_is_read_with_and_without_cpg__truth(tmp_path):
    path = write_layer(
        tmp_path / "r.shp", [shapely.force_2d(LINES[0])], {"NAZEV": ["Příčná"]}, encoding="CP1250"
    )
    assert read_roads(path, BLOCK).name[0] == "Příčná"
    (tmp_path / "r.cpg").unlink()
    table = bytearray((tmp_path / "r.dbf").read_bytes())
    table[29] = 0  # no language stated, as old exports have it
    (tmp_path / "r.dbf").write_bytes(table)
    assert read_roads(path, BLOCK).name[0] == "Příčná"


def test_attributes_of_osm_are_understood__truth(tmp_path):
    fields = {
        "highway": ["primary", "track", "path", "service"],
        "bridge": ["yes", None, "no", None],
        "layer": [None, "-2", "0", None],
        "tunnel": [None, None, None, "yes"],
        "width": ["7,5 m", "3", "wide", None],
    }
    lines = [shapely.LineString([(EAST, NORTH + i), (EAST + 9, NORTH + i)]) for i in range(4)]
    roads = read_roads(write_layer(tmp_path / "o.gpkg", lines, fields), BLOCK)
    assert list(roads.kind) == ["primary", "track", "path", "service"]
    np.testing.assert_array_equal(roads.level, [1, -2, 0, -1])
    np.testing.assert_array_equal(roads.width_m, [7.5, 3, np.nan, np.nan])


def test_another_crs_is_transformed_and_bounds_hold__truth(tmp_path):
    degrees = [shapely.LineString([(16.95, 48.92), (16.96, 48.92)])]
    far = [shapely.LineString([(14.0, 50.0), (14.1, 50.0)])]
    path = write_layer(tmp_path / "w.geojson", degrees + far, crs="EPSG:4326")
    roads = read_roads(path, BLOCK)
    assert len(roads) == 2
    (east, north) = shapely.get_coordinates(roads.lines[:1])[0]
    assert abs(east + 574_000) < 4000
    assert abs(north + 1_196_000) < 4000
    near = read_roads(path, BLOCK, (east - 500, north - 500, east + 500, north + 500))
    assert len(near) == 1


def test_a_missing_crs_is_inferred_or_refused__truth(tmp_path):
    flat = [shapely.force_2d(LINES[0])]
    assert len(read_roads(write_layer(tmp_path / "n.shp", flat, crs=None), BLOCK)) == 1
    swapped = [shapely.LineString([(NORTH, EAST), (NORTH + 9, EAST)])]
    with pytest.raises(CrsError, match="swapped"):
        read_roads(write_layer(tmp_path / "s.shp", swapped, crs=None), BLOCK)
    positive = [shapely.LineString([(-EAST, -NORTH), (9 - EAST, -NORTH)])]
    with pytest.raises(CrsError, match="positive"):
        read_roads(write_layer(tmp_path / "p.shp", positive), BLOCK)
    nowhere = [shapely.LineString([(1, 2), (9000, 9000)])]
    with pytest.raises(CrsError, match="names no CRS"):
        read_roads(write_layer(tmp_path / "x.shp", nowhere, crs=None), BLOCK)


def test_an_empty_layer_is_a_notice__truth(tmp_path):
    path = tmp_path / "e.gpkg"
    write_layer(path, [shapely.LineString([(0, 0), (1, 1)])], layer="leer")
    pyogrio.raw.write(
        path, np.array([], dtype=object), [], [], geometry_type="LineString", crs=BLOCK,
        layer="empty",
    )  # fmt: skip
    roads = read_roads(f"{path}|layername=empty", BLOCK)
    assert len(roads) == 0
    (note,) = roads.notes
    assert note.kind == "roads-empty"
    assert "salient" in note.message
    points = write_layer(tmp_path / "p.gpkg", [shapely.Point(EAST, NORTH)])
    assert "no lines" in read_roads(points, BLOCK).notes[0].message
    assert len(read_roads([], BLOCK)) == 0


def test_unusable_files_are_told__truth(tmp_path):
    with pytest.raises(ReferenceDataError, match="is not there"):
        read_roads(tmp_path / "missing.shp", BLOCK)
    (tmp_path / "text.gpkg").write_text("nothing")
    with pytest.raises(ReferenceDataError, match="cannot be read as vector data"):
        read_roads(tmp_path / "text.gpkg", BLOCK)
    path = write_layer(tmp_path / "cut.shp", [shapely.force_2d(LINES[0])] * 50)
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(ReferenceDataError, match=r"cut\.shp"):
        read_roads(path, BLOCK)


def test_missing_and_empty_geometries_are_left_out__truth(tmp_path):
    lines = [shapely.force_2d(LINES[0]), None, shapely.LineString()]
    roads = read_roads(write_layer(tmp_path / "m.gpkg", lines, {"TYP": ["a", "b", "c"]}), BLOCK)
    assert list(roads.kind) == ["a"]


def test_masks_are_one_area__truth(tmp_path):
    square = shapely.box(EAST, NORTH, EAST + 10, NORTH + 10)
    other = shapely.box(EAST + 5, NORTH, EAST + 15, NORTH + 10)
    path = write_layer(
        tmp_path / "m.gpkg", [shapely.MultiPolygon([square]), shapely.MultiPolygon([other])]
    )
    area = read_mask_polygons(path, CRS(BLOCK))
    assert area.area == pytest.approx(150)
    lines = write_layer(tmp_path / "l.gpkg", LINES[:1])
    assert read_mask_polygons([lines], CRS(BLOCK)).is_empty
