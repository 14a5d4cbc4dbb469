"""The middle of a mark to a fraction of a pixel, in two independent ways.

Matching compares the scan with the drawn mark; symmetry compares the scan with itself turned by
half a circle and knows nothing of the mark's kind. Both solve for a shift by least squares with the
influence of dirt and scratches bounded.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, Float64

from core.doubts import Failure
from core.geometry.robust import robust_sigma

Gray = Float32[np.ndarray, "rows columns"]
Weights = Float64[np.ndarray, "side side"]
Shift = Float64[np.ndarray, "2"]
STEPS = 20
FAR = 3.0
"""Residual, in spreads, at which half of a pixel's influence is gone."""
CONVERGED_PX = 1e-3
ROUGH_PX = 5e-3
"""Last step that suffices where the mark's likeness is wanted, not its middle, pixels."""
NEAR_PX = 0.05
"""Step from which what is far from the drawn mark no longer counts, pixels."""
NOISE_SHARE = 0.08
"""Noise that is always reckoned with, as a share of the contrast of the mark."""
LAGS = 3
"""How far apart pixels are whose noise is taken to be correlated."""
LOCAL_PX = 3
"""Half width of the surroundings that tell how noisy a pixel is."""
SOFT_TAPS = 4
SOFT_PX = 0.7
"""Blur (Gaussian sigma) of both fields before they are compared, pixels: a sharp line is less wide
than resampling can follow, and its middle would be drawn to the middles of pixels."""
EDGE_PX = 0.15
"""How far a drawn edge may lie beside the scan's before it counts as dirt, pixels: the shape of a
real mark is not quite the drawn one's."""


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
        even = self.residual / np.maximum(local, 1e-9)
        power = float(np.sum(even**2)) + 1e-12
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
        least = 0.25 * float(np.sum(first**2) + np.sum(second**2))
        if np.linalg.eigvalsh(total)[0] <= 0 or np.trace(total) < least:
            total = np.eye(2) * max(float(np.trace(total)), least) / 2
        return total * float(np.count_nonzero(self.residual)) / self.freedom


def _spread_about(residual: Weights) -> Weights:
    """Root mean square of the residuals about each pixel; 0 where none is near."""
    around = (2 * LOCAL_PX + 1,) * 2
    count = cv2.blur((residual != 0).astype(np.float64), around)
    mean = np.maximum(cv2.blur(residual**2, around), 0.0) / np.maximum(count, 1e-9)
    return np.asarray(np.sqrt(mean), dtype=np.float64)


def match_mark(
    window: Gray,
    template: Weights,
    weights: Weights,
    start: tuple[float, float],
    limit_px: float,
    judged: bool = True,
) -> Centre | Failure:
    """Least squares matching of a drawn mark: shift, gain and offset.

    Args:
        window: Part of the scan, without NaN.
        template: The drawn mark; its middle is the middle of its middle pixel.
        weights: Weight of each template pixel.
        start: Approximate middle (column, row) in the window, pixels.
        limit_px: How far from the start the middle may be.
        judged: Whether its sigma is wanted.
    """
    template = softened(template)
    slope_c, slope_r = np.gradient(template, axis=1), np.gradient(template, axis=0)
    place = np.array(start, dtype=np.float64)
    state = (0.0, 0.0)
    left: Left | None = None
    far = True
    for _ in range(STEPS):
        patch = sample_about(window, place, template.shape[0])
        gain, step, left, alike = _shift_and_gain(patch, template, slope_c, slope_r, weights, far)
        if not np.isfinite(step).all() or abs(gain) < 1e-9:
            return Failure("The window holds nothing like the mark.")
        place = place + np.clip(step, -1.0, 1.0)
        state = (alike, float(np.abs(step).max()))
        if np.linalg.norm(place - np.array(start)) > limit_px:
            return Failure("Matching the drawn mark drifted away from it.")
        if state[1] < (NEAR_PX if far else CONVERGED_PX if judged else ROUGH_PX):
            if not far:
                break
            far = False
    sigma = left.sigma_px if judged and left else float("nan")
    return Centre(float(place[0]), float(place[1]), sigma, state[0])


def centre_by_symmetry(
    window: Gray, weights: Weights, start: tuple[float, float], limit_px: float
) -> Centre | Failure:
    """The point about which the window looks most like itself after half a turn.

    Args:
        window: Part of the scan, without NaN.
        weights: Weight of each pixel about the middle; itself symmetric.
        start: Approximate middle (column, row) in the window, pixels.
        limit_px: How far from the start the middle may be.
    """
    place = np.array(start, dtype=np.float64)
    alike = 0.0
    left: Left | None = None
    far = True
    for _ in range(STEPS):
        patch = sample_about(window, place, weights.shape[0])
        turned = patch[::-1, ::-1]
        # With the middle at d: patch = f(u - d), turned = f(u + d), their difference d times
        # the sum of their slopes.
        slope_c = np.gradient(patch, axis=1) + np.gradient(turned, axis=1)
        slope_r = np.gradient(patch, axis=0) + np.gradient(turned, axis=0)
        step, left = _solve(
            np.stack([slope_c, slope_r], axis=-1), turned - patch, weights, float(patch.std()), far
        )
        alike = correlation(patch, turned, weights)
        if not np.isfinite(step).all():
            return Failure("The window has no contrast.")
        place = place + np.clip(step, -1.0, 1.0)
        if np.linalg.norm(place - np.array(start)) > limit_px:
            return Failure("The point of symmetry lies elsewhere.")
        if np.abs(step).max() < (CONVERGED_PX if not far else NEAR_PX):
            if not far:
                break
            far = False
    # Every pixel stands against its opposite, which stands against it: half of them are new.
    sigma = float(np.sqrt(2)) * left.sigma_px if left else float("nan")
    return Centre(float(place[0]), float(place[1]), sigma, alike)


def softened(field: np.ndarray) -> Weights:
    """A drawn mark, or a window, under the blur with which scans are sampled."""
    return cv2.GaussianBlur(
        field, (2 * SOFT_TAPS + 1, 2 * SOFT_TAPS + 1), SOFT_PX, borderType=cv2.BORDER_REPLICATE
    ).astype(np.float64)


def sample_about(window: Gray, place: Shift, side: int) -> Weights:
    """An odd square of pixels whose middle pixel is centred on a place, softly blurred.

    Blur and shift are one Gaussian laid beside the pixels' middles: exact to 1e-4 of the contrast
    at any fraction of a pixel, where resampling by `cv2.remap` knows only 32 of them.
    """
    half = side // 2 + SOFT_TAPS
    first = np.floor(place).astype(int) - half
    kernels = [_gaussian(float(at - 0.5 - np.floor(at))) for at in place]
    patch = _part(window, int(first[0]), int(first[1]), 2 * half + 1)
    soft = cv2.sepFilter2D(patch, cv2.CV_64F, kernels[0], kernels[1])
    return np.asarray(soft[SOFT_TAPS:-SOFT_TAPS, SOFT_TAPS:-SOFT_TAPS], dtype=np.float64)


def _gaussian(shift: float) -> Float64[np.ndarray, "taps"]:
    """The blur's weights of a pixel and its neighbours about a place beside the pixel's middle."""
    apart = np.arange(-SOFT_TAPS, SOFT_TAPS + 1) - shift
    weights = np.exp(-0.5 * (apart / SOFT_PX) ** 2)
    return weights / weights.sum()


def _part(window: Gray, column: int, row: int, side: int) -> Float32[np.ndarray, "side side"]:
    """A square of the window, continued by its edge where it reaches beyond."""
    rows, columns = window.shape
    inside_c = np.clip(np.arange(column, column + side), 0, columns - 1)
    inside_r = np.clip(np.arange(row, row + side), 0, rows - 1)
    return window[np.ix_(inside_r, inside_c)]


def disc_weights(side: int, radius_px: float) -> Weights:
    """One inside a disc about the middle pixel, falling to nought over two pixels."""
    axis = np.arange(side) - side // 2
    distance = np.hypot(*np.meshgrid(axis, axis))
    return np.clip((radius_px + 1 - distance) / 2, 0.0, 1.0)


def _shift_and_gain(
    patch: Weights,
    template: Weights,
    slope_c: Weights,
    slope_r: Weights,
    weights: Weights,
    far_counts: bool,
) -> tuple[float, Shift, Left, float]:
    """One step of patch = gain * template(shifted) + offset."""
    mean_t = float(np.average(template, weights=weights))
    mean_p = float(np.average(patch, weights=weights))
    centred, wanted = template - mean_t, patch - mean_p
    gain = float(np.sum(weights * centred * wanted) / np.sum(weights * centred**2))
    alike = correlation(patch, template, weights)
    # A mark that lies further right than assumed makes the patch look shifted right:
    # patch(u) = gain * template(u - step), hence minus the slope.
    columns = np.stack([-gain * slope_c, -gain * slope_r, centred, np.ones_like(template)], axis=-1)
    solution, left = _solve(
        columns, wanted - gain * centred, weights, float(patch.std()), far_counts
    )
    return gain, solution[:2], left, alike


def _solve(
    columns: Float64[np.ndarray, "side side unknowns"],
    wanted: Weights,
    weights: Weights,
    contrast: float,
    far_counts: bool,
) -> tuple[Float64[np.ndarray, "unknowns"], Left]:
    """Weighted least squares, robust; the unknowns, and what is left to judge the first two by.

    Huber's bound on the way, as it never loses the mark; Geman and McClure's in the end.
    """
    chosen = weights > 0
    design, right, base = columns[chosen], wanted[chosen], weights[chosen]
    # On a flawless black background the median is nought: the mark's edges must not be bounded.
    noise = max(robust_sigma(right), NOISE_SHARE * contrast) + 1e-6
    # Nor is half a pixel's share at an edge dirt: that would leave only the pixels in which the
    # mark happens to have no edge, and the middle would jump from pixel to pixel.
    spread = np.hypot(noise, EDGE_PX * np.hypot(design[:, 0], design[:, 1]))
    if far_counts:
        used = base * np.minimum(1.0, 2.5 * spread / np.maximum(np.abs(right), 1e-12))
    else:
        # A scratch along the mark's edge would still pull: what is far off counts for nothing.
        used = base / (1 + (right / (FAR * spread)) ** 2) ** 2
    heavy = design * used[:, None]
    normal = heavy.T @ design
    fields = np.zeros((3, *weights.shape))
    if np.linalg.cond(normal) > 1e14:
        return np.full(design.shape[1], np.nan), Left(fields[:2], fields[2], 1.0)
    inverse = np.linalg.inv(normal)
    solution = inverse @ (heavy.T @ right)
    residual = (right - design @ solution) * np.sqrt(used)
    fields[:, chosen] = np.vstack([(inverse @ heavy.T)[:2], residual])
    freedom = max(float(used.sum()) - design.shape[1], 1.0)
    return solution, Left(fields[:2], fields[2], freedom)


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
