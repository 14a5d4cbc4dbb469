"""STAC: an item for every photo, with the fields of perspective imagery, view and projection.

The item says where a photo was taken and how it looked as other programs read it (`pers:`, a camera
whose pixels lie upright, its turn in the orientation), and the whole interior orientation in fields
of ours. An item spans the day, month or year of exposure; where nobody says it, the time of film.
"""

from calendar import monthrange
from collections.abc import Iterable, Mapping
from datetime import date
from pathlib import Path
from typing import Any, cast

import numpy as np

from core.doubts import Failure
from core.errors import ProjectError
from core.formats.exchange import (
    Conventions,
    ExchangeBlock,
    ExchangeCamera,
    ExchangeFormat,
    ExchangePhoto,
    from_frame_camera,
    places_of,
    upright_camera,
)
from core.formats.film_rays import principal_distance_mm
from core.formats.outlines import ground_outline, off_nadir
from core.formats.records import json_numbers, read_bytes, read_json, write_json
from core.formats.rotations import triple_of
from core.geometry.exterior import ExteriorOrientation
from core.geometry.map_in_space import MapInSpace, map_crs, map_in_space
from core.said import say

VERSION = "1.1.0"
EXTENSIONS = {
    "pers": "https://stac-extensions.github.io/perspective-imagery/v1.0.0/schema.json",
    "view": "https://stac-extensions.github.io/view/v1.0.0/schema.json",
    "proj": "https://stac-extensions.github.io/projection/v1.2.0/schema.json",
    "file": "https://stac-extensions.github.io/file/v2.1.0/schema.json",
}
"""Schemas of the fields that items bear."""
# source: Nadar's first photograph from the air; the last large film cameras.
FILM = date(1858, 1, 1), date(2015, 12, 31)
"""Between these days photos were taken on film."""
DAY = len("1938-05-16")
MONTHS = 12  # source: the calendar
SPAN = ("start_datetime", "end_datetime")
"""Fields of the time in which a photo was taken."""
CATALOG = "catalog.json"
ROOT = {"rel": "root", "href": f"./{CATALOG}", "type": "application/json"}
"""How an item leads to its catalogue."""
MATRIX = "gruber:pixel_from_image"
"""Our field: 2 x 3, pixels (outer corner) from image coordinates."""
NEEDED = ("pers:perspective_center", "pers:omega", "pers:phi", "pers:kappa")
"""Fields that say where a photo was taken."""
REMEDY = "Items have the fields of the perspective imagery extension."


def write_stac(path: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write a catalogue and an item for every photo into a folder.

    Returns:
        What was left out.

    Raises:
        CrsError: The block does not say its CRS: items lie on the Earth.
    """
    path.mkdir(parents=True, exist_ok=True)
    earth = map_in_space(map_crs(block.crs, path), near=places_of(block))
    items = [_item(block, photo, earth) for photo in block.photos.values()]
    write_catalog(path, "Archival aerial photos with their orientation", items)
    notes: list[str] = []
    if not all(photo.taken for photo in block.photos.values()):
        notes.append(say("Where `taken` is not given, items span the time of film."))
    if block.points or block.measurements or len(block.ties.point):
        notes.append(say("Items hold no points and no measurements."))
    return tuple(notes)


def write_catalog(path: Path, description: str, items: Iterable[Mapping[str, Any]]) -> None:
    """Write items into a folder, each by its id, and a catalogue that leads to them."""
    links = [ROOT]
    for item in items:
        name = f"{item['id']}.json"
        write_json(path / name, item)
        links.append({"rel": "item", "href": f"./{name}", "type": "application/geo+json"})
    catalog = {
        "type": "Catalog",
        "stac_version": VERSION,
        "id": "gruber",
        "description": description,
        "links": links,
    }
    write_json(path / CATALOG, catalog)


def day_span(first: date, last: date) -> dict[str, Any]:
    """Fields of the time from the beginning of a day to the end of another."""
    times = (f"{first}T00:00:00Z", f"{last}T23:59:59Z")
    return {"datetime": None, **dict(zip(SPAN, times, strict=True))}


def _item(block: ExchangeBlock, photo: ExchangePhoto, earth: MapInSpace) -> dict[str, Any]:
    geometry, box = _geometry(block, photo, earth)
    fields: dict[str, Any] = {
        **day_span(*_days(photo)),
        **_orientation(block, photo),
        **_interior(block, photo),
    }
    used = [key for key in ("pers", "view", "proj") if any(f.startswith(key + ":") for f in fields)]
    asset: dict[str, Any] = {"href": photo.file, "roles": ["data"], "title": "Scan"}
    scan = Path(photo.file)
    if scan.is_file():
        asset["file:size"] = scan.stat().st_size
        used.append("file")
    item: dict[str, Any] = {
        "type": "Feature",
        "stac_version": VERSION,
        "stac_extensions": [EXTENSIONS[key] for key in used],
        "id": photo.photo_id,
        "geometry": geometry,
        "properties": fields,
        "links": [ROOT],
        "assets": {"scan": asset},
    }
    if box is not None:
        item["bbox"] = box
    return item


def time_span(taken: str) -> tuple[date, date] | Failure:
    """First and last day of a day, month or year as ISO has it; without any, of film."""
    if not taken:
        return FILM
    parts = taken.split("-")
    try:
        year, month, day = (int(part) for part in (*parts, "1", "1")[:3])
        first = date(year, month, day)
    except (ValueError, OverflowError):
        return Failure("It is no date.")
    if len(parts) > 3 or not FILM[0] <= first <= FILM[1]:
        return Failure("No film was exposed then.")
    if len(parts) == 3:
        return first, first
    last_month = int(parts[1]) if len(parts) == 2 else MONTHS
    return first, date(year, last_month, monthrange(year, last_month)[1])


def _days(photo: ExchangePhoto) -> tuple[date, date]:
    """First and last day on which a photo may have been taken."""
    span = time_span(photo.taken)
    return FILM if isinstance(span, Failure) else span


def _taken(fields: Mapping[str, Any]) -> str:
    """The day, month or year that an item spans; empty where it spans more."""
    first, last = (str(fields.get(key) or fields.get("datetime") or "")[:DAY] for key in SPAN)
    parts = first.split("-")
    for known in range(len(parts), 0, -1):
        taken = "-".join(parts[:known])
        span = time_span(taken)
        if not isinstance(span, Failure) and (f"{span[0]}", f"{span[1]}") == (first, last):
            return taken
    return ""


def _geometry(
    block: ExchangeBlock, photo: ExchangePhoto, earth: MapInSpace
) -> tuple[dict[str, Any] | None, list[float] | None]:
    """Footprint, or the place of exposure, in degrees; nothing where the photo is not oriented."""
    if photo.exterior is None:
        return None, None
    ring = ground_outline(block, photo)
    plan = np.array([photo.exterior.centre[:2].tolist()] if ring is None else ring)
    degrees = earth.degrees(np.column_stack([plan, np.zeros(len(plan))]))[:, :2]
    box = [*degrees.min(axis=0).tolist(), *degrees.max(axis=0).tolist()]
    if ring is None:
        return {"type": "Point", "coordinates": degrees[0].tolist()}, box
    return {"type": "Polygon", "coordinates": [degrees.tolist()]}, box


def _orientation(block: ExchangeBlock, photo: ExchangePhoto) -> dict[str, Any]:
    """Fields of the orientation: of the upright camera where there is one."""
    exterior = photo.exterior
    if exterior is None:
        return {}
    if photo.pixel_from_image is not None and photo.camera in block.cameras:
        frame = upright_camera(photo, block.camera_of(photo.photo_id))
        if frame is not None:
            exterior = from_frame_camera(frame)[2] or exterior
    angles = np.degrees(exterior.angles).tolist()
    code = block.crs.partition(":")[2]
    named = block.crs.upper().startswith("EPSG:") and code.isdecimal()
    fields = {
        "pers:perspective_center": exterior.centre.tolist(),
        "pers:crs": int(code) if named else block.crs,
        **dict(zip(NEEDED[1:], angles, strict=True)),
        "pers:rotation_matrix": exterior.object_from_image.T.ravel().tolist(),
        "view:off_nadir": off_nadir(photo),
    }
    for key, sigma in (("m", photo.sigma_centre_m), ("rad", photo.sigma_angles)):
        if sigma is not None:
            fields[f"gruber:sigma_{key}"] = list(sigma)
    return fields


def _interior(block: ExchangeBlock, photo: ExchangePhoto) -> dict[str, Any]:
    """Fields of the camera."""
    camera = block.cameras.get(photo.camera)
    if camera is None or photo.pixel_from_image is None:
        return {}
    distance = principal_distance_mm(block, photo.photo_id)
    pixel = distance / photo.focal_px
    inside: dict[str, Any] = {"camera_id": camera.name, "focal_length": distance}
    frame = upright_camera(photo, camera)
    if frame is not None:
        across = distance / (frame.focal_px + frame.affinity_px)
        inside["pixel_spacing"] = [across, pixel]
    fields: dict[str, Any] = {}
    if camera.size_px is not None:
        columns, rows = camera.size_px
        inside["sensor_array_dimensions"] = [columns, rows]
        if frame is not None:
            column, row = frame.principal_point_px
            offset = [(column - columns / 2) * pixel, (rows / 2 - row) * pixel]
            inside["principal_point_offset"] = offset
        fields["proj:shape"] = [rows, columns]
    return fields | {
        "pers:interior_orientation": inside,
        MATRIX: photo.pixel_from_image.tolist(),
        "gruber:radial": list(camera.radial),
        "gruber:tangential": list(camera.tangential),
        "gruber:principal_point_mm": list(camera.principal_point_mm),
        "gruber:angles": _angles(photo),
    }


def _angles(photo: ExchangePhoto) -> list[float] | None:
    """omega, phi, kappa of the scan as it lies, radians."""
    turned = photo.exterior
    return None if turned is None else [turned.omega, turned.phi, turned.kappa]


def read_stac(path: Path) -> ExchangeBlock:
    """A folder of items, or one item or collection of features.

    Raises:
        ProjectError: It holds no photo, or an item lacks a field or contradicts another one.
    """
    files = [path]
    folder = path.is_dir()
    if folder:
        files = [one for one in sorted(path.iterdir()) if one.suffix.lower() == ".json"]
    photos: dict[str, ExchangePhoto] = {}
    cameras: dict[str, ExchangeCamera] = {}
    crs, oriented = "", False
    for file in files:
        for item in [] if folder and not _claims(file) else _items(file):
            fields = cast("Mapping[str, Any]", item.get("properties") or {})
            named = _crs(fields)
            oriented |= any(key.startswith("pers:") for key in fields)
            if named and crs and named != crs:
                raise ProjectError(
                    file,
                    "is in {crs}, other items are in {other}.",
                    "Take items of one CRS at a time.",
                    crs=named,
                    other=crs,
                )
            crs = crs or named
            photo, camera = _photo(file, item, fields)
            if photo.photo_id in photos:
                raise ProjectError(
                    file,
                    "The item {name} stands twice.",
                    "Give every photo one item.",
                    name=photo.photo_id,
                )
            photos[photo.photo_id] = photo
            if camera is not None:
                cameras[camera.name] = camera
    if not photos:
        raise ProjectError(path, "holds no STAC item.", REMEDY)
    if not oriented:
        raise ProjectError(path, "holds no STAC item of a photo with its orientation.", REMEDY)
    return ExchangeBlock(crs, cameras, photos)


def _claims(path: Path) -> bool:
    """Whether a file says that it is of STAC: other ones may lie beside items."""
    return b'"stac_version"' in read_bytes(path)


def _items(path: Path) -> list[Mapping[str, Any]]:
    """Items of a file; none where it is a catalogue."""
    value = read_json(path)
    if not isinstance(value, dict):
        raise ProjectError(path, "is no STAC item.", REMEDY)
    if value.get("type") in ("Catalog", "Collection"):
        return []
    found = value.get("features") if value.get("type") == "FeatureCollection" else [value]
    items = [one for one in found or [] if isinstance(one, dict)]
    if any("stac_version" not in one or "id" not in one for one in items):
        raise ProjectError(path, "is no STAC item.", REMEDY)
    return cast("list[Mapping[str, Any]]", items)


def _crs(fields: Mapping[str, Any]) -> str:
    crs = fields.get("pers:crs") or fields.get("proj:code") or ""
    return f"EPSG:{crs}" if isinstance(crs, int) else str(crs)


def _photo(
    path: Path, item: Mapping[str, Any], fields: Mapping[str, Any]
) -> tuple[ExchangePhoto, ExchangeCamera | None]:
    """Photo and camera of an item: ours where our fields are there, else the upright camera."""
    name = str(item["id"])
    asset = next(iter((item.get("assets") or {}).values()), {})
    file = str(asset.get("href") or f"{name}.tif").replace("\\", "/").rsplit("/", 1)[-1]
    inside = cast("Mapping[str, Any]", fields.get("pers:interior_orientation") or {})
    camera, affine = _camera(path, name, inside, fields)
    exterior = None
    if fields.get(NEEDED[0]) is not None:
        centre = np.array(json_numbers(path, fields, NEEDED[0], 3))
        angles = [np.radians(json_numbers(path, fields, key, 1)[0]) for key in NEEDED[1:]]
        if fields.get("gruber:angles"):
            angles = json_numbers(path, fields, "gruber:angles", 3)
        exterior = ExteriorOrientation(centre, float(angles[0]), float(angles[1]), float(angles[2]))
    sigma_m, sigma_rad = (
        triple_of(json_numbers(path, fields, key, 3)) if fields.get(key) else None
        for key in ("gruber:sigma_m", "gruber:sigma_rad")
    )
    photo = ExchangePhoto(
        name, file, "" if camera is None else camera.name, affine, exterior, sigma_m, sigma_rad,
        taken=_taken(fields),
    )  # fmt: skip
    return photo, camera


def _camera(
    path: Path, name: str, inside: Mapping[str, Any], fields: Mapping[str, Any]
) -> tuple[ExchangeCamera | None, np.ndarray | None]:
    """Camera, and its pixel_from_image."""
    if not inside:
        return None, None
    distance = json_numbers(path, inside, "focal_length", 1)[0]
    size = None
    if inside.get("sensor_array_dimensions"):
        columns, rows = json_numbers(path, inside, "sensor_array_dimensions", 2)
        size = (int(columns), int(rows))
    given = str(inside.get("camera_id") or name)
    if fields.get(MATRIX):
        values = [value for row in fields[MATRIX] for value in row]
        matrix = np.array(json_numbers(path, {MATRIX: values}, MATRIX, 2 * 3)).reshape(2, 3)
        radial = tuple(map(float, fields.get("gruber:radial") or ()))
        p1, p2 = map(float, fields.get("gruber:tangential") or (0.0, 0.0))
        x, y = map(float, fields.get("gruber:principal_point_mm") or (0.0, 0.0))
        return ExchangeCamera(given, radial, (p1, p2), size, distance, (x, y)), matrix
    camera = ExchangeCamera(given, size_px=size, principal_distance_mm=distance)
    if size is None or not inside.get("pixel_spacing"):
        return camera, None
    across, down = json_numbers(path, inside, "pixel_spacing", 2)
    offset = [0.0, 0.0]
    if inside.get("principal_point_offset"):
        offset = json_numbers(path, inside, "principal_point_offset", 2)
    column, row = size[0] / 2 + offset[0] / across, size[1] / 2 - offset[1] / down
    return camera, np.array([[distance / across, 0, column], [0, -distance / down, row]])


STAC_FORMAT = ExchangeFormat(
    name="stac",
    title="STAC: an item for every photo",
    conventions=Conventions(
        pixels="of our own fields, the outer corner of the first pixel; principal point of the "
        "extension from the middle of the sensor, x right, y up, millimetres",
        object_space="`pers:perspective_center` in `pers:crs`, metres; geometry in degrees",
        rotation="`pers:omega`, `pers:phi`, `pers:kappa` in degrees, R = R_x R_y R_z turns image "
        "space into object space; `pers:rotation_matrix` the other way",
        camera="focal length and pixels in millimetres; affine transform and distortion in fields "
        "of ours (`gruber:`)",
        sigmas="orientations, in fields of ours",
        lost="points, measurements, ties, fiducials",
        tested="angles and matrix of an item of the Danish oblique photos (SDFI); items and "
        "catalogue against the schemas of STAC 1.1.0, extensions by their description",
    ),
    holds="film",
    write=write_stac,
    read=read_stac,
    default_name="stac",
)
"""Items with the fields of perspective imagery."""
