"""A block as MicMac's folder: cameras, orientations, fiducials, points, measurements and ties."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from core.arrays import Affine2
from core.errors import ExchangeError
from core.formats.exchange import (
    Conventions,
    ExchangeBlock,
    ExchangeCamera,
    ExchangeFormat,
    ExchangeMeasurement,
    ExchangePhoto,
    ExchangePoint,
    Pair,
)
from core.formats.frame_interiors import without_orientation
from core.formats.micmac_lens import DOWN, fit_held_lens, lens_of
from core.formats.micmac_orientation import (
    PREFIX,
    SAME,
    SUFFIX,
    Calibration,
    OrientedImage,
    read_calibration,
    read_orientation,
    write_calibration,
    write_orientation,
)
from core.formats.micmac_points import (
    HEAD,
    IMAGE,
    MEASURES,
    POINTS,
    by_name,
    corner_of,
    film_from_written,
    image_measures_name,
    one_set,
    read_camera_measures,
    read_image_measures,
    read_measures,
    read_points_text,
    read_points_xml,
    write_camera_measures,
    write_image_measures,
    write_measures,
    write_points,
)
from core.formats.micmac_points import PREFIX as MEASURES_OF_IMAGE
from core.formats.micmac_ties import FOLDER as TIES
from core.formats.micmac_ties import read_homol, write_couples, write_homol
from core.formats.outlines import ground_height
from core.formats.records import read_bytes
from core.frames import HALF_PIXEL
from core.said import Said, say

MARKS, ORIENTATIONS = "Ori-InterneScan", "Ori-Gruber"
CAMERA_MARKS = "MeasuresCamera"
# design: MicMac's own files begin with their root; more is not looked at.
OPENING = 2000
"""Bytes in which a file says what it is."""
# design: below what points are measured to; a lens farther off is not taken over.
HELD_PX = 0.1
"""Pixels that a fitted lens may be off the file's own."""
# design: scans have tens of pixels to a millimetre; a scan that shrank stays far within.
UNIT_PX = (0.5, 2.0)
"""Pixels to a calibration's square unit between which the unit is a pixel, not a millimetre."""
# source: issue 18, round trips: what differs less is the same.
SAME_PX = 1e-6
"""Pixels that a lens may be off without a word."""


@dataclass(frozen=True, slots=True)
class _Read:
    """What the orientations gave."""

    cameras: dict[str, ExchangeCamera]
    photos: dict[str, ExchangePhoto]
    notes: tuple[str, ...]


def read_micmac(folder: Path) -> ExchangeBlock:
    """Read a project of MicMac, or one of its folders of orientations with what lies around it.

    Args:
        folder: The project's folder, or one `Ori-...` inside it where there are several.

    Raises:
        ExchangeError: Nothing of MicMac there, several sets of orientations, or a damaged file.
    """
    chosen, root = _orientations(folder)
    oriented = _Read({}, {}, ()) if chosen is None else _oriented(chosen, root)
    photos = dict(oriented.photos)
    points, measures = _points_and_measures(root)
    marks = _marks(root)
    tied = read_homol(root / TIES)
    for file in [*marks, *(file for file, _ in measures), *tied.ties.photo_ids]:
        name = _photo_id(file)
        photos.setdefault(name, ExchangePhoto(name, file))
        _same_file(root, photos[name], file)
    for file, places in marks.items():
        name = _photo_id(file)
        photos[name] = replace(photos[name], fiducials_px=places)
    if not photos and not points:
        raise ExchangeError(
            folder,
            "It holds no orientations, points or measurements of MicMac.",
            "Choose the project's folder, the one with Ori-... inside.",
        )
    return ExchangeBlock(
        cameras=_with_marks(root, oriented.cameras, photos),
        photos=photos,
        points=points,
        measurements=tuple(one for _, one in measures),
        ties=replace(tied.ties, photo_ids=tuple(map(_photo_id, tied.ties.photo_ids))),
        notes=(*oriented.notes, *tied.notes),
    )


def _orientations(folder: Path) -> tuple[Path | None, Path]:
    """The folder of orientations, if there is any, and the project's folder."""
    if not folder.is_dir():
        raise ExchangeError(
            folder, "It is not a folder that can be read.", "Choose the project's folder."
        )
    if any(folder.glob(f"{PREFIX}*{SUFFIX}")):
        inside = folder.name.startswith("Ori-")
        return folder, folder.parent if inside else folder
    sets = [one for one in sorted(folder.glob("Ori-*")) if any(one.glob(f"{PREFIX}*{SUFFIX}"))]
    return one_set(folder, sets), folder


def _oriented(folder: Path, root: Path) -> _Read:
    """Cameras and photos of a set of orientations."""
    calibrations: dict[Path, Calibration] = {}
    cameras: dict[str, ExchangeCamera] = {}
    photos: dict[str, ExchangePhoto] = {}
    notes: dict[str, Said] = {}
    film = _film_origin(root)
    for path in sorted(folder.glob(f"{PREFIX}*{SUFFIX}")):
        image = read_orientation(path)
        where = image.calibration if isinstance(image.calibration, Path) else path
        if where not in calibrations:
            calibrations[where] = read_calibration(image.calibration, where)
        calibration = calibrations[where]
        camera, affine, note = camera_of(calibration, image.pixel_from_file, film)
        if note is not None:
            notes[calibration.name] = note
        name = _photo_id(image.file)
        cameras.setdefault(camera.name, camera)
        if name in photos:
            _same_file(root, photos[name], image.file)
        photos[name] = ExchangePhoto(
            name, image.file, camera.name, affine, image.exterior, image.sigma_centre_m
        )
    return _Read(cameras, photos, tuple(notes.values()))


def camera_of(
    calibration: Calibration, pixel_from_file: Affine2, film: tuple[Pair, Pair]
) -> tuple[ExchangeCamera, Affine2 | None, Said | None]:
    """The camera of a calibration, a photo's pixel_from_image, and what could not be held.

    Args:
        calibration: The camera's file.
        pixel_from_file: OrIntImaM2C of the photo.
        film: Origin of the film in the file's unit, and the factors of its axes.
    """
    name, lens = calibration.name, calibration.lens
    empty = ExchangeCamera(name, size_px=calibration.size_px)
    if lens is None:
        told = say(
            "The camera {name} has the distortion {model}, which is not taken over: its photos "
            "come without interior orientation.",
            name=name,
            model=calibration.model,
        )
        return empty, None, told
    linear = pixel_from_file[:, :2] @ calibration.scan_from_unit[:, :2]
    shift = pixel_from_file[:, :2] @ calibration.scan_from_unit[:, 2] + pixel_from_file[:, 2]
    held = fit_held_lens(lens, calibration.size)
    off = held.off * float(np.sqrt(abs(np.linalg.det(linear))))
    if off > HELD_PX:
        told = say(
            "The lens of {name} cannot be held to {limit} px (best is {off:.3g} px): its photos "
            "come without interior orientation.",
            name=name,
            limit=HELD_PX,
            off=off,
        )
        return empty, None, told
    affine = np.column_stack(
        [
            linear @ held.file_from_image[:, :2],
            linear @ held.file_from_image[:, 2] + shift + HALF_PIXEL,
        ]
    )
    camera = ExchangeCamera(name, held.radial, held.tangential, calibration.size_px)
    unit_px = abs(float(np.linalg.det(linear)))
    if calibration.scanned or not UNIT_PX[0] < unit_px < UNIT_PX[1]:
        origin, factors = film
        point = (np.array(lens.principal_point) - origin) * factors
        camera = replace(
            camera,
            principal_distance_mm=lens.focal,
            principal_point_mm=(float(point[0]), float(point[1])),
            frame_mm=calibration.size,
            size_px=calibration.size_px if calibration.scanned else None,
        )
    note = None
    if off > SAME_PX:
        note = say(
            "The lens of {name} was fitted by the terms that a block holds; it is {off:.2g} px off "
            "at most.",
            name=name,
            off=off,
        )
    return camera, affine, note


def _film_origin(root: Path) -> tuple[Pair, Pair]:
    """Where the fiducials' frame begins in MicMac's, and the factors of its axes."""
    path = root / MARKS / f"{CAMERA_MARKS}.xml"
    return film_from_written(path) if path.is_file() else ((0.0, 0.0), (1.0, -1.0))


def _marks(root: Path) -> dict[str, dict[str, Pair]]:
    """Measured fiducials by the scan's file name."""
    found: dict[str, dict[str, Pair]] = {}
    for path in sorted((root / MARKS).glob(f"{MEASURES_OF_IMAGE}*.xml")):
        found |= read_image_measures(path)
    return found


def _with_marks(
    root: Path, cameras: Mapping[str, ExchangeCamera], photos: dict[str, ExchangePhoto]
) -> dict[str, ExchangeCamera]:
    """Cameras with their certified fiducials; photos that are not oriented get the only one."""
    path = root / MARKS / f"{CAMERA_MARKS}.xml"
    found = dict(cameras)
    if not path.is_file():
        return found
    marks = read_camera_measures(path)
    found = {
        name: replace(one, fiducials_mm=marks) if one.principal_distance_mm is not None else one
        for name, one in found.items()
    } or {CAMERA_MARKS: ExchangeCamera(CAMERA_MARKS, fiducials_mm=marks)}
    for name, photo in photos.items():
        if not photo.camera and photo.fiducials_px and len(found) == 1:
            photos[name] = replace(photo, camera=next(iter(found)))
    return found


def _points_and_measures(
    root: Path,
) -> tuple[dict[str, ExchangePoint], list[tuple[str, ExchangeMeasurement]]]:
    """All files of points and of measurements that lie in the project's folder itself."""
    points: list[ExchangePoint] = []
    measures: dict[tuple[str, str], tuple[str, ExchangeMeasurement]] = {}
    for path, kind in _files(root):
        if kind == HEAD:
            points += read_points_text(path).values()
        elif kind == POINTS:
            points += read_points_xml(path).values()
        else:
            for file, one in read_measures(path):
                before = measures.setdefault((file, one.point_id), (file, one))[1]
                if before != one:
                    raise ExchangeError(
                        path,
                        "{name} is measured twice in {scan}.",
                        "Take one of the two away.",
                        name=one.point_id,
                        scan=file,
                    )
    return by_name(root, points), list(measures.values())


def _files(root: Path) -> Iterator[tuple[Path, str]]:
    """Files of points and measurements with what they are, by how they begin; XML first."""
    for path in sorted(root.glob("*.xml")):
        opening = read_bytes(path)[:OPENING].decode(errors="replace")
        kind = next((tag for tag in (POINTS, MEASURES, IMAGE) if f"<{tag}" in opening), None)
        if kind is not None:
            yield path, kind
    for path in sorted(root.glob("*.txt")):
        if read_bytes(path)[:OPENING].decode("utf-8-sig", errors="replace").startswith(HEAD):
            yield path, HEAD


def _photo_id(file: str) -> str:
    """A photo's name: its scan's without folder and extension."""
    return Path(file).stem


def _same_file(root: Path, photo: ExchangePhoto, file: str) -> None:
    """Two scans must not come to one photo."""
    if photo.file != file:
        raise ExchangeError(
            root,
            "{one} and {other} would be one photo.",
            "Rename one of the two scans.",
            one=photo.file,
            other=file,
        )


def write_micmac(folder: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write a block as MicMac's folder.

    Returns:
        What was left out, a sentence each.
    """
    folder.mkdir(parents=True, exist_ok=True)
    left = [*_write_cameras(folder, block)]
    for photo in block.photos.values():
        if photo.fiducials_px:
            path = folder / MARKS / image_measures_name(photo.file)
            path.parent.mkdir(exist_ok=True)
            write_image_measures(path, photo.file, photo.fiducials_px)
    write_points(folder, block.points)
    files = {name: photo.file for name, photo in block.photos.items()}
    if block.measurements:
        write_measures(folder / "Measures-S2D.xml", block.measurements, files)
    couples = write_homol(folder / TIES, block.ties, files)
    if couples:
        write_couples(folder / "img_pairs.xml", couples)
    return tuple(left)


def _write_cameras(folder: Path, block: ExchangeBlock) -> Iterator[str]:
    """Calibrations, orientations and the fiducials of the cameras; says what is left out."""
    ground = ground_height(block)
    marked = ""
    for name, camera in block.cameras.items():
        photos = [photo for photo in block.photos.values() if photo.camera == name]
        if camera.fiducials_mm and not marked:
            marked = name
            path = folder / MARKS / f"{CAMERA_MARKS}.xml"
            path.parent.mkdir(exist_ok=True)
            write_camera_measures(path, camera.fiducials_mm)
        elif camera.fiducials_mm:
            yield say(
                "MicMac keeps the fiducials of one camera: {kept}; those of {name} are left out.",
                kept=marked,
                name=name,
            )
        oriented = [p for p in photos if p.exterior is not None and p.pixel_from_image is not None]
        if oriented:
            _write_set(folder / ORIENTATIONS, camera, oriented, ground)
    missing = [
        photo.photo_id
        for photo in block.photos.values()
        if photo.exterior is None or photo.pixel_from_image is None
    ]
    yield from without_orientation(missing)


def _write_set(
    folder: Path, camera: ExchangeCamera, photos: list[ExchangePhoto], ground: float | None
) -> None:
    """A camera's calibration and the orientations of its photos."""
    affines = np.array([photo.pixel_from_image for photo in photos])
    first: Affine2 = affines[0]
    focal = float(first[0, 0])
    upright = np.array_equal(first[:, :2], focal * np.diag(DOWN)) and focal > 0
    path = folder / calibration_name(camera.name)
    if upright and (affines == first).all() and not camera.fiducials_mm:
        point = (float(first[0, 2]) - HALF_PIXEL, float(first[1, 2]) - HALF_PIXEL)
        size = camera.size_px or _size_px(camera, focal, point)
        lens = lens_of(camera, focal, point)
        calibration = Calibration(path, camera.name, size, False, size, lens, "")
        units = [SAME] * len(photos)
    else:
        calibration = _film_calibration(path, camera, first)
        units = [_pixel_from_unit(calibration, affine) for affine in affines]
    write_calibration(calibration)
    for photo, unit in zip(photos, units, strict=True):
        assert photo.exterior is not None, "only oriented photos are written"
        name = folder / f"{PREFIX}{photo.file}{SUFFIX}"
        image = OrientedImage(name, photo.file, path, unit, photo.exterior, photo.sigma_centre_m)
        write_orientation(image, ground)


def _size_px(camera: ExchangeCamera, focal: float, point: Pair) -> tuple[int, int]:
    """A size, which MicMac asks for: that of the frame, or about the principal point."""
    if camera.frame_mm is not None and camera.principal_distance_mm is not None:
        width, height = camera.frame_mm
        scale = focal / camera.principal_distance_mm
        return round(width * scale), round(height * scale)
    return round(2 * point[0] + 1), round(2 * point[1] + 1)


def calibration_name(camera: str) -> str:
    """Name of a camera's file, without what a path cannot hold."""
    plain = re.sub(r"[^\w.+-]", "_", camera)
    return f"{plain}.xml" if plain.startswith("AutoCal") else f"AutoCal_{plain}.xml"


def _film_calibration(path: Path, camera: ExchangeCamera, affine: Affine2) -> Calibration:
    """A calibration in millimetres from the upper left of the fiducials, y downwards.

    Where no millimetres are known, the unit is such that the first scan has one pixel to it.
    """
    scale = float(np.sqrt(abs(np.linalg.det(affine[:, :2]))))
    focal = camera.principal_distance_mm or scale
    marks = list(camera.fiducials_mm.values())
    if marks:
        left, top = corner_of(camera.fiducials_mm)
        size = camera.frame_mm or tuple(np.ptp(np.array(marks), axis=0).tolist())
    else:
        size = camera.frame_mm or (focal, focal)
        left, top = (0.0, 0.0)
    x, y = camera.principal_point_mm
    lens = lens_of(camera, focal, (x - left, top - y))
    return Calibration(path, camera.name, (size[0], size[1]), True, camera.size_px, lens, "")


def _pixel_from_unit(calibration: Calibration, pixel_from_image: Affine2) -> Affine2:
    """OrIntImaM2C of a photo."""
    lens = calibration.lens
    assert lens is not None, "a written calibration has a lens"
    linear = pixel_from_image[:, :2] * DOWN / lens.focal
    shift = pixel_from_image[:, 2] - HALF_PIXEL - linear @ np.array(lens.principal_point)
    return np.column_stack([linear, shift])


MICMAC = ExchangeFormat(
    name="micmac",
    title="MicMac",
    conventions=Conventions(
        pixels="column right, row down, from the centre of the first pixel",
        object_space="right-handed, metres, Euclidean: projected coordinates go out as they are; "
        "MicMac adjusts rightly in a local tangent frame alone",
        rotation="matrix by rows L1, L2, L3: object = Centre + L (x right, y down, z forwards)",
        camera="PP and F in millimetres of the film from its upper left, y down, or in pixels; "
        "ModRad, ModPhgrStd from the ideal to the measured place; OrIntImaM2C from film to scan",
        sigmas="points, perspective centres (1 1 1 stands for none), measurements",
        lost="CRS, deviations of angles, names, places and weights of ties, ties of one photo, "
        "origin of the fiducials' frame, distortion models other "
        "than ModRad and ModPhgrStd, millimetres of a camera without fiducials",
        tested="orientations, calibrations, fiducials, points and measurements that MicMac wrote; "
        "tie points by description alone",
    ),
    holds="film",
    write=write_micmac,
    read=read_micmac,
    default_name="micmac",
    curved=False,
)
"""MicMac's folder."""
