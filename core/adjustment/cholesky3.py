"""Cholesky roots of many 3 x 3 matrices at once: what eliminating the points needs."""

import numpy as np
from jaxtyping import Float64


def cholesky3(own: Float64[np.ndarray, "6 points"]) -> Float64[np.ndarray, "6 points"]:
    """Cholesky roots of many 3 x 3 matrices; a point nothing is known of gets infinite roots.

    An infinite root makes everything that is divided by it nought: such a point stays where it is.
    """
    a, b, c, d, e, f = own
    r00 = np.sqrt(np.where(a > 0, a, np.inf))
    r10, r20 = b / r00, d / r00
    rest = c - r10 * r10
    r11 = np.sqrt(np.where(rest > 0, rest, np.inf))
    r21 = (e - r20 * r10) / r11
    rest = f - r20 * r20 - r21 * r21
    r22 = np.sqrt(np.where(rest > 0, rest, np.inf))
    return np.stack([r00, r10, r11, r20, r21, r22])


def forward3(
    root: Float64[np.ndarray, "6 n"], side: Float64[np.ndarray, "3 n"]
) -> Float64[np.ndarray, "3 n"]:
    """L^-1 times a vector, for many at once."""
    x = side[0] / root[0]
    y = (side[1] - root[1] * x) / root[2]
    z = (side[2] - root[3] * x - root[4] * y) / root[5]
    return np.stack([x, y, z])


def backward3(
    root: Float64[np.ndarray, "6 n"], side: Float64[np.ndarray, "3 n"]
) -> Float64[np.ndarray, "3 n"]:
    """L^-T times a vector, for many at once."""
    z = side[2] / root[5]
    y = (side[1] - root[4] * z) / root[2]
    x = (side[0] - root[1] * y - root[3] * z) / root[0]
    return np.stack([x, y, z])
