"""The verdict on a block: what is sound, what is doubtful, what is not good enough, and why."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from core.arrays import Scalars
from core.block.adjusted import AdjustmentReport
from core.block.control_rules import ControlCount, ControlLimits
from core.block.quality import BlockQuality, Overlap, QualityLimits


@dataclass(frozen=True, slots=True)
class Finding:
    """One sentence of the verdict."""

    text: str
    """Key of the sentence."""
    grave: int
    """0 sound, 1 doubtful, 2 not good enough."""
    values: Mapping[str, str] = field(default_factory=dict[str, str])
    """What stands in its places."""


def judge_block(
    found: BlockQuality, report: AdjustmentReport, limits: QualityLimits | None = None
) -> tuple[Finding, ...]:
    """Every finding about an adjusted block, gravest first; the gravest is the verdict.

    Args:
        found: What was measured of the block.
        report: The adjustment.
        limits: What it is held against.
    """
    held = limits or QualityLimits()
    findings = [
        *_adjustment_findings(report, held),
        *_control_findings(found, report, held),
        *_tie_findings(found, held),
        *_flight_findings(found, held),
    ]
    return tuple(sorted(findings, key=lambda finding: -finding.grave))


def _adjustment_findings(report: AdjustmentReport, limits: QualityLimits) -> list[Finding]:
    if not report.converged:
        return [Finding("verdict.diverged", 2)]
    low, high = limits.sigma_nought
    told = {"value": f"{report.sigma_nought:.2f}", "low": f"{low:g}", "high": f"{high:g}"}
    sound = low <= report.sigma_nought <= high
    return [Finding("verdict.sigma" if sound else "verdict.sigma-off", 0 if sound else 1, told)]


def _control_findings(
    found: BlockQuality, report: AdjustmentReport, limits: QualityLimits
) -> list[Finding]:
    count, filled = len(report.surveyed_positions), int(np.count_nonzero(found.control_cells))
    told = {"count": str(count), "cells": str(filled), "least": str(limits.control.block_points)}
    if count < limits.control.block_points:
        return [Finding("verdict.control-few", 2, told)]
    sound = filled >= limits.control_cells
    findings = [Finding("verdict.control" if sound else "verdict.control-gaps", 1 - sound, told)]
    if found.control is not None:
        findings += _rule_findings(found.control, limits.control)
    weak = sum(number < 0.1 for number in report.redundancy_numbers.values())
    if weak:
        findings.append(Finding("verdict.unchecked", 1, {"count": str(weak)}))
    if not report.checks:
        findings.append(Finding("verdict.no-checks", 1))
    return findings


def _rule_findings(control: ControlCount, limits: ControlLimits) -> list[Finding]:
    """What the rules of aerial triangulation find missing; how far control is apart if nothing."""
    findings: list[Finding] = []
    name, shown = control.poorest_strip
    if shown < limits.strip_points:
        told = {"worst": name, "count": str(shown), "least": str(limits.strip_points)}
        findings.append(Finding("verdict.strip-few", 1, told))
    for kind, spread, most, least in (
        ("plan", control.plan, limits.edge_bases[0], limits.per_model[0]),
        ("heights", control.heights, limits.edge_bases[1], limits.per_model[1]),
    ):
        told = {
            "bases": f"{spread.gap.bases:.1f}",
            "most": f"{most:g}",
            "worst": spread.gap.photo_id,
            "east": f"{spread.gap.middle[0]:.0f}",
            "north": f"{spread.gap.middle[1]:.0f}",
        }
        # Judged as it is told: "2.0 (2 at most)" would puzzle.
        wide = round(spread.gap.bases, 1) > most
        findings.append(
            Finding(f"verdict.edge-gap-{kind}" if wide else f"verdict.edge-{kind}", int(wide), told)
        )
        if spread.per_model < least:
            told = {"value": f"{spread.per_model:.1f}", "least": f"{least:g}"}
            findings.append(Finding(f"verdict.inside-few-{kind}", 1, told))
    return findings


def _tie_findings(found: BlockQuality, limits: QualityLimits) -> list[Finding]:
    total = sum(found.rays.values())
    if not total:
        return [Finding("verdict.no-ties", 2 if len(found.photos) > 1 else 0)]
    many = sum(count for rays, count in found.rays.items() if rays >= 3) / total
    told = {"share": f"{100 * many:.0f}"}
    sound = many >= limits.rays
    findings = [Finding("verdict.rays" if sound else "verdict.rays-few", 1 - sound, told)]
    bare = [
        photo.photo_id
        for photo in found.photos
        if photo.oriented and sum(count > 0 for count in photo.cells) < limits.tie_cells
    ]
    if bare:
        findings.append(Finding("verdict.bare", 1, {"count": str(len(bare)), "worst": bare[0]}))
    lengths: Scalars = np.linalg.norm(found.pattern_px[found.pattern_counts >= 20], axis=1)
    worst = float(lengths.max()) if len(lengths) else 0.0
    systematic = worst > limits.pattern_px
    text = "verdict.systematic" if systematic else "verdict.no-pattern"
    findings.append(Finding(text, int(systematic), {"value": f"{worst:.2f}"}))
    return findings


def _flight_findings(found: BlockQuality, limits: QualityLimits) -> list[Finding]:
    findings: list[Finding] = []
    loose = [photo.photo_id for photo in found.photos if not photo.oriented]
    if loose:
        findings.append(Finding("verdict.loose", 2, {"count": str(len(loose)), "worst": loose[0]}))
    for text, values, (rule, most) in (
        ("tilt", {p.photo_id: p.tilt_deg for p in found.photos if p.oriented}, limits.tilt_deg),
        ("crab", {p.photo_id: p.crab_deg for p in found.photos if p.oriented}, limits.crab_deg),
    ):
        known = {name: value for name, value in values.items() if np.isfinite(value)}
        if not known:
            continue
        worst = max(known, key=lambda name: known[name])
        over = sum(value > rule for value in known.values())
        told = {"value": f"{known[worst]:.1f}", "worst": worst, "limit": f"{rule:g}",
                "over": str(over)}  # fmt: skip
        grave = 0 if not over else 1 if known[worst] <= most else 2
        findings.append(
            Finding(f"verdict.{text}" if not grave else f"verdict.{text}-over", grave, told)
        )
    for text, along, (least, _) in (
        ("along", True, limits.along),
        ("across", False, limits.across),
    ):
        shares = _nearest_shares(found.overlaps, along)
        if shares:
            small = sum(share < least for share in shares)
            told = {
                "low": f"{100 * min(shares):.0f}",
                "high": f"{100 * max(shares):.0f}",
                "least": f"{100 * least:.0f}",
                "small": str(small),
            }
            key = f"verdict.{text}" if not small else f"verdict.{text}-small"
            findings.append(Finding(key, int(small > 0), told))
    return findings


def _nearest_shares(overlaps: tuple[Overlap, ...], along: bool) -> list[float]:
    """Of each photo the share it has with its nearest neighbour in a direction."""
    best: dict[str, float] = {}
    for pair in overlaps:
        if pair.along is along:
            for name in (pair.first, pair.second):
                best[name] = max(best.get(name, 0.0), pair.share)
    return list(best.values())
