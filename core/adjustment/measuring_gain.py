"""What measuring a point that nobody has measured yet would bring, in metres.

A measurement of a control point takes off the ground's variance, with A its rows over photos and
cameras, B those over the point, S the covariance of its coordinates and Q the cofactors,

    Q A^T (I + A Q A^T + B S B^T)^-1 A Q,

of which the mean over nine places of every photo is m_p squared before less m_p squared after: the
same measure as that of a decision (`expected_gain.py`). A check point moves nothing; it tells how
good the block is. The m_p that n points show is known to m_p / sqrt(4 n + 1), so that one more
brings the difference to n + 1 of them, the most where the block is known least.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from core.adjustment.influence import BATCH, Influence
from core.block import HAND_SIGMA_PX, Measurement, SurveyedPoint, position_sigma_m

Key = tuple[str, str]
"""Point and photo."""


def measuring_gains(
    influence: Influence, wanted: Sequence[tuple[SurveyedPoint, str]], checks: int
) -> dict[Key, float]:
    """What each measurement alone would bring, metres.

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
        found |= _gains(influence, inside[first : first + BATCH], numbers, checks)
    return found


def _gains(
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
