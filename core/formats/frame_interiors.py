"""Interior orientations as other programs hold them: one named frame camera for several photos.

Every scan may lie differently, so one camera of ours can become several of theirs.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.arrays import Position, Rotation
from core.errors import ExchangeError
from core.formats.exchange import (
    ExchangeBlock,
    ExchangeCamera,
    ExchangePhoto,
    FrameCamera,
    FrameInterior,
    Triple,
    from_frame_camera,
    placed,
    upright_camera,
)
from core.said import say

# source: rounding of the affine's decomposition, relative to the principal distance.
ROUNDING = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class FramePhotos:
    """Photos of a block as frame cameras."""

    interiors: Mapping[str, FrameInterior]
    """By the name the other program is given."""
    camera: Mapping[str, str]
    """Name of the interior of each photo that has one."""
    frames: Mapping[str, FrameCamera]
    """All of each photo that has an interior orientation."""
    lost: tuple[str, ...]
    """Photos without interior orientation, or scanned from their back."""


def frame_photos(block: ExchangeBlock) -> FramePhotos:
    """All photos of a block; those that no frame camera can hold are named."""
    interiors: dict[str, FrameInterior] = {}
    names: dict[FrameInterior, str] = {}
    camera: dict[str, str] = {}
    frames: dict[str, FrameCamera] = {}
    lost: list[str] = []
    for photo_id, photo in block.photos.items():
        lens = block.cameras.get(photo.camera, ExchangeCamera(photo.camera))
        frame = upright_camera(photo, lens)
        if frame is None:
            lost.append(photo_id)
            continue
        interior = _interior(lens, frame)
        if interior not in names:
            name = photo.camera or "camera"
            names[interior] = name if name not in interiors else f"{name}-{photo_id}"
            interiors[names[interior]] = interior
        camera[photo_id], frames[photo_id] = names[interior], frame
    return FramePhotos(interiors, camera, frames, tuple(lost))


def frames_with_origin(
    photos: FramePhotos, folder: Path
) -> tuple[dict[str, FrameCamera], Position]:
    """Photos with an orientation, and a round place near their middle.

    Raises:
        ExchangeError: None has one.
    """
    found = {n: one for n, one in photos.frames.items() if one.camera_from_object is not None}
    if not found:
        raise ExchangeError(folder, "No photo of the block is oriented.", "Adjust the block first.")
    return found, rounded_origin([one.with_rotation_and_centre()[1] for one in found.values()])


def without_orientation(names: Iterable[str]) -> tuple[str, ...]:
    """A word on photos that were left out, where there are any."""
    listed = list(names)
    told = say(
        "Without interior or exterior orientation, or scanned from their back, and so left out: "
        "{photos}.",
        photos=listed,
    )
    return where_any(listed, told)


def size_of(interior: FrameInterior) -> tuple[int, int]:
    """Columns and rows; a frame about the principal point where nobody knows them."""
    column, row = interior.principal_point_px
    return interior.size_px or (max(1, round(2 * column)), max(1, round(2 * row)))


def _interior(lens: ExchangeCamera, frame: FrameCamera) -> FrameInterior:
    """Without what is rounding alone."""
    limit = ROUNDING * frame.focal_px
    affinity, skew = (
        0.0 if abs(value) < limit else value for value in (frame.affinity_px, frame.skew_px)
    )
    point, focal = frame.principal_point_px, frame.focal_px
    return FrameInterior(lens.size_px, focal, point, affinity, skew, frame.radial, frame.tangential)


def exchange_camera(name: str, interior: FrameInterior) -> ExchangeCamera:
    """The camera of ours that belongs to a frame camera."""
    _, tangential, _ = from_frame_camera(placed(interior))
    return ExchangeCamera(name, trimmed_radial(interior.radial), tangential, interior.size_px)


def trimmed_radial(radial: tuple[float, ...]) -> tuple[float, ...]:
    """Radial terms without noughts at their end."""
    while radial and radial[-1] == 0.0:
        radial = radial[:-1]
    return radial


def exchange_photo(
    file: str,
    camera: str,
    interior: FrameInterior | None,
    rotation: Rotation | None = None,
    centre: Position | None = None,
    sigma_centre_m: Triple | None = None,
) -> ExchangePhoto:
    """A photo of ours.

    Args:
        file: File name of the scan, without folder.
        camera: Name of its camera.
        interior: Its frame camera; None where nothing is known of it.
        rotation: Into the camera's axes (x right, y down, z forwards); None if not oriented.
        centre: Perspective centre, metres.
        sigma_centre_m: Standard deviations of the centre.
    """
    shape = interior or FrameInterior(None, 1.0, (0.0, 0.0))
    matrix, _, exterior = from_frame_camera(placed(shape, rotation, centre))
    known = None if interior is None else matrix
    return ExchangePhoto(photo_name(file), file, camera, known, exterior, sigma_centre_m)


SCANS = (".tif", ".tiff", ".jpg", ".jpeg", ".png", ".jp2", ".vrt", ".img", ".bmp")
"""Extensions of scans; other points in a name belong to it."""


def photo_name(file: str) -> str:
    """Name of a photo: that of its scan without folder and extension."""
    name = file.replace("\\", "/").rsplit("/", 1)[-1]
    stem, dot, extension = name.rpartition(".")
    return stem if dot and stem and f".{extension.lower()}" in SCANS else name


def named_photos(photos: list[ExchangePhoto], path: Path) -> dict[str, ExchangePhoto]:
    """Photos by name.

    Raises:
        ExchangeError: Two have the same.
    """
    found: dict[str, ExchangePhoto] = {}
    for photo in photos:
        other = found.setdefault(photo.photo_id, photo)
        if other is not photo:
            raise ExchangeError(
                path,
                "{one} and {other} would be one photo.",
                "Rename one of the two scans.",
                one=other.file,
                other=photo.file,
            )
    return found


def where_any(names: Sequence[str], sentence: str) -> tuple[str, ...]:
    """A sentence about photos or cameras, where there are any."""
    return (sentence,) if names else ()


def rounded_origin(positions: list[Position]) -> Position:
    """A round place near the middle, metres: small numbers remain when it is taken off."""
    if not positions:
        return np.zeros(3)
    # design: kilometres are easily read, and what remains has no more digits than it needs.
    return np.round(np.mean(np.array(positions), axis=0) / 1000.0) * 1000.0
