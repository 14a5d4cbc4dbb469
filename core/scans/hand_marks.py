"""Fiducials that somebody measured and named, in place of found ones."""

from collections.abc import Mapping

import numpy as np

from core.doubts import Doubt
from core.geometry.camera import Camera
from core.geometry.transforms import PlaneTransform, fit_similarity
from core.scans.measured_marks import FiducialMeasurement, FiducialSet

HAND_SIGMA_PX = 0.4
"""What a careful hand can do on a screen, pixels."""


def fiducials_by_hand(
    photo_id: str, camera: Camera, by_hand: Mapping[str, tuple[float, float]]
) -> FiducialSet:
    """Marks as somebody measured and named them; names the certificate lacks are a doubt.

    Args:
        photo_id: The photo.
        camera: Camera with its certified fiducials.
        by_hand: Column and row by name.
    """
    known = {name: place for name, place in by_hand.items() if name in camera.fiducials_mm}
    marks = tuple(
        FiducialMeasurement(name, *known[name], HAND_SIGMA_PX, 1.0, 0.0, "by hand")
        for name in camera.fiducials_mm
        if name in known
    )
    doubts = tuple(
        Doubt(
            "fiducial-doubtful",
            photo_id,
            f"Fiducial {name} was measured by hand, but camera '{camera.name}' has no such mark.",
            evidence={"fiducial": name},
        )
        for name in by_hand
        if name not in known
    )
    if len(marks) < 3:
        return FiducialSet(marks, doubts)
    pixels = np.array([(mark.column, mark.row) for mark in marks])
    film = np.array([camera.fiducials_mm[mark.name] for mark in marks])
    fits = [fit_similarity(pixels, film, mirrored=not back) for back in (False, True)]
    rms = [fit.rms if isinstance(fit, PlaneTransform) else np.inf for fit in fits]
    turn = fits[int(rms[1] < rms[0])]
    quarter = 0
    if isinstance(turn, PlaneTransform):
        # The film is turned in the scan by as much as the scan is turned back on the film.
        angle = np.arctan2(turn.matrix[1, 0], turn.matrix[0, 0])
        quarter = round(float(-angle if rms[0] <= rms[1] else np.pi - angle) / (np.pi / 2)) % 4
    return FiducialSet(marks, doubts, (quarter, bool(rms[1] < rms[0])))
