"""The block as arrays: photos, cameras, points and the rays between them, ready to adjust."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64, Int

from core.arrays import FilmPoints, Flags, Indices, ObjectPoints, Scalars
from core.block.adjusted import AdjustmentOptions
from core.block.block import Block, Measurement, Photo
from core.geometry.camera import Camera
from core.geometry.collinearity import VACUUM, ideal_from_film
from core.geometry.intersection import SMALLEST_ANGLE, closest_points
from core.geometry.partials import (
    Rotations,
    angles_from_rotations,
    constants_of,
    constants_of_air,
    rotations_from_increments,
)

SMALLEST_SIGMA_M = 1e-4
"""Ground coordinates are never held more firmly than this, metres."""
SMALLEST_SIGMA_PX = 1e-3
"""Measurements are never weighted as if better than this, pixels."""


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
    """Names of the control points that follow."""
    known: ObjectPoints
    """A-priori coordinates, metres; nought for tie points."""
    known_weight: ObjectPoints
    """Root of the weight of each a-priori coordinate, 1 / metres; nought for tie points."""

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
    constant_weights: Float64[np.ndarray, "cameras 5"]
    """Of the scaled constants, 1 / millimetres."""


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
    measurements: tuple[Measurement, ...]
    """Used measurements of control points in these photos."""
    rays: Rays
    """All rays."""
    points: Points
    """All points."""
    priors: Priors
    """What is known beforehand."""
    scale: Float64[np.ndarray, "cameras 5"]
    """Scaled constant = constant x scale: all in millimetres at the corner of the frame."""
    estimate_cameras: bool
    """Whether the cameras' constants are unknowns."""

    @property
    def shared(self) -> int:
        """Number of unknowns that photos share."""
        return 5 * len(self.cameras) if self.estimate_cameras else 0

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
    points: Float64[np.ndarray, "points 3"]
    """Object points, metres."""

    def moved(
        self,
        photos: Float64[np.ndarray, "photos 6"],
        constants: Float64[np.ndarray, "cameras 5"],
        points: Float64[np.ndarray, "points 3"],
    ) -> "State":
        """The unknowns after increments (rotations by R exp[w])."""
        changed = self.constants.copy()
        changed[:, :5] += constants
        return replace(
            self,
            centres=self.centres + photos[:, :3],
            rotations=self.rotations @ rotations_from_increments(photos[:, 3:]),
            constants=changed,
            points=self.points + points,
        )


def network_of(block: Block, options: AdjustmentOptions) -> Network:
    """The part of a block that can be adjusted: oriented photos and what they show."""
    photos = tuple(photo for photo in block.photos.values() if photo.oriented)
    names = sorted({photo.camera for photo in photos})
    cameras = tuple(block.cameras[name] for name in names)
    place = {photo.photo_id: index for index, photo in enumerate(photos)}
    measurements = tuple(
        measurement
        for measurement in block.measurements.values()
        if measurement.used
        and measurement.photo_id in place
        and block.surveyed[measurement.point_id].role == "control"
    )
    control = tuple(sorted({measurement.point_id for measurement in measurements}))
    kept, tie_point = _kept_ties(block, place)
    scale = np.array([_scale(camera) for camera in cameras]).reshape(-1, 5)
    return Network(
        photos=photos,
        cameras=cameras,
        camera_names=tuple(names),
        camera=np.array([names.index(photo.camera) for photo in photos], dtype=np.int64),
        measurements=measurements,
        rays=_rays(block, place, kept, tie_point, measurements, control),
        points=_points(block, tie_point, control),
        priors=_priors(photos, cameras, options),
        scale=scale,
        estimate_cameras=options.estimate_cameras,
    )


def _scale(camera: Camera) -> list[float]:
    """Constants in millimetres at the frame's corner: k1 r^3 and k2 r^5."""
    corner = float(np.hypot(*camera.frame_mm)) / 2
    return [1.0, 1.0, 1.0, corner**3, corner**5]


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
        known[row] = block.surveyed[name].position
        weight[row] = 1.0 / np.maximum(block.surveyed[name].sigma_m, SMALLEST_SIGMA_M)
    return Points(tie_point, control, known, weight)


def _priors(
    photos: Sequence[Photo], cameras: Sequence[Camera], options: AdjustmentOptions
) -> Priors:
    """Means and weights of exterior orientations and camera constants."""
    approximate = [photo.approximate for photo in photos]
    rotations = np.array([known.object_from_image for known in approximate]).reshape(-1, 3, 3)
    distortion = options.sigma_distortion_um / 1000.0
    sigmas = np.array(
        [options.sigma_principal_distance_mm]
        + [options.sigma_principal_point_mm] * 2
        + [distortion] * 2
    )
    return Priors(
        centres=np.array([known.centre for known in approximate]).reshape(-1, 3),
        centre_weights=1 / np.array([p.prior.sigma_centre_m for p in photos]).reshape(-1, 3),
        angles=angles_from_rotations(rotations),
        angle_weights=1 / np.array([p.prior.sigma_angles for p in photos]).reshape(-1, 3),
        constants=np.array([constants_of(c.certificate) for c in cameras]).reshape(-1, 6),
        constant_weights=np.tile(1 / sigmas, (len(cameras), 1)),
    )


def constants_of_atmospheres(network: Network) -> Float64[np.ndarray, "photos 2"]:
    """Refraction and curvature of each photo."""
    return np.concatenate([constants_of_air(photo.atmosphere) for photo in network.photos])


def initial_state(network: Network) -> tuple[State, Flags]:
    """Present orientations, points where their rays meet, and the rays whose points do so."""
    state, origins, directions = _oriented(network)
    points, placed = _met_points(network, origins, directions)
    return replace(state, points=points), placed[network.rays.point]


def on_the_ground(network: Network, softness: float) -> tuple[Network, State]:
    """Where rough orientations are improved from: tie points laid on the ground, nearly held there.

    Rays of rough orientations meet anywhere; the heights of the ground are known far better.

    Args:
        network: The network as it is.
        softness: Standard deviation of the ground's height, as a share of the flying height.

    Returns:
        The network with the ground's heights as observations, and the state to begin from.
    """
    state, origins, directions = _oriented(network)
    laid = _laid_points(network, origins, directions)
    ties = len(network.points.tie)
    above = origins[:, 2] - _ground_of_rays(network)
    known, weight = network.points.known.copy(), network.points.known_weight.copy()
    known[:ties, 2] = laid[:ties, 2]
    weight[:ties, 2] = 1 / (softness * float(np.median(above)))
    points = replace(network.points, known=known, known_weight=weight)
    return replace(network, points=points), replace(state, points=laid)


def at_state(network: Network, state: State) -> tuple[State, Flags]:
    """The state with its points where their rays now meet, as in `initial_state`."""
    directions = _directions(network, state.rotations)
    points, placed = _met_points(network, state.centres[network.rays.photo], directions)
    return replace(state, points=points), placed[network.rays.point]


def _oriented(network: Network) -> tuple[State, ObjectPoints, ObjectPoints]:
    """Present orientations (points still at nought), origins and directions of the rays."""
    photos = network.photos
    state = State(
        centres=np.array([photo.exterior.centre for photo in photos]),
        rotations=np.array([photo.exterior.object_from_image for photo in photos]),
        constants=np.array([constants_of(camera) for camera in network.cameras]),
        points=np.zeros((network.points.count, 3)),
    )
    directions = _directions(network, state.rotations)
    return state, state.centres[network.rays.photo], directions


def _directions(network: Network, rotations: Rotations) -> ObjectPoints:
    """Unit vectors along the rays; refraction is left to the adjustment."""
    image = np.empty((len(network.rays.photo), 3))
    camera_of_ray = network.camera[network.rays.photo]
    for index, camera in enumerate(network.cameras):
        rows = np.flatnonzero(camera_of_ray == index)
        image[rows, :2] = ideal_from_film(network.rays.film[rows], camera, VACUUM)
        image[rows, 2] = -camera.principal_distance_mm
    turned = np.einsum("nij,nj->ni", rotations[network.rays.photo], image)
    return turned / np.linalg.norm(turned, axis=1, keepdims=True)


def _ground_of_rays(network: Network) -> Scalars:
    """Mean height of the ground under the photo of each ray, metres."""
    return np.array([photo.ground_height_m for photo in network.photos])[network.rays.photo]


def _laid_points(
    network: Network, origins: ObjectPoints, directions: ObjectPoints
) -> Float64[np.ndarray, "points 3"]:
    """Control points where they are known to be, tie points where their rays reach the ground."""
    point, count = network.rays.point, network.points.count
    above = origins[:, 2] - _ground_of_rays(network)
    downwards = np.where(directions[:, 2] < 0, directions[:, 2], np.nan)
    hits = origins - directions * (above / downwards)[:, None]
    laid = np.stack([np.bincount(point, hits[:, k], count) for k in range(3)], axis=1)
    laid /= np.maximum(np.bincount(point, minlength=count), 1)[:, None]
    ties = len(network.points.tie)
    laid[ties:] = network.points.known[ties:]
    return np.where(np.isfinite(laid), laid, 0.0)


def _met_points(
    network: Network, origins: ObjectPoints, directions: ObjectPoints
) -> tuple[Float64[np.ndarray, "points 3"], Bool[np.ndarray, "points"]]:
    """Tie points where their rays meet (far off the ground: laid on it), and whether they do."""
    point, count = network.rays.point, network.points.count
    met, angles = closest_points(origins, directions, point, count)
    ground = _ground_of_rays(network)
    near_ground = np.abs(met[point, 2] - ground) < 0.5 * (origins[:, 2] - ground)
    astray = np.bincount(point, ~near_ground, count) > 0
    laid = _laid_points(network, origins, directions)
    ties = len(network.points.tie)
    astray[ties:] = True
    placed = angles >= SMALLEST_ANGLE
    placed[ties:] = True
    return np.where(astray[:, None], laid, met), placed
