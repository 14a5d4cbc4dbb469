"""A trial: what a decision would do is what it does."""

from dataclasses import replace

import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.control.stage import adjusted_without_gross
from sessions.decisions import Place
from tests.ui.desk_block import adjust, tiny_block, tiny_snapshot
from ui.review.state import DeskState, Draft
from ui.review.trial import NEIGHBOURS, TrialWork, largest_shift, turn_measurement


@pytest.fixture(scope="module")
def state() -> DeskState:
    return tiny_snapshot().state


def test_rejecting_a_blunder_would_lower_sigma_nought__truth(state):
    key = sorted(tiny_block().blunders)[0]
    work = TrialWork(state, key)
    block = work.block()
    assert block is not None
    assert block.measurements[key].status == "rejected"
    found = work.conclude(adjust(block))
    assert found is not None
    assert found.rejects
    assert found.sigma_nought < state.report.sigma_nought
    assert found.photo_id in state.block.photos
    assert 0 < found.shift_m < 5
    assert len(found.neighbours) == NEIGHBOURS
    assert all(one.key[1] == key[1] != one.key for one in found.neighbours)


def test_what_is_left_out_would_be_taken_in__law(state):
    control = {name for name, point in state.block.surveyed.items() if point.role == "control"}
    unused = [key for key, item in state.block.measurements.items() if item.status == "unused"]
    key = next(key for key in unused if key[0] in control)
    block = turn_measurement(state, key)
    assert block is not None
    assert block.measurements[key].status == "accepted"


def test_a_draft_is_tried_where_it_lies__truth(state):
    key = sorted(tiny_block().blunders)[0]
    right = next(p for p in state.block.measurements[key].peaks[1:])
    draft = Draft(key, Place(*key, right.column, right.row))
    work = TrialWork(state, draft)
    moved = work.block().measurements[key]
    assert (moved.column, moved.status) == (right.column, "accepted")
    found = work.conclude(adjust(work.block()))
    assert not found.rejects
    assert found.sigma_nought < state.report.sigma_nought


def test_a_trial_says_what_it_leaves_out__law(state):
    key = sorted(tiny_block().blunders)[0]
    report = adjust(TrialWork(state, key).block())
    assert TrialWork(state, key).conclude(report).left_out == ()
    other = next(one for one in state.report.residuals_px if one != key)
    more = replace(report, rejected={**report.rejected, other: "gross error", key: "gross error"})
    assert TrialWork(state, key).conclude(more).left_out == (other,)


def test_a_blunder_kept_leaves_out_what_its_draft_told__truth(state):
    """A draft 8 m off threw out the same point in another photo, and nothing told it."""
    options = AdjustmentOptions(estimate_cameras=False)
    now = replace(state, report=adjusted_without_gross(state.block, options))
    used = [key for key, one in now.block.measurements.items() if now.shown_state(one) == "auto"]
    # Two photos show it: neither ray can tell which of them is wrong.
    key, other = sorted(key for key in used if key[0] == "J124")
    photo, placed = now.oriented.photos[key[1]], now.block.measurements[key]
    away = 8 / photo.ground_pixel_m(now.oriented.camera_of(key[1]))
    work = TrialWork(now, Draft(key, Place(*key, placed.column, placed.row + away)))
    block = work.block()
    report = adjusted_without_gross(block, options)
    kept = replace(now, block=block, report=report)
    unused = {one for one in used if kept.shown_state(block.measurements[one]) == "unused"}
    assert other in unused
    assert set(work.conclude(report).left_out) == unused - {key}


def test_a_check_point_and_what_is_gone_change_nothing__law(state):
    check = next(k for k in state.block.measurements if state.block.surveyed[k[0]].role == "check")
    assert turn_measurement(state, check) is None
    assert turn_measurement(state, ("none", "none")) is None


def test_a_trial_that_does_not_settle_says_nothing__law(state):
    key = sorted(tiny_block().blunders)[0]
    lost = replace(state.report, converged=False)
    assert TrialWork(state, key).conclude(lost) is None


def test_no_change_shifts_nothing__law(state):
    assert largest_shift(state.oriented, state.oriented)[0] < 1e-6
