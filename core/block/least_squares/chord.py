"""One more step of the whole block without some of a point's coordinates."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from core.arrays import Position
from core.block.least_squares.linearised import Linearised, linearise
from core.block.least_squares.network import Network, State
from core.block.least_squares.roots import forward3
from core.block.least_squares.solution import Solution
from core.block.least_squares.solver import Increment, Normals, Weights, normals_of, solve

Gradient = Float64[np.ndarray, "points 3"]
"""Half the derivative of the squared residuals by the points."""


def without_coordinates(
    solution: Solution,
    point: int,
    axes: list[int],
    predicted: Float64[np.ndarray, "axes"],
    remaining: Float64[np.ndarray, "axes axes"],
    anew: bool,
) -> Position:
    """Where a point comes to lie when some of its known coordinates are left out, metres.

    The closed form leads to a first place. There residuals and derivatives are taken again, and a
    step of Gauss and Newton leads on; as long as the photos have not turned much, on the equations
    that are factored already, less the point's coordinates.

    Args:
        solution: The adjusted network.
        point: Row of the point.
        axes: Its coordinates that are left out.
        predicted: What they contradict all others by, in their standard deviations.
        remaining: I - A Q A^T of them.
        anew: Whether the equations are built and factored again.
    """
    network, fit, count = solution.network, solution.fit, solution.network.points.count
    weights = network.points.known_weight[point, axes]
    pull = np.zeros((count, 3))
    pull[point, axes] = -weights * predicted
    first = solve(network, solution.pattern, _pulled(network, solution.normals, pull))
    state = fit.state.moved(first.photos, first.constants, first.positioning, first.points)
    if anew:
        return state.points[point] + _anew(solution, state, point, axes).points[point]
    lin = linearise(network, state)
    lin.ground[point, axes] = 0.0
    more = _solved(solution, lin, fit.weights).points[point]
    share = np.eye(len(axes)) - remaining
    more[axes] += share @ np.linalg.solve(remaining, weights * more[axes]) / weights
    return state.points[point] + more


def _anew(solution: Solution, state: State, point: int, axes: list[int]) -> Increment:
    """A step from a state with the equations of that state."""
    weights = solution.network.points.known_weight.copy()
    weights[point, axes] = 0.0
    points = replace(solution.network.points, known_weight=weights)
    network, pattern = replace(solution.network, points=points), solution.pattern
    lin = linearise(network, state)
    return solve(network, pattern, normals_of(network, pattern, lin, solution.fit.weights, 0.0))


def _pulled(network: Network, normals: Normals, gradient: Gradient) -> Normals:
    """The equations with a gradient by the points alone."""
    side = forward3(normals.root, np.ascontiguousarray(gradient.T)).T
    by_ray = np.take(side, network.rays.point, axis=0)
    taken = np.einsum("rnk,nk->rn", normals.photo_rays, by_ray)
    count, shared = len(network.photos), len(normals.camera_side)
    own = np.stack([-np.bincount(network.rays.photo, row, count) for row in taken], axis=1)
    camera = np.zeros(shared)
    camera[: network.lensed] = -np.tensordot(normals.camera_points, side, axes=2)
    return replace(normals, point_side=side, photo_side=own, camera_side=camera)


def _solved(solution: Solution, lin: Linearised, weights: Weights) -> Increment:
    """The step of the equations as they are from the gradient of another state."""
    network, pattern = solution.network, solution.pattern
    rays, points, photos = network.rays, network.points.count, len(network.photos)
    by_ray = np.einsum("arn,an->rn", lin.by_photo, weights * lin.residuals)
    ground = lin.ground * network.points.known_weight
    by_point = np.stack([-np.bincount(rays.point, row, points) for row in by_ray[:3]], axis=1)
    pulled = _pulled(network, solution.normals, by_point + ground)
    own = np.stack([np.bincount(rays.photo, row, photos) for row in by_ray], axis=1)
    own[:, :3] += network.priors.centre_weights * lin.centres
    own[:, 3:] += np.einsum("pij,pi->pj", lin.angles_by_rotation, lin.angles)
    normals = replace(
        pulled,
        photo_side=pulled.photo_side + own,
        camera_side=pulled.camera_side + _by_shared(network, lin, weights),
    )
    return solve(network, pattern, normals)


def _by_shared(
    network: Network, lin: Linearised, weights: Weights
) -> Float64[np.ndarray, "shared"]:
    """The gradient by cameras and positioning."""
    priors, lensed = network.priors, network.lensed
    by_ray = np.einsum("arn,an->rn", lin.by_camera, weights * lin.residuals)
    camera = network.camera[network.rays.photo]
    lens = [np.bincount(camera, row, len(network.cameras)) for row in by_ray]
    own = np.array(lens).T.ravel() + (priors.constant_weights * lin.constants).ravel()[:lensed]
    measured = np.einsum("pij,pi->j", lin.centres_by_positioning, lin.centres)
    measured += np.einsum("pij,pi->j", lin.angles_by_positioning, lin.angles)
    return np.append(own, measured + network.positioning.weights * lin.positioning)
