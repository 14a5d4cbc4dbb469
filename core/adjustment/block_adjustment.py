"""Bundle adjustment of a block: all rays, known coordinates and priors in one least squares fit."""

from contextlib import AbstractContextManager
from functools import cache

from threadpoolctl import ThreadpoolController

from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.adjustment.adjustment_report import report_of, untouched
from core.adjustment.free_network import freed, laid_on_control
from core.adjustment.input_checks import examined
from core.adjustment.network import network_of
from core.adjustment.solution import Solution, solve_network
from core.adjustment.terrain import Terrain
from core.block import Block
from core.progress import Progress, Silent

DEFAULT = AdjustmentOptions()
SILENT = Silent()
# design: a dense border of that size is worth two threads, the band of the photos never is.
MANY_UNKNOWNS = 1000
"""Below this many shared unknowns, whose equations are dense, one BLAS thread is faster: in the
narrow band of the photos several wait for each other."""


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
    sound = examined(block)
    network = network_of(sound.block, options)
    if not network.photos:
        return untouched(block, sound), None
    with one_thread(network.shared):
        taken = freed(network) if options.free_network else network
        solution = solve_network(taken, options, terrain, progress)
        if options.free_network:
            solution = laid_on_control(solution, network)
        return report_of(block, sound, solution), solution


def one_thread(shared: int) -> AbstractContextManager[object]:
    """BLAS held to one thread while a block with few shared unknowns is adjusted."""
    limit = 1 if shared < MANY_UNKNOWNS else None
    return _threads().limit(limits=limit, user_api="blas")


@cache
def _threads() -> ThreadpoolController:
    """Finding the BLAS libraries takes milliseconds: once is enough."""
    return ThreadpoolController()
