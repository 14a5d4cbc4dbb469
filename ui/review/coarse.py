"""The reference ortho small, read once in the background: sheets without overviews are slow."""

import threading
from dataclasses import dataclass, field

import cv2
import numpy as np

from core.frames import HALF_PIXEL
from core.raster.grid import Grid
from ui.review.tiles import Colour, OrthoSource

LONGEST_PX = 3072
"""Longer side of the small ortho, pixels."""
STRIPS = 24
"""It is read in so many strips from north to south; each can be shown at once."""


@dataclass(eq=False)
class CoarseOrtho:
    """An ortho that answers for coarse grids from memory and for fine ones from its files."""

    ortho: OrthoSource
    """The files."""
    longest_px: int = LONGEST_PX
    """Longer side of what is kept."""
    _halves: list[Colour] = field(default_factory=list[Colour])
    _rows_read: int = 0
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        west, south, east, north = self.ortho.bounds
        longer = max(east - west, north - south)
        pixel = max(longer / self.longest_px, 2 * self.ortho.ground_sample_distance_m)
        self.grid = Grid.over(self.ortho.bounds, pixel)
        self._whole = np.zeros((self.grid.rows, self.grid.columns, 3), np.uint8)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north, metres."""
        return self.ortho.bounds

    @property
    def ground_sample_distance_m(self) -> float:
        """Finest pixel, metres."""
        return self.ortho.ground_sample_distance_m

    def prepare(self) -> None:
        """Read it, strip by strip; a second call waits for the first."""
        with self._lock:
            step = -(-self.grid.rows // STRIPS)
            while self._rows_read < self.grid.rows:
                first = self._rows_read
                rows = min(step, self.grid.rows - first)
                part = self.grid.window(0, first, self.grid.columns, rows)
                self._whole[first : first + rows] = self.ortho.read_colour(part)
                self._rows_read = first + rows
            self._halves = self._halves or _halved(self._whole)

    def ready(self, grid: Grid) -> bool:
        """True when a grid can be answered without reading the files whole."""
        if self._fine(grid):
            return True
        _, bottom = self.grid.grid_from_object(np.array([[grid.bounds[0], grid.bounds[1]]]))[0]
        return self._rows_read >= min(float(bottom), self.grid.rows)

    def read_colour(self, grid: Grid) -> Colour:
        """Colours on a grid, black where there are none."""
        if self._fine(grid) or not self.ready(grid):
            return self.ortho.read_colour(grid)
        ratio = grid.ground_sample_distance_m / self.grid.ground_sample_distance_m
        level = min(int(np.log2(max(ratio, 1.0))), max(len(self._halves) - 1, 0))
        source = self._halves[level] if self._halves else self._whole
        across, down = grid.centres()
        scale = self.grid.ground_sample_distance_m * 2**level
        columns = (across - self.grid.west) / scale - HALF_PIXEL
        rows = (self.grid.north - down) / scale - HALF_PIXEL
        x, y = np.meshgrid(columns.astype(np.float32), rows.astype(np.float32))
        return np.asarray(cv2.remap(source, x, y, cv2.INTER_LINEAR), np.uint8)

    def _fine(self, grid: Grid) -> bool:
        own = self.grid.ground_sample_distance_m
        return grid.ground_sample_distance_m < own * (1 - 1e-6)


def _halved(whole: Colour) -> list[Colour]:
    """The picture and its halves, down to a few pixels."""
    found = [whole]
    while min(found[-1].shape[:2]) > 64:
        rows, columns = (side // 2 for side in found[-1].shape[:2])
        even = found[-1][: 2 * rows, : 2 * columns]
        found.append(
            np.asarray(cv2.resize(even, (columns, rows), interpolation=cv2.INTER_AREA), np.uint8)
        )
    return found
