"""Thinning: areas served, quotas kept, the best of each place."""

from pathlib import Path

import numpy as np
import pytest

from core.block import Block, ExteriorPrior, Photo, TiePoints
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation
from core.ties.chains import common_rays, rays_per_point
from core.ties.thinning import ThinningOptions, frame_cells, thin_ties

NONE = np.zeros((0, 2))
INTERIOR = InteriorOrientation(
    "affine", np.array([[0.1, 0, -100], [0, -0.1, 100]]), (), NONE, NONE, 0.0
)
CAMERA = Camera("c", 150.0, (200.0, 200.0))
PRIOR = ExteriorPrior(np.ones(3), np.full(3, 0.1))


def block(names: str) -> Block:
    start = ExteriorOrientation(np.array([0.0, 0, 1000]), 0.0, 0.0, 0.0)
    photos = {
        name: Photo(name, Path(), (2000, 2000), "c", INTERIOR, start, start, PRIOR, 0.0)
        for name in names
    }
    return Block("EPSG:5514", {"c": CAMERA}, photos)


def random_ties(rng, names: str, points: int) -> TiePoints:
    """Points crowded into one corner, with two or three rays."""
    point, photo = [], []
    for number in range(points):
        shown = np.sort(rng.choice(len(names), rng.integers(2, 4), replace=False))
        point += [number] * len(shown)
        photo += shown.tolist()
    pixels = 2000 * rng.beta(1.0, 2.5, (len(point), 2))
    sigmas = rng.uniform(0.05, 0.4, len(point))
    return TiePoints(tuple(names), np.array(point), np.array(photo), pixels, sigmas)


@pytest.mark.parametrize("seed", range(5))
def test_areas_and_pairs_are_served_and_photos_not_crowded__law(seed):
    rng = np.random.default_rng(seed)
    ties = random_ties(rng, "abcd", 3000)
    options = ThinningOptions(wanted=120, most=180)
    kept = thin_ties(block("abcd"), ties, options)
    ray = kept[ties.point]
    cells = frame_cells(block("abcd"), ties, 3)
    for photo in range(4):
        mine = ties.photo == photo
        assert 120 <= np.sum(ray & mine) <= 180
        before = np.bincount(cells[mine], minlength=9)
        after = np.bincount(cells[mine & ray], minlength=9)
        assert (after >= np.minimum(before, 3)).all()
        for other in range(photo):
            shared, _ = common_rays(ties, other, photo)
            assert ray[shared].sum() >= min(15, len(shared))


def test_points_are_spread_and_have_more_rays_than_before__law():
    ties = random_ties(np.random.default_rng(9), "abcd", 3000)
    kept = thin_ties(block("abcd"), ties, ThinningOptions(wanted=120, most=180))
    ray = kept[ties.point]
    cells = frame_cells(block("abcd"), ties, 8) + 64 * ties.photo
    before, after = np.bincount(cells), np.bincount(cells[ray])
    assert after.std() / after.mean() < 0.8 * before.std() / before.mean()
    rays = rays_per_point(ties)
    assert rays[kept].mean() > rays.mean() + 0.15


def test_of_two_in_one_place_the_better_stays__truth():
    pixels = np.array([[10.0, 10], [12, 10], [11, 11], [13, 11]])
    sigmas = np.array([0.3, 0.3, 0.1, 0.1])
    ties = TiePoints(("a", "b"), np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1]), pixels, sigmas)
    options = ThinningOptions(per_gruber_area=1, per_pair=1, wanted=1, most=1)
    assert thin_ties(block("ab"), ties, options).tolist() == [False, True]
    reserve = np.array([False, True])
    assert thin_ties(block("ab"), ties, options, reserve).tolist() == [True, False]


def test_no_ties_stay_none__law():
    assert len(thin_ties(block("ab"), TiePoints.none())) == 0
