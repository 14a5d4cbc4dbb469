"""The way down to the least squares minimum: Gauss-Newton, damped where a step does not help."""

from dataclasses import dataclass, replace

import numpy as np

from core.adjustment.linearised import Linearised, linearise
from core.adjustment.network import Network, State
from core.adjustment.reliability import Chosen
from core.adjustment.solver import Increment, Pattern, Weights, normals_of, solve
from core.geometry.robust import huber_costs, huber_weights, robust_sigma
from core.progress import Progress

# design: a thousandth of a standard deviation in all unknowns together.
SETTLED = 1e-6
"""The squared length, in standard deviations, of a step so small that it is the last."""
# design: residuals change by less than a percent of what a test asks.
NEARLY = 1e-4
"""Fall of the robust cost, as a share of it, at which gross errors can be told."""
# design: both coordinates together, 14 % of good rays lie beyond and lose little.
HUBER_LIMIT = 2.0
"""Residuals (both coordinates together) beyond this many sigmas lose weight."""
# design: from what hardly shortens a step to where nothing moves any more.
FIRST_DAMPING, MOST_DAMPING = 1e-4, 1e6


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """How far the adjustment has come."""

    state: State
    """The unknowns."""
    lin: Linearised
    """Residuals and derivatives there."""
    taking_part: Chosen
    """Rays that count."""
    weights: Weights
    """Weights of the rays, 0 for those that do not count."""
    steps: int = 0
    """Steps taken so far."""
    settled: bool = False
    """The last step was small."""

    def cost(self) -> float:
        """Weighted squared residuals of everything."""
        return float(np.sum(self.weights * self.lin.residuals**2)) + self.lin.prior_cost


def begin(network: Network, state: State, placed: Chosen) -> Fit:
    """The first state, without the rays whose points are behind the camera or nowhere."""
    lin = linearise(network, state)
    sound = np.bincount(network.rays.point, placed & ~lin.behind, network.points.count) >= 2
    taking_part = placed & ~lin.behind & (network.anchored | sound[network.rays.point])
    return Fit(state, lin, taking_part, taking_part.astype(np.float64))


def minimise(
    network: Network, pattern: Pattern, fit: Fit, robust: bool, steps: int, progress: Progress
) -> Fit:
    """Steps until one is small, or none helps; robust costs need not settle to the last digit."""
    damping = 0.0
    fit = replace(fit, settled=False)
    for _ in range(steps):
        progress.report(float(fit.steps), float(fit.steps + steps), "adjustment")
        limit = _huber_limit(fit) if robust else np.inf
        fit = replace(fit, weights=_weights(fit.lin, fit.taking_part, limit))
        cost = _cost(fit.lin, fit.taking_part, limit)
        trial, increment = _step(network, pattern, fit, damping)
        if increment is not None and increment.decrement < _enough(cost, robust):
            lin = linearise(network, trial)
            sound = np.isfinite(_cost(lin, fit.taking_part, limit))
            fit = _accepted(fit, trial, lin) if sound else fit
            return replace(fit, settled=True)
        lin = linearise(network, trial)
        if increment is not None and _cost(lin, fit.taking_part, limit) <= cost:
            fit = _accepted(fit, trial, lin)
            damping = damping / 10 if damping > FIRST_DAMPING else 0.0
        else:
            fit = replace(fit, steps=fit.steps + 1)
            damping = max(10 * damping, FIRST_DAMPING)
        if damping > MOST_DAMPING:
            break
    return fit


def _accepted(fit: Fit, state: State, lin: Linearised) -> Fit:
    return replace(fit, state=state, lin=lin, steps=fit.steps + 1)


def _enough(cost: float, robust: bool) -> float:
    return max(SETTLED, NEARLY * cost) if robust else SETTLED


def _step(
    network: Network, pattern: Pattern, fit: Fit, damping: float
) -> tuple[State, Increment | None]:
    """The state after one step; without a step where the normal equations are singular."""
    try:
        normals = normals_of(network, pattern, fit.lin, fit.weights, damping)
    except np.linalg.LinAlgError:
        return fit.state, None
    increment = solve(network, pattern, normals)
    moved = fit.state.moved(
        increment.photos, increment.constants, increment.positioning, increment.points
    )
    return moved, increment


def _lengths(lin: Linearised) -> Weights:
    return np.hypot(lin.residuals[0], lin.residuals[1])


def _huber_limit(fit: Fit) -> float:
    """Wide while the orientations are still off, in the end `HUBER_LIMIT` sigmas."""
    sigma = robust_sigma(fit.lin.residuals[:, fit.taking_part].ravel())
    return HUBER_LIMIT * max(1.0, sigma)


def _weights(lin: Linearised, taking_part: Chosen, limit: float) -> Weights:
    if not np.isfinite(limit):
        return taking_part.astype(np.float64)
    return np.where(taking_part, huber_weights(_lengths(lin), limit), 0.0)


def _cost(lin: Linearised, taking_part: Chosen, limit: float) -> float:
    """Cost of the rays that count, and of the priors; infinite when one is behind its camera."""
    if (lin.behind & taking_part).any():
        return float("inf")
    lengths = _lengths(lin)[taking_part]
    rays = lengths**2 if not np.isfinite(limit) else huber_costs(lengths, limit)
    return float(np.sum(rays)) + lin.prior_cost
