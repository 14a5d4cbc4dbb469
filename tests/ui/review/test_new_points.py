"""A detail clicked in a scan: a named point, a draft of its place, one act with its first rays."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sessions.decisions import AddPoint, Place, Recorded, Withdraw
from sessions.replay import replay
from tests.ui.user_points import measuring_snapshot, true_pixel
from ui.review.gestures import Dropped, PlacedInScan
from ui.review.new_points import UNKNOWN, act_of, given_up, name_after, next_name
from ui.review.outcome import outcome_of
from ui.review.queue import seat_down
from ui.review.state import QueueFilter, Seat


@pytest.fixture(scope="module")
def desk():
    return measuring_snapshot()


def clicked(desk):
    """The seat and the decision after a click, and where it was."""
    seat = seat_down(Seat("seat-1", "anna", filter=QueueFilter("measure")), desk.rows)
    photo, place = seat.current[1], true_pixel(seat.current)
    outcome = outcome_of(PlacedInScan("seat-1", ("", photo), *place), seat, desk)
    return outcome.seat, outcome.decisions, photo, place


def test_a_click_names_a_point_and_drafts_its_place__law(desk):
    seat, (added,), photo, place = clicked(desk)
    assert (added.point_id, added.sigma_m, added.measured) == ("N001", UNKNOWN, ())
    assert seat.current == ("N001", photo)
    assert seat.draft_of(seat.current).decision == Place("N001", photo, *place.tolist())
    known = [Recorded(1, "t1", "anna", added), Recorded(2, "t2", "anna", Withdraw(1))]
    assert next_name("N###", desk.state, known) == "N002"


def test_a_point_belongs_to_its_first_two_rays__law(desk):
    _, (added,), photo, place = clicked(desk)
    made = Recorded(1, "t1", "anna", added)
    state = replace(desk.state, block=replay(desk.state.block, [made]).block)
    first = Place("N001", photo, *place.tolist())
    assert act_of((first,), state, [made]) == made
    others = [name for name in state.block.photos if name != photo][:2]
    rays = [Recorded(2, "t2", "anna", first)]
    rays += [Recorded(n, "t3", "anna", replace(first, photo_id=p)) for n, p in enumerate(others, 3)]
    two = replace(state, block=replay(state.block, rays[:2]).block)
    assert act_of((rays[2].decision,), two, [made, *rays[:2]]) is None
    assert given_up(two, [made, *rays[:2]], "N001") == ()


def test_a_dropped_draft_takes_its_new_point_along__law(desk):
    seat, (added,), _, _ = clicked(desk)
    made = Recorded(1, "t1", "anna", added)
    state = replace(desk.state, block=replay(desk.state.block, [made]).block)
    there = replace(desk, state=state, recorded=(made,))
    assert isinstance(added, AddPoint)
    assert outcome_of(Dropped("seat-1", seat.current), seat, there).decisions == (Withdraw(1),)


def test_names_count_on__truth():
    assert name_after("N###", []) == "N001"
    assert name_after("N###", ["N001", "N007", "N7x", "P9"]) == "N008"
    assert name_after("H#", ["H9", "H10"]) == "H11"
    assert name_after("roof-##-a", ["roof-99-a"]) == "roof-100-a"
    assert name_after("P", ["P3"]) == "P4"


@given(st.text("N#a1", max_size=6), st.lists(st.text("Na12", max_size=5)))
def test_a_name_is_never_given_twice__law(pattern, taken):
    given_names = list(taken)
    for _ in range(3):
        name = name_after(pattern, given_names)
        assert name not in given_names
        given_names.append(name)
