"""How good the block is: check points, and residuals by class."""

from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float64

from core.arrays import Position
from core.block.adjusted import CheckResult
from core.block.block import UNKNOWN_M, Block, Measurement, SurveyedPoint
from core.doubts import Failure
from core.geometry.intersection import Intersection, OrientedRay, intersect

AXES = ("X", "Y", "Z")


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
        met = _met(block, measurements)
        if isinstance(met, Intersection):
            return _result(point, met.position, len(measurements))
    camera = block.cameras[photos[0].camera]
    height = point.position[2:]
    position = photos[0].object_from_pixel(measurements[0].pixel, height, camera)[0]
    return _result(point, position, 1) if np.isfinite(position).all() else None


def _met(block: Block, measurements: Sequence[Measurement]) -> Intersection | Failure:
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
