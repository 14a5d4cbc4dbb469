"""Radial triangulation: positions in plan from directions alone (notes on triangulation, 4.7 A).

About its radial point a vertical photo shows all directions as they are in the field: relief moves
images along them. Each photo is a station whose directions are measured; stations, their turns and
all points are adjusted at once as a network of directions on known points. It knows no heights.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float64

from core.arrays import FilmPoints, Indices, Scalars
from core.block import Block, Photo
from core.doubts import Failure
from core.geometry.camera import Camera
from core.geometry.image_corrections import isocentre_on_film, nadir_on_film
from core.literature.independent_models import Sights

RadialPoint = Literal["principal", "isocentre", "nadir"]
"""About which point of the photo directions are measured; only the first needs no orientation."""
# source: the notes: at least two known points.
LEAST_KNOWN = 2
# source: the surveyor's rule of intersection, 30 to 150 degrees; near the line of its stations a
# point would be thrown along it. The notes' wing points stand far aside.
LEAST_CROSSING = np.pi / 6
"""Directions to a new point cross at this angle at least, radians."""
# design: three degrees of tilt move the nadir of 152 mm by 8; nearer than three times that a
# direction says little, and throws the first steps about.
LEAST_ARM_MM = 25.0
"""Directions to images nearer to the radial point are not used."""
# design: an upper limit; a network of directions settles in five or six.
PASSES = 30
# design: a tenth of a millimetre.
STILL_M = 1e-4
Plan = Float64[np.ndarray, "_ 2"]
"""Easting and northing, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class RadialResult:
    """A block triangulated radially."""

    numbers: Indices
    """Points that were determined, see `Sights`."""
    places: Plan
    """Where they are."""
    stations: Mapping[str, Plan]
    """Radial point of each photo on the ground, (1, 2)."""
    rms_mm: float
    """Left across the directions, on the film, RMS."""


@dataclass(frozen=True, slots=True, eq=False)
class _Rays:
    """Directions as parallel arrays."""

    station: Indices
    point: Indices
    """Row among the unknown points, or len(unknown) + row among the known."""
    direction: Scalars
    """On the film about the radial point, radians."""
    radius_mm: Scalars
    """From it."""


def direction_error(
    height_m: Scalars,
    above_ground_m: float,
    nadir_mm: Float64[np.ndarray, "2"],
    film: FilmPoints,
) -> Scalars:
    """What relief turns directions about a radial point, to first order, radians.

    h moves an image by r h / H away from the nadir; across the direction from the radial point
    that is h / H times the nadir's distance from the line of the direction.

    Args:
        height_m: h over the plane on which the photo has its scale.
        above_ground_m: H over the same plane.
        nadir_mm: From the radial point.
        film: Images on the plane, from the radial point.
    """
    square = np.sum(film**2, axis=1)
    across = film[:, 1] * nadir_mm[0] - film[:, 0] * nadir_mm[1]
    return height_m / above_ground_m * across / square


def radial_point(photo: Photo, camera: Camera, which: RadialPoint) -> FilmPoints:
    """The point on the film about which directions count, (1, 2) mm, in the fiducial frame."""
    principal = np.array([camera.principal_point_mm])
    if which == "principal":
        return principal
    found = isocentre_on_film if which == "isocentre" else nadir_on_film
    return principal + found(photo.exterior, camera.principal_distance_mm)


def triangulate_radially(block: Block, which: RadialPoint = "principal") -> RadialResult | Failure:
    """All points of a block in plan from directions.

    Args:
        block: Photos about where they are, ties, and control, which is held.
        which: The radial point.
    """
    sights = Sights.of(block)
    names = list(block.photos)
    known = {n: block.surveyed[name].position[:2] for n, name in sights.control.items()}
    films = {
        name: block.photos[name].interior.film_from_pixel(sights.pixels[name])
        - radial_point(block.photos[name], block.camera_of(name), which)
        for name in names
    }
    start = np.array(
        [[*block.photos[name].exterior.centre[:2], block.photos[name].exterior.kappa]
         for name in names]
    )  # fmt: skip
    unknown = _crossed(sights, films, start, names, known)
    order = [*unknown, *(n for n in known if any(n in sights.numbers[name] for name in names))]
    if len(order) - len(unknown) < LEAST_KNOWN:
        return Failure("fewer than two known points are measured")
    row = {number: i for i, number in enumerate(order)}
    rays = _rays_of(sights, films, names, row)
    fixed = np.array([known[number] for number in order[len(unknown) :]])
    first = np.array([_where(n, sights, films, start, names, block) for n in unknown])
    return _adjusted(rays, start, first.reshape(-1, 2), fixed, (names, np.array(unknown, int)))


def _crossed(
    sights: Sights,
    films: Mapping[str, FilmPoints],
    start: np.ndarray,
    names: list[str],
    known: Mapping[int, np.ndarray],
) -> list[int]:
    """Points that are not known and whose directions cross well."""
    lines: dict[int, list[float]] = {}
    for name, (_, _, kappa) in zip(names, start, strict=True):
        turned = np.arctan2(films[name][:, 1], films[name][:, 0]) + kappa
        far = np.hypot(*films[name].T) > LEAST_ARM_MM
        for number, angle in zip(sights.numbers[name][far].tolist(), turned[far], strict=True):
            lines.setdefault(number, []).append(float(angle))
    return [
        number
        for number, angles in sorted(lines.items())
        if number not in known
        and np.abs(np.sin(np.subtract.outer(angles, angles))).max() > np.sin(LEAST_CROSSING)
    ]


def _rays_of(
    sights: Sights, films: Mapping[str, FilmPoints], names: list[str], row: Mapping[int, int]
) -> _Rays:
    parts = [
        (station, row[number], np.arctan2(y, x), np.hypot(x, y))
        for station, name in enumerate(names)
        for number, (x, y) in zip(sights.numbers[name].tolist(), films[name], strict=True)
        if number in row and np.hypot(x, y) > LEAST_ARM_MM
    ]
    station, point, direction, radius = np.array(parts).T
    return _Rays(station.astype(np.int64), point.astype(np.int64), direction, radius)


def _where(
    number: int,
    sights: Sights,
    films: Mapping[str, FilmPoints],
    start: np.ndarray,
    names: list[str],
    block: Block,
) -> np.ndarray:
    """About where a point lies: the mean of what its photos say at their nominal scale."""
    places: list[np.ndarray] = []
    for name, (east, north, kappa) in zip(names, start, strict=True):
        photo = block.photos[name]
        above = float(photo.exterior.centre[2]) - photo.ground_height_m
        scale = above / block.camera_of(name).principal_distance_mm
        turn = np.array([[np.cos(kappa), np.sin(kappa)], [-np.sin(kappa), np.cos(kappa)]])
        for film in films[name][sights.numbers[name] == number]:
            places.append(np.array([east, north]) + scale * film @ turn)
    return np.mean(places, axis=0)


def _adjusted(
    rays: _Rays, start: np.ndarray, first: Plan, fixed: Plan, named: tuple[list[str], Indices]
) -> RadialResult | Failure:
    """Gauss and Newton; what is left of a direction counts as it lies across it on the film."""
    stations, points = start.copy(), first.copy()
    count, rows = len(start), np.arange(len(rays.station))
    free = rays.point < len(points)
    left = np.zeros(0)
    for _ in range(PASSES):
        every = np.vstack([points, fixed])
        east, north = (every[rays.point] - stations[rays.station, :2]).T
        square = east**2 + north**2
        left = rays.direction + stations[rays.station, 2] - np.arctan2(north, east)
        left = (left + np.pi) % (2 * np.pi) - np.pi
        design = np.zeros((len(rows), 3 * count + 2 * len(points)))
        by_east, by_north = -north / square, east / square
        design[rows, 3 * rays.station] = -by_east
        design[rows, 3 * rays.station + 1] = -by_north
        design[rows, 3 * rays.station + 2] = -1.0
        column = 3 * count + 2 * rays.point[free]
        design[rows[free], column], design[rows[free], column + 1] = by_east[free], by_north[free]
        weight = rays.radius_mm[:, None]
        step, _, rank, _ = np.linalg.lstsq(design * weight, left * rays.radius_mm, rcond=None)
        if rank < design.shape[1]:
            return Failure("the directions leave some of the network open")
        stations += step[: 3 * count].reshape(-1, 3)
        points += step[3 * count :].reshape(-1, 2)
        moved = np.delete(step, np.s_[2 : 3 * count : 3])
        if np.abs(moved).max() < STILL_M:
            names, numbers = named
            places = {name: stations[i : i + 1, :2] for i, name in enumerate(names)}
            rms = float(np.sqrt(np.mean((left * rays.radius_mm) ** 2)))
            return RadialResult(numbers, points, places, rms)
    return Failure("the directions do not settle")
