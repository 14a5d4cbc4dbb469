"""Surfaces made by chance: the true ground, and textures.

The ground is smooth between lattice heights and defined at every point; textures do not depend on
how a picture is cut into tiles.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, Float64
from scipy import ndimage

from core.arrays import Matrix, Scalars, locked
from core.raster.grid import Grid
from core.synthetic.options import seeded

PlanPoints = Float64[np.ndarray, "_ 2"]
"""Easting and northing in the block's CRS, metres."""
Bounds = tuple[float, float, float, float]
"""West, south, east, north, metres."""
LATTICE_M = 20.0
"""Distance of the lattice heights: the shortest wave of the terrain is some three times longer."""
Field = Float32[np.ndarray, "_ _"]
BLOCK = 256


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


def fractal(
    shape: tuple[int, int],
    gsd_m: float,
    shortest_m: float,
    longest_m: float,
    *,
    slope: float,
    rng: np.random.Generator,
) -> Field:
    """A field of mean 0 and deviation 1 with structure between two sizes.

    Args:
        shape: Rows and columns.
        gsd_m: Size of a pixel, metres.
        shortest_m: Smallest structure, metres; below two pixels the pixel itself.
        longest_m: Largest structure, metres.
        slope: Amplitude grows with structure size to this power.
        rng: Source of chance.
    """
    result = np.zeros(shape, dtype=np.float32)
    size = longest_m
    while size >= max(shortest_m, gsd_m):
        step = max(size / gsd_m, 1.0)
        lattice = rng.standard_normal(
            (int(shape[0] / step) + 4, int(shape[1] / step) + 4), dtype=np.float32
        )
        move = rng.uniform(0.0, 1.0, 2) + 1.0
        layer = _stretched(lattice, shape, step, (float(move[0]), float(move[1])))
        layer *= np.float32(size**slope)
        result += layer
        size /= 2.0
    sample = result[:: max(1, shape[0] // 500), :: max(1, shape[1] // 500)]
    result -= sample.mean()
    result /= max(float(sample.std()), 1e-6)
    return result


def _stretched(
    lattice: Field, shape: tuple[int, int], step: float, move: tuple[float, float]
) -> Field:
    """The lattice enlarged by cubic interpolation."""
    matrix = np.array([[1 / step, 0, move[0]], [0, 1 / step, move[1]]], dtype=np.float64)
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpAffine(lattice, matrix, shape[::-1], flags=flags, borderMode=cv2.BORDER_REFLECT),
        dtype=np.float32,
    )


def smooth_step(field: Field, source: Grid, target: Grid) -> Field:
    """A field brought from one grid to another that it covers, linear between pixels."""
    ratio = target.ground_sample_distance_m / source.ground_sample_distance_m
    west = (target.west - source.west) / source.ground_sample_distance_m + 0.5 * ratio - 0.5
    north = (source.north - target.north) / source.ground_sample_distance_m + 0.5 * ratio - 0.5
    matrix = np.array([[ratio, 0, west], [0, ratio, north]], dtype=np.float64)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = (target.columns, target.rows)
    return np.asarray(
        cv2.warpAffine(field, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE),
        dtype=np.float32,
    )


def stretched_band(field: Field, shape: tuple[int, int], first: int, rows: int) -> Field:
    """Some rows of a small field enlarged to a picture of the given rows and columns."""
    down, right = field.shape[0] / shape[0], field.shape[1] / shape[1]
    matrix = np.array(
        [[right, 0, 0.5 * right - 0.5], [0, down, (first + 0.5) * down - 0.5]], dtype=np.float64
    )
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpAffine(
            field, matrix, (shape[1], rows), flags=flags, borderMode=cv2.BORDER_REPLICATE
        ),
        dtype=np.float32,
    )


def white(seed: int, name: str, column: int, row: int, columns: int, rows: int) -> Field:
    """White noise of a window of an endless picture: the same however it is windowed."""
    first_column, first_row = column // BLOCK, row // BLOCK
    last_column, last_row = (column + columns - 1) // BLOCK, (row + rows - 1) // BLOCK
    strips = [
        np.hstack(
            [
                seeded(seed, name, i, j).standard_normal((BLOCK, BLOCK), dtype=np.float32)
                for j in range(first_column, last_column + 1)
            ]
        )
        for i in range(first_row, last_row + 1)
    ]
    left, top = column - first_column * BLOCK, row - first_row * BLOCK
    return np.vstack(strips)[top : top + rows, left : left + columns]
