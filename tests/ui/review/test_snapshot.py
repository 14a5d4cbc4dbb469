"""A snapshot: who sits where, and queues that keep up with the rows."""

import math
from dataclasses import replace

from tests.ui.desk_block import tiny_snapshot
from ui.review.queue import keep_seat_up, seat_down, with_filter
from ui.review.state import QueueFilter, Seat


def test_others_are_those_with_an_open_page__law():
    desk = tiny_snapshot()
    anna, berta, gone = (
        seat_down(Seat(f"seat-{name}", name), desk.rows) for name in ("anna", "berta", "gone")
    )
    berta = replace(berta, current=berta.order[5])
    desk = desk.with_seat(anna).with_seat(berta).with_seat(gone)
    desk = replace(desk, present=frozenset({anna.seat_id, berta.seat_id}))
    assert desk.others(anna.seat_id) == [berta]
    assert desk.taken(anna.seat_id) == {berta.current}
    assert {seat.operator for seat in desk.present_seats()} == {"anna", "berta"}


def test_a_queue_keeps_up_with_rows_that_went__law():
    desk = tiny_snapshot()
    seat = seat_down(Seat("seat-1", "anna"), desk.rows)
    desk = desk.with_seat(seat)
    gone = seat.order[2]
    left = {k: m for k, m in desk.state.block.measurements.items() if k != gone}
    state = replace(desk.state, block=replace(desk.state.block, measurements=left))
    after = desk.with_table(desk.table.renewed(state))
    assert gone in desk.seats["seat-1"].order
    assert gone not in after.seats["seat-1"].order
    assert gone not in after.rows


def test_the_same_rows_leave_every_seat_as_it_is__law():
    desk = tiny_snapshot()
    seat = seat_down(Seat("seat-1", "anna"), desk.rows)
    desk = desk.with_seat(seat)
    assert desk.with_table(desk.table.renewed(desk.state)).seats["seat-1"] is seat


def test_the_first_row_that_comes_to_an_empty_queue_is_looked_at__law():
    """The row stood in the queue, and beside it "Choose a point" until a key was pressed."""
    desk = tiny_snapshot()
    looking = seat_down(Seat("seat-1", "anna"), desk.rows)
    empty = {key: replace(row, disputed_m=math.nan) for key, row in desk.rows.items()}
    waiting = with_filter(replace(looking, seat_id="seat-2"), empty, QueueFilter("disputed"))
    assert waiting.current is None
    desk = replace(desk, table=replace(desk.table, rows=empty))
    desk = desk.with_seat(looking).with_seat(waiting)
    less, more = looking.order[5], looking.order[9]
    rows = {
        **empty,
        less: replace(empty[less], disputed_m=3.0, gain=0.1),
        more: replace(empty[more], disputed_m=9.0, gain=0.9),
    }
    assert desk.with_table(replace(desk.table, rows=empty)).seats == desk.seats
    after = desk.with_table(replace(desk.table, rows=rows)).seats
    assert after["seat-1"] is looking
    assert after["seat-2"].current == more
    assert after["seat-2"].filter == waiting.filter


def test_an_empty_queue_that_stays_empty_keeps_its_filter__law():
    desk = tiny_snapshot()
    seat = seat_down(Seat("seat-1", "anna"), desk.rows)
    waiting = with_filter(seat, desk.rows, QueueFilter("measure"))
    fewer = {key: row for key, row in desk.rows.items() if key != seat.current}
    assert (waiting.current, keep_seat_up(waiting, fewer).filter) == (None, waiting.filter)
