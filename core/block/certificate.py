"""May the mosaic be given out? Only where what is predicted of it is good and can be believed."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from core.block.adjusted import AdjustmentReport
from core.block.foresight import Foresight
from core.block.quality import QualityLimits

LIMIT_M = 0.8
"""Position error on the ground up to which a block is certified, metres."""
LIMIT_PX = 1.3
"""The same in pixels of the scans, where they are coarse."""
Reason = Literal["diverged", "sigma-nought", "loose", "control-few", "predicted"]


@dataclass(frozen=True, slots=True)
class Certificate:
    """What is predicted of the block's ground, and why it is not certified, if it is not."""

    predicted_m: float
    """Standard deviation of position, RMS over nine places of all photos, that of the reference
    included, metres; NaN where nothing was adjusted."""
    worst_m: float
    """The largest of all places, metres."""
    worst_photo: str
    """The photo that shows it; empty without one."""
    limit_m: float
    """What is predicted may not be larger than this, metres."""
    reasons: tuple[Reason, ...]
    """Why the block is not certified; none: it is."""


def certify(
    report: AdjustmentReport, foresight: Foresight | None, ortho_sigma_m: float
) -> Certificate:
    """Judge an adjusted block by what its own figures predict.

    An error that all control shares no figure of the block can show: check points can.

    Args:
        report: The adjustment.
        foresight: Its equations; None where no photo took part.
        ortho_sigma_m: Standard deviation of the reference per axis, metres.
    """
    limits = QualityLimits()
    sigmas = {} if foresight is None else foresight.corner_sigmas()
    scale = report.sigma_nought if np.isfinite(report.sigma_nought) else 1.0
    places = {name: scale**2 * np.sum(s**2, axis=1) for name, s in sigmas.items()}
    shared = 2 * ortho_sigma_m**2
    every = np.concatenate([np.zeros(0), *places.values()])
    predicted = float(np.sqrt(every.mean() + shared)) if len(every) else float("nan")
    worst = max(places, key=lambda name: float(places[name].max()), default="")
    worst_m = float(np.sqrt(places[worst].max() + shared)) if worst else float("nan")
    block = report.block
    pixels = [photo.ground_pixel_m(block.camera_of(name)) for name, photo in block.photos.items()]
    limit = max(LIMIT_M, LIMIT_PX * float(np.median(pixels)))
    low, high = limits.sigma_nought
    found: dict[Reason, bool] = {
        "diverged": not report.converged,
        "sigma-nought": not low <= report.sigma_nought <= high,
        "loose": not all(photo.oriented for photo in block.photos.values()),
        "control-few": len(report.surveyed_positions) < limits.control.block_points,
        "predicted": not predicted <= limit,
    }
    return Certificate(
        predicted, worst_m, worst, limit, tuple(reason for reason, holds in found.items() if holds)
    )
