"""Gain and offset of every photo, so that neighbours agree where they overlap.

One least-squares problem for the block (METHODS 8) over cells that two photos share:
gain_i * gray_i + offset_i = gain_j * gray_j + offset_j, with gain 1 and offset 0 as priors.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float64
from scipy import sparse
from scipy.sparse.linalg import spsolve

from core.arrays import Indices, Scalars
from core.geometry.robust import huber_weights, solve_robustly
from core.mosaic.overview import Overview, common_cells

Unknowns = Float64[np.ndarray, "unknowns"]
"""Gain and offset of each photo in turn."""
# source: Holland and Welsch 1977: 95 % efficiency at the normal distribution
HUBER = 1.345
# design: a quarter of a gray value of 8 bits, which are rounded to one
SMALLEST_SCALE = 1e-3
# design: loose: nearly half a stop of exposure; overlaps decide
SIGMA_GAIN = 0.3
"""Prior standard deviation of a gain about 1."""
# design: loose: veil and vignetting of a seventh of the range; overlaps decide
SIGMA_OFFSET_SHARE = 0.15
"""Prior standard deviation of an offset about 0, as a share of the full scale."""
# design: the mean of so many is known to a fortieth of the noise of one
SAMPLES_PER_PAIR = 2000
"""Cells of one overlap that are used at most."""
# design: a limit of time
ITERATIONS = 15
"""Reweighted solutions."""


@dataclass(frozen=True, slots=True)
class Balance:
    """Radiometric correction of one photo: gain * gray + offset."""

    gain: float = 1.0
    """Factor."""
    offset: float = 0.0
    """Summand, gray values of the scan's type."""


@dataclass(frozen=True, slots=True, eq=False)
class _Samples:
    """Gray values of pairs of photos at common cells, as parallel arrays."""

    first: Indices
    second: Indices
    gray_first: Scalars
    gray_second: Scalars


def balance_orthos(
    overviews: Sequence[Overview], full_scale: float = 255.0
) -> Mapping[str, Balance]:
    """Gain and offset by photo; over the block they are 1 and 0 in the mean.

    Args:
        overviews: The orthos in small, as means over cells: grain is gone there.
        full_scale: Largest gray value.

    Returns:
        The balance of every photo; gain 1 and offset 0 for one without neighbours.
    """
    samples = _collect(overviews, full_scale)
    unknowns = _adjust(samples, len(overviews))
    return {
        view.photo_id: Balance(float(gain), float(offset) * full_scale)
        for view, (gain, offset) in zip(overviews, unknowns.reshape(-1, 2), strict=True)
    }


def _collect(overviews: Sequence[Overview], full_scale: float) -> _Samples:
    first: list[np.ndarray] = []
    second: list[np.ndarray] = []
    grays: list[tuple[np.ndarray, np.ndarray]] = []
    for i, one in enumerate(overviews):
        for j in range(i + 1, len(overviews)):
            here, there = common_cells(one, overviews[j])
            step = max(1, len(here) // SAMPLES_PER_PAIR)
            grays.append((here[::step] / full_scale, there[::step] / full_scale))
            first.append(np.full(len(grays[-1][0]), i))
            second.append(np.full(len(grays[-1][0]), j))
    if not grays:
        nothing, nobody = np.zeros(0), np.zeros(0, dtype=np.int64)
        return _Samples(nobody, nobody, nothing, nothing)
    return _Samples(
        np.concatenate(first),
        np.concatenate(second),
        np.concatenate([pair[0] for pair in grays]),
        np.concatenate([pair[1] for pair in grays]),
    )


def _adjust(samples: _Samples, photos: int) -> Unknowns:
    """Gain and offset (share of full scale) of all photos, alternating, by reweighting."""
    unknowns = np.tile([1.0, 0.0], photos)
    design = _design(samples, photos)
    prior = sparse.diags_array(np.tile([SIGMA_GAIN**-2, SIGMA_OFFSET_SHARE**-2], photos))
    # The mean over the block is held: else noise would pull every gain down a little.
    mean = np.zeros((2, 2 * photos))
    mean[0, ::2] = mean[1, 1::2] = 1.0
    # design: so much heavier than all samples that the mean stays to the last digits told
    hold = sparse.csc_array(mean.T @ mean) * 1e13
    right = (prior + hold) @ unknowns

    def solve(weights: Scalars) -> tuple[Unknowns, Scalars]:
        nonlocal unknowns
        # A large gain enlarges its own noise.
        scaled = weights / _noise_gains(samples, unknowns) ** 2
        normal = design.T @ sparse.diags_array(scaled) @ design + prior + hold
        unknowns = np.array(spsolve(sparse.csc_array(normal), right), dtype=np.float64).ravel()
        return unknowns, lengths()

    def lengths() -> Scalars:
        return np.abs(design @ unknowns) / _noise_gains(samples, unknowns)

    weigh = partial(huber_weights, limit=HUBER)
    return solve_robustly(solve, lengths(), weigh, passes=ITERATIONS, least_scale=SMALLEST_SCALE)


def _design(samples: _Samples, photos: int) -> sparse.csr_array:
    count = len(samples.first)
    rows = np.repeat(np.arange(count), 4)
    columns = np.column_stack(
        [2 * samples.first, 2 * samples.first + 1, 2 * samples.second, 2 * samples.second + 1]
    )
    ones = np.ones(count)
    values = np.column_stack([samples.gray_first, ones, -samples.gray_second, -ones])
    return sparse.csr_array((values.ravel(), (rows, columns.ravel())), shape=(count, 2 * photos))


def _noise_gains(samples: _Samples, unknowns: Unknowns) -> Scalars:
    """What gains make of a sample's noise, 1 where both are 1."""
    gains = unknowns[::2]
    return np.hypot(gains[samples.first], gains[samples.second]) / np.sqrt(2)
