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

Gray = Float32[np.ndarray, "rows columns"]
Weights = Float64[np.ndarray, "side side"]
Shift = Float64[np.ndarray, "2"]
STEPS = 20
FAR = 3.0
"""Residual, in spreads, at which half of a pixel's influence is gone."""
CONVERGED_PX = 1e-3
NEAR_PX = 0.05
"""Step from which what is far from the drawn mark no longer counts, pixels."""
NOISE_SHARE = 0.2
"""Noise that is always reckoned with, as a share of the contrast of the mark."""
SOFT_PX = 0.7
"""Blur (Gaussian sigma) of both fields before they are compared, pixels: a sharp line is less wide
than resampling can follow, and its middle would be drawn to the middles of pixels."""
EDGE_PX = 0.25
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


def match_mark(
    window: Gray, template: Weights, weights: Weights, start: tuple[float, float], limit_px: float
) -> Centre | Failure:
    """Least squares matching of a drawn mark: shift, gain and offset.

    Args:
        window: Part of the scan, without NaN.
        template: The drawn mark; its middle is the middle of its middle pixel.
        weights: Weight of each template pixel.
        start: Approximate middle (column, row) in the window, pixels.
        limit_px: How far from the start the middle may be.
    """
    window, template = softened(window), softened(template)
    slope_c, slope_r = np.gradient(template, axis=1), np.gradient(template, axis=0)
    place = np.array(start, dtype=np.float64)
    state = (1.0, 0.0, 0.0, 0.0)
    far = True
    for _ in range(STEPS):
        patch = sample_about(window, place, template.shape[0])
        gain, step, sigma, alike = _shift_and_gain(patch, template, slope_c, slope_r, weights, far)
        if not np.isfinite(step).all() or abs(gain) < 1e-9:
            return Failure("The window holds nothing like the mark.")
        place = place + np.clip(step, -1.0, 1.0)
        state = (gain, sigma, alike, float(np.abs(step).max()))
        if np.linalg.norm(place - np.array(start)) > limit_px:
            return Failure("Matching the drawn mark drifted away from it.")
        if state[3] < (CONVERGED_PX if not far else NEAR_PX):
            if not far:
                break
            far = False
    return Centre(float(place[0]), float(place[1]), state[1], state[2])


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
    window = softened(window)
    place = np.array(start, dtype=np.float64)
    sigma = alike = 0.0
    far = True
    for _ in range(STEPS):
        patch = sample_about(window, place, weights.shape[0])
        turned = patch[::-1, ::-1]
        # With the middle at d: patch = f(u - d), turned = f(u + d), their difference d times
        # the sum of their slopes.
        slope_c = np.gradient(patch, axis=1) + np.gradient(turned, axis=1)
        slope_r = np.gradient(patch, axis=0) + np.gradient(turned, axis=0)
        step, sigma = _solve(
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
    return Centre(float(place[0]), float(place[1]), sigma, alike)


def softened(field: np.ndarray) -> np.ndarray:
    """A field under the blur in which middles are looked for."""
    return np.asarray(cv2.GaussianBlur(field, (0, 0), SOFT_PX, borderType=cv2.BORDER_REPLICATE))


def sample_about(window: Gray, place: Shift, side: int) -> Weights:
    """An odd square of pixels whose middle pixel is centred on a place (cubic resampling)."""
    half = side // 2
    columns = (np.arange(side) - half + place[0] - 0.5).astype(np.float32)
    rows = (np.arange(side) - half + place[1] - 0.5).astype(np.float32)
    map_c, map_r = np.meshgrid(columns, rows)
    patch = cv2.remap(window, map_c, map_r, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return patch.astype(np.float64)


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
) -> tuple[float, Shift, float, float]:
    """One step of patch = gain * template(shifted) + offset."""
    mean_t = float(np.average(template, weights=weights))
    mean_p = float(np.average(patch, weights=weights))
    centred, wanted = template - mean_t, patch - mean_p
    gain = float(np.sum(weights * centred * wanted) / np.sum(weights * centred**2))
    alike = correlation(patch, template, weights)
    # A mark that lies further right than assumed makes the patch look shifted right:
    # patch(u) = gain * template(u - step), hence minus the slope.
    columns = np.stack([-gain * slope_c, -gain * slope_r, centred, np.ones_like(template)], axis=-1)
    solution, sigma = _solve(
        columns, wanted - gain * centred, weights, float(patch.std()), far_counts
    )
    return gain, solution[:2], sigma, alike


def _solve(
    columns: Float64[np.ndarray, "side side unknowns"],
    wanted: Weights,
    weights: Weights,
    contrast: float,
    far_counts: bool,
) -> tuple[Float64[np.ndarray, "unknowns"], float]:
    """Weighted least squares, robust; the unknowns and the sigma of the first two.

    Huber's bound on the way, as it never loses the mark; Geman and McClure's in the end.
    """
    chosen = weights > 0
    design, right, base = columns[chosen], wanted[chosen], weights[chosen]
    # On a flawless black background the median is nought: the mark's edges must not be bounded.
    noise = max(1.4826 * float(np.median(np.abs(right))), NOISE_SHARE * contrast) + 1e-6
    # Nor is half a pixel's share at an edge dirt: that would leave only the pixels in which the
    # mark happens to have no edge, and the middle would jump from pixel to pixel.
    spread = np.hypot(noise, EDGE_PX * np.hypot(design[:, 0], design[:, 1]))
    if far_counts:
        used = base * np.minimum(1.0, 2.5 * spread / np.maximum(np.abs(right), 1e-12))
    else:
        # A scratch along the mark's edge would still pull: what is far off counts for nothing.
        used = base / (1 + (right / (FAR * spread)) ** 2) ** 2
    normal = (design * used[:, None]).T @ design
    if np.linalg.cond(normal) > 1e14:
        return np.full(design.shape[1], np.nan), float("nan")
    solution = np.linalg.solve(normal, (design * used[:, None]).T @ right)
    residual = right - design @ solution
    freedom = max(float(used.sum()) - design.shape[1], 1.0)
    variance = float(np.sum(used * residual**2)) / freedom
    cofactor = np.linalg.inv(normal)[:2, :2]
    return solution, float(np.sqrt(variance * np.trace(cofactor) / 2))


def correlation(first: Weights, second: Weights, weights: Weights) -> float:
    """Weighted correlation coefficient of two fields."""
    a = first - np.average(first, weights=weights)
    b = second - np.average(second, weights=weights)
    power = np.sum(weights * a**2) * np.sum(weights * b**2)
    return float(np.sum(weights * a * b) / np.sqrt(power)) if power > 0 else 0.0
