"""A second operator measures what a first one has, without seeing where."""

from dataclasses import replace

import pytest

from sessions.decisions import Place, Recorded
from sessions.replay import replay
from tests.ui.user_points import measuring_snapshot, true_pixel
from ui.review.gestures import Judged, PlacedInScan
from ui.review.outcome import outcome_of
from ui.review.pages import seat_point
from ui.review.queue import seat_down, visible
from ui.review.second_reading import apart_px, blinded, is_blind, readings_part
from ui.review.snapshot import DeskSnapshot
from ui.review.state import QueueFilter, Seat
from ui.review.to_measure import kept_up

SECOND = QueueFilter("second")


def read(desk: DeskSnapshot, *readings: tuple[str, float]) -> DeskSnapshot:
    """The desk once operators have placed its first point so many pixels beside the truth."""
    key = next(iter(desk.state.to_measure.waiting))
    column, row = true_pixel(key).tolist()
    recorded = [
        Recorded(number, f"2026-01-0{number}", who, Place(*key, column + beside, row))
        for number, (who, beside) in enumerate(readings, start=1)
    ]
    block = replay(desk.state.block, recorded).block
    state = kept_up(desk.state, replace(desk.state, block=block), desk.dem)
    return replace(desk, state=state).with_table(desk.table.with_changes(desk.state, state))


@pytest.fixture(scope="module")
def once() -> DeskSnapshot:
    return read(measuring_snapshot(), ("anna", 0.4))


@pytest.fixture
def key(once):
    return next(iter(once.state.to_measure.predictions))


def test_what_one_has_read_is_to_be_read_again_by_another_who_sees_no_place__law(once, key):
    anna = seat_down(Seat("seat-1", "anna", filter=SECOND), once.rows)
    berta = seat_down(Seat("seat-2", "berta", filter=SECOND), once.rows)
    assert visible(once.rows, berta) == (key,)
    assert is_blind(once.state, berta, key)
    assert not is_blind(once.state, anna, key)
    seen, hidden = seat_point(anna, once), seat_point(berta, once)
    measured = once.state.block.measurements[key]
    assert seen["raw"]["measured"] == pytest.approx([measured.column, measured.row], abs=1e-3)
    assert hidden["state"] == "predicted"
    assert hidden["raw"]["measured"] == hidden["raw"]["predicted"]
    assert hidden["figures"]["misfit"] is None
    assert (hidden["peaks"], hidden["readings"], hidden["trial"]) == ([], [], None)
    assert key not in blinded(once.state, berta, key[0]).block.measurements


def test_who_reads_blindly_places_before_he_says_yes__law(once, key):
    berta = seat_down(Seat("seat-2", "berta", filter=SECOND), once.rows)
    refused = outcome_of(Judged("seat-2", key, "accept"), berta, once)
    assert refused.notice.text == "notice.read-first"
    assert not refused.decisions
    place = (true_pixel(key) + 0.2).tolist()
    drafted = outcome_of(PlacedInScan("seat-2", key, *place), berta, once).seat
    part = seat_point(drafted, once)
    assert part["draft"]["raw"] == pytest.approx(place, abs=1e-3)
    kept = outcome_of(Judged("seat-2", key, "accept"), drafted, once)
    assert kept.decisions == (Place(*key, *place),)


def test_both_readings_are_shown_once_both_are_there__law(once, key):
    twice = read(measuring_snapshot(), ("anna", 0.4), ("berta", -0.2))
    berta = Seat("seat-2", "berta", current=key, filter=SECOND)
    assert not is_blind(twice.state, berta, key)
    assert visible(twice.rows, seat_down(berta, twice.rows)) == ()
    measured = twice.state.block.measurements[key]
    assert apart_px(measured) == pytest.approx(0.6)
    assert [one["who"] for one in readings_part(measured)] == ["anna", "berta"]
    assert len(seat_point(berta, twice)["readings"]) == 2
    assert readings_part(once.state.block.measurements[key]) == []
