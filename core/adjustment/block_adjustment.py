"""Bundle adjustment of a block: all rays, known coordinates and priors in one least squares fit.

In a free network ties alone determine the shape of the block, and control only its position. The
residuals are then those of the ties; differences at control after a similarity show the errors of
control, or a bend of the block. Standard deviations are those of inner constraints on the
perspective centres: cofactors S Q S^T with S = I - G (G^T B G)^-1 G^T B, G the seven directions in
which a block can be moved without changing its shape, B one for centres (Baarda 1973).
"""

from contextlib import AbstractContextManager
from dataclasses import replace
from functools import cache

import numpy as np
from jaxtyping import Float64
from threadpoolctl import ThreadpoolController

from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.adjustment.adjustment_report import report_of, report_without_adjustment
from core.adjustment.equations import Equations
from core.adjustment.factorisation import DenseInverse
from core.adjustment.input_checks import check_input
from core.adjustment.linearised import linearise
from core.adjustment.network import Network, State, network_of
from core.adjustment.reliability import Precision, precision_from
from core.adjustment.solution import Solution, solve_network
from core.adjustment.weights import Terrain
from core.block import Block
from core.geometry.exterior import Similarity, fit_similarity
from core.progress import SILENT, Progress

DEFAULT = AdjustmentOptions()
# design: a dense border of that size is worth two threads, the band of the photos never is.
MANY_UNKNOWNS = 1000
"""Below this many shared unknowns, whose equations are dense, one BLAS thread is faster: in the
narrow band of the photos several wait for each other."""
# design: far beyond any correction of a block that stands.
LOOSE_M = 300.0
"""Prior of a perspective centre that keeps the equations regular and bends nothing, metres."""
# design: as LOOSE_M.
LOOSE_RAD = 1.0
"""The same for angles."""
# design: 300 photos make a matrix of 26 MB, inverted in a second.
MOST_PHOTOS = 300
"""Larger blocks keep the photos' standard deviations of the loose datum, and their points have
none: the full inverse is too large."""


def adjust_block(
    block: Block,
    options: AdjustmentOptions = DEFAULT,
    progress: Progress = SILENT,
    terrain: Terrain | None = None,
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
        terrain: Heights of the ground, used where `options.dem_sigma_m` is not nought.

    Returns:
        The adjusted block with residuals, standard deviations and check points.
    """
    return adjust_with_solution(block, options, progress, terrain)[0]


def adjust_with_solution(
    block: Block,
    options: AdjustmentOptions = DEFAULT,
    progress: Progress = SILENT,
    terrain: Terrain | None = None,
) -> tuple[AdjustmentReport, Solution | None]:
    """As `adjust_block`, with the solved equations, from which effects are told ahead."""
    sound = check_input(block)
    network = network_of(sound.block, options)
    if not network.photos:
        return replace(report_without_adjustment(block, sound), options=options), None
    with one_thread(network.shared):
        taken = loosen_datum(network) if options.free_network else network
        solution = solve_network(taken, options, terrain, progress)
        if options.free_network:
            solution = lay_on_control(solution, network)
        report = report_of(block, sound, solution, options.risk)
        return replace(report, options=options), solution


def one_thread(shared: int) -> AbstractContextManager[object]:
    """BLAS held to one thread while a block with few shared unknowns is adjusted."""
    limit = 1 if shared < MANY_UNKNOWNS else None
    return _threads().limit(limits=limit, user_api="blas")


@cache
def _threads() -> ThreadpoolController:
    """Finding the BLAS libraries takes milliseconds: once is enough."""
    return ThreadpoolController()


def loosen_datum(network: Network) -> Network:
    """The network without known coordinates, and with priors that only keep it somewhere."""
    priors = replace(
        network.priors,
        centre_weights=np.full_like(network.priors.centre_weights, 1 / LOOSE_M),
        angle_weights=np.full_like(network.priors.angle_weights, 1 / LOOSE_RAD),
    )
    weights = np.zeros_like(network.points.known_weight)
    return replace(network, priors=priors, points=replace(network.points, known_weight=weights))


def lay_on_control(solution: Solution, known: Network) -> Solution:
    """The free solution moved as one body onto control, or onto the approximate centres.

    Args:
        solution: The adjusted free network.
        known: The network it came from, with its control.
    """
    network, state = solution.network, solution.fit.state
    similarity = _onto_control(solution, known)
    if similarity is None:
        count = len(state.centres)
        weights = np.ones(count)
        if count < 3:
            return solution
        similarity = fit_similarity(state.centres, known.priors.centres, weights)
    moved = _moved(state, similarity)
    fit = replace(solution.fit, state=moved, lin=linearise(network, moved))
    return replace(solution, fit=fit, precision=_inner_precision(solution, similarity))


def _onto_control(solution: Solution, known: Network) -> Similarity | None:
    """The similarity onto control points that two rays or more intersect; None of fewer than 3."""
    network, fit = solution.network, solution.fit
    rays = np.bincount(network.rays.point[fit.taking_part], minlength=network.points.count)
    weights = known.points.known_weight.min(axis=1)
    good = (rays >= 2) & (weights > 0) & (np.arange(len(rays)) >= len(network.points.tie))
    if good.sum() < 3:
        return None
    return fit_similarity(fit.state.points[good], known.points.known[good], weights[good] ** 2)


def _moved(state: State, similarity: Similarity) -> State:
    return replace(
        state,
        centres=similarity.moved(state.centres),
        rotations=similarity.rotation @ state.rotations,
        points=similarity.moved(state.points),
    )


def _inner_precision(solution: Solution, similarity: Similarity) -> Precision:
    """Cofactors by inner constraints, turned with the block; increments stay in image axes.

    Points follow from photos and rays alone, so their cofactors are those of the photos' inner ones
    carried on. Of large blocks only the photos' are told, in the loose datum.
    """
    count, precision = len(solution.network.photos), solution.precision
    scaled = similarity.scale * similarity.rotation
    points = np.full_like(precision.points, np.nan)
    if 3 <= count <= MOST_PHOTOS:
        inverse = DenseInverse(_inner_cofactors(solution), count)
        network, pattern, place = solution.network, solution.pattern, np.arange(count)
        precision = precision_from(
            network,
            pattern,
            solution.fit.lin,
            solution.normals,
            inverse=inverse,
            place=place,
            turn=scaled,
        )
        points = precision.points
    turn = np.zeros((6, 6))
    turn[:3, :3], turn[3:, 3:] = scaled, np.eye(3)
    return replace(
        solution.precision,
        photos=turn @ precision.photos @ turn.T,
        mixed=turn @ precision.mixed,
        points=points,
        known=points,
    )


def _inner_cofactors(solution: Solution) -> Float64[np.ndarray, "unknowns unknowns"]:
    """Cofactors of all photos' and shared unknowns by inner constraints on the centres."""
    count = len(solution.network.photos)
    equations = Equations(solution)
    full = equations.cofactors(np.eye(equations.unknowns))
    directions = np.zeros((equations.unknowns, 7))
    directions[: 6 * count] = _free_directions(solution.fit.state)
    held = np.zeros(equations.unknowns)
    held[: 6 * count].reshape(count, 6)[:, :3] = 1.0
    inner = directions.T @ (held[:, None] * directions)
    shift = directions @ np.linalg.solve(inner, (held[:, None] * directions).T)
    change = np.eye(equations.unknowns) - shift
    return change @ full @ change.T


def _free_directions(state: State) -> Float64[np.ndarray, "unknowns 7"]:
    """Seven movements of the whole block: shifts, turns about the middle, scale."""
    centres = state.centres - state.centres.mean(axis=0)
    found = np.zeros((len(centres), 6, 7))
    for axis in range(3):
        found[:, axis, axis] = 1.0
        unit = np.eye(3)[axis]
        found[:, :3, 3 + axis] = np.cross(unit, centres)
        # A turn u in object space is the increment R^T u about the image axes.
        found[:, 3:, 3 + axis] = unit @ state.rotations
    found[:, :3, 6] = centres
    return found.reshape(-1, 7)
