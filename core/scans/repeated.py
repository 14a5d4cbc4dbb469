"""Fiducials of unknown appearance: what repeats at the corners or sides of a camera's frame.

Four places lie opposite each other on the film. A camera's own figures repeat there, rotated or
mirrored; landscape does not. So small conspicuous figures at one place are searched for at the
other three, and the best matches are treated as marks, as if an operator had shown them. At the
sides corners of the frame itself go before what is not symmetric.
"""

from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import cv2
import numpy as np
from jaxtyping import Float32

from core.doubts import Doubt, Failure
from core.geometry.camera import Camera
from core.geometry.robust import TINY
from core.raster.scan_file import ScanFile, photo_id_of
from core.scans.candidates import FLAT, SearchWindow, Sought, Wanted
from core.scans.centring import (
    Centre,
    border_axis,
    centre_by_symmetry,
    correlation,
    disc,
    disc_in,
    sample_about,
    square_about,
    without_border,
)
from core.scans.constellation import AGREE_MM, FRAME_CORNER_MM, LIBRARY
from core.scans.copies import mark_shown_at, measure_like
from core.scans.corner_sets import FOUND_MM, LEAST_MARKS, frame_windows, measure_corners
from core.scans.corners import FINE_MM
from core.scans.example import SYMMETRIC_FROM, ShownMark
from core.scans.fiducials import GUESSED, measure_unknown_fiducials
from core.scans.film_area import FilmArea
from core.scans.judging import (
    LIMIT_PX,
    REPEATED,
    SURELY_MARK,
    FiducialMeasurement,
    FiducialSet,
    doubt_of_repeated,
)
from core.scans.marks import EXAMPLE, Mark
from core.scans.naming import GROUPS, Group

Field = Float32[np.ndarray, "rows columns"]
FIGURE_MM, AROUND_MM = 0.8, 1.8  # design: the middle size of marks, and of what they stand out of
"""Radius of a figure, and of the surroundings that it stands out of."""
FIGURES = 12  # design: writing and dirt stand out too; of four places one shows the mark well
"""Figures tried of each window."""
TRIED = 4  # design: one for each place; on ten real frames a mark was among the first four of eight
"""Figures that are offered, best first."""
APART_MM = 0.6  # design: less than the figure's radius
"""Least distance of two figures of a window."""
MOST_ALIKE, BALANCE = 0.999, 1.0  # design: Fisher's transform, kept finite: marks 2, texture 1.2
"""Likeness to other places from which more counts nothing, and what likeness of a figure's
surroundings to themselves, 0 to 1, counts beside it."""
LEAST_LONE = 0.25  # design: half way between a line (0) and the middle of a cross (0.5 and more)
"""How much more a point of symmetry is one than the points about it."""
LOOKED_AT = 4  # design: the same mark at four places, as a figure and as a point of symmetry
"""Figures a place that are compared with their surroundings, for one that is offered."""
CROSSING_STEPS = 12  # design: steps of at most a cell; a figure's radius is eight to eleven
"""How often the point at which a figure's edges meet is taken anew."""
GRAIN = 0.5  # design: slopes of grain on even film, gray values squared
"""Slopes that are always reckoned with around a figure."""
LEAST_ALIKE = 0.6  # design: landscape is as much alike by chance at one place, not at two
"""Mean likeness at the two places that are most alike."""


@dataclass(frozen=True, slots=True)
class _Figure:
    """Something that stands out of its surroundings."""

    window: int
    column: int
    row: int


def with_repeated(
    scan: ScanFile,
    camera: Camera,
    pixel_mm: float,
    area: FilmArea,
    known: FiducialSet,
    kinds: tuple[Mark, ...] = LIBRARY,
) -> FiducialSet:
    """The marks of a scan, and those of corners or sides where none of a known kind was found.

    Args:
        scan: The scan.
        camera: Camera with the size of its frame.
        pixel_mm: Nominal size of a scan pixel, millimetres.
        area: The exposed picture.
        known: Marks of known kinds, named by where they lie in the scan.
        kinds: Those kinds, which are looked for once more where they may be dim.
    """
    doubted = {str(doubt.evidence.get("fiducial")) for doubt in known.doubts}
    for group, places in GROUPS.items():
        enough = camera.fiducial_marks == len(places) and len(known.marks) >= LEAST_MARKS
        own = [mark for mark in known.marks if mark.name in places]
        # A drawn notch is a corner whose edges were guessed, a dot is anything: corners that were
        # seen go before those in doubt.
        drawn = [mark.kind in GUESSED and mark.name in doubted for mark in own]
        guessed = bool(drawn) and all(drawn)
        if (enough or len(own) >= LEAST_MARKS) and not guessed:
            continue
        others = _without(known, places)
        firm = firm_marks(others)
        seen = len(own) >= LEAST_MARKS
        offered = _offered(scan, camera, pixel_mm, area, group, firm, corners_only=seen)
        dim = () if seen else _dim(scan, camera, pixel_mm, area, group, kinds)
        for copies in chain(offered, dim):
            if _about_one_middle(replace(others, marks=firm), copies, pixel_mm):
                unsure = _doubts_of(photo_id_of(scan.path), copies)
                marks, doubts = (*others.marks, *copies.marks), (*others.doubts, *unsure)
                known = replace(known, marks=marks, doubts=doubts)
                break
    return known


def _offered(
    scan: ScanFile,
    camera: Camera,
    pixel_mm: float,
    area: FilmArea,
    group: Group,
    known: Sequence[FiducialMeasurement],
    *,
    corners_only: bool,
) -> Iterator[FiducialSet]:
    """What may be the marks of corners or sides, likeliest first.

    At the sides figures beyond doubt go before corners of the frame, and these before others:
    the edges of figures meet in corners too. One or two corners go last, and those of coarse
    scans, whose edges are short.
    """
    others: list[FiducialSet] = []
    places = len(GROUPS[group])
    for shown in () if corners_only else repeated_marks(scan, camera, pixel_mm, area, group):
        copies = measure_like(scan, camera, pixel_mm, area, shown)
        # Nobody said that it is a mark: cut off by the scan it does not tell.
        rim_px = FIGURE_MM / 2 / pixel_mm
        inside = tuple(one for one in copies.marks if _lies_in(scan, one.place, rim_px))
        copies = replace(copies, marks=inside)
        if not _whole(copies, places):
            continue
        if group == "corners" or (_surely(copies) and len(copies.marks) == places):
            yield copies
        else:
            others.append(copies)
    if pixel_mm > FINE_MM:
        yield from others
        others = []
    if group == "sides":
        corners = measure_corners(scan, camera, pixel_mm, area, known=known)
        few = isinstance(corners, Failure) or len(corners.marks) < LEAST_MARKS
        if isinstance(corners, FiducialSet) and corners.marks and not (few and corners_only):
            wider = [one for one in others if _holds(one, corners, pixel_mm)]
            others = [*wider, *others, corners] if few else [*wider, corners, *others]
    yield from others


def _dim(
    scan: ScanFile,
    camera: Camera,
    pixel_mm: float,
    area: FilmArea,
    group: Group,
    kinds: tuple[Mark, ...],
) -> Iterator[FiducialSet]:
    """Marks of known kinds with hardly any contrast, where there are three."""
    figures = tuple(kind for kind in kinds if kind.symmetric and kind.shape not in GUESSED)
    found = measure_unknown_fiducials(scan, camera, pixel_mm, area, figures, group)
    if len(found.marks) >= LEAST_MARKS:
        yield found


def _holds(copies: FiducialSet, corners: FiducialSet, pixel_mm: float) -> bool:
    """True for copies that have all corners at their places, and marks where no edges are seen."""
    at = {mark.name: mark.place for mark in copies.marks}
    apart = [
        np.hypot(*np.subtract(at.get(mark.name, (np.inf, np.inf)), mark.place)) * pixel_mm
        for mark in corners.marks
    ]
    return len(at) > len(apart) and max(apart) < FOUND_MM


def firm_marks(known: FiducialSet) -> tuple[FiducialMeasurement, ...]:
    """Marks that tell where others lie: not those of which it is doubted that they are marks."""
    kinds = {mark.name: mark.kind for mark in known.marks}
    names = {str(doubt.evidence.get("fiducial")): doubt for doubt in known.doubts}
    guessed = {
        name
        for name, doubt in names.items()
        if REPEATED in doubt.evidence or kinds.get(name) in (*GUESSED, EXAMPLE)
    }
    return tuple(mark for mark in known.marks if mark.name not in guessed)


def _without(known: FiducialSet, places: Container[str]) -> FiducialSet:
    """The marks, and doubts about them, of the other group."""
    marks = tuple(mark for mark in known.marks if mark.name not in places)
    doubts = known.doubts if marks else ()
    kept = tuple(doubt for doubt in doubts if str(doubt.evidence.get("fiducial")) not in places)
    return replace(known, marks=marks, doubts=kept)


def _whole(copies: FiducialSet, places: int) -> bool:
    """True for all marks of a group, most of them well measured, or for three beyond doubt.

    Nobody knows their pattern: three of landscape fit some of all that are tried.
    """
    return len(_sure(copies)) >= LEAST_MARKS and (len(copies.marks) == places or _surely(copies))


def _sure(copies: FiducialSet) -> list[FiducialMeasurement]:
    """Those that are well measured."""
    return [one for one in copies.marks if max(one.sigma_px, one.disagreement_px) < LIMIT_PX]


def _surely(copies: FiducialSet) -> bool:
    """True for symmetric marks that texture is never like."""
    symmetric = all(fit.mark.symmetric for fit in copies.fitted)
    sure = _sure(copies)
    alike = min((one.correlation for one in sure), default=0.0) > SURELY_MARK
    return symmetric and len(sure) >= LEAST_MARKS and alike


def _doubts_of(photo_id: str, copies: FiducialSet) -> tuple[Doubt, ...]:
    """A doubt about every mark that only repeats: of its precision, else of which point it is."""
    told = {doubt.evidence["fiducial"]: doubt for doubt in copies.doubts}
    return tuple(told.get(mark.name) or doubt_of_repeated(photo_id, mark) for mark in copies.marks)


def _about_one_middle(known: FiducialSet, copies: FiducialSet, pixel_mm: float) -> bool:
    """True when marks of corners and of sides lie about the same place."""
    if min(len(known.marks), len(copies.marks)) < LEAST_MARKS:
        return True
    apart = np.subtract(known.middle, copies.middle)
    return float(np.hypot(*apart)) * pixel_mm < AGREE_MM


def repeated_marks(
    scan: ScanFile, camera: Camera, pixel_mm: float, area: FilmArea, group: Group
) -> Iterator[ShownMark]:
    """What may be a mark of a camera whose marks nobody knows, likeliest first.

    Args:
        scan: The scan.
        camera: The camera, with the size of its frame.
        pixel_mm: Nominal size of a scan pixel, millimetres.
        area: The exposed picture.
        group: Whether marks are sought in the corners or at the sides.
    """
    windows = frame_windows(scan, camera, pixel_mm, area, group)
    cell_mm = pixel_mm * windows[0].reduction
    half = int(np.ceil(FIGURE_MM / cell_mm)) + 1
    fields = [without_border(one.gray, 2 * half + 1, border_axis(one.outward)) for one in windows]
    figures = [
        figure
        for k, window in enumerate(windows)
        for figure in (*_standing_out(fields[k], k, half, cell_mm), *_symmetric(window, k, half))
        if _lies_in(scan, window.at(figure.column, figure.row), FIGURE_MM / pixel_mm)
    ]
    sought = [Sought(field) for field in fields]
    alike = {one: _repeated(one, windows, sought, half) for one in figures}
    best = sorted((f for f in figures if alike[f] > LEAST_ALIKE), key=lambda f: -alike[f])
    best = best[: LOOKED_AT * TRIED]
    middle = {one: _middle(one, windows[one.window].gray, cell_mm) for one in best}
    worth = {
        one: np.arctanh(min(alike[one], MOST_ALIKE))
        + BALANCE * _balance(windows[one.window], middle[one], cell_mm)
        for one in best
    }
    offered: list[tuple[float, float]] = []
    for one in sorted(best, key=lambda one: -worth[one]):
        place = windows[one.window].place(*middle[one])
        near = [float(np.hypot(*np.subtract(place, other))) * pixel_mm for other in offered]
        if min(near, default=APART_MM) < APART_MM / 2:
            continue
        if _lies_in(scan, place, FIGURE_MM / pixel_mm) and not _of_border(area, place, pixel_mm):
            offered.append(place)
            yield mark_shown_at(scan, area, place, pixel_mm)
        if len(offered) == TRIED:
            break


def _of_border(area: FilmArea, place: tuple[float, float], pixel_mm: float) -> bool:
    """True at the corners of the picture itself."""
    apart = np.linalg.norm(area.corners - np.array(place), axis=1).min()
    return float(apart) * pixel_mm < FRAME_CORNER_MM


def _middle(figure: _Figure, gray: Field, cell_mm: float) -> tuple[float, float]:
    """The point of a figure that is its mark: of its symmetry, else where its edges meet."""
    start, reach = (figure.column + 0.5, figure.row + 0.5), FIGURE_MM / cell_mm
    about = centre_by_symmetry(gray, start, reach, disc(reach))
    if isinstance(about, Centre) and about.correlation > SYMMETRIC_FROM:
        return about.column, about.row
    return _crossing(gray, start, cell_mm)


def _balance(window: SearchWindow, middle: tuple[float, float], cell_mm: float) -> float:
    """How much what is about a figure is like itself turned by half, or in a mirror.

    The mirror stands along its outward direction: of a row of teeth that all repeat, the middle of
    the whole is the mark.
    """
    side = 2 * int(AROUND_MM / cell_mm) + 1
    patch = square_about(window.gray, np.array(middle), side)
    patch = without_border(patch, side, border_axis(window.outward))
    mirrored = _turned(patch, 0, window.outward)[1]
    weights = disc_in(patch.astype(np.float64))
    return max(correlation(patch, other, weights) for other in (patch[::-1, ::-1], mirrored))


def _symmetric(window: SearchWindow, number: int, half: int) -> list[_Figure]:
    """Points about which a window is like itself after half a turn, and not about others beside.

    Rings and crosses are so about their middle, a straight edge or line about many points.
    """
    gray = cv2.resize(window.gray, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    reach = (half + 1) // 2
    away = np.hypot(*(np.indices((2 * reach + 1, 2 * reach + 1)) - reach))
    padded = np.pad(gray, reach, mode="reflect")
    rows, columns = gray.shape
    products, mean, square = (np.zeros_like(gray) for _ in range(3))
    for down, right in np.argwhere(away <= reach).tolist():
        here = padded[down : down + rows, right : right + columns]
        back = 2 * reach - down, 2 * reach - right
        there = padded[back[0] : back[0] + rows, back[1] : back[1] + columns]
        products += here * there
        mean += here
        square += here * here
    count = np.count_nonzero(away <= reach)
    mean /= count
    alike = (products / count - mean**2) / (square / count - mean**2 + np.float32(FLAT**2))
    beside = ((away <= reach) & (away > reach / 2)).astype(np.uint8)
    lone = alike - cv2.dilate(alike, beside)
    highest = alike == cv2.dilate(alike, (away <= reach).astype(np.uint8))
    highest &= lone > LEAST_LONE
    highest[:reach] = highest[-reach:] = False
    highest[:, :reach] = highest[:, -reach:] = False
    down, right = np.nonzero(highest)
    order = np.argsort(-lone[down, right], kind="stable")[:FIGURES]
    return [_Figure(number, 2 * int(right[k]) + 1, 2 * int(down[k]) + 1) for k in order]


def _crossing(gray: Field, start: tuple[float, float], cell_mm: float) -> tuple[float, float]:
    """Where the edges of a figure, drawn out, meet: the tip of a notch, the middle of a cross.

    The point nearest to the lines of all slopes about it by least squares (Förstner & Gülch 1987),
    taken anew about itself; the start where that leads away.

    Args:
        gray: The reduced window.
        start: Column and row in it of the figure's middle, cells.
        cell_mm: Size of a cell, millimetres.
    """
    reach = round(FIGURE_MM / cell_mm)
    column, row = np.meshgrid(*2 * (np.arange(-reach, reach + 1, dtype=np.float64),))
    weights = np.exp(-2 * (column**2 + row**2) / reach**2)
    place = np.array(start)
    for _ in range(CROSSING_STEPS):
        patch = sample_about(gray, place, 2 * reach + 1)
        right, down = np.gradient(patch, axis=1), np.gradient(patch, axis=0)
        xx, yy, xy = (float(np.sum(weights * v)) for v in (right**2, down**2, right * down))
        along = right * column + down * row
        aim = [float(np.sum(weights * right * along)), float(np.sum(weights * down * along))]
        step = np.linalg.lstsq(np.array([[xx, xy], [xy, yy]]), np.array(aim), rcond=None)[0]
        place = place + np.clip(step, -1.0, 1.0)
        if np.hypot(*(place - np.array(start))) * cell_mm > FIGURE_MM:
            return start
    return float(place[0]), float(place[1])


def _lies_in(scan: ScanFile, place: tuple[float, float], rim_px: float) -> bool:
    """True for a place that is further than a rim from the scan's edges."""
    return all(rim_px < at < size - rim_px for at, size in zip(place, scan.size_px, strict=True))


def _standing_out(field: Field, window: int, half: int, cell_mm: float) -> list[_Figure]:
    """Figures with slopes in all directions, and few about them."""
    right, down = np.gradient(field, axis=1), np.gradient(field, axis=0)
    inner, outer = (2 * int(size / cell_mm) + 1 for size in (FIGURE_MM, AROUND_MM))

    def mean(values: np.ndarray, side: int) -> np.ndarray:
        return cv2.blur(values.astype(np.float32), (side, side))

    across, along, both = (mean(v, inner) for v in (right**2, down**2, right * down))
    least = (across + along) / 2 - np.hypot((across - along) / 2, both)
    out = least / (mean(right**2 + down**2, outer) + GRAIN + TINY)
    rim = half + 1
    out[:rim] = out[-rim:] = 0
    out[:, :rim] = out[:, -rim:] = 0
    side = 2 * int(APART_MM / cell_mm) + 1
    highest = cv2.dilate(out, np.ones((side, side), np.uint8))
    rows, columns = np.nonzero((out == highest) & (out > 0))
    order = np.argsort(-out[rows, columns], kind="stable")[:FIGURES]
    return [
        _Figure(window, column, row)
        for column, row in zip(columns[order].tolist(), rows[order].tolist(), strict=True)
    ]


def _repeated(
    figure: _Figure, windows: Sequence[SearchWindow], fields: Sequence[Sought], half: int
) -> float:
    """How alike the two most alike of the opposite places are, on average."""
    row, column = figure.row, figure.column
    own = fields[figure.window].gray[row - half : row + half + 1, column - half : column + half + 1]
    values = sorted(
        max(
            float(fields[k].correlated(Wanted(one)).max())
            for one in _turned(own, (k - figure.window) % 4, windows[k].outward)
        )
        for k in range(len(windows))
        if k != figure.window
    )
    return sum(values[-2:]) / 2


def _turned(figure: Field, quarters: int, outward: tuple[float, float]) -> tuple[Field, ...]:
    """A figure turned clockwise by quarters, mirrored along its outward direction, and as it is."""
    turned = np.rot90(figure, -quarters)
    along = border_axis(outward)
    if along is not None:
        mirrored = turned[:, ::-1] if along == 1 else turned[::-1]
    else:
        mirrored = turned.T if outward[0] * outward[1] > 0 else turned[::-1, ::-1].T
    return np.ascontiguousarray(turned), np.ascontiguousarray(mirrored), figure
