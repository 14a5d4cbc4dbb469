"""Statistics of differences, residuals and pointing, as METHODS 9.1 defines them; JSON-able."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from itertools import permutations
from typing import Any

import numpy as np
from scipy.special import stdtrit

from core.adjustment.adjusted import AdjustmentReport, CheckResult
from core.arrays import ObjectPoints, Scalars
from core.block import Measurement, Reading
from core.geometry.robust import nmad
from core.mosaic.comparison import (
    MosaicAccuracy,
)
from core.quality.check_points import (
    SPREAD_LEAST,
    independent_checks,
    kept_out,
)
from core.quality.control_count import ray_counts_of
from core.quality.job_rules import USUAL_RULES, JobRules
from core.quality.readings import circular_error_90, rms_interval
from core.quality.residuals import film_patterns, residual_trends
from sessions.readings import SAME_PLACE_PX

FEW = 3
"""A mean of fewer residuals is not drawn."""
BINS = 24
"""Bars of a histogram, over four times the RMS to either side."""
REACH = 4.0
"""What lies beyond so many times the RMS stands in no bar: it is counted apart."""


def check_accuracy(report: AdjustmentReport, rules: JobRules = USUAL_RULES) -> dict[str, Any]:
    """The user's check points one by one and together; `count` is 0 where there are none.

    Those that were proposals, or that nobody saw, stand apart under `kept_out`; `least` is how many
    a statement needs.
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
        return {"count": 0, "points": [], "kept_out": apart, "least": rules.check_points}
    differences = np.array([check.difference_m for check in own], dtype=np.float64)
    intersected = np.array([check.used_scans > 1 for check in own])
    found = independent_checks(report, rules)
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
        "least": found.least,
        "enough": found.enough,
        "asprs_least": USUAL_RULES.check_points,
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
        "nmad": [nmad(axis) for axis in plan.T],
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
        "truth_sigma_m": accuracy.truth_sigma_m,
        "rule": accuracy.rule,
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
    if count < SPREAD_LEAST or float(np.ptp(values)) == 0:
        return False
    t = abs(float(values.mean())) / (float(values.std(ddof=1)) / np.sqrt(count))
    return bool(t > stdtrit(count - 1, 0.975))


def residual_figures(report: AdjustmentReport) -> dict[str, Any]:
    """Histograms by class, trends, and the mean residuals of each photo by parts of its film."""
    ties = report.tie_residuals_px
    used = [report.residuals_px[key] for key in report.redundancy_numbers]
    classes = {
        "tie": ties[np.isfinite(ties).all(axis=1)].ravel(),
        "control": np.array(used, dtype=np.float64).ravel(),
    }
    return {
        "histograms": {name: histogram(values) for name, values in classes.items() if len(values)},
        "trends": {
            name: {
                "along": trend.along.tolist(),
                "mean_px": trend.mean_px.tolist(),
                "sigma_px": trend.sigma_px.tolist(),
                "count": trend.count,
            }
            for name, trend in residual_trends(report).items()
        },
        "strips": _strips(report),
        "films": _films(report),
    }


def parameter_figures(report: AdjustmentReport) -> list[dict[str, Any]]:
    """What cameras and positions turned out to be, and what each is mixed up with."""
    fields = ("owner", "name", "value", "sigma", "test", "correlation", "partner", "held")
    return [{name: getattr(one, name) for name in fields} for one in report.parameters]


def histogram(values: Scalars, unit: str = "px") -> dict[str, Any]:
    """Counts of coordinates in bars of equal width about nought; RMS and reach in their unit."""
    rms = float(np.sqrt(np.mean(values**2)))
    reach = REACH * rms or 1.0
    edges = np.linspace(-reach, reach, BINS + 1)
    counts, _ = np.histogram(values, edges)
    told: dict[str, Any] = {f"rms_{unit}": rms, f"reach_{unit}": reach, "counts": counts.tolist()}
    told |= {"beyond": len(values) - int(counts.sum()), "largest": float(np.abs(values).max())}
    return {"count": len(values), **told}


def _strips(report: AdjustmentReport) -> list[dict[str, Any]]:
    """By strip: its photos, and RMS of the residuals (column, row) of ties and control, pixels."""
    counts = ray_counts_of(report)
    ties = report.block.ties
    used = np.isfinite(report.tie_residuals_px).all(axis=1)
    of_ray = np.array([counts.strip.get(name, -1) for name in ties.photo_ids])[ties.photo]
    found: list[dict[str, Any]] = []
    for strip in sorted(set(counts.strip.values())):
        scans = sorted(name for name, number in counts.strip.items() if number == strip)
        control = [report.residuals_px[key] for key in report.redundancy_numbers if key[1] in scans]
        rays = report.tie_residuals_px[used & (of_ray == strip)]
        found.append(
            {
                "strip": strip + 1,
                "scans": scans,
                "tie_rays": len(rays),
                "tie_rms_px": rms_columns(rays),
                "control": len(control),
                "control_rms_px": rms_columns(np.array(control).reshape(-1, 2)),
            }
        )
    return found


def rms_columns(values: np.ndarray) -> list[float | None]:
    """Root mean square of each column, leaving out what is no number."""
    good = np.isfinite(values)
    sums = np.where(good, values, 0.0) ** 2
    return [
        float(np.sqrt(total / count)) if count else None
        for total, count in zip(sums.sum(axis=0), good.sum(axis=0), strict=True)
    ]


def _films(report: AdjustmentReport) -> Mapping[str, Any]:
    """By photo: mean residual (x right, y up) of each cell, um; null where few make it."""
    found: dict[str, Any] = {}
    for name, (mean, counts) in film_patterns(report).items():
        told = np.where(counts[..., None] >= FEW, mean, np.nan)
        found[name] = {"mean_um": told.tolist(), "counts": counts.tolist()}
    return found


def pointing_figures(measurements: Iterable[Measurement]) -> list[dict[str, Any]]:
    """One row for each operator who measured what somebody else measured too.

    Args:
        measurements: Of the block with its decisions.

    Returns:
        `who`; `count` of differences to others; `sigma_px`, the standard deviation per axis of one
        reading (both being alike, the RMS difference over the root of two); the mean difference,
        own minus others', `column_px` and `row_px`; and `other_detail`, how many lay too far apart
        to be of the same detail, which count in none of these.
    """
    differences: dict[str, list[tuple[float, float]]] = defaultdict(list)
    apart: dict[str, int] = defaultdict(int)
    for item in measurements:
        for own, other in permutations(item.readings, 2):
            off = _difference(own, other)
            if np.hypot(*off) <= SAME_PLACE_PX:
                differences[own.operator].append(off)
            else:
                apart[own.operator] += 1
    return [
        _row(who, np.array(differences[who]).reshape(-1, 2), apart[who])
        for who in sorted({*differences, *apart})
    ]


def _difference(own: Reading, other: Reading) -> tuple[float, float]:
    return own.column - other.column, own.row - other.row


def _row(who: str, off: np.ndarray, apart: int) -> dict[str, Any]:
    some = len(off) > 0
    return {
        "who": who,
        "count": len(off),
        "sigma_px": float(np.sqrt(np.mean(off**2) / 2)) if some else float("nan"),
        "column_px": float(off[:, 0].mean()) if some else float("nan"),
        "row_px": float(off[:, 1].mean()) if some else float("nan"),
        "other_detail": apart,
    }
