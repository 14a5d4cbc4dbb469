"""Chance textures that do not depend on how the picture is cut into tiles."""

import cv2
import numpy as np
from jaxtyping import Float32

from core.raster.grid import Grid
from core.synthetic.options import seeded

Field = Float32[np.ndarray, "_ _"]
BLOCK = 256


def fractal(
    shape: tuple[int, int],
    gsd_m: float,
    shortest_m: float,
    longest_m: float,
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
