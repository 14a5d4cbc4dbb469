"""COLMAP's sparse model: cameras, images, points3D as text and as binary (FORMATS 4.11).

Pixels count from the outer corner, as ours do. Coordinates go out minus a round origin, which
`gruber.json` beside the model holds with the CRS, so that viewers of single precision show them
and nothing is lost on the way back.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation as Turn

from core.arrays import ObjectPoints, PixelPoints, Position, Rotation
from core.errors import ExchangeError
from core.formats.colmap_files import (
    Image,
    Model,
    Point,
    read_binary,
    read_text_model,
    write_binary,
    write_text_model,
)
from core.formats.exchange import (
    Conventions,
    ExchangeBlock,
    ExchangeFormat,
    ExchangePhoto,
    ExchangeTies,
    FrameInterior,
)
from core.formats.frame_interiors import (
    FramePhotos,
    exchange_camera,
    exchange_photo,
    frame_photos,
    frames_with_origin,
    named_photos,
    size_of,
    where_any,
    without_orientation,
)
from core.formats.records import read_text, write_json
from core.formats.xml_files import AGAIN
from core.said import say

SIDECAR = "gruber.json"
"""Origin, CRS and names: what COLMAP has no place for."""
# source: COLMAP, src/colmap/sensor/models.h; k4, k5, k6 divide and are not held by a block.
RADIAL_TERMS = {"SIMPLE_RADIAL": 1, "RADIAL": 2, "OPENCV": 2, "FULL_OPENCV": 3}
"""Most radial terms of each model."""
ONE_FOCAL = ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
"""Models with one principal distance for columns and rows."""


def write_colmap(folder: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write the model as text and as binary, side by side.

    Returns:
        What was left out, a sentence each.

    Raises:
        ExchangeError: No photo has an orientation.
    """
    photos = frame_photos(block)
    oriented, origin = frames_with_origin(photos, folder)
    numbers = {name: number for number, name in enumerate(photos.interiors, 1)}
    points, seen = _tracks(block.ties, tuple(oriented), origin)
    images: dict[int, Image] = {}
    for number, (name, frame) in enumerate(oriented.items(), 1):
        rotation, centre = frame.with_rotation_and_centre()
        pixels, ids = seen[name]
        turn = Turn.from_matrix(rotation).as_quat(canonical=True, scalar_first=True)
        shift = -rotation @ (centre - origin)
        camera = numbers[photos.camera[name]]
        images[number] = Image(turn, shift, camera, block.photos[name].file, pixels, ids)
    cameras = {numbers[name]: colmap_camera(one) for name, one in photos.interiors.items()}
    model = Model(cameras, images, points)
    folder.mkdir(parents=True, exist_ok=True)
    write_text_model(folder, model)
    write_binary(folder, model)
    told = {
        "crs": block.crs,
        "origin": origin.tolist(),
        "cameras": {str(number): name for name, number in numbers.items()},
        "ties": {str(n): block.ties.names[n - 1] for n in points if block.ties.names},
    }
    write_json(folder / SIDECAR, told)
    return _notes(block, photos, set(oriented), len(points))


def read_colmap(path: Path) -> ExchangeBlock:
    """Read a model: the folder, or one of its files. Binary is preferred where both are there.

    Raises:
        ExchangeError: Files missing, damaged or contradictory; a lens that a block cannot hold.
    """
    folder = path if path.is_dir() else path.parent
    if (folder / "cameras.bin").exists():
        model = read_binary(folder)
    elif (folder / "cameras.txt").exists():
        model = read_text_model(folder)
    else:
        raise ExchangeError(
            folder,
            "It holds neither cameras.txt nor cameras.bin.",
            "Choose the folder of COLMAP's sparse model.",
        )
    told = read_sidecar(folder)
    interiors = {
        number: interior_of(folder, number, *camera) for number, camera in model.cameras.items()
    }
    names = {number: told.cameras.get(str(number), f"camera{number}") for number in interiors}
    photos = [
        _photo(folder, image, interiors, names, told.origin) for image in model.images.values()
    ]
    return ExchangeBlock(
        told.crs,
        {names[number]: exchange_camera(names[number], one) for number, one in interiors.items()},
        named_photos(photos, folder),
        ties=_ties(folder, model, photos, told),
        notes=()
        if (folder / SIDECAR).exists()
        else ("COLMAP names no CRS: coordinates are those of its own model.",),
    )


def colmap_camera(interior: FrameInterior) -> tuple[str, tuple[int, int], list[float]]:
    """The smallest of COLMAP's models that holds a camera: its name, size and parameters.

    Skew and terms beyond k3 are left out.
    """
    size = size_of(interior)
    f, (cx, cy) = interior.focal_px, interior.principal_point_px
    terms = [*interior.radial[:3]]
    while terms and terms[-1] == 0.0:
        terms.pop()
    p1, p2 = interior.tangential
    if interior.affinity_px == 0.0 and (p1, p2) == (0.0, 0.0) and len(terms) < 3:
        return ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")[len(terms)], size, [f, cx, cy, *terms]
    both = [f + interior.affinity_px, f, cx, cy]
    if not terms and (p1, p2) == (0.0, 0.0):
        return "PINHOLE", size, both
    k1, k2, k3 = [*terms, 0.0, 0.0, 0.0][:3]
    if k3 == 0.0:
        return "OPENCV", size, [*both, k1, k2, p1, p2]
    return "FULL_OPENCV", size, [*both, k1, k2, p1, p2, k3, 0.0, 0.0, 0.0]


def interior_of(
    path: Path, number: int, model: str, size: tuple[int, int], values: list[float]
) -> FrameInterior:
    """The frame camera of one of COLMAP's.

    Raises:
        ExchangeError: A model with a lens that a block cannot hold, or impossible values.
    """
    lens = values[3:] if model in ONE_FOCAL else values[4:]
    if model not in ("SIMPLE_PINHOLE", "PINHOLE", *RADIAL_TERMS) or any(lens[5:]):
        raise ExchangeError(
            path,
            "Camera {number} has the model {model}.",
            "Take over frame cameras alone: SIMPLE_PINHOLE to FULL_OPENCV without k4, k5, k6.",
            number=number,
            model=model,
        )
    focal_x, focal_y = (values[0], values[0]) if model in ONE_FOCAL else (values[0], values[1])
    if not (np.isfinite(values).all() and focal_x > 0 and focal_y > 0 and min(size) > 0):
        raise ExchangeError(path, "Camera {number} has impossible values.", AGAIN, number=number)
    place = values[1:3] if model in ONE_FOCAL else values[2:4]
    tangential = (lens[2], lens[3]) if model.endswith("OPENCV") else (0.0, 0.0)
    radial = tuple(lens[:2]) + tuple(lens[4:5])
    point = (place[0], place[1])
    return FrameInterior(size, focal_y, point, focal_x - focal_y, 0.0, radial, tangential)


def _tracks(
    ties: ExchangeTies, oriented: tuple[str, ...], origin: Position
) -> tuple[dict[int, Point], dict[str, tuple[PixelPoints, list[int]]]]:
    """Points by number with what sees them, and the rays of every oriented photo."""
    image = {name: number for number, name in enumerate(oriented, 1)}
    seen: dict[str, tuple[list[list[float]], list[int]]] = {name: ([], []) for name in oriented}
    tracks: dict[int, list[tuple[int, int]]] = {}
    positions = ties.positions
    for point, photo, pixel in zip(
        ties.point.tolist(), ties.photo.tolist(), ties.pixels.tolist(), strict=True
    ):
        name = ties.photo_ids[photo]
        if positions is None or name not in image or not np.isfinite(positions[point]).all():
            continue
        pixels, ids = seen[name]
        tracks.setdefault(point + 1, []).append((image[name], len(ids)))
        pixels.append(pixel)
        ids.append(point + 1)
    points: dict[int, Point] = {}
    for number in sorted(tracks):
        assert positions is not None
        points[number] = Point(positions[number - 1] - origin, tracks[number])
    rays = {
        name: (np.array(pixels, dtype=np.float64).reshape(-1, 2), ids)
        for name, (pixels, ids) in seen.items()
    }
    return points, rays


def _notes(
    block: ExchangeBlock, photos: FramePhotos, oriented: set[str], points: int
) -> tuple[str, ...]:
    """What COLMAP cannot hold of this block."""
    notes = without_orientation(name for name in block.photos if name not in oriented)
    skewed = [name for name, one in photos.interiors.items() if one.skew_px or one.radial[3:]]
    notes += where_any(
        skewed, say("COLMAP holds no skew and no k4; left out of: {photos}.", photos=skewed)
    )
    unsized = [name for name, one in photos.interiors.items() if one.size_px is None]
    notes += where_any(
        unsized,
        say("The size of the scans is not known and was guessed: {photos}.", photos=unsized),
    )
    if block.points:
        notes += ("COLMAP holds no surveyed points; points and measurements are left out.",)
    lost = len(np.unique(block.ties.point)) - points
    if lost:
        notes += (
            say(
                "{count:# tie point|# tie points} without coordinates or photos left out.",
                count=lost,
            ),
        )
    return notes


@dataclass(frozen=True, slots=True, eq=False)
class Sidecar:
    """What COLMAP has no place for."""

    crs: str
    """CRS of the coordinates."""
    origin: Position
    """What was taken off all coordinates, metres."""
    cameras: Mapping[str, str]
    """Names of cameras by number."""
    ties: Mapping[str, str]
    """Names of tie points by number."""
    photos: Mapping[str, tuple[float, ...]]
    """Principal point, columns and rows by scan, for programs that have no place for them."""


def read_sidecar(folder: Path) -> Sidecar:
    """The file beside a model; nothing and no origin where there is none.

    Raises:
        ExchangeError: It is damaged.
    """
    path = folder / SIDECAR
    if not path.exists():
        return Sidecar("", np.zeros(3), {}, {}, {})
    try:
        told = json.loads(read_text(path))
        origin = np.array([float(value) for value in told["origin"]])
        if origin.shape != (3,) or not np.isfinite(origin).all():
            raise ValueError("origin")
        cameras = {str(key): str(name) for key, name in told.get("cameras", {}).items()}
        ties = {str(key): str(name) for key, name in told.get("ties", {}).items()}
        photos = {str(k): tuple(map(float, v)) for k, v in told.get("photos", {}).items()}
        if not np.isfinite([value for values in photos.values() for value in values]).all():
            raise ValueError("photos")
        return Sidecar(str(told["crs"]), origin, cameras, ties, photos)
    except (ValueError, KeyError, TypeError, AttributeError, IndexError, RecursionError) as error:
        raise ExchangeError(
            path,
            "It says no origin and CRS ({error}).",
            "Export the model again, or take this file away to read local coordinates.",
            error=error,
        ) from error


def _photo(
    path: Path,
    image: Image,
    interiors: dict[int, FrameInterior],
    names: dict[int, str],
    origin: Position,
) -> ExchangePhoto:
    """One of COLMAP's images."""
    if image.camera not in interiors:
        raise ExchangeError(
            path,
            "{name} has camera {number}, which is not there.",
            AGAIN,
            name=image.name,
            number=image.camera,
        )
    if not (np.isfinite(image.turn).all() and np.isfinite(image.shift).all() and image.turn.any()):
        raise ExchangeError(path, "{name} has no orientation.", AGAIN, name=image.name)
    rotation: Rotation = Turn.from_quat(image.turn, scalar_first=True).as_matrix()
    return exchange_photo(
        image.name,
        names[image.camera],
        interiors[image.camera],
        rotation,
        origin - rotation.T @ image.shift,
    )


def _ties(path: Path, model: Model, photos: list[ExchangePhoto], told: Sidecar) -> ExchangeTies:
    """Tracks of the points; what belongs to none is left."""
    place = {number: index for index, number in enumerate(model.points)}
    index = {number: one for one, number in enumerate(model.images)}
    rays: list[tuple[int, int, list[float]]] = []
    for number, point in model.points.items():
        for image, spot in point.track:
            if image not in index or not 0 <= spot < len(model.images[image].pixels):
                raise ExchangeError(
                    path, "Point {number} is seen in what is not there.", AGAIN, number=number
                )
            rays.append((place[number], index[image], model.images[image].pixels[spot].tolist()))
    if not rays:
        return ExchangeTies.none()
    positions: ObjectPoints = np.array([one.position for one in model.points.values()])
    return ExchangeTies(
        tuple(photo.photo_id for photo in photos),
        np.array([ray[0] for ray in rays]),
        np.array([ray[1] for ray in rays]),
        np.array([ray[2] for ray in rays]),
        tuple(told.ties.get(str(number), str(number)) for number in model.points),
        positions + told.origin,
    )


COLMAP = ExchangeFormat(
    name="colmap",
    title="COLMAP",
    conventions=Conventions(
        pixels="column right, row down, from the outer corner of the first pixel",
        object_space="right-handed, metres; a round origin is taken off and kept in gruber.json",
        rotation="unit quaternion w x y z: camera (x right, y down, z forwards) from object; "
        "translation is minus the turned centre",
        camera="smallest of SIMPLE_PINHOLE, SIMPLE_RADIAL, RADIAL, PINHOLE, OPENCV, FULL_OPENCV "
        "that holds the lens; pixels",
        lost="surveyed points and their measurements, fiducials, photos that are not oriented, "
        "tie points without coordinates, skew, standard deviations",
        tested="a text model that COLMAP wrote; pycolmap opens what we write",
    ),
    holds="upright",
    write=write_colmap,
    read=read_colmap,
    default_name="colmap",
    curved=False,
)
"""COLMAP's sparse model."""
