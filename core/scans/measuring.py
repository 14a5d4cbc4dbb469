"""Measure the marks of one set at full resolution: kind, and every middle in two ways."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
from jaxtyping import Float32

from core.doubts import Failure
from core.geometry.robust import TINY
from core.geometry.transforms import apply_affine
from core.raster.scan_file import ScanFile, read_window
from core.scans.candidates import eighth
from core.scans.centring import (
    Centre,
    Gray,
    Weights,
    blur_as_scanned,
    border_axis,
    centre_by_likeness,
    centre_by_symmetry,
    correlation,
    disc,
    disc_in,
    match_mark,
    sample_about,
    square_about,
    without_border,
)
from core.scans.constellation import SEARCH_PIXEL_MM, SHORTEST_REACH, Constellation
from core.scans.corners import Edges, centre_by_corner, likeness_of
from core.scans.marks import SURROUND, Lie, Mark, draw_mark, resize_mark
from core.scans.naming import within_eighth
from core.scans.outlines import centre_by_edges, centre_by_sides

FITTING_MM = 0.03  # design: the thinnest lines are three pixels wide
"""Pixel to which finer scans are reduced while the kind and size of the mark are fitted."""
NOTCH_MM = 0.04  # design: its edges are a blur wide; finer pixels cost their number squared
"""Pixel to which finer scans are reduced where the sides of a notch are fitted."""
RING_MM = 1.4  # design: the largest ring of the library, and a little
"""Greatest ring about a dot that is looked for."""
RINGS = (2.5, 1.12, RING_MM)  # design: a ring is apart from its dot; steps less than its line
"""Rings that are tried about a dot: the least over its radius, step, and the greatest (mm)."""
RING_GAIN = 0.15  # design: texture about a dot adds some hundredths
"""Likeness that a ring must add."""
WINDOW_REACH, WINDOW_MM, WINDOW_PX = 1.8, 0.6, 8  # design: drawn surroundings, error of the start
"""Half width of a window in the mark's reach, and what is added in millimetres and pixels."""
BLURS_PX = (0.0, 0.5, 0.8, 1.2, 1.8)  # design: from sharp to as wide as a thin line
"""Blurs that are tried, pixels of the fitting."""
SIZE_STEPS = (0.2, 0.1, 0.05)  # design: from the step of the library to what moves no middle
FINE_STEPS = (0.025, 0.0125)  # design: the ends of one-sided arms draw the middle with their size
"""Steps of radius and stroke, as shares; the fine ones for marks that are not symmetric."""
GAIN, FINE_GAIN = 1e-4, 2e-5  # design: less likeness is noise
"""Likeness that a coarse and a fine step must add."""
OFF_MM, NEAR_MM = 0.4, 0.3  # design: four cells of the search, and a little
"""How far a mark may be from where its search, and its first measurement, put it."""
NOTCH_SIGMA_PX = 0.024  # measured: prove_fiducials, chi-square of notches 1.0 in docs/measurements
"""What the picture beside a notch does to its edges at least, pixels."""
STEPS_APART_PX = 0.2  # design: as far as slopes of gray in the picture draw the steps aside
"""How far a notch by its steps of gray may lie from the notch by its sides, pixels."""
OUTLINE_SIGMAS, OUTLINE_PX, OUTLINE_MM = 4.0, 0.1, 0.1  # design: 1 in 10,000; goal of the centring
"""How far the outline may lie from the mark's middle before dirt is suspected, and is sought."""
WORST_PX = 9.0  # design: worse than any limit, and small enough to be squared
"""Largest standard deviation of a second way that is reckoned with."""


@dataclass(frozen=True, slots=True)
class TwoWays:
    """One mark's middle from both ways."""

    column: float
    """Scan pixels."""
    row: float
    """Scan pixels."""
    sigma_px: float
    """Standard deviation per axis, pixels."""
    correlation: float
    """Likeness to the drawn mark."""
    disagreement_px: float
    """Distance between both ways."""
    outline_px: float = 0.0
    """How far its outline, a third way, lay from both, where that was taken; pixels."""
    worst_px: float = 0.0
    """Standard deviation in the direction in which it is least sure, where that is known."""
    lies: Lie = "turned"
    """How an example lies there."""
    reduction: int = 1
    """Scan pixels a side of the pixels in which it was measured; limits are of those."""


@dataclass(frozen=True, slots=True, eq=False)
class Spot:
    """A window about one mark."""

    name: str
    """The fiducial's name."""
    corner: tuple[int, int]
    """First column and row in the scan."""
    gray: Float32[np.ndarray, "rows columns"]
    """Gray values."""
    start: tuple[float, float]
    """Approximate middle, window pixels."""
    outward: tuple[float, float]
    """Direction from the middle of the marks, in the film's axes (right, down)."""
    found: bool
    """False where the place only follows from the other marks."""
    reduction: int = 1
    """Scan pixels a side that became one pixel of the window."""

    def within(self, column: float, row: float) -> tuple[float, float]:
        """A place of the scan in the window."""
        return (column - self.corner[0]) / self.reduction, (row - self.corner[1]) / self.reduction

    def placed(self, found: TwoWays) -> TwoWays:
        """What was measured in the window, in the scan."""
        by = self.reduction
        return replace(
            found,
            column=self.corner[0] + by * found.column,
            row=self.corner[1] + by * found.row,
            sigma_px=by * found.sigma_px,
            disagreement_px=by * found.disagreement_px,
            outline_px=by * found.outline_px,
            worst_px=by * found.worst_px,
            reduction=by,
        )


def open_spots(
    scan: ScanFile, found: Constellation, pixel_mm: float, reduction: int = 1
) -> Mapping[str, Spot]:
    """Windows about all marks; those not found yet where the others put them."""
    places = _all_places(found)
    middle = np.mean(list(places.values()), axis=0)
    spots: dict[str, Spot] = {}
    for name, (column, row) in places.items():
        outward = eighth((column - middle[0], row - middle[1]), within_eighth(found.turn))
        reach_mm = found.mark.reach_mm
        spot = open_spot(scan, name, (column, row), outward, reach_mm, pixel_mm, reduction)
        if spot is not None:
            spots[name] = replace(spot, found=name in found.names)
    return spots


def open_spot(
    scan: ScanFile,
    name: str,
    place: tuple[float, float],
    outward: tuple[float, float],
    reach_mm: float,
    pixel_mm: float,
    reduction: int = 1,
) -> Spot | None:
    """The window about one place; None outside the scan.

    Args:
        scan: The scan.
        name: The fiducial's name.
        place: Where it should be, scan pixels.
        outward: Direction from the middle of the marks, in the film's axes (right, down).
        reach_mm: How far the mark extends from its middle.
        pixel_mm: Size of a scan pixel, millimetres.
        reduction: Scan pixels a side that become one.
    """
    column, row = place
    if not (0 < column < scan.size_px[0] and 0 < row < scan.size_px[1]):
        return None
    # Room for a ring about what was found as a dot, and for a start that is a little off.
    cell_mm = pixel_mm * reduction
    half = int(np.ceil((max(reach_mm, RING_MM) * WINDOW_REACH + WINDOW_MM) / cell_mm)) + WINDOW_PX
    corner = (round(column) - half * reduction, round(row) - half * reduction)
    side = 2 * half * reduction
    gray = read_window(scan, *corner, side, side, reduction, outside="edge")
    if not np.isfinite(gray[half - 3 : half + 3, half - 3 : half + 3]).all():
        return None
    spot = Spot(name, corner, gray, (0.0, 0.0), outward, False, reduction)
    return replace(spot, start=spot.within(column, row))


def _all_places(found: Constellation) -> Mapping[str, tuple[float, float]]:
    """Where each mark was found, or where a similarity through the found ones puts it."""
    places = dict(found.predicted)
    if found.fit is not None:
        put = apply_affine(found.fit.matrix, found.layout.lying(found.way)).tolist()
        for name, (column, row) in zip(found.layout.names, put, strict=True):
            places[name] = (column, row)
    for name, (column, row) in zip(found.names, found.pixels.tolist(), strict=True):
        places[name] = (column, row)
    return places


@dataclass(frozen=True, slots=True)
class FittedMark:
    """The mark as it looks in this scan."""

    mark: Mark
    """Kind, measures and blur."""
    turn: float
    """Small rotation of the film in the scan, radians, clockwise."""
    bright: bool
    """True when it is brighter than its surroundings."""
    pixel_mm: float
    """Size of the pixels its blur is given for."""

    def drawn(
        self,
        outward: tuple[float, float],
        pixel_mm: float,
        reach_mm: float = 0.0,
        beside: tuple[float, float] = (0.0, 0.0),
    ) -> Weights:
        """Template for one place, at a pixel size, as large as for a mark of at least a reach."""
        blur = self.mark.blur_px * self.pixel_mm / pixel_mm
        mark = replace(self.mark, outward=outward, blur_px=blur)
        surround = SURROUND * max(reach_mm / mark.reach_mm, 1.0)
        return draw_mark(mark, pixel_mm, self.turn, surround, beside)


def fit_mark(spots: Sequence[Spot], found: Constellation, pixel_mm: float) -> FittedMark:
    """The mark's kind and measures: what makes the drawn mark most like the scan's, on average.

    Of the kinds that were found at the same places the one that explains most, then coordinate
    descent over radius, stroke and blur.
    """
    reduction = max(1, round(FITTING_MM / pixel_mm))
    cell = pixel_mm * reduction
    turn = -within_eighth(found.turn)
    trials = [FittedMark(kind, turn, found.bright, cell) for kind in (found.mark, *found.kinds)]
    if found.mark.picture is not None:
        return trials[0]
    small = [_reduced(spot, reduction) for spot in spots]
    best = _kind(small, trials, cell)
    if best.mark.notch:
        return best
    best, small = _sized(small, best, cell)
    ringed = _ringed(small, best, cell) if best.mark.shape == "dot" else None
    return best if ringed is None else _sized(small, ringed, cell)[0]


def _sized(
    spots: Sequence[Spot], fitted: FittedMark, cell_mm: float
) -> tuple[FittedMark, list[Spot]]:
    """Radius, stroke and blur that make it most like the scan's, and the spots started there."""
    best, blur = fitted, 0.0
    likeness, small = _likeness(spots, best, cell_mm)
    # Size and blur move the middle of one-sided marks only: the others are matched once a step.
    compare = partial(_likeness, matched=not best.mark.symmetric)
    finer = () if best.mark.symmetric else FINE_STEPS
    for step in (*SIZE_STEPS, *finer):
        for _ in range(3):
            factors = ((1 + step, 1.0), (1 / (1 + step), 1.0), (1.0, 1 + 2 * step),
                       (1.0, 1 / (1 + 2 * step)))  # fmt: skip
            near = [b for b in BLURS_PX if b != blur] if step == SIZE_STEPS[1] else []
            marks = [resize_mark(best.mark, *pair, blur) for pair in factors]
            marks += [resize_mark(best.mark, 1.0, 1.0, other) for other in near]
            trials = [replace(best, mark=mark) for mark in marks]
            found = [compare(small, trial, cell_mm) for trial in trials]
            winner = int(np.argmax([value for value, _ in found]))
            if found[winner][0] <= likeness + (GAIN if step in SIZE_STEPS else FINE_GAIN):
                break
            best = trials[winner]
            likeness, small = _likeness(found[winner][1], best, cell_mm)
            blur = best.mark.blur_px
    return best, small


def _ringed(spots: Sequence[Spot], dot: FittedMark, cell_mm: float) -> FittedMark | None:
    """The dot with the ring about it that explains more than the dot alone; None if none does.

    A scratch beside a dot moves it, and few pixels say so; a ring holds against it.
    """
    size_mm = dot.mark.radius_mm
    radii = [r for r in (size_mm * RINGS[0] * RINGS[1] ** k for k in range(16)) if r < RINGS[2]]
    if not radii:
        return None
    rings = [Mark("ringed-dot", radius, 2 * size_mm) for radius in radii]
    trials = [dot, *(replace(dot, mark=ring) for ring in rings)]
    values: list[float] = []
    for trial in trials:
        template = blur_as_scanned(trial.drawn((0.0, 1.0), cell_mm, radii[-1]))
        sign = 1 if dot.bright else -1
        patches = [sample_about(s.gray, np.array(s.start), template.shape[0]) for s in spots]
        values.append(
            sign * float(np.median([correlation(p, template, disc_in(template)) for p in patches]))
        )
    best = int(np.argmax(values))
    return trials[best] if best and values[best] > values[0] + RING_GAIN else None


def _kind(spots: Sequence[Spot], trials: Sequence[FittedMark], cell_mm: float) -> FittedMark:
    """The kind that explains most of what all of them cover: a cross's middle is not a dot."""
    if len(trials) == 1:
        return trials[0]
    reach_mm = max(trial.mark.reach_mm for trial in trials)
    values = [_likeness(spots, trial, cell_mm, reach_mm)[0] for trial in trials]
    return trials[int(np.argmax(values))]


def measure_spot(spot: Spot, fitted: FittedMark, pixel_mm: float) -> TwoWays | Failure:
    """One mark in both ways, near where it is expected."""
    cell_mm = pixel_mm * spot.reduction
    if fitted.mark.notch:
        by = max(1, round(NOTCH_MM / cell_mm))
        coarse = _reduced(spot, by)
        notch = _notch(coarse, fitted, cell_mm * by)
        return coarse.placed(notch) if isinstance(notch, TwoWays) else notch
    failure = Failure("Nothing there is like the mark that was shown.")
    for mark in _lying(spot, fitted, cell_mm):
        found = _measured(spot, replace(fitted, mark=mark), cell_mm)
        if isinstance(found, TwoWays):
            return replace(spot.placed(found), lies=mark.lies)
        failure = found
    return failure


def _lying(spot: Spot, fitted: FittedMark, pixel_mm: float) -> Sequence[Mark]:
    """The mark as it may lie at a place, likeliest first by a look from afar."""
    variants = fitted.mark.variants
    if len(variants) == 1:
        return variants
    reduction = max(1, round(SEARCH_PIXEL_MM / pixel_mm))
    cell, small, along = pixel_mm * reduction, _reduced(spot, reduction), border_axis(spot.outward)
    values: list[float] = []
    for mark in variants:
        template = replace(fitted, mark=mark).drawn(spot.outward, cell).astype(np.float32)
        side, reach = template.shape[0], int(np.ceil(OFF_MM / cell)) + 1
        half = side // 2 + reach
        near = square_about(small.gray, np.array(small.start), 2 * half + 1).astype(np.float32)
        shown, like = (without_border(one, side, along) for one in (near, template))
        values.append(float(cv2.matchTemplate(shown, like, cv2.TM_CCOEFF_NORMED).max()))
    return [variants[int(k)] for k in np.argsort([-value for value in values], kind="stable")]


def _measured(spot: Spot, fitted: FittedMark, pixel_mm: float) -> TwoWays | Failure:
    """One mark that is a figure, or a picture lying in one way."""
    template = fitted.drawn(spot.outward, pixel_mm)
    if fitted.mark.picture is not None and not fitted.mark.symmetric:
        along = border_axis(spot.outward)
        both = centre_by_likeness(spot.gray, spot.start, OFF_MM / pixel_mm + 1, template, along)
        if isinstance(both, Failure):
            return both
        alike = _together(both[0], both[1], both[0].correlation)
        edges = fitted.mark.edges_in(fitted.turn, spot.outward)
        if edges is None:
            return alike
        near = replace(spot, start=(alike.column, alike.row), corner=(0, 0), reduction=1)
        met = measure_corner(near, edges, OFF_MM, pixel_mm)
        if isinstance(met, Failure):
            return alike
        # Edges know nothing of the picture beside them, grays more of noise: each by its variance.
        ways = np.array([(one.column, one.row, one.sigma_px) for one in (met, alike)])
        column, row = np.average(ways[:, :2], axis=0, weights=1 / (ways[:, 2] ** 2 + TINY)).tolist()
        return replace(met, column=column, row=row, correlation=alike.correlation)
    matched = match_mark(spot.gray, spot.start, OFF_MM / pixel_mm + 2, template)
    if isinstance(matched, Failure):
        return matched
    start = (matched.column, matched.row)
    second = _second_way(spot.gray, fitted, template, start, pixel_mm)
    if isinstance(second, Failure):
        return second
    likeness = matched.correlation if fitted.bright else -matched.correlation
    both = _together(matched, second, likeness)
    if not fitted.mark.symmetric or fitted.mark.picture is not None:
        return both  # An example has no outline that its grays do not hold.
    outline = template if fitted.bright else -template
    middle = (both.column, both.row)
    third = centre_by_edges(spot.gray, middle, OUTLINE_MM / pixel_mm + 1, outline)
    return both if isinstance(third, Failure) else _confirmed(both, third)


def measure_corner(spot: Spot, edges: Edges, limit_mm: float, pixel_mm: float) -> TwoWays | Failure:
    """A mark where two edges meet near the start of its window, by half and steepest steps."""
    cell_mm = pixel_mm * spot.reduction
    both = centre_by_corner(spot.gray, spot.start, limit_mm / cell_mm + 1, edges, cell_mm)
    if isinstance(both, Failure):
        return both
    likeness = likeness_of(spot.gray, both[0], edges, cell_mm)
    return spot.placed(replace(_together(*both, likeness), worst_px=both[0].worst_px))


def _confirmed(both: TwoWays, third: Centre) -> TwoWays:
    """Both ways beside the outline: dirt that touches the mark moves them, but few of its edges."""
    apart = float(np.hypot(third.column - both.column, third.row - both.row))
    sigma = float(np.hypot(both.sigma_px, third.sigma_px))
    if apart < max(OUTLINE_SIGMAS * sigma, OUTLINE_PX):
        return both
    wide = float(np.hypot(third.sigma_px, apart / 2))
    return replace(both, column=third.column, row=third.row, sigma_px=wide, outline_px=apart)


def _notch(spot: Spot, fitted: FittedMark, pixel_mm: float) -> TwoWays | Failure:
    """A notch by its outline in two ways: nobody can draw the gray of the picture beside it."""
    template = fitted.drawn(spot.outward, pixel_mm)
    outline = template if fitted.bright else -template
    limit_px = OFF_MM / pixel_mm + 2
    first = centre_by_edges(spot.gray, spot.start, limit_px, outline, notch=True)
    if isinstance(first, Failure):
        return first
    drawn = partial(fitted.drawn, spot.outward, pixel_mm, 0.0)
    second = centre_by_sides(spot.gray, (first.column, first.row), limit_px, drawn)
    if isinstance(second, Failure):
        return second
    likeness = second.correlation if fitted.bright else -second.correlation
    apart = float(np.hypot(first.column - second.column, first.row - second.row))
    # The steps alone are drawn aside by the picture's slopes: they only confirm.
    beyond = max(apart - STEPS_APART_PX, 0.0) / 2
    return TwoWays(
        second.column,
        second.row,
        float(np.hypot(np.hypot(second.sigma_px, NOTCH_SIGMA_PX), beyond)),
        likeness,
        apart,
        worst_px=float(np.hypot(np.hypot(second.worst_px, NOTCH_SIGMA_PX), beyond)),
    )


def _together(matched: Centre, second: Centre, likeness: float) -> TwoWays:
    """Both ways weighted by their sigmas."""
    apart = float(np.hypot(matched.column - second.column, matched.row - second.row))
    # Two ways that differ by no more than both sigmas let expect are as sure as they say.
    expected = 2 * (matched.sigma_px**2 + min(second.sigma_px, WORST_PX) ** 2)
    beyond = float(np.sqrt(max(apart**2 - expected, 0.0))) / 2
    share = matched.sigma_px**2 / (matched.sigma_px**2 + second.sigma_px**2 + TINY)
    return TwoWays(
        share * second.column + (1 - share) * matched.column,
        share * second.row + (1 - share) * matched.row,
        float(np.hypot(min(second.sigma_px, WORST_PX), beyond)),
        likeness,
        apart,
    )


def _second_way(
    gray: Gray,
    fitted: FittedMark,
    template: Weights,
    start: tuple[float, float],
    pixel_mm: float,
) -> Centre | Failure:
    """The way that knows nothing of the grays of the drawn mark."""
    if not fitted.mark.symmetric:
        outline = template if fitted.bright else -template
        return centre_by_edges(gray, start, NEAR_MM / pixel_mm + 2, outline)
    radius = fitted.mark.reach_mm * SHORTEST_REACH / pixel_mm + 1
    return centre_by_symmetry(gray, start, NEAR_MM / pixel_mm + 2, disc(radius))


def _reduced(spot: Spot, reduction: int) -> Spot:
    """The same window with fewer pixels."""
    if reduction == 1:
        return spot
    side = spot.gray.shape[0] // reduction
    part = spot.gray[: side * reduction, : side * reduction]
    gray = part.reshape(side, reduction, side, reduction).mean(axis=(1, 3))
    start = (spot.start[0] / reduction, spot.start[1] / reduction)
    return replace(spot, gray=gray, start=start, reduction=spot.reduction * reduction)


def _likeness(
    spots: Sequence[Spot],
    fitted: FittedMark,
    cell_mm: float,
    reach_mm: float = 0.0,
    *,
    matched: bool = True,
) -> tuple[float, list[Spot]]:
    """Mean correlation with the drawn mark where it matches best, and the spots started there.

    Args:
        spots: Where marks are.
        fitted: The mark to draw.
        cell_mm: Pixel of the spots.
        reach_mm: Look at as much as a mark of this reach covers, if that is more.
        matched: False to compare where the spots start.
    """
    values: list[float] = []
    placed: list[Spot] = []
    drawn: dict[tuple[float, float], Weights] = {}
    for spot in spots:
        outward = spot.outward if not fitted.mark.symmetric else (0.0, 1.0)
        if outward not in drawn:
            drawn[outward] = fitted.drawn(outward, cell_mm, reach_mm)
        template = drawn[outward]
        if matched:
            match = match_mark(spot.gray, spot.start, NEAR_MM / cell_mm + 1, template, False)
            if isinstance(match, Failure):
                values.append(-1.0)
                placed.append(spot)
                continue
            spot = replace(spot, start=(match.column, match.row))
        patch = sample_about(spot.gray, np.array(spot.start), template.shape[0])
        values.append(
            correlation(patch, blur_as_scanned(template), disc_in(template))
            * (1 if fitted.bright else -1)
        )
        placed.append(spot)
    # The drawn mark's own size is its window: likeness of a larger one is worth more.
    return float(np.mean(np.sort(values)[len(values) // 4 :])), placed
