"""What two adjusted blocks predict of their difference in a photo that both hold.

An error e of an observation, in standard deviations, moves the unknowns by Q A^T e. What both
blocks observed alike moves both alike, and is not in their difference. With F the derivatives of
what is compared, u the sigma noughts and R the correlation of what both observed,

    C = u1^2 F1 Q1 F1^T + u2^2 F2 Q2 F2^T - K - K^T,  K = u1 u2 F1 Q1 A1^T R A2 Q2 F2^T.

Common are the measurements in the same scan, the coordinates of the same control, and the
certificate of the same camera. R is 1 where both took over the same value; of measurements in scans
it follows from how far both lie apart.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int
from scipy.spatial import KDTree

from core.adjustment.adjusted import SETTLED
from core.adjustment.equations import PLACES, Rows
from core.adjustment.factorisation import SIZE
from core.adjustment.influence import Influence
from core.arrays import ObjectPoints, Scalars
from core.block import Measurement
from core.geometry.crs import SAME_PLACE_M

Some = Int[np.ndarray, "_"]
"""Numbers of some rays or points."""
Pairs = tuple[Some, Some]
"""Rays, or points, of the first block and of the second, in the same order."""
# design: one good pair of coordinates in four hundred lies further apart.
APART_SIGMAS = 3.0
"""A tie point of both blocks lies within so many standard deviations in their photo."""
# design: memory; 256 rays over 2,400 unknowns take 10 MB.
BATCH = 256
"""Observations whose rows are held at once."""


@dataclass(frozen=True, slots=True, eq=False)
class DifferenceErrors:
    """Covariances of the second block less the first in one photo, in the first one's axes."""

    exterior: Float64[np.ndarray, "6 6"]
    """Of the centre (metres) and the rotation increments (radians, about the image's axes)."""
    ground: Float64[np.ndarray, "18 18"]
    """Of E and N of nine places on the ground at their height, place after place, metres."""


class CommonErrors:
    """Two adjusted blocks, and what both observed alike in the photos they share."""

    def __init__(
        self,
        one: Influence,
        other: Influence,
        units: tuple[float, float],
        photos: Mapping[str, str],
        *,
        same_axes: bool = True,
    ) -> None:
        """Find what both observed.

        Args:
            one: The equations of the first block.
            other: Those of the second.
            units: Their sigma noughts.
            photos: Name of each shared photo in the first block, and in the second.
            same_axes: Whether both count coordinates in one CRS; else no control is common.
        """
        self._both = (one, other)
        self._units = units
        self._numbers = tuple(
            {photo.photo_id: row for row, photo in enumerate(block.solution.network.photos)}
            for block in self._both
        )
        known = {
            name: there
            for name, there in photos.items()
            if name in self._numbers[0] and there in self._numbers[1]
        }
        rows = [(self._numbers[0][name], self._numbers[1][there]) for name, there in known.items()]
        points = _same_points(one, other) if same_axes else _as_pairs([])
        self._rays = (_same_control(one, other, rows, points), _same_ties(one, other, rows))
        self._correlations = tuple(_correlation(one, other, pairs) for pairs in self._rays)
        self._points = points
        self._cameras = _same_cameras(one, other, rows)

    @property
    def measurements(self) -> int:
        """How many measurements in the shared photos took part in both blocks."""
        return sum(len(pairs[0]) for pairs in self._rays)

    @property
    def correlation(self) -> float:
        """Mean correlation of these measurements, 0 to 1; 0 without any."""
        counts = [len(pairs[0]) for pairs in self._rays]
        told = sum(count * rho for count, rho in zip(counts, self._correlations, strict=True))
        return told / max(sum(counts), 1)

    def of_photo(
        self,
        names: tuple[str, str],
        ground: tuple[ObjectPoints, ObjectPoints],
        turn: Float64[np.ndarray, "3 3"],
    ) -> DifferenceErrors | None:
        """What is predicted of one photo; None where it took no part in one of the blocks.

        Args:
            names: Its name in the first block and in the second.
            ground: Nine places as the first shows them (E, N, H), and the second, metres.
            turn: Axes of the first CRS from those of the second.
        """
        numbers = [known.get(name) for known, name in zip(self._numbers, names, strict=True)]
        if None in numbers:
            return None
        # Derivatives of the photo's unknowns, then of its ground, in axes of the first block.
        rows = [
            _photo_rows(block, names[side], number or 0, ground[side])
            for side, (block, number) in enumerate(zip(self._both, numbers, strict=True))
        ]
        rows[1] = _turned(rows[1], turn)
        moves = [
            block.equations.cofactors(row).T for block, row in zip(self._both, rows, strict=True)
        ]
        own = [
            unit**2 * row @ move.T for unit, row, move in zip(self._units, rows, moves, strict=True)
        ]
        common = np.zeros_like(own[0])
        for one, other, correlation in self._observations():
            common += correlation * (moves[0] @ one.T) @ (moves[1] @ other.T).T
        common *= self._units[0] * self._units[1]
        total = (1 + SETTLED**2) * (own[0] + own[1]) - common - common.T
        return DifferenceErrors(total[:SIZE, :SIZE], total[SIZE:, SIZE:])

    def _observations(self) -> Iterator[tuple[Rows, Rows, float]]:
        """Rows of what both observed, some at a time, with their correlation."""
        one, other = (block.equations for block in self._both)
        for pairs, correlation in zip(self._rays, self._correlations, strict=True):
            for first in range(0, len(pairs[0]), BATCH):
                some = slice(first, first + BATCH)
                rows = one.of_rays(pairs[0][some])[0], other.of_rays(pairs[1][some])[0]
                yield *rows, correlation
        for here, there in zip(*(found.tolist() for found in self._points), strict=True):
            yield one.of_ground(here, (0, 1, 2))[0], other.of_ground(there, (0, 1, 2))[0], 1.0
        for here, there in self._cameras:
            yield one.of_certificate(here), other.of_certificate(there), 1.0


def _photo_rows(block: Influence, name: str, number: int, ground: ObjectPoints) -> Rows:
    """Derivatives of a photo's six unknowns, and of its ground at fixed height (E, N)."""
    equations = block.equations
    rows = [np.eye(SIZE, equations.unknowns, SIZE * number)]
    for place in ground:
        ray = Measurement("", name, 0.0, 0.0, 1.0)
        by_unknowns, by_point = equations.of_free_ray(number, ray, place)
        rows.append(-np.linalg.solve(by_point[:, :2], by_unknowns))
    return np.concatenate(rows)


def _turned(rows: Rows, turn: Float64[np.ndarray, "3 3"]) -> Rows:
    """Rows of a photo in the axes of another CRS; rotations are told in image axes already."""
    plan = np.kron(np.eye(PLACES), turn[:2, :2])
    return np.concatenate([turn @ rows[:3], rows[3:SIZE], plan @ rows[SIZE:]])


def _taking_part(block: Influence, photo: int, *, ties: bool) -> Some:
    """Rays of one photo that took part: of ties, or of control."""
    network = block.solution.network
    rays = np.flatnonzero((network.rays.photo == photo) & block.solution.fit.taking_part)
    return rays[(network.rays.tie[rays] >= 0) == ties]


def _same_points(one: Influence, other: Influence) -> Pairs:
    """Control points in use in both with the same coordinates, whatever they are called."""
    places = [_known_places(block) for block in (one, other)]
    if not all(len(rows) for rows, _ in places):
        return _as_pairs([])
    apart, nearest = KDTree(places[1][1]).query(places[0][1])
    same = np.asarray(apart) < SAME_PLACE_M
    return places[0][0][same], places[1][0][np.asarray(nearest)[same]]


def _known_places(block: Influence) -> tuple[Some, ObjectPoints]:
    """Rows of points with known coordinates that a ray in use shows, and these coordinates."""
    network, fit = block.solution.network, block.solution.fit
    used = np.bincount(network.rays.point[fit.taking_part], minlength=network.points.count) > 0
    rows = np.flatnonzero(used & (network.points.known_weight > 0).any(axis=1, keepdims=False))
    rows = rows[rows >= len(network.points.tie)]
    return rows, network.points.known[rows]


def _same_control(
    one: Influence, other: Influence, photos: list[tuple[int, int]], points: Pairs
) -> Pairs:
    """Measurements of the same control point in the same photo."""
    there = dict(zip(points[0].tolist(), points[1].tolist(), strict=True))
    found: list[tuple[int, int]] = []
    for here, other_photo in photos:
        second = other.solution.network.rays.point
        rays = {
            int(second[ray]): ray for ray in _taking_part(other, other_photo, ties=False).tolist()
        }
        for ray in _taking_part(one, here, ties=False).tolist():
            match = rays.get(there.get(int(one.solution.network.rays.point[ray]), -1))
            if match is not None:
                found.append((ray, match))
    return _as_pairs(found)


def _same_ties(one: Influence, other: Influence, photos: list[tuple[int, int]]) -> Pairs:
    """Rays of tie points that meet the same place of the same photo."""
    found: list[tuple[int, int]] = []
    for here, there in photos:
        rays = _taking_part(one, here, ties=True), _taking_part(other, there, ties=True)
        if not (len(rays[0]) and len(rays[1])):
            continue
        films = one.solution.network.rays.film[rays[0]], other.solution.network.rays.film[rays[1]]
        apart, nearest = KDTree(films[1]).query(films[0])
        match = rays[1][np.asarray(nearest)]
        near = np.asarray(apart) < APART_SIGMAS * _both_sigmas(one, other, (rays[0], match))
        found += zip(rays[0][near].tolist(), match[near].tolist(), strict=True)
    return _as_pairs(found)


def _both_sigmas(one: Influence, other: Influence, pairs: Pairs) -> Scalars:
    """Standard deviation per axis of the difference of independent measurements, millimetres."""
    sigmas = (block.solution.network.rays.sigma_mm for block in (one, other))
    return np.hypot(*(sigma[rays] for sigma, rays in zip(sigmas, pairs, strict=True)))


def _correlation(one: Influence, other: Influence, pairs: Pairs) -> float:
    """Correlation of measurements of both blocks by how far they lie apart, 0 to 1."""
    if not len(pairs[0]):
        return 0.0
    films = (block.solution.network.rays.film for block in (one, other))
    here, there = (film[rays] for film, rays in zip(films, pairs, strict=True))
    apart = np.mean(((there - here) / _both_sigmas(one, other, pairs)[:, None]) ** 2)
    return float(np.clip(1.0 - apart, 0.0, 1.0))


def _same_cameras(
    one: Influence, other: Influence, photos: list[tuple[int, int]]
) -> tuple[tuple[int, int], ...]:
    """Estimated cameras of shared photos with the same certificate in both."""
    here, there = one.solution.network, other.solution.network
    if not (here.lensed and there.lensed and here.lens == there.lens):
        return ()
    cameras = {(int(here.camera[first]), int(there.camera[second])) for first, second in photos}
    return tuple(
        sorted(
            (first, second)
            for first, second in cameras
            if np.array_equal(here.priors.constants[first], there.priors.constants[second])
        )
    )


def _as_pairs(found: list[tuple[int, int]]) -> Pairs:
    table = np.array(found, dtype=np.int64).reshape(-1, 2)
    return table[:, 0], table[:, 1]
