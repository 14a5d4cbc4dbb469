"""Plane transforms and projectivities: known ones, least squares, OpenCV."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.doubts import Failure
from core.geometry.transforms import (
    PlaneTransform,
    apply_affine,
    apply_projectivity,
    compose_affine,
    fit_affine,
    fit_projectivity,
    fit_similarity,
    invert_affine,
    jacobians,
    rotation_and_scale,
)

number = st.floats(-1e4, 1e4, allow_nan=False)
FIELD = np.array([[0.0, 0.0], [9000.0, 200.0], [8800.0, 9100.0], [100.0, 8900.0], [4000.0, 5000.0]])
MATRIX = np.array([[-1.02, 0.05, 4000.0], [-0.04, -0.98, 3900.0], [1e-6, -2e-6, 1.0]])


def similar(angle: float, scale: float, mirrored: bool = False) -> np.ndarray:
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    sign = -1 if mirrored else 1
    return np.array([[c, -sign * s, -743000.0], [s, sign * c, -1043000.0]])


@settings(max_examples=50)
@given(st.floats(-3.14, 3.14), st.floats(0.01, 100), st.booleans())
def test_similarity_comes_back__truth(angle: float, scale: float, mirrored: bool) -> None:
    matrix = similar(angle, scale, mirrored)
    fit = fit_similarity(FIELD, apply_affine(matrix, FIELD), mirrored)
    assert isinstance(fit, PlaneTransform)
    np.testing.assert_allclose(
        apply_affine(fit.matrix, FIELD), apply_affine(matrix, FIELD), atol=1e-6
    )
    found, size = rotation_and_scale(fit.matrix, mirrored)
    assert size == pytest.approx(scale, rel=1e-6)
    assert np.cos(found - angle) == pytest.approx(1.0)


@settings(max_examples=50)
@given(number, number, number, number, number, number)
def test_there_and_back__law(a: float, b: float, c: float, d: float, e: float, f: float) -> None:
    matrix = np.array([[a + 2e4, b, c], [d, e - 3e4, f]])
    back = invert_affine(matrix)
    np.testing.assert_allclose(apply_affine(back, apply_affine(matrix, FIELD)), FIELD, atol=1e-5)
    np.testing.assert_allclose(compose_affine(back, matrix), np.eye(2, 3), atol=1e-5)


def test_affine_is_the_least_squares_solution__oracle() -> None:
    rng = np.random.default_rng(1)
    target = FIELD * 0.5 + rng.normal(0, 3, FIELD.shape) - 7e5
    fit = fit_affine(FIELD, target)
    assert isinstance(fit, PlaneTransform)
    design = np.column_stack([FIELD, np.ones(len(FIELD))])
    expected = np.linalg.lstsq(design, target, rcond=None)[0].T
    np.testing.assert_allclose(fit.matrix, expected, rtol=1e-7, atol=1e-5)
    np.testing.assert_allclose(fit.residuals, design @ expected.T - target, atol=1e-6)


@pytest.mark.parametrize("model", ["similarity", "affine"])
def test_sigma_tells_the_scatter__truth(model: str) -> None:
    rng = np.random.default_rng(2)
    matrix = similar(0.3, 0.35)
    fit_one = fit_similarity if model == "similarity" else fit_affine
    fits = [
        fit_one(FIELD, apply_affine(matrix, FIELD) + rng.normal(0, 0.5, FIELD.shape))
        for _ in range(400)
    ]
    sigma = np.sqrt(np.mean([fit.sigma**2 for fit in fits]))
    assert sigma == pytest.approx(0.5, rel=0.05)


def test_too_few_or_in_line_is_a_failure__law() -> None:
    line = np.column_stack([np.arange(5.0), 2 * np.arange(5.0)])
    assert isinstance(fit_affine(line, line), Failure)
    assert isinstance(fit_affine(FIELD[:2], FIELD[:2]), Failure)
    assert isinstance(fit_similarity(FIELD[:1], FIELD[:1]), Failure)
    assert isinstance(fit_similarity(np.ones((3, 2)), FIELD[:3]), Failure)


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
