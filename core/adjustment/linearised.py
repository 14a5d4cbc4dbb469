"""All observations of a network at one state: residuals and derivatives in standard deviations.

Arrays are laid out with the rays last.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from core.adjustment.network import CONSTANTS, Network, State
from core.arrays import Indices
from core.geometry.camera import by_parameters
from core.geometry.collinearity import (
    Deformation,
    FilmPartials,
    RayModel,
    angles_by_increments,
    angles_from_rotations,
    deformation_of_cameras,
    ray_model,
    rotations_from_increments,
    stacked_partials,
)


@dataclass(frozen=True, slots=True, eq=False)
class Linearised:
    """The model at one state, every observation divided by its standard deviation."""

    by_photo: Float64[np.ndarray, "2 6 rays"]
    """Rays by centre and rotation; by the object point it is the negative of the first three."""
    by_camera: Float64[np.ndarray, "2 told rays"]
    """Rays by scaled camera constants; empty (2 0 rays) when these are not estimated."""
    residuals: Float64[np.ndarray, "2 rays"]
    """Computed minus measured, in standard deviations."""
    behind: Bool[np.ndarray, "rays"]
    """Rays whose point lies behind the camera: their derivatives and residuals are nought."""
    ground: Float64[np.ndarray, "points 3"]
    """Residuals of known coordinates of points."""
    centres: Float64[np.ndarray, "photos 3"]
    """Residuals of a-priori perspective centres."""
    angles: Float64[np.ndarray, "photos 3"]
    """Residuals of a-priori angles."""
    angles_by_rotation: Float64[np.ndarray, "photos 3 3"]
    """Their derivatives by the rotation increments."""
    centres_by_positioning: Float64[np.ndarray, "photos 3 unknowns"]
    """Derivatives of the a-priori centres by shifts and drifts."""
    angles_by_positioning: Float64[np.ndarray, "photos 3 unknowns"]
    """Derivatives of the a-priori angles by the misalignment."""
    constants: Float64[np.ndarray, "cameras lens"]
    """Residuals of a-priori camera constants."""
    positioning: Float64[np.ndarray, "unknowns"]
    """Residuals of the loose priors of shifts, drifts and misalignment."""
    shifts: Float64[np.ndarray, "shifts"]
    """Residuals of the priors of references' shifts."""

    @property
    def prior_cost(self) -> float:
        """Squared residuals of everything that is known beforehand."""
        known = (self.ground, self.centres, self.angles, self.constants, self.positioning)
        return float(sum(np.sum(part**2) for part in (*known, self.shifts)))


def linearise(network: Network, state: State) -> Linearised:
    """Residuals and derivatives of all observations."""
    rays, priors, positioning = network.rays, network.priors, network.positioning
    offsets = state.points[rays.point] - state.centres[rays.photo]
    models = ray_models(network, state, rays.photo)
    # A step too far may leave the numbers: its cost is then no number, and the step is not taken.
    with np.errstate(over="ignore", invalid="ignore"):
        partials = stacked_partials(np.ascontiguousarray(offsets.T), models)
    by_photo = np.concatenate([partials.by_centre, partials.by_rotation], axis=1)
    by_camera, constants = _camera_part(network, state, partials)
    residuals = partials.film - rays.film.T
    behind = np.isnan(residuals[0])
    if behind.any():
        by_photo[:, :, behind], by_camera[:, :, behind], residuals[:, behind] = 0.0, 0.0, 0.0
    weights = priors.centre_weights[:, :, None]
    shifted = state.centres + positioning.by_centre @ state.positioning
    angles, by_rotation, by_misalignment = _angles(network, state)
    return Linearised(
        by_photo=by_photo / rays.sigma_mm,
        by_camera=by_camera / rays.sigma_mm,
        residuals=residuals / rays.sigma_mm,
        behind=behind,
        ground=(network.points.shifts.added(state.points, state.shifts) - network.points.known)
        * network.points.known_weight,
        centres=(shifted - priors.centres) * priors.centre_weights,
        angles=angles,
        angles_by_rotation=by_rotation,
        centres_by_positioning=weights * positioning.by_centre,
        angles_by_positioning=by_misalignment,
        constants=constants,
        positioning=state.positioning * positioning.weights,
        shifts=state.shifts * network.points.shifts.weights,
    )


def _angles(
    network: Network, state: State
) -> tuple[
    Float64[np.ndarray, "photos 3"],
    Float64[np.ndarray, "photos 3 3"],
    Float64[np.ndarray, "photos 3 unknowns"],
]:
    """Residuals of a-priori angles, and their derivatives by rotations and by the misalignment.

    Of R exp[w] exp[m] with a common m: by m as by an increment, by w turned back by m.
    """
    priors, positioning = network.priors, network.positioning
    rotations, turn = state.rotations, np.eye(3)
    if positioning.misaligned:
        turn = rotations_from_increments(state.positioning[None, -3:])[0]
        rotations = np.where(positioning.turned[:, None, None], rotations @ turn, rotations)
    off = angles_from_rotations(rotations) - priors.angles
    off = np.remainder(off + np.pi, 2 * np.pi) - np.pi
    by_turn = angles_by_increments(rotations) * priors.angle_weights[:, :, None]
    by_unknowns = np.zeros((len(rotations), 3, positioning.count))
    by_rotation = by_turn
    if positioning.misaligned:
        turned = positioning.turned[:, None, None]
        by_unknowns[:, :, -3:] = np.where(turned, by_turn, 0.0)
        by_rotation = np.where(turned, by_turn @ turn.T, by_turn)
    return off * priors.angle_weights, by_rotation, by_unknowns


def ray_models(network: Network, state: State, photo: Indices) -> RayModel:
    """The model constants of rays in some photos."""
    model = ray_model(state.rotations, state.constants[network.camera], network.air)
    return RayModel(
        np.take(model.rotation, photo, axis=2),
        np.take(model.constants, photo, axis=1),
        np.take(model.atmosphere, photo, axis=1),
        _deformation(network, state, network.camera[photo]),
    )


def _deformation(network: Network, state: State, camera_of_ray: Indices) -> Deformation | None:
    """What the additional parameters do now; held cameras keep their own."""
    if not network.estimate_cameras:
        return deformation_of_cameras(network.cameras, camera_of_ray)
    if not len(network.additional.names):
        return None
    coefficients = np.tensordot(state.additional, network.additional.basis, axes=1)
    return Deformation(coefficients, halves_of(network), camera_of_ray)


def halves_of(network: Network) -> Float64[np.ndarray, "cameras"]:
    """What each camera's image coordinates are normalised by, millimetres."""
    return np.array([camera.half_mm for camera in network.cameras])


def _camera_part(
    network: Network, state: State, partials: FilmPartials
) -> tuple[Float64[np.ndarray, "2 told rays"], Float64[np.ndarray, "cameras lens"]]:
    """Derivatives by scaled constants and the constants' own residuals; empty when held."""
    if not network.estimate_cameras:
        return partials.by_camera[:, :0], np.zeros((len(network.cameras), network.lens))
    known = (state.constants - network.priors.constants)[:, :CONSTANTS]
    off = np.concatenate([known, state.additional], axis=1) * network.scale
    by_camera = by_scaled_camera(network, network.rays.photo, partials)
    return by_camera, off * network.priors.constant_weights


def by_scaled_camera(
    network: Network, photo: Indices, partials: FilmPartials
) -> Float64[np.ndarray, "2 lens rays"]:
    """Derivatives of rays in some photos by their cameras' scaled constants, millimetres."""
    scale = np.ascontiguousarray(network.scale[:, :CONSTANTS].T)
    by_camera = partials.by_camera / np.take(scale, network.camera[photo], axis=1)
    if not len(network.additional.names):
        return by_camera
    xi, eta = partials.ideal / halves_of(network)[network.camera[photo]]
    return np.concatenate([by_camera, by_parameters(xi, eta, network.additional.basis)], axis=1)
