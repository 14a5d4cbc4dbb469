"""Two rasters seen on one grid, whatever their pixels, bands and CRS are."""

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import rasterio
from affine import Affine
from jaxtyping import Bool, Float32
from rasterio.enums import Resampling
from rasterio.vrt import WarpedVRT
from rasterio.warp import transform_bounds

from core.errors import CrsError, ReferenceDataError
from core.raster.grid import Grid
from core.raster.tiles import Tile, window_of

LUMA = np.array([0.299, 0.587, 0.114], dtype=np.float32)
"""Weights of red, green, blue in gray."""


@dataclass(frozen=True, slots=True, eq=False)
class GrayPatch:
    """Part of a raster on the common grid."""

    values: Float32[np.ndarray, "rows columns"]
    """Gray values; 0 where nothing is seen."""
    seen: Bool[np.ndarray, "rows columns"]
    """Where the raster shows something."""


class CommonView:
    """A product and a truth, read by windows on the coarser one's pixel size.

    The grid lies on the pixels of the coarser raster, so that one is not interpolated at all and
    the finer one is smoothed by GDAL's cubic kernel, which is symmetric and moves nothing.
    """

    def __init__(
        self, product: Path, truth: Path, ground_sample_distance_m: float | None = None
    ) -> None:
        self._stack = ExitStack()
        files: list[Any] = [self._stack.enter_context(rasterio.open(p)) for p in (product, truth)]
        if files[0].crs is None or files[1].crs is None:
            self._stack.close()
            missing = product if files[0].crs is None else truth
            raise CrsError(missing, "It has no CRS.", "Write one with gdal_edit.py -a_srs.")
        crs = files[0].crs
        bounds = [file.bounds for file in files]
        if files[1].crs != crs:
            bounds[1] = transform_bounds(files[1].crs, crs, *bounds[1])
        sizes = [(b[2] - b[0]) / file.width for b, file in zip(bounds, files, strict=True)]
        coarser = int(sizes[1] > sizes[0])
        gsd = ground_sample_distance_m or float(sizes[coarser])
        common = (
            *(max(a, b) for a, b in zip(bounds[0][:2], bounds[1][:2], strict=True)),
            *(min(a, b) for a, b in zip(bounds[0][2:], bounds[1][2:], strict=True)),
        )
        if common[0] + gsd >= common[2] or common[1] + gsd >= common[3]:
            self._stack.close()
            raise ReferenceDataError(
                product, f"It has no area in common with {truth}.", "Check the CRS of both."
            )
        self.grid = _grid_on(common, gsd, bounds[coarser][0], bounds[coarser][3])
        self._files, self._crs = files, crs
        self._views = [
            self._stack.enter_context(self._on(file, self.grid, Resampling.cubic)) for file in files
        ]

    def __enter__(self) -> "CommonView":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.close()

    def whole(self, reduction: int) -> tuple[GrayPatch, GrayPatch]:
        """Both rasters in small: means over `reduction` pixels of the grid a side."""
        grid = self.grid
        step = grid.ground_sample_distance_m * reduction
        small = Grid(grid.west, grid.north, step, grid.columns // reduction, grid.rows // reduction)
        tile = (0, 0, small.columns, small.rows)
        method = Resampling.average if reduction > 1 else Resampling.cubic
        patches: list[GrayPatch] = []
        for file in self._files:
            with self._on(file, small, method) as view:
                patches.append(_gray(view, tile))
        return patches[0], patches[1]

    def window(self, tile: Tile) -> tuple[GrayPatch, GrayPatch]:
        """A window of both rasters on the grid."""
        return _gray(self._views[0], tile), _gray(self._views[1], tile)

    def _on(self, file: Any, grid: Grid, method: Resampling) -> Any:
        return WarpedVRT(
            file,
            crs=self._crs,
            transform=Affine.from_gdal(*grid.geotransform),
            width=grid.columns,
            height=grid.rows,
            resampling=method,
            # Nought would be refused by GDAL; this keeps its transformer exact to 0.001 px.
            tolerance=1e-3,
        )


def _gray(view: Any, tile: Tile) -> GrayPatch:
    bands = [1, 2, 3] if view.count >= 3 else [1]
    values = view.read(bands, window=window_of(tile), out_dtype="float32")
    seen = view.dataset_mask(window=window_of(tile)) > 0
    gray = np.einsum("b,bij->ij", LUMA, values) if len(bands) == 3 else values[0]
    return GrayPatch(np.where(seen, gray, np.float32(0)).astype(np.float32), seen)


def _grid_on(common: tuple[float, ...], gsd: float, west: float, north: float) -> Grid:
    """Grid inside the common bounds whose pixels coincide with those from a given corner."""
    first_column = np.ceil((common[0] - west) / gsd - 1e-6)
    first_row = np.ceil((north - common[3]) / gsd - 1e-6)
    columns = np.floor((common[2] - west) / gsd + 1e-6) - first_column
    rows = np.floor((north - common[1]) / gsd + 1e-6) - first_row
    return Grid(
        float(west + first_column * gsd),
        float(north - first_row * gsd),
        gsd,
        int(columns),
        int(rows),
    )
