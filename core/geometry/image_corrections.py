"""Corrections of image points and special points of a photo: textbook formulas with sources.

The notes on image coordinates (chapter 4, cited by section) give them for near-vertical photos.
The bundle adjustment uses its own models, in `collinearity` and `camera`; what these do to one
place of a scan is told at the end.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from core.arrays import FilmPoints, ObjectPoints, PixelPoints, Scalars, locked
from core.geometry.collinearity import (
    EARTH_RADIUS_M,
    film_from_ideal,
    film_from_object,
    object_from_film,
)
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import plain_similarity
from core.geometry.resection import PhotoModel
from core.geometry.transforms import PlaneTransform, apply_affine, invert_affine

KM_H = 0.2778  # source: 1 / 3.6, as the notes round it.
"""Metres a second of one kilometre an hour."""


def photo_scale(principal_distance_mm: float, flying_height_m: float, ground_m: float) -> float:
    """S = f / (H - h): 1e-4 is 1:10 000 ("Princip perspektivního zobrazení").

    Args:
        principal_distance_mm: f, millimetres.
        flying_height_m: H above the datum, metres.
        ground_m: h of the ground above the same datum, metres.
    """
    return principal_distance_mm / 1000.0 / (flying_height_m - ground_m)


def relief_displacement_mm(radius_mm: Scalars, height_m: Scalars, above_ground_m: float) -> Scalars:
    """Dr = r h / H: how far the top of an object leans away from the nadir on a vertical photo.

    Args:
        radius_mm: Distance of its image from the nadir point, millimetres.
        height_m: Height of the object over the reference plane, metres.
        above_ground_m: Flying height over the same plane, metres.
    """
    return radius_mm * height_m / above_ground_m


def ground_displacement_m(
    radius_mm: float, height_error_m: float, principal_distance_mm: float
) -> float:
    """R h / c: how far a wrong height moves a point of an ortho, along the line from the nadir.

    Args:
        radius_mm: r, distance of its image from the nadir point of a vertical photo.
        height_error_m: h, what the DEM is too high there.
        principal_distance_mm: c.
    """
    return radius_mm / principal_distance_mm * height_error_m


def tilt_displacement_mm(
    radius_mm: Scalars, azimuth: Scalars, tilt: float, principal_distance_mm: float
) -> Scalars:
    """Dr = -r^2 sin t cos a / (c - r sin t cos a): what a tilt does to an image point.

    Outwards from the isocentre, along which directions are those of a vertical photo from the
    same place: collinearity in polar coordinates there. The horizon is where r cos a is c / sin t.

    Args:
        radius_mm: r, distance of the image on the tilted photo from the isocentre.
        azimuth: a, its direction there from the line towards the horizon, radians.
        tilt: t, between axis and plumb line, radians.
        principal_distance_mm: c, millimetres.
    """
    along = radius_mm * np.sin(tilt) * np.cos(azimuth)
    return -radius_mm * along / (principal_distance_mm - along)


def image_motion_mm(
    speed_km_h: float, exposure_s: float, principal_distance_mm: float, above_ground_m: float
) -> float:
    """M = 0.2778 n t f / H: how long a still point is drawn on the film ("smaz").

    Args:
        speed_km_h: n, speed of the aircraft over ground.
        exposure_s: t, time of exposure, seconds.
        principal_distance_mm: f, millimetres.
        above_ground_m: H, flying height over the reference plane, metres.
    """
    return KM_H * speed_km_h * exposure_s * principal_distance_mm / above_ground_m


def refraction_um(radius_mm: Scalars, principal_distance_mm: float, refraction: float) -> Scalars:
    """Dr = K (r + r^3 / c^2), outwards, micrometres (table 4.1); K of `refraction_constant`."""
    return 1000 * refraction * (radius_mm + radius_mm**3 / principal_distance_mm**2)


def curvature_um(
    radius_mm: Scalars, principal_distance_mm: float, above_ground_m: float
) -> Scalars:
    """Dr = H r^3 / (2 R c^2), inwards, micrometres (table 4.2)."""
    return 1000 * above_ground_m * radius_mm**3 / (2 * EARTH_RADIUS_M * principal_distance_mm**2)


def shrinkage_factor(certified_mm: FilmPoints, measured_mm: FilmPoints) -> float:
    """Certified over measured distances of all pairs of marks: what image coordinates are times.

    Section "Vlivy srážky fotografického materiálu": the mean over opposite marks; here over all
    pairs, weighted by their length.
    """
    pairs = np.triu_indices(len(certified_mm), 1)
    true = np.linalg.norm(certified_mm[pairs[0]] - certified_mm[pairs[1]], axis=1)
    seen = np.linalg.norm(measured_mm[pairs[0]] - measured_mm[pairs[1]], axis=1)
    return float(np.sum(true * seen) / np.sum(seen * seen))


def nadir_on_film(exterior: ExteriorOrientation, principal_distance_mm: float) -> FilmPoints:
    """Where the plumb line through the perspective centre meets the film, (1, 2) mm.

    From the principal point; all vertical edges lean away from it. In the direction of the nadir
    (0, 0, -1) of object space, divided down to z = -c of image space.
    """
    down = exterior.object_from_image.T @ np.array([0.0, 0.0, -1.0])
    return (down[:2] * (-principal_distance_mm / down[2]))[None, :]


def isocentre_on_film(exterior: ExteriorOrientation, principal_distance_mm: float) -> FilmPoints:
    """The focal point of a tilted photo, on the bisector of principal point and nadir, (1, 2) mm.

    At c tan(tilt / 2) from the principal point: the notes' "half way" holds for small tilts.
    """
    nadir = nadir_on_film(exterior, principal_distance_mm)
    away = float(np.linalg.norm(nadir))
    if away == 0.0:
        return nadir
    tilt = np.arctan2(away, principal_distance_mm)
    return nadir * (principal_distance_mm * np.tan(tilt / 2) / away)


def tangential_mm(film_mm: FilmPoints, p1: float, p2: float) -> FilmPoints:
    """Tangential distortion of a lens out of centre (Brown 1966), millimetres to be added.

    Args:
        film_mm: Ideal image points from the principal point.
        p1: Coefficient of dx = p1 (r^2 + 2 x^2) + 2 p2 x y, per millimetre.
        p2: Coefficient of dy = p2 (r^2 + 2 y^2) + 2 p1 x y, per millimetre.
    """
    x, y = film_mm.T
    r2 = x * x + y * y
    return np.column_stack(
        [p1 * (r2 + 2 * x * x) + 2 * p2 * x * y, p2 * (r2 + 2 * y * y) + 2 * p1 * x * y]
    )


def radial_from_table_um(radius_mm: Scalars, table: Sequence[tuple[float, float]]) -> Scalars:
    """Radial distortion at radii from a certificate's table (mm, um), straight lines between."""
    radii, shifts = locked(table).T
    order = np.argsort(radii)
    return np.interp(radius_mm, radii[order], shifts[order])


SpecialPoint = Literal["nadir", "isocentre", "principal", "fiducial_centre"]
"""Points of a photo that have a name."""
Effect = Literal["refraction", "curvature", "distortion", "film"]
"""What moves an image point away from where a central projection puts it."""


def special_points(
    model: PhotoModel, exterior: ExteriorOrientation
) -> Mapping[SpecialPoint, FilmPoints]:
    """Nadir, isocentre, principal point and middle of the certified marks, film frame, (1, 2) mm.

    A camera without marks has no fiducial centre.
    """
    camera, air = model.camera, model.atmosphere
    c = camera.principal_distance_mm
    points: dict[SpecialPoint, FilmPoints] = {
        "nadir": film_from_ideal(nadir_on_film(exterior, c), camera, air),
        "isocentre": film_from_ideal(isocentre_on_film(exterior, c), camera, air),
        "principal": film_from_ideal(np.zeros((1, 2)), camera, air),
    }
    if camera.fiducials_mm:
        marks = np.array(list(camera.fiducials_mm.values()))
        points["fiducial_centre"] = marks.mean(axis=0)[None]
    return points


@dataclass(frozen=True, slots=True, eq=False)
class ImageShift:
    """What one effect does to a place of a scan."""

    film_mm: FilmPoints
    """How far it moved the image point on the film, (1, 2) mm."""
    pixel_px: PixelPoints
    """The same in the scan, (1, 2) pixels."""
    ground_m: ObjectPoints
    """How far the ground would seem to lie if it were not corrected, (1, 3) metres."""

    def __add__(self, other: "ImageShift") -> "ImageShift":
        """Both effects together."""
        return ImageShift(
            self.film_mm + other.film_mm,
            self.pixel_px + other.pixel_px,
            self.ground_m + other.ground_m,
        )

    def sign(self, away_mm: FilmPoints) -> float:
        """-1 where it points towards the principal point from a place so far away, else 1."""
        return -1.0 if float(np.sum(self.film_mm * away_mm)) < 0 else 1.0


def shifts_at(
    pixel: PixelPoints, height: Scalars, model: PhotoModel, exterior: ExteriorOrientation
) -> Mapping[Effect, ImageShift]:
    """What each effect does at one place of a scan: the engine's model with it and without it.

    Args:
        pixel: The place, (1, 2).
        height: Of the ground there, (1,) metres.
        model: Interior orientation, camera and air of the photo.
        exterior: Its exterior orientation.

    Returns:
        Shifts; `film` is what the interior orientation takes up beyond a similarity, and is
        missing where no marks were measured.
    """
    camera, air, interior = model.camera, model.atmosphere, model.interior
    film = interior.film_from_pixel(pixel)
    ground = object_from_film(film, height, exterior, camera, air)
    ideal_lens = replace(camera, radial_distortion=(0.0, 0.0, 0.0), deformation_mm=())
    without: dict[Effect, PhotoModel] = {
        "refraction": replace(model, atmosphere=replace(air, refraction=0.0)),
        "curvature": replace(model, atmosphere=replace(air, curvature_per_m=0.0)),
        "distortion": replace(model, camera=ideal_lens),
    }
    shifts: dict[Effect, ImageShift] = {}
    for effect, plain in without.items():
        straight = film_from_object(ground, exterior, plain.camera, plain.atmosphere)
        seeming = object_from_film(film, height, exterior, plain.camera, plain.atmosphere)
        shifts[effect] = ImageShift(
            film - straight, pixel - interior.pixel_from_film(straight), seeming - ground
        )
    similarity = plain_similarity(interior) if interior.names else None
    if isinstance(similarity, PlaneTransform):
        deformed = apply_affine(similarity.matrix, pixel)
        shifts["film"] = ImageShift(
            deformed - film,
            pixel - apply_affine(invert_affine(similarity.matrix), film),
            object_from_film(deformed, height, exterior, camera, air) - ground,
        )
    return shifts
