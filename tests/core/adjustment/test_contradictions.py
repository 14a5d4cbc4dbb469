"""A measurement that a human accepted is judged by all others, whatever its weight hides."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block, adjust_with_solution
from tests.flights import FlightPlan, fly

PLAN = FlightPlan(ties=400, control=30, check=0, control_sigma_m=(0.4, 0.4, 0.6))
HAND_PX = 0.5


def accepted(block, share=3):
    """The block with every so-manyth control measurement looked at and accepted."""
    keys = sorted(block.measurements)[::share]
    decided = {key: replace(block.measurements[key], status="accepted") for key in keys}
    return replace(block, measurements={**block.measurements, **decided})


def shifted(block, key, metres, turn=0.7):
    """The block with one measurement placed by hand so far off, on the ground."""
    item, photo = block.measurements[key], block.photos[key[1]]
    pixels = metres / photo.ground_pixel_m(block.camera_of(key[1]))
    wrong = replace(
        item,
        column=item.column + pixels * np.cos(turn),
        row=item.row + pixels * np.sin(turn),
        sigma_px=HAND_PX,
        status="accepted",
    )
    return block.with_measurement(wrong)


@pytest.mark.parametrize(("seed", "metres"), [(1, 3.0), (2, 8.0), (3, 18.0)])
def test_an_accepted_blunder_is_named_with_its_size__truth(seed, metres):
    block = accepted(fly(PLAN, np.random.default_rng(seed)).block)
    keys = sorted(block.measurements)
    for key in (keys[seed], keys[len(keys) // 2], keys[-seed]):
        worst, *others = adjust_block(shifted(block, key, metres)).contradictions
        assert worst.key == key
        assert worst.metres == pytest.approx(metres, abs=1.5)
        photo = block.photos[key[1]]
        per_pixel = photo.ground_pixel_m(block.camera_of(key[1]))
        assert worst.pixels == pytest.approx(worst.metres / per_pixel, rel=1e-3)
        assert worst.test > 3.7
        assert worst.shift_m > 0
        # What it pulled along is not accused.
        assert not others


def test_good_decisions_are_not_accused__truth():
    """At a risk of 0.1 % one of a thousand good ones may be."""
    named = decided = 0
    for seed in range(8):
        block = accepted(fly(PLAN, np.random.default_rng(40 + seed)).block, share=1)
        report = adjust_block(block)
        named += len(report.contradictions)
        decided += sum(m.status == "accepted" for m in block.measurements.values())
    assert decided > 300
    assert named <= 2


def test_blunders_do_not_hide_each_other__truth():
    """Two points side by side, both off by as much the same way, and a third elsewhere."""
    block = accepted(fly(PLAN, np.random.default_rng(5)).block)
    name = sorted(block.photos)[1]
    within = sorted(key for key in block.measurements if key[1] == name)
    places = {k: block.surveyed[k[0]].position[:2] for k in within}
    first = within[0]
    beside = min(within[1:], key=lambda k: float(np.hypot(*(places[k] - places[first]))))
    other = next(key for key in sorted(block.measurements) if key[1] != name)
    for key, metres in ((first, 8.0), (beside, 8.0), (other, 3.0)):
        block = shifted(block, key, metres)
    found = {one.key: one.metres for one in adjust_block(block).contradictions}
    assert set(found) == {first, beside, other}
    assert found[first] == pytest.approx(8.0, abs=2.0)


def test_a_point_taken_for_another_in_all_its_photos_is_named__truth():
    """Its rays agree with each other, so only what is known of the point contradicts them."""
    flight = fly(PLAN, np.random.default_rng(6))
    block, shown = flight.block, {}
    for key in sorted(flight.block.measurements):
        shown.setdefault(key[0], []).append(key)
    keys = next(keys for keys in shown.values() if len(keys) > 1)
    known = block.surveyed[keys[0][0]]
    moved = flight.truth.surveyed[known.point_id].position + np.array([8.0, 0.0, 0.0])
    for key in keys:
        photo = flight.truth.photos[key[1]]
        (column, row), *_ = photo.pixel_from_object(moved[None], flight.truth.camera_of(key[1]))
        item = replace(
            block.measurements[key], column=column, row=row, sigma_px=HAND_PX, status="accepted"
        )
        block = block.with_measurement(item)
    found = adjust_block(block).contradictions
    assert {one.key for one in found} == set(keys)
    assert found[0].metres == pytest.approx(8.0, abs=1.5)


def test_what_it_says_is_what_an_adjustment_without_it_says__oracle():
    """Closed form against the block adjusted again without the measurement."""
    plain = AdjustmentOptions(robust=False, estimate_cameras=False)
    block = accepted(fly(PLAN, np.random.default_rng(7)).block)
    key = sorted(block.measurements)[4]
    block = shifted(block, key, 8.0)
    report, solution = adjust_with_solution(block, plain)
    worst = report.contradictions[0]
    out = block.with_measurement(replace(block.measurements[key], status="rejected"))
    again, without = adjust_with_solution(out, plain)
    if key[0] in again.surveyed_positions:
        position = again.surveyed_positions[key[0]]
        pixel = again.block.photos[key[1]].pixel_from_object(
            position[None], again.block.camera_of(key[1])
        )[0]
        item = block.measurements[key]
        off = float(np.hypot(*(pixel - (item.column, item.row))))
    else:
        off = float(np.hypot(*again.residuals_px[key]))
    assert worst.pixels == pytest.approx(off, rel=0.02)
    fall = solution.fit.cost() - without.fit.cost()
    assert worst.test == pytest.approx(np.sqrt(fall), rel=0.05)


def test_a_check_point_misplaced_by_hand_is_named__truth():
    block = fly(replace(PLAN, check=10), np.random.default_rng(8)).block
    checks = [k for k in sorted(block.measurements) if block.surveyed[k[0]].role == "check"]
    good = adjust_block(accepted(block, share=1))
    assert not [one for one in good.contradictions if one.key in checks]
    found = adjust_block(shifted(block, checks[0], 18.0)).contradictions
    assert [one.key for one in found] == [checks[0]]
    assert found[0].shift_m == 0
