"""NASA's Ames Stereo Pipeline: cameras (.tsai) and ground control (.gcp) of a folder.

A camera is centre and rotation on the Earth (geocentric), focal length and principal point in
units of `pitch`, lens by OpenCV's formula. Pixels count from the centre of the first pixel.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from core.arrays import Rotation
from core.errors import ProjectError
from core.formats.exchange import (
    Conventions,
    ExchangeBlock,
    ExchangeCamera,
    ExchangeFormat,
    ExchangeMeasurement,
    ExchangePhoto,
    ExchangePoint,
    FrameCamera,
    from_frame_camera,
    places_of,
    upright_camera,
)
from core.formats.film_rays import numbered
from core.formats.records import Record, read_records, scan_stem
from core.formats.words import in_words
from core.frames import HALF_PIXEL
from core.geometry.map_in_space import EARTH_M, MapInSpace, map_crs, map_in_space, zone_of
from core.said import say

# source: documentation of the program.
NEEDED = {"fu": 1, "fv": 1, "cu": 1, "cv": 1, "C": 3, "R": 9}
"""Entries that a camera must have, and how many numbers each."""
LENS = ("k1", "k2", "p1", "p2", "k3")
"""Lens, each nought where it is not given."""
ROUND = 1e-4  # design: digits of a matrix that was written with five of them.
"""How far a rotation may be from one."""
SKEW_PX = 1e-6  # design: far below any measurement.
"""A skew beyond this is told, since a camera holds none, pixels."""
PAIR = 5  # source: documentation of the program.
"""Entries of a measurement: photo, column, row and two standard deviations."""
HEAD = 7  # source: documentation of the program.
"""Entries before the measurements: name, latitude, longitude, height, three deviations."""
MOST_RADIAL = 3  # source: documentation of the program; k1, k2, k3.


def read_asp(path: Path) -> ExchangeBlock:
    """Cameras and ground control of a folder, or of one file.

    Raises:
        ProjectError: Nothing is there, or a file is damaged.
    """
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    cameras = {f.stem: _Camera.read(f) for f in files if f.suffix.lower() == ".tsai"}
    lists = [f for f in files if f.suffix.lower() == ".gcp"]
    if not cameras and not lists:
        raise ProjectError(
            path, "holds neither cameras (.tsai) nor control (.gcp).", "Give the right folder."
        )
    points, degrees, measured, files_of = _control(lists)
    notes: list[str] = []
    earth: MapInSpace | None = None
    crs = ""
    everywhere = all(np.linalg.norm(camera.centre) > EARTH_M for camera in cameras.values())
    if degrees or (cameras and everywhere):
        place = np.array(degrees[:1]) if degrees else _first_place(cameras)
        crs = zone_of(place)
        earth = map_in_space(map_crs(crs, path))
    if cameras and not everywhere:
        notes.append(say("Cameras stand in a frame of their own, not on the Earth."))
    if points and earth is not None:
        moved = earth.from_degrees(np.array(degrees)).tolist()
        points = {
            name: ExchangePoint(name, (place[0], place[1], place[2]), point.sigma_m, point.role)
            for (name, point), place in zip(points.items(), moved, strict=True)
        }
    held: dict[str, ExchangeCamera] = {}
    photos: dict[str, ExchangePhoto] = {}
    for name, camera in cameras.items():
        file = files_of.get(name, f"{name}.tif")
        held[name], photos[name] = camera.photo(name, file, earth if everywhere else None)
    for name, file in files_of.items():
        photos.setdefault(name, ExchangePhoto(name, file))
    return ExchangeBlock(crs, held, photos, points, tuple(measured), notes=tuple(notes))


class _Camera:
    """What a .tsai file says."""

    def __init__(self, values: dict[str, list[float]], centre: np.ndarray, turn: Rotation) -> None:
        self.values, self.centre, self.turn = values, centre, turn

    @staticmethod
    def read(path: Path) -> "_Camera":
        values: dict[str, list[float]] = {}
        for record in read_records(path, lambda line: line.replace("=", " ").split()):
            if len(record.cells) > 1:
                key = record.cells[0]
                if key in NEEDED or key in (*LENS, "pitch"):
                    needed = NEEDED.get(key, 1)
                    values[key] = [record.value(1 + n) for n in range(needed)]
        for key in NEEDED:
            if key not in values:
                raise ProjectError(
                    path,
                    "The entry {key!r} is missing.",
                    "A camera has fu, fv, cu, cv, C and R.",
                    key=key,
                )
        turn = np.array(values["R"]).reshape(3, 3)
        if np.abs(turn @ turn.T - np.eye(3)).max() > ROUND or np.linalg.det(turn) < 0:
            raise ProjectError(
                path, "R is no rotation.", "Nine numbers, row by row, of a right-handed rotation."
            )
        left, _, right = np.linalg.svd(turn)
        return _Camera(values, np.array(values["C"]), left @ right)

    def photo(
        self, name: str, file: str, earth: MapInSpace | None
    ) -> tuple[ExchangeCamera, ExchangePhoto]:
        """Camera and photo; on a map where the Earth below it is given."""
        pitch = self.values.get("pitch", [1.0])[0]
        fu, fv, cu, cv = (self.values[key][0] / pitch for key in ("fu", "fv", "cu", "cv"))
        k1, k2, p1, p2, k3 = (self.values.get(key, [0.0])[0] for key in LENS)
        centre, turn = self.centre, self.turn
        if earth is not None:
            centre = earth.to_object(centre[None])[0]
            turn = earth.turn_at(centre).T @ turn
        radial = (k1, k2, k3) if k3 else (k1, k2)
        frame = FrameCamera(
            None,
            fv,
            (cu + HALF_PIXEL, cv + HALF_PIXEL),
            fu - fv,
            0.0,
            radial,
            (p1, p2),
            turn.T,
            centre,
        )
        affine, tangential, exterior = from_frame_camera(frame)
        return (
            ExchangeCamera(name, radial, tangential),
            ExchangePhoto(name, file, name, affine, exterior),
        )


def _first_place(cameras: dict[str, _Camera]) -> np.ndarray:
    """Longitude, latitude, height of one camera."""
    centre = next(iter(cameras.values())).centre[None]
    return map_in_space(map_crs("EPSG:32633", "")).space_degrees(centre)


def _parted(line: str) -> list[str]:
    return line.replace(",", " ").split()


def _control(
    lists: Sequence[Path],
) -> tuple[dict[str, ExchangePoint], list[list[float]], list[ExchangeMeasurement], dict[str, str]]:
    """Points (not yet on a map), their places in degrees, measurements, files by photo."""
    points: dict[str, ExchangePoint] = {}
    degrees: list[list[float]] = []
    measured: list[ExchangeMeasurement] = []
    files: dict[str, str] = {}
    for path in lists:
        names: dict[str, str] = {}
        for record in read_records(path, _parted, comment=""):
            if record.cells[0].startswith("#"):
                if record.cells[:2] == ("#", "point"):
                    names[record.text(2)] = " ".join(record.cells[4:])
                continue
            name = names.get(record.text(0), record.text(0))
            latitude, longitude, height = record.triple(1)
            sigma = record.triple(4)
            record.refuse_again(name, points)
            _check(record, latitude)
            role = "check" if "check" in path.stem.lower() else "control"
            points[name] = ExchangePoint(name, (longitude, latitude, height), sigma, role)
            degrees.append([longitude, latitude, height])
            if (len(record.cells) - HEAD) % PAIR:
                record.text(len(record.cells) + PAIR - (len(record.cells) - HEAD) % PAIR - 1)
            for at in range(HEAD, len(record.cells), PAIR):
                file = record.text(at)
                photo = scan_stem(file)
                files[photo] = file
                column, row = record.value(at + 1), record.value(at + 2)
                deviation = (record.value(at + 3) + record.value(at + 4)) / 2
                measured.append(
                    ExchangeMeasurement(
                        name, photo, column + HALF_PIXEL, row + HALF_PIXEL, deviation
                    )
                )
    return points, degrees, measured, files


def _check(record: Record, latitude: float) -> None:
    if abs(latitude) > 90:
        raise record.refused(
            "Line {number}: {latitude} is no latitude.",
            "Control is given as latitude, longitude in degrees and height; perhaps they are "
            "swapped, or map coordinates.",
            latitude=latitude,
        )


def write_asp(path: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write a camera for every oriented photo, control and checks into a folder.

    Returns:
        What was left out.

    Raises:
        CrsError: The block does not say its CRS: there is no Earth below it.
    """
    path.mkdir(parents=True, exist_ok=True)
    block, renamed = in_words(block)
    earth = map_in_space(map_crs(block.crs, path), near=places_of(block))
    notes: list[str] = [
        *renamed,
        say("Heights are written as they stand, as if above the ellipsoid of WGS 84."),
    ]
    skewed = 0
    for name, photo in block.photos.items():
        camera = block.cameras.get(photo.camera)
        frame = None if camera is None else upright_camera(photo, camera)
        if photo.exterior is None or frame is None:
            notes.append(say("Photo {photo} has no orientation: left out.", photo=name))
            continue
        skewed += abs(frame.skew_px) > SKEW_PX
        text = _camera_text(frame, earth)
        (path / f"{name}.tsai").write_text(text, encoding="utf-8")
        if len(frame.radial) > MOST_RADIAL:
            notes.append(say("Radial terms after the third are left out ({photo}).", photo=name))
    if skewed:
        notes.append(
            say(
                "{count:# scan is|# scans are} turned or sheared, which a camera here cannot be.",
                count=skewed,
            )
        )
    for role, file in (("control", "control.gcp"), ("check", "check.gcp")):
        chosen = [point for point in block.points.values() if point.role == role]
        if chosen:
            (path / file).write_text(_control_text(block, chosen, earth), encoding="utf-8")
    if len(block.ties.point):
        notes.append(say("Tie points are left out."))
    return tuple(notes)


def _camera_text(frame: FrameCamera, earth: MapInSpace) -> str:
    rotation, centre = frame.with_rotation_and_centre()
    turn = earth.turn_at(np.asarray(centre)) @ rotation.T
    place = earth.from_object(np.asarray(centre)[None])[0]
    column, row = (value - HALF_PIXEL for value in frame.principal_point_px)
    k1, k2, k3 = (*frame.radial, 0.0, 0.0, 0.0)[:MOST_RADIAL]
    numbers = {
        "fu": [frame.focal_px + frame.affinity_px],
        "fv": [frame.focal_px],
        "cu": [column],
        "cv": [row],
        "u_direction": [1.0, 0.0, 0.0],
        "v_direction": [0.0, 1.0, 0.0],
        "w_direction": [0.0, 0.0, 1.0],
        "C": place.tolist(),
        "R": turn.ravel().tolist(),
        "pitch": [1.0],
    }
    lens = {"k1": k1, "k2": k2, "p1": frame.tangential[0], "p2": frame.tangential[1]}
    lens |= {"k3": k3} if k3 else {}
    lines = ["VERSION_4", "PINHOLE"]
    lines += [f"{key} = {' '.join(map(repr, value))}" for key, value in numbers.items()]
    lines += ["TSAI", *(f"{key} = {value!r}" for key, value in lens.items())]
    return "\n".join(lines) + "\n"


def _control_text(block: ExchangeBlock, chosen: Sequence[ExchangePoint], earth: MapInSpace) -> str:
    """Points with their measurements, numbered; comments keep the names."""
    numbers = numbered(point.point_id for point in chosen)
    lines = ["# WGS 84, heights as they stand"]
    lines += [f"# point {n} is {name}" for name, n in numbers.items() if name != n]
    places = earth.degrees(np.array([point.position for point in chosen])).tolist()
    seen: dict[str, list[str]] = {}
    for one in block.measurements:
        sigma = 1.0 if one.sigma_px is None else one.sigma_px
        photo = block.photos.get(one.photo_id)
        file = photo.file if photo is not None else one.photo_id
        values = (one.column - HALF_PIXEL, one.row - HALF_PIXEL, sigma, sigma)
        seen.setdefault(one.point_id, []).append(" ".join([file, *map(repr, values)]))
    for point, (longitude, latitude, height) in zip(chosen, places, strict=True):
        sigmas = point.sigma_m or (1.0, 1.0, 1.0)
        head = " ".join(map(repr, (latitude, longitude, height, *sigmas)))
        lines.append(" ".join([numbers[point.point_id], head, *seen.get(point.point_id, [])]))
    return "\n".join(lines) + "\n"


ASP_FORMAT = ExchangeFormat(
    name="asp",
    title="Ames Stereo Pipeline: .tsai and .gcp",
    conventions=Conventions(
        pixels="column right, row down, centre of the first pixel; in .tsai times `pitch`",
        object_space="geocentric WGS 84, metres (cameras); latitude, longitude in degrees, height "
        "(control); read into UTM",
        rotation="R turns camera axes (x right, y down, z forwards) into geocentric axes, row by "
        "row",
        camera="fu, fv, cu, cv in units of `pitch`; k1, k2, k3, p1, p2 as OpenCV has them",
        sigmas="control, metres; measurements, pixels",
        lost="scans that are turned or sheared, ties, fiducials, standard deviations of "
        "orientations; heights lose their datum",
        tested="files of the program's own tests (two Antarctic film frames)",
    ),
    holds="upright",
    write=write_asp,
    read=read_asp,
    default_name="asp",
)
"""Cameras and ground control of the Ames Stereo Pipeline."""
