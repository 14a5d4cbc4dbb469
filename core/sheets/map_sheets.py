"""Map sheets to cut, by the user's index layer: a name and an area each, in the block's CRS."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import shapely
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from core.errors import ReferenceDataError
from core.formats.vectors import VectorLayer, read_layers
from core.geometry.crs import parse_crs

NAME = "name"
"""Attribute of the index that holds the name of a sheet."""
SHOWN_NAMES = 5  # design: as many as a line holds.
"""Names that a message lists."""


@dataclass(frozen=True, slots=True, eq=False)
class MapSheet:
    """One sheet of a map."""

    name: str
    """As the index has it."""
    area: Polygon | MultiPolygon
    """What it shows, in the block's CRS, metres."""


def read_sheet_index(path: Path, crs: str) -> tuple[MapSheet, ...]:
    """The sheets of an index layer, brought into the block's CRS, in the order of their names.

    Args:
        path: Any vector file that GDAL reads; one of its layers by `|layername=`.
        crs: The block's CRS.

    Raises:
        ReferenceDataError: It cannot be read, has no polygons, or names are missing or stand twice.
        CrsError: It lies in a CRS that PROJ cannot bring to the block's.
    """
    layers = read_layers(path, parse_crs(crs, "block.toml [block] crs"))
    layer = _index_layer(path, [one for one in layers if len(one.geometries)])
    sheets: list[MapSheet] = []
    nameless = 0
    for area, given in zip(layer.geometries, layer.columns[NAME], strict=True):
        name = "" if given is None or given != given else str(given).strip()
        nameless += not name
        sheets.append(MapSheet(name, only_areas(shapely.make_valid(area))))
    if nameless:
        raise ReferenceDataError(
            path,
            "{nameless} of its {count} sheets have no `name`.",
            "Fill in the attribute: files of sheets are named by it.",
            nameless=nameless,
            count=len(sheets),
        )
    refuse_twins(path, [sheet.name for sheet in sheets])
    return tuple(sorted(sheets, key=lambda sheet: sheet.name))


def only_areas(geometry: BaseGeometry) -> Polygon | MultiPolygon:
    """The polygons of a geometry, without the lines and points that cutting may leave."""
    parts = shapely.get_parts(geometry)
    found = shapely.union_all(parts[shapely.get_dimensions(parts) == 2])
    return found if isinstance(found, Polygon | MultiPolygon) else Polygon()


def _index_layer(path: Path, layers: list[VectorLayer]) -> VectorLayer:
    """The one layer of polygons with names."""
    areal = [one for one in layers if (shapely.get_dimensions(one.geometries) == 2).all()]
    if not areal:
        raise ReferenceDataError(
            path, "it has no layer of polygons.", "Give the areas of the map sheets as polygons."
        )
    named = [one for one in areal if NAME in one.columns]
    if not named:
        raise ReferenceDataError(
            path,
            "it has no attribute `name`, only {names}.",
            "Rename the attribute that holds the names of the sheets to `name`.",
            names=list(areal[0].columns) or "none",
        )
    if len(named) > 1:
        raise ReferenceDataError(
            path,
            "{count} of its layers may be the index: {names}.",
            "Name the one that is meant: FILE|layername=LAYER.",
            count=len(named),
            names=[one.name for one in named],
        )
    return named[0]


def refuse_twins(path: Path, names: list[str]) -> None:
    """Raise where two sheets bear one name, letters of either case being the same to a disk.

    Raises:
        ReferenceDataError: Names stand twice.
    """
    twins = [name for name, count in Counter(map(str.casefold, names)).items() if count > 1]
    if twins:
        told = sorted(name for name in set(names) if name.casefold() in twins)
        raise ReferenceDataError(
            path,
            "{count:# name stands|# names stand} for more than one sheet: {names}.",
            "Give every sheet a name of its own, or join its parts into one polygon.",
            count=len(twins),
            names=told[:SHOWN_NAMES],
        )
