"""The view of a block's quality, as values a page can draw and print."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import shapely

from core.quality.assessment import BlockQuality
from core.quality.job_rules import USUAL_RULES, JobRules
from ui.review.checking import figures_told
from ui.review.history import AdjustmentRecord, record_line, shifts_m
from ui.review.judgement import BlockJudgement
from ui.review.picture import Part, checks_told, position_error_m
from ui.review.rule_rows import rules_part
from ui.review.state import DeskState

TIES_DRAWN = 2500
"""Tie points on the maps: enough to see where they are weak."""
PAIRS_TOLD = 80


def quality_part(
    judged: BlockJudgement,
    state: DeskState,
    adjustments: tuple[AdjustmentRecord, ...],
    pair: tuple[int, int] | None = None,
    *,
    rules: JobRules = USUAL_RULES,
) -> dict[str, Any]:
    """Everything the view shows, but for the signatures."""
    report, found, findings = state.report, judged.measured, judged.findings
    return {
        "verdict": findings[0].grave,
        "findings": [[f"verdict.{f.kind}", f.grave, dict(f.values)] for f in findings],
        "rules": rules_part(judged.rules),
        "turned": [rules.tilt_deg, rules.crab_deg],
        "read": None if judged.read is None else figures_told(judged.read),
        "sigma": _number(report.sigma_nought, 3),
        "mp": _number(position_error_m(report), 3),
        "checks": checks_told(report, rules),
        "free": list(state.free),
        "photos": _photos(found),
        "overlaps": _overlaps(found),
        "rays": [[number, count] for number, count in sorted(found.rays.items())],
        "pattern": [
            [[_number(value, 2) for value in cell] for cell in line] for line in found.pattern_um
        ],
        "pattern_counts": found.pattern_counts.tolist(),
        "control_cells": found.control_cells.tolist(),
        "map": _map(state, judged.polygons),
        "milestones": [record_line(one) for one in adjustments],
        "compared": _compared(adjustments, pair),
    }


def _photos(found: BlockQuality) -> list[dict[str, Any]]:
    return [
        {
            "photo": one.photo_id, "oriented": one.oriented,
            "tilt": _number(one.tilt_deg, 2), "crab": _number(one.crab_deg, 2),
            "rms": _number(one.rms_px, 2), "control": one.control, "ties": one.ties,
            "sigma": _number(one.sigma_m, 2), "cells": list(one.cells),
        }
        for one in found.photos
    ]  # fmt: skip


def _overlaps(found: BlockQuality) -> list[list[Any]]:
    pairs = sorted(found.overlaps, key=lambda pair: (pair.ties > 0, -pair.share))
    return [
        [p.first, p.second, _number(100 * p.share, 0), p.ties, p.along] for p in pairs[:PAIRS_TOLD]
    ]


def _map(state: DeskState, polygons: Mapping[str, shapely.Polygon]) -> dict[str, Any]:
    """Places in metres from the block's origin: outlines, control, checks, ties with sigma.

    Origin, and the bounds whose nine parts control is counted in, are of the block's CRS. A control
    point also tells its name, and the photo of the measurement to go to.
    """
    report, origin = state.report, state.block.origin[:2]
    surveyed = state.block.surveyed
    used = [key for key, item in report.block.measurements.items() if item.used]
    photo_of = dict(reversed(used))
    control = [
        [
            *_place(surveyed[name].position, origin),
            *_place(adjusted, surveyed[name].position, 2),
            name,
            photo_of.get(name),
        ]
        for name, adjusted in report.surveyed_positions.items()
        if name in surveyed
    ]
    checks = [
        [*_place(check.position, origin), *(_number(v, 2) for v in check.difference_m[:2])]
        for check in report.checks
    ]
    sound = np.flatnonzero(np.isfinite(report.tie_positions).all(axis=1))
    drawn = sound[:: max(1, -(-len(sound) // TIES_DRAWN))]
    sigmas = np.linalg.norm(report.tie_sigmas_m[drawn, :2], axis=1) if len(drawn) else []
    every = shapely.union_all(list(polygons.values())).bounds if polygons else (0.0,) * 4
    return {
        "origin": [float(value) for value in origin],
        "bounds": [_number(value, 1) for value in every],
        "outlines": {
            name: [[round(x - origin[0]), round(y - origin[1])] for x, y in polygon.exterior.coords]
            for name, polygon in polygons.items()
        },
        "control": control,
        "checks": checks,
        "ties": [
            [*_place(report.tie_positions[number], origin), _number(sigma, 2)]
            for number, sigma in zip(drawn, sigmas, strict=True)
        ],
    }


def _compared(adjustments: tuple[AdjustmentRecord, ...], pair: tuple[int, int] | None) -> Part:
    """Two adjustments side by side: how far each photo moved between them, furthest first."""
    by_number = {one.number: one for one in adjustments}
    if not by_number:
        return None
    numbers = (
        pair if pair and all(n in by_number for n in pair) else (min(by_number), max(by_number))
    )
    one, other = (by_number[number] for number in numbers)
    shifts = sorted(shifts_m(one, other).items(), key=lambda item: -item[1])
    return {"pair": list(numbers), "shifts": [[name, _number(value, 3)] for name, value in shifts]}


def _place(position: Any, origin: Any, digits: int = 0) -> list[float | None]:
    return [_number(float(position[i]) - float(origin[i]), digits) for i in (0, 1)]


def _number(value: float | None, digits: int) -> float | None:
    if value is None or not np.isfinite(value):
        return None
    return round(float(value), digits)
