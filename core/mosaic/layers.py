"""The orthos over one part of a mosaic: files that stay open, pixels that are read once."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import local
from typing import Any

import numpy as np
import rasterio
from jaxtyping import Float32

from core.mosaic.radiometry import Balance
from core.orthos.rectification import OrthoProduct
from core.raster.grid import Grid, Pixels, window_of


@dataclass(frozen=True, slots=True)
class Kind:
    """What the pixels of a mosaic are."""

    crs: str
    """The CRS of its orthos."""
    dtype: np.dtype[Any]
    """Their deepest type of values; scans may have 8 and 16 bit."""
    bands: int
    """Bands of the ortho that has most; gray among colours shows the same in each."""


def common_kind(orthos: Sequence[OrthoProduct]) -> Kind:
    """What the mosaic of some orthos is."""
    crs, depths, bands = "", set[np.dtype[Any]](), 1
    for ortho in orthos:
        with rasterio.open(ortho.path) as file:
            crs, bands = file.crs.to_string(), max(bands, file.count)
            depths.add(np.dtype(file.dtypes[0]))
    return Kind(crs, max(depths, key=lambda depth: depth.itemsize), bands)


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

    def read(self, index: int, part: Grid, band: int = 0) -> Pixels:
        """Values of a band of an ortho over a part of the mosaic, 0 outside it.

        Where one band is 0 all are: nothing is shown.
        """
        ortho = self.orthos[index]
        corner = ortho.grid.grid_from_object(np.array([[part.west, part.north]]))[0]
        column, row = (int(value) for value in np.rint(corner))
        first, last = max(column, 0), min(column + part.columns, ortho.grid.columns)
        top, bottom = max(row, 0), min(row + part.rows, ortho.grid.rows)
        values = np.zeros((part.rows, part.columns), dtype=self.dtype)
        if first < last and top < bottom:
            place = np.s_[top - row : bottom - row, first - column : last - column]
            window = window_of((first, top, last - first, bottom - top))
            file = self._file(ortho.path)
            found = file.read(min(band + 1, file.count), window=window)
            values[place] = in_depth(found, self.dtype)
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
    """The orthos over one tile, each band read once when it is first needed."""

    def __init__(self, files: OrthoFiles, part: Grid) -> None:
        self.files, self.part = files, part
        self._read: dict[tuple[int, int], Pixels] = {}
        self.corrections: dict[tuple[int, int], Float32[np.ndarray, "rows columns"]] = {}
        """Beside seams, by ortho and band."""

    def pixels(self, index: int, band: int = 0) -> Pixels:
        """Values of a band of an ortho over the tile, 0 outside it."""
        if (index, band) not in self._read:
            self._read[index, band] = self.files.read(index, self.part, band)
        return self._read[index, band]

    def toned(self, index: int, band: int = 0) -> Float32[np.ndarray, "rows columns"]:
        """The same after the correction of the photo, and that beside seams."""
        balance = self.files.balances[self.files.orthos[index].photo_id].of_band(band)
        values = balance.corrected(self.pixels(index, band).astype(np.float32), self.part)
        if (index, band) in self.corrections:
            values += self.corrections[index, band]
        return values
