"""Fiducials measured to a fraction of a pixel; one that is missing or in doubt says so."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from core.doubts import Doubt, Failure
from core.geometry.camera import Camera
from core.geometry.transforms import PlaneTransform, fit_similarity
from core.raster.scan_file import ScanFile, photo_id_of
from core.scans.constellation import Constellation, find_constellation
from core.scans.film_area import FilmArea
from core.scans.judging import FiducialOptions, judged_marks, measurement_of, spoilt_by, unsure
from core.scans.layouts import Way, certified_layouts, guessed_layouts, lying
from core.scans.mark_doubts import doubtful_mark, no_marks, nothing_found, unsure_mark
from core.scans.mark_recovery import found_after_all, looked_again
from core.scans.mark_sets import find_mark_sets, middles_apart_mm
from core.scans.mark_windows import Spot, open_spots
from core.scans.measured_marks import FiducialMeasurement, FiducialSet
from core.scans.measuring import (
    FittedMark,
    TwoWays,
    fit_mark,
    measure_spot,
    sought,
)
from core.scans.naming import name_marks, small_turn


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
    measured = _measured(scan, found, scan_pixel_mm, area, options)
    if not measured.marks:
        return FiducialSet((), (nothing_found(photo_id, len(camera.fiducials_mm)),))
    named = renamed(measured, camera, area=area)
    again = looked_again(scan, camera, named, scan_pixel_mm, options)
    return named if again is named else renamed(again, camera, area=area)


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
    return _measured(scan, sets, scan_pixel_mm, area, options)


def renamed(
    measured: FiducialSet,
    camera: Camera,
    preferred: Sequence[Way] = (),
    area: FilmArea | None = None,
) -> FiducialSet:
    """The marks under the names of the way to lie that the certificate speaks for.

    Args:
        measured: Marks with the names they were found under.
        camera: Camera with its certified fiducials.
        preferred: Ways to take where the certificate cannot tell, best first.
        area: The exposed picture.
    """
    pixels = np.array([(mark.column, mark.row) for mark in measured.marks], dtype=np.float64)
    sigmas = np.array([mark.sigma_px for mark in measured.marks])
    names = [mark.name for mark in measured.marks]
    naming = name_marks(names, pixels, sigmas, measured.way, camera.fiducials_mm, preferred, area)
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
    scan: ScanFile,
    found: Sequence[Constellation],
    pixel_mm: float,
    area: FilmArea,
    options: FiducialOptions,
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
            fit = replace(fit, turn=_turn_of(judged_marks(results, options), one, fit.turn, area))
            results = _both_ways(spots, one, fit, pixel_mm)
        if one.names:
            results = found_after_all(results, spots, one, (fit, *fitted), pixel_mm, options)
        fitted.append(fit)
        everyone = results if one.names else {**known, **results}
        known |= results
        spoilt, judged = spoilt_by(everyone), judged_marks(everyone, options)
        for name in results:
            result = judged[name]
            if isinstance(result, Failure):
                doubts.append(doubtful_mark(photo_id, name, one.predicted[name], result))
                continue
            mark = measurement_of(name, result, spoilt[name], fit.mark.shape, options)
            marks.append(mark)
            if unsure(mark, result, options):
                place = (mark.column, mark.row)
                doubts.append(unsure_mark(photo_id, name, place, mark.sigma_px))
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


def _turn_of(
    results: Mapping[str, TwoWays | Failure], found: Constellation, turn: float, area: FilmArea
) -> float:
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
    naming = name_marks(list(good), pixels, sigmas, found.way, places, (), area)
    film = lying(found.layout.film, naming.way)[[at[name] for name in naming.names]]
    fit = fit_similarity(film, pixels, mirrored=True)
    if not isinstance(fit, PlaneTransform):
        return turn
    return small_turn(fit)


def _renamed(doubt: Doubt, old: str, new: str) -> Doubt:
    """The same doubt about the mark under its other name."""
    if old == new:
        return doubt
    message = doubt.message.replace(f"Fiducial {old},", f"Fiducial {new},", 1)
    return replace(doubt, message=message, evidence={**doubt.evidence, "fiducial": new})
