"""Robust weights, scale and solution."""

from functools import partial

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import median_abs_deviation

from core.geometry.robust import (
    cauchy_weights,
    huber_costs,
    huber_weights,
    robust_sigma,
    solve_robustly,
)


def test_weights_are_slopes_of_the_cost__law():
    residuals, step = np.linspace(0.1, 9, 40), 1e-6
    slopes = (huber_costs(residuals + step, 2.0) - huber_costs(residuals - step, 2.0)) / (2 * step)
    np.testing.assert_allclose(slopes, 2 * huber_weights(residuals, 2.0) * residuals, rtol=1e-6)


def test_robust_sigma_ignores_a_third_of_gross_errors__truth():
    rng = np.random.default_rng(0)
    sound = rng.normal(size=20000) * 0.5
    # The median of 20000 is good to 1 %.
    assert robust_sigma(sound) == pytest.approx(0.5, rel=0.03)
    assert robust_sigma(np.concatenate([sound, np.full(10000, 1e6)])) < 1.0
    assert robust_sigma(np.zeros(0)) == 0


def test_robust_sigma_is_the_scaled_median_deviation__oracle():
    values = np.random.default_rng(1).normal(3.0, 2.0, size=(40, 30))
    about_median = robust_sigma(values - np.median(values))
    assert about_median == pytest.approx(
        median_abs_deviation(values, axis=None, scale="normal"), rel=1e-12
    )
    gappy = np.where(values > 6, np.nan, values) - 3.0
    about_nought = median_abs_deviation(
        gappy, axis=None, center=lambda v, axis: 0.0, scale="normal", nan_policy="omit"
    )
    assert robust_sigma(gappy) == pytest.approx(about_nought, rel=1e-12)


@pytest.mark.parametrize(("weigh", "loss"), [(huber_weights, "huber"), (cauchy_weights, "cauchy")])
def test_robust_solution_is_the_minimum_of_its_cost__oracle(weigh, loss):
    rng = np.random.default_rng(2)
    design = rng.normal(size=(300, 4))
    target = design @ np.array([1.0, -2.0, 0.5, 3.0]) + rng.normal(size=300) * 0.1
    target[:60] += 5.0

    def solve(weights):
        root = np.sqrt(weights)
        solution = np.linalg.lstsq(design * root[:, None], target * root, rcond=None)[0]
        return solution, np.abs(design @ solution - target)

    found = solve_robustly(solve, np.ones(300), partial(weigh, limit=2.0), passes=200)
    scale = 2.0 * robust_sigma(design @ found - target)
    expected = least_squares(
        lambda x: design @ x - target,
        found + 0.05,
        loss=loss,
        f_scale=scale,
        xtol=1e-15,
        ftol=1e-15,
    )
    np.testing.assert_allclose(found, expected.x, atol=1e-5)
    assert np.abs(found - [1.0, -2.0, 0.5, 3.0]).max() < 0.1


def test_exact_measurements_are_solved_exactly__law():
    design = np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0]])

    def solve(weights):
        root = np.sqrt(weights)
        solution = np.linalg.lstsq(design * root[:, None], design @ [3.0, 4.0] * root, rcond=None)
        return solution[0], np.abs(design @ (solution[0] - [3.0, 4.0]))

    weigh = partial(cauchy_weights, limit=3.0)
    for first in (np.ones(3), np.zeros(3)):
        found = solve_robustly(solve, first, weigh, passes=5)
        np.testing.assert_allclose(found, [3.0, 4.0], atol=1e-9)
