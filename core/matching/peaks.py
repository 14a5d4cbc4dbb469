"""Peaks of a score map: detected, refined to sub-pixel, with their standard deviation.

All correlation of the engine is done here, by OpenCV; only camera marks have their own in
`core/scans`. `core/matching/operators.py` says which layers are correlated.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, Float64

from core.arrays import Mask
from core.geometry.robust import robust_sigma

Image = Float32[np.ndarray, "rows columns"]
Field = Float32[np.ndarray, "rows columns 2"]
Template = Float32[np.ndarray, "template_rows template_columns"]
TemplateField = Float32[np.ndarray, "template_rows template_columns 2"]
Description = tuple[Float32[np.ndarray, "..."], ...]
"""What an operator compares of an image: layers (rows, columns) or (rows, columns, channels)."""

ScoreMap = Float32[np.ndarray, "shifts_down shifts_right"]
"""How alike a template and a window are, up to 1, by the template's displacement in the window."""
Neighbours = Float64[np.ndarray, "3 3"]
"""A value of a score map and those about it."""
# design: far below the scatter of any score map, far above rounding: it keeps divisions finite.
FLAT = 1e-6


@dataclass(frozen=True, slots=True)
class ScorePeak:
    """A maximum of a score map."""

    column: float
    """Displacement index to the right, sub-pixel."""
    row: float
    """Displacement index downwards, sub-pixel."""
    value: float
    """The score itself."""
    z: float
    """Height above the map's median in robust standard deviations."""
    sigma_px: float
    """Standard deviation of the place per axis, from the curvature of the peak, pixels."""


def detect_peaks(scores: ScoreMap, count: int, separation_px: int) -> tuple[ScorePeak, ...]:
    """The highest maxima of a score map, no two of them closer than `separation_px`.

    A maximum near the rim is none: the scores may go on rising outside.
    """
    middle, spread = level_and_spread(scores)
    maxima = local_maxima(scores, separation_px)
    inner = np.zeros_like(maxima)
    rim = min(separation_px, (min(scores.shape) - 1) // 2)
    inner[rim:-rim, rim:-rim] = True
    maxima &= inner
    maxima &= scores > middle + FLAT
    rows, columns = np.nonzero(maxima)
    order = np.argsort(-scores[rows, columns], kind="stable")
    apart: list[tuple[int, int]] = []
    for row, column in zip(rows[order].tolist(), columns[order].tolist(), strict=True):
        # Neighbouring pixels of one flat top are all maxima: the first stands for them.
        if all(max(abs(row - r), abs(column - c)) > separation_px for r, c in apart):
            apart.append((row, column))
        if len(apart) == count:
            break
    return tuple(measure_peak(scores, row, column, middle, spread) for row, column in apart)


def nearest_peak(scores: ScoreMap, column: float, row: float, reach_px: float) -> ScorePeak | None:
    """The maximum nearest to a place of a score map in robust deviations; None if none is near.

    Args:
        scores: Heights above the median in robust standard deviations.
        column: Displacement index to the right.
        row: Displacement index downwards.
        reach_px: How far from there a maximum may lie, pixels.
    """
    reach = int(np.ceil(reach_px)) + 1
    left, top = round(column) - reach, round(row) - reach
    if min(left, top) < 0:
        return None
    around = np.ascontiguousarray(
        scores[top : top + 2 * reach + 1, left : left + 2 * reach + 1], dtype=np.float32
    )
    rows, columns = np.nonzero(local_maxima(around, 1))
    away = np.hypot(columns + left - column, rows + top - row)
    if len(away) == 0 or away.min() > reach_px:
        return None
    nearest = int(np.argmin(away))
    return measure_peak(scores, top + int(rows[nearest]), left + int(columns[nearest]), 0.0, 1.0)


def highest_places(scores: ScoreMap, count: int, separation_px: int) -> list[tuple[int, int]]:
    """Row and column of the highest scores, each further than `separation_px` from those before.

    Other than peaks they may lie at the rim or on the side of a higher one.
    """
    left = scores.copy()
    places: list[tuple[int, int]] = []
    while len(places) < count:
        row, column = (int(i) for i in np.unravel_index(int(np.argmax(left)), left.shape))
        if np.isneginf(left[row, column]):
            break
        places.append((row, column))
        top, first = max(row - separation_px, 0), max(column - separation_px, 0)
        left[top : row + separation_px + 1, first : column + separation_px + 1] = -np.inf
    return places


def local_maxima(scores: Float32[np.ndarray, "rows columns"], separation_px: int) -> Mask:
    """Where nothing within so many pixels, diagonals included, is higher."""
    kernel = np.ones((2 * separation_px + 1, 2 * separation_px + 1), np.uint8)
    return np.asarray(scores >= cv2.dilate(scores, kernel))


def level_and_spread(scores: Float32[np.ndarray, "..."]) -> tuple[float, float]:
    """Median and robust standard deviation of scores: what heights of peaks are counted in."""
    middle = float(np.median(scores))
    return middle, robust_sigma(scores - middle) + FLAT


def measure_peak(
    scores: ScoreMap, row: int, column: int, middle: float, spread: float
) -> ScorePeak:
    """Sub-pixel place of a maximum by the paraboloid through its 3 x 3 neighbours' logarithms.

    Scores fall off as a bell does: a paraboloid through the values themselves would pull narrow
    peaks towards whole pixels (Raffel et al., *Particle Image Velocimetry*, three-point Gaussian
    estimator).

    The standard deviation comes from noise / curvature; the noise of the scores near the peak
    is taken as a share of their spread, because neighbouring values are correlated.
    """
    around = scores[row - 1 : row + 2, column - 1 : column + 2].astype(np.float64)
    curvature = np.linalg.eigvalsh(_slope_and_curvature(around)[1])
    if curvature[1] < -FLAT:
        step = _summit(around, middle)
        # design: assumed, as prove_peak_sigma shows; control replaces it by what the template
        # leaves unexplained (core/matching/precision.py).
        sigma = 0.1 * spread / np.sqrt(curvature[0] * curvature[1])
    else:
        step, sigma = np.zeros(2), 3.0
    # design: curvature alone never tells a place to better than a fifth of a pixel, and a ridge of
    # three pixels or more is no place.
    return ScorePeak(
        column=column + float(step[0]),
        row=row + float(step[1]),
        value=float(around[1, 1]),
        z=(float(around[1, 1]) - middle) / spread,
        sigma_px=float(np.clip(sigma, 0.2, 3.0)),
    )


def _summit(around: Neighbours, middle: float) -> Float64[np.ndarray, "2"]:
    """Where the peak within 3 x 3 values is, columns and rows from the middle one."""
    above = around - middle
    # design: logarithms of values near nought would rule the fit.
    for values in (np.log(above) if above.min() > 0.05 * above[1, 1] else None, around):
        if values is None:
            continue
        slope, curvature = _slope_and_curvature(values)
        if np.linalg.eigvalsh(curvature)[1] < -FLAT:
            # design: the summit belongs to the highest pixel, half a pixel and a little for noise.
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


def correlation_scores(window: Image, template: Template) -> ScoreMap:
    """Pearson's correlation of grey values; nought where either is flat."""
    if float(np.ptp(template)) == 0:
        # OpenCV calls a flat template perfectly alike to everything.
        shape = np.array(window.shape) - template.shape + 1
        return np.zeros((int(shape[0]), int(shape[1])), np.float32)
    return finite(cv2.matchTemplate(window, template, cv2.TM_CCOEFF_NORMED))


def cosine_scores(window: Field, template: TemplateField) -> ScoreMap:
    """Re sum(conj(z_T) z_S) / sqrt(sum |z_T|^2 sum |z_S|^2) of fields z of vectors."""
    return finite(cv2.matchTemplate(window, template, cv2.TM_CCORR_NORMED))


def channel_scores(window: Description, template: Description) -> ScoreMap:
    """Correlation of many channels.

    Args:
        window: Channels in groups, then the squared length of each pixel's.
        template: The same of the template.
    """
    product = sum_of_products(window[:-1], template[:-1])
    ones = np.ones(template[-1].shape, np.float32)
    energy = sum_of_products(window[-1:], (ones,))
    return normalised(product, energy, float(template[-1].sum()))


def sum_of_products(window: Sequence[np.ndarray], template: Sequence[np.ndarray]) -> ScoreMap:
    """Sum over all layers of the products."""
    first, *others = zip(window, template, strict=True)
    total = cv2.matchTemplate(*first, cv2.TM_CCORR)
    for one, other in others:
        total += cv2.matchTemplate(one, other, cv2.TM_CCORR)
    return np.asarray(total, dtype=np.float32)


def normalised(product: ScoreMap, energy: ScoreMap, template_energy: float) -> ScoreMap:
    """Products over the geometric mean of both energies; nought where there is none."""
    scale = np.sqrt(np.maximum(energy, 0.0) * template_energy)
    # design: a thousandth of the greatest energy is rounding of single precision sums.
    flat = scale < 1e-3 * float(scale.max()) + 1e-9
    return finite(np.where(flat, 0.0, product / np.where(flat, 1.0, scale)).astype(np.float32))


def finite(scores: np.ndarray) -> ScoreMap:
    """Flat places have no correlation: they count as nought."""
    # design: more than one by rounding is none; what is farther off is a division by nearly nought.
    bad = ~np.isfinite(scores) | (np.abs(scores) > 1.0 + 1e-3)
    scores[bad] = 0.0
    return np.asarray(scores, dtype=np.float32)
