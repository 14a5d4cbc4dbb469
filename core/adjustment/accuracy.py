"""Accuracy of a block: differences at check points, what was predicted, residuals by class."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy import sparse
from scipy.special import chdtri

from core.adjustment.adjusted import CheckResult
from core.adjustment.equations import Equations
from core.arrays import Position
from core.block import UNKNOWN_M, Block, Measurement, SurveyedPoint
from core.doubts import Failure
from core.geometry.intersection import Intersection, OrientedRay, intersect

AXES = ("X", "Y", "Z")
# design: one good point in a thousand is lost; what lies beyond is mostly a wrong detail.
LEAST_CHANCE = 1e-3
"""Rays that miss each other by more than this chance explains tell nothing of the pointing."""
# design: as readings of one measurement (`sessions/readings.py`): one pair of coordinates.
STATED_COORDINATES = 2.0
"""What is stated of the pointing weighs as many coordinates as this."""


def predicted_residuals(block: Block) -> dict[tuple[str, str], tuple[float, float]]:
    """Where each surveyed point should be in each photo, minus where it was measured, pixels.

    With the points' known coordinates and the photos' present orientations, oriented or not.
    """
    by_photo: dict[str, list[Measurement]] = defaultdict(list)
    for measurement in block.measurements.values():
        by_photo[measurement.photo_id].append(measurement)
    residuals: dict[tuple[str, str], tuple[float, float]] = {}
    for photo_id, measurements in by_photo.items():
        photo = block.photos[photo_id]
        known = np.array([block.surveyed[m.point_id].position for m in measurements])
        with np.errstate(over="ignore", invalid="ignore"):
            predicted = photo.pixel_from_object(known, block.camera_of(photo_id))
        for measurement, (column, row) in zip(measurements, predicted, strict=True):
            off = (float(column) - measurement.column, float(row) - measurement.row)
            residuals[measurement.key] = off
    return {key: residuals[key] for key in block.measurements}


def intersect_checks(block: Block) -> tuple[CheckResult, ...]:
    """Check points from the oriented photos in which they are measured."""
    rays: dict[str, list[Measurement]] = defaultdict(list)
    for measurement in block.measurements.values():
        role = block.surveyed[measurement.point_id].role
        if role == "check" and measurement.used and block.photos[measurement.photo_id].oriented:
            rays[measurement.point_id].append(measurement)
    results = (
        _check(block, block.surveyed[name], measurements)
        for name, measurements in sorted(rays.items())
    )
    return tuple(result for result in results if result is not None)


def _check(
    block: Block, point: SurveyedPoint, measurements: Sequence[Measurement]
) -> CheckResult | None:
    """One check point; with one photo, or rays that do not meet, at its known height."""
    photos = [block.photos[m.photo_id] for m in measurements]
    if len(measurements) > 1:
        met = _intersect_rays(block, measurements)
        if isinstance(met, Intersection):
            return _result(point, met.position, len(measurements))
    camera = block.cameras[photos[0].camera]
    height = point.position[2:]
    position = photos[0].object_from_pixel(measurements[0].pixel, height, camera)[0]
    return _result(point, position, 1) if np.isfinite(position).all() else None


def _intersect_rays(block: Block, measurements: Sequence[Measurement]) -> Intersection | Failure:
    """Intersection of the rays of one point."""
    photos = [block.photos[m.photo_id] for m in measurements]
    pairs = list(zip(photos, measurements, strict=True))
    film = [photo.interior.film_from_pixel(m.pixel) for photo, m in pairs]
    sigma = [photo.interior.pixel_size_mm * m.sigma_px for photo, m in pairs]
    rays = [OrientedRay(p.exterior, block.cameras[p.camera], p.atmosphere) for p in photos]
    return intersect(np.concatenate(film), np.array(sigma), rays)


def _result(point: SurveyedPoint, position: Position, used_scans: int) -> CheckResult:
    return CheckResult(point.point_id, position, position - point.position, used_scans)


def rms_by_class(
    block: Block,
    residuals: Mapping[tuple[str, str], tuple[float, float]],
    control: frozenset[tuple[str, str]],
    ties: Float64[np.ndarray, "rays 2"],
) -> dict[str, float]:
    """RMS residual per coordinate of ties, used control and check points, pixels; NaN if none."""
    checks = [
        key
        for key, measurement in block.measurements.items()
        if block.surveyed[key[0]].role == "check"
        and measurement.used
        and block.photos[key[1]].oriented
    ]
    return {
        "tie": _rms(ties[np.isfinite(ties)]),
        "control": _rms(np.array([residuals[key] for key in sorted(control)])),
        "check": _rms(np.array([residuals[key] for key in checks])),
    }


def known_differences(
    block: Block, surveyed: Mapping[str, Position], checks: Sequence[CheckResult]
) -> dict[str, float]:
    """RMS of adjusted minus known coordinates of control and check points, metres; NaN if none."""
    control = [
        np.where(block.surveyed[name].sigma_m < UNKNOWN_M, position, np.nan)
        - block.surveyed[name].position
        for name, position in surveyed.items()
    ]
    check = [result.difference_m for result in checks]
    # A height that was taken from the point itself tells nothing.
    heights = [result.difference_m[2] for result in checks if result.used_scans > 1]
    table: dict[str, float] = {}
    for axis, name in enumerate(AXES):
        table[f"control_{name}"] = _rms(np.array([difference[axis] for difference in control]))
        values = heights if name == "Z" else [difference[axis] for difference in check]
        table[f"check_{name}"] = _rms(np.array(values))
    return table


def _rms(values: Float64[np.ndarray, "..."]) -> float:
    """Root mean square of what is a number, NaN of nothing."""
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


@dataclass(frozen=True, slots=True, eq=False)
class CheckPrediction:
    """What the adjustment says of one computed check point, in the standard deviations stated."""

    by_unknowns: sparse.csr_array
    """Its coordinates (E, N, and H where rays meet) by photos and cameras, metres per unit: of all
    unknowns only few take part."""
    own: Float64[np.ndarray, "axes axes"]
    """Covariance that its own measurements bring, square metres."""
    left: sparse.csr_array
    """What its rays miss each other by, by photos and cameras; as many rows as coordinates."""
    redundancy: int
    """So many coordinates of its rays are more than the point needs."""
    misclosure: float
    """Sum of squares of what its rays miss each other by."""


def check_predictions(
    equations: Equations, block: Block, checks: Sequence[CheckResult]
) -> dict[str, CheckPrediction]:
    """How computed check points hang on photos, cameras and their own measurements.

    X = -(B^T B)^-1 B^T (A d + e) with the rays' derivatives A by photos and cameras, B by the
    point, all in standard deviations; the known coordinates' own error is not in it.

    Args:
        equations: The adjusted block's equations.
        block: The adjusted block.
        checks: Its check points.
    """
    photo_row = {p.photo_id: row for row, p in enumerate(equations.solution.network.photos)}
    rays: dict[str, list[Measurement]] = defaultdict(list)
    for item in block.measurements.values():
        if (
            item.used
            and item.photo_id in photo_row
            and block.surveyed[item.point_id].role == "check"
        ):
            rays[item.point_id].append(item)
    found: dict[str, CheckPrediction] = {}
    for check in checks:
        items = rays[check.point_id][:1] if check.used_scans == 1 else rays[check.point_id]
        if items:
            photos = [photo_row[item.photo_id] for item in items]
            found[check.point_id] = _prediction(equations, block, items, photos, check)
    return found


def _prediction(
    equations: Equations,
    block: Block,
    items: Sequence[Measurement],
    photos: Sequence[int],
    check: CheckResult,
) -> CheckPrediction:
    """One point; with one ray at a height that is taken as true."""
    parts = [
        equations.of_free_ray(photo, item, check.position)
        for photo, item in zip(photos, items, strict=True)
    ]
    rows = np.concatenate([part[0] for part in parts])
    by_point = np.concatenate([part[1] for part in parts])
    design = by_point[:, : 3 if len(items) > 1 else 2]
    inverse = np.linalg.inv(design.T @ design)
    by_unknowns = inverse @ design.T @ rows
    shown = [(block.photos[item.photo_id], block.camera_of(item.photo_id)) for item in items]
    misses = [
        (photo.pixel_from_object(check.position[None], camera) - item.pixel) / item.sigma_px
        for (photo, camera), item in zip(shown, items, strict=True)
    ]
    return CheckPrediction(
        sparse.csr_array(by_unknowns),
        inverse,
        left=sparse.csr_array(rows - design @ by_unknowns),
        redundancy=len(design) - design.shape[1],
        misclosure=float(np.sum(np.square(misses))),
    )


def pointing_variance(
    equations: Equations, predictions: Mapping[str, CheckPrediction], scale: float
) -> float:
    """How the pointing at check points scatters, as the square of what is stated of it.

    By how far the rays of each point miss each other, less what the orientations bring to that;
    a few coordinates of what is stated, for a sigma nought of `scale`, weigh along. Points whose
    rays miss each other by more than chance can explain do not count.
    """
    some = [one for one in predictions.values() if one.redundancy > 0]
    brought = [np.trace(part) for part in equations.covariances([one.left for one in some])]
    excess = np.array(
        [
            (one.misclosure - scale**2 * part) / one.redundancy
            for one, part in zip(some, brought, strict=True)
        ]
    )
    freedom = np.array([float(one.redundancy) for one in some])
    usual = float(np.median(np.maximum(excess, 0.0))) if some else scale**2
    most = max(usual, scale**2) * chdtri(freedom, LEAST_CHANCE) / freedom
    good = excess <= most
    total = max(float(excess[good] @ freedom[good]), 0.0) + STATED_COORDINATES * scale**2
    return total / (float(freedom[good].sum()) + STATED_COORDINATES)


def check_sigmas(
    equations: Equations,
    predictions: Mapping[str, CheckPrediction],
    scale: float,
    pointing: float,
) -> dict[str, Position]:
    """Standard deviations (E, N, H) of computed check points, metres.

    Args:
        equations: The adjusted block's equations.
        predictions: Of its check points.
        scale: Sigma nought.
        pointing: As `pointing_variance` finds it.
    """
    sigmas: dict[str, Position] = {}
    blocks = equations.covariances([one.by_unknowns for one in predictions.values()])
    for (name, one), block in zip(predictions.items(), blocks, strict=True):
        covariance = scale**2 * block + pointing * one.own
        sigmas[name] = np.zeros(3)
        sigmas[name][: len(covariance)] = np.sqrt(np.diag(covariance))
    return sigmas


def check_freedom(
    equations: Equations,
    block: Block,
    predictions: Mapping[str, CheckPrediction],
    scale: float,
    pointing: float,
) -> float:
    """So many independent errors the plan of the independent check points is worth together.

    They share what the block is off, so that the sum of their squared differences scatters more
    than that of as many errors of their own: tr(C)^2 / tr(C^2), C their covariance with the error
    of the survey (Satterthwaite 1946). Nought without any.
    """
    independent = block.independent_checks
    names = [name for name in predictions if name in independent]
    if not names:
        return 0.0
    rows = sparse.vstack([predictions[name].by_unknowns[:2] for name in names]).toarray()
    total = scale**2 * rows @ equations.cofactors(rows)
    for place, name in enumerate(names):
        part = slice(2 * place, 2 * place + 2)
        survey = np.diag(block.surveyed[name].sigma_m[:2] ** 2)
        total[part, part] += pointing * predictions[name].own[:2, :2] + survey
    return float(np.trace(total) ** 2 / np.sum(total**2))
