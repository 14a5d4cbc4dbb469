"""Probabilities of candidates, told from decoys alone: do they come true?"""

import numpy as np
import pytest

from core.matching.probability import (
    DISPLACED_M,
    GRID,
    Searches,
    log_clutter,
    posterior,
    probabilities,
)

REACH_M, SIGMA_M, PER_M2 = 6.0, 0.7, 0.05


def drawn(rng, count, share, height=4.0, aside=0.0):
    """Searches as they come about: peaks of chance everywhere, a right one in some; the truth.

    A share of the right ones stands aside of its place, by a metre per axis.
    """
    search, heights, away, right = [], [], [], []
    for number in range(count):
        chance = rng.poisson(PER_M2 * (2 * REACH_M) ** 2)
        places = rng.uniform(-REACH_M, REACH_M, (chance, 2))
        search += [number] * chance
        heights += list(1.0 + rng.exponential(0.6, chance))
        away += list(np.hypot(*places.T))
        right += [False] * chance
        if rng.random() < share:
            search.append(number)
            heights.append(rng.normal(height, 1.0))
            sigma_m = np.hypot(SIGMA_M, DISPLACED_M if rng.random() < aside else 0.0)
            away.append(float(np.hypot(*rng.normal(0, sigma_m, 2))))
            right.append(True)
    area = count * 2000.0
    decoys = 1.0 + rng.exponential(0.6, rng.poisson(PER_M2 * area))
    searches = Searches(
        np.array(search, dtype=np.int64),
        np.array(heights),
        np.array(away),
        np.full(len(heights), SIGMA_M),
        count,
        decoys,
        area,
    )
    return searches, np.array(right)


@pytest.mark.parametrize("rounds", [30, 120])
def test_more_or_fewer_rounds_change_no_probability__law(monkeypatch, rounds):
    """Half and double: none by a ten-thousandth."""
    for seed in range(4):
        searches, _ = drawn(np.random.default_rng(seed), 200, 0.4)
        usual = probabilities(searches)[0]
        with monkeypatch.context() as changed:
            changed.setattr("core.matching.probability.ROUNDS", rounds)
            np.testing.assert_allclose(probabilities(searches)[0], usual, atol=1e-4)


@pytest.mark.parametrize(
    ("share", "height", "aside"),
    [(0.8, 4.0, 0.0), (0.4, 3.0, 0.0), (0.15, 4.0, 0.0), (0.8, 4.0, 0.3), (0.4, 3.0, 0.3)],
)
def test_probabilities_come_true__truth(share, height, aside):
    """Expected calibration error at most 0.05, and what is sure is right: no label is seen."""
    told, came = [], []
    for seed in range(5):
        searches, right = drawn(np.random.default_rng(seed), 250, share, height, aside)
        probability, resting = probabilities(searches, mapped=aside > 0)
        assert resting is not None
        assert abs(resting.share - share) < 0.12
        told.append(probability)
        came.append(right)
    told, came = np.concatenate(told), np.concatenate(came)
    bins = np.clip((told * 10).astype(int), 0, 9)
    error = sum(
        (bins == b).mean() * abs(told[bins == b].mean() - came[bins == b].mean())
        for b in np.unique(bins)
    )
    assert error <= 0.05
    assert came[told >= 0.9].mean() >= 0.93
    assert came[told >= 0.9].sum() > 0.3 * came.sum()


def test_objects_aside_of_the_map_are_lost_unless_reckoned_with__truth():
    """Three of ten right ones stand aside: more of them are believed, and no more wrong ones."""
    kept, wrong = np.zeros(2), np.zeros(2)
    for seed in range(5):
        searches, right = drawn(np.random.default_rng(seed), 250, 0.8, 5.0, 0.3)
        for number, mapped in enumerate((False, True)):
            told, found = probabilities(searches, mapped)
            assert found is not None
            assert (found.displaced > 0.0) == mapped
            kept[number] += (right & (told >= 0.95)).sum() / right.sum() / 5
            wrong[number] += (~right & (told >= 0.95)).sum() / right.sum() / 5
    assert kept[1] > kept[0] + 0.03
    assert (wrong <= 0.005).all()


@pytest.mark.parametrize("mapped", [False, True])
def test_in_pure_noise_nothing_is_probable__truth(mapped):
    """No search has a right peak: hardly one candidate of thousands seems right."""
    noise = [drawn(np.random.default_rng(seed), 200, 0.0)[0] for seed in range(10)]
    high = [int((probabilities(searches, mapped)[0] >= 0.9).sum()) for searches in noise]
    assert sum(high) <= 2


def test_a_handful_of_searches_is_judged_with_reserve__truth():
    """Five clear points among the decoys of five searches are believed, five dull ones are not."""
    rng = np.random.default_rng(3)
    decoys = 1.0 + rng.exponential(0.6, 400)
    five = np.arange(5)

    def told(height, away):
        ones = np.ones(5)
        return probabilities(
            Searches(five, height * ones, away * ones, SIGMA_M * ones, 5, decoys, 8000.0)
        )[0]

    assert (told(7.0, 0.3) > 0.9).all()
    assert (told(1.5, 3.0) < 0.1).all()


def test_a_higher_or_nearer_candidate_is_never_less_probable__law():
    searches, _ = drawn(np.random.default_rng(1), 200, 0.5)
    _, found = probabilities(searches)
    assert found is not None
    assert (np.diff(found.log_ratio) >= 0).all()
    one = np.zeros(1, dtype=np.int64)

    def of(height, away):
        return posterior(
            Searches(
                one, np.array([height]), np.array([away]), np.array([0.7]), 1, np.zeros(1), 1.0
            ),
            found,
        )[0]

    assert of(5.0, 0.5) >= of(4.0, 0.5) >= of(2.0, 0.5)
    assert of(4.0, 0.2) >= of(4.0, 1.0) >= of(4.0, 3.0)


def test_probabilities_of_one_search_add_up_to_one_at_most__law():
    searches, _ = drawn(np.random.default_rng(2), 100, 0.7)
    told, _ = probabilities(searches)
    assert (np.bincount(searches.search, weights=told) <= 1 + 1e-9).all()


def test_clutter_is_as_dense_as_what_was_drawn__truth():
    rng = np.random.default_rng(0)
    decoys = 1.0 + rng.exponential(0.6, 20_000)
    density = np.exp(log_clutter(decoys, 1e5))
    told = np.interp([2.0, 3.0, 5.0], GRID, density)
    true = 0.2 * np.exp(-(np.array([2.0, 3.0, 5.0]) - 1.0) / 0.6) / 0.6
    np.testing.assert_allclose(told, true, rtol=0.25)


def test_without_decoys_nothing_is_told__law():
    searches = Searches(
        np.zeros(1, dtype=np.int64), np.ones(1), np.ones(1), np.ones(1), 1, np.zeros(0), 0.0
    )
    told, found = probabilities(searches)
    assert told.tolist() == [0.0]
    assert found is None
