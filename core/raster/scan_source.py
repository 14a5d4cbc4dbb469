"""A scan's pixels for resampling: reduced by whole numbers, in memory where it fits."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from core.raster.scan_file import ScanFile, open_scan, read_window
from core.raster.tiles import Pixels

STRIP_ROWS = 1024


class ScanSource:
    """Windows of one scan, averaged over `reduction` pixels a side, in the type of the scan.

    A scan is read once from end to end where it fits the budget: film scans come in strips as
    often as in tiles, and a turned photo would have every strip decoded for every ortho tile.
    """

    def __init__(self, path: Path, reduction: int, threads: int, budget_bytes: int) -> None:
        self.scan: ScanFile = open_scan(path)
        self.reduction = reduction
        self.dtype = np.dtype(self.scan.dtype)
        columns, rows = (-(-size // reduction) for size in self.scan.size_px)
        fits = columns * rows * self.dtype.itemsize <= budget_bytes
        self._whole: Pixels | None = self._read_whole(columns, rows, threads) if fits else None

    def window(self, column: int, row: int, columns: int, rows: int) -> Pixels:
        """A window counted in reduced pixels; edge values go on outside the scan."""
        if self._whole is not None:
            return self._whole[row : row + rows, column : column + columns]
        return self._read(column, row, columns, rows)

    def _read_whole(self, columns: int, rows: int, threads: int) -> Pixels:
        whole = np.empty((rows, columns), dtype=self.dtype)

        def read(start: int) -> None:
            end = min(start + STRIP_ROWS, rows)
            whole[start:end] = self._read(0, start, columns, end - start)

        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(read, range(0, rows, STRIP_ROWS)))
        return whole

    def _read(self, column: int, row: int, columns: int, rows: int) -> Pixels:
        step = self.reduction
        values = read_window(
            self.scan, column * step, row * step, columns * step, rows * step, step, "edge"
        )
        np.rint(values, out=values)
        return values.astype(self.dtype)
