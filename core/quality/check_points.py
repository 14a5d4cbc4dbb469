"""What check points say of a block: those the user brought, apart from proposals kept out.

Check points of the user's list are independent of the reference once somebody has seen one of their
measurements: a hand placed it, or it was looked at when it was accepted. Proposals of the program
that an operator turned into check points are not: they were found on the reference, and were
control before. Figures follow the ASPRS Positional Accuracy Standards, edition 2 (2023): the error
of the survey itself enters the accuracy of the product.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from core.adjustment.adjusted import AdjustmentReport, CheckResult
from core.block import Block
from core.quality.job_rules import USUAL_RULES, JobRules

# source: a deviation about a mean needs three values to be one.
SPREAD_LEAST = 3
"""Fewer values than these have no spread to compare their mean with."""
# source: definition of a two-sided interval of 95 %.
TAILS = (0.975, 0.025)
"""Chances of being above the lower and the upper end of the interval."""


@dataclass(frozen=True, slots=True)
class CheckFigures:
    """Check points of one kind together; figures without points are NaN."""

    count: int
    """Number of points."""
    heights: int
    """Those seen in two photos and more: only they have a height of their own."""
    fit_m: tuple[float, float, float]
    """RMS of computed minus known X, Y, Z, metres."""
    survey_m: tuple[float, float]
    """RMS error of the survey in plan (both axes together) and in height, metres."""
    predicted_m: float
    """RMS of what the adjustment and the survey predict of the differences in plan, metres."""
    freedom: float
    """So many independent errors the differences in plan are worth."""
    least: int
    """So many points a statement needs."""

    @property
    def fit_plan_m(self) -> float:
        """RMSE of the fit in plan, metres."""
        return float(np.hypot(*self.fit_m[:2]))

    @property
    def plan_m(self) -> float:
        """RMSE_H of the product: fit and survey, metres."""
        return float(np.hypot(self.fit_plan_m, self.survey_m[0]))

    @property
    def height_m(self) -> float:
        """RMSE_V of the product: fit and survey, metres."""
        return float(np.hypot(self.fit_m[2], self.survey_m[1]))

    @property
    def space_m(self) -> float:
        """RMSE_3D of the product, metres."""
        return float(np.hypot(self.plan_m, self.height_m))

    @property
    def enough(self) -> bool:
        """Whether they allow a statement."""
        return self.count >= self.least

    @property
    def ratio(self) -> float:
        """Observed over predicted RMS of the differences in plan."""
        return self.fit_plan_m / self.predicted_m if self.predicted_m > 0 else float("nan")

    @property
    def ratio_interval(self) -> tuple[float, float]:
        """Between these the ratio lies by chance in 95 of 100 blocks as good as predicted."""
        if not self.freedom:
            return float("nan"), float("nan")
        low, high = np.sqrt(chdtri(self.freedom, TAILS) / self.freedom)
        return float(low), float(high)

    @property
    def least_fit_m(self) -> float:
        """The differences in plan are at least so large in the long run (97.5 %), metres."""
        return self.fit_plan_m / self.ratio_interval[1]

    @property
    def bear_out(self) -> bool:
        """Whether the points bear the prediction out: enough of them, the ratio within chance."""
        low, high = self.ratio_interval
        return self.enough and low <= self.ratio <= high

    def judged(self, limit_m: float) -> tuple[str, dict[str, str]]:
        """The kind of finding that independent check points come to, and what it tells.

        Args:
            limit_m: Position error on the ground up to which the block is released, metres.
        """
        told = {"count": str(self.count), "least": str(self.least)}
        if not self.count:
            return "no-checks", told
        told["value"] = f"{self.plan_m:.2f}"
        low, high = self.ratio_interval
        told |= {"ratio": f"{self.ratio:.2f}", "low": f"{low:.2f}", "high": f"{high:.2f}"}
        if self.least_fit_m > limit_m:
            return "checks-over", {**told, "limit": f"{limit_m:.2f}"}
        if self.ratio > high:
            return "checks-worse", told
        # Few cannot bear a block out, though they may show it wrong: the interval knows how few.
        if not self.enough:
            return "one-check" if self.count == 1 else "checks-few", told
        return "checks-better" if self.ratio < low else "checks", told


def independent_checks(report: AdjustmentReport, rules: JobRules = USUAL_RULES) -> CheckFigures:
    """Figures of the check points that the user brought and somebody saw.

    Args:
        report: The adjustment.
        rules: Limits of the job.
    """
    own = report.block.independent_checks
    chosen = [check for check in report.checks if check.point_id in own]
    return _figures(report.block, chosen, report.check_freedom, rules.check_points)


def kept_out(report: AdjustmentReport) -> CheckFigures:
    """Figures of all other check points: proposals, turned over or seen by nobody.

    Args:
        report: The adjustment.
    """
    own = report.block.independent_checks
    chosen = [check for check in report.checks if check.point_id not in own]
    return _figures(report.block, chosen, 0.0, USUAL_RULES.check_points)


def _figures(
    block: Block, checks: Sequence[CheckResult], freedom: float, least: int
) -> CheckFigures:
    """Figures of some check points; with no `freedom` each coordinate is an error by itself."""
    own = [check for check in checks if check.used_scans > 1]
    off = np.array([check.difference_m for check in checks]).reshape(-1, 3)
    high = np.array([check.difference_m[2] for check in own])
    sigma = np.array([block.surveyed[check.point_id].sigma_m for check in checks]).reshape(-1, 3)
    survey_high = np.array([block.surveyed[check.point_id].sigma_m[2] for check in own])
    told = np.array([check.sigma_m for check in checks if check.sigma_m is not None]).reshape(-1, 3)
    # Both axes together: the mean square of their lengths.
    survey = _rms(np.linalg.norm(sigma[:, :2], axis=1))
    predicted = _rms(np.linalg.norm(told[:, :2], axis=1))
    return CheckFigures(
        len(checks),
        len(own),
        (_rms(off[:, 0]), _rms(off[:, 1]), _rms(high)),
        (survey, _rms(survey_high)),
        float(np.hypot(predicted, survey)),
        freedom or 2.0 * len(checks),
        least,
    )


def _rms(values: np.ndarray) -> float:
    """Root mean square, NaN of nothing."""
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")
