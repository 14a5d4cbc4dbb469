"""Statistics of independent differences, as METHODS 9.1 defines them; JSON-able."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.special import stdtrit

from core.adjustment.adjusted import AdjustmentReport, CheckResult
from core.arrays import ObjectPoints
from core.geometry.robust import robust_sigma
from core.mosaic.comparison import (
    OUTLIER_RULE,
    MosaicAccuracy,
)
from core.quality.check_points import CHECKS, STANDARD_LEAST, independent_checks, kept_out
from core.quality.readings import circular_error_90, rms_interval


def check_accuracy(report: AdjustmentReport) -> dict[str, Any]:
    """The user's check points one by one and together; `count` is 0 where there are none.

    Those that were proposals, or that nobody saw, stand apart under `kept_out`.
    """
    seen = report.block.independent_checks
    own = [check for check in report.checks if check.point_id in seen]
    proposals = [check for check in report.checks if check.point_id not in seen]
    rest = kept_out(report)
    apart = {
        "count": rest.count,
        "points": _points(report, proposals),
        "rmse_plan_m": rest.plan_m,
        "rmse_height_m": rest.height_m,
    }
    if not own:
        return {"count": 0, "points": [], "kept_out": apart}
    differences = np.array([check.difference_m for check in own], dtype=np.float64)
    intersected = np.array([check.used_scans > 1 for check in own])
    found = independent_checks(report)
    return {
        "count": len(own),
        "points": _points(report, own),
        "kept_out": apart,
        **plan_figures(differences),
        **_heights(differences[intersected, 2]),
        "survey_rms_horizontal": found.survey_m[0],
        "survey_rms_vertical": found.survey_m[1],
        "rmse_plan_m": found.plan_m,
        "rmse_height_m": found.height_m,
        "rmse_space_m": found.space_m,
        "predicted_m": found.predicted_m,
        "ratio": found.ratio,
        "ratio_interval": list(found.ratio_interval),
        "independent_errors": found.freedom,
        "enough": len(own) >= CHECKS,
        "asprs_least": STANDARD_LEAST,
        "asprs_enough": found.enough,
    }


def _points(report: AdjustmentReport, checks: Sequence[CheckResult]) -> list[dict[str, Any]]:
    return [
        {
            "point_id": check.point_id,
            "position": report.block.surveyed[check.point_id].position.tolist(),
            "difference_m": check.difference_m.tolist(),
            "used_scans": check.used_scans,
        }
        for check in checks
    ]


def plan_figures(differences: ObjectPoints) -> dict[str, Any]:
    """Plan figures of differences in metres (n, 3)."""
    plan, count = differences[:, :2], len(differences)
    m_x, m_y = np.sqrt(np.mean(plan**2, axis=0))
    mean, median = plan.mean(axis=0), np.median(plan, axis=0)
    deviation = plan.std(axis=0, ddof=1) if count > 1 else np.full(2, np.nan)
    m_p = float(np.hypot(m_x, m_y))
    lengths = np.linalg.norm(plan, axis=1)
    return {
        "m_x": float(m_x),
        "m_y": float(m_y),
        "m_p": m_p,
        "m_p_interval": list(rms_interval(m_p, 2 * count)),
        "mean_shift": mean.tolist(),
        "deviation": deviation.tolist(),
        "mean_significant": [_differs_from_nought(axis) for axis in plan.T],
        "median_shift": median.tolist(),
        "nmad": [robust_sigma(axis) for axis in (plan - median).T],
        "mean_length": float(lengths.mean()),
        "largest": float(lengths.max()),
        "circular_error_90": circular_error_90(m_p),
    }


def comparison_accuracy(name: str, accuracy: MosaicAccuracy) -> dict[str, Any]:
    """A mosaic against another ortho."""
    used = accuracy.places.used
    return {
        "name": name,
        "count": accuracy.n,
        "m_x": accuracy.m_x,
        "m_y": accuracy.m_y,
        "m_p": accuracy.m_p,
        "m_p_interval": list(accuracy.m_p_interval),
        "mean_shift": list(accuracy.mean_shift),
        "deviation": list(accuracy.deviation),
        "median_shift": list(accuracy.median_shift),
        "nmad": list(accuracy.nmad),
        "largest": accuracy.largest,
        "m_p_with_mismatches": accuracy.m_p_with_mismatches,
        "circular_error_90": accuracy.circular_error_90,
        "refused": dict(accuracy.refused),
        "ground_sample_distance_m": accuracy.ground_sample_distance_m,
        "rule": OUTLIER_RULE,
        "vectors": np.hstack([accuracy.places.positions, accuracy.places.shifts_m])[used].tolist(),
    }


def _heights(differences: np.ndarray) -> dict[str, Any]:
    """Height figures; only points seen in two photos have a height of their own."""
    if not len(differences):
        return {"heights": 0, "m_z": None, "mean_z": None, "linear_error_95": None}
    m_z = float(np.sqrt(np.mean(differences**2)))
    return {
        "heights": len(differences),
        "m_z": m_z,
        "mean_z": float(differences.mean()),
        "linear_error_95": 1.96 * m_z,
    }


def _differs_from_nought(values: np.ndarray) -> bool:
    """True when a t-test at 5 % says the mean is not nought."""
    count = len(values)
    if count < CHECKS or float(np.ptp(values)) == 0:
        return False
    t = abs(float(values.mean())) / (float(values.std(ddof=1)) / np.sqrt(count))
    return bool(t > stdtrit(count - 1, 0.975))
