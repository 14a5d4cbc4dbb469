"""Scans for the desk: windows of raster files, each file looked at once."""

import threading
from pathlib import Path

from core.arrays import Raster
from core.raster.scan_file import ScanFile, open_scan, read_window


class ScanFiles:
    """Grey values of windows of scans, by their path; asked from several threads."""

    def __init__(self, folder: Path = Path()) -> None:
        """Paths of scans that are not absolute are counted from `folder`."""
        self._folder = folder
        self._opened: dict[Path, ScanFile] = {}
        self._lock = threading.Lock()

    def __call__(
        self, scan: Path, column: int, row: int, columns: int, rows: int, reduction: int
    ) -> Raster:
        """Grey values of a window, averaged over `reduction` pixels a side."""
        return read_window(self.opened(scan), column, row, columns, rows, reduction, "edge")

    def opened(self, scan: Path) -> ScanFile:
        """A scan by its path, looked at once."""
        with self._lock:
            if scan not in self._opened:
                self._opened[scan] = open_scan(self._folder / scan)
            return self._opened[scan]
