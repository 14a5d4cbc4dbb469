"""Footprints of photos: polygons of any vector file GDAL reads, named by the scan's file name."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import pyogrio
import pyogrio.errors
import pyogrio.raw
import shapely
from jaxtyping import Float64
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from core.errors import ProjectError
from core.formats.records import scan_stem


@dataclass(frozen=True, slots=True, eq=False)
class Footprint:
    """The ground one photo is said to show."""

    path: Path
    """The file it was read from."""
    photo_id: str
    """The photo."""
    polygon: Polygon
    """Outline."""

    @property
    def corners(self) -> Float64[np.ndarray, "4 2"]:
        """The four corners of the smallest rectangle about it, counter-clockwise."""
        box = cast(Polygon, shapely.oriented_envelope(self.polygon))
        ring = box.exterior.coords[:4]
        return np.array(ring if box.exterior.is_ccw else ring[::-1], dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Footprints:
    """Footprints of a file, in the file's own CRS."""

    path: Path
    """The file."""
    crs: str | None
    """CRS as the file says, None where it says none."""
    by_photo: Mapping[str, Footprint]
    """Those of the photos that were asked for; photos may be missing."""


def read_footprints(path: Path, name_attribute: str, photo_ids: Iterable[str]) -> Footprints:
    """Footprints by photo; photos that have none are simply not there.

    Args:
        path: Any vector file that GDAL reads.
        name_attribute: Attribute that holds the scan's file name; matched with or without folder
            and extension, in any case.
        photo_ids: Photos that are asked for.

    Raises:
        ProjectError: Missing, unreadable, or without the attribute.
    """
    meta, geometries, names = _read(path, name_attribute)
    wanted = {photo_id.lower(): photo_id for photo_id in photo_ids}
    found: dict[str, Footprint] = {}
    for name, geometry in zip(names, geometries, strict=True):
        photo_id = _photo_of(str(name), wanted)
        if photo_id is None or geometry is None:
            continue
        part = _largest_polygon(shapely.from_wkb(geometry))
        if part is not None and not part.is_empty:
            found.setdefault(photo_id, Footprint(path, photo_id, part))
    return Footprints(path, meta.get("crs"), found)


def _read(path: Path, name_attribute: str) -> tuple[dict[str, Any], Any, Any]:
    """Meta, geometries (WKB) and names of the first layer that has the attribute."""
    if not path.exists():
        raise ProjectError(path, "The footprints are missing.", "Check `footprints` in [scans].")
    try:
        layers = [str(layer) for layer, _ in pyogrio.list_layers(path)]
        seen: list[str] = []
        for layer in layers:
            fields = [str(field) for field in pyogrio.read_info(path, layer=layer)["fields"]]
            matching = [field for field in fields if field.lower() == name_attribute.lower()]
            if matching:
                meta, _, geometries, columns = pyogrio.raw.read(
                    path, layer=layer, columns=matching[:1], force_2d=True
                )
                return dict(meta), geometries, columns[0]
            seen += fields
    except pyogrio.errors.DataSourceError as error:
        raise ProjectError(
            path, "It is not a vector file that can be read.", "Check `footprints` in [scans]."
        ) from error
    raise ProjectError(
        path,
        "It has no attribute '{name_attribute}', only {names}.",
        "Name the attribute that holds the file names as `footprint_name` in [scans].",
        name_attribute=name_attribute,
        names=", ".join(sorted(set(seen))) or "none",
    )


def _photo_of(name: str, wanted: Mapping[str, str]) -> str | None:
    """The photo a name means, with or without folder and extension, in any case."""
    plain = name.strip().replace("\\", "/").rsplit("/", 1)[-1].lower()
    return wanted.get(scan_stem(plain)) or wanted.get(plain)


def _largest_polygon(geometry: BaseGeometry) -> Polygon | None:
    """The polygon itself, or the largest part of a multi-polygon; None for lines and points."""
    if isinstance(geometry, Polygon):
        return geometry
    parts = [part for part in getattr(geometry, "geoms", ()) if isinstance(part, Polygon)]
    return max(parts, key=lambda part: part.area, default=None)
