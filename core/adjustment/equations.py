"""Single observations of an adjusted block as rows over photos and cameras, points eliminated.

The ground at the nine von Gruber places of a photo is expressed by the same unknowns.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float64, Int
from scipy import sparse

from core.adjustment.factorisation import SIZE, backward3, solve_bordered_many
from core.adjustment.linearised import by_scaled_camera, ray_models
from core.adjustment.network import SMALLEST_SIGMA_PX, Network, State
from core.adjustment.solution import Solution
from core.arrays import Indices, Matrix, Position
from core.block import Measurement
from core.geometry.collinearity import stacked_partials

Rows = Float64[np.ndarray, "rows unknowns"]
"""Observations as rows over the unknowns of the photos, in their order, and the shared ones."""
Whitened = Float64[np.ndarray, "rows 3"]
"""Part of each row by its own point, that point's root taken off."""
# design: a batch of 2,400 unknowns (400 photos) takes 10 MB.
BATCH = 256
"""Observations whose cofactors are held at once."""
# design: just inside the frame, where photos are still measured.
REACH = 0.9
"""Outer places, as a share of half the frame."""
# source: the nine Gruber places of a photo.
PLACES = 9

Steps = Float64[np.ndarray, "unknowns steps"]
"""Changes of all photos' and shared unknowns."""


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

    def covariances(self, parts: Sequence[sparse.csr_array]) -> list[Matrix]:
        """A Q A^T of the rows of each of many observations, some at a time."""
        found = list[Matrix]()
        for first in range(0, len(parts), BATCH):
            some = parts[first : first + BATCH]
            rows = sparse.vstack(some).toarray()
            columns = self.cofactors(rows)
            ends = np.cumsum([0, *(len(part.indptr) - 1 for part in some)]).tolist()
            found += [rows[a:b] @ columns[:, a:b] for a, b in pairwise(ends)]
        return found

    def of_rays(self, rays: Indices) -> tuple[Rows, Whitened]:
        """The two coordinates of each of some rays that take part."""
        rows, whitened = self.sparse_rows(rays)
        return rows.toarray(), whitened

    def sparse_rows(self, rays: Indices) -> tuple[sparse.csr_array, Whitened]:
        """The same of very many rays: of all unknowns each has a few photos and the shared ones."""
        lin, network, normals = self.solution.fit.lin, self.solution.network, self.solution.normals
        photo, point = network.rays.photo[rays], network.rays.point[rays]
        each, shared = np.arange(len(rays)), SIZE * self.photos
        whitened = np.moveaxis(normals.by_point[:, :, rays], 2, 0)
        counts = self._starts[point + 1] - self._starts[point]
        of_ray = np.repeat(each, counts)
        firsts = np.repeat(self._starts[point] - np.cumsum(counts) + counts, counts)
        beside = self._order[firsts + np.arange(len(of_ray))]
        taken_up = whitened[of_ray] @ np.moveaxis(normals.photo_rays[:, beside], 0, 2)
        by_shared = whitened @ np.moveaxis(normals.camera_points[:, point], 0, 2)
        parts = [
            (each, SIZE * photo, np.moveaxis(lin.by_photo[:, :, rays], 2, 0)),
            (of_ray, SIZE * network.rays.photo[beside], -taken_up),
            (each, np.full(len(rays), shared), -by_shared),
        ]
        if network.lensed:
            first = shared + network.lens * network.camera[photo]
            parts.append((each, first, np.moveaxis(lin.by_camera[:, :, rays], 2, 0)))
        values, row, column = (
            np.concatenate(told) for told in zip(*map(_entries, parts), strict=True)
        )
        size = (2 * len(rays), self.unknowns)
        return sparse.csr_array((values, (row, column)), shape=size), whitened.reshape(-1, 3)

    def of_ground(self, point: int, axes: Sequence[int]) -> tuple[Rows, Whitened]:
        """Some known coordinates of a point."""
        weights = self.solution.network.points.known_weight[point]
        whitened = (self._inverse_root(point) * weights[:, None])[list(axes)]
        network = self.solution.network
        shifts = network.points.shifts
        begin, end = SIZE * self.photos + np.array([network.lensed, network.pointed])
        rows = np.zeros((len(whitened), self.unknowns))
        for own in np.flatnonzero(shifts.rows == point).tolist():
            rows[:, begin:end] = (weights[:, None] * shifts.design[own])[list(axes)]
        return self._through(rows, point, whitened), whitened

    def of_certificate(self, camera: int) -> Rows:
        """The certified constants of a camera that is estimated, and its additional parameters."""
        network = self.solution.network
        first = SIZE * self.photos + network.lens * camera
        rows = np.zeros((network.lens, self.unknowns))
        rows[:, first : first + network.lens] = np.diag(network.priors.constant_weights[camera])
        return rows

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
        pointed = slice(SIZE * self.photos, SIZE * self.photos + network.pointed)
        rows[:, pointed] -= whitened @ normals.camera_points[:, point].T
        return rows

    def _inverse_root(self, point: int) -> Float64[np.ndarray, "3 3"]:
        """L^-T of one point."""
        root = self.solution.normals.root[:, point : point + 1]
        return np.hstack([backward3(root, unit[:, None]) for unit in np.eye(3)])


def _entries(
    part: tuple[Indices, Indices, Float64[np.ndarray, "n 2 columns"]],
) -> tuple[Float64[np.ndarray, "all"], Int[np.ndarray, "all"], Int[np.ndarray, "all"]]:
    """Values, rows and columns of pairs of rows: number of the pair, first column, values."""
    pair, first, values = part
    row = np.broadcast_to(2 * pair[:, None, None] + np.arange(2)[:, None], values.shape)
    column = np.broadcast_to(first[:, None, None] + np.arange(values.shape[2]), values.shape)
    return values.ravel(), row.ravel(), column.ravel()


@dataclass(frozen=True, slots=True, eq=False)
class GroundShifts:
    """Derivatives of places on the ground (at their height) by the unknowns, metres."""

    by_photo: Float64[np.ndarray, "photos 9 2 6"]
    """By each photo's centre and rotation."""
    by_camera: Float64[np.ndarray, "photos 9 2 told"]
    """By the scaled unknowns of its camera; empty when cameras are held."""
    camera_start: Float64[np.ndarray, "photos"]
    """First unknown of its camera among the shared ones."""
    unknowns: int
    """Number of all photos' and shared ones."""

    def matrix(self) -> sparse.csr_array:
        """Two rows (E, N) for every place, over all unknowns."""
        photos, told = len(self.by_photo), self.by_camera.shape[3]
        own = np.arange(SIZE * photos).reshape(photos, SIZE)
        camera = SIZE * photos + self.camera_start.astype(np.int64)[:, None] + np.arange(told)
        columns = np.hstack([own, camera])[:, None, None]
        values = np.concatenate([self.by_photo, self.by_camera], axis=3)
        ends = np.arange(0, values.size + 1, SIZE + told)
        columns = np.broadcast_to(columns, values.shape)
        shape = (2 * PLACES * photos, self.unknowns)
        return sparse.csr_array((values.ravel(), columns.ravel(), ends), shape=shape)

    def of(self, steps: Steps) -> Float64[np.ndarray, "photos 9 2 steps"]:
        """Shifts (E, N) of every place, metres."""
        return (self.matrix() @ steps).reshape(len(self.by_photo), PLACES, 2, -1)

    def largest(self, steps: Steps) -> Float64[np.ndarray, "steps"]:
        """Largest shift each step brings about, metres."""
        return np.linalg.norm(self.of(steps), axis=2).max(axis=(0, 1))

    def covariances(
        self,
        own: Float64[np.ndarray, "photos 6 6"],
        mixed: Float64[np.ndarray, "photos 6 shared"],
        shared: Float64[np.ndarray, "shared shared"],
    ) -> Float64[np.ndarray, "photos 9 2 2"]:
        """Covariance (E, N) of every place from that of the unknowns, square metres."""
        found = self.by_photo @ own[:, None] @ np.swapaxes(self.by_photo, 2, 3)
        told = self.by_camera.shape[3]
        if told:
            for photo in range(len(own)):
                first = int(self.camera_start[photo])
                part = slice(first, first + told)
                cross = self.by_photo[photo] @ mixed[photo][:, part]
                cross = cross @ np.swapaxes(self.by_camera[photo], 1, 2)
                found[photo] += cross + np.swapaxes(cross, 1, 2)
                camera = self.by_camera[photo]
                found[photo] += camera @ shared[part, part] @ np.swapaxes(camera, 1, 2)
        return found


def nine_places(frame_mm: tuple[float, float]) -> Float64[np.ndarray, "9 2"]:
    """Three by three places over a frame, upper left to lower right, millimetres on the film."""
    line = REACH * np.array([-1.0, 0.0, 1.0])
    return np.array([(x, y) for y in line[::-1] for x in line]) * (np.array(frame_mm) / 2)


def ground_shifts_of(network: Network, state: State) -> GroundShifts:
    """The nine places of every photo of a network: three by three over the frame.

    Of a film point (f = const) at fixed height: dX = f_C,plan^-1 (f_C dC + f_w dw + f_c dc).
    """
    count = len(network.photos)
    places = np.array([nine_places(camera.frame_mm) for camera in network.cameras])
    distance = state.constants[network.camera, 0]
    image = np.empty((count, PLACES, 3))
    image[:, :, :2] = places[network.camera]
    image[:, :, 2] = -distance[:, None]
    direction = image @ np.swapaxes(state.rotations, 1, 2)
    ground = np.array([photo.ground_height_m for photo in network.photos])
    drop = (ground - state.centres[:, 2])[:, None]
    # design: a ray within a milliradian of the horizon meets no ground.
    down = np.minimum(direction[:, :, 2], -1e-3)
    offsets = direction * (drop / down)[:, :, None]
    photo = np.repeat(np.arange(count), PLACES)
    rays = np.ascontiguousarray(offsets.reshape(-1, 3).T)
    partials = stacked_partials(rays, ray_models(network, state, photo))
    # design: places behind the camera do not move.
    plan = np.linalg.inv(np.nan_to_num(np.moveaxis(partials.by_centre[:, :2], 2, 0), nan=1e9) + 0.0)
    by_photo = np.concatenate([partials.by_centre, partials.by_rotation], axis=1)
    told = network.lens if network.lensed else 0
    by_camera = np.zeros((count * PLACES, 2, told))
    if told:
        by_camera = plan @ np.moveaxis(by_scaled_camera(network, photo, partials), 2, 0)
    moved = plan @ np.moveaxis(by_photo, 2, 0)
    return GroundShifts(
        moved.reshape(count, PLACES, 2, SIZE),
        by_camera.reshape(count, PLACES, 2, told),
        (network.camera * told).astype(np.float64),
        SIZE * count + network.shared,
    )
