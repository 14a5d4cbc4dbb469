"""The equations of a block that was adjusted before, built again from its report."""

from dataclasses import replace

import numpy as np

from core.block.adjusted import AdjustmentOptions, AdjustmentReport
from core.block.least_squares.components import reweighted
from core.block.least_squares.linearised import linearise
from core.block.least_squares.minimum import Fit
from core.block.least_squares.network import Network, State, network_of
from core.block.least_squares.solution import Solution, resolved, with_held
from core.block.least_squares.start import initial_state
from core.block.least_squares.terrain import Terrain, laid_on_terrain
from core.progress import Progress


def solution_of(
    report: AdjustmentReport,
    options: AdjustmentOptions,
    progress: Progress,
    terrain: Terrain | None,
) -> Solution | None:
    """The report's equations, with the rays, weights and held parameters it ended with.

    Args:
        report: A report of `adjust_block`.
        options: Those it was made with.
        progress: Told of every step.
        terrain: As then.

    Returns:
        The solution; None where no photo took part.
    """
    network = network_of(report.block, options)
    if not network.photos:
        return None
    network = reweighted(network, {name: c.factor for name, c in report.classes.items()})
    held = tuple(row for row, parameter in enumerate(report.parameters) if parameter.held)
    network = with_held(network, held)
    state = _state_of(network, report)
    taking_part = _taking_part(network, report)
    fit = Fit(state, linearise(network, state), taking_part, taking_part.astype(np.float64))
    if terrain is not None and options.dem_sigma_m > 0:
        sigma = options.dem_sigma_m * (report.classes["dem"].factor if report.classes else 1.0)
        network = laid_on_terrain(network, fit, terrain, sigma)
        fit = replace(fit, lin=linearise(network, state))
    factors = {name: c.factor for name, c in report.classes.items()}
    solution = resolved(network, fit, options, progress)
    return replace(solution, factors=factors, held=held)


def _state_of(network: Network, report: AdjustmentReport) -> State:
    """The adjusted unknowns; points that took no part where their rays meet."""
    state, _ = initial_state(network)
    points = state.points.copy()
    ties = report.tie_positions[network.points.tie]
    known = np.isfinite(ties).all(axis=1)
    points[: len(ties)][known] = ties[known]
    for row, name in enumerate(network.points.control, start=len(ties)):
        if name in report.surveyed_positions:
            points[row] = report.surveyed_positions[name]
    first = network.lensed
    values = [parameter.value for parameter in report.parameters[first:]]
    units = [_to_internal(parameter.name) for parameter in report.parameters[first:]]
    positioning = np.array(values) * np.array(units) if values else state.positioning
    return replace(state, points=points, positioning=positioning)


def _to_internal(name: str) -> float:
    """Factor from the unit a shared parameter is told in to radians or metres."""
    return float(np.radians(1.0)) if name.endswith("_deg") else 1.0


def _taking_part(network: Network, report: AdjustmentReport) -> np.ndarray:
    """Rays that took part in the adjustment the report is of."""
    rays = network.rays
    used = np.zeros(len(rays.photo), dtype=np.bool_)
    tie = rays.tie >= 0
    used[tie] = np.isfinite(report.tie_residuals_px[rays.tie[tie], 0])
    for ray in np.flatnonzero(~tie).tolist():
        used[ray] = network.measurements[rays.measurement[ray]].key in report.redundancy_numbers
    return used
