"""What decisions would do, told ahead, against the adjustment made again."""

from dataclasses import replace

import numpy as np
import pytest

from core.block.adjusted import AdjustmentOptions
from core.block.adjustment import adjust_block
from core.block.foresight import foresee
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
def ahead(report):
    return foresee(report, PLAIN)


def centres(exteriors):
    return np.array([exterior.centre for exterior in exteriors.values()])


def adjusted_centres(report):
    return centres({name: p.exterior for name, p in report.block.photos.items()})


def control_keys(block, count):
    keys = [key for key in block.measurements if block.surveyed[key[0]].role == "control"]
    return keys[:: max(1, len(keys) // count)]


def test_leaving_each_point_out_is_told_to_the_millimetre__law(flight, report, ahead):
    judged = ahead.leave_one_out()
    assert len(judged) == len(report.surveyed_positions)
    for point in judged[::5]:
        known, free = flight.block.surveyed[point.point_id], np.isfinite(point.difference_m)
        loose = replace(known, sigma_m=np.where(free, 1e7, known.sigma_m))
        surveyed = {**flight.block.surveyed, point.point_id: loose}
        again = adjust_block(replace(flight.block, surveyed=surveyed), PLAIN)
        off = again.surveyed_positions[point.point_id] - known.position
        np.testing.assert_allclose(off[free], point.difference_m[free], atol=1e-3)


def test_left_out_points_keep_their_sigmas__truth():
    """Differences over their standard deviations have variance one: they are honest judges."""
    lengths = []
    for seed in range(12):
        report = adjust_block(fly(PLAN, np.random.default_rng(seed)).block, PLAIN)
        for point in foresee(report, PLAIN).leave_one_out():
            lengths.append(np.nanmean((point.difference_m / point.sigma_m) ** 2))
    assert np.mean(lengths) == pytest.approx(1.0, abs=0.15)


def test_rejecting_does_what_was_told__law(flight, report, ahead):
    for key in control_keys(flight.block, 6):
        effect = ahead.effect(key)
        assert effect.rejects
        out = replace(flight.block.measurements[key], status="rejected")
        again = adjust_block(flight.block.with_measurement(out), PLAIN)
        assert_same(effect, again, ahead, report, key)
        # And taking it in again leads back.
        back = foresee(again, PLAIN).effect(key)
        assert not back.rejects
        assert back.shift_m == pytest.approx(effect.shift_m, rel=0.01, abs=1e-4)
        assert back.test == pytest.approx(effect.test, rel=0.01, abs=1e-3)
        assert back.sigma_nought == pytest.approx(report.sigma_nought, abs=1e-5)
        assert back.redundancy == pytest.approx(effect.redundancy, abs=1e-3)


def assert_same(effect, again, ahead, report, key):
    """The effect against the adjustment that was made."""
    told = centres(ahead.exteriors_after(effect))
    change = np.abs(adjusted_centres(again) - adjusted_centres(report)).max()
    np.testing.assert_allclose(told, adjusted_centres(again), atol=0.02 * change + 1e-4)
    assert effect.sigma_nought == pytest.approx(again.sigma_nought, abs=1e-5)
    np.testing.assert_allclose(effect.residual_px, again.residuals_px[key], atol=0.01)
    then = foresee(again, PLAIN).corner_sigmas()
    now = ahead.corner_sigmas()
    ratio = largest(then) / largest(now)
    assert effect.corner_sigma_ratio == pytest.approx(ratio, rel=1e-3)
    before, after = report.block.cameras["wide"], ahead.cameras_after(effect)["wide"]
    changed = again.block.cameras["wide"]
    shift = changed.principal_distance_mm - before.principal_distance_mm
    told_shift = after.principal_distance_mm - before.principal_distance_mm
    assert told_shift == pytest.approx(shift, rel=0.05, abs=2e-5)


def largest(sigmas):
    return max(np.hypot(*values.T).max() for values in sigmas.values())


def test_pending_point_that_no_other_photo_shows__law(flight):
    """A first measurement of a control point brings the point with it."""
    block = flight.block
    counts = {name: sum(key[0] == name for key in block.measurements) for name in block.surveyed}
    name = next(n for n, c in counts.items() if c == 1 and n.startswith("control"))
    key = next(key for key in block.measurements if key[0] == name)
    pending = block.with_measurement(replace(block.measurements[key], status="unused"))
    report = adjust_block(pending, PLAIN)
    effect = foresee(report, PLAIN).effect(key)
    again = adjust_block(block, PLAIN)
    assert effect.sigma_nought == pytest.approx(again.sigma_nought, abs=1e-5)
    np.testing.assert_allclose(effect.residual_px, again.residuals_px[key], atol=0.02)


def test_checks_and_photos_that_stand_aside_have_no_effect__law(flight, ahead):
    key = next(key for key in flight.block.measurements if key[0].startswith("check"))
    assert ahead.effect(key) is None
    assert ahead.effect(("nobody", "nowhere")) is None
    keys = control_keys(flight.block, 4)
    assert list(ahead.effects([*keys, key])) == keys


def test_smallest_detectable_errors_are_found_in_four_of_five_cases__truth(flight, report, ahead):
    """Baarda's limit: an error of that size lifts w to 4.13, and 80 % of them beyond 3.29."""
    smallest = ahead.smallest_errors()
    assert set(smallest) == set(report.redundancy_numbers)
    key = control_keys(flight.block, 1)[0]
    size, shift = smallest[key]
    item = flight.block.measurements[key]
    moved = []
    for sign in (1, -1):
        for axis in ("column", "row"):
            wrong = replace(item, **{axis: getattr(item, axis) + sign * size})
            again = adjust_block(flight.block.with_measurement(wrong), PLAIN)
            moved.append(np.abs(adjusted_centres(again) - adjusted_centres(report)).max())
    assert size > 4.13 * item.sigma_px
    assert 0.01 < shift < 10 * max(moved)


def test_check_points_are_off_by_what_is_predicted__truth():
    squares, told = [], []
    for seed in range(15):
        for check in adjust_block(fly(PLAN, np.random.default_rng(seed)).block, PLAIN).checks:
            squares.append(check.difference_m[:2] ** 2)
            told.append(check.sigma_m[:2] ** 2)
            assert (check.sigma_m[2] == 0) == (check.used_scans == 1)
    ratio = np.sqrt(np.mean(told) / np.mean(squares))
    assert 0.8 < ratio < 1.25
