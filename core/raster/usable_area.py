"""Which part of a scan is photograph, kept small: a packed mask of cells, and scratches."""

import zlib
from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from core.arrays import Flags, Indices, Mask, PixelPoints, locked

SCRATCH_PX = 3.0
"""What is no farther than this from a scratch is not used, pixels."""


@dataclass(frozen=True, slots=True)
class Scratch:
    """A thin line along the film that is no part of the picture."""

    axis: int
    """0 when it runs along the rows of the scan, 1 along its columns."""
    first: float
    """Column (of axis 1, row) of its beginning, pixels."""
    last: float
    """The same of its end."""
    course: tuple[float, float, float]
    """Its row (of axis 1, column): the factors of the square, of the column, and the constant."""

    def near(self, pixels: PixelPoints, reach_px: float) -> Flags:
        """Which pixels lie no farther from it."""
        along, across = pixels[:, self.axis], pixels[:, 1 - self.axis]
        beside = np.abs(across - np.polyval(self.course, along)) <= reach_px
        return beside & (along >= self.first - reach_px) & (along <= self.last + reach_px)


@dataclass(frozen=True, slots=True, eq=False)
class UsableArea:
    """True where a scan may be used, in cells of equal size that cover the whole scan."""

    size_px: tuple[int, int]
    """Columns and rows of the scan."""
    shape: tuple[int, int]
    """Rows and columns of cells."""
    packed: UInt8[np.ndarray, "n"]
    """The cells as bits, row by row, deflated."""
    scratches: tuple[Scratch, ...] = ()
    """Lines that are left out, thinner than a cell."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "packed", locked(self.packed, np.uint8))

    @staticmethod
    def of(
        mask: Mask, size_px: tuple[int, int], scratches: tuple[Scratch, ...] = ()
    ) -> "UsableArea":
        """A mask of any resolution that covers the whole scan."""
        rows, columns = mask.shape
        deflated = zlib.compress(np.packbits(mask).tobytes())
        return UsableArea(size_px, (rows, columns), np.frombuffer(deflated, np.uint8), scratches)

    @property
    def mask(self) -> Mask:
        """The cells; unpacked anew each time, so that a thousand scans need no room."""
        bits = np.frombuffer(zlib.decompress(self.packed.tobytes()), np.uint8)
        count = self.shape[0] * self.shape[1]
        return np.unpackbits(bits, count=count).astype(bool).reshape(self.shape)

    def at(self, pixels: PixelPoints) -> Flags:
        """Whether scan pixels may be used; none outside the scan, nor where there is no number."""
        places = np.where(np.isfinite(pixels), pixels, -1.0)
        column, across = self._cells(places[:, 0], 0)
        row, down = self._cells(places[:, 1], 1)
        usable = across & down & self.mask[row, column]
        for scratch in self.scratches:
            usable &= ~scratch.near(places, SCRATCH_PX)
        return usable

    def within(self, column: int, row: int, columns: int, rows: int, reduction: int) -> Mask:
        """The same for all pixels of a window of the reduced scan that begins at a scan pixel.

        Asked by what looks at areas, such as templates, to which a scratch matters little.
        """
        cells, across = self._cells(column + (np.arange(columns) + 0.5) * reduction, 0)
        lines, down = self._cells(row + (np.arange(rows) + 0.5) * reduction, 1)
        return self.mask[np.ix_(lines, cells)] & np.outer(down, across)

    def _cells(self, places: np.ndarray, axis: int) -> tuple[Indices, Flags]:
        """Cells of scan columns (axis 0) or rows (1), and which of them lie in the scan."""
        count = self.shape[1 - axis]
        cells = np.floor(places * (count / self.size_px[axis])).astype(np.int64)
        return np.clip(cells, 0, count - 1), (cells >= 0) & (cells < count)
