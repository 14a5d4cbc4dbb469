"""Robust estimation: weights and scales that gross errors do not dominate."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from jaxtyping import Num

from core.arrays import Scalars

Solution = TypeVar("Solution")

# source: 1 / the 0.75 quantile of the normal distribution, as in scipy.stats.median_abs_deviation.
MAD_TO_SIGMA = 1.482602218505602
"""Median absolute deviation to standard deviation, for normal residuals."""
SMALLEST_SHARE = 1e-9  # design: far above rounding, far below any measurement.
"""The least scale of residuals, as a share of the largest: an exact fit has none."""
TINY = 1e-12  # design: only keeps a division from failing.
"""The least scale where all residuals are nought."""
# source: 95 % efficiency on normal errors (Holland and Welsch 1977, table 1)
CAUCHY_LIMIT = 2.385
"""Usual limit of `cauchy_weights`, standard deviations."""
SETTLED = 1e-7  # design: a solution changes less than its weights do.
"""Relative change of weights that is no more."""


def robust_sigma(residuals: Num[np.ndarray, "..."]) -> float:
    """Standard deviation of finite residuals about nought by their median; 0 where none is."""
    sound = np.abs(residuals[np.isfinite(residuals)])
    return MAD_TO_SIGMA * float(np.median(sound)) if sound.size else 0.0


def nmad(values: Scalars) -> float:
    """Normalised median absolute deviation: a robust standard deviation about the median."""
    return robust_sigma(values - np.median(values))


def huber_weights(standardised: Scalars, limit: float) -> Scalars:
    """Weight 1 up to the limit, falling with the residual's length beyond it (Huber)."""
    return limit / np.maximum(standardised, limit)


def huber_costs(standardised: Scalars, limit: float) -> Scalars:
    """The cost that `huber_weights` minimises: squared inside the limit, linear outside."""
    inside = np.minimum(standardised, limit)
    return inside * (2 * standardised - inside)


def cauchy_weights(standardised: Scalars, limit: float) -> Scalars:
    """Half the weight at the limit, falling with the residual's square beyond it (Cauchy)."""
    return 1 / (1 + (standardised / limit) ** 2)


def solve_robustly(
    solve: Callable[[Scalars], tuple[Solution, Scalars]],
    lengths: Scalars,
    weigh: Callable[[Scalars], Scalars],
    *,
    passes: int,
    least_scale: float = 0.0,
) -> Solution:
    """A least squares solution in which residuals far beyond the others' scale lose weight.

    Args:
        solve: The solution with given weights, and the length of each residual there.
        lengths: Lengths of the residuals to begin with; all alike where none are known.
        weigh: Weights by residual over scale, such as `huber_weights` with a limit.
        passes: Solutions at most.
        least_scale: Residuals have at least this standard deviation.
    """
    weights: Scalars | None = None
    while True:
        least = max(least_scale, SMALLEST_SHARE * float(np.max(lengths, initial=0.0)), TINY)
        scale = max(robust_sigma(lengths), least)
        before, weights = weights, weigh(lengths / scale) / scale**2
        solution, lengths = solve(weights)
        passes -= 1
        if passes < 1 or (before is not None and np.allclose(before, weights, SETTLED, 0)):
            return solution


def log10_nfa(candidates: int, agreeing: int, sample: int, chance: float) -> float:
    """log10 of the number of false alarms: how often chance would give such an agreement.

    log NFA = log(N - m) + log C(N, k) + log C(k, m) + (k - m) log alpha (METHODS 5.2; Moisan and
    Stival 2004). Nought where no more agree than a sample has.

    Args:
        candidates: N, all of them.
        agreeing: k, those that agree with the model, its sample among them.
        sample: m, so many determine a model.
        chance: alpha, probability that a wrong one agrees.
    """
    if agreeing <= sample:
        return 0.0
    return float(
        np.log10(max(candidates - sample, 1))
        + _log10_binomial(candidates, agreeing)
        + _log10_binomial(agreeing, sample)
        + (agreeing - sample) * np.log10(chance)
    )


def _log10_binomial(total: int, chosen: int) -> float:
    """log10 of the number of ways to choose."""
    steps = np.arange(1, chosen + 1, dtype=np.float64)
    return float(np.sum(np.log10((total - chosen + steps) / steps)))
