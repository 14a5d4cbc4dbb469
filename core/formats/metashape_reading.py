"""Metashape's cameras, markers and OPK lists read into an exchanged block."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pyproj import CRS
from pyproj.exceptions import CRSError
from scipy.spatial.transform import Rotation as Turn

from core.arrays import Position, Rotation
from core.errors import ExchangeError
from core.formats.exchange import (
    ExchangeBlock,
    ExchangeMeasurement,
    ExchangePhoto,
    ExchangePoint,
    FrameInterior,
    Triple,
)
from core.formats.frame_interiors import exchange_camera, exchange_photo, named_photos
from core.formats.records import read_records
from core.formats.xml_files import AGAIN, Element, child, number_of, numbers_in, read_xml, trimmed
from core.geometry.crs import horizontal
from core.geometry.exterior import ExteriorOrientation
from core.geometry.map_in_space import MapInSpace, crs_text, geographic_of, map_in_space
from core.said import say

# source: matrices of 3 x 3 and 4 x 4.
NINE, SIXTEEN = 9, 16
OPK_COLUMNS = 7  # source: Metashape's export; label, X, Y, Z, omega, phi, kappa.


def read_metashape(path: Path) -> ExchangeBlock:
    """Read a folder of Metashape's XML files, one of them, or an OPK list.

    Raises:
        ExchangeError: Damaged, several chunks, unknown cameras or markers, impossible values.
        ProjectError: An OPK list that is none.
    """
    if path.is_dir():
        files = sorted(path.glob("*.xml"))
        if not files:
            raise ExchangeError(
                path, "It holds no XML of Metashape.", "Export cameras and markers as XML."
            )
        blocks = [_read_document(file) for file in files]
        return _joined(blocks, path)
    if path.suffix.lower() == ".xml":
        return _read_document(path)
    return _read_opk(path)


def _joined(blocks: list[ExchangeBlock], path: Path) -> ExchangeBlock:
    """Cameras of the first file that orients photos, all points and measurements."""
    first = max(blocks, key=lambda one: sum(p.exterior is not None for p in one.photos.values()))
    if len({one.crs for one in blocks if one.points or one.photos}) > 1:
        raise ExchangeError(
            path, "Its files are in several CRS.", "Read the one you want by itself."
        )
    points = {name: point for one in blocks for name, point in one.points.items()}
    measured = {(m.point_id, m.photo_id): m for one in blocks for m in one.measurements}
    notes = tuple(dict.fromkeys(note for one in blocks for note in one.notes))
    photos = {name: photo for one in (first, *blocks) for name, photo in one.photos.items()}
    photos |= first.photos
    cameras = {name: camera for one in (*blocks, first) for name, camera in one.cameras.items()}
    return replace(
        first,
        cameras=cameras,
        photos=photos,
        points=points,
        measurements=tuple(measured.values()),
        notes=notes,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Similarity:
    """A chunk's or component's transform: geocentric (or local) from chunk."""

    scale: float
    rotation: Rotation
    translation: Position


def _read_document(path: Path) -> ExchangeBlock:
    """One XML file."""
    root = read_xml(path, "document")
    chunks = root.findall("chunk")
    if len(chunks) != 1:
        raise ExchangeError(
            path,
            "It holds {count:# chunk|# chunks}, not one.",
            "Export the chunk you want by itself.",
            count=len(chunks),
        )
    chunk = chunks[0]
    crs, frame = _crs(chunk, path)
    notes: tuple[str, ...] = ()
    interiors = _interiors(chunk, path)
    names = {key: label for key, (label, _) in interiors.items()}
    labels: dict[str, str] = {}
    photos: list[ExchangePhoto] = []
    transforms = _transforms(chunk, path)
    for camera in chunk.iterfind("cameras//camera"):
        label, key = camera.get("label", ""), camera.get("id", "")
        sensor = camera.get("sensor_id", "")
        if not label or not key or key in labels or (sensor and sensor not in interiors):
            raise ExchangeError(
                path, "Camera {key} has no label, no sensor, or is there twice.", AGAIN, key=key
            )
        interior = interiors[sensor][1] if sensor else None
        photo = exchange_photo(label, names.get(sensor, ""), interior)
        own = transforms.get(camera.get("component_id", ""), transforms.get(""))
        photo = _oriented(photo, camera, interior, own, frame, path)
        labels[key] = photo.photo_id
        photos.append(photo)
    points, keys = _points(chunk, path)
    loose = [p.photo_id for p in photos if p.exterior is None]
    if loose and len(loose) < len(photos):
        notes += (say("Came without orientation: {photos}.", photos=loose),)
    cameras = {label: exchange_camera(label, one) for label, one in interiors.values() if one}
    measured = _measurements(chunk, keys, labels, path)
    return ExchangeBlock(crs, cameras, named_photos(photos, path), points, measured, notes=notes)


def _crs(chunk: Element, path: Path) -> tuple[str, MapInSpace | None]:
    """CRS of the chunk, and geocentric coordinates of its datum; none where it is local."""
    text = trimmed_text(chunk.find("reference"))
    if not text or text.startswith("LOCAL_CS"):
        return "", None
    try:
        crs = CRS.from_wkt(text)
    except CRSError as error:
        raise ExchangeError(
            path, "Its CRS cannot be read ({error}).", AGAIN, error=error
        ) from error
    plane = horizontal(crs)
    if not plane.is_projected:
        raise ExchangeError(
            path,
            "Its coordinates are in {crs}, not on a map in metres.",
            "Convert the chunk's reference to a projected CRS and export it again.",
            crs=crs.name,
        )
    # Metashape knows no shift of datum here: the frame is that of the map's own ellipsoid.
    return crs_text(plane), map_in_space(plane, geographic_of(plane))


def trimmed_text(element: Element | None) -> str:
    """Text without blanks around it; quotation marks stay, as WKT ends with them."""
    return "" if element is None else (element.text or "").strip()


def _interiors(chunk: Element, path: Path) -> dict[str, tuple[str, FrameInterior | None]]:
    """Label and frame camera of every sensor, adjusted before initial; None if not calibrated."""
    found: dict[str, tuple[str, FrameInterior | None]] = {}
    used: set[str] = set()
    for sensor in chunk.iterfind("sensors/sensor"):
        key = sensor.get("id", "")
        label = sensor.get("label") or f"sensor{key}"
        label = label if label not in used else f"{label}-{key}"
        used.add(label)
        known = {one.get("class"): one for one in sensor.iterfind("calibration")}
        best = known.get("adjusted", known.get("initial"))
        kinds = {sensor.get("type", "frame"), *(one.get("type", "frame") for one in known.values())}
        if kinds != {"frame"}:
            raise ExchangeError(
                path, "{label} is no frame camera.", "Take it out of the chunk.", label=label
            )
        found[key] = (label, None if best is None else _interior(sensor, best, path))
    return found


def _interior(sensor: Element, calibration: Element, path: Path) -> FrameInterior:
    """One calibration; what is not there is nought."""
    size = calibration.find("resolution")
    size = child(sensor, "resolution", path) if size is None else size
    width, height = (int(_attribute(size, key, path)) for key in ("width", "height"))

    def value(tag: str) -> float:
        return 0.0 if calibration.find(tag) is None else number_of(calibration, tag, path)

    focal = number_of(calibration, "f", path)
    if focal <= 0 or width <= 0 or height <= 0:
        raise ExchangeError(path, "A sensor has no size or no principal distance.", AGAIN)
    return FrameInterior(
        (width, height),
        focal,
        (value("cx") + width / 2, value("cy") + height / 2),
        value("b1"),
        value("b2"),
        tuple(value(f"k{number}") for number in (1, 2, 3, 4)),
        (value("p2"), value("p1")),
    )


def _transforms(chunk: Element, path: Path) -> dict[str, _Similarity]:
    """Transforms by component; that of the chunk without a name."""
    found: dict[str, _Similarity] = {}
    places = [("", chunk)]
    places += [(one.get("id", ""), one) for one in chunk.iterfind("components/component")]
    for key, place in places:
        transform = place.find("transform")
        if transform is not None and transform.find("rotation") is not None:
            rotation = _whole(transform, "rotation", NINE, path).reshape(3, 3)
            scale = number_of(transform, "scale", path)
            if scale <= 0 or not np.allclose(rotation @ rotation.T, np.eye(3), atol=STRAIGHT):
                raise ExchangeError(path, "The chunk's transform is no similarity.", AGAIN)
            found[key] = _Similarity(scale, rotation, _whole(transform, "translation", 3, path))
    return found


STRAIGHT = 1e-6  # design: seventeen digits are written; anything beyond this is no rotation.


def _whole(element: Element, tag: str, count: int, path: Path) -> np.ndarray:
    """Finite numbers of a child."""
    return np.array(numbers_in(trimmed(child(element, tag, path)), count, tag, path))


def _oriented(
    photo: ExchangePhoto,
    camera: Element,
    interior: FrameInterior | None,
    chunk: _Similarity | None,
    frame: MapInSpace | None,
    path: Path,
) -> ExchangePhoto:
    """A photo with its orientation, where camera and chunk have a transform."""
    if camera.find("transform") is None or chunk is None:
        return photo
    matrix = _whole(camera, "transform", SIXTEEN, path).reshape(4, 4)
    if not np.allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=STRAIGHT):
        raise ExchangeError(path, "{name} has no rotation.", AGAIN, name=photo.file)
    place = chunk.scale * chunk.rotation @ matrix[:3, 3] + chunk.translation
    turn = chunk.rotation
    if frame is not None:
        place = frame.to_object(place[None])[0]
        turn = frame.turn_at(place).T @ turn
    if not np.isfinite(place).all():
        raise ExchangeError(path, "{name} lies outside its CRS.", AGAIN, name=photo.file)
    sigma = None
    if camera.find("location_covariance") is not None:
        covariance = _whole(camera, "location_covariance", NINE, path).reshape(3, 3)
        variances = np.diag(turn @ covariance @ turn.T).clip(0)
        east, north, up = (chunk.scale * np.sqrt(variances)).tolist()
        sigma = (east, north, up)
    rotation = Turn.from_matrix(turn @ matrix[:3, :3]).as_matrix().T
    return exchange_photo(photo.file, photo.camera, interior, rotation, place, sigma)


def _points(chunk: Element, path: Path) -> tuple[dict[str, ExchangePoint], dict[str, str]]:
    """Markers with coordinates, and the labels of all by their number."""
    points: dict[str, ExchangePoint] = {}
    labels: dict[str, str] = {}
    for marker in chunk.iterfind("markers//marker"):
        key, label = marker.get("id", ""), marker.get("label", "")
        if not key or not label or key in labels or label in labels.values():
            raise ExchangeError(
                path, "Marker {key} has no label or is there twice.", AGAIN, key=key
            )
        labels[key] = label
        reference = marker.find("reference")
        if reference is not None and all(axis in reference.attrib for axis in "xyz"):
            x, y, z = (_attribute(reference, axis, path) for axis in "xyz")
            role = "check" if reference.get("enabled") in NO else "control"
            points[label] = ExchangePoint(label, (x, y, z), _sigmas(reference, path), role)
    return points, labels


NO = ("false", "0")
"""As the versions of Metashape write it."""


def _sigmas(reference: Element, path: Path) -> Triple | None:
    """sx, sy, sz, or one for all axes, or none."""
    if all(key in reference.attrib for key in ("sx", "sy", "sz")):
        east, north, up = (_attribute(reference, key, path) for key in ("sx", "sy", "sz"))
        return east, north, up
    if "sxyz" in reference.attrib:
        one = _attribute(reference, "sxyz", path)
        return one, one, one
    return None


def _measurements(
    chunk: Element, markers: dict[str, str], cameras: dict[str, str], path: Path
) -> tuple[ExchangeMeasurement, ...]:
    """Projections of markers; those that Metashape calls invalid are none."""
    settings = chunk.find("settings/property[@name='accuracy_projections']")
    sigma = None if settings is None else _attribute(settings, "value", path)
    found: list[ExchangeMeasurement] = []
    for marker in chunk.iterfind("frames/frame/markers/marker"):
        point = markers.get(marker.get("marker_id", ""))
        for location in marker.iterfind("location"):
            photo = cameras.get(location.get("camera_id", ""))
            if point is None or photo is None:
                raise ExchangeError(
                    path,
                    "Marker {marker} is measured in camera {camera}; one of both is not there.",
                    AGAIN,
                    marker=marker.get("marker_id", ""),
                    camera=location.get("camera_id", ""),
                )
            if location.get("valid") not in NO:
                column, row = (_attribute(location, axis, path) for axis in "xy")
                found.append(ExchangeMeasurement(point, photo, column, row, sigma))
    return tuple(found)


def _attribute(element: Element, key: str, path: Path) -> float:
    """A finite number."""
    return numbers_in(element.get(key, ""), 1, f"{element.tag} {key}", path)[0]


def _read_opk(path: Path) -> ExchangeBlock:
    """An OPK list: orientations alone."""
    photos: list[ExchangePhoto] = []
    for record in read_records(path, _cells):
        omega, phi, kappa = np.radians(record.triple(OPK_COLUMNS - 3)).tolist()
        exterior = ExteriorOrientation(np.array(record.triple(1)), omega, phi, kappa)
        photos.append(replace(exchange_photo(record.text(0), "", None), exterior=exterior))
    if not photos:
        raise ExchangeError(path, "It holds no orientations.", "Export cameras as OPK text.")
    return ExchangeBlock("", {}, named_photos(photos, path))


def _cells(line: str) -> list[str]:
    """Tabs part cells where there are any: labels may hold blanks."""
    return line.split("\t") if "\t" in line else line.split()
