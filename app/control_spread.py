"""Is control enough, and where would more help most: as figures, and as lines of the protocol."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from core.adjustment.adjusted import AdjustmentReport
from core.adjustment.influence import Influence
from core.quality.control_count import ControlSpread, count_control
from core.quality.control_design import Want, wanted_control
from core.quality.rules import EDGE_BASES, PER_MODEL, STRIP_POINTS

PLACES = ("NW", "N", "NE", "W", "centre", "E", "SW", "S", "SE")
"""The nine places of a photo, as they lie on the film."""


def spread_figures(report: AdjustmentReport, influence: Influence | None) -> dict[str, Any]:
    """Control against the rules, and the places where one more point would help most.

    Args:
        report: The adjusted block.
        influence: Its equations; None where no photo took part.
    """
    count = count_control(report)
    scale = report.sigma_nought if np.isfinite(report.sigma_nought) else 1.0
    wants = () if influence is None else wanted_control(influence)
    rules = None if count is None else {
        "base_m": count.base_m,
        "models": count.models,
        "strip_points_least": STRIP_POINTS,
        "poorest_strip": {"scan": count.poorest_strip[0], "points": count.poorest_strip[1]},
        "plan": _spread(count.plan, 0),
        "heights": _spread(count.heights, 1),
        "check_share": count.check_share,
    }  # fmt: skip
    return {"rules": rules, "wanted": [_want(want, scale) for want in wants]}


def _spread(spread: ControlSpread, kind: int) -> dict[str, Any]:
    return {
        "points": spread.points,
        "edge_gap_bases": spread.gap.bases,
        "edge_gap_most": EDGE_BASES[kind],
        "edge_gap_at": spread.gap.middle.tolist(),
        "edge_gap_scan": spread.gap.photo_id,
        "per_model": spread.per_model,
        "per_model_least": PER_MODEL[kind],
    }


def _want(want: Want, scale: float) -> dict[str, Any]:
    return {
        "scan": want.photo_id,
        "place": PLACES[want.place],
        "at": want.position[:2].tolist(),
        "scans": list(want.photos),
        "sigma_now_m": scale * want.sigma_now_m,
        "sigma_then_m": scale * want.sigma_then_m,
        "worst_then_m": scale * want.worst_then_m,
    }


def spread_lines(figures: Mapping[str, Any]) -> list[str]:
    """The same as text."""
    rules, lines = figures["rules"], ["CONTROL: ENOUGH AND WELL SPREAD?"]
    if rules is None:
        lines.append("no two photos follow one another in a strip: the rules say nothing")
    else:
        poorest = rules["poorest_strip"]
        lines += [
            f"base {rules['base_m']:.0f} m, {rules['models']} stereo models; the poorest strip "
            f"({poorest['scan']}) shows {poorest['points']} points, "
            f"at least {rules['strip_points_least']}",
            *(_spread_line(name, rules[name]) for name in ("plan", "heights")),
        ]
    lines += [
        f"{number}. a point in {want['scan']}, {want['place']} (E {want['at'][0]:.0f}, "
        f"N {want['at'][1]:.0f}): {want['sigma_now_m']:.2f} m now, {want['sigma_then_m']:.2f} m "
        f"then; the worst of the block {want['worst_then_m']:.2f} m"
        for number, want in enumerate(figures["wanted"], 1)
    ]
    return [*lines, ""]


def _spread_line(name: str, spread: Mapping[str, Any]) -> str:
    return (
        f"{name:<8}{spread['points']:>5} points; along the edge at most "
        f"{spread['edge_gap_bases']:.1f} bases apart (rule {spread['edge_gap_most']:g}; widest by "
        f"{spread['edge_gap_scan']}); inside {spread['per_model']:.1f} a model "
        f"(rule {spread['per_model_least']:g})"
    )
