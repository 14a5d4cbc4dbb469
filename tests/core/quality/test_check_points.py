"""Figures of check points: independent ones apart, the survey's own error in them."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.quality.check_points import independent_checks, kept_out
from core.quality.job_rules import USUAL_RULES
from tests.flights import FlightPlan, fly

PLAN = FlightPlan(ties=300, control=30, check=40, camera_errors=False)
PLAIN = AdjustmentOptions(estimate_cameras=False)
SURVEY_M = np.array([0.3, 0.4, 0.5])


def flown(seed, survey_m=SURVEY_M):
    """A flight whose check points a surveyor measured with an error of their own."""
    rng = np.random.default_rng(seed)
    block = fly(PLAN, rng).block
    surveyed = {
        name: replace(point, position=point.position + rng.normal(size=3) * survey_m,
                      sigma_m=survey_m) if point.role == "check" else point
        for name, point in block.surveyed.items()
    }  # fmt: skip
    return replace(block, surveyed=surveyed)


def test_differences_are_as_predicted_and_scatter_as_told__truth():
    """The ratio of twenty flights: about one, and inside its interval nearly always."""
    found = [independent_checks(adjust_block(flown(seed), PLAIN)) for seed in range(20)]
    assert 0.9 < np.sqrt(np.mean([one.ratio**2 for one in found])) < 1.1
    inside = [one.ratio_interval[0] <= one.ratio <= one.ratio_interval[1] for one in found]
    assert np.mean(inside) >= 0.8
    # They share what the block is off: fewer errors of their own than coordinates.
    assert all(10 < one.freedom < 2 * one.count for one in found)


def test_check_points_that_share_an_error_are_worth_fewer__truth():
    """Known exactly, they tell the block's own error, which neighbours have in common."""
    noisy, exact = (
        independent_checks(adjust_block(flown(3, sigma), PLAIN))
        for sigma in (SURVEY_M, np.full(3, 1e-3))
    )
    assert exact.freedom < 0.8 * noisy.freedom


def test_the_survey_s_error_is_in_the_product__paper():
    """ASPRS, edition 2: RMSE_H^2 = fit^2 + survey^2, RMSE_3D^2 = RMSE_H^2 + RMSE_V^2."""
    report = adjust_block(flown(1), PLAIN)
    found = independent_checks(report)
    off = np.array([check.difference_m for check in report.checks])
    fit = np.sqrt(np.mean(off[:, 0] ** 2) + np.mean(off[:, 1] ** 2))
    assert found.count == len(report.checks) >= USUAL_RULES.check_points
    assert found.plan_m == pytest.approx(np.sqrt(fit**2 + 0.3**2 + 0.4**2))
    high = off[[check.used_scans > 1 for check in report.checks], 2]
    assert found.height_m == pytest.approx(np.sqrt(np.mean(high**2) + 0.5**2))
    assert found.space_m == pytest.approx(np.hypot(found.plan_m, found.height_m))
    assert not independent_checks(replace(report, checks=report.checks[:29])).enough


def test_proposals_stand_apart__law():
    block = flown(2)
    names = [name for name, point in block.surveyed.items() if point.role == "check"]
    turned = {name: replace(block.surveyed[name], source="salient") for name in names[:15]}
    report = adjust_block(replace(block, surveyed={**block.surveyed, **turned}), PLAIN)
    own, apart = independent_checks(report), kept_out(report)
    assert own.count + apart.count == len(report.checks)
    assert apart.count == len([check for check in report.checks if check.point_id in turned])
    assert not apart.bear_out
