"""Ceres on one of our blocks, by pycolmap's cost functions: one run, told as JSON.

`python -m tests.benchmarks.ceres_peer STRIPS PHOTOS SEED`; needs `pip install pycolmap pyceres`.
"""

import json
import os
import sys
from importlib import import_module
from time import perf_counter
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.gauss_newton import initial_state
from core.adjustment.network import Network, State, network_of
from tests.benchmarks.blocks import comparable

CERES_FROM_IMAGE = np.diag([1.0, -1.0, -1.0])
"""COLMAP looks along +z with y down."""
THREADS = 2
KEPT: list[Any] = []
"""What must live until the process ends."""


def main() -> None:
    """Adjust, print the figures, and leave without the interpreter's clean-up.

    A manifold shared by two problems is freed twice there.
    """
    strips, photos, seed = (int(word) for word in sys.argv[1:4])
    network = network_of(comparable(strips, photos, seed), AdjustmentOptions(robust=False))
    state, _ = initial_state(network)
    sys.stdout.write(json.dumps(run(network, state)) + "\n")
    sys.stdout.flush()
    os._exit(0)


def run(network: Network, start: State) -> dict[str, float]:
    """Sparse Schur complement until the relative change of the cost is below 1e-6."""
    ceres: Any = import_module("pyceres")
    colmap: Any = import_module("pycolmap")
    body, adjuster = _reconstruction(colmap, network, start)
    begun = perf_counter()
    problem = _problem(ceres, colmap, network, start, body, adjuster)
    KEPT.extend([body, adjuster, problem])
    options = ceres.SolverOptions()
    options.linear_solver_type = ceres.LinearSolverType.SPARSE_SCHUR
    options.num_threads = THREADS
    options.function_tolerance = 1e-6
    options.gradient_tolerance, options.parameter_tolerance = 1e-14, 1e-14
    options.max_num_iterations = 50
    options.minimizer_progress_to_stdout = False
    ready = perf_counter()
    summary = ceres.SolverSummary()
    ceres.solve(options, problem, summary)
    done = perf_counter()
    asked = colmap.BACovarianceOptions()
    asked.params = colmap.BACovarianceOptionsParams.POSES
    found = colmap.estimate_ba_covariance_from_problem(asked, body, problem)
    return {
        "set_up_s": ready - begun,
        "solve_s": done - ready,
        "covariance_s": perf_counter() - done if found is not None else float("nan"),
        "cost": 2 * summary.final_cost,
        "steps": summary.num_successful_steps + summary.num_unsuccessful_steps,
    }


def _reconstruction(colmap: Any, network: Network, start: State) -> tuple[Any, Any]:
    """Poses and points in COLMAP's own memory, and an adjuster that knows their manifolds."""
    origin, rays = start.centres.mean(axis=0), network.rays
    body = colmap.Reconstruction()
    c, x0, y0, k1, k2, _ = start.constants[0]
    values = [c, x0, -y0, k1 * c**2, k2 * c**4]
    camera = colmap.Camera(model="RADIAL", width=180, height=180, params=values, camera_id=1)
    body.add_camera_with_trivial_rig(camera)
    config = colmap.BundleAdjustmentConfig()
    place = np.zeros(len(rays.photo), dtype=np.int64)
    for row in range(len(network.photos)):
        first, last = int(rays.first[row]), int(rays.first[row + 1])
        place[first:last] = np.arange(last - first)
        film = rays.film[first:last] * [1.0, -1.0]
        seen = colmap.Point2DList([colmap.Point2D(point) for point in film])
        image = colmap.Image(name=str(row), camera_id=1, image_id=row + 1, points2D=seen)
        turn = CERES_FROM_IMAGE @ start.rotations[row].T
        pose = colmap.Rigid3d(
            colmap.Rotation3d(Rotation.from_matrix(turn).as_quat()),
            -turn @ (start.centres[row] - origin),
        )
        body.add_image_with_trivial_frame(image, pose)
        config.add_image(row + 1)
    order = np.argsort(rays.point, kind="stable")
    ends = np.searchsorted(rays.point[order], np.arange(network.points.count + 1))
    for row in range(network.points.count):
        track = colmap.Track()
        mine = order[ends[row] : ends[row + 1]].tolist()
        # The adjuster, which is only asked for its manifolds, takes no point of one photo.
        for ray in mine if len(mine) > 1 else []:
            track.add_element(int(rays.photo[ray]) + 1, int(place[ray]))
        body.add_point3D(start.points[row] - origin, track)
    options = colmap.BundleAdjustmentOptions()
    options.refine_principal_point = True
    return body, colmap.create_default_ceres_bundle_adjuster(options, config, body)


def _problem(
    ceres: Any, colmap: Any, network: Network, start: State, body: Any, adjuster: Any
) -> Any:
    """Residual blocks of rays, known coordinates, measured centres and the camera."""
    costs: Any = import_module("pycolmap._core.cost_functions")
    model, origin, rays = colmap.CameraModelId.RADIAL, start.centres.mean(axis=0), network.rays
    poses = [body.frames[row + 1].rig_from_world.params for row in range(len(network.photos))]
    points = [body.points3D[row + 1].xyz for row in range(network.points.count)]
    camera, problem = body.cameras[1].params, ceres.Problem()
    film = rays.film * [1.0, -1.0]
    for ray in range(len(rays.photo)):
        spread = np.eye(2) * rays.sigma_mm[ray] ** 2
        cost = costs.ReprojErrorCost(model, spread, film[ray])
        own = [points[rays.point[ray]], poses[rays.photo[ray]], camera]
        problem.add_residual_block(cost, None, own)
    for row in np.flatnonzero(network.points.known_weight.any(axis=1)):
        spread = np.diag(1 / network.points.known_weight[row] ** 2)
        prior = ceres.factors.NormalPrior(network.points.known[row] - origin, spread)
        problem.add_residual_block(prior, None, [points[row]])
    for row, pose in enumerate(poses):
        spread = np.diag(1 / network.priors.centre_weights[row] ** 2)
        known = network.priors.centres[row] - origin
        cost = costs.AbsolutePosePositionPriorCost(spread, known)
        problem.add_residual_block(cost, None, [pose])
        problem.set_manifold(pose, adjuster.problem.get_manifold(pose))
    distance = network.priors.constants[0, 0]
    units = np.array([1.0, 1.0, 1.0, distance**2, distance**4])
    known = network.priors.constants[0, :5] * units * [1, 1, -1, 1, 1]
    sigma = units / (network.priors.constant_weights[0] * network.scale[0])
    problem.add_residual_block(ceres.factors.NormalPrior(known, np.diag(sigma**2)), None, [camera])
    return problem


if __name__ == "__main__":
    main()
