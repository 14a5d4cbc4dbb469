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

from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int
from scipy import sparse
from scipy.special import expit

from core.adjustment.equations import BATCH, PLACES
from core.adjustment.influence import Influence, Key
from core.arrays import Indices, Matrix, Scalars
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
# design: one in fifty wrong bends nothing; 400 at once take 100 MB on a block of 400 photos.
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

    Two rows a measurement. Their hat matrix is A Q A^T and, within a point, W W^T besides. Of Q and
    of what is made with it only those elements are kept whose two unknowns some row has together:
    all of them would fill the memory of a large block.
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
    together: sparse.csc_array
    """Pattern of A^T A."""

    @staticmethod
    def of(influence: Influence) -> "_Control":
        network, rays = influence.solution.network, influence.control_rays
        rows, whitened = influence.equations.sparse_rows(rays)
        return _Control(
            influence,
            [network.measurements[row] for row in network.rays.measurement[rays].tolist()],
            network.rays.point[rays],
            rows,
            whitened,
            influence.solution.fit.lin.residuals[:, rays].T,
            sparse.csc_array(abs(rows).T @ abs(rows)),
        )

    def own(self) -> Blocks:
        """The block of every measurement on the hat matrix's diagonal."""
        shared = self.whitened.reshape(-1, 2, 3)
        return shared @ np.swapaxes(shared, 1, 2) + self._blocks(self._cofactors)

    def ground(self) -> Blocks:
        """Mean square shift of the ground by the errors of every measurement, square metres."""
        equations, places = self.influence.equations, self.influence.ground
        shifts = places.matrix() / np.sqrt(PLACES * len(places.by_photo))
        squares = sparse.csr_array(shifts.T @ shifts)
        return self._blocks(lambda some: equations.cofactors((squares @ self._cofactors(some)).T))

    def with_less_weight(
        self, doubted: Int[np.ndarray, "k"], down: Float64[np.ndarray, "k"]
    ) -> tuple[Pairs, Blocks]:
        """What residuals and the hat matrix's diagonal change by where some lose weight.

        Measurements of their points share more with them than photos.
        """
        at = (2 * doubted[:, None] + np.arange(2)).ravel()
        columns = self.influence.equations.cofactors(self.rows[at].toarray())
        beside = np.flatnonzero(np.isin(self.point, self.point[doubted]))
        hat = self._hat(doubted, beside, columns)
        lost = np.repeat(down, 2)[:, None]
        own = (2 * np.searchsorted(beside, doubted)[:, None] + np.arange(2)).ravel()
        sides = [self.residuals[doubted].reshape(-1, 1), columns.T, hat]
        solved = lost * np.linalg.solve(np.eye(len(at)) - hat[:, own] * lost.T, np.hstack(sides))
        by_residuals, by_columns, by_hat = np.split(solved, [1, 1 + len(columns)], axis=1)
        residuals = (self.rows @ (columns @ by_residuals)).reshape(-1, 2)
        blocks = self._blocks(lambda some: columns @ by_columns[:, some])
        pairs = hat.T.reshape(len(beside), 2, -1)
        residuals[beside] = pairs @ by_residuals[:, 0]
        blocks[beside] = pairs @ np.moveaxis(by_hat.reshape(len(at), -1, 2), 1, 0)
        return residuals, blocks

    def _hat(
        self,
        chosen: Int[np.ndarray, "n"],
        others: Int[np.ndarray, "m"],
        columns: Float64[np.ndarray, "unknowns two_n"],
    ) -> Float64[np.ndarray, "two_n two_m"]:
        """The hat matrix between some measurements and others, from Q A^T of the first."""
        at, beside = ((2 * rows[:, None] + np.arange(2)).ravel() for rows in (chosen, others))
        same = np.repeat(self.point[chosen], 2)[:, None] == np.repeat(self.point[others], 2)
        hat = (self.rows[beside] @ columns).T
        return hat + np.where(same, self.whitened[at] @ self.whitened[beside].T, 0.0)

    def _cofactors(self, some: Indices) -> Float64[np.ndarray, "unknowns n"]:
        """Some columns of Q."""
        rows = np.zeros((len(some), self.influence.equations.unknowns))
        rows[np.arange(len(some)), some] = 1.0
        return self.influence.equations.cofactors(rows)

    def _blocks(self, columns: Callable[[Indices], Matrix]) -> Blocks:
        """A_i M A_i^T of every measurement i, from a function that gives some columns of M."""
        known = self.together.copy()
        for batch in _batches(len(known.indptr) - 1):
            ends = known.indptr[batch[0] : batch[-1] + 2]
            inside = slice(ends[0], ends[-1])
            column = np.repeat(np.arange(len(batch)), np.diff(ends))
            known.data[inside] = columns(batch)[known.indices[inside], column]
        found = np.zeros((len(self.point), 2, 2))
        photos = self.influence.solution.network.rays.photo[self.influence.control_rays]
        # Measurements in one photo have few unknowns in all.
        order = np.argsort(photos, kind="stable")
        for batch in _batches(len(found)):
            some = order[batch]
            rows = self.rows[(2 * some[:, None] + np.arange(2)).ravel()]
            unknowns = np.unique(rows.indices)
            dense, inner = rows[:, unknowns].toarray(), known[unknowns][:, unknowns].toarray()
            pairs, turned = (part.reshape(len(some), 2, -1) for part in (dense, dense @ inner))
            found[some] = turned @ np.swapaxes(pairs, 1, 2)
        return found


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
    squares = np.einsum("ni,nij,nj->n", errors, control.ground(), errors)
    shifts = np.sqrt(np.maximum(squares, 0.0))
    return {
        item.key: Gain(one, shift)
        for item, one, shift in zip(
            control.measurements, wrong.tolist(), shifts.tolist(), strict=True
        )
        if item.status == "auto"
    }


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
        changed, blocks = control.with_less_weight(doubted, down)
        now, own = now + changed, own + blocks
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
