"""A trial: what a decision would do is what it does."""

from dataclasses import replace

import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.control.stage import adjusted_without_gross
from sessions.decisions import JudgePhoto, JudgeTie, Place, Recorded, Reject
from sessions.replay import replay
from tests.ui.desk_block import adjust, tiny_block, tiny_snapshot
from ui.review.doubtful import extra_of, key_of_verdict
from ui.review.picture import Pictured, point_part
from ui.review.snapshot import DeskSnapshot
from ui.review.state import DeskState, Draft, Seat
from ui.review.trial import NEIGHBOURS, TrialWork, largest_shift


@pytest.fixture(scope="module")
def state() -> DeskState:
    return tiny_snapshot().state


def work_on(state: DeskState, subject, desk: DeskSnapshot | None = None) -> TrialWork:
    return TrialWork(state, subject, (desk or tiny_snapshot()).after)


def turned(state: DeskState, key):
    return work_on(state, key).block()


def decided(*decisions) -> DeskSnapshot:
    """The desk once these were decided and the block was adjusted."""
    desk = tiny_snapshot()
    recorded = tuple(Recorded(n, "", "anna", one) for n, one in enumerate(decisions, start=1))
    block = replay(desk.base, recorded).block
    state = replace(desk.state, block=block, report=adjust(block))
    state = replace(state, extra=extra_of(state, desk.base, recorded, (), desk.dem))
    desk = replace(desk, state=state, recorded=recorded)
    return desk.with_table(desk.table.renewed(state))


def test_rejecting_a_blunder_would_lower_sigma_nought__truth(state):
    key = sorted(tiny_block().blunders)[0]
    work = work_on(state, key)
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
    block = turned(state, key)
    assert block is not None
    assert block.measurements[key].status == "accepted"


def test_a_draft_is_tried_where_it_lies__truth(state):
    key = sorted(tiny_block().blunders)[0]
    right = next(p for p in state.block.measurements[key].peaks[1:])
    draft = Draft(key, Place(*key, right.column, right.row))
    work = work_on(state, draft)
    moved = work.block().measurements[key]
    assert (moved.column, moved.status) == (right.column, "accepted")
    found = work.conclude(adjust(work.block()))
    assert not found.rejects
    assert found.sigma_nought < state.report.sigma_nought


def test_a_trial_says_what_it_leaves_out__law(state):
    key = sorted(tiny_block().blunders)[0]
    report = adjust(work_on(state, key).block())
    assert work_on(state, key).conclude(report).left_out == ()
    other = next(one for one in state.report.residuals_px if one != key)
    more = replace(report, rejected={**report.rejected, other: "gross error", key: "gross error"})
    assert work_on(state, key).conclude(more).left_out == (other,)


def test_a_blunder_kept_leaves_out_what_its_draft_told__truth(state):
    """A draft 8 m off threw out the same point in another photo, and nothing told it."""
    options = AdjustmentOptions(estimate_cameras=False)
    now = replace(state, report=adjusted_without_gross(state.block, options))
    used = [key for key, one in now.block.measurements.items() if now.shown_state(one) == "auto"]
    # Two photos show it: neither ray can tell which of them is wrong.
    key, other = sorted(key for key in used if key[0] == "J124")
    photo, placed = now.oriented.photos[key[1]], now.block.measurements[key]
    away = 8 / photo.ground_pixel_m(now.oriented.camera_of(key[1]))
    work = work_on(now, Draft(key, Place(*key, placed.column, placed.row + away)))
    block = work.block()
    report = adjusted_without_gross(block, options)
    kept = replace(now, block=block, report=report)
    unused = {one for one in used if kept.shown_state(block.measurements[one]) == "unused"}
    assert other in unused
    assert set(work.conclude(report).left_out) == unused - {key}


def test_a_check_point_and_what_is_gone_change_nothing__law(state):
    check = next(k for k in state.block.measurements if state.block.surveyed[k[0]].role == "check")
    assert turned(state, check) is None
    assert turned(state, ("none", "none")) is None


def test_a_trial_that_does_not_settle_says_nothing__law(state):
    key = sorted(tiny_block().blunders)[0]
    lost = replace(state.report, converged=False)
    assert work_on(state, key).conclude(lost) is None


def test_no_change_shifts_nothing__law(state):
    assert largest_shift(state.oriented, state.oriented)[0] < 1e-6


def test_accepting_what_was_rejected_would_bring_it_back__law(state):
    """The trial of a rejected photo or tie point rejected it once more."""
    ties = state.block.ties
    name = ties.photo_ids[int(ties.photo[0])]
    column, row = (float(value) for value in ties.pixels[0])
    for verdict in (JudgePhoto(name, use=False), JudgeTie(name, column, row, use=False)):
        desk = decided(verdict)
        key = key_of_verdict(desk.state.extra, verdict)
        work = work_on(desk.state, key, desk)
        found = work.conclude(adjust(work.block()))
        assert not found.rejects
        assert found.sigma_nought == pytest.approx(state.report.sigma_nought, rel=1e-6)
        assert found.sigma_nought != pytest.approx(desk.state.report.sigma_nought, rel=1e-6)


def test_what_is_only_in_use_or_not_is_told_as_that__law(state):
    ties = state.block.ties
    name, (column, row) = ties.photo_ids[int(ties.photo[0])], map(float, ties.pixels[0])
    desk = decided(JudgeTie(name, column, row, use=False))
    of_a_tie = next(iter(desk.state.extra.measurements))
    for key in (of_a_tie, next(iter(desk.state.block.measurements))):
        seat, pictured = Seat("anna-1", "anna", current=key), Pictured(desk.drawn, desk.dem)
        part = point_part(desk.state, seat, desk.rows, pictured)
        assert part["fixed"] == (key == of_a_tie)


def test_in_a_rejected_photo_no_verdict_changes_anything__law(state):
    """Its measurements were told a change that did not come."""
    key = sorted(tiny_block().blunders)[0]
    for more in ((), (Reject(*key, "other"),)):
        desk = decided(JudgePhoto(key[1], use=False), *more)
        assert work_on(desk.state, key, desk).block() is None
        seat, pictured = Seat("anna-1", "anna", current=key), Pictured(desk.drawn, desk.dem)
        assert point_part(desk.state, seat, desk.rows, pictured)["idle"]
        other = next(k for k in desk.state.block.measurements if k[1] != key[1])
        assert not desk.state.is_idle(other)
