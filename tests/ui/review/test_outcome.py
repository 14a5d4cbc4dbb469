"""What gestures mean: a decision, a changed seat, and never a surprise."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import Contradiction
from sessions.decisions import (
    Accept,
    ChoosePeak,
    MarkDubious,
    MarkNotVisible,
    Place,
    Recorded,
    Reject,
    SetRole,
    Withdraw,
)
from tests.ui.desk_block import tiny_block
from ui.review.compare import ground_from_pixel
from ui.review.drafts import ASKING_SIGMA
from ui.review.gestures import (
    Aimed,
    Dropped,
    Explained,
    Filtered,
    Fitted,
    Judged,
    JudgedTogether,
    PeakChosen,
    PhotoEntered,
    PlacedInScan,
    PlacedOnGround,
    Refined,
    ReliefRaised,
    RoleSwitched,
    Selected,
    Sorted,
    Stepped,
    ThemeChosen,
    Undone,
)
from ui.review.outcome import outcome_of
from ui.review.queue import next_open, showing, visible, with_filter
from ui.review.state import Draft, Extra, Notice, QueueFilter
from ui.review.trial import Trial


def plain(desk, seat):
    """Keys in sight that the block does not contradict."""
    misfits = desk.table.figures.misfits
    return tuple(key for key in visible(desk.rows, seat) if misfits[key].ratio < ASKING_SIGMA)


def recorded(desk, outcome):
    """The desk once it has recorded what a gesture came to."""
    made = (Recorded(n, "", "anna", one) for n, one in enumerate(outcome.decisions, start=1))
    return replace(desk, recorded=tuple(made))


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
    here, after = plain(desk, seat)[:2]
    seat = replace(seat, current=here, order=plain(desk, seat))
    found = outcome_of(Judged(seat.seat_id, here, verdict), seat, desk)
    (made,) = found.decisions
    assert isinstance(made, decision)
    assert (made.point_id, made.photo_id) == here
    assert found.seat.current == after


def test_a_verdict_on_a_point_already_left_does_not_step__law(desk, seat):
    here, there = plain(desk, seat)[:2]
    found = outcome_of(Judged(seat.seat_id, there, "accept"), replace(seat, current=here), desk)
    assert found.decisions == (Accept(*there),)
    assert found.seat.current == here


def test_the_same_verdict_again_is_no_decision__law(desk, seat):
    accepted = replace(desk.state.block.measurements[seat.current], status="accepted")
    state = replace(desk.state, block=desk.state.block.with_measurement(accepted))
    found = outcome_of(
        Judged(seat.seat_id, seat.current, "accept"), seat, replace(desk, state=state)
    )
    assert found.decisions == ()
    assert found.seat.current != seat.current


def test_a_digit_after_a_rejection_gives_its_reason__law(desk, seat):
    rejected = outcome_of(Judged(seat.seat_id, seat.current, "reject"), seat, desk)
    made, digit = recorded(desk, rejected), Explained(seat.seat_id, 2)
    explained = outcome_of(digit, rejected.seat, made)
    assert explained.decisions == (Withdraw(1), Reject(*seat.current, reason="changed"))
    assert outcome_of(digit, explained.seat, made).decisions == ()


@pytest.mark.parametrize("then", [Withdraw(1), "accepted by another"])
def test_a_digit_does_not_reject_again_what_was_decided_since__law(desk, seat, then):
    """Withdrawn in the history, or accepted by a colleague, it was rejected once more."""
    rejected = outcome_of(Judged(seat.seat_id, seat.current, "reject"), seat, desk)
    made = recorded(desk, rejected)
    decision = then if isinstance(then, Withdraw) else Accept(*seat.current)
    since = (*made.recorded, Recorded(2, "", "bob", decision))
    late = outcome_of(Explained(seat.seat_id, 2), rejected.seat, replace(made, recorded=since))
    assert late.decisions == ()
    assert late.notice == Notice("notice.no-reason")


def test_one_digit_gives_all_that_was_rejected_together_its_reason__law(desk, seat):
    keys = visible(desk.rows, seat)[:3]
    rejected = outcome_of(JudgedTogether(seat.seat_id, keys, "reject"), seat, desk)
    explained = outcome_of(Explained(seat.seat_id, 2), rejected.seat, recorded(desk, rejected))
    assert explained.decisions[3:] == tuple(Reject(*key, reason="changed") for key in keys)
    assert explained.seat.explaining == ()
    accepted = outcome_of(JudgedTogether(seat.seat_id, keys, "accept"), rejected.seat, desk)
    assert accepted.seat.explaining == ()


def test_a_place_on_the_warped_scan_is_the_pixel_under_it__law(desk, seat):
    key = seat.current
    pixel = desk.state.block.measurements[key].pixel + 3.25
    ground = ground_from_pixel(pixel, desk.drawn[key[1]], desk.dem, 280.0)[0]
    found = outcome_of(PlacedOnGround(seat.seat_id, key, *ground[:2]), seat, desk)
    assert found.decisions == ()
    place = found.seat.draft_of(key).decision
    assert isinstance(place, Place)
    assert np.allclose([place.column, place.row], pixel[0], atol=1e-2)
    assert found.seat.current == key


def test_a_draft_is_kept_by_yes_and_dropped_by_anything_else__law(desk, seat):
    key = seat.current
    near = Place(*key, *map(float, desk.state.block.measurements[key].pixel[0] + 0.1))
    drafted = seat.with_draft(Draft(key, near))
    drafted = replace(drafted, asking=drafted.drafts[0])
    kept = outcome_of(Judged(seat.seat_id, key, "accept"), drafted, desk)
    assert kept.decisions == (near,)
    assert kept.seat.drafts == ()
    assert kept.seat.current != key
    dropped = outcome_of(Dropped(seat.seat_id, key), drafted, desk)
    assert (dropped.decisions, dropped.act, dropped.seat.drafts) == ((), "", ())
    rejected = outcome_of(Judged(seat.seat_id, key, "reject"), drafted, desk)
    assert rejected.decisions == (Reject(*key, "other"),)
    assert rejected.seat.drafts == ()
    walked = outcome_of(Stepped(seat.seat_id, 1), drafted, desk)
    assert walked.decisions == ()
    assert walked.seat.draft_of(key).decision == near


def test_a_draft_against_the_block_is_asked_about_once__law(desk, seat):
    key = next(k for k in seat.order if k not in tiny_block().blunders)
    pixel = desk.state.block.measurements[key].pixel[0]
    seat = replace(seat, current=key)
    for away, asks in ((0.1, False), (30.0, True)):
        place = Place(*key, *map(float, pixel + away))
        first = outcome_of(
            Judged(seat.seat_id, key, "accept"), seat.with_draft(Draft(key, place)), desk
        )
        assert (first.decisions == ()) is asks
        assert (first.seat.current == key) is asks
    assert outcome_of(Judged(seat.seat_id, key, "accept"), first.seat, desk).decisions == (place,)
    # What is asked about is what is shown: the test of the block adjusted with the draft.
    near = seat.with_draft(Draft(key, Place(*key, *map(float, pixel + 0.1))))
    found = Contradiction(*key, pixels=2.0, metres=1.1, test=3.7, shift_m=0.4)
    trial = Trial(key, False, 1.0, 0.0, key[1], (), against=found)
    tried = replace(desk, trials={near.drafts[0]: trial})
    assert outcome_of(Judged(seat.seat_id, key, "accept"), near, tried).decisions == ()
    # So is one that the block agrees with, and that puts another out of the adjustment.
    throws = replace(trial, against=None, left_out=(("J1", key[1]),))
    tried = replace(desk, trials={near.drafts[0]: throws})
    asked = outcome_of(Judged(seat.seat_id, key, "accept"), near, tried)
    assert (asked.decisions, asked.seat.asking) == ((), near.drafts[0])
    kept = outcome_of(Judged(seat.seat_id, key, "accept"), asked.seat, tried)
    assert kept.decisions == (near.drafts[0].decision,)
    # Given up and placed there again, or moved, it is asked about once more.
    given_up = outcome_of(Dropped(seat.seat_id, key), first.seat, desk).seat
    again = given_up.with_draft(Draft(key, place))
    assert outcome_of(Judged(seat.seat_id, key, "accept"), again, desk).decisions == ()
    other = first.seat.with_draft(Draft(key, replace(place, row=place.row + 1)))
    assert outcome_of(Judged(seat.seat_id, key, "accept"), other, desk).decisions == ()


def test_several_at_once_are_one_act_and_drafts_in_doubt_wait__law(desk, seat):
    keys = plain(desk, seat)[:4]
    pixel = desk.state.block.measurements[keys[2]].pixel[0]
    seat = seat.with_draft(Draft(keys[2], Place(*keys[2], *map(float, pixel + 40))))
    found = outcome_of(JudgedTogether(seat.seat_id, keys[::-1], "accept"), seat, desk)
    assert found.decisions == tuple(Accept(*key) for key in keys if key != keys[2])
    assert found.left == (Notice("notice.still-drafts", {"count": "1"}),)
    assert found.seat.draft_of(keys[2]) is not None
    # Those that nobody moved wait as well, and are counted.
    far = [key for key in visible(desk.rows, seat) if key not in plain(desk, seat)]
    found = outcome_of(JudgedTogether(seat.seat_id, (*far, keys[0]), "accept"), seat, desk)
    assert found.decisions == (Accept(*keys[0]),)
    apart = Notice("notice.far-off", {"count": f"{len(far)}"})
    assert found.left == (apart,)
    # Each reason is told.
    found = outcome_of(JudgedTogether(seat.seat_id, (*far, *keys), "accept"), seat, desk)
    assert found.left == (Notice("notice.still-drafts", {"count": "1"}), apart)


def test_a_measurement_against_the_block_is_asked_about_once__law(desk, seat):
    key = next(key for key in visible(desk.rows, seat) if key not in plain(desk, seat))
    seat = replace(seat, current=key)
    first = outcome_of(Judged(seat.seat_id, key, "accept"), seat, desk)
    assert (first.decisions, first.seat.current) == ((), key)
    assert first.seat.asking == first.seat.draft_of(key) == Draft(key, Accept(*key))
    kept = outcome_of(Judged(seat.seat_id, key, "accept"), first.seat, desk)
    assert (kept.decisions, kept.seat.drafts) == ((Accept(*key),), ())
    rejected = outcome_of(Judged(seat.seat_id, key, "reject"), first.seat, desk)
    assert (rejected.decisions, rejected.seat.drafts) == ((Reject(*key, "other"),), ())


def test_a_place_outside_the_scan_is_refused_in_words__law(desk, seat):
    found = outcome_of(PlacedInScan(seat.seat_id, seat.current, -5.0, 10.0), seat, desk)
    assert found.decisions == ()
    assert found.notice is not None
    assert found.notice.text == "notice.outside"


def test_enter_waits_there_for_what_is_measured__law(desk, seat):
    key = seat.order[6]
    found = outcome_of(Refined(seat.seat_id, key), replace(seat, explaining=(key,)), desk)
    assert (found.decisions, found.act) == ((), "measure")
    assert (found.seat.current, found.seat.explaining) == (key, ())
    assert outcome_of(Refined(seat.seat_id, ("J1", "none")), seat, desk).act == ""


def test_a_place_does_not_call_back_a_hand_that_has_gone_on__law(desk, seat):
    left = next(key for key in visible(desk.rows, seat) if key != seat.current)
    found = outcome_of(PlacedInScan(seat.seat_id, left, 400.0, 400.0), seat, desk)
    assert found.seat.current == seat.current
    assert [draft.key for draft in found.seat.drafts] == [left]


def test_what_does_not_apply_to_a_tie_point_is_told__law(desk, seat):
    key = "tie 7", seat.current[1]
    tie = replace(desk.state.block.measurements[seat.current], point_id=key[0])
    extra = Extra({}, {key: tie}, {key[0]: "tie"})
    there = replace(desk, state=replace(desk.state, extra=extra))
    for gesture in (Refined(seat.seat_id, key), RoleSwitched(seat.seat_id, key[0])):
        found = outcome_of(gesture, seat, there)
        assert (found.decisions, found.act) == ((), "")
        assert found.notice is not None
        assert found.notice.text == "notice.yes-or-no"


def test_a_peak_is_chosen_only_if_it_is_there__law(desk, seat):
    chosen = outcome_of(PeakChosen(seat.seat_id, seat.current, 0), seat, desk)
    assert chosen.seat.drafts == (Draft(seat.current, ChoosePeak(*seat.current, 0)),)
    assert chosen.decisions == ()
    assert outcome_of(PeakChosen(seat.seat_id, seat.current, 99), seat, desk).seat.drafts == ()


def test_the_role_is_switched_both_ways__law(desk, seat):
    for point_id, point in desk.state.block.surveyed.items():
        found = outcome_of(RoleSwitched(seat.seat_id, point_id), seat, desk)
        role = "check" if point.role == "control" else "control"
        assert found.decisions == (SetRole(point_id, role),)


def test_undo_is_left_to_the_loop__law(desk, seat):
    found = outcome_of(Undone(seat.seat_id), seat, desk)
    assert (found.decisions, found.act) == ((), "undo")


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
    filtered = outcome_of(
        Filtered(seat.seat_id, QueueFilter("all", photo, "check")), seat, desk
    ).seat
    shown = visible(desk.rows, filtered)
    assert shown
    assert all(key[1] == photo and desk.rows[key].role == "check" for key in shown)
    assert filtered.current in shown


def test_a_ray_to_a_point_makes_it_current__truth(desk, seat):
    block = desk.state.oriented
    key = seat.order[7]
    target = block.surveyed[key[0]].position - block.origin
    eye = target + np.array([300.0, -900.0, 1500.0])
    found = outcome_of(Aimed(seat.seat_id, "pick", tuple(eye), tuple(target - eye)), seat, desk)
    assert found.seat.current is not None
    assert found.seat.current[0] == key[0]


def test_a_point_picked_in_3d_is_a_row_of_the_queue__law(desk, seat):
    """A point that is not in use was shown as one of none, and no row was marked."""
    block = desk.state.oriented
    unused = {
        point
        for point, keys in desk.table.by_point.items()
        if all(desk.rows[key].state == "unused" for key in keys)
    }
    target = block.surveyed[min(unused)].position - block.origin
    eye = target + np.array([0.0, 0.0, 900.0])
    found = outcome_of(Aimed(seat.seat_id, "pick", tuple(eye), (0.0, 0.0, -1.0)), seat, desk).seat
    assert found.current[0] in unused
    assert found.current in visible(desk.rows, found)


def test_a_point_picked_in_3d_leaves_the_filter_that_shows_it__law(desk, seat):
    """Of a point in the queue another measurement was taken, and the filter changed unasked."""
    key = seat.order[7]
    other = next(one for one in desk.table.by_point[key[0]] if one != key)
    seat = replace(seat, filter=QueueFilter("all", key[1]), current=other)
    target = desk.state.oriented.surveyed[key[0]].position - desk.state.oriented.origin
    eye = target + np.array([300.0, -900.0, 1500.0])
    aimed = Aimed(seat.seat_id, "pick", tuple(eye), tuple(target - eye))
    found = outcome_of(aimed, seat, desk)
    assert (found.seat.current, found.seat.filter, found.notice) == (key, seat.filter, None)
    elsewhere = replace(seat, filter=QueueFilter("all", "elsewhere"))
    told = outcome_of(aimed, elsewhere, desk)
    assert told.notice == Notice("notice.filter", {"name": key[0]})


def test_a_ray_through_a_frustum_shows_that_photo__truth(desk, seat):
    block = desk.state.oriented
    for photo_id, photo in block.photos.items():
        target = photo.exterior.centre - block.origin - np.array([0.0, 0.0, 60.0])
        eye = target + np.array([0.0, -500.0, 3000.0])
        found = outcome_of(Aimed(seat.seat_id, "pick", tuple(eye), tuple(target - eye)), seat, desk)
        assert found.seat.current is not None
        assert found.seat.current[1] == photo_id
        assert found.seat.scene.photo == photo_id
        let_go = outcome_of(
            Aimed(seat.seat_id, "pick", tuple(eye), (0.0, 0.0, 1.0)), found.seat, desk
        )
        assert let_go.seat.scene.photo == ""


def above(desk, photo_id: str) -> tuple[tuple[float, ...], tuple[float, float, float]]:
    """A ray from the sky down through a photo's frustum."""
    centre = desk.state.oriented.photos[photo_id].exterior.centre - desk.state.block.origin
    return tuple(centre + np.array([0.0, 0.0, 3000.0])), (0.0, 0.0, -1.0)


def test_a_double_click_flies_into_a_photo_and_the_next_one_out__law(desk, seat):
    photo_id = "1938_01_015"
    ray = above(desk, photo_id)
    inside = outcome_of(Aimed(seat.seat_id, "follow", *ray, number=1), seat, desk).seat
    assert inside.scene.inside == inside.scene.photo == photo_id
    assert replace(inside.scene, relief=5.0).seen_relief == 1.0
    outside = outcome_of(Aimed(seat.seat_id, "follow", *ray, number=2), inside, desk).seat
    assert outside.scene.inside == ""
    assert outside.scene.photo == photo_id
    for gesture in (PhotoEntered(seat.seat_id, ""), Fitted(seat.seat_id, True)):
        assert outcome_of(gesture, inside, desk).seat.scene.inside == ""
    assert outcome_of(PhotoEntered(seat.seat_id, "none"), seat, desk).seat == seat


def test_a_double_click_on_the_ground_lists_the_photos_that_see_it__truth(desk, seat):
    bare = replace(seat, scene=replace(seat.scene, hidden=frozenset({"photos"})))
    eye, down = above(desk, "1938_01_015")
    found = outcome_of(Aimed(seat.seat_id, "follow", eye, down, number=9), bare, desk)
    assert found.answer is not None
    name, part = found.answer
    assert (name, part["number"]) == ("sight", 9)
    assert part["photos"][0][0] == "1938_01_015"
    assert len(part["photos"]) > 1
    assert found.seat == bare


def test_a_card_tells_of_what_lies_under_the_pointer__truth(desk, seat):
    ray = above(desk, "1938_01_015")
    name, card = outcome_of(Aimed(seat.seat_id, "hover", *ray, number=3), seat, desk).answer
    assert (name, card["number"], card["photo"]) == ("card", 3, "1938_01_015")
    used = [
        key for key, item in desk.state.report.block.measurements.items()
        if key[1] == card["photo"] and item.used and key not in desk.state.report.rejected
        and desk.state.block.surveyed[key[0]].role == "control"
    ]  # fmt: skip
    assert card["control"] == len(used)
    assert 0.1 < card["rms"] < 5
    block = desk.state.oriented
    point = seat.order[0][0]
    target = block.surveyed[point].position - block.origin
    ray = tuple(target + np.array([300.0, -900.0, 1000.0])), (-300.0, 900.0, -1000.0)
    _, card = outcome_of(Aimed(seat.seat_id, "hover", *ray, number=4), seat, desk).answer
    misfits = [
        desk.rows[key].misfit_px
        for key in desk.table.by_point[point]
        if desk.rows[key].misfit_px is not None
    ]
    assert card["point"] == point
    assert card["photos"] == len(desk.table.by_point[point])
    assert card["misfit_px"] == pytest.approx(max(misfits), abs=0.3)
    _, card = outcome_of(
        Aimed(seat.seat_id, "hover", ray[0], (0.0, 0.0, 1.0), number=5), seat, desk
    ).answer
    assert card == {"number": 5}


def test_heights_are_exaggerated_for_one_seat__law(desk, seat):
    raised = outcome_of(ReliefRaised(seat.seat_id, 5.0), seat, desk).seat
    assert raised.scene.relief == 5.0
    assert raised.scene.hidden == seat.scene.hidden


def test_a_page_that_turns_light_has_its_scene_so__law(desk, seat):
    scene = outcome_of(ThemeChosen(seat.seat_id, True), seat, desk).seat.scene
    assert scene == replace(seat.scene, light=True)


def test_selected_must_exist__law(desk, seat):
    assert outcome_of(Selected(seat.seat_id, ("none", "none")), seat, desk).seat == seat


def test_what_is_selected_is_in_the_list__law(desk, seat):
    """A thumbnail of another scan led to a row that the filter hides."""
    key = seat.current
    narrow = with_filter(seat, desk.rows, QueueFilter("all", photo_id="elsewhere"))
    found = outcome_of(Selected(seat.seat_id, key), narrow, desk).seat
    assert found.current == key
    assert key in visible(desk.rows, found)


def test_a_filter_that_lets_nothing_through_shows_nothing_and_forgets_nothing__law(desk, seat):
    here = replace(seat, current=seat.order[3])
    empty = outcome_of(Filtered(seat.seat_id, QueueFilter("open", "", "fiducial")), here, desk).seat
    assert empty.current is None
    back = outcome_of(Filtered(seat.seat_id, QueueFilter("open")), empty, desk).seat
    assert back.current == here.current


def test_every_filter_keeps_its_own_place__law(desk, seat):
    shown = visible(desk.rows, seat)
    here = replace(seat, current=shown[4])
    there = outcome_of(Filtered(seat.seat_id, QueueFilter("unused")), here, desk).seat
    assert desk.rows[there.current].state == "unused"
    there = outcome_of(Stepped(seat.seat_id, 1), there, desk).seat
    back = outcome_of(Filtered(seat.seat_id, QueueFilter("open")), there, desk).seat
    assert back.current == shown[4]
    again = outcome_of(Filtered(seat.seat_id, QueueFilter("unused")), back, desk).seat
    assert again.current == there.current
    # What was decided meanwhile is passed over.
    rows = {**desk.rows, shown[4]: replace(desk.rows[shown[4]], state="accepted")}
    assert with_filter(there, rows, QueueFilter("open")).current == shown[5]


def test_next_passes_over_what_is_decided__law(desk, seat):
    shown = visible(desk.rows, seat)
    done = {key: replace(desk.rows[key], state="rejected") for key in shown[1:4]}
    rows = {**desk.rows, **done}
    seat = replace(seat, current=shown[0], filter=QueueFilter("all"))
    assert next_open(rows, seat) == next(
        k for k in visible(rows, seat)[1:] if rows[k].state == "auto"
    )
    assert next_open(rows, replace(seat, filter=QueueFilter("rejected"))) in done


def test_what_is_picked_in_3d_is_in_the_queue_whatever_its_filter__law(desk, seat):
    unused = next(key for key, row in desk.rows.items() if row.state == "unused")
    seat = with_filter(seat, desk.rows, QueueFilter("open", "elsewhere", "tie"))
    found = showing(seat, desk.rows, unused)
    assert found.current == unused
    assert found.filter == QueueFilter("unused")
    same = showing(replace(found, filter=QueueFilter("all")), desk.rows, unused)
    assert same.filter == QueueFilter("all")
