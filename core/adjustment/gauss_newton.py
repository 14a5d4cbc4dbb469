"""Gauss-Newton iterations to the least squares minimum, damped where a step does not help.

They start from the given orientations, with each point where its rays meet.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64

from core.adjustment.linearised import Linearised, linearise
from core.adjustment.network import Network, State
from core.adjustment.reliability import Chosen
from core.adjustment.solver import Increment, Pattern, Weights, normals_of, solve
from core.arrays import Flags, ObjectPoints, Scalars
from core.geometry.camera import COEFFICIENTS
from core.geometry.collinearity import VACUUM, Rotations, constants_of, ideal_from_film
from core.geometry.intersection import SMALLEST_ANGLE, closest_points
from core.geometry.robust import huber_costs, huber_weights, robust_sigma
from core.progress import Progress

# design: a thousandth of a standard deviation in all unknowns together.
SETTLED = 1e-6
"""The squared length, in standard deviations, of a step so small that it is the last."""
# design: residuals change by less than a percent of what a test asks.
NEARLY = 1e-4
"""Fall of the robust cost, as a share of it, at which gross errors can be told."""
# design: both coordinates together, 14 % of good rays lie beyond and lose little.
HUBER_LIMIT = 2.0
"""Residuals (both coordinates together) beyond this many sigmas lose weight."""
# design: from what hardly shortens a step to where nothing moves any more.
FIRST_DAMPING, MOST_DAMPING = 1e-4, 1e6
# measured: tests/core/adjustment/test_unknown_distance.py; a principal distance a quarter off needs
# two, half of them leaves it where it was, twice as many change nothing.
WATCHED = 4
"""Full steps that may pass over a rise of the cost."""


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """How far the adjustment has come."""

    state: State
    """The unknowns."""
    lin: Linearised
    """Residuals and derivatives there."""
    taking_part: Chosen
    """Rays that count."""
    weights: Weights
    """Weights of the rays, 0 for those that do not count."""
    steps: int = 0
    """Steps taken so far."""
    settled: bool = False
    """The last step was small."""

    def cost(self) -> float:
        """Weighted squared residuals of everything."""
        return float(np.sum(self.weights * self.lin.residuals**2)) + self.lin.prior_cost


def begin(network: Network, state: State, placed: Chosen) -> Fit:
    """The first state, without the rays whose points are behind the camera or nowhere."""
    lin = linearise(network, state)
    sound = np.bincount(network.rays.point, placed & ~lin.behind, network.points.count) >= 2
    taking_part = placed & ~lin.behind & (network.anchored | sound[network.rays.point])
    return Fit(state, lin, taking_part, taking_part.astype(np.float64))


def minimise(
    network: Network, pattern: Pattern, fit: Fit, robust: bool, *, steps: int, progress: Progress
) -> Fit:
    """Steps until one is small, or none helps; robust costs need not settle to the last digit."""
    damping = 0.0
    fit = replace(fit, settled=False)
    for _ in range(steps):
        progress.report(float(fit.steps), float(fit.steps + steps), "adjustment")
        limit = _huber_limit(fit) if robust else np.inf
        fit = replace(fit, weights=_weights(fit.lin, fit.taking_part, limit))
        cost = _cost(fit.lin, fit.taking_part, limit)
        trial, increment = _step(network, pattern, fit, damping)
        # A damped step is short wherever the minimum lies.
        if increment is not None and not damping and increment.decrement < _enough(cost, robust):
            lin = linearise(network, trial)
            sound = np.isfinite(_cost(lin, fit.taking_part, limit))
            fit = _accepted(fit, trial, lin) if sound else fit
            return replace(fit, settled=True)
        lin = linearise(network, trial)
        if increment is not None and _cost(lin, fit.taking_part, limit) <= cost:
            fit = _accepted(fit, trial, lin)
            damping = damping / 10 if damping > FIRST_DAMPING else 0.0
        elif not damping and (beyond := _beyond(network, pattern, fit, limit, cost)) is not None:
            fit = beyond
        else:
            fit = replace(fit, steps=fit.steps + 1)
            damping = max(10 * damping, FIRST_DAMPING)
        if damping > MOST_DAMPING:
            break
    return fit


def _beyond(network: Network, pattern: Pattern, fit: Fit, limit: float, cost: float) -> Fit | None:
    """Where some full steps lead that pass over a rise; None where they do not lead lower.

    Flying heights and a principal distance that is only proposed are exchanged for each other by a
    fifth of themselves, and a block that only rough centres hold turns about its strip by degrees.
    Along such a way full steps miss by what is of second order, and come back with the next; damped
    ones creep (watchdog technique, Chamberlain and others 1982).
    """
    for _ in range(WATCHED):
        state, increment = _step(network, pattern, fit, 0.0)
        if increment is None:
            return None
        lin = linearise(network, state)
        found = _cost(lin, fit.taking_part, limit)
        fit = _accepted(fit, state, lin)
        if found <= cost:
            return fit
        if not np.isfinite(found):
            return None
        fit = replace(fit, weights=_weights(lin, fit.taking_part, limit))
    return None


def _accepted(fit: Fit, state: State, lin: Linearised) -> Fit:
    return replace(fit, state=state, lin=lin, steps=fit.steps + 1)


def _enough(cost: float, robust: bool) -> float:
    return max(SETTLED, NEARLY * cost) if robust else SETTLED


def _step(
    network: Network, pattern: Pattern, fit: Fit, damping: float
) -> tuple[State, Increment | None]:
    """The state after one step; without a step where the normal equations are singular."""
    try:
        normals = normals_of(network, pattern, fit.lin, fit.weights, damping=damping)
    except np.linalg.LinAlgError:
        return fit.state, None
    increment = solve(network, pattern, normals)
    moved = fit.state.moved(
        increment.photos,
        increment.constants,
        increment.positioning,
        increment.shifts,
        increment.points,
    )
    return moved, increment


def _lengths(lin: Linearised) -> Weights:
    return np.hypot(lin.residuals[0], lin.residuals[1])


def _huber_limit(fit: Fit) -> float:
    """Wide while the orientations are still off, in the end `HUBER_LIMIT` sigmas."""
    sigma = robust_sigma(fit.lin.residuals[:, fit.taking_part].ravel())
    return HUBER_LIMIT * max(1.0, sigma)


def _weights(lin: Linearised, taking_part: Chosen, limit: float) -> Weights:
    if not np.isfinite(limit):
        return taking_part.astype(np.float64)
    return np.where(taking_part, huber_weights(_lengths(lin), limit), 0.0)


def _cost(lin: Linearised, taking_part: Chosen, limit: float) -> float:
    """Cost of the rays that count, and of the priors; infinite when one is behind its camera."""
    if (lin.behind & taking_part).any():
        return float("inf")
    lengths = _lengths(lin)[taking_part]
    rays = lengths**2 if not np.isfinite(limit) else huber_costs(lengths, limit)
    return float(np.sum(rays)) + lin.prior_cost


def initial_state(network: Network) -> tuple[State, Flags]:
    """Present orientations, points where their rays meet, and the rays whose points do so."""
    state, origins, directions = _orient_rays(network)
    points, placed = _intersect_points(network, origins, directions)
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
    state, origins, directions = _orient_rays(network)
    laid = _lay_points(network, origins, directions)
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
    points, placed = _intersect_points(network, state.centres[network.rays.photo], directions)
    return replace(state, points=points), placed[network.rays.point]


def _orient_rays(network: Network) -> tuple[State, ObjectPoints, ObjectPoints]:
    """Present orientations (points still at nought), origins and directions of the rays."""
    photos = network.photos
    state = State(
        centres=np.array([photo.exterior.centre for photo in photos]),
        rotations=np.array([photo.exterior.object_from_image for photo in photos]),
        constants=np.array([constants_of(camera) for camera in network.cameras]),
        additional=_additional(network),
        positioning=np.zeros(network.positioning.count),
        shifts=np.zeros(network.points.shifts.count),
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


def _lay_points(
    network: Network, origins: ObjectPoints, directions: ObjectPoints
) -> Float64[np.ndarray, "points 3"]:
    """Control points where they are known to be, tie points where their rays reach the ground."""
    point, count = network.rays.point, network.points.count
    above = origins[:, 2] - _ground_of_rays(network)
    downwards = np.where(directions[:, 2] < 0, directions[:, 2], np.nan)
    hits = origins - directions * (above / downwards)[:, None]
    sums = [np.bincount(point, hits[:, k], count).astype(np.float64) for k in range(3)]
    laid = np.stack(sums, axis=1)
    laid /= np.maximum(np.bincount(point, minlength=count), 1)[:, None]
    ties = len(network.points.tie)
    laid[ties:] = network.points.known[ties:]
    return np.where(np.isfinite(laid), laid, 0.0)


def _intersect_points(
    network: Network, origins: ObjectPoints, directions: ObjectPoints
) -> tuple[Float64[np.ndarray, "points 3"], Bool[np.ndarray, "points"]]:
    """Tie and new points where their rays meet (far off the ground: laid on it), and whether so."""
    point, count = network.rays.point, network.points.count
    met, angles = closest_points(origins, directions, point, count)
    ground = _ground_of_rays(network)
    near_ground = np.abs(met[point, 2] - ground) < 0.5 * (origins[:, 2] - ground)
    astray = np.bincount(point, ~near_ground, count) > 0
    laid = _lay_points(network, origins, directions)
    held = np.any(network.points.known_weight > 0, axis=1, keepdims=False)
    held = held & (np.arange(count) >= len(network.points.tie))
    astray |= held
    placed = (angles >= SMALLEST_ANGLE) | held
    return np.where(astray[:, None], laid, met), placed
