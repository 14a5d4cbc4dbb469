"""A second operator measures what a first one has, without seeing where."""

from dataclasses import replace

import numpy as np
import pytest

from app.desk.measuring import MeasuringTool
from core.control.likeness import Likeness
from sessions.decisions import Place, Recorded
from sessions.replay import replay
from tests.ui.user_points import measuring_snapshot, true_pixel
from ui.review.gestures import Judged, PeakChosen, PlacedInScan, Refined
from ui.review.outcome import outcome_of
from ui.review.pages import Pages, seat_point
from ui.review.queue import seat_down, visible
from ui.review.second_reading import apart_px, blinded, is_blind, readings_part
from ui.review.sight import Picked, card_part
from ui.review.snapshot import DeskSnapshot
from ui.review.state import QueueFilter, Seat
from ui.review.to_measure import kept_up

SECOND = QueueFilter("second")
STEPS = np.arange(-20, 21) ** 2
HILL = np.exp(-np.add.outer(STEPS, STEPS) / 4).astype(np.float32)


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
    table = desk.table.with_changes(desk.state, state)
    return replace(desk, state=state, recorded=recorded).with_table(table)


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


def test_nothing_begins_at_the_first_place_or_tells_it_while_one_reads_blindly__law(once, key):
    """Enter and a peak made a second reading of the first; history, card and 3D told of it."""
    anna = seat_down(Seat("seat-1", "anna", filter=SECOND), once.rows)
    berta = seat_down(Seat("seat-2", "berta", filter=SECOND), once.rows)
    for gesture in (Refined("seat-2", key), PeakChosen("seat-2", key, 0)):
        refused = outcome_of(gesture, berta, once)
        assert refused.notice.text == "notice.read-first"
        assert (refused.act, refused.seat.drafts) == ("", ())
    drafted = outcome_of(PlacedInScan("seat-2", key, *true_pixel(key).tolist()), berta, once).seat
    assert outcome_of(Refined("seat-2", key), drafted, once).act == "measure"
    lines = [seat_point(seat, once)["history"][0]["detail"][0] for seat in (anna, berta)]
    assert lines == ["detail.pixel", ""]
    cards = [card_part(Picked("point", key[0]), seat, once) for seat in (anna, berta)]
    assert cards[0]["misfit_m"] is not None
    assert cards[1]["misfit_m"] is None
    drawn = [Pages().changed_scene(seat, once)().vector_keys for seat in (anna, berta)]
    assert set(drawn[0]) - set(drawn[1]) == {key}
    found = replace(once.state.block.measurements[key], status="dubious")
    proposed = replace(once.state.to_measure, proposals={key: found})
    known = blinded(replace(once.state, to_measure=proposed), berta, key[0])
    assert known.measurement_of(key) != found


def test_a_second_reading_that_is_refined_stays_one__law(once, key):
    """Within two pixels of the first it took over its weight, and both readings were lost."""
    column, row = true_pixel(key).tolist()
    berta = Seat("seat-2", "berta", current=key, filter=SECOND)
    berta = outcome_of(PlacedInScan("seat-2", key, column, row), berta, once).seat
    tool = MeasuringTool(lambda *_: Likeness(HILL, np.array([[column, row]]) - 20.0, 1))
    found = tool(Refined("seat-2", key), once.with_seat(berta), print).decision
    assert found == Place(*key, pytest.approx(column, abs=1), pytest.approx(row, abs=1), None)


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
