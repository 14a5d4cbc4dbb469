"""A vote among candidates most of which are wrong: what agrees, and whether chance could do so."""

import numpy as np
import pytest

from core.geometry.consensus import SAMPLE, Candidates, Consensus, ConsensusOptions
from tests.core.geometry.planted import PRIOR_SIGMA, START, planted, with_idle

DEFAULT = ConsensusOptions()


def linear(case, options=DEFAULT) -> Consensus:
    """The vote of a planted photo in its linear model."""
    pixels, design = case.model.linearised(case.points, START)
    known = case.candidates
    offset = known.pixels - pixels[known.point]
    return Consensus(known, offset, design[known.point], np.diag(PRIOR_SIGMA**2), options)


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
        vote = Consensus(voices, offset, design, 1e9 * np.eye(2), ConsensusOptions())
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
