"""Decisions laid over a block."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from core.block import UNKNOWN_M, Block, Measurement, Peak
from core.formats.listed_point import ROLES, ListedPoint
from sessions.codec import encode
from sessions.decisions import (
    REASONS,
    Accept,
    AddPoint,
    BringPoints,
    ChoosePeak,
    Decision,
    DrawMask,
    JudgePhoto,
    JudgeTie,
    MarkDubious,
    MarkNotVisible,
    Place,
    PlacePhoto,
    Recorded,
    Reject,
    SetRole,
    Withdraw,
)
from sessions.replay import replay, with_place

points, photos = st.sampled_from(["P1", "P2", "P3", "gone"]), st.sampled_from(["A", "B", "gone"])
pixel = st.floats(0, 12000)
listed = st.builds(
    ListedPoint, points, pixel, pixel, pixel, st.tuples(*[st.floats(0.01, 9)] * 3),
    st.sampled_from(ROLES),
)  # fmt: skip
decisions: st.SearchStrategy[Decision] = st.one_of(
    st.builds(Accept, points, photos, st.none(), st.none()),
    st.builds(Accept, points, photos, pixel, pixel),
    st.builds(Reject, points, photos, st.sampled_from(REASONS)),
    st.builds(MarkDubious, points, photos),
    st.builds(MarkNotVisible, points, photos),
    st.builds(Place, points, photos, pixel, pixel),
    st.builds(ChoosePeak, points, photos, st.integers(-1, 3)),
    st.builds(SetRole, points, st.sampled_from(["control", "check"])),
    st.builds(
        DrawMask,
        photos,
        st.lists(st.tuples(pixel, pixel), min_size=1, max_size=4).map(tuple),
        st.sampled_from([0.0, 90.0]),
        st.booleans(),
        st.booleans(),
    ),
    st.builds(PlacePhoto, photos, st.lists(st.tuples(*[pixel] * 4), max_size=3).map(tuple)),
    st.builds(BringPoints, st.lists(listed, max_size=3).map(tuple), st.just("list.csv")),
)
some = settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])


def number(items: Sequence[Decision]) -> list[Recorded]:
    return [Recorded(n + 1, "", "ada", item) for n, item in enumerate(items)]


def after(block: Block, *items: Decision) -> Measurement:
    return replay(block, number(list(items))).block.measurements["P1", "A"]


@some
@given(st.lists(decisions, max_size=8), decisions)
def test_do_and_withdraw_is_nothing__law(
    block: Block, before: list[Decision], decision: Decision
) -> None:
    log = number([*before, decision, Withdraw(len(before) + 1)])
    assert encode(replay(block, log).block) == encode(replay(block, log[:-2]).block)


@some
@given(st.lists(decisions, max_size=8))
def test_undo_and_redo_of_everything_is_everything__law(block: Block, done: list[Decision]) -> None:
    count = len(done)
    undone: list[Decision] = [Withdraw(n) for n in range(count, 0, -1)]
    redone: list[Decision] = [Withdraw(n) for n in range(2 * count, count, -1)]
    assert encode(replay(block, number(done + undone)).block) == encode(block)
    assert encode(replay(block, number(done + undone + redone)).block) == encode(
        replay(block, number(done)).block
    )


@some
@given(st.lists(decisions, max_size=8))
def test_replaying_twice_is_replaying_once__law(block: Block, done: list[Decision]) -> None:
    once = replay(block, number(done)).block
    assert encode(replay(once, number(done)).block) == encode(once)


def test_each_decision_does_what_it_says__truth(block: Block) -> None:
    assert after(block, Accept("P1", "A")).status == "accepted"
    rejected = after(block, Reject("P1", "A", "changed"))
    assert (rejected.status, rejected.reason) == ("rejected", "changed")
    hidden = after(block, MarkNotVisible("P1", "A"))
    assert (hidden.status, hidden.reason) == ("rejected", "not visible")
    assert after(block, MarkDubious("P1", "A")).status == "dubious"
    peak = block.measurements["P1", "A"].peaks[1]
    chosen = after(block, ChoosePeak("P1", "A", 1))
    assert (chosen.column, chosen.row, chosen.sigma_px) == (peak.column, peak.row, peak.sigma_px)
    assert chosen.status == "accepted"
    changed = replay(block, number([SetRole("P1", "check")])).block
    assert changed.surveyed["P1"].role == "check"


def test_a_placed_measurement_is_accepted_with_half_a_pixel__truth(block: Block) -> None:
    placed = after(block, Place("P1", "A", 812.5, 90.25))
    assert (placed.column, placed.row, placed.sigma_px) == (812.5, 90.25, 0.5)
    assert (placed.status, placed.reason) == ("accepted", "placed by ada")
    assert placed.peaks[-1] == Peak(812.5, 90.25, 0.5, 1.0, "operator")
    assert placed.peaks[:2] == block.measurements["P1", "A"].peaks


def test_a_refined_measurement_keeps_its_weight_and_its_score__law(block: Block) -> None:
    proposed = block.measurements["P1", "A"]
    refined = after(block, Place("P1", "A", proposed.column + 0.1, proposed.row, 0.23))
    assert (refined.column, refined.status) == (proposed.column + 0.1, "accepted")
    assert (refined.sigma_px, refined.score) == (0.23, proposed.score)
    assert refined.peaks == proposed.peaks


def test_a_point_can_be_placed_where_nothing_was_proposed__truth(block: Block) -> None:
    bare = replace(block, measurements={})
    assert after(bare, Place("P1", "A", 5.0, 6.0)).used


def test_the_later_decision_holds__truth(block: Block) -> None:
    assert after(block, Reject("P1", "A", "other"), Accept("P1", "A")).status == "accepted"
    assert after(block, Accept("P1", "A"), Reject("P1", "A", "other")).status == "rejected"
    turned_down = after(block, Place("P1", "A", 1.0, 2.0), Reject("P1", "A", "blurred"))
    assert (turned_down.column, turned_down.status) == (1.0, "rejected")


def test_of_verdicts_on_a_photo_or_a_tie_the_last_that_stands_counts__law(block: Block) -> None:
    kept = block.ties.kept(block.ties.point != 1)
    ties = replace(kept, pixels=kept.pixels + np.array([[0.0, 0.0], [50.0, 0.0]]))
    block = replace(block, ties=ties)
    # A tie is the same one whichever of its rays was judged.
    tie = {use: JudgeTie("A", 100.25, 100.25, use) for use in (False, True)}
    other = JudgeTie("B", 150.25, 100.25, use=False)
    photo = {use: JudgePhoto("A", use) for use in (False, True)}
    log = number([photo[False], tie[False], other, photo[True], tie[True]])
    again = replay(block, log)
    assert not again.unmatched
    assert encode(again.block) == encode(block)
    out = replay(block, number([photo[True], tie[True], photo[False], other])).block
    assert (out.photos["A"].oriented, len(out.ties.point)) == (False, 0)
    undone = replay(block, [*log, *(Recorded(n + 2, "", "ada", Withdraw(n)) for n in (4, 5))])
    assert (undone.block.photos["A"].oriented, len(undone.block.ties.point)) == (False, 0)


def test_decisions_about_what_is_not_proposed_are_reported_and_come_back__truth(
    block: Block,
) -> None:
    log = number([Accept("P1", "A"), Reject("new", "A", "other"), SetRole("new", "check")])
    gone = replace(block, measurements={})
    assert [item.decision_id for item in replay(gone, log).unmatched] == [1, 2, 3]
    found = replay(block, log)
    assert [item.decision_id for item in found.unmatched] == [2, 3]
    assert found.block.measurements["P1", "A"].status == "accepted"


def test_a_new_proposal_elsewhere_does_not_move_what_was_accepted__truth(block: Block) -> None:
    seen = block.measurements["P1", "A"]
    log = number([with_place(Accept("P1", "A"), block)])
    nearby = replace(seen, column=seen.column + 0.7)
    elsewhere = replace(seen, column=seen.column + 300, peaks=())
    second = replace(elsewhere, peaks=seen.peaks)
    for proposed, expected in (
        (nearby, nearby.column),
        (elsewhere, seen.column),
        (second, seen.column),
    ):
        held = replay(block.with_measurement(proposed), log).block.measurements["P1", "A"]
        assert held.column == pytest.approx(expected)
        assert held.status == "accepted"
    assert replay(replace(block, measurements={}), log).block.measurements["P1", "A"].used


def test_a_chosen_peak_is_found_again_in_another_order__truth(block: Block) -> None:
    seen = block.measurements["P1", "A"]
    log = number([with_place(ChoosePeak("P1", "A", 1), block)])
    turned = block.with_measurement(replace(seen, peaks=seen.peaks[::-1]))
    assert replay(turned, log).block.measurements["P1", "A"].column == seen.peaks[1].column


def test_the_given_block_is_not_touched__truth(block: Block) -> None:
    before = encode(block)
    replay(block, number([Place("P1", "A", 5.0, 6.0), SetRole("P1", "check")]))
    assert encode(block) == before


def test_thousands_of_decisions_replay_within_a_keystroke__truth(block: Block) -> None:
    rng = np.random.default_rng(1)
    log = number([Place("P1", "A", *rng.uniform(0, 12000, 2)) for _ in range(5000)])
    last = log[-1].decision
    assert isinstance(last, Place)
    assert replay(block, log).block.measurements["P1", "A"].column == last.column


MINE = ListedPoint("M1", 10.0, 20.0, 30.0, (0.05, 0.05, 0.08), "check", "stone", "m1.jpg")


def test_brought_points_stand_as_surveyed_and_go_with_their_list__truth(block: Block) -> None:
    log = number([BringPoints((MINE, replace(MINE, point_id="M2")), "list.csv")])
    brought = replay(block, log)
    point = brought.block.surveyed["M1"]
    assert (point.position.tolist(), point.sigma_m.tolist()) == ([10, 20, 30], [0.05, 0.05, 0.08])
    assert (point.role, point.source) == ("check", "surveyed")
    assert (point.description, point.sketch) == ("stone", "m1.jpg")
    assert set(brought.block.surveyed) - set(block.surveyed) == {"M1", "M2"}
    assert not brought.unmatched
    gone = replay(block, [*log, Recorded(2, "", "ada", Withdraw(1))]).block
    assert set(gone.surveyed) == set(block.surveyed)


def test_a_corrected_point_keeps_what_was_measured_of_it__law(block: Block) -> None:
    first, moved = BringPoints((MINE,), "a.csv"), BringPoints((replace(MINE, height=31.0),), "")
    log = [first, Place("M1", "A", 5.0, 6.0), moved]
    for decisions in (log, [log[0], log[1], Withdraw(1), moved]):
        after_all = replay(block, number(decisions)).block
        assert after_all.surveyed["M1"].position[2] == 31.0
        assert after_all.measurements["M1", "A"].column == 5.0


def test_a_brought_point_never_takes_the_name_of_another_kind__truth(block: Block) -> None:
    taken = BringPoints((MINE, replace(MINE, point_id="P1")), "list.csv")
    replayed = replay(block, number([taken]))
    assert replayed.block.surveyed["P1"].source == "junction"
    assert "M1" in replayed.block.surveyed
    assert [item.decision for item in replayed.unmatched] == [taken]


def test_a_detail_of_unknown_coordinates_is_a_new_point__truth(block: Block) -> None:
    measured = Measurement("N001", "A", 400.0, 300.0, 0.5, status="accepted")
    added = AddPoint("N001", 1.0, 2.0, 3.0, (UNKNOWN_M, UNKNOWN_M, UNKNOWN_M), (measured,))
    known = AddPoint("H1", 1.0, 2.0, 3.0, (0.2, 0.2, 0.5), ())
    log = number([added, known, Place("N001", "B", 5.0, 6.0), SetRole("N001", "check")])
    replayed = replay(block, log)
    assert replayed.block.surveyed["N001"].role == "new"
    assert replayed.block.surveyed["H1"].role == "control"
    assert {key for key in replayed.block.measurements if key[0] == "N001"} == {
        ("N001", "A"),
        ("N001", "B"),
    }
    # Nobody knows its coordinates, so it can check nothing.
    assert [item.decision for item in replayed.unmatched] == [SetRole("N001", "check")]
