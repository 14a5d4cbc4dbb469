"""Samples of map sheets: the exact law, printed plans of ISO 2859-1, and what decides a sheet."""

from collections import Counter
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.stats import binom, hypergeom
from shapely.geometry import box

from core.quality.job_rules import USUAL_RULES, JobRules
from core.quality.readings import plan_figures
from core.sheets.acceptance import (
    DrawnSheet,
    JudgedLot,
    JudgedSheet,
    SamplingPlan,
    bad_sheets,
    draw_sheets,
    lot_findings,
    smallest_plan,
)
from core.sheets.map_sheets import MapSheet

AREA = box(0, 0, 100, 80)
NONE = plan_figures(np.zeros((0, 2)))
LIMIT_M = 0.8


def rules_of(good: float, bad: float, producer: float, consumer: float) -> JobRules:
    return replace(
        USUAL_RULES,
        sheets_good_percent=good,
        sheets_bad_percent=bad,
        producer_risk_percent=producer,
        consumer_risk_percent=consumer,
    )


@given(st.integers(1, 400), st.data())
def test_the_operating_characteristic_is_the_hypergeometric_sum__oracle(lot, data) -> None:
    sample = data.draw(st.integers(1, lot))
    plan = SamplingPlan(lot, sample, data.draw(st.integers(0, sample)))
    bad = data.draw(st.integers(0, lot))
    expected = hypergeom.cdf(plan.accepted, lot, bad, sample)
    assert plan.acceptance(bad) == pytest.approx(expected, abs=1e-9)


@given(st.integers(2, 120), st.data())
def test_worse_lots_and_larger_samples_are_accepted_more_rarely__law(lot, data) -> None:
    plan = SamplingPlan(lot, data.draw(st.integers(1, lot - 1)), data.draw(st.integers(0, 5)))
    curve = [plan.acceptance(bad) for bad in range(lot + 1)]
    assert curve[0] == 1.0
    assert all(a >= b for a, b in pairwise(curve))
    larger = replace(plan, sample=plan.sample + 1)
    assert all(larger.acceptance(bad) <= curve[bad] for bad in range(lot + 1))


@given(
    st.integers(1, 80),
    st.sampled_from([0.0, 1.0, 2.5, 4.0, 10.0]),
    st.sampled_from([2.5, 8.0, 20.0, 50.0, 100.0]),
    st.sampled_from([0.0, 1.0, 5.0]),
    st.sampled_from([0.0, 5.0, 10.0]),
)
def test_no_smaller_plan_keeps_both_risks__law(lot, good, more, producer, consumer) -> None:
    rules = rules_of(good, max(good, more), producer, consumer)
    plan, (few, many) = smallest_plan(lot, rules), bad_sheets(lot, rules)

    def keeps(sample: int, accepted: int) -> bool:
        rejected = 1 - hypergeom.cdf(accepted, lot, few, sample)
        passed = hypergeom.cdf(accepted, lot, many, sample)
        return rejected <= producer / 100 + 1e-9 and passed <= consumer / 100 + 1e-9

    assert 0 <= few < many <= lot
    assert keeps(plan.sample, plan.accepted)
    smaller = [(n, c) for n in range(1, plan.sample) for c in range(min(n, few) + 1)]
    assert not any(keeps(n, c) for n, c in smaller)


@pytest.mark.parametrize(
    ("accepted", "times", "printed"),
    [
        (0, 10, 2.84),
        (1, 10, 4.78),
        (2, 10, 6.52),
        (3, 10, 8.16),
        (5, 10, 11.3),
        (2, 95, 1.03),
        (3, 95, 1.73),
        (5, 95, 3.32),
    ],
)
def test_large_lots_have_the_printed_qualities_of_code_letter_j__paper(
    accepted, times, printed
) -> None:
    """ISO 2859-1, table 10-J-1: per cent bad of a process that is accepted so often in 100."""
    lot = 200_000  # beside which 80 sheets are few, as beside a process
    plan = SamplingPlan(lot, 80, accepted)

    def more_often(bad: float) -> float:
        return 100 * plan.acceptance(round(bad)) - times

    quality = 100 * brentq(more_often, 0, lot / 4, xtol=2) / lot
    assert quality == pytest.approx(printed, rel=0.005)


@pytest.mark.parametrize(
    ("lot", "sample", "accepted", "quality"),
    [
        (16, 3, 0, 4.0),
        (50, 8, 0, 1.5),
        (90, 13, 1, 4.0),
        (150, 20, 2, 4.0),
        (280, 32, 3, 4.0),
        (500, 50, 5, 4.0),
        (1200, 80, 7, 4.0),
    ],
)
def test_a_plan_is_no_larger_than_one_of_the_standard_that_keeps_the_same_risks__paper(
    lot, sample, accepted, quality
) -> None:
    """ISO 2859-1, general level II, table 2-A: so many are drawn, so many may be bad."""
    printed = SamplingPlan(lot, sample, accepted)
    good, bad = bad_sheets(lot, rules_of(quality, 20.0, 5, 10))
    # The risks are those of the printed plan; ours may not draw more for them.
    risks = 100 * (1 - printed.acceptance(good)), 100 * printed.acceptance(bad)
    ours = smallest_plan(lot, rules_of(quality, 20.0, *risks))
    assert ours.sample <= sample
    assert ours.acceptance(good) >= printed.acceptance(good) - 1e-9
    assert ours.acceptance(bad) <= printed.acceptance(bad) + 1e-9
    # Lots at the standard's limit are mostly accepted: that is what its plans are for.
    assert binom.cdf(accepted, sample, quality / 100) > 0.88


@pytest.mark.parametrize(
    ("lot", "plan"),
    [(1, (1, 0)), (4, (4, 0)), (12, (6, 0)), (50, (22, 2)), (100, (24, 2)), (1200, (32, 3))],
)
def test_usual_limits_ask_for_a_sample_that_can_be_looked_at__truth(lot, plan) -> None:
    found = smallest_plan(lot, USUAL_RULES)
    assert (found.sample, found.accepted) == plan


def sheets(count: int) -> list[MapSheet]:
    return [MapSheet(f"S{number:03d}", AREA) for number in range(count)]


def test_the_same_seed_draws_the_same_sheets_in_whatever_order_they_come__law() -> None:
    lot, plan = sheets(40), SamplingPlan(40, 9, 1)
    drawn = draw_sheets(lot, plan, 7)
    assert drawn == draw_sheets(lot[::-1], plan, 7)
    assert drawn != draw_sheets(lot, plan, 8)
    assert [one.name for one in drawn] == sorted({one.name for one in drawn})
    assert len(drawn) == 9


def test_every_sheet_is_drawn_equally_often__law() -> None:
    lot, plan = sheets(10), SamplingPlan(10, 3, 0)
    counts = Counter(one.name for seed in range(2000) for one in draw_sheets(lot, plan, seed))
    # 600 each, with a standard deviation of 20.
    assert len(counts) == 10
    assert all(abs(count - 600) < 90 for count in counts.values())


def judged(faults=0, read=NONE, said=None) -> JudgedSheet:
    return JudgedSheet(DrawnSheet("A", AREA), faults, read, said, LIMIT_M)


def off(metres: float, count: int):
    return plan_figures(np.tile([[metres, -metres]], (count, 1)) / 2**0.5)


@pytest.mark.parametrize(
    ("one", "state"),
    [
        (judged(), "open"),
        (judged(said=True), "good"),
        (judged(said=False), "bad"),
        (judged(read=off(0.1, 4)), "good"),
        (judged(read=off(2.0, 4)), "bad"),
        (judged(read=off(0.7, 2)), "open"),
        (judged(read=off(0.7, 2), said=True), "good"),
        (judged(read=off(2.0, 4), said=True), "bad"),
        (judged(faults=1, said=True), "bad"),
        (judged(faults=1, read=off(0.1, 4)), "bad"),
        (judged(read=off(0.1, 4), said=False), "bad"),
    ],
)
def test_any_evidence_against_a_sheet_makes_it_bad__truth(one, state) -> None:
    assert one.state == state


@pytest.mark.parametrize(
    ("states", "told", "grave"),
    [
        ((True, True, None), "sheets-open", 1),
        ((True, True, False), "sheets-accepted", 0),
        ((None, False, False), "sheets-rejected", 2),
    ],
)
def test_a_lot_is_rejected_at_once_and_accepted_at_last__truth(states, told, grave) -> None:
    lot = JudgedLot(
        SamplingPlan(40, 3, 1), tuple(judged(said=one) for one in states), changed=False, replaced=0
    )
    (finding,) = lot_findings(lot, USUAL_RULES)
    assert (finding.kind, finding.grave) == (told, grave)
    assert str(finding.values["bad"]) in str(finding.sentence)
    (changed,) = lot_findings(replace(lot, changed=True), USUAL_RULES)
    assert (changed.kind, changed.grave) == ("sheets-changed", max(grave, 1))
    _, replaced = lot_findings(replace(lot, replaced=2), USUAL_RULES)
    assert (replaced.kind, replaced.values["count"]) == ("sheets-replaced", "2")
