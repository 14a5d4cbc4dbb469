"""The judgement of a block: findings and the verdict; its limits are those of `JobRules`.

The desk's verdict, the report's release check and the protocol's doubts all use these findings.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import chdtri

from core.adjustment.adjusted import AdjustmentReport, Contradiction
from core.adjustment.contradictions import by_point
from core.adjustment.influence import Influence
from core.adjustment.significance import CONSTANT_NAMES
from core.arrays import Scalars
from core.block import Block
from core.doubts import Doubt
from core.quality.assessment import BlockQuality, Overlap, PhotoQuality, assess_block
from core.quality.check_points import CheckFigures, independent_checks, kept_out
from core.quality.control_count import ControlCount
from core.quality.controllability import unchecked_control
from core.quality.job_rules import USUAL_RULES, JobRules
from core.quality.sentences import CLASSES, SENTENCES
from core.raster.holes import Hole
from core.said import Said, say

LARGER = 1.25  # design: less is within what a class of few observations scatters.
"""Residuals of a class this many times as large as stated are told."""
DATUM = (2, 3)  # source: a body has seven degrees of freedom: two points in plan, three heights.
LINE = 0.05  # design: heights within a twentieth of their length, or of a photo, turn freely.
"""Extent across of all height control, as a share of that along or of a photo's side."""
SYSTEMATIC = 5.0  # design: chance brings it about in one of 24,000 films of 36 cells.
"""Mean residual of a cell of the film, in its standard deviations, that is systematic."""
# measured: tests/camera_types.py; cameras of one type differ by up to 0.9 % (1.36 of 153 mm). What
# is known worse is known no better than the name of the lens tells it.
DISTANCE_SHARE = 0.01
"""A principal distance known worse than this share of it is not known."""

# design: as many as can be read at a glance; the queue and the tables have them all.
NAMED = 10
"""Accepted measurements against the block that are named one by one."""

# design: names.
SOUND, DOUBTFUL, POOR = 0, 1, 2
GRAVITY = (0.0, 0.5, 0.9)  # design: a doubt is open to the operator; a poor block is to be mended.
"""Gravity of a doubt by how grave the finding is."""
MANY_AGAINST = "contradicted-more"
"""Accepted measurements against the block that are counted, not named."""
HOLDING_BACK = (
    "diverged", "sigma-none", "sigma-far", "loose", "control-few", "contradicted-far",
    "checks-over", "read-over", "read-over-before",
)  # fmt: skip
"""Findings with which no prediction can be believed: the block is not released."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One sentence of the judgement."""

    kind: str
    """Key of its sentence."""
    grave: int
    """0 sound, 1 doubtful, 2 not good enough."""
    values: Mapping[str, str] = field(default_factory=dict[str, str])
    """What stands in its places."""

    @property
    def stands_for(self) -> int:
        """So many findings it is."""
        return int(self.values["count"]) if self.kind.startswith("contradicted") else 1

    @property
    def sentence(self) -> Said:
        """What it says."""
        return Said(SENTENCES[self.kind], self.values)


def judge_block(
    found: BlockQuality,
    report: AdjustmentReport,
    holes: Sequence[Hole] | None = None,
    rules: JobRules = USUAL_RULES,
) -> tuple[Finding, ...]:
    """Every finding about an adjusted block, gravest first; the gravest is the verdict.

    Args:
        found: What was measured of the block.
        report: The adjustment.
        holes: Holes inside its mosaic, largest first; None where there is no mosaic yet.
        rules: Limits of the job.
    """
    findings = [
        *human_findings(report, rules),
        *_adjustment_findings(report, rules),
        *_control_findings(found, report, rules),
        *_tie_findings(found, rules),
        *_distance_findings(report),
        *_flight_findings(found, rules),
        *_hole_findings(holes),
    ]
    return tuple(sorted(findings, key=lambda finding: -finding.grave))


def doubts_of(
    report: AdjustmentReport,
    findings: Sequence[Finding] | None = None,
    rules: JobRules = USUAL_RULES,
) -> tuple[Doubt, ...]:
    """What the adjustment left out, and every finding that is not sound, as doubts.

    Args:
        report: The adjustment.
        findings: What `judge_block` said of it; asked again when left out.
        rules: Limits of the job.
    """
    if findings is None:
        findings = judge_block(assess_block(report), report, rules=rules)
    return *report.doubts, *(_doubt(finding) for finding in findings if finding.grave)


def human_doubts(report: AdjustmentReport, rules: JobRules = USUAL_RULES) -> tuple[Doubt, ...]:
    """Every accepted measurement that the block contradicts, as the queue's filter shows them.

    Args:
        report: The adjustment.
        rules: Limits of the job.
    """
    limit = release_limit_m(report.block, rules)
    told = by_point(report.contradictions)
    return tuple(_doubt(_against(ones, report.block, limit)) for ones in told)


def _doubt(finding: Finding) -> Doubt:
    told, subject = dict(finding.values), finding.values.get("worst", "block")
    return Doubt(finding.kind, subject, finding.sentence, GRAVITY[finding.grave], told)


@dataclass(frozen=True, slots=True)
class Release:
    """What is predicted of the block's ground, and why it is not released, if it is not."""

    relative_m: float
    """Standard deviation of position against the reference, RMS over nine places of all photos,
    metres; NaN where nothing was adjusted."""
    predicted_m: float
    """The same on the ground: that of the reference included, metres."""
    worst_m: float
    """The largest of all places on the ground, metres."""
    worst_photo: str
    """The photo that shows it; empty without one."""
    limit_m: float
    """What is predicted on the ground may not be larger than this, metres."""
    reasons: tuple[Finding, ...]
    """Why the block is not released; none: it is."""
    checks: CheckFigures
    """The independent check points."""

    def with_findings(self, findings: Sequence[Finding]) -> "Release":
        """The same with what holds it back among further findings."""
        more = [finding for finding in findings if finding.kind in HOLDING_BACK]
        return replace(self, reasons=(*self.reasons, *more))

    @property
    def certified(self) -> bool:
        """Whether the block is released, and independent check points bear the prediction out."""
        return not self.reasons and self.checks.bear_out


def check_release(
    report: AdjustmentReport,
    influence: Influence | None,
    ortho_sigma_m: float,
    findings: Sequence[Finding] | None = None,
    *,
    rules: JobRules = USUAL_RULES,
) -> Release:
    """Whether a block may be given out: what is predicted is good, and can be believed.

    An error that all control shares no figure of the block can show: check points can.

    Args:
        report: The adjustment.
        influence: Its equations; None where no photo took part.
        ortho_sigma_m: Standard deviation of the reference per axis, metres.
        findings: As in `doubts_of`.
        rules: Limits of the job.
    """
    if findings is None:
        findings = judge_block(assess_block(report), report, rules=rules)
    places = _ground_variances(report, influence)
    relative = _relative_m(places)
    worst = max(places, key=lambda name: float(places[name].max()), default="")
    own_m = report.block.reference_error_m(ortho_sigma_m)
    reference = np.sqrt(2) * own_m  # alike in both axes
    worst_m = float(np.hypot(np.sqrt(places[worst].max()), reference)) if worst else float("nan")
    limit = release_limit_m(report.block, rules)
    predicted = float(np.hypot(relative, reference))
    reasons = [finding for finding in findings if finding.kind in HOLDING_BACK]
    position = predicted_finding(relative, own_m, limit)
    if position.grave:
        reasons.append(position)
    checks = independent_checks(report, rules)
    return Release(relative, predicted, worst_m, worst, limit, tuple(reasons), checks)


def predicted_finding(relative_m: float, reference_m: float, limit_m: float) -> Finding:
    """Whether what is predicted of the position on the ground is within its limit.

    Args:
        relative_m: RMS in plan against the reference, as in `Release`; NaN where not known.
        reference_m: What the reference adds per axis, metres; 0 where it adds nothing.
        limit_m: Position error on the ground up to which a block is released, metres.
    """
    predicted = float(np.hypot(relative_m, np.sqrt(2) * reference_m))
    told = {
        "relative": f"{relative_m:.2f}", "value": f"{predicted:.2f}", "limit": f"{limit_m:.2f}"
    }  # fmt: skip
    if not np.isfinite(predicted):
        return Finding("predicted-unknown", POOR, told)
    good, kind = predicted <= limit_m, "predicted" if reference_m else "predicted-alone"
    return Finding(f"{kind}-within" if good else kind, SOUND if good else POOR, told)


def relative_sigma_m(report: AdjustmentReport, influence: Influence | None) -> float:
    """Standard deviation in plan against the reference, as in `Release`; NaN where not known."""
    return _relative_m(_ground_variances(report, influence))


def _ground_variances(report: AdjustmentReport, influence: Influence | None) -> dict[str, Scalars]:
    """Variance in plan against the reference of nine places of each photo, square metres."""
    sigmas = {} if influence is None else influence.corner_sigmas()
    return {name: report.unit**2 * np.sum(s**2, axis=1) for name, s in sigmas.items()}


def _relative_m(places: Mapping[str, Scalars]) -> float:
    every = np.concatenate([np.zeros(0), *places.values()])
    return float(np.sqrt(every.mean())) if len(every) else float("nan")


def human_findings(report: AdjustmentReport, rules: JobRules = USUAL_RULES) -> list[Finding]:
    """Where a human and the block disagree, worst first.

    Args:
        report: The adjustment.
        rules: Limits of the job.
    """
    against, limit = report.contradictions, release_limit_m(report.block, rules)
    if not against:
        items = report.block.measurements.values()
        accepted = sum(item.status == "accepted" for item in items)
        return [Finding("agreed", SOUND, {"count": str(accepted)})] if accepted else []
    # What alone moves the ground by more than the block may be off is named in any case.
    told = by_point(against)
    named = [ones for n, ones in enumerate(told) if n < NAMED or ones[0].shift_m > limit]
    findings = [_against(ones, report.block, limit) for ones in named]
    rest = [one.metres for ones in told if ones not in named for one in ones]
    if rest:
        told = {"count": str(len(rest)), "metres": f"{max(rest):.1f}"}
        findings.append(Finding(MANY_AGAINST, DOUBTFUL, told))
    return findings


def release_limit_m(block: Block, rules: JobRules = USUAL_RULES) -> float:
    """Position error on the ground up to which this block is released, metres."""
    pixels = [photo.ground_pixel_m(block.camera_of(name)) for name, photo in block.photos.items()]
    median = float(np.median(pixels)) if pixels else 0.0
    return max(rules.position_m, rules.position_px * median)


def _against(ones: Sequence[Contradiction], block: Block, limit_m: float) -> Finding:
    """Accepted measurements of one point that the block contradicts with one test."""
    one = max(ones, key=lambda one: one.metres)
    told = {
        "worst": one.point_id, "photo": ", ".join(each.photo_id for each in ones),
        "count": str(len(ones)), "metres": f"{one.metres:.1f}", "pixels": f"{one.pixels:.1f}",
        "test": f"{one.test:.1f}", "shift": f"{one.shift_m:.2f}", "limit": f"{limit_m:.2f}",
        "most": f"{max(one.metres, one.shift_m):.2f}",
    }  # fmt: skip
    if block.surveyed[one.point_id].role == "check":
        return Finding("contradicted-check", DOUBTFUL, told)
    # A gross error holds the block back even where the others outweigh it: whoever accepted one may
    # have accepted more.
    if max(one.metres, one.shift_m) > limit_m:
        return Finding("contradicted-far", POOR, told)
    return Finding("contradicted", DOUBTFUL, told)


def _adjustment_findings(report: AdjustmentReport, rules: JobRules) -> list[Finding]:
    low, high = rules.sigma_nought_low, rules.sigma_nought_high
    if not report.converged:
        return [Finding("diverged", POOR, {"low": f"{low:g}", "high": f"{high:g}"})]
    told = {"value": f"{report.sigma_nought:.2f}", "low": f"{low:g}", "high": f"{high:g}"}
    if not np.isfinite(report.sigma_nought):
        return [Finding("sigma-none", POOR, {**told, "value": "–"})]
    findings = [Finding("sigma-far", POOR, told)]
    for kind, grave, least, most in (
        ("sigma-off", DOUBTFUL, rules.sigma_nought_least, rules.sigma_nought_most),
        ("sigma", SOUND, low, high),
    ):
        if least <= report.sigma_nought <= most:
            findings = [Finding(kind, grave, told)]
    for name, figures in report.classes.items():
        squares, redundancy = figures.weighted_squares, figures.redundancy
        # design: three redundant observations at least, and one chance in a thousand.
        if redundancy < 3 or squares <= chdtri(redundancy, 0.001):
            continue
        if figures.sigma_ratio >= LARGER:
            ratio = f"{figures.sigma_ratio:.1f}"
            told = {"worst": say(CLASSES[name]), "ratio": ratio, "class": name}
            findings.append(Finding("class-large", DOUBTFUL, told))
    return findings


def _control_findings(
    found: BlockQuality, report: AdjustmentReport, rules: JobRules
) -> list[Finding]:
    findings = [] if found.control_by_flight else _amount_findings(found, report, rules)
    if findings and findings[0].kind == "control-few":
        return findings
    weak = unchecked_control(report)
    if weak:
        told = {"count": str(len(weak)), "worst": weak[0][0], "photo": weak[0][1]}
        findings.append(Finding("unchecked", DOUBTFUL, told))
    return [*findings, *_check_findings(report, rules)]


def _check_findings(report: AdjustmentReport, rules: JobRules) -> list[Finding]:
    """What independent check points say, few nothing of the block; then the proposals kept out."""
    own, proposals = independent_checks(report, rules), kept_out(report)
    kind, told = own.judged(release_limit_m(report.block, rules))
    graves = {"checks": SOUND, "checks-better": SOUND, "checks-over": POOR}
    findings = [Finding(kind, graves.get(kind, DOUBTFUL), told)]
    control = len(report.surveyed_positions)
    # That there are none at all has been said.
    if control and own.count:
        least = int(np.ceil(rules.check_share_percent * control / 100))
        few = own.count < least
        told = {"count": str(own.count), "control": str(control), "least": str(least)}
        findings.append(Finding("check-share-few" if few else "check-share", int(few), told))
    if proposals.count:
        told = {"count": str(proposals.count), "value": f"{proposals.plan_m:.2f}"}
        findings.append(Finding("kept-out", SOUND, told))
    return findings


def _amount_findings(
    found: BlockQuality, report: AdjustmentReport, rules: JobRules
) -> list[Finding]:
    """Whether there is enough control, and where."""
    plan, heights = len(found.known_plan), len(found.known_heights)
    count, filled = len(report.surveyed_positions), int(np.count_nonzero(found.control_cells))
    told = {"count": str(count), "cells": str(filled), "least": str(rules.control_points),
            "parts": str(rules.control_parts)}  # fmt: skip
    if count < rules.control_points or plan < DATUM[0] or heights < DATUM[1]:
        return [Finding("control-few", POOR, {**told, "plan": str(plan), "heights": str(heights)})]
    sound = filled >= rules.control_parts
    kind = "control" if sound else "control-gaps"
    findings = [Finding(kind, SOUND if sound else DOUBTFUL, told)]
    along, across = found.heights_extent_m
    if across < LINE * max(along, found.side_m):
        told = {**told, "along": f"{along:.0f}", "across": f"{across:.0f}"}
        findings.append(Finding("control-on-a-line", POOR, told))
    if found.control is not None:
        findings += _spread_findings(found.control, rules)
    return findings


def _spread_findings(control: ControlCount, rules: JobRules) -> list[Finding]:
    """Where control lies: in strips, along the edge and inside."""
    name, shown = control.poorest_strip
    few = shown < rules.strip_points
    told = {"worst": name, "count": str(shown), "least": str(rules.strip_points)}
    findings = [Finding("strip-few" if few else "strip", int(few), told)]
    for kind, spread, most, least in (
        ("plan", control.plan, rules.edge_plan_bases, rules.inside_plan),
        ("heights", control.heights, rules.edge_heights_bases, rules.inside_heights),
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
        findings.append(Finding(f"edge-gap-{kind}" if wide else f"edge-{kind}", int(wide), told))
        thin = spread.per_model < least
        told = {"value": f"{spread.per_model:.1f}", "least": f"{least:g}"}
        findings.append(
            Finding(f"inside-few-{kind}" if thin else f"inside-{kind}", int(thin), told)
        )
    return findings


def _tie_findings(found: BlockQuality, rules: JobRules) -> list[Finding]:
    total, oriented = sum(found.rays.values()), [p for p in found.photos if p.oriented]
    limit = {"least": f"{rules.rays_percent:g}"}
    if not total:
        kind, grave = ("one-photo", DOUBTFUL) if len(oriented) < 2 else ("no-ties", POOR)
        return [Finding(kind, grave, limit)]
    many = sum(count for rays, count in found.rays.items() if rays >= 3) / total
    told = {"share": f"{100 * many:.0f}", **limit}
    sound = 100 * many >= rules.rays_percent
    findings = [Finding("rays" if sound else "rays-few", SOUND if sound else DOUBTFUL, told)]
    for members, points in found.parts:
        told = {"worst": members[0], "photos": str(len(members)), "points": str(points), **limit}
        findings.append(Finding("in-parts", POOR if points < DATUM[1] else DOUBTFUL, told))
    bare = [p.photo_id for p in oriented if _areas_held(p) < rules.photo_parts]
    if bare:
        told = {"count": str(len(bare)), "worst": bare[0], "parts": str(rules.photo_parts)}
        findings.append(Finding("bare", DOUBTFUL, told))
    camera, test, largest = found.pattern_worst
    kind, grave = ("systematic", DOUBTFUL) if test > SYSTEMATIC else ("no-pattern", SOUND)
    findings.append(Finding(kind, grave, {"value": f"{largest:.1f}", "worst": camera}))
    return findings


def _areas_held(photo: PhotoQuality) -> int:
    return sum(count > 0 for count in photo.cells)


def _distance_findings(report: AdjustmentReport) -> list[Finding]:
    """What the block tells of principal distances that no certificate states."""
    findings: list[Finding] = []
    for told in report.parameters:
        camera = report.block.cameras.get(told.owner)
        unknown = camera is not None and camera.sigma_principal_distance_mm > 0
        if camera is None or not unknown or told.name != CONSTANT_NAMES[0]:
            continue
        known = told.sigma <= DISTANCE_SHARE * camera.principal_distance_mm
        values = {
            "worst": told.owner, "value": f"{camera.principal_distance_mm:.2f}",
            "sigma": f"{told.sigma:.2f}", "correlation": f"{told.correlation:.3f}",
        }  # fmt: skip
        kind = ("distance", SOUND) if known else ("distance-unknown", DOUBTFUL)
        findings.append(Finding(*kind, values))
    return findings


def _flight_findings(found: BlockQuality, rules: JobRules) -> list[Finding]:
    findings: list[Finding] = []
    loose = [photo.photo_id for photo in found.photos if not photo.oriented]
    if loose:
        findings.append(Finding("loose", POOR, {"count": str(len(loose)), "worst": loose[0]}))
    else:
        findings.append(Finding("oriented", SOUND, {"count": str(len(found.photos))}))
    oriented = [photo for photo in found.photos if photo.oriented]
    for text, values, rule, most in (
        ("tilt", {p.photo_id: p.tilt_deg for p in oriented}, rules.tilt_deg, rules.tilt_most_deg),
        ("crab", {p.photo_id: p.crab_deg for p in oriented}, rules.crab_deg, rules.crab_most_deg),
    ):
        known = {name: value for name, value in values.items() if np.isfinite(value)}
        if not known:
            continue
        worst = max(known, key=lambda name: known[name])
        over = sum(value > rule for value in known.values())
        told = {"value": f"{known[worst]:.1f}", "worst": worst, "limit": f"{rule:g}",
                "over": str(over)}  # fmt: skip
        grave = SOUND if not over else DOUBTFUL if known[worst] <= most else POOR
        findings.append(Finding(text if not grave else f"{text}-over", grave, told))
    for text, along, least in (
        ("along", True, rules.along_percent),
        ("across", False, rules.across_percent),
    ):
        shares = [100 * share for share in _nearest_shares(found.overlaps, along)]
        if shares:
            small = sum(share < least for share in shares)
            told = {
                "low": f"{min(shares):.0f}",
                "high": f"{max(shares):.0f}",
                "least": f"{least:g}",
                "small": str(small),
            }
            findings.append(Finding(f"{text}-small" if small else text, int(small > 0), told))
    return findings


def _hole_findings(holes: Sequence[Hole] | None) -> list[Finding]:
    if not holes:
        return [] if holes is None else [Finding("no-holes", SOUND)]
    told = {
        "count": str(len(holes)),
        "area": f"{sum(hole.area_m2 for hole in holes):.0f}",
        "largest": f"{holes[0].area_m2:.0f}",
        "east": f"{holes[0].east:.0f}",
        "north": f"{holes[0].north:.0f}",
    }
    return [Finding("holes", DOUBTFUL, told)]


def _nearest_shares(overlaps: tuple[Overlap, ...], along: bool) -> list[float]:
    """Of each photo the share it has with its nearest neighbour in a direction."""
    best: dict[str, float] = {}
    for pair in overlaps:
        if pair.along is along:
            for name in (pair.first, pair.second):
                best[name] = max(best.get(name, 0.0), pair.share)
    return list(best.values())
