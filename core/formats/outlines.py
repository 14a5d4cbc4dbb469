"""Footprints of exchanged photos on level ground, and as a vector file of any GDAL driver."""

import errno
import os
from pathlib import Path

import numpy as np
import pyogrio
import pyogrio.errors
import pyogrio.raw
import shapely

from core.arrays import ObjectPoints, PixelPoints
from core.errors import ProjectError
from core.formats.exchange import (
    Conventions,
    ExchangeBlock,
    ExchangeCamera,
    ExchangeFormat,
    ExchangePhoto,
    frame_camera,
    ideal_from_image,
)
from core.said import say

NAME = "LMS_TIF_UP"
"""Attribute with the scan's name, as the Czech Office has it."""
# source: definition, in units of columns and rows.
CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1), (0, 0))
"""Corners of a scan in turn, closed."""
STEEPEST = -0.05  # design: rays within three degrees of the horizon reach nowhere.
"""Rays that fall less than this meet no ground."""


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
    """Easting and northing of a scan's corners on level ground, closed; None where unknown."""
    level, camera = ground_height(block), block.cameras.get(photo.camera)
    if level is None or camera is None or camera.size_px is None:
        return None
    if photo.exterior is None or photo.pixel_from_image is None:
        return None
    corners = np.array(CORNERS, dtype=np.float64) * camera.size_px
    places = ground_places(photo, camera, corners, level)
    if places is None:
        return None
    ring = places[:, :2]
    return ring.tolist() if shapely.Polygon(ring).exterior.is_ccw else ring[::-1].tolist()


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
        "focal_px": np.array(
            [frame_camera(photo, block.camera_of(photo.photo_id)).focal_px for photo in photos]
        ),
    }
    try:
        pyogrio.raw.write(
            path,
            geometry=np.array([shapely.to_wkb(shapely.Polygon(r)) for r in known.values()]),
            field_data=list(fields.values()),
            fields=np.array(list(fields), dtype=object),
            geometry_type="Polygon",
            crs=block.crs or None,
            driver=pyogrio.detect_write_driver(path.name),
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
        object_space="easting, northing, metres, on level ground at the mean height of all "
        "points; the CRS in the file",
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
