"""A surface beside the DEM: what differs everywhere, what differs in places, and its relief."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, UInt8

from core.arrays import Scalars, locked
from core.geometry.crs import Bounds
from core.surface.rectified import Picture

# source: Huber 1981, k; and the factor from a median deviation to a standard deviation
HUBER, MAD = 1.345, 1.4826
# design: converged to a hundredth of the scatter.
ROUNDS = 15
"""Steps of the robust fit at most."""
# source: cartographic convention: light from the north-west, 45 degrees high
SUN_AZIMUTH_DEG, SUN_HEIGHT_DEG = 315.0, 45.0
NOTHING = 1e-6  # design: no division by nought.
TERMS = 4  # source: definition of the trend
"""Shift, tilt to the east and to the north, and bowl."""


@dataclass(frozen=True, slots=True, eq=False)
class SystematicPart:
    """Systematic part of surface minus DEM: a + b x + c y + d (x^2 + y^2)."""

    bounds: Bounds
    """x and y run from -1 to 1 along the longer side of these."""
    coefficients: Float64[np.ndarray, "4"]
    """a, b, c, d, metres."""
    nmad_m: float
    """Normalised median deviation of what is left, metres."""
    cells: int
    """Cells that it was fitted to."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients", locked(self.coefficients))

    def at(self, plan: Float64[np.ndarray, "n 2"]) -> Scalars:
        """Of places, easting and northing, metres."""
        return _design(plan, self.bounds) @ self.coefficients


def fit_trend(
    plan: Float64[np.ndarray, "n 2"], differences: Scalars, bounds: Bounds
) -> SystematicPart:
    """Fit the systematic part robustly; buildings, woods and changed ground hardly count.

    Args:
        plan: Easting and northing of cells.
        differences: Surface minus DEM there, metres.
        bounds: West, south, east, north of the surface.
    """
    if len(differences) < 10 * TERMS:
        return SystematicPart(bounds, np.zeros(TERMS), float("nan"), len(differences))
    design = _design(plan, bounds)
    found = np.zeros(TERMS)
    found[0] = np.median(differences)
    residuals = differences - design @ found
    for _ in range(ROUNDS):
        scale = max(nmad(residuals), NOTHING)
        # Huber's weights squared: what is far off counts for nothing much.
        weight = np.minimum(1, HUBER * scale / np.maximum(np.abs(residuals), NOTHING)) ** 2
        side = design * weight[:, None]
        step = np.linalg.lstsq(side.T @ design, side.T @ residuals, rcond=None)[0]
        found = found + step
        residuals = differences - design @ found
        # design: a hundredth of the scatter changes nothing.
        if np.max(np.abs(step)) < 0.01 * scale:
            break
    return SystematicPart(bounds, found, nmad(residuals), len(differences))


def nmad(values: Scalars) -> float:
    """Normalised median absolute deviation: the standard deviation of normal errors."""
    return float(MAD * np.median(np.abs(values - np.median(values))))


def _design(plan: Float64[np.ndarray, "n 2"], bounds: Bounds) -> Float64[np.ndarray, "n 4"]:
    west, south, east, north = bounds
    half = max(east - west, north - south) / 2
    x = (plan[:, 0] - (west + east) / 2) / half
    y = (plan[:, 1] - (south + north) / 2) / half
    return np.column_stack([np.ones(len(plan)), x, y, x**2 + y**2])


def hillshade(heights: Picture, cell_m: float) -> UInt8[np.ndarray, "rows columns"]:
    """Relief under light from the north-west, 1 to 255; 0 in holes and beside them."""
    down, right = np.gradient(heights, cell_m)
    azimuth, high = np.radians([SUN_AZIMUTH_DEG, SUN_HEIGHT_DEG])
    light = (
        np.sin(high) - np.cos(high) * (right * np.sin(azimuth) - down * np.cos(azimuth))
    ) / np.sqrt(1 + right**2 + down**2)
    shown = 1 + 254 * np.clip(light, 0, 1)  # source: eight bits without nodata
    known = np.isfinite(light) & np.isfinite(heights)
    return np.where(known, shown, 0).astype(np.uint8)
