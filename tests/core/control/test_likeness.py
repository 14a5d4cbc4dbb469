"""Likeness about a point: the peak beside a place is where the point truly is."""

import numpy as np

from core.control.likeness import Likeness, likeness_about, search_options
from core.doubts import Failure
from core.localisation.photo_orientation import OrientationOptions
from core.matching.local_search import SEPARATION_PX


def true_places(tiny, count):
    """Photo, position and true pixel of points well inside the photos."""
    rng = np.random.default_rng(4)
    for name in tiny.names[:2]:
        columns, rows = tiny.photos[name].size_px
        pixels = rng.uniform(0.3, 0.7, (count, 2)) * np.array([columns, rows])
        for pixel in pixels:
            photo = tiny.photos[name]
            heights = np.array([photo.ground_height_m])
            for _ in range(4):
                ground = photo.object_from_pixel(pixel[None], heights, tiny.truth.camera)
                heights = tiny.truth.heights_at(ground)
            yield name, pixel[None]


def test_a_place_beside_is_refined_to_the_true_one__truth(tiny):
    reference, options = tiny.archival(), OrientationOptions()
    before, after = [], []
    for name, pixel in true_places(tiny, 12):
        opened = tiny.opened(name)
        sizes = search_options(opened, reference, options, 10.0)
        likeness = likeness_about(opened, reference, pixel, sizes)
        assert not isinstance(likeness, Failure)
        beside = pixel + np.array([[1.1, -0.9]])
        found = likeness.refined(beside)
        if not isinstance(found, Failure):
            before.append(np.linalg.norm(beside - pixel))
            after.append(np.linalg.norm(found - pixel))
    assert len(after) >= 18
    assert np.median(after) < 0.4 * np.median(before)


def test_far_from_any_peak_nothing_is_refined__law(tiny):
    reference, options = tiny.archival(), OrientationOptions()
    name, pixel = next(true_places(tiny, 1))
    opened = tiny.opened(name)
    sizes = search_options(opened, reference, options, 10.0)
    likeness = likeness_about(opened, reference, pixel, sizes)
    assert isinstance(likeness.refined(pixel + 5000.0), Failure)
    nowhere = likeness_about(opened, reference, np.full((1, 2), np.nan), sizes)
    assert isinstance(nowhere, Failure)


def test_chance_stays_below_its_height_in_nineteen_of_twenty_windows__truth():
    """Surfaces of independent places a separation of peaks apart, of two sizes."""
    rng = np.random.default_rng(5)
    for cells in (9, 20):
        side = cells * SEPARATION_PX
        limit = Likeness(np.zeros((side, side), np.float32), np.zeros((1, 2)), 1).chance_height
        passed = (rng.normal(0, 1, (4000, cells**2)).max(axis=1) > limit).mean()
        assert 0.035 < passed < 0.065


def test_height_is_counted_in_robust_sigma_of_the_surface__law():
    """It does not change with the scale and level of the likeness."""
    values = np.random.default_rng(2).normal(0, 1, (41, 41)).astype(np.float32)
    values[20, 20] = 5.0
    place = np.array([[60.0, 60.0]])
    plain = Likeness(values, np.array([[20.0, 20.0]]), 2)
    other = Likeness(values * 0.03 + 0.2, np.array([[20.0, 20.0]]), 2)
    assert abs(plain.height_at(place) - 5.0) < 0.5
    assert abs(other.height_at(place) - plain.height_at(place)) < 1e-3
