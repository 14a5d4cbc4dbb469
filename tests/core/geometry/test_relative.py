"""Relative orientation: parallaxes, robust search, and what chance cannot do."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from core.doubts import Failure
from core.geometry.exterior import ExteriorOrientation
from core.geometry.relative import (
    OrientedPair,
    RayPairs,
    RelativeOptions,
    log10_false_alarms,
    orient_relative,
    parallax,
    relative_from_exteriors,
)

PIXEL = 0.02 / 150.0
FIRST = ExteriorOrientation(np.array([0.0, 0.0, 2000.0]), 0.02, -0.01, 0.1)
SECOND = ExteriorOrientation(np.array([900.0, 60.0, 1980.0]), -0.015, 0.02, 3.2)
ROUGH = relative_from_exteriors(
    ExteriorOrientation(np.array([100.0, -80.0, 2000.0]), 0.0, 0.0, 0.12),
    ExteriorOrientation(np.array([850.0, 100.0, 2000.0]), 0.0, 0.0, 3.18),
)
TRUE = relative_from_exteriors(FIRST, SECOND)


def rays_to(exterior: ExteriorOrientation, ground: np.ndarray) -> np.ndarray:
    image = (ground - exterior.centre) @ exterior.object_from_image
    return image / -image[:, 2:]


def scene(rng, count=300, relief_m=60.0, noise_px=0.0) -> RayPairs:
    ground = rng.uniform([0, -700, -relief_m], [900, 700, relief_m + 1e-9], (count, 3))
    rays = [rays_to(exterior, ground) for exterior in (FIRST, SECOND)]
    for one in rays:
        one[:, :2] += rng.normal(0, noise_px * PIXEL, (count, 2))
    return RayPairs(*rays, (PIXEL, PIXEL))


def found_in(rays: RayPairs, rng, start=ROUGH):
    return orient_relative(rays, (5000.0, 5000.0), start, RelativeOptions(), rng=rng)


def test_rays_of_one_point_have_no_parallax__truth():
    residual = parallax(scene(np.random.default_rng(1)), TRUE)
    assert np.abs(residual).max() < 1e-8


def test_parallax_is_scaled_to_the_noise_of_a_coordinate__truth():
    residual = parallax(scene(np.random.default_rng(2), count=20_000, noise_px=0.7), TRUE)
    assert np.std(residual) == pytest.approx(0.7, rel=0.02)


@pytest.mark.parametrize("relief_m", [60.0, 0.0], ids=["hilly", "flat"])
@pytest.mark.parametrize("wrong_share", [0.1, 0.5])
def test_orientation_is_found_among_wrong_matches__truth(relief_m, wrong_share):
    rng = np.random.default_rng(3)
    rays = scene(rng, relief_m=relief_m, noise_px=0.4)
    wrong = rng.random(len(rays.first)) < wrong_share
    low, high = rays.second[:, :2].min(axis=0), rays.second[:, :2].max(axis=0)
    rays.second[wrong, :2] = rng.uniform(low, high, (wrong.sum(), 2))
    found = found_in(rays, rng)
    assert isinstance(found, OrientedPair)
    assert (found.agrees & ~wrong).sum() >= 0.97 * (~wrong).sum()
    assert (found.agrees & wrong).sum() <= 0.02 * max(wrong.sum(), 50)
    clean = parallax(scene(rng, relief_m=relief_m), found.orientation)
    assert np.sqrt(np.mean(clean**2)) < 0.3


def test_orientation_is_found_without_a_usable_approximation__truth():
    rng = np.random.default_rng(4)
    elsewhere = ExteriorOrientation(np.array([0.0, 900.0, 2000.0]), 0.0, 0.0, 0.0)
    found = found_in(scene(rng, noise_px=0.4), rng, relative_from_exteriors(FIRST, elsewhere))
    assert isinstance(found, OrientedPair)
    assert found.agrees.mean() > 0.97
    assert np.allclose(found.orientation.rotation, TRUE.rotation, atol=2e-3)
    assert np.allclose(found.orientation.base, TRUE.base, atol=5e-3)


def test_matches_by_chance_are_refused__truth():
    for seed in range(10):
        rng = np.random.default_rng(seed)
        rays = scene(rng, count=200)
        shuffled = replace(rays, second=rays.second[rng.permutation(200)])
        assert isinstance(found_in(shuffled, rng), Failure)


def test_same_seed_same_orientation__law():
    found = []
    for _ in range(2):
        rng = np.random.default_rng(5)
        found.append(found_in(scene(rng, noise_px=0.5), rng))
    assert np.array_equal(found[0].parallax_px, found[1].parallax_px)


def test_more_agreement_is_less_likely_by_chance__law():
    nfas = [log10_false_alarms(100, agreeing, 2.0, (3000.0, 3000.0)) for agreeing in range(6, 100)]
    assert all(later < earlier for earlier, later in pairwise(nfas[4:]))
    assert log10_false_alarms(100, 5, 2.0, (3000.0, 3000.0)) == 0.0
