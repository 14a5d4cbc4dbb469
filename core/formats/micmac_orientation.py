"""MicMac's Orientation-SCAN.xml and AutoCal*.xml, in millimetres or pixels (FORMATS 4.4).

The world is Centre + [L1; L2; L3] ray, with rays x right, y down, z forwards; OrIntImaM2C takes
the calibration's unit into the scan, whose pixels count from the centre of the first.
"""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath, PureWindowsPath

import numpy as np

from core.arrays import Affine2, Position, Rotation
from core.errors import ExchangeError
from core.formats.exchange import FLIP, Pair, Triple
from core.formats.micmac_lens import MicmacLens
from core.formats.micmac_points import UNSAID, sigma_or_none
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
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation, rotation_from_angles

PREFIX, SUFFIX = "Orientation-", ".xml"
FORWARDS, BACKWARDS = "eConvApero_DistM2C", "eConvApero_DistC2M"
# source: definition of degree and gon.
ANGLES = {
    "eConvAngErdas": np.pi / 180,
    "eConvAngErdas_Grade": np.pi / 200,
    "eConvAngPhotoMDegre": np.pi / 180,
    "eConvAngPhotoMGrade": np.pi / 200,
}
"""Conventions whose three angles are omega, phi, kappa, with a unit's radians."""
SAME = np.column_stack([np.eye(2), np.zeros(2)])
"""OrIntImaM2C of a camera that counts in pixels."""


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """One AutoCal file."""

    path: Path
    """The file."""
    name: str
    """What the camera is called."""
    size: Pair
    """SzIm, in the file's unit."""
    scanned: bool
    """Whether its unit is the millimetre of a film."""
    size_px: tuple[int, int] | None
    """PixelSzIm, or SzIm of a camera that counts in pixels."""
    lens: MicmacLens | None
    """What the lens does; None where the model is none that can be taken over."""
    model: str
    """Name of its distortion's model."""
    scan_from_unit: Affine2 = field(default_factory=lambda: SAME)
    """Inverse of OrIntGlob: what OrIntImaM2C begins from, from the file's unit."""


@dataclass(frozen=True, slots=True, eq=False)
class OrientedImage:
    """One Orientation file."""

    path: Path
    """The file."""
    file: str
    """File name of the scan."""
    calibration: Path | Element
    """The file of its calibration, or the calibration itself where it stands inside."""
    pixel_from_file: Affine2
    """OrIntImaM2C: pixels, from the centre of the first, from the calibration's unit."""
    exterior: ExteriorOrientation
    """Where it was taken."""
    sigma_centre_m: Triple | None
    """IncCentre, metres."""


def read_orientation(path: Path) -> OrientedImage:
    """Read an Orientation file.

    Raises:
        ExchangeError: Damaged, something missing, or a convention that is not known.
    """
    root = read_xml(path)
    one = root if root.tag == "OrientationConique" else child(root, "OrientationConique", path)
    place = child(one, "Externe", path)
    rotation = _rotation(place, _convention(one, place, path), path)
    centre = np.array(numbers_of(place, "Centre", 3, path))
    affine = SAME
    if one.find("OrIntImaM2C") is not None:
        affine = _affine(child(one, "OrIntImaM2C", path), path)
    inside = one.find("Interne")
    calibration = _calibration_file(path, one) if inside is None else inside
    sigma = None
    if place.find("IncCentre") is not None:
        sigma = sigma_or_none(numbers_of(place, "IncCentre", 3, path))
    name = path.name.removeprefix(PREFIX).removesuffix(SUFFIX)
    exterior = ExteriorOrientation(centre, *angles_from_rotation(rotation))
    return OrientedImage(path, name, calibration, affine, exterior, sigma)


def _convention(one: Element, place: Element, path: Path) -> str:
    """Name of the rotation's convention."""
    said = {trimmed(place.find("KnownConv")), trimmed(one.find("ConvOri/KnownConv"))} - {""}
    if len(said) > 1:
        raise ExchangeError(
            path, "It names two conventions: {names}.", AGAIN, names=", ".join(sorted(said))
        )
    return next(iter(said), FORWARDS)


def _rotation(place: Element, convention: str, path: Path) -> Rotation:
    """The rotation from image to object space, by matrix or by angles."""
    matrix = place.find("ParamRotation/CodageMatr")
    if matrix is not None and convention in (FORWARDS, BACKWARDS):
        rows = np.array([numbers_of(matrix, f"L{n}", 3, path) for n in (1, 2, 3)])
        if not is_rotation(rows):
            raise ExchangeError(path, "L1, L2, L3 are no rotation.", AGAIN)
        return rows @ FLIP
    if place.find("ParamRotation/CodageAngulaire") is not None and convention in ANGLES:
        angles = numbers_of(child(place, "ParamRotation", path), "CodageAngulaire", 3, path)
        return rotation_from_angles(*(angle * ANGLES[convention] for angle in angles))
    raise ExchangeError(
        path,
        "Its rotation follows {convention}, which is not known.",
        "Convert it with mm3d OriConvert, or export the orientation as a matrix.",
        convention=convention,
    )


def _affine(element: Element, path: Path) -> Affine2:
    """I00, V10, V01 as 2 x 3."""
    columns = [numbers_of(element, tag, 2, path) for tag in ("V10", "V01", "I00")]
    affine = np.array(columns).T
    # design: a pixel of a nanometre is rounding.
    if abs(np.linalg.det(affine[:, :2])) < 1e-18:
        raise ExchangeError(path, "OrIntImaM2C is no transform: its pixel has no area.", AGAIN)
    return affine


def _calibration_file(path: Path, one: Element) -> Path:
    """Where the calibration lies: beside the orientation, or as named from the project's folder."""
    named = text_of(one, "FileInterne", path)
    name = PureWindowsPath(named).name if "\\" in named else PurePosixPath(named).name
    beside, below = path.with_name(name), path.parent.parent / named
    found = next((file for file in (beside, below) if file.is_file()), None)
    if found is None:
        raise ExchangeError(
            path,
            "Its calibration {name} is not there.",
            "Put the calibration beside the orientations.",
            name=named,
        )
    return found


def read_calibration(source: Path | Element, path: Path) -> Calibration:
    """Read a calibration.

    Args:
        source: Its file, or the element inside an orientation.
        path: The file, for messages, and for the name of the camera.

    Raises:
        ExchangeError: Damaged, something missing, or numbers that are no camera.
    """
    one = read_xml(source) if isinstance(source, Path) else source
    one = next(one.iter("CalibrationInternConique"), one)
    width, height = numbers_of(one, "SzIm", 2, path)
    focal = number_of(one, "F", path)
    if focal <= 0 or width <= 0 or height <= 0:
        raise ExchangeError(path, "F and SzIm must be above nought.", AGAIN)
    scanned = trimmed(one.find("ScannedAnalogik")) == "true"
    pixels = None if scanned else (round(width), round(height))
    if one.find("PixelSzIm") is not None:
        columns, rows = numbers_of(one, "PixelSzIm", 2, path)
        pixels = (round(columns), round(rows))
    known = one.find("KnownConv")
    backwards = known is not None and trimmed(known) == BACKWARDS
    lens, model = _lens(one, focal, backwards, path)
    common = SAME
    if one.find("OrIntGlob") is not None:
        common = _common(child(one, "OrIntGlob", path), path)
    if lens is not None and not lens.plain and common is not SAME:
        lens, model = None, "OrIntGlob"
    name = path.stem.removeprefix("AutoCal_")
    return Calibration(path, name, (width, height), scanned, pixels, lens, model, common)


def _common(element: Element, path: Path) -> Affine2:
    """The transform of all scans of a camera, from the calibration's unit."""
    affine = _affine(child(element, "Affinite", path), path)
    if text_of(element, "C2M", path) != "true":
        return affine
    linear = np.linalg.inv(affine[:, :2])
    return np.column_stack([linear, -linear @ affine[:, 2]])


def _lens(one: Element, focal: float, backwards: bool, path: Path) -> tuple[MicmacLens | None, str]:
    """The lens, or None, and the name of its model."""
    pp = _pair(one, "PP", path)
    models = [model for block in one.findall("CalibDistortion") for model in block]
    models = [model for model in models if model.tag != "ModNoDist"]
    if not models:
        return MicmacLens(focal, pp, pp, backwards=backwards), "ModNoDist"
    model = models[0]
    if len(models) > 1 or model.tag not in ("ModRad", "ModPhgrStd"):
        named = trimmed(models[-1].find("TypeModele"))
        return None, named or " + ".join(each.tag for each in models)
    part = model if model.tag == "ModRad" else child(model, "RadialePart", path)
    centre = _pair(part, "CDist", path)
    radial = tuple(own_number(each, path) for each in part.findall("CoeffDist"))
    p1, p2, b1, b2 = (
        number_of(model, tag, path) if model.find(tag) is not None else 0.0
        for tag in ("P1", "P2", "b1", "b2")
    )
    return MicmacLens(focal, pp, centre, radial, (p1, p2), (b1, b2), backwards), model.tag


def _pair(element: Element, tag: str, path: Path) -> Pair:
    """Two numbers."""
    x, y = numbers_of(element, tag, 2, path)
    return x, y


def write_calibration(calibration: Calibration) -> None:
    """Write an AutoCal file, whose lens must be one without b1, b2."""
    lens = calibration.lens
    assert lens is not None, "a camera without lens is not written"
    assert lens.plain, "only a plain lens is written"
    root = ElementTree.Element("ExportAPERO")
    one = add(root, "CalibrationInternConique")
    add(one, "KnownConv", FORWARDS)
    add(one, "PP", digits(lens.principal_point))
    add(one, "F", digits((lens.focal,)))
    add(one, "SzIm", " ".join(str(round(side)) for side in calibration.size))
    if calibration.scanned:
        if calibration.size_px is not None:
            add(one, "PixelSzIm", " ".join(str(side) for side in calibration.size_px))
        add(one, "ScannedAnalogik", "true")
    block = add(one, "CalibDistortion")
    bent = lens.tangential != (0.0, 0.0)
    model = add(block, "ModPhgrStd" if bent else "ModRad")
    part = add(model, "RadialePart") if bent else model
    add(part, "CDist", digits(lens.centre))
    for value in lens.radial:
        add(part, "CoeffDist", digits((value,)))
    add(part, "PPaEqPPs", "true")
    if bent:
        add(model, "P1", digits(lens.tangential[:1]))
        add(model, "P2", digits(lens.tangential[1:]))
    write_xml(calibration.path, root)


def write_orientation(image: OrientedImage, ground: float | None) -> None:
    """Write an Orientation file.

    Args:
        image: All of it; `calibration` must be a file.
        ground: Height of the ground below it, metres, where it is known.
    """
    assert isinstance(image.calibration, Path), "a calibration stands in its own file"
    root = ElementTree.Element("ExportAPERO")
    one = add(root, "OrientationConique")
    affine = add(one, "OrIntImaM2C")
    for tag, column in (("I00", 2), ("V10", 0), ("V01", 1)):
        add(affine, tag, digits(image.pixel_from_file[:, column]))
    add(one, "TypeProj", "eProjStenope")
    folder = image.path.parent.name
    add(one, "FileInterne", f"{folder}/{image.calibration.name}")
    add(one, "RelativeNameFI", "true")
    place = add(one, "Externe")
    centre: Position = image.exterior.centre
    if ground is not None:
        add(place, "AltiSol", digits((ground,)))
        add(place, "Profondeur", digits((max(float(centre[2]) - ground, 0.0),)))
    add(place, "KnownConv", FORWARDS)
    add(place, "Centre", digits(centre))
    add(place, "IncCentre", digits(image.sigma_centre_m or UNSAID))
    rows = image.exterior.object_from_image @ FLIP
    matrix = add(add(place, "ParamRotation"), "CodageMatr")
    for number, row in enumerate(rows, start=1):
        add(matrix, f"L{number}", digits(row))
    add(add(one, "ConvOri"), "KnownConv", FORWARDS)
    write_xml(image.path, root)
