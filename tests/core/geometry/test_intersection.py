"""Intersection of rays."""

import numpy as np
import pytest

from core.doubts import Failure
from core.geometry.camera import Camera
from core.geometry.collinearity import atmosphere_of, film_from_object
from core.geometry.exterior import ExteriorOrientation
from core.geometry.intersection import Intersection, OrientedRay, closest_points, intersect

CAMERA = Camera("wide", 152.0, (230.0, 230.0), (0.01, -0.02), (1e-8, 0.0, 0.0))
AIR = atmosphere_of(3000.0, 300.0)
POINT = np.array([350.0, 120.0, 310.0])


def photos(count=3, base=900.0):
    return [
        OrientedRay(
            ExteriorOrientation(
                np.array([base * k, base * k / 30, 3000.0]), 0.01 * k, -0.02, 0.1 * k
            ),
            CAMERA,
            AIR,
        )
        for k in range(count)
    ]


def film_of(rays, point=POINT):
    return np.concatenate(
        [film_from_object(point[None], ray.exterior, ray.camera, ray.atmosphere) for ray in rays]
    )


def test_exact_rays_meet_in_their_point__truth():
    rays = photos()
    found = intersect(film_of(rays), np.full(3, 0.005), rays)
    assert isinstance(found, Intersection)
    np.testing.assert_allclose(found.position, POINT, atol=1e-6)
    np.testing.assert_allclose(found.residuals_mm, 0, atol=1e-9)


def test_covariance_is_that_of_the_scatter__truth():
    rays, rng = photos(), np.random.default_rng(3)
    sigma = np.array([0.004, 0.006, 0.008])
    film = film_of(rays)
    errors, covariance = [], np.zeros((3, 3))
    for _ in range(400):
        found = intersect(film + rng.normal(size=(3, 2)) * sigma[:, None], sigma, rays)
        assert isinstance(found, Intersection)
        errors.append(found.position - POINT)
        covariance = found.covariance
    mahalanobis = np.einsum("ni,ij,nj->n", errors, np.linalg.inv(covariance), errors)
    # Chi-square of 3 over 400 trials: 3 +- 0.12; three of these sigmas.
    assert np.mean(mahalanobis) == pytest.approx(3.0, abs=0.37)


def test_one_ray_and_parallel_rays_fail__law():
    single = photos(1)
    assert isinstance(intersect(film_of(single), np.full(1, 0.005), single), Failure)
    near = photos(2, base=5.0)
    assert isinstance(intersect(film_of(near), np.full(2, 0.005), near), Failure)


def test_closest_points_tell_the_angle__truth():
    # Two rays at 0.2 rad, and two at 0.002 rad, towards the origin.
    angles = np.array([0.1, -0.1, 0.001, -0.001])
    directions = np.column_stack([np.sin(angles), np.zeros(4), -np.cos(angles)])
    positions, met = closest_points(-1000 * directions, directions, np.array([0, 0, 1, 1]), 2)
    np.testing.assert_allclose(positions, 0, atol=1e-6)
    np.testing.assert_allclose(met, [0.2, 0.002], rtol=0.01)
