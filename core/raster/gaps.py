"""Small gaps of a height raster, closed by the smoothest surface through what surrounds them."""

from typing import cast

import numpy as np
from jaxtyping import Bool, Float32, Int, Int32
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

LARGEST_GAP_PX = 10
"""Gaps up to this size in rows and in columns are closed; larger ones stay gaps."""


def small_gaps(
    heights: Float32[np.ndarray, "rows columns"], largest_px: int = LARGEST_GAP_PX
) -> Bool[np.ndarray, "rows columns"]:
    """The gaps (NaN) that may be closed: small ones that do not reach the raster's edge."""
    empty = np.isnan(heights)
    if not empty.any() or empty.all():
        return np.zeros_like(empty)
    labels, count = labelled(empty)
    small = np.zeros(count + 1, dtype=bool)
    for label, (down, across) in enumerate(ndimage.find_objects(labels), start=1):
        inside = (
            down.start > 0
            and across.start > 0
            and down.stop < heights.shape[0]
            and across.stop < heights.shape[1]
        )
        size = max(down.stop - down.start, across.stop - across.start)
        small[label] = inside and size <= largest_px
    return small[labels]


def labelled(
    flags: Bool[np.ndarray, "rows columns"],
) -> tuple[Int32[np.ndarray, "rows columns"], int]:
    """Number of the connected part (eight neighbours) of every pixel, 0 outside; how many."""
    labels = np.zeros(flags.shape, dtype=np.int32)
    count = ndimage.label(flags, structure=np.ones((3, 3)), output=labels)
    return labels, cast(int, count)


def fill_gaps(
    heights: Float32[np.ndarray, "rows columns"], gaps: Bool[np.ndarray, "rows columns"]
) -> Float32[np.ndarray, "rows columns"]:
    """The raster with these gaps closed.

    The squares of all second differences that touch a gap are made least: the surface goes on
    with the slope it has at the rim, so a plane with holes becomes the plane.
    """
    if not gaps.any():
        return heights
    number = np.full(heights.shape, -1, dtype=np.int64)
    number[gaps] = np.arange(np.count_nonzero(gaps))
    open_gap = np.isnan(heights) & ~gaps
    rows, columns, weights, constants = [], [], [], []
    first = 0
    for offsets, factors in _SECOND_DIFFERENCES:
        cells = _stencils(gaps, open_gap, offsets)
        if not len(cells):
            continue
        constant = np.zeros(len(cells))
        for offset, factor in zip(offsets, factors, strict=True):
            down, across = (cells + offset).T
            unknown = number[down, across]
            free = unknown >= 0
            rows.append(first + np.flatnonzero(free))
            columns.append(unknown[free])
            weights.append(np.full(int(free.sum()), factor))
            constant[~free] -= factor * heights[down[~free], across[~free]]
        constants.append(constant)
        first += len(cells)
    entries = (np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns)))
    design = coo_array(entries, shape=(first, int(gaps.sum()))).tocsc()
    filled = heights.copy()
    normal = (design.T @ design).tocsc()
    filled[gaps] = splu(normal).solve(design.T @ np.concatenate(constants))
    return filled


_SECOND_DIFFERENCES = (
    (((0, -1), (0, 0), (0, 1)), (1.0, -2.0, 1.0)),
    (((-1, 0), (0, 0), (1, 0)), (1.0, -2.0, 1.0)),
    (((0, 0), (0, 1), (1, 0), (1, 1)), (1.0, -1.0, -1.0, 1.0)),
)
"""Row and column offsets, and factors, of d2/dc2, d2/dr2 and d2/dcdr."""


def _stencils(
    gaps: Bool[np.ndarray, "rows columns"],
    open_gap: Bool[np.ndarray, "rows columns"],
    offsets: tuple[tuple[int, int], ...],
) -> Int[np.ndarray, "n 2"]:
    """Where a difference touches a gap and meets neither the edge nor a gap that stays."""
    touched = np.unique(np.vstack([np.argwhere(gaps) - offset for offset in offsets]), axis=0)
    sound = np.ones(len(touched), dtype=bool)
    for offset in offsets:
        place = touched + offset
        sound &= ((place >= 0) & (place < gaps.shape)).all(axis=1)
    touched = touched[sound]
    whole = np.ones(len(touched), dtype=bool)
    for offset in offsets:
        whole &= ~open_gap[tuple((touched + offset).T)]
    return touched[whole]
