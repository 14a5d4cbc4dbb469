"""Single observations of an adjusted block as rows over photos and cameras, points eliminated."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from core.arrays import Indices, Position
from core.block.block import Measurement, SurveyedPoint
from core.block.least_squares.banded import SIZE, solve_bordered_many
from core.block.least_squares.linearised import by_scaled_camera, ray_models
from core.block.least_squares.network import SMALLEST_SIGMA_PX
from core.block.least_squares.roots import backward3
from core.block.least_squares.solution import Solution
from core.geometry.partials import stacked_partials

Rows = Float64[np.ndarray, "rows unknowns"]
"""Observations as rows over the unknowns of the photos, in their order, and the shared ones."""
Whitened = Float64[np.ndarray, "rows 3"]
"""Part of each row by its own point, that point's root taken off."""


class Equations:
    """The normal equations of a solution, ready for rows and right-hand sides.

    With X = -L^-T (t + Y^T d) a point and d photos and cameras, an observation with the derivatives
    A by d and B by X is the row A - (B L^-T) Y^T and has the variance (B L^-T)(B L^-T)^T besides.
    """

    def __init__(self, solution: Solution) -> None:
        self.solution = solution
        network = solution.network
        self.photos = len(network.photos)
        self.unknowns = SIZE * self.photos + network.shared
        order = np.argsort(network.rays.point, kind="stable")
        starts = np.searchsorted(network.rays.point[order], np.arange(network.points.count + 1))
        self._order, self._starts = order, starts

    def rays_of(self, point: int) -> Indices:
        """Rays of one point, whether they take part or not."""
        return self._order[self._starts[point] : self._starts[point + 1]]

    def cofactors(self, rows: Rows) -> Float64[np.ndarray, "unknowns rows"]:
        """Q A^T: covariance of all photos' and shared unknowns with some observations."""
        place, count = self.solution.pattern.place, len(rows)
        if not count:
            return np.zeros((self.unknowns, 0))
        side = np.empty((self.photos, SIZE, count))
        side[place] = rows[:, : SIZE * self.photos].T.reshape(self.photos, SIZE, count)
        band, shared = solve_bordered_many(
            self.solution.normals.factor,
            side.reshape(SIZE * self.photos, count),
            np.ascontiguousarray(rows[:, SIZE * self.photos :].T),
        )
        own = band.reshape(self.photos, SIZE, count)[place]
        return np.concatenate([own.reshape(SIZE * self.photos, count), shared])

    def of_ray(self, ray: int) -> tuple[Rows, Whitened]:
        """The two coordinates of a ray that takes part."""
        lin, rays = self.solution.fit.lin, self.solution.network.rays
        by_camera = lin.by_camera[:, :, ray]
        rows = self._own(int(rays.photo[ray]), lin.by_photo[:, :, ray], by_camera)
        whitened = self.solution.normals.by_point[:, :, ray]
        return self._through(rows, int(rays.point[ray]), whitened), whitened

    def of_ground(self, point: int, axes: Sequence[int]) -> tuple[Rows, Whitened]:
        """Some known coordinates of a point."""
        weights = self.solution.network.points.known_weight[point]
        whitened = (self._inverse_root(point) * weights[:, None])[list(axes)]
        rows = np.zeros((len(whitened), self.unknowns))
        return self._through(rows, point, whitened), whitened

    def of_pending(
        self,
        photo: int,
        measurement: Measurement,
        known: SurveyedPoint,
        point: int | None,
    ) -> tuple[Rows, Whitened, Float64[np.ndarray, "2"]]:
        """A measurement that does not take part yet, with its residual in standard deviations.

        Args:
            photo: Row of its photo.
            measurement: The measurement.
            known: Its surveyed point.
            point: Row of that point where other rays of it take part, else None.
        """
        state = self.solution.fit.state
        position: Position = known.position if point is None else state.points[point]
        rows, by_point, residual = self._ray_at(photo, measurement, position)
        if point is None:
            return rows, by_point * known.sigma_m, residual
        whitened = by_point @ self._inverse_root(point)
        return self._through(rows, point, whitened), whitened, residual

    def of_free_ray(
        self, photo: int, measurement: Measurement, position: Position
    ) -> tuple[Rows, Whitened]:
        """A ray to a point of its own: its rows, and its derivatives by the point (2, 3)."""
        rows, by_point, _ = self._ray_at(photo, measurement, position)
        return rows, by_point

    def _ray_at(
        self, photo: int, measurement: Measurement, position: Position
    ) -> tuple[Rows, Whitened, Float64[np.ndarray, "2"]]:
        """Rows, derivatives by the point and residual of a measurement, in standard deviations."""
        network, state = self.solution.network, self.solution.fit.state
        one = np.array([photo])
        offsets = (position - state.centres[photo])[:, None]
        partials = stacked_partials(offsets, ray_models(network, state, one))
        interior = network.photos[photo].interior
        sigma = interior.pixel_size_mm * max(measurement.sigma_px, SMALLEST_SIGMA_PX)
        residual = (partials.film[:, 0] - interior.film_from_pixel(measurement.pixel)[0]) / sigma
        by_photo = np.hstack([partials.by_centre[:, :, 0], partials.by_rotation[:, :, 0]])
        by_camera = by_scaled_camera(network, one, partials)[:, :, 0]
        rows = self._own(photo, by_photo / sigma, by_camera / sigma)
        return rows, -partials.by_centre[:, :, 0] / sigma, residual

    def of_priors(
        self, steps: Float64[np.ndarray, "unknowns steps"]
    ) -> Float64[np.ndarray, "priors steps"]:
        """The rows of all priors times some changes of the unknowns."""
        network, lin = self.solution.network, self.solution.fit.lin
        count, lensed, many = self.photos, network.lensed, steps.shape[1]
        own = steps[: SIZE * count].reshape(count, SIZE, many)
        shared = steps[SIZE * count :]
        weights = network.priors.centre_weights[:, :, None]
        centres = weights * own[:, :3] + lin.centres_by_positioning @ shared[lensed:]
        angles = lin.angles_by_rotation @ own[:, 3:] + lin.angles_by_positioning @ shared[lensed:]
        known = np.append(
            network.priors.constant_weights.ravel()[:lensed], network.positioning.weights
        )
        return np.concatenate(
            [centres.reshape(-1, many), angles.reshape(-1, many), known[:, None] * shared]
        )

    def prior_residuals(self) -> Float64[np.ndarray, "priors"]:
        """Residuals of all priors, in the order of `of_priors`."""
        lin, lensed = self.solution.fit.lin, self.solution.network.lensed
        constants = lin.constants.ravel()[:lensed]
        parts = [lin.centres.ravel(), lin.angles.ravel(), constants, lin.positioning]
        return np.concatenate(parts)

    def _own(
        self,
        photo: int,
        by_photo: Float64[np.ndarray, "2 6"],
        by_camera: Float64[np.ndarray, "2 told"],
    ) -> Rows:
        """Two rows with the derivatives by a photo and its camera."""
        network = self.solution.network
        rows = np.zeros((2, self.unknowns))
        rows[:, SIZE * photo : SIZE * photo + SIZE] = by_photo
        if network.lensed:
            first = SIZE * self.photos + network.lens * int(network.camera[photo])
            rows[:, first : first + network.lens] = by_camera
        return rows

    def _through(self, rows: Rows, point: int, whitened: Whitened) -> Rows:
        """Take off what the point's own adjustment takes up."""
        normals, network = self.solution.normals, self.solution.network
        for ray in self.rays_of(point).tolist():
            first = SIZE * int(network.rays.photo[ray])
            rows[:, first : first + SIZE] -= whitened @ normals.photo_rays[:, ray].T
        lensed = slice(SIZE * self.photos, SIZE * self.photos + network.lensed)
        rows[:, lensed] -= whitened @ normals.camera_points[:, point].T
        return rows

    def _inverse_root(self, point: int) -> Float64[np.ndarray, "3 3"]:
        """L^-T of one point."""
        root = self.solution.normals.root[:, point : point + 1]
        return np.hstack([backward3(root, unit[:, None]) for unit in np.eye(3)])
