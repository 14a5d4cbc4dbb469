"""Values anywhere between the cells of a lattice: separable where axes agree, warped where not."""

from dataclasses import dataclass
from typing import Any, Literal, cast

import cv2
import numpy as np
from jaxtyping import Float32, Float64
from scipy.sparse import csr_array

from core.reference.cells import Cells

Kernel = Literal["cubic", "linear"]
RADIUS: dict[str, float] = {"cubic": 2.0, "linear": 1.0}
"""Reach of a kernel on either side, source cells, at no reduction."""


@dataclass(frozen=True, slots=True, eq=False)
class Sampled:
    """Values on a target raster."""

    values: Float32[np.ndarray, "bands rows columns"]
    """Resampled values; meaningless where the coverage is nought."""
    coverage: Float32[np.ndarray, "rows columns"]
    """Share of the kernel that found usable cells, 0 to 1."""


def sample_separable(
    cells: Cells,
    columns: Float64[np.ndarray, "width"],
    rows: Float64[np.ndarray, "height"],
    scale: tuple[float, float],
    kernel: Kernel,
) -> Sampled:
    """Values where source columns and source rows cross.

    Args:
        cells: Source cells; their margin holds the kernel's reach.
        columns: Source column of every target column (corner origin).
        rows: Source row of every target row (corner origin).
        scale: Source cells per target pixel across and down; above 1 the kernel is widened by
            it, which keeps patterns finer than the target from aliasing.
        kernel: `cubic` (Keys, a = -1/2, the one GDAL uses) or `linear`.
    """
    height, width = cells.weight.shape
    across = _weights(columns, width, scale[0], kernel)
    down = _weights(rows, height, scale[1], kernel)
    reach = int(np.ceil(RADIUS[kernel] * max(1.0, *scale))) + 1
    filled = _filled(cells, reach)
    values = np.stack([_apply(down, band, across) for band in filled])
    if cells.weight.min() >= 1:
        return Sampled(values, np.ones(values.shape[1:], dtype=np.float32))
    smooth = (
        _weights(rows, height, scale[1], "linear"),
        _weights(columns, width, scale[0], "linear"),
    )
    return Sampled(values, np.clip(_apply(smooth[0], cells.weight, smooth[1]), 0, 1))


def sample_warped(
    cells: Cells,
    columns: Float32[np.ndarray, "height width"],
    rows: Float32[np.ndarray, "height width"],
    scale: float,
    kernel: Kernel,
) -> Sampled:
    """Values at any source places; good to 1/64 of a cell, OpenCV's step.

    Args:
        cells: Source cells with margin.
        columns: Source column of every target pixel (corner origin).
        rows: Source row of every target pixel (corner origin).
        scale: Source cells per target pixel; above 1 the source is smoothed first.
        kernel: `cubic` or `linear`.
    """
    filled, weight = _filled(cells, 3), cells.weight
    if scale > 1:
        # What is missing to the width of a target pixel, a source cell being one wide.
        sigma = 0.5 * float(np.sqrt(scale**2 - 1))
        filled = np.stack([cv2.GaussianBlur(band, (0, 0), sigma) for band in filled])
        weight = cv2.GaussianBlur(weight, (0, 0), sigma)
    flag = cv2.INTER_CUBIC if kernel == "cubic" else cv2.INTER_LINEAR
    # OpenCV counts from the centre of the first cell.
    across, down = columns - np.float32(0.5), rows - np.float32(0.5)
    edge: dict[str, Any] = {"borderMode": cv2.BORDER_REPLICATE}
    values = np.stack([cv2.remap(band, across, down, flag, **edge) for band in filled])
    coverage = cv2.remap(weight, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    return Sampled(values, np.clip(coverage, 0, 1))


def _weights(
    places: Float64[np.ndarray, "target"], source: int, scale: float, kernel: Kernel
) -> csr_array:
    """Sparse matrix (target, source) of kernel weights, rows adding up to one."""
    widening = max(1.0, scale)
    radius = RADIUS[kernel] * widening
    first = np.ceil(places - 0.5 - radius).astype(np.int64)
    taps = first[:, None] + np.arange(int(np.ceil(2 * radius)) + 1)
    distance = np.abs(taps + 0.5 - places[:, None]) / widening
    weight = _cubic(distance) if kernel == "cubic" else np.maximum(0, 1 - distance)
    weight /= weight.sum(axis=1, keepdims=True)
    begin = np.arange(len(places) + 1) * taps.shape[1]
    columns = np.clip(taps, 0, source - 1).ravel()
    matrix = csr_array(
        (weight.astype(np.float32).ravel(), columns, begin), shape=(len(places), source)
    )
    matrix.sum_duplicates()
    matrix.eliminate_zeros()
    return matrix


def _cubic(t: Float64[np.ndarray, "*shape"]) -> Float64[np.ndarray, "*shape"]:
    """Keys' cubic convolution with a = -1/2, of the distance t >= 0."""
    near = (1.5 * t - 2.5) * t * t + 1
    far = ((-0.5 * t + 2.5) * t - 4) * t + 2
    return np.where(t < 1, near, np.where(t < 2, far, 0.0))


def _apply(
    down: csr_array, band: Float32[np.ndarray, "rows columns"], across: csr_array
) -> Float32[np.ndarray, "height width"]:
    """Product down @ band @ across', the shorter product first."""
    height = cast(tuple[int, int], down.shape)[0]
    if height <= band.shape[0]:
        return np.ascontiguousarray((across @ np.ascontiguousarray((down @ band).T)).T)
    return np.ascontiguousarray(down @ np.ascontiguousarray((across @ band.T).T))


def _filled(cells: Cells, reach: int) -> Float32[np.ndarray, "bands rows columns"]:
    """Cells without value get the mean of their neighbours, so that no kernel drags in a nought."""
    if cells.weight.min() > 0:
        return cells.values
    window = (2 * reach + 1, 2 * reach + 1)
    weight = cv2.boxFilter(cells.weight, -1, window, normalize=False)
    filled = cells.values.copy()
    hole = (cells.weight == 0) & (weight > 1e-6)
    for band in filled:
        sums = cv2.boxFilter(band * cells.weight, -1, window, normalize=False)
        band[hole] = sums[hole] / weight[hole]
    return filled
