"""What a decision would do, in closed form: a measurement rejected or accepted, a point left out.

With the cofactors Q of all unknowns and the rows A of the observations a decision concerns (their
residuals v, computed minus measured, in standard deviations), leaving them out gives
v' = (I - A Q A^T)^-1 v and moves the unknowns by Q A^T v'; taking others in gives
v'' = (I + A Q A^T)^-1 v and moves them by -Q A^T v''. The points stay eliminated, so that every row
is one of photos and cameras (METHODS 7.5).
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from core.block.adjusted import AdjustmentOptions, AdjustmentReport
from core.block.adjustment import one_thread
from core.block.block import UNKNOWN_M, Block, Measurement
from core.block.effects import Effect, Key, LeftOut
from core.block.least_squares.banded import SIZE
from core.block.least_squares.chord import without_coordinates
from core.block.least_squares.control_system import ControlSystem
from core.block.least_squares.equations import Equations
from core.block.least_squares.footprints import ground_shifts_of
from core.block.least_squares.network import CONSTANTS
from core.block.least_squares.reintersection import met_again
from core.block.least_squares.reliability import NONCENTRALITY
from core.block.least_squares.solution import Solution
from core.block.least_squares.terrain import Terrain
from core.block.least_squares.warm import solution_of
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation
from core.geometry.partials import rotations_from_increments
from core.progress import Progress, Silent

SILENT = Silent()
BENT_M = 4e-5
"""Square of a photo's shift over the flying height from which its rays bend by half a millimetre,
as found on synthetic blocks: then the whole block makes one more step."""
MUCH_BENT_M = 2e-4
"""From here on the equations themselves have changed: they are built again for that step."""


def foresee(
    report: AdjustmentReport,
    options: AdjustmentOptions,
    progress: Progress = SILENT,
    terrain: Terrain | None = None,
) -> "Foresight | None":
    """The equations of an adjusted block from its report; None where no photo took part.

    Args:
        report: A report of `adjust_block`.
        options: Those it was made with.
        progress: Told of every step.
        terrain: As then.
    """
    with one_thread(len(report.parameters)):
        solution = solution_of(report, options, progress, terrain)
    return None if solution is None else Foresight(report.block, solution)


class Foresight:
    """The equations of an adjusted block, ready to be asked.

    It asks about the block as it was adjusted: the rays that took part then, the gross errors left
    out then. It does not look whether a decision would bring further gross errors to light.
    """

    def __init__(self, block: Block, solution: Solution) -> None:
        self.block, self.solution = block, solution
        self._equations = Equations(solution)
        network, rays = solution.network, solution.network.rays
        self._photo_row = {photo.photo_id: row for row, photo in enumerate(network.photos)}
        self._ray_of = {
            network.measurements[rays.measurement[ray]].key: ray
            for ray in np.flatnonzero(rays.measurement >= 0).tolist()
        }
        first = len(network.points.tie)
        self._point_of = {name: first + row for row, name in enumerate(network.points.control)}
        self._ground = ground_shifts_of(network, solution.fit.state)
        ground = np.array([photo.ground_height_m for photo in network.photos])
        above = solution.fit.state.centres[:, 2] - ground
        self._height_m = max(float(np.median(above)), 1.0)
        precision = solution.precision
        self._covariances = self._ground.covariances(
            precision.photos, precision.mixed, precision.constants
        )

    def effect(self, key: Key) -> Effect | None:
        """What turning one measurement would do; None where it can change nothing."""
        ray = self._ray_of.get(key)
        if ray is not None and self.solution.fit.taking_part[ray]:
            return self._rejected(key, ray)
        measurement = self.block.measurements.get(key)
        if measurement is None or key[1] not in self._photo_row:
            return None
        if self.block.surveyed[key[0]].role == "check":
            return None
        return self._accepted(measurement)

    def effects(self, keys: Iterable[Key]) -> dict[Key, Effect]:
        """Effects of many decisions, each by itself."""
        told = {key: self.effect(key) for key in keys}
        return {key: effect for key, effect in told.items() if effect is not None}

    def control_system(self) -> ControlSystem:
        """All control measurements that take part, as one system of observations."""
        network, fit = self.solution.network, self.solution.fit
        rays = [ray for ray in self._ray_of.values() if fit.taking_part[ray]]
        parts = [self._equations.of_ray(ray) for ray in rays]
        rows = np.concatenate(
            [np.zeros((0, self._equations.unknowns)), *(part[0] for part in parts)]
        )
        return ControlSystem(
            [network.measurements[network.rays.measurement[ray]] for ray in rays],
            network.rays.point[rays],
            rows,
            self._equations.cofactors(rows),
            np.concatenate([np.zeros((0, 3)), *(part[1] for part in parts)]),
            fit.lin.residuals[:, rays].T,
        )

    def ground_shifts(
        self, steps: Float64[np.ndarray, "unknowns steps"]
    ) -> Float64[np.ndarray, "places steps"]:
        """Shifts (E, N) of nine places of every photo by changes of the unknowns, metres."""
        return self._ground.of(steps).reshape(-1, steps.shape[1])

    def leave_one_out(self) -> tuple[LeftOut, ...]:
        """Every control point against all others, in closed form.

        The point's coordinates are left out; its rays stay, and are intersected again with photos
        and cameras as they would be. Where these move much, the whole block makes one more step.
        Of a point that one photo alone shows only the plan is, for one ray does not give a height.
        """
        network, fit = self.solution.network, self.solution.fit
        used = np.bincount(network.rays.point[fit.taking_part], minlength=network.points.count)
        axes = {
            name: self._free_axes(row, int(used[row]))
            for name, row in self._point_of.items()
            if used[row] > 0
        }
        names = [name for name, free in axes.items() if free]
        parts = [self._equations.of_ground(self._point_of[name], axes[name]) for name in names]
        nothing = np.zeros((0, self._equations.unknowns))
        rows = np.concatenate([nothing, *(part[0] for part in parts)])
        columns = self._equations.cofactors(rows)
        found: list[LeftOut] = []
        steps = np.zeros((self._equations.unknowns, len(names)))
        predicted: list[Float64[np.ndarray, ...]] = []
        remaining: list[Float64[np.ndarray, ...]] = []
        start = 0
        for index, (name, (_, inner)) in enumerate(zip(names, parts, strict=True)):
            part = slice(start, start + len(inner))
            start = part.stop
            shared = rows[part] @ columns[:, part] + inner @ inner.T
            remaining.append(np.eye(len(inner)) - shared)
            judged, off = self._left_out(name, axes[name], remaining[-1])
            steps[:, index] = columns[:, part] @ off
            predicted.append(off)
            found.append(judged)
        shifts, _ = self._ground.largest(steps)
        found = [replace(judged, shift_m=float(m)) for judged, m in zip(found, shifts, strict=True)]
        return self._bent(found, steps, predicted, remaining)

    def _bent(
        self,
        flat: Sequence[LeftOut],
        steps: Float64[np.ndarray, "unknowns points"],
        predicted: Sequence[Float64[np.ndarray, "..."]],
        remaining: Sequence[Float64[np.ndarray, "..."]],
    ) -> tuple[LeftOut, ...]:
        """The differences where rays truly meet, not where tangents do."""
        solution, known = self.solution, self.solution.network.points.known
        points = np.array([self._point_of[item.point_id] for item in flat], dtype=np.int64)
        free = np.isfinite(np.array([item.difference_m for item in flat]).reshape(-1, 3))
        met = met_again(solution.network, solution.fit, points, free, steps)
        found: list[LeftOut] = []
        for row, (item, point) in enumerate(zip(flat, points.tolist(), strict=True)):
            place = met[row]
            bend = item.shift_m**2 / self._height_m
            if bend > BENT_M:
                axes = np.flatnonzero(free[row]).tolist()
                place = without_coordinates(
                    solution, point, axes, predicted[row], remaining[row], bend > MUCH_BENT_M
                )
            off = np.where(free[row], place - known[point], np.nan)
            found.append(replace(item, difference_m=off) if np.isfinite(place).all() else item)
        return tuple(found)

    def smallest_errors(self) -> dict[Key, tuple[float, float]]:
        """Smallest error of each used control measurement a test would find, and what it would do.

        Returns:
            By measurement: the error in pixels (Baarda 1968: 4.13 sigma / sqrt r, of the less well
            checked coordinate) and the largest shift of a photo's ground an error of that size,
            unfound, would bring about, metres.
        """
        network, precision = self.solution.network, self.solution.precision
        rays = [ray for ray in self._ray_of.values() if self.solution.fit.taking_part[ray]]
        parts = [self._equations.of_ray(ray)[0] for ray in rays]
        nothing = np.zeros((0, self._equations.unknowns))
        columns = self._equations.cofactors(np.concatenate([nothing, *parts]))
        redundancy = np.maximum(1 - precision.rays[:, rays], 1e-6)
        errors = NONCENTRALITY / np.sqrt(redundancy)
        shifts, _ = self._ground.largest(columns * errors.T.ravel())
        found: dict[Key, tuple[float, float]] = {}
        for index, ray in enumerate(rays):
            item = network.measurements[network.rays.measurement[ray]]
            worst = float(shifts[2 * index : 2 * index + 2].max())
            found[item.key] = (float(errors[:, index].max()) * item.sigma_px, worst)
        return found

    def corner_sigmas(self) -> dict[str, Float64[np.ndarray, "9 2"]]:
        """Standard deviation (E, N) in metres of the ground each photo shows, at nine places.

        From the orientation alone (for a sigma nought of one), as for a point whose height is
        known; upper left to lower right on the film.
        """
        sigmas = np.sqrt(np.diagonal(self._covariances, axis1=2, axis2=3))
        return {name: sigmas[row] for name, row in self._photo_row.items()}

    def exteriors_after(self, effect: Effect) -> dict[str, ExteriorOrientation]:
        """Exterior orientation of every photo that takes part, after a decision."""
        state = self.solution.fit.state
        photos = effect.step[: SIZE * len(self._photo_row)].reshape(-1, SIZE)
        rotations = state.rotations @ rotations_from_increments(photos[:, 3:])
        return {
            name: ExteriorOrientation(
                state.centres[row] + photos[row, :3], *angles_from_rotation(rotations[row])
            )
            for name, row in self._photo_row.items()
        }

    def cameras_after(self, effect: Effect) -> dict[str, Camera]:
        """Cameras after a decision, by the names the adjusted block has for them."""
        network, state = self.solution.network, self.solution.fit.state
        if not network.lensed:
            return {name: self.block.cameras[name] for name in network.camera_names}
        first = SIZE * len(self._photo_row)
        lens = effect.step[first : first + network.lensed].reshape(-1, network.lens)
        constants = state.constants.copy()
        constants[:, :CONSTANTS] += (lens / network.scale)[:, :CONSTANTS]
        more = state.additional + lens[:, CONSTANTS:]
        bent = np.tensordot(more, network.additional.basis, axes=1).reshape(len(more), -1)
        cameras: dict[str, Camera] = {}
        for row, name in enumerate(network.camera_names):
            c, x0, y0, k1, k2, k3 = constants[row].tolist()
            deformation = tuple(bent[row].tolist()) if bent[row].any() else ()
            camera = network.cameras[row]
            cameras[name] = camera.with_constants(c, (x0, y0), (k1, k2, k3), deformation)
        return cameras

    def _free_axes(self, point: int, rays: int) -> tuple[int, ...]:
        """Known coordinates that can be left out without losing the point."""
        known = self.solution.network.points.known_weight[point] > 1 / UNKNOWN_M
        axes = (0, 1) if rays == 1 else (0, 1, 2)
        return tuple(axis for axis in axes if known[axis])

    def _left_out(
        self, name: str, axes: tuple[int, ...], remaining: Float64[np.ndarray, "n n"]
    ) -> tuple[LeftOut, Float64[np.ndarray, "n"]]:
        """One control point, and its residuals when left out, in standard deviations."""
        point, network = self._point_of[name], self.solution.network
        residual = self.solution.fit.lin.ground[point, list(axes)]
        predicted = np.linalg.solve(remaining, residual)
        weights = network.points.known_weight[point, list(axes)]
        difference, sigma = np.full((2, 3), np.nan)
        difference[list(axes)] = predicted / weights
        sigma[list(axes)] = np.sqrt(np.diag(np.linalg.inv(remaining))) / weights
        test = float(np.sqrt(max(residual @ predicted, 0.0)))
        return LeftOut(name, difference, sigma, test, 0.0), predicted

    def _rejected(self, key: Key, ray: int) -> Effect:
        rows, whitened = self._equations.of_ray(ray)
        columns = self._equations.cofactors(rows)
        remaining = np.eye(2) - rows @ columns - whitened @ whitened.T
        residual = self.solution.fit.lin.residuals[:, ray]
        return self._effect(key, True, residual, columns, remaining)

    def _accepted(self, measurement: Measurement) -> Effect | None:
        solution, photo = self.solution, self._photo_row[measurement.photo_id]
        point = self._point_of.get(measurement.point_id)
        if point is not None and not solution.fit.taking_part[self._equations.rays_of(point)].any():
            point = None
        known = self.block.surveyed[measurement.point_id]
        rows, whitened, residual = self._equations.of_pending(photo, measurement, known, point)
        if not np.isfinite(residual).all():
            return None
        columns = self._equations.cofactors(rows)
        total = np.eye(2) + rows @ columns + whitened @ whitened.T
        return self._effect(measurement.key, False, residual, columns, total)

    def _effect(
        self,
        key: Key,
        rejects: bool,
        residual: Float64[np.ndarray, "2"],
        columns: Float64[np.ndarray, "unknowns 2"],
        share: Float64[np.ndarray, "2 2"],
    ) -> Effect:
        """All figures of one decision; `share` is I - A Q A^T rejecting, I + A Q A^T accepting."""
        sign = 1.0 if rejects else -1.0
        # A ray that nothing checks has no residual of its own: pinv leaves it where it is.
        inverse = np.linalg.pinv(share, rcond=1e-9, hermitian=True)
        left = inverse @ residual
        step = sign * (columns @ left)
        shift, photo = self._ground.largest(step[:, None])
        squares = float(residual @ left)
        checked = np.diag(share if rejects else inverse)
        effect = Effect(
            key=key,
            rejects=rejects,
            residual_px=(float("nan"), float("nan")),
            test=float(np.sqrt(max(squares, 0.0))),
            redundancy=float(np.mean(checked)),
            shift_m=float(shift[0]),
            photo_id=self.solution.network.photos[int(photo[0])].photo_id,
            sigma_nought=self._sigma_nought(-sign * squares, -sign * 2, step, columns, inverse),
            corner_sigma_ratio=self._corner_ratio(sign, columns, inverse),
            step=step,
        )
        return replace(effect, residual_px=self._pixels(effect, left))

    def _pixels(self, effect: Effect, left: Float64[np.ndarray, "2"]) -> tuple[float, float]:
        """Residual of the measurement after the decision, pixels."""
        item, photo = self.block.measurements[effect.key], self.block.photos[effect.key[1]]
        if effect.rejects:
            moved = self.exteriors_after(effect)[photo.photo_id]
            known = self.block.surveyed[item.point_id].position[None]
            camera = self.cameras_after(effect)[photo.camera]
            place = photo.with_exterior(moved, oriented=True).pixel_from_object(known, camera)
            column, row = (place - item.pixel)[0]
        else:
            film = left * item.sigma_px * photo.interior.pixel_size_mm
            column, row = np.linalg.solve(photo.interior.film_from_pixel_matrix[:, :2], film)
        return float(column), float(row)

    def _sigma_nought(
        self,
        squares: float,
        observations: float,
        step: Float64[np.ndarray, "unknowns"],
        columns: Float64[np.ndarray, "unknowns 2"],
        inverse: Float64[np.ndarray, "2 2"],
    ) -> float:
        """Sigma nought after a decision that changes all squares and the number of observations."""
        solution, equations = self.solution, self._equations
        priors = equations.prior_residuals()
        moved = priors + equations.of_priors(step[:, None])[:, 0]
        left = solution.weighted_squares + squares - float(moved @ moved - priors @ priors)
        rows = equations.of_priors(columns)
        traced = -np.sign(observations) * float(np.sum((rows @ inverse) * rows))
        redundancy = solution.redundancy + observations + traced
        return float(np.sqrt(max(left, 0.0) / redundancy)) if redundancy > 0.5 else float("nan")

    def _corner_ratio(
        self,
        sign: float,
        columns: Float64[np.ndarray, "unknowns 2"],
        inverse: Float64[np.ndarray, "2 2"],
    ) -> float:
        """Largest standard deviation of the ground after a decision over that of now."""
        moved = self._ground.of(columns)
        change = np.sum((moved @ inverse) * moved, axis=3)
        now = np.diagonal(self._covariances, axis1=2, axis2=3)
        then = np.maximum((now + sign * change).sum(axis=2), 0.0)
        return float(np.sqrt(then.max() / now.sum(axis=2).max()))
