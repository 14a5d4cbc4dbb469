"""Fiducials measured to a fraction of a pixel; one that is missing or in doubt says so."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from core.doubts import Doubt, Failure
from core.geometry.camera import Camera
from core.geometry.transforms import PlaneTransform, apply_affine, fit_similarity
from core.scan.constellation import Constellation, ConstellationOptions, find_constellation
from core.scan.film_area import FilmArea
from core.scan.layouts import UPRIGHT, Way, certified_layouts, guessed_layouts, lying
from core.scan.mark_doubts import doubtful_mark, no_marks, nothing_found
from core.scan.mark_sets import find_mark_sets, middles_apart_mm
from core.scan.measuring import (
    FittedMark,
    Spot,
    TwoWays,
    fit_mark,
    measure_spot,
    open_spots,
    sought,
)
from core.scan.naming import name_marks
from core.scan.raster import ScanFile, photo_id_of

AFTER_ALL_MM = 1.0
"""How near to its place by the others a mark must lie that was not seen from afar, millimetres."""


@dataclass(frozen=True, slots=True)
class FiducialOptions:
    """When a measured mark stands."""

    max_disagreement_px: float = 0.5
    """Greatest distance between the matched and the second middle, pixels."""
    min_correlation: float = 0.55
    """Correlation with the drawn mark below which a place is no mark."""
    surely_mark: float = 0.9
    """Correlation from which a place where nothing was seen from afar is a mark."""
    max_drop: float = 0.25
    """How much less like the mark than the others a place may be before it is no mark."""
    max_spoilt: float = 4.0
    """How much more than the usual mark may differ from the drawn one before it is covered."""
    dirt_from: float = 1.2
    """How much more than the usual mark one differs from the drawn one by noise alone."""
    dirt_px: float = 0.1
    """What dirt that doubles the difference from the drawn mark does to its middle, pixels."""
    max_sigma_px: float = 0.5
    """Standard deviation beyond which a mark is not used, pixels."""
    unsure_px: float = 0.06
    """Standard deviation from which a mark that stands is pointed out, pixels: 0.15 pixels are then
    not sure to 95 per cent."""
    sigma_floor_px: float = 0.006
    """No mark is believed better than this, pixels."""
    agree_mm: float = 1.5
    """How far corner marks and marks of the sides may disagree about each other's places."""
    search: ConstellationOptions = field(default_factory=ConstellationOptions)
    """How the marks are looked for."""


@dataclass(frozen=True, slots=True)
class FiducialMeasurement:
    """One fiducial in one scan."""

    name: str
    """Its name in the camera's certificate."""
    column: float
    """Pixels, outer corner of the first pixel (0, 0)."""
    row: float
    """Pixels."""
    sigma_px: float
    """Standard deviation per axis, pixels."""
    correlation: float
    """Likeness to the drawn mark, 0 to 1."""
    disagreement_px: float
    """Distance between its middles found in two ways, pixels."""
    kind: str
    """Shape of the mark."""


@dataclass(frozen=True, slots=True)
class FiducialSet:
    """All marks of a scan, and how the film lies by them."""

    marks: tuple[FiducialMeasurement, ...]
    """Those that stand, in the order of the certificate."""
    doubts: tuple[Doubt, ...]
    """One for each that does not."""
    way: Way = UPRIGHT
    """How the film lies in the scan."""
    rivals: tuple[Way, ...] = ()
    """Ways that the certificate cannot tell from it."""
    fitted: tuple[FittedMark, ...] = ()
    """The marks as they look in this scan, a kind for each group."""
    guessed: bool = False
    """True where the certificate hardly tells which mark is which, and nothing else does."""

    @property
    def middle(self) -> tuple[float, float]:
        """Middle of the box about the marks, column and row."""
        places = np.array([(mark.column, mark.row) for mark in self.marks])
        column, row = ((places.min(axis=0) + places.max(axis=0)) / 2).tolist()
        return column, row


def measure_fiducials(
    scan: ScanFile,
    camera: Camera,
    scan_pixel_mm: float,
    area: FilmArea,
    options: FiducialOptions | None = None,
) -> FiducialSet:
    """Find and measure the camera's fiducials in a scan.

    Args:
        scan: The scan.
        camera: Camera with its certified fiducials.
        scan_pixel_mm: Nominal size of a scan pixel, millimetres.
        area: The exposed picture.
        options: When a mark stands.
    """
    options = options or FiducialOptions()
    photo_id = photo_id_of(scan.path)
    layouts = certified_layouts(camera, quarters_of(camera, area))
    found = find_mark_sets(scan, layouts, scan_pixel_mm, area, options.agree_mm, options.search)
    if not found:
        return FiducialSet((), (nothing_found(photo_id, len(camera.fiducials_mm)),))
    measured = _measured(scan, found, scan_pixel_mm, options)
    if not measured.marks:
        return FiducialSet((), (nothing_found(photo_id, len(camera.fiducials_mm)),))
    return renamed(measured, camera)


def measure_unknown_fiducials(
    scan: ScanFile,
    camera: Camera,
    scan_pixel_mm: float,
    area: FilmArea,
    options: FiducialOptions | None = None,
) -> FiducialSet:
    """Find marks of which nobody knows where they lie: four in the corners, four at the sides.

    They are named UL, UR, LR, LL and T, R, B, L as they lie in the scan.

    Args:
        scan: The scan.
        camera: Camera with the size of its frame.
        scan_pixel_mm: Nominal size of a scan pixel, millimetres.
        area: The exposed picture.
        options: When a mark stands.
    """
    options = options or FiducialOptions()
    search = replace(options.search, beware_of_border=True, max_log_false_alarms=-6.0)
    sets: list[Constellation] = []
    for layouts in guessed_layouts(camera).values():
        found = find_constellation(scan, layouts, scan_pixel_mm, area, search)
        if isinstance(found, Constellation) and len(found.names) >= 3:
            sets.append(found)
    apart = len(sets) == 2 and middles_apart_mm(sets, scan_pixel_mm) > options.agree_mm
    if len(sets) == 2 and (apart or camera.fiducial_marks == 4):
        sets = [max(sets, key=lambda one: one.score * one.symmetry)]
    if not sets:
        return FiducialSet((), (no_marks(photo_id_of(scan.path)),))
    return _measured(scan, sets, scan_pixel_mm, options)


def renamed(measured: FiducialSet, camera: Camera, preferred: Sequence[Way] = ()) -> FiducialSet:
    """The marks under the names of the way to lie that the certificate speaks for.

    Args:
        measured: Marks with the names they were found under.
        camera: Camera with its certified fiducials.
        preferred: Ways to take where the certificate cannot tell, best first.
    """
    pixels = np.array([(mark.column, mark.row) for mark in measured.marks], dtype=np.float64)
    sigmas = np.array([mark.sigma_px for mark in measured.marks])
    names = [mark.name for mark in measured.marks]
    naming = name_marks(names, pixels, sigmas, measured.way, camera.fiducials_mm, preferred)
    marks = [
        replace(mark, name=name) for mark, name in zip(measured.marks, naming.names, strict=True)
    ]
    order = {name: i for i, name in enumerate(camera.fiducials_mm)}
    marks.sort(key=lambda mark: order[mark.name])
    renamed = dict(zip(names, naming.names, strict=True))
    missing = iter(name for name in order if name not in naming.names)
    doubts: list[Doubt] = []
    for doubt in measured.doubts:
        name = str(doubt.evidence["fiducial"])
        doubts.append(_renamed(doubt, name, renamed[name] if name in renamed else next(missing)))
    return replace(
        measured, marks=tuple(marks), doubts=tuple(doubts), way=naming.way, rivals=naming.rivals,
        guessed=naming.guessed,
    )  # fmt: skip


def quarters_of(camera: Camera, area: FilmArea) -> tuple[int, ...]:
    """Quarter turns the frame's shape allows: all four when it is square."""
    width, height = camera.frame_mm
    if abs(width - height) < 0.02 * width:
        return (0, 1, 2, 3)
    spans = np.ptp(area.corners, axis=0)
    return (0, 2) if (spans[0] - spans[1]) * (width - height) > 0 else (1, 3)


def _measured(
    scan: ScanFile, found: Sequence[Constellation], pixel_mm: float, options: FiducialOptions
) -> FiducialSet:
    """Every mark of every set at full resolution."""
    photo_id = photo_id_of(scan.path)
    marks: list[FiducialMeasurement] = []
    doubts: list[Doubt] = []
    fitted: list[FittedMark] = []
    known: dict[str, TwoWays | Failure] = {}
    for one in found:
        spots = open_spots(scan, one, pixel_mm)
        if one.names or not fitted:
            fit = fit_mark([spot for spot in spots.values() if spot.found], one, pixel_mm)
        else:
            # Nobody saw these marks from afar: they are sought where and as the others tell.
            fit = fitted[0]
            spots = {name: sought(spot, fit, pixel_mm) for name, spot in spots.items()}
        results = _both_ways(spots, one, fit, pixel_mm)
        if not fit.mark.symmetric:
            # A notch drawn turned by a little is found beside its place.
            fit = replace(fit, turn=_turn_of(_judged(results, options), one, fit.turn))
            results = _both_ways(spots, one, fit, pixel_mm)
        if one.names:
            results = _found_after_all(results, spots, one, (fit, *fitted), pixel_mm, options)
        fitted.append(fit)
        everyone = results if one.names else {**known, **results}
        known |= results
        spoilt, judged = _spoilt(everyone), _judged(everyone, options)
        for name in results:
            result = judged[name]
            if isinstance(result, Failure):
                doubts.append(doubtful_mark(photo_id, name, one.predicted[name], result))
                continue
            floor = max(result.sigma_px, options.sigma_floor_px)
            dirt = max(spoilt[name] - options.dirt_from, 0.0)
            sigma = float(np.hypot(floor, options.dirt_px * dirt))
            marks.append(
                FiducialMeasurement(
                    name, result.column, result.row, sigma, result.correlation,
                    result.disagreement_px, fit.mark.shape,
                )
            )  # fmt: skip
            if sigma > options.unsure_px:
                doubts.append(_unsure(photo_id, marks[-1]))
    return FiducialSet(tuple(marks), tuple(doubts), found[0].way, (), tuple(fitted))


def _both_ways(
    spots: Mapping[str, Spot], found: Constellation, fit: FittedMark, pixel_mm: float
) -> dict[str, TwoWays | Failure]:
    """Every mark of a layout measured, or why not."""
    return {
        name: measure_spot(spots[name], fit, pixel_mm)
        if name in spots
        else Failure("It lies outside the scan.")
        for name in found.layout.names
    }


def _found_after_all(
    results: dict[str, TwoWays | Failure],
    spots: Mapping[str, Spot],
    found: Constellation,
    fits: Sequence[FittedMark],
    pixel_mm: float,
    options: FiducialOptions,
) -> dict[str, TwoWays | Failure]:
    """Marks that did not stand are sought in their windows as the others of the scan look.

    From afar a bright spot of the picture may have been taken for the mark beside it.
    """
    judged = _judged(results, options)
    good = {n: r for n, r in judged.items() if isinstance(r, TwoWays)}
    film = dict(zip(found.layout.names, found.layout.lying(found.way).tolist(), strict=True))
    put = fit_similarity(
        np.array([film[n] for n in good]).reshape(-1, 2),
        np.array([(r.column, r.row) for r in good.values()]).reshape(-1, 2),
        mirrored=True,
    )
    again = dict(results)
    if len(good) < 2 or not isinstance(put, PlaneTransform):
        return again
    for name in [n for n in film if n not in good and n in spots]:
        place = apply_affine(put.matrix, np.array([film[name]]))[0]
        for fit in fits:
            if not fit.mark.symmetric:
                continue
            result = measure_spot(sought(spots[name], fit, pixel_mm), fit, pixel_mm)
            if isinstance(result, Failure) or result.correlation < options.surely_mark:
                continue
            if np.hypot(result.column - place[0], result.row - place[1]) * pixel_mm < AFTER_ALL_MM:
                again[name] = result
                break
    return again


def _turn_of(results: Mapping[str, TwoWays | Failure], found: Constellation, turn: float) -> float:
    """Small rotation of the film (clockwise in the scan) by the marks themselves."""
    at = {name: i for i, name in enumerate(found.layout.names)}
    good = {n: r for n, r in results.items() if isinstance(r, TwoWays) and r.disagreement_px < 1}
    if len(good) < 3:
        return turn
    pixels = np.array([(r.column, r.row) for r in good.values()])
    sigmas = np.array([max(r.sigma_px, 0.1) for r in good.values()])
    places = {
        name: (float(x), float(y)) for name, (x, y) in zip(at, found.layout.film, strict=True)
    }
    # The names the marks were found under may be those of another way to lie.
    naming = name_marks(list(good), pixels, sigmas, found.way, places)
    film = lying(found.layout.film, naming.way)[[at[name] for name in naming.names]]
    fit = fit_similarity(film, pixels, mirrored=True)
    if not isinstance(fit, PlaneTransform):
        return turn
    clockwise = float(np.arctan2(fit.matrix[1, 0], fit.matrix[0, 0]))
    return float((clockwise + np.pi / 4) % (np.pi / 2) - np.pi / 4)


def _spoilt(results: Mapping[str, TwoWays | Failure]) -> dict[str, float]:
    """How much more than in the clean ones is there besides the mark: dirt makes unsure."""
    left = {n: 1 - r.correlation**2 for n, r in results.items() if isinstance(r, TwoWays)}
    least = max(float(np.percentile(list(left.values()), 25)) if left else 1.0, 0.01)
    return {name: max(1.0, float(np.sqrt(max(value, 0.0) / least))) for name, value in left.items()}


def _judged(
    results: Mapping[str, TwoWays | Failure], options: FiducialOptions
) -> dict[str, TwoWays | Failure]:
    """Marks that are like the drawn mark, like the others, and alike in both ways."""
    likeness = [r.correlation for r in results.values() if isinstance(r, TwoWays)]
    usual = float(np.median(likeness)) if likeness else 0.0
    least = max(options.min_correlation, usual - options.max_drop)
    spoilt, most_apart = _spoilt(results), options.max_disagreement_px
    judged: dict[str, TwoWays | Failure] = {}
    for name, result in results.items():
        judged[name] = result
        if isinstance(result, Failure):
            continue
        if result.correlation < least:
            judged[name] = Failure(
                f"What is there is not like the mark (correlation {result.correlation:.2f}).",
                {"correlation": result.correlation},
            )
        elif spoilt[name] > options.max_spoilt:
            judged[name] = Failure(
                "Something covers it: it is much less like the drawn mark than the others are "
                f"(correlation {result.correlation:.2f}).",
                {"correlation": result.correlation},
            )
        elif result.sigma_px > options.max_sigma_px:
            judged[name] = Failure(
                f"Its middle is only known to {result.sigma_px:.1f} pixels.",
                {"sigma_px": result.sigma_px},
            )
        elif (apart := max(result.disagreement_px, result.outline_px)) > most_apart:
            judged[name] = Failure(
                f"The ways to centre it differ by {apart:.2f} pixels.", {"disagreement_px": apart}
            )
    return judged


def _renamed(doubt: Doubt, old: str, new: str) -> Doubt:
    """The same doubt about the mark under its other name."""
    if old == new:
        return doubt
    message = doubt.message.replace(f"Fiducial {old},", f"Fiducial {new},", 1)
    return replace(doubt, message=message, evidence={**doubt.evidence, "fiducial": new})


def _unsure(photo_id: str, mark: FiducialMeasurement) -> Doubt:
    """The doubt of a mark that stands, but not firmly."""
    return Doubt(
        "fiducial-unsure",
        photo_id,
        f"Fiducial {mark.name}, at column {mark.column:.1f}, row {mark.row:.1f}, is only known to "
        f"{mark.sigma_px:.2f} pixels: dirt, a scratch or a blurred mark. Look at it.",
        0.3,
        {"fiducial": mark.name, "column": mark.column, "row": mark.row, "sigma_px": mark.sigma_px},
    )
