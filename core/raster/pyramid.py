"""A lattice in cells of 1, 2, 4 ... pixels a side: every original pixel is decoded once.

Cells are cut on the lattice, not on the sheets: a cell across a sheet edge averages the pixels of
both neighbours, each pixel once. Where sheets overlap the first one is taken. Levels are kept in
tiles that all readers share; a tile is made from the four below it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Shaped
from rasterio.enums import Resampling

from core.raster.cache import TILES
from core.raster.lattices import Lattice
from core.raster.sheets import Sheet, sheet_file

Content = Literal["gray", "colour", "heights"]
BANDS: dict[Content, int] = {"gray": 1, "colour": 3, "heights": 1}
LUMINANCE = (0.299, 0.587, 0.114)
"""Weights of red, green and blue in gray."""
# source: Rec. ITU-R BT.601-7, section 2.5.1
TILE_CELLS = 512
"""Side of a tile, cells."""
# design: one megabyte of gray and four blocks of a usual GeoTIFF, a little more than one search.


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """A window of a level."""

    values: Float32[np.ndarray, "bands rows columns"]
    """Mean of the usable pixels of each cell; 0 where there are none."""
    weight: Float32[np.ndarray, "rows columns"]
    """Share of the cell that is usable, 0 to 1."""

    @property
    def nbytes(self) -> int:
        """Memory it takes."""
        return self.values.nbytes + self.weight.nbytes


@dataclass(frozen=True, slots=True)
class CellWindow:
    """Where a window of cells begins on the lattice, in cells, and how large it is."""

    column: int
    """First column, cells."""
    row: int
    """First row, cells."""
    columns: int
    """Width, cells."""
    rows: int
    """Height, cells."""
    size: int
    """Edge of a cell, lattice pixels; a power of two."""


def read_cells(lattice: Lattice, window: CellWindow, content: Content, exact: bool) -> Cells:
    """The lattice's pixels, averaged in cells.

    Args:
        lattice: Sheets on a common raster.
        window: The cells wanted; they may lie anywhere, also beyond all sheets.
        content: Gray (luminance), colour (three bands, 0 to 255) or heights.
        exact: From original pixels, never from overviews.
    """
    values = np.zeros((BANDS[content], window.rows, window.columns), dtype=np.float32)
    weight = np.zeros((window.rows, window.columns), dtype=np.float32)
    for place in _tiles_under(window):
        if not sheets_under(lattice, place):
            continue
        key = (lattice.key, content, exact or place.size == 1, place)
        tile = TILES.get(key, partial(_make_tile, lattice, place, content, exact))
        left, top = place.column - window.column, place.row - window.row
        across = slice(max(left, 0), min(left + TILE_CELLS, window.columns))
        down = slice(max(top, 0), min(top + TILE_CELLS, window.rows))
        own = np.s_[down.start - top : down.stop - top, across.start - left : across.stop - left]
        values[:, down, across], weight[down, across] = tile.values[:, *own], tile.weight[own]
    return Cells(values, weight)


def sheets_under(lattice: Lattice, window: CellWindow) -> list[int]:
    """The sheets that have pixels in the window."""
    size = np.array([(sheet.columns, sheet.rows) for sheet in lattice.sheets])
    low = np.array([window.column, window.row]) * window.size
    high = low + np.array([window.columns, window.rows]) * window.size
    inside = (lattice.offsets < high) & (lattice.offsets + size > low)
    return [int(index) for index in np.flatnonzero(inside.all(axis=1))]


def _tiles_under(window: CellWindow) -> Iterator[CellWindow]:
    """The tiles that hold a window."""
    first, last = window.column // TILE_CELLS, -(-(window.column + window.columns) // TILE_CELLS)
    for row in range(window.row // TILE_CELLS, -(-(window.row + window.rows) // TILE_CELLS)):
        for column in range(first, last):
            corner = (column * TILE_CELLS, row * TILE_CELLS)
            yield CellWindow(*corner, TILE_CELLS, TILE_CELLS, window.size)


def _make_tile(lattice: Lattice, place: CellWindow, content: Content, exact: bool) -> Cells:
    """One tile: from the level below, or from the files."""
    if exact and place.size > 1:
        side, size = 2 * TILE_CELLS, place.size // 2
        below = CellWindow(2 * place.column, 2 * place.row, side, side, size)
        return halve_cells(read_cells(lattice, below, content, exact))
    values = np.zeros((BANDS[content], place.rows, place.columns), dtype=np.float32)
    weight = np.zeros((place.rows, place.columns), dtype=np.float32)
    for index in sheets_under(lattice, place):
        _add(lattice.sheets[index], lattice.offsets[index].tolist(), place, content, values, weight)
    return Cells(values, weight)


def halve_cells(cells: Cells) -> Cells:
    """Cells twice as large; each original pixel counts alike."""
    shape = (cells.weight.shape[1] // 2, cells.weight.shape[0] // 2)
    known = cells.values if cells.weight.min() >= 1 else cells.values * cells.weight
    # By a factor of exactly two this is the mean of four.
    sums = [cv2.resize(band, shape, interpolation=cv2.INTER_AREA) for band in known]
    weight = cv2.resize(cells.weight, shape, interpolation=cv2.INTER_AREA)
    values = np.stack(sums)
    np.divide(values, weight, out=values, where=weight > 0)
    return Cells(values, np.asarray(weight))


def _add(
    sheet: Sheet,
    offset: list[int],
    place: CellWindow,
    content: Content,
    values: Float32[np.ndarray, "bands rows columns"],
    weight: Float32[np.ndarray, "rows columns"],
) -> None:
    """Lay a sheet into the cells that are still empty: its pixels, or means GDAL makes of them."""
    n = place.size
    column, row = place.column * n - offset[0], place.row * n - offset[1]
    # Cells whose middle lies on the sheet; at its rim means are stretched by under half a cell.
    first, above = max(0, _nearest(-column, n)), max(0, _nearest(-row, n))
    last = min(place.columns, _nearest(sheet.columns - column, n))
    below = min(place.rows, _nearest(sheet.rows - row, n))
    if last <= first or below <= above:
        return
    left, top = max(0, column + first * n), max(0, row + above * n)
    right, bottom = min(sheet.columns, column + last * n), min(sheet.rows, row + below * n)
    raw, usable = _read(sheet, (left, top, right, bottom), (below - above, last - first), n == 1)
    cells = (slice(above, below), slice(first, last))
    free = usable & (weight[cells] == 0)
    weight[cells][free] = 1
    values[(slice(None), *cells)] += _content(raw, sheet, content) * free


def _nearest(value: int, size: int) -> int:
    """Value over size to the nearest whole number."""
    return (2 * value + size) // (2 * size)


def _read(
    sheet: Sheet, box: tuple[int, int, int, int], shape: tuple[int, int], whole: bool
) -> tuple[Shaped[np.ndarray, "bands rows columns"], Bool[np.ndarray, "rows columns"]]:
    """Bands of a box (left, top, right, bottom) of a sheet, and which of it is usable.

    Overviews are read only where `whole` is not asked for: those of JPEG 2000 and of nearest
    neighbour lie up to half a cell aside.
    """
    left, top, right, bottom = box
    window = ((top, bottom), (left, right))
    options = {"OVERVIEW_LEVEL": "NONE"} if whole else {}
    with sheet_file(sheet.path, **options) as file:
        raw = file.read(
            list(sheet.bands),
            window=window,
            out_shape=(len(sheet.bands), *shape),
            resampling=Resampling.average,
        )
        usable = np.ones(shape, dtype=bool)
        if sheet.masked:
            usable = file.dataset_mask(window=window, out_shape=shape) > 0
    if raw.dtype.kind == "f":
        usable &= np.isfinite(raw).all(axis=0)
    if sheet.collar is not None:
        rows, columns = (
            np.linspace(start, end, 2 * count + 1)[1::2] / side
            for start, end, count, side in (
                (top, bottom, shape[0], sheet.rows),
                (left, right, shape[1], sheet.columns),
            )
        )
        usable &= ~sheet.collar.within(raw, (rows, columns), whole)
    return raw, usable


def _content(
    raw: Shaped[np.ndarray, "bands rows columns"], sheet: Sheet, content: Content
) -> Float32[np.ndarray, "_ rows columns"]:
    """Gray, colour or heights from the bands of a file; unusable numbers become 0."""
    if raw.dtype.kind == "f":
        raw = np.nan_to_num(raw, nan=0.0, posinf=0.0, neginf=0.0)
    if content == "gray" and len(raw) == 3:
        gray = np.multiply(raw[0], LUMINANCE[0], dtype=np.float32)
        for band, share in zip(raw[1:], LUMINANCE[1:], strict=True):
            gray += np.multiply(band, share, dtype=np.float32)
        return gray[None]
    values = raw.astype(np.float32)
    if content == "heights":
        return values * np.float32(sheet.factor) + np.float32(sheet.addend)
    if content == "colour":
        values *= 255.0 / sheet.white
        return np.repeat(values, 3, axis=0) if len(values) == 1 else values
    return values
