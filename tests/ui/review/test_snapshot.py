"""A snapshot: who sits where, and queues that keep up with the rows."""

from dataclasses import replace

from tests.ui.desk_block import tiny_snapshot
from ui.review.queue import seat_down
from ui.review.state import Seat


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
