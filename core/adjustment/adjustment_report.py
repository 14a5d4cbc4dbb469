"""Make the report of an adjustment: residuals, standard deviations, reasons."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from core.adjustment.accuracy import (
    check_freedom,
    check_predictions,
    check_sigmas,
    intersect_checks,
    known_differences,
    pointing_variance,
    predicted_residuals,
    rms_by_class,
)
from core.adjustment.adjusted import AdjustmentReport, CheckResult, ExteriorSigmas, NewPoint
from core.adjustment.contradictions import find_contradictions
from core.adjustment.equations import Equations
from core.adjustment.input_checks import Sound
from core.adjustment.significance import shared_parameters
from core.adjustment.solution import Solution
from core.arrays import Position
from core.block import Block
from core.doubts import Doubt
from core.geometry.camera import Camera
from core.geometry.collinearity import angles_by_increments
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation
from core.said import say


def report_of(block: Block, sound: Sound, solution: Solution, risk: float) -> AdjustmentReport:
    """The adjusted block and every figure about it.

    Args:
        block: The block as it was given.
        sound: What was taken out of it beforehand.
        solution: The adjusted network.
        risk: Probability that a good measurement is taken for a gross error.
    """
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
    new = _new_points(block, solution, (surveyed, surveyed_sigmas), rays_px)
    for point in new:
        del surveyed[point.point_id], surveyed_sigmas[point.point_id]
    steering = frozenset(key for key in control if block.surveyed[key[0]].role == "control")
    checks, freedom = _checks(adjusted, solution, scale)
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
        check_freedom=freedom,
        rms_px=rms_by_class(adjusted, residuals, steering, ties),
        rms_m=known_differences(adjusted, surveyed, checks),
        rejected={**sound.reasons, **_rejected(solution, rays_px)},
        tie_reasons=_tie_reasons(solution, rays_px),
        contradictions=find_contradictions(adjusted, solution, checks, risk),
        classes=solution.classes,
        parameters=shared_parameters(
            network, fit.state, solution.precision, solution.held, sigma_nought=scale
        ),
        doubts=(*sound.doubts, *_behind(solution)),
        new_points=new,
        condition=solution.normals.factor.condition,
    )


def _behind(solution: Solution) -> list[Doubt]:
    """Rays whose point would lie behind the camera: their photo looks the wrong way."""
    network, behind = solution.network, solution.fit.lin.behind
    counts = np.bincount(network.rays.photo[behind], minlength=len(network.photos))
    return [
        Doubt(
            "point-behind-camera",
            network.photos[photo].photo_id,
            say(
                "{count} measured points would lie behind the camera and were left out. The "
                "orientation is upside down, or the points belong to another photo.",
                count=counts[photo],
            ),
            evidence={"points": int(counts[photo])},
        )
        for photo in np.flatnonzero(counts).tolist()
    ]


def _checks(
    adjusted: Block, solution: Solution, scale: float
) -> tuple[tuple[CheckResult, ...], float]:
    """Check points with what the adjustment says they should be worth, and how freely."""
    checks = intersect_checks(adjusted)
    if not checks:
        return (), 0.0
    equations = Equations(solution)
    predictions = check_predictions(equations, adjusted, checks)
    pointing = pointing_variance(equations, predictions, scale)
    sigmas = check_sigmas(equations, predictions, scale, pointing)
    told = tuple(
        replace(check, sigma_m=sigmas[check.point_id]) if check.point_id in sigmas else check
        for check in checks
    )
    return told, check_freedom(equations, adjusted, predictions, scale, pointing)


def _adjusted_block(block: Block, solution: Solution) -> Block:
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
        bent = np.tensordot(state.additional, network.additional.basis, axes=1)
        for row, name in enumerate(network.camera_names):
            camera = network.cameras[row]
            cameras[name] = _with_constants(camera, state.constants[row], bent[row].ravel())
        photos = {
            photo_id: replace(photo, camera=network.camera_names[network.camera[row]])
            for row, (photo_id, photo) in enumerate(photos.items())
        }
    return replace(block, cameras=cameras, photos={**block.photos, **photos})


def _with_constants(
    camera: Camera, values: Float64[np.ndarray, "6"], bent: Float64[np.ndarray, "50"]
) -> Camera:
    distance, x0, y0, k1, k2, k3 = (float(value) for value in values)
    deformation = tuple(bent.tolist()) if bent.any() else ()
    return camera.with_constants(distance, (x0, y0), (k1, k2, k3), deformation)


def _residuals_px(solution: Solution) -> Float64[np.ndarray, "rays 2"]:
    """Residual (column, row) of every ray, by the linear part of its photo's interior."""
    rays = solution.network.rays
    film = (solution.fit.lin.residuals * rays.sigma_mm).T
    film_from_pixel = np.array(
        [photo.interior.film_from_pixel_matrix[:, :2] for photo in solution.network.photos]
    )
    pixel_from_film = np.linalg.inv(film_from_pixel)[rays.photo]
    return np.einsum("nij,nj->ni", pixel_from_film, film)


def _control_rays(solution: Solution) -> dict[tuple[str, str], int]:
    """Rays of the control measurements that took part."""
    rays, fit = solution.network.rays, solution.fit
    used = np.flatnonzero(fit.taking_part & (rays.measurement >= 0))
    return {solution.network.measurements[rays.measurement[ray]].key: int(ray) for ray in used}


def _rejected(
    solution: Solution, rays_px: Float64[np.ndarray, "rays 2"]
) -> dict[tuple[str, str], str]:
    """Control measurements that were left out, with the reason in words."""
    network, fit = solution.network, solution.fit
    lost = (solution.candidates | fit.lin.behind) & ~fit.taking_part
    return {
        network.measurements[network.rays.measurement[ray]].key: _why(solution, rays_px, ray)
        for ray in np.flatnonzero(lost & (network.rays.measurement >= 0)).tolist()
    }


def _tie_reasons(solution: Solution, rays_px: Float64[np.ndarray, "rays 2"]) -> dict[int, str]:
    """Rays of tie points that were left out, with the reason in words."""
    fit, tie = solution.fit, solution.network.rays.tie
    lost = (solution.candidates | fit.lin.behind) & ~fit.taking_part & (tie >= 0)
    return {int(tie[ray]): _why(solution, rays_px, ray) for ray in np.flatnonzero(lost).tolist()}


def _why(solution: Solution, rays_px: Float64[np.ndarray, "rays 2"], ray: int) -> str:
    """Why a ray was left out."""
    if solution.fit.lin.behind[ray]:
        return "The point would lie behind the camera."
    times = float(solution.standardised[:, ray].max())
    off = float(np.hypot(*rays_px[ray]))
    if times < 3.0:
        return f"The other ray of its point is a gross error ({off:.1f} px off)."
    return f"Gross error: {off:.1f} px off, {times:.1f} times its standard deviation."


def _exterior_sigmas(solution: Solution, scale: float) -> dict[str, ExteriorSigmas]:
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
    block: Block, solution: Solution, scale: float
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
    solution: Solution, scale: float
) -> tuple[dict[str, Position], dict[str, Position]]:
    """Adjusted coordinates of control and new points, and their standard deviations."""
    network, fit = solution.network, solution.fit
    counts = np.bincount(network.rays.point[fit.taking_part], minlength=network.points.count)
    held = network.points.known_weight.any(axis=1)
    alive = set(np.flatnonzero((counts >= 2) | ((counts > 0) & held)).tolist())
    first = len(network.points.tie)
    rows = {name: first + row for row, name in enumerate(network.points.control)}
    rows = {name: row for name, row in rows.items() if row in alive}
    places = network.points.shifts.added(fit.state.points, fit.state.shifts)
    positions = {name: places[row].copy() for name, row in rows.items()}
    variances = solution.precision.known
    return positions, {name: scale * np.sqrt(variances[row]) for name, row in rows.items()}


def _new_points(
    block: Block,
    solution: Solution,
    adjusted: tuple[Mapping[str, Position], Mapping[str, Position]],
    rays_px: Float64[np.ndarray, "rays 2"],
) -> tuple[NewPoint, ...]:
    """The new points among what was adjusted."""
    positions, sigmas = adjusted
    rays, first = solution.network.rays, len(solution.network.points.tie)
    found: list[NewPoint] = []
    for row, name in enumerate(solution.network.points.control, start=first):
        if name in positions and block.surveyed[name].role == "new":
            own = np.flatnonzero((rays.point == row) & solution.fit.taking_part)
            largest = float(np.hypot(*rays_px[own].T).max())
            found.append(NewPoint(name, positions[name], sigmas[name], len(own), largest))
    return tuple(found)


def report_without_adjustment(block: Block, sound: Sound) -> AdjustmentReport:
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
        rejected=dict(sound.reasons),
        doubts=(
            *sound.doubts,
            Doubt("no-photo-oriented", "block", "No photo is oriented: nothing to adjust."),
        ),
    )
