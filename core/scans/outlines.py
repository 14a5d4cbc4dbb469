"""The middle of a mark by its outline: by steps of gray across it, or by the sides it parts.

Along every piece of the drawn outline the scan's own step of gray is looked for on the normal; the
shift (and the growth of the mark by exposure) that brings the outline onto the steps is solved for
with the influence of dirt bounded. It compares places of edges, where matching compares grays. A
step's place is that of its steepest part, or that at which the gray is half way between what lies
on its two sides: the first is blind to how bright the picture beside a notch is, the second to the
noise of single pixels.

A notch is where film meets picture, and nobody can draw the picture. So both sides of the notch's
outline are smooth surfaces of unknown gray (penalised splines), and the shift of the outline is
solved for together with them: a slope of gray along the outline then moves nothing.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float64
from scipy.interpolate import BSpline

from core.doubts import Failure
from core.geometry.robust import cauchy_weights, robust_sigma
from core.scans.centring import (
    EDGE_PX,
    FAR,
    SOFT_TAPS,
    Centre,
    Gray,
    Left,
    Spline,
    Weights,
    blur_as_scanned,
    correlation,
    disc_in,
    gray_between,
    spline_of,
    square_about,
)

REACH_PX, FAR_PX = 3.0, 5.0  # design: twice the blur of a step; the error of the start
"""How far from the drawn outline a step is looked for, and while the mark is being approached."""
STEP_PX, BEYOND_PX = 0.25, 2.0  # design: cubic interpolation shows no more; a step is seen whole
"""Step along a normal, and how much further than its reach a profile goes."""
EDGE_TIP_PX, TIP_PX = 12.0, 6.0  # design: a narrow notch is no wider than its edges are blurred
"""Outline this near to the tip of a notch is not used for steps, and pixels not for surfaces."""
NEARNESS, CENTROID_PX = 0.45, 0.7  # design: between the sides of a thin line; as wide as a step
"""Spread of the preference for near steps in their reach, and window of a step's centroid."""
STEP_HALF_PX, SIDE_PX = 2.5, 5.0  # design: three sigmas of a usual blur, and as much beside it
"""Half width of a step under blur, and how far on either side of it its gray is looked at."""
LEAST_STEP, MOST_STEP = 0.3, 2.0  # design: a third and twice the usual step are another edge
"""Height over the usual below which a step is not seen, and above which it counts no more."""
LEAST_RISE, OVERSHOOT = 1e-3, 0.2  # design: no gray; noise on both sides of a step
"""Smallest height of a step, gray, and how far a share may leave 0 to 1."""
EDGE_ROUNDS, ROBUST_ROUNDS = 6, 8  # design: twice what clean marks take
"""Rounds of the outline and of the weights in each."""
APPROACH_ROUNDS = 2  # design: the start is right to FAR_PX, the next to REACH_PX
"""Rounds in which the mark is still being approached."""
ROUGHEST_PX = 0.01  # design: no edge is drawn better
"""Spread of edges that is always reckoned with."""
CORRELATED = 2  # design: neighbouring pixels share their blur and grain
"""Pieces of outline that make one independent edge."""
STIFF = 1e-9  # design: keeps the normal equations regular, far below their elements
"""Added to the diagonal of normal equations."""
MIN_EDGES, MIN_PIXELS = 24, 150  # design: eight for each unknown; a notch of ten pixels a side
"""Fewer pieces of outline, and fewer pixels of a notch, say nothing."""
STEEP = 0.5  # design: the pixels that the outline crosses
"""Share of the steepest drawn slope from which a pixel belongs to the outline."""
BAND_PX = 12.0  # design: two knots: beyond, the picture says nothing of the edge
"""How far from the outline pixels are used."""
KNOTS_PX, CALM_KNOTS_PX = 6.0, 60.0  # design: as wide as a blurred edge; a frame is even
"""Distance of the splines' knots, and on a side that is even."""
CALM = 0.5  # design: a frame's gray spreads by grain only
"""How much less than the other side's gray that of an even side spreads."""
SMOOTH = (1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3)  # design: chosen by likelihood, in half decades
"""Weights of a bend between knots against the gray of one pixel that are tried: what is grain and
what is picture the scan itself must tell."""
SHARED_PX = 1.0  # design: pixels are used as they are
"""Pixels that tell no more than one would without its neighbours."""
RIDGE = 1e-3  # design: hardly any, but enough where no pixel reaches
"""Weight of a spline's own height."""
CHOSEN_IN = (0, 2)  # design: at first, and where the notch was found
"""Rounds in which the weight of bends is chosen."""
BLUR_PX, MOST_BLUR_PX, LEAST_BLUR_PX2 = 0.6, 3.0, 0.01  # design: solved for within these
"""Blur of lens, film and scanner: begun with, most, and least variance."""
NOTCH_ROUNDS, REWEIGHTED = 8, 3  # design: twice what clean notches take
CONVERGED_PX = 2e-3  # design: a tenth of the sigma of good notches
NOISE_SHARE = 0.04  # design: on flawless film the picture's own unevenness would count as dirt
"""Noise that is always reckoned with, as a share of the spread of grays."""
CLEAR = 0.98  # design: pixels that the outline does not touch
"""Share of a pixel on one side from which it tells of that side alone."""
Points = Float64[np.ndarray, "edges 2"]
Surfaces = Float64[np.ndarray, "pixels _"]
Square = Float64[np.ndarray, "_ _"]
Values = Float64[np.ndarray, "pixels"]
Used = Bool[np.ndarray, "side side"]
Drawn = Callable[[tuple[float, float]], Weights]


def centre_by_edges(
    window: Gray,
    start: tuple[float, float],
    limit_px: float,
    template: Weights,
    notch: bool = False,
) -> Centre | Failure:
    """The place at which the drawn outline lies on the scan's steps of gray.

    Args:
        window: Part of the scan, without NaN.
        start: Approximate middle (column, row) in the window, pixels.
        limit_px: How far from the start the middle may be.
        template: The drawn mark, 1 where the scan is brighter; its middle is that of its middle
            pixel.
        notch: All edges meet in one point: nothing is said of growth, and the place of half the
            step is taken instead of its steepest part.
    """
    window, template = blur_as_scanned(window).astype(np.float32), blur_as_scanned(template)
    points, normals = _outline(template, notch)
    if notch:
        # About the tip itself both edges run into each other.
        away = np.hypot(points[:, 0], points[:, 1]) > EDGE_TIP_PX
        points, normals = points[away], normals[away]
    if len(points) < MIN_EDGES:
        return Failure("The mark has too little outline in the window.")
    place, sigma, share = np.array(start, dtype=np.float64), np.nan, 0.0
    spline = spline_of(window)
    for step_number in range(EDGE_ROUNDS):
        reach = FAR_PX if step_number < APPROACH_ROUNDS else REACH_PX
        offsets, height = steps_of_gray(spline, points + place, normals, notch, reach)
        sure = height > 0
        if sure.sum() < MIN_EDGES:
            return Failure("The mark's outline is not there.")
        design = np.column_stack([normals, np.full(len(normals), float(not notch))])[sure]
        step, sigma = _robust(design, offsets[sure], height[sure])
        share = float(sure.mean())
        place = place + np.clip(step[:2], -1.0, 1.0)
        if np.linalg.norm(place - np.array(start)) > limit_px:
            return Failure("The outline lies elsewhere.")
        if np.abs(step[:2]).max() < CONVERGED_PX:
            break
    return Centre(float(place[0]), float(place[1]), sigma, share)


def _outline(template: Weights, half_way: bool) -> tuple[Points, Points]:
    """Places (from the middle) and unit normals, towards the bright side, of the drawn outline."""
    half = template.shape[0] // 2
    right, down = np.gradient(template, axis=1), np.gradient(template, axis=0)
    steep = np.hypot(right, down)
    used = (steep > STEEP * steep.max()) & (disc_in(template) > 0.5)
    margin = int(REACH_PX)
    used[:margin] = used[-margin:] = used[:, :margin] = used[:, -margin:] = False
    rows, columns = np.nonzero(used)
    normals = np.column_stack([right[used], down[used]]) / steep[used][:, None]
    points = np.column_stack([columns - half, rows - half]).astype(np.float64)
    # To the place on the normal where the drawn step itself is: the same measure on both sides.
    drawn, places = template.astype(np.float32), points + half + 0.5
    offsets, height = steps_of_gray(spline_of(drawn), places, normals, half_way)
    sure = height > 0
    return (points + offsets[:, None] * normals)[sure], normals[sure]


def steps_of_gray(
    spline: Spline, points: Points, normals: Points, half_way: bool, reach: float = REACH_PX
) -> tuple[Float64[np.ndarray, "edges"], Float64[np.ndarray, "edges"]]:
    """How far along its normal each step lies, and its height over the usual; 0 if not seen."""
    along = np.arange(-reach - BEYOND_PX, reach + BEYOND_PX + STEP_PX / 2, STEP_PX)
    columns, rows = (points[:, k, None] + normals[:, k, None] * along for k in (0, 1))
    profile = gray_between(spline, columns, rows)
    slope = np.maximum(np.diff(profile, axis=1), 0.0)
    middle = (along[1:] + along[:-1]) / 2
    # Nearness decides between the two sides of a thin line.
    near = slope * np.exp(-0.5 * (middle / (NEARNESS * reach)) ** 2)
    place = middle[near.argmax(axis=1)]
    total = np.zeros(len(points))
    for _ in range(3):
        # The window pulls the centroid towards its own middle: until both are the same.
        around = np.exp(-0.5 * ((middle[None, :] - place[:, None]) / CENTROID_PX) ** 2) * slope
        total = around.sum(axis=1)
        place = (around * middle).sum(axis=1) / np.maximum(total, STIFF)
    height = total / max(float(np.median(total)), STIFF) if len(total) else total
    if half_way:
        # The stretch that is looked at has its middle where the step was taken to be.
        for _ in range(2):
            place = _half_way(profile, along, place)
    return place, np.where((height > LEAST_STEP) & (np.abs(place) < reach - 0.5), height, 0.0)


def _half_way(
    profile: Float64[np.ndarray, "edges samples"],
    along: Float64[np.ndarray, "samples"],
    place: Float64[np.ndarray, "edges"],
) -> Float64[np.ndarray, "edges"]:
    """Where each profile is half way between the grays on both sides of its step.

    The gray of each side is continued to the step as a straight line: beside a notch the picture
    brightens or darkens, which moves the steepest place and would move the half way too.
    """
    apart = along[None, :] - place[:, None]
    low = _continued(profile, apart, (apart < -STEP_HALF_PX) & (apart > -SIDE_PX))
    high = _continued(profile, apart, (apart > STEP_HALF_PX) & (apart < SIDE_PX))
    share = (profile - low) / np.maximum(high - low, LEAST_RISE)
    # The share of the samples about the step that is still dark is where the step lies.
    about = np.abs(apart) <= STEP_HALF_PX
    dark = np.where(about, np.clip(1 - share, -OVERSHOOT, 1 + OVERSHOOT), 0.0).sum(axis=1)
    left = np.where(about, along[None, :], np.inf).min(axis=1)
    return left + (dark - 0.5) * (along[1] - along[0])


def _continued(
    profile: Float64[np.ndarray, "edges samples"],
    apart: Float64[np.ndarray, "edges samples"],
    side: np.ndarray,
) -> Float64[np.ndarray, "edges samples"]:
    """The straight line through the samples of one side, at all samples."""
    count = np.maximum(side.sum(axis=1, keepdims=True), 1)
    middle = np.where(side, apart, 0.0).sum(axis=1, keepdims=True) / count
    level = np.where(side, profile, 0.0).sum(axis=1, keepdims=True) / count
    spread = np.where(side, (apart - middle) ** 2, 0.0).sum(axis=1, keepdims=True)
    slope = np.where(side, (apart - middle) * (profile - level), 0.0).sum(axis=1, keepdims=True)
    return level + slope / np.maximum(spread, STIFF) * (apart - middle)


def _robust(
    design: Float64[np.ndarray, "edges 3"],
    offsets: Float64[np.ndarray, "edges"],
    height: Float64[np.ndarray, "edges"],
) -> tuple[Float64[np.ndarray, "3"], float]:
    """Shift and growth, what is far off counting for little; sigma of the shift per axis."""
    solution = np.zeros(3)
    # Noise and texture move a low step more than a high one.
    base = np.clip(height, LEAST_STEP, MOST_STEP) ** 2
    weight = base
    for _ in range(ROBUST_ROUNDS):
        normal = (design * weight[:, None]).T @ design + STIFF * np.eye(3)
        solution = np.linalg.solve(normal, (design * weight[:, None]).T @ offsets)
        residual = offsets - design @ solution
        spread = robust_sigma(residual) + ROUGHEST_PX
        weight = base * cauchy_weights(np.abs(residual) / spread, FAR) ** 2
    residual = offsets - design @ solution
    freedom = max(weight.sum() / CORRELATED - 3, 1.0)
    variance = float(np.sum(weight * residual**2)) / CORRELATED / freedom
    normal = (design * weight[:, None]).T @ design + STIFF * np.eye(3)
    cofactor = np.linalg.inv(normal) * CORRELATED
    return solution, float(np.sqrt(variance * np.trace(cofactor[:2, :2]) / 2))


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """The splines of one side of the outline."""

    gray: Surfaces
    """What each adds to the gray of each pixel."""
    slope_c: Surfaces
    """How that changes along the columns."""
    slope_r: Surfaces
    """How that changes along the rows."""

    def beside(
        self, share: Values, rise: Float64[np.ndarray, "pixels _"], variance: float
    ) -> Surfaces:
        """What each adds where a blur mixes both sides.

        Blur draws a gray that rises towards the outline across it: by Gauss's kernel, the blurred
        product of a linear gray and a step is their product plus variance times both slopes.

        Args:
            share: Share of this side in each pixel, blurred.
            rise: How that share changes along columns and rows.
            variance: Of the blur, square pixels.
        """
        drawn = self.slope_c * rise[:, :1] + self.slope_r * rise[:, 1:2]
        return self.gray * share[:, None] + variance * drawn


def centre_by_sides(
    window: Gray, start: tuple[float, float], limit_px: float, drawn: Drawn
) -> Centre | Failure:
    """The place at which the drawn outline parts two smooth surfaces of gray.

    The notch is drawn where it is thought to be, each pixel's share exact, and the scan's pixels
    are left as they are: along an edge that is nearly level with them, resampling would move it.

    Args:
        window: Part of the scan, without NaN.
        start: Approximate tip (column, row) in the window, pixels.
        limit_px: How far from the start the tip may be.
        drawn: The notch, 1 on one side, 0 on the other, its tip so far (column, row) beside the
            middle of the middle pixel.
    """
    template = drawn((0.0, 0.0))
    used = _band(template)
    if used.sum() < MIN_PIXELS:
        return Failure("The mark has too little outline in the window.")
    place, blur = np.array(start, dtype=np.float64), BLUR_PX**2
    left, bent = Left(np.zeros((2, 1, 1)), np.zeros((1, 1)), 1.0), np.zeros((2, 2))
    share, _ = _outlines(template, blur, used)
    # Pixels as they are: softening blurs a sharp edge more than its grain.
    gray = square_about(window, place, template.shape[0])[used]
    sides, bends = _surfaces(used, _knots(gray, share))
    prior, weight = bends, np.ones(len(share))
    for round_number in range(NOTCH_ROUNDS):
        gray = square_about(window, place, template.shape[0])[used]
        gray -= np.median(gray)
        column, row = (place - np.floor(place) - 0.5).tolist()
        share, slopes = _outlines(drawn((column, row)), blur, used)
        surfaces = _beside_outline(sides, share, slopes, blur)
        if round_number in CHOSEN_IN:
            prior = _likely(np.hstack([surfaces, slopes]), gray, bends)
        try:
            apart = _step_of_gray(sides, surfaces, gray, weight, prior)
            design = np.hstack([surfaces, slopes * apart[:, None]])
            step, weight, left, bent = _solved(design, gray, prior, used)
        except np.linalg.LinAlgError:
            return Failure("The mark's outline is not there.")
        place = place + np.clip(step[:2], -1.0, 1.0)
        blur = float(np.clip(blur + np.clip(step[2], -0.5, 0.5), LEAST_BLUR_PX2, MOST_BLUR_PX**2))
        if np.linalg.norm(place - np.array(start)) > limit_px:
            return Failure("The outline lies elsewhere.")
        if np.abs(step[:2]).max() < CONVERGED_PX:
            break
    covariance = left.covariance + bent
    sigma, worst = np.trace(covariance) / 2, np.linalg.eigvalsh(covariance)[1]
    return Centre(
        float(place[0]), float(place[1]), float(np.sqrt(sigma)), _likeness(gray, share),
        float(np.sqrt(worst)),
    )  # fmt: skip


def _beside_outline(
    sides: Sequence[Side], share: Values, slopes: Float64[np.ndarray, "pixels 3"], blur: float
) -> Surfaces:
    """What the splines of both sides add to each pixel."""
    mine, other = sides[0].beside(share, -slopes, blur), sides[1].beside(1 - share, slopes, blur)
    return np.hstack([mine, other])


def _step_of_gray(
    sides: Sequence[Side], surfaces: Surfaces, gray: Values, weight: Values, prior: Square
) -> Values:
    """How much brighter the notch is than the picture, as if both went on to each pixel."""
    found = _normal(surfaces, weight, prior) @ (surfaces * weight[:, None]).T @ gray
    first = sides[0].gray.shape[1]
    return sides[0].gray @ found[:first] - sides[1].gray @ found[first:]


def _likeness(gray: Values, share: Values) -> float:
    """Correlation with the drawn notch, the picture's ups and downs cut off at its usual gray."""
    usual = [float(np.median(gray[(share > 0.5) == side])) for side in (False, True)]
    clipped = np.clip(gray, min(usual), max(usual))
    return correlation(clipped, share, np.ones_like(share))


def _band(template: Weights) -> Used:
    """Pixels near the outline, but not at the tip."""
    inside = (template > 0.5).astype(np.uint8)
    near = np.zeros(template.shape)
    for part in (inside, 1 - inside):
        depth = cv2.distanceTransform(np.pad(part, 1, mode="edge"), cv2.DIST_L2, cv2.DIST_MASK_5)[
            1:-1, 1:-1
        ]
        near += depth
    axis = np.arange(template.shape[0]) - template.shape[0] // 2
    away = np.hypot(*np.meshgrid(axis, axis))
    return np.asarray((near < BAND_PX) & (away > TIP_PX) & (disc_in(template) > 0.5))


def _outlines(
    template: Weights, blur: float, used: Used
) -> tuple[Values, Float64[np.ndarray, "pixels 3"]]:
    """The drawn notch under a blur (variance), and how it changes with column, row and blur."""
    width, edge = (2 * SOFT_TAPS + 1,) * 2, cv2.BORDER_REPLICATE
    soft = cv2.GaussianBlur(template, width, float(np.sqrt(blur)), borderType=edge)
    right, down = _slope(soft, 1), _slope(soft, 0)
    curved = _slope(right, 1) + _slope(down, 0)
    return soft[used], np.column_stack([-right[used], -down[used], 0.5 * curved[used]])


def _slope(field: Weights, axis: int) -> Weights:
    """First derivative to the fourth order: a plain difference is flatter than an edge."""
    # source: Fornberg 1988, table 1
    taps = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12
    kernels = (taps, np.ones(1)) if axis else (np.ones(1), taps)
    return cv2.sepFilter2D(field, cv2.CV_64F, *kernels, borderType=cv2.BORDER_REPLICATE)


def _knots(gray: Values, share: Values) -> tuple[float, float]:
    """Distance of knots on both sides: a frame is even where the picture is not."""
    spreads = [float(gray[side].std()) for side in (share > CLEAR, share < 1 - CLEAR)]
    first, second = (
        CALM_KNOTS_PX if spread < CALM * max(spreads) else KNOTS_PX for spread in spreads
    )
    return first, second


def _surfaces(used: Used, knots_px: Sequence[float]) -> tuple[list[Side], Square]:
    """Splines of both sides, and the normal equations of the wish that they be smooth."""
    sides, priors = zip(*(_splines(used, distance) for distance in knots_px), strict=True)
    sizes = [len(prior) for prior in priors]
    prior = np.zeros((sum(sizes), sum(sizes)))
    prior[: sizes[0], : sizes[0]] = priors[0]
    prior[sizes[0] :, sizes[0] :] = priors[1]
    return list(sides), prior


def _splines(used: Used, knots_px: float) -> tuple[Side, Square]:
    """Cubic splines over the used pixels, and the penalty of second differences between knots.

    Knots that hardly any pixel reaches are left out.
    """
    rows, columns = np.nonzero(used)
    count = int(used.shape[0] / knots_px) + 4
    splines = BSpline(np.arange(count + 4) - 3.0, np.eye(count), 3)
    across, down = splines(columns / knots_px), splines(rows / knots_px)
    basis = _products(across, down)
    kept = basis.sum(axis=0) > 0.5
    at = np.full(kept.size, -1)
    at[kept] = np.arange(int(kept.sum()))
    grid = at.reshape(count, count)
    penalty = np.zeros((int(kept.sum()),) * 2)
    for lines in (grid, grid.T):
        triples = np.stack([lines[:-2], lines[1:-1], lines[2:]], axis=-1).reshape(-1, 3)
        triples = triples[(triples >= 0).all(axis=1)]
        bends = np.zeros((len(triples), len(penalty)))
        for column, value in zip(triples.T, (1.0, -2.0, 1.0), strict=True):
            bends[np.arange(len(triples)), column] = value
        penalty += bends.T @ bends
    slopes = splines.derivative()
    across_slope, down_slope = (slopes(at / knots_px) / knots_px for at in (columns, rows))
    slope_c, slope_r = _products(across_slope, down), _products(across, down_slope)
    return Side(basis[:, kept], slope_c[:, kept], slope_r[:, kept]), penalty


def _likely(design: Surfaces, gray: Values, bends: Square) -> Square:
    """The prior of the surfaces that makes the grays likeliest (restricted likelihood).

    Args:
        design: The surfaces, and what else is solved for.
        gray: Of the pixels.
        bends: Normal equations of all bends between knots.
    """
    ridge = RIDGE * np.eye(len(bends))
    rank = int(np.linalg.matrix_rank(bends))
    best, chosen = np.inf, ridge
    for smooth in SMOOTH:
        prior = smooth * bends + ridge
        normal = design.T @ design
        normal[: len(prior), : len(prior)] += prior
        right = design.T @ gray
        solution = np.linalg.solve(normal, right)
        left = float(gray @ gray - solution @ right) / SHARED_PX
        value = np.linalg.slogdet(normal)[1] - rank * np.log(smooth)
        value += len(gray) / SHARED_PX * np.log(max(left, STIFF))
        if value < best:
            best, chosen = float(value), prior
    return chosen


def _products(across: Surfaces, down: Surfaces) -> Surfaces:
    """Every function of the columns times every function of the rows."""
    return (across[:, :, None] * down[:, None, :]).reshape(len(across), -1)


def _normal(design: Surfaces, weight: Values, prior: Square) -> Square:
    """Inverse of the weighted normal equations, the prior on the first unknowns included."""
    normal = (design * weight[:, None]).T @ design
    normal[: len(prior), : len(prior)] += prior
    return np.linalg.inv(normal)


def _solved(
    design: Surfaces, gray: Values, prior: Square, used: Used
) -> tuple[Float64[np.ndarray, "3"], Values, Left, Square]:
    """Shift and blur, weights, and what is left; what fits no surface counts less.

    Also what surfaces that bend as their prior lets expect do to the shift (covariance): noise and
    residuals do not tell of that.
    """
    weight = np.ones(len(gray))
    inverse = _normal(design, weight, prior)
    heavy = design
    solution = inverse @ heavy.T @ gray
    # Half a pixel's share at the outline is no dirt; without it only pixels beside it would count.
    edge = EDGE_PX * np.hypot(design[:, -3], design[:, -2])
    least = NOISE_SHARE * float(gray.std()) + LEAST_RISE
    for _ in range(REWEIGHTED):
        residual = gray - design @ solution
        spread = np.hypot(max(robust_sigma(residual), least), edge)
        weight = cauchy_weights(np.abs(residual) / spread, FAR) ** 2
        inverse, heavy = _normal(design, weight, prior), design * weight[:, None]
        solution = inverse @ heavy.T @ gray
    residual = (gray - design @ solution) * np.sqrt(weight)
    unknowns = float(np.vdot(inverse, design.T @ heavy))
    freedom = max(float(weight.sum()) - unknowns, 10.0)
    fields = np.zeros((3, *used.shape))
    fields[:, used] = np.vstack([(inverse @ heavy.T)[-3:-1], residual])
    at = inverse[-3:-1, : len(prior)]
    bent = at @ prior @ at.T * float(np.sum(residual**2)) / freedom
    return solution[-3:], weight, Left(fields[:2], fields[2], freedom), bent
