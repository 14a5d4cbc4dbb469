"""Copies of a mark that an operator showed, found and measured in its own scan and in others."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np

from core.doubts import Failure
from core.geometry.camera import Camera
from core.raster.scan_file import ScanFile, photo_id_of
from core.scans.candidates import eighth
from core.scans.centring import blur_as_scanned, disc_in
from core.scans.constellation import Constellation, find_constellation
from core.scans.corner_sets import FOUND_MM, measure_corners
from core.scans.example import (
    Corner,
    ShownMark,
    example_reduction,
    layout_like,
    marks_like,
    mean_picture,
    shown_edges,
)
from core.scans.fiducials import both_ways, found_after_all, quarters_of
from core.scans.film_area import FilmArea
from core.scans.judging import (
    LIMIT_PX,
    SHOWN_PX,
    FiducialMeasurement,
    FiducialSet,
    doubt_of_repeated,
    judged_set,
    nothing_found,
)
from core.scans.marks import draw_mark
from core.scans.measuring import FittedMark, Spot, TwoWays, fit_mark, open_spots
from core.scans.naming import SIDES, Layout, OpenLayout

LEAST_COPIES = 3  # design: the median of two is still half the picture beside each
"""Copies of an example from which their mean is taken."""
LEAST_SEEN = 0.5  # design: a place from half as many slopes is unsure by the root of two
"""Share of the slopes of an example, in their weakest direction, that must lie in the scan."""
LEARNT_ROUNDS = 2  # design: the second begins where the picture beside the mark no longer draws
"""How often the mean of the copies is taken anew."""


def mark_shown_at(
    scan: ScanFile, area: FilmArea, place: tuple[float, float], pixel_mm: float
) -> ShownMark:
    """The mark at a place of a scan, with how it lies there.

    Args:
        scan: The scan.
        area: The exposed picture.
        place: Column and row of the mark's middle.
        pixel_mm: Nominal size of a scan pixel, millimetres.
    """
    right, down = (np.array(place) - area.centre[0]).tolist()
    cosine, sine = float(np.cos(area.turn)), float(np.sin(area.turn))
    film = (right * cosine - down * sine) * pixel_mm, -(right * sine + down * cosine) * pixel_mm
    return ShownMark(scan, place, eighth((right, down), area.turn), pixel_mm, film)


def measure_like(
    scan: ScanFile, camera: Camera, pixel_mm: float, area: FilmArea, shown: ShownMark
) -> FiducialSet:
    """Find and measure the copies of a shown mark in one scan.

    They are named as the certificate has them, and where there is none by where they lie in the
    scan: UL, UR, LR, LL and T, R, B, L.

    Args:
        scan: The scan.
        camera: Camera with its certified fiducials, or the size of its frame alone.
        pixel_mm: Nominal size of a scan pixel, millimetres.
        area: The exposed picture.
        shown: The mark; it may be of another scan of the camera.
    """
    photo_id = photo_id_of(scan.path)
    layout = layout_like(camera, shown, area, quarters_of(camera, area))
    corner = cache(partial(shown_edges, shown))
    best = _alike(scan, layout, pixel_mm, area, shown, corner)
    if isinstance(layout, Layout) or layout.names != tuple(SIDES) or _sure(best, layout):
        return best
    pointed = corner()
    if pointed is None:
        return best
    corners = measure_corners(scan, camera, pixel_mm, area, (shown, pointed))
    if isinstance(corners, Failure) or len(corners.marks) < len(best.marks):
        return best
    known = [mark for mark in corners.marks if not _near(mark, best.marks, pixel_mm)]
    told = {str(doubt.evidence["fiducial"]) for doubt in corners.doubts}
    unlike = (doubt_of_repeated(photo_id, mark) for mark in known if mark.name not in told)
    return replace(corners, doubts=(*corners.doubts, *unlike))


def _sure(found: FiducialSet, layout: OpenLayout) -> bool:
    """True for all marks of a layout, each by two ways that agree."""
    apart = [max(mark.sigma_px, mark.disagreement_px) for mark in found.marks]
    return len(apart) == len(layout.names) and max(apart) < LIMIT_PX


def _near(
    mark: FiducialMeasurement, others: Sequence[FiducialMeasurement], pixel_mm: float
) -> bool:
    """True for a corner that is also like the example."""
    apart = [np.hypot(*np.subtract(mark.place, other.place)) * pixel_mm for other in others]
    return bool(min(apart, default=np.inf) < FOUND_MM)


def _alike(
    scan: ScanFile,
    layout: Layout | OpenLayout,
    pixel_mm: float,
    area: FilmArea,
    shown: ShownMark,
    corner: Callable[[], Corner | None],
) -> FiducialSet:
    """The marks of a layout that look like the example."""
    sure = shown.place if shown.scan.path == scan.path else None
    sizes = marks_like(shown, corner)
    found = find_constellation(scan, layout, pixel_mm, area, marks=sizes, sure=sure)
    if isinstance(found, Failure):
        count = len(layout.names) if isinstance(layout, Layout) else 0
        return FiducialSet((), (nothing_found(photo_id_of(scan.path), count),))
    best = _measured(scan, found, pixel_mm)
    # What is most like the example from afar may reach into the picture, which differs: another
    # size goes before it where all of its copies stand.
    whole = len(found.layout.names)
    for size in sizes:
        if len(best.marks) == whole:
            break
        if size is not found.mark:
            other = _measured(scan, replace(found, mark=size), pixel_mm)
            best = other if len(other.marks) == whole else best
    return best


def _measured(scan: ScanFile, found: Constellation, pixel_mm: float) -> FiducialSet:
    """The copies of an example in one of its sizes, and which of them stand."""
    reduction = example_reduction(pixel_mm)
    spots = open_spots(scan, found, pixel_mm, reduction)
    fit = fit_mark(list(spots.values()), found, pixel_mm)
    results = both_ways(spots, found, fit, pixel_mm)
    for _ in range(LEARNT_ROUNDS):
        learnt = _learnt(fit, spots, results, pixel_mm)
        if learnt is fit:
            break
        fit = learnt
        results = both_ways(spots, found, fit, pixel_mm)
    results = found_after_all(results, spots, found, (fit,), pixel_mm)
    results = {
        name: _inside(scan, one, spots[name].outward, fit, pixel_mm) if name in spots else one
        for name, one in results.items()
    }
    photo_id = photo_id_of(scan.path)
    marks, doubts = judged_set(photo_id, results, results, found.predicted, fit, SHOWN_PX)
    return FiducialSet(tuple(marks), tuple(doubts), found.way, (), (fit,))


def _learnt(
    fit: FittedMark,
    spots: Mapping[str, Spot],
    results: Mapping[str, TwoWays | Failure],
    pixel_mm: float,
) -> FittedMark:
    """An example as its copies show it together, also those that are not measured well yet."""
    copies = [
        (
            spots[name].gray,
            spots[name].within(one.column, one.row),
            replace(fit.mark, outward=spots[name].outward, lies=one.lies),
        )
        for name, one in results.items()
        if isinstance(one, TwoWays) and spots[name].found
    ]
    if len(copies) < LEAST_COPIES:
        return fit
    cell_mm = pixel_mm * example_reduction(pixel_mm)
    return replace(fit, mark=mean_picture(fit.mark, copies, fit.turn, cell_mm))


def _inside(
    scan: ScanFile,
    one: TwoWays | Failure,
    outward: tuple[float, float],
    fit: FittedMark,
    pixel_mm: float,
) -> TwoWays | Failure:
    """A mark; a failure where less than half of what fixes its place lies in the scan.

    The tip of a notch lies at the edge of the scan, its sides within.
    """
    if isinstance(one, Failure):
        return one
    mark = replace(fit.mark, outward=outward, lies=one.lies)
    drawn = blur_as_scanned(draw_mark(mark, pixel_mm, fit.turn))
    half = drawn.shape[0] // 2
    columns, rows = (np.arange(-half, half + 1) + at for at in (one.column, one.row))
    seen = np.outer(
        *(
            (at > 0) & (at < size)
            for at, size in zip((rows, columns), scan.size_px[::-1], strict=True)
        )
    )
    slopes = np.stack([np.gradient(drawn, axis=axis) for axis in (1, 0)]) * disc_in(drawn)
    whole, left = (np.einsum("arc,brc->ab", some, some) for some in (slopes, slopes * seen))
    if np.linalg.eigvalsh(left)[0] > LEAST_SEEN * np.linalg.eigvalsh(whole)[0]:
        return one
    return Failure("It lies at the edge of the scan.")
