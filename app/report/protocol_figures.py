"""Every figure of the adjustment's protocol as one JSON-able value."""

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from app.report.accuracy import parameter_figures, rms_columns
from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport, ClassFigures
from core.adjustment.influence import Influence, LeftOut, Reliability
from core.adjustment.reliability import TestLimits
from core.block import Block, Measurement, Photo
from core.geometry.camera import Camera
from core.literature.methods import compare_methods
from core.quality.control_count import ControlSpread, RayCounts, count_control, ray_counts_of
from core.quality.control_design import Want, wanted_control
from core.quality.job_rules import USUAL_RULES, JobRules
from core.quality.rules import doubts_of

AXES = ("X", "Y", "Z")
PLACES = ("NW", "N", "NE", "W", "centre", "E", "SW", "S", "SE")
"""The nine places of a photo, as they lie on the film."""
CELLS = 3
"""Cells a side in which the coverage of a photo is counted, as the Gruber points lie."""


def protocol_figures(
    name: str,
    report: AdjustmentReport,
    options: AdjustmentOptions,
    influence: Influence | None,
    *,
    rules: JobRules = USUAL_RULES,
) -> dict[str, Any]:
    """All figures of an adjustment.

    Args:
        name: Name of the block.
        report: The adjusted block.
        options: What it was adjusted with.
        influence: Its equations; None where no photo took part.
        rules: Limits of the job.
    """
    counts = ray_counts_of(report)
    corners = {} if influence is None else influence.corner_sigmas()
    scale = report.unit
    return {
        "block": {"name": name, **_block(report, counts)},
        "options": _options(report, options),
        "quality": _quality(report),
        "classes": {name: _class(figures) for name, figures in report.classes.items()},
        "parameters": parameter_figures(report),
        "ties": _ties(report, counts),
        "photos": _photos(report, counts, {n: scale * s for n, s in corners.items()}),
        "control": _control(report, influence, scale),
        "control_spread": spread_figures(report, influence, rules),
        "checks": _checks(report),
        "methods": _methods(report) if options.compare_methods else [],
        "rms_m": dict(report.rms_m),
        "exterior": _exterior(report),
        "excluded": _excluded(report),
        "doubts": [
            {"kind": d.kind, "subject": d.subject, "message": d.message, "gravity": d.gravity}
            for d in sorted(doubts_of(report, rules=rules), key=lambda doubt: -doubt.gravity)
        ],
    }


def _block(report: AdjustmentReport, counts: RayCounts) -> dict[str, Any]:
    block = report.block
    photos = [block.photos[name] for name in report.exterior_sigmas]
    above = [float(photo.exterior.centre[2]) - photo.ground_height_m for photo in photos]
    scales = [
        1000 * height / block.camera_of(photo.photo_id).principal_distance_mm
        for photo, height in zip(photos, above, strict=True)
    ]
    return {
        "crs": block.crs,
        "photos": len(block.photos),
        "photos_adjusted": len(photos),
        "strips": len(set(counts.strip.values())),
        "strip_of_photo": {name: number + 1 for name, number in counts.strip.items()},
        "mean_height_over_ground_m": _mean(above),
        "mean_ground_height_m": _mean([photo.ground_height_m for photo in photos]),
        "mean_scale_number": _mean(scales),
    }


def _options(report: AdjustmentReport, options: AdjustmentOptions) -> dict[str, Any]:
    block = report.block
    limits = TestLimits.of(options.test, options.risk, max(report.redundancy, 3))
    control = [p for p in block.surveyed.values() if p.role == "control"]
    used = [m for m in block.measurements.values() if m.key in report.redundancy_numbers]
    sigmas = {
        "tie_px": _median(block.ties.sigma_px.tolist()),
        "control_px": _median([m.sigma_px for m in used]),
        **{
            f"control_{axis}_m": _median([float(p.sigma_m[row]) for p in control])
            for row, axis in enumerate(AXES)
        },
        "principal_distance_mm": options.sigma_principal_distance_mm,
        "principal_point_mm": options.sigma_principal_point_mm,
        "distortion_um": options.sigma_distortion_um,
        "additional_um": options.sigma_additional_um,
        "dem_m": options.dem_sigma_m or None,
    }
    return {
        "a_priori_sigmas": sigmas,
        "cameras_estimated": options.estimate_cameras,
        "self_calibration": list(options.self_calibration),
        "self_calibration_per": "photo" if options.per_photo else "camera",
        "gnss_shift": options.gnss_shift,
        "gnss_drift": options.gnss_drift,
        "imu_misalignment": options.misalignment,
        "network": "free" if options.free_network else "control",
        "variance_components": options.variance_components,
        "refraction": _corrected(block, "refraction"),
        "earth_curvature": _corrected(block, "curvature"),
        "gross_errors": options.test if options.robust else "none",
        "risk": options.risk,
        "critical_value": limits.critical if options.robust else None,
    }


def _corrected(block: Block, correction: str) -> bool:
    """Whether the rays of all photos were corrected so."""
    return all(correction in photo.corrections for photo in block.photos.values())


def _quality(report: AdjustmentReport) -> dict[str, Any]:
    """Sigma nought, also as the deviation of a tie point's coordinate on scan and film."""
    sigma_px = _median(report.block.ties.sigma_px.tolist())
    sizes = [1000 * photo.interior.pixel_size_mm for photo in report.block.photos.values()]
    pixels = None if sigma_px is None else report.sigma_nought * sigma_px
    return {
        "sigma_nought": report.sigma_nought,
        "sigma_nought_px": pixels,
        "sigma_nought_um": None if pixels is None or not sizes else pixels * float(np.mean(sizes)),
        "redundancy": report.redundancy,
        "iterations": report.iterations,
        "converged": report.converged,
        "condition": report.condition,
    }


def _class(figures: ClassFigures) -> dict[str, Any]:
    return {
        "observations": figures.observations,
        "redundancy": figures.redundancy,
        "mean_redundancy_number": figures.redundancy / max(figures.observations, 1),
        "sigma_ratio": figures.sigma_ratio,
        "weight_factor": figures.factor,
    }


def _ties(report: AdjustmentReport, counts: RayCounts) -> dict[str, Any]:
    residuals = report.tie_residuals_px[np.isfinite(report.tie_residuals_px).all(axis=1)]
    rays = len(residuals)
    taken = rays + len(report.tie_reasons)
    return {
        "points": sum(counts.within.values()) + sum(counts.across.values()),
        "rays": rays,
        "accepted_percent": 100 * rays / taken if taken else None,
        "within_strips": {str(number): count for number, count in counts.within.items()},
        "across_strips": {str(number): count for number, count in counts.across.items()},
        "rms_px": rms_columns(residuals),
        "largest_px": np.abs(residuals).max(axis=0).tolist() if rays else [None, None],
    }


def _photos(
    report: AdjustmentReport, counts: RayCounts, corners: Mapping[str, Any]
) -> list[dict[str, Any]]:
    """One row a photo: rays, how many were accepted, residuals, ground standard deviations."""
    ties = report.block.ties
    lost = Counter(ties.photo_ids[ties.photo[ray]] for ray in report.tie_reasons)
    used = np.isfinite(report.tie_residuals_px).all(axis=1)
    rows: list[dict[str, Any]] = []
    for name in report.exterior_sigmas:
        number = ties.photo_ids.index(name) if name in ties.photo_ids else -1
        residuals = report.tie_residuals_px[used & (ties.photo == number)]
        by_rays = counts.by_photo.get(name, {})
        taken = len(residuals) + lost[name]
        rows.append(
            {
                "scan": name,
                "strip": counts.strip[name] + 1,
                "tie_points": len(residuals),
                "accepted_percent": 100 * len(residuals) / taken if taken else None,
                "multi_ray_points": sum(c for n, c in by_rays.items() if n > 2),
                "points_by_rays": {str(n): count for n, count in by_rays.items()},
                "control": sum(key[1] == name for key in report.redundancy_numbers),
                "rms_px": rms_columns(residuals),
                "largest_px": float(np.linalg.norm(residuals, axis=1).max())
                if len(residuals)
                else None,
                "ground_sigma_m": {
                    place: np.round(sigma, 4).tolist()
                    for place, sigma in zip(PLACES, corners.get(name, ()), strict=False)
                },
            }
        )
    return rows


def _control(report: AdjustmentReport, influence: Influence | None, scale: float) -> dict[str, Any]:
    """Residuals, reliability and the point without itself."""
    block = report.block
    reliabilities = {} if influence is None else influence.reliabilities()
    left_out = {} if influence is None else {p.point_id: p for p in influence.leave_one_out()}
    points = [
        {
            "point_id": name,
            "difference_m": (position - block.surveyed[name].position).tolist(),
            "sigma_m": report.surveyed_sigmas_m[name].tolist(),
            **_without(left_out.get(name), scale),
        }
        for name, position in sorted(report.surveyed_positions.items())
    ]
    measurements = [
        {
            "point_id": key[0],
            "scan": key[1],
            "residual_px": list(report.residuals_px[key]),
            "redundancy_number": number,
            "says": _checked(number),
            **_reliable(reliabilities.get(key), scale),
        }
        for key, number in sorted(report.redundancy_numbers.items())
    ]
    differences = np.array([point["difference_m"] for point in points]).reshape(-1, 3)
    return {
        "points": points,
        "measurements": measurements,
        "rms_m": rms_columns(differences),
        "largest_m": np.abs(differences).max(axis=0).tolist() if points else [None] * 3,
        "left_out_rms_m": rms_columns(
            np.array([p["left_out_m"] for p in points if p["left_out_m"]]).reshape(-1, 3)
        ),
    }


def control_in_use(report: AdjustmentReport, influence: Influence | None) -> dict[str, Any]:
    """Every control measurement that takes part, worst first, with how far its point moved."""
    scale = report.unit
    control = _control(report, influence, scale)
    moved = {point["point_id"]: point["difference_m"] for point in control["points"]}
    items = report.block.measurements
    rows: list[dict[str, Any]] = [
        {
            **row,
            "status": items[row["point_id"], row["scan"]].status,
            "difference_m": moved.get(row["point_id"], [np.nan] * 3),
            "length_px": float(np.hypot(*row["residual_px"])),
        }
        for row in control["measurements"]
    ]
    return {"in_use": sorted(rows, key=lambda row: (-(row["test"] or 0.0), -row["length_px"]))}


def _without(left_out: LeftOut | None, scale: float) -> dict[str, Any]:
    if left_out is None:
        return {"left_out_m": None, "left_out_sigma_m": None, "left_out_test": None}
    return {
        "left_out_m": left_out.difference_m.tolist(),
        "left_out_sigma_m": (scale * left_out.sigma_m).tolist(),
        "left_out_test": left_out.test / scale,
    }


def _reliable(found: Reliability | None, scale: float) -> dict[str, Any]:
    return {
        "test": None if found is None else found.test / scale,
        "shift_if_rejected_m": None if found is None else found.shift_m,
        "smallest_detectable_px": None if found is None else scale * found.smallest_error_px,
        "its_effect_on_the_ground_m": None if found is None else scale * found.its_shift_m,
    }


def _checked(number: float) -> str:
    """A redundancy number in words."""
    if number < 0.1:
        return "cannot be checked by any other"
    return "weakly checked" if number < 0.3 else "well checked"


def _checks(report: AdjustmentReport) -> dict[str, Any]:
    independent = report.block.independent_checks
    points = [
        {
            "point_id": check.point_id,
            "difference_m": check.difference_m.tolist(),
            "predicted_sigma_m": None if check.sigma_m is None else check.sigma_m.tolist(),
            "used_scans": check.used_scans,
            "independent": check.point_id in independent,
        }
        for check in report.checks
    ]
    told = [check.sigma_m for check in report.checks if check.sigma_m is not None]
    differences = np.array([p["difference_m"] for p in points]).reshape(-1, 3)
    return {
        "points": points,
        "rms_m": [report.rms_m.get(f"check_{axis}") for axis in AXES],
        "predicted_rms_m": rms_columns(np.array(told).reshape(-1, 3)),
        "largest_m": np.abs(differences).max(axis=0).tolist() if points else [None] * 3,
    }


def _methods(report: AdjustmentReport) -> list[dict[str, Any]]:
    """Strips, independent models and bundle side by side."""
    return [
        {
            "method": result.method,
            "reason": result.reason,
            **{
                name: None if values is None else values.tolist()
                for name, values in (
                    ("joint_m", result.joint_m),
                    ("control_m", result.control_m),
                    ("check_m", result.check_m),
                    ("centres_m", result.centres_m),
                )
            },
        }
        for result in compare_methods(report)
    ]


def _exterior(report: AdjustmentReport) -> dict[str, Any]:
    rows: list[dict[str, Any]] = []
    for name, sigmas in report.exterior_sigmas.items():
        exterior = report.block.photos[name].exterior
        rows.append(
            {
                "scan": name,
                "centre_m": exterior.centre.tolist(),
                "angles_deg": np.degrees(exterior.angles).tolist(),
                "sigma_centre_m": sigmas.centre_m.tolist(),
                "sigma_angles_deg": np.degrees(sigmas.angles).tolist(),
            }
        )
    centres = np.array([row["sigma_centre_m"] for row in rows]).reshape(-1, 3)
    angles = np.array([row["sigma_angles_deg"] for row in rows]).reshape(-1, 3)
    return {
        "photos": rows,
        "rms_sigma_centre_m": rms_columns(centres),
        "rms_sigma_angles_deg": rms_columns(angles),
        "largest_sigma_centre_m": centres.max(axis=0).tolist() if rows else [None] * 3,
        "largest_sigma_angles_deg": angles.max(axis=0).tolist() if rows else [None] * 3,
    }


def _excluded(report: AdjustmentReport) -> dict[str, Any]:
    """Everything that took no part, with the reason."""
    block, ties = report.block, report.block.ties
    control: list[dict[str, Any]] = []
    for key, item in sorted(block.measurements.items()):
        status, reason = report.final_status(item)
        if block.surveyed[key[0]].role == "control" and status not in ("auto", "accepted"):
            control.append(
                {
                    "point_id": key[0],
                    "scan": key[1],
                    "status": status,
                    "reason": reason,
                    "residual_px": list(report.residuals_px.get(key, (np.nan, np.nan))),
                }
            )
    rays = [
        {
            "tie_point": int(ties.point[ray]),
            "scan": ties.photo_ids[ties.photo[ray]],
            "reason": reason,
        }
        for ray, reason in sorted(report.tie_reasons.items())
    ]
    return {"control": control, "tie_rays": rays}


def _median(values: list[float]) -> float | None:
    return float(np.median(values)) if values else None


def _mean(values: list[float]) -> float | None:
    return float(np.mean(values)) if values else None


def spread_figures(
    report: AdjustmentReport, influence: Influence | None, rules: JobRules = USUAL_RULES
) -> dict[str, Any]:
    """Control against the rules, and the places where one more point would help most.

    Args:
        report: The adjusted block.
        influence: Its equations; None where no photo took part.
        rules: Limits of the job.
    """
    count = count_control(report)
    scale = report.unit
    wants = () if influence is None else wanted_control(influence)
    spread = None if count is None else {
        "base_m": count.base_m,
        "models": count.models,
        "strip_points_least": rules.strip_points,
        "poorest_strip": {"scan": count.poorest_strip[0], "points": count.poorest_strip[1]},
        "plan": _spread(count.plan, rules.edge_plan_bases, rules.inside_plan),
        "heights": _spread(count.heights, rules.edge_heights_bases, rules.inside_heights),
        "check_share": count.check_share,
    }  # fmt: skip
    return {"rules": spread, "wanted": [_want(want, scale) for want in wants]}


def _spread(spread: ControlSpread, bases: float, per_model: float) -> dict[str, Any]:
    return {
        "points": spread.points,
        "edge_gap_bases": spread.gap.bases,
        "edge_gap_most": bases,
        "edge_gap_at": spread.gap.middle.tolist(),
        "edge_gap_scan": spread.gap.photo_id,
        "per_model": spread.per_model,
        "per_model_least": per_model,
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


def coverage_figures(report: AdjustmentReport) -> list[dict[str, Any]]:
    """Used control and tie points in the nine cells of each photo, top row first."""
    block, ties = report.block, report.block.ties
    in_use = np.isfinite(report.tie_residuals_px).all(axis=1)
    coverage: list[dict[str, Any]] = []
    for name, photo in block.photos.items():
        used = [m for m in block.measurements.values() if m.photo_id == name]
        used = [m for m in used if _steers(report, m)]
        control = np.array([[m.column, m.row] for m in used], dtype=np.float64).reshape(-1, 2)
        number = ties.photo_ids.index(name) if name in ties.photo_ids else -1
        tied = ties.pixels[(ties.photo == number) & in_use]
        camera = block.camera_of(name)
        cells = _cells(photo, camera, control)
        coverage.append(
            {
                "scan": name,
                "control": cells,
                "ties": _cells(photo, camera, tied),
                "control_cells": int(np.count_nonzero(cells)),
                "rms_px": _rms([report.residuals_px.get(m.key, (np.nan, np.nan)) for m in used]),
            }
        )
    return coverage


def _steers(report: AdjustmentReport, measurement: Measurement) -> bool:
    role = report.block.surveyed[measurement.point_id].role
    return role == "control" and report.final_status(measurement)[0] in ("auto", "accepted")


def _cells(photo: Photo, camera: Camera, pixels: np.ndarray) -> list[list[int]]:
    film = photo.interior.film_from_pixel(pixels) / np.array(camera.frame_mm) + 0.5
    columns, rows = np.clip((film * CELLS).astype(int), 0, CELLS - 1).T
    counts = np.zeros((CELLS, CELLS), dtype=int)
    np.add.at(counts, (CELLS - 1 - rows, columns), 1)
    return counts.tolist()


def _rms(residuals: list[tuple[float, float]]) -> float | None:
    return float(np.sqrt(np.mean(np.square(residuals)))) if residuals else None


def json_value(value: Any) -> Any:
    """The same value in JSON's own types; what is no number becomes null."""
    if isinstance(value, Mapping):
        # A sentence as a key stays one.
        return {
            key if isinstance(key, str) else str(key): json_value(part)
            for key, part in value.items()
        }
    if isinstance(value, (list, tuple)):
        return [json_value(part) for part in value]
    if isinstance(value, np.ndarray):
        return json_value(value.tolist())
    if isinstance(value, (np.bool_, np.integer)):
        return value.item()
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    return value if isinstance(value, (str, int, bool)) or value is None else str(value)
