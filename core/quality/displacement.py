"""Error of a photo's georeference: assumed minus final position."""

from dataclasses import dataclass, replace

import numpy as np

from core.arrays import PlanPosition
from core.block import Photo
from core.doubts import Failure
from core.geometry.camera import Camera
from core.geometry.transforms import fit_similarity, rotation_and_scale

# source: the nine Gruber places of a photo.
SHARES = np.stack(np.meshgrid([0.1, 0.5, 0.9], [0.1, 0.5, 0.9]), axis=-1).reshape(-1, 2)
"""Places over the frame, shares of its width and height."""


@dataclass(frozen=True, slots=True, eq=False)
class Displacement:
    """From the approximate orientation to the present one, on level ground under the frame."""

    shift_m: PlanPosition
    """Mean shift, easting and northing, metres."""
    turn: float
    """Turn, radians, counter-clockwise."""
    scale: float
    """Change of scale, 1 = none."""
    rms_m: float
    """RMS of the shifts over the frame, metres."""


def displacement(photo: Photo, camera: Camera) -> Displacement:
    """How far the photo's approximate orientation showed the ground from where it lies.

    Args:
        photo: With the orientation it came with and the one it has now.
        camera: Its camera.
    """
    pixels = SHARES * np.array(photo.size_px)
    heights = np.full(len(pixels), photo.ground_height_m)
    believed = replace(photo, exterior=photo.approximate)
    before = believed.object_from_pixel(pixels, heights, camera)[:, :2]
    after = photo.object_from_pixel(pixels, heights, camera)[:, :2]
    apart = after - before
    fitted = fit_similarity(before, after)
    turn, scale = (0.0, 1.0) if isinstance(fitted, Failure) else rotation_and_scale(fitted.matrix)
    rms = float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))
    return Displacement(apart.mean(axis=0), turn, scale, rms)
