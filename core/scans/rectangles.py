"""Four marks whose pattern alone is known: a rectangle's corners, or the middles of its sides.

Sides, middle and turn of the rectangle are free. All combinations of one peak from each window are
fitted at once, and those of three windows, whose fourth mark is missing. Complex numbers turn and
scale by one product: places are x + i y with y up.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Bool, Complex128, Float64, Int

Places = Complex128[np.ndarray, "four peaks"]
Numbers = Float64[np.ndarray, "n"]


@dataclass(frozen=True, slots=True, eq=False)
class Rectangles:
    """Rectangles through every combination of peaks."""

    chosen: Int[np.ndarray, "n four"]
    """Peak of each mark; -1 where the other three put it."""
    middle: Complex128[np.ndarray, "n"]
    """Where the diagonals meet."""
    turn: Numbers
    """Rotation counter-clockwise, radians."""
    half: Float64[np.ndarray, "n 2"]
    """Half of the width and of the height."""
    apart: Float64[np.ndarray, "n four"]
    """Distance of each peak from its place in the rectangle."""

    @property
    def seen(self) -> Bool[np.ndarray, "n four"]:
        """Which marks are peaks."""
        return self.chosen >= 0


def fit_rectangles(places: Places, directions: Float64[np.ndarray, "four 2"]) -> Rectangles:
    """Fit a rectangle to every combination of peaks, by least squares.

    Args:
        places: Peaks by mark; NaN where there are fewer.
        directions: Where the marks lie from the middle in halves of the sides, clockwise: mark k
            and k + 2 are opposite.
    """
    peaks = range(places.shape[1])
    four = np.array(list(product(peaks, repeat=4)))
    three = np.array(list(product(peaks, repeat=3)))
    chosen = np.vstack([four, *(np.insert(three, missing, -1, axis=1) for missing in range(4))])
    at = np.take_along_axis(places.T, np.maximum(chosen, 0), axis=0)
    for missing in range(4):
        lost = chosen[:, missing] < 0
        before, after, opposite = (at[lost, (missing + k) % 4] for k in (-1, 1, 2))
        at[lost, missing] = before + after - opposite
    chosen, at = (values[np.isfinite(at).all(axis=1)] for values in (chosen, at))
    return _fitted(chosen, at, directions)


def _fitted(
    chosen: Int[np.ndarray, "n four"],
    at: Complex128[np.ndarray, "n four"],
    directions: Float64[np.ndarray, "four 2"],
) -> Rectangles:
    """A parallelogram first: its half sides then share the turn that makes them square."""
    right, up = directions.T
    middle = at.mean(axis=1)
    width, height = at @ right / (right @ right), -1j * (at @ up) / (up @ up)
    turn = np.angle(width**2 + height**2) / 2
    back = np.exp(-1j * turn)
    half = np.column_stack([np.real(width * back), np.real(height * back)])
    drawn = np.exp(1j * turn)[:, None] * (half[:, :1] * right + 1j * half[:, 1:] * up)
    apart = np.abs(at - middle[:, None] - drawn)
    return Rectangles(chosen, middle, turn, half, apart)
