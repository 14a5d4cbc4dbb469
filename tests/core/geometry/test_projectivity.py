"""Projectivities: fit, apply, derive."""

import numpy as np

from core.geometry.projectivity import apply_projectivity, fit_projectivity, jacobians

MATRIX = np.array([[-1.02, 0.05, 4000.0], [-0.04, -0.98, 3900.0], [1e-6, -2e-6, 1.0]])


def test_projectivity_is_found_among_wrong_points__truth():
    rng = np.random.default_rng(1)
    source = rng.uniform(0, 4000, (200, 2))
    target = apply_projectivity(MATRIX, source)
    target[:60] = rng.uniform(0, 4000, (60, 2))
    fitted = fit_projectivity(source, target)
    assert np.abs(apply_projectivity(fitted, source[60:]) - target[60:]).max() < 1e-3


def test_jacobians_are_the_differences__law():
    points = np.random.default_rng(2).uniform(0, 4000, (20, 2))
    steps = np.eye(2) * 0.01
    numeric = np.stack(
        [
            (apply_projectivity(MATRIX, points + s) - apply_projectivity(MATRIX, points - s)) / 0.02
            for s in steps
        ],
        axis=2,
    )
    assert np.allclose(jacobians(MATRIX, points), numeric, atol=1e-6)


def test_too_few_points_give_a_shift__truth():
    source = np.array([[0.0, 0.0], [10.0, 5.0]])
    assert np.allclose(
        apply_projectivity(fit_projectivity(source, source + 3.0), source), source + 3
    )
