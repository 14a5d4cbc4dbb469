"""Second readings stand beside the first."""

import numpy as np
import pytest

from app.report.accuracy import pointing_figures
from core.block import HAND_SIGMA_PX, Block, Measurement, Reading
from sessions.codec import decode, encode
from sessions.decisions import Accept, ChoosePeak, Decision, Place, Recorded, Reject, Withdraw
from sessions.readings import agreeing, mean_sigma_px
from sessions.replay import replay


def log(*said: tuple[str, Decision]) -> list[Recorded]:
    return [Recorded(n, f"2026-01-0{n}", who, what) for n, (who, what) in enumerate(said, start=1)]


def after(block: Block, *said: tuple[str, Decision]) -> Measurement:
    return replay(block, log(*said)).block.measurements["P1", "A"]


def place(column: float, row: float) -> Place:
    return Place("P1", "A", column, row)


def test_two_operators_stand_side_by_side_and_their_mean_is_used__truth(block):
    both = after(block, ("ada", place(100.0, 50.0)), ("bob", place(101.0, 50.4)))
    assert (both.column, both.row) == (100.5, 50.2)
    assert both.readings == (
        Reading("ada", 100.0, 50.0, "2026-01-01"),
        Reading("bob", 101.0, 50.4, "2026-01-02"),
    )
    assert both.reason == "placed by ada, bob"
    assert decode(encode(both)) == both


def test_the_same_operator_replaces_his_own_reading_only__truth(block):
    alone = after(block, ("ada", place(100.0, 50.0)), ("ada", place(101.0, 50.0)))
    assert (alone.column, alone.sigma_px, len(alone.readings)) == (101.0, HAND_SIGMA_PX, 1)
    again = after(
        block,
        ("ada", place(99.0, 50.0)),
        ("bob", place(101.0, 50.0)),
        ("ada", place(100.0, 50.0)),
    )
    assert again.column == 100.5
    assert [one.operator for one in again.readings] == ["bob", "ada"]


def test_taken_back_leaves_the_other_reading__law(block):
    first = ("ada", place(100.0, 50.0))
    assert after(block, first, ("bob", place(101.0, 50.0)), ("bob", Withdraw(2))) == after(
        block, first
    )


def test_replaying_over_what_was_replayed_changes_nothing__law(block):
    said = log(("ada", place(99.0, 50.0)), ("bob", place(101.0, 50.0)), ("ada", place(100.0, 50.0)))
    once = replay(block, said).block
    assert encode(replay(once, said).block) == encode(once)


def test_another_detail_is_kept_and_not_averaged__truth(block):
    both = after(block, ("ada", place(100.0, 50.0)), ("bob", place(130.0, 50.0)))
    assert (both.column, both.sigma_px, len(both.readings)) == (130.0, HAND_SIGMA_PX, 2)
    assert both.reason == "placed by bob"


def test_what_was_rejected_is_no_reading_any_more__truth(block):
    said = (("ada", place(100.0, 50.0)), ("bob", Reject("P1", "A", "wrong object")))
    assert after(block, *said).readings == ()
    assert after(block, *said, ("bob", place(101.0, 50.0))).column == 101.0
    assert (
        after(block, ("ada", place(100.0, 50.0)), ("bob", ChoosePeak("P1", "A", 0))).readings == ()
    )
    accepted = after(block, ("ada", place(100.0, 50.0)), ("bob", Accept("P1", "A", 100.0, 50.0)))
    assert len(accepted.readings) == 1


def test_the_sigma_of_a_mean_is_that_of_hands_on_the_average__law():
    """Normal readings of half a pixel: variances told are right in the mean."""
    rng = np.random.default_rng(1)
    for count in (1, 2, 3):
        places = rng.normal(0, HAND_SIGMA_PX, (2000, count, 2))
        told = [
            mean_sigma_px([Reading("x", column, row, "") for column, row in own.tolist()])
            for own in places
        ]
        # Two thousand variances of two degrees of freedom or more: within 5 %.
        assert np.mean(np.square(told)) == pytest.approx(HAND_SIGMA_PX**2 / count, rel=0.05)
    wide = mean_sigma_px([Reading("x", 0.0, 0.0, ""), Reading("y", 1.9, 0.0, "")])
    near = mean_sigma_px([Reading("x", 0.0, 0.0, ""), Reading("y", 0.1, 0.0, "")])
    assert wide > HAND_SIGMA_PX > near > 0.2


def test_the_newest_reading_decides_which_detail_it_is__law():
    far, near, newest = (
        Reading(who, column, 0.0, "") for who, column in (("a", 9.0), ("b", 1.0), ("c", 0.0))
    )
    assert agreeing((far, near, newest)) == (near, newest)


def test_the_report_says_how_well_operators_point__truth(block):
    rng = np.random.default_rng(2)
    measured = []
    for number in range(500):
        own, other = rng.normal(0, 0.4, (2, 2)).tolist()
        readings = (Reading("ada", own[0] + 0.2, own[1], ""), Reading("bob", *other, ""))
        measured.append(Measurement(f"P{number}", "A", 0.0, 0.0, 0.3, readings=readings))
    far = (Reading("ada", 0.0, 0.0, ""), Reading("bob", 50.0, 0.0, ""))
    measured.append(Measurement("P", "A", 0.0, 0.0, 0.5, readings=far))
    ada, bob = pointing_figures(measured)
    assert (ada["who"], bob["who"]) == ("ada", "bob")
    # A tenth of differences of 0.57 px lies beyond 2 px nowhere; the shift of 0.2 adds a twentieth.
    assert ada["sigma_px"] == pytest.approx(0.41, rel=0.06)
    assert ada["sigma_px"] == bob["sigma_px"]
    # 0.57 px over the root of five hundred, three times.
    assert ada["column_px"] == pytest.approx(0.2, abs=0.08)
    assert ada["column_px"] == -bob["column_px"]
    assert ada["other_detail"] >= 1
    assert pointing_figures(block.measurements.values()) == []
