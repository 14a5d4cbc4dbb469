"""Blocks without an ortho, brought together by ties, against flights that are known."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.block import ExteriorPrior, TiePoints
from core.geometry.exterior import ExteriorOrientation
from core.localisation.tied_block import on_tied_ground, stand_by_ties, stand_on_points
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


HELD = AdjustmentOptions(estimate_cameras=False, robust=False)
PLAN_OF_ON_POINTS = FlightPlan(
    strips=2, photos_per_strip=4, ties=400, control=24, camera_errors=False,
    control_sigma_px=0.5, control_sigma_m=(0.05, 0.05, 0.05),
)  # fmt: skip
ARCHIVE = ExteriorPrior(np.full(3, 30.0), np.radians([1.0, 1.0, 1.0]))


def by_hand(block):
    """The block with its control as points that the user brought."""
    surveyed = {n: replace(p, source="surveyed") for n, p in block.surveyed.items()}
    return replace(block, surveyed=surveyed)


def elsewhere(block, away_m=(250.0, -300.0, 60.0)):
    """The block as one body where its sources put it, which is wrong."""
    shift = np.array(away_m)
    photos = {}
    for name, photo in block.photos.items():
        e = photo.exterior
        there = ExteriorOrientation(e.centre + shift, e.omega, e.phi, e.kappa)
        photos[name] = replace(photo, exterior=there, approximate=there, prior=ARCHIVE)
    return block.with_photos(photos)


def with_points(block, count):
    """Only so many measured points, those furthest apart first."""
    names = sorted({m.point_id for m in block.measurements.values()})
    plan = np.array([block.surveyed[name].position[:2] for name in names])
    chosen = [int(np.argmin(plan.sum(axis=1)))]
    while len(chosen) < count:
        away = np.min([np.hypot(*(plan - plan[one]).T) for one in chosen], axis=0)
        chosen.append(int(np.argmax(away)))
    kept = {names[one] for one in chosen}
    return replace(
        block, measurements={k: m for k, m in block.measurements.items() if k[0] in kept}
    )


def off_m(report, flight):
    """How far the photos' ground lies from the true one, RMS in metres."""
    return apart_m(report.block, flight.truth)


def apart_m(block, truth):
    """How far the ground of the same photos lies apart in two blocks, RMS in metres."""
    away = []
    for name, photo in block.photos.items():
        size = np.array(photo.size_px)
        pixels = size * np.array([[0.25, 0.25], [0.75, 0.25], [0.5, 0.75]])
        heights = np.full(3, photo.ground_height_m)
        places = [
            one.object_from_pixel(pixels, heights, camera)
            for one, camera in (
                (photo, block.camera_of(name)),
                (truth.photos[name], truth.camera_of(name)),
            )
        ]
        away.append(places[0] - places[1])
    return float(np.sqrt(np.mean(np.square(np.concatenate(away)[:, :2]))))


@pytest.mark.parametrize("seed", range(3))
def test_measured_points_bring_a_block_from_where_its_sources_put_it__truth(seed):
    flight = fly(PLAN_OF_ON_POINTS, np.random.default_rng(seed))
    block = with_points(by_hand(elsewhere(flight.block)), 6)
    report = adjust_block(stand_on_points(block), HELD)
    # Half a pixel of 0.22 m, points of 5 cm: the sources 400 m off have no say left.
    assert report.converged
    assert off_m(report, flight) < 0.5
    assert 0.85 < report.sigma_nought < 1.15
    # Where the sources put it makes no difference; held by them it would.
    other = with_points(by_hand(elsewhere(flight.block, (-150.0, 200.0, -40.0))), 6)
    freed = adjust_block(stand_on_points(other), HELD).block
    bent, bent_elsewhere = (adjust_block(one, HELD).block for one in (block, other))
    assert apart_m(report.block, freed) < 0.2 * apart_m(bent, bent_elsewhere)
    assert apart_m(report.block, freed) < 0.02


def test_two_points_move_nothing__law():
    flight = fly(PLAN_OF_ON_POINTS, np.random.default_rng(0))
    block = with_points(by_hand(elsewhere(flight.block)), 2)
    same = stand_on_points(block)
    assert all(same.photos[name] is photo for name, photo in block.photos.items())


def test_what_was_measured_in_flight_keeps_its_say__law():
    flight = fly(PLAN_OF_ON_POINTS, np.random.default_rng(0))
    known = ExteriorPrior(np.full(3, 0.1), np.full(3, 1e-4))
    photos = {n: replace(p, prior=known) for n, p in flight.block.photos.items()}
    block = by_hand(flight.block.with_photos(photos))
    for name, photo in stand_on_points(block).photos.items():
        assert photo.prior is known
        assert photo.approximate is block.photos[name].approximate


def test_check_points_orient_nothing__law():
    flight = fly(PLAN_OF_ON_POINTS, np.random.default_rng(0))
    block = by_hand(elsewhere(flight.block))
    checks = {n: replace(p, role="check") for n, p in block.surveyed.items()}
    block = replace(block, surveyed=checks)
    same = stand_on_points(block)
    assert all(same.photos[name] is photo for name, photo in block.photos.items())


def lost_photo(seed):
    """One photo that nothing ties, of which only the kappa is wrong by half a turn as well."""
    flight = fly(replace(PLAN_OF_ON_POINTS, control=60), np.random.default_rng(seed))
    name = sorted(flight.block.photos)[1]
    block = by_hand(elsewhere(flight.block))
    photo = block.photos[name]
    turned = replace(photo.exterior, kappa=photo.exterior.kappa + np.pi)
    photo = replace(photo, exterior=turned, approximate=turned, oriented=False)
    own = {k: m for k, m in block.measurements.items() if k[1] == name}
    alone = replace(block, photos={name: photo}, measurements=own, ties=TiePoints.none())
    return flight, name, alone


@pytest.mark.parametrize("seed", range(3))
def test_a_photo_is_resected_from_points_measured_in_it__truth(seed):
    flight, name, alone = lost_photo(seed)
    assert len(alone.measurements) >= 6
    found = stand_on_points(alone).photos[name]
    true = flight.truth.photos[name].exterior
    assert found.oriented
    assert np.abs(found.exterior.centre - true.centre).max() < 15.0
    report = adjust_block(stand_on_points(alone), HELD)
    assert off_m(report, flight) < 1.0


def test_three_points_resect_no_photo_and_nor_does_one_that_was_taken_out__law():
    _, name, alone = lost_photo(0)
    assert not stand_on_points(with_points(alone, 3)).photos[name].oriented
    assert not stand_on_points(alone, frozenset([name])).photos[name].oriented


def test_a_point_measured_in_the_wrong_place_resects_no_photo__truth():
    _, name, alone = lost_photo(0)
    few = with_points(alone, 5)
    key = next(iter(few.measurements))
    wrong = replace(few.measurements[key], column=few.measurements[key].column + 2000.0)
    spoilt = replace(few, measurements={**few.measurements, key: wrong})
    assert not stand_on_points(spoilt).photos[name].oriented
