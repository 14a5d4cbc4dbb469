"""Several epochs of one place: what changes is known, and goes one way."""

from itertools import pairwise

import numpy as np
import pytest
from shapely.geometry import Polygon

from core.synthetic.changes import HEIGHTS_M
from core.synthetic.epochs import changes_between, plan_epochs
from core.synthetic.options import SyntheticOptions

YEARS = (1938, 1953, 1984)


@pytest.fixture(scope="module")
def epochs():
    return plan_epochs(
        SyntheticOptions(size="tiny", seed=9228, strips=1, photos_per_strip=2), YEARS
    )


def test_heights_differ_by_what_was_planted_alone__truth(epochs):
    changes = epochs[0].landscape.changes
    assert {change.kind for change in changes} == set(HEIGHTS_M)
    middles = np.array([Polygon(change.outline).centroid.coords[0] for change in changes])
    rng = np.random.default_rng(9229)
    west, south, east, north = epochs[0].flight.bounds
    free = rng.uniform((west, south), (east, north), (300, 2))
    # Beyond the longest half diagonal of a change, and what a spline carries further.
    apart = np.linalg.norm(free[:, None] - middles, axis=2).min(axis=1) > 90
    for one, other in pairwise(epochs):
        rise = [
            other.flight.terrain.heights(p) - one.flight.terrain.heights(p)
            for p in (middles, free[apart])
        ]
        new = changes_between(epochs, one.year, other.year)
        sign = {"wood": -1}
        expected = [sign.get(c.kind, 1) * HEIGHTS_M[c.kind] if c in new else 0.0 for c in changes]
        assert rise[0] == pytest.approx(expected, abs=0.5)
        assert np.abs(rise[1]).max() < 0.05
    today = epochs[-1].landscape.terrain.heights(middles)
    bare = epochs[0].landscape.terrain_then.heights(middles)
    dug = [HEIGHTS_M[c.kind] if c.of_ground else 0.0 for c in changes]
    stood = [HEIGHTS_M["wood"] if c.kind == "wood" else 0.0 for c in changes]
    assert today - bare == pytest.approx(np.array(dug) - stood, abs=0.5)


def test_what_has_changed_once_stays_so_to_the_present__law(epochs):
    networks = [epoch.landscape.network.roads for epoch in epochs]
    changed = [
        np.array(
            [
                np.array_equal(road.then, road.now) and road.existed_then == road.exists_now
                for road in roads
            ]
        )
        for roads in networks
    ]
    for before, after in pairwise(changed):
        assert not (before & ~after).any()
        assert after.sum() > before.sum()
    for roads in networks[1:]:
        for one, road in zip(networks[0], roads, strict=True):
            assert np.array_equal(one.now, road.now)


def test_each_is_flown_and_filmed_anew__law(epochs):
    centres = [epoch.flight.exposures[0].exterior.centre[:2] for epoch in epochs]
    names = {photo.photo_id for epoch in epochs for photo in epoch.flight.exposures}
    assert len(names) == 6
    assert np.linalg.norm(centres[0] - centres[1]) > 1
    assert len({epoch.options.seed for epoch in epochs}) == 3
