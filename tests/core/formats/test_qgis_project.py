"""A QGIS project: its layers are found from its folder, in the structure that QGIS writes."""

from pathlib import Path
from xml.etree import ElementTree

import pyogrio
from pyogrio import raw
from shapely import Point

from core.formats.qgis_project import ProjectLayer, Style, session_layers, write_qgis_project


def project(path: Path) -> ElementTree.Element:
    layers = (
        *session_layers("session.gpkg"),
        ProjectLayer("mosaic", "results/mosaic.tif", "raster", bands=3, shown=False),
        ProjectLayer("own", "own.gpkg|layername=own", "point", Style("#ff8000", 4.0, "cross")),
    )
    write_qgis_project(path, "Block", "EPSG:5514", layers, (0.0, 1.0, 2.0, 3.0))
    return ElementTree.parse(path).getroot()


def test_each_layer_stands_in_tree_order_and_map__truth(tmp_path: Path) -> None:
    root = project(tmp_path / "block.qgs")
    leaves = root.findall("layer-tree-group/layer-tree-layer")
    assert [leaf.get("name") for leaf in leaves] == [
        "points",
        "residual_vectors",
        "photos",
        "measurements",
        "footprints",
        "masks",
        "mosaic",
        "own",
    ]
    held = {one.findtext("id"): one for one in root.findall("projectlayers/maplayer")}
    assert [leaf.get("id") for leaf in leaves] == list(held)
    assert [one.get("id") for one in root.findall("layerorder/layer")] == list(held)
    for leaf in leaves:
        one = held[leaf.get("id")]
        assert one.findtext("datasource") == leaf.get("source")
        assert one.findtext("provider") == leaf.get("providerKey")
        assert one.findtext("srs/spatialrefsys/authid") == "EPSG:5514"
        drawn = "pipe/rasterrenderer" if one.get("type") == "raster" else "renderer-v2"
        assert one.find(drawn) is not None
    assert leaves[6].get("checked") == "Qt::Unchecked"
    assert root.findtext("projectCrs/spatialrefsys/authid") == "EPSG:5514"
    # QGIS 3 reads it only then (tests/benchmarks/check_qgis.py opens a whole block in QGIS).
    assert root.findtext("properties/SpatialRefSys/ProjectionsEnabled") == "1"
    assert root.findtext("mapcanvas/extent/ymax") == "3.0"


def test_states_have_their_colours__truth(tmp_path: Path) -> None:
    root = project(tmp_path / "block.qgs")
    points = root.findall("projectlayers/maplayer")[0]
    renderer = points.find("renderer-v2")
    assert renderer is not None
    assert (renderer.get("type"), renderer.get("attr")) == ("categorizedSymbol", "status")
    kinds = {kind.get("value"): kind.get("symbol") for kind in renderer.findall("categories/*")}
    inks = {
        symbol.get("name"): symbol.findall("layer/prop[@k='color']")[0].get("v")
        for symbol in renderer.findall("symbols/symbol")
    }
    assert inks[kinds["rejected"] or ""] == "179,38,30,255"
    assert set(kinds.values()) == set(inks)
    text = points.find("labeling/settings/text-style")
    assert text is not None
    assert text.get("fieldName") == "point_id"


def test_its_vector_sources_open_with_gdal__oracle(tmp_path: Path) -> None:
    raw.write(
        tmp_path / "own.gpkg", geometry=[Point(1, 2).wkb], field_data=[], fields=[],
        geometry_type="Point", crs="EPSG:5514", layer="own",
    )  # fmt: skip
    root = project(tmp_path / "block.qgs")
    source = root.findall("projectlayers/maplayer")[-1].findtext("datasource") or ""
    file, layer = source.split("|layername=")
    assert pyogrio.read_info(tmp_path / file, layer=layer)["features"] == 1
