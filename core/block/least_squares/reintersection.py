"""Points intersected again, each from photos and cameras moved for it alone.

The closed form of a point left out follows tangents. Photos move by centimetres then, but the point
by a metre or two, over which rays that meet bend by d^2 / H: a millimetre. Its own rays alone know
of that, so it alone is solved again.
"""

import numpy as np
from jaxtyping import Bool, Float64, Int

from core.block.least_squares.banded import SIZE
from core.block.least_squares.linearised import halves_of
from core.block.least_squares.minimum import Fit
from core.block.least_squares.network import CONSTANTS, Network, constants_of_atmospheres
from core.geometry.partials import (
    Deformation,
    RayModel,
    deformation_of_cameras,
    ray_model,
    rotations_from_increments,
    stacked_partials,
)

ROUNDS = 2
"""Two metres off, the first comes to a millimetre, the second to less than a micrometre."""

Steps = Float64[np.ndarray, "unknowns points"]
"""Change of all photos' and shared unknowns, one column for each point."""
Rays = Int[np.ndarray, "rays"]
"""A number for each ray of these points."""


def met_again(
    network: Network,
    fit: Fit,
    points: Int[np.ndarray, "points"],
    free: Bool[np.ndarray, "points 3"],
    steps: Steps,
) -> Float64[np.ndarray, "points 3"]:
    """Where the rays that take part meet, with what is still known of each point.

    Args:
        network: What was adjusted.
        fit: Its last state.
        points: Rows of the points.
        free: Known coordinates that count no longer.
        steps: What the photos and cameras of each point do.

    Returns:
        Their positions, metres; NaN where one would lie behind a camera.
    """
    item = np.full(network.points.count, -1)
    item[points] = np.arange(len(points))
    rays = np.flatnonzero(fit.taking_part & (item[network.rays.point] >= 0))
    item = item[network.rays.point[rays]]
    centres, model = _moved(network, fit, rays, item, steps)
    film, sigma = network.rays.film[rays].T, network.rays.sigma_mm[rays]
    known, weights = network.points.known[points], network.points.known_weight[points]
    weights = np.where(free, 0.0, weights) ** 2
    found = fit.state.points[points].copy()
    for _ in range(ROUNDS):
        partials = stacked_partials(np.ascontiguousarray((found[item] - centres).T), model)
        by_point, residuals = -partials.by_centre / sigma, (partials.film - film) / sigma
        normal, side = np.zeros((len(points), 3, 3)), (found - known) * weights
        normal[:, range(3), range(3)] = weights
        np.add.at(normal, item, np.einsum("ain,ajn->nij", by_point, by_point))
        np.add.at(side, item, np.einsum("ain,an->ni", by_point, residuals))
        found -= np.linalg.solve(normal, side[:, :, None])[:, :, 0]
    return found


def _moved(
    network: Network, fit: Fit, rays: Rays, item: Rays, steps: Steps
) -> tuple[Float64[np.ndarray, "rays 3"], RayModel]:
    """Centre and model of each ray after the step of its own point."""
    state, photo = fit.state, network.rays.photo[rays]
    camera, count = network.camera[photo], len(network.photos)
    own = steps[: SIZE * count].reshape(count, SIZE, -1)[photo, :, item]
    constants, bent = state.constants[camera], deformation_of_cameras(network.cameras, camera)
    if network.lensed:
        shared = steps[SIZE * count :][: network.lensed]
        lens = shared.reshape(len(network.cameras), network.lens, -1)[camera, :, item]
        constants[:, :CONSTANTS] += (lens / network.scale[camera])[:, :CONSTANTS]
        values = state.additional[camera] + lens[:, CONSTANTS:]
        coefficients = np.tensordot(values, network.additional.basis, axes=1)
        bent = Deformation(coefficients, halves_of(network)[camera], np.arange(len(rays)))
    turned = state.rotations[photo] @ rotations_from_increments(own[:, 3:])
    air = constants_of_atmospheres(network)[photo]
    return state.centres[photo] + own[:, :3], ray_model(turned, constants, air, bent)
