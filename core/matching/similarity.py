"""Surfaces of likeness, up to 1, over the displacements of a template, and their peaks.

`ncc_surface` is the normalised cross-correlation, `gradient_surface` correlates doubled gradient
angles, so that a dark road matches a bright one. `core/matching/operators.py` says what
is compared.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, Float64

from core.geometry.robust import robust_sigma

Image = Float32[np.ndarray, "rows columns"]
Field = Float32[np.ndarray, "rows columns 2"]
Template = Float32[np.ndarray, "template_rows template_columns"]
TemplateField = Float32[np.ndarray, "template_rows template_columns 2"]
Neighbours = Float64[np.ndarray, "3 3"]
Surface = Float32[np.ndarray, "shifts_down shifts_right"]
Description = tuple[Float32[np.ndarray, "..."], ...]
"""What an operator compares of an image: layers (rows, columns) or (rows, columns, channels)."""

GRAIN_SIGMA_PX = 0.7
GRADIENT_SIGMA_PX = 1.2
REDUCED_SIGMA_PX = 5.0
"""A wide mean is found on an image so far reduced that it still spans this many pixels."""
FLAT = 1e-6


@dataclass(frozen=True, slots=True)
class SurfacePeak:
    """A maximum of a similarity surface."""

    column: float
    """Displacement index to the right, sub-pixel."""
    row: float
    """Displacement index downwards, sub-pixel."""
    value: float
    """Height of the surface."""
    z: float
    """Height above the surface's median in robust standard deviations."""
    sigma_px: float
    """Standard deviation of the place per axis, from the curvature of the peak, pixels."""


def high_passed(image: Image, sigma_px: float) -> Image:
    """Grey values less their surroundings, with the grain smoothed: a band of detail."""
    fine = cv2.GaussianBlur(image, (0, 0), GRAIN_SIGMA_PX)
    return np.asarray(fine - surroundings(image, sigma_px), dtype=np.float32)


def surroundings(image: Image, sigma_px: float) -> Image:
    """Gaussian mean about every place; where it is wide, found on a reduced image."""
    size = int(sigma_px / REDUCED_SIGMA_PX)
    rows, columns = image.shape
    if size < 2 or min(rows, columns) < 8 * size:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), dtype=np.float32)
    shape = (-(-columns // size), -(-rows // size))
    # Less one of its values, so that rounding leaves a flat image flat.
    level = image[0, 0]
    small = cv2.resize(image - level, shape, interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), sigma_px / size)
    whole = cv2.resize(small, (columns, rows), interpolation=cv2.INTER_LINEAR)
    return np.asarray(whole + level, dtype=np.float32)


def doubled_angle_field(image: Image) -> Field:
    """Gradient direction doubled, weighted from 0 (flat) to 1: z = g^2 / (|g|^2 + tau^2).

    Returns:
        Real and imaginary part of z; tau is the 60th percentile of |g|.
    """
    smooth = cv2.GaussianBlur(image, (0, 0), GRADIENT_SIGMA_PX)
    right = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3)
    down = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3)
    across, along = right * right, down * down
    squared = across + along
    tau_squared = float(np.percentile(squared[::3, ::3], 60)) + FLAT
    squared += np.float32(tau_squared)
    across -= along
    across /= squared
    right *= down
    right *= np.float32(2)
    right /= squared
    return np.asarray(cv2.merge([across, right]), dtype=np.float32)


def ncc_surface(window: Image, template: Template) -> Surface:
    """Normalised cross-correlation of a template at every place within a window."""
    return finite(cv2.matchTemplate(window, template, cv2.TM_CCOEFF_NORMED))


def gradient_surface(window: Field, template: TemplateField) -> Surface:
    """Re sum(conj(z_T) z_S) / sqrt(sum |z_T|^2 sum |z_S|^2) at every place within a window."""
    return finite(cv2.matchTemplate(window, template, cv2.TM_CCORR_NORMED))


def channel_surface(window: Description, template: Description) -> Surface:
    """Correlation of many channels at every place within a window.

    Args:
        window: Channels in groups, then the squared length of each pixel's.
        template: The same of the template.
    """
    product = sum_of_products(window[:-1], template[:-1])
    ones = np.ones(template[-1].shape, np.float32)
    energy = cv2.matchTemplate(window[-1], ones, cv2.TM_CCORR)
    return normalised(product, energy, float(template[-1].sum()))


def sum_of_products(around: Sequence[np.ndarray], patch: Sequence[np.ndarray]) -> Surface:
    """Sum over all channels of the products at every place."""
    first, *others = zip(around, patch, strict=True)
    total = cv2.matchTemplate(*first, cv2.TM_CCORR)
    for one, other in others:
        total += cv2.matchTemplate(one, other, cv2.TM_CCORR)
    return np.asarray(total, dtype=np.float32)


def normalised(product: np.ndarray, energy: np.ndarray, template_energy: float) -> Surface:
    """Products over the geometric mean of both energies; nought where there is none."""
    scale = np.sqrt(np.maximum(energy, 0.0) * template_energy)
    flat = scale < 1e-3 * float(scale.max()) + 1e-9
    return finite(np.where(flat, 0.0, product / np.where(flat, 1.0, scale)).astype(np.float32))


def finite(surface: np.ndarray) -> Surface:
    """Flat places have no correlation: they count as nought."""
    bad = ~np.isfinite(surface) | (np.abs(surface) > 1.0 + 1e-3)
    surface[bad] = 0.0
    return np.asarray(surface, dtype=np.float32)


def detect_peaks(surface: Surface, count: int, separation_px: int) -> tuple[SurfacePeak, ...]:
    """The highest maxima of a surface, no two of them closer than `separation_px`.

    A maximum near the rim is none: the surface may go on rising outside.
    """
    middle = float(np.median(surface))
    spread = robust_sigma(surface - middle) + FLAT
    kernel = np.ones((2 * separation_px + 1, 2 * separation_px + 1), np.uint8)
    maxima = surface >= cv2.dilate(surface, kernel)
    inner = np.zeros_like(maxima)
    rim = min(separation_px, (min(surface.shape) - 1) // 2)
    inner[rim:-rim, rim:-rim] = True
    maxima &= inner
    maxima &= surface > middle + FLAT
    rows, columns = np.nonzero(maxima)
    order = np.argsort(-surface[rows, columns], kind="stable")
    apart: list[tuple[int, int]] = []
    for row, column in zip(rows[order].tolist(), columns[order].tolist(), strict=True):
        # Neighbouring pixels of one flat top are all maxima: the first stands for them.
        if all(max(abs(row - r), abs(column - c)) > separation_px for r, c in apart):
            apart.append((row, column))
        if len(apart) == count:
            break
    return tuple(measure_peak(surface, row, column, middle, spread) for row, column in apart)


def measure_peak(
    surface: Surface, row: int, column: int, middle: float, spread: float
) -> SurfacePeak:
    """Sub-pixel place of a maximum by the paraboloid through its 3 x 3 neighbours' logarithms.

    Likeness falls off as a bell does: a paraboloid through the values themselves would pull narrow
    peaks towards whole pixels (Raffel et al., *Particle Image Velocimetry*, three-point Gaussian
    estimator).

    The standard deviation comes from noise / curvature; the noise of the surface near the peak
    is taken as a share of its spread, because neighbouring values are correlated.
    """
    around = surface[row - 1 : row + 2, column - 1 : column + 2].astype(np.float64)
    curvature = np.linalg.eigvalsh(_slope_and_curvature(around)[1])
    if curvature[1] < -FLAT:
        step = _summit(around, middle)
        sigma = 0.1 * spread / np.sqrt(curvature[0] * curvature[1])
    else:
        step, sigma = np.zeros(2), 3.0
    return SurfacePeak(
        column=column + float(step[0]),
        row=row + float(step[1]),
        value=float(around[1, 1]),
        z=(float(around[1, 1]) - middle) / spread,
        sigma_px=float(np.clip(sigma, 0.2, 3.0)),
    )


def _summit(around: Neighbours, middle: float) -> Float64[np.ndarray, "2"]:
    """Where the peak within 3 x 3 values is, columns and rows from the middle one."""
    above = around - middle
    for values in (np.log(above) if above.min() > 0.05 * above[1, 1] else None, around):
        if values is None:
            continue
        slope, curvature = _slope_and_curvature(values)
        if np.linalg.eigvalsh(curvature)[1] < -FLAT:
            return np.clip(-np.linalg.solve(curvature, slope), -0.6, 0.6)
    return np.zeros(2)


def _slope_and_curvature(
    around: Neighbours,
) -> tuple[Float64[np.ndarray, "2"], Float64[np.ndarray, "2 2"]]:
    """First and second derivatives (column, row) in the middle of 3 x 3 values."""
    slope = np.array([around[1, 2] - around[1, 0], around[2, 1] - around[0, 1]]) / 2
    mixed = (around[2, 2] - around[2, 0] - around[0, 2] + around[0, 0]) / 4
    across = around[1, 2] - 2 * around[1, 1] + around[1, 0]
    down = around[2, 1] - 2 * around[1, 1] + around[0, 1]
    return slope, np.array([[across, mixed], [mixed, down]])
