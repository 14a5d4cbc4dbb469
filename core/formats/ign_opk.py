"""IGN's OPK: orientations (.OPK), ties and measured control (.MES), control (.APP), cameras (.txt).

The folder holds one list of orientations; what else there is of it is read with it. Pixels count
column and row from the outer corner, angles turn as omega, phi, kappa of the map's axes. Heights
may bear the map's scale ("linear alteration"): they are taken as they stand.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from core.errors import ProjectError
from core.formats.exchange import (
    Conventions,
    ExchangeBlock,
    ExchangeCamera,
    ExchangeFormat,
    ExchangeMeasurement,
    ExchangePhoto,
    ExchangePoint,
    ExchangeTies,
    Holds,
)
from core.formats.film_rays import median_misfit, not_oriented, tie_names
from core.formats.records import (
    Record,
    one_word,
    only_file,
    read_records,
    read_text,
    scan_stem,
    write_lines,
)
from core.formats.rotations import RADIANS, AngleUnit
from core.formats.words import in_words
from core.geometry.exterior import ExteriorOrientation
from core.said import say

HOLDS: Holds = "upright"
UNITS: dict[str, AngleUnit] = {"degre": "deg", "grade": "gon", "radian": "rad"}
"""What `UNITE ANGLE` may say (accents are dropped)."""
MAPS = {"LAMBERT93": "EPSG:2154", "LAMBERT-93": "EPSG:2154", "UTM31": "EPSG:32631"}
"""CRS by IGN's name of it."""
COLUMNS = {"NOM": "name", "X": "x", "Y": "y", "Z": "z", "O": "o", "P": "p", "K": "k"}
"""Heads of the list, and what they hold; `CAMERA` beside them."""
CONTROL, CHECK = "13", "3"
"""Codes of .APP: 13 is used as control by IGN's tools, all else checks."""
# design: a wrong unit of angles misses by a hundred times as much as a right one.
CLEARLY = 3.0
"""How many times worse the other units must fit, where measurements tell the unit."""
# design: one pixel in a thousand; the map's own distortion already moves more.
UPRIGHT = 1e-6
"""Affinity and turn below this are none."""
ASKED = "Write `UNITE ANGLE : degre` (or grade, radian) above the header."


def read_opk(path: Path) -> ExchangeBlock:
    """A folder, or a list of orientations alone.

    Raises:
        ProjectError: A file is missing, damaged, contradicts another one, or does not say the
            unit of its angles.
    """
    folder = path if path.is_dir() else path.parent
    listed = only_file(path, "*.opk") if path.is_dir() else path
    if listed is None:
        raise ProjectError(
            path, "holds no list of orientations (.OPK).", "Give the folder that the list is in."
        )
    header, unit, rows = _list(listed)
    if path.is_dir():
        cameras = _cameras(folder)
        points = _points(folder)
    else:
        cameras, points = {}, {}
    photos = _photos(listed, header, rows, cameras, unit or "deg")
    block = ExchangeBlock(_crs(listed), cameras, photos, points)
    if path.is_dir():
        block = _with_measurements(folder, block)
    if unit is not None:
        return block
    best = _fitting_unit(listed, block)
    photos = _photos(listed, header, rows, cameras, best)
    told = say("Angles are in {unit}: the measured control says so.", unit=best)
    return replace(block, photos=photos, notes=(told,))


def _list(path: Path) -> tuple[dict[str, int], AngleUnit | None, list[Record]]:
    """Columns, unit where it is said, and rows of the list."""
    unit: AngleUnit | None = None
    records = read_records(path)
    for at, record in enumerate(records):
        words = [cell.upper() for cell in record.cells]
        if words[:2] == ["UNITE", "ANGLE"]:
            said = record.cells[-1].lower().replace("é", "e")
            if said not in UNITS:
                raise record.refused(
                    "Line {number}: the unit of angles {said!r} is unknown.", ASKED, said=said
                )
            unit = UNITS[said]
        if "NOM" in words:
            header = {COLUMNS.get(word, word): index for index, word in enumerate(words)}
            missing = [head for head, name in COLUMNS.items() if name not in header]
            if missing:
                raise record.refused(
                    "The column {missing} is missing.",
                    "The header is NOM X Y Z O P K CAMERA.",
                    missing=missing[0],
                )
            if at + 1 == len(records):
                raise record.refused("The list holds no rows.", "Give the whole file.")
            return header, unit, records[at + 1 :]
    raise ProjectError(
        path,
        "The column {missing} is missing.",
        "The header is NOM X Y Z O P K CAMERA.",
        missing="NOM",
    )


def _crs(path: Path) -> str:
    for line in read_text(path).splitlines():
        key, colon, value = line.partition(":")
        if colon and key.strip().upper() == "PROJECTION":
            value = value.strip()
            return MAPS.get(value.upper().replace(" ", ""), value)
    return ""


def _photos(
    path: Path,
    header: dict[str, int],
    rows: Sequence[Record],
    cameras: dict[str, ExchangeCamera],
    unit: AngleUnit,
) -> dict[str, ExchangePhoto]:
    photos: dict[str, ExchangePhoto] = {}
    for row in rows:
        name = scan_stem(row.text(header["name"]))
        row.refuse_again(name, photos)
        centre = np.array([row.value(header[axis]) for axis in "xyz"])
        angles = [row.value(header[axis]) * RADIANS[unit] for axis in "opk"]
        camera = row.text(header["CAMERA"]) if "CAMERA" in header else ""
        if cameras and camera not in cameras:
            raise row.refused(
                "Line {number}: the camera {camera!r} is unknown.",
                "Put its file beside the list.",
                camera=camera,
            )
        affine = None
        if camera in cameras:
            affine = _affine(path.parent, cameras[camera])
        exterior = ExteriorOrientation(centre, angles[0], angles[1], angles[2])
        photos[name] = ExchangePhoto(name, f"{name}.tif", camera, affine, exterior)
    return photos


def _affine(folder: Path, camera: ExchangeCamera) -> np.ndarray:
    """pixel_from_image of a camera's file, which `_cameras` found to be there."""
    values = _camera_values(_camera_files(folder)[camera.name])
    focal, column, row = (float(values[key]) for key in ("focal", "ppax", "ppay"))
    return np.array([[focal, 0.0, column], [0.0, -focal, row]])


def _camera_files(folder: Path) -> dict[str, Path]:
    """Files of cameras by the names they bear."""
    found: dict[str, Path] = {}
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() == ".txt":
            values = _camera_values(path)
            if "ppax" in values:
                found[values.get("name", path.stem)] = path
    return found


def _camera_values(path: Path) -> dict[str, str]:
    pairs = (line.partition("=") for line in read_text(path).splitlines())
    return {key.strip().lower(): value.strip() for key, sign, value in pairs if sign}


def _cameras(folder: Path) -> dict[str, ExchangeCamera]:
    cameras: dict[str, ExchangeCamera] = {}
    for name, path in _camera_files(folder).items():
        values = _camera_values(path)
        for key in ("ppax", "ppay", "focal"):
            Record(path, 0, (values.get(key, ""),)).value(0)
        size = None
        if "width" in values and "height" in values:
            columns = Record(path, 0, (values["width"],)).value(0)
            size = (int(columns), int(Record(path, 0, (values["height"],)).value(0)))
        cameras[name] = ExchangeCamera(name, size_px=size)
    return cameras


def _plain(name: str) -> str:
    return name.strip('"')


def _points(folder: Path) -> dict[str, ExchangePoint]:
    path = only_file(folder, "*.app")
    points: dict[str, ExchangePoint] = {}
    for record in read_records(path) if path is not None else ():
        name = _plain(record.text(0))
        record.refuse_again(name, points)
        role = "control" if record.text(1) == CONTROL else "check"
        points[name] = ExchangePoint(name, record.triple(2), role=role)
    return points


def _with_measurements(folder: Path, block: ExchangeBlock) -> ExchangeBlock:
    """Ties and measured control of all .MES files that hold pixels."""
    measured: dict[tuple[str, str], ExchangeMeasurement] = {}
    ties: dict[tuple[str, str], tuple[float, float]] = {}
    lost: set[str] = set()
    for path in sorted(one for one in folder.iterdir() if one.suffix.lower() == ".mes"):
        for record in read_records(path):
            point, photo = _plain(record.text(0)), scan_stem(record.text(1))
            column, row = record.value(2), record.value(3)
            if len(record.cells) > 4:
                raise record.refused(
                    "Line {number} holds more than point, photo, column and row.",
                    "Points in space do not belong into a .MES file.",
                )
            if photo not in block.photos:
                lost.add(photo)
                continue
            if (point, photo) in measured or (point, photo) in ties:
                raise record.refused(
                    "Point {point} is measured twice in photo {photo}.",
                    "Leave one measurement of a point in every photo.",
                    point=point,
                    photo=photo,
                )
            if point in block.points:
                measured[point, photo] = ExchangeMeasurement(point, photo, column, row)
            else:
                ties[point, photo] = (column, row)
    names, photos = (tuple(dict.fromkeys(key[n] for key in ties)) for n in (0, 1))
    point_of, photo_of = ({name: n for n, name in enumerate(side)} for side in (names, photos))
    notes = block.notes
    if lost:
        notes += (
            say(
                "{count:# photo is|# photos are} measured that the list does not hold: left out.",
                count=len(lost),
            ),
        )
    return replace(
        block,
        measurements=tuple(measured.values()),
        ties=ExchangeTies(
            photos,
            np.array([point_of[point] for point, _ in ties], dtype=np.int64),
            np.array([photo_of[photo] for _, photo in ties], dtype=np.int64),
            np.array(list(ties.values())).reshape(-1, 2),
            names,
        ),
        notes=notes,
    )


def _fitting_unit(path: Path, block: ExchangeBlock) -> AngleUnit:
    """The unit of angles that measured control bears out.

    Raises:
        ProjectError: Nothing is measured, or several fit alike.
    """
    fits: list[tuple[float, AngleUnit]] = []
    for unit in UNITS.values():
        factor = RADIANS[unit] / RADIANS["deg"]
        photos = {
            name: replace(
                photo,
                exterior=ExteriorOrientation(
                    photo.exterior.centre,
                    photo.exterior.omega * factor,
                    photo.exterior.phi * factor,
                    photo.exterior.kappa * factor,
                ),
            )
            for name, photo in block.photos.items()
            if photo.exterior is not None
        }
        fits.append((median_misfit(replace(block, photos=photos)), unit))
    fits.sort()
    if not np.isfinite(fits[0][0]) or fits[1][0] < CLEARLY * fits[0][0]:
        raise ProjectError(path, "The list does not say the unit of its angles.", ASKED)
    return fits[0][1]


def write_opk(path: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write orientations, cameras, control and all measurements into a folder.

    Returns:
        What was left out.
    """
    path.mkdir(parents=True, exist_ok=True)
    block, renamed = in_words(block)
    oriented = {n: p for n, p in block.photos.items() if p.exterior is not None}
    head = ["CHANTIER : gruber", f"PROJECTION : {block.crs}" if block.crs else ""]
    lines = [
        *(line for line in head if line),
        "UNITE ANGLE  : degre",
        "NOM\tX\tY\tZ\tO\tP\tK\tCAMERA",
    ]
    for name, photo in oriented.items():
        assert photo.exterior is not None
        turned = photo.exterior
        angles = np.degrees(turned.angles)
        numbers = [repr(float(value)) for value in (*turned.centre, *angles)]
        lines.append("\t".join([name, *numbers, one_word(photo.camera or "-")]))
    write_lines(path / "block.OPK", lines)
    notes = _write_cameras(path, block)
    write_lines(
        path / "control.APP",
        [
            f'"{point.point_id}" {CONTROL if point.role == "control" else CHECK} '
            + " ".join(repr(value) for value in point.position)
            for point in block.points.values()
        ],
    )
    write_lines(
        path / "control.MES",
        [f'"{m.point_id}" {m.photo_id} {m.column!r} {m.row!r}' for m in block.measurements],
    )
    names, ties = tie_names(block), block.ties
    write_lines(
        path / "ties.MES",
        [
            f"{names[point]} {ties.photo_ids[photo]} {pixel[0]!r} {pixel[1]!r}"
            for point, photo, pixel in zip(
                ties.point, ties.photo, ties.pixels.tolist(), strict=True
            )
        ],
    )
    notes += not_oriented(block.photos.values())
    if any(point.sigma_m for point in block.points.values()) or any(
        photo.sigma_centre_m for photo in block.photos.values()
    ):
        notes.append(say("The format holds no standard deviations."))
    return (*renamed, *notes)


def _write_cameras(path: Path, block: ExchangeBlock) -> list[str]:
    notes: list[str] = []
    written: set[str] = set()
    bent: set[str] = set()
    for photo in block.photos.values():
        camera = block.cameras.get(photo.camera)
        if photo.pixel_from_image is None or camera is None:
            continue
        linear, shift = photo.pixel_from_image[:, :2], photo.pixel_from_image[:, 2].tolist()
        focal = float(linear[0, 0])
        if np.abs(linear / focal - np.diag([1.0, -1.0])).max() > UPRIGHT:
            bent.add(photo.photo_id)
        if camera.name in written:
            continue
        written.add(camera.name)
        size = camera.size_px or (0, 0)
        write_lines(
            path / f"camera-{len(written)}.txt",
            [
                f"Name = {one_word(camera.name)}",
                f"PPAx = {shift[0]!r}",
                f"PPAy = {shift[1]!r}",
                f"focal = {focal!r}",
                *([f"width = {size[0]}", f"height = {size[1]}"] if camera.size_px else []),
            ],
        )
        if any(camera.radial) or any(camera.tangential):
            notes.append(say("The lens distortion of {camera} is left out.", camera=camera.name))
    if bent:
        notes.append(
            say(
                "{count:# scan is|# scans are} turned or sheared, which a camera here cannot be.",
                count=len(bent),
            )
        )
    return notes


OPK_FORMAT = ExchangeFormat(
    name="opk",
    title="IGN: OPK, MES, APP",
    conventions=Conventions(
        pixels="column right, row down, outer corner of the first pixel",
        object_space="the map's easting, northing, altitude, metres; the CRS by IGN's name or code",
        rotation="R = R_x(omega) R_y(phi) R_z(kappa) turns image space into the map's axes; "
        "degrees, gon or radians as `UNITE ANGLE` says",
        camera="focal length and principal point in pixels; no distortion",
        lost="lens distortion, scans that are turned, standard deviations, object points of ties, "
        "fiducials",
        tested="IGN's own files (Borea): within a pixel of its expected pixels",
    ),
    holds=HOLDS,
    write=write_opk,
    read=read_opk,
    default_name="opk",
)
"""IGN's list of orientations with what belongs to it."""
