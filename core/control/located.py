"""Ground position of a point measured in photos, with its covariance.

Two rays or more intersect; a single ray ends at the known height of the point, or near the
terrain. The errors of the orientations are propagated along with the pointing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float64

from core.adjustment.adjusted import ExteriorSigmas
from core.adjustment.equations import Rows
from core.arrays import Position
from core.block import UNKNOWN_M, Block, Measurement, Photo, SurveyedPoint
from core.control.prediction import Covariances, JointErrors, pixel_spreads
from core.doubts import Failure
from core.geometry.intersection import Intersection, OrientedRay, intersect
from core.geometry.resection import PhotoModel
from core.matching.patches import OpenPhoto, object_on_ground
from core.raster.dem import HeightSource
from core.raster.scan_file import ScanFile

Plane = Float64[np.ndarray, "2 2"]
Space = Float64[np.ndarray, "3 3"]

# design: a house or a tree; what is measured need not stand on the bare ground.
ABOVE_GROUND_M = 5.0
"""Standard deviation of a point's height against that of the terrain, metres."""
# design: the relief of hilly country; as the adjustment holds points at first.
RELIEF = 0.05
"""The same where no terrain is known, as a share of the flying height."""
# design: over a few metres slopes of the ground show, over more its bends.
SLOPE_M = 10.0
"""The plane of the ground is laid through heights this far about a point, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """What a transfer needs to know besides the point."""

    block: Block
    """Photos as they are oriented, cameras, surveyed points."""
    scans: Mapping[str, ScanFile]
    """Opened scans by photo; photos without one are left out."""
    sigmas: Mapping[str, ExteriorSigmas]
    """How well the photos are oriented; those not in it, as their prior says."""
    heights: HeightSource | None = None
    """The terrain; without one, the mean height under each photo."""
    covariances: Covariances = field(default_factory=dict[str, Any])
    """The same as `sigmas` with all correlations; counts where it is known."""
    joint: JointErrors | None = None
    """The same of all photos together; counts where it knows the photos of a point."""

    def opened(self, photo_id: str) -> OpenPhoto:
        """A photo with its camera and its scan at hand."""
        camera = self.block.camera_of(photo_id)
        return OpenPhoto(self.block.photos[photo_id], camera, self.scans[photo_id])


@dataclass(frozen=True, slots=True, eq=False)
class Located:
    """Where a point is on the ground as far as is known."""

    position: Position
    """Easting, northing, height, metres."""
    covariance: Space
    """Square metres."""
    slope: Float64[np.ndarray, "2"]
    """Rise of the ground for a metre east and north."""
    joint: "ByUnknowns | None" = None
    """How the place hangs on the orientations; None where that is not known."""


@dataclass(frozen=True, slots=True, eq=False)
class ByUnknowns:
    """A place as the unknowns of the adjustment and its own rays make it."""

    rows: Rows
    """Easting, northing, height by all unknowns, (3, n)."""
    own: Space
    """Covariance that pointing and a known height bring, square metres."""


def locate_point(
    around: Surroundings, measured: Sequence[Measurement], point: SurveyedPoint | None
) -> Located | Failure:
    """Where the rays of a point meet; where a single one meets the ground.

    Args:
        around: The block, no scans; the orientations' own errors count with the rays.
        measured: Measurements in oriented photos, one or more.
        point: Where its height comes from if that is known.
    """
    if len(measured) > 1:
        met = _met(around, measured)
        if isinstance(met, Intersection):
            joint = _by_unknowns(around, measured, met.position, np.inf)
            return Located(met.position, met.covariance, slope_at(around, met.position), joint)
    photo, pixel = around.block.photos[measured[0].photo_id], measured[0].pixel
    height, sigma = _height(around, photo, pixel, point)
    camera = around.block.camera_of(photo.photo_id)
    position = photo.object_from_pixel(pixel, np.array([height]), camera)[0]
    if not np.isfinite(position).all():
        return Failure("its ray does not meet the ground")
    by_object, spread = derivatives(around, photo, position)
    spread = spread + np.eye(2) * measured[0].sigma_px ** 2
    to_plane = np.linalg.inv(by_object[:, :2])
    along = np.append(-to_plane @ by_object[:, 2], 1.0)
    covariance = sigma**2 * np.outer(along, along)
    covariance[:2, :2] += to_plane @ spread @ to_plane.T
    joint = _by_unknowns(around, measured[:1], position, sigma)
    return Located(position, covariance, slope_at(around, position), joint)


def expected_spread(around: Surroundings, where: Located, photo: Photo) -> Plane:
    """Covariance of where a photo should show a place, square pixels.

    What its orientation shares with those of the photos in which the place was measured counts
    once, where the equations of the block are at hand.
    """
    joint, known = where.joint, around.joint
    if joint is not None and known is not None and known.know([photo.photo_id]):
        camera = around.block.camera_of(photo.photo_id)
        by_unknowns, by_point = known.of_ray(photo, camera, where.position)
        together = known.covariance(by_unknowns + by_point @ joint.rows)
        return together + by_point @ joint.own @ by_point.T
    by_object, spread = derivatives(around, photo, where.position)
    return by_object @ where.covariance @ by_object.T + spread


def _by_unknowns(
    around: Surroundings,
    measured: Sequence[Measurement],
    position: Position,
    height_sigma_m: float,
) -> ByUnknowns | None:
    """How rays, and a height known so well, make a place hang on the unknowns: least squares."""
    if around.joint is None or not around.joint.know([item.photo_id for item in measured]):
        return None
    normal = np.diag([0.0, 0.0, height_sigma_m**-2])
    rows: Rows | None = None
    for item in measured:
        photo, camera = around.block.photos[item.photo_id], around.block.camera_of(item.photo_id)
        by_unknowns, by_point = around.joint.of_ray(photo, camera, position)
        weighted = by_point.T / item.sigma_px**2
        normal += weighted @ by_point
        rows = weighted @ by_unknowns if rows is None else rows + weighted @ by_unknowns
    own = np.linalg.inv(normal)
    return None if rows is None else ByUnknowns(-own @ rows, own)


def pointing_px(measured: Sequence[Measurement]) -> float:
    """What the pointing at the place carries over to all other photos, pixels."""
    return float(np.sum([item.sigma_px**-2 for item in measured]) ** -0.5)


def _met(around: Surroundings, measured: Sequence[Measurement]) -> Intersection | Failure:
    """The intersection of two rays or more."""
    block = around.block
    photos = [block.photos[item.photo_id] for item in measured]
    film = [p.interior.film_from_pixel(m.pixel) for p, m in zip(photos, measured, strict=True)]
    rays = [OrientedRay(p.exterior, block.cameras[p.camera], p.atmosphere) for p in photos]
    sigma = [p.interior.pixel_size_mm * m.sigma_px for p, m in zip(photos, measured, strict=True)]
    first = intersect(np.concatenate(film), np.array(sigma), rays)
    if isinstance(first, Failure):
        return first
    wider = [
        np.hypot(own, p.interior.pixel_size_mm * _typical(derivatives(around, p, first.position)))
        for own, p in zip(sigma, photos, strict=True)
    ]
    return intersect(np.concatenate(film), np.array(wider), rays)


def _typical(derivatives: tuple[Float64[np.ndarray, "2 3"], Plane]) -> float:
    """Standard deviation per axis of the orientation's part, pixels."""
    return float(np.sqrt(np.trace(derivatives[1]) / 2))


def derivatives(
    around: Surroundings, photo: Photo, position: Position
) -> tuple[Float64[np.ndarray, "2 3"], Plane]:
    """Pixels by the point (2, 3), and their covariance from the photo's orientation."""
    camera = around.block.cameras[photo.camera]
    model = PhotoModel(photo.interior, camera, photo.atmosphere)
    by_all = model.linearised(position[None], photo.exterior)[1][0]
    whole = around.covariances.get(photo.photo_id)
    if whole is not None:
        return by_all[:, :3], pixel_spreads(photo, camera, position[None], whole)[0]
    known = around.sigmas.get(photo.photo_id)
    centre = photo.prior.sigma_centre_m if known is None else known.centre_m
    angles = photo.prior.sigma_angles if known is None else known.angles
    variances = np.concatenate([centre, angles]) ** 2
    return by_all[:, :3], (by_all * variances) @ by_all.T


def _height(
    around: Surroundings, photo: Photo, pixel: np.ndarray, point: SurveyedPoint | None
) -> tuple[float, float]:
    """Height of a point on a ray, and its standard deviation, metres."""
    if point is not None and point.sigma_m[2] < UNKNOWN_M:
        return float(point.position[2]), float(point.sigma_m[2])
    if around.heights is not None:
        camera = around.block.camera_of(photo.photo_id)
        ground = object_on_ground(photo, camera, pixel, around.heights)
        if np.isfinite(ground).all():
            return float(ground[0, 2]), ABOVE_GROUND_M
    above = float(photo.exterior.centre[2]) - photo.ground_height_m
    return photo.ground_height_m, RELIEF * above


def slope_at(around: Surroundings, position: Position) -> Float64[np.ndarray, "2"]:
    """Rise of the terrain for a metre east and north; level where it is not known."""
    if around.heights is None:
        return np.zeros(2)
    steps = SLOPE_M * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    heights = around.heights.heights(position[:2] + steps)
    return np.nan_to_num(np.array([heights[0] - heights[1], heights[2] - heights[3]])) / (
        2 * SLOPE_M
    )


def usable(around: Surroundings, photo_id: str) -> bool:
    """Whether a photo is oriented and its scan at hand."""
    photo = around.block.photos.get(photo_id)
    return photo is not None and photo.oriented and photo_id in around.scans
