"""Shapes burnt into the cells of a grid."""

from collections.abc import Iterable
from threading import Lock

import numpy as np
import rasterio.features
from affine import Affine
from jaxtyping import Int32
from shapely.geometry.base import BaseGeometry

from core.raster.grid import Grid

RASTERIZING = Lock()
"""rasterio silences a warning of its own while it rasterizes, which is one thread's business."""


def burn(
    shapes: Iterable[tuple[BaseGeometry, int]], grid: Grid, *, empty: int, touched: bool = False
) -> Int32[np.ndarray, "rows columns"]:
    """The number of the last shape in each cell.

    Args:
        shapes: Shapes in the block's CRS, each with its number.
        grid: The cells.
        empty: What stands where there is none.
        touched: Whether a cell counts that a shape only touches; else its middle must lie inside.
    """
    kept = [(shape, number) for shape, number in shapes if not shape.is_empty]
    if not kept:
        return np.full((grid.rows, grid.columns), empty, dtype=np.int32)
    transform = Affine.from_gdal(*grid.geotransform)
    with RASTERIZING:
        burnt = rasterio.features.rasterize(
            kept,
            (grid.rows, grid.columns),
            empty,
            transform=transform,
            all_touched=touched,
            dtype="int32",
        )
    return np.asarray(burnt, dtype=np.int32)
