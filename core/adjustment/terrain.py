"""The terrain as an observation: tie points lie on it, softly, for forests and changes do not."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from core.adjustment.gauss_newton import Fit
from core.adjustment.network import Network
from core.arrays import ObjectPoints, Scalars
from core.geometry.robust import robust_sigma

Terrain = Callable[[ObjectPoints], Scalars]
"""Heights (metres) of the ground at object points, whatever height these have; NaN outside."""
# design: ground within two standard deviations is terrain as a rule, forest is beyond.
LIMIT = 2.0
"""At this many standard deviations off the terrain a point has a quarter of its weight."""


def laid_on_terrain(network: Network, fit: Fit, terrain: Terrain, sigma_m: float) -> Network:
    """The network with the terrain's heights at the tie points as observations.

    Heights are those under the present positions; the adjustment repeats this until they no
    longer move.

    Args:
        network: The network.
        fit: Where the points are now.
        terrain: Heights of the ground.
        sigma_m: Standard deviation of the difference between a tie point and the terrain, metres.
    """
    ties = len(network.points.tie)
    known, weight = network.points.known.copy(), network.points.known_weight.copy()
    heights = terrain(fit.state.points[:ties])
    off = np.abs(fit.state.points[:ties, 2] - heights) / sigma_m
    # Geman and McClure: what stands far off, as a forest does, has no say at all; but the limit is
    # wide as long as the block as a whole is off.
    limit = LIMIT * max(1.0, robust_sigma(off))
    soft = 1 / (1 + (np.nan_to_num(off, nan=np.inf) / limit) ** 2)
    known[:ties, 2] = np.nan_to_num(heights)
    weight[:ties, 2] = np.where(np.isfinite(heights), soft / sigma_m, 0.0)
    return replace(network, points=replace(network.points, known=known, known_weight=weight))
