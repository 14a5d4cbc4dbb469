"""Tones drawn together across seams: low frequencies widely, detail not at all.

What neighbours show differently is split into bands by means over windows of growing width (Burt
and Adelson 1983), and each band fades from one photo into the next over its own width. The finest
is as wide as detail, which only the feather blends: nothing is shown twice. All sums are of whole
numbers in cells that count from (0, 0) of the CRS, so a pixel gets the same correction in whatever
tile it lies.
"""

from collections.abc import Mapping

import cv2
import numpy as np
from jaxtyping import Float32, Float64, Int32

from core.mosaic.layers import OrthoFiles
from core.raster.grid import NODATA, Grid, sums_over_cells

# design: less than the feather
CELL_PX = 4
"""Side of the cells in which tones are compared, pixels."""
# design: each some twice as wide as the one before; an eye sees no slope over a hundred pixels
WINDOWS = (3, 7, 17)
"""Sides of the windows of the bands, cells; each mean is taken twice."""
REACH_PX = 2 * CELL_PX * WINDOWS[-1]
"""Further from a pixel than this nothing changes its correction, pixels."""
# design: tones are balanced to a few gray values; what differs by more is other ground
MOST = 16.0
"""Differences beyond this count as this, gray values of 255."""
# design: sums of so fine steps are exact in single precision, and no step is seen
STEPS = 64
"""Steps of a correction in a gray value of 255."""
# design: a mean of fewer would follow single details
LEAST_SHARE = 0.125
"""Corrections fade out where both photos show less than this share of a window."""

Whole = Float64[np.ndarray, "rows columns"]
"""Whole numbers in double precision, whose sums are exact."""


def cells_about(grid: Grid, part: Grid) -> tuple[Grid, Grid, tuple[int, int]]:
    """The cells that decide on the corrections of a part of a mosaic.

    Args:
        grid: The mosaic.
        part: A window of it.

    Returns:
        The cells, the pixels of the same ground, and the part's first column and row in these.
    """
    gsd, origin = grid.ground_sample_distance_m, grid.on_multiples or (0, 0)
    corner = grid.grid_from_object(np.array([[part.west, part.north]]))[0]
    column, row = (round(float(value)) for value in corner)
    left, top = (
        place - REACH_PX - (start + place - REACH_PX) % CELL_PX
        for start, place in zip(origin, (column, row), strict=True)
    )
    columns, rows = (
        -(-(place + size + REACH_PX - first) // CELL_PX)
        for first, place, size in ((left, column, part.columns), (top, row, part.rows))
    )
    pixels = grid.window(left, top, columns * CELL_PX, rows * CELL_PX)
    cells = Grid(pixels.west, pixels.north, gsd * CELL_PX, columns, rows)
    return cells, pixels, (column - left, row - top)


def tone_corrections(
    files: OrthoFiles,
    labels: Int32[np.ndarray, "rows columns"],
    cells: Grid,
    pixels: Grid,
    band: int = 0,
) -> Mapping[int, Float32[np.ndarray, "rows columns"]]:
    """What is added to the balanced grays of each photo, by cell.

    Args:
        files: The orthos.
        labels: Index of the ortho that the seams give each cell, -1 for none.
        cells: Where the cells lie.
        pixels: The pixels of the same ground.
        band: Which band, counted from 0.
    """
    present = np.unique(labels[labels >= 0]).tolist()
    step = (int(np.iinfo(files.dtype).max) + 1) / 256 / STEPS
    tones = {index: _tones(files, index, (cells, pixels), step, band) for index in present}
    shares = [_shares(labels, present, side) for side in WINDOWS]
    total = {index: np.zeros(labels.shape) for index in present}
    for place, one in enumerate(present):
        for other in present[:place]:
            apart, both = _apart(tones[one], tones[other])
            finer: Whole | None = None
            for share, side in zip(shares[::-1], WINDOWS[::-1], strict=True):
                least = LEAST_SHARE * side**4
                mean = _sums(apart, side) / np.maximum(_sums(both, side), least)
                octave = mean if finer is None else mean - finer
                # Each is drawn towards what the other shows.
                total[one] += share[other] * octave
                total[other] -= share[one] * octave
                finer = mean
    return {index: (np.rint(total[index]) * step).astype(np.float32) for index in present}


def spread(
    correction: Float32[np.ndarray, "_ _"], part: Grid, corner: tuple[int, int]
) -> Float32[np.ndarray, "_ _"]:
    """A correction by cell at the pixels of a part, between middles of cells linearly."""
    size = (correction.shape[1] * CELL_PX, correction.shape[0] * CELL_PX)
    wide = np.asarray(cv2.resize(correction, size, interpolation=cv2.INTER_LINEAR))
    column, row = corner
    return wide[row : row + part.rows, column : column + part.columns]


def _tones(
    files: OrthoFiles, index: int, grids: tuple[Grid, Grid], step: float, band: int
) -> tuple[Whole, Whole]:
    """Balanced means of a photo in whole steps, and 1 where it shows the whole cell."""
    cells, pixels = grids
    gray = files.read(index, pixels, band)
    means = (sums_over_cells(gray, CELL_PX) / CELL_PX**2).astype(np.float32)
    shown = sums_over_cells((gray != NODATA).view(np.uint8), CELL_PX) == CELL_PX**2
    balance = files.balances[files.orthos[index].photo_id].of_band(band)
    return np.rint(balance.corrected(means, cells) / step).astype(np.float64), shown.astype(
        np.float64
    )


def _apart(one: tuple[Whole, Whole], other: tuple[Whole, Whole]) -> tuple[Whole, Whole]:
    """What the other shows more than the one, and 1 where both show the whole cell."""
    both = one[1] * other[1]
    return np.clip(other[0] - one[0], -MOST * STEPS, MOST * STEPS) * both, both


def _shares(
    labels: Int32[np.ndarray, "rows columns"], present: list[int], side: int
) -> Mapping[int, Whole]:
    """Shares of each photo in a window about each cell, adding up to one."""
    sums = {index: _sums((labels == index).astype(np.float64), side) for index in present}
    whole = np.maximum(sum(sums.values(), np.zeros(labels.shape)), 1)
    return {index: found / whole for index, found in sums.items()}


def _sums(values: Whole, side: int) -> Whole:
    """Sums over windows, taken twice, which fall off evenly to all sides."""
    once = cv2.boxFilter(values, -1, (side, side), normalize=False, borderType=cv2.BORDER_CONSTANT)
    twice = cv2.boxFilter(once, -1, (side, side), normalize=False, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(twice)
