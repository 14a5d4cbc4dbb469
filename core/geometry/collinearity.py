"""Collinearity: object point, perspective centre and film point lie on one line.

What bends that line, refraction and the curvature of the earth, is a photo's `Atmosphere`.

One photo's points come first; then rays of many photos at once, with their derivatives.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int

from core.arrays import FilmPoints, ObjectPoints, Scalars
from core.geometry.camera import (
    TERMS,
    Camera,
    Coefficients,
    deformation_of,
    radial_factor,
    shifts,
    slopes,
)
from core.geometry.exterior import ExteriorOrientation

# source: mean radius of GRS 80.
EARTH_RADIUS_M = 6_371_000.0
BERTRAM = (2410.0, 6.0, 250.0)  # source: Bertram 1966, for heights in kilometres.
"""Constants of `refraction_constant`, in the order of its formula."""
# design: a micrometre in front of the camera nothing stands.
BEHIND = 1e-6
"""A depth below this (metres) counts as behind the camera: its film point is NaN."""
Offsets = Float64[np.ndarray, "3 rays"]
"""Object point minus perspective centre, metres, one column per ray."""
Rotations = Float64[np.ndarray, "photos 3 3"]
"""A stack of rotation matrices, image space into object space."""
Vectors = Float64[np.ndarray, "photos 3"]
"""A stack of vectors."""


CORRECTIONS = ("refraction", "curvature")
"""What rays are corrected for, where nothing else is said."""


@dataclass(frozen=True, slots=True)
class Atmosphere:
    """The two physical corrections of one photo, both nought by default."""

    refraction: float = 0.0
    """K of dr = K (r + r^3 / c^2), dimensionless; moves image points outwards."""
    curvature_per_m: float = 0.0
    """1 / (2 R) per metre: a point at distance d from the nadir appears d^2 / (2 R) lower."""


VACUUM = Atmosphere()


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
    return film_from_ideal(
        -camera.principal_distance_mm * image[:, :2] / depth[:, None], camera, atmosphere
    )


def squared_lengths(plane: Float64[np.ndarray, "n 2"]) -> Scalars:
    """Of vectors in the plane; `np.sum` over an axis of two takes twenty times as long."""
    return plane[:, 0] ** 2 + plane[:, 1] ** 2


def film_from_ideal(ideal: FilmPoints, camera: Camera, atmosphere: Atmosphere) -> FilmPoints:
    """Lens distortion and refraction of ideal points about the principal point; film frame, mm."""
    factor = image_factor(squared_lengths(ideal), camera, atmosphere)
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
        factor = image_factor(squared_lengths(ideal), camera, atmosphere)
        shifted = measured - _deformation(ideal, camera) if camera.deformation_mm else measured
        before, ideal = ideal, shifted / factor[:, None]
        if np.array_equal(before, ideal):
            break
    return ideal


def rays_from_film(
    film: FilmPoints, exterior: ExteriorOrientation, camera: Camera, atmosphere: Atmosphere
) -> ObjectPoints:
    """Vectors from the perspective centre to film points in object space, millimetres of film."""
    ideal = ideal_from_film(film, camera, atmosphere)
    depth = np.full((len(film), 1), -camera.principal_distance_mm)
    return np.hstack([ideal, depth]) @ exterior.object_from_image.T


def object_on_rays(
    rays: ObjectPoints, heights: Scalars, exterior: ExteriorOrientation, atmosphere: Atmosphere
) -> ObjectPoints:
    """Where rays reach given heights (metres), Earth curvature included."""
    slope = rays[:, :2] / rays[:, 2:]
    drop = below = heights - exterior.centre[2]
    for _ in range(3):
        plane = slope * drop[:, None]
        drop = below - atmosphere.curvature_per_m * squared_lengths(plane)
    return np.column_stack([slope * drop[:, None] + exterior.centre[:2], heights])


def object_from_film(
    film: FilmPoints,
    heights: Scalars,
    exterior: ExteriorOrientation,
    camera: Camera,
    atmosphere: Atmosphere = VACUUM,
) -> ObjectPoints:
    """Follow the rays of film points down to given heights (metres), Earth curvature included."""
    rays = rays_from_film(film, exterior, camera, atmosphere)
    return object_on_rays(rays, heights, exterior, atmosphere)


@dataclass(frozen=True, slots=True, eq=False)
class Deformation:
    """The additional parameters of the cameras of some rays."""

    coefficients: Coefficients
    """Of each camera, millimetres."""
    half_mm: Float64[np.ndarray, "groups"]
    """What the coordinates of each are counted in."""
    group: Int[np.ndarray, "rays"]
    """Camera of each ray."""


@dataclass(frozen=True, slots=True, eq=False)
class RayModel:
    """What turns an offset into film coordinates, one column per ray."""

    rotation: Float64[np.ndarray, "3 3 rays"]
    """R = R_omega R_phi R_kappa, from image space into object space."""
    constants: Float64[np.ndarray, "6 rays"]
    """Principal distance, x0, y0 (mm), k1, k2, k3 (per mm^2, mm^4, mm^6)."""
    atmosphere: Float64[np.ndarray, "2 rays"]
    """Refraction K (dimensionless) and curvature 1 / (2 R) (per metre)."""
    deformation: Deformation | None = None
    """Additional parameters, if any camera has some."""


@dataclass(frozen=True, slots=True, eq=False)
class FilmPartials:
    """Film coordinates and their derivatives; NaN for points behind the camera."""

    film: Float64[np.ndarray, "2 rays"]
    """x right, y up, film frame, millimetres."""
    by_centre: Float64[np.ndarray, "2 3 rays"]
    """By the perspective centre, mm per metre; by the object point it is the negative of this."""
    by_rotation: Float64[np.ndarray, "2 3 rays"]
    """By a rotation increment w about the image axes, R exp[w], mm per radian."""
    by_camera: Float64[np.ndarray, "2 5 rays"]
    """By principal distance, x0, y0 (mm per mm), k1 and k2 (mm per unit)."""
    ideal: Float64[np.ndarray, "2 rays"]
    """Ideal image coordinates from the principal point, millimetres."""


def film_partials(
    points: ObjectPoints,
    exterior: ExteriorOrientation,
    camera: Camera,
    atmosphere: Atmosphere = VACUUM,
) -> FilmPartials:
    """Film coordinates of object points (metres) in one photo, with derivatives."""
    model = ray_model(
        exterior.object_from_image[None], constants_of(camera)[None], constants_of_air(atmosphere)
    )
    single = np.zeros(len(points), dtype=np.int64)
    rays = RayModel(
        model.rotation[:, :, single],
        model.constants[:, single],
        model.atmosphere[:, single],
        deformation_of_cameras([camera], single),
    )
    return stacked_partials((points - exterior.centre).T, rays)


def deformation_of_cameras(
    cameras: Sequence[Camera], group: Int[np.ndarray, "rays"]
) -> Deformation | None:
    """The cameras' own deformation, None where none has any; `group` is the camera of each ray."""
    if not any(camera.deformation_mm for camera in cameras):
        return None
    coefficients = np.zeros((len(cameras), 2, TERMS))
    for row, camera in enumerate(cameras):
        if camera.deformation_mm:
            coefficients[row] = np.reshape(camera.deformation_mm, (2, TERMS))
    return Deformation(coefficients, np.array([camera.half_mm for camera in cameras]), group)


def constants_of(camera: Camera) -> Float64[np.ndarray, "6"]:
    """Principal distance, principal point and k1, k2, k3 as an array."""
    return np.array(
        [camera.principal_distance_mm, *camera.principal_point_mm, *camera.radial_distortion]
    )


def constants_of_air(atmosphere: Atmosphere) -> Float64[np.ndarray, "1 2"]:
    """Refraction and curvature as an array of one row."""
    return np.array([[atmosphere.refraction, atmosphere.curvature_per_m]])


def ray_model(
    rotations: Rotations,
    constants: Float64[np.ndarray, "photos 6"],
    atmospheres: Float64[np.ndarray, "photos 2"],
    deformation: Deformation | None = None,
) -> RayModel:
    """Rows turned into columns."""
    return RayModel(
        np.ascontiguousarray(np.moveaxis(rotations, 0, -1)),
        np.ascontiguousarray(constants.T),
        np.ascontiguousarray(atmospheres.T),
        deformation,
    )


def stacked_partials(offsets: Offsets, rays: RayModel) -> FilmPartials:
    """Film coordinates and derivatives of rays that may belong to different photos.

    With u, v the ideal image coordinates and s = u^2 + v^2 the film point is
    (x0, y0) + (u, v) f, f = 1 + k1 s + k2 s^2 + k3 s^3 + K (1 + s / c^2).
    """
    c = rays.constants[0]
    u, v, depth = _ideal(offsets, rays)
    s = u * u + v * v
    factor, slope = _factor_and_slope(s, rays)
    # The lens: how the film point follows the ideal point.
    uu, uv, vv = factor + slope * u * u, slope * u * v, factor + slope * v * v
    vu, film = uv, np.stack([u * factor + rays.constants[1], v * factor + rays.constants[2]])
    if rays.deformation is not None:
        bent, bends = _deformed(u, v, rays.deformation)
        film, uu, uv = film + bent, uu + bends[0, 0], uv + bends[0, 1]
        vu, vv = vu + bends[1, 0], vv + bends[1, 1]
    by_image = np.empty((2, 3, len(c)))
    _centre_partials(by_image, offsets, rays, u, v=v, depth=depth)
    by_angle = np.array([[-u * v / c, c + u * u / c, v], [-c - v * v / c, u * v / c, -u]])
    refraction_by_c = -2.0 * rays.atmosphere[0] * s / c**3
    zero, one = np.zeros_like(c), np.ones_like(c)
    camera_u = (u / c * (uu + refraction_by_c * c) + uv * v / c, one, zero, u * s, u * s * s)
    camera_v = (v / c * (vv + refraction_by_c * c) + vu * u / c, zero, one, v * s, v * s * s)
    return FilmPartials(
        film=film,
        by_centre=_through_lens(by_image, uu, uv, vu, vv=vv),
        by_rotation=_through_lens(by_angle, uu, uv, vu, vv=vv),
        by_camera=np.array([camera_u, camera_v]),
        ideal=np.stack([u, v]),
    )


def _deformed(
    u: Scalars, v: Scalars, deformation: Deformation
) -> tuple[Float64[np.ndarray, "2 rays"], Float64[np.ndarray, "2 2 rays"]]:
    """Shift of ideal points by the additional parameters, and its derivatives by the points."""
    half = deformation.half_mm[deformation.group]
    bent = shifts(u / half, v / half, deformation.coefficients, deformation.group)
    return bent, slopes(u / half, v / half, deformation.coefficients, deformation.group) / half


def _ideal(offsets: Offsets, rays: RayModel) -> tuple[Scalars, Scalars, Scalars]:
    """Ideal image coordinates (mm, from the principal point) and depth (m, negative in front)."""
    east, north = offsets[0], offsets[1]
    up = offsets[2] - rays.atmosphere[1] * (east * east + north * north)
    x, y, z = (
        rays.rotation[0, axis] * east + rays.rotation[1, axis] * north + rays.rotation[2, axis] * up
        for axis in range(3)
    )
    depth = np.where(z < -BEHIND, z, np.nan)
    scale = -rays.constants[0] / depth
    return scale * x, scale * y, depth


def _factor_and_slope(s: Scalars, rays: RayModel) -> tuple[Scalars, Scalars]:
    """Factor f on the ideal image vector, and 2 df/ds."""
    c, _, _, k1, k2, k3 = rays.constants
    bend = rays.atmosphere[0]
    factor = 1 + s * (k1 + s * (k2 + s * k3)) + bend * (1 + s / c**2)
    slope = 2 * (k1 + s * (2 * k2 + 3 * s * k3) + bend / c**2)
    return factor, slope


def _centre_partials(
    by_image: Float64[np.ndarray, "2 3 rays"],
    offsets: Offsets,
    rays: RayModel,
    u: Scalars,
    *,
    v: Scalars,
    depth: Scalars,
) -> None:
    """Fill in the ideal point's derivatives by the centre; curvature bends the third axis."""
    c = rays.constants[0]
    for row, ideal in enumerate((u, v)):
        for axis in range(3):
            image_by_axis = c * rays.rotation[axis, row] + ideal * rays.rotation[axis, 2]
            np.divide(image_by_axis, depth, out=by_image[row, axis])
        sagging = 2 * rays.atmosphere[1] * by_image[row, 2]
        by_image[row, 0] -= sagging * offsets[0]
        by_image[row, 1] -= sagging * offsets[1]


def _through_lens(
    ideal: Float64[np.ndarray, "2 3 rays"], uu: Scalars, uv: Scalars, vu: Scalars, *, vv: Scalars
) -> Float64[np.ndarray, "2 3 rays"]:
    """Derivatives of the ideal point turned into derivatives of the film point."""
    return np.stack([uu * ideal[0] + uv * ideal[1], vu * ideal[0] + vv * ideal[1]])


def rotations_from_increments(increments: Vectors) -> Rotations:
    """exp[w]: rotation matrices of rotation vectors (radians), Rodrigues' formula."""
    angle = np.linalg.norm(increments, axis=1)
    # design: sin x / x is one in doubles.
    small = angle < 1e-8
    safe = np.where(small, 1.0, angle)
    sine = np.where(small, 1.0, np.sin(safe) / safe)
    versine = np.where(small, 0.5, (1 - np.cos(safe)) / safe**2)
    cross = np.zeros((len(increments), 3, 3))
    cross[:, 2, 1], cross[:, 0, 2], cross[:, 1, 0] = increments.T
    cross -= np.swapaxes(cross, 1, 2)
    return np.eye(3) + sine[:, None, None] * cross + versine[:, None, None] * (cross @ cross)


def angles_from_rotations(rotations: Rotations) -> Vectors:
    """omega, phi, kappa (radians) of each rotation R = R_omega R_phi R_kappa."""
    return np.stack(
        [
            np.arctan2(-rotations[:, 1, 2], rotations[:, 2, 2]),
            np.arcsin(np.clip(rotations[:, 0, 2], -1.0, 1.0)),
            np.arctan2(-rotations[:, 0, 1], rotations[:, 0, 0]),
        ],
        axis=1,
    )


def angles_by_increments(rotations: Rotations) -> Rotations:
    """Derivatives of omega, phi, kappa (rows) by the increment w of R exp[w] (columns).

    Undefined at phi = 90 degrees, where no aerial photo is.
    """
    return np.linalg.inv(increments_by_angles(rotations))


def increments_by_angles(rotations: Rotations) -> Rotations:
    """Derivatives of the increment w of R exp[w] (rows) by omega, phi, kappa (columns).

    From R^T dR = [w]: w = (first row of R) d omega + (sin kappa, cos kappa, 0) d phi
    + (0, 0, 1) d kappa.
    """
    kappa = angles_from_rotations(rotations)[:, 2]
    turns = np.zeros_like(rotations)
    turns[:, :, 0] = rotations[:, 0, :]
    turns[:, 0, 1], turns[:, 1, 1] = np.sin(kappa), np.cos(kappa)
    turns[:, 2, 2] = 1.0
    return turns


def refraction_constant(flying_height_m: float, ground_height_m: float) -> float:
    """K of the standard atmosphere for heights above sea level in metres.

    K = [2410 H / (H^2 - 6 H + 250) - 2410 h / (h^2 - 6 h + 250) h / H] 1e-6 with H, h in
    kilometres; with r = 130 mm it reproduces Table 4.1 of the notes on image coordinates.
    """
    high, low = flying_height_m / 1000.0, ground_height_m / 1000.0
    if high <= 0:
        return 0.0
    # source: Bertram 1966, microradians.
    return (_bertram(high) - _bertram(low) * low / high) * 1e-6


def _bertram(height_km: float) -> float:
    """Refraction of the air below a height, microradians."""
    factor, linear, constant = BERTRAM
    return factor * height_km / (height_km * height_km - linear * height_km + constant)


def atmosphere_of(flying_height_m: float, ground_height_m: float) -> Atmosphere:
    """Both corrections for a photo taken at a height over mean ground, above sea level, metres."""
    return Atmosphere(
        refraction=refraction_constant(flying_height_m, ground_height_m),
        curvature_per_m=1.0 / (2.0 * EARTH_RADIUS_M),
    )
