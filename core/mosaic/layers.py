"""The orthos over one part of a mosaic: files that stay open, pixels that are read once."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from threading import local
from typing import Any

import numpy as np
import rasterio
from jaxtyping import Float32

from core.mosaic.radiometry import Balance
from core.orthos.rectification import OrthoProduct
from core.raster.grid import Grid, Pixels, window_of


def common_crs_and_depth(orthos: Sequence[OrthoProduct]) -> tuple[str, np.dtype[Any]]:
    """The CRS of orthos, and their deepest type of values; scans may have 8 and 16 bit."""
    crs, depths = "", set[np.dtype[Any]]()
    for ortho in orthos:
        with rasterio.open(ortho.path) as file:
            crs = file.crs.to_string()
            depths.add(np.dtype(file.dtypes[0]))
    return crs, max(depths, key=lambda depth: depth.itemsize)


def in_depth(values: Pixels, depth: np.dtype[Any]) -> Pixels:
    """Gray values with the range of another type; what is seen stays at least 1."""
    if values.dtype == depth:
        return values
    own, wanted = int(np.iinfo(values.dtype).max), int(np.iinfo(depth).max)
    if wanted > own:
        return values.astype(depth) * depth.type(wanted // own)
    return (-(-values.astype(np.int64) // (own // wanted))).astype(depth)


class OrthoFiles:
    """The files of all orthos of a mosaic, opened once by each thread that reads them."""

    def __init__(
        self,
        orthos: Sequence[OrthoProduct],
        balances: Mapping[str, Balance],
        dtype: np.dtype[Any],
    ) -> None:
        self.orthos, self.balances, self.dtype = tuple(orthos), balances, dtype
        self._own = local()
        self._opened: list[Any] = []

    def read(self, index: int, part: Grid) -> Pixels:
        """Gray values of an ortho over a part of the mosaic, 0 outside it."""
        ortho = self.orthos[index]
        corner = ortho.grid.grid_from_object(np.array([[part.west, part.north]]))[0]
        column, row = (int(value) for value in np.rint(corner))
        first, last = max(column, 0), min(column + part.columns, ortho.grid.columns)
        top, bottom = max(row, 0), min(row + part.rows, ortho.grid.rows)
        values = np.zeros((part.rows, part.columns), dtype=self.dtype)
        if first < last and top < bottom:
            place = np.s_[top - row : bottom - row, first - column : last - column]
            window = window_of((first, top, last - first, bottom - top))
            values[place] = in_depth(self._file(ortho.path).read(1, window=window), self.dtype)
        return values

    def close(self) -> None:
        """Close all files of all threads."""
        for file in self._opened:
            file.close()

    def _file(self, path: Path) -> Any:
        """A file as this thread has it open: no two threads may read from one."""
        mine: dict[Path, Any] = self._own.__dict__.setdefault("files", {})
        if path not in mine:
            mine[path] = rasterio.open(path)
            self._opened.append(mine[path])
        return mine[path]


class Layers:
    """The orthos over one tile, each read once when it is first needed."""

    def __init__(self, files: OrthoFiles, part: Grid) -> None:
        self.files, self.part = files, part
        self._read: dict[int, Pixels] = {}
        self.corrections: dict[int, Float32[np.ndarray, "rows columns"]] = {}

    def pixels(self, index: int) -> Pixels:
        """Gray values of an ortho over the tile, 0 outside it."""
        if index not in self._read:
            self._read[index] = self.files.read(index, self.part)
        return self._read[index]

    def toned(self, index: int) -> Float32[np.ndarray, "rows columns"]:
        """Gray values after the correction of the photo, and that beside seams."""
        balance = self.files.balances[self.files.orthos[index].photo_id]
        values = balance.corrected(self.pixels(index).astype(np.float32), self.part)
        if index in self.corrections:
            values += self.corrections[index]
        return values
