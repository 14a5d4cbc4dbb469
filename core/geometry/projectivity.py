"""Projectivity of a plane: how flat ground in one photo lies in another."""

from typing import cast

import cv2
import numpy as np
from jaxtyping import Float64

from core.arrays import Rotation, Scalars
from core.geometry.transforms import PARAMETERS

PlanePoints = Float64[np.ndarray, "n 2"]
"""Points of a plane, any unit."""
Projectivity = Float64[np.ndarray, "3 3"]
"""Homogeneous matrix, target from source."""


def fit_projectivity(source: PlanePoints, target: PlanePoints) -> Projectivity:
    """Projectivity with the least median of squares; a median shift where none can be found."""
    if 2 * len(source) >= PARAMETERS["projective"]:
        found = cast(Rotation | None, cv2.findHomography(source, target, cv2.LMEDS)[0])
        if found is not None and np.shape(found) == (3, 3):
            return np.asarray(found, dtype=np.float64)
    shift = np.eye(3)
    if len(source):
        shift[:2, 2] = np.median(target - source, axis=0)
    return shift


def apply_projectivity(matrix: Projectivity, points: PlanePoints) -> PlanePoints:
    """Where a projectivity puts points."""
    return (points @ matrix[:2, :2].T + matrix[:2, 2]) / _depth(matrix, points)[:, None]


def jacobians(matrix: Projectivity, points: PlanePoints) -> Float64[np.ndarray, "n 2 2"]:
    """Derivatives of a projectivity at points."""
    moved = apply_projectivity(matrix, points)
    rows = matrix[None, :2, :2] - moved[:, :, None] * matrix[None, 2:, :2]
    return rows / _depth(matrix, points)[:, None, None]


def _depth(matrix: Projectivity, points: PlanePoints) -> Scalars:
    """The third homogeneous coordinate."""
    return points @ matrix[2, :2] + matrix[2, 2]
