"""The middle of a mark to a fraction of a pixel: by its figure, or by its symmetry.

Every way to centre a mark takes a window of the scan, an approximate middle and how far the middle
may be from there, and returns a `Centre` in that window, or why there is none; the ways by the
mark's outline are in `outlines`, by its edges in `corners`. Matching compares the scan with the
drawn mark; symmetry compares the scan with itself turned by half a circle and knows nothing of the
mark's kind. Both solve for a shift by least squares with the influence of dirt and scratches
bounded. Half of an example that is not symmetric is picture, which differs from place to place: it
is compared in two ways of its own.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from jaxtyping import Float32, Float64
from scipy.ndimage import map_coordinates, spline_filter

from core.doubts import Failure
from core.geometry.robust import TINY, cauchy_weights, robust_sigma
from core.matching.peaks import (
    ScoreMap,
    ScorePeak,
    correlation_scores,
    cosine_scores,
    level_and_spread,
    measure_peak,
)
from core.matching.precision import place_covariance, sharpness_of

Gray = Float32[np.ndarray, "rows columns"]
Weights = Float64[np.ndarray, "side side"]
Shift = Float64[np.ndarray, "2"]
Spline = Float64[np.ndarray, "rows_and_rim columns_and_rim"]
Samples = Float64[np.ndarray, "edges samples"]
SPLINE_PX = 12  # source: Unser 1999, the pole of cubic splines: 0.27^12 of the contrast
"""Pixels beyond samples that still tell in their interpolation: the rim of a spline."""
STEPS = 20  # design: a fit that has not converged by then wanders
FAR = 3.0  # source: Geman & McClure 1987, the usual three spreads
"""Residual, in spreads, at which half of a pixel's influence is gone."""
HUBER = 2.5  # source: Huber & Ronchetti 2009, between 1.5 and 3 spreads
"""Residual, in spreads, from which influence is bounded on the way."""
CONVERGED_PX = 1e-3  # design: a tenth of the best marks' sigma
ROUGH_PX = 5e-3  # design: likeness changes in the fifth digit
"""Last step that suffices where the mark's likeness is wanted, not its middle."""
NEAR_PX = 0.05  # design: nearer than the residuals of a shift look like dirt
"""Step from which what is far from the drawn mark no longer counts."""
NOISE_SHARE = 0.08  # design: what drawn and real marks differ by on clean film
"""Noise that is always reckoned with, as a share of the contrast of the mark."""
LAGS = 3  # design: the softening below reaches so far, and grain with it
"""How far apart pixels are whose noise is taken to be correlated."""
LOCAL_PX = 3  # design: forty-nine residuals for one spread, narrower than a mark
"""Half width of the surroundings that tell how noisy a pixel is."""
LEAST_VARIANCE = 0.25  # design: positive correlations only widen; half a sigma is left to chance
"""Share of the variance of uncorrelated pixels that correlated ones have at least."""
SOFT_TAPS = 4  # design: more than five sigmas of the blur
SOFT_PX = 0.7  # design: the least at which resampling is exact to 1e-4 of the contrast
"""Blur (Gaussian sigma) of both fields before they are compared, pixels: a sharp line is less wide
than resampling can follow, and its middle would be drawn to the middles of pixels."""
EDGE_PX = 0.15  # design: between the middle's error (0.03) and the width of an edge (1)
"""How far a drawn edge may lie beside the scan's before it counts as dirt: the shape of a real mark
is not quite the drawn one's."""
LEAST_RADIUS_PX = 3.0  # design: about thirty pixels for two unknowns
"""Smallest disc about a middle that is compared."""


@dataclass(frozen=True, slots=True, eq=False)
class Centre:
    """Where a mark's middle is in a window, and how sure the fit is of it."""

    column: float
    """Window pixels, outer corner of the first pixel (0, 0)."""
    row: float
    """Window pixels."""
    sigma_px: float
    """Standard deviation per axis from the fit's residuals, pixels."""
    correlation: float
    """Correlation of the two fields that were compared, -1 to 1."""
    worst_px: float = float("nan")
    """Standard deviation in the direction in which it is least sure, where that was asked for."""


@dataclass(frozen=True, slots=True, eq=False)
class Left:
    """What a fit of correlated pixels leaves, to judge its shift by."""

    influence: Float64[np.ndarray, "2 side side"]
    """What a gray more in each pixel does to the shift, column and row."""
    residual: Weights
    """What the fit leaves in each pixel; 0 where it was not used."""
    freedom: float
    """Pixels less unknowns."""

    @property
    def sigma_px(self) -> float:
        """Standard deviation of the shift per axis, pixels."""
        return float(np.sqrt(np.trace(self.covariance) / 2))

    @property
    def covariance(self) -> Float64[np.ndarray, "2 2"]:
        """Of the shift, square pixels.

        Pixels share their blur and grain, and where the drawn mark is not quite the scan's they are
        wrong together: how much, their own residuals tell. They also tell where: film is noisier
        where it is bright, and at edges.
        """
        local = _spread_about(self.residual)
        even = self.residual / np.maximum(local, TINY)
        power = float(np.sum(even**2)) + TINY
        first, second = self.influence * local
        total = np.zeros((2, 2))
        for down in range(LAGS + 1):
            for right in range(-LAGS if down else 0, LAGS + 1):
                share = _lagged(even, even, down, right) / power
                aside = _lagged(first, second, down, right) + _lagged(second, first, down, right)
                both = np.array([[2 * _lagged(first, first, down, right), aside],
                                 [aside, 2 * _lagged(second, second, down, right)]])  # fmt: skip
                total += share * both * (0.5 if down == right == 0 else 1)
        # Chance in the correlations may bring the sum of all below that of none.
        least = LEAST_VARIANCE * float(np.sum(first**2) + np.sum(second**2))
        if np.linalg.eigvalsh(total)[0] <= 0 or np.trace(total) < least:
            total = np.eye(2) * max(float(np.trace(total)), least) / 2
        return total * float(np.count_nonzero(self.residual)) / self.freedom


Step = tuple[Shift, Callable[[], Left], float]
"""Where a fit moves the middle (or has moved it), what it leaves, and how alike both fields are."""


def _spread_about(residual: Weights) -> Weights:
    """Root mean square of the residuals about each pixel; 0 where none is near."""
    around = (2 * LOCAL_PX + 1,) * 2
    count = cv2.blur((residual != 0).astype(np.float64), around)
    mean = np.maximum(cv2.blur(residual**2, around), 0.0) / np.maximum(count, TINY)
    return np.asarray(np.sqrt(mean), dtype=np.float64)


def match_mark(
    window: Gray,
    start: tuple[float, float],
    limit_px: float,
    template: Weights,
    judged: bool = True,
) -> Centre | Failure:
    """Least squares matching of a drawn mark: shift, gain and offset.

    Args:
        window: Part of the scan, without NaN.
        start: Approximate middle (column, row) in the window, pixels.
        limit_px: How far from the start the middle may be.
        template: The drawn mark; its middle is the middle of its middle pixel.
        judged: Whether its sigma is wanted.
    """
    template, weights = blur_as_scanned(template), disc_in(template)
    inside = weights > 0
    base = weights[inside]
    slopes = np.stack([np.gradient(template, axis=axis)[inside] for axis in (1, 0)])
    drawn = template[inside] - np.average(template, weights=weights)
    power = float(np.sum(base * drawn**2)) + TINY

    def step(place: Shift, far: bool) -> Step | Failure:
        patch = sample_about(window, place, template.shape[0])
        wanted = patch[inside] - np.average(patch, weights=weights)
        shared = float(np.sum(base * drawn * wanted))
        gain = shared / power
        # patch = gain * template(shifted) + offset: a mark that lies further right than assumed
        # makes the patch look shifted right, patch(u) = gain * template(u - step), hence the minus.
        design = np.stack([*(-gain * slopes), drawn, np.ones_like(drawn)])
        solution, left = _solve(design, wanted - gain * drawn, weights, float(patch.std()), far)
        if not np.isfinite(solution).all() or abs(gain) < 1e-9:  # design: no contrast at all
            return Failure("The window holds nothing like the mark.")
        return solution[:2], left, shared / float(np.sqrt(power * np.sum(base * wanted**2)) + TINY)

    found = _approached(start, limit_px, step, CONVERGED_PX if judged else ROUGH_PX)
    if found is None:
        return Failure("Matching the drawn mark drifted away from it.")
    if isinstance(found, Failure):
        return found
    place, left, alike = found
    sigma = left().sigma_px if judged else float("nan")
    return Centre(float(place[0]), float(place[1]), sigma, alike)


def centre_by_symmetry(
    window: Gray, start: tuple[float, float], limit_px: float, weights: Weights
) -> Centre | Failure:
    """The point about which the window looks most like itself after half a turn.

    Args:
        window: Part of the scan, without NaN.
        start: Approximate middle (column, row) in the window, pixels.
        limit_px: How far from the start the middle may be.
        weights: Weight of each pixel about the middle; itself symmetric.
    """
    inside = weights > 0

    def step(place: Shift, far: bool) -> Step | Failure:
        patch = sample_about(window, place, weights.shape[0])
        turned = patch[::-1, ::-1]
        # With the middle at d: patch = f(u - d), turned = f(u + d), their difference d times
        # the sum of their slopes; the slope of the turned one is that of the other, turned.
        both = [np.gradient(patch, axis=axis) for axis in (1, 0)]
        slopes = np.stack([(one - one[::-1, ::-1])[inside] for one in both])
        right = (turned - patch)[inside]
        shift, left = _solve(slopes, right, weights, float(patch.std()), far)
        if not np.isfinite(shift).all():
            return Failure("The window has no contrast.")
        return shift, left, correlation(patch, turned, weights)

    found = _approached(start, limit_px, step, CONVERGED_PX)
    if found is None:
        return Failure("The point of symmetry lies elsewhere.")
    if isinstance(found, Failure):
        return found
    place, left, alike = found
    # Every pixel stands against its opposite, which stands against it: half of them are new.
    return Centre(float(place[0]), float(place[1]), float(np.sqrt(2)) * left().sigma_px, alike)


def centre_by_likeness(
    window: Gray, start: tuple[float, float], limit_px: float, template: Weights, along: int | None
) -> tuple[Centre, Centre] | Failure:
    """Where a window is most like an example that is not symmetric, in two ways.

    Grays without the straight border beside it, and directions of gradients whatever their height:
    the picture beside a notch is bright or dark, its edge runs the same way.

    Args:
        window: Part of the scan, without NaN.
        start: Approximate middle (column, row) in the window, pixels.
        limit_px: How far from the start the middle may be.
        template: The example as it lies in the scan.
        along: The axis along which the picture's border runs; None at a corner.
    """
    side, half = template.shape[0], template.shape[0] // 2
    reach = int(np.ceil(limit_px)) + 2
    column, row = int(start[0]) - half - reach, int(start[1]) - half - reach
    wide = side + 2 * reach
    if min(column, row) < 0 or max(column, row) + wide > min(window.shape):
        return Failure("It lies outside the scan.")
    gray = window[row : row + wide, column : column + wide]
    found: list[Centre] = []
    for layer_of, scores_of in (
        (partial(_without_border, along=along, side=side), correlation_scores),
        (_directions, cosine_scores),
    ):
        shown, sought = layer_of(gray), layer_of(template)
        scores = scores_of(shown, sought)
        peak = _highest(scores, limit_px)
        if peak is None:
            return Failure("Nothing there is like the mark that was shown.")
        at = round(peak.column), round(peak.row)
        part = shown[at[1] : at[1] + side, at[0] : at[0] + side]
        sharp = sharpness_of((sought,))
        if sharp is None:
            return Failure("The mark that was shown is an edge that fixes no place.")
        covariance = place_covariance(sharp, (part,))
        if not np.isfinite(covariance).all():
            return Failure("Nothing there is like the mark that was shown.")
        found.append(
            Centre(
                column + half + 0.5 + peak.column,
                row + half + 0.5 + peak.row,
                float(np.sqrt(np.trace(covariance) / 2)),
                peak.value,
            )
        )
    return found[0], found[1]


def _highest(scores: ScoreMap, limit_px: float) -> ScorePeak | None:
    """The highest peak within reach of the middle of a score map; None at the rim."""
    middle = scores.shape[0] // 2
    rows, columns = np.indices(scores.shape)
    near = np.hypot(rows - middle, columns - middle) <= limit_px
    best = int(np.argmax(np.where(near, scores, -np.inf)))
    row, column = divmod(best, scores.shape[1])
    if not (0 < row < scores.shape[0] - 1 and 0 < column < scores.shape[1] - 1):
        return None
    return measure_peak(scores, row, column, *level_and_spread(scores))


def _without_border(gray: np.ndarray, along: int | None, side: int) -> Gray:
    return without_border(gray.astype(np.float32), side, along)


def _directions(gray: np.ndarray) -> Float32[np.ndarray, "rows columns 2"]:
    """Gradients (right, down), strong ones weighing little more than weak ones."""
    soft = blur_as_scanned(gray.astype(np.float32))
    both = np.stack([np.gradient(soft, axis=1), np.gradient(soft, axis=0)], axis=-1)
    length = np.linalg.norm(both, axis=-1, keepdims=True)
    return (both / np.sqrt(length * length.mean() + TINY)).astype(np.float32)


def border_axis(outward: tuple[float, float]) -> int | None:
    """The axis of an array along which the picture's border runs at a side; None at a corner."""
    right, down = (abs(part) for part in outward)
    if max(right, down) < 2 * min(right, down):
        return None
    return 0 if right > down else 1


def without_border(gray: np.ndarray, side: int, along: int | None) -> Gray:
    """What a window shows besides a straight border: all of it would be like any other part of it.

    Args:
        gray: The window, or a template.
        side: Pixels a side of the template.
        along: The axis along which the border runs; None takes away what is even all around.
    """
    box = (side, side) if along is None else ((side, 1) if along == 1 else (1, side))
    mean = cv2.blur(gray, box, borderType=cv2.BORDER_REFLECT)
    return (gray - mean).astype(np.float32)


def _approached(
    start: tuple[float, float],
    limit_px: float,
    step: Callable[[Shift, bool], Step | Failure],
    converged_px: float,
) -> Step | Failure | None:
    """Place, what is left and likeness where steps have become small; None if they lead away.

    `step` takes a place and whether what is far from the mark still counts.
    """
    place = np.array(start, dtype=np.float64)
    far, taken = True, None
    for _ in range(STEPS):
        taken = step(place, far)
        if isinstance(taken, Failure):
            return taken
        place = place + np.clip(taken[0], -1.0, 1.0)
        if np.linalg.norm(place - np.array(start)) > limit_px:
            return None
        if np.abs(taken[0]).max() < (NEAR_PX if far else converged_px):
            if not far:
                break
            far = False
    assert taken is not None
    return place, *taken[1:]


def blur_as_scanned(field: np.ndarray) -> Weights:
    """A drawn mark, or a window, under the blur with which scans are sampled."""
    return cv2.GaussianBlur(
        field, (2 * SOFT_TAPS + 1, 2 * SOFT_TAPS + 1), SOFT_PX, borderType=cv2.BORDER_REPLICATE
    ).astype(np.float64)


def sample_about(window: Gray, place: Shift, side: int) -> Weights:
    """An odd square of pixels whose middle pixel is centred on a place, softly blurred.

    Blur and shift are one Gaussian laid beside the pixels' middles: exact to 1e-4 of the contrast
    at any fraction of a pixel, where resampling by `cv2.remap` knows only 32 of them.
    """
    kernels = [_gaussian(float(at - 0.5 - np.floor(at))) for at in place]
    patch = square_about(window, place, side + 2 * SOFT_TAPS)
    soft = cv2.sepFilter2D(patch, cv2.CV_64F, kernels[0], kernels[1])
    return np.asarray(soft[SOFT_TAPS:-SOFT_TAPS, SOFT_TAPS:-SOFT_TAPS], dtype=np.float64)


def _gaussian(shift: float) -> Float64[np.ndarray, "taps"]:
    """The blur's weights of a pixel and its neighbours about a place beside the pixel's middle."""
    apart = np.arange(-SOFT_TAPS, SOFT_TAPS + 1) - shift
    weights = np.exp(-0.5 * (apart / SOFT_PX) ** 2)
    return weights / weights.sum()


def square_about(window: Gray, place: Shift, side: int) -> Weights:
    """An odd square of pixels as they are about one, continued where it reaches beyond."""
    (rows, columns), half = window.shape, side // 2
    column, row = np.floor(place).astype(int).tolist()
    inside_c = np.clip(np.arange(column - half, column + half + 1), 0, columns - 1)
    inside_r = np.clip(np.arange(row - half, row + half + 1), 0, rows - 1)
    return window[np.ix_(inside_r, inside_c)].astype(np.float64)


def spline_of(window: Gray) -> Spline:
    """A window as cubic splines, continued evenly: for `gray_between`."""
    padded = np.pad(np.asarray(window, dtype=np.float64), SPLINE_PX, mode="edge")
    return np.asarray(spline_filter(padded, order=3, mode="nearest"))


def gray_between(spline: Spline, columns: Samples, rows: Samples) -> Samples:
    """Grays at places of a window; `cv2.remap` knows only 32 places within a pixel."""
    at = [rows + (SPLINE_PX - 0.5), columns + (SPLINE_PX - 0.5)]
    return map_coordinates(spline, at, order=3, mode="nearest", prefilter=False)


def disc_weights(side: int, radius_px: float) -> Weights:
    """One inside a disc about the middle pixel, falling to nought over two pixels."""
    axis = np.arange(side) - side // 2
    distance = np.hypot(*np.meshgrid(axis, axis))
    return np.clip((radius_px + 1 - distance) / 2, 0.0, 1.0)


def disc(radius_px: float) -> Weights:
    """The weights of a disc in the smallest square that holds it."""
    return disc_weights(2 * int(np.ceil(radius_px)) + 3, radius_px)


def disc_in(template: Weights) -> Weights:
    """The weights of the largest disc in a template."""
    return disc_weights(template.shape[0], template.shape[0] / 2 - 1)


def _solve(
    design: Float64[np.ndarray, "unknowns pixels"],
    right: Float64[np.ndarray, "pixels"],
    weights: Weights,
    contrast: float,
    far_counts: bool,
) -> tuple[Float64[np.ndarray, "unknowns"], Callable[[], Left]]:
    """Weighted least squares, robust; the unknowns, and what is left to judge the first two by.

    Huber's bound on the way, as it never loses the mark; Geman and McClure's in the end. `design`
    and `right` are of the pixels that have a weight.
    """
    chosen = weights > 0
    # On a flawless black background the median is nought: the mark's edges must not be bounded.
    noise = max(robust_sigma(right), NOISE_SHARE * contrast) + TINY
    # Nor is half a pixel's share at an edge dirt: that would leave only the pixels in which the
    # mark happens to have no edge, and the middle would jump from pixel to pixel.
    spread = np.hypot(noise, EDGE_PX * np.hypot(design[0], design[1]))
    if far_counts:
        used = weights[chosen] * np.minimum(1.0, HUBER * spread / np.maximum(np.abs(right), TINY))
    else:
        # A scratch along the mark's edge would still pull: what is far off counts for nothing.
        used = weights[chosen] * cauchy_weights(np.abs(right) / spread, FAR) ** 2
    heavy = design * used
    normal = heavy @ design.T
    if not np.linalg.cond(normal) < 1e14:  # design: float64 leaves two digits
        return np.full(len(design), np.nan), _nothing_left
    inverse = np.linalg.inv(normal)
    solution = inverse @ (heavy @ right)

    def left() -> Left:
        fields = np.zeros((3, *weights.shape))
        residual = (right - solution @ design) * np.sqrt(used)
        fields[:, chosen] = np.vstack([(inverse @ heavy)[:2], residual])
        return Left(fields[:2], fields[2], max(float(used.sum()) - len(design), 1.0))

    return solution, left


def _nothing_left() -> Left:
    return Left(np.zeros((2, 1, 1)), np.zeros((1, 1)), 1.0)


def _lagged(one: Weights, other: Weights, down: int, right: int) -> float:
    """Sum of products of a field with another moved by whole pixels."""
    rows, columns = one.shape
    here = one[: rows - down, max(0, -right) : columns - max(0, right)]
    there = other[down:, max(0, right) : columns - max(0, -right)]
    return float(np.vdot(here, there))


def correlation(first: np.ndarray, second: np.ndarray, weights: np.ndarray) -> float:
    """Weighted correlation coefficient of two fields."""
    a = first - np.average(first, weights=weights)
    b = second - np.average(second, weights=weights)
    power = np.sum(weights * a**2) * np.sum(weights * b**2)
    return float(np.sum(weights * a * b) / np.sqrt(power)) if power > 0 else 0.0
