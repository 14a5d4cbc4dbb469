"""Feature tables of a GeoPackage, written by hand in the transaction of the caller."""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import shapely
from pyproj.exceptions import CRSError
from shapely.geometry.base import BaseGeometry

from core.geometry.crs import read_crs
from sessions.store import Transaction

CUSTOM_SRS_ID = 100_000
"""Number of a CRS that has no code of an authority."""
_LITTLE_ENDIAN, _XY_ENVELOPE, _EMPTY = 0b1, 0b10, 0b10000


@dataclass(frozen=True, slots=True)
class Layer:
    """One table of features."""

    name: str
    """Table and layer name."""
    description: str
    """One sentence, shown by QGIS."""
    geometry_type: str
    """POINT, LINESTRING or POLYGON."""
    has_z: bool
    """True when the geometries carry heights."""
    columns: Mapping[str, str]
    """SQL type by attribute name."""


Feature = tuple[BaseGeometry, tuple[Any, ...]]
"""A geometry and its attributes in the order of the layer's columns."""


def replace_layer(
    transaction: Transaction, layer: Layer, srs_id: int, features: Sequence[Feature]
) -> None:
    """Put a layer in the place of what the file held under its name.

    The table is dropped, not emptied: a spatial index or feature count that QGIS may have hung on
    it lives in triggers that only GDAL can run.
    """
    _drop(transaction, layer.name)
    columns = "".join(f', "{name}" {kind}' for name, kind in layer.columns.items())
    transaction.execute(
        f'CREATE TABLE "{layer.name}" ('
        f"fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom {layer.geometry_type}{columns})"
    )
    bounds = [geometry.bounds for geometry, _ in features if not geometry.is_empty]
    extent = _extent(np.array(bounds)) if bounds else [None] * 4
    transaction.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, description,"
        " min_x, min_y, max_x, max_y, srs_id) VALUES (?, 'features', ?, ?, ?, ?, ?, ?, ?)",
        (layer.name, layer.name, layer.description, *extent, srs_id),
    )
    transaction.execute(
        "INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', ?, ?, ?, 0)",
        (layer.name, layer.geometry_type, srs_id, int(layer.has_z)),
    )
    marks = ", ".join("?" * (1 + len(layer.columns)))
    names = ", ".join(["geom", *(f'"{name}"' for name in layer.columns)])
    transaction.execute_many(
        f'INSERT INTO "{layer.name}" ({names}) VALUES ({marks})',
        (
            (geometry_blob(shape, srs_id, layer.has_z), *map(_plain, values))
            for shape, values in features
        ),
    )


def geometry_blob(geometry: BaseGeometry, srs_id: int, has_z: bool = False) -> bytes:
    """A geometry as GeoPackage binary: header with envelope, then ISO well-known binary."""
    flags = _LITTLE_ENDIAN | (_EMPTY if geometry.is_empty else 0)
    envelope = b""
    if not geometry.is_empty and geometry.geom_type != "Point":
        west, south, east, north = geometry.bounds
        flags |= _XY_ENVELOPE
        envelope = struct.pack("<4d", west, east, south, north)
    header = struct.pack("<2sBBi", b"GP", 0, flags, srs_id)
    return (
        header
        + envelope
        + shapely.to_wkb(geometry, output_dimension=3 if has_z else 2, byte_order=1, flavor="iso")
    )


def register_crs(transaction: Transaction, crs: str) -> int:
    """Enter the CRS into the file.

    Returns:
        Its `srs_id`.
    """
    known = read_crs(crs, "block.toml [block] crs")
    epsg = known.to_epsg(min_confidence=100)
    organization, code = ("NONE", CUSTOM_SRS_ID) if epsg is None else ("EPSG", epsg)
    try:
        definition = known.to_wkt("WKT1_GDAL")
    except CRSError:
        definition = known.to_wkt()
    transaction.execute(
        "INSERT OR REPLACE INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, NULL)",
        (known.name, code, organization, code, definition),
    )
    return code


def _drop(transaction: Transaction, name: str) -> None:
    """Remove a table and what GDAL may have entered about it."""
    tables = {row[0] for row in transaction.query("SELECT name FROM sqlite_master")}
    for about in ("gpkg_ogr_contents", "gpkg_extensions", "gpkg_geometry_columns", "gpkg_contents"):
        if about in tables:
            transaction.execute(f"DELETE FROM {about} WHERE table_name = ?", (name,))
    transaction.execute(f'DROP TABLE IF EXISTS "{name}"')
    transaction.execute(f'DROP TABLE IF EXISTS "rtree_{name}_geom"')


def _extent(bounds: np.ndarray) -> list[float]:
    low, high = np.nanmin(bounds[:, :2], axis=0), np.nanmax(bounds[:, 2:], axis=0)
    return [float(value) for value in (*low, *high)]


def _plain(value: Any) -> Any:
    """An attribute as SQLite takes it: no NumPy scalars; NaN is NULL."""
    plain: Any = cast("Any", value).item() if isinstance(value, np.generic) else value
    return None if isinstance(plain, float) and not np.isfinite(plain) else plain
