"""Footprints of photos: from vector files of any GDAL driver, and of exchanged photos into one."""

import errno
import os
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

from core.arrays import ObjectPoints, PixelPoints
from core.errors import ProjectError
from core.formats.exchange import (
    Conventions,
    ExchangeBlock,
    ExchangeCamera,
    ExchangeFormat,
    ExchangePhoto,
    ideal_from_image,
)
from core.formats.records import scan_stem, status_of
from core.formats.vectors import GDAL_ERRORS, no_remarks
from core.said import say

NAME = "LMS_TIF_UP"
"""Attribute with the scan's name, as the Czech Office has it."""
LAYER = "footprints"
"""Layer of files that name theirs."""
SHAPEFILE = "ESRI Shapefile"
"""GDAL's name of the driver whose files name none."""
# source: definition, in units of columns and rows.
CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1), (0, 0))
"""Corners of a scan in turn, closed."""
# source: definition, in units of half the picture area.
FILM_CORNERS = ((-1, 1), (1, 1), (1, -1), (-1, -1), (-1, 1))
"""Corners of the picture area about the middle of the fiducials in turn, closed."""
STEEPEST = -0.05  # design: rays within three degrees of the horizon reach nowhere.
"""Rays that fall less than this meet no ground."""


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


def ground_height(block: ExchangeBlock) -> float | None:
    """Mean height of all points that are known, metres; None where none is."""
    heights = [point.position[2] for point in block.points.values()]
    if block.ties.positions is not None:
        known = block.ties.positions[:, 2]
        heights += known[np.isfinite(known)].tolist()
    return float(np.mean(heights)) if heights else None


def ground_places(
    photo: ExchangePhoto, camera: ExchangeCamera, pixels: PixelPoints, level: float
) -> ObjectPoints | None:
    """Where pixels of an oriented photo meet level ground; None where one does not."""
    assert photo.exterior is not None, "only an oriented photo lies on the ground"
    assert photo.pixel_from_image is not None, "only an oriented photo lies on the ground"
    linear, shift = photo.pixel_from_image[:, :2], photo.pixel_from_image[:, 2]
    ideal = ideal_from_image(np.linalg.solve(linear, (pixels - shift).T).T, camera)
    rays = np.column_stack([ideal, -np.ones(len(ideal))]) @ photo.exterior.object_from_image.T
    fall = float(photo.exterior.centre[2]) - level
    if fall <= 0 or np.any(rays[:, 2] / np.linalg.norm(rays, axis=1) > STEEPEST):
        return None
    return photo.exterior.centre - rays * (fall / rays[:, 2:])


def ground_outline(block: ExchangeBlock, photo: ExchangePhoto) -> list[list[float]] | None:
    """Easting and northing of a photo's corners on level ground, closed; None where unknown.

    The corners are those of the scan where its size is known, else of the camera's picture area.
    """
    level, camera = ground_height(block), block.cameras.get(photo.camera)
    if level is None or camera is None:
        return None
    if photo.exterior is None or photo.pixel_from_image is None:
        return None
    corners = _corners(photo, camera)
    places = None if corners is None else ground_places(photo, camera, corners, level)
    if places is None:
        return None
    ring = places[:, :2]
    return ring.tolist() if shapely.Polygon(ring).exterior.is_ccw else ring[::-1].tolist()


def _corners(photo: ExchangePhoto, camera: ExchangeCamera) -> PixelPoints | None:
    """Pixels of the corners of scan or picture area, closed; None where neither is known."""
    if camera.size_px is not None:
        return np.array(CORNERS, dtype=np.float64) * camera.size_px
    if camera.frame_mm is None or not camera.principal_distance_mm:
        return None
    # Refraction in `pixel_from_image` moves a corner by centimetres on the ground at most.
    film = np.array(FILM_CORNERS) * camera.frame_mm / 2 - camera.principal_point_mm
    image = film / camera.principal_distance_mm
    return image @ photo.interior[:, :2].T + photo.interior[:, 2]


def off_nadir(photo: ExchangePhoto) -> float:
    """Angle between the viewing axis of an oriented photo and the plumb line, degrees."""
    assert photo.exterior is not None
    down = float(photo.exterior.object_from_image[2, 2])
    return float(np.degrees(np.arccos(np.clip(down, -1.0, 1.0))))


def write_footprints(path: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write footprints into a vector file, whose driver its ending tells.

    Returns:
        What was left out.

    Raises:
        ProjectError: No driver writes files of that ending, or no photo has a footprint.
        OSError: The disk is full.
    """
    rings = {name: ground_outline(block, photo) for name, photo in block.photos.items()}
    known = {name: ring for name, ring in rings.items() if ring is not None}
    if not known:
        raise ProjectError(
            path, "No photo has a footprint.", "Orient photos and give points with heights first."
        )
    photos = [block.photos[name] for name in known]
    fields = {
        NAME: np.array([photo.file or photo.photo_id for photo in photos], dtype=object),
        "off_nadir": np.array([off_nadir(photo) for photo in photos]),
        "focal_px": np.array([photo.focal_px for photo in photos]),
    }
    try:
        driver = pyogrio.detect_write_driver(path.name)
        pyogrio.raw.write(
            path,
            # A shapefile is its layer; elsewhere the file may still have the name of a temporary.
            layer=None if driver == SHAPEFILE else LAYER,
            geometry=np.array([shapely.to_wkb(shapely.Polygon(r)) for r in known.values()]),
            field_data=list(fields.values()),
            fields=np.array(list(fields), dtype=object),
            geometry_type="Polygon",
            crs=block.crs or None,
            driver=driver,
        )
    except ValueError as error:
        raise ProjectError(
            path, "No vector format has this ending.", "Name it .gpkg, .geojson, .shp or .fgb."
        ) from error
    except pyogrio.errors.DataSourceError as error:
        raise OSError(errno.EACCES, os.strerror(errno.EACCES), str(path)) from error
    lost = len(rings) - len(known)
    if lost:
        return (
            say(
                "{count:# photo has|# photos have} no footprint: orientation, scan size or ground "
                "are unknown.",
                count=lost,
            ),
        )
    return ()


FOOTPRINTS_FORMAT = ExchangeFormat(
    name="footprints",
    title="Footprints as a vector file",
    conventions=Conventions(
        object_space="easting, northing, metres: corners of the picture area on level ground at "
        "the mean height of all points; the CRS in the file",
        camera="none; the principal distance in pixels as an attribute",
        lost="all but the outlines of photos, named by `LMS_TIF_UP`",
        tested="GDAL reads it; the Czech Office's footprints are read by `[scans] footprints`",
    ),
    holds="film",
    write=write_footprints,
    default_name="footprints.gpkg",
    folder=False,
)
"""Footprints, written; read as `footprints` in [scans]."""


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
    try:
        status_of(path)
    except OSError as error:
        cause, remedy = "The footprints are missing.", "Check `footprints` in [scans]."
        raise ProjectError(path, cause, remedy) from error
    try:
        with no_remarks():
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
    except GDAL_ERRORS as error:
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
