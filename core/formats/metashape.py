"""Metashape: cameras and markers as XML, orientations as OPK text (FORMATS 4.8, 4.9).

Pixels count from the outer corner, as ours do. A chunk's coordinates go through its transform into
geocentric ones of the CRS's own datum, or into local ones; we write a chunk whose axes are east,
north, up in the middle of the block.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.arrays import ObjectPoints, Position, Rotation
from core.formats.exchange import (
    Conventions,
    ExchangeBlock,
    ExchangeFormat,
    FrameCamera,
    from_frame_camera,
)
from core.formats.frame_interiors import FrameInterior, frame_photos, rounded_origin, where_any
from core.formats.metashape_reading import read_metashape
from core.formats.xml_files import Element, add, digits, write_xml
from core.geometry.map_in_space import (
    MapInSpace,
    geocentric_axes,
    geographic_of,
    map_crs,
    map_in_space,
    origin_of,
)
from core.said import say

CAMERAS, MARKERS, OPK = "cameras.xml", "markers.xml", "cameras_opk.txt"
"""Files of a folder."""
LOCAL = (
    'LOCAL_CS["Local Coordinates (m)",LOCAL_DATUM["Local Datum",0],'
    'UNIT["metre",1,AUTHORITY["EPSG","9001"]]]'
)
"""What Metashape writes where there is no CRS."""
RADIAL_TERMS = 4  # source: Metashape manual, appendix C; k1 to k4.
VERSION = "1.5.0"
"""Of the document; that of the samples."""


@dataclass(frozen=True, slots=True, eq=False)
class Chunk:
    """The frame of a chunk that we write."""

    frame: MapInSpace | None
    """East, north, up in the middle; None for local coordinates."""
    rotation: Rotation
    """Geocentric (or local) from chunk."""
    translation: Position
    """Metres."""

    def from_object(self, points: ObjectPoints) -> ObjectPoints:
        """The chunk's coordinates."""
        return points - self.translation if self.frame is None else self.frame.from_object(points)

    def turn_at(self, place: Position) -> Rotation:
        """The chunk's axes from the map's."""
        return np.eye(3) if self.frame is None else self.frame.turn_at(place)


def chunk_of(crs: str, origin: Position, file: Path) -> Chunk:
    """The frame of a chunk about a place.

    Raises:
        CrsError: The CRS is no map.
    """
    if not crs:
        return Chunk(None, np.eye(3), origin)
    plane = map_crs(crs, file)
    datum = geographic_of(plane)
    place = origin_of(plane, datum, origin)
    rotation, translation = geocentric_axes(datum, place)
    return Chunk(map_in_space(plane, datum, place), rotation, translation)


def write_metashape(folder: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write cameras.xml, markers.xml and cameras_opk.txt.

    Returns:
        What was left out, a sentence each.

    Raises:
        CrsError: The CRS is no map in metres.
    """
    photos = frame_photos(block)
    centres = [photo.exterior.centre for photo in block.photos.values() if photo.exterior]
    places = [np.array(point.position) for point in block.points.values()]
    chunk = chunk_of(block.crs, rounded_origin(centres or places), folder)
    ids = {name: number for number, name in enumerate(block.photos)}
    sensors = _sensors(photos.interiors)
    numbers = {name: number for number, name in enumerate(photos.interiors)}
    cameras = Element("cameras", next_id=str(len(ids)), next_group_id="0")
    for name, photo in block.photos.items():
        one = add(cameras, "camera")
        one.attrib.update(id=str(ids[name]), label=photo.file)
        if name in photos.camera:
            one.set("sensor_id", str(numbers[photos.camera[name]]))
        if name in photos.frames and photo.exterior is not None:
            _orient(one, photos.frames[name], chunk, photo.sigma_centre_m)
    folder.mkdir(parents=True, exist_ok=True)
    for file, parts in (
        (CAMERAS, (sensors, cameras)),
        (MARKERS, (sensors, cameras, *_markers(block, ids))),
    ):
        root = Element("document", version=VERSION)
        whole = add(root, "chunk")
        whole.attrib.update(label="gruber", enabled="true")
        whole.extend(parts)
        _close(whole, chunk, block)
        write_xml(folder / file, root)
    _write_opk(folder / OPK, block, photos.frames)
    extra = [name for name, one in photos.interiors.items() if len(one.radial) > RADIAL_TERMS]
    notes = where_any(
        photos.lost, say("Without interior orientation: {photos}.", photos=photos.lost)
    )
    notes += where_any(extra, say("Metashape holds no k5; left out of: {photos}.", photos=extra))
    if len(block.ties.point):
        notes += ("Metashape's XML holds no tie points; they are left out.",)
    if chunk.frame is not None:
        notes += (
            "Coordinates went into space: the map's scale remains, and heights went out as if "
            "above the ellipsoid.",
        )
    return notes


def _sensors(interiors: Mapping[str, FrameInterior]) -> Element:
    """Every frame camera as a sensor."""
    sensors = Element("sensors", next_id=str(len(interiors)))
    for number, (name, one) in enumerate(interiors.items()):
        sensor = add(sensors, "sensor")
        sensor.attrib.update(id=str(number), label=name, type="frame")
        column, row = one.principal_point_px
        width, height = one.size_px or (round(2 * column), round(2 * row))
        size = {"width": str(width), "height": str(height)}
        add(sensor, "resolution").attrib.update(size)
        calibration = add(sensor, "calibration")
        calibration.attrib.update({"type": "frame", "class": "adjusted"})
        add(calibration, "resolution").attrib.update(size)
        # Metashape names the tangential terms the other way round than OpenCV.
        values = {
            "f": one.focal_px,
            "cx": column - width / 2,
            "cy": row - height / 2,
            "b1": one.affinity_px,
            "b2": one.skew_px,
            **{f"k{n}": value for n, value in enumerate(one.radial[:RADIAL_TERMS], 1)},
            "p1": one.tangential[1],
            "p2": one.tangential[0],
        }
        for tag, value in values.items():
            add(calibration, tag, digits([value]))
    return sensors


def _orient(
    camera: Element, frame: FrameCamera, chunk: Chunk, sigma: tuple[float, float, float] | None
) -> None:
    """Chunk from camera, and the covariance of its centre in the chunk."""
    rotation, centre = frame.with_rotation_and_centre()
    turn = chunk.turn_at(centre)
    matrix = np.eye(4)
    matrix[:3, :3] = turn @ rotation.T
    matrix[:3, 3] = chunk.from_object(centre[None])[0]
    add(camera, "transform", digits(matrix.ravel()))
    if sigma is not None:
        covariance = turn @ np.diag(np.square(sigma)) @ turn.T
        add(camera, "location_covariance", digits(covariance.ravel()))


def _markers(block: ExchangeBlock, ids: dict[str, int]) -> tuple[Element, Element]:
    """Surveyed points, and where they are measured."""
    numbers = {name: str(number) for number, name in enumerate(block.points)}
    markers = Element("markers", next_id=str(len(numbers)), next_group_id="0")
    for name, point in block.points.items():
        marker = add(markers, "marker")
        marker.attrib.update(id=numbers[name], label=name)
        values = dict(zip("xyz", point.position, strict=True))
        if point.sigma_m is not None:
            values |= dict(zip(("sx", "sy", "sz"), point.sigma_m, strict=True))
        reference = add(marker, "reference")
        reference.attrib.update({key: digits([value]) for key, value in values.items()})
        reference.set("enabled", "true" if point.role == "control" else "false")
    frames = Element("frames", next_id="1")
    frame = add(frames, "frame")
    frame.set("id", "0")
    inside = add(frame, "markers")
    for name, number in numbers.items():
        own = [one for one in block.measurements if one.point_id == name and one.photo_id in ids]
        marker = add(inside, "marker") if own else None
        for one in own:
            assert marker is not None
            marker.set("marker_id", number)
            add(marker, "location").attrib.update(
                camera_id=str(ids[one.photo_id]),
                pinned="true",
                x=digits([one.column]),
                y=digits([one.row]),
            )
    return markers, frames


def _close(whole: Element, chunk: Chunk, block: ExchangeBlock) -> None:
    """Transform, CRS and accuracy."""
    transform = add(whole, "transform")
    add(transform, "rotation", digits(chunk.rotation.ravel()))
    add(transform, "translation", digits(chunk.translation))
    add(transform, "scale", "1.0")
    wkt = LOCAL if not block.crs else map_crs(block.crs, Path(CAMERAS)).to_wkt("WKT1_GDAL")
    add(whole, "reference", wkt)
    sigmas = [one.sigma_px for one in block.measurements if one.sigma_px is not None]
    if sigmas:
        accuracy = add(add(whole, "settings"), "property")
        accuracy.set("name", "accuracy_projections")
        accuracy.set("value", digits([float(np.median(sigmas))]))


def _write_opk(path: Path, block: ExchangeBlock, frames: Mapping[str, FrameCamera]) -> None:
    """Orientations as Metashape's export of cameras lists them."""
    lines: list[str] = []
    for name, frame in frames.items():
        _, _, exterior = from_frame_camera(frame)
        if exterior is not None:
            angles = np.degrees(exterior.angles)
            matrix = exterior.object_from_image.T.ravel()
            values = [*exterior.centre, *angles, *matrix]
            cells = [block.photos[name].file, *(digits([value]) for value in values)]
            lines.append("\t".join(cells))
    matrix = ", ".join(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))
    head = [f"# Cameras ({len(lines)})", f"# PhotoID, X, Y, Z, Omega, Phi, Kappa, {matrix}"]
    path.write_text("\n".join([*head, *lines]) + "\n", encoding="utf-8")


METASHAPE = ExchangeFormat(
    name="metashape",
    title="Agisoft Metashape",
    conventions=Conventions(
        pixels="column right, row down, from the outer corner of the first pixel",
        object_space="chunk coordinates, carried by the chunk's (or component's) transform into "
        "geocentric metres of the CRS's own datum, or into local ones; markers in the CRS",
        rotation="4 x 4 by rows: chunk from camera (x right, y down, z forwards); OPK list: "
        "R = Rx(omega) Ry(phi) Rz(kappa) in degrees, r11 to r33 its transpose",
        camera="f, cx, cy (from the middle of the scan), b1, b2 in pixels; k1 to k4; p1, p2 "
        "the other way round than OpenCV",
        sigmas="points, perspective centres; one for all measurements",
        lost="tie points, fiducials, deviations of angles, k5",
        tested="markers, cameras and chunk transforms that PhotoScan 1.2 and Metashape 1.5 wrote; "
        "the OPK list by description alone",
    ),
    holds="frame",
    write=write_metashape,
    read=read_metashape,
    default_name="metashape",
)
"""Metashape's XML."""
