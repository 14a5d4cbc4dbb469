"""All figures of the report as one JSON-able value; the page shows nothing else."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry import Polygon

from app.report.accuracy import (
    check_accuracy,
    comparison_accuracy,
    parameter_figures,
    pointing_figures,
    residual_figures,
)
from app.report.against import compare_states
from app.report.checked import checked_part
from app.report.control import control_counts, reference_figures, shift_figures
from app.report.decisions import decision_figures
from app.report.drawing import map_figures
from app.report.mosaic import fault_figures, misfit_figures, mosaic_figures
from app.report.protocol_figures import (
    control_in_use,
    coverage_figures,
    json_value,
    spread_figures,
)
from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.adjustment.influence import Influence
from core.block import REFERENCE, Block, Photo
from core.control.calibration_check import Bin, calibration_error
from core.doubts import Doubt
from core.geometry.camera import Camera
from core.geometry.crs import Bounds
from core.matching.reference import ReferenceLayer
from core.mosaic.comparison import MosaicAccuracy
from core.mosaic.fault_places import FaultPlace, misfit_findings
from core.mosaic.misfit_places import Misfit
from core.mosaic.seam_fit import SeamFit
from core.mosaic.seams import Seam
from core.quality.assessment import assess_block
from core.quality.job_rules import USUAL_RULES, JobRules
from core.quality.judged_rules import judge_rules
from core.quality.residuals import displacement
from core.quality.rules import (
    Finding,
    Release,
    check_release,
    human_doubts,
    judge_block,
    predicted_finding,
    release_limit_m,
)
from core.quality.sun import sun_findings
from core.raster.holes import Hole
from core.raster.ortho import Ortho
from core.sheets.acceptance import JudgedLot, lot_findings
from core.sheets.delivery import Delivery, sheet_figures
from sessions.checked import Checked, Predicted, checked_by_hand, judged_lot, readings_found
from sessions.decisions import Recorded
from sessions.remarks import fault_findings, standing_faults
from sessions.sheet_samples import sheets_of
from ui.review.sheet_samples import lot_part
from ui.words.catalogue import LANGUAGES


@dataclass(frozen=True, slots=True)
class Written:
    """When, by whom and with what a report was written."""

    at: str
    """Date and time, UTC."""
    operator: str
    """Who had it written."""
    version: str
    """Of Gruber."""


def written_now(operator: str) -> Written:
    """Written at this minute by this version."""
    return Written(datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"), operator, version("gruber"))


@dataclass(frozen=True, slots=True, eq=False)
class ReportContent:
    """Everything a report tells of; what is left out is left out of the report."""

    name: str
    """Name of the block."""
    report: AdjustmentReport
    """The adjusted block and its figures."""
    adjustment: AdjustmentOptions = field(default_factory=AdjustmentOptions)
    """What it was adjusted with."""
    before: Block | None = None
    """The block before the adjustment, for the changes of the cameras."""
    heights: str = ""
    """Height system in words."""
    doubts: Sequence[Doubt] = ()
    """What the engine is unsure of."""
    set_aside: Mapping[str, str] = field(default_factory=dict[str, str])
    """Scans that could not be used, with the reason."""
    reference_sigma_m: tuple[float, float] | None = None
    """Accuracy of the reference ortho and DEM, metres."""
    influence: Influence | None = None
    """Equations of the adjusted block, to tell where control would help; None: it is not told."""
    reliability: Sequence[Bin] = ()
    """How far the probabilities of control proposals are borne out."""
    footprints: Mapping[str, Polygon] = field(default_factory=dict[str, Polygon])
    """Footprint of each photo; over level ground when left out."""
    mosaic: Path | None = None
    """The mosaic."""
    ortho: Ortho | None = None
    """The reference ortho, which lies under the mosaic; None where there is none."""
    seams: Sequence[Seam] = ()
    """Its seams."""
    seam_fits: Sequence[SeamFit] = ()
    """How well neighbours fit along them, the largest shift first."""
    holes: Sequence[Hole] | None = None
    """Holes inside it, largest first; None where there is no mosaic."""
    area_shown: float | None = None
    """Share that it shows of the area asked for, 0 to 1; None where none was."""
    change: Mapping[str, float] = field(default_factory=dict[str, float])
    """Share of the ground that is `same` as today and that is `different`; empty: not known."""
    misfit: Misfit | None = None
    """The mosaic against the reference; None where there is none."""
    likely_faults: Sequence[FaultPlace] = ()
    """Places at which the mosaic is likely to be wrong, worst first."""
    sheets: Delivery | None = None
    """Map sheets that were cut from it; None where there are none."""
    tied_to: Mapping[ReferenceLayer, int] = field(default_factory=dict[ReferenceLayer, int])
    """References that photos are tied to, with their control points; empty where it is but one."""
    comparisons: Mapping[str, MosaicAccuracy] = field(default_factory=dict[str, MosaicAccuracy])
    """Mosaic against other orthos, by their name."""
    timings_s: Mapping[str, float] = field(default_factory=dict[str, float])
    """Seconds of each stage."""
    provenance: Mapping[str, str] = field(default_factory=dict[str, str])
    """What the stages were made from."""
    written: Written | None = None
    """Date, operator and version."""
    decisions: Sequence[Recorded] = ()
    """Every decision of the session."""
    proposed: Block | None = None
    """The block before any of them; None where it is not known."""
    mosaic_version: str = ""
    """What the mosaic was made of, as readings of it say; empty where there is none."""
    rules: JobRules = USUAL_RULES
    """Limits by which the block is judged."""
    exposed: Mapping[str, str] = field(default_factory=dict[str, str])
    """When each photo was taken, as far as that is known."""
    against: Mapping[str, Any] | None = None
    """Report of an earlier state that this one is compared with; None: with none."""
    language: str = LANGUAGES[0]
    """Of the page; the JSON knows one language."""


def gather(content: ReportContent) -> dict[str, Any]:
    """All figures of a report, with nothing that JSON cannot hold: NaN becomes null."""
    report, rules = content.report, content.rules
    block = report.block
    footprints = {
        name: content.footprints.get(name) or _level_footprint(photo, block.camera_of(name))
        for name, photo in block.photos.items()
    }
    standing = {name: footprints[name] for name, photo in block.photos.items() if photo.oriented}
    findings, release, checked = _judged(content, standing)
    figures = {
        "verdict": [_finding_figures(one) for one in findings],
        "written": None if content.written is None else asdict(content.written),
        "decisions": decision_figures(content.decisions, content.proposed),
        "pointing": pointing_figures(block.measurements.values()),
        "block": _block_figures(content),
        "adjustment": _adjustment_figures(report, rules),
        "checks": check_accuracy(report, rules),
        "checked": _checked_figures(content, footprints, findings, checked),
        "comparisons": [
            {**comparison_accuracy(*item), "tied": item[0] in {one.name for one in content.tied_to}}
            for item in content.comparisons.items()
        ],
        "control": {
            **control_counts(report),
            **control_in_use(report, content.influence),
            "references": reference_figures(content.tied_to, report),
            "reference_shift": shift_figures(REFERENCE, report),
        },
        "residuals": residual_figures(report),
        "parameters": parameter_figures(report),
        "reliability": _reliability(content),
        "coverage": coverage_figures(report),
        "control_spread": spread_figures(report, content.influence, rules),
        "certificate": None if release is None else _release_figures(release),
        "ties": _tie_figures(report),
        "overlaps": _overlaps(block, footprints),
        "exterior": _exterior_figures(report, content.before),
        "interior": [_interior_figures(photo) for photo in block.photos.values()],
        "cameras": _camera_figures(content),
        "doubts": _doubts(content),
        "set_aside": dict(content.set_aside),
        "map": map_figures(report, footprints),
        "mosaic": None
        if content.mosaic is None
        else {
            **mosaic_figures(content.mosaic, content.seams, content.holes or (), content.seam_fits),
            "area_shown": content.area_shown,
        },
        "change": dict(content.change),
        "misfit": misfit_figures(content.misfit),
        "likely_faults": [fault_figures(place) for place in content.likely_faults],
        "sheets": [] if content.sheets is None else sheet_figures(content.sheets.files),
        "timings_s": dict(content.timings_s),
        "provenance": dict(content.provenance),
    }
    told = json_value(figures)
    earlier = content.against
    told["against"] = None if earlier is None else json_value(compare_states(told, earlier))
    return told


def _finding_figures(one: Finding) -> dict[str, Any]:
    return {
        "kind": one.kind,
        "grave": one.grave,
        "sentence": one.sentence,
        "stands_for": one.stands_for,
        **one.values,
    }


def _doubts(content: ReportContent) -> list[dict[str, Any]]:
    """What the engine is unsure of, and where a human and the block disagree; gravest first."""
    doubts = (*human_doubts(content.report, content.rules), *content.doubts)
    return [
        {
            "kind": doubt.kind,
            "subject": doubt.subject,
            "message": doubt.message,
            "gravity": doubt.gravity,
            "evidence": dict(doubt.evidence),
        }
        for doubt in sorted(doubts, key=lambda doubt: -doubt.gravity)
    ]


def _judged(
    content: ReportContent, standing: Mapping[str, Polygon]
) -> tuple[tuple[Finding, ...], Release | None, Checked | None]:
    """Every finding, whether the block may be given out, and what readings say of its mosaic."""
    report, rules = content.report, content.rules
    measured = assess_block(report, standing)
    findings = (
        *sun_findings(report.block, content.exposed, rules),
        *judge_block(measured, report, content.holes, rules),
    )
    release = _release(content, findings)
    relative_m = float("nan") if release is None else release.relative_m
    predicted = Predicted(relative_m, _ortho_sigma_m(content), content.influence, content.seams)
    version = content.mosaic_version
    checked = checked_by_hand(report, content.decisions, version, predicted, rules=rules)
    lot = lot_of(content)
    more = (
        *readings_found(checked, version, rules),
        *misfit_findings(content.likely_faults),
        *fault_findings(standing_faults(content.decisions)),
        *(() if lot is None else lot_findings(lot, rules)),
    )
    findings = (*more, *findings)
    if release is not None:
        own_m = report.block.reference_error_m(_ortho_sigma_m(content))
        position = predicted_finding(release.relative_m, own_m, release.limit_m)
        findings, release = (*findings, position), release.with_findings(more)
    return tuple(sorted(findings, key=lambda one: -one.grave)), release, checked


def _checked_figures(
    content: ReportContent,
    footprints: Mapping[str, Polygon],
    findings: Sequence[Finding],
    checked: Checked | None,
) -> dict[str, Any]:
    """Checks, and every rule that concerns the block."""
    decided, rules = (content.decisions, content.mosaic_version), content.rules
    judged = judge_rules(findings, rules)
    seams, bounds = content.seams, _bounds(footprints)
    told = checked_part(
        content.report,
        *decided,
        checked,
        judged,
        seams=seams,
        bounds=bounds,
        rules=rules,
        sheets=sheets_of(content.sheets, content.mosaic_version),
    )
    lot = lot_of(content)
    return told | {"sheets": None if lot is None else lot_part(lot, *decided, rules)}


def lot_of(content: ReportContent) -> JudgedLot | None:
    """The sample of map sheets that was drawn last; None where none was drawn."""
    limit, rules = release_limit_m(content.report.block, content.rules), content.rules
    sheets = sheets_of(content.sheets, content.mosaic_version)
    return judged_lot(content.decisions, sheets, content.mosaic_version, limit, rules=rules)


def _ortho_sigma_m(content: ReportContent) -> float:
    """Standard deviation of the reference per axis, metres; 0 without one."""
    return content.reference_sigma_m[0] if content.reference_sigma_m else 0.0


def _release(content: ReportContent, findings: Sequence[Finding]) -> Release | None:
    """Whether the block may be given out; None where that was not asked."""
    if content.influence is None and content.report.exterior_sigmas:
        return None
    sigma, rules = _ortho_sigma_m(content), content.rules
    return check_release(content.report, content.influence, sigma, findings, rules=rules)


def _release_figures(found: Release) -> dict[str, Any]:
    return {
        "relative_m": found.relative_m,
        "predicted_m": found.predicted_m,
        "worst_m": found.worst_m,
        "worst_photo": found.worst_photo,
        "limit_m": found.limit_m,
        "certified": found.certified,
        "reasons": [finding.kind for finding in found.reasons],
        "sentences": [finding.sentence for finding in found.reasons],
    }


def _block_figures(content: ReportContent) -> dict[str, Any]:
    block = content.report.block
    sigma = content.reference_sigma_m or (None, None)
    return {
        "name": content.name,
        "crs": block.crs,
        "heights": content.heights,
        "photos": len(block.photos),
        "oriented": sum(photo.oriented for photo in block.photos.values()),
        "cameras": len(block.cameras),
        "reference_ortho_sigma_m": sigma[0],
        "reference_dem_sigma_m": sigma[1],
        "surveyed_datum": block.surveyed_datum,
    }


def _adjustment_figures(report: AdjustmentReport, rules: JobRules) -> dict[str, Any]:
    return {
        "sigma_nought": report.sigma_nought,
        "sigma_nought_range": [rules.sigma_nought_low, rules.sigma_nought_high],
        "redundancy": report.redundancy,
        "iterations": report.iterations,
        "converged": report.converged,
        "rms_px": dict(report.rms_px),
        "rms_m": dict(report.rms_m),
    }


def _reliability(content: ReportContent) -> dict[str, Any]:
    """What the heights of peaks stated, and how far it is borne out by where they lie."""
    return {
        "bins": [asdict(one) for one in content.reliability],
        "error": calibration_error(content.reliability),
        "proposals": sum(one.proposals for one in content.reliability),
    }


def _tie_figures(report: AdjustmentReport) -> dict[str, Any]:
    """How many tie points have how many rays, and how many rays each photo has."""
    ties = report.block.ties
    in_use = np.isfinite(report.tie_residuals_px).all(axis=1)
    rays = np.bincount(ties.point[in_use], minlength=ties.count)
    counts = np.bincount(rays[rays > 0])
    per_photo = np.bincount(ties.photo[in_use], minlength=len(ties.photo_ids))
    return {
        "points": int(np.count_nonzero(rays)),
        "rays": int(in_use.sum()),
        "left_out_rays": int((~in_use).sum()),
        "points_by_rays": {str(n): int(c) for n, c in enumerate(counts) if c},
        "rays_by_scan": dict(zip(ties.photo_ids, per_photo.tolist(), strict=True)),
    }


def _overlaps(block: Block, footprints: Mapping[str, Polygon]) -> list[dict[str, Any]]:
    """Pairs of photos that overlap: share of the smaller footprint, and common tie points."""
    ties = block.ties
    seen = {
        name: set(ties.point[ties.photo == number].tolist())
        for number, name in enumerate(ties.photo_ids)
    }
    names = list(footprints)
    pairs: list[dict[str, Any]] = []
    for index, first in enumerate(names):
        for second in names[index + 1 :]:
            one, other = footprints[first], footprints[second]
            share = one.intersection(other).area / max(min(one.area, other.area), 1e-9)
            if share > 0.01:
                common = seen.get(first, set()) & seen.get(second, set())
                pairs.append({"scans": [first, second], "share": share, "common_ties": len(common)})
    return pairs


def _exterior_figures(report: AdjustmentReport, before: Block | None) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    for name, photo in report.block.photos.items():
        exterior, sigmas = photo.exterior, report.exterior_sigmas.get(name)
        # How far the georeference was off, not where localisation began.
        given = None if before is None else before.photos.get(name)
        came = photo if given is None else replace(photo, approximate=given.exterior)
        off = displacement(came, report.block.camera_of(name))
        rows.append(
            {
                "scan": name,
                "oriented": photo.oriented,
                "centre_m": exterior.centre.tolist(),
                "angles_deg": np.degrees(exterior.angles).tolist(),
                "ground_pixel_m": photo.ground_pixel_m(report.block.camera_of(name)),
                "sigma_centre_m": None if sigmas is None else sigmas.centre_m.tolist(),
                "sigma_angles_deg": None if sigmas is None else np.degrees(sigmas.angles).tolist(),
                "georeference_off": {
                    "shift_m": off.shift_m.tolist(),
                    "turn_deg": float(np.degrees(off.turn)),
                    "scale": off.scale,
                    "rms_m": off.rms_m,
                },
            }
        )
    return rows


def _interior_figures(photo: Photo) -> dict[str, Any]:
    interior = photo.interior
    return {
        "scan": photo.photo_id,
        "model": interior.model,
        "pixel_um": interior.pixel_size_mm * 1000,
        "sigma_um": interior.sigma_um,
        "rms_um": interior.rms_um,
        "residuals_um": dict(zip(interior.names, interior.residuals_um.tolist(), strict=True)),
    }


def _camera_figures(content: ReportContent) -> list[dict[str, Any]]:
    """Constants after the adjustment, and what it changed."""
    rows: list[dict[str, Any]] = []
    for name, camera in content.report.block.cameras.items():
        row: dict[str, Any] = {"camera": name, "adjusted": _constants(camera)}
        if content.before is not None and name in content.before.cameras:
            row["before"] = _constants(content.before.cameras[name])
        rows.append(row)
    return rows


def _constants(camera: Camera) -> dict[str, Any]:
    k1, k2, k3 = camera.radial_distortion
    corner = float(np.hypot(*camera.frame_mm)) / 2
    at_corner = corner * (k1 * corner**2 + k2 * corner**4 + k3 * corner**6)
    return {
        "principal_distance_mm": camera.principal_distance_mm,
        "principal_point_mm": list(camera.principal_point_mm),
        "radial_distortion": [k1, k2, k3],
        "distortion_at_corner_um": at_corner * 1000,
    }


def _bounds(footprints: Mapping[str, Polygon]) -> Bounds:
    """Bounds of all footprints, metres."""
    west, south, east, north = shapely.total_bounds(list(footprints.values())).tolist()
    return west, south, east, north


def _level_footprint(photo: Photo, camera: Camera) -> Polygon:
    corners = photo.interior.pixel_from_film(camera.frame_corners_mm)
    heights = np.full(len(corners), photo.ground_height_m)
    return Polygon(photo.object_from_pixel(corners, heights, camera)[:, :2])
