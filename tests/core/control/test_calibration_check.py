"""A reliability diagram without labels: does it show what is true of the probabilities?"""

from dataclasses import replace

import numpy as np
import pytest

from core.control.calibration_check import Bin, calibration_error, diagram, sightings
from core.matching.probability import probabilities
from tests.core.matching.test_probability import REACH_M, drawn

WINDOW_M2 = (2 * REACH_M) ** 2


def seen(boldness: float = 1.0):
    """Searches judged by what their heights tell, or by that many times as much."""
    every = []
    for seed in range(4):
        searches, _ = drawn(np.random.default_rng(seed), 250, 0.5, 4.0)
        _, found = probabilities(searches)
        assert found is not None
        bold = replace(found, log_ratio=boldness * found.log_ratio)
        every.append(sightings(searches, bold, WINDOW_M2))
    return diagram(every)


def test_heights_that_tell_the_truth_are_borne_out__truth():
    bins = seen()
    assert sum(one.proposals for one in bins) > 900
    assert calibration_error(bins) < 0.05
    assert bins[-1].borne_out > 0.9


def test_heights_that_promise_too_much_are_shown__truth():
    """A likelihood ratio squared: every difference of heights counts twice."""
    assert calibration_error(seen(2.0)) > 0.15


def test_the_error_is_the_mean_difference_by_proposals__law():
    bins = (Bin(30, 0.05, 0.0), Bin(10, 0.95, 0.75))
    assert calibration_error(bins) == pytest.approx((30 * 0.05 + 10 * 0.2) / 40)
    assert calibration_error(()) == 0.0
    assert diagram(()) == ()
