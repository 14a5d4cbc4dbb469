"""What waits to be measured: where it is expected, in which order, and how it leaves the list."""

from dataclasses import replace

import numpy as np
import pytest

from app.desk.measuring import Proposer
from sessions.decisions import Accept, MarkNotVisible, Place, Recorded, Reject, Withdraw
from sessions.replay import replay
from tests.ui.desk_block import tiny_block
from tests.ui.user_points import COUNT, measuring_snapshot, true_pixel
from ui.review.gestures import Judged, JudgedTogether, PlacedInScan
from ui.review.outcome import outcome_of
from ui.review.pages import seat_point
from ui.review.queue import seat_down, visible
from ui.review.snapshot import DeskSnapshot
from ui.review.state import DeskState, Draft, QueueFilter, Seat
from ui.review.to_measure import kept_up, with_proposals
from ui.review.trial import is_to_be_asked

DEM = tiny_block().land.dem
MEASURE = QueueFilter("measure")


@pytest.fixture(scope="module")
def desk() -> DeskSnapshot:
    return measuring_snapshot()


@pytest.fixture
def seat(desk: DeskSnapshot) -> Seat:
    return seat_down(Seat("seat-1", "anna", filter=MEASURE), desk.rows)


def after(state: DeskState, decision) -> DeskState:
    """The desk after one decision."""
    block = replay(state.block, [Recorded(1, "", "anna", decision)]).block
    return kept_up(state, replace(state, block=block), DEM)


def proposed(desk: DeskSnapshot, *keys) -> DeskSnapshot:
    """The desk with proposals at the true places."""
    waiting = desk.state.to_measure.waiting
    found = {
        key: replace(waiting[key], column=pixel[0], row=pixel[1], sigma_px=0.2, score=0.9)
        for key in keys
        if (pixel := true_pixel(key).tolist())
    }
    state = with_proposals(desk.state, found)
    return replace(desk, state=state).with_table(desk.table.renewed(state))


def test_every_point_waits_in_every_photo_that_shows_it__truth(desk):
    waiting = desk.state.to_measure.waiting
    assert {point for point, _ in waiting} == {f"T{n + 1}" for n in range(COUNT)}
    for point in {point for point, _ in waiting}:
        for photo in desk.state.block.photos:
            inside = np.all((true_pixel((point, photo)) > 25) & (true_pixel((point, photo)) < 1175))
            assert not inside or (point, photo) in waiting
    errors = [
        one.sigmas_away(*true_pixel(key), 0.0)
        for key, one in desk.state.to_measure.predictions.items()
    ]
    # The tiny block has blunders that nobody has rejected: its ellipses are not to be tight.
    assert np.median(errors) < 3


def test_all_photos_of_a_point_come_together_best_view_first__law(desk, seat):
    shown = visible(desk.rows, seat)
    points = list(dict.fromkeys(point for point, _ in shown))
    predictions = desk.state.to_measure.predictions
    assert [key for name in points for key in shown if key[0] == name] == list(shown)
    for name in points:
        views = [predictions[key].view for key in shown if key[0] == name]
        assert views == sorted(views)
    gains = [desk.rows[key].gain for key in shown]
    assert gains == sorted(gains, reverse=True)
    assert gains[0] > gains[-1] > 0


def test_what_is_to_be_measured_is_not_to_be_reviewed__law(desk):
    plain = seat_down(Seat("seat-1", "anna"), desk.rows)
    assert plain.filter.state == "open"
    assert not set(visible(desk.rows, plain)) & set(desk.state.to_measure.waiting)
    only = {key: row for key, row in desk.rows.items() if row.state == "predicted"}
    assert seat_down(Seat("seat-2", "anna"), only).filter == MEASURE


@pytest.mark.parametrize("verdict", ["accept", "reject", "dubious"])
def test_a_prediction_is_not_a_measurement__law(desk, seat, verdict):
    outcome = outcome_of(Judged("seat-1", seat.current, verdict), seat, desk)
    assert outcome.decisions == ()
    assert outcome.notice.text == "notice.place-first"
    assert outcome.seat.current == seat.current


def test_a_click_and_yes_measure_and_the_next_photo_comes__law(desk, seat):
    key, place = seat.current, true_pixel(seat.current)
    drafted = outcome_of(PlacedInScan("seat-1", key, *place), seat, desk).seat
    kept = outcome_of(Judged("seat-1", key, "accept"), drafted, desk)
    (decision,) = kept.decisions
    assert decision == Place(*key, *place)
    assert kept.seat.current[0] == key[0]
    state = after(desk.state, decision)
    assert key not in state.to_measure.waiting
    measured = state.block.measurements[key]
    assert (measured.status, measured.column) == ("accepted", pytest.approx(place[0]))
    table = desk.table.with_changes(desk.state, state)
    assert table.rows[key].state == "accepted"
    assert len(table.rows) == len(desk.rows)


def test_what_cannot_be_seen_leaves_the_list__law(desk, seat):
    key = seat.current
    outcome = outcome_of(Judged("seat-1", key, "invisible"), seat, desk)
    assert outcome.decisions == (MarkNotVisible(*key),)
    state = after(desk.state, outcome.decisions[0])
    assert state.block.measurements[key].status == "rejected"
    assert key not in state.to_measure.waiting
    assert np.isfinite(state.block.measurements[key].column)


def test_a_place_outside_of_the_ellipse_is_asked_about__law(desk, seat):
    expected = desk.state.to_measure.predictions[seat.current]
    reach = 10 * np.sqrt(np.trace(expected.covariance)) + 10
    far = Place(*seat.current, expected.column + reach, expected.row)
    near = replace(far, column=expected.column + 0.3)
    assert is_to_be_asked(desk.state, seat, Draft(seat.current, far), ())
    assert not is_to_be_asked(desk.state, seat, Draft(seat.current, near), ())


def test_proposals_are_accepted_one_by_one_or_all_at_once__law(desk, seat):
    keys = [key for key in visible(desk.rows, seat) if key[0] == seat.current[0]][:2]
    fresh = proposed(desk, *keys)
    assert [fresh.rows[key].state for key in keys] == ["proposed"] * 2
    assert fresh.rows[keys[0]].score == pytest.approx(0.9)
    one = outcome_of(Judged("seat-1", keys[0], "accept"), seat, fresh)
    assert one.decisions == (Place(*keys[0], *true_pixel(keys[0]), 0.2),)
    both = outcome_of(JudgedTogether("seat-1", tuple(keys), "accept"), seat, fresh)
    assert [(item.point_id, item.photo_id) for item in both.decisions] == keys
    assert both.seat.current not in keys
    assert both.seat.current[0] == keys[0][0]
    measured = after(fresh.state, one.decisions[0]).block.measurements[keys[0]]
    assert measured.sigma_px == 0.2


def test_a_dismissed_proposal_stays_dismissed_until_it_is_undone__law(desk, seat):
    fresh = proposed(desk, seat.current)
    key, state = seat.current, fresh.state
    outcome = outcome_of(Judged("seat-1", key, "reject"), seat, fresh)
    assert outcome.decisions == (Reject(*key, reason="other"),)
    dismissed = Recorded(1, "", "anna", outcome.decisions[0])
    block = replay(state.block, [dismissed]).block
    gone = kept_up(state, replace(state, block=block), DEM)
    assert block.measurements[key].status == "rejected"
    # What is proposed anew does not bring it back; nor is there a place to be accepted.
    assert key not in with_proposals(gone, state.to_measure.proposals).to_measure.waiting
    there = replace(fresh, state=gone).with_table(fresh.table.renewed(gone))
    again = outcome_of(Judged("seat-1", key, "accept"), seat, there)
    assert again.decisions == ()
    assert again.notice.text == "notice.place-first"
    undone = replay(state.block, [dismissed, Recorded(2, "", "anna", Withdraw(1))]).block
    back = kept_up(gone, replace(gone, block=undone), DEM)
    assert back.to_measure.waiting.keys() == state.to_measure.waiting.keys()


def test_what_is_accepted_with_others_was_seen_by_nobody__law(desk, seat):
    keys = [key for key in visible(desk.rows, seat) if key[0] == seat.current[0]][:3]
    fresh = proposed(desk, *keys)
    together = outcome_of(JudgedTogether("seat-1", tuple(keys), "accept"), seat, fresh)
    assert [item.seen for item in together.decisions] == [True, False, False]
    recorded = [Recorded(n, "", "anna", one) for n, one in enumerate(together.decisions, start=1)]
    block = replay(fresh.state.block, recorded).block
    assert [block.measurements[key].seen for key in keys] == [True, False, False]
    state = kept_up(fresh.state, replace(fresh.state, block=block), DEM)
    there = replace(fresh, state=state).with_table(fresh.table.renewed(state))
    # Who looks at it later says so by accepting it.
    looked = outcome_of(Judged("seat-1", keys[1], "accept"), seat, there).decisions
    assert looked == (Accept(*keys[1]),)
    assert replay(block, [Recorded(9, "", "anna", looked[0])]).block.measurements[keys[1]].seen


def test_check_points_that_nobody_saw_are_not_independent__law(desk):
    name = f"T{COUNT}"
    keys = [key for key in desk.state.to_measure.waiting if key[0] == name][:2]
    places = [Place(*key, *true_pixel(key).tolist(), 0.2, seen=False) for key in keys]
    unseen = [Recorded(n, "", "anna", place) for n, place in enumerate(places, start=1)]
    block = replay(desk.state.block, unseen).block
    assert name not in block.independent_checks
    looked = Recorded(3, "", "anna", replace(places[0], sigma_px=None, seen=True))
    assert name in replay(desk.state.block, [*unseen, looked]).block.independent_checks


def test_the_page_gets_the_ellipse_and_no_misfit_of_a_prediction__law(desk, seat):
    part = seat_point(seat, desk)
    root = np.array(part["ellipse"])
    covariance = desk.state.to_measure.predictions[seat.current].covariance
    np.testing.assert_allclose(root @ root.T / 9, covariance, rtol=0.02, atol=0.01)
    assert part["figures"]["misfit"] is None
    assert part["state"] == "predicted"
    views = [(seat.current[0], other["photo"]) for other in part["others"]]
    predictions = desk.state.to_measure.predictions
    assert views == sorted(views, key=lambda key: predictions[key].view)
    assert all(other["at"] for other in part["others"])


def test_a_point_with_other_coordinates_is_searched_anew__law(desk, seat):
    """What was found at the old ones stayed proposed, also where nobody looked between."""
    name, proposer = seat.current[0], Proposer()

    def wanted(state):
        return [one.point_id for one in proposer.wanted(state, [seat])]

    state = proposed(desk, seat.current).state
    other = next(key for key in state.to_measure.waiting if key[0] != name)
    state = with_proposals(
        state, {**state.to_measure.proposals, other: state.to_measure.waiting[other]}
    )
    assert (wanted(state), wanted(state)) == ([name], [])
    point = state.block.surveyed[name]
    there = replace(point, position=point.position + np.array([8.0, 0.0, 0.0]))
    block = replace(state.block, surveyed={**state.block.surveyed, name: there})
    moved = kept_up(state, replace(state, block=block), DEM)
    assert moved.to_measure.proposals.keys() == {other}
    assert moved.to_measure.waiting[seat.current].score == 0.0
    elsewhere = replace(seat, current=other)
    assert [one.point_id for one in proposer.wanted(moved, [elsewhere])] == [other[0]]
    back = kept_up(moved, replace(moved, block=state.block), DEM)
    assert wanted(back) == [name]


def test_points_that_come_are_predicted_at_once__law(desk):
    state = desk.state
    name, point = next((n, p) for n, p in state.block.surveyed.items() if p.source == "surveyed")
    fresh = replace(point, point_id="new")
    block = replace(state.block, surveyed={**state.block.surveyed, "new": fresh})
    came = kept_up(state, replace(state, block=block), DEM)
    shown = {photo for known, photo in state.to_measure.waiting if known == name}
    assert {photo for known, photo in came.to_measure.waiting if known == "new"} == shown
    gone = kept_up(came, replace(came, block=state.block), DEM)
    assert gone.to_measure.waiting.keys() == state.to_measure.waiting.keys()
