"""Vector files of any GDAL driver: layers, geometries and attributes in the block's CRS."""

import errno
import glob
import os
import warnings
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pyogrio.raw
import shapely
from pyogrio import raw
from pyogrio.errors import DataLayerError, DataSourceError, FeatureError
from pyproj import CRS
from shapely.geometry.base import BaseGeometry

from core.errors import ReferenceDataError
from core.formats.records import status_of
from core.geometry.crs import (
    FARTHEST_M,
    Bounds,
    Operation,
    check_range,
    horizontal,
    infer_crs,
    operation_between,
    read_crs,
    same_coordinates,
)
from core.said import say

GDAL_ERRORS = (DataSourceError, DataLayerError, FeatureError, UnicodeDecodeError)
"""What GDAL says of vector files that it cannot read or write, and pyogrio of spoilt words."""
LAYER_MARK = "|layername="
"""What QGIS writes between a file and one of its layers."""
CZECH_DBF = "windows-1250"
"""Encoding of shapefiles that name none: those of the Czech Office are all in it."""
LENGTH_AT = 24  # source: ESRI Shapefile Technical Description, July 1998, page 4.
"""Byte at which a shapefile says its length, in words of two bytes."""
LANGUAGE_AT = 29  # source: structure of a dBASE III+ file header.
"""Byte at which the table of a shapefile names its encoding; nought where it does not."""
NO_TIME = "2000-01-01T00:00:00Z"
"""When every layer was written last: the same run gives the same bytes."""


@dataclass(frozen=True, slots=True, eq=False)
class VectorLayer:
    """One layer, flat (heights dropped), in the block's CRS."""

    file: str
    """The file it came from."""
    name: str
    """The layer."""
    geometries: np.ndarray
    """Shapely geometries, none of them empty or missing."""
    columns: Mapping[str, np.ndarray]
    """Attributes by the names they have in the file, one row per geometry."""


def read_layers(
    path: str | Path,
    crs: CRS,
    bounds: Bounds | None = None,
    attributes: bool = True,
    *,
    heights: bool = False,
) -> tuple[VectorLayer, ...]:
    """Every layer with geometry of a file; of one layer, where the path ends in `|layername=`.

    Args:
        path: Shapefile, GeoPackage, GeoJSON, GML, FlatGeobuf: whatever GDAL reads.
        crs: The block's CRS.
        bounds: Read only what touches these, in the block's CRS.
        attributes: Read the attributes as well.
        heights: Keep heights of coordinates, as they are in the file.
    """
    file, _, wanted = str(path).partition(LAYER_MARK)
    try:
        check_files(Path(file))
    except OSError as error:
        cause = say("it cannot be read ({error}).", error=error.strerror)
        if isinstance(error, FileNotFoundError):
            cause = "the file is not there."
        raise ReferenceDataError(file, cause, "Correct the path under [reference].") from error
    try:
        with no_remarks():
            names = [str(name) for name, kind in pyogrio.list_layers(file) if kind is not None]
            if wanted and wanted not in names:
                raise ReferenceDataError(
                    file,
                    "it has no layer {wanted!r}.",
                    "It has: {names}.",
                    wanted=wanted,
                    names=", ".join(names) or "none",
                )
            chosen = [wanted] if wanted else names
            return tuple(
                _read_layer(file, name, crs, bounds, attributes=attributes, heights=heights)
                for name in chosen
            )
    except GDAL_ERRORS as error:
        raise ReferenceDataError(
            file,
            "the file cannot be read as vector data: GDAL does not know it, or it is damaged.",
            "Export it again, for example as GeoPackage.",
        ) from error


@contextmanager
def no_remarks() -> Generator[None]:
    """Without GDAL's remarks on dialects of formats; what cannot be read is an error still."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _read_layer(
    file: str, name: str, crs: CRS, bounds: Bounds | None, *, attributes: bool, heights: bool
) -> VectorLayer:
    """One layer, brought into the block's CRS."""
    encoding = _encoding(file)
    info: dict[str, Any] = pyogrio.read_info(file, name, encoding=encoding, force_total_bounds=True)
    columns = None if attributes else []
    if not info["features"] or info["total_bounds"] is None:
        return VectorLayer(file, name, np.empty(0, dtype=object), {})
    extent = _corners(info["total_bounds"])
    to_block = _way_to_block(info["crs"], extent, crs, file)
    box = bounds if bounds is None or to_block is None else _box_in(to_block, bounds)
    meta, _, wkb, fields = raw.read(
        file, name, encoding=encoding, columns=columns, force_2d=not heights, bbox=box
    )
    geometries = np.asarray(shapely.from_wkb(wkb), dtype=object)
    kept = ~(shapely.is_missing(geometries) | shapely.is_empty(geometries))
    geometries = geometries[kept]
    if not (np.abs(shapely.get_coordinates(geometries)) < FARTHEST_M).all():
        raise ReferenceDataError(
            file, "it holds coordinates that are no places.", "Export it again from its source."
        )
    if to_block is not None and len(geometries):
        geometries = shapely.transform(
            geometries,
            lambda old: np.column_stack([to_block.forward(old[:, :2]), old[:, 2:]]),
            include_z=heights,
        )
    table = {str(n): values[kept] for n, values in zip(meta["fields"], fields, strict=True)}
    return VectorLayer(file, name, geometries, table)


def check_files(path: Path) -> None:
    """Refuse what GDAL would wait for without end, and a shapefile that was cut off.

    GDAL reads such a shapefile without a word, and gives fewer lines.
    """
    status_of(path)
    if path.suffix.lower() != ".shp" or path.is_dir():
        return
    for part in path.parent.glob(f"{glob.escape(path.stem)}.*"):
        status_of(part)
    with path.open("rb") as stream:
        stream.seek(LENGTH_AT)
        words = stream.read(4)
    if len(words) < 4 or 2 * int.from_bytes(words, "big") > path.stat().st_size:
        raise ReferenceDataError(
            path,
            "the shapefile is shorter than its header says: it was cut off.",
            "Copy it again from its source, with its .shx and .dbf.",
        )


def _encoding(file: str) -> str | None:
    """Encoding of a shapefile that does not say its own; None leaves it to GDAL."""
    path = Path(file)
    if path.suffix.lower() != ".shp" or any(
        path.with_suffix(suffix).exists() for suffix in (".cpg", ".CPG")
    ):
        return None
    table = path.with_suffix(".dbf")
    if not table.exists():
        return None
    with table.open("rb") as stream:
        stream.seek(LANGUAGE_AT)
        return CZECH_DBF if stream.read(1) == b"\0" else None


def _corners(bounds: Sequence[float]) -> np.ndarray:
    """The four corners of bounds."""
    west, south, east, north = bounds
    return np.array([[west, south], [east, south], [east, north], [west, north]], dtype=np.float64)


def _way_to_block(
    stated: str | None, extent: np.ndarray, block: CRS, file: str
) -> Operation | None:
    """The operation from the layer's CRS to the block's; None where they agree."""
    if stated:
        own = horizontal(read_crs(stated, file))
        if own.is_projected:
            check_range(own, extent, file)
    else:
        own = infer_crs(extent, block, file)
    if same_coordinates(own.to_wkt(), block.to_wkt(), extent):
        return None
    return operation_between(own.to_wkt(), block.to_wkt(), extent, file)


def _box_in(to_block: Operation, bounds: Bounds) -> Bounds:
    """Bounds that hold the block's bounds in the layer's CRS."""
    corners = _corners(bounds)
    # design: eighths of a side of a block bend by less than a metre between two CRS.
    share = np.linspace(0, 1, 9)[:-1, None]
    outline = corners[:, None] + share * (np.roll(corners, -1, axis=0) - corners)[:, None]
    there = to_block.backward(outline.reshape(-1, 2))
    (west, south), (east, north) = there.min(axis=0), there.max(axis=0)
    return float(west), float(south), float(east), float(north)


def read_mask_polygons(
    path: str | Path | Sequence[str | Path], crs: CRS, bounds: Bounds | None = None
) -> BaseGeometry:
    """The area of all polygons of files as one geometry: masks, buildings, bridges.

    Args:
        path: One file or several.
        crs: The block's CRS.
        bounds: Read only what touches these, in the block's CRS.

    Returns:
        A polygon or multipolygon, flat; empty where the files hold no polygons.
    """
    files = [path] if isinstance(path, str | Path) else list(path)
    parts: list[BaseGeometry] = []
    for file in files:
        for layer in read_layers(file, crs, bounds, attributes=False):
            pieces = shapely.get_parts(layer.geometries)
            areal = pieces[shapely.get_dimensions(pieces) == 2]
            parts.extend(shapely.make_valid(areal))
    return shapely.unary_union(parts) if parts else shapely.Polygon()


def write_polygons(
    path: Path,
    layer: str,
    areas: Sequence[BaseGeometry],
    fields: Mapping[str, np.ndarray],
    *,
    crs: str,
    append: bool = False,
) -> None:
    """Write one layer of polygons or multipolygons; see `write_layer`."""
    several = any(isinstance(area, shapely.MultiPolygon) for area in areas)
    kind = "MultiPolygon" if several else "Polygon"
    write_layer(path, layer, areas, fields, crs=crs, kind=kind, append=append)


def write_layer(
    path: Path,
    layer: str,
    geometries: Sequence[BaseGeometry],
    fields: Mapping[str, np.ndarray],
    *,
    crs: str,
    kind: str,
    append: bool = False,
) -> None:
    """Write one layer of a GeoPackage.

    Args:
        path: The GeoPackage, in a folder that can be written to.
        layer: Name of the layer.
        geometries: Geometries of one kind.
        fields: Attributes by name, one value for each geometry.
        crs: CRS of the coordinates.
        kind: Their kind as GDAL calls it, such as `Polygon`.
        append: Put the layer into the file that is there.

    Raises:
        OSError: The disk is full.
    """
    # The time of writing that GDAL puts into a GeoPackage would make every run another file.
    pyogrio.set_gdal_config_options({"OGR_CURRENT_DATE": NO_TIME})
    try:
        pyogrio.raw.write(
            path,
            geometry=np.array([shapely.to_wkb(one) for one in geometries], dtype=object),
            field_data=list(fields.values()),
            fields=np.array(list(fields), dtype=object),
            geometry_type=kind,
            crs=crs,
            driver="GPKG",
            layer=layer,
            append=append,
        )
    except GDAL_ERRORS as error:
        # The folder has been found to be writable: only room for what is put in may be lacking.
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path)) from error
    finally:
        pyogrio.set_gdal_config_options({"OGR_CURRENT_DATE": None})
