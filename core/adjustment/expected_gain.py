"""What looking at a control measurement, or making one, is expected to bring.

Every measurement that takes part is taken for wrong with a probability that follows from how far it
lies from where all others put it. The others may be wrong themselves, so this is found for all of
them together: with the probabilities so far as weights the block is solved again in closed form,
which gives better distances, and so on (a mixture of good and wrong observations; Box & Tiao 1968,
variances of the wrong ones spread over what a search can miss by). With H the hat matrix of the
control rays (points eliminated), D = 1 - weight, and v the residuals in standard deviations:

    v_w = (I - H D)^-1 v,  H_w = (I - H D)^-1 H,
    d_i = (I - w_i H_w,ii)^-1 v_w,i  against the variance  I + H_w,ii (I - w_i H_w,ii)^-1.

A wrong measurement with the error d_i shifts the ground by G Q A_i^T d_i; the mean square of that
over nine places of every photo, times the probability, is what its decision takes off m_p squared
where errors are independent of each other.
"""

from collections.abc import Sequence, Set
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int
from scipy import sparse
from scipy.special import expit

from core.adjustment.influence import BATCH, Influence, Key
from core.arrays import Indices, Scalars
from core.block import HAND_SIGMA_PX, Measurement, SurveyedPoint, position_sigma_m

# design: one in ten is what a reviewer expects of an automatic search; data outweigh it soon.
PRIOR_WRONG = 0.1
"""Share of wrong ones before anything is known; it counts as much as `PRIOR_COUNT` of them."""
PRIOR_COUNT = 20.0  # design: a small block's share is its own after a few dozen measurements.
# design: doubled each time, from just above the noise to the width of a search.
WRONG_SIGMAS = (3.0, 6.0, 12.0, 24.0, 48.0)
"""Standard deviations of wrong ones, in those of a good one, equally likely."""
ROUNDS = 12  # design: probabilities settle in four or five.
SETTLED = 1e-3  # design: no order of a queue depends on a thousandth.
# design: one in fifty wrong bends nothing; 400 at once take 150 MB on a block of 400 photos.
DOUBTED, MOST_DOUBTED = 0.02, 400
"""Measurements more likely wrong than this lose weight, the likeliest ones where there are many."""
Pairs = Float64[np.ndarray, "n 2"]
Blocks = Float64[np.ndarray, "n 2 2"]


@dataclass(frozen=True, slots=True)
class Gain:
    """One control measurement that takes part."""

    wrong: float
    """Probability that it is wrong, 0 to 1."""
    shift_m: float
    """RMS shift of the block's ground that its error brings about, if it is wrong, metres."""

    @property
    def expected_m(self) -> float:
        """Root of the expected change of m_p squared when it is looked at, metres."""
        return float(np.sqrt(self.wrong)) * self.shift_m


@dataclass(frozen=True, slots=True, eq=False)
class _Control:
    """Control measurements as observations of photos and cameras, points eliminated.

    Two rows a measurement. Their hat matrix is A Q A^T and, within a point, W W^T besides.
    Cofactors Q A^T are found anew for those asked about: those of a large block fill the memory.
    """

    influence: Influence
    measurements: list[Measurement]
    """Those that take part."""
    point: Int[np.ndarray, "rays"]
    """Point of each, by number."""
    rows: sparse.csr_array
    """A."""
    whitened: Float64[np.ndarray, "rows 3"]
    """W."""
    residuals: Pairs
    """Computed minus measured, in standard deviations."""

    @staticmethod
    def of(influence: Influence) -> "_Control":
        network, rays = influence.solution.network, influence.control_rays
        parts = [influence.equations.of_rays(rays[batch]) for batch in _batches(len(rays))]
        empty = sparse.csr_array((0, influence.equations.unknowns))
        return _Control(
            influence,
            [network.measurements[row] for row in network.rays.measurement[rays].tolist()],
            network.rays.point[rays],
            sparse.csr_array(
                sparse.vstack([empty, *(sparse.csr_array(rows) for rows, _ in parts)])
            ),
            np.concatenate([np.zeros((0, 3)), *(whitened for _, whitened in parts)]),
            influence.solution.fit.lin.residuals[:, rays].T,
        )

    def columns(self, chosen: Indices) -> Float64[np.ndarray, "unknowns two_n"]:
        """Q A^T of some measurements."""
        rows = self.rows[(2 * chosen[:, None] + np.arange(2)).ravel()]
        return self.influence.equations.cofactors(rows.toarray())

    def hat(self, chosen: Indices) -> Float64[np.ndarray, "two_n rows"]:
        """Rows of the hat matrix of some measurements."""
        at = (2 * chosen[:, None] + np.arange(2)).ravel()
        same = np.repeat(self.point[chosen], 2)[:, None] == np.repeat(self.point, 2)
        hat = np.ascontiguousarray((self.rows @ self.columns(chosen)).T)
        hat[same] += (self.whitened[at] @ self.whitened.T)[same]
        return hat

    def own(self) -> Blocks:
        """The block of every measurement on the hat matrix's diagonal."""
        shared = self.whitened.reshape(-1, 2, 3)
        blocks = shared @ np.swapaxes(shared, 1, 2)
        for batch in _batches(len(blocks)):
            rows = self.rows[2 * batch[0] : 2 * batch[-1] + 2].toarray()
            pairs = self.columns(batch).reshape(-1, len(batch), 2)
            blocks[batch] += rows.reshape(len(batch), 2, -1) @ np.moveaxis(pairs, 1, 0)
        return blocks


def _batches(count: int) -> list[Indices]:
    """The numbers below a count, some at a time."""
    return [np.arange(first, min(first + BATCH, count)) for first in range(0, count, BATCH)]


def expected_gains(influence: Influence, known_wrong: Set[Key] | None = None) -> dict[Key, Gain]:
    """Gains of all control measurements that take part and nobody accepted.

    Args:
        influence: The equations of the adjusted block.
        known_wrong: The wrong ones, where somebody knows.
    """
    control = _Control.of(influence)
    if not control.measurements:
        return {}
    if known_wrong is None:
        undecided = np.array([item.status == "auto" for item in control.measurements])
        wrong, errors = _judged(control, undecided)
    else:
        wrong = np.array([float(item.key in known_wrong) for item in control.measurements])
        doubted = np.flatnonzero(wrong > 0)
        errors, _ = _predicted(control, control.own(), doubted, wrong[doubted])
    return _gains(control, wrong, errors)


def _gains(control: _Control, wrong: Scalars, errors: Pairs) -> dict[Key, Gain]:
    """Probabilities, and how far each error alone shifts the ground."""
    found: dict[Key, Gain] = {}
    for batch in _batches(len(wrong)):
        pairs = control.columns(batch).reshape(-1, len(batch), 2)
        moved = control.influence.ground.of(np.einsum("unk,nk->un", pairs, errors[batch]))
        shifts = np.sqrt(2 * (moved**2).mean(axis=(0, 1, 2)))
        for place, shift in zip(batch.tolist(), shifts.tolist(), strict=True):
            item = control.measurements[place]
            if item.status == "auto":
                found[item.key] = Gain(float(wrong[place]), shift)
    return found


def _judged(control: _Control, undecided: np.ndarray) -> tuple[np.ndarray, Pairs]:
    """Probability of being wrong, and the distance from where all others put it."""
    wrong, share = np.zeros(len(undecided)), PRIOR_WRONG
    errors, own = control.residuals, control.own()
    for _ in range(ROUNDS):
        doubted = np.flatnonzero(wrong > DOUBTED)
        doubted = doubted[np.argsort(-wrong[doubted])[:MOST_DOUBTED]]
        errors, variances = _predicted(control, own, doubted, wrong[doubted])
        fresh = np.where(undecided, _probability(errors, variances, share), 0.0)
        settled = np.max(np.abs(fresh - wrong)) < SETTLED
        wrong = fresh
        share = (PRIOR_WRONG * PRIOR_COUNT + wrong.sum()) / (PRIOR_COUNT + undecided.sum())
        if settled:
            break
    return wrong, errors


def _predicted(
    control: _Control,
    own: Blocks,
    doubted: Int[np.ndarray, "k"],
    down: Float64[np.ndarray, "k"],
) -> tuple[Pairs, Blocks]:
    """Each residual against all others, and its variance; some lose the weight `down`."""
    weights = np.ones(len(own))
    now = control.residuals
    if len(doubted):
        weights[doubted] = 1 - down
        hat = control.hat(doubted)
        at = (2 * doubted[:, None] + np.arange(2)).ravel()
        lost = np.repeat(down, 2)
        # Only columns of what loses weight differ from those of the unit matrix.
        inner = np.eye(len(at)) - hat[:, at] * lost
        solved = np.linalg.solve(inner, np.column_stack([now[doubted].reshape(-1), hat]))
        carried = hat.T * lost
        now = now + (carried @ solved[:, 0]).reshape(-1, 2)
        pairs = carried.reshape(len(own), 2, -1)
        own = own + pairs @ np.moveaxis(solved[:, 1:].reshape(len(at), -1, 2), 1, 0)
    # design: a measurement that nothing checks has a hat of one.
    remaining = np.linalg.inv((1 + 1e-9) * np.eye(2) - weights[:, None, None] * own)
    return np.einsum("nij,nj->ni", remaining, now), np.eye(2) + own @ remaining


def _probability(errors: Pairs, variances: Blocks, share: float) -> np.ndarray:
    """Of a wrong one, from its distance and that distance's variance."""
    good = _log_density(errors, variances)
    spread = [
        _log_density(errors, variances + sigma**2 * np.eye(2)) - np.log(len(WRONG_SIGMAS))
        for sigma in WRONG_SIGMAS
    ]
    bad = np.logaddexp.reduce(spread, axis=0)
    return expit(bad - good + np.log(share / (1 - share)))


def _log_density(errors: Pairs, variances: Blocks) -> np.ndarray:
    squares = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(variances), errors)
    return -0.5 * (squares + np.log(np.linalg.det(variances)))


def measuring_gains(
    influence: Influence, wanted: Sequence[tuple[SurveyedPoint, str]], checks: int
) -> dict[Key, float]:
    """What each measurement of a point that nobody has measured yet would bring alone, metres.

    A measurement of a control point takes off the ground's variance, with A its rows over photos
    and cameras, B those over the point, S the covariance of its coordinates and Q the cofactors,

        Q A^T (I + A Q A^T + B S B^T)^-1 A Q,

    of which the mean over nine places of every photo is m_p squared before less m_p squared after:
    the same measure as that of a decision. A check point moves nothing; it tells how good the block
    is. The m_p that n points show is known to m_p / sqrt(4 n + 1), so that one more brings the
    difference to n + 1 of them, the most where the block is known least.

    Args:
        influence: The equations of the adjusted block.
        wanted: Points, each with the name of a photo that shows it.
        checks: Number of check points that are measured already.
    """
    numbers = {photo.photo_id: row for row, photo in enumerate(influence.solution.network.photos)}
    found = {
        (point.point_id, name): position_sigma_m(influence.block.photos[name])
        for point, name in wanted
        if name not in numbers
    }
    inside = [(point, name) for point, name in wanted if name in numbers]
    for first in range(0, len(inside), BATCH):
        found |= _photo_gains(influence, inside[first : first + BATCH], numbers, checks)
    return found


def _photo_gains(
    influence: Influence,
    some: Sequence[tuple[SurveyedPoint, str]],
    numbers: dict[str, int],
    checks: int,
) -> dict[Key, float]:
    """Those in photos that took part."""
    equations = influence.equations
    rays = [
        equations.of_free_ray(numbers[name], _ray(point.point_id, name), point.position)
        for point, name in some
    ]
    rows = np.concatenate([row for row, _ in rays])
    columns = equations.cofactors(rows).reshape(equations.unknowns, len(some), 2)
    moved = influence.ground.of(columns.reshape(equations.unknowns, -1))
    steps = moved.reshape(*moved.shape[:3], len(some), 2)
    found: dict[Key, float] = {}
    for number, ((point, name), (row, by_point)) in enumerate(zip(some, rays, strict=True)):
        known = row @ columns[:, number]
        if not np.isfinite(known).all():
            continue
        if point.role == "check":
            gain = _told(influence, name, known, checks)
        else:
            ground = by_point * point.sigma_m**2 @ by_point.T
            root = np.linalg.cholesky(np.linalg.inv(np.eye(2) + known + ground))
            gain = float(np.sqrt(2 * np.mean(np.sum((steps[:, :, :, number] @ root) ** 2, axis=3))))
        found[point.point_id, name] = gain
    return found


def _ray(point_id: str, photo_id: str) -> Measurement:
    return Measurement(point_id, photo_id, 0.0, 0.0, HAND_SIGMA_PX)


def _told(influence: Influence, name: str, known: Float64[np.ndarray, "2 2"], checks: int) -> float:
    """What one check point more tells of m_p, from how well the block knows its place."""
    block = influence.block
    pixel_m = block.photos[name].ground_pixel_m(block.camera_of(name))
    position_error_m = float(np.sqrt(np.trace(known))) * HAND_SIGMA_PX * pixel_m
    return position_error_m * (_unsure(checks) - _unsure(checks + 1))


def _unsure(checks: int) -> float:
    """Relative standard deviation of an RMS of two coordinates of so many points; 1 of none."""
    return float(1 / np.sqrt(4 * checks + 1))
