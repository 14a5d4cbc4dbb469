"""Bundle adjustment of a block: all rays, known coordinates and priors in one least squares fit."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from jaxtyping import Float64
from threadpoolctl import ThreadpoolController

from core.arrays import Position
from core.block.accuracy import (
    intersect_checks,
    known_differences,
    predicted_residuals,
    rms_by_class,
)
from core.block.adjusted import AdjustmentOptions, AdjustmentReport, ExteriorSigmas
from core.block.block import Block
from core.block.minimum import Fit, begin, minimise
from core.block.network import Network, network_of
from core.block.reliability import (
    Chosen,
    Precision,
    RayPairs,
    cleared_rays,
    gross_errors,
    precision_of,
    standardised_residuals,
)
from core.block.solver import Pattern, normals_of, pattern_of
from core.block.start import at_state, initial_state, on_the_ground
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation
from core.geometry.partials import angles_by_increments
from core.geometry.robust import robust_sigma
from core.progress import Progress, Silent

DEFAULT = AdjustmentOptions()
SILENT = Silent()
MANY_UNKNOWNS = 3000
"""Below this many unknowns of photos one BLAS thread is faster than several on a busy machine."""
ROUNDS = 8
"""Rounds of leaving out gross errors at most."""
FINAL_STEPS = 2
"""A round begins only while at least this many steps are left for it."""
ROUGH = 500.0
"""Residuals at the start (in sigmas, their median) from which orientations count as rough."""
APPROACH_STEPS = 8
"""Steps at most with points held on the ground."""
GROUND_SOFTNESS = 0.05
"""How firmly they are held there, as a share of the flying height."""
TINY_DAMPING = 1e-10
"""Makes a datum defect invertible for the standard deviations."""


def adjust_block(
    block: Block, options: AdjustmentOptions = DEFAULT, progress: Progress = SILENT
) -> AdjustmentReport:
    """Adjust all oriented photos of a block together.

    Observations are the rays of tie points that two oriented photos or more show, the used
    measurements of control points, their coordinates, and the priors of orientations and cameras.
    Check points take no part in anything. When the steps do not settle, the block keeps the last
    orientations that were better than those before, and the report says `converged=False`.

    Args:
        block: The block; only photos with `oriented=True` take part, the others stay as they are.
        options: Weights and what is estimated.
        progress: Told of every step; may raise `Cancelled`.

    Returns:
        The adjusted block with residuals, standard deviations and check points.
    """
    network = network_of(block, options)
    if not network.photos:
        return _untouched(block)
    limit = 1 if 6 * len(network.photos) < MANY_UNKNOWNS else None
    with _threads().limit(limits=limit, user_api="blas"):
        solution = _adjust(network, options, progress)
        return _report(block, solution)


@cache
def _threads() -> ThreadpoolController:
    """Finding the BLAS libraries takes milliseconds: once is enough."""
    return ThreadpoolController()


@dataclass(frozen=True, slots=True, eq=False)
class _Judged:
    """A fit, how sure it is, and how its residuals stand to that."""

    fit: Fit
    precision: Precision
    standardised: RayPairs


@dataclass(frozen=True, slots=True, eq=False)
class _Solution:
    """An adjusted network."""

    network: Network
    judged: _Judged
    candidates: Chosen
    """Rays that took part at first."""

    @property
    def fit(self) -> Fit:
        """The last state."""
        return self.judged.fit

    @property
    def precision(self) -> Precision:
        """Its cofactors."""
        return self.judged.precision

    @property
    def redundancy(self) -> float:
        """Redundancy of rays and known coordinates: all observations' less that of the priors."""
        network, fit = self.network, self.fit
        priors, precision = network.priors, self.precision
        alive = np.bincount(network.rays.point[fit.taking_part], minlength=network.points.count) > 0
        observed = 2 * np.sum(fit.taking_part) + np.sum(network.points.known_weight[alive] > 0)
        unknown = 3 * np.sum(alive) + 6 * len(network.photos) + network.shared
        axes = np.arange(3)
        centres = precision.photos[:, axes, axes] * priors.centre_weights**2
        turned = fit.lin.angles_by_rotation
        angles = np.einsum("pij,pjk,pik->pi", turned, precision.photos[:, 3:, 3:], turned)
        weights = priors.constant_weights.ravel()[: network.shared]
        constants = np.diag(precision.constants) * weights**2
        return float(observed - unknown + centres.sum() + angles.sum() + constants.sum())

    @property
    def sigma_nought(self) -> float:
        """From rays and known coordinates; weak priors would only dilute it. NaN without any."""
        fit = self.fit
        squares = np.sum(fit.weights * fit.lin.residuals**2) + np.sum(fit.lin.ground**2)
        redundancy = self.redundancy
        return float(np.sqrt(squares / redundancy)) if redundancy > 0.5 else float("nan")


def _adjust(network: Network, options: AdjustmentOptions, progress: Progress) -> _Solution:
    """Robust first, then plain least squares without the gross errors."""
    pattern, left = pattern_of(network), options.max_iterations
    start = _start(network, pattern, left, progress)
    fit = start
    if options.robust:
        steps = max(left - 3 * FINAL_STEPS - fit.steps, 1)
        fit = minimise(network, pattern, fit, True, steps, progress)
        judged = _judge(network, pattern, fit)
        fit = _with_rays(network, fit, _kept(network, judged, start.taking_part))
    fit = minimise(network, pattern, fit, False, left - fit.steps, progress)
    judged = _judge(network, pattern, fit)
    if options.robust:
        judged = _snoop(network, pattern, judged, start.taking_part, options, progress)
    return _Solution(network, judged, start.taking_part)


def _start(network: Network, pattern: Pattern, steps: int, progress: Progress) -> Fit:
    """The present orientations; where they are rough, improved with points held on the ground."""
    start = begin(network, *initial_state(network))
    if robust_sigma(start.lin.residuals[:, start.taking_part].ravel()) < ROUGH:
        return start
    soft, state = on_the_ground(network, GROUND_SOFTNESS)
    laid = begin(soft, state, np.ones(len(network.rays.photo), dtype=np.bool_))
    better = minimise(soft, pattern, laid, True, min(APPROACH_STEPS, steps // 2), progress)
    again = begin(network, *at_state(network, better.state))
    return replace(again, steps=better.steps)


def _judge(network: Network, pattern: Pattern, fit: Fit) -> _Judged:
    """Cofactors and standardised residuals at the fit's state."""
    try:
        normals = normals_of(network, pattern, fit.lin, fit.weights, 0.0)
    except np.linalg.LinAlgError:
        normals = normals_of(network, pattern, fit.lin, fit.weights, TINY_DAMPING)
    precision = precision_of(network, pattern, fit.lin, normals)
    return _Judged(fit, precision, standardised_residuals(fit.lin, precision, fit.weights))


def _kept(network: Network, judged: _Judged, candidates: Chosen) -> Chosen:
    """Rays without those the others contradict, with those they no longer do."""
    fit, standardised = judged.fit, judged.standardised
    gross = gross_errors(network, fit.lin, judged.precision, standardised, fit.taking_part)
    back = cleared_rays(network, standardised, fit.taking_part, candidates)
    return (fit.taking_part & ~gross) | back


def _with_rays(network: Network, fit: Fit, taking_part: Chosen) -> Fit:
    """The fit with other rays; tie points left with one ray lose that too."""
    rays = network.rays
    alive = np.bincount(rays.point, taking_part, network.points.count) >= 2
    taking_part = taking_part & ((rays.measurement >= 0) | alive[rays.point]) & ~fit.lin.behind
    return replace(fit, taking_part=taking_part, weights=taking_part.astype(np.float64))


def _snoop(
    network: Network,
    pattern: Pattern,
    judged: _Judged,
    candidates: Chosen,
    options: AdjustmentOptions,
    progress: Progress,
) -> _Judged:
    """Data snooping: leave out the worst, adjust, look again; a ray comes back once at most."""
    for _ in range(ROUNDS):
        fit = judged.fit
        changed = _with_rays(network, fit, _kept(network, judged, candidates))
        left = options.max_iterations - fit.steps
        if np.array_equal(changed.taking_part, fit.taking_part) or left < FINAL_STEPS:
            return judged
        candidates = candidates & ~(changed.taking_part & ~fit.taking_part)
        fit = minimise(network, pattern, changed, False, left, progress)
        judged = _judge(network, pattern, fit)
    return judged


def _report(block: Block, solution: _Solution) -> AdjustmentReport:
    """The adjusted block and every figure about it."""
    network, fit = solution.network, solution.fit
    sigma = solution.sigma_nought
    scale = sigma if np.isfinite(sigma) else 1.0
    adjusted = _adjusted_block(block, solution)
    rays_px = _residuals_px(solution)
    control = _control_rays(solution)
    residuals = predicted_residuals(adjusted)
    for key, ray in control.items():
        residuals[key] = (float(rays_px[ray, 0]), float(rays_px[ray, 1]))
    ties = np.full((len(block.ties.point), 2), np.nan)
    seen = fit.taking_part & (network.rays.tie >= 0)
    ties[network.rays.tie[seen]] = rays_px[seen]
    positions, sigmas = _tie_points(block, solution, scale)
    surveyed, surveyed_sigmas = _control_points(solution, scale)
    checks = intersect_checks(adjusted)
    return AdjustmentReport(
        block=adjusted,
        sigma_nought=sigma,
        redundancy=round(solution.redundancy),
        iterations=fit.steps,
        converged=fit.settled,
        exterior_sigmas=_exterior_sigmas(solution, scale),
        residuals_px=residuals,
        surveyed_positions=surveyed,
        surveyed_sigmas_m=surveyed_sigmas,
        redundancy_numbers={
            key: float(1 - solution.precision.rays[:, ray].mean()) for key, ray in control.items()
        },
        tie_positions=positions,
        tie_sigmas_m=sigmas,
        tie_residuals_px=ties,
        checks=checks,
        rms_px=rms_by_class(adjusted, residuals, frozenset(control), ties),
        rms_m=known_differences(adjusted, surveyed, checks),
        rejected=_rejected(solution, rays_px),
    )


def _adjusted_block(block: Block, solution: _Solution) -> Block:
    """Photos and cameras with their adjusted values."""
    network, state = solution.network, solution.fit.state
    photos = {
        photo.photo_id: photo.with_exterior(
            ExteriorOrientation(state.centres[row], *angles_from_rotation(state.rotations[row])),
            oriented=True,
        )
        for row, photo in enumerate(network.photos)
    }
    cameras = dict(block.cameras)
    if network.estimate_cameras:
        for name, values in zip(network.camera_names, state.constants, strict=True):
            cameras[name] = _with_constants(cameras[name], values)
    return replace(block, cameras=cameras, photos={**block.photos, **photos})


def _with_constants(camera: Camera, values: Float64[np.ndarray, "6"]) -> Camera:
    distance, x0, y0, k1, k2, k3 = (float(value) for value in values)
    return camera.with_constants(distance, (x0, y0), (k1, k2, k3))


def _residuals_px(solution: _Solution) -> Float64[np.ndarray, "rays 2"]:
    """Residual (column, row) of every ray, by the linear part of its photo's interior."""
    rays = solution.network.rays
    film = (solution.fit.lin.residuals * rays.sigma_mm).T
    film_from_pixel = np.array(
        [photo.interior.film_from_pixel_matrix[:, :2] for photo in solution.network.photos]
    )
    pixel_from_film = np.linalg.inv(film_from_pixel)[rays.photo]
    return np.einsum("nij,nj->ni", pixel_from_film, film)


def _control_rays(solution: _Solution) -> dict[tuple[str, str], int]:
    """Rays of the control measurements that took part."""
    rays, fit = solution.network.rays, solution.fit
    used = np.flatnonzero(fit.taking_part & (rays.measurement >= 0))
    return {solution.network.measurements[rays.measurement[ray]].key: int(ray) for ray in used}


def _rejected(
    solution: _Solution, rays_px: Float64[np.ndarray, "rays 2"]
) -> dict[tuple[str, str], str]:
    """Control measurements that were left out, with the reason in words."""
    network, fit = solution.network, solution.fit
    lost = solution.candidates & ~fit.taking_part & (network.rays.measurement >= 0)
    times = solution.judged.standardised.max(axis=0)
    return {
        network.measurements[network.rays.measurement[ray]].key: (
            f"Gross error: {np.hypot(*rays_px[ray]):.1f} px off, "
            f"{times[ray]:.1f} times its standard deviation."
        )
        for ray in np.flatnonzero(lost)
    }


def _exterior_sigmas(solution: _Solution, scale: float) -> dict[str, ExteriorSigmas]:
    """Standard deviations of centres and angles."""
    cofactors = solution.precision.photos
    turned = angles_by_increments(solution.fit.state.rotations)
    angles = np.einsum("pij,pjk,pik->pi", turned, cofactors[:, 3:, 3:], turned)
    centres = np.diagonal(cofactors[:, :3, :3], axis1=1, axis2=2)
    return {
        photo.photo_id: ExteriorSigmas(scale * np.sqrt(centres[row]), scale * np.sqrt(angles[row]))
        for row, photo in enumerate(solution.network.photos)
    }


def _tie_points(
    block: Block, solution: _Solution, scale: float
) -> tuple[Float64[np.ndarray, "points 3"], Float64[np.ndarray, "points 3"]]:
    """Adjusted tie points and their standard deviations, NaN for those left out."""
    network, fit = solution.network, solution.fit
    positions, sigmas = np.full((2, block.ties.count, 3), np.nan)
    alive = np.bincount(network.rays.point[fit.taking_part], minlength=network.points.count) > 0
    rows = np.flatnonzero(alive[: len(network.points.tie)])
    positions[network.points.tie[rows]] = fit.state.points[rows]
    sigmas[network.points.tie[rows]] = scale * np.sqrt(solution.precision.points[rows])
    return positions, sigmas


def _control_points(
    solution: _Solution, scale: float
) -> tuple[dict[str, Position], dict[str, Position]]:
    """Adjusted coordinates of control points and their standard deviations."""
    network, fit = solution.network, solution.fit
    alive = set(network.rays.point[fit.taking_part].tolist())
    first = len(network.points.tie)
    rows = {name: first + row for row, name in enumerate(network.points.control)}
    rows = {name: row for name, row in rows.items() if row in alive}
    positions = {name: fit.state.points[row].copy() for name, row in rows.items()}
    variances = solution.precision.points
    return positions, {name: scale * np.sqrt(variances[row]) for name, row in rows.items()}


def _untouched(block: Block) -> AdjustmentReport:
    """What can be said of a block without any oriented photo."""
    points, rays = block.ties.count, len(block.ties.point)
    residuals = predicted_residuals(block)
    missing = np.full((rays, 2), np.nan)
    return AdjustmentReport(
        block=block,
        sigma_nought=float("nan"),
        redundancy=0,
        iterations=0,
        converged=False,
        exterior_sigmas={},
        residuals_px=residuals,
        surveyed_positions={},
        surveyed_sigmas_m={},
        redundancy_numbers={},
        tie_positions=np.full((points, 3), np.nan),
        tie_sigmas_m=np.full((points, 3), np.nan),
        tie_residuals_px=missing,
        checks=(),
        rms_px=rms_by_class(block, residuals, frozenset(), missing),
        rms_m=known_differences(block, {}, ()),
        rejected={},
    )
