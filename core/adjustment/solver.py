"""Least squares of one network: points eliminated, photos in a band, cameras as its border.

Everything is in units of standard deviations; arrays are laid out with the rays last.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int

from core.adjustment.factorisation import (
    SIZE,
    BorderedFactor,
    backward3,
    band_places,
    cholesky3,
    factor_bordered,
    forward3,
    narrow_places,
    solve_bordered,
)
from core.adjustment.linearised import Linearised
from core.adjustment.network import Network

Weights = Float64[np.ndarray, "rays"]
"""Factor on the squared residuals of each ray."""
# design: 64 photos of 200 rays are 3 MB, which a second-level cache holds.
TOGETHER = 64
"""So many photos, or pairs of them, are gathered at a time: what is gathered stays in the cache."""


@dataclass(frozen=True, slots=True, eq=False)
class Pattern:
    """Which rays meet in which points, and where photos stand in the band."""

    first: Int[np.ndarray, "meetings"]
    """One ray of every two that share a point, ordered by their photos."""
    second: Int[np.ndarray, "meetings"]
    """The other ray, in a later photo."""
    slices: Int[np.ndarray, "starts"]
    """Start of each pair of photos in these lists."""
    low: Int[np.ndarray, "pairs"]
    """Earlier photo of each pair of photos."""
    high: Int[np.ndarray, "pairs"]
    """Later photo of each pair."""
    place: Int[np.ndarray, "photos"]
    """Where each photo stands in the band."""
    reach: int
    """How many places two photos that share a point are apart at most."""


def pattern_of(network: Network) -> Pattern:
    """Pairs of rays by pair of photos, and an order of photos that keeps the band narrow."""
    rays, photos = network.rays, len(network.photos)
    first, second = _ray_pairs(rays.point)
    swap = rays.photo[first] > rays.photo[second]
    first, second = np.where(swap, second, first), np.where(swap, first, second)
    key = rays.photo[first] * photos + rays.photo[second]
    order = np.argsort(key, kind="stable")
    keys, starts = np.unique(key[order], return_index=True)
    low, high = keys // photos, keys % photos
    centres = np.array([photo.exterior.centre for photo in network.photos]).reshape(-1, 3)
    place = narrow_places(low, high, centres)
    reach = int(np.abs(place[low] - place[high]).max(initial=0))
    slices = np.append(starts, len(order)).astype(np.int64)
    return Pattern(first[order], second[order], slices, low, high, place, reach)


def _ray_pairs(
    point: Int[np.ndarray, "rays"],
) -> tuple[Int[np.ndarray, "meetings"], Int[np.ndarray, "meetings"]]:
    """Every two rays of the same point."""
    order = np.argsort(point, kind="stable")
    numbers = point[order]
    firsts, seconds = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for lag in range(1, len(point)):
        same = np.flatnonzero(numbers[lag:] == numbers[:-lag])
        if not len(same):
            break
        firsts.append(order[same])
        seconds.append(order[same + lag])
    return np.concatenate(firsts), np.concatenate(seconds)


@dataclass(frozen=True, slots=True, eq=False)
class Normals:
    """Normal equations with the points eliminated.

    With V = L L^T a point's own 3 x 3 part, W the part it shares with photo or camera: the reduced
    system has sum of W L^-T (W L^-T)^T taken off.
    """

    by_point: Float64[np.ndarray, "2 3 rays"]
    """B L^-T of each ray, B its derivatives by the point."""
    photo_rays: Float64[np.ndarray, "6 rays 3"]
    """W L^-T of each ray and its photo."""
    camera_points: Float64[np.ndarray, "pointed points 3"]
    """W L^-T of each point and the cameras' constants, then the shifts of references."""
    root: Float64[np.ndarray, "6 points"]
    """L of each point: entries 00, 10, 11, 20, 21, 22."""
    point_side: Float64[np.ndarray, "points 3"]
    """L^-1 times the point's gradient."""
    factor: BorderedFactor
    """The reduced system, factored."""
    photo_side: Float64[np.ndarray, "photos 6"]
    """Reduced gradient of the photos."""
    camera_side: Float64[np.ndarray, "shared"]
    """Reduced gradient of what photos share."""


@dataclass(frozen=True, slots=True, eq=False)
class Increment:
    """One step of the unknowns."""

    photos: Float64[np.ndarray, "photos 6"]
    """Centre (metres) and rotation (radians)."""
    constants: Float64[np.ndarray, "cameras lens"]
    """Camera constants, unscaled, and additional parameters."""
    positioning: Float64[np.ndarray, "unknowns"]
    """Shifts, drifts (metres) and misalignment (radians)."""
    shifts: Float64[np.ndarray, "shifts"]
    """Of references, metres."""
    points: Float64[np.ndarray, "points 3"]
    """Object points, metres."""
    decrement: float
    """Fall of the squared residuals the linear model promises: the step's length in sigmas."""


def normals_of(
    network: Network, pattern: Pattern, lin: Linearised, weights: Weights, *, damping: float
) -> Normals:
    """Build and factor the reduced normal equations; weights multiply the rays' squares.

    Raises `numpy.linalg.LinAlgError` where they are singular.
    """
    root, by_point, point_side = _eliminate_points(network, lin, weights, damping)
    photo_rays = _shared_with_photos(lin, by_point, weights)
    camera_points = np.concatenate(
        [
            _shared_with_cameras(network, lin, by_point, weights),
            _shared_with_shifts(network, root),
        ]
    )
    system = _Reduced(network, pattern)
    system.add_rays(lin, weights)
    system.add_priors(lin)
    system.damp(damping)
    system.take_off_points(photo_rays, camera_points, point_side)
    return Normals(
        by_point=by_point,
        photo_rays=photo_rays,
        camera_points=camera_points,
        root=root,
        point_side=point_side,
        factor=system.factor(photo_rays),
        photo_side=system.photo_side,
        camera_side=system.camera_side,
    )


def _eliminate_points(
    network: Network, lin: Linearised, weights: Weights, damping: float
) -> tuple[
    Float64[np.ndarray, "6 points"],
    Float64[np.ndarray, "2 3 rays"],
    Float64[np.ndarray, "points 3"],
]:
    """Cholesky root of each point's own part, rays by point times its inverse, and L^-1 g."""
    point, count = network.rays.point, network.points.count
    known = network.points.known_weight
    by_point = -lin.by_photo[:, :3]
    weighted = by_point * weights
    own = np.empty((9, count))
    for row, (i, j) in enumerate(((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2))):
        entry = weighted[0, i] * by_point[0, j] + weighted[1, i] * by_point[1, j]
        own[row] = np.bincount(point, entry, count)
        if i == j:
            own[row] = (own[row] + known[:, i] ** 2) * (1 + damping)
    for axis in range(3):
        entry = weighted[0, axis] * lin.residuals[0] + weighted[1, axis] * lin.residuals[1]
        own[6 + axis] = np.bincount(point, entry, count) + known[:, axis] * lin.ground[:, axis]
    root = cholesky3(own[:6])
    side = forward3(root, own[6:])
    scaled = np.take(root, point, axis=1)
    whitened = np.stack([forward3(scaled, by_point[0]), forward3(scaled, by_point[1])])
    return root, whitened, np.ascontiguousarray(side.T)


def _shared_with_photos(
    lin: Linearised, by_point: Float64[np.ndarray, "2 3 rays"], weights: Weights
) -> Float64[np.ndarray, "6 rays 3"]:
    """W L^-T of each ray with its photo."""
    shared = np.empty((SIZE, len(weights), 3))
    weighted = by_point * weights
    for row in range(SIZE):
        for axis in range(3):
            shared[row, :, axis] = (
                lin.by_photo[0, row] * weighted[0, axis] + lin.by_photo[1, row] * weighted[1, axis]
            )
    return shared


def _shared_with_cameras(
    network: Network,
    lin: Linearised,
    by_point: Float64[np.ndarray, "2 3 rays"],
    weights: Weights,
) -> Float64[np.ndarray, "lensed points 3"]:
    """W L^-T of each point with the constants of all cameras."""
    rays, cameras, count = network.rays, len(network.cameras), network.points.count
    shared = np.empty((network.lensed, count, 3))
    bins = network.camera[rays.photo] * count + rays.point
    weighted = by_point * weights
    for row in range(lin.by_camera.shape[1]):
        for axis in range(3):
            entry = (
                lin.by_camera[0, row] * weighted[0, axis]
                + lin.by_camera[1, row] * weighted[1, axis]
            )
            sums = np.bincount(bins, entry, cameras * count).reshape(cameras, count)
            shared[row :: network.lens, :, axis] = sums
    return shared


def _shared_with_shifts(
    network: Network, root: Float64[np.ndarray, "6 points"]
) -> Float64[np.ndarray, "shifts points 3"]:
    """W L^-T of each point with the shifts of references: both make up a known coordinate."""
    shifts, known = network.points.shifts, network.points.known_weight
    shared = np.zeros((shifts.count, network.points.count, 3))
    own = (known[shifts.rows, :, None] ** 2 * shifts.design).transpose(2, 1, 0)
    for unknown in range(shifts.count):
        shared[unknown, shifts.rows] = forward3(root[:, shifts.rows], own[unknown]).T
    return shared


class _Reduced:
    """The reduced normal equations while they are summed up."""

    def __init__(self, network: Network, pattern: Pattern) -> None:
        self._network = network
        self._pattern = pattern
        photos, shared = len(network.photos), network.shared
        self._blocks = np.zeros((photos, SIZE, SIZE))
        self._border = np.zeros((photos, SIZE, shared))
        self._corner = np.zeros((shared, shared))
        self.photo_side = np.zeros((photos, SIZE))
        self.camera_side = np.zeros(shared)

    def add_rays(self, lin: Linearised, weights: Weights) -> None:
        """Squares and products of photo, camera and residual, photo by photo."""
        first, photos = self._network.rays.first, len(self._blocks)
        derivatives = (lin.by_photo, lin.by_camera, lin.residuals[:, None])
        for begin in range(0, photos, TOGETHER):
            end = min(begin + TOGETHER, photos)
            rays = slice(first[begin], first[end])
            rows = np.concatenate([part[:, :, rays] for part in derivatives], axis=1)
            rows *= np.sqrt(weights[rays])
            for photo in range(begin, end):
                own = slice(first[photo] - first[begin], first[photo + 1] - first[begin])
                self._add_photo(photo, rows[:, :, own])

    def _add_photo(self, photo: int, rows: Float64[np.ndarray, "2 unknowns rays"]) -> None:
        """One photo's rays; the last row holds their residuals."""
        product = rows[0] @ rows[0].T + rows[1] @ rows[1].T
        camera = self._columns(photo)
        self._blocks[photo] = product[:SIZE, :SIZE]
        self.photo_side[photo] = product[:SIZE, -1]
        self._border[photo][:, camera] = product[:SIZE, SIZE:-1]
        self._corner[camera, camera] += product[SIZE:-1, SIZE:-1]
        self.camera_side[camera] += product[SIZE:-1, -1]

    def _columns(self, photo: int) -> slice:
        """Unknowns of the photo's camera in the border; none when constants are held."""
        lens = self._network.lens if self._network.estimate_cameras else 0
        start = int(self._network.camera[photo]) * lens
        return slice(start, start + lens)

    def add_priors(self, lin: Linearised) -> None:
        """What is known of orientations and camera constants."""
        priors = self._network.priors
        axes = np.arange(3)
        self._blocks[:, axes, axes] += priors.centre_weights**2
        self.photo_side[:, :3] += priors.centre_weights * lin.centres
        turned = np.swapaxes(lin.angles_by_rotation, 1, 2)
        self._blocks[:, 3:, 3:] += turned @ lin.angles_by_rotation
        self.photo_side[:, 3:] += (turned @ lin.angles[:, :, None])[:, :, 0]
        lensed, shifts = self._network.lensed, self._network.points.shifts
        weights = np.concatenate(
            [
                priors.constant_weights.ravel()[:lensed],
                shifts.weights,
                self._network.positioning.weights,
            ]
        )
        residuals = [lin.constants.ravel()[:lensed], lin.shifts, lin.positioning]
        self._corner += np.diag(weights**2)
        self.camera_side += weights * np.concatenate(residuals)
        self._add_shifts(lin)
        if self._network.positioning.count:
            self._add_positioning(lin, turned)

    def _add_shifts(self, lin: Linearised) -> None:
        """What known coordinates say of the shifts of their references."""
        points, part = self._network.points, slice(self._network.lensed, self._network.pointed)
        own = points.shifts.rows
        rows = points.known_weight[own, :, None] * points.shifts.design
        rows = rows.reshape(3 * len(own), points.shifts.count)
        self._corner[part, part] += rows.T @ rows
        self.camera_side[part] += rows.T @ lin.ground[own].ravel()

    def _add_positioning(self, lin: Linearised, turned: Float64[np.ndarray, "photos 3 3"]) -> None:
        """What measured centres and angles say of shift, drift and misalignment."""
        part = slice(self._network.pointed, None)
        weights = self._network.priors.centre_weights[:, :, None]
        self._border[:, :3, part] += weights * lin.centres_by_positioning
        self._border[:, 3:, part] += turned @ lin.angles_by_positioning
        for design, residuals in (
            (lin.centres_by_positioning, lin.centres),
            (lin.angles_by_positioning, lin.angles),
        ):
            rows = design.reshape(-1, design.shape[2])
            self._corner[part, part] += rows.T @ rows
            self.camera_side[part] += rows.T @ residuals.ravel()

    def damp(self, damping: float) -> None:
        """Levenberg and Marquardt: the diagonal grows, steps shrink."""
        six, shared = np.arange(SIZE), np.arange(len(self._corner))
        self._blocks[:, six, six] *= 1 + damping
        self._corner[shared, shared] *= 1 + damping

    def take_off_points(
        self,
        photo_rays: Float64[np.ndarray, "6 rays 3"],
        camera_points: Float64[np.ndarray, "pointed points 3"],
        point_side: Float64[np.ndarray, "points 3"],
    ) -> None:
        """Eliminate the points from photos' own blocks, border, corner and gradient."""
        network = self._network
        shared, count = camera_points.shape[0], 3 * network.points.count
        common = np.concatenate([camera_points, point_side[None]])
        by_point = common.reshape(shared + 1, count)
        product = by_point @ by_point.T
        self._corner[:shared, :shared] -= product[:-1, :-1]
        self.camera_side[:shared] -= product[:-1, -1]
        rays, photos = network.rays, len(self._blocks)
        for begin in range(0, photos, TOGETHER):
            end = min(begin + TOGETHER, photos)
            by_ray = np.take(common, rays.point[rays.first[begin] : rays.first[end]], axis=1)
            for photo in range(begin, end):
                start, stop = rays.first[photo : photo + 2]
                own = photo_rays[:, start:stop].reshape(SIZE, 3 * (stop - start))
                here = slice(start - rays.first[begin], stop - rays.first[begin])
                others = by_ray[:, here].reshape(shared + 1, 3 * (stop - start))
                self._blocks[photo] -= own @ own.T
                product = own @ others.T
                self._border[photo][:, :shared] -= product[:, :-1]
                self.photo_side[photo] -= product[:, -1]

    def factor(self, photo_rays: Float64[np.ndarray, "6 rays 3"]) -> BorderedFactor:
        """Lay photos' own blocks and those of pairs into the band, and factor."""
        pattern = self._pattern
        pairs = self._pair_blocks(photo_rays)
        photos, unknowns = len(self._blocks), len(self._blocks) * SIZE
        place_low, place_high = pattern.place[pattern.low], pattern.place[pattern.high]
        upside = (place_low > place_high)[:, None, None]
        blocks = np.concatenate([self._blocks, np.where(upside, pairs, np.swapaxes(pairs, 1, 2))])
        rows = np.concatenate([pattern.place, np.maximum(place_low, place_high)])
        columns = np.concatenate([pattern.place, np.minimum(place_low, place_high)])
        index, below = band_places(rows, columns, unknowns)
        band = np.bincount(
            index.ravel(), (blocks * below).ravel(), SIZE * (pattern.reach + 1) * unknowns
        ).reshape(-1, unknowns)
        border = np.empty((photos, SIZE, self._border.shape[2]))
        border[pattern.place] = self._border
        return factor_bordered(band, border.reshape(unknowns, border.shape[2]), self._corner)

    def _pair_blocks(
        self, photo_rays: Float64[np.ndarray, "6 rays 3"]
    ) -> Float64[np.ndarray, "pairs 6 6"]:
        """What eliminating their points leaves between two photos, 6 x 6 each."""
        pattern = self._pattern
        blocks = np.empty((len(pattern.low), SIZE, SIZE))
        for begin in range(0, len(blocks), TOGETHER):
            ends = pattern.slices[begin : begin + TOGETHER + 1]
            rays = slice(ends[0], ends[-1])
            first = np.take(photo_rays, pattern.first[rays], axis=1).reshape(SIZE, -1)
            second = np.take(photo_rays, pattern.second[rays], axis=1).reshape(SIZE, -1)
            ends = 3 * (ends - ends[0])
            for pair in range(len(ends) - 1):
                part = slice(ends[pair], ends[pair + 1])
                np.matmul(first[:, part], second[:, part].T, out=blocks[begin + pair])
        return -blocks


def solve(network: Network, pattern: Pattern, normals: Normals) -> Increment:
    """The step that the normal equations ask for."""
    side = np.empty_like(normals.photo_side)
    side[pattern.place] = normals.photo_side
    band, shared = solve_bordered(normals.factor, -side.ravel(), -normals.camera_side)
    photos = band.reshape(-1, SIZE)[pattern.place]
    rays = network.rays
    steps = np.take(np.ascontiguousarray(photos.T), rays.photo, axis=1)
    by_ray = np.einsum("rnk,rn->kn", normals.photo_rays, steps)
    moved = normals.point_side.T.copy()
    for axis in range(3):
        moved[axis] += np.bincount(rays.point, by_ray[axis], network.points.count)
    lensed, pointed = network.lensed, network.pointed
    moved += np.tensordot(shared[:pointed], normals.camera_points, axes=1).T
    constants = np.zeros((len(network.cameras), network.lens))
    if network.estimate_cameras:
        constants = shared[:lensed].reshape(-1, network.lens) / network.scale
    fall = np.sum(photos * normals.photo_side) + np.sum(shared * normals.camera_side)
    return Increment(
        photos=photos,
        constants=constants,
        positioning=shared[pointed:],
        shifts=shared[lensed:pointed],
        points=-backward3(normals.root, moved).T,
        decrement=float(np.sum(normals.point_side**2) - fall),
    )
