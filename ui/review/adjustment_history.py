"""Adjustments of this sitting, small enough to keep: to compare any two of them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from core.adjustment.adjusted import AdjustmentReport
from core.block import Block, Photo
from core.geometry.camera import Camera
from ui.review.compare import shift_px
from ui.review.picture import position_error_m
from ui.review.state import DeskState

KEPT = 60
"""So many are kept; the first one always."""


@dataclass(frozen=True, slots=True, eq=False)
class AdjustmentRecord:
    """One adjustment, without its residuals."""

    number: int
    """Counts from 1."""
    decided: int
    """Decisions it rests on."""
    sigma_nought: float
    """Standard deviation of unit weight."""
    position_error_m: float | None
    """m_p of the check points; None without any."""
    rms_px: Mapping[str, float]
    """RMS residual by class, pixels."""
    used: int
    """Control measurements in use."""
    photos: Mapping[str, tuple[Photo, Camera]]
    """Orientations."""


def record_of(
    report: AdjustmentReport, block: Block, decided: int, number: int
) -> AdjustmentRecord:
    """What is kept of an adjustment."""
    adjusted = report.block
    used = sum(
        item.used and key not in report.rejected and block.surveyed[key[0]].role == "control"
        for key, item in adjusted.measurements.items()
        if key[0] in block.surveyed
    )
    photos = {name: (photo, adjusted.camera_of(name)) for name, photo in adjusted.photos.items()}
    error = position_error_m(report)
    return AdjustmentRecord(
        number, decided, report.sigma_nought, error, dict(report.rms_px), used, photos
    )


def with_adjustment(
    kept: tuple[AdjustmentRecord, ...], report: AdjustmentReport, state: DeskState
) -> tuple[AdjustmentRecord, ...]:
    """The list with one more; the first stays, old ones behind it go."""
    number = kept[-1].number + 1 if kept else 1
    longer = (*kept, record_of(report, state.block, state.decided, number))
    return longer if len(longer) <= KEPT else (longer[0], *longer[2:])


def record_line(one: AdjustmentRecord) -> dict[str, Any]:
    """An adjustment in the list."""
    return {
        "number": one.number, "decided": one.decided, "used": one.used,
        "sigma": round(one.sigma_nought, 4),
        "mp": None if one.position_error_m is None else round(one.position_error_m, 3),
        "rms": {name: round(value, 3) for name, value in one.rms_px.items() if value == value},
    }  # fmt: skip


def shifts_m(one: AdjustmentRecord, other: AdjustmentRecord) -> dict[str, float]:
    """How far each photo's corners moved at most between two adjustments, metres on the ground."""
    return {
        name: shift_px(*one.photos[name], photo, camera) * photo.ground_pixel_m(camera)
        for name, (photo, camera) in other.photos.items()
        if name in one.photos
    }
