"""A QGIS project (.qgs) of layers in their styles, written without QGIS.

Sources are kept as they are given: relative ones count from the project's folder, so that both may
be moved together. Written after projects of QGIS 3; newer ones convert when they open it.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from pyproj import CRS

from core.formats.xml_files import Element, add

Kind = Literal["point", "line", "polygon", "raster"]
Bounds = tuple[float, float, float, float]
HEAD = b"<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
"""First line of every project of QGIS."""
VERSION = "3.22.0"
"""Of the projects that this one is written after."""
SYMBOLS: Mapping[Kind, tuple[str, str, str]] = {
    "point": ("marker", "SimpleMarker", "Point"),
    "line": ("line", "SimpleLine", "Line"),
    "polygon": ("fill", "SimpleFill", "Polygon"),
}
"""A geometry's symbol, its layer's class, and what QGIS calls the geometry."""


@dataclass(frozen=True, slots=True)
class Style:
    """How a layer is drawn."""

    colour: str = "#1f6fb2"
    """As #rrggbb."""
    size_mm: float = 2.0
    """Diameter of markers, width of lines."""
    shape: str = "circle"
    """Shape of markers, as QGIS calls it: circle, triangle, cross, square, ..."""
    label: str = ""
    """Field whose text stands beside each feature; none where it is empty."""
    by: str = ""
    """Field whose value chooses the colour; empty for one colour."""
    colours: Mapping[str, str] = field(default_factory=dict[str, str])
    """Colour of each value of that field."""


@dataclass(frozen=True, slots=True)
class ProjectLayer:
    """One layer."""

    name: str
    """As the tree of layers shows it."""
    source: str
    """A file, or `FILE.gpkg|layername=NAME`, from the project's folder."""
    kind: Kind
    """What it holds."""
    style: Style = Style()
    """How it is drawn; a raster's is black to white, or its colours."""
    bands: int = 1
    """Bands of a raster: one is grey, three and more are red, green, blue."""
    shown: bool = True
    """Whether it is switched on."""


STATES = {
    "auto": "#2a9d3a",
    "accepted": "#1b7a2b",
    "dubious": "#d98c00",
    "rejected": "#b3261e",
    "unused": "#8a8a8a",
}
"""Colours of the states of points and measurements."""
# design: legible at the scale of a block, the lesser layers thinner.
SESSION_LAYERS: tuple[tuple[str, Kind, Style], ...] = (
    ("points", "point", Style(size_mm=3.0, label="point_id", by="status", colours=STATES)),
    ("residual_vectors", "line", Style("#b3261e", 0.4)),
    ("photos", "point", Style("#222222", 3.0, "triangle", "photo_id")),
    ("measurements", "point", Style(size_mm=1.5, by="status", colours=STATES)),
    ("footprints", "polygon", Style("#1f6fb2", 0.3)),
    ("masks", "polygon", Style("#b3261e", 0.3)),
)
"""Layers of a session's GeoPackage, from the top, in their styles."""


def session_layers(geopackage: str) -> tuple[ProjectLayer, ...]:
    """The layers of a session, which lies at that path from the project's folder."""
    return tuple(
        ProjectLayer(name, f"{geopackage}|layername={name}", kind, style)
        for name, kind, style in SESSION_LAYERS
    )


def result_layers(geopackage: str, bands: int) -> tuple[ProjectLayer, ...]:
    """What there is to see of a block's results: session, seams, and a mosaic of some bands."""
    # design: seen over the mosaic at the scale of a block.
    seams, vectors = Style("#d98c00", 0.6, label="scan"), Style("#7b3fa0", 0.4)
    return (
        *session_layers(geopackage),
        ProjectLayer("misfit", f"{geopackage}|layername=misfit", "line", vectors, shown=False),
        ProjectLayer("seams", "seams.gpkg", "polygon", seams, shown=False),
        ProjectLayer("mosaic", "mosaic.tif", "raster", bands=bands),
    )


def write_qgis_project(
    path: Path, title: str, crs: str, layers: Sequence[ProjectLayer], extent: Bounds | None = None
) -> None:
    """Write a project.

    Args:
        path: The file, `.qgs`.
        title: Shown by QGIS.
        crs: CRS of the project and of all layers.
        layers: From the top to the bottom.
        extent: West, south, east, north of what is shown first; all, where it is None.
    """
    root = ElementTree.Element("qgis", version=VERSION, projectname=title)
    add(root, "homePath").set("path", "")
    add(root, "title", title)
    _crs(add(root, "projectCrs"), crs)
    tree = add(root, "layer-tree-group")
    names = [f"layer_{number}" for number in range(len(layers))]
    for name, layer in zip(names, layers, strict=True):
        leaf = add(tree, "layer-tree-layer")
        leaf.set("id", name)
        leaf.set("name", layer.name)
        leaf.set("source", layer.source)
        leaf.set("providerKey", _provider(layer))
        leaf.set("checked", "Qt::Checked" if layer.shown else "Qt::Unchecked")
        leaf.set("expanded", "0")
    canvas = add(root, "mapcanvas")
    canvas.set("name", "theMapCanvas")
    add(canvas, "units", "meters")
    if extent is not None:
        shown = add(canvas, "extent")
        for tag, value in zip(("xmin", "ymin", "xmax", "ymax"), extent, strict=True):
            add(shown, tag, repr(float(value)))
    add(canvas, "rotation", "0")
    _crs(add(canvas, "destinationsrs"), crs)
    held = add(root, "projectlayers")
    order = add(root, "layerorder")
    for name, layer in zip(names, layers, strict=True):
        _map_layer(held, name, layer, crs)
        add(order, "layer").set("id", name)
    properties = add(root, "properties")
    # QGIS reads a project's CRS only where its projections are switched on.
    add(add(properties, "SpatialRefSys"), "ProjectionsEnabled", "1").set("type", "int")
    paths = add(add(properties, "Paths"), "Absolute", "false")
    paths.set("type", "bool")
    ElementTree.indent(root)
    path.write_bytes(HEAD + ElementTree.tostring(root, encoding="utf-8") + b"\n")


def _provider(layer: ProjectLayer) -> str:
    """What opens a layer in QGIS."""
    return "gdal" if layer.kind == "raster" else "ogr"


def _crs(parent: Element, crs: str) -> None:
    """A CRS in QGIS's own terms."""
    known = CRS.from_user_input(crs)
    authority = known.to_authority()
    system = add(parent, "spatialrefsys")
    add(system, "wkt", known.to_wkt())
    add(system, "srid", authority[1] if authority else "0")
    add(system, "authid", ":".join(authority) if authority else "")
    add(system, "description", known.name)
    add(system, "geographicflag", "true" if known.is_geographic else "false")


def _map_layer(parent: Element, name: str, layer: ProjectLayer, crs: str) -> None:
    """One layer with its source and style."""
    one = add(parent, "maplayer")
    one.set("type", "raster" if layer.kind == "raster" else "vector")
    if layer.kind != "raster":
        one.set("geometry", SYMBOLS[layer.kind][2])
        one.set("labelsEnabled", "1" if layer.style.label else "0")
    add(one, "id", name)
    add(one, "datasource", layer.source)
    add(one, "layername", layer.name)
    _crs(add(one, "srs"), crs)
    provider = add(one, "provider", _provider(layer))
    if layer.kind == "raster":
        _picture(add(one, "pipe"), layer.bands)
    else:
        provider.set("encoding", "UTF-8")
        _renderer(one, layer)
        if layer.style.label:
            labeling = add(one, "labeling")
            labeling.set("type", "simple")
            text = add(add(labeling, "settings"), "text-style")
            text.set("fieldName", layer.style.label)
            text.set("fontSize", "8")
            text.set("textColor", "0,0,0,255")
    add(one, "layerOpacity", "1")


def _picture(pipe: Element, bands: int) -> None:
    """How a raster is drawn."""
    renderer = add(pipe, "rasterrenderer")
    renderer.set("opacity", "1")
    renderer.set("alphaBand", "-1")
    if bands < len(("red", "green", "blue")):
        renderer.set("type", "singlebandgray")
        renderer.set("grayBand", "1")
        renderer.set("gradient", "BlackToWhite")
        return
    renderer.set("type", "multibandcolor")
    for number, band in enumerate(("red", "green", "blue"), start=1):
        renderer.set(f"{band}Band", str(number))


def _renderer(parent: Element, layer: ProjectLayer) -> None:
    """One symbol, or one for each value of a field and one for all others."""
    style = layer.style
    renderer = add(parent, "renderer-v2")
    renderer.set("symbollevels", "0")
    renderer.set("type", "categorizedSymbol" if style.by else "singleSymbol")
    colours = {**style.colours, "": style.colour} if style.by else {"": style.colour}
    if style.by:
        renderer.set("attr", style.by)
        kinds = add(renderer, "categories")
        for number, value in enumerate(colours):
            kind = add(kinds, "category")
            kind.set("symbol", str(number))
            kind.set("value", value)
            kind.set("label", value)
            kind.set("render", "true")
    symbols = add(renderer, "symbols")
    for number, colour in enumerate(colours.values()):
        _symbol(symbols, str(number), layer, colour)


def _symbol(parent: Element, name: str, layer: ProjectLayer, colour: str) -> None:
    """One symbol."""
    kind, drawn, _ = SYMBOLS[layer.kind]
    symbol = add(parent, "symbol")
    for key, value in (("type", kind), ("name", name), ("alpha", "1"), ("clip_to_extent", "1")):
        symbol.set(key, value)
    part = add(symbol, "layer")
    for key, value in (("class", drawn), ("enabled", "1"), ("locked", "0"), ("pass", "0")):
        part.set(key, value)
    ink = ",".join(map(str, bytes.fromhex(colour.removeprefix("#")))) + ",255"
    size = repr(layer.style.size_mm)
    properties: dict[Kind, dict[str, str]] = {
        "point": {
            "name": layer.style.shape,
            "color": ink,
            "size": size,
            "size_unit": "MM",
            "outline_color": "255,255,255,255",
            "outline_width": "0.2",
        },
        "line": {
            "line_color": ink,
            "line_width": size,
            "line_width_unit": "MM",
            "line_style": "solid",
        },
        "polygon": {
            "style": "no",
            "outline_color": ink,
            "outline_width": size,
            "outline_width_unit": "MM",
            "outline_style": "solid",
        },
    }
    for key, value in properties[layer.kind].items():
        one = add(part, "prop")
        one.set("k", key)
        one.set("v", value)
