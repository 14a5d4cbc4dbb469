"""Marks that did not stand at first, sought once more as the others look and where they put them.

From afar a bright spot of the picture may have been taken for the mark beside it; and until the
marks have their right names nobody knows to a few pixels where a missing one should be.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from core.doubts import Doubt, Failure
from core.geometry.camera import Camera
from core.geometry.interior import InteriorOrientation, fit_interior
from core.geometry.transforms import PlaneTransform, apply_affine, fit_similarity
from core.raster.scan_file import ScanFile, photo_id_of
from core.scans.candidates import eighth
from core.scans.constellation import Constellation
from core.scans.judging import FiducialOptions, judged_marks, measurement_of, spoilt_by, unsure
from core.scans.layouts import lying
from core.scans.mark_doubts import doubtful_mark, unsure_mark
from core.scans.mark_windows import Spot, open_spot
from core.scans.measured_marks import FiducialMeasurement, FiducialSet
from core.scans.measuring import FittedMark, TwoWays, measure_spot, sought
from core.scans.naming import small_turn

AFTER_ALL_MM = 1.0
"""How near to its place by the others a mark must lie that was not seen from afar, millimetres."""
AGAIN_MM = 0.12
"""The same once the marks have their right names: what film bends and shrinks."""
ELSEWHERE_MM = 0.5
"""A doubt tells another place from this distance on, millimetres."""


def looked_again(
    scan: ScanFile,
    camera: Camera,
    named: FiducialSet,
    pixel_mm: float,
    options: FiducialOptions,
) -> FiducialSet:
    """The marks, and those that were not measured but lie where the named ones put them.

    Args:
        scan: The scan.
        camera: Camera with its certified fiducials.
        named: The marks that stand under their names, and doubts about the others.
        pixel_mm: Nominal size of a scan pixel, millimetres.
        options: When a mark stands.
    """
    interior = _interior(named, camera)
    lost = [name for name in camera.fiducials_mm if interior and name not in interior.names]
    if interior is None or not lost:
        return named
    look = _Look(scan, camera, interior, _turned(named, camera), pixel_mm, options)
    marks = {mark.name: mark for mark in named.marks}
    doubts = {str(doubt.evidence["fiducial"]): doubt for doubt in named.doubts}
    clean = [marks[name] for name in interior.names]
    for name in lost:
        found = _sought_again(look, name, clean)
        if isinstance(found, tuple):
            mark, result = found
            marks[name] = mark
            doubts.pop(name, None)
            if unsure(mark, result, options):
                doubts[name] = unsure_mark(look.photo_id, name, mark.place, mark.sigma_px)
        elif name in doubts and name not in marks:
            doubts[name] = _in_place(look, doubts[name], name, found)
    order = [name for name in camera.fiducials_mm if name in marks]
    return replace(named, marks=tuple(marks[name] for name in order), doubts=tuple(doubts.values()))


@dataclass(frozen=True, slots=True, eq=False)
class _Look:
    """What stays the same for all marks that are sought again."""

    scan: ScanFile
    camera: Camera
    interior: InteriorOrientation
    fits: tuple[FittedMark, ...]
    pixel_mm: float
    options: FiducialOptions

    @property
    def photo_id(self) -> str:
        """The photo."""
        return photo_id_of(self.scan.path)

    def place(self, name: str) -> tuple[float, float]:
        """Where the marks that stand put another, scan pixels."""
        film = np.array([self.camera.fiducials_mm[name]], dtype=np.float64)
        column, row = self.interior.pixel_from_film(film)[0].tolist()
        return column, row


def _interior(named: FiducialSet, camera: Camera) -> InteriorOrientation | None:
    """How the film lies by the marks that stand; None where too few do, or do not agree."""
    if len(named.marks) < 3:
        return None
    pixels = np.array([mark.place for mark in named.marks], dtype=np.float64)
    film = np.array([camera.fiducials_mm[mark.name] for mark in named.marks], dtype=np.float64)
    sigmas = np.array([mark.sigma_px for mark in named.marks])
    names = [mark.name for mark in named.marks]
    fit = fit_interior(names, pixels, film, "auto", sigmas_px=sigmas, mirrored=named.way[1])
    return fit if isinstance(fit, InteriorOrientation) and len(fit.names) >= 3 else None


def _turned(named: FiducialSet, camera: Camera) -> tuple[FittedMark, ...]:
    """The marks of the scan, drawn turned as the film lies by their right names."""
    certified = np.array([camera.fiducials_mm[mark.name] for mark in named.marks], dtype=np.float64)
    pixels = np.array([mark.place for mark in named.marks], dtype=np.float64)
    put = fit_similarity(lying(certified, named.way), pixels, mirrored=True)
    if not isinstance(put, PlaneTransform):
        return named.fitted
    return tuple(replace(fit, turn=small_turn(put)) for fit in named.fitted)


def _sought_again(
    look: _Look, name: str, clean: Sequence[FiducialMeasurement]
) -> tuple[FiducialMeasurement, TwoWays] | Failure:
    """One mark where the others put it, as one of the kinds of this scan."""
    place, middle = look.place(name), look.interior.pixels.mean(axis=0)
    failure = Failure("It lies outside the scan.")
    for fit in look.fits:
        outward = eighth((place[0] - middle[0], place[1] - middle[1]), -fit.turn)
        spot = open_spot(look.scan, name, place, outward, fit.mark.reach_mm, look.pixel_mm)
        if spot is None:
            return failure
        result = measure_spot(spot, fit, look.pixel_mm)
        alike = {
            mark.name: TwoWays(*mark.place, mark.sigma_px, mark.correlation, 0.0)
            for mark in clean
            if mark.kind == fit.mark.shape
        }
        everyone: dict[str, TwoWays | Failure] = {**alike, name: result}
        judged = judged_marks(everyone, look.options)[name]
        if isinstance(judged, Failure):
            failure = judged
        elif np.hypot(judged.column - place[0], judged.row - place[1]) * look.pixel_mm > AGAIN_MM:
            failure = Failure("What is there does not lie where the other marks put it.")
        elif alike or judged.correlation > look.options.surely_mark:
            spoilt = spoilt_by(everyone)[name]
            mark = measurement_of(name, judged, spoilt, fit.mark.shape, look.options)
            return mark, judged
    return failure


def _in_place(look: _Look, doubt: Doubt, name: str, failure: Failure) -> Doubt:
    """The doubt of a mark that is still missing, told of the place that its right name has."""
    place = look.place(name)
    told = (float(str(doubt.evidence["column"])), float(str(doubt.evidence["row"])))
    beside_mm = float(np.hypot(place[0] - told[0], place[1] - told[1])) * look.pixel_mm
    return doubt if beside_mm < ELSEWHERE_MM else doubtful_mark(look.photo_id, name, place, failure)


def found_after_all(
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
    judged = judged_marks(results, options)
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
