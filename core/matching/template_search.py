"""Correlation of a template with a window: similarity at every place where the template fits.

All correlation of the engine is done here, by OpenCV; only camera marks have their own in
`core/scans`. `core/matching/operators.py` says which layers are correlated.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float32

from core.matching.peaks import ScoreMap

Image = Float32[np.ndarray, "rows columns"]
Field = Float32[np.ndarray, "rows columns 2"]
Template = Float32[np.ndarray, "template_rows template_columns"]
TemplateField = Float32[np.ndarray, "template_rows template_columns 2"]
Description = tuple[Float32[np.ndarray, "..."], ...]
"""What an operator compares of an image: layers (rows, columns) or (rows, columns, channels)."""


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
