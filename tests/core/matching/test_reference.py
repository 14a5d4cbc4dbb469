"""The reference held in memory is the one on disk."""

import numpy as np

from core.matching.reference import open_reference


def test_heights_held_in_memory_are_those_on_disk__law(given, placed):
    bounds = placed.block.bounds
    held, whole = open_reference(given.reference, bounds), open_reference(given.reference)
    rng = np.random.default_rng(0)
    places = rng.uniform(bounds[:2], bounds[2:], (200, 2))
    np.testing.assert_allclose(held.dem.heights(places), whole.dem.heights(places), atol=1e-6)
