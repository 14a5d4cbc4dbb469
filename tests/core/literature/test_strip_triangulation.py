"""Strips on flights that are known."""

import numpy as np

from core.literature.independent_models import Sights, Triangulated, form_models
from core.literature.methods import strip_names, triangulate_strips
from tests.core.literature.test_independent_models import EXACT, astray_m
from tests.flights import fly


def test_without_noise_strips_find_the_truth__truth():
    """Relief and Earth curvature included."""
    rng = np.random.default_rng(1)
    flight = fly(EXACT, rng)
    models = form_models(flight.block, rng)
    found = triangulate_strips(flight.block, models, Sights.of(flight.block))
    assert isinstance(found, Triangulated)
    assert astray_m(found.block, flight.truth) < 0.01
    assert found.joint_m.max() < 0.001


def test_strips_are_those_of_the_flight__truth():
    """Neighbours of a strip are as near each other as none of another is."""
    flight = fly(EXACT, np.random.default_rng(4))
    strips = strip_names(flight.block)
    assert len(strips) == EXACT.strips
    assert {len(names) for names in strips} == {EXACT.photos_per_strip}
    centres = {name: photo.exterior.centre for name, photo in flight.truth.photos.items()}
    for names in strips:
        line = np.array([centres[name][:2] for name in names])
        way = line[-1] - line[0]
        assert (np.diff(line, axis=0) @ way > 0).all()
