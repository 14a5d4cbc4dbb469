"""Pixels of a lattice in square cells of n x n, averaged, from whatever sheets lie there.

Cells are cut on the lattice, not on the sheets: a cell across a sheet edge averages the pixels of
both neighbours, each pixel once.
"""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
import rasterio
from jaxtyping import Bool, Float32, Shaped
from rasterio.enums import Resampling

from core.reference.sheets import Lattice, Sheet, damage_told, open_raster

Content = Literal["gray", "colour", "heights"]
RowsColumns = tuple[tuple[int, int], tuple[int, int]]
"""A window as rasterio takes it: first and last row, first and last column."""
LUMINANCE = np.array([0.299, 0.587, 0.114], dtype=np.float32)
"""Weights of red, green and blue in gray, Rec. 601."""
EXACT_TO = 10
"""Up to this reduction every original pixel is read. Overviews are not trusted for measuring:
those of JPEG 2000 and of nearest neighbour lie up to half a cell aside."""


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """A window of reduced pixels."""

    values: Float32[np.ndarray, "bands rows columns"]
    """Mean of the usable pixels of each cell; 0 where there are none."""
    weight: Float32[np.ndarray, "rows columns"]
    """Share of the cell that is usable, 0 to 1."""


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
    """Edge of a cell, lattice pixels."""


def read_cells(lattice: Lattice, window: CellWindow, content: Content, exact: bool) -> Cells:
    """Average the lattice's pixels in cells.

    Args:
        lattice: Sheets on a common raster.
        window: The cells wanted; they may lie anywhere, also beyond all sheets.
        content: Gray (luminance), colour (three bands, 0 to 255) or heights.
        exact: Read original pixels, never overviews.
    """
    bands = 3 if content == "colour" else 1
    total = np.zeros((bands, window.rows, window.columns), dtype=np.float32)
    weight = np.zeros((window.rows, window.columns), dtype=np.float32)
    for index in sheets_under(lattice, window):
        sheet, (column, row) = lattice.sheets[index], lattice.offsets[index]
        place = CellWindow(
            window.column * window.size - int(column),
            window.row * window.size - int(row),
            window.columns,
            window.rows,
            window.size,
        )
        if exact or window.size == 1:
            _add_exact(sheet, place, content, total, weight)
        else:
            _add_reduced(sheet, place, content, total, weight)
    np.divide(total, weight, out=total, where=weight > 0)
    return Cells(total, np.minimum(weight, 1, out=weight))


def sheets_under(lattice: Lattice, window: CellWindow) -> list[int]:
    """The sheets that have pixels in the window."""
    size = np.array([(sheet.columns, sheet.rows) for sheet in lattice.sheets])
    low = np.array([window.column, window.row]) * window.size
    high = low + np.array([window.columns, window.rows]) * window.size
    inside = (lattice.offsets < high) & (lattice.offsets + size > low)
    return [int(index) for index in np.flatnonzero(inside.all(axis=1))]


def _add_exact(
    sheet: Sheet,
    place: CellWindow,
    content: Content,
    total: Float32[np.ndarray, "bands rows columns"],
    weight: Float32[np.ndarray, "rows columns"],
) -> None:
    """Add a sheet's pixels to the sums of the cells; `place` begins in pixels of the sheet."""
    n = place.size
    left, top = max(0, place.column), max(0, place.row)
    right = min(sheet.columns, place.column + place.columns * n)
    bottom = min(sheet.rows, place.row + place.rows * n)
    values, usable = _read_pixels(sheet, (left, top, right - left, bottom - top), content)
    if not usable.all():
        values *= usable
    # The first cell touched, and how many of its pixels lie before the sheet.
    first, above = (left - place.column) // n, (top - place.row) // n
    skipped = ((top - place.row) % n, (left - place.column) % n)
    share = _averaged(usable[None].astype(np.float32), n, skipped)[0]
    cells = (slice(above, above + share.shape[0]), slice(first, first + share.shape[1]))
    # Where sheets overlap the first one stays; where they share a cell they add up to it.
    room = np.minimum(share, 1 - weight[cells])
    scale = np.divide(room, share, out=np.zeros_like(room), where=share > 0)
    total[(slice(None), *cells)] += _averaged(values, n, skipped) * scale
    weight[cells] += room


def _averaged(
    values: Float32[np.ndarray, "bands rows columns"], size: int, skipped: tuple[int, int]
) -> Float32[np.ndarray, "bands _ _"]:
    """Mean over cells, pixels beyond the values counting as nought.

    Args:
        values: Pixels.
        size: Edge of a cell, pixels.
        skipped: Rows and columns of the first cell that lie before the values.
    """
    if size == 1:
        return values
    rows, columns = values.shape[1:]
    above, left = skipped
    below, right = -(rows + above) % size, -(columns + left) % size
    if above or left or below or right:
        values = np.pad(values, ((0, 0), (above, below), (left, right)))
    shape = (values.shape[2] // size, values.shape[1] // size)
    return np.stack([cv2.resize(band, shape, interpolation=cv2.INTER_AREA) for band in values])


def _read_pixels(
    sheet: Sheet, box: tuple[int, int, int, int], content: Content
) -> tuple[Float32[np.ndarray, "bands rows columns"], Bool[np.ndarray, "rows columns"]]:
    """A window (column, row, width, height) of a sheet in original pixels, and which are usable."""
    column, row, width, height = box
    window = ((row, row + height), (column, column + width))
    with open_raster(sheet.path, OVERVIEW_LEVEL="NONE") as raster, damage_told(sheet.path):
        raw = _read(raster, sheet, window=window)
        usable = np.ones((height, width), dtype=bool)
        if sheet.masked:
            usable = raster.dataset_mask(window=window) > 0
    if raw.dtype.kind == "f":
        usable &= np.isfinite(raw).all(axis=0)
    if sheet.collar is not None:
        usable &= ~sheet.collar.within(raw, column, row)
    return _content(raw, sheet, content), usable


def _add_reduced(
    sheet: Sheet,
    place: CellWindow,
    content: Content,
    total: Float32[np.ndarray, "bands rows columns"],
    weight: Float32[np.ndarray, "rows columns"],
) -> None:
    """As `_add_exact`, through overviews: for showing and for coarse searches."""
    n = place.size
    # Cells whose middle lies on the sheet; the sheet's rim is stretched by under half a cell.
    first, above = max(0, _round(-place.column, n)), max(0, _round(-place.row, n))
    last = min(place.columns, _round(sheet.columns - place.column, n))
    below = min(place.rows, _round(sheet.rows - place.row, n))
    if last <= first or below <= above:
        return
    left, top = max(0, place.column + first * n), max(0, place.row + above * n)
    right = min(sheet.columns, place.column + last * n)
    bottom = min(sheet.rows, place.row + below * n)
    window = ((top, bottom), (left, right))
    shape = (below - above, last - first)
    with open_raster(sheet.path) as raster, damage_told(sheet.path):
        raw = _read(raster, sheet, window=window, shape=shape)
        usable = np.isfinite(raw).all(axis=0)
        if sheet.masked:
            usable &= raster.dataset_mask(window=window, out_shape=shape) > 0
    if sheet.collar is not None:
        usable &= ~_collar_cells(sheet, raw, (left, top, right, bottom))
    cells = (slice(above, below), slice(first, last))
    room = np.where(usable, 1 - weight[cells], 0).astype(np.float32)
    total[(slice(None), *cells)] += _content(raw, sheet, content) * room
    weight[cells] += room


def _round(value: int, size: int) -> int:
    """Value over size to the nearest whole number."""
    return (2 * value + size) // (2 * size)


def _collar_cells(
    sheet: Sheet, raw: Shaped[np.ndarray, "bands rows columns"], box: tuple[int, int, int, int]
) -> Bool[np.ndarray, "rows columns"]:
    """Cells that hold collar: looked up in its rough shape, then by their own value."""
    collar = sheet.collar
    assert collar is not None
    left, top, right, bottom = box
    rows = np.linspace(top, bottom, raw.shape[1] * 2 + 1)[1::2] / sheet.rows
    columns = np.linspace(left, right, raw.shape[2] * 2 + 1)[1::2] / sheet.columns
    down = (rows * collar.reduced.shape[0]).astype(int)
    across = (columns * collar.reduced.shape[1]).astype(int)
    # A cell half collar is a mixture: twice the spread of noise would not do, half the range may.
    near = np.all(np.abs(raw.astype(np.float32) - collar.value) < 32, axis=0)
    return collar.reduced[np.ix_(down, across)] & near


def _read(
    raster: rasterio.DatasetReader,
    sheet: Sheet,
    window: RowsColumns,
    shape: tuple[int, int] | None = None,
) -> Shaped[np.ndarray, "bands rows columns"]:
    """The sheet's bands in a window, averaged to a shape where one is given."""
    reduced = {} if shape is None else {"resampling": Resampling.average}
    out = None if shape is None else (len(sheet.bands), *shape)
    return raster.read(list(sheet.bands), window=window, out_shape=out, **reduced)


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
