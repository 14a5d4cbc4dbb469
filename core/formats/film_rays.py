"""Measurements on film: for programs that know image coordinates in millimetres and no pixels.

Image coordinates are given from the principal point, x right, y up, free of lens distortion. What
such a program wrote comes back with micrometres of film in place of pixels.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from core.arrays import Affine2
from core.errors import ProjectError
from core.formats.exchange import (
    ExchangeBlock,
    ExchangeCamera,
    ExchangeMeasurement,
    ExchangePhoto,
    ExchangePoint,
    ExchangeTies,
    ideal_from_image,
    image_from_ideal,
    pixels_of,
)
from core.formats.records import Record, read_records
from core.said import say

# design: rounds of ten micrometres are what film is scanned with.
NOMINAL_PIXEL_MM = 0.01
"""Size of a pixel of a camera whose principal distance is known in pixels alone."""
MICROMETRES = 1000.0  # source: definition.
"""Pixels that stand for a millimetre of film."""
MOST_DIGITS = 15  # source: PCI on PAT-B, names of at most 15 characters.
"""Digits that a number may have where nothing else is a name."""


@dataclass(frozen=True, slots=True)
class FilmRay:
    """One point in one photo."""

    point_id: str
    """The point, surveyed or tie."""
    photo_id: str
    """The photo."""
    x_mm: float
    """From the principal point, to the right."""
    y_mm: float
    """From the principal point, upwards."""
    sigma_mm: float | None = None
    """Standard deviation per axis."""


def untested() -> str:
    """What the user is told of a format that was not tested on real files."""
    return say(
        "This format was written by its description: no file of the program itself was to be had, "
        "so check the first import there."
    )


def principal_distance_mm(block: ExchangeBlock, photo_id: str) -> float:
    """Principal distance of a photo's camera; at a nominal pixel where only pixels are known."""
    camera = block.camera_of(photo_id)
    if camera.principal_distance_mm is not None:
        return camera.principal_distance_mm
    return block.photos[photo_id].focal_px * NOMINAL_PIXEL_MM


def film_rays(block: ExchangeBlock) -> tuple[list[FilmRay], tuple[str, ...]]:
    """All measurements on film, ties too, and what could not be given (a sentence each)."""
    places: dict[str, list[tuple[str, float, float, float | None]]] = {}
    for one in block.measurements:
        places.setdefault(one.photo_id, []).append(
            (one.point_id, one.column, one.row, one.sigma_px)
        )
    names = tie_names(block)
    ties = block.ties
    for index, (point, photo) in enumerate(zip(ties.point, ties.photo, strict=True)):
        column, row = ties.pixels[index].tolist()
        sigma = None if ties.sigma_px is None else float(ties.sigma_px[index])
        places.setdefault(ties.photo_ids[photo], []).append((names[point], column, row, sigma))
    rays: list[FilmRay] = []
    lost: list[str] = []
    for name, seen in places.items():
        photo = block.photos.get(name)
        if photo is None or photo.pixel_from_image is None or photo.camera not in block.cameras:
            lost.append(name)
            continue
        rays += _on_film(block, photo, seen)
    notes: list[str] = []
    if lost:
        notes.append(
            say(
                "{count:# photo has|# photos have} no interior orientation: "
                "measurements there left out.",
                count=len(lost),
            )
        )
    if any(any(lens.radial) or any(lens.tangential) for lens in block.cameras.values()):
        notes.append(
            say(
                "Image coordinates are written free of lens distortion; the distortion itself is "
                "left out."
            )
        )
    return rays, tuple(notes)


def _on_film(
    block: ExchangeBlock,
    photo: ExchangePhoto,
    seen: Sequence[tuple[str, float, float, float | None]],
) -> Iterable[FilmRay]:
    """The measurements of one photo."""
    assert photo.pixel_from_image is not None
    distance = principal_distance_mm(block, photo.photo_id)
    linear, shift = photo.pixel_from_image[:, :2], photo.pixel_from_image[:, 2]
    pixels = np.array([[column, row] for _, column, row, _ in seen])
    image = np.linalg.solve(linear, (pixels - shift).T).T
    film = ideal_from_image(image, block.camera_of(photo.photo_id)) * distance
    pixel_mm = distance / float(np.sqrt(abs(np.linalg.det(linear))))
    for (name, _, _, sigma), (x, y) in zip(seen, film.tolist(), strict=True):
        yield FilmRay(name, photo.photo_id, x, y, None if sigma is None else sigma * pixel_mm)


def tie_names(block: ExchangeBlock) -> list[str]:
    """A name for every tie point that no surveyed point bears."""
    count = 1 + max(block.ties.point.tolist(), default=-1)
    given = block.ties.names or tuple(f"T{number}" for number in range(count))
    return [f"T-{name}" if name in block.points else name for name in given]


def block_of_rays(
    photos: Sequence[tuple[ExchangePhoto, float]],
    points: Mapping[str, ExchangePoint],
    rays: Sequence[FilmRay],
    crs: str = "",
) -> ExchangeBlock:
    """A block whose pixels are micrometres of film, from the principal point.

    Args:
        photos: Photos and the principal distances of their cameras, millimetres.
        points: Surveyed points; a ray to any other is one of a tie point.
        rays: Measurements.
        crs: CRS of the coordinates, where it is known.
    """
    cameras: dict[str, ExchangeCamera] = {}
    made: dict[str, ExchangePhoto] = {}
    for photo, distance in photos:
        camera = photo.camera or f"{distance:g} mm"
        cameras[camera] = ExchangeCamera(camera, principal_distance_mm=distance)
        size = distance * MICROMETRES
        affine = np.array([[size, 0.0, 0.0], [0.0, -size, 0.0]])
        made[photo.photo_id] = replace(photo, camera=camera, pixel_from_image=affine)
    measured = [
        ExchangeMeasurement(
            ray.point_id,
            ray.photo_id,
            ray.x_mm * MICROMETRES,
            -ray.y_mm * MICROMETRES,
            None if ray.sigma_mm is None else ray.sigma_mm * MICROMETRES,
        )
        for ray in rays
        if ray.point_id in points
    ]
    told = say("The program knows no pixels: columns and rows are micrometres of film.")
    return ExchangeBlock(
        crs,
        cameras,
        made,
        dict(points),
        tuple(measured),
        ties_of([ray for ray in rays if ray.point_id not in points]),
        (told,),
        on_film=bool(rays),
    )


def ties_of(rays: Sequence[FilmRay]) -> ExchangeTies:
    """Rays of tie points, their pixels micrometres of film."""
    photos = tuple(dict.fromkeys(ray.photo_id for ray in rays))
    names = tuple(dict.fromkeys(ray.point_id for ray in rays))
    of_photo = {name: number for number, name in enumerate(photos)}
    of_point = {name: number for number, name in enumerate(names)}
    sigmas = [np.nan if ray.sigma_mm is None else ray.sigma_mm * MICROMETRES for ray in rays]
    return ExchangeTies(
        photos,
        np.array([of_point[ray.point_id] for ray in rays], dtype=np.int64),
        np.array([of_photo[ray.photo_id] for ray in rays], dtype=np.int64),
        np.array([[ray.x_mm, -ray.y_mm] for ray in rays]).reshape(-1, 2) * MICROMETRES,
        names,
        sigma_px=np.array(sigmas) if sigmas and np.isfinite(sigmas).all() else None,
    )


def with_interiors(
    block: ExchangeBlock, cameras: Mapping[str, ExchangeCamera], photos: Mapping[str, ExchangePhoto]
) -> ExchangeBlock:
    """A block of rays with the pixels of scans whose interior orientations are known.

    Args:
        block: What `block_of_rays` made.
        cameras: Cameras of these photos.
        photos: The same photos with `pixel_from_image`.
    """

    def affines(name: str) -> tuple[Affine2, Affine2]:
        before, after = block.photos[name].pixel_from_image, photos[name].pixel_from_image
        assert before is not None, "a block of rays has one for every photo"
        assert after is not None, "only photos with an interior orientation are given"
        return before, after

    def pixel(name: str, place: tuple[float, float]) -> list[float]:
        before, after = affines(name)
        ideal = np.linalg.solve(before[:, :2], np.array(place) - before[:, 2])[None]
        image = image_from_ideal(ideal, cameras[photos[name].camera])[0]
        return (after[:, :2] @ image + after[:, 2]).tolist()

    def scale(name: str) -> float:
        areas = [abs(float(np.linalg.det(matrix[:, :2]))) for matrix in affines(name)]
        return float(np.sqrt(areas[1] / areas[0]))

    measured: list[ExchangeMeasurement] = []
    for one in block.measurements:
        column, row = pixel(one.photo_id, (one.column, one.row))
        sigma = None if one.sigma_px is None else one.sigma_px * scale(one.photo_id)
        measured.append(ExchangeMeasurement(one.point_id, one.photo_id, column, row, sigma))
    ties = block.ties
    names = [ties.photo_ids[index] for index in ties.photo]
    pixels = [pixel(name, (p[0], p[1])) for name, p in zip(names, ties.pixels, strict=True)]
    sigmas = None
    if ties.sigma_px is not None:
        factors = np.array([scale(name) for name in names])
        sigmas = ties.sigma_px * factors
    moved = replace(ties, pixels=np.array(pixels).reshape(-1, 2), sigma_px=sigmas)
    return ExchangeBlock(
        block.crs, dict(cameras), dict(photos), block.points, tuple(measured), moved
    )


END = "-99"
"""Ends the points of a photo in files of PAT-B and BINGO."""


def photo_groups(path: Path, comment: str = "") -> list[tuple[Record, list[Record]]]:
    """Groups of lines that begin with a photo and end with -99.

    Raises:
        ProjectError: The last group does not end.
    """
    groups: list[tuple[Record, list[Record]]] = []
    within = False
    for record in read_records(path, comment=comment):
        if record.text(0) == END:
            within = False
        elif within:
            groups[-1][1].append(record)
        else:
            within = True
            groups.append((record, []))
    if within:
        raise ProjectError(path, "does not end with -99.", "The file was cut off: give all of it.")
    return groups


def without_sigmas(photos: Iterable[ExchangePhoto]) -> tuple[str, ...]:
    """A sentence on standard deviations of orientations that a format cannot hold."""
    if any(photo.sigma_centre_m for photo in photos):
        return (say("Standard deviations of orientations are left out."),)
    return ()


def not_oriented(photos: Iterable[ExchangePhoto]) -> tuple[str, ...]:
    """A word on photos that go out without, where there are any."""
    missing = sum(photo.exterior is None for photo in photos)
    if not missing:
        return ()
    return (say("{count:# photo has|# photos have} no orientation: left out.", count=missing),)


def refuse_twice(path: Path, rays: Sequence[FilmRay]) -> None:
    """Refuse a point that is measured twice in a photo.

    Raises:
        ProjectError: It is.
    """
    seen: set[tuple[str, str]] = set()
    for ray in rays:
        if (ray.point_id, ray.photo_id) in seen:
            raise ProjectError(
                path,
                "Point {point} is measured twice in photo {photo}.",
                "Leave one measurement of a point in every photo.",
                point=ray.point_id,
                photo=ray.photo_id,
            )
        seen.add((ray.point_id, ray.photo_id))


def refuse_unknown(path: Path, rays: Sequence[FilmRay], photos: Iterable[str]) -> None:
    """Refuse measurements in photos that the block does not have.

    Raises:
        ProjectError: There are some.
    """
    known = set(photos)
    for ray in rays:
        if ray.photo_id not in known:
            raise ProjectError(
                path,
                "Point {point} is measured in photo {photo}, which is unknown.",
                "Give the photo, or take its measurements out.",
                point=ray.point_id,
                photo=ray.photo_id,
            )


def median_misfit(block: ExchangeBlock) -> float:
    """Median distance, in pixels, of what is measured from where the block shows it.

    Surveyed points and ties with coordinates; infinite where nothing can be compared.
    """
    seen: dict[str, list[tuple[float, ...]]] = {}
    for one in block.measurements:
        if one.point_id in block.points:
            place = block.points[one.point_id].position
            seen.setdefault(one.photo_id, []).append((*place, one.column, one.row))
    ties = block.ties
    if ties.positions is not None:
        rays = np.column_stack([ties.positions[ties.point], ties.pixels]).tolist()
        for photo, ray in zip(ties.photo, rays, strict=True):
            seen.setdefault(ties.photo_ids[photo], []).append(tuple(ray))
    distances: list[float] = []
    for name, rays in seen.items():
        photo = block.photos.get(name)
        if photo is None or photo.exterior is None or photo.pixel_from_image is None:
            continue
        values = np.array(rays)
        pixels = pixels_of(values[:, :3], photo, block.camera_of(name))
        off = np.hypot(*(pixels - values[:, 3:]).T)
        distances += np.where(np.isfinite(off), off, np.inf).tolist()
    return float(np.median(distances)) if distances else np.inf


def numbered(names: Iterable[str]) -> dict[str, str]:
    """A number for every name, for programs that take nothing else: numbers stay what they are."""
    every = list(dict.fromkeys(names))
    plain = {name for name in every if name.isdecimal() and len(name) <= MOST_DIGITS}
    free = (str(number) for number in range(1, 2 * len(every) + 2) if str(number) not in plain)
    return {name: name if name in plain else next(free) for name in every}
