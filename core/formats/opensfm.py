"""OpenSfM's reconstruction, reference, points and tracks; ODM's gcp_list.txt.

FORMATS 4.10. Coordinates are east, north, up (metres) at a reference place on the ellipsoid of
WGS 84; places in a scan count from its middle in parts of its longer side, y down.

Pixels count from the centre of the first pixel, as OpenSfM has them; heights are always numbers.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS
from scipy.spatial.transform import Rotation as Turn

from core.arrays import PixelPoints
from core.errors import ExchangeError
from core.formats.colmap import SIDECAR, read_sidecar
from core.formats.colmap_files import GREY
from core.formats.exchange import (
    Conventions,
    ExchangeBlock,
    ExchangeFormat,
    ExchangeMeasurement,
    ExchangePhoto,
    ExchangePoint,
    ExchangeTies,
    FrameInterior,
)
from core.formats.frame_interiors import (
    exchange_camera,
    exchange_photo,
    frame_photos,
    frames_with_origin,
    named_photos,
    size_of,
    where_any,
    without_orientation,
)
from core.formats.records import read_json, read_records, read_text, write_json
from core.formats.rotations import triple_of
from core.formats.words import in_words
from core.formats.xml_files import AGAIN, digits
from core.frames import HALF_PIXEL
from core.geometry.map_in_space import (
    WGS84,
    MapInSpace,
    Origin,
    crs_text,
    map_crs,
    map_in_space,
    origin_of,
    zone_of,
)
from core.said import say

RECONSTRUCTION, REFERENCE = "reconstruction.json", "reference_lla.json"
POINTS, TRACKS = "ground_control_points.json", "tracks.csv"
VERSION = "OPENSFM_TRACKS_VERSION_v2"
# design: of no meaning to an adjustment; that of a keypoint of some pixels.
SCALE = 0.001
LENSES = {
    "perspective": ("k1", "k2"),
    "simple_radial": ("k1",),
    "radial": ("k1", "k2"),
    "brown": ("k1", "k2", "k3"),
}
"""Radial terms of the projections that are frame cameras."""

UTM = re.compile(r"WGS84\s+UTM\s+(\d{1,2})([NS])", re.IGNORECASE)
"""First line that names a zone."""
NAME = 6  # source: ODM's documentation; after three coordinates, two of the pixel, and the image.
ZONES = {"N": 32600, "S": 32700}  # source: codes of EPSG.


def write_opensfm(folder: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write the files of a project.

    Returns:
        What was left out, a sentence each.

    Raises:
        CrsError: The CRS is no map in metres.
        ExchangeError: No photo is oriented.
    """
    photos = frame_photos(block)
    oriented, middle = frames_with_origin(photos, folder)
    plane, datum = map_crs(block.crs, folder), CRS.from_epsg(WGS84)
    longitude, latitude, _ = origin_of(plane, datum, middle)
    space = map_in_space(plane, datum, (longitude, latitude, 0.0))
    reference = {"latitude": latitude, "longitude": longitude, "altitude": 0.0}
    shots: dict[str, Any] = {}
    for name, frame in oriented.items():
        rotation, centre = frame.with_rotation_and_centre()
        turn = rotation @ space.turn_at(centre).T
        shift = -turn @ space.from_object(centre[None])[0]
        shots[block.photos[name].file] = {
            "rotation": Turn.from_matrix(turn).as_rotvec().tolist(),
            "translation": shift.tolist(),
            "camera": photos.camera[name],
        }
    cameras = {name: _written(one) for name, one in photos.interiors.items()}
    coordinates: dict[str, Any] = {}
    names = _track_names(block.ties)
    if block.ties.positions is not None:
        known = np.flatnonzero(np.isfinite(block.ties.positions).all(axis=1))
        places = space.from_object(block.ties.positions[known])
        for number, place in zip(known.tolist(), places.tolist(), strict=True):
            coordinates[names[number]] = {"color": [float(GREY)] * 3, "coordinates": place}
    whole = {"cameras": cameras, "shots": shots, "points": coordinates, "reference_lla": reference}
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / RECONSTRUCTION, [whole])
    write_json(folder / REFERENCE, reference)
    write_json(
        folder / POINTS, {"points": _surveyed(block, space, photos.interiors, photos.camera)}
    )
    write_json(folder / SIDECAR, {"crs": block.crs, "origin": [0.0, 0.0, 0.0]})
    _write_tracks(folder / TRACKS, block, photos.interiors, photos.camera)
    notes = without_orientation(name for name in block.photos if name not in oriented)
    return (
        *notes,
        "Coordinates went into space: the map's scale remains, and heights went out as if above "
        "the ellipsoid.",
    )


def _written(one: FrameInterior) -> dict[str, Any]:
    """A brown camera: it holds any lens of a block but skew and k4."""
    (width, height), (column, row) = size_of(one), one.principal_point_px
    unit = max(width, height)
    k1, k2, k3 = (*one.radial, 0.0, 0.0, 0.0)[:3]
    return {
        "projection_type": "brown",
        "width": width,
        "height": height,
        "focal_x": (one.focal_px + one.affinity_px) / unit,
        "focal_y": one.focal_px / unit,
        "c_x": (column - width / 2) / unit,
        "c_y": (row - height / 2) / unit,
        "k1": k1,
        "k2": k2,
        "p1": one.tangential[0],
        "p2": one.tangential[1],
        "k3": k3,
    }


def _normalised(pixels: PixelPoints, one: FrameInterior) -> PixelPoints:
    """From the middle of the scan, in parts of its longer side."""
    size = np.array(size_of(one), dtype=np.float64)
    return (pixels - size / 2) / size.max()


def _pixels(places: PixelPoints, one: FrameInterior) -> PixelPoints:
    """Back."""
    size = np.array(size_of(one), dtype=np.float64)
    return places * size.max() + size / 2


def _surveyed(
    block: ExchangeBlock, space: MapInSpace, interiors: Any, camera: Any
) -> list[dict[str, Any]]:
    """Surveyed points with what is measured of them."""
    found: dict[str, dict[str, Any]] = {}
    for name, point in block.points.items():
        place = np.array([point.position])
        longitude, latitude, _ = space.degrees(place)[0].tolist()
        position = {"latitude": latitude, "longitude": longitude, "altitude": point.position[2]}
        found[name] = {"id": name, "position": position, "observations": []}
    for one in block.measurements:
        if one.point_id in found and one.photo_id in camera:
            pixel = np.array([[one.column, one.row]])
            projection = _normalised(pixel, interiors[camera[one.photo_id]])[0].tolist()
            shot = block.photos[one.photo_id].file
            found[one.point_id]["observations"].append({"shot_id": shot, "projection": projection})
    return list(found.values())


def _track_names(ties: ExchangeTies) -> list[str]:
    """Names of the tie points, or their numbers."""
    count = int(ties.point.max()) + 1 if len(ties.point) else 0
    return list(ties.names) or [str(number) for number in range(count)]


def _write_tracks(path: Path, block: ExchangeBlock, interiors: Any, camera: Any) -> None:
    """Rays of the tie points."""
    ties, names, lines = block.ties, _track_names(block.ties), [VERSION]
    numbers = dict.fromkeys(ties.photo_ids, 0)
    for point, photo, pixel in zip(ties.point, ties.photo, ties.pixels, strict=True):
        name = ties.photo_ids[int(photo)]
        if name in camera:
            x, y = _normalised(pixel[None], interiors[camera[name]])[0].tolist()
            cells = [block.photos[name].file, names[int(point)], numbers[name], x, y, SCALE]
            lines.append("\t".join(str(cell) for cell in [*cells, *[GREY] * 3, -1, -1]))
            numbers[name] += 1
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def read_opensfm(path: Path) -> ExchangeBlock:
    """Read a project's folder, or one reconstruction.

    Raises:
        ExchangeError: Missing, damaged, cameras that are no frame cameras, impossible values.
    """
    file = path / RECONSTRUCTION if path.is_dir() else path
    try:
        whole = read_json(file)
        return _read(file, whole)
    except (ValueError, KeyError, TypeError, AttributeError, IndexError, RecursionError) as error:
        raise ExchangeError(
            file,
            "It is no reconstruction of OpenSfM ({error}).",
            "Choose a project with a whole reconstruction.json.",
            error=repr(error)[:120],
        ) from error


def _read(file: Path, whole: Any) -> ExchangeBlock:
    """All parts."""
    first = whole[0]
    interiors = {str(name): _interior(one, file) for name, one in first["cameras"].items()}
    reference = first.get("reference_lla")
    if reference is None and (file.parent / REFERENCE).exists():
        reference = read_json(file.parent / REFERENCE)
    crs, space = _space(reference, file)
    photos: list[ExchangePhoto] = []
    for shot, one in first["shots"].items():
        turn = Turn.from_rotvec(_finite(one["rotation"], 3)).as_matrix()
        centre = -turn.T @ _finite(one["translation"], 3)
        if space is not None:
            centre = space.to_object(centre[None])[0]
            turn = turn @ space.turn_at(centre)
        camera = str(one["camera"])
        photos.append(exchange_photo(str(shot), camera, interiors[camera], turn, centre))
    cameras = {name: exchange_camera(name, one) for name, one in interiors.items()}
    block = ExchangeBlock(crs, cameras, named_photos(photos, file))
    points, measurements = _read_points(file.parent / POINTS, block, interiors, space)
    notes = () if len(whole) == 1 else ("Of several reconstructions the first was taken.",)
    if space is None:
        notes += ("It names no place on the Earth: coordinates are those of its own model.",)
    placeless = sorted({one.point_id for one in measurements} - set(points))
    notes += where_any(
        placeless,
        say(
            "{names}: without a place or its height, so their measurements count only where the "
            "block knows these points.",
            names=placeless,
        ),
    )
    ties = _read_tracks(file.parent / TRACKS, block, interiors, space, first.get("points", {}))
    return ExchangeBlock(crs, cameras, block.photos, points, measurements, ties, notes)


def _finite(values: Any, count: int) -> np.ndarray:
    """So many finite numbers."""
    found = np.array([float(value) for value in values])
    if found.shape != (count,) or not np.isfinite(found).all():
        raise ValueError(f"{values} are not {count} numbers")
    return found


def _interior(one: Any, file: Path) -> FrameInterior:
    """A frame camera of the kinds that are one."""
    kind = one["projection_type"]
    if kind not in LENSES:
        raise ExchangeError(
            file,
            "It has a camera of the kind {kind}.",
            "Frame cameras alone are taken over: perspective, simple_radial, radial, brown.",
            kind=str(kind)[:60],
        )
    width, height = int(one["width"]), int(one["height"])
    unit = max(width, height)
    fx = float(one["focal_x"] if "focal_x" in one else one["focal"]) * unit
    fy = float(one["focal_y"] if "focal_y" in one else one["focal"]) * unit
    cx, cy = float(one.get("c_x", 0.0)) * unit, float(one.get("c_y", 0.0)) * unit
    radial = tuple(float(one.get(key, 0.0)) for key in LENSES[kind])
    tangential = (float(one.get("p1", 0.0)), float(one.get("p2", 0.0)))
    values = [fx, fy, cx, cy, *radial, *tangential]
    _finite(values, len(values))
    if min(width, height) <= 0 or min(fx, fy) <= 0:
        raise ValueError("size and focal must be above nought")
    point = (width / 2 + cx, height / 2 + cy)
    return FrameInterior((width, height), fy, point, fx - fy, 0.0, radial, tangential)


def _space(reference: Any, file: Path) -> tuple[str, MapInSpace | None]:
    """CRS and frame; UTM where no note of ours names the CRS; none where no place is named."""
    if reference is None:
        return "", None
    keys = ("longitude", "latitude", "altitude")
    longitude, latitude, height = _finite([reference[key] for key in keys], 3).tolist()
    if (longitude, latitude) == (0.0, 0.0):
        return "", None
    origin: Origin = (longitude, latitude, height)
    crs = read_sidecar(file.parent).crs or zone_of(np.array([origin]))
    return crs, map_in_space(map_crs(crs, file), origin=origin)


def _read_points(
    path: Path, block: ExchangeBlock, interiors: dict[str, FrameInterior], space: MapInSpace | None
) -> tuple[dict[str, ExchangePoint], tuple[ExchangeMeasurement, ...]]:
    """Surveyed points, where there is such a file and a place on the Earth."""
    points: dict[str, ExchangePoint] = {}
    measured: list[ExchangeMeasurement] = []
    if not path.exists() or space is None:
        return points, ()
    files = {photo.file: name for name, photo in block.photos.items()}
    for one in read_json(path)["points"]:
        name, place = str(one["id"]), one.get("position") or {}
        known = [place.get(key) for key in ("longitude", "latitude", "altitude")]
        if None not in known:
            degrees = _finite(known, 3)
            points[name] = ExchangePoint(name, triple_of(space.from_degrees(degrees[None])[0]))
        for seen in one.get("observations", ()):
            if seen["shot_id"] not in files:
                raise ExchangeError(
                    path,
                    "{name} is measured in {shot}, which is not there.",
                    AGAIN,
                    name=name,
                    shot=str(seen["shot_id"])[:60],
                )
            photo = files[seen["shot_id"]]
            interior = interiors[block.photos[photo].camera]
            pixel = _pixels(_finite(seen["projection"], 2)[None], interior)[0].tolist()
            measured.append(ExchangeMeasurement(name, photo, pixel[0], pixel[1]))
    return points, tuple(measured)


def _read_tracks(
    path: Path,
    block: ExchangeBlock,
    interiors: dict[str, FrameInterior],
    space: MapInSpace | None,
    known: Any,
) -> ExchangeTies:
    """Rays of tracks.csv; of those in photos that are oriented."""
    if not path.exists():
        return ExchangeTies.none()
    files = {photo.file: name for name, photo in block.photos.items()}
    index = {name: number for number, name in enumerate(block.photos)}
    names: dict[str, int] = {}
    rays: list[tuple[int, int, list[float]]] = []
    for line in read_text(path).splitlines():
        cells = line.split("\t")
        if line.startswith("OPENSFM_TRACKS_VERSION") or not line or cells[0] not in files:
            continue
        photo = files[cells[0]]
        place = _finite(cells[3:5], 2)[None]
        pixel = _pixels(place, interiors[block.photos[photo].camera])[0].tolist()
        rays.append((names.setdefault(cells[1], len(names)), index[photo], pixel))
    if not rays:
        return ExchangeTies.none()
    positions = np.full((len(names), 3), np.nan)
    for name, number in names.items():
        if name in known:
            positions[number] = _finite(known[name]["coordinates"], 3)
    stands = np.isfinite(positions).all(axis=1)
    if space is not None and stands.any():
        positions[stands] = space.to_object(positions[stands])
    return ExchangeTies(
        tuple(block.photos),
        np.array([ray[0] for ray in rays]),
        np.array([ray[1] for ray in rays]),
        np.array([ray[2] for ray in rays]),
        tuple(names),
        positions if stands.any() else None,
    )


OPENSFM = ExchangeFormat(
    name="opensfm",
    title="OpenSfM",
    conventions=Conventions(
        pixels="from the middle of the scan, in parts of its longer side, y down",
        object_space="east, north, up at reference_lla (WGS 84), metres; heights as they stand; "
        "gruber.json names the CRS, UTM otherwise",
        rotation="angle-axis: camera (x right, y down, z forwards) from object; every photo is "
        "turned by the map's axes at its own place",
        camera="brown: focal_x, focal_y, c_x, c_y in parts of the longer side; k1 to k3, p1, p2 as "
        "OpenCV has them",
        lost="standard deviations, roles, fiducials, photos that are not oriented, skew",
        tested="reconstructions that OpenSfM and ODM wrote; tracks.csv and "
        "ground_control_points.json by description alone",
    ),
    holds="upright",
    write=write_opensfm,
    read=read_opensfm,
    default_name="opensfm",
)
"""OpenSfM's project."""


def write_odm(path: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write the list.

    Returns:
        What was left out, a sentence each.

    Raises:
        CrsError: The CRS is no map in metres.
        ExchangeError: Nothing is measured.
    """
    block, renamed = in_words(block)
    plane = map_crs(block.crs, path)
    authority = plane.to_authority()
    lines = [":".join(authority) if authority else plane.to_proj4()]
    for one in block.measurements:
        if one.point_id in block.points and one.photo_id in block.photos:
            place = digits(block.points[one.point_id].position)
            pixel = digits([one.column - HALF_PIXEL, one.row - HALF_PIXEL])
            lines.append(
                "\t".join(
                    [*place.split(), *pixel.split(), block.photos[one.photo_id].file, one.point_id]
                )
            )
    if len(lines) == 1:
        raise ExchangeError(
            path, "No surveyed point is measured in any photo.", "Measure some first."
        )
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    seen = {one.point_id for one in block.measurements}
    without = [name for name in block.points if name not in seen]
    notes = renamed + where_any(
        without, say("Measured nowhere, and so left out: {names}.", names=without)
    )
    checks = [name for name, point in block.points.items() if point.role == "check"]
    return notes + where_any(
        checks,
        say("ODM has control points alone; check points went out too: {names}.", names=checks),
    )


def read_odm(path: Path) -> ExchangeBlock:
    """Read a list.

    Raises:
        ProjectError: No text, or lines without numbers.
        ExchangeError: No CRS, no points, one name at two places.
    """
    records = read_records(path)
    if not records:
        raise ExchangeError(path, "It is empty.", "Export the list again.")
    crs = _crs(path, " ".join(records[0].cells))
    points: dict[str, ExchangePoint] = {}
    places: dict[tuple[float, float, float], str] = {}
    photos: dict[str, ExchangePhoto] = {}
    measurements: list[ExchangeMeasurement] = []
    for record in records[1:]:
        place = record.triple(0)
        photo = exchange_photo(record.text(NAME - 1), "", None)
        if photos.setdefault(photo.photo_id, photo).file != photo.file:
            raise record.refused(
                "{name} would be two scans.", "Rename one of the two scans.", name=photo.photo_id
            )
        unnamed = places.get(place, str(len(places) + 1))
        name = record.cells[NAME] if len(record.cells) > NAME else unnamed
        places.setdefault(place, name)
        if points.setdefault(name, ExchangePoint(name, place)).position != place:
            raise record.refused(
                "Line {number}: {name} has two places.",
                "Rename one of the two, or take it away.",
                name=name,
            )
        column, row = record.value(3) + HALF_PIXEL, record.value(4) + HALF_PIXEL
        measurements.append(ExchangeMeasurement(name, photo.photo_id, column, row))
    if not points:
        raise ExchangeError(path, "It holds no points.", "Export the list again.")
    return ExchangeBlock(crs, {}, photos, points, tuple(measurements))


def _crs(path: Path, text: str) -> str:
    """CRS of the first line: UTM in words, a code, or PROJ's parameters."""
    zone = UTM.fullmatch(text.strip())
    if zone is not None:
        text = f"EPSG:{ZONES[zone[2].upper()] + int(zone[1])}"
    return crs_text(map_crs(text, path))


ODM = ExchangeFormat(
    name="odm",
    title="ODM gcp_list.txt",
    conventions=Conventions(
        pixels="column right, row down, from the centre of the first pixel",
        object_space="easting, northing, height in the CRS of the first line, metres",
        lost="orientations, cameras, tie points, roles, standard deviations, points that are "
        "measured nowhere",
        tested="a list written for ODM; its pixels are whole, so the half pixel rests on the "
        "description",
    ),
    holds="upright",
    write=write_odm,
    read=read_odm,
    default_name="gcp_list.txt",
    folder=False,
)
"""ODM's list of control points."""
