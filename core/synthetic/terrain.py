"""The true ground: a smooth surface between lattice heights, defined at every point."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy import ndimage

from core.arrays import Matrix, Scalars, locked
from core.raster.grid import Grid

PlanPoints = Float64[np.ndarray, "_ 2"]
"""Easting and northing in the block's CRS, metres."""
Bounds = tuple[float, float, float, float]
"""West, south, east, north, metres."""
LATTICE_M = 20.0
"""Distance of the lattice heights: the shortest wave of the terrain is some three times longer."""


@dataclass(frozen=True, slots=True, eq=False)
class Terrain:
    """Bare earth as a cubic B-spline over a lattice: twice differentiable, no facets."""

    grid: Grid
    """The lattice; heights belong to its pixel centres."""
    coefficients: Matrix
    """B-spline coefficients of the lattice heights, metres."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients", locked(self.coefficients))

    def heights(self, points: PlanPoints) -> Scalars:
        """Height of the ground at points (easting, northing), metres; level beyond the lattice."""
        lattice = self.grid.grid_from_object(points) - 0.5
        return ndimage.map_coordinates(
            self.coefficients, lattice.T[::-1], order=3, mode="nearest", prefilter=False
        )

    def on(self, grid: Grid) -> Matrix:
        """Heights at the pixel centres of a grid, metres."""
        east, north = np.meshgrid(*grid.centres())
        heights = self.heights(np.column_stack([east.ravel(), north.ravel()]))
        return heights.reshape(grid.rows, grid.columns)


def make_terrain(bounds: Bounds, relief_m: float, rng: np.random.Generator) -> Terrain:
    """A landscape of hills and valleys: power-law spectrum below a longest wave of some 2 km.

    Args:
        bounds: Area of the lattice, metres; it should reach beyond what is seen.
        relief_m: Highest minus lowest ground in the middle half of the area, metres.
        rng: Source of chance.
    """
    grid = Grid.over(bounds, LATTICE_M)
    rows, columns = grid.rows, grid.columns
    frequency = np.hypot(
        np.fft.fftfreq(rows, LATTICE_M)[:, None], np.fft.rfftfreq(columns, LATTICE_M)[None, :]
    )
    longest = 1.0 / 1600.0
    amplitude = 1.0 / (1.0 + (frequency / longest) ** 2) ** 1.25
    amplitude *= np.exp(-((frequency * 60.0) ** 2))
    noise = np.fft.rfft2(rng.standard_normal((rows, columns)))
    shape = np.fft.irfft2(noise * amplitude, s=(rows, columns))
    middle = shape[rows // 4 : rows - rows // 4, columns // 4 : columns - columns // 4]
    shape = (shape - middle.min()) / max(float(np.ptp(middle)), 1e-12)
    heights = float(rng.uniform(190.0, 280.0)) + relief_m * shape
    return Terrain(grid, ndimage.spline_filter(heights, order=3, mode="nearest"))
