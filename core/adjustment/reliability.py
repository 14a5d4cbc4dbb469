"""Standard deviations and redundancy of an adjusted block, and measurements that contradict it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy.special import ndtri, stdtrit

from core.adjustment.factorisation import (
    SIZE,
    BorderedInverse,
    DenseInverse,
    backward3,
    forward3,
    invert_bordered,
)
from core.adjustment.linearised import Linearised
from core.adjustment.network import Network
from core.adjustment.solver import Normals, Pattern, Weights
from core.arrays import Scalars
from core.geometry.robust import robust_sigma

# source: Baarda 1968: risk 0.1 %, power 80 %.
NONCENTRALITY = 4.13
"""Shift of w that is found in 80 % of cases at a risk of 0.1 % (Baarda 1968)."""
# design: below it rounding decides.
SMALLEST_REDUNDANCY = 1e-6
"""Below this a residual is nought whatever was measured, and says nothing."""

NOT_TURNED = np.eye(3)
"""Coordinates as they are."""

RayPairs = Float64[np.ndarray, "2 rays"]
"""Two film coordinates of each ray."""
Chosen = Bool[np.ndarray, "rays"]
"""One truth value per ray."""


@dataclass(frozen=True, slots=True)
class TestLimits:
    """From which standardised residual a measurement is left out, below which it comes back."""

    critical: float
    """The limit for residuals whose standard deviations are known."""
    risk: float
    """Probability of a false alarm for one coordinate."""

    @staticmethod
    def of(test: str, risk: float, redundancy: float) -> "TestLimits":
        """Limits of Baarda's w test or Pope's tau test.

        Args:
            test: `w` trusts the stated standard deviations, `tau` estimates them.
            risk: Probability of a false alarm for one coordinate.
            redundancy: Redundancy of the adjustment.
        """
        limits = TestLimits(float(ndtri(1 - risk / 2)), risk)
        return TestLimits(limits.tau(redundancy), risk) if test == "tau" else limits

    def tau(self, redundancy: float) -> float:
        """The limit where the standard deviation comes from residuals of some redundancy r.

        tau = t sqrt(r / (r - 1 + t^2)) with Student's t of r - 1 degrees of freedom (Pope 1976).
        """
        if redundancy <= 2:
            return self.critical
        t = float(stdtrit(redundancy - 1, 1 - self.risk / 2))
        return t * float(np.sqrt(redundancy / (redundancy - 1 + t * t)))


@dataclass(frozen=True, slots=True, eq=False)
class Precision:
    """Cofactors: covariances for a sigma nought of one."""

    rays: RayPairs
    """Of each ray's computed coordinates, in units of its variance."""
    photos: Float64[np.ndarray, "photos 6 6"]
    """Of centres (metres) and rotation increments (radians)."""
    points: Float64[np.ndarray, "points 3"]
    """Variances of the points' coordinates, square metres."""
    known: Float64[np.ndarray, "points 3"]
    """The same as their references have them, shifted, square metres."""
    constants: Float64[np.ndarray, "shared shared"]
    """Of the scaled camera constants, shifts of references, and of the positioning's unknowns."""
    mixed: Float64[np.ndarray, "photos 6 shared"]
    """Between photos and these."""


def precision_of(
    network: Network, pattern: Pattern, lin: Linearised, normals: Normals
) -> Precision:
    """Cofactors of all unknowns and computed coordinates from undamped normal equations.

    With X = -(L^-T)(t + Y^T d), d the photos and constants, Q their cofactors: the cofactors of a
    point are L^-T (I + Y^T Q Y) L^-1, those between d and X are -Q Y L^-1.
    """
    inverse = invert_bordered(normals.factor, pattern.reach)
    return precision_from(network, pattern, lin, normals, inverse=inverse, place=pattern.place)


def precision_from(
    network: Network,
    pattern: Pattern,
    lin: Linearised,
    normals: Normals,
    *,
    inverse: BorderedInverse | DenseInverse,
    place: Int[np.ndarray, "photos"],
    turn: Float64[np.ndarray, "3 3"] = NOT_TURNED,
) -> Precision:
    """Cofactors of everything from those of photos and cameras.

    Args:
        network: What was adjusted.
        pattern: Which rays meet.
        lin: The model at its state.
        normals: The equations there.
        inverse: Cofactors of photos and of what they share.
        place: Where each photo stands in it.
        turn: Turns and scales the points' coordinates before their variances are taken.
    """
    own = inverse.pairs(place, place)
    shared = inverse.with_border(place)
    photo_part = _photo_part(
        network, pattern, normals, inverse, place=place, own=own, shared=shared
    )
    camera_part = _camera_part(network, normals, inverse, shared)
    inner = _point_part(network, normals, photo_part, camera_part)
    points = _point_variances(normals, inner, turn)
    return Precision(
        rays=np.stack(
            [
                _ray_variance(
                    network, lin, normals, own, shared=shared, corner=inverse.corner, axis=axis
                )
                + _point_variance(
                    network,
                    lin,
                    normals,
                    photo_part,
                    camera_part=camera_part,
                    inner=inner,
                    axis=axis,
                )
                for axis in range(2)
            ]
        ),
        photos=own,
        points=points,
        known=_known_variances(network, normals, inverse.corner, points, camera_part=camera_part),
        constants=inverse.corner,
        mixed=shared,
    )


def _photo_part(
    network: Network,
    pattern: Pattern,
    normals: Normals,
    inverse: BorderedInverse | DenseInverse,
    *,
    place: Int[np.ndarray, "photos"],
    own: Float64[np.ndarray, "photos 6 6"],
    shared: Float64[np.ndarray, "photos 6 shared"],
) -> Float64[np.ndarray, "6 rays 3"]:
    """Rows of Q Y that belong to each ray's photo."""
    rays, photo_rays = network.rays, normals.photo_rays
    part = np.empty_like(photo_rays)
    constants = np.take(normals.camera_points, rays.point, axis=1)
    shared = shared[:, :, : network.pointed]
    for photo, (start, stop) in enumerate(zip(rays.first[:-1], rays.first[1:], strict=True)):
        part[:, start:stop] = _times(own[photo], photo_rays[:, start:stop])
        part[:, start:stop] += _times(shared[photo], constants[:, start:stop])
    between = inverse.pairs(place[pattern.low], place[pattern.high])
    first = np.take(photo_rays, pattern.first, axis=1)
    second = np.take(photo_rays, pattern.second, axis=1)
    for pair, (start, stop) in enumerate(zip(pattern.slices[:-1], pattern.slices[1:], strict=True)):
        # A point has one ray in a photo, so no ray occurs twice in one pair of photos.
        part[:, pattern.first[start:stop]] += _times(between[pair], second[:, start:stop])
        part[:, pattern.second[start:stop]] += _times(between[pair].T, first[:, start:stop])
    return part


def _times(
    matrix: Float64[np.ndarray, "a b"], blocks: Float64[np.ndarray, "b m 3"]
) -> Float64[np.ndarray, "a m 3"]:
    """A matrix times many blocks of three columns."""
    rows, many, _ = blocks.shape
    return (matrix @ blocks.reshape(rows, 3 * many)).reshape(len(matrix), many, 3)


def _camera_part(
    network: Network,
    normals: Normals,
    inverse: BorderedInverse | DenseInverse,
    shared: Float64[np.ndarray, "photos 6 shared"],
) -> Float64[np.ndarray, "pointed points 3"]:
    """Rows of Q Y that belong to the cameras' constants and the shifts of references."""
    rays, count, pointed = network.rays, network.points.count, network.pointed
    by_ray = np.empty((pointed, len(rays.photo), 3))
    shared = shared[:, :, :pointed]
    for photo, (start, stop) in enumerate(zip(rays.first[:-1], rays.first[1:], strict=True)):
        by_ray[:, start:stop] = _times(shared[photo].T, normals.photo_rays[:, start:stop])
    part = _times(inverse.corner[:pointed, :pointed], normals.camera_points)
    for row in range(pointed):
        for axis in range(3):
            part[row, :, axis] += np.bincount(rays.point, by_ray[row, :, axis], count)
    return part


def _point_part(
    network: Network,
    normals: Normals,
    photo_part: Float64[np.ndarray, "6 rays 3"],
    camera_part: Float64[np.ndarray, "pointed points 3"],
) -> Float64[np.ndarray, "3 3 points"]:
    """I + Y^T Q Y of each point."""
    point, count = network.rays.point, network.points.count
    inner = np.empty((3, 3, count))
    for i in range(3):
        for j in range(i + 1):
            by_ray = np.einsum("rn,rn->n", normals.photo_rays[:, :, i], photo_part[:, :, j])
            constants = np.einsum("rn,rn->n", normals.camera_points[:, :, i], camera_part[:, :, j])
            inner[i, j] = np.bincount(point, by_ray, count) + constants + float(i == j)
            inner[j, i] = inner[i, j]
    return inner


def _ray_variance(
    network: Network,
    lin: Linearised,
    normals: Normals,
    own: Float64[np.ndarray, "photos 6 6"],
    *,
    shared: Float64[np.ndarray, "photos 6 shared"],
    corner: Float64[np.ndarray, "shared shared"],
    axis: int,
) -> Weights:
    """The share of photo and camera in the variance of one computed coordinate."""
    rays, lens = network.rays, lin.by_camera.shape[1]
    variance = np.empty(len(rays.photo))
    for photo, (start, stop) in enumerate(zip(rays.first[:-1], rays.first[1:], strict=True)):
        columns = slice(network.camera[photo] * lens, (network.camera[photo] + 1) * lens)
        rows = np.concatenate(
            [lin.by_photo[axis, :, start:stop], lin.by_camera[axis, :, start:stop]]
        )
        cofactors = np.empty((SIZE + lens, SIZE + lens))
        cofactors[:SIZE, :SIZE] = own[photo]
        cofactors[:SIZE, SIZE:] = shared[photo][:, columns]
        cofactors[SIZE:, :SIZE] = shared[photo][:, columns].T
        cofactors[SIZE:, SIZE:] = corner[columns, columns]
        variance[start:stop] = np.sum(rows * (cofactors @ rows), axis=0)
    return variance


def _point_variance(
    network: Network,
    lin: Linearised,
    normals: Normals,
    photo_part: Float64[np.ndarray, "6 rays 3"],
    *,
    camera_part: Float64[np.ndarray, "pointed points 3"],
    inner: Float64[np.ndarray, "3 3 points"],
    axis: int,
) -> Weights:
    """The share of the point in the variance of one computed coordinate, mixed terms included."""
    rays = network.rays
    by_point = normals.by_point[axis]
    inner_of_ray = np.take(inner, rays.point, axis=2)
    mixed = np.einsum("rn,rnk->kn", lin.by_photo[axis], photo_part)
    lens = lin.by_camera.shape[1]
    if lens:
        camera = network.camera[rays.photo]
        for row in range(lens):
            constants = camera_part[camera * network.lens + row, rays.point]
            mixed += lin.by_camera[axis, row] * constants.T
    own = np.einsum("in,ijn,jn->n", by_point, inner_of_ray, by_point)
    return own - 2 * np.sum(by_point * mixed, axis=0)


def _point_variances(
    normals: Normals,
    inner: Float64[np.ndarray, "3 3 points"],
    turn: Float64[np.ndarray, "3 3"],
) -> Float64[np.ndarray, "points 3"]:
    """Diagonals of T L^-T (I + Y^T Q Y) L^-1 T^T, T what turns the coordinates."""
    count = inner.shape[2]
    columns = np.empty((3, 3, count))
    for axis in range(3):
        unit = np.zeros((3, count))
        unit[axis] = 1.0
        columns[:, axis] = backward3(normals.root, unit)
    columns = np.einsum("ab,bkn->akn", turn, columns)
    return np.einsum("akn,kln,aln->na", columns, inner, columns)


def _known_variances(
    network: Network,
    normals: Normals,
    corner: Float64[np.ndarray, "shared shared"],
    points: Float64[np.ndarray, "points 3"],
    *,
    camera_part: Float64[np.ndarray, "pointed points 3"],
) -> Float64[np.ndarray, "points 3"]:
    """Variances of point plus shift: between both are -Q Y L^-1."""
    shifts, known = network.points.shifts, points.copy()
    own = slice(network.lensed, network.pointed)
    for axis in range(3):
        unit = np.zeros((3, len(shifts.rows)))
        unit[axis] = 1.0
        column = forward3(normals.root[:, shifts.rows], unit)
        mixed = -np.einsum("unk,kn->nu", camera_part[own][:, shifts.rows], column)
        by_shift = shifts.design[:, axis]
        moved = by_shift @ corner[own, own] + 2 * mixed
        known[shifts.rows, axis] += np.sum(moved * by_shift, axis=1)
    return known


def standardised_residuals(lin: Linearised, precision: Precision, weights: Weights) -> RayPairs:
    """Every film coordinate's w = |v| / sqrt(q_vv); of rays left out, that of their prediction."""
    left_out = weights == 0
    variance = 1 - weights * precision.rays
    variance[:, left_out] = 1 + precision.rays[:, left_out]
    checked = variance > SMALLEST_REDUNDANCY
    scale = np.sqrt(np.where(checked, variance, 1.0))
    return np.where(checked, np.abs(lin.residuals) / scale, 0.0)


def gross_errors(
    network: Network,
    lin: Linearised,
    precision: Precision,
    standardised: RayPairs,
    *,
    taking_part: Chosen,
    limits: TestLimits,
) -> Chosen:
    """Rays to leave out next: beyond the critical value, and the worst where errors spread.

    Of a tie point only the worst ray goes; of control those half as bad as the worst in their point
    and photo, and more: what they hide shows in the next round. Where the rays of a control point
    agree with each other but not with its coordinates, all of them go. What a human accepted stays.
    """
    rays, control = network.rays, network.rays.measurement >= 0
    free = taking_part & ~network.by_operator
    by_ray = _scaled(network, standardised, precision, taking_part, limits)
    by_ray = np.where(free, by_ray, 0.0)
    of_point = np.zeros(network.points.count)
    np.maximum.at(of_point, rays.point, by_ray)
    ground = _ground_scores(network, lin, precision, taking_part)[rays.point]
    misplaced = control & free & (ground >= of_point[rays.point])
    score = np.where(misplaced, ground, by_ray)
    of_photo = np.zeros(len(network.photos))
    np.maximum.at(of_photo, rays.photo[control], score[control])
    share = np.where(control, 0.5, 1.0)
    leading = misplaced | (by_ray >= share * of_point[rays.point])
    return (score > limits.critical) & leading & (~control | (score >= 0.5 * of_photo[rays.photo]))


def _ground_scores(
    network: Network, lin: Linearised, precision: Precision, taking_part: Chosen
) -> Float64[np.ndarray, "points"]:
    """Largest standardised residual of each point's known coordinates; 0 for points that keep."""
    rays, count = network.rays, network.points.count
    known = network.points.known_weight > 0
    variance = 1 - np.where(known, precision.known, 0.0) * network.points.known_weight**2
    checked = (variance > SMALLEST_REDUNDANCY) & known
    scale = np.sqrt(np.where(checked, variance, 1.0))
    scores = np.where(checked, np.abs(lin.ground) / scale, 0.0)
    used = np.bincount(rays.point[taking_part], minlength=count) > 0
    if checked.any():
        scores /= _class_scale(scores[checked & used[:, None]])
    accepted = np.bincount(rays.point[taking_part & network.by_operator], minlength=count) > 0
    return np.where(used & ~accepted, scores.max(axis=1), 0.0)


def cleared_rays(
    network: Network,
    lin: Linearised,
    precision: Precision,
    standardised: RayPairs,
    *,
    taking_part: Chosen,
    candidates: Chosen,
    limits: TestLimits,
) -> Chosen:
    """Rays left out before that the others no longer contradict.

    Of control that few others predict only the surest of a photo comes back: what is wrong would
    come with it, as the prediction is too weak to tell the two apart. With it, it is strong enough.
    """
    rays = network.rays
    worst = _scaled(network, standardised, precision, taking_part, limits)
    alive = np.bincount(rays.point, taking_part, network.points.count) >= 2
    back = candidates & ~taking_part & (worst < limits.critical)
    back &= network.anchored | alive[rays.point]
    weak = np.flatnonzero(back & (rays.measurement >= 0))
    by_photo, own = lin.by_photo[:, :, weak], precision.photos[rays.photo[weak]]
    of_photo = np.einsum("ain,nij,ajn->an", by_photo, own, by_photo)
    # design: the photo, not measurement or ground, is the larger part of what is uncertain.
    hangs = (of_photo > 0.5 * (1 + precision.rays[:, weak])).any(axis=0)
    weak = weak[hangs]
    surest = weak[np.lexsort((worst[weak], rays.photo[weak]))]
    back[weak] = False
    back[surest[np.unique(rays.photo[surest], return_index=True)[1]]] = True
    return back


def _scaled(
    network: Network,
    standardised: RayPairs,
    precision: Precision,
    taking_part: Chosen,
    limits: TestLimits,
) -> Weights:
    """The larger standardised residual of each ray over the sigma of its class, at least one.

    The class's sigma is robust, so that gross errors do not hide each other. Where it is estimated,
    residuals are measured by Pope's limit of the class instead of the known one.
    """
    control = network.rays.measurement >= 0
    worst = standardised.max(axis=0)
    for members in (control, ~control):
        used = members & taking_part
        if used.any():
            scale = _class_scale(standardised[:, used].ravel())
            worst[members] /= scale
            if scale > 1:
                redundancy = float(np.sum(1 - precision.rays[:, used]))
                worst[members] *= limits.critical / limits.tau(redundancy)
    return worst


def control_scale(network: Network, standardised: RayPairs, taking_part: Chosen) -> float:
    """How much larger than stated the residuals of control are as a rule; 1 at least."""
    used = taking_part & (network.rays.measurement >= 0)
    return _class_scale(standardised[:, used].ravel()) if used.any() else 1.0


def _class_scale(standardised: Scalars) -> float:
    """How much larger than stated residuals are, beyond what chance does to their median.

    A deviation taken from the median of n values scatters by about 1.17 / sqrt(n).
    """
    # source: asymptotic deviation of the median of absolute normal values, 1 / (2 f sqrt n) over
    # their median: 1.4826 / (4 phi(0.6745) sqrt n) = 1.17 / sqrt n.
    chance = 1 + 2 * 1.17 / float(np.sqrt(len(standardised)))
    return max(1.0, robust_sigma(standardised) / chance)
