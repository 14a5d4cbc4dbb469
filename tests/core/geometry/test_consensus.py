"""Consensus of candidates, and whether it could be chance."""

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from core.geometry.consensus import (
    SAMPLE,
    SHARES,
    Candidates,
    Consensus,
    ConsensusOptions,
    Evidence,
)
from tests.core.geometry.planted import PRIOR_SIGMA, START, planted, with_idle

DEFAULT = ConsensusOptions()
HALF_PX, SIGMA_PX, PRIOR_PX, LIMIT = 30.0, 1.5, 12.0, 18.0
CHANCE = 1 / (2 * HALF_PX) ** 2


def linear(case, options=DEFAULT) -> Consensus:
    """The vote of a planted photo in its linear model."""
    pixels, design = case.model.linearised(case.points, START)
    known = case.candidates
    offset = known.pixels - pixels[known.point]
    return Consensus(known, offset, design[known.point], np.diag(PRIOR_SIGMA**2), options=options)


def best(vote: Consensus, seed: int):
    """Step, agreeing candidates and e-value of the best hypothesis."""
    steps = vote.hypotheses(np.random.default_rng(seed))
    _, step, chosen = min((vote.refined(step) for step in steps), key=lambda found: found[0])
    return step, chosen, log10_e_value(vote, step)


def log10_e_value(vote: Consensus, step) -> float:
    return vote.log10_e_value(vote.offset - vote.design @ step, vote.design, step)


@pytest.mark.parametrize("each", [1, 3])
def test_pure_noise_is_refused_in_99_of_100_blocks__truth(each):
    """The e-value keeps its word: chance reaches 1000 in at most one of 1000."""
    count, seeds = (90, 200) if each == 1 else (30, 200)
    options = ConsensusOptions(hypotheses=1000, refined=6)
    numbers = [
        best(linear(planted(seed, count, 0, sigma_px=3.0, each=each), options), seed)[2]
        for seed in range(seeds)
    ]
    refused = np.mean(np.array(numbers) < options.least_log10_e_value)
    assert refused >= 0.99


def test_points_whose_gate_fills_their_window_make_no_agreement__truth():
    """Noise with many points that agree wherever they lie is still noise."""
    options = ConsensusOptions(hypotheses=500, refined=6)
    numbers = [
        best(linear(with_idle(planted(seed, 40, 0, sigma_px=3.0), 60), options), seed)[2]
        for seed in range(60)
    ]
    assert np.mean(np.array(numbers) < options.least_log10_e_value) >= 0.99


def test_points_whose_gate_fills_their_window_change_no_number__law():
    case = planted(3, 90, 14)
    step, chosen, number = best(linear(case), 1)
    more = linear(with_idle(case, 60))
    everyone = more.agreeing(more.offset - more.design @ step)[0]
    assert len(everyone) >= len(chosen) + 60
    assert log10_e_value(more, step) == pytest.approx(number, abs=1e-9)


def test_only_one_candidate_a_point_agrees_and_the_nearest_of_them__truth():
    case = planted(5, 40, 20, each=3)
    vote = linear(case)
    _, chosen, number = best(vote, 0)
    points = case.candidates.point[chosen]
    assert len(set(points.tolist())) == len(points)
    assert set(case.right) <= set(chosen.tolist())
    assert number > 10


def test_a_candidate_without_a_number_takes_no_part__law():
    """A point behind the camera has no predicted place."""
    case = planted(6, 40, 20)
    vote = linear(case)
    _, chosen, _ = best(vote, 0)
    residual = np.full(vote.offset.shape, np.nan)
    residual[chosen] = 0.0
    assert set(vote.agreeing(residual)[0].tolist()) == set(chosen.tolist())


def test_a_distrusted_candidate_has_less_of_a_voice__law():
    """Trust is the share of a full vote, in the cost and in the solution."""
    design = np.tile(np.eye(2)[None], (2, 1, 1))
    offset = np.array([[1.0, 0.0], [-1.0, 0.0]])
    ones = np.ones(2)

    def solved(trust):
        voices = Candidates(np.arange(2), offset, ones, ones, np.array(trust), 1e-4 * ones)
        vote = Consensus(voices, offset, design, 1e9 * np.eye(2), options=ConsensusOptions())
        step = vote.solved(np.arange(2), offset, design, np.zeros(2))[0]
        return step, vote.agreeing(offset)[1]

    even, together = solved([1.0, 1.0])
    uneven, less = solved([1.0, 0.25])
    np.testing.assert_allclose(even, 0.0, atol=1e-9)
    np.testing.assert_allclose(uneven, [0.6, 0.0], atol=1e-6)
    assert less > together


def test_without_candidates_that_agree_the_prior_stands__law():
    case = planted(8, 10, 0, sigma_px=0.01)
    vote = linear(case)
    cost, step, chosen = vote.refined(np.zeros(6))
    assert len(chosen) < SAMPLE
    np.testing.assert_array_equal(step, 0.0)
    assert cost == pytest.approx(10 * vote.limit)


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
        np.arange(points) * each, ones, SIGMA_PX * ones, CHANCE * ones, telling=telling, limit=LIMIT
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
