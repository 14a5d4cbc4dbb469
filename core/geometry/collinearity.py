"""Collinearity: object point, perspective centre and film point lie on one line."""

import numpy as np

from core.arrays import FilmPoints, ObjectPoints, Scalars
from core.geometry.atmosphere import Atmosphere
from core.geometry.camera import Camera, radial_factor
from core.geometry.deformation import deformation_of
from core.geometry.exterior import ExteriorOrientation

VACUUM = Atmosphere()
# design: a micrometre in front of the camera nothing stands.
BEHIND = 1e-6
"""A depth below this (metres) counts as behind the camera: its film point is NaN."""


def film_from_object(
    points: ObjectPoints,
    exterior: ExteriorOrientation,
    camera: Camera,
    atmosphere: Atmosphere = VACUUM,
) -> FilmPoints:
    """Project object points onto the film of one photo, with lens, refraction and curvature.

    Args:
        points: Object points (easting, northing, height) in the block's CRS, metres.
        exterior: Exterior orientation of the photo.
        camera: Camera with its constants.
        atmosphere: Refraction and Earth curvature of the photo.

    Returns:
        Film points (x right, y up), millimetres; NaN for points behind the camera.
    """
    offset = points - exterior.centre
    offset[:, 2] -= atmosphere.curvature_per_m * (offset[:, 0] ** 2 + offset[:, 1] ** 2)
    image = offset @ exterior.object_from_image
    depth = np.where(image[:, 2] < -BEHIND, image[:, 2], np.nan)
    ideal = -camera.principal_distance_mm * image[:, :2] / depth[:, None]
    factor = image_factor(np.sum(ideal**2, axis=1), camera, atmosphere)
    film = ideal * factor[:, None] + np.array(camera.principal_point_mm)
    return film + _deformation(ideal, camera) if camera.deformation_mm else film


def _deformation(ideal: FilmPoints, camera: Camera) -> FilmPoints:
    """Shift of ideal film points by the camera's additional parameters, millimetres."""
    return deformation_of(ideal, np.array(camera.deformation_mm), camera.half_mm)


def image_factor(radius_squared: Scalars, camera: Camera, atmosphere: Atmosphere) -> Scalars:
    """Factor on the ideal image vector: lens distortion plus refraction K (1 + r^2 / c^2)."""
    bend = atmosphere.refraction * (1 + radius_squared / camera.principal_distance_mm**2)
    return radial_factor(radius_squared, camera) + bend


def ideal_from_film(film: FilmPoints, camera: Camera, atmosphere: Atmosphere) -> FilmPoints:
    """Undo lens distortion and refraction: the ideal central projection, from the principal point.

    Fixed-point iteration; converges to below 1e-9 mm for lens errors of film cameras.
    """
    measured = film - np.array(camera.principal_point_mm)
    ideal = measured
    for _ in range(12):
        factor = image_factor(np.sum(ideal**2, axis=1), camera, atmosphere)
        shifted = measured - _deformation(ideal, camera) if camera.deformation_mm else measured
        ideal = shifted / factor[:, None]
    return ideal


def object_from_film(
    film: FilmPoints,
    heights: Scalars,
    exterior: ExteriorOrientation,
    camera: Camera,
    atmosphere: Atmosphere = VACUUM,
) -> ObjectPoints:
    """Follow the rays of film points down to given heights (metres), Earth curvature included."""
    ideal = ideal_from_film(film, camera, atmosphere)
    depth = np.full((len(film), 1), -camera.principal_distance_mm)
    ray = np.hstack([ideal, depth]) @ exterior.object_from_image.T
    drop = heights - exterior.centre[2]
    for _ in range(3):
        plane = ray[:, :2] / ray[:, 2:] * drop[:, None]
        drop = heights - exterior.centre[2] - atmosphere.curvature_per_m * np.sum(plane**2, axis=1)
    plane = ray[:, :2] / ray[:, 2:] * drop[:, None]
    return np.column_stack([plane + exterior.centre[:2], heights])
