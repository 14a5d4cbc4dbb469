"""Where an adjustment begins: orientations as they are, points where their rays meet."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float64

from core.adjustment.network import Network, State
from core.arrays import Flags, ObjectPoints, Scalars
from core.geometry.camera import COEFFICIENTS
from core.geometry.collinearity import VACUUM, Rotations, constants_of, ideal_from_film
from core.geometry.intersection import SMALLEST_ANGLE, closest_points


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
        additional=_additional(network),
        positioning=np.zeros(network.positioning.count),
        points=np.zeros((network.points.count, 3)),
    )
    directions = _directions(network, state.rotations)
    return state, state.centres[network.rays.photo], directions


def _additional(network: Network) -> Float64[np.ndarray, "cameras more"]:
    """Additional parameters nearest to the deformation the cameras have now."""
    count = len(network.additional.names)
    found = np.zeros((len(network.cameras), count))
    basis = network.additional.basis.reshape(count, COEFFICIENTS)
    for row, camera in enumerate(network.cameras):
        if camera.deformation_mm and count:
            found[row] = np.linalg.lstsq(basis.T, np.array(camera.deformation_mm))[0]
    return found


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
