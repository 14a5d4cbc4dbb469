"""Name the marks that were found by an example, and add them to the known ones."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from core.doubts import Failure
from core.geometry.camera import Camera
from core.said import say
from core.scans.camera_group import settle_family
from core.scans.interior_orientation import ScanOrientation
from core.scans.judging import FiducialMeasurement, FiducialSet
from core.scans.naming import ASIDE, CORNERS, NEAR_MM, SIDES, UPRIGHT

LEAST_MARKS = 2  # design: a similarity needs two
"""Fewer marks orient no scan."""
Films = Mapping[str, ScanOrientation]
Found = Mapping[str, FiducialSet]


@dataclass(frozen=True, slots=True)
class FilledMarks:
    """What an example brought for all scans of a camera."""

    found: Mapping[str, tuple[FiducialMeasurement, ...]]
    """By photo, named on the film."""
    places_mm: Mapping[str, tuple[float, float]]
    """Where the marks of the camera lie, estimated from the roll, millimetres; empty where a
    certificate says so."""
    sigma_mm: float
    """Standard deviation of such a place per axis, millimetres."""


def fill_marks(
    films: Films, found: Found, camera: Camera, pixels_mm: Mapping[str, float]
) -> FilledMarks | Failure:
    """Name the marks that an example brought, and place them where nobody certified them.

    Args:
        films: The scans of the camera as they stand, by photo, with the marks that take part.
        found: What is like the example, by photo.
        camera: The camera as the block describes it.
        pixels_mm: Nominal size of a scan pixel by photo, millimetres.
    """
    fill = _certified if camera.fiducials_mm else _estimated
    filled = fill(films, found, camera, pixels_mm)
    if isinstance(filled, FilledMarks) and not any(filled.found.values()):
        return Failure("nothing else is like it")
    return filled


def _certified(
    films: Films, found: Found, camera: Camera, pixels_mm: Mapping[str, float]
) -> FilledMarks:
    """Marks that take part stay; scans without an orientation get all their marks anew."""
    bare = {name for name, film in films.items() if film.interior.model == "nominal"}
    laid = {
        name: replace(film, fiducials=one.marks, way=one.way, rivals=one.rivals)
        if name in bare and (one := found.get(name)) is not None
        else film
        for name, film in films.items()
    }
    settled = settle_family(laid, camera, pixels_mm).oriented
    named = {
        name: settled[name].fiducials if name in bare else _missing(films[name], one, camera)
        for name, one in found.items()
    }
    return FilledMarks({name: marks for name, marks in named.items() if marks}, {}, 0.0)


def _missing(
    film: ScanOrientation, found: FiducialSet, camera: Camera
) -> tuple[FiducialMeasurement, ...]:
    """Marks of an oriented scan that it lacks, named by where the others put them."""
    missing = [name for name in camera.fiducials_mm if name not in film.interior.names]
    kept: dict[str, FiducialMeasurement] = {}
    for mark in found.marks if missing else ():
        place = film.interior.film_from_pixel(np.array([mark.place]))[0]
        away = {name: np.hypot(*(place - camera.fiducials_mm[name])) for name in missing}
        nearest = min(missing, key=lambda name: float(away[name]))
        if away[nearest] < NEAR_MM:
            kept[nearest] = replace(mark, name=nearest)
    return tuple(kept.values())


def _estimated(
    films: Films, found: Found, camera: Camera, pixels_mm: Mapping[str, float]
) -> FilledMarks | Failure:
    """All marks of the roll together: those of an earlier example stay beside these."""
    laid: dict[str, ScanOrientation] = {}
    for name, film in films.items():
        fresh = found[name].marks if name in found else ()
        every = [_by_place(mark, film) for mark in (*film.fiducials, *fresh)]
        marks = {mark.name: mark for mark in every}
        if len(marks) >= LEAST_MARKS:
            laid[name] = replace(film, fiducials=tuple(marks.values()), way=UPRIGHT, rivals=())
    family = settle_family(laid, camera, pixels_mm)
    if family.estimated is None:
        most = max((len(one.marks) for one in found.values()), default=0)
        return Failure(
            say("no scan shows more than {count} marks like it, and three are needed", count=most)
        )
    measured = {
        name: {mark.place for mark in one.marks} for name, one in found.items() if name in laid
    }
    named = {
        name: tuple(mark for mark in family.oriented[name].fiducials if mark.place in places)
        for name, places in measured.items()
    }
    kept = {name: marks for name, marks in named.items() if marks}
    return FilledMarks(kept, family.estimated.places_mm, float(family.estimated.sigma_mm))


def _by_place(mark: FiducialMeasurement, film: ScanOrientation) -> FiducialMeasurement:
    """A mark named by where it lies in the scan."""
    corners = film.area.corners
    middle = corners.mean(axis=0)
    away = (np.array(mark.place) - middle) / np.abs(corners - middle).max(axis=0)
    towards = np.array([away[0], -away[1]])
    near = CORNERS if bool((np.abs(away) > ASIDE).all()) else SIDES
    name = max(near, key=lambda one: float(np.dot(near[one], towards)))
    return replace(mark, name=name)
