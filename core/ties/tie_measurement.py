"""Measure tie points on the raw scans, with standard deviations scaled by y-parallaxes."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np
from jaxtyping import Bool
from scipy.spatial import KDTree

from core.arrays import Flags, PixelPoints, Scalars
from core.block import Block, TiePoints
from core.geometry.relative import MINIMAL, RelativeOrientation, adjust_relative
from core.geometry.robust import robust_sigma
from core.progress import Progress
from core.ties.chains import PairKey, common_rays, pair_parallax, rays_of_pair
from core.ties.fine_matching import FineRays, GivenTies, match_to_fixed
from core.ties.matches import RELATIVE

KEPT = 0.95  # design: one match in twenty may be wrong; so many should be more than there are
"""Share of squared parallaxes that say how well matches are measured, the smallest ones."""
_BOUND = NormalDist().inv_cdf((1 + KEPT) / 2)
# source: second moment of a normal distribution cut off where KEPT of it lies within
TRIMMED = 1 - 2 * _BOUND * NormalDist().pdf(_BOUND) / KEPT
"""Mean square of the smallest KEPT of a normal distribution, over its variance."""
NEIGHBOURS = 8  # design: they reach over an eighth of a photo with the ties of a common pair
"""So many places about a parallax say what lens and film do there."""
# source: variance of the median of eight normal values over that of one, by numerical integration
MEDIAN_VARIANCE = 0.1682
"""Variance of the median of `NEIGHBOURS` values over that of one."""
CLASSES = 10  # design: a line through ten means, each of twenty parallaxes or more
"""Classes of formal variance in which variances are compared with parallaxes."""
LEAST_IN_CLASS = 20  # design: their mean square is known to a third
"""Fewer parallaxes than this in each class, and all are one class."""
# source: the tail of a normal distribution beyond is one in 15,000, some thousand rays are judged
MOST_PARALLAX_SIGMAS = 4.0
"""A ray goes when its y-parallax exceeds this many of its own standard deviations ..."""
MOST_PARALLAX_PX = RELATIVE.tolerance_px
"""... or this many pixels of the reduced scan, as when it was matched."""
LEAST_SIGMA_PX = 0.005  # design: numerical safety; no ray outweighs hundreds of usual ones
"""No ray is believed better than this, scan pixels."""
ENOUGH_FAILED = 10  # design: their median deviation is known to a third
"""So many rays that could not be measured finely tell how good such rays are."""
TINY = 1e-12  # design: numerical safety; a millionth of a pixel, squared


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredTies:
    """Tie points after fine measurement."""

    ties: TiePoints
    """All rays, with new pixels and standard deviations."""
    good: Bool[np.ndarray, "rays"]
    """Rays that may stay."""
    coarse: Bool[np.ndarray, "points"]
    """Points whose fine measurement failed: they rest on their features alone."""


def measure_ties(given: GivenTies, progress: Progress) -> MeasuredTies:
    """Measure every ray finely and say how well.

    In each point one ray is fixed and the others are matched to it. A match's variance is a
    power of the formal one times a factor; both are found from the y-parallaxes of all pairs, each
    against its neighbours': lens and film bend them alike, and are the adjustment's to model. The
    variance is shared equally between the two rays of the match.
    """
    block, ties = given.block, given.ties
    fine = match_to_fixed(given, progress)
    measured = replace(ties, pixels=fine.pixels)
    orientations = {
        pair: _adjust_pair(block, measured, pair, known.orientation, fine=fine)
        for pair, known in given.pairs.items()
    }
    squares, formal, coarse = _observed_variances(block, measured, orientations, fine)
    if not np.isfinite(coarse):
        # Places that could not be measured finely are worse than features commonly are.
        common = [known.parallax_rms_px for known in given.pairs.values()]
        coarse = 2.0 * float(np.median(common or [0.5]))
    sigma = _sigmas(ties, fine, fit_variance_law(squares, formal), coarse)
    measured = replace(measured, sigma_px=sigma)
    failed = np.bincount(ties.point[fine.fixed >= 0], minlength=ties.count) < 2
    # Where matching worked for some rays of a point, those it failed for are not worth keeping.
    good = _agreeing_rays(replace(given, ties=measured), orientations, fine)
    return MeasuredTies(measured, good & ((fine.fixed >= 0) | failed[ties.point]), failed)


def _adjust_pair(
    block: Block, ties: TiePoints, pair: PairKey, start: RelativeOrientation, *, fine: FineRays
) -> RelativeOrientation:
    """The pair's relative orientation from its fine rays, where there are enough of them."""
    first, second = pair
    ours, theirs = common_rays(ties, ties.photo_ids.index(first), ties.photo_ids.index(second))
    good = (fine.fixed[ours] >= 0) & (fine.fixed[theirs] >= 0)
    # As many parallaxes beyond the unknowns as there are unknowns, and one each to spare.
    if good.sum() < 2 * (MINIMAL + 1):
        return start
    rays = rays_of_pair(block, ties, pair, ours=ours[good], theirs=theirs[good])
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
        if direct.sum() > NEIGHBOURS:
            own = against_neighbours(ties.pixels[ours[direct]], residual[direct])
            squares.append(2 * own**2 / (1 + MEDIAN_VARIANCE))
            formal.append(np.maximum(fine.formal[ours], fine.formal[theirs])[direct] ** 2)
        failed = ((fine.fixed[theirs] < 0) | (fine.fixed[ours] < 0)) & seen
        coarse.append(np.abs(residual[failed]))
    rough = np.concatenate(coarse)
    sigma = robust_sigma(rough) if len(rough) >= ENOUGH_FAILED else float("nan")
    return np.concatenate(squares), np.concatenate(formal), sigma


def against_neighbours(pixels: PixelPoints, values: Scalars) -> Scalars:
    """Each value less the median of its nearest neighbours': what changes slowly goes.

    Args:
        pixels: Where the values stand, more than `NEIGHBOURS` places.
        values: One for each place.
    """
    _, near = KDTree(pixels).query(pixels, k=NEIGHBOURS + 1)
    return values - np.median(values[np.atleast_2d(near)[:, 1:]], axis=1)


def fit_variance_law(squares: Scalars, formal: Scalars) -> tuple[float, float]:
    """Factor and exponent of variance = factor * formal ** exponent, exponent between 0 and 2.

    Fitted to ten classes; the largest twentieth of each is left out, for it holds wrong matches.

    Args:
        squares: Variances seen in parallaxes, square pixels.
        formal: The formal variance of each, square pixels.
    """
    if len(squares) == 0:
        return 1.0, 1.0
    classes = CLASSES if len(squares) >= CLASSES * LEAST_IN_CLASS else 1
    groups = np.array_split(np.argsort(formal, kind="stable"), classes)
    seen = np.log([max(_trimmed_variance(squares[members]), TINY) for members in groups])
    given = np.log([max(float(np.mean(formal[members])), TINY) for members in groups])
    exponent = 1.0
    if classes > 1:
        spread = given - given.mean()
        slope = float(spread @ (seen - seen.mean())) / max(float(spread @ spread), TINY)
        exponent = float(np.clip(slope, 0.0, 2.0))
    return float(np.exp(seen.mean() - exponent * given.mean())), exponent


def _trimmed_variance(squares: Scalars) -> float:
    """Mean square without the largest twentieth, set right for what a normal law would lose."""
    kept = np.sort(squares)[: max(1, int(np.ceil(KEPT * len(squares))))]
    return float(np.mean(kept)) / TRIMMED


def _sigmas(ties: TiePoints, fine: FineRays, law: tuple[float, float], coarse: float) -> Scalars:
    """Standard deviation of every ray: half of a match's variance belongs to each of its rays."""
    matched = (fine.fixed >= 0) & (fine.formal > 0)
    variance = np.maximum(law[0] * fine.formal ** (2 * law[1]), 2 * LEAST_SIGMA_PX**2)
    sigma = np.full(len(ties.point), coarse)
    least = np.full(len(ties.point), np.inf)
    np.minimum.at(least, fine.fixed[matched], variance[matched] / 2)
    fixed = np.isfinite(least)
    sigma[fixed] = np.sqrt(least[fixed])
    sigma[matched] = np.sqrt(variance[matched] - least[fine.fixed[matched]])
    return sigma


def _agreeing_rays(
    given: GivenTies, orientations: Mapping[PairKey, RelativeOrientation], fine: FineRays
) -> Flags:
    """False for rays whose y-parallaxes are too large in the sum over their pairs."""
    block, ties = given.block, given.ties
    count, wrong = np.zeros(len(ties.point)), np.zeros(len(ties.point))
    for pair, orientation in orientations.items():
        ours, theirs, residual = pair_parallax(block, ties, pair, orientation)
        expected = np.sqrt((ties.sigma_px[ours] ** 2 + ties.sigma_px[theirs] ** 2) / 2)
        limit = MOST_PARALLAX_PX * max(given.reductions[name] for name in pair)
        bad = ~(np.abs(residual) <= limit)
        near = np.flatnonzero(~bad)
        own = residual[near]
        if len(near) > NEIGHBOURS:
            own = against_neighbours(ties.pixels[ours[near]], own)
        bad[near] = np.abs(own) > MOST_PARALLAX_SIGMAS * expected[near]
        for rays in (ours, theirs):
            count[rays] += 1
            wrong[rays] += bad
    # A wrong ray disagrees with all its partners, a right one only with the wrong ray.
    worst = np.zeros(ties.count)
    share = wrong / np.maximum(count, 1)
    np.maximum.at(worst, ties.point, share)
    return (share == 0) | ((share < worst[ties.point]) & (fine.fixed >= 0))
