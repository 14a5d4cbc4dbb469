"""The tip of a notch by least squares, the picture beside it taken up as it is.

A notch is where film meets picture, and nobody can draw the picture. So both sides of the notch's
outline are smooth surfaces of unknown gray (penalised splines), and the shift of the outline is
solved for together with them: a slope of gray along the outline then moves nothing.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float64

from core.doubts import Failure
from core.geometry.robust import robust_sigma
from core.scans.centring import (
    EDGE_PX,
    Centre,
    Gray,
    Left,
    Weights,
    correlation,
)

BAND_PX = 12.0
"""How far from the outline pixels are used."""
TIP_PX = 6.0
"""Pixels this near to the tip are not used: no tip is quite sharp, and near that of a narrow notch
both edges run into each other."""
KNOTS_PX = 6.0
"""Distance of the splines' knots, pixels."""
CALM_KNOTS_PX = 60.0
"""The same on a side that is even."""
CALM = 0.5
"""How much less than the other side's gray that of an even side spreads."""
SMOOTH = (1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3)
"""Weights of a bend between knots against the gray of one pixel that are tried: what is grain and
what is picture the scan itself must tell."""
SHARED_PX = 1.0
"""Pixels, softened as they are, that tell no more than one would without its neighbours."""
RIDGE = 1e-3
"""Weight of a spline's own height: hardly any, but enough where no pixel reaches."""
CHOSEN_IN = (0, 2)
"""Rounds in which the weight of bends is chosen: at first, and where the notch was found."""
BLUR_PX = 0.6
"""Blur of lens, film and scanner that is begun with, pixels; it is solved for."""
MOST_BLUR_PX = 3.0
BLUR_TAPS = 4
ROUNDS = 8
CONVERGED_PX = 2e-3
FAR = 3.0
"""Residual, in spreads, at which half of a pixel's influence is gone."""
NOISE_SHARE = 0.04
"""Noise that is always reckoned with, as a share of the spread of grays: on flawless film the
picture's own unevenness would count as dirt, and only on one side."""
MIN_PIXELS = 150
Surfaces = Float64[np.ndarray, "pixels _"]
Square = Float64[np.ndarray, "_ _"]
Values = Float64[np.ndarray, "pixels"]
Used = Bool[np.ndarray, "side side"]
Drawn = Callable[[tuple[float, float]], Weights]


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
    window: Gray,
    drawn: Drawn,
    weights: Weights,
    start: tuple[float, float],
    limit_px: float,
) -> Centre | Failure:
    """The place at which the drawn outline parts two smooth surfaces of gray.

    The notch is drawn where it is thought to be, each pixel's share exact, and the scan's pixels
    are left as they are: along an edge that is nearly level with them, resampling would move it.

    Args:
        window: Part of the scan, without NaN.
        drawn: The notch, 1 on one side, 0 on the other, its tip so far (column, row) beside the
            middle of the middle pixel.
        weights: Weight of each template pixel.
        start: Approximate tip (column, row) in the window, pixels.
        limit_px: How far from the start the tip may be.
    """
    template = drawn((0.0, 0.0))
    used = _band(template, weights)
    if used.sum() < MIN_PIXELS:
        return Failure("The mark has too little outline in the window.")
    place, blur = np.array(start, dtype=np.float64), BLUR_PX**2
    left, bent = Left(np.zeros((2, 1, 1)), np.zeros((1, 1)), 1.0), np.zeros((2, 2))
    share, _ = _outlines(template, blur, used)
    gray = _pixels_about(window, np.floor(place) + 0.5, template.shape[0])[used]
    sides, bends = _surfaces(used, _knots(gray, share))
    prior, weight = bends, np.ones(len(share))
    for turn in range(ROUNDS):
        pixel = np.floor(place) + 0.5
        gray = _pixels_about(window, pixel, template.shape[0])[used]
        gray -= np.median(gray)
        column, row = (place - pixel).tolist()
        share, slopes = _outlines(drawn((column, row)), blur, used)
        surfaces = _beside_outline(sides, share, slopes, blur)
        if turn in CHOSEN_IN:
            prior = _likely(np.hstack([surfaces, slopes]), gray, bends)
        try:
            apart = _step_of_gray(sides, surfaces, gray, weight, prior)
            design = np.hstack([surfaces, slopes * apart[:, None]])
            step, weight, left, bent = _solved(design, gray, prior, used)
        except np.linalg.LinAlgError:
            return Failure("The mark's outline is not there.")
        place = place + np.clip(step[:2], -1.0, 1.0)
        blur = float(np.clip(blur + np.clip(step[2], -0.5, 0.5), 0.01, MOST_BLUR_PX**2))
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
    return np.hstack([
        sides[0].beside(share, -slopes, blur), sides[1].beside(1 - share, slopes, blur)
    ])  # fmt: skip


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


def _pixels_about(window: Gray, middle: Float64[np.ndarray, "2"], side: int) -> Weights:
    """An odd square of pixels as they are: softening blurs a sharp edge more than its grain.

    Args:
        window: Part of the scan.
        middle: Middle of a pixel, column and row.
        side: Of the square.
    """
    half = side // 2
    column, row = np.floor(middle).astype(int).tolist()
    columns = np.clip(np.arange(column - half, column + half + 1), 0, window.shape[1] - 1)
    rows = np.clip(np.arange(row - half, row + half + 1), 0, window.shape[0] - 1)
    return window[np.ix_(rows, columns)].astype(np.float64)


def _band(template: Weights, weights: Weights) -> Used:
    """Pixels near the outline, but not at the tip."""
    inside = (template > 0.5).astype(np.uint8)
    near = np.zeros(template.shape)
    for part in (inside, 1 - inside):
        depth = cv2.distanceTransform(np.pad(part, 1, mode="edge"), cv2.DIST_L2, 5)[1:-1, 1:-1]
        near += depth
    axis = np.arange(template.shape[0]) - template.shape[0] // 2
    away = np.hypot(*np.meshgrid(axis, axis))
    return np.asarray((near < BAND_PX) & (away > TIP_PX) & (weights > 0.5))


def _outlines(
    template: Weights, blur: float, used: Used
) -> tuple[Values, Float64[np.ndarray, "pixels 3"]]:
    """The drawn notch under a blur (variance), and how it changes with column, row and blur."""
    width, edge = (2 * BLUR_TAPS + 1,) * 2, cv2.BORDER_REPLICATE
    soft = cv2.GaussianBlur(template, width, float(np.sqrt(blur)), borderType=edge)
    right, down = _slope(soft, 1), _slope(soft, 0)
    curved = _slope(right, 1) + _slope(down, 0)
    return soft[used], np.column_stack([-right[used], -down[used], 0.5 * curved[used]])


def _slope(field: Weights, axis: int) -> Weights:
    """First derivative to the fourth order: a plain difference is flatter than an edge."""
    taps = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12
    kernels = (taps, np.ones(1)) if axis else (np.ones(1), taps)
    return cv2.sepFilter2D(field, cv2.CV_64F, *kernels, borderType=cv2.BORDER_REPLICATE)


def _knots(gray: Values, share: Values) -> tuple[float, float]:
    """Distance of knots on both sides: a frame is even where the picture is not."""
    spreads = [float(gray[side].std()) for side in (share > 0.98, share < 0.02)]
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
    knots = np.arange(-1, int(used.shape[0] / knots_px) + 3)
    across, down = (_hats(at / knots_px, knots) for at in (columns, rows))
    basis = _products(across, down)
    kept = basis.sum(axis=0) > 0.5
    at = np.full(kept.size, -1)
    at[kept] = np.arange(int(kept.sum()))
    grid = at.reshape(len(knots), len(knots))
    penalty = np.zeros((int(kept.sum()),) * 2)
    for lines in (grid, grid.T):
        triples = np.stack([lines[:-2], lines[1:-1], lines[2:]], axis=-1).reshape(-1, 3)
        triples = triples[(triples >= 0).all(axis=1)]
        bends = np.zeros((len(triples), len(penalty)))
        for column, value in zip(triples.T, (1.0, -2.0, 1.0), strict=True):
            bends[np.arange(len(triples)), column] = value
        penalty += bends.T @ bends
    across_slope, down_slope = (_slopes(at / knots_px, knots) / knots_px for at in (columns, rows))
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
        value += len(gray) / SHARED_PX * np.log(max(left, 1e-9))
        if value < best:
            best, chosen = float(value), prior
    return chosen


def _products(across: Surfaces, down: Surfaces) -> Surfaces:
    """Every function of the columns times every function of the rows."""
    return (across[:, :, None] * down[:, None, :]).reshape(len(across), -1)


def _hats(at: Values, knots: np.ndarray) -> Surfaces:
    """Cubic B-splines about whole knots."""
    apart = np.abs(at[:, None] - knots[None, :])
    inner = 2 / 3 - apart**2 + apart**3 / 2
    return np.where(apart < 1, inner, np.clip(2 - apart, 0, None) ** 3 / 6)


def _slopes(at: Values, knots: np.ndarray) -> Surfaces:
    """First derivatives of `_hats`."""
    along = at[:, None] - knots[None, :]
    apart = np.abs(along)
    steep = np.where(apart < 1, 1.5 * apart**2 - 2 * apart, -0.5 * np.clip(2 - apart, 0, None) ** 2)
    return np.sign(along) * steep


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
    least = NOISE_SHARE * float(gray.std()) + 1e-3
    for _ in range(3):
        residual = gray - design @ solution
        spread = np.hypot(max(robust_sigma(residual), least), edge)
        weight = 1 / (1 + (residual / (FAR * spread)) ** 2) ** 2
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
