"""Several orthophoto sheets as one: read onto any grid, edges invisible, every pixel once."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float32, Float64, UInt8

from core.arrays import Mask
from core.doubts import Doubt
from core.geometry.crs import Bounds, parse_crs
from core.raster.grid import Grid
from core.raster.lattices import SheetSet, laid_over, no_sheets, open_sheets
from core.raster.sampling import ReadOptions, read_kept, read_onto

# design: the majority.
LEAST_COVERAGE = 0.5
"""A pixel is usable when the sheets fill at least this share of it."""
# design: half a cell aside does not show on a screen.
COARSE_TO = 2
"""Beyond this reduction overviews serve for showing, and for what is covered."""
# design: a screen; whatever is finer asks the scans.
SCREEN_PX = 2000
"""An ortho that is not there counts as having so many pixels along its longer side."""


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

    @property
    def bounds(self) -> Bounds:
        """West, south, east, north over all sheets, metres."""
        return self.sheets.bounds

    @property
    def is_there(self) -> bool:
        """False where the block has no reference ortho; it is then black everywhere."""
        return bool(self.sheets.lattices)

    @property
    def ground_sample_distance_m(self) -> float:
        """Pixel size of the finest sheets, metres; of none, that of a picture on a screen."""
        if not self.is_there:
            west, south, east, north = self.bounds
            return max(east - west, north - south) / SCREEN_PX
        return self.sheets.finest.ground_sample_distance_m

    @property
    def notes(self) -> tuple[Doubt, ...]:
        """What the operator should know, such as sheets reprojected on the fly."""
        return self.sheets.notes

    def read(self, grid: Grid) -> OrthoPatch:
        """Gray values on a grid, cubic and anti-aliased.

        Up to ten times the pixel size of the sheets every original pixel is read; coarser grids
        may use the files' overviews, which can lie up to half a grid pixel aside.
        """
        sampled = read_kept(self.sheets, grid, ReadOptions("gray"))
        mask = sampled.coverage >= LEAST_COVERAGE
        return OrthoPatch(np.where(mask, sampled.values[0], np.float32(0)), mask)

    def read_coverage(self, grid: Grid) -> Float32[np.ndarray, "rows columns"]:
        """Share of each grid pixel that the sheets fill, 0 to 1; overviews are used."""
        return read_onto(self.sheets, grid, ReadOptions("gray", exact_to=COARSE_TO)).coverage

    def shows(self, plan: Float64[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
        """Whether there is a pixel at each place, easting and northing."""
        gsd = self.ground_sample_distance_m
        pixels = [Grid(x - gsd / 2, y + gsd / 2, gsd, 1, 1) for x, y in plan.tolist()]
        shares = [self.read_coverage(pixel)[0, 0] for pixel in pixels]
        return np.array(shares, dtype=np.float64) >= LEAST_COVERAGE

    def read_colour(self, grid: Grid) -> UInt8[np.ndarray, "rows columns 3"]:
        """Red, green and blue on a grid, for showing: overviews are used; black where none."""
        options = ReadOptions("colour", exact_to=COARSE_TO, over_joins=False)
        sampled = read_onto(self.sheets, grid, options)
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
    return Ortho(open_sheets(paths, block, "ortho"))


def orthos_laid_over(orthos: Sequence[Ortho]) -> Ortho:
    """Orthos of one CRS as one: each shows where those before it have nothing."""
    return Ortho(laid_over([ortho.sheets for ortho in orthos]))


def no_ortho(crs: str, bounds: Bounds) -> Ortho:
    """The ortho of a block that has none: black over bounds (west, south, east, north, metres)."""
    return Ortho(no_sheets(crs, bounds))
