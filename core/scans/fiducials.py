"""Measure the fiducials of a scan with sub-pixel precision; missing or doubtful ones are reported.

Marks that are not accepted at first are searched for once more, with the appearance and the
places that the others give: at reduced resolution a bright spot of the picture may be taken for
the mark beside it, and until marks have their right names the place of a missing one is not known
to a few pixels.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from core.arrays import FilmPoints, PixelPoints
from core.doubts import Doubt, Failure
from core.geometry.camera import Camera
from core.geometry.interior import InteriorOrientation
from core.geometry.transforms import PlaneTransform, apply_affine, fit_similarity
from core.raster.scan_file import ScanFile, photo_id_of
from core.said import say
from core.scans.candidates import eighth
from core.scans.constellation import (
    AGREE_MM,
    LIBRARY,
    Constellation,
    find_constellation,
    find_mark_sets,
)
from core.scans.film_area import FilmArea
from core.scans.judging import (
    SURELY_MARK,
    FiducialMeasurement,
    FiducialSet,
    certified_places,
    doubt_of_repeated,
    doubt_of_sigma,
    doubtful_mark,
    interior_of,
    judged_marks,
    judged_set,
    measurement_of,
    nothing_found,
    places_of,
    spoilt_by,
)
from core.scans.marks import NOTCH_NORMALS, Mark
from core.scans.measuring import (
    FittedMark,
    Spot,
    TwoWays,
    fit_mark,
    measure_spot,
    open_spot,
    open_spots,
)
from core.scans.naming import (
    GROUPS,
    Group,
    Way,
    certified_layouts,
    guessed_layouts,
    lying,
    name_marks,
    small_turn,
)

AFTER_ALL_MM = 1.0  # design: the fit that sets are found with
"""How near to its place by the others a mark must lie that was not seen from afar."""
AGAIN_MM = 0.12  # design: what film bends and shrinks
"""The same once the marks have their right names."""
ELSEWHERE_MM = 0.5  # design: a mark is then outside the crop that is shown
"""A doubt tells another place from this distance on."""
SQUARE = 0.02  # design: the tolerance of the picture's size
"""Frames whose sides differ by less, as a share, may lie in four ways."""
GUESSED = (*NOTCH_NORMALS, "dot")
"""Kinds that much else is like: a tooth is one at its tip and at its foot."""
HAND_SIGMA_PX = 0.4  # measured: test_fiducials (real), a hand on Wild marks: 13 um RMS of 42
"""What a careful hand can do on a screen."""


def measure_fiducials(
    scan: ScanFile,
    camera: Camera,
    scan_pixel_mm: float,
    area: FilmArea,
) -> FiducialSet:
    """Find and measure the camera's fiducials in a scan.

    Args:
        scan: The scan.
        camera: Camera with its certified fiducials.
        scan_pixel_mm: Nominal size of a scan pixel, millimetres.
        area: The exposed picture.
    """
    photo_id = photo_id_of(scan.path)
    layouts = certified_layouts(camera, quarters_of(camera, area))
    found = find_mark_sets(scan, layouts, scan_pixel_mm, area)
    if not found:
        return FiducialSet((), (nothing_found(photo_id, len(camera.fiducials_mm)),))
    measured = _measured(scan, found, scan_pixel_mm, area)
    if not measured.marks:
        return FiducialSet((), (nothing_found(photo_id, len(camera.fiducials_mm)),))
    named = renamed(measured, camera, area=area)
    again = measure_missing_marks(scan, camera, named, scan_pixel_mm)
    return named if again is named else renamed(again, camera, area=area)


def measure_unknown_fiducials(
    scan: ScanFile,
    camera: Camera,
    scan_pixel_mm: float,
    area: FilmArea,
    marks: tuple[Mark, ...] = LIBRARY,
    dim: Group | None = None,
) -> FiducialSet:
    """Find marks of which nobody knows where they lie: four in the corners, four at the sides.

    They are named UL, UR, LR, LL and T, R, B, L as they lie in the scan.

    Args:
        scan: The scan.
        camera: Camera with the size of its frame.
        scan_pixel_mm: Nominal size of a scan pixel, millimetres.
        area: The exposed picture.
        marks: Kinds and sizes that are looked for.
        dim: The group alone in which they are sought as figures with hardly any contrast.
    """
    sets: list[Constellation] = []
    for layout in guessed_layouts(camera):
        if dim is not None and layout.names != tuple(GROUPS[dim]):
            continue
        found = find_constellation(
            scan, layout, scan_pixel_mm, area, marks=marks, dim=dim is not None
        )
        if isinstance(found, Constellation) and len(found.names) >= 3:
            sets.append(found)
    apart = len(sets) == 2 and _middles_apart_mm(sets, scan_pixel_mm) > AGREE_MM
    if len(sets) == 2 and (apart or camera.fiducial_marks == 4):
        sets = [max(sets, key=lambda one: one.score * one.symmetry)]
    if not sets:
        return FiducialSet((), (nothing_found(photo_id_of(scan.path), 0),))
    found = _measured(scan, sets, scan_pixel_mm, area)
    doubted = {doubt.evidence["fiducial"] for doubt in found.doubts}
    guessed = [one for one in found.marks if one.kind in GUESSED and one.name not in doubted]
    unsure = tuple(doubt_of_repeated(photo_id_of(scan.path), mark) for mark in guessed)
    return replace(found, doubts=(*found.doubts, *unsure))


def _middles_apart_mm(sets: Sequence[Constellation], pixel_mm: float) -> float:
    """Distance between the middles of two sets of four."""
    middles = [np.mean(list(one.predicted.values()), axis=0) for one in sets]
    return float(np.linalg.norm(middles[0] - middles[1])) * pixel_mm


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
    pixels = places_of(measured.marks)
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
        doubts.append(
            renamed_doubt(doubt, name, renamed[name] if name in renamed else next(missing))
        )
    return replace(
        measured, marks=tuple(marks), doubts=tuple(doubts), way=naming.way, rivals=naming.rivals,
        guessed=naming.guessed,
    )  # fmt: skip


def quarters_of(camera: Camera, area: FilmArea) -> tuple[int, ...]:
    """Quarter turns the frame's shape allows: all four when it is square."""
    width, height = camera.frame_mm
    if abs(width - height) < SQUARE * width:
        return (0, 1, 2, 3)
    spans = np.ptp(area.corners, axis=0)
    return (0, 2) if (spans[0] - spans[1]) * (width - height) > 0 else (1, 3)


def _measured(
    scan: ScanFile,
    found: Sequence[Constellation],
    pixel_mm: float,
    area: FilmArea,
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
            spots = {name: search_mark(spot, fit, pixel_mm) for name, spot in spots.items()}
        results = both_ways(spots, one, fit, pixel_mm)
        if not fit.mark.symmetric:
            # A notch drawn turned by a little is found beside its place.
            turn = _turn_of(judged_marks(results), one, fit.turn, area)
            if turn != fit.turn:
                fit = replace(fit, turn=turn)
                results = both_ways(spots, one, fit, pixel_mm)
        if one.names:
            results = found_after_all(results, spots, one, (fit, *fitted), pixel_mm)
        fitted.append(fit)
        everyone = results if one.names else {**known, **results}
        known |= results
        stand, doubted = judged_set(photo_id, results, everyone, one.predicted, fit)
        marks += stand
        doubts += doubted
    return FiducialSet(tuple(marks), tuple(doubts), found[0].way, (), tuple(fitted))


def search_mark(spot: Spot, fitted: FittedMark, pixel_mm: float) -> Spot:
    """The spot with its start where the window is most like a mark that was fitted elsewhere."""
    template = fitted.drawn(spot.outward, pixel_mm * spot.reduction).astype(np.float32)
    side = template.shape[0]
    if min(spot.gray.shape) <= side:
        return spot
    field = cv2.matchTemplate(spot.gray, template, cv2.TM_CCOEFF_NORMED)
    best = int(np.nan_to_num(field if fitted.bright else -field).argmax())
    row, column = divmod(best, field.shape[1])
    return replace(spot, start=(column + side / 2, row + side / 2))


def both_ways(
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
    # design: notches drawn turned are off by as much
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


def renamed_doubt(doubt: Doubt, old: str, new: str) -> Doubt:
    """The same doubt about the mark under its other name."""
    if old == new:
        return doubt
    message = doubt.message.replace(f"Fiducial {old},", f"Fiducial {new},", 1)
    return replace(doubt, message=message, evidence={**doubt.evidence, "fiducial": new})


def measure_missing_marks(
    scan: ScanFile,
    camera: Camera,
    named: FiducialSet,
    pixel_mm: float,
) -> FiducialSet:
    """The marks, and those that were not measured but lie where the named ones put them.

    Args:
        scan: The scan.
        camera: Camera with its certified fiducials.
        named: The marks that stand under their names, and doubts about the others.
        pixel_mm: Nominal size of a scan pixel, millimetres.
    """
    interior = _interior(named, camera)
    lost = [name for name in camera.fiducials_mm if interior and name not in interior.names]
    if interior is None or not lost:
        return named
    look = _Look(scan, camera, interior, _turned(named, camera), pixel_mm)
    marks = {mark.name: mark for mark in named.marks}
    doubts = {str(doubt.evidence["fiducial"]): doubt for doubt in named.doubts}
    clean = [marks[name] for name in interior.names]
    for name in lost:
        found = _sought_again(look, name, clean)
        if isinstance(found, tuple):
            mark, result = found
            marks[name] = mark
            doubts.pop(name, None)
            for doubt in doubt_of_sigma(look.photo_id, mark, result):
                doubts[name] = doubt
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
    fit = interior_of(named.marks, camera.fiducials_mm, named.way[1])
    return fit if isinstance(fit, InteriorOrientation) and len(fit.names) >= 3 else None


def _turned(named: FiducialSet, camera: Camera) -> tuple[FittedMark, ...]:
    """The marks of the scan, drawn turned as the film lies by their right names."""
    certified = certified_places(named.marks, camera.fiducials_mm)
    put = fit_similarity(lying(certified, named.way), places_of(named.marks), mirrored=True)
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
        judged = judged_marks(everyone)[name]
        if isinstance(judged, Failure):
            failure = judged
        elif np.hypot(judged.column - place[0], judged.row - place[1]) * look.pixel_mm > AGAIN_MM:
            failure = Failure("What is there does not lie where the other marks put it.")
        elif alike or judged.correlation > SURELY_MARK:
            spoilt = spoilt_by(everyone)[name]
            mark = measurement_of(name, judged, spoilt, fit.mark.shape)
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
) -> dict[str, TwoWays | Failure]:
    """Marks that did not stand are sought in their windows as the others of the scan look.

    From afar a bright spot of the picture may have been taken for the mark beside it.
    """
    judged = judged_marks(results)
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
            result = measure_spot(search_mark(spots[name], fit, pixel_mm), fit, pixel_mm)
            if isinstance(result, Failure) or result.correlation < SURELY_MARK:
                continue
            if np.hypot(result.column - place[0], result.row - place[1]) * pixel_mm < AFTER_ALL_MM:
                again[name] = result
                break
    return again


def fiducials_by_hand(
    photo_id: str, camera: Camera, by_hand: Mapping[str, tuple[float, float]]
) -> FiducialSet:
    """Marks as somebody measured and named them; names the certificate lacks are a doubt.

    Args:
        photo_id: The photo.
        camera: Camera with its certified fiducials.
        by_hand: Column and row by name.
    """
    known = {name: place for name, place in by_hand.items() if name in camera.fiducials_mm}
    marks = tuple(
        FiducialMeasurement(name, *known[name], HAND_SIGMA_PX, 1.0, 0.0, "by hand")
        for name in camera.fiducials_mm
        if name in known
    )
    doubts = tuple(
        Doubt(
            "fiducial-doubtful",
            photo_id,
            say(
                "Fiducial {name} was measured by hand, but camera '{camera}' has no such mark.",
                name=name,
                camera=camera.name,
            ),
            evidence={"fiducial": name},
        )
        for name in by_hand
        if name not in known
    )
    turn, back = seen_from(places_of(marks), certified_places(marks, camera.fiducials_mm))
    if turn is None:
        return FiducialSet(marks, doubts)
    # The film is turned in the scan by as much as the scan is turned back on the film.
    angle = float(np.arctan2(turn.matrix[1, 0], turn.matrix[0, 0]))
    quarter = round((np.pi - angle if back else -angle) / (np.pi / 2)) % 4
    return FiducialSet(marks, doubts, (quarter, back))


def seen_from(pixels: PixelPoints, film: FilmPoints) -> tuple[PlaneTransform | None, bool]:
    """The similarity film from scan through marks, and whether they lie as seen from the back.

    Fewer than three marks cannot tell, and have none.
    """
    if len(pixels) < 3:
        return None, False
    fits = [fit_similarity(pixels, film, mirrored=not back) for back in (False, True)]
    rms = [fit.rms if isinstance(fit, PlaneTransform) else np.inf for fit in fits]
    back = bool(rms[1] < rms[0])
    best = fits[back]
    return (best if isinstance(best, PlaneTransform) else None), back
