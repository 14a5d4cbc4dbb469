"""Distribution of the residuals, and their mean over parts of each film."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from core.adjustment.adjusted import AdjustmentReport
from core.arrays import Scalars
from core.quality.residuals import film_patterns, residual_trends

FEW = 3
"""A mean of fewer residuals is not drawn."""
BINS = 24
"""Bars of a histogram, over four times the RMS to either side."""
REACH = 4.0
"""Residuals beyond so many times the RMS are counted in the outermost bars."""


def residual_figures(report: AdjustmentReport) -> dict[str, Any]:
    """Histograms by class, trends, and the mean residuals of each photo by parts of its film."""
    ties = report.tie_residuals_px
    used = [report.residuals_px[key] for key in report.redundancy_numbers]
    classes = {
        "tie": ties[np.isfinite(ties).all(axis=1)].ravel(),
        "control": np.array(used, dtype=np.float64).ravel(),
    }
    return {
        "histograms": {name: _histogram(values) for name, values in classes.items() if len(values)},
        "trends": {
            name: {
                "along": trend.along.tolist(),
                "mean_px": trend.mean_px.tolist(),
                "sigma_px": trend.sigma_px.tolist(),
                "count": trend.count,
            }
            for name, trend in residual_trends(report).items()
        },
        "films": _films(report),
    }


def parameter_figures(report: AdjustmentReport) -> list[dict[str, Any]]:
    """What cameras and positions turned out to be, and what each is mixed up with."""
    fields = ("owner", "name", "value", "sigma", "test", "correlation", "partner", "held")
    return [{name: getattr(one, name) for name in fields} for one in report.parameters]


def _histogram(values: Scalars) -> dict[str, Any]:
    """Counts of coordinates in bars of equal width about nought, pixels."""
    rms = float(np.sqrt(np.mean(values**2)))
    reach = REACH * rms or 1.0
    edges = np.linspace(-reach, reach, BINS + 1)
    counts, _ = np.histogram(np.clip(values, -reach, reach), edges)
    return {"count": len(values), "rms_px": rms, "reach_px": reach, "counts": counts.tolist()}


def _films(report: AdjustmentReport) -> Mapping[str, Any]:
    """By photo: mean residual (column, row) of each cell, pixels; null where few make it."""
    found: dict[str, Any] = {}
    for name, (mean, counts) in film_patterns(report).items():
        told = np.where(counts[..., None] >= FEW, mean, np.nan)
        found[name] = {"mean_px": told.tolist(), "counts": counts.tolist()}
    return found
