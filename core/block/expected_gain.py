"""What looking at a control measurement is expected to bring: is it wrong, what does it bend.

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

from collections.abc import Set
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int

from core.block.effects import Key
from core.block.foresight import Foresight
from core.block.least_squares.control_system import ControlSystem

PRIOR_WRONG = 0.1
"""Share of wrong ones before anything is known; it counts as much as `PRIOR_COUNT` of them."""
PRIOR_COUNT = 20.0
WRONG_SIGMAS = (3.0, 6.0, 12.0, 24.0, 48.0)
"""Standard deviations of wrong ones about the right place, in those of a good one, equally likely:
from just above the noise to the width of a search."""
ROUNDS = 12
SETTLED = 1e-3
DOUBTED, MOST_DOUBTED = 0.02, 400
"""Measurements more likely wrong than this lose weight, the likeliest ones where there are many."""
CHUNK = 400
LARGEST = 40_000_000
"""Values of the observations' rows, 320 MB of them."""
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


def expected_gains(foresight: Foresight) -> dict[Key, Gain]:
    """Gains of all control measurements that take part and nobody accepted.

    Empty for blocks whose equations would not fit: there a rule of thumb has to do.
    """
    block = foresight.block
    if 2 * len(block.measurements) * 6 * len(block.photos) > LARGEST:
        return {}
    system = foresight.control_system()
    if not system.measurements:
        return {}
    undecided = np.array([item.status == "auto" for item in system.measurements])
    wrong, errors = _judged(system, undecided)
    return _gains(foresight, system, wrong, errors)


def known_gains(foresight: Foresight, wrong_ones: Set[Key]) -> dict[Key, Gain]:
    """The same where somebody knows which are wrong."""
    system = foresight.control_system()
    wrong = np.array([float(item.key in wrong_ones) for item in system.measurements])
    doubted = np.flatnonzero(wrong > 0)
    errors, _ = _predicted(system, system.own(), doubted, wrong[doubted])
    return _gains(foresight, system, wrong, errors)


def _gains(
    foresight: Foresight, system: ControlSystem, wrong: np.ndarray, errors: Pairs
) -> dict[Key, Gain]:
    """Probabilities, and how far each error alone shifts the ground."""
    pairs = system.columns.reshape(len(system.columns), -1, 2)
    found: dict[Key, Gain] = {}
    for first in range(0, len(wrong), CHUNK):
        part = slice(first, first + CHUNK)
        moved = foresight.ground_shifts(np.einsum("unk,nk->un", pairs[:, part], errors[part]))
        shifts = np.sqrt(2 * (moved**2).mean(axis=0))
        for place, item in enumerate(system.measurements[part]):
            if item.status == "auto":
                found[item.key] = Gain(float(wrong[first + place]), float(shifts[place]))
    return found


def _judged(system: ControlSystem, undecided: np.ndarray) -> tuple[np.ndarray, Pairs]:
    """Probability of being wrong, and the distance from where all others put it."""
    wrong, share = np.zeros(len(undecided)), PRIOR_WRONG
    errors, own = system.residuals, system.own()
    for _ in range(ROUNDS):
        doubted = np.flatnonzero(wrong > DOUBTED)
        doubted = doubted[np.argsort(-wrong[doubted])[:MOST_DOUBTED]]
        errors, variances = _predicted(system, own, doubted, wrong[doubted])
        fresh = np.where(undecided, _probability(errors, variances, share), 0.0)
        settled = np.max(np.abs(fresh - wrong)) < SETTLED
        wrong = fresh
        share = (PRIOR_WRONG * PRIOR_COUNT + wrong.sum()) / (PRIOR_COUNT + undecided.sum())
        if settled:
            break
    return wrong, errors


def _predicted(
    system: ControlSystem,
    own: Blocks,
    doubted: Int[np.ndarray, "k"],
    down: Float64[np.ndarray, "k"],
) -> tuple[Pairs, Blocks]:
    """Each residual against all others, and its variance; some lose the weight `down`."""
    weights = np.ones(len(own))
    now = system.residuals
    if len(doubted):
        weights[doubted] = 1 - down
        hat = system.hat(doubted)
        at = (2 * doubted[:, None] + np.arange(2)).ravel()
        lost = np.repeat(down, 2)
        # Only columns of what loses weight differ from those of the unit matrix.
        inner = np.eye(len(at)) - hat[:, at] * lost
        solved = np.linalg.solve(inner, np.column_stack([now[doubted].reshape(-1), hat]))
        carried = hat.T * lost
        now = now + (carried @ solved[:, 0]).reshape(-1, 2)
        pairs = carried.reshape(len(own), 2, -1)
        own = own + pairs @ np.moveaxis(solved[:, 1:].reshape(len(at), -1, 2), 1, 0)
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
    return 1 / (1 + np.exp(np.clip(good - bad + np.log((1 - share) / share), -700, 700)))


def _log_density(errors: Pairs, variances: Blocks) -> np.ndarray:
    squares = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(variances), errors)
    return -0.5 * (squares + np.log(np.linalg.det(variances)))
