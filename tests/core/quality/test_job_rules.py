"""Limits of a job: what they may be, and that the judgement goes by them."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.quality.assessment import assess_block
from core.quality.job_rules import (
    AUTHORITIES,
    IN_ORDER,
    LIMITS,
    USUAL_RULES,
    JobRules,
    out_of_order,
    set_by_job,
)
from core.quality.judged_rules import RULES, judge_rules
from core.quality.rules import check_release, judge_block, predicted_finding, release_limit_m
from tests.flights import FlightPlan, fly

PLAN = FlightPlan(ties=400, control=30, check=20, camera_errors=False)
STRICT = {
    "check_points": 100, "check_share_percent": 100.0, "sigma_nought_low": 1.19,
    "control_points": 500, "strip_points": 500, "edge_plan_bases": 0.1, "edge_heights_bases": 0.1,
    "inside_plan": 90.0, "inside_heights": 90.0, "rays_percent": 100.0,
    "along_percent": 99.0, "across_percent": 99.0, "tilt_deg": 0.01, "crab_deg": 0.01,
}  # fmt: skip
"""A value of each of these that the flight does not keep."""


@pytest.fixture(scope="module")
def report():
    options = AdjustmentOptions(estimate_cameras=False)
    return adjust_block(fly(PLAN, np.random.default_rng(4)).block, options)


def test_every_default_can_be_set_and_fits_the_others__law() -> None:
    assert JobRules() == USUAL_RULES
    for name, limit in LIMITS.items():
        assert limit.low <= getattr(USUAL_RULES, name) <= limit.high, name
        assert limit.source in AUTHORITIES
    assert out_of_order(USUAL_RULES) is None
    assert out_of_order(replace(USUAL_RULES, tilt_deg=5.0)) == ("tilt_deg", "tilt_most_deg")
    assert {name for pair in IN_ORDER for name in pair} <= set(LIMITS)


def test_every_limit_belongs_to_a_rule__law() -> None:
    assert {name for rule in RULES for name in rule.limits} == set(LIMITS)


@pytest.mark.parametrize("name", STRICT)
def test_a_stricter_limit_breaks_its_rule__truth(report, name: str) -> None:
    found = assess_block(report)
    rules = replace(USUAL_RULES, **{name: STRICT[name]})
    assert set_by_job(rules) == (name,)

    def judged(by: JobRules):
        return {one.rule.name: one for one in judge_rules(judge_block(found, report, rules=by), by)}

    (rule,) = (rule.name for rule in RULES if name in rule.limits)
    usual, own = judged(USUAL_RULES), judged(rules)
    assert own[rule].finding.grave > 0
    assert own[rule].finding.values != usual[rule].finding.values
    assert own[rule].by_job
    assert not usual[rule].by_job
    assert sum(one.by_job for one in own.values()) == 1


def test_the_position_that_a_job_asks_for_decides_the_release__truth(report) -> None:
    limit = release_limit_m(report.block)
    rules = replace(USUAL_RULES, position_m=0.02, position_px=0.0)
    assert limit >= 0.8
    assert release_limit_m(report.block, rules) == 0.02
    assert check_release(report, None, 0.0, rules=rules).limit_m == 0.02
    assert predicted_finding(0.1, 0.25, 0.02).kind == "predicted"
    assert predicted_finding(0.1, 0.25, limit).kind == "predicted-within"
    assert predicted_finding(0.1, 0.0, 0.02).kind == "predicted-alone"
    assert predicted_finding(0.1, 0.0, limit).kind == "predicted-alone-within"
