"""Single observations of an adjusted block as rows over photos and cameras, points eliminated."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from core.adjustment.banded import SIZE, solve_bordered_many
from core.adjustment.cholesky3 import backward3
from core.adjustment.linearised import by_scaled_camera, ray_models
from core.adjustment.network import SMALLEST_SIGMA_PX
from core.adjustment.solution import Solution
from core.arrays import Indices, Position
from core.block import Measurement
from core.geometry.collinearity import stacked_partials

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

    def of_rays(self, rays: Indices) -> tuple[Rows, Whitened]:
        """The two coordinates of each of some rays that take part."""
        lin, network, normals = self.solution.fit.lin, self.solution.network, self.solution.normals
        rows = [np.zeros((0, self.unknowns))]
        whitened = [np.zeros((0, 3))]
        for ray in rays.tolist():
            by_camera, photo = lin.by_camera[:, :, ray], int(network.rays.photo[ray])
            own = self._own(photo, lin.by_photo[:, :, ray], by_camera)
            whitened.append(normals.by_point[:, :, ray])
            rows.append(self._through(own, int(network.rays.point[ray]), whitened[-1]))
        return np.concatenate(rows), np.concatenate(whitened)

    def of_ground(self, point: int, axes: Sequence[int]) -> tuple[Rows, Whitened]:
        """Some known coordinates of a point."""
        weights = self.solution.network.points.known_weight[point]
        whitened = (self._inverse_root(point) * weights[:, None])[list(axes)]
        rows = np.zeros((len(whitened), self.unknowns))
        return self._through(rows, point, whitened), whitened

    def of_free_ray(
        self, photo: int, measurement: Measurement, position: Position
    ) -> tuple[Rows, Whitened]:
        """A ray to a point of its own: its rows, and its derivatives by the point (2, 3)."""
        network, state = self.solution.network, self.solution.fit.state
        one = np.array([photo])
        offsets = (position - state.centres[photo])[:, None]
        partials = stacked_partials(offsets, ray_models(network, state, one))
        pixel_size_mm = network.photos[photo].interior.pixel_size_mm
        sigma = pixel_size_mm * max(measurement.sigma_px, SMALLEST_SIGMA_PX)
        by_photo = np.hstack([partials.by_centre[:, :, 0], partials.by_rotation[:, :, 0]])
        by_camera = by_scaled_camera(network, one, partials)[:, :, 0]
        rows = self._own(photo, by_photo / sigma, by_camera / sigma)
        return rows, -partials.by_centre[:, :, 0] / sigma

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
