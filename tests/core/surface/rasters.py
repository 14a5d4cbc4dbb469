"""Rasters of a surface whose heights are given."""

from pathlib import Path

import numpy as np
import rasterio

from core.raster.grid import Grid, tiled_profile
from core.surface.ground import NODATA_M
from core.surface.stage import SurfaceFiles

CRS = "EPSG:5514"
WEST, NORTH, CELL_M = -600_000.4, -1_100_000.2, 0.8


def grid_of(heights: np.ndarray) -> Grid:
    """Where the cells of heights lie."""
    return Grid(WEST, NORTH, CELL_M, heights.shape[1], heights.shape[0])


def written(folder: Path, heights: np.ndarray) -> SurfaceFiles:
    """Heights (NaN in holes), with a standard deviation and a count that differ from row to row."""
    files = SurfaceFiles.within(folder)
    known = np.isfinite(heights)
    row = np.arange(heights.shape[0])[:, None]
    sigmas = np.where(known, 0.1 + row / 10_000, NODATA_M).astype(np.float32)
    counts = np.where(known, 1 + row % 5, 0).astype(np.uint8)
    values = np.nan_to_num(heights, nan=NODATA_M).astype(np.float32)
    grid = grid_of(heights)
    for path, band, nodata in (
        (files.surface, values, NODATA_M),
        (files.sigma, sigmas, NODATA_M),
        (files.count, counts, 0),
    ):
        profile = tiled_profile(grid, CRS, str(band.dtype)) | {"nodata": nodata}
        with rasterio.open(path, "w", **profile) as out:
            out.write(band, 1)
    return files
