"""Reliability diagram of the probabilities of proposals, without labelled data.

The highest peak of every search gets a probability from its height alone, without its position.
The position then tests it: a right peak lies within the gate about the block's prediction, a wrong
one only as often as the gate has a share in the window. So of the peaks with a stated probability
p, the share p r + (1 - p) c should lie there, with r = 98.9 % (three standard deviations in the
plane) and c that share. The prediction has moved a little towards what the block used; comparison
with the truth would be stricter.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from core.arrays import Scalars
from core.matching.probability import GATE, GRID, Calibration, Searches, gate_m

# design: as reliability diagrams are drawn.
BINS = 10
WITHIN = 1.0 - float(np.exp(-0.5 * GATE**2))
"""Share of right peaks within the gate."""


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """The highest peak of each search, as parallel arrays."""

    stated: Scalars
    """Probability by its height alone that it is right, 0 to 1."""
    near: Scalars
    """1 where it lies within the gate about the prediction, else 0."""
    by_chance: Scalars
    """Share of wrong peaks that would lie there."""


@dataclass(frozen=True, slots=True)
class Bin:
    """Proposals of about the same stated probability."""

    proposals: int
    """How many."""
    stated: float
    """Mean probability that was stated, 0 to 1."""
    borne_out: float
    """Share that is right by where they lie, 0 to 1."""


def sightings(searches: Searches, found: Calibration, window_m2: float) -> Sightings:
    """What the heights of the highest peaks state, and where these lie.

    Args:
        searches: Candidates of one kind.
        found: What their probabilities rest on.
        window_m2: Area of a window in which candidates are looked for, square metres.
    """
    # design: numerical safety; odds of nought say nothing of peaks.
    share = max(found.share, 1e-6)
    ratio = np.exp(np.interp(searches.height, GRID, found.log_ratio)) / window_m2
    odds = share * ratio
    total = np.bincount(searches.search, weights=odds, minlength=searches.count)
    stated = odds / (1.0 - share + total[searches.search])
    order = np.lexsort((-searches.height, searches.search))
    top = order[np.unique(searches.search[order], return_index=True)[1]]
    gate = gate_m(searches.sigma_m[top], found)
    return Sightings(
        stated[top],
        (searches.distance_m[top] <= gate).astype(np.float64),
        # design: numerical safety; a gate as wide as the window would leave nothing to compare.
        np.minimum(np.pi * gate**2 / window_m2, 0.9),
    )


def diagram(every: Sequence[Sightings]) -> tuple[Bin, ...]:
    """Ten classes of stated probability and how far each is borne out; empty ones are left out."""
    if not every:
        return ()
    stated = np.concatenate([one.stated for one in every])
    near = np.concatenate([one.near for one in every])
    chance = np.concatenate([one.by_chance for one in every])
    number = np.clip((stated * BINS).astype(np.int64), 0, BINS - 1)
    found: list[Bin] = []
    for one in np.unique(number):
        own = number == one
        wrong = float(chance[own].mean())
        right = (float(near[own].mean()) - wrong) / (WITHIN - wrong)
        found.append(
            Bin(int(own.sum()), float(stated[own].mean()), float(np.clip(right, 0.0, 1.0)))
        )
    return tuple(found)


def calibration_error(bins: Sequence[Bin]) -> float:
    """Expected calibration error: mean difference of stated and borne out, by proposals."""
    count = sum(one.proposals for one in bins)
    return sum(one.proposals * abs(one.stated - one.borne_out) for one in bins) / max(count, 1)
