"""An adjusted network: state, cofactors and residuals."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from core.adjustment.adjusted import AdjustmentOptions, ClassFigures
from core.adjustment.gauss_newton import (
    Fit,
    at_state,
    begin,
    initial_state,
    minimise,
    on_the_ground,
)
from core.adjustment.network import SMALLEST_SIGMA_MM, Network
from core.adjustment.reliability import (
    Chosen,
    Precision,
    RayPairs,
    TestLimits,
    cleared_rays,
    gross_errors,
    precision_of,
    standardised_residuals,
)
from core.adjustment.significance import insignificant
from core.adjustment.solver import Normals, Pattern, normals_of, pattern_of
from core.adjustment.weights import (
    OBSERVED,
    Terrain,
    classes_of,
    next_factors,
    observe_terrain,
    reweight,
)
from core.geometry.robust import robust_sigma
from core.progress import Progress

# design: two or three are the rule.
ROUNDS = 8
"""Rounds of leaving out gross errors at most."""
# design: from a minimum nearby one step leads there, another shows that it did.
FINAL_STEPS = 2
"""A round begins only while at least this many steps are left for it."""
# design: hundreds of pixels, beyond what Gauss-Newton with free points comes back from.
ROUGH = 500.0
"""Residuals at the start (in sigmas, their median) from which orientations count as rough."""
# design: it settles in four or five.
APPROACH_STEPS = 8
"""Steps at most with points held on the ground."""
# design: the relief of hilly country, as a share of the flying height.
GROUND_SOFTNESS = 0.05
"""How firmly they are held there, as a share of the flying height."""
# design: far below any information a block has, above rounding.
TINY_DAMPING = 1e-10
"""Makes a datum defect invertible for the standard deviations."""
# design: weights settle in three to five rounds.
CHANGES = 10
"""Rounds of weights, terrain heights and held parameters at most."""
# design: half of what a rough start takes.
CHANGE_STEPS = 15
"""Steps at most after each of them."""
# design: no result changes visibly by a weight two percent off.
SAME_WEIGHT = 0.02
"""A class whose standard deviation is to change by less than this share keeps it."""


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """An adjusted network."""

    network: Network
    """What was adjusted, with the weights of the last round."""
    pattern: Pattern
    """Which rays meet."""
    fit: Fit
    """The last state."""
    normals: Normals
    """The normal equations there."""
    precision: Precision
    """Their cofactors."""
    standardised: RayPairs
    """w of every film coordinate."""
    candidates: Chosen
    """Rays that took part at first."""
    factors: dict[str, float]
    """What the classes' standard deviations were multiplied by."""
    held: tuple[int, ...] = ()
    """Shared unknowns held at nought because they do not stand out."""

    @property
    def classes(self) -> dict[str, ClassFigures]:
        """Figures of every class of observations."""
        found = classes_of(self.network, self.fit, self.precision)
        return {
            name: replace(figures, factor=self.factors.get(name, 1.0))
            for name, figures in found.items()
        }

    @property
    def redundancy(self) -> float:
        """Redundancy of rays and known coordinates: all observations' less that of the priors."""
        classes = self.classes
        observed = sum(classes[name].redundancy for name in OBSERVED if name in classes)
        return observed + 2 * float(self._by_chance.sum())

    @property
    def weighted_squares(self) -> float:
        """Squared residuals of rays and known coordinates over their variances."""
        fit = self.fit
        used = float(np.sum(fit.weights * fit.lin.residuals**2) + np.sum(fit.lin.ground**2))
        return used + float(np.sum(self.standardised[:, self._by_chance] ** 2))

    @property
    def sigma_nought(self) -> float:
        """From rays and known coordinates; weak priors would only dilute it. NaN without any.

        Rays left out that chance may have brought beyond the limit, so many rays being tested,
        count with what they contradict the others by: without them sigma nought would be too small.
        """
        redundancy = self.redundancy
        return float(np.sqrt(self.weighted_squares / redundancy)) if redundancy > 0.5 else np.nan

    @property
    def _by_chance(self) -> Chosen:
        """Rays left out that are no surer gross errors than the largest of as many good ones."""
        rays, used = self.network.rays, self.fit.taking_part
        alive = np.bincount(rays.point[used], minlength=self.network.points.count) >= 2
        lost = self.candidates & ~used & alive[rays.point]
        tested = max(2 * int(self.candidates.sum()), 1)
        # design: five in a hundred blocks have one good ray beyond it.
        largest = float(ndtri(1 - 0.05 / (2 * tested)))
        return lost & (self.standardised.max(axis=0) < largest)


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """What stays the same while a block is adjusted."""

    pattern: Pattern
    options: AdjustmentOptions
    terrain: Terrain | None
    progress: Progress


def solve_network(
    network: Network, options: AdjustmentOptions, terrain: Terrain | None, progress: Progress
) -> Solution:
    """Robust first, then plain least squares without the gross errors, then weights and terrain.

    Args:
        network: What is adjusted.
        options: Weights and tests.
        terrain: Heights of the ground as observations of tie points; None for none.
        progress: Told of every step; may raise `Cancelled`.
    """
    task = _Task(pattern_of(network), options, terrain, progress)
    fit = _start(network, task)
    begun = fit
    if options.robust:
        steps = max(options.max_iterations - 3 * FINAL_STEPS - begun.steps, 1)
        fit = minimise(network, task.pattern, fit, True, steps=steps, progress=progress)
        judged = _judge(network, task, fit, begun.taking_part)
        fit = _with_rays(network, fit, _keep_rays(judged, task, begun.taking_part))
    left = options.max_iterations - fit.steps
    fit = minimise(network, task.pattern, fit, False, steps=left, progress=progress)
    solution = _snoop(_judge(network, task, fit, begun.taking_part), task)
    return _settle(solution, task)


def solve_again(
    network: Network, fit: Fit, options: AdjustmentOptions, progress: Progress
) -> Solution:
    """Plain least squares with given rays from a state that is nearly the minimum."""
    task = _Task(pattern_of(network), options, None, progress)
    fit = minimise(
        network, task.pattern, fit, False, steps=options.max_iterations, progress=progress
    )
    return _judge(network, task, fit, fit.taking_part)


def _start(network: Network, task: _Task) -> Fit:
    """The present orientations; where they are rough, improved with points held on the ground."""
    start = begin(network, *initial_state(network))
    if robust_sigma(start.lin.residuals[:, start.taking_part].ravel()) < ROUGH:
        return start
    soft, state = on_the_ground(network, GROUND_SOFTNESS)
    laid = begin(soft, state, np.ones(len(network.rays.photo), dtype=np.bool_))
    steps = min(APPROACH_STEPS, task.options.max_iterations // 2)
    better = minimise(soft, task.pattern, laid, True, steps=steps, progress=task.progress)
    again = begin(network, *at_state(network, better.state))
    return replace(again, steps=better.steps)


def _judge(network: Network, task: _Task, fit: Fit, candidates: Chosen) -> Solution:
    """Cofactors and standardised residuals at the fit's state."""
    try:
        normals = normals_of(network, task.pattern, fit.lin, fit.weights, damping=0.0)
    except np.linalg.LinAlgError:
        normals = normals_of(network, task.pattern, fit.lin, fit.weights, damping=TINY_DAMPING)
    precision = precision_of(network, task.pattern, fit.lin, normals)
    standardised = standardised_residuals(fit.lin, precision, fit.weights)
    return Solution(network, task.pattern, fit, normals, precision, standardised, candidates, {})


def _keep_rays(judged: Solution, task: _Task, candidates: Chosen) -> Chosen:
    """Rays without those the others contradict, with those they no longer do."""
    network, fit, standardised = judged.network, judged.fit, judged.standardised
    limits = TestLimits.of(task.options.test, task.options.risk, judged.redundancy)
    gross = gross_errors(
        network, fit.lin, judged.precision, standardised, taking_part=fit.taking_part, limits=limits
    )
    back = cleared_rays(
        network,
        fit.lin,
        judged.precision,
        standardised,
        taking_part=fit.taking_part,
        candidates=candidates,
        limits=limits,
    )
    return (fit.taking_part & ~gross) | back


def _with_rays(network: Network, fit: Fit, taking_part: Chosen) -> Fit:
    """The fit with other rays; tie points left with one ray lose that too."""
    rays = network.rays
    alive = np.bincount(rays.point, taking_part, network.points.count) >= 2
    taking_part = taking_part & (network.anchored | alive[rays.point]) & ~fit.lin.behind
    return replace(fit, taking_part=taking_part, weights=taking_part.astype(np.float64))


def _snoop(judged: Solution, task: _Task) -> Solution:
    """Data snooping: leave out the worst, adjust, look again; a ray comes back once at most."""
    if not task.options.robust:
        return judged
    first = judged.candidates
    candidates = first
    for _ in range(ROUNDS):
        network, fit = judged.network, judged.fit
        changed = _with_rays(network, fit, _keep_rays(judged, task, candidates))
        left = task.options.max_iterations - fit.steps
        if np.array_equal(changed.taking_part, fit.taking_part) or left < FINAL_STEPS:
            break
        candidates = candidates & ~(changed.taking_part & ~fit.taking_part)
        fit = minimise(network, task.pattern, changed, False, steps=left, progress=task.progress)
        judged = replace(_judge(network, task, fit, first), factors=judged.factors)
    return judged


def _settle(solution: Solution, task: _Task) -> Solution:
    """Change weights, terrain heights and held parameters until nothing is left to change."""
    for _ in range(CHANGES):
        changed = _change_network(solution, task)
        if changed is None:
            break
        # Each change has steps of its own.
        most = solution.fit.steps + CHANGE_STEPS
        task = replace(task, options=replace(task.options, max_iterations=most))
        network = changed.network
        start = begin(network, solution.fit.state, solution.fit.taking_part)
        start = replace(start, steps=solution.fit.steps)
        fit = minimise(
            network, task.pattern, start, False, steps=CHANGE_STEPS, progress=task.progress
        )
        judged = _judge(network, task, fit, solution.candidates)
        judged = replace(judged, factors=changed.factors)
        solution = replace(_snoop(judged, task), held=changed.held)
    return solution


def _change_network(solution: Solution, task: _Task) -> Solution | None:
    """The solution with another network to adjust; None when it can stay as it is."""
    network, factors, held = solution.network, solution.factors, solution.held
    options, same = task.options, True
    if task.terrain is not None and options.dem_sigma_m > 0:
        sigma = options.dem_sigma_m * factors.get("dem", 1.0)
        laid = observe_terrain(network, solution.fit, task.terrain, sigma)
        new, old = laid.points, network.points
        moved = np.abs(new.known - old.known) * np.minimum(new.known_weight, 1 / sigma)
        changed = np.abs(new.known_weight - old.known_weight) * sigma
        ties = len(new.tie)
        # design: a twentieth of a standard deviation changes no result.
        same = bool((moved[:ties] < 0.05).all() and (changed[:ties] < SAME_WEIGHT).all())
        network = network if same else laid
    if options.variance_components:
        more = next_factors(solution.classes)
        if any(abs(factor - 1) > SAME_WEIGHT for factor in more.values()):
            network, same = reweight(network, more), False
            names = factors.keys() | more.keys()
            factors = {n: factors.get(n, 1.0) * more.get(n, 1.0) for n in names}
    if same and options.only_significant and network.additional.names and network.lensed:
        drop = insignificant(network, solution.fit.state, solution.precision, held)
        if drop:
            network, same, held = with_held(network, drop), False, (*held, *drop)
    return None if same else replace(solution, network=network, factors=factors, held=held)


def with_held(network: Network, unknowns: tuple[int, ...]) -> Network:
    """The network with some additional parameters held at nought."""
    weights = network.priors.constant_weights.copy()
    for unknown in unknowns:
        if unknown >= network.lensed:
            continue
        camera, row = divmod(unknown, network.lens)
        weights[camera, row] = 1 / SMALLEST_SIGMA_MM
    return replace(network, priors=replace(network.priors, constant_weights=weights))
