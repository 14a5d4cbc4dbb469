"""Enough control, and well spread: the rules counted, and the places where more would help most."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.adjustment.influence import influence_of
from core.block import Measurement
from core.quality.control_count import count_control
from core.quality.control_design import wanted_control
from tests.flights import FlightPlan, fly

PLAIN = AdjustmentOptions(robust=False, estimate_cameras=False)
PLAN = FlightPlan(strips=2, photos_per_strip=6, ties=500, control=60, check=4, camera_errors=False)


@pytest.fixture(scope="module")
def flight():
    return fly(PLAN, np.random.default_rng(11))


def kept(block, keep):
    """The block with only the control points of which `keep` is true."""
    surveyed = {
        name: point
        for name, point in block.surveyed.items()
        if point.role == "check" or keep(point.position)
    }
    measured = {key: item for key, item in block.measurements.items() if key[0] in surveyed}
    return replace(block, surveyed=surveyed, measurements=measured)


@pytest.fixture(scope="module")
def western(flight):
    """Control at one end only, adjusted."""
    east = np.array([p.exterior.centre[0] for p in flight.truth.photos.values()])
    limit = east.min() + 0.2 * np.ptp(east)
    return adjust_block(kept(flight.block, lambda position: position[0] < limit), PLAIN)


def test_control_all_over_the_block_keeps_the_rules__truth(flight):
    report = adjust_block(flight.block, PLAIN)
    count = count_control(report)
    assert count is not None
    assert count.models == 10
    side = PLAN.frame_mm * PLAN.flying_height_m / PLAN.principal_distance_mm
    assert count.base_m == pytest.approx(side * (1 - PLAN.forward), rel=0.05)
    assert count.plan.points == count.heights.points == len(report.surveyed_positions)
    assert count.plan.gap.bases < 5
    assert count.plan.per_model > 0.4
    assert count.check_share == pytest.approx(4 / 64, abs=0.01)


def test_the_edge_without_control_is_told_where_it_is__truth(flight, western):
    count = count_control(western)
    assert count is not None
    centres = np.array([p.exterior.centre for p in flight.truth.photos.values()])
    assert count.plan.gap.bases > 8
    assert count.plan.gap.middle[0] > centres[:, 0].mean()
    assert count.plan.gap.photo_id[-3:] in ("004", "005")
    assert count.poorest_strip[1] < len(western.surveyed_positions)


def test_heights_that_are_not_known_do_not_count__truth(flight):
    blind = {
        name: replace(point, sigma_m=np.array([*point.sigma_m[:2], 1e7]))
        for name, point in flight.block.surveyed.items()
    }
    count = count_control(adjust_block(replace(flight.block, surveyed=blind), PLAIN))
    assert count is not None
    assert count.heights.points == 0
    assert count.heights.per_model == 0
    assert count.plan.points > 30


def test_a_single_photo_has_no_rules__truth():
    alone = fly(FlightPlan(strips=1, photos_per_strip=1, ties=0), np.random.default_rng(1))
    assert count_control(adjust_block(alone.block, PLAIN)) is None


def test_what_a_wanted_point_would_bring_comes_true__law(flight, western):
    """The point is put in and everything adjusted again: the sigmas are those that were told."""
    ahead = influence_of(western, PLAIN)
    assert ahead is not None
    wants = wanted_control(ahead, 2)
    assert len(wants) == 2
    assert wants[0].sigma_then_m < 0.5 * wants[0].sigma_now_m
    block = western.block
    for number, want in enumerate(wants):
        block = with_point(block, want, f"new{number}")
        then = influence_of(adjust_block(block, PLAIN), PLAIN)
        assert then is not None
        lengths = {name: np.hypot(*s.T) for name, s in then.corner_sigmas().items()}
        assert lengths[want.photo_id][want.place] == pytest.approx(want.sigma_then_m, rel=0.02)
        assert max(s.max() for s in lengths.values()) == pytest.approx(want.worst_then_m, rel=0.02)


def test_no_other_corner_would_have_helped_more__law(flight, western):
    ahead = influence_of(western, PLAIN)
    assert ahead is not None
    want = wanted_control(ahead, 1)[0]
    east = [p.exterior.centre[0] for p in flight.truth.photos.values()]
    assert want.position[0] > np.mean(east), "control lies in the west"
    worst = max(np.hypot(*s.T).max() for s in ahead.corner_sigmas().values())
    assert want.worst_then_m < 0.7 * worst


def with_point(block, want, name):
    """The block with the wanted point, measured without error in every photo that shows it."""
    control = [p for p in block.surveyed.values() if p.role == "control"]
    used = [item.sigma_px for item in block.measurements.values() if item.used]
    point = replace(
        control[0],
        point_id=name,
        position=want.position,
        sigma_m=np.median([p.sigma_m for p in control], axis=0),
    )
    measured = dict(block.measurements)
    for photo_id in want.photos:
        photo = block.photos[photo_id]
        column, row = photo.pixel_from_object(want.position[None], block.camera_of(photo_id))[0]
        key = (name, photo_id)
        measured[key] = Measurement(*key, float(column), float(row), float(np.median(used)))
    return replace(block, surveyed={**block.surveyed, name: point}, measurements=measured)
