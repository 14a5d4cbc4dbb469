"""What each control measurement does to an adjusted block, in closed form.

With the cofactors Q of all unknowns and the rows A of some observations (their residuals v,
computed minus measured, in standard deviations), leaving them out gives v' = (I - A Q A^T)^-1 v and
moves the unknowns by Q A^T v'. The points are eliminated, so that every row is one of photos and
cameras. What a decision really does, the adjustment says; this says it to first order for all at
once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64
from scipy import sparse

from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.adjustment.block_adjustment import one_thread
from core.adjustment.equations import BATCH, Equations, ground_shifts_of
from core.adjustment.gauss_newton import Fit, initial_state
from core.adjustment.linearised import linearise
from core.adjustment.network import Network, State, network_of
from core.adjustment.reliability import NONCENTRALITY, SMALLEST_REDUNDANCY
from core.adjustment.solution import Solution, solve_again, with_held
from core.adjustment.weights import Terrain, observe_terrain, reweight
from core.arrays import Flags, Indices, Position
from core.block import UNKNOWN_M, Block, Measurement
from core.progress import SILENT, Progress

Key = tuple[str, str]
"""Point and photo."""


@dataclass(frozen=True, slots=True, eq=False)
class LeftOut:
    """One control point judged by all others: where they put it, less where it is said to be."""

    point_id: str
    """The point."""
    difference_m: Position
    """Predicted minus known (E, N, H), metres; NaN where its coordinate takes no part."""
    sigma_m: Position
    """Standard deviation of that difference, metres, for a sigma nought of one."""
    test: float
    """Length of the difference in its standard deviations."""


@dataclass(frozen=True, slots=True)
class Reliability:
    """What one control measurement says, what it steers, and which error in it would be found."""

    test: float
    """Length of what it says against all others, in standard deviations (of two coordinates)."""
    shift_m: float
    """Largest shift of a photo's ground if it were left out, metres."""
    smallest_error_px: float
    """The smallest error a test would find, pixels (Baarda 1968: 4.13 sigma / sqrt r, of the less
    well checked coordinate)."""
    its_shift_m: float
    """Largest shift of a photo's ground an error of that size brings about, unfound, metres."""


def influence_of(
    report: AdjustmentReport,
    options: AdjustmentOptions,
    progress: Progress = SILENT,
    terrain: Terrain | None = None,
) -> "Influence | None":
    """The equations of an adjusted block from its report; None where no photo took part.

    Args:
        report: A report of `adjust_block`.
        options: Those it was made with.
        progress: Told of every step.
        terrain: As then.
    """
    with one_thread(len(report.parameters)):
        solution = _solution_of(report, options, progress, terrain)
    return None if solution is None else Influence(report.block, solution)


class Influence:
    """The equations of an adjusted block, ready to be asked.

    It asks about the block as it was adjusted: the rays that took part then, the gross errors left
    out then. It does not look whether a decision would bring further gross errors to light.
    """

    def __init__(self, block: Block, solution: Solution) -> None:
        self.block, self.solution = block, solution
        self.equations = Equations(solution)
        network = solution.network
        self.ground = ground_shifts_of(network, solution.fit.state)
        used = solution.fit.taking_part & (network.rays.measurement >= 0)
        self.control_rays: Indices = np.flatnonzero(used)

    def corner_sigmas(self) -> dict[str, Float64[np.ndarray, "9 2"]]:
        """Standard deviation (E, N) in metres of the ground each photo shows, at nine places.

        From the orientation alone (for a sigma nought of one), as for a point whose height is
        known; upper left to lower right on the film.
        """
        found = self.solution.precision
        covariances = self.ground.covariances(found.photos, found.mixed, found.constants)
        sigmas = np.sqrt(np.diagonal(covariances, axis1=2, axis2=3))
        names = [photo.photo_id for photo in self.solution.network.photos]
        return dict(zip(names, sigmas, strict=True))

    def ground_freedom(self, places: Sequence[tuple[str, Position]]) -> float:
        """So many independent errors the plan that photos show of places is worth together.

        tr(C)^2 / tr(C^2), C what the orientations bring to all of them at known height: photos of
        a block share what it is off (Satterthwaite 1946). NaN without any.

        Args:
            places: Photo and place (E, N, H), metres.
        """
        numbers = {photo.photo_id: row for row, photo in enumerate(self.solution.network.photos)}
        rows = [np.zeros((0, self.equations.unknowns))]
        for name, place in places:
            if name in numbers:
                ray = Measurement("", name, 0.0, 0.0, 1.0)
                by_unknowns, by_point = self.equations.of_free_ray(numbers[name], ray, place)
                rows.append(np.linalg.solve(by_point[:, :2], by_unknowns))
        every = np.concatenate(rows)
        found = every @ self.equations.cofactors(every)
        return float(np.trace(found) ** 2 / np.sum(found**2)) if len(found) else float("nan")

    def leave_one_out(self) -> tuple[LeftOut, ...]:
        """Every control point against all others.

        The point's coordinates are left out; its rays stay. Of a point that one photo alone shows
        only the plan is, for one ray does not give a height.
        """
        network, fit = self.solution.network, self.solution.fit
        first = len(network.points.tie)
        used = np.bincount(network.rays.point[fit.taking_part], minlength=network.points.count)
        points = [
            (name, row, axes)
            for row, name in enumerate(network.points.control, start=first)
            if used[row] and (axes := self._free_axes(row, int(used[row])))
        ]
        batches = (points[first : first + BATCH] for first in range(0, len(points), BATCH))
        return tuple(
            self._left_out(name, point, axes, hat)
            for some in batches
            for (name, point, axes), hat in zip(some, self._ground_hats(some), strict=True)
        )

    def reliabilities(self) -> dict[Key, Reliability]:
        """Test and reliability of every control measurement that takes part."""
        network, found = self.solution.network, dict[Key, Reliability]()
        for first in range(0, len(self.control_rays), BATCH):
            rays = self.control_rays[first : first + BATCH]
            for ray, one in zip(rays.tolist(), self._reliabilities(rays), strict=True):
                found[network.measurements[network.rays.measurement[ray]].key] = one
        return found

    def _reliabilities(self, rays: Indices) -> list[Reliability]:
        network, count = self.solution.network, len(rays)
        rows, whitened = self.equations.of_rays(rays)
        columns = self.equations.cofactors(rows)
        pairs = np.moveaxis(columns.reshape(-1, count, 2), 1, 0)
        inner = whitened.reshape(count, 2, 3)
        hats = rows.reshape(count, 2, -1) @ pairs + inner @ np.swapaxes(inner, 1, 2)
        residuals = self.solution.fit.lin.residuals[:, rays].T
        # A ray that nothing checks has no residual of its own: pinv leaves it where it is.
        # design: rounding of cofactors is 1e-12.
        inverse = np.linalg.pinv(np.eye(2) - hats, rcond=1e-9, hermitian=True)
        left = (inverse @ residuals[:, :, None])[:, :, 0]
        moved = self.ground.largest((pairs @ left[:, :, None])[:, :, 0].T)
        redundancy = np.maximum(1 - self.solution.precision.rays[:, rays], SMALLEST_REDUNDANCY)
        errors = NONCENTRALITY / np.sqrt(redundancy).T
        worst = self.ground.largest(columns * errors.ravel()).reshape(count, 2).max(axis=1)
        sigmas = [network.measurements[m].sigma_px for m in network.rays.measurement[rays]]
        tests = np.sqrt(np.maximum(np.sum(residuals * left, axis=1), 0.0))
        figures = zip(tests, moved, errors.max(axis=1) * np.array(sigmas), worst, strict=True)
        return [Reliability(*(float(figure) for figure in four)) for four in figures]

    def _ground_hats(
        self, points: Sequence[tuple[str, int, tuple[int, ...]]]
    ) -> list[Float64[np.ndarray, "n n"]]:
        """Share of each point's known coordinates in what the block says of them."""
        parts = [self.equations.of_ground(point, axes) for _, point, axes in points]
        blocks = self.equations.covariances([sparse.csr_array(rows) for rows, _ in parts])
        return [block + inner @ inner.T for block, (_, inner) in zip(blocks, parts, strict=True)]

    def _free_axes(self, point: int, rays: int) -> tuple[int, ...]:
        """Known coordinates that can be left out without losing the point."""
        known = self.solution.network.points.known_weight[point] > 1 / UNKNOWN_M
        axes = (0, 1) if rays == 1 else (0, 1, 2)
        return tuple(axis for axis in axes if known[axis])

    def _left_out(
        self, name: str, point: int, axes: tuple[int, ...], hat: Float64[np.ndarray, "n n"]
    ) -> LeftOut:
        remaining = np.eye(len(axes)) - hat
        residual = self.solution.fit.lin.ground[point, list(axes)]
        predicted = np.linalg.solve(remaining, residual)
        weights = self.solution.network.points.known_weight[point, list(axes)]
        difference, sigma = np.full((2, 3), np.nan)
        difference[list(axes)] = predicted / weights
        sigma[list(axes)] = np.sqrt(np.diag(np.linalg.inv(remaining))) / weights
        return LeftOut(name, difference, sigma, float(np.sqrt(max(residual @ predicted, 0.0))))


def _solution_of(
    report: AdjustmentReport,
    options: AdjustmentOptions,
    progress: Progress,
    terrain: Terrain | None,
) -> Solution | None:
    """The report's equations, with the rays, weights and held parameters it ended with."""
    network = network_of(report.block, options)
    if not network.photos:
        return None
    factors = {name: figures.factor for name, figures in report.classes.items()}
    held = tuple(row for row, parameter in enumerate(report.parameters) if parameter.held)
    network = with_held(reweight(network, factors), held)
    state = _state_of(network, report)
    taking_part = _taking_part(network, report)
    fit = Fit(state, linearise(network, state), taking_part, taking_part.astype(np.float64))
    if terrain is not None and options.dem_sigma_m > 0:
        sigma = options.dem_sigma_m * factors.get("dem", 1.0)
        network = observe_terrain(network, fit, terrain, sigma)
        fit = replace(fit, lin=linearise(network, state))
    solution = solve_again(network, fit, options, progress)
    return replace(solution, factors=factors, held=held)


def _state_of(network: Network, report: AdjustmentReport) -> State:
    """The adjusted unknowns; points that took no part where their rays meet."""
    state, _ = initial_state(network)
    points = state.points.copy()
    ties = report.tie_positions[network.points.tie]
    known = np.isfinite(ties).all(axis=1)
    points[: len(ties)][known] = ties[known]
    adjusted = {point.point_id: point.position for point in report.new_points}
    adjusted |= report.surveyed_positions
    for row, name in enumerate(network.points.control, start=len(ties)):
        if name in adjusted:
            points[row] = adjusted[name]
    told = np.array(
        [
            float(np.radians(p.value)) if p.name.endswith("_deg") else p.value
            for p in report.parameters[network.lensed :]
        ]
    )
    shifts = network.points.shifts
    state = replace(state, shifts=told[: shifts.count], positioning=told[shifts.count :])
    return replace(state, points=shifts.added(points, -state.shifts))


def _taking_part(network: Network, report: AdjustmentReport) -> Flags:
    """Rays that took part in the adjustment the report is of."""
    rays = network.rays
    used = np.zeros(len(rays.photo), dtype=np.bool_)
    tie = rays.tie >= 0
    used[tie] = np.isfinite(report.tie_residuals_px[rays.tie[tie], 0])
    for ray in np.flatnonzero(~tie).tolist():
        used[ray] = network.measurements[rays.measurement[ray]].key in report.redundancy_numbers
    return used
