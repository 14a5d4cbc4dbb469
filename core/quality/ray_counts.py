"""Tie points by the number of their rays, within one strip and across several."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from core.adjustment.adjusted import AdjustmentReport
from core.adjustment.positioning import strips_of


@dataclass(frozen=True, slots=True, eq=False)
class RayCounts:
    """How many tie points have how many rays."""

    strip: dict[str, int]
    """Number of the strip of each photo that takes part."""
    within: dict[int, int]
    """Tie points by their rays, all of one strip."""
    across: dict[int, int]
    """Tie points by their rays, of two strips and more."""
    by_photo: dict[str, dict[int, int]]
    """Tie points in each photo by the number of their rays in all."""


def ray_counts_of(report: AdjustmentReport) -> RayCounts:
    """Count the rays that took part in an adjustment."""
    block, ties = report.block, report.block.ties
    photos = [block.photos[name] for name in report.exterior_sigmas]
    cameras = [block.camera_of(photo.photo_id) for photo in photos]
    sides = [
        camera.frame_mm[0]
        / camera.principal_distance_mm
        * abs(float(photo.exterior.centre[2]) - photo.ground_height_m)
        for photo, camera in zip(photos, cameras, strict=True)
    ]
    numbers = strips_of(photos, sides).tolist() if photos else []
    strip = {photo.photo_id: number for photo, number in zip(photos, numbers, strict=True)}
    used = np.isfinite(report.tie_residuals_px).all(axis=1)
    point, photo = ties.point[used], ties.photo[used]
    of_photo = np.array([strip.get(name, -1) for name in ties.photo_ids] + [-1])
    rays = np.bincount(point, minlength=ties.count)
    lowest, highest = np.full((2, ties.count), -1)
    lowest[:] = len(photos)
    np.minimum.at(lowest, point, of_photo[photo])
    np.maximum.at(highest, point, of_photo[photo])
    seen = rays > 0
    return RayCounts(
        strip,
        _counted(rays[seen & (lowest == highest)]),
        _counted(rays[seen & (lowest != highest)]),
        {
            name: _counted(rays[point[photo == row]])
            for row, name in enumerate(ties.photo_ids)
            if name in strip
        },
    )


def _counted(rays: Int[np.ndarray, "points"]) -> dict[int, int]:
    counts = np.bincount(rays)
    return {number: int(count) for number, count in enumerate(counts) if count}
