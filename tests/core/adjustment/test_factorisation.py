"""Banded systems with a border."""

import numpy as np
import pytest

from core.adjustment.factorisation import (
    band_places,
    factor_bordered,
    invert_bordered,
    solve_bordered,
)


def bordered(photos, reach, shared, seed):
    """A random positive definite system: dense, and in the parts that the solver wants."""
    rng = np.random.default_rng(seed)
    size = 6 * photos
    near = np.abs(np.subtract.outer(np.arange(size) // 6, np.arange(size) // 6)) <= reach
    matrix = np.where(near, rng.normal(size=(size, size)), 0.0)
    matrix = matrix + matrix.T + np.eye(size) * 12 * (reach + 1) * 2
    border = rng.normal(size=(size, shared))
    corner = np.eye(shared) * (size + 50.0)
    dense = np.block([[matrix, border], [border.T, corner]])
    blocks = matrix.reshape(photos, 6, photos, 6).swapaxes(1, 2)
    pairs = [(i, j) for i in range(photos) for j in range(i + 1) if i - j <= reach]
    rows, columns = np.array(pairs).T
    index, below = band_places(rows, columns, size)
    values = np.array([blocks[i, j] for i, j in pairs])
    band = np.bincount(index.ravel(), (values * below).ravel(), 6 * (reach + 1) * size)
    return dense, band.reshape(-1, size), border, corner


@pytest.mark.parametrize(
    ("photos", "reach", "shared"), [(1, 0, 5), (4, 3, 5), (11, 2, 5), (12, 4, 0), (9, 0, 10)]
)
def test_bordered_system_is_the_dense_one__law(photos, reach, shared):
    dense, band, border, corner = bordered(photos, reach, shared, photos)
    factor = factor_bordered(band, border, corner)
    side = np.random.default_rng(9).normal(size=len(dense))
    first, second = solve_bordered(factor, side[: 6 * photos], side[6 * photos :])
    expected = np.linalg.solve(dense, side)
    np.testing.assert_allclose(np.concatenate([first, second]), expected, atol=1e-12)
    inverse = invert_bordered(factor, reach)
    whole = np.linalg.inv(dense)
    np.testing.assert_allclose(inverse.corner, whole[6 * photos :, 6 * photos :], atol=1e-12)
    for i in range(photos):
        for j in range(max(i - reach, 0), min(i + reach + 1, photos)):
            block = inverse.pairs(np.array([i]), np.array([j]))[0]
            expected = whole[6 * i : 6 * i + 6, 6 * j : 6 * j + 6]
            np.testing.assert_allclose(block, expected, atol=1e-12)
        shared_part = inverse.with_border(np.array([i]))[0]
        expected = whole[6 * i : 6 * i + 6, 6 * photos :]
        np.testing.assert_allclose(shared_part, expected, atol=1e-12)
