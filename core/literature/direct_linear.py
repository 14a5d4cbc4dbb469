"""Direct linear transformation: eleven parameters, and RANSAC over them as the thesis did it.

Kept for comparison and for cameras of which nothing is known. On nearly level ground the eleven
parameters are not determined (thesis: Milovice), which `is_flat` tells; with the principal distance
known, `core.geometry.resection` needs three points where this needs six.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int

from core.arrays import Indices, ObjectPoints, PixelPoints, Scalars

SAMPLE = 6
PARAMETERS = 11
BATCH = 2000
LEAST_RELIEF = 0.02
"""Below this share of the flying height the relief does not determine the parameters."""
Agreeing = Int[np.ndarray, "agreeing"]
"""Indices of candidates."""
Models = Float64[np.ndarray, "samples 11"]
"""Parameters of many transformations."""


@dataclass(frozen=True, slots=True)
class RansacOptions:
    """The plain RANSAC of the thesis (script 7)."""

    samples: int = 100_000
    """Samples of six points."""
    threshold_px: float = 4.0
    """A point agrees when the model puts it closer than this, pixels."""


def agreeing_points(
    points: ObjectPoints,
    pixels: PixelPoints,
    owner: Indices,
    options: RansacOptions,
    rng: np.random.Generator,
) -> Agreeing:
    """Candidates that the best of many samples of six agrees with.

    As in the thesis: most candidates win, ties go to the lesser sum of distances, the sample itself
    counts, nothing is refitted.

    Args:
        points: Known point of each candidate, metres.
        pixels: Where each candidate lies.
        owner: Number of the known point of each candidate; a sample has six different ones.
        options: How many, how near.
        rng: Source of the samples.
    """
    if len(np.unique(owner)) < SAMPLE:
        return np.zeros(0, dtype=np.int64)
    ground, image = conditioned(points), conditioned(pixels)
    best, least = np.zeros(0, dtype=np.int64), (0, 0.0)
    scale = float(np.std(pixels - pixels.mean(axis=0)))
    for start in range(0, options.samples, BATCH):
        size = min(BATCH, options.samples - start)
        drawn = np.argsort(rng.random((size, len(points))), axis=1)[:, :SAMPLE]
        named = np.sort(owner[drawn], axis=1)
        drawn = drawn[(np.diff(named, axis=1) > 0).all(axis=1)]
        models = solved(ground[drawn], image[drawn])
        away = distances(models, ground, image) * scale
        near = away < options.threshold_px
        count, total = near.sum(axis=1), np.where(near, away, 0.0).sum(axis=1)
        order = np.lexsort((total, -count))
        if len(order):
            first = int(order[0])
            found = (-int(count[first]), float(total[first]))
            if found < least:
                least, best = found, np.flatnonzero(near[first])
    return best


def conditioned(points: Float64[np.ndarray, "n axes"]) -> Float64[np.ndarray, "n axes"]:
    """Coordinates about their mean in units of their common spread."""
    centred = points - points.mean(axis=0)
    return centred / max(float(np.std(centred)), 1e-12)


def solved(
    ground: Float64[np.ndarray, "samples 6 3"], image: Float64[np.ndarray, "samples 6 2"]
) -> Models:
    """Parameters of every sample by least squares over its twelve equations; NaN if singular."""
    count = len(ground)
    design = np.zeros((count, 12, PARAMETERS))
    for axis in range(2):
        rows = slice(axis, 12, 2)
        design[:, rows, 4 * axis : 4 * axis + 3] = ground
        design[:, rows, 4 * axis + 3] = 1.0
        design[:, rows, 8:] = -image[:, :, axis : axis + 1] * ground
    right = image.reshape(count, 12, 1)
    normal = np.swapaxes(design, 1, 2) @ design
    normal += 1e-12 * np.eye(PARAMETERS)
    return np.linalg.solve(normal, np.swapaxes(design, 1, 2) @ right)[:, :, 0]


def distances(
    models: Models, ground: Float64[np.ndarray, "n 3"], image: Float64[np.ndarray, "n 2"]
) -> Float64[np.ndarray, "samples n"]:
    """Distance between where every model puts every point and where it is."""
    whole = np.column_stack([ground, np.ones(len(ground))])
    depth = models[:, 8:] @ ground.T + 1.0
    depth = np.where(np.abs(depth) < 1e-9, np.nan, depth)
    across = (models[:, :4] @ whole.T) / depth - image[:, 0]
    down = (models[:, 4:8] @ whole.T) / depth - image[:, 1]
    return np.nan_to_num(np.hypot(across, down), nan=np.inf)


def is_flat(heights: Scalars, flying_height_m: float) -> bool:
    """Whether the relief of the points is too low for eleven parameters."""
    return bool(np.ptp(heights) < LEAST_RELIEF * flying_height_m) if len(heights) else True
