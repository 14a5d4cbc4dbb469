"""Tie points measured finely on the raw scans, with deviations that the y-parallaxes confirm."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool

from core.arrays import Flags, Scalars
from core.block.block import Block, TiePoints
from core.block.ties.chains import PairKey, common_rays, pair_parallax, rays_of_pair
from core.block.ties.fine_matching import FineRays, GivenTies, match_to_fixed
from core.block.ties.refinement import RefinementOptions
from core.geometry.relative import RelativeOrientation, adjust_relative
from core.progress import Progress

ROBUST = 1.4826
"""Standard deviation over median deviation, normal distribution."""
TRIMMED = 0.7588
"""Mean square of the smaller 95 % of a normal distribution, over its variance."""


@dataclass(frozen=True, slots=True)
class MeasurementOptions:
    """How tie points are measured and judged."""

    refinement: RefinementOptions = field(default_factory=RefinementOptions)
    """Least squares matching."""
    max_parallax_sigmas: float = 4.0
    """A ray goes when its y-parallax exceeds this many of its own standard deviations ..."""
    max_parallax_px: float = 2.0
    """... or this many pixels of the reduced scan."""
    floor_px: float = 0.005
    """No ray is believed better than this, scan pixels."""


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredTies:
    """Tie points after fine measurement."""

    ties: TiePoints
    """All rays, with new pixels and standard deviations."""
    good: Bool[np.ndarray, "rays"]
    """Rays that may stay."""
    coarse: Bool[np.ndarray, "points"]
    """Points whose fine measurement failed: they rest on their features alone."""


def measure_ties(given: GivenTies, options: MeasurementOptions, progress: Progress) -> MeasuredTies:
    """Measure every ray finely and say how well.

    In each point one ray is fixed and the others are matched to it. A match's variance is a
    power of the formal one times a factor; both are found from the y-parallaxes of all pairs, so
    that lens and film errors that no stage has modelled yet are in the figure too. It is shared
    equally between the two rays of the match.
    """
    block, ties = given.block, given.ties
    refinement = options.refinement.at_reduction(max(given.reductions.values(), default=1))
    fine = match_to_fixed(given, refinement, progress)
    measured = replace(ties, pixels=fine.pixels)
    orientations = {
        pair: _adjusted(block, measured, pair, known.orientation, fine)
        for pair, known in given.pairs.items()
    }
    squares, formal, coarse = _observed_variances(block, measured, orientations, fine)
    if not np.isfinite(coarse):
        # Places that could not be measured finely are worse than features commonly are.
        common = [known.parallax_rms_px for known in given.pairs.values()]
        coarse = 2.0 * float(np.median(common or [0.5]))
    sigma = _sigmas(ties, fine, _variance_law(squares, formal), coarse, options)
    measured = replace(measured, sigma_px=sigma)
    failed = np.bincount(ties.point[fine.fixed >= 0], minlength=ties.count) < 2
    # Where matching worked for some rays of a point, those it failed for are not worth keeping.
    good = _bearable(replace(given, ties=measured), orientations, fine, options)
    return MeasuredTies(measured, good & ((fine.fixed >= 0) | failed[ties.point]), failed)


def _adjusted(
    block: Block, ties: TiePoints, pair: PairKey, start: RelativeOrientation, fine: FineRays
) -> RelativeOrientation:
    """The pair's relative orientation from its fine rays, where there are enough of them."""
    first, second = pair
    ours, theirs = common_rays(ties, ties.photo_ids.index(first), ties.photo_ids.index(second))
    good = (fine.fixed[ours] >= 0) & (fine.fixed[theirs] >= 0)
    if good.sum() < 12:
        return start
    rays = rays_of_pair(block, ties, pair, ours[good], theirs[good])
    return adjust_relative(rays, start, tolerance_px=1.0)


def _observed_variances(
    block: Block,
    ties: TiePoints,
    orientations: Mapping[PairKey, RelativeOrientation],
    fine: FineRays,
) -> tuple[Scalars, Scalars, float]:
    """Squared parallaxes of direct matches as variances, their formal variances, and the coarse.

    Returns:
        Variance of a match (sum of both rays) seen in each parallax; the formal one; and the
        standard deviation of a ray that was not measured finely, pixels.
    """
    squares, formal, coarse = [np.zeros(0)], [np.zeros(0)], [np.zeros(0)]
    for pair, orientation in sorted(orientations.items()):
        ours, theirs, residual = pair_parallax(block, ties, pair, orientation)
        seen = np.isfinite(residual)
        direct = (fine.fixed[theirs] == ours) | (fine.fixed[ours] == theirs)
        direct &= seen
        # Five unknowns per pair were fitted to these very parallaxes.
        freedom = max(int(direct.sum()), 6) / max(int(direct.sum()) - 5, 1)
        squares.append(2 * residual[direct] ** 2 * freedom)
        formal.append(np.maximum(fine.formal[ours], fine.formal[theirs])[direct] ** 2)
        failed = ((fine.fixed[theirs] < 0) | (fine.fixed[ours] < 0)) & seen
        coarse.append(np.abs(residual[failed]))
    rough = np.concatenate(coarse)
    sigma = ROBUST * float(np.median(rough)) if len(rough) >= 10 else float("nan")
    return np.concatenate(squares), np.concatenate(formal), sigma


def _variance_law(squares: Scalars, formal: Scalars) -> tuple[float, float]:
    """Factor and exponent of variance = factor * formal ** exponent, exponent between 0 and 2.

    Fitted to ten classes; the largest twentieth of each is left out, for it holds wrong matches.
    """
    if len(squares) == 0:
        return 1.0, 1.0
    classes = np.array_split(np.argsort(formal, kind="stable"), 10 if len(squares) >= 200 else 1)
    seen = np.log([max(_trimmed_variance(squares[members]), 1e-12) for members in classes])
    given = np.log([max(float(np.mean(formal[members])), 1e-12) for members in classes])
    exponent = 1.0
    if len(classes) > 1:
        spread = given - given.mean()
        slope = float(spread @ (seen - seen.mean())) / max(float(spread @ spread), 1e-9)
        exponent = float(np.clip(slope, 0.0, 2.0))
    return float(np.exp(seen.mean() - exponent * given.mean())), exponent


def _trimmed_variance(squares: Scalars) -> float:
    """Mean square without the largest twentieth, set right for what a normal law would lose."""
    kept = np.sort(squares)[: max(1, int(np.ceil(0.95 * len(squares))))]
    return float(np.mean(kept)) / TRIMMED


def _sigmas(
    ties: TiePoints,
    fine: FineRays,
    law: tuple[float, float],
    coarse: float,
    options: MeasurementOptions,
) -> Scalars:
    """Standard deviation of every ray: half of a match's variance belongs to each of its rays."""
    matched = (fine.fixed >= 0) & (fine.formal > 0)
    variance = np.maximum(law[0] * fine.formal ** (2 * law[1]), 2 * options.floor_px**2)
    sigma = np.full(len(ties.point), coarse)
    least = np.full(len(ties.point), np.inf)
    np.minimum.at(least, fine.fixed[matched], variance[matched] / 2)
    fixed = np.isfinite(least)
    sigma[fixed] = np.sqrt(least[fixed])
    sigma[matched] = np.sqrt(variance[matched] - least[fine.fixed[matched]])
    return sigma


def _bearable(
    given: GivenTies,
    orientations: Mapping[PairKey, RelativeOrientation],
    fine: FineRays,
    options: MeasurementOptions,
) -> Flags:
    """False for rays whose y-parallaxes are too large in the sum over their pairs."""
    block, ties = given.block, given.ties
    count, wrong = np.zeros(len(ties.point)), np.zeros(len(ties.point))
    for pair, orientation in orientations.items():
        ours, theirs, residual = pair_parallax(block, ties, pair, orientation)
        expected = np.sqrt((ties.sigma_px[ours] ** 2 + ties.sigma_px[theirs] ** 2) / 2)
        limit = options.max_parallax_px * max(given.reductions[name] for name in pair)
        limits = np.minimum(options.max_parallax_sigmas * expected, limit)
        bad = np.abs(residual) > limits
        for rays in (ours, theirs):
            count[rays] += 1
            wrong[rays] += bad
    # A wrong ray disagrees with all its partners, a right one only with the wrong ray.
    worst = np.zeros(ties.count)
    share = wrong / np.maximum(count, 1)
    np.maximum.at(worst, ties.point, share)
    return (share == 0) | ((share < worst[ties.point]) & (fine.fixed >= 0))
