"""Bundler's bundle.out v0.3 with list.txt (FORMATS 4.12).

Its camera is ours: x right, y up, z backwards. Places count from the principal point, y up; the
file names neither that nor the size of the scans, so `gruber.json` beside it does.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation as Turn

from core.arrays import PixelPoints
from core.errors import ExchangeError
from core.formats.colmap import SIDECAR, Sidecar, read_sidecar
from core.formats.colmap_files import GREY
from core.formats.exchange import (
    FLIP,
    Conventions,
    ExchangeBlock,
    ExchangeCamera,
    ExchangeFormat,
    ExchangePhoto,
    ExchangeTies,
    FrameInterior,
    ideal_from_image,
    image_from_ideal,
)
from core.formats.frame_interiors import (
    exchange_camera,
    exchange_photo,
    frame_photos,
    frames_with_origin,
    named_photos,
    trimmed_radial,
    where_any,
    without_orientation,
)
from core.formats.records import read_text, write_json
from core.formats.words import in_words
from core.formats.xml_files import AGAIN, digits
from core.said import say

BUNDLE, NAMES = "bundle.out", "list.txt"
HEAD = "# Bundle file v0.3"
CAMERA = 15  # source: Bundler's manual; f, k1, k2, nine of the rotation, three of the translation.
VIEW = 4  # source: Bundler's manual; camera, key, x, y.
MIDDLE = (0.0, 0.0)  # source: Bundler's manual; the middle of the image.
"""Principal point of a scan of unknown size: Bundler puts it into the middle."""
RADIAL_TERMS = 2  # source: Bundler's manual; k1, k2.


def write_bundler(folder: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write bundle.out and list.txt.

    Returns:
        What was left out, a sentence each.

    Raises:
        ExchangeError: No photo is oriented.
    """
    block, renamed = in_words(block)
    photos = frame_photos(block)
    oriented, origin = frames_with_origin(photos, folder)
    lines: list[str] = []
    for frame in oriented.values():
        rotation, centre = frame.with_rotation_and_centre()
        image = FLIP @ rotation
        radial = (*frame.radial, 0.0, 0.0)[:RADIAL_TERMS]
        lines.append(digits([frame.focal_px, *radial]))
        lines += [digits(row) for row in (*image, -image @ (centre - origin))]
    points = _point_lines(block, oriented, photos.interiors, photos.camera, origin)
    folder.mkdir(parents=True, exist_ok=True)
    head = [HEAD, f"{len(oriented)} {len(points)}"]
    (folder / BUNDLE).write_text("\n".join([*head, *lines, *points]) + "\n", encoding="utf-8")
    files = [block.photos[name].file for name in oriented]
    (folder / NAMES).write_text("\n".join(files) + "\n", encoding="utf-8")
    told = {
        "crs": block.crs,
        "origin": origin.tolist(),
        "photos": {
            block.photos[name].file: [
                *frame.principal_point_px,
                *(photos.interiors[photos.camera[name]].size_px or (0, 0)),
            ]
            for name, frame in oriented.items()
        },
    }
    write_json(folder / SIDECAR, told)
    notes = renamed + without_orientation(name for name in block.photos if name not in oriented)
    bent = [name for name, one in photos.interiors.items() if _is_beyond(one)]
    return notes + where_any(
        bent,
        say("Bundler holds k1 and k2 alone; places were freed of the rest: {photos}.", photos=bent),
    )


def _is_beyond(one: FrameInterior) -> bool:
    """Whether a lens has more than k1 and k2."""
    more = (*one.radial[RADIAL_TERMS:], *one.tangential, one.affinity_px, one.skew_px)
    return any(value != 0.0 for value in more)


def _places(pixels: PixelPoints, one: FrameInterior) -> PixelPoints:
    """From the principal point, y up, as a lens of k1 and k2 alone shows them."""
    column, row = one.principal_point_px
    v = (row - pixels[:, 1]) / one.focal_px
    if not _is_beyond(one):
        return np.column_stack([pixels[:, 0] - column, row - pixels[:, 1]])
    u = (pixels[:, 0] - column + one.skew_px * v) / (one.focal_px + one.affinity_px)
    ideal = ideal_from_image(np.column_stack([u, v]), exchange_camera("", one))
    plain = ExchangeCamera("", one.radial[:RADIAL_TERMS])
    return image_from_ideal(ideal, plain) * one.focal_px


def _point_lines(
    block: ExchangeBlock,
    oriented: Mapping[str, object],
    interiors: Mapping[str, FrameInterior],
    camera: Mapping[str, str],
    origin: np.ndarray,
) -> list[str]:
    """Three lines in one entry for each tie point with coordinates."""
    ties, index = block.ties, {name: number for number, name in enumerate(oriented)}
    views: dict[int, list[str]] = {}
    keys = dict.fromkeys(index, 0)
    if ties.positions is None:
        return []
    for point, photo, pixel in zip(ties.point.tolist(), ties.photo, ties.pixels, strict=True):
        name = ties.photo_ids[int(photo)]
        if name in index and np.isfinite(ties.positions[point]).all():
            place = digits(_places(pixel[None], interiors[camera[name]])[0])
            views.setdefault(point, []).append(f"{index[name]} {keys[name]} {place}")
            keys[name] += 1
    return [
        f"{digits(ties.positions[point] - origin)}\n{GREY} {GREY} {GREY}\n"
        f"{len(seen)} {' '.join(seen)}"
        for point, seen in sorted(views.items())
    ]


def read_bundler(path: Path) -> ExchangeBlock:
    """Read bundle.out of a folder, or the file itself, with list.txt beside it.

    Raises:
        ExchangeError: Missing, damaged, or with more cameras than names.
    """
    file = path / BUNDLE if path.is_dir() else path
    lines = read_text(file).splitlines()
    if not lines or lines[0].strip() != HEAD:
        raise ExchangeError(
            file, "It does not begin with '{head}'.", "Export it as version 0.3.", head=HEAD
        )
    try:
        numbers = iter([float(word) for line in lines[1:] for word in line.split()])
        cameras, points = int(next(numbers)), int(next(numbers))
        names = [line.split()[0] for line in read_text(file.parent / NAMES).splitlines() if line]
        told = read_sidecar(file.parent)
        if len(names) != cameras:
            raise ValueError(f"{cameras} cameras, {len(names)} names")
        values = [_take(numbers, CAMERA) for _ in range(cameras)]
        photos = [_photo(name, one, told) for name, one in zip(names, values, strict=True)]
        ties = _ties(numbers, points, photos, told)
    except (ValueError, KeyError, TypeError, IndexError, StopIteration, OverflowError) as error:
        raise ExchangeError(
            file, "It is cut off or damaged ({error}).", AGAIN, error=repr(error)[:90]
        ) from error
    lenses = {
        photo.camera: ExchangeCamera(
            photo.camera, trimmed_radial(one[1:3]), size_px=_size(told, photo.file)
        )
        for photo, one in zip(photos, values, strict=True)
        if photo.camera
    }
    return ExchangeBlock(
        told.crs, lenses, named_photos(photos, file), ties=ties, from_middle=not told.photos
    )


def _finite(values: list[float], count: int) -> tuple[float, ...]:
    """So many finite numbers."""
    found = tuple(float(value) for value in values)
    if len(found) != count or not np.isfinite(found).all():
        raise ValueError(f"{values} are not {count} numbers")
    return found


def _size(told: Sidecar, file: str) -> tuple[int, int] | None:
    """Columns and rows of a scan, where the file beside the model says them."""
    _, _, width, height = told.photos.get(file, (0.0,) * 4)
    return (int(width), int(height)) if width and height else None


def _take(numbers: Iterator[float], count: int) -> tuple[float, ...]:
    """The next numbers."""
    return _finite([next(numbers) for _ in range(count)], count)


def _photo(name: str, values: tuple[float, ...], told: Sidecar) -> ExchangePhoto:
    """A photo; without orientation where Bundler has none."""
    focal, k1, k2, *place = values
    if focal <= 0:
        return exchange_photo(name, "", None)
    image = np.array(place[:9]).reshape(3, 3)
    rotation = FLIP @ Turn.from_matrix(image).as_matrix()
    centre = told.origin - image.T @ np.array(place[9:])
    point = told.photos.get(name, MIDDLE)
    interior = FrameInterior(_size(told, name), focal, (point[0], point[1]), radial=(k1, k2))
    return exchange_photo(name, f"lens-{name}", interior, rotation, centre)


def _ties(
    numbers: Iterator[float], count: int, photos: list[ExchangePhoto], told: Sidecar
) -> ExchangeTies:
    """Points with what sees them, in photos whose principal point is known."""
    rays: list[tuple[int, int, tuple[float, float]]] = []
    positions: list[tuple[float, ...]] = []
    for number in range(count):
        positions.append(_take(numbers, 3))
        _take(numbers, 3)
        for _ in range(int(next(numbers))):
            camera, _key, x, y = _take(numbers, VIEW)
            photo = photos[int(camera)]
            point = told.photos.get(photo.file, MIDDLE)
            rays.append((number, int(camera), (point[0] + x, point[1] - y)))
    if not rays:
        return ExchangeTies.none()
    return ExchangeTies(
        tuple(photo.photo_id for photo in photos),
        np.array([ray[0] for ray in rays]),
        np.array([ray[1] for ray in rays]),
        np.array([ray[2] for ray in rays]),
        positions=np.array(positions) + told.origin,
    )


BUNDLER = ExchangeFormat(
    name="bundler",
    title="Bundler",
    conventions=Conventions(
        pixels="from the principal point, x right, y up; gruber.json says where that is",
        object_space="right-handed, metres; a round origin is taken off and kept in gruber.json",
        rotation="matrix by rows: camera (x right, y up, z backwards) from object; translation is "
        "minus the turned centre",
        camera="focal length in pixels, k1, k2 from the ideal to the measured place",
        lost="principal point, k3 and tangential terms (taken out of the places), surveyed points, "
        "standard deviations, names of tie points, photos that are not oriented",
    ),
    holds="upright",
    write=write_bundler,
    read=read_bundler,
    default_name="bundler",
    curved=False,
)
"""Bundler's files."""
