"""Marks that are corners of the frame: four that lie and point as cameras have them.

Notches, teeth and wings are corners of the frame's own outline, and nobody can list all of them.
What cameras share is how they are laid out. Marks of opposite sides are alike, turned or mirrored;
the lines that join them cross at right angles in the middle of the picture, as its border runs; and
a mark is made to be pointed at: one of its edges runs along such a line, or its edges are mirror
images about it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from math import comb

import numpy as np
from jaxtyping import Float64

from core.doubts import Failure
from core.geometry.camera import Camera
from core.raster.scan_file import ScanFile, photo_id_of, read_window
from core.scans.candidates import SearchWindow, eighth, fill_window
from core.scans.constellation import FRAME_CORNER_MM, SEARCH_PIXEL_MM, expected_places
from core.scans.corners import (
    COARSEST_MM,
    FARTHEST_MM,
    Edges,
    angle_between,
    corners_in,
    edges_about,
    turned_edges,
)
from core.scans.example import Corner, ShownMark, example_reduction
from core.scans.film_area import FilmArea
from core.scans.judging import SHOWN_PX, FiducialMeasurement, FiducialSet, judged_set
from core.scans.marks import EXAMPLE, Mark
from core.scans.measuring import FittedMark, TwoWays, measure_corner, open_spot
from core.scans.naming import CORNERS, GROUPS, SIDES, Group
from core.scans.rectangles import Rectangles, fit_rectangles

MARGIN_MM: Mapping[Group, tuple[float, float]] = {
    "corners": (5.0, 12.0),
    "sides": (0.0, 8.0),
}  # design: marks of sides lie at the border, those of corners up to 15 mm inside it
"""How far inside the border windows have their middle, and their half width."""
LEAST_MARKS = 3  # design: two fit anywhere
"""Marks that are found together at least."""
KEPT = 14  # design: time; insets of real frames showed at most twelve
"""Corners of a window that are kept, likest first."""
FOUND_MM = 0.3  # design: four cells of the search
"""How far a corner may be from where it was sought, and measured from where it was found."""
# design: each is what frames of cameras that were looked at are usually made to
APART_MM, MIDDLE_MM, TURN_DEG, ALIKE_DEG, POINTED_DEG = 0.15, 0.7, 0.3, 4.0, 3.0
"""Usual distance of marks from their rectangle, of its middle from the picture's, usual turn
against the border, and how edges of opposite marks, and edges that point, usually differ."""
MOST = 9.0  # design: three sigmas
"""Square of a deviation beyond which it is none of the usual."""
OUTWARD = 3.0  # design: the step of a tooth or wing begins at its mark and runs into the picture
"""What an edge that runs outward counts against a mark."""
MISSING = 12.0  # design: more than a mark that fits badly in two ways
"""What a mark that was not seen counts against a set."""
MOST_MISFIT = 18.0  # design: two deviations of three sigmas
ON_AXES_MM = 3.0  # design: three of what is usual
"""How far beside the middle of a side a corner may lie, in what is usual."""
INSETS_DIFFER_MM = 1.5  # design: half of what marks lie further out along one axis (constellation)
"""How much further out marks of one camera may lie at one side than at the others."""
MOST_CHANCE_AXES = -1.3  # source: the usual one in twenty; every such mark is a doubt as well
"""log10 of the number of sets as good at the middles of sides that chance may give."""


@dataclass(frozen=True, slots=True)
class _Seen:
    """A corner that was seen."""

    place: tuple[float, float]
    edges: Edges
    outward: float
    """Direction from the middle of the photo, as the film lies, radians."""

    def angles(self, *, mirrored: bool) -> tuple[float, float]:
        """Its rising and its falling edge from its outward direction, as it is or in a mirror."""
        rise, fall = turned_edges(self.edges, self.outward, 0.0, mirrored)
        return (rise.angle, fall.angle) if rise.rises else (fall.angle, rise.angle)


def measure_corners(
    scan: ScanFile,
    camera: Camera,
    pixel_mm: float,
    area: FilmArea,
    shown: tuple[ShownMark, Corner] | None = None,
    known: Sequence[FiducialMeasurement] = (),
) -> FiducialSet | Failure:
    """Find and measure corners at the four sides that lie and point as marks of a camera do.

    Where three do not make a rectangle and none was shown, one or two suffice that point at the
    middle of their side: known marks of corners tell where that is, or the border all around.

    Args:
        scan: The scan.
        camera: Camera with the size of its frame.
        pixel_mm: Nominal size of a scan pixel, millimetres.
        area: The exposed picture.
        shown: One of them, where somebody pointed at it, and where its edges meet.
        known: Marks in the corners of the frame.
    """
    if pixel_mm > COARSEST_MM:
        return Failure("The scan is too coarse for edges.")
    placed = _placed_by(known, area)
    area = area if placed is None else placed
    windows = frame_windows(scan, camera, pixel_mm, area, "sides")
    seen = [_seen_in(window, area, pixel_mm) for window in windows]
    if shown is not None:
        _keep_shown(seen, windows, *shown, own=shown[0].scan.path == scan.path, area=area)
    fitted = _rectangle(seen, area, pixel_mm)
    placing = placed is not None or len(area.seen) == len(SIDES)
    if fitted is None and shown is None and placing:
        usual_mm = MIDDLE_MM if placed is None else FOUND_MM
        fitted = _on_axes(seen, area, np.array(camera.frame_mm) / 2, pixel_mm, usual_mm)
    if fitted is None:
        return Failure("No corners of the frame lie as marks do.")
    return _measured(scan, pixel_mm, seen, fitted)


def _placed_by(known: Sequence[FiducialMeasurement], area: FilmArea) -> FilmArea | None:
    """The picture as marks of its corners place it; None without all four: three check nothing."""
    places = np.full((len(CORNERS), 1), complex(np.nan, np.nan))
    for mark in known:
        if mark.name in CORNERS:
            places[list(CORNERS).index(mark.name)] = complex(mark.column, -mark.row)
    if not np.isfinite(places).all():
        return None
    fitted = fit_rectangles(places, np.array(list(CORNERS.values())))
    turn = np.exp(1j * (fitted.turn[0] - area.turn))
    about = (area.corners - area.centre) @ np.array([1, -1j])
    moved = fitted.middle[0] + about * turn
    return replace(area, corners=np.column_stack([moved.real, -moved.imag]))


def _rectangle(
    seen: Sequence[Sequence[_Seen]], area: FilmArea, pixel_mm: float
) -> Rectangles | None:
    """The likeliest rectangle of corners at three sides or all."""
    if sum(bool(one) for one in seen) < LEAST_MARKS:
        return None
    count = max(len(one) for one in seen)
    places = np.full((4, count), complex(np.nan, np.nan))
    for k, corners in enumerate(seen):
        places[k, : len(corners)] = [complex(c.place[0], -c.place[1]) for c in corners]
    fitted = fit_rectangles(places, np.array(list(SIDES.values())))
    misfit = _misfit(fitted, seen, area, pixel_mm)
    if not len(misfit) or misfit.min() > MOST_MISFIT:
        return None
    best = slice(int(np.argmin(misfit)), int(np.argmin(misfit)) + 1)
    return Rectangles(
        fitted.chosen[best], fitted.middle[best], fitted.turn[best], fitted.half[best],
        fitted.apart[best],
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Pointing:
    """A corner that points along a line through the middle of the picture."""

    number: int
    """Which of its side's corners it is."""
    corner: _Seen
    beside_mm: float
    """Distance from the line from the picture's middle to that of the side."""
    inset_mm: float
    """How much further out than the frame it lies."""
    pointing: float
    """How far from pointing, in what is usual."""


def _on_axes(
    seen: Sequence[Sequence[_Seen]],
    area: FilmArea,
    half_mm: Float64[np.ndarray, "2"],
    pixel_mm: float,
    usual_mm: float,
) -> Rectangles | None:
    """Corners that point at the middles of their sides, about equally far out: of any sides.

    Args:
        seen: Corners by side.
        area: The picture; its middle and its turn are known.
        half_mm: Half width and half height of the frame.
        pixel_mm: Nominal size of a scan pixel, millimetres.
        usual_mm: How far beside the middle of a side marks usually lie.
    """
    directions = np.array(list(SIDES.values()))
    middle = complex(area.centre[0, 0], -area.centre[0, 1])
    outward = directions @ np.array([1, 1j]) * np.exp(1j * area.turn)
    pointing: list[list[_Pointing]] = []
    for k, corners in enumerate(seen):
        found: list[_Pointing] = []
        for i, one in enumerate(corners):
            at = (complex(one.place[0], -one.place[1]) - middle) / outward[k] * pixel_mm
            inset = float(at.real) - float(np.abs(directions[k]) @ half_mm)
            found.append(_Pointing(i, one, abs(at.imag), inset, float(np.sqrt(_pointing(one)))))
        pointing.append([one for one in found if one.pointing**2 < MOST])
    near = [[one for one in own if one.beside_mm < ON_AXES_MM * usual_mm] for own in pointing]
    elsewhere = [
        one.pointing for own in pointing for one in own if one.beside_mm >= ON_AXES_MM * usual_mm
    ]
    tried = [dict(enumerate(them)) for them in product(*([None, *own] for own in near))]
    sets = [{k: one for k, one in them.items() if one is not None} for them in tried]
    sets = [them for them in sets if them and _differ_mm(them) < 2 * INSETS_DIFFER_MM]
    chances = [_log_chance_on_axes(list(them.values()), elsewhere, usual_mm) for them in sets]
    if min(chances, default=0.0) > MOST_CHANCE_AXES:
        return None
    best = sets[int(np.argmin(chances))]
    inset = float(np.mean([one.inset_mm for one in best.values()]))
    half = half_mm + [
        float(np.mean([best[k].inset_mm for k in pair if k in best] or [inset]))
        for pair in ((1, 3), (0, 2))
    ]
    chosen = [[best[k].number if k in best else -1 for k in range(len(SIDES))]]
    return Rectangles(
        np.array(chosen), np.array([middle]), np.array([area.turn]), half[None] / pixel_mm,
        np.zeros((1, len(SIDES))),
    )  # fmt: skip


def _differ_mm(chosen: Mapping[int, _Pointing]) -> float:
    """How much further out one of them lies than another."""
    return float(np.ptp([one.inset_mm for one in chosen.values()]))


def _log_chance_on_axes(
    chosen: Sequence[_Pointing], elsewhere: Sequence[float], usual_mm: float
) -> float:
    """log10 of how many sets as good chance gives at the middles of the sides.

    How many corners point as well by chance, those tell that lie elsewhere along the border.
    """
    width_mm = 2 * MARGIN_MM["sides"][1]
    middle = float(np.mean([one.inset_mm for one in chosen]))
    chance = np.log10(comb(len(SIDES), len(chosen)))
    for k, one in enumerate(chosen):
        as_good = 1 + sum(other <= max(one.pointing, 1.0) for other in elsewhere)
        beside = 2 * max(one.beside_mm, usual_mm) / (len(SIDES) * width_mm)
        chance += np.log10(as_good * beside)
        if k:
            # The first is free to lie as far out, and to look, as it does.
            unlike = min(_unlike(one.corner, other.corner) for other in chosen[:k])
            unlike = max(float(np.sqrt(unlike)), 1.0)
            chance += np.log10(min(2 * max(abs(one.inset_mm - middle), usual_mm) / width_mm, 1.0))
            chance += np.log10(min(2 * unlike * ALIKE_DEG / 180, 1.0))
    return float(chance)


def frame_windows(
    scan: ScanFile, camera: Camera, pixel_mm: float, area: FilmArea, group: Group
) -> list[SearchWindow]:
    """The four reduced windows in which opposite marks lie, clockwise."""
    inset, reach_mm = MARGIN_MM[group]
    half = np.array(camera.frame_mm) / 2 - inset
    directions = np.array(list(GROUPS[group].values()))
    expected = expected_places(directions * half, area, pixel_mm)
    reach, reduction = round(reach_mm / pixel_mm), max(1, round(SEARCH_PIXEL_MM / pixel_mm))
    windows: list[SearchWindow] = []
    for column, row in expected.tolist():
        corner = round(column) - reach, round(row) - reach
        gray = read_window(scan, *corner, 2 * reach, 2 * reach, reduction)
        outward = column - float(area.centre[0, 0]), row - float(area.centre[0, 1])
        windows.append(SearchWindow(corner, reduction, outward, fill_window(gray)))
    return windows


def _direction(outward: tuple[float, float], area: FilmArea) -> float:
    """An outward direction of the film in the scan, radians, column towards row."""
    right, down = eighth(outward, area.turn)
    return float(np.arctan2(down, right)) - area.turn


def _seen_in(window: SearchWindow, area: FilmArea, pixel_mm: float) -> list[_Seen]:
    """The corners of a window, likest first."""
    cell_mm, outward = pixel_mm * window.reduction, _direction(window.outward, area)
    found = [
        _Seen(window.place(centre.column, centre.row), edges, outward)
        for centre, edges, _ in corners_in(window.gray, FOUND_MM / cell_mm, cell_mm, KEPT)
    ]
    return [one for one in found if not _of_border(one, area, pixel_mm)]


def _of_border(one: _Seen, area: FilmArea, pixel_mm: float) -> bool:
    """True for the picture's own corners: both edges run as its border does."""
    apart = np.linalg.norm(area.corners - np.array(one.place), axis=1).min() * pixel_mm
    level = [(edge.angle + area.turn) % (np.pi / 2) for edge in one.edges]
    aslant = max(min(angle, np.pi / 2 - angle) for angle in level)
    return bool(apart < FRAME_CORNER_MM and aslant < np.radians(2 * ALIKE_DEG))


def _keep_shown(
    seen: list[list[_Seen]],
    windows: Sequence[SearchWindow],
    shown: ShownMark,
    pointed: Corner,
    *,
    own: bool,
    area: FilmArea,
) -> None:
    """Leave the corner that was shown alone in its window; in another scan those like it."""
    towards = np.array(shown.outward)
    at = int(np.argmax([np.dot(eighth(one.outward, area.turn), towards) for one in windows]))
    place, edges = pointed
    if own:
        seen[at] = [_Seen(place, edges, _direction(windows[at].outward, area))]
        return
    mark = _Seen(place, edges, float(np.arctan2(towards[1], towards[0])))
    seen[at] = [one for one in seen[at] if _unlike(one, mark) < MOST]


def _unlike(one: _Seen, other: _Seen) -> float:
    """Square of how differently edges of two corners run, in what is usual; 0 is alike."""
    here, usual = one.angles(mirrored=False), np.radians(ALIKE_DEG)
    there = [other.angles(mirrored=mirrored) for mirrored in (False, True)]
    return min(
        sum((angle_between(*pair) / usual) ** 2 for pair in zip(here, angles, strict=True)) / 2
        for angles in there
    )


def _pointing(one: _Seen) -> float:
    """Square of how far a corner is from pointing along its line, in what is usual."""
    rise, fall = one.angles(mirrored=False)
    usual = np.radians(POINTED_DEG)
    inward, outward = (
        min(angle_between(rise, along), angle_between(fall, along)) / usual for along in (np.pi, 0)
    )
    mirrored = angle_between(rise, -fall) / usual / 2
    return min(inward**2, outward**2 + OUTWARD, mirrored**2, MOST)


def _misfit(
    fitted: Rectangles,
    seen: Sequence[Sequence[_Seen]],
    area: FilmArea,
    pixel_mm: float,
) -> Float64[np.ndarray, "n"]:
    """How unusual marks of a camera would be that lie at the corners of each set."""
    chosen, there = fitted.chosen, fitted.seen
    misfit = np.where(there, (fitted.apart * pixel_mm / APART_MM) ** 2, MISSING).sum(axis=1)
    turn = (fitted.turn - area.turn) / np.radians(TURN_DEG)
    misfit += np.minimum(turn**2, 4 * MOST)
    beside = np.abs(fitted.middle - complex(area.centre[0, 0], -area.centre[0, 1])) * pixel_mm
    misfit += np.minimum((beside / MIDDLE_MM) ** 2, 4 * MOST)
    for first, second in combinations(range(4), 2):
        unlike = np.array([[_unlike(a, b) for b in seen[second]] for a in seen[first]])
        if not unlike.size:
            continue
        both = there[:, first] & there[:, second]
        values = unlike[
            np.maximum(chosen[:, first], 0) * both, np.maximum(chosen[:, second], 0) * both
        ]
        most = 4 * MOST if second == first + 2 else 2.0
        misfit += np.where(both, np.minimum(values, most), 0.0)
    for k in range(4):
        pointing = np.array([_pointing(one) for one in seen[k]] or [0.0])
        misfit += np.where(there[:, k], pointing[np.maximum(chosen[:, k], 0)], 0.0)
    return misfit


def _measured(
    scan: ScanFile,
    pixel_mm: float,
    seen: Sequence[Sequence[_Seen]],
    fitted: Rectangles,
) -> FiducialSet:
    """The corners of one set at full resolution, one that was not seen where the others put it."""
    turn, directions = float(fitted.turn[0]), np.array(list(SIDES.values()))
    put = directions * fitted.half[0] @ np.array([1, 1j]) * np.exp(1j * turn)
    places = [(at.real, -at.imag) for at in (fitted.middle[0] + put).tolist()]
    predicted = dict(zip(SIDES, places, strict=True))
    reduction = example_reduction(pixel_mm)
    cell_mm = pixel_mm * reduction
    results: dict[str, TwoWays | Failure] = {}
    others = [seen[k][i] for k, i in enumerate(fitted.chosen[0].tolist()) if i >= 0]
    for k, name in enumerate(SIDES):
        chosen = int(fitted.chosen[0][k])
        place = predicted[name] if chosen < 0 else seen[k][chosen].place
        outward = (float(directions[k][0]), -float(directions[k][1]))
        spot = open_spot(scan, name, place, outward, FARTHEST_MM, pixel_mm, reduction)
        results[name] = Failure("It lies outside the scan.")
        if spot is None:
            continue
        own = [seen[k][chosen].edges] if chosen >= 0 else []
        if not own:
            corner = edges_about(spot.gray, spot.start, FOUND_MM / cell_mm, cell_mm)
            angle = float(np.arctan2(outward[1], outward[0])) - turn
            own = [corner[1]] if corner is not None else _as_at(others, angle)
        results[name] = Failure("No two edges meet there.")
        tried = [measure_corner(spot, edges, FOUND_MM, pixel_mm) for edges in own]
        met = [one for one in tried if isinstance(one, TwoWays)]
        if met:
            results[name] = max(met, key=lambda one: one.correlation)
        elif tried and chosen >= 0:
            results[name] = tried[0]
    fit = FittedMark(Mark(EXAMPLE, FARTHEST_MM, 0.0), -turn, True, cell_mm)
    marks, doubts = judged_set(photo_id_of(scan.path), results, results, predicted, fit, SHOWN_PX)
    return FiducialSet(tuple(marks), tuple(doubts), fitted=(fit,))


def _as_at(others: Sequence[_Seen], outward: float) -> list[Edges]:
    """Edges of corners that were seen as they would run at another side, as they are or mirrored.

    A weak edge is seen where one knows how it runs.
    """
    return [
        turned_edges(one.edges, one.outward, outward, mirrored)
        for one in others
        for mirrored in (False, True)
    ]
