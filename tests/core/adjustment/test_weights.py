"""Weights that residuals tell: variance components, terrain, free network, control in parts."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.adjustment.positioning import places_along, strips_of
from core.block import UNKNOWN_M, TiePoints
from core.geometry.exterior import fit_similarity, rotation_from_angles
from tests.flights import FlightPlan, fly

PLAN = FlightPlan(strips=3, photos_per_strip=4, ties=900, control=90)
PLAIN = AdjustmentOptions(robust=False)


def test_variance_components_come_back__truth():
    true = {"tie": 1.8, "control_image": 0.6, "control_plan": 1.5, "control_height": 0.7}
    found = []
    for seed in range(6):
        sigma = np.array(PLAN.control_sigma_m) * [1.5, 1.5, 0.7]
        noisy = replace(
            PLAN,
            tie_sigma_px=0.9,
            control_sigma_px=0.6,
            control_sigma_m=tuple(sigma.tolist()),
        )
        block = fly(noisy, np.random.default_rng(seed)).block
        ties = replace(block.ties, sigma_px=np.full(len(block.ties.point), 0.5))
        known = np.array(PLAN.control_sigma_m)
        surveyed = {n: replace(p, sigma_m=known) for n, p in block.surveyed.items()}
        measured = {key: replace(m, sigma_px=1.0) for key, m in block.measurements.items()}
        stated = replace(block, ties=ties, surveyed=surveyed, measurements=measured)
        report = adjust_block(stated, replace(PLAIN, variance_components=True))
        assert report.sigma_nought == pytest.approx(1.0, abs=0.02)
        found.append([report.classes[name].factor / value for name, value in true.items()])
    np.testing.assert_allclose(np.mean(np.square(found), axis=0), 1.0, atol=0.15)


def test_terrain_holds_what_control_does_not__truth():
    """Control at one end alone: the heights of the far end come from the terrain."""
    flight = fly(replace(PLAN, strips=1, photos_per_strip=6), np.random.default_rng(2))
    block = flight.block
    west = np.quantile([p.position[0] for p in block.surveyed.values()], 0.25)
    near = {n for n, p in block.surveyed.items() if p.position[0] < west}
    measured = {key: m for key, m in block.measurements.items() if key[0] in near}
    ends = replace(block, measurements=measured)
    grounds = flight.ties

    def terrain(points):
        """The true ground, but for a forest over a fifth of it and a gap."""
        nearest = np.argmin(
            np.linalg.norm(points[:, None, :2] - grounds[None, :, :2], axis=2), axis=1
        )
        heights = grounds[nearest, 2] - np.where(nearest % 5 == 0, 15.0, 0.0)
        return np.where(nearest % 7 == 0, np.nan, heights)

    def far_error(report):
        """Mean height error of the tie points furthest from control: how the block bends."""
        heights = report.tie_positions[:, 2] - grounds[: len(report.tie_positions), 2]
        far = grounds[: len(heights), 0] > np.quantile(grounds[:, 0], 0.8)
        return abs(np.nanmean(heights[far]))

    options = replace(PLAIN, dem_sigma_m=1.0)
    without, report = adjust_block(ends, PLAIN), adjust_block(ends, options, terrain=terrain)
    assert report.converged
    assert far_error(report) < 0.5 * far_error(without)
    assert report.classes["dem"].observations > 500
    last = max(report.exterior_sigmas)
    assert report.exterior_sigmas[last].centre_m[2] < without.exterior_sigmas[last].centre_m[2]


def test_control_in_plan_or_height_alone__truth():
    flight = fly(PLAN, np.random.default_rng(3))
    surveyed = {
        name: replace(
            point,
            # What is not known may be wrong by any amount.
            position=point.position + np.where(known_in(number), 0.0, 40.0),
            sigma_m=np.where(known_in(number), point.sigma_m, UNKNOWN_M),
        )
        for number, (name, point) in enumerate(flight.block.surveyed.items())
    }
    report = adjust_block(replace(flight.block, surveyed=surveyed), PLAIN)
    assert report.sigma_nought == pytest.approx(1.0, abs=0.1)
    assert report.rms_m["control_X"] < 1.0
    for name, photo in report.block.photos.items():
        off = photo.exterior.centre - flight.truth.photos[name].exterior.centre
        assert np.abs(off / report.exterior_sigmas[name].centre_m).max() < 4.5


def known_in(number):
    return np.array([[True, True, False], [False, False, True], [True, True, True]][number % 3])


# ------------------------------------------------------------------ free network


def test_free_network_keeps_its_shape_whatever_control_says__law():
    flight = fly(replace(PLAN, camera_errors=False), np.random.default_rng(4))
    options = replace(PLAIN, free_network=True, estimate_cameras=False)
    report = adjust_block(flight.block, options)
    bent = {
        name: replace(p, position=p.position + np.array([0, 0, bend(p.position)]))
        for name, p in flight.block.surveyed.items()
    }
    other = adjust_block(replace(flight.block, surveyed=bent), options)
    assert other.sigma_nought == pytest.approx(report.sigma_nought, rel=1e-4)
    ours, theirs = shape(report.block), shape(other.block)
    same = fit_similarity(ours, theirs, np.ones(len(ours)))
    np.testing.assert_allclose(same.moved(ours), theirs, atol=1e-3)
    assert other.rms_m["control_Z"] > 1.5 * report.rms_m["control_Z"]
    assert np.abs(shape(report.block) - shape(flight.truth)).max() < 3.0


def bend(position):
    """Ten metres of sag over the block."""
    return 1e-6 * (position[0] + 545_000) ** 2


def shape(block):
    return np.array([photo.exterior.centre for photo in block.photos.values()])


def test_free_network_sigmas_are_those_of_its_shape__truth():
    squares, points = [], []
    for seed in range(12):
        plan = replace(PLAN, strips=2, photos_per_strip=3, ties=500, camera_errors=False)
        flight = fly(plan, np.random.default_rng(seed))
        options = replace(PLAIN, free_network=True, estimate_cameras=False)
        report = adjust_block(flight.block, options)
        ours, true = shape(report.block), shape(flight.truth)
        onto_truth = fit_similarity(ours, true, np.ones(len(ours)))
        moved = onto_truth.moved(ours)
        sigmas = np.array([s.centre_m for s in report.exterior_sigmas.values()])
        squares.append(np.mean(((moved - true) / sigmas) ** 2))
        seen = np.isfinite(report.tie_positions[:, 0])
        off = onto_truth.moved(report.tie_positions[seen]) - flight.ties[: len(seen)][seen]
        points.append(np.mean((off / report.tie_sigmas_m[seen]) ** 2))
    assert np.mean(squares) == pytest.approx(1.0, abs=0.35)
    assert np.mean(points) == pytest.approx(1.0, abs=0.2)


def test_similarity_lays_a_body_onto_another__law():
    rng = np.random.default_rng(1)
    body = rng.normal(size=(12, 3)) * 500
    turn = rotation_from_angles(0.3, -1.0, 2.5)
    found = fit_similarity(body, 1.7 * body @ turn.T + [10, 20, 30], rng.uniform(1, 2, 12))
    assert found.scale == pytest.approx(1.7)
    np.testing.assert_allclose(found.rotation, turn, atol=1e-12)
    np.testing.assert_allclose(found.shift, [10, 20, 30], atol=1e-9)


# ------------------------------------------------------------------ strips


def test_strips_are_found_however_the_scans_lie__truth():
    flight = fly(replace(PLAN, ties=10, control=1), np.random.default_rng(5))
    photos = list(flight.truth.photos.values())
    side = [180.0 / 211.59 * 3170.0] * len(photos)
    expected = [int(photo.photo_id[:2]) for photo in photos]
    assert strips_of(photos, side).tolist() == expected
    quarter = [
        replace(p, exterior=replace(p.exterior, kappa=p.exterior.kappa + np.pi / 2)) for p in photos
    ]
    assert strips_of(quarter, side).tolist() == expected
    places = places_along(photos, np.array(expected))
    assert places.min() == -1.0
    assert places.max() == pytest.approx(1.0)


def test_a_hole_in_a_strip_makes_two__truth():
    flight = fly(replace(PLAN, strips=1, photos_per_strip=7, ties=10), np.random.default_rng(5))
    photos = [p for n, p in flight.truth.photos.items() if n[3:] not in ("002", "003", "004")]
    assert strips_of(photos, [2700.0] * 4).tolist() == [0, 0, 1, 1]


def test_ties_alone_still_work_with_every_option__law():
    flight = fly(replace(PLAN, strips=1, photos_per_strip=3, ties=150), np.random.default_rng(6))
    options = AdjustmentOptions(
        self_calibration=("gruen44",), variance_components=True, test="tau", gnss_shift="block"
    )
    report = adjust_block(replace(flight.block, measurements={}), options)
    assert np.isfinite(report.sigma_nought)
    alone = adjust_block(replace(flight.block, ties=TiePoints.none()), options)
    assert alone.redundancy_numbers
