"""Robust weights: what keeps a gross error from pulling the good observations."""

import numpy as np

from core.arrays import Scalars

MAD_TO_SIGMA = 1.4826
"""Median absolute deviation to standard deviation, for normal residuals."""


def huber_weights(standardised: Scalars, limit: float) -> Scalars:
    """Weight 1 up to the limit, falling with the residual's length beyond it (Huber)."""
    return limit / np.maximum(standardised, limit)


def huber_costs(standardised: Scalars, limit: float) -> Scalars:
    """The cost that `huber_weights` minimises: squared inside the limit, linear outside."""
    inside = np.minimum(standardised, limit)
    return inside * (2 * standardised - inside)


def robust_sigma(residuals: Scalars) -> float:
    """Standard deviation of residuals about nought by their median; 0 where there are none."""
    sound = np.abs(residuals[np.isfinite(residuals)])
    return MAD_TO_SIGMA * float(np.median(sound)) if len(sound) else 0.0
