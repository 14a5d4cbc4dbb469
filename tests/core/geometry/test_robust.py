"""Robust weights."""

import numpy as np
import pytest

from core.geometry.robust import huber_costs, huber_weights, robust_sigma


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
