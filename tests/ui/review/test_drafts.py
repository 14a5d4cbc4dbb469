"""Drafts: what a place would be, how it lies to the block, and which are asked about."""

from dataclasses import replace

import numpy as np
import pytest

from sessions.decisions import (
    AddPoint,
    ChoosePeak,
    Place,
    PlaceFiducial,
    Recorded,
    Reject,
    Withdraw,
)
from tests.ui.desk_block import tiny_block, tiny_snapshot
from ui.review.drafts import (
    ASKING_SIGMA,
    apply_draft,
    by_hand,
    draft_ratio,
    left_seats,
    with_left,
)
from ui.review.state import DeskState, Draft, Seat
from ui.review.trial import is_to_be_asked


@pytest.fixture(scope="module")
def state() -> DeskState:
    return tiny_snapshot().state


def test_the_further_from_its_expected_place_the_more_sigma__law(state):
    key = next(k for k in state.block.measurements if k not in tiny_block().blunders)
    pixel = state.block.measurements[key].pixel[0]
    drafts = [Draft(key, Place(*key, *map(float, pixel + away))) for away in (0.0, 5.0, 20.0, 80.0)]
    ratios = [draft_ratio(state, draft) for draft in drafts]
    assert np.all(np.diff(ratios[1:]) > 0)
    seat = Seat("seat-1", "anna")
    asked = [is_to_be_asked(state, seat, draft, ()) for draft in drafts]
    assert asked == [ratio > ASKING_SIGMA for ratio in ratios]
    assert asked[-1]
    assert not is_to_be_asked(state, replace(seat, asking=drafts[-1]), drafts[-1], ())


def test_a_draft_over_what_a_colleague_took_out_of_use_is_asked_about__law(state):
    key = next(k for k in state.block.measurements if k not in tiny_block().blunders)
    pixel = state.block.measurements[key].pixel[0]
    draft, seat = Draft(key, Place(*key, *map(float, pixel))), Seat("seat-1", "anna")
    out = Recorded(1, "t", "bob", Reject(*key, "changed"))
    placed = Recorded(2, "t", "bob", draft.decision)
    assert is_to_be_asked(state, seat, draft, [out])
    assert not is_to_be_asked(state, replace(seat, asking=draft), draft, [out])
    for said in ([], [replace(out, who="anna")], [out, placed], [out, replace(out, decision_id=2,
                 decision=Withdraw(1))]):  # fmt: skip
        assert not is_to_be_asked(state, seat, draft, said)


def test_a_place_by_hand_has_no_score_but_a_peak_and_a_refined_one_have__truth(state):
    key, measured = next((k, m) for k, m in state.block.measurements.items() if len(m.peaks) > 1)
    hand = Draft(key, Place(*key, measured.column, measured.row))
    refined = Draft(key, Place(*key, measured.column + 0.1, measured.row, measured.sigma_px))
    peak = Draft(key, ChoosePeak(*key, 1))
    drafted = {
        draft: apply_draft(state, draft).block.measurements[key] for draft in (hand, refined, peak)
    }
    assert [by_hand(one) for one in drafted.values()] == [True, False, False]
    assert drafted[refined].sigma_px == measured.sigma_px
    assert drafted[refined].score == measured.score
    assert drafted[peak].column == measured.peaks[1].column
    assert state.block.measurements[key] is measured


def test_what_a_desk_leaves_keeps_its_place_whatever_the_next_one_finds__law(state):
    key, measured = next((k, m) for k, m in state.block.measurements.items() if len(m.peaks) > 1)
    new, gone = ("N001", key[1]), ("J1", "none")
    begins = AddPoint("N001", 0.0, 0.0, 0.0, (1.0, 1.0, 1.0), ())
    drafts = Draft(key, ChoosePeak(*key, 1)), Draft(new, Place(*new, 1.0, 2.0), begins)
    marks = PlaceFiducial(key[1], "1", 3.0, 4.0), PlaceFiducial("none", "1", 3.0, 4.0)
    asked = Seat(
        "seat-1", "anna", drafts=(*drafts, Draft(gone, Place(*gone, 1.0, 2.0))), marks=marks
    )
    (left,) = left_seats((Seat("seat-2", "berta"), asked), state.block)
    seat = with_left(Seat("seat-1", "operator"), left, {key}, {key[1]})
    assert (seat.operator, seat.marks) == ("anna", marks[:1])
    assert [draft.key for draft in seat.drafts] == [key, new]
    turned = replace(measured, peaks=tuple(reversed(measured.peaks)))
    there = apply_draft(replace(state, block=state.block.with_measurement(turned)), seat.drafts[0])
    assert there.block.measurements[key].column == measured.peaks[1].column
