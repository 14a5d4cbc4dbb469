"""Additional parameters: polynomials of the ideal image coordinates."""

from dataclasses import replace

import numpy as np
import pytest

from core.geometry.camera import BASE, SETS, Camera, additional_set, by_parameters
from core.geometry.collinearity import (
    Atmosphere,
    film_from_object,
    film_partials,
    ideal_from_film,
    object_from_film,
)
from core.geometry.exterior import ExteriorOrientation

AIR = Atmosphere(refraction=1e-4, curvature_per_m=1e-7)
EXTERIOR = ExteriorOrientation(np.array([10.0, 20.0, 2500.0]), 0.05, -0.03, 0.7)


def bent_camera(name, size_mm=0.05):
    parameters = additional_set((name,))
    values = np.random.default_rng(1).normal(size=len(parameters.names)) * size_mm
    bent = np.tensordot(values, parameters.basis, axes=1).ravel()
    return Camera(
        "bent", 152.0, (230.0, 230.0), (0.1, -0.1), (1e-7, 0.0, 0.0), deformation_mm=tuple(bent)
    )


def places(count=40):
    plane = np.random.default_rng(2).uniform(-1500, 1500, size=(count, 2))
    return np.column_stack([plane, np.full(count, 300.0)])


@pytest.mark.parametrize("name", SETS)
def test_film_points_go_back_to_the_ground__law(name):
    camera, points = bent_camera(name), places()
    film = film_from_object(points, EXTERIOR, camera, AIR)
    back = object_from_film(film, points[:, 2], EXTERIOR, camera, AIR)
    np.testing.assert_allclose(back, points, atol=1e-5)
    straight = film_from_object(points, EXTERIOR, replace(camera, deformation_mm=()), AIR)
    assert 0.005 < np.abs(film - straight).max() < 1.5
    assert np.isfinite(ideal_from_film(film, camera, AIR)).all()


@pytest.mark.parametrize("name", SETS)
def test_derivatives_through_a_bent_film__law(name):
    camera, points = bent_camera(name), places()
    ours = film_partials(points, EXTERIOR, camera, AIR)
    np.testing.assert_allclose(ours.film.T, film_from_object(points, EXTERIOR, camera, AIR))
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 0.1
        ahead, behind = (
            film_from_object(points + sign * step, EXTERIOR, camera, AIR) for sign in (1, -1)
        )
        expected = -(ahead - behind).T / 0.2
        np.testing.assert_allclose(ours.by_centre[:, axis], expected, atol=2e-7)
    longer, shorter = (
        replace(camera, principal_distance_mm=camera.principal_distance_mm + step)
        for step in (1e-3, -1e-3)
    )
    by_distance = film_from_object(points, EXTERIOR, longer, AIR)
    by_distance = (by_distance - film_from_object(points, EXTERIOR, shorter, AIR)).T / 2e-3
    np.testing.assert_allclose(ours.by_camera[:, 0], by_distance, atol=1e-6)


@pytest.mark.parametrize(("name", "side", "count"), [("ebner12", 3, 12), ("gruen44", 5, 44)])
def test_sets_are_orthogonal_on_their_places__paper(name, side, count):
    """Ebner 1976 on nine places, Gruen 1978 on twenty-five; none of them is a tilt."""
    line = np.linspace(-BASE, BASE, side)
    x, y = (axis.ravel() for axis in np.meshgrid(line, line))
    basis = additional_set((name,)).basis
    rows = by_parameters(x, y, basis).transpose(0, 2, 1).reshape(-1, count)
    normal = rows.T @ rows
    np.testing.assert_allclose(normal, np.diag(np.diag(normal)), atol=1e-12)
    one, nought = np.ones_like(x), np.zeros_like(x)
    orientation = [(one, nought), (nought, one), (x, y), (y, -x), (x * x, x * y), (x * y, y * y)]
    for dx, dy in orientation:
        np.testing.assert_allclose(rows.T @ np.concatenate([dx, dy]), 0, atol=1e-12)


def test_no_set_is_nothing__law():
    assert additional_set(()).basis.shape == (0, 2, 25)
