"""Where rays of a photo meet the terrain."""

import numpy as np
from jaxtyping import Float64

from core.arrays import Indices, ObjectPoints, Position, Scalars
from core.geometry.crs import Bounds
from core.reference.dem import Dem

MOST_STEPS = 4000
"""Longest march along a ray, in pixels of the DEM."""
CHUNK = 500_000
"""Heights looked up at once."""
REFINEMENTS = 40
"""Halvings of the interval that holds the terrain: far below a millimetre from any pixel size."""


def object_on_terrain(
    centre: Position, directions: Float64[np.ndarray, "n 3"], dem: Dem
) -> ObjectPoints:
    """The first point of the terrain each ray meets.

    Every ray is followed from above the highest ground down, in steps of half a pixel of the DEM
    on the ground, until it dives under; then the crossing is halved in. So a ray that passes a
    ridge finds the near slope, where the usual iteration on heights may swing or miss.

    Args:
        centre: Perspective centre, metres.
        directions: Direction of each ray in object space, any length.
        dem: Terrain; crop it to the block beforehand when there are many calls.

    Returns:
        Ground points (n, 3), metres; NaN for rays that point up, leave the DEM, or meet a gap.
    """
    points = np.full(directions.shape, np.nan)
    local, low, high = _around(centre, directions, dem)
    down = np.flatnonzero(directions[:, 2] < 0)
    if local is None or not len(down):
        return points
    drop = directions[down] / -directions[down, 2:]
    start = np.full(len(down), max(0.0, float(centre[2]) - high))
    end = np.full(len(down), float(centre[2]) - low)
    near, far = _march(centre, drop, start, end, local)
    found = np.isfinite(near)
    near, far, drop, down = near[found], far[found], drop[found], down[found]
    for _ in range(REFINEMENTS):
        middle = (near + far) / 2
        above = _clearance(centre, drop, middle, local) > 0
        near, far = np.where(above, middle, near), np.where(above, far, middle)
    points[down] = centre + drop * ((near + far) / 2)[:, None]
    return points


def _around(
    centre: Position, directions: Float64[np.ndarray, "n 3"], dem: Dem
) -> tuple[Dem | None, float, float]:
    """The terrain the rays can reach, in memory, and its lowest and highest height."""
    low, high = dem.height_range()
    if np.isnan(low):
        return None, low, high
    slack = 20.0 + 0.5 * (high - low)
    local = dem.cropped(_reach(centre, directions, low - slack, high + slack))
    assert local.window is not None
    known = local.window.heights[np.isfinite(local.window.heights)]
    if not len(known):
        return None, low, high
    # A little more on both sides, so that a ray begins above and ends below.
    return local, float(known.min()) - 0.01, float(known.max()) + 0.01


def _reach(
    centre: Position, directions: Float64[np.ndarray, "n 3"], low: float, high: float
) -> Bounds:
    """Bounds of all places between two heights that the rays pass."""
    down = directions[directions[:, 2] < 0]
    drop = down[:, :2] / -down[:, 2:]
    depths = max(0.0, float(centre[2]) - high), float(centre[2]) - low
    plane = np.vstack([centre[:2] + drop * depth for depth in depths])
    if not len(plane):
        return (*centre[:2].tolist(), *centre[:2].tolist())
    return (*plane.min(axis=0).tolist(), *plane.max(axis=0).tolist())


def _march(
    centre: Position,
    drop: Float64[np.ndarray, "n 3"],
    start: Scalars,
    end: Scalars,
    dem: Dem,
) -> tuple[Scalars, Scalars]:
    """Depths below the centre between which each ray dives under the terrain; NaN if it does not.

    A ray that comes from a gap, or from outside, straight under the terrain has no crossing that
    could be known.
    """
    length = np.linalg.norm(drop[:, :2], axis=1) * (end - start)
    steps = np.clip(np.ceil(length / dem.ground_sample_distance_m * 2), 1, MOST_STEPS)
    near, far = np.full(len(drop), np.nan), np.full(len(drop), np.nan)
    # Rays of like length together, so that steep ones do not march as long as slanting ones.
    for part in _in_chunks(np.argsort(length, kind="stable"), steps):
        count = int(steps[part].max())
        share = np.linspace(0, 1, count + 1)
        depth = start[part, None] + share * (end[part] - start[part])[:, None]
        spread = np.repeat(drop[part], count + 1, axis=0)
        over = _clearance(centre, spread, depth.ravel(), dem).reshape(depth.shape)
        under = over <= 0
        at = np.argmax(under, axis=1)
        rows = np.arange(len(at))
        sound = under[rows, at] & (at > 0) & (over[rows, at - 1] > 0)
        near[part] = np.where(sound, depth[rows, at - 1], np.nan)
        far[part] = np.where(sound, depth[rows, at], np.nan)
    return near, far


def _in_chunks(order: Indices, steps: Scalars) -> list[Indices]:
    """The rays in this order, cut so that no piece needs more than `CHUNK` heights."""
    cost = np.cumsum(steps[order] + 1)
    piece = np.floor(cost / CHUNK).astype(np.int64)
    return np.split(order, np.flatnonzero(np.diff(piece)) + 1)


def _clearance(
    centre: Position, drop: Float64[np.ndarray, "n 3"], depth: Scalars, dem: Dem
) -> Scalars:
    """Height of each ray above the terrain at a depth below the centre, metres; NaN unknown."""
    place = centre + drop * depth[:, None]
    return place[:, 2] - dem.heights(place[:, :2])
