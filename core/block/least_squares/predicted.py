"""How far check points should be off: the covariance of orientations carried to the ground."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from core.arrays import Position
from core.block.adjusted import CheckResult
from core.block.block import Block, Measurement
from core.block.least_squares.equations import Equations


def check_sigmas(
    equations: Equations, block: Block, checks: Sequence[CheckResult]
) -> dict[str, Position]:
    """Standard deviations (E, N, H) of computed check points, metres, for a sigma nought of one.

    X = -(B^T B)^-1 B^T (A d + e) with the rays' derivatives A by photos and cameras, B by the
    point, all in standard deviations; the known coordinates' own error is not in it.

    Args:
        equations: The adjusted block's equations.
        block: The adjusted block.
        checks: Its check points.
    """
    photo_row = {p.photo_id: row for row, p in enumerate(equations.solution.network.photos)}
    rays: dict[str, list[Measurement]] = defaultdict(list)
    for item in block.measurements.values():
        if (
            item.used
            and item.photo_id in photo_row
            and block.surveyed[item.point_id].role == "check"
        ):
            rays[item.point_id].append(item)
    sigmas: dict[str, Position] = {}
    for check in checks:
        items = rays[check.point_id][:1] if check.used_scans == 1 else rays[check.point_id]
        if items:
            photos = [photo_row[item.photo_id] for item in items]
            sigmas[check.point_id] = _sigma(equations, items, photos, check.position)
    return sigmas


def _sigma(
    equations: Equations,
    items: Sequence[Measurement],
    photos: Sequence[int],
    position: Float64[np.ndarray, "3"],
) -> Position:
    """Standard deviations of one point; with one ray at a height that is taken as true."""
    parts = [
        equations.of_free_ray(photo, item, position)
        for photo, item in zip(photos, items, strict=True)
    ]
    rows = np.concatenate([part[0] for part in parts])
    by_point = np.concatenate([part[1] for part in parts])
    axes = 3 if len(items) > 1 else 2
    design = by_point[:, :axes]
    inverse = np.linalg.inv(design.T @ design)
    carried = inverse @ design.T @ rows
    covariance = carried @ equations.cofactors(carried) + inverse
    sigma = np.zeros(3)
    sigma[:axes] = np.sqrt(np.diag(covariance))
    return sigma
