"""Derivatives of film coordinates."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from core.geometry.atmosphere import Atmosphere
from core.geometry.camera import Camera
from core.geometry.collinearity import film_from_object
from core.geometry.exterior import (
    ExteriorOrientation,
    angles_from_rotation,
    rotation_from_angles,
)
from core.geometry.partials import (
    angles_by_increments,
    angles_from_rotations,
    film_partials,
    rotations_from_increments,
)

# Corrections far larger than in nature, so that a missing term would show.
CAMERA = Camera("wide", 152.0, (230.0, 230.0), (0.3, -0.2), (1e-6, -2e-10, 1e-14))
AIR = Atmosphere(refraction=2e-3, curvature_per_m=1e-5)
CENTRE = np.array([1000.0, 2000.0, 3000.0])


def some_photo(seed):
    rng = np.random.default_rng(seed)
    omega, phi = rng.uniform(-0.2, 0.2, size=2)
    exterior = ExteriorOrientation(CENTRE, float(omega), float(phi), float(rng.uniform(-3, 3)))
    plane = rng.uniform(-1500, 1500, size=(15, 2))
    return exterior, np.column_stack([plane + CENTRE[:2], rng.uniform(200, 400, size=15)])


def differences(function, step, size):
    """Central differences of film coordinates (n, 2) by parameters: (2, size, n)."""
    columns = [
        (function(step * axis) - function(-step * axis)).T / (2 * step) for axis in np.eye(size)
    ]
    return np.stack(columns, axis=1)


def assert_close(ours, numerical):
    """Central differences are good to eight digits of the largest derivative or so."""
    assert np.abs(ours - numerical).max() < 1e-7 * np.abs(numerical).max()


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_film_is_that_of_the_collinearity_equations__law(seed):
    exterior, points = some_photo(seed)
    expected = film_from_object(points, exterior, CAMERA, AIR)
    film = film_partials(points, exterior, CAMERA, AIR).film
    np.testing.assert_allclose(film.T, expected, rtol=0, atol=1e-10)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_centre_and_point_partials_are_differences__law(seed):
    exterior, points = some_photo(seed)
    ours = film_partials(points, exterior, CAMERA, AIR).by_centre

    def by_centre(step):
        return film_from_object(points, replace(exterior, centre=CENTRE + step), CAMERA, AIR)

    def by_point(step):
        return film_from_object(points + step, exterior, CAMERA, AIR)

    assert_close(ours, differences(by_centre, 0.1, 3))
    assert_close(-ours, differences(by_point, 0.1, 3))


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_rotation_partials_are_differences__law(seed):
    exterior, points = some_photo(seed)

    def by_increment(increment):
        turned = exterior.object_from_image @ rotations_from_increments(increment[None])[0]
        moved = ExteriorOrientation(CENTRE, *angles_from_rotation(turned))
        return film_from_object(points, moved, CAMERA, AIR)

    ours = film_partials(points, exterior, CAMERA, AIR).by_rotation
    assert_close(ours, differences(by_increment, 1e-5, 3))


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_camera_partials_are_differences__law(seed):
    exterior, points = some_photo(seed)
    scale = np.array([1.0, 1.0, 1.0, 1e-6, 1e-10])

    def by_constants(step):
        c, x0, y0, k1, k2 = np.array([152.0, 0.3, -0.2, 1e-6, -2e-10]) + step * scale
        camera = replace(
            CAMERA,
            principal_distance_mm=float(c),
            principal_point_mm=(float(x0), float(y0)),
            radial_distortion=(float(k1), float(k2), 1e-14),
        )
        return film_from_object(points, exterior, camera, AIR)

    ours = film_partials(points, exterior, CAMERA, AIR).by_camera * scale[:, None]
    numerical = differences(by_constants, 1e-3, 5)
    for row in range(5):
        assert_close(ours[:, row], numerical[:, row])


def test_points_behind_the_camera_are_nan__law():
    exterior = ExteriorOrientation(CENTRE, 0.0, 0.0, 0.0)
    film = film_partials(np.array([[1000.0, 2000.0, 3100.0]]), exterior, CAMERA).film
    assert np.isnan(film).all()


@given(
    omega=st.floats(-1, 1), phi=st.floats(-1, 1), kappa=st.floats(-3, 3), seed=st.integers(0, 999)
)
@settings(max_examples=30, deadline=None)
def test_angle_partials_are_differences__law(omega, phi, kappa, seed):
    rotation = rotation_from_angles(omega, phi, kappa)[None]
    ours = angles_by_increments(rotation)[0]
    step = np.random.default_rng(seed).normal(size=3) * 1e-6
    after = angles_from_rotations(rotation @ rotations_from_increments(step[None]))
    before = angles_from_rotations(rotation @ rotations_from_increments(-step[None]))
    np.testing.assert_allclose(ours @ step, (after - before)[0] / 2, rtol=0, atol=1e-13)


@given(st.lists(st.floats(-3, 3), min_size=3, max_size=3))
@settings(max_examples=30, deadline=None)
def test_increments_give_rotations__law(vector):
    rotation = rotations_from_increments(np.array([vector]))[0]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(rotation @ np.array(vector), vector, atol=1e-13)
