"""The photo of the lessons: a frame camera, and where it was exposed."""

import numpy as np

from core.arrays import FilmPoints, ObjectPoints
from core.geometry.camera import Camera
from core.geometry.collinearity import VACUUM
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation, rotation_from_angles
from core.geometry.interior import nominal_interior
from core.geometry.resection import PhotoModel

HALF_MM = 115.0
"""Half the side of the usual frame of 230 mm."""
PIXEL_MM = 0.015
"""Pixel of the archive's scans."""


def camera_with(principal_distance_mm: float, k1: float = 0.0) -> Camera:
    """A camera of a 230 mm frame, without distortion unless k1 (per mm^2) is given."""
    frame = (2 * HALF_MM, 2 * HALF_MM)
    return Camera("lesson", principal_distance_mm, frame, radial_distortion=(k1, 0.0, 0.0))


def vertical_at(east: float, height: float) -> ExteriorOrientation:
    """A photo looking straight down from over a place on the x axis, metres."""
    return ExteriorOrientation(np.array([east, 0.0, height]), 0.0, 0.0, 0.0)


def tilted_at(height: float, tilt: float, direction: float) -> ExteriorOrientation:
    """A photo whose axis leans from the plumb line, in metres and radians.

    Args:
        height: Above the origin of object space, which is the nadir on the ground.
        tilt: Between axis and plumb line.
        direction: Towards which the axis leans, from the x axis counter-clockwise.
    """
    towards, back = (rotation_from_angles(0.0, 0.0, turn) for turn in (direction, -direction))
    # A positive phi turns the axis, which points down, towards -x.
    leaning = towards @ rotation_from_angles(0.0, -tilt, 0.0) @ back
    return ExteriorOrientation(np.array([0.0, 0.0, height]), *angles_from_rotation(leaning))


def on_ground(*places: tuple[float, float, float]) -> ObjectPoints:
    """Object points, metres."""
    return np.array(places, dtype=np.float64)


def on_film(*places: tuple[float, float]) -> FilmPoints:
    """Film points, millimetres."""
    return np.array(places, dtype=np.float64)


def photo_model(principal_distance_mm: float, pixel_mm: float = PIXEL_MM) -> PhotoModel:
    """The photo scanned at 15 um or another pixel, without air or curvature."""
    camera = camera_with(principal_distance_mm)
    side = round(2 * HALF_MM / pixel_mm)
    return PhotoModel(nominal_interior((side, side), camera, pixel_mm), camera, VACUUM)
