"""What gestures mean: a decision, a changed seat, and never a surprise."""

from dataclasses import replace

import numpy as np
import pytest

from sessions.decisions import (
    Accept,
    ChoosePeak,
    MarkDubious,
    MarkNotVisible,
    Place,
    Reject,
    SetRole,
)
from tests.ui.desk_block import tiny_snapshot
from ui.review.compare import ground_from_pixel
from ui.review.gestures import (
    Explained,
    Filtered,
    Judged,
    PeakChosen,
    PlacedInScan,
    PlacedOnGround,
    RayPicked,
    Refined,
    RoleSwitched,
    Selected,
    Sorted,
    Stepped,
    Undone,
)
from ui.review.outcome import outcome_of
from ui.review.queue import seat_down, visible
from ui.review.snapshot import DeskSnapshot
from ui.review.state import Seat


@pytest.fixture(scope="module")
def desk() -> DeskSnapshot:
    return tiny_snapshot()


@pytest.fixture
def seat(desk: DeskSnapshot) -> Seat:
    return seat_down(Seat("seat-1", "anna"), desk.rows)


@pytest.mark.parametrize(
    ("verdict", "decision"),
    [
        ("accept", Accept),
        ("reject", Reject),
        ("dubious", MarkDubious),
        ("invisible", MarkNotVisible),
    ],
)
def test_a_verdict_is_a_decision_and_goes_to_the_next__law(desk, seat, verdict, decision):
    found = outcome_of(Judged(seat.seat_id, seat.current, verdict), seat, desk)
    assert isinstance(found.decision, decision)
    assert (found.decision.point_id, found.decision.photo_id) == seat.current
    assert found.seat.current == visible(desk.rows, seat)[1]


def test_a_verdict_on_a_point_already_left_does_not_step__law(desk, seat):
    here, there = visible(desk.rows, seat)[:2]
    found = outcome_of(Judged(seat.seat_id, there, "accept"), replace(seat, current=here), desk)
    assert found.decision == Accept(*there)
    assert found.seat.current == here


def test_the_same_verdict_again_is_no_decision__law(desk, seat):
    accepted = replace(desk.state.block.measurements[seat.current], status="accepted")
    state = replace(desk.state, block=desk.state.block.with_measurement(accepted))
    found = outcome_of(
        Judged(seat.seat_id, seat.current, "accept"), seat, replace(desk, state=state)
    )
    assert found.decision is None
    assert found.seat.current != seat.current


def test_a_digit_after_a_rejection_gives_its_reason__law(desk, seat):
    rejected = outcome_of(Judged(seat.seat_id, seat.current, "reject"), seat, desk)
    explained = outcome_of(Explained(seat.seat_id, 2), rejected.seat, desk)
    assert explained.decision == Reject(*seat.current, reason="changed")
    assert explained.act == "amend"
    assert outcome_of(Explained(seat.seat_id, 2), explained.seat, desk).decision is None


def test_a_place_on_the_warped_scan_is_the_pixel_under_it__law(desk, seat):
    key = seat.current
    pixel = desk.state.block.measurements[key].pixel + 3.25
    ground = ground_from_pixel(pixel, desk.drawn[key[1]], desk.dem, 280.0)[0]
    found = outcome_of(PlacedOnGround(seat.seat_id, key, *ground[:2]), seat, desk)
    assert isinstance(found.decision, Place)
    assert np.allclose([found.decision.column, found.decision.row], pixel[0], atol=1e-2)
    assert found.seat.current == key


def test_a_place_outside_the_scan_is_refused_in_words__law(desk, seat):
    found = outcome_of(PlacedInScan(seat.seat_id, seat.current, -5.0, 10.0), seat, desk)
    assert found.decision is None
    assert found.notice is not None
    assert found.notice.text == "notice.outside"


def test_enter_waits_there_for_what_is_measured__law(desk, seat):
    key = seat.order[6]
    found = outcome_of(Refined(seat.seat_id, key), replace(seat, explaining=key), desk)
    assert (found.decision, found.act) == (None, "measure")
    assert (found.seat.current, found.seat.explaining) == (key, None)
    assert outcome_of(Refined(seat.seat_id, ("J1", "none")), seat, desk).act == ""


def test_a_peak_is_chosen_only_if_it_is_there__law(desk, seat):
    assert outcome_of(PeakChosen(seat.seat_id, seat.current, 0), seat, desk).decision == ChoosePeak(
        *seat.current, 0
    )
    assert outcome_of(PeakChosen(seat.seat_id, seat.current, 99), seat, desk).decision is None


def test_the_role_is_switched_both_ways__law(desk, seat):
    for point_id, point in desk.state.block.surveyed.items():
        found = outcome_of(RoleSwitched(seat.seat_id, point_id), seat, desk)
        assert found.decision == SetRole(
            point_id, "check" if point.role == "control" else "control"
        )


def test_undo_is_left_to_the_loop__law(desk, seat):
    found = outcome_of(Undone(seat.seat_id), seat, desk)
    assert (found.decision, found.act) == (None, "undo")


def test_steps_walk_the_queue_and_stop_at_its_ends__law(desk, seat):
    shown = visible(desk.rows, seat)
    seat = replace(seat, current=shown[0])
    assert outcome_of(Stepped(seat.seat_id, -1), seat, desk).seat.current == shown[0]
    assert outcome_of(Stepped(seat.seat_id, 1), seat, desk).seat.current == shown[1]
    seat = replace(seat, current=shown[-1])
    assert outcome_of(Stepped(seat.seat_id, 1), seat, desk).seat.current == shown[-1]


def test_sorting_orders_by_the_column__law(desk, seat):
    sorted_seat = outcome_of(Sorted(seat.seat_id, "score", False), seat, desk).seat
    scores = [desk.rows[key].score for key in sorted_seat.order]
    assert scores == sorted(scores)
    assert sorted_seat.current == seat.current


def test_a_filter_shows_only_what_fits_and_keeps_a_current_point__law(desk, seat):
    photo = next(iter(desk.state.block.photos))
    filtered = outcome_of(Filtered(seat.seat_id, "all", photo, "check"), seat, desk).seat
    shown = visible(desk.rows, filtered)
    assert shown
    assert all(key[1] == photo and desk.rows[key].role == "check" for key in shown)
    assert filtered.current in shown


def test_a_ray_to_a_point_makes_it_current__truth(desk, seat):
    block = desk.state.oriented
    key = seat.order[7]
    target = block.surveyed[key[0]].position - block.origin
    eye = target + np.array([300.0, -900.0, 1500.0])
    found = outcome_of(RayPicked(seat.seat_id, tuple(eye), tuple(target - eye)), seat, desk)
    assert found.seat.current is not None
    assert found.seat.current[0] == key[0]


def test_a_ray_through_a_frustum_shows_that_photo__truth(desk, seat):
    block = desk.state.oriented
    for photo_id, photo in block.photos.items():
        target = photo.exterior.centre - block.origin - np.array([0.0, 0.0, 60.0])
        eye = target + np.array([0.0, -500.0, 3000.0])
        found = outcome_of(RayPicked(seat.seat_id, tuple(eye), tuple(target - eye)), seat, desk)
        assert found.seat.current is not None
        assert found.seat.current[1] == photo_id


def test_selected_must_exist__law(desk, seat):
    assert outcome_of(Selected(seat.seat_id, ("none", "none")), seat, desk).seat == seat


def test_a_filter_that_lets_nothing_through_shows_nothing_and_forgets_nothing__law(desk, seat):
    here = replace(seat, current=seat.order[3])
    empty = outcome_of(Filtered(seat.seat_id, "review", "", "fiducial"), here, desk).seat
    assert empty.current is None
    back = outcome_of(Filtered(seat.seat_id, "review", "", ""), empty, desk).seat
    assert back.current == here.current
