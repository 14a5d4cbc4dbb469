"""Where the mosaic misfits the reference, worst places first, and what of the misfit is systematic.

A place is a neighbourhood of vectors in one photo that agree on a shift s. With probability p_j,
vector v_j is right and scatters about s with covariance S_j; else it lies anywhere in the search
area A:

    L(s) = product over j of (1 - p_j) / A + p_j N(v_j; s, S_j).

S_j holds what an edge that slides along itself leaves open, and by how much the photo's errors may
displace both places differently.

Two explanations are weighed: s is what the block predicts, N(0, C), or s is anything within the
search. Their evidences are the integrals of L; with a prior of one wrong place in the whole block
they give the probability that a place is off by more than predicted. No length enters. The shift
that is told is the mean over both: a few vectors that chance made agree far off weigh little.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from core.arrays import Scalars
from core.geometry.robust import CAUCHY_LIMIT, cauchy_weights, robust_sigma, solve_robustly
from core.mosaic.misfit import SEARCH_M, MisfitVectors, Vectors

# design: several that agree, and as many as a photo has at a usual pixel.
NEIGHBOUR_SIZES = (6, 24)
"""Numbers of vectors of one photo that are weighed together."""
# design: beyond it probabilities rest on the shape of a tail alone.
MOST_SURE = 0.99
"""No vector is taken to be right with more than this probability."""
# design: every third of a metre; the floor of a match of pixels of a metre is as much.
STEPS = 61
"""Shifts that are weighed along either axis of the search."""
# source: the usual level of a test
SURE = 0.95
"""So probable is what is called significant."""
# source: 95 % of normal errors are within
TWO_SIGMAS = 2.0
"""So many standard deviations less than its shift is surely there at a place."""
# design: some pages of a list; more would not be looked at.
MOST = 40
"""Places told at most."""
# design: they settle in ten.
PASSES = 20
# design: numerical safety.
LEAST_SCATTER_M = 1e-9
# source: an affinity has so many parameters
AFFINE = 6


@dataclass(frozen=True, slots=True, eq=False)
class MisfitPlace:
    """One place where vectors agree."""

    east: float
    """Of its worst spot, metres."""
    north: float
    """Of its worst spot, metres."""
    photo_id: str
    """The photo that the mosaic shows there."""
    shift_m: tuple[float, float]
    """Mosaic minus reference (east, north), metres."""
    sigma_m: float
    """Standard deviation per axis of the shift, what is predicted of it being known, metres."""
    predicted_m: tuple[float, float]
    """Standard deviations (east, north) of the misfit that the block predicts, metres."""
    probability: float
    """That it is off by more than predicted."""
    vectors: int
    """Vectors about which neighbours agree on it."""
    radius_m: float
    """How far they lie about the spot, metres."""

    @property
    def length_m(self) -> float:
        """Length of the shift, metres."""
        return float(np.hypot(*self.shift_m))

    @property
    def significant(self) -> bool:
        """Whether it is off by more than the block predicts."""
        return self.probability >= SURE


@dataclass(frozen=True, slots=True, eq=False)
class SystematicMisfit:
    """The affinity that fits all vectors, about the middle of the block."""

    shift_m: tuple[float, float]
    """East and north in the middle, metres."""
    shift_sigma_m: tuple[float, float]
    """Their standard deviations, metres."""
    scale: float
    """Mean enlargement, a pure number."""
    rotation: float
    """Counter-clockwise, radians."""
    scale_sigma: float
    """Standard deviation of scale and rotation."""
    largest_m: float
    """Its longest vector within the block, metres."""
    rms_m: float
    """Root mean square length of its vectors, metres."""
    remainder_m: float
    """Robust standard deviation per axis of what is left, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class Misfit:
    """The misfit of a mosaic against the reference."""

    vectors: MisfitVectors
    """Every vector."""
    systematic: SystematicMisfit | None
    """None where there are too few vectors."""
    places: tuple[MisfitPlace, ...]
    """The worst first: by what is surely there, predicted or not."""
    judged: int
    """Neighbourhoods that were weighed."""


def judge_misfit(vectors: MisfitVectors) -> Misfit:
    """The systematic part of a misfit, and its places, worst first."""
    hoods = _weigh_all(vectors)
    return Misfit(vectors, _systematic(vectors), _places(vectors, hoods), len(hoods))


def _systematic(vectors: MisfitVectors) -> SystematicMisfit | None:
    """An affinity by weighted least squares; vectors far from it lose their weight."""
    found = vectors.found
    if found.sum() < 2 * AFFINE:
        return None
    places, shifts = vectors.positions[found], vectors.shifts_m[found]
    middle = (places.min(axis=0) + places.max(axis=0)) / 2
    reach = float(np.ptp(places, axis=0).max()) / 2 or 1.0
    design = np.column_stack([np.ones(len(places)), (places - middle) / reach])
    own = vectors.probabilities[found]

    def solve(weights: Scalars) -> tuple[np.ndarray, Scalars]:
        root = np.sqrt(weights * own)[:, None]
        terms = np.linalg.lstsq(root * design, root * shifts, rcond=None)[0]
        return terms, np.hypot(*(shifts - design @ terms).T)

    start = np.hypot(*(shifts - np.median(shifts, axis=0)).T)
    terms = solve_robustly(
        solve, start, lambda lengths: cauchy_weights(lengths, CAUCHY_LIMIT), passes=PASSES
    )
    fitted = design @ terms
    rest = shifts - fitted
    scatter = [robust_sigma(axis) for axis in rest.T]
    counted = (np.abs(rest) < 3 * np.maximum(scatter, LEAST_SCATTER_M)).all(axis=1)
    sigma = np.array(scatter) / np.sqrt(max(int(counted.sum()), 1))
    east, north = terms[1] / reach, terms[2] / reach
    lengths = np.hypot(*fitted.T)
    return SystematicMisfit(
        (float(terms[0, 0]), float(terms[0, 1])),
        (float(sigma[0]), float(sigma[1])),
        float(east[0] + north[1]) / 2,
        float(east[1] - north[0]) / 2,
        float(np.sqrt(np.mean(sigma**2)) / np.sqrt(np.mean((places - middle) ** 2)) / np.sqrt(2)),
        float(lengths.max()),
        float(np.sqrt(np.mean(lengths**2))),
        float(np.sqrt(np.mean(np.square(scatter)))),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Hood:
    """A vector with its nearest ones of the same photo, weighed."""

    middle: int
    shift_m: Vectors
    """East and north, (1, 2)."""
    sigma_m: float
    off: float
    """Probability that it is off by more than predicted."""
    there: float
    """Probability that its vectors agree at all."""

    @property
    def least_m(self) -> float:
        """So much of it is surely there."""
        return surely_there_m(self.shift_m[0].tolist(), self.sigma_m)


def surely_there_m(shift_m: Sequence[float], sigma_m: float) -> float:
    """What ranks places: the length of a shift less two standard deviations, metres.

    The worst place is where most is off, whether the block predicts it or not. A length alone would
    put first what is known badly.
    """
    return math.hypot(*shift_m) - TWO_SIGMAS * sigma_m


def _weigh_all(vectors: MisfitVectors) -> list[_Hood]:
    """A hood about every vector whose photo took part in the adjustment: the size that tells most.

    A small one shows a bad corner, a large one a photo in which little has lasted.
    """
    own = np.array(vectors.photo_ids)
    sound = np.isfinite(vectors.predicted).all(axis=(1, 2))
    best: dict[int, _Hood] = {}
    for size in NEIGHBOUR_SIZES:
        members = [
            rows[hood]
            for name in sorted(set(own[sound].tolist()))
            for rows in [np.flatnonzero((own == name) & sound)]
            for hood in _hoods(vectors.positions[rows], vectors.patch_m, size)
        ]
        for near in members:
            hood = _weigh(vectors, near, max(len(members) / size, 1.0))
            known = best.get(hood.middle)
            if known is None or hood.off > known.off:
                best[hood.middle] = hood
    return [best[middle] for middle in sorted(best)]


def _hoods(positions: Vectors, patch_m: float, count: int) -> Iterator[np.ndarray]:
    """Every place with its nearest ones whose patches have no pixel in common with each other."""
    if len(positions) < count:
        return
    # design: time; four in five of those nearby may have pixels in common.
    _, near = KDTree(positions).query(positions, k=min(5 * count, len(positions)))
    for row in np.asarray(near):
        places = positions[row]
        apart = np.abs(places[:, None] - places).max(axis=2) >= patch_m
        free, hood = np.ones(len(row), dtype=bool), list[int]()
        while len(hood) < count and free.any():
            hood.append(int(np.argmax(free)))
            free &= apart[hood[-1]]
        if len(hood) == count:
            yield row[hood]


def _weigh(vectors: MisfitVectors, near: np.ndarray, places: float) -> _Hood:
    """Weigh what vectors of one neighbourhood say of their common shift.

    Args:
        vectors: All of them.
        near: Which, the middle one first.
        places: Independent neighbourhoods in the block, of which one is off beforehand.
    """
    line = np.linspace(-SEARCH_M, SEARCH_M, STEPS)
    area = (2 * SEARCH_M) ** 2
    step2 = area / STEPS**2
    apart = vectors.photo_errors_m[near] - vectors.photo_errors_m[near[0]]
    spread = vectors.covariances[near] + apart @ np.swapaxes(apart, 1, 2)
    right = np.minimum(vectors.probabilities[near], MOST_SURE)
    wrong = (1 - right) / area
    peak = right / (2 * np.pi * np.sqrt(np.linalg.det(spread)))
    away = line - vectors.shifts_m[near][:, :, None]
    mass = np.prod(
        wrong[:, None, None] + peak[:, None, None] * _bells(np.linalg.inv(spread), away), axis=0
    )
    # A density cannot be told more finely than the steps it is summed in.
    expected = np.linalg.inv(vectors.predicted[near[0]] + step2 / 4 * np.eye(2))
    about = _bells(expected[None], np.stack([line, line])[None])[0]
    # The others are as predicted, or show nothing that lasts.
    free, held = mass / mass.size / places, mass * about / about.sum() / 2
    none = float(np.prod(wrong)) / 2
    whole = float((free + held).sum()) + none
    along_axes = np.stack([(free + held).sum(axis=1), (free + held).sum(axis=0)]) / (whole - none)
    shift = along_axes @ line
    sigma = float(np.sqrt(max((along_axes @ line**2 - shift**2).sum(), 0.0) / 2))
    return _Hood(int(near[0]), shift[None], sigma, float(free.sum()) / whole, 1 - none / whole)


def _bells(inverse: np.ndarray, away: np.ndarray) -> np.ndarray:
    """Normal densities over their highest at all places of a grid: (n, STEPS, STEPS).

    Args:
        inverse: Of the covariances, (n, 2, 2).
        away: How far lines of the grid lie east and north of each middle, (n, 2, STEPS).
    """
    east, north = away[:, 0, :, None], away[:, 1, None, :]
    (xx, xy), (_, yy) = np.moveaxis(inverse, 0, 2)[..., None, None]
    return np.exp(-0.5 * (xx * east**2 + 2 * xy * east * north + yy * north**2))


def _places(vectors: MisfitVectors, hoods: Sequence[_Hood]) -> tuple[MisfitPlace, ...]:
    """Neighbourhoods of a photo that are off the same way are one place, told by its worst."""
    left = [hood for hood in hoods if hood.there >= SURE and hood.least_m > 0]
    left.sort(key=lambda hood: (-hood.least_m, hood.middle))
    photos = vectors.photo_ids
    places: list[MisfitPlace] = []
    while left and len(places) < MOST:
        worst = left[0]
        reach = max(float(np.hypot(*worst.shift_m[0])) / 2, TWO_SIGMAS * worst.sigma_m)
        alike = [
            hood
            for hood in left
            if photos[hood.middle] == photos[worst.middle]
            and np.hypot(*(hood.shift_m - worst.shift_m)[0]) <= reach
        ]
        left = [hood for hood in left if hood not in alike]
        places.append(_place(vectors, worst, [hood.middle for hood in alike]))
    return tuple(places)


def _place(vectors: MisfitVectors, worst: _Hood, members: Sequence[int]) -> MisfitPlace:
    spot, places = vectors.positions[worst.middle], vectors.positions[list(members)]
    predicted = vectors.predicted_sigmas_m[worst.middle]
    return MisfitPlace(
        float(spot[0]),
        float(spot[1]),
        vectors.photo_ids[worst.middle],
        (float(worst.shift_m[0, 0]), float(worst.shift_m[0, 1])),
        worst.sigma_m,
        (float(predicted[0]), float(predicted[1])),
        worst.off,
        len(members),
        float(np.hypot(*(places - spot).T).max()),
    )
