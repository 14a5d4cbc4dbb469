"""All observations of a network at one state: residuals and derivatives in standard deviations.

Arrays are laid out with the rays last.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from core.block.network import Network, State, constants_of_atmospheres
from core.geometry.partials import (
    RayModel,
    angles_by_increments,
    angles_from_rotations,
    ray_model,
    stacked_partials,
)

LENS = 5
"""Unknown constants of one camera."""


@dataclass(frozen=True, slots=True, eq=False)
class Linearised:
    """The model at one state, every observation divided by its standard deviation."""

    by_photo: Float64[np.ndarray, "2 6 rays"]
    """Rays by centre and rotation; by the object point it is the negative of the first three."""
    by_camera: Float64[np.ndarray, "2 lens rays"]
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
    constants: Float64[np.ndarray, "cameras 5"]
    """Residuals of a-priori camera constants."""

    @property
    def prior_cost(self) -> float:
        """Squared residuals of everything that is known beforehand."""
        known = (self.ground, self.centres, self.angles, self.constants)
        return float(sum(np.sum(part**2) for part in known))


def linearise(network: Network, state: State) -> Linearised:
    """Residuals and derivatives of all observations."""
    rays, priors = network.rays, network.priors
    offsets = state.points[rays.point] - state.centres[rays.photo]
    partials = stacked_partials(np.ascontiguousarray(offsets.T), _models(network, state))
    by_photo = np.concatenate([partials.by_centre, partials.by_rotation], axis=1)
    by_camera, constants = _camera_part(network, state, partials.by_camera)
    residuals = partials.film - rays.film.T
    behind = np.isnan(residuals[0])
    if behind.any():
        by_photo[:, :, behind], by_camera[:, :, behind], residuals[:, behind] = 0.0, 0.0, 0.0
    angles = angles_from_rotations(state.rotations) - priors.angles
    angles = np.remainder(angles + np.pi, 2 * np.pi) - np.pi
    by_rotation = angles_by_increments(state.rotations) * priors.angle_weights[:, :, None]
    return Linearised(
        by_photo=by_photo / rays.sigma_mm,
        by_camera=by_camera / rays.sigma_mm,
        residuals=residuals / rays.sigma_mm,
        behind=behind,
        ground=(state.points - network.points.known) * network.points.known_weight,
        centres=(state.centres - priors.centres) * priors.centre_weights,
        angles=angles * priors.angle_weights,
        angles_by_rotation=by_rotation,
        constants=constants,
    )


def _models(network: Network, state: State) -> RayModel:
    """The model constants of every ray."""
    photo = network.rays.photo
    model = ray_model(
        state.rotations, state.constants[network.camera], constants_of_atmospheres(network)
    )
    return RayModel(
        np.take(model.rotation, photo, axis=2),
        np.take(model.constants, photo, axis=1),
        np.take(model.atmosphere, photo, axis=1),
    )


def _camera_part(
    network: Network, state: State, by_camera: Float64[np.ndarray, "2 5 rays"]
) -> tuple[Float64[np.ndarray, "2 lens rays"], Float64[np.ndarray, "cameras 5"]]:
    """Derivatives by scaled constants and the constants' own residuals; empty when held."""
    if not network.estimate_cameras:
        return by_camera[:, :0], np.zeros((len(network.cameras), LENS))
    off = (state.constants - network.priors.constants)[:, :LENS] * network.scale
    by_ray = network.scale[network.camera[network.rays.photo]].T
    return by_camera / by_ray, off * network.priors.constant_weights
