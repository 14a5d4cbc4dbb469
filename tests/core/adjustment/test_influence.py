"""What control does to a block, in closed form, against the adjustment made again."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block, adjust_with_solution
from core.adjustment.influence import Influence, influence_of
from tests.flights import FlightPlan, fly

PLAIN = AdjustmentOptions(robust=False)
PLAN = FlightPlan(ties=500, control=24, check=12)


@pytest.fixture(scope="module")
def flight():
    return fly(PLAN, np.random.default_rng(2))


@pytest.fixture(scope="module")
def report(flight):
    return adjust_block(flight.block, PLAIN)


@pytest.fixture(scope="module")
def influence(report):
    return influence_of(report, PLAIN)


def adjusted_centres(report):
    return np.array([photo.exterior.centre for photo in report.block.photos.values()])


def control_keys(block, count):
    keys = [key for key in block.measurements if block.surveyed[key[0]].role == "control"]
    return keys[:: max(1, len(keys) // count)]


def test_leaving_each_point_out_is_told_to_first_order__oracle(flight, influence, report):
    judged = influence.leave_one_out()
    assert len(judged) == len(report.surveyed_positions)
    photo = next(iter(report.block.photos.values()))
    above = photo.exterior.centre[2] - photo.ground_height_m
    for point in judged[::5]:
        known, free = flight.block.surveyed[point.point_id], np.isfinite(point.difference_m)
        loose = replace(known, sigma_m=np.where(free, 1e7, known.sigma_m))
        surveyed = {**flight.block.surveyed, point.point_id: loose}
        again = adjust_block(replace(flight.block, surveyed=surveyed), PLAIN)
        off = again.surveyed_positions[point.point_id] - known.position
        # Rays that meet bend by d^2 / H over a shift d, which tangents do not know.
        bend = np.sum(point.difference_m[free] ** 2) / above
        np.testing.assert_allclose(off[free], point.difference_m[free], atol=1e-3 + 5 * bend)


def test_places_are_worth_as_many_errors_as_their_covariance_tells__law(influence, report):
    """One place twice is worth what it is once; far photos of a block add to it, not all of it."""
    at = {
        name: np.array([*photo.exterior.centre[:2], photo.ground_height_m])
        for name, photo in report.block.photos.items()
    }
    (name, place), *_ = at.items()
    once = influence.ground_freedom([(name, place)])
    assert 1.0 <= once <= 2.0
    assert influence.ground_freedom([(name, place)] * 2) == pytest.approx(once)
    assert once < influence.ground_freedom(list(at.items())) < 2 * len(at)
    assert np.isnan(influence.ground_freedom([("nowhere", place)]))


def test_left_out_points_keep_their_sigmas__truth():
    """Differences over their standard deviations have variance one: they are honest judges."""
    lengths = []
    for seed in range(12):
        report = adjust_block(fly(PLAN, np.random.default_rng(seed)).block, PLAIN)
        for point in influence_of(report, PLAIN).leave_one_out():
            lengths.append(np.nanmean((point.difference_m / point.sigma_m) ** 2))
    assert np.mean(lengths) == pytest.approx(1.0, abs=0.15)


def test_rejecting_does_what_was_told__oracle(flight, influence):
    reliabilities = influence.reliabilities()
    cost = influence.solution.fit.cost()
    for key in control_keys(flight.block, 6):
        told = reliabilities[key]
        out = replace(flight.block.measurements[key], status="rejected")
        _, solution = adjust_with_solution(flight.block.with_measurement(out), PLAIN)
        assert told.test == pytest.approx(np.sqrt(cost - solution.fit.cost()), rel=1e-3, abs=1e-3)
        moved = np.linalg.norm(influence.ground.of(step_between(influence, solution)), axis=2)
        assert told.shift_m == pytest.approx(moved.max(), rel=0.02, abs=1e-4)


def step_between(influence, solution):
    """Change of all photos' and cameras' unknowns from one adjustment to another."""
    one, other = influence.solution.fit.state, solution.fit.state
    network = influence.solution.network
    turned = np.swapaxes(one.rotations, 1, 2) @ other.rotations
    turns = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=1)
    photos = np.hstack([other.centres - one.centres, turns])
    lens = (other.constants - one.constants)[:, : network.lens] * network.scale
    return np.concatenate([photos.ravel(), lens.ravel()[: network.lensed]])[:, None]


def test_a_report_gives_the_equations_it_was_made_with__law(flight):
    """Also with self-calibration, held parameters and gross errors left out."""
    options = AdjustmentOptions(self_calibration=("tangential",))
    report, solution = adjust_with_solution(flight.block, options)
    direct, again = Influence(report.block, solution), influence_of(report, options)
    told, once_more = direct.corner_sigmas(), again.corner_sigmas()
    for name, sigmas in told.items():
        np.testing.assert_allclose(once_more[name], sigmas, rtol=1e-3)
    for one, other in zip(direct.leave_one_out(), again.leave_one_out(), strict=True):
        np.testing.assert_allclose(one.difference_m, other.difference_m, atol=1e-3)


def test_smallest_detectable_errors_are_found_in_four_of_five_cases__truth(
    flight, report, influence
):
    """Baarda's limit: an error of that size lifts w to 4.13, and 80 % of them beyond 3.29."""
    reliabilities = influence.reliabilities()
    assert set(reliabilities) == set(report.redundancy_numbers)
    key = control_keys(flight.block, 1)[0]
    told = reliabilities[key]
    size = told.smallest_error_px
    item = flight.block.measurements[key]
    moved = []
    for sign in (1, -1):
        for axis in ("column", "row"):
            wrong = replace(item, **{axis: getattr(item, axis) + sign * size})
            again = adjust_block(flight.block.with_measurement(wrong), PLAIN)
            moved.append(np.abs(adjusted_centres(again) - adjusted_centres(report)).max())
    assert size > 4.13 * item.sigma_px
    assert 0.01 < told.its_shift_m < 10 * max(moved)


def test_check_points_are_off_by_what_is_predicted__truth():
    squares, told = [], []
    for seed in range(15):
        for check in adjust_block(fly(PLAN, np.random.default_rng(seed)).block, PLAIN).checks:
            squares.append(check.difference_m[:2] ** 2)
            told.append(check.sigma_m[:2] ** 2)
            assert (check.sigma_m[2] == 0) == (check.used_scans == 1)
    ratio = np.sqrt(np.mean(told) / np.mean(squares))
    assert 0.8 < ratio < 1.25
