"""BINGO: image coordinates in millimetres (`image.dat`), orientations and control (`geoin.dat`).

By its description: a photo's line bears its name and its camera, its points follow, -99 ends it;
in `geoin.dat` ORIA lines bear photo, X, Y, Z, phi, omega, kappa in gon, CONT lines control and CHCK
lines check points. `cameras.txt`, which is ours, says what each camera's principal distance is.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from core.errors import ProjectError
from core.formats.exchange import (
    Conventions,
    ExchangeBlock,
    ExchangeFormat,
    ExchangePhoto,
    ExchangePoint,
)
from core.formats.film_rays import (
    END,
    FilmRay,
    block_of_rays,
    film_rays,
    not_oriented,
    photo_groups,
    principal_distance_mm,
    refuse_twice,
    refuse_unknown,
    untested,
    without_sigmas,
)
from core.formats.records import Record, one_word, read_records, write_lines
from core.formats.rotations import FULL_TURN, RADIANS, angles_of, rotation_of
from core.formats.words import in_words
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation

IMAGE, GEO, CAMERAS = "image.dat", "geoin.dat", "cameras.txt"
"""Files of the folder; the last one is ours."""
ORIENTATION, CONTROL, CHECK = "ORIA", "CONT", "CHCK"
"""First words of lines of `geoin.dat`."""
AFTER_POSITION = 5  # source: definition; word, name and three coordinates come before.
"""Index of what follows a position in a line of `geoin.dat`."""


def write_bingo(path: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write image coordinates, orientations and control into a folder.

    Returns:
        What was left out.
    """
    path.mkdir(parents=True, exist_ok=True)
    block, renamed = in_words(block)
    rays, notes = film_rays(block)
    write_lines(path / IMAGE, _image_lines(block, rays))
    write_lines(path / GEO, _geo_lines(block))
    seen = {photo.camera: name for name, photo in block.photos.items() if photo.camera}
    cameras = [
        f"{one_word(camera)} {principal_distance_mm(block, name)!r}"
        for camera, name in seen.items()
        if camera in block.cameras and block.photos[name].pixel_from_image is not None
    ]
    write_lines(path / CAMERAS, cameras)
    photos = block.photos.values()
    return (*renamed, *notes, *not_oriented(photos), *without_sigmas(photos), untested())


def _image_lines(block: ExchangeBlock, rays: Sequence[FilmRay]) -> Iterator[str]:
    for name, photo in block.photos.items():
        seen = [ray for ray in rays if ray.photo_id == name]
        if seen:
            yield f"{name} {one_word(photo.camera)}"
            for ray in seen:
                sigma = "" if ray.sigma_mm is None else f" {ray.sigma_mm!r}"
                yield f"{ray.point_id} {ray.x_mm!r} {ray.y_mm!r}{sigma}"
            yield END


def _geo_lines(block: ExchangeBlock) -> Iterator[str]:
    for name, photo in block.photos.items():
        if photo.exterior is not None:
            turned = angles_of("phi-omega-kappa", photo.exterior.object_from_image)
            numbers = [*photo.exterior.centre.tolist(), *(a / RADIANS["gon"] for a in turned)]
            yield " ".join([ORIENTATION, name, *map(repr, numbers)])
    for name, point in block.points.items():
        word = CONTROL if point.role == "control" else CHECK
        yield " ".join([word, name, *map(repr, (*point.position, *(point.sigma_m or ())))])


def read_bingo(path: Path) -> ExchangeBlock:
    """A folder with `geoin.dat` and, where they are, `image.dat` and `cameras.txt`.

    Raises:
        ProjectError: `geoin.dat` is missing, or a file is damaged.
    """
    folder = path if path.is_dir() else path.parent
    photos, points = _geo(folder / GEO)
    cameras: dict[str, float] = {}
    if (folder / CAMERAS).exists():
        records = read_records(folder / CAMERAS)
        cameras = {record.text(0): record.value(1) for record in records}
    rays: list[FilmRay] = []
    of_photo: dict[str, str] = {}
    if (folder / IMAGE).exists():
        rays, of_photo = _rays(folder / IMAGE)
        refuse_twice(folder / IMAGE, rays)
        refuse_unknown(folder / IMAGE, rays, photos)
    every: list[tuple[ExchangePhoto, float]] = []
    for name, photo in photos.items():
        camera = of_photo.get(name, "")
        if rays and camera not in cameras:
            raise ProjectError(
                folder,
                "Nothing says the principal distance of camera {camera!r}.",
                "Put a line `CAMERA MILLIMETRES` into cameras.txt beside geoin.dat.",
                camera=camera,
            )
        one = ExchangePhoto(name, photo.file, camera, exterior=photo.exterior)
        every.append((one, cameras.get(camera, 1.0)))
    return block_of_rays(every, points, rays)


def _geo(path: Path) -> tuple[dict[str, ExchangePhoto], dict[str, ExchangePoint]]:
    photos: dict[str, ExchangePhoto] = {}
    points: dict[str, ExchangePoint] = {}
    for record in read_records(path, comment="C "):
        word = record.text(0).upper()
        name = record.text(1) if word in (ORIENTATION, CONTROL, CHECK) else ""
        record.refuse_again(name, {**photos, **points})
        if word == ORIENTATION:
            exterior = ExteriorOrientation(np.array(record.triple(2)), *_angles(record))
            photos[name] = ExchangePhoto(name, f"{name}.tif", exterior=exterior)
        elif name:
            sigma = record.triple(AFTER_POSITION) if len(record.cells) > AFTER_POSITION else None
            role = "control" if word == CONTROL else "check"
            points[name] = ExchangePoint(name, record.triple(2), sigma, role)
    return photos, points


def _angles(record: Record) -> tuple[float, float, float]:
    """omega, phi, kappa in radians."""
    written = record.triple(AFTER_POSITION)
    beyond = next((value for value in written if abs(value) > FULL_TURN["gon"]), None)
    if beyond is not None:
        raise record.refused(
            "Line {number}: an angle of {value} gon is more than a whole turn.",
            "Angles are phi, omega, kappa in gon.",
            value=beyond,
        )
    phi, omega, kappa = (value * RADIANS["gon"] for value in written)
    return angles_from_rotation(rotation_of("phi-omega-kappa", (phi, omega, kappa)))


def _rays(path: Path) -> tuple[list[FilmRay], dict[str, str]]:
    """Measurements, and the camera of every photo."""
    rays: list[FilmRay] = []
    cameras: dict[str, str] = {}
    for head, rows in photo_groups(path, comment="C "):
        cameras[head.text(0)] = head.text(1)
        for row in rows:
            sigma = row.value(3) if len(row.cells) > 3 else None
            rays.append(FilmRay(row.text(0), head.text(0), row.value(1), row.value(2), sigma))
    return rays, cameras


BINGO_FORMAT = ExchangeFormat(
    name="bingo",
    title="BINGO: image.dat and geoin.dat",
    conventions=Conventions(
        pixels="none: millimetres of film from the principal point, x right, y up",
        object_space="easting, northing, height, metres; the CRS is not said",
        rotation="ORIA: phi, omega, kappa in gon; R = R_y(phi) R_x(omega) R_z(kappa) turns image "
        "space into object space",
        camera="principal distance in `cameras.txt`, which is ours; distortion and refraction are "
        "taken out",
        sigmas="control, metres; measurements, millimetres",
        lost="scans, fiducials, standard deviations of orientations, object points of ties; blanks "
        "in names",
    ),
    holds="film",
    write=write_bingo,
    read=read_bingo,
    default_name="bingo",
)
"""BINGO, by description."""
