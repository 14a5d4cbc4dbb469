"""Several orthophoto sheets as one: read onto any grid, edges invisible, every pixel once."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float32, UInt8

from core.arrays import Mask, locked
from core.doubts import Doubt
from core.geometry.crs import Bounds, parse_crs
from core.geometry.grid import Grid
from core.reference.composite import ReadOptions, read_onto
from core.reference.sheets import SheetSet, open_sheets

LEAST_COVERAGE = 0.5
"""A pixel is usable when the sheets fill at least this share of it."""
PIECE_PX = 512
"""Pieces that are remembered have this edge, pixels of the grid they are read on."""
MOST_PIECES = 240
"""Pieces kept in memory: 315 MB."""

PieceKey = tuple[float, int, int]
"""Pixel size, and column and row of a piece on the lattice of that pixel size."""


@dataclass(frozen=True, slots=True, eq=False)
class OrthoPatch:
    """The ortho on a grid."""

    values: Float32[np.ndarray, "rows columns"]
    """Gray (luminance) in the sheets' own units, 0 where there is none."""
    mask: Mask
    """True where the ortho has a value."""


@dataclass(frozen=True, slots=True, eq=False)
class Ortho:
    """The reference ortho; it holds no open file, so it may be pickled and shared by threads."""

    sheets: SheetSet
    """The files and how they lie together."""
    recent: dict[PieceKey, OrthoPatch] = field(
        default_factory=dict[PieceKey, OrthoPatch], repr=False
    )
    """Pieces that were read lately: a memory that changes no answer."""

    def __reduce__(self) -> tuple[type["Ortho"], tuple[SheetSet]]:
        """A copy in another process reads its own pieces."""
        return Ortho, (self.sheets,)

    @property
    def bounds(self) -> Bounds:
        """West, south, east, north over all sheets, metres."""
        return self.sheets.bounds

    @property
    def ground_sample_distance_m(self) -> float:
        """Pixel size of the finest sheets, metres."""
        return self.sheets.lattices[0].ground_sample_distance_m

    @property
    def notes(self) -> tuple[Doubt, ...]:
        """What the operator should know, such as sheets reprojected on the fly."""
        return self.sheets.notes

    def read(self, grid: Grid) -> OrthoPatch:
        """Gray values on a grid, cubic and anti-aliased.

        Up to ten times the pixel size of the sheets every original pixel is read; coarser grids
        may use the files' overviews, which can lie up to half a grid pixel aside.
        """
        sampled = read_onto(self.sheets, grid, ReadOptions("gray"))
        mask = sampled.coverage >= LEAST_COVERAGE
        return OrthoPatch(np.where(mask, sampled.values[0], np.float32(0)), mask)

    def read_again(self, grid: Grid) -> OrthoPatch:
        """As `read`, for grids that are wanted over and over: in pieces, which are remembered.

        Args:
            grid: A grid on multiples of its pixel size, such as `Grid.over` makes.
        """
        gsd = grid.ground_sample_distance_m
        west, north = round(grid.west / gsd), round(-grid.north / gsd)
        values = np.zeros((grid.rows, grid.columns), dtype=np.float32)
        mask = np.zeros((grid.rows, grid.columns), dtype=bool)
        for row in range(north // PIECE_PX, -(-(north + grid.rows) // PIECE_PX)):
            for column in range(west // PIECE_PX, -(-(west + grid.columns) // PIECE_PX)):
                piece = self._piece((gsd, column, row))
                left, top = column * PIECE_PX - west, row * PIECE_PX - north
                across = slice(max(left, 0), min(left + PIECE_PX, grid.columns))
                down = slice(max(top, 0), min(top + PIECE_PX, grid.rows))
                own = np.s_[
                    down.start - top : down.stop - top, across.start - left : across.stop - left
                ]
                values[down, across], mask[down, across] = piece.values[own], piece.mask[own]
        return OrthoPatch(values, mask)

    def _piece(self, key: PieceKey) -> OrthoPatch:
        """A square piece, kept for the next question."""
        held = self.recent.get(key)
        if held is None:
            gsd, column, row = key
            grid = Grid(column * PIECE_PX * gsd, -row * PIECE_PX * gsd, gsd, PIECE_PX, PIECE_PX)
            read = self.read(grid)
            held = OrthoPatch(locked(read.values, np.float32), locked(read.mask, bool))
        # Another thread may add or drop pieces meanwhile; at worst one is read twice.
        self.recent.pop(key, None)
        for old in list(self.recent)[: max(0, len(self.recent) - MOST_PIECES + 1)]:
            self.recent.pop(old, None)
        self.recent[key] = held
        return held

    def read_coverage(self, grid: Grid) -> Float32[np.ndarray, "rows columns"]:
        """Share of each grid pixel that the sheets fill, 0 to 1; overviews are used."""
        return read_onto(self.sheets, grid, ReadOptions("gray", exact_to=2)).coverage

    def read_colour(self, grid: Grid) -> UInt8[np.ndarray, "rows columns 3"]:
        """Red, green and blue on a grid, for showing: overviews are used; black where none."""
        sampled = read_onto(self.sheets, grid, ReadOptions("colour", exact_to=2))
        mask = sampled.coverage >= LEAST_COVERAGE
        values = np.where(mask, np.clip(np.rint(sampled.values), 0, 255), 0)
        return np.ascontiguousarray(np.moveaxis(values, 0, -1)).astype(np.uint8)


def open_ortho(paths: Sequence[str | Path], crs: str) -> Ortho:
    """Look at the sheets once and lay them together.

    Args:
        paths: Sheets of any raster format, pixel size and CRS.
        crs: The block's CRS; sheets without one are taken to be in it, sheets in another are
            reprojected while reading, which `notes` tells.

    Raises:
        ReferenceDataError: A file is missing, damaged or has no place on the ground.
        CrsError: A file's coordinates do not fit its CRS, or no CRS can be found for it.
    """
    block = parse_crs(crs, "block.toml [block] crs")
    return Ortho(open_sheets(paths, block, "ortho", collars=True))
