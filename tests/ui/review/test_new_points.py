"""A detail clicked in a scan: a named point, a draft of its place, one act with its first rays."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sessions.decisions import AddPoint, Place, Recorded, Withdraw
from sessions.replay import replay
from tests.ui.user_points import measuring_snapshot, true_pixel
from ui.review.drafts import apply_draft
from ui.review.gestures import Dropped, Judged, PlacedInScan
from ui.review.misfit import misfits
from ui.review.new_points import UNKNOWN, act_of, name_after, next_name, with_begun
from ui.review.outcome import outcome_of
from ui.review.pages import seat_point
from ui.review.queue import keep_seat_up, seat_down
from ui.review.state import QueueFilter, Seat


@pytest.fixture(scope="module")
def desk():
    return measuring_snapshot()


def clicked(desk):
    """The seat and the new point it begins after a click, and where that was."""
    seat = seat_down(Seat("seat-1", "anna", filter=QueueFilter("measure")), desk.rows)
    photo, place = seat.current[1], true_pixel(seat.current)
    outcome = outcome_of(PlacedInScan("seat-1", ("", photo), *place), seat, desk)
    assert outcome.decisions == ()
    (added,) = outcome.seat.begun.values()
    return outcome.seat, added, photo, place


def test_a_click_names_a_point_and_drafts_its_place__law(desk):
    seat, added, photo, place = clicked(desk)
    assert (added.point_id, added.sigma_m, added.measured) == ("N001", UNKNOWN, ())
    assert seat.current == ("N001", photo)
    assert seat.draft_of(seat.current).decision == Place("N001", photo, *place.tolist())
    known = (Recorded(1, "t1", "anna", added), Recorded(2, "t2", "anna", Withdraw(1)))
    assert next_name("N###", replace(desk, recorded=known)) == "N002"
    # What somebody else has drafted is taken as well.
    assert next_name("N###", desk.with_seat(seat)) == "N002"


def test_who_drafts_a_point_alone_has_its_rows_and_keeps_it_with_its_place__law(desk):
    seat, added, photo, place = clicked(desk)
    there = with_begun(desk, seat)
    assert with_begun(desk, seat.without_draft(seat.current)) is desk
    assert not any(key[0] == "N001" for key in desk.rows)
    assert there.rows[seat.current].state == "predicted"
    assert [line[:2] for line in there.table.lines[len(desk.table.lines) :]] == [
        list(key) for key in there.rows if key[0] == "N001"
    ]
    refused = outcome_of(Judged("seat-1", seat.current, "reject"), seat, there)
    assert (refused.decisions, refused.notice.text) == ((), "notice.only-draft")
    kept = outcome_of(Judged("seat-1", seat.current, "accept"), seat, there)
    assert kept.decisions == (added, Place("N001", photo, *place.tolist()))
    assert not kept.seat.drafts


def test_nothing_is_known_of_a_new_points_misfit_before_a_second_photo__law(desk):
    seat, _, photo, place = clicked(desk)
    (draft,) = seat.drafts
    there = with_begun(desk, seat)
    assert draft.key not in misfits(apply_draft(there.state, draft), (draft.key,))
    figures = seat_point(seat, there)["figures"]
    assert (figures["ratio"], figures["misfit"]) == (None, None)
    other = next(key for key in there.rows if key[0] == "N001" and key[1] != photo)
    rays = [Place(*draft.key, *place.tolist()), Place(*other, 50.0, 50.0)]
    said = [Recorded(n, "t", "anna", ray) for n, ray in enumerate(rays, 1)]
    both = replace(there.state, block=replay(there.state.block, said).block)
    assert misfits(both, (draft.key, other)).keys() == {draft.key, other}


def test_what_a_draft_of_a_new_point_brings_along_is_decided_by_nobody__law(desk):
    seat, added, photo, _ = clicked(desk)
    known = next(iter(desk.state.block.measurements.values()))
    found = replace(known, point_id="N001", photo_id=photo, status="accepted")
    (draft,) = seat.drafts
    seat = replace(seat, drafts=(replace(draft, begins=replace(added, measured=(found,))),))
    row = with_begun(desk, seat).rows["N001", photo]
    assert (row.state, row.human) == ("accepted", False)


def test_other_drafts_of_a_kept_point_go_when_it_is_taken_back__law(desk):
    seat, added, photo, place = clicked(desk)
    there = with_begun(desk, seat)
    seat = keep_seat_up(seat, there.rows)
    other = next(key for key in there.rows if key[0] == "N001" and key[1] != photo)
    seat = outcome_of(PlacedInScan("seat-1", other, *place), seat, there).seat
    assert seat.draft_of(other).begins == added
    kept = outcome_of(Judged("seat-1", ("N001", photo), "accept"), seat, there).seat
    assert [(one.key, one.begins) for one in kept.drafts] == [(other, None)]
    assert keep_seat_up(kept, there.rows).drafts == kept.drafts
    assert keep_seat_up(kept, desk.rows).drafts == ()


def test_a_point_belongs_to_its_first_two_rays__law(desk):
    _, added, photo, place = clicked(desk)
    made = Recorded(1, "t1", "anna", added)
    state = replace(desk.state, block=replay(desk.state.block, [made]).block)
    first = Place("N001", photo, *place.tolist())
    assert act_of((first,), state, [made]) == made
    others = [name for name in state.block.photos if name != photo][:2]
    rays = [Recorded(2, "t2", "anna", first)]
    rays += [Recorded(n, "t3", "anna", replace(first, photo_id=p)) for n, p in enumerate(others, 3)]
    two = replace(state, block=replay(state.block, rays[:2]).block)
    assert act_of((rays[2].decision,), two, [made, *rays[:2]]) is None


def test_a_dropped_draft_takes_its_new_point_along__law(desk):
    seat, added, _, _ = clicked(desk)
    assert isinstance(added, AddPoint)
    dropped = outcome_of(Dropped("seat-1", seat.current), seat, with_begun(desk, seat))
    assert (dropped.decisions, dropped.seat.begun) == ((), {})


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
