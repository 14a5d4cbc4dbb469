"""A block as MMVII's folder, MMVII-PhgrProj: orientations, calibrations, points, measurements.

AxeI, AxeJ, AxeK are the camera's axes (x right, y down, z forwards) in object space. A ray comes to
PP + F (x / z, y / z) and is moved by terms in units of F. Variances stand for deviations; `1 0 1`
and `1 0 0 1 0 1` are what MMVII writes where nobody said any, and are read as none. Pixels count
from the centre of the first pixel there, from its outer corner here.
"""

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path, PurePath

import numpy as np

from core.arrays import Affine2
from core.errors import ExchangeError
from core.formats.exchange import (
    FLIP,
    Conventions,
    ExchangeBlock,
    ExchangeCamera,
    ExchangeFormat,
    ExchangeMeasurement,
    ExchangePhoto,
    ExchangePoint,
    FrameCamera,
    Triple,
    upright_camera,
)
from core.formats.frame_interiors import without_orientation
from core.formats.micmac import SAME_PX, camera_of
from core.formats.micmac_lens import MicmacLens, lens_of_frame
from core.formats.micmac_orientation import SAME, Calibration
from core.formats.micmac_points import by_name, one_set, refuse_again
from core.formats.rotations import is_rotation
from core.formats.xml_files import (
    AGAIN,
    Element,
    add,
    child,
    digits,
    number_of,
    numbers_of,
    own_number,
    read_xml,
    text_of,
    trimmed,
    write_xml,
)
from core.frames import HALF_PIXEL
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation
from core.said import Said, say

PROJECT, SET = "MMVII-PhgrProj", "Gruber"
ORI, CALIB = "Ori-PerspCentral-", "Calib-PerspCentral-"
POSE, INNER, MARKS, POINTS = "CameraPose", "InternalCalibration", "SetMesIm", "SetGCP"
TERMS = re.compile(r"(?i)k[0-9]+|p[12]|b[12]|tan_[xy]|rad_[0-9]+")
"""Names of the terms that are known."""
# source: what MMVII's own files hold.
UNSAID_PIXEL, UNSAID_POINT = (1.0, 0.0, 1.0), (1.0, 0.0, 0.0, 1.0, 0.0, 1.0)
"""Variances that MMVII writes where nobody said any."""


def read_mmvii(folder: Path) -> ExchangeBlock:
    """Read a project of MMVII, its MMVII-PhgrProj, or one set of orientations inside.

    Args:
        folder: Any of the three; the set, where there are several.

    Raises:
        ExchangeError: Nothing of MMVII there, several sets, or a damaged file.
    """
    chosen, root = _orientations(folder)
    cameras: dict[str, ExchangeCamera] = {}
    photos: dict[str, ExchangePhoto] = {}
    notes: dict[str, Said] = {}
    lenses: dict[str, Calibration] = {}
    for path in sorted(chosen.glob(f"{ORI}*.xml")) if chosen is not None else []:
        pose = child(_data(path), POSE, path)
        named = text_of(pose, "NameInternalCalib", path)
        if named not in lenses:
            lenses[named] = _calibration(path, named)
        camera, affine, note = camera_of(lenses[named], SAME, ((0.0, 0.0), (1.0, -1.0)))
        if note is not None:
            notes[named] = note
        photo = _photo(path, pose, camera.name, affine)
        cameras[camera.name], photos[photo.photo_id] = camera, photo
    points, measures = _points_and_measures(root)
    for file, _ in measures:
        name = PurePath(file).stem
        photos.setdefault(name, ExchangePhoto(name, file))
    if not photos and not points:
        raise ExchangeError(
            folder,
            "It holds no orientations, points or measurements of MMVII.",
            "Choose the folder with MMVII-PhgrProj inside.",
        )
    return ExchangeBlock(
        cameras=cameras,
        photos=photos,
        points=points,
        measurements=tuple(one for _, one in measures),
        notes=tuple(notes.values()),
    )


def _orientations(folder: Path) -> tuple[Path | None, Path]:
    """The set of orientations, if there is any, and the folder MMVII-PhgrProj."""
    if not folder.is_dir():
        raise ExchangeError(
            folder, "It is not a folder that can be read.", "Choose the project's folder."
        )
    if any(folder.glob(f"{ORI}*.xml")):
        return folder, folder.parents[1]
    root = folder / PROJECT if (folder / PROJECT).is_dir() else folder
    sets = [one for one in sorted(root.glob("Ori/*")) if any(one.glob(f"{ORI}*.xml"))]
    return one_set(folder, sets), root


def _data(path: Path) -> Element:
    """What a serialised file holds."""
    return child(read_xml(path, "Root"), "Data", path)


def _photo(path: Path, pose: Element, camera: str, affine: Affine2 | None) -> ExchangePhoto:
    """A photo of an orientation file."""
    file = text_of(pose, "NameImage", path)
    axes = child(pose, "RotMatrix", path)
    rotation = np.array([numbers_of(axes, f"Axe{n}", 3, path) for n in "IJK"]).T
    if not is_rotation(rotation):
        raise ExchangeError(path, "AxeI, AxeJ, AxeK are no rotation.", AGAIN)
    centre = np.array(numbers_of(pose, "Center", 3, path))
    exterior = ExteriorOrientation(centre, *angles_from_rotation(rotation @ FLIP))
    return ExchangePhoto(PurePath(file).stem, file, camera, affine, exterior)


def _calibration(orientation: Path, named: str) -> Calibration:
    """The calibration that an orientation names."""
    path = orientation.with_name(f"{PurePath(named).name}.xml")
    if not path.is_file():
        raise ExchangeError(
            orientation,
            "Its calibration {name} is not there.",
            "Put the calibration beside the orientations.",
            name=named,
        )
    one = child(_data(path), INNER, path)
    width, height = (round(side) for side in numbers_of(one, "PixelFrame/NbPix", 2, path))
    ideal = child(one, "PerfectProj", path)
    focal = number_of(ideal, "F", path)
    if focal <= 0 or width <= 0 or height <= 0:
        raise ExchangeError(path, "F and NbPix must be above nought.", AGAIN)
    x, y = numbers_of(ideal, "PP", 2, path)
    terms = {
        term.tag.lower(): own_number(term, path)
        for part in one.findall("Distorsion/*")
        for term in part
    }
    projection = trimmed(one.find("Projection")) or "Stenope"
    unknown = [name for name, value in terms.items() if value and not TERMS.fullmatch(name)]
    lens = None
    if projection == "Stenope" and not unknown:
        order = max((int(name[1:]) for name in terms if name.startswith("k")), default=0)
        radial = tuple(terms.get(f"k{n}", 0.0) / focal ** (2 * n) for n in range(1, order + 1))
        tangential = (terms.get("p1", 0.0) / focal, terms.get("p2", 0.0) / focal)
        affinity = (terms.get("b1", 0.0), terms.get("b2", 0.0))
        lens = MicmacLens(focal, (x, y), (x, y), radial, tangential, affinity)
    name = PurePath(named).name.removeprefix(CALIB)
    model = projection if projection != "Stenope" else ", ".join(unknown)
    size = (width, height)
    return Calibration(path, name, (float(width), float(height)), False, size, lens, model)


def _points_and_measures(
    root: Path,
) -> tuple[dict[str, ExchangePoint], list[tuple[str, ExchangeMeasurement]]]:
    """Points and measurements of the one set of them."""
    points: list[ExchangePoint] = []
    measures: list[tuple[str, ExchangeMeasurement]] = []
    chosen = one_set(root, sorted({path.parent for path in root.glob("*/*/Mes*.xml")}))
    for path in sorted(chosen.glob("Mes*.xml")) if chosen is not None else ():
        data = _data(path)
        for image in data.iter(MARKS):
            measures += _measures(path, image)
        for every in data.iter(POINTS):
            points += _points(path, every)
    return by_name(root, points), measures


def _measures(path: Path, image: Element) -> Iterator[tuple[str, ExchangeMeasurement]]:
    """Measurements in one scan."""
    file = text_of(image, "NameIm", path)
    seen: set[tuple[str, str]] = set()
    for one in image.findall("Measures/el"):
        name = text_of(one, "Name", path)
        refuse_again(path, seen, name, file)
        seen.add((file, name))
        column, row = numbers_of(one, "Pt", 2, path)
        sigma = None
        if one.find("Sigma2") is not None:
            xx, xy, yy = numbers_of(one, "Sigma2", 3, path)
            said = (xx, xy, yy) != UNSAID_PIXEL
            sigma = float(np.sqrt((xx + yy) / 2)) if said else None
        place = (column + HALF_PIXEL, row + HALF_PIXEL)
        yield file, ExchangeMeasurement(name, PurePath(file).stem, *place, sigma)


def _points(path: Path, every: Element) -> Iterator[ExchangePoint]:
    """Surveyed points."""
    for one in every.findall("Measures/el"):
        x, y, z = numbers_of(one, "Pt", 3, path)
        sigma: Triple | None = None
        if one.find("__Opt__Sigma2") is not None:
            values = numbers_of(one, "__Opt__Sigma2", len(UNSAID_POINT), path)
            if values != UNSAID_POINT:
                xx, _, _, yy, _, zz = values
                sx, sy, sz = (float(np.sqrt(value)) for value in (xx, yy, zz))
                sigma = (sx, sy, sz)
        role = "check" if trimmed(one.find("AdditionalInfo")) == "check" else "control"
        yield ExchangePoint(text_of(one, "Name", path), (x, y, z), sigma, role)


def write_mmvii(folder: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write a block as MMVII's folder.

    Returns:
        What was left out, a sentence each.
    """
    root = folder if folder.name == PROJECT else folder / PROJECT
    marks = root / "PointsMeasure" / SET
    missing: list[str] = []
    written: dict[str, FrameCamera] = {}
    notes: list[str] = []
    for photo in block.photos.values():
        camera = block.cameras.get(photo.camera)
        frame = None if camera is None else upright_camera(photo, camera)
        if camera is None or frame is None or photo.exterior is None:
            missing.append(photo.photo_id)
            continue
        notes += _write_photo(root / "Ori" / SET, photo, camera, frame, written)
    for photo in block.photos.values():
        own = [one for one in block.measurements if one.photo_id == photo.photo_id]
        if own:
            _write_measures(marks / f"MesIm-{photo.file}.xml", photo.file, own)
    if block.points:
        _write_points(marks / f"MesGCP-{SET}.xml", block)
    return (*notes, *without_orientation(missing))


def _write_photo(
    folder: Path,
    photo: ExchangePhoto,
    camera: ExchangeCamera,
    frame: FrameCamera,
    written: dict[str, FrameCamera],
) -> Iterator[Said]:
    """An orientation and, where no photo before had the same, a calibration."""
    plain = re.sub(r"[^\w.+-]", "_", camera.name)
    name = plain
    if plain in written and not _same_lens(written[plain], frame):
        name = f"{plain}-{photo.photo_id}"
    if name not in written:
        written[name] = frame
        off = _write_calibration(folder / f"{CALIB}{name}.xml", name, frame, camera)
        if off > SAME_PX:
            yield say(
                "The lens of {name} was fitted by the terms that MMVII holds; it is {off:.2g} px "
                "off at most.",
                name=name,
                off=off,
            )
    rotation, centre = frame.with_rotation_and_centre()
    root = _serialised()
    pose = add(child(root, "Data", folder), POSE)
    add(pose, "NameImage", f'"{photo.file}"')
    add(pose, "NameInternalCalib", f'"{CALIB}{name}"')
    add(pose, "Center", digits(centre))
    axes = add(pose, "RotMatrix")
    for letter, axis in zip("IJK", rotation, strict=True):
        add(axes, f"Axe{letter}", digits(axis))
    write_xml(folder / f"{ORI}{photo.file}.xml", root)


def _same_lens(one: FrameCamera, other: FrameCamera) -> bool:
    """Whether one calibration serves two photos."""
    # design: rounding of doubles.
    near = np.allclose(_inner(one), _inner(other), rtol=1e-12, atol=1e-12)
    return near and one.radial == other.radial


def _inner(frame: FrameCamera) -> list[float]:
    """Numbers of an interior orientation."""
    first = [frame.focal_px, *frame.principal_point_px, frame.affinity_px, frame.skew_px]
    return [*first, *frame.tangential]


def _write_calibration(path: Path, name: str, frame: FrameCamera, camera: ExchangeCamera) -> float:
    """Write a calibration; returns how far it is off at most, pixels."""
    x, y = (value - HALF_PIXEL for value in frame.principal_point_px)
    width, height = camera.size_px or (round(2 * x + 1), round(2 * y + 1))
    lens, off = lens_of_frame(frame, (float(width), float(height)))
    focal = lens.focal
    radial = [value * focal ** (2 * n) for n, value in enumerate(lens.radial, start=1)]
    root = _serialised()
    one = add(child(root, "Data", path), INNER)
    add(one, "Name", f'"{CALIB}{name}"')
    add(add(one, "PixelFrame"), "NbPix", f"{width} {height}")
    add(one, "Projection", '"Stenope"')
    extra = add(one, "Auxiliary")
    add(extra, "SzBuffer", "-1")
    add(extra, "Degree", f"{len(radial)} 1 1")
    add(extra, "DegreeApproxInv", f"{len(radial)} 1 1")
    add(extra, "IsFraserMode", "1")
    ideal = add(one, "PerfectProj")
    add(ideal, "F", digits((focal,)))
    add(ideal, "PP", digits(lens.principal_point))
    parts = add(one, "Distorsion")
    along = add(parts, "Radial")
    for number, value in enumerate(radial, start=1):
        add(along, f"K{number}", digits((value,)))
    for part, terms, values in (
        ("Decentric", ("p1", "p2"), (lens.tangential[0] * focal, lens.tangential[1] * focal)),
        ("Polynomial", ("b1", "b2"), lens.affinity),
    ):
        holder = add(parts, part)
        for term, value in zip(terms, values, strict=True):
            add(holder, term, digits((value,)))
    notes = add(one, "Informations")
    add(notes, "el", '"Written by Gruber"')
    write_xml(path, root)
    return off


def _write_measures(path: Path, file: str, measurements: list[ExchangeMeasurement]) -> None:
    """Measurements in one scan."""
    root = _serialised()
    image = add(child(root, "Data", path), MARKS)
    add(image, "NameIm", f'"{file}"')
    holder = add(image, "Measures")
    for one in measurements:
        mark = add(holder, "el")
        add(mark, "Name", f'"{one.point_id}"')
        add(mark, "Pt", digits((one.column - HALF_PIXEL, one.row - HALF_PIXEL)))
        variance = UNSAID_PIXEL
        if one.sigma_px is not None:
            variance = (one.sigma_px**2, 0.0, one.sigma_px**2)
        add(mark, "Sigma2", digits(variance))
    write_xml(path, root)


def _write_points(path: Path, block: ExchangeBlock) -> None:
    """Surveyed points."""
    root = _serialised()
    every = add(child(root, "Data", path), POINTS)
    add(every, "NameSet", f'"{SET}"')
    holder = add(every, "Measures")
    for point in block.points.values():
        one = add(holder, "el")
        add(one, "Name", f'"{point.point_id}"')
        add(one, "Pt", digits(point.position))
        add(one, "AdditionalInfo", '"check"' if point.role == "check" else '""')
        if point.sigma_m is not None:
            sx, sy, sz = (value**2 for value in point.sigma_m)
            add(one, "__Opt__Sigma2", digits((sx, 0.0, 0.0, sy, 0.0, sz)))
    write_xml(path, root)


def _serialised() -> Element:
    """The root of every file of MMVII, with an empty Data."""
    root = ElementTree.Element("Root")
    add(root, "Type", '"MMVII_Serialization"')
    add(root, "Version", '"0.0.0"')
    add(root, "Data")
    return root


MMVII = ExchangeFormat(
    name="mmvii",
    title="MMVII",
    conventions=Conventions(
        pixels="column right, row down, from the centre of the first pixel",
        object_space="right-handed, metres, Euclidean",
        rotation="AxeI, AxeJ, AxeK: the camera's axes (x right, y down, z forwards) in object "
        "space",
        camera="F and PP in pixels; K1.., p1, p2, b1, b2 in units of F, from the ideal to the "
        "measured place",
        sigmas="points and measurements, as variances (1 stands for none)",
        lost="CRS, deviations of orientations, fiducials, millimetres, tie points; affinity and "
        "skew beside distortion are fitted",
        tested="orientations, calibrations, points and measurements that MMVII wrote",
    ),
    holds="frame",
    write=write_mmvii,
    read=read_mmvii,
    default_name="mmvii",
    curved=False,
)
"""MMVII's folder."""
