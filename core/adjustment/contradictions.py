"""Where a human and the block disagree: accepted measurements, judged by all others.

What a human has accepted is never left out, so it pulls photos and points towards itself, and its
residual hides what is wrong with it. Left out in closed form it does not: with the rows A of
accepted rays and of the known coordinates of their points (residuals v), their cofactors Q and
M = I - A Q A^T, leaving out the observations i gives M_ii^-1 v_i and changes the others by

    v_j' = v_j - M_ji M_ii^-1 v_i,   M_jk' = M_jk - M_ji M_ii^-1 M_ik

(Cook and Weisberg 1982). The worst goes first and the rest is judged without it: what it had pulled
along is cleared, and what it had hidden comes to light.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.special import chdtri

from core.adjustment.adjusted import CheckResult, Contradiction
from core.adjustment.equations import Equations, ground_shifts_of
from core.adjustment.reliability import control_scale
from core.adjustment.solution import Solution
from core.arrays import Scalars
from core.block import UNKNOWN_M, Block

# design: a batch of 2,400 unknowns (400 photos) takes 10 MB.
BATCH = 256
"""Observations whose cofactors are held at once."""
# design: a matrix of 10 MB; more blunders than that are no blunders.
TOGETHER = 400
"""So many of the worst observations are judged without each other."""
# design: rounding of cofactors is 1e-12.
SINGULAR = 1e-9
"""Share of a residual's variance below which nothing checks it."""


@dataclass(frozen=True, slots=True)
class _Unit:
    """What is left out at once: the ray of one measurement, or the coordinates of a point."""

    point: int
    """Row of its point."""
    rays: tuple[int, ...]
    """Accepted rays it speaks for."""
    axes: tuple[int, ...] = ()
    """Coordinates; none for a ray."""


@dataclass(slots=True, eq=False)
class _Judged:
    """Units with their rows, changed as one after the other is left out."""

    units: list[_Unit]
    rows: list[slice]
    residuals: Scalars
    remaining: Float64[np.ndarray, "rows rows"]
    """M."""
    columns: Float64[np.ndarray, "unknowns rows"]
    """Q A^T."""

    def _inverse(self, number: int) -> Float64[np.ndarray, "own own"]:
        """M_ii^-1 of a unit."""
        own = self.rows[number]
        return np.linalg.pinv(self.remaining[own, own], rcond=SINGULAR, hermitian=True)

    def deleted(self, number: int) -> Scalars:
        """What a unit says against all others, in standard deviations by coordinate."""
        return self._inverse(number) @ self.residuals[self.rows[number]]

    def test(self, number: int) -> float:
        """Its length in standard deviations."""
        own = self.residuals[self.rows[number]]
        return float(np.sqrt(max(own @ self.deleted(number), 0.0)))

    def leave_out(self, number: int) -> None:
        """Judge the rest without a unit from now on."""
        own, inverse = self.rows[number], self._inverse(number)
        share = inverse @ self.remaining[own]
        self.residuals = self.residuals - self.remaining[:, own] @ inverse @ self.residuals[own]
        self.columns = self.columns - self.columns[:, own] @ share
        self.remaining = self.remaining - self.remaining[:, own] @ share


def find_contradictions(
    block: Block, solution: Solution, checks: Sequence[CheckResult], risk: float
) -> tuple[Contradiction, ...]:
    """Accepted measurements that the rest of the block contradicts, worst first.

    Args:
        block: The adjusted block.
        solution: Its solved equations.
        checks: Its check points, with what the adjustment predicts of them.
        risk: Probability that a good one is named.
    """
    found = [*_of_control(block, solution, risk), *_of_checks(block, checks, risk)]
    return tuple(sorted(found, key=lambda one: (-one.test, one.key)))


def by_point(against: Sequence[Contradiction]) -> list[list[Contradiction]]:
    """Together what is one fault: coordinates of a point that are off speak in all its photos.

    Args:
        against: Contradictions, worst first.
    """
    found: dict[tuple[str, float], list[Contradiction]] = {}
    for one in against:
        found.setdefault((one.point_id, one.test), []).append(one)
    return list(found.values())


def _of_control(block: Block, solution: Solution, risk: float) -> list[Contradiction]:
    units = _units(solution)
    if not units:
        return []
    scale = control_scale(solution.network, solution.standardised, solution.fit.taking_part)
    judged = _together(solution, _worst(solution, units))
    limits = [scale * _limit(len(judged.residuals[rows]), risk) for rows in judged.rows]
    ground = ground_shifts_of(solution.network, solution.fit.state)
    found: list[Contradiction] = []
    left = set(range(len(judged.units)))
    while left:
        beyond = {number: judged.test(number) / limits[number] for number in left}
        # A ray goes before the coordinates of its point where both say the same.
        worst = max(left, key=lambda number: (round(beyond[number], 6), -number))
        if beyond[worst] <= 1:
            break
        deleted, own = judged.deleted(worst), judged.rows[worst]
        shift = float(ground.largest((judged.columns[:, own] @ deleted)[:, None])[0])
        test = judged.test(worst) / scale
        found += _told(block, solution, judged.units[worst], deleted, test=test, shift_m=shift)
        judged.leave_out(worst)
        left.discard(worst)
    return _each_once(found)


def _units(solution: Solution) -> list[_Unit]:
    """Accepted rays that take part, then the known coordinates of points that two rays show."""
    network, used = solution.network, solution.fit.taking_part
    accepted = np.flatnonzero(used & network.by_operator & network.anchored)
    rays = np.bincount(network.rays.point[used], minlength=network.points.count)
    of_point: dict[int, list[int]] = defaultdict(list)
    for ray in accepted.tolist():
        of_point[int(network.rays.point[ray])].append(ray)
    units = [_Unit(point, (ray,)) for point, shown in of_point.items() for ray in shown]
    for point, shown in of_point.items():
        known = network.points.known_weight[point] > 1 / UNKNOWN_M
        axes = tuple(np.flatnonzero(known).tolist())
        if rays[point] > 1 and axes:
            units.append(_Unit(point, tuple(shown), axes))
    return units


def _worst(solution: Solution, units: list[_Unit]) -> list[_Unit]:
    """Those that stand out most, each judged by itself; in their order."""
    if len(units) <= TOGETHER:
        return units
    tests = np.concatenate(
        [
            [part.test(number) for number in range(len(part.units))]
            for first in range(0, len(units), BATCH)
            for part in [_together(solution, units[first : first + BATCH])]
        ]
    )
    return [units[number] for number in sorted(np.argsort(-tests)[:TOGETHER].tolist())]


def _together(solution: Solution, units: list[_Unit]) -> _Judged:
    """Rows, residuals and cofactors of some units."""
    equations, lin = Equations(solution), solution.fit.lin
    parts, residuals, points = [], [], []
    for unit in units:
        if unit.axes:
            parts.append(equations.of_ground(unit.point, unit.axes))
            residuals.append(lin.ground[unit.point, list(unit.axes)])
        else:
            parts.append(equations.of_rays(np.array(unit.rays)))
            residuals.append(lin.residuals[:, unit.rays[0]])
        points.append(np.full(len(residuals[-1]), unit.point))
    rows = np.concatenate([part[0] for part in parts])
    inner = np.concatenate([part[1] for part in parts])
    of_row = np.concatenate(points)
    columns = equations.cofactors(rows)
    hats = rows @ columns + (inner @ inner.T) * (of_row[:, None] == of_row)
    ends = np.cumsum([len(part) for part in residuals]).tolist()
    slices = [slice(end - len(part), end) for part, end in zip(residuals, ends, strict=True)]
    return _Judged(units, slices, np.concatenate(residuals), np.eye(len(rows)) - hats, columns)


def _told(
    block: Block,
    solution: Solution,
    unit: _Unit,
    deleted: Scalars,
    *,
    test: float,
    shift_m: float,
) -> list[Contradiction]:
    """What a unit that was left out says, of every accepted measurement it speaks for."""
    network, found = solution.network, list[Contradiction]()
    for ray in unit.rays:
        item = network.measurements[network.rays.measurement[ray]]
        photo = network.photos[int(network.rays.photo[ray])]
        per_pixel = photo.ground_pixel_m(block.camera_of(photo.photo_id))
        if unit.axes:
            weights = network.points.known_weight[unit.point, list(unit.axes)]
            metres = float(np.linalg.norm(deleted / weights))
        else:
            sigma_px = float(network.rays.sigma_mm[ray]) / photo.interior.pixel_size_mm
            metres = float(np.linalg.norm(deleted)) * sigma_px * per_pixel
        point_id, photo_id = item.key
        found.append(Contradiction(point_id, photo_id, metres / per_pixel, metres, test, shift_m))
    return found


def _each_once(found: Sequence[Contradiction]) -> list[Contradiction]:
    """The graver one of what is said twice of a measurement: by its ray, and by its point."""
    best: dict[tuple[str, str], Contradiction] = {}
    for one in found:
        known = best.get(one.key)
        best[one.key] = one if known is None or one.test > known.test else known
    return list(best.values())


def _of_checks(block: Block, checks: Sequence[CheckResult], risk: float) -> list[Contradiction]:
    """Accepted measurements of check points that lie elsewhere than the block can be wrong."""
    accepted: Mapping[str, list[str]] = defaultdict(list)
    for item in block.measurements.values():
        if item.status == "accepted" and block.photos[item.photo_id].oriented:
            accepted[item.point_id].append(item.photo_id)
    found: list[Contradiction] = []
    for check in checks:
        if check.sigma_m is None:
            continue
        known = block.surveyed[check.point_id].sigma_m[:2]
        off = check.difference_m[:2]
        test = float(np.linalg.norm(off / np.hypot(check.sigma_m[:2], known)))
        if test <= _limit(len(off), risk):
            continue
        metres = float(np.linalg.norm(off))
        for name in accepted[check.point_id]:
            pixels = metres / block.photos[name].ground_pixel_m(block.camera_of(name))
            found.append(Contradiction(check.point_id, name, pixels, metres, test, 0.0))
    return found


def _limit(coordinates: int, risk: float) -> float:
    """Length in standard deviations that chance brings about with a probability of `risk`."""
    return float(np.sqrt(chdtri(coordinates, risk)))
