"""Collinearity and its derivatives."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.geometry.camera import Camera
from core.geometry.collinearity import (
    Atmosphere,
    angles_by_increments,
    angles_from_rotations,
    atmosphere_of,
    film_from_object,
    film_partials,
    ideal_from_film,
    object_from_film,
    rotations_from_increments,
)
from core.geometry.exterior import (
    ExteriorOrientation,
    angles_from_rotation,
    rotation_from_angles,
)

LENS = (-3e-8, 2e-12, -1e-17)
CAMERA = Camera("wide", 152.0, (230.0, 230.0), (0.05, -0.03), LENS)
CENTRE = np.array([-580_000.0, -1_190_000.0, 3300.0])
# Corrections far larger than in nature, so that a missing term would show.
STRONG = Camera("wide", 152.0, (230.0, 230.0), (0.3, -0.2), (1e-6, -2e-10, 1e-14))
AIR = Atmosphere(refraction=2e-3, curvature_per_m=1e-5)
ABOVE = np.array([1000.0, 2000.0, 3000.0])


def points(seed: int = 0, count: int = 50) -> np.ndarray:
    rng = np.random.default_rng(seed)
    plane = CENTRE[:2] + rng.uniform(-1900, 1900, (count, 2))
    return np.column_stack([plane, rng.uniform(150, 400, count)])


def test_an_upright_photo_shows_east_to_the_right__law():
    """METHODS 7.1: omega = phi = kappa = 0 gives x' = +c (X - X0) / (Z0 - Z)."""
    camera = Camera("plain", 200.0, (180.0, 180.0))
    exterior = ExteriorOrientation(np.array([100.0, 200.0, 2000.0]), 0.0, 0.0, 0.0)
    film = film_from_object(np.array([[400.0, 100.0, 500.0]]), exterior, camera)
    np.testing.assert_allclose(film, [[200.0 * 300 / 1500, -200.0 * 100 / 1500]])


def test_kappa_turns_the_camera_counter_clockwise__law():
    """A quarter turn to the left: what lies north then lies to the right."""
    camera = Camera("plain", 200.0, (180.0, 180.0))
    exterior = ExteriorOrientation(np.array([0.0, 0.0, 1000.0]), 0.0, 0.0, np.pi / 2)
    film = film_from_object(np.array([[0.0, 100.0, 0.0]]), exterior, camera)
    np.testing.assert_allclose(film, [[20.0, 0.0]], atol=1e-12)


@settings(max_examples=60)
@given(
    st.floats(-0.1, 0.1),
    st.floats(-0.1, 0.1),
    st.floats(-3.1, 3.1),
    st.booleans(),
    st.integers(0, 9),
)
def test_down_to_the_ground_and_back__law(omega, phi, kappa, air, seed):
    exterior = ExteriorOrientation(CENTRE, omega, phi, kappa)
    through = atmosphere_of(3300.0, 270.0) if air else atmosphere_of(0.0, 0.0)
    there = points(seed)
    film = film_from_object(there, exterior, CAMERA, through)
    back = object_from_film(film, there[:, 2], exterior, CAMERA, through)
    np.testing.assert_allclose(back, there, atol=1e-4)


def test_projection_with_lens_is_opencv_s__oracle():
    exterior = ExteriorOrientation(CENTRE, 0.02, -0.03, 2.1)
    camera = Camera("wide", 152.0, (230.0, 230.0), (0.05, -0.03), LENS)
    there = points(1)
    flip = np.diag([1.0, -1.0, -1.0])  # OpenCV: y down, z to the ground
    turn = flip @ exterior.object_from_image.T
    c = camera.principal_distance_mm
    k1, k2, k3 = LENS
    theirs, _ = cv2.projectPoints(
        there - CENTRE,
        cv2.Rodrigues(turn)[0],
        np.zeros(3),
        np.diag([c, c, 1.0]),
        np.array([k1 * c**2, k2 * c**4, 0.0, 0.0, k3 * c**6]),
    )
    ours = film_from_object(there, exterior, camera) - np.array(camera.principal_point_mm)
    np.testing.assert_allclose(ours, theirs[:, 0] * [1.0, -1.0], atol=1e-9)


def test_lens_and_refraction_are_undone__law():
    rng = np.random.default_rng(2)
    ideal = rng.uniform(-110, 110, (80, 2))
    air = atmosphere_of(5000.0, 200.0)
    exterior = ExteriorOrientation(np.array([0.0, 0.0, 152.0]), 0.0, 0.0, 0.0)
    flat = np.column_stack([ideal, np.zeros(80)])
    curved = film_from_object(
        flat, exterior, CAMERA, type(air)(refraction=air.refraction, curvature_per_m=0.0)
    )
    np.testing.assert_allclose(ideal_from_film(curved, CAMERA, air), ideal, atol=1e-9)


def test_what_lies_behind_the_camera_has_no_image__law():
    exterior = ExteriorOrientation(CENTRE, 0.0, 0.0, 0.0)
    above = CENTRE + np.array([[10.0, 0.0, 50.0], [10.0, 0.0, -50.0]])
    film = film_from_object(above, exterior, CAMERA)
    assert np.isnan(film[0]).all()
    assert np.isfinite(film[1]).all()


@settings(max_examples=60)
@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_angles_and_rotation_are_each_other_s_inverse__law(omega, phi, kappa):
    rotation = rotation_from_angles(omega, phi, kappa)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(angles_from_rotation(rotation), (omega, phi, kappa), atol=1e-9)


def some_photo(seed):
    rng = np.random.default_rng(seed)
    omega, phi = rng.uniform(-0.2, 0.2, size=2)
    exterior = ExteriorOrientation(ABOVE, float(omega), float(phi), float(rng.uniform(-3, 3)))
    plane = rng.uniform(-1500, 1500, size=(15, 2))
    return exterior, np.column_stack([plane + ABOVE[:2], rng.uniform(200, 400, size=15)])


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
@settings(max_examples=20)
def test_film_is_that_of_the_collinearity_equations__law(seed):
    exterior, points = some_photo(seed)
    expected = film_from_object(points, exterior, STRONG, AIR)
    film = film_partials(points, exterior, STRONG, AIR).film
    np.testing.assert_allclose(film.T, expected, rtol=0, atol=1e-10)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_centre_and_point_partials_are_differences__law(seed):
    exterior, points = some_photo(seed)
    ours = film_partials(points, exterior, STRONG, AIR).by_centre

    def by_centre(step):
        return film_from_object(points, replace(exterior, centre=ABOVE + step), STRONG, AIR)

    def by_point(step):
        return film_from_object(points + step, exterior, STRONG, AIR)

    assert_close(ours, differences(by_centre, 0.1, 3))
    assert_close(-ours, differences(by_point, 0.1, 3))


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_rotation_partials_are_differences__law(seed):
    exterior, points = some_photo(seed)

    def by_increment(increment):
        turned = exterior.object_from_image @ rotations_from_increments(increment[None])[0]
        moved = ExteriorOrientation(ABOVE, *angles_from_rotation(turned))
        return film_from_object(points, moved, STRONG, AIR)

    ours = film_partials(points, exterior, STRONG, AIR).by_rotation
    assert_close(ours, differences(by_increment, 1e-5, 3))


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_camera_partials_are_differences__law(seed):
    exterior, points = some_photo(seed)
    scale = np.array([1.0, 1.0, 1.0, 1e-6, 1e-10])

    def by_constants(step):
        c, x0, y0, k1, k2 = np.array([152.0, 0.3, -0.2, 1e-6, -2e-10]) + step * scale
        camera = replace(
            STRONG,
            principal_distance_mm=float(c),
            principal_point_mm=(float(x0), float(y0)),
            radial_distortion=(float(k1), float(k2), 1e-14),
        )
        return film_from_object(points, exterior, camera, AIR)

    ours = film_partials(points, exterior, STRONG, AIR).by_camera * scale[:, None]
    numerical = differences(by_constants, 1e-3, 5)
    for row in range(5):
        assert_close(ours[:, row], numerical[:, row])


def test_points_behind_the_camera_are_nan__law():
    exterior = ExteriorOrientation(ABOVE, 0.0, 0.0, 0.0)
    film = film_partials(np.array([[1000.0, 2000.0, 3100.0]]), exterior, STRONG).film
    assert np.isnan(film).all()


@given(
    omega=st.floats(-1, 1), phi=st.floats(-1, 1), kappa=st.floats(-3, 3), seed=st.integers(0, 999)
)
@settings(max_examples=30)
def test_angle_partials_are_differences__law(omega, phi, kappa, seed):
    rotation = rotation_from_angles(omega, phi, kappa)[None]
    ours = angles_by_increments(rotation)[0]
    step = np.random.default_rng(seed).normal(size=3) * 1e-6
    after = angles_from_rotations(rotation @ rotations_from_increments(step[None]))
    before = angles_from_rotations(rotation @ rotations_from_increments(-step[None]))
    np.testing.assert_allclose(ours @ step, (after - before)[0] / 2, rtol=0, atol=1e-13)


@given(st.lists(st.floats(-3, 3), min_size=3, max_size=3))
@settings(max_examples=30)
def test_increments_give_rotations__law(vector):
    rotation = rotations_from_increments(np.array([vector]))[0]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(rotation @ np.array(vector), vector, atol=1e-13)
