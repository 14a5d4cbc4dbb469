"""Intersection: film points of one ground detail in several photos -> object point."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from core.arrays import FilmPoints, Indices, ObjectPoints, Position, Scalars, locked
from core.doubts import Failure
from core.geometry.camera import Camera
from core.geometry.collinearity import (
    Atmosphere,
    RayModel,
    constants_of,
    constants_of_air,
    deformation_of_cameras,
    ray_model,
    rays_from_film,
    stacked_partials,
)
from core.geometry.exterior import ExteriorOrientation

# design: a pixel of 15 um at 200 mm would move the height by 22 m in 3 km.
SMALLEST_ANGLE = 0.01
"""Rays that meet at a smaller angle than this (radians) do not fix a height."""
# design: three times as many as the rule.
STEPS = 10
"""Gauss-Newton steps at most; two or three are the rule."""


@dataclass(frozen=True, slots=True, eq=False)
class Intersection:
    """One object point from two or more rays."""

    position: Position
    """Easting, northing, height, metres."""
    covariance: Float64[np.ndarray, "3 3"]
    """From the standard deviations of the film points alone, square metres."""
    residuals_mm: FilmPoints
    """Residual of each film point, computed minus measured, millimetres."""

    def __post_init__(self) -> None:
        for name in ("position", "covariance", "residuals_mm"):
            object.__setattr__(self, name, locked(getattr(self, name)))


@dataclass(frozen=True, slots=True, eq=False)
class OrientedRay:
    """What is known of the photo a film point lies in."""

    exterior: ExteriorOrientation
    """Exterior orientation."""
    camera: Camera
    """Camera with its constants."""
    atmosphere: Atmosphere
    """Refraction and curvature."""


def intersect(
    film: FilmPoints, sigma_mm: Scalars, photos: Sequence[OrientedRay]
) -> Intersection | Failure:
    """Least squares intersection of film points (millimetres), one row per photo."""
    if len(film) < 2:
        return Failure("One ray alone does not fix a point.", {"rays": len(film)})
    origins = np.array([photo.exterior.centre for photo in photos])
    directions = np.concatenate(
        [
            ray_directions(film[row : row + 1], photo.exterior, photo.camera, photo.atmosphere)
            for row, photo in enumerate(photos)
        ]
    )
    start, angles = closest_points(origins, directions, np.zeros(len(film), dtype=np.int64), 1)
    if not angles[0] >= SMALLEST_ANGLE:
        return Failure("The rays are almost parallel.", {"angle_rad": float(angles[0])})
    return _refine(start[0], film, sigma_mm, origins, _model_of(photos))


def _model_of(photos: Sequence[OrientedRay]) -> RayModel:
    """The photos' constants, one column per ray."""
    cameras = [photo.camera for photo in photos]
    return ray_model(
        np.array([photo.exterior.object_from_image for photo in photos]),
        np.array([constants_of(camera) for camera in cameras]),
        np.concatenate([constants_of_air(photo.atmosphere) for photo in photos]),
        deformation_of_cameras(cameras, np.arange(len(cameras))),
    )


def _refine(
    position: Position, film: FilmPoints, sigma_mm: Scalars, origins: ObjectPoints, model: RayModel
) -> Intersection | Failure:
    """Gauss-Newton on the three coordinates."""
    for _ in range(STEPS):
        partials = stacked_partials((position - origins).T, model)
        design = np.moveaxis(-partials.by_centre / sigma_mm, 1, 2).reshape(-1, 3)
        residuals = partials.film - film.T
        side = (residuals / sigma_mm).ravel()
        if not np.isfinite(side).all():
            return Failure("The point would lie behind a camera.")
        covariance = np.linalg.inv(design.T @ design)
        step = covariance @ (design.T @ side)
        position = position - step
        # design: a ten thousandth of a standard deviation.
        if step @ np.linalg.solve(covariance, step) < 1e-8:
            residuals = stacked_partials((position - origins).T, model).film - film.T
            return Intersection(position, covariance, residuals.T)
    return Failure("The intersection does not settle.")


def ray_directions(
    film: FilmPoints, exterior: ExteriorOrientation, camera: Camera, atmosphere: Atmosphere
) -> ObjectPoints:
    """Unit vectors from the perspective centre through film points towards the ground."""
    rays = rays_from_film(film, exterior, camera, atmosphere)
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def closest_points(
    origins: ObjectPoints, directions: ObjectPoints, point: Indices, count: int
) -> tuple[Float64[np.ndarray, "points 3"], Float64[np.ndarray, "points"]]:
    """Points nearest to all their rays, and about the angle (radians) at which the rays meet.

    `point` numbers the point of each ray, 0 to count - 1. Solves sum (I - d d^T) (X - C) = 0;
    the product of the two large eigenvalues is near the square of the number of rays, so the
    smallest, half the squared angle for two rays, follows from the determinant.
    """
    origin = origins.mean(axis=0) if len(origins) else np.zeros(3)
    local = origins - origin
    along = np.sum(directions * local, axis=1)
    sums = np.empty((9, count))
    for row, (i, j) in enumerate(((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))):
        entry = float(i == j) - directions[:, i] * directions[:, j]
        sums[row] = np.bincount(point, entry, count)
    for axis in range(3):
        entry = local[:, axis] - along * directions[:, axis]
        sums[6 + axis] = np.bincount(point, entry, count)
    rays = np.maximum(np.bincount(point, minlength=count), 1)
    positions, determinant = solve_symmetric3(sums[:6], sums[6:])
    angles = np.sqrt(2 * np.maximum(determinant, 0.0)) / rays
    return np.where((angles > 0)[:, None], positions.T + origin, np.nan), angles


def solve_symmetric3(
    matrix: Float64[np.ndarray, "6 n"], side: Float64[np.ndarray, "3 n"]
) -> tuple[Float64[np.ndarray, "3 n"], Scalars]:
    """Solve many symmetric 3 x 3 systems by cofactors; also returns the determinants.

    The rows of the matrix are its entries 00, 01, 02, 11, 12, 22; singular systems give NaN.
    """
    a, b, c, d, e, f = matrix
    c00, c01, c02 = d * f - e * e, c * e - b * f, b * e - c * d
    c11, c12, c22 = a * f - c * c, b * c - a * e, a * d - b * b
    determinant = a * c00 + b * c01 + c * c02
    inverse = 1.0 / np.where(determinant > 0, determinant, np.nan)
    solution = np.stack(
        [
            c00 * side[0] + c01 * side[1] + c02 * side[2],
            c01 * side[0] + c11 * side[1] + c12 * side[2],
            c02 * side[0] + c12 * side[1] + c22 * side[2],
        ]
    )
    return solution * inverse, determinant
