"""The block as arrays: photos, cameras, points and the rays between them, ready to adjust."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64, Int

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.positioning import MEASURED_M, Positioning, positioning_of
from core.adjustment.reference_shifts import ReferenceShifts, shifts_of
from core.arrays import FilmPoints, Flags, Indices, ObjectPoints, Position, Scalars
from core.block import Block, Measurement, Photo, ShiftedReference
from core.errors import OrientationError
from core.geometry.camera import AdditionalSet, Camera, additional_set
from core.geometry.collinearity import (
    Rotations,
    angles_from_rotations,
    constants_of,
    constants_of_air,
    rotations_from_increments,
)
from core.said import say

# design: the equations stay regular in doubles, and nothing is known better.
SMALLEST_SIGMA_M = 1e-4
"""Ground coordinates are never held more firmly than this, metres."""
# design: as SMALLEST_SIGMA_M.
SMALLEST_SIGMA_PX = 1e-3
"""Measurements are never weighted as if better than this, pixels."""
# design: as SMALLEST_SIGMA_M, 0.1 mm at 10 km.
SMALLEST_SIGMA_RAD = 1e-8
"""Angles are never held more firmly than this, radians."""
# design: as SMALLEST_SIGMA_M, a nanometre of film.
SMALLEST_SIGMA_MM = 1e-6
"""Camera constants are never held more firmly than this, millimetres at the frame's corner."""

# design: k3 cannot be told from k1 and k2 by the photos of one block.
CONSTANTS = 5
"""Unknown constants of every camera: principal distance, x0, y0, k1, k2."""
# design: all heights together then weigh a ninth of what is known of the distance itself.
HEIGHTS_FREE = 3.0
"""So much looser heights are that follow from a principal distance which is only proposed."""
PER_PHOTO = "@"
"""Between a camera's name and the photo's, where each photo has constants of its own."""
# design: with 44 additional parameters each the dense border has 4,900 unknowns, 192 MB.
MOST_CAMERAS = 100
"""Cameras with unknowns of their own at most: all of them stand in the dense border."""


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """Film points that take part or may, sorted by photo."""

    photo: Indices
    """Photo of each ray."""
    point: Indices
    """Point of each ray."""
    film: FilmPoints
    """Measured film points, millimetres."""
    sigma_mm: Scalars
    """Standard deviation per axis, millimetres."""
    tie: Indices
    """Row in `block.ties`, -1 for measurements of control points."""
    measurement: Indices
    """Row in `Network.measurements`, -1 for tie points."""
    first: Int[np.ndarray, "starts"]
    """First ray of each photo, and the number of rays at the end."""


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Tie points that two photos or more show, then control points."""

    tie: Int[np.ndarray, "ties"]
    """Number in `block.ties` of each tie point; these come first."""
    control: tuple[str, ...]
    """Names of the control points and new points that follow."""
    known: ObjectPoints
    """A-priori coordinates, metres; nought for tie points."""
    known_weight: ObjectPoints
    """Root of the weight of each a-priori coordinate, 1 / metres; nought for tie and new points."""
    shifts: ReferenceShifts
    """What the a-priori coordinates of many points are off together."""

    @property
    def count(self) -> int:
        """Number of points."""
        return len(self.known)


@dataclass(frozen=True, slots=True, eq=False)
class Priors:
    """A-priori values of orientations and camera constants, with roots of weights."""

    centres: ObjectPoints
    """Perspective centres, metres."""
    centre_weights: ObjectPoints
    """1 / metres."""
    angles: ObjectPoints
    """omega, phi, kappa, radians."""
    angle_weights: ObjectPoints
    """1 / radians."""
    constants: Float64[np.ndarray, "cameras 6"]
    """The certificates: principal distance, x0, y0, k1, k2, k3."""
    constant_weights: Float64[np.ndarray, "cameras lens"]
    """Of the scaled constants and the additional parameters, 1 / millimetres."""


@dataclass(frozen=True, slots=True, eq=False)
class Network:
    """What does not change while a block is adjusted."""

    photos: tuple[Photo, ...]
    """The oriented photos."""
    cameras: tuple[Camera, ...]
    """Their cameras."""
    camera_names: tuple[str, ...]
    """What the block calls them."""
    camera: Indices
    """Camera of each photo."""
    air: Float64[np.ndarray, "photos 2"]
    """Refraction and curvature of each photo."""
    measurements: tuple[Measurement, ...]
    """Used measurements of control points in these photos."""
    rays: Rays
    """All rays."""
    points: Points
    """All points."""
    priors: Priors
    """What is known beforehand."""
    scale: Float64[np.ndarray, "cameras lens"]
    """Scaled constant = constant x scale: all in millimetres at the corner of the frame."""
    estimate_cameras: bool
    """Whether the cameras' constants are unknowns."""
    additional: AdditionalSet
    """Additional parameters of each camera."""
    positioning: Positioning
    """What GNSS and IMU get wrong the same way in many photos."""

    @property
    def lens(self) -> int:
        """Number of unknowns of one camera: five constants and the additional parameters."""
        return CONSTANTS + len(self.additional.names)

    @property
    def lensed(self) -> int:
        """Number of unknowns of all cameras; then come references and positioning."""
        return self.lens * len(self.cameras) if self.estimate_cameras else 0

    @property
    def pointed(self) -> int:
        """Number of shared unknowns that points depend on: cameras, then shifts of references."""
        return self.lensed + self.points.shifts.count

    @property
    def shared(self) -> int:
        """Number of unknowns that photos share."""
        return self.pointed + self.positioning.count

    @property
    def anchored(self) -> Flags:
        """Rays of points whose coordinates are known: one such ray alone says something."""
        known = np.any(self.points.known_weight > 0, axis=1, keepdims=False)
        return (self.rays.measurement >= 0) & known[self.rays.point]

    @property
    def by_operator(self) -> Flags:
        """Rays that a human has accepted."""
        accepted = np.array([m.status == "accepted" for m in self.measurements] + [False])
        return accepted[self.rays.measurement]


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """The unknowns."""

    centres: Float64[np.ndarray, "photos 3"]
    """Perspective centres, metres."""
    rotations: Rotations
    """Image space into object space."""
    constants: Float64[np.ndarray, "cameras 6"]
    """Principal distance, x0, y0, k1, k2, k3 of each camera."""
    additional: Float64[np.ndarray, "cameras more"]
    """Additional parameters of each camera, millimetres."""
    positioning: Float64[np.ndarray, "unknowns"]
    """Shifts and drifts (metres), misalignment (radians)."""
    shifts: Float64[np.ndarray, "shifts"]
    """What references are off, metres."""
    points: Float64[np.ndarray, "points 3"]
    """Object points, metres."""

    def moved(
        self,
        photos: Float64[np.ndarray, "photos 6"],
        constants: Float64[np.ndarray, "cameras lens"],
        positioning: Float64[np.ndarray, "unknowns"],
        shifts: Float64[np.ndarray, "shifts"],
        points: Float64[np.ndarray, "points 3"],
    ) -> "State":
        """The unknowns after increments (rotations by R exp[w])."""
        changed = self.constants.copy()
        changed[:, :CONSTANTS] += constants[:, :CONSTANTS]
        return replace(
            self,
            centres=self.centres + photos[:, :3],
            rotations=self.rotations @ rotations_from_increments(photos[:, 3:]),
            constants=changed,
            additional=self.additional + constants[:, CONSTANTS:],
            positioning=self.positioning + positioning,
            shifts=self.shifts + shifts,
            points=self.points + points,
        )


def network_of(block: Block, options: AdjustmentOptions) -> Network:
    """The part of a block that can be adjusted: oriented photos and what they show."""
    photos = tuple(photo for photo in block.photos.values() if photo.oriented)
    groups = [_group(photo, options) for photo in photos]
    names = sorted(set(groups))
    of_group = {group: photo.camera for group, photo in zip(groups, photos, strict=True)}
    cameras = tuple(block.cameras[of_group[name]] for name in names)
    if options.per_photo and len(names) > MOST_CAMERAS:
        cause = say("{count} photos each with constants of its own are too many.", count=len(names))
        remedy = say('Up to {most} work; write self_calibration_per = "camera".', most=MOST_CAMERAS)
        raise OrientationError("block.toml [adjustment] self_calibration_per", cause, remedy)
    place = {photo.photo_id: index for index, photo in enumerate(photos)}
    camera = np.array([names.index(group) for group in groups], dtype=np.int64)
    measurements = tuple(
        measurement
        for measurement in block.measurements.values()
        if measurement.used
        and measurement.photo_id in place
        and block.surveyed[measurement.point_id].role != "check"
    )
    control = tuple(sorted({measurement.point_id for measurement in measurements}))
    kept, tie_point = _kept_ties(block, place)
    more = additional_set(options.self_calibration if options.estimate_cameras else ())
    scale = np.array([_scale(camera, len(more.names)) for camera in cameras])
    return Network(
        photos=photos,
        cameras=cameras,
        camera_names=tuple(names),
        camera=camera,
        air=np.vstack([np.zeros((0, 2)), *(constants_of_air(one.atmosphere) for one in photos)]),
        measurements=measurements,
        rays=_rays(block, place, kept, tie_point, measurements, control),
        points=_points(block, tie_point, control),
        priors=_priors(photos, cameras, camera, options, len(more.names)),
        scale=scale.reshape(-1, CONSTANTS + len(more.names)),
        estimate_cameras=options.estimate_cameras,
        additional=more,
        positioning=positioning_of(photos, [block.cameras[p.camera] for p in photos], options),
    )


def _group(photo: Photo, options: AdjustmentOptions) -> str:
    """Name of the camera a photo shares its constants with; its own when each is by itself."""
    own = f"{PER_PHOTO}{photo.photo_id}"
    return (
        photo.camera if not options.per_photo or photo.camera.endswith(own) else photo.camera + own
    )


def _scale(camera: Camera, more: int) -> list[float]:
    """Constants in millimetres at the frame's corner: k1 r^3 and k2 r^5; additional ones are."""
    corner = float(np.hypot(*camera.frame_mm)) / 2
    return [1.0, 1.0, 1.0, corner**3, corner**5] + [1.0] * more


def _kept_ties(
    block: Block, place: dict[str, int]
) -> tuple[Int[np.ndarray, "rays"], Int[np.ndarray, "points"]]:
    """Rays of tie points that two oriented photos or more show, and the numbers of these points."""
    ties = block.ties
    photo = np.array([place.get(name, -1) for name in ties.photo_ids] + [-1], dtype=np.int64)
    of_ray = photo[ties.photo]
    inside = np.flatnonzero(of_ray >= 0)
    # One ray of a point in a photo: a second one contradicts the first, and is left out.
    pairs = ties.point[inside] * len(photo) + of_ray[inside]
    single = np.sort(inside[np.unique(pairs, return_index=True)[1]])
    photos_of_point = np.bincount(ties.point[single], minlength=ties.count)
    kept = single[photos_of_point[ties.point[single]] >= 2]
    return kept, np.flatnonzero(photos_of_point >= 2)


def _rays(
    block: Block,
    place: dict[str, int],
    kept: Int[np.ndarray, "rays"],
    tie_point: Int[np.ndarray, "points"],
    measurements: Sequence[Measurement],
    control: Sequence[str],
) -> Rays:
    """Tie rays and control rays together, sorted by photo, on film."""
    ties = block.ties
    photo_of_tie = np.array([place.get(name, -1) for name in ties.photo_ids] + [-1])
    new_number = np.zeros(ties.count, dtype=np.int64)
    new_number[tie_point] = np.arange(len(tie_point))
    number = {name: len(tie_point) + index for index, name in enumerate(control)}
    photo = [place[m.photo_id] for m in measurements]
    point = [number[m.point_id] for m in measurements]
    pixels = np.array([(m.column, m.row) for m in measurements]).reshape(-1, 2)
    sigma = np.array([m.sigma_px for m in measurements], dtype=np.float64)
    of_photo = np.concatenate([photo_of_tie[ties.photo[kept]], np.array(photo, dtype=np.int64)])
    order = np.argsort(of_photo, kind="stable")
    count = len(photo)
    first = np.searchsorted(of_photo[order], np.arange(len(place) + 1))
    film, sigma_mm = _on_film(
        [block.photos[name] for name in place],
        first,
        np.concatenate([ties.pixels[kept], pixels])[order],
        np.concatenate([ties.sigma_px[kept], sigma])[order],
    )
    return Rays(
        photo=of_photo[order],
        point=np.concatenate([new_number[ties.point[kept]], np.array(point, np.int64)])[order],
        film=film,
        sigma_mm=sigma_mm,
        tie=np.concatenate([kept, np.full(count, -1)])[order],
        measurement=np.concatenate([np.full(len(kept), -1), np.arange(count)])[order],
        first=first,
    )


def _on_film(
    photos: Sequence[Photo],
    first: Int[np.ndarray, "starts"],
    pixels: FilmPoints,
    sigma_px: Scalars,
) -> tuple[FilmPoints, Scalars]:
    """Film points and their standard deviations in millimetres, by each photo's interior."""
    film, sigma_mm = np.empty_like(pixels), np.maximum(sigma_px, SMALLEST_SIGMA_PX)
    for photo, start, stop in zip(photos, first[:-1], first[1:], strict=True):
        film[start:stop] = photo.interior.film_from_pixel(pixels[start:stop])
        sigma_mm[start:stop] *= photo.interior.pixel_size_mm
    return film, sigma_mm


def _points(block: Block, tie_point: Indices, control: tuple[str, ...]) -> Points:
    """Points with what is known of them."""
    known, weight = np.zeros((2, len(tie_point) + len(control), 3))
    for row, name in enumerate(control, start=len(tie_point)):
        point = block.surveyed[name]
        known[row] = point.position
        if point.role != "new":
            weight[row] = 1.0 / np.maximum(point.sigma_m, SMALLEST_SIGMA_M)
    first = len(tie_point)
    references = _references(block, control)
    return Points(tie_point, control, known, weight, shifts_of(references, known[first:], first))


def _references(block: Block, control: tuple[str, ...]) -> list[ShiftedReference | None]:
    """The reference of each point that is off as a whole.

    What every place of a reference shares, shadows of another hour among it, shows nowhere but at
    surveyed points: where these position the block, it is estimated.
    """
    usual = block.reference if block.surveyed_datum else None
    points = [block.surveyed[name] for name in control]
    return [point.shifted or (None if point.source == "surveyed" else usual) for point in points]


def _priors(
    photos: Sequence[Photo],
    cameras: Sequence[Camera],
    of_photo: Indices,
    options: AdjustmentOptions,
    more: int,
) -> Priors:
    """Means and weights of exterior orientations and camera constants."""
    approximate = [photo.approximate for photo in photos]
    rotations = np.array([known.object_from_image for known in approximate]).reshape(-1, 3, 3)
    distortion = options.sigma_distortion_um / 1000.0
    sigmas = np.array(
        [
            [camera.sigma_principal_distance_mm or options.sigma_principal_distance_mm]
            + [options.sigma_principal_point_mm] * 2
            + [distortion] * 2
            + [options.sigma_additional_um / 1000.0] * more
            for camera in cameras
        ]
    )
    return Priors(
        centres=np.array([known.centre for known in approximate]).reshape(-1, 3),
        centre_weights=_weights(
            [
                _sigma_centre(photo, cameras[row], int(np.sum(of_photo == row)))
                for photo, row in zip(photos, of_photo.tolist(), strict=True)
            ],
            SMALLEST_SIGMA_M,
        ),
        angles=angles_from_rotations(rotations),
        angle_weights=_weights([p.prior.sigma_angles for p in photos], SMALLEST_SIGMA_RAD),
        constants=np.array([constants_of(c.certificate) for c in cameras]).reshape(-1, 6),
        constant_weights=1 / np.maximum(sigmas.reshape(len(cameras), -1), SMALLEST_SIGMA_MM)
        if cameras
        else np.zeros((0, 0)),
    )


def _sigma_centre(photo: Photo, camera: Camera, photos: int) -> Position:
    """Standard deviations of a centre, metres.

    Where it was not measured in flight its height follows from the scale of the photo and the
    principal distance. An error of a proposed distance is in the heights of all its photos alike,
    so that they must not speak for it together.
    """
    sigma = photo.prior.sigma_centre_m
    if np.all(sigma <= MEASURED_M):
        return sigma
    above = float(photo.approximate.centre[2]) - photo.ground_height_m
    share = camera.sigma_principal_distance_mm / camera.certificate.principal_distance_mm
    loose = HEIGHTS_FREE * np.sqrt(photos) * share * above
    return np.array([sigma[0], sigma[1], np.hypot(sigma[2], loose)])


def _weights(sigmas: Sequence[Position], smallest: float) -> Float64[np.ndarray, "photos 3"]:
    """Roots of weights of three values a photo."""
    return 1 / np.maximum(np.array(sigmas).reshape(-1, 3), smallest)
