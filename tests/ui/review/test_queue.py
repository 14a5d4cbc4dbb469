"""The queue: what is doubtful comes first, and order and filter keep their promises."""

import math
from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.block_adjustment import adjust_block
from core.quality.assessment import assess_block
from core.quality.rules import judge_block
from sessions.decisions import Place
from tests.flights import FlightPlan, fly
from tests.ui.desk_block import tiny_block
from ui.review.compare import made_with
from ui.review.misfit import Misfit, misfits
from ui.review.queue import (
    coming,
    keep_seat_up,
    neighbour,
    passes,
    seat_down,
    showing,
    sort_keys,
    visible,
    with_filter,
)
from ui.review.rows import NO_ROWS, queue_row, row_line
from ui.review.state import POINT_KINDS, DeskState, Draft, QueueFilter, Seat, Sorting
from ui.review.trial import TrialWork


def test_doubt_finds_the_blunders_first__truth(desk, seat):
    blunders = tiny_block().blunders
    first = set(seat.order[: 2 * len(blunders)])
    assert len(blunders & first) >= 0.9 * len(blunders)


def test_new_measurements_join_the_end_and_vanished_ones_leave__law(desk, seat):
    rows = dict(desk.rows)
    gone, moved = seat.order[3], seat.order[5]
    row = rows.pop(gone)
    rows["J999", moved[1]] = replace(row, key=("J999", moved[1]))
    kept = keep_seat_up(seat, rows)
    assert gone not in kept.order
    assert kept.order[-1] == ("J999", moved[1])


def test_an_area_takes_points_of_all_photos_and_lets_a_chosen_one_go__law(desk, seat):
    chosen = replace(seat, scene=replace(seat.scene, photo=seat.current[1]))
    area = QueueFilter("all", area=((-1e7, -1e7), (1e7, -1e7), (0.0, 1e7)))
    after = with_filter(chosen, desk.rows, area)
    assert len({key[1] for key in visible(desk.rows, after)}) > 1
    assert after.scene.photo == ""
    assert with_filter(chosen, desk.rows, QueueFilter("all")).scene == chosen.scene
    again = replace(after, scene=chosen.scene)
    assert with_filter(again, desk.rows, replace(area, state="open")).scene == chosen.scene


def test_who_sits_down_second_begins_elsewhere__law(desk, seat):
    second = seat_down(Seat("seat-2", "berta"), desk.rows, [seat.current])
    assert second.current not in (None, seat.current)


def test_when_a_point_vanishes_the_one_beside_it_is_shown__law(desk, seat):
    gone, beside = seat.order[4], seat.order[5]
    rows = {key: row for key, row in desk.rows.items() if key != gone}
    assert keep_seat_up(replace(seat, current=gone), rows).current == beside


def test_rows_without_a_figure_come_last_either_way__law(desk):
    some = list(desk.rows.values())[:5]
    rows = [replace(some[0], misfit_px=float("nan")), *some[1:]]
    for descending in (True, False):
        order = sort_keys(rows, Sorting("misfit", descending))
        assert order[-1] == rows[0].key
        values = [row.misfit_px for key in order[:-1] for row in rows if row.key == key]
        assert values == sorted(values, reverse=descending)


@pytest.mark.parametrize(
    ("wanted", "state", "role", "let_through"),
    [
        ("open", "unused", "control", False),
        ("open", "rejected", "control", False),
        ("open", "auto", "check", True),
        ("open", "accepted", "control", False),
        ("all", "unused", "control", True),
        ("dubious", "dubious", "control", True),
        ("all", "auto", "tie", False),
    ],
)
def test_a_filter_lets_through_what_it_names__truth(desk, wanted, state, role, let_through):
    row = replace(next(iter(desk.rows.values())), state=state, role=role)
    assert passes(row, QueueFilter(wanted)) == let_through
    assert passes(row, QueueFilter("all", role=role))
    assert not passes(row, QueueFilter("all", photo_id="elsewhere", role=role))


def test_a_name_is_found_by_its_parts_and_leaves_no_place_behind__law(desk, seat):
    row = replace(next(iter(desk.rows.values())), key=("J-5765650_-11947411", "a"))
    found = {
        text: passes(row, QueueFilter("all", text=text))
        for text in ("j 65650 47411", "J-57", "65650 kr", " ")
    }
    assert found == {"j 65650 47411": True, "J-57": True, "65650 kr": False, " ": True}
    key = seat.current
    elsewhere = next(other for other in desk.rows if other[0] != key[0])
    only = replace(seat, filter=QueueFilter("all", text=key[0]))
    assert showing(only, desk.rows, key).filter.text == key[0]
    assert showing(only, desk.rows, elsewhere).filter.text == ""
    there = with_filter(seat, desk.rows, QueueFilter("all", text=key[0]))
    back = with_filter(there, desk.rows, QueueFilter("open"))
    assert all(not filtered.text for filtered, _ in back.places)


def test_an_area_lets_through_the_points_inside_of_it__truth(desk, seat):
    places = {key: desk.state.point_of(key[0]).position[:2] for key in desk.rows}
    east, north = (np.median(list(places.values()), axis=0) + 0.013).tolist()
    # A triangle: its right angle at the middle of the points, its legs east and north.
    legs = 1e5
    area = ((east, north), (east + legs, north), (east, north + legs))
    wanted = QueueFilter("all", area=area)
    inside = {
        key
        for key, (x, y) in places.items()
        if x > east and y > north and desk.rows[key].role in POINT_KINDS
    }
    assert {key for key, row in desk.rows.items() if passes(row, wanted)} == inside
    there = with_filter(seat, desk.rows, wanted)
    assert there.current in inside
    outside = next(key for key in desk.rows if key not in inside)
    assert showing(there, desk.rows, outside).filter.area == ()
    back = with_filter(with_filter(there, desk.rows, QueueFilter("open")), desk.rows, wanted)
    assert back.current == there.current


@pytest.mark.parametrize(("seed", "metres"), [(1, 3.0), (2, 8.0), (3, 18.0)])
def test_an_accepted_blunder_passes_its_filter_and_heads_the_queue__truth(seed, metres):
    flown = fly(FlightPlan(ties=300, control=30, check=0), np.random.default_rng(seed)).block
    key = sorted(flown.measurements)[7 * seed]
    item, photo = flown.measurements[key], flown.photos[key[1]]
    off = metres / photo.ground_pixel_m(flown.camera_of(key[1]))
    wrong = replace(item, column=item.column + off, sigma_px=0.5, status="accepted")
    block = flown.with_measurement(wrong)
    report = adjust_block(block)
    state = DeskState(block, report, made=made_with(report.block))
    rows = NO_ROWS.renewed(state).rows
    seat = seat_down(Seat("seat-1", "anna", filter=QueueFilter("disputed")), rows)
    assert visible(rows, seat) == (key,)
    assert seat.order[0] == key
    assert rows[key].disputed_m == pytest.approx(metres, abs=1.5)
    assert rows[key].grounds[0].text == "doubt.disputed"
    assert row_line(rows[key])[-6] == round(rows[key].disputed_m, 1)
    # One figure for one misfit: what is asked before it is kept, the row, the verdict.
    shown = misfits(state, (key,))[key]
    asked = (shown.ratio, math.hypot(*shown.metres))
    assert asked == pytest.approx((rows[key].sigmas, rows[key].disputed_m), rel=1e-12)
    told, *_ = judge_block(assess_block(report), report)
    assert f"{rows[key].sigmas:.1f}" == told.values["test"]
    before = DeskState(flown, adjust_block(flown), made=made_with(flown))
    draft = Draft(key, Place(*key, wrong.column, wrong.row, 0.5))
    work = TrialWork(before, draft, lambda _: flown)
    kept = work.block()
    assert kept is not None
    trial = work.conclude(adjust_block(kept))
    assert trial is not None
    assert trial.against is not None
    assert trial.against.test == pytest.approx(rows[key].sigmas, rel=0.01)
    # Rejected, it is not disputed any more.
    after = replace(state, block=block.with_measurement(replace(wrong, status="rejected")))
    assert np.isnan(queue_row(after, NO_ROWS.renewed(state).figures, key).disputed_m)


def test_what_is_disputed_stands_by_sigmas_and_opens_on_the_worst__truth(desk, seat):
    """It stood as it had been sorted before anything was disputed, or by metres."""
    keys, figures = seat.order[2:5], desk.table.figures
    against = dict(zip(keys, ((5.0, 9.9), (2.0, 66.7), (3.0, 50.5)), strict=True))
    misfits = {key: Misfit((m, 0.0), (m, 0.0), sigmas) for key, (m, sigmas) in against.items()}
    told = replace(
        figures,
        misfits={**figures.misfits, **misfits},
        disputed={key: metres for key, (metres, _) in against.items()},
    )
    state = desk.state
    for key in keys:
        accepted = replace(state.block.measurements[key], status="accepted")
        state = replace(state, block=state.block.with_measurement(accepted))
    rows = {**desk.rows, **{key: queue_row(state, told, key) for key in keys}}
    after = with_filter(replace(seat, current=keys[0]), rows, QueueFilter("disputed"))
    assert visible(rows, after) == (keys[1], keys[2], keys[0])
    assert after.current == keys[1]
    # Asked for again it begins anew; what is narrowed stays where one is.
    on = replace(after, current=keys[0])
    assert with_filter(on, rows, QueueFilter("disputed")).current == keys[1]
    narrowed = with_filter(on, rows, QueueFilter("disputed", text=keys[0][0]))
    assert narrowed.current == keys[0]


def test_what_comes_next_is_open_and_nobody_elses__law(desk, seat):
    ahead = list(coming(desk.rows, seat))
    assert all(desk.rows[key].state == "auto" for key in ahead)
    assert ahead[0] not in coming(desk.rows, seat, {ahead[0]})


def test_steps_end_at_the_ends__law(desk, seat):
    shown = visible(desk.rows, seat)
    assert neighbour(desk.rows, replace(seat, current=shown[-1]), 1) == shown[-1]
    assert neighbour(desk.rows, replace(seat, current=shown[0]), -1) == shown[0]
    assert neighbour({}, seat, 1) is None


def test_steps_are_those_of_the_shown_queue__oracle(desk, seat):
    """Also from what the filter hides, and from nowhere."""
    decided = {key: replace(desk.rows[key], state="accepted") for key in seat.order[::3]}
    rows = {**desk.rows, **decided}
    shown = visible(rows, seat)
    assert len(shown) < len(seat.order)
    for here, key in enumerate((None, *seat.order), start=-1):
        after = [one for one in shown if seat.order.index(one) > here]
        before = [one for one in shown if seat.order.index(one) < here]
        at = replace(seat, current=key)
        assert neighbour(rows, at, 1) == (after or shown[-1:])[0]
        assert neighbour(rows, at, -1) == (before[-1:] or shown[:1])[0]
        assert tuple(coming(rows, at)) == (*after, *before)


def test_what_no_other_could_find_wrong_is_a_queue_of_its_own__law(desk):
    first, second, third = list(desk.rows)[:3]
    weak = {key: replace(desk.rows[key], controlled=0.02) for key in (first, third)}
    rows = {**desk.rows, **weak, second: replace(desk.rows[second], controlled=0.5)}
    seat = seat_down(Seat("seat-1", "anna", filter=QueueFilter("unchecked")), rows)
    assert {first, third} <= set(visible(rows, seat))
    assert second not in visible(rows, seat)
    assert [row_line(rows[key])[-1] for key in (first, second, third)] == [1, 0, 1]
