"""Blocks without an ortho, brought together by ties, against flights that are known."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.block import ExteriorPrior, TiePoints
from core.geometry.exterior import ExteriorOrientation
from core.localisation.tied_block import on_tied_ground, stand_by_ties
from tests.flights import FlightPlan, fly

OPTIONS = AdjustmentOptions()
PLAN = FlightPlan(strips=2, photos_per_strip=4, ties=400, camera_errors=False)
IN_FLIGHT = ExteriorPrior(np.full(3, 0.5), np.radians([0.1, 0.1, 0.2]))
CENTRES_ALONE = ExteriorPrior(np.full(3, 0.5), np.radians([3.0, 3.0, 45.0]))


def listed(flight, prior, rng):
    """The flight as a list of centres, and perhaps angles, tells it."""
    photos, hypotheses = {}, {}
    for name, photo in flight.block.photos.items():
        true = flight.truth.photos[name].exterior
        centre = true.centre + rng.normal(size=3) * prior.sigma_centre_m
        if prior is IN_FLIGHT:
            known = [ExteriorOrientation(centre, true.omega, true.phi, true.kappa)]
        else:
            quarters = true.kappa + 0.1 + np.arange(4) * np.pi / 2
            known = [ExteriorOrientation(centre, 0.0, 0.0, k) for k in rng.permutation(quarters)]
        hypotheses[name] = tuple(known)
        photos[name] = replace(
            photo, exterior=known[0], approximate=known[0], prior=prior, oriented=False
        )
    bare = replace(flight.block, surveyed={}, measurements={})
    return bare.with_photos(photos), hypotheses


@pytest.mark.parametrize("seed", range(3))
def test_centres_and_ties_orient_a_block__truth(seed):
    """No angle is known: ties give tilts and turns, centres the place."""
    flight = fly(PLAN, np.random.default_rng(seed))
    block, hypotheses = listed(flight, CENTRES_ALONE, np.random.default_rng(seed))
    found, doubts = stand_by_ties(block, hypotheses, OPTIONS)
    assert not doubts
    for name, photo in found.photos.items():
        true = flight.truth.photos[name].exterior
        assert photo.oriented
        # Eight centres of 0.5 m hold a stiff body.
        assert np.abs(photo.exterior.centre - true.centre).max() < 3.0
        for angle in ("omega", "phi", "kappa"):
            apart = getattr(photo.exterior, angle) - getattr(true, angle)
            assert abs(np.angle(np.exp(1j * apart))) < np.radians(0.3)


def test_a_photo_without_ties_stays_only_where_it_was_measured_in_flight__truth():
    flight = fly(replace(PLAN, strips=1, photos_per_strip=2), np.random.default_rng(0))
    for prior, stands in ((IN_FLIGHT, True), (CENTRES_ALONE, False)):
        block, hypotheses = listed(flight, prior, np.random.default_rng(0))
        untied = replace(block, ties=TiePoints.none())
        found, doubts = stand_by_ties(untied, hypotheses, OPTIONS)
        assert {photo.oriented for photo in found.photos.values()} == {stands}
        assert len(doubts) == (0 if stands else 2)


def test_tie_points_tell_the_height_of_the_ground__truth():
    flight = fly(replace(PLAN, strips=1), np.random.default_rng(0))
    block, hypotheses = listed(flight, IN_FLIGHT, np.random.default_rng(0))
    wrong = block.with_photos(
        {name: replace(photo, ground_height_m=0.0) for name, photo in block.photos.items()}
    )
    found, _ = stand_by_ties(wrong, hypotheses, OPTIONS)
    for name, photo in on_tied_ground(found, OPTIONS).photos.items():
        true = flight.truth.photos[name].ground_height_m
        # The relief under one photo.
        assert photo.ground_height_m == pytest.approx(true, abs=40.0)
