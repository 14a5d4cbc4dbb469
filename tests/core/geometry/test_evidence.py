"""Agreement against chance: the Bayes factor is what an integral over the prior says."""

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from core.geometry.evidence import SHARES, Evidence

HALF_PX, SIGMA_PX, PRIOR_PX, LIMIT = 30.0, 1.5, 12.0, 18.0
CHANCE = 1 / (2 * HALF_PX) ** 2


def drawn(rng, points, right, each=1):
    """Offsets of candidates in square windows, the first `right` points with a true one."""
    shift = rng.normal(0, PRIOR_PX, 2)
    offset = rng.uniform(-HALF_PX, HALF_PX, (points * each, 2))
    offset[: right * each : each] = shift + rng.normal(0, SIGMA_PX, (right, 2))
    return offset, shift


def weighed(offset, each, at, prior_px=PRIOR_PX, idle=0):
    """The factor of a shift of all points, log10."""
    points = len(offset) // each
    ones = np.ones(len(offset))
    telling = np.arange(points) >= idle
    evidence = Evidence(
        np.arange(points) * each, ones, SIGMA_PX * ones, CHANCE * ones, telling, LIMIT
    )
    design = np.tile(np.eye(2)[None], (len(offset), 1, 1))
    return evidence.log10_e_value(offset - at, design, at, np.eye(2) / prior_px**2)


def integrated(offset, each, step=0.25):
    """The same by summing over a lattice of shifts."""
    line = np.arange(-45.0, 45.01, step)
    shifts = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    squared = np.sum((offset[None] - shifts[:, None]) ** 2, axis=2) / SIGMA_PX**2
    near = np.where(squared < LIMIT, np.exp(-0.5 * squared), 0.0)
    density = (near / (2 * np.pi * SIGMA_PX**2 * CHANCE)).reshape(len(shifts), -1, each)
    prior = multivariate_normal.logpdf(shifts, cov=PRIOR_PX**2 * np.eye(2)) + 2 * np.log(step)
    parts = [
        np.log1p(-share + share * density.mean(axis=2)).sum(axis=1) + prior for share in SHARES
    ]
    return (logsumexp(parts) - np.log(len(SHARES))) / np.log(10)


@pytest.mark.parametrize(("right", "each"), [(5, 1), (9, 1), (8, 3), (20, 2)])
def test_the_factor_is_the_average_over_the_prior__oracle(right, each):
    for seed in range(3):
        offset, shift = drawn(np.random.default_rng(seed), 40, right, each)
        assert weighed(offset, each, shift) == pytest.approx(integrated(offset, each), abs=0.35)


def test_chance_brings_a_factor_of_one_in_the_mean__law():
    """So that no more than one photo in ten has a factor of ten (the lattice is exact)."""
    rng = np.random.default_rng(4)
    factors = [10 ** integrated(drawn(rng, 12, 0)[0], 1, 0.75) for _ in range(60)]
    assert np.mean(np.array(factors) >= 10) <= 0.1
    assert np.median(factors) < 1


def test_a_wider_prior_leaves_more_to_chance__law():
    """Ten times the room for each of two unknowns: a hundred times the chance."""
    offset, shift = drawn(np.random.default_rng(5), 60, 20)
    narrow, wide = (weighed(offset, 1, shift, prior_px) for prior_px in (PRIOR_PX, 10 * PRIOR_PX))
    assert 1.4 < narrow - wide < 2.1


def test_points_that_agree_wherever_they_lie_say_nothing__law():
    offset, shift = drawn(np.random.default_rng(6), 40, 10)
    more = np.vstack([np.repeat(shift[None], 30, axis=0), offset])
    assert weighed(more, 1, shift, idle=30) == pytest.approx(weighed(offset, 1, shift))


def test_nothing_near_is_evidence_against__law():
    offset, _ = drawn(np.random.default_rng(7), 40, 0)
    assert weighed(offset + 500.0, 1, np.zeros(2)) == pytest.approx(
        np.log10(np.mean((1 - np.array(SHARES)) ** 40))
    )
