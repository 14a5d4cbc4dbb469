"""How probable it is that a candidate is right, told without a single label.

In every search only places near the prediction can be right; all peaks further off, and all peaks
of mirrored templates, are decoys: they say how many peaks of which height chance brings to a square
metre. What the searches hold beyond that near their predictions is due to points that are really
there. So probabilities are those of tracking in clutter (probabilistic data association): with
prior share w of points that can be found, height density f1 of right peaks, density N of their
distance from the prediction, and l0 peaks of chance per square metre and unit of height,

    p_k = w f1(h_k) N(d_k) / l0(h_k) / (1 - w + w sum_j f1(h_j) N(d_j) / l0(h_j)).

N is narrow about the prediction for most points. At some the object itself stands aside of where
the map has it, because rows of trees or verges hide one edge of a road or it was widened: a share
of all right ones is spread by a metre more. w, f1, that share and, within narrow bounds, the width
of N are estimated from the block itself by expectation and maximisation.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from core.arrays import Indices, Scalars, locked

Decoys = Float64[np.ndarray, "decoys"]
"""Heights of peaks that are certainly wrong."""
Table = Float64[np.ndarray, "heights"]
"""One value for each height of GRID."""
# design: four above the 90th percentile, whose mean excess is then known to a half.
LEAST_DECOYS = 40
"""With fewer decoys nothing is known of chance."""
# design: high enough for a tail, low enough to leave decoys in it.
TAIL = 0.9
"""Above this quantile the heights of decoys fall off exponentially."""
# measured: test_probability: with 30 or 120 rounds no probability differs by 0.0001.
ROUNDS = 60
# design: heights in steps of a twentieth of a deviation; those beyond take the values at the ends.
GRID = np.linspace(-2.0, 30.0, 641)
"""Heights at which densities are tabulated."""
# design: a third of a deviation smooths some hundred decoys without blurring their tail.
BANDWIDTH = 0.35
# design: the noise of the map is one deviation by itself, and beyond six right peaks would have any
# height.
HEIGHT_SIGMA = (0.8, 6.0)
"""Least and greatest standard deviation of the heights of right peaks."""
# source: exp(-3 squared / 2) = 0.011 of a normal distribution in the plane lie beyond.
GATE = 3.0
"""Right peaks lie within this many stated standard deviations (99 % of them)."""
# design: stated deviations are right to within a half; beyond, chance peaks would widen them.
WIDER = (0.6, 1.25)
"""Least and greatest factor on the stated standard deviations of distance."""
# design: a verge, a lane or a row of trees is a metre or two wide.
DISPLACED_M = 1.0
"""Standard deviation per axis of how far objects stand aside of where the map has them, metres:
what lies further off than three of them is another object."""
# design: one in five is a guess that the block replaces; most objects of a map are in their place.
DISPLACED_SHARE, MOST_DISPLACED = 0.2, 0.5
"""Share of right ones that stand aside: where a block tells nothing of it, and at most."""
# design: it weighs as four searches, nothing among the hundreds of a block.
PRIOR_COUNT, PRIOR_SHARE = 4.0, 0.25
"""So many searches of which so many are right are added to those of the block, their peaks as high
as one in twenty decoys: a few searches alone cannot say what right peaks look like."""


@dataclass(frozen=True, slots=True, eq=False)
class Searches:
    """Candidates of many searches of one kind, and the decoys beside them, as parallel arrays."""

    search: Indices
    """Number of the search of each candidate, ascending."""
    height: Scalars
    """Height of each candidate above its surface, in that surface's robust deviations."""
    distance_m: Scalars
    """Distance from the prediction on the ground."""
    sigma_m: Scalars
    """Standard deviation per axis of that distance, were the candidate right."""
    count: int
    """Number of searches, also those without a candidate."""
    decoys: Decoys
    """Heights of all decoys."""
    decoy_area_m2: float
    """Area on which the decoys were found."""


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """What right and chance peaks look like in one block."""

    share: float
    """w: share of searches whose point can be found."""
    height: float
    """Mean height of right peaks."""
    height_sigma: float
    """Their standard deviation."""
    wider: float
    """Factor on the stated standard deviations of distance."""
    displaced: float
    """Share of right peaks whose object stands aside of where the map has it."""
    log_ratio: Table
    """Natural logarithm of f1 / l0 at the heights of GRID, never falling, l0 per square metre."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "log_ratio", locked(self.log_ratio))


def probabilities(searches: Searches, mapped: bool = False) -> tuple[Scalars, Calibration | None]:
    """Probability of every candidate to be the right one.

    Args:
        searches: Candidates and decoys of one kind.
        mapped: Whether they are objects of a map, some of which stand aside of their place.

    Returns:
        One probability a candidate, and what it rests on; noughts and None where too little was
        searched to tell.
    """
    if len(searches.height) == 0 or len(searches.decoys) < LEAST_DECOYS:
        return np.zeros(len(searches.height)), None
    log_chance = log_clutter(searches.decoys, searches.decoy_area_m2)
    # design: one in twenty decoys is as high: right peaks begin there.
    usual = float(np.quantile(searches.decoys, 0.95))
    moved = DISPLACED_SHARE if mapped else 0.0
    first = Calibration(0.5, usual + 1.0, 2.0, 1.0, moved, np.zeros_like(GRID))
    found = with_ratio(first, log_chance)
    for _ in range(ROUNDS):
        right, aside = posterior(searches, found), displaced(searches, found)
        found = with_ratio(maximise_likelihood(searches, right, aside, usual), log_chance)
    return posterior(searches, found), found


def log_clutter(decoys: Decoys, area_m2: float) -> Table:
    """Logarithm of decoys per square metre and unit of height, at the heights of GRID.

    Smoothed where there are many; beyond the 90th percentile exponential with their mean excess,
    so that a height never seen among decoys is rare and not impossible.
    """
    knee = float(np.quantile(decoys, TAIL))
    # design: a tail no steeper than the steps of the grid can show.
    excess = max(float(np.mean(decoys[decoys > knee] - knee)), 0.1) if decoys.max() > knee else 0.1
    step = GRID[1] - GRID[0]
    counts = np.histogram(decoys, bins=np.append(GRID - step / 2, GRID[-1] + step / 2))[0]
    # design: 40 steps are two deviations, nearly six bandwidths: the kernel has ended.
    reach = np.arange(-40, 41) * step
    kernel = np.exp(-0.5 * (reach / BANDWIDTH) ** 2)
    density = np.convolve(counts, kernel / kernel.sum(), mode="same") / step
    tail = (1 - TAIL) * len(decoys) / excess * np.exp(-np.maximum(GRID - knee, 0) / excess)
    # design: keeps the logarithm finite where no decoy was seen.
    both = np.where(knee < GRID, tail, np.maximum(density, 1e-3 * len(decoys)))
    return np.log(both / area_m2)


def with_ratio(found: Calibration, log_chance: Table) -> Calibration:
    """The calibration with its likelihood ratio by height.

    Right peaks are taken as normal about their mean; a higher peak never tells less than a lower.
    Normed so that chance alone brings a ratio of one in the mean: else noise would look right.
    """
    off = (GRID - found.height) / found.height_sigma
    log_right = -0.5 * off**2 - np.log(found.height_sigma * np.sqrt(2 * np.pi))
    ratio = log_right - log_chance
    mode = int(np.argmax(log_chance))
    # Below the usual height of chance there is too little of it to divide by.
    ratio[:mode] = ratio[mode]
    ratio = np.maximum.accumulate(ratio)
    step = GRID[1] - GRID[0]
    ratio -= np.log(np.sum(np.exp(ratio + log_chance)) * step)
    return replace(found, log_ratio=ratio)


def posterior(searches: Searches, found: Calibration) -> Scalars:
    """Probability of every candidate under a calibration."""
    near = searches.distance_m <= gate_m(searches.sigma_m, found)
    # design: keeps the logarithm finite.
    log_odds = np.interp(searches.height, GRID, found.log_ratio) + np.log(
        np.maximum(np.sum(densities(searches, found), axis=0), 1e-30)
    )
    # design: exp(60) still leaves room for sums of doubles.
    odds = np.where(near, found.share * np.exp(np.clip(log_odds, -60.0, 60.0)), 0.0)
    total = np.bincount(searches.search, weights=odds, minlength=searches.count)
    return odds / (1.0 - found.share + total[searches.search])


def gate_m(sigma_m: Scalars, found: Calibration) -> Scalars:
    """How far from its prediction a right candidate lies at most, metres."""
    return GATE * np.maximum(sigma_m, DISPLACED_M if found.displaced > 0.0 else 0.0)


def densities(searches: Searches, found: Calibration) -> tuple[Scalars, Scalars]:
    """Density of the distance of every candidate, were it right: in its place, and aside of it."""
    in_place = searches.sigma_m * found.wider
    aside = np.hypot(in_place, DISPLACED_M)
    return (
        (1.0 - found.displaced) * normal(searches.distance_m, in_place),
        found.displaced * normal(searches.distance_m, aside),
    )


def normal(distance_m: Scalars, sigma_m: Scalars) -> Scalars:
    """Density of the normal distribution in the plane, per square metre."""
    return np.exp(-0.5 * (distance_m / sigma_m) ** 2) / (2 * np.pi * sigma_m**2)


def displaced(searches: Searches, found: Calibration) -> Scalars:
    """Probability that the object of a candidate stands aside of its place, were it right."""
    in_place, aside = densities(searches, found)
    # design: keeps the division finite.
    return aside / np.maximum(in_place + aside, 1e-30)


def maximise_likelihood(
    searches: Searches, right: Scalars, aside: Scalars, usual: float
) -> Calibration:
    """The parameters under which these probabilities are likeliest; `with_ratio` adds the ratio."""
    prior = PRIOR_COUNT * PRIOR_SHARE
    weight = float(right.sum())
    # design: one search in fifty may always be without its point, so that no probability is one.
    share = min((weight + prior) / (searches.count + PRIOR_COUNT), 0.98)
    height = (float(right @ searches.height) + prior * usual) / (weight + prior)
    spread = (float(right @ (searches.height - height) ** 2) + prior) / (weight + prior)
    sigma = float(np.clip(np.sqrt(spread), *HEIGHT_SIGMA))
    in_place = right * (1.0 - aside)
    normed = float(in_place @ (searches.distance_m / searches.sigma_m) ** 2)
    wider = np.sqrt((normed + 2 * prior) / (2 * (float(in_place.sum()) + prior)))
    # Where none can stand aside, `aside` is nought and the share stays so.
    known = DISPLACED_SHARE if aside.any() else 0.0
    moved = (float(right @ aside) + prior * known) / (weight + prior)
    return Calibration(
        share,
        height,
        sigma,
        float(np.clip(wider, *WIDER)),
        min(moved, MOST_DISPLACED),
        np.zeros_like(GRID),
    )
