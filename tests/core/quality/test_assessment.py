"""Overlaps and crab of a flight are those of its strips."""

import numpy as np

from core.adjustment.block_adjustment import adjust_block
from core.quality.assessment import assess_block
from tests.flights import FlightPlan, fly


def test_strips_are_those_flown_also_where_photos_overlap_more_beside_them__truth():
    """The neighbour with the largest overlap was taken for the next photo of the strip."""
    plan = FlightPlan(forward=0.3, side=0.4, ties=120, camera_errors=False)
    flight = fly(plan, np.random.default_rng(3))
    found = assess_block(adjust_block(flight.block))
    names = list(flight.block.photos)
    strip = {name: number // plan.photos_per_strip for number, name in enumerate(names)}
    along = {(one.first, one.second): one.along for one in found.overlaps}
    beside = [pair for pair, is_along in along.items() if is_along is not None]
    assert len(beside) >= 7
    assert all(along[pair] == (strip[pair[0]] == strip[pair[1]]) for pair in beside)
    assert max(one.crab_deg for one in found.photos) < 10
