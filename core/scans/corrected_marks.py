"""Fiducials that a person corrected, or had filled in by an example: scans oriented again."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np

from core.doubts import Doubt, Failure
from core.geometry.camera import Camera
from core.geometry.interior import InteriorOrientation, fit_interior
from core.raster.scan_file import ScanFile, read_window
from core.said import say
from core.scans.camera_group import settle_family
from core.scans.centring import (
    LEAST_RADIUS_PX,
    Centre,
    Gray,
    Weights,
    centre_by_symmetry,
    correlation,
    disc,
    match_mark,
    sample_about,
)
from core.scans.fiducials import HAND_SIGMA_PX, seen_from
from core.scans.film_area import area_from_interior
from core.scans.interior_orientation import ScanOrientation, pooled_factor
from core.scans.judging import (
    FiducialMeasurement,
    FiducialSet,
    certified_places,
    doubts_of_fit,
    interior_of,
    places_of,
)
from core.scans.naming import ASIDE, CORNERS, NEAR_MM, SIDES, UPRIGHT

LEAST_FILLED = 2  # design: a similarity needs two
"""Fewer marks found by an example orient no scan."""
FOUND_SIGMA_PX = 0.1  # design: the goal of the centring
"""Standard deviation of a found mark whose own is not known any more."""
BY_HAND = "by hand"
"""Kind of a mark that a person measured."""
OF_FIT = frozenset(
    {
        "fiducial-left-out", "fiducials-few", "fiducial-residual", "scan-mirrored",
        "fiducials-scale", "film-shrinkage", "interior-nominal", "fiducials-of-another-camera",
        "fiducials-not-found",
    }
)  # fmt: skip
"""Doubts that are raised anew once the marks are others."""
RADII_MM = (0.5, 0.8, 1.3)  # design: marks are of different sizes
"""Radii about the middle that are tried."""
REACH_MM = 0.5  # design: as near as one points on a screen
"""How far the middle may lie from where somebody pointed."""
SNAP_PX, MARGIN_PX = 3.0, 8  # design: a search to a pixel; the blur of the samples
"""How far matching may move from the place that was found, and what a window has beyond."""
SEARCH_STEPS = 8  # design: time; steps of a twentieth of a millimetre
"""Steps to either side in which the middle of a symmetric mark is sought."""
LEAST_ALIKE = 0.6  # design: texture is hardly as symmetric
"""Likeness below which the place is no mark."""


@dataclass(frozen=True, slots=True)
class MarkChange:
    """What a person said about one fiducial of one scan, or had found by an example."""

    measured: FiducialMeasurement | None = None
    """By hand, or like an example; None leaves it where it was found."""
    use: bool = True
    """False for a mark that cannot be seen, or is not to be used."""

    @property
    def place(self) -> tuple[float, float] | None:
        """Column and row where it was measured."""
        return None if self.measured is None else self.measured.place

    @property
    def filled(self) -> bool:
        """True for a mark that was found by an example."""
        return self.measured is not None and self.measured.kind != BY_HAND


Changes = Mapping[str, MarkChange]
"""By the name of the mark."""


def by_hand(name: str, place: tuple[float, float]) -> FiducialMeasurement:
    """A mark that a person measured."""
    return FiducialMeasurement(name, *place, HAND_SIGMA_PX, 1.0, 0.0, BY_HAND)


def corrected_scans(
    oriented: Mapping[str, ScanOrientation],
    cameras: Mapping[str, Camera],
    pixels_mm: Mapping[str, float],
    changes: Mapping[str, Changes],
) -> dict[str, ScanOrientation]:
    """The scans of one or several cameras with corrected marks; the others stay as they are.

    Args:
        oriented: Scans by photo, as they were found.
        cameras: Camera of each photo, with the certified places of its marks.
        pixels_mm: Nominal size of a scan pixel by photo, millimetres.
        changes: What was said, by photo; nothing where only the camera's marks are others.
    """
    corrected = {
        name: corrected_scan(scan, cameras[name], pixels_mm[name], changes[name])
        for name, scan in oriented.items()
        if name in changes
    }
    result = {**oriented, **corrected}
    for name, scan in corrected.items():
        family = [one.interior for k, one in result.items() if cameras[k] is cameras[name]]
        factor = pooled_factor(family)
        if factor is not None and scan.interior.model != "nominal":
            interior = scan.interior.with_variance_factor(factor)
            result[name] = replace(scan, interior=interior)
    return result


def corrected_scan(
    scan: ScanOrientation, camera: Camera, pixel_mm: float, changes: Changes
) -> ScanOrientation:
    """One scan with its interior orientation from corrected marks.

    Where they do not fit their certificate the orientation stays what it was, with a doubt.
    """
    nominal = scan.interior.model == "nominal"
    found = {mark.name: mark for mark in scan.fiducials}
    if nominal and any(change.filled for change in changes.values()):
        # The few that were found alone could not tell which marks they are.
        found.clear()
    for name, change in changes.items():
        if change.measured is not None and name in camera.fiducials_mm:
            found[name] = change.measured
    marks = tuple(found[name] for name in camera.fiducials_mm if name in found)
    used = [mark for mark in marks if changes.get(mark.name, MarkChange()).use]
    doubts = tuple(doubt for doubt in scan.doubts if not _settled(doubt, changes))
    back = scan.way[1]
    if nominal:
        _, back = seen_from(places_of(used), certified_places(used, camera.fiducials_mm))
    fitted = interior_of(used, camera.fiducials_mm, back)
    if isinstance(fitted, Failure):
        doubt = Doubt(
            "fiducials-corrected",
            scan.photo_id,
            say(
                "With the corrected fiducials there is no interior orientation ({why}): it "
                "stays what it was. Look at its marks again.",
                why=fitted.reason.rstrip("."),
            ),
            evidence={"fiducials": [mark.name for mark in used]},
        )
        return replace(scan, fiducials=marks, doubts=(*doubts, doubt))
    kept = tuple(doubt for doubt in doubts if doubt.kind not in OF_FIT)
    return replace(
        scan,
        interior=fitted,
        fiducials=marks,
        doubts=(*kept, *doubts_of_fit(scan.photo_id, fitted, used, pixel_mm)),
        area=scan.area if scan.area.seen else area_from_interior(fitted, camera),
    )


def corrected_interior(
    interior: InteriorOrientation, camera: Camera, changes: Changes
) -> InteriorOrientation:
    """An interior orientation with corrected marks; as it is where nothing of it changes.

    For a block whose scans are not at hand: marks that were found count as good as usual ones.
    """
    certified = _certified(interior, camera)
    places = dict(zip(interior.names, interior.pixels.tolist(), strict=True))
    before = dict(places)
    known: dict[str, float] = {}
    for name, change in changes.items():
        if change.measured is not None and name in certified:
            places[name] = [*change.measured.place]
            known[name] = change.measured.sigma_px
        if not change.use:
            places.pop(name, None)
    if places == before:
        return interior
    names = list(places)
    pixels = np.array([places[name] for name in names]).reshape(-1, 2)
    film = np.array([certified[name] for name in names]).reshape(-1, 2)
    sigmas = np.array([known.get(name, FOUND_SIGMA_PX) for name in names])
    back = interior.mirrored if interior.names else seen_from(pixels, film)[1]
    fitted = fit_interior(names, pixels, film, "auto", sigmas_px=sigmas, mirrored=back)
    return interior if isinstance(fitted, Failure) else fitted


def _certified(
    interior: InteriorOrientation, camera: Camera
) -> dict[str, tuple[float, float] | list[float]]:
    """Where each mark lies on the film, millimetres; of marks in use as they were fitted."""
    fitted = interior.film_from_pixel(interior.pixels) - interior.residuals_um / 1000
    return {**camera.fiducials_mm, **dict(zip(interior.names, fitted.tolist(), strict=True))}


def _settled(doubt: Doubt, changes: Changes) -> bool:
    """True for a doubt about a mark that a person has looked at."""
    return doubt.evidence.get("fiducial") in changes


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
    fill = _filled if camera.fiducials_mm else _estimated
    filled = fill(films, found, camera, pixels_mm)
    if isinstance(filled, FilledMarks) and not any(filled.found.values()):
        known = set(camera.fiducials_mm)
        whole = known and all(known <= set(film.interior.names) for film in films.values())
        return Failure(
            "every mark of these scans is measured already" if whole else "nothing else is like it"
        )
    return filled


def _filled(
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
        if len(marks) >= LEAST_FILLED:
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


@dataclass(frozen=True, slots=True)
class Example:
    """The same mark where it was measured well."""

    scan: ScanFile
    """The scan."""
    place: tuple[float, float]
    """Column and row of its middle."""


def snap_mark(
    scan: ScanFile, place: tuple[float, float], pixel_mm: float, example: Example | None = None
) -> Centre | Failure:
    """The middle of the mark beside a place, scan pixels.

    Args:
        scan: The scan.
        place: Column and row where somebody pointed.
        pixel_mm: Size of a scan pixel on the film, millimetres.
        example: The same mark in another scan of the camera, that lies the same way and has
            pixels of the same size; without one, or where it is unlike, the mark's own symmetry.
    """
    window, corner = _window(scan, place, pixel_mm)
    start = (place[0] - corner[0], place[1] - corner[1])
    reach_px = REACH_MM / pixel_mm + 2
    tried: list[Centre] = []
    if example is not None:
        other, beside = _window(example.scan, example.place, pixel_mm)
        middle = np.array(example.place) - np.array(beside)
        for radius in RADII_MM:
            template = sample_about(other, middle, _disc(radius, pixel_mm).shape[0])
            near = _likest(window, template, start, reach_px)
            _keep(tried, match_mark(window, near, SNAP_PX, template))
    if not tried:
        for radius in RADII_MM:
            weights = _disc(radius, pixel_mm)
            near = _most_symmetric(window, weights, start, reach_px)
            _keep(tried, centre_by_symmetry(window, near, SNAP_PX, weights))
    if not tried:
        return Failure("there is nothing like the mark beside that place")
    best = max(tried, key=lambda centre: centre.correlation)
    return Centre(best.column + corner[0], best.row + corner[1], best.sigma_px, best.correlation)


def _likest(
    window: Gray, template: Weights, start: tuple[float, float], reach_px: float
) -> tuple[float, float]:
    """The place within reach at which the window is most like a template, to a pixel."""
    surface = cv2.matchTemplate(window, template.astype(np.float32), cv2.TM_CCOEFF_NORMED)
    half = template.shape[0] // 2
    columns, rows = np.meshgrid(*(np.arange(n) + half + 0.5 for n in surface.shape[::-1]))
    away = np.hypot(columns - start[0], rows - start[1])
    best = int(np.argmax(np.where(away <= reach_px, surface, -np.inf)))
    return float(columns.flat[best]), float(rows.flat[best])


def _most_symmetric(
    window: Gray, weights: Weights, start: tuple[float, float], reach_px: float
) -> tuple[float, float]:
    """The place within reach about which the window looks most like itself after half a turn."""
    step = max(1.0, reach_px / SEARCH_STEPS)
    offsets = np.arange(-reach_px, reach_px + step / 2, step)
    best, place = -np.inf, start
    for right in offsets:
        for down in offsets:
            here = np.array([start[0] + right, start[1] + down])
            patch = sample_about(window, here, weights.shape[0])
            alike = correlation(patch, patch[::-1, ::-1], weights)
            if alike > best:
                best, place = alike, (float(here[0]), float(here[1]))
    return place


def _keep(tried: list[Centre], found: Centre | Failure) -> None:
    """Remember what looks like the mark."""
    if isinstance(found, Centre) and found.correlation >= LEAST_ALIKE:
        tried.append(found)


def _disc(radius_mm: float, pixel_mm: float) -> Weights:
    return disc(max(radius_mm / pixel_mm, LEAST_RADIUS_PX))


def _window(
    scan: ScanFile, place: tuple[float, float], pixel_mm: float
) -> tuple[Gray, tuple[int, int]]:
    """Grays about a place, and the first column and row."""
    half = int(np.ceil((RADII_MM[-1] + REACH_MM) / pixel_mm)) + MARGIN_PX
    corner = (round(place[0]) - half, round(place[1]) - half)
    return read_window(scan, *corner, 2 * half, 2 * half, outside="edge"), corner
