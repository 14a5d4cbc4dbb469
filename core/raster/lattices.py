"""The sheets of an ortho or a DEM together: on common pixel lattices, the finest first.

Sheets of one pixel size and phase share a lattice, on which neighbours join without a seam: a
resampling kernel that crosses a sheet edge finds the neighbour's pixels there. A lattice is read in
cells of 1, 2, 4 ... pixels a side, and every original pixel is decoded once. Cells are cut on the
lattice, not on the sheets: a cell across a sheet edge averages the pixels of both neighbours. Where
sheets overlap the first one is taken. Levels are kept in tiles that all readers share; a tile is
made from the four below it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from hashlib import blake2b
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64, Shaped
from pyproj import CRS
from rasterio.enums import Resampling

from core.arrays import Affine2, locked
from core.doubts import Doubt
from core.errors import ReferenceDataError
from core.formats.listed_point import HIGHEST_M, LOWEST_M
from core.frames import HALF_PIXEL
from core.geometry.crs import Bounds, Operation, bounds_of, operation_between, short_name
from core.raster.files import TILES, gray_from_colour
from core.raster.grid import ROUNDING_PX, Grid
from core.raster.sheets import Sheet, SheetKind, block_outline, open_sheet, sheet_file
from core.said import say

# design: 128 bits; no two meet by chance
DIGEST_BYTES = 16
"""Length of the name of a set of files."""
Content = Literal["gray", "colour", "heights"]
BANDS: dict[Content, int] = {"gray": 1, "colour": 3, "heights": 1}  # design: what each content is
# design: one megabyte of gray and four blocks of a usual GeoTIFF, a little more than one search.
TILE_CELLS = 512
"""Side of a tile, cells."""

# design: a fiftieth of a pixel, what rounded world files leave; nothing here is measured as well.
PHASE_TOLERANCE_PX = 0.02
"""Origins that differ from whole pixels by less than this lie on one lattice."""
# design: a hundredth of a pixel over a sheet of ten thousand.
SIZE_TOLERANCE = 1e-6
"""Relative difference below which two pixel sizes are one."""
# design: a ten-thousandth of a pixel over a sheet of a hundred thousand.
SLANT = 1e-9
"""Axes turned by less than this, radians, or pixels less oblong, are north up and square."""
# design: coarser than `PHASE_TOLERANCE_PX`, since it only makes a note.
HALF_TOLERANCE_PX = 0.05
"""Sheets this near to half a pixel beside others are told."""


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """Sheets whose pixels fall on one and the same raster, of any extent."""

    sheets: tuple[Sheet, ...]
    """The sheets, in the order of their files; where two overlap the first is taken."""
    offsets: Int64[np.ndarray, "sheets 2"]
    """Column and row of each sheet's first pixel on the lattice."""
    plane_from_lattice: Affine2
    """Coordinates in the lattice's CRS from lattice columns and rows."""
    operation: Operation | None
    """From the CRS of the sheets to the block's; None where they give the same coordinates."""
    ground_sample_distance_m: float
    """Size of a pixel on the ground, metres."""
    key: str
    """Names the files in their present state, for what is remembered of them."""

    @property
    def north_up(self) -> bool:
        """Whether rows run east and columns south in the block's CRS."""
        (a, b, _), (d, e, _) = self.plane_from_lattice
        slant = abs(b) + abs(d)
        return self.operation is None and a > 0 > e and bool(slant < SLANT * (a - e))

    @property
    def square(self) -> bool:
        """Whether its pixels may be those of a grid: north up, and as wide as high."""
        (a, _, _), (_, e, _) = self.plane_from_lattice
        return self.north_up and bool(abs(a + e) < SLANT * a)


@dataclass(frozen=True, slots=True, eq=False)
class SheetSet:
    """All sheets of an ortho or a DEM: finest lattice first."""

    crs: str
    """The block's CRS."""
    lattices: tuple[Lattice, ...]
    """Groups of sheets in the order they are taken, of one reference the finest first."""
    bounds: Bounds
    """West, south, east, north over all sheets, in the block's CRS, metres."""
    notes: tuple[Doubt, ...]
    """What the operator should know, such as sheets reprojected on the fly."""

    @property
    def sheets(self) -> tuple[Sheet, ...]:
        """Every sheet."""
        return tuple(sheet for lattice in self.lattices for sheet in lattice.sheets)

    @property
    def finest(self) -> Lattice:
        """The one of the smallest pixels."""
        return min(self.lattices, key=lambda lattice: lattice.ground_sample_distance_m)

    @property
    def grid(self) -> Grid:
        """Pixels of the finest sheets, extended over all of them."""
        finest = self.finest
        gsd, (west, _, _, north) = finest.ground_sample_distance_m, self.bounds
        if finest.square:
            # On their own pixels, values are read, not interpolated.
            (a, _, c), (_, _, f) = finest.plane_from_lattice
            gsd = float(a)
            west = float(c) + np.floor((west - c) / gsd + ROUNDING_PX) * gsd
            north = float(f) + np.ceil((north - f) / gsd - ROUNDING_PX) * gsd
        columns = int(np.ceil((self.bounds[2] - west) / gsd - ROUNDING_PX))
        rows = int(np.ceil((north - self.bounds[1]) / gsd - ROUNDING_PX))
        return Grid(float(west), float(north), gsd, columns, rows)

    @property
    def key(self) -> tuple[str, ...]:
        """Names the files in their present state, for what is remembered of them."""
        return (self.crs, *(lattice.key for lattice in self.lattices))


def no_sheets(crs: str, bounds: Bounds) -> SheetSet:
    """A set that covers bounds (west, south, east, north, metres) with nothing."""
    return SheetSet(crs, (), bounds, ())


def laid_over(sets: Sequence[SheetSet]) -> SheetSet:
    """Sets of one CRS as one: each shows only where those before it have nothing."""
    if len(sets) == 1:
        return sets[0]
    corners = np.array([one.bounds for one in sets]).reshape(-1, 2)
    lattices = tuple(lattice for one in sets for lattice in one.lattices)
    notes = tuple(note for one in sets for note in one.notes)
    return SheetSet(sets[0].crs, lattices, bounds_of(corners), notes)


def open_sheets(paths: Sequence[str | Path], crs: CRS, what: SheetKind) -> SheetSet:
    """Look at every file once: size, place, bands, mask, collar; nothing stays open.

    Args:
        paths: GeoTIFF, JPEG 2000, JPEG with world file: whatever GDAL reads.
        crs: The block's CRS.
        what: What the files hold, for messages; only orthos have collars.
    """
    if not paths:
        raise ReferenceDataError(
            f"[reference] {what.lower()}",
            say("no {what} is given.", what=what),
            "Name at least one file.",
        )
    # Each file once, whatever globs overlap; sorted, so that the result hangs on no order.
    sheets = [open_sheet(path, crs, what) for path in sorted({str(path) for path in paths})]
    sheets = _with_operations(sheets, crs)
    lattices = sorted(_lattices(sheets), key=lambda g: g.ground_sample_distance_m)
    corners = np.vstack([block_outline(sheet) for sheet in sheets])
    notes = (*_notes(sheets, crs, what), *_half_pixel_notes(lattices, what))
    return SheetSet(crs.to_wkt(), tuple(lattices), bounds_of(corners), notes)


def _with_operations(sheets: Sequence[Sheet], crs: CRS) -> list[Sheet]:
    """Sheets of one CRS all go the same way to the block's."""
    result = [sheet for sheet in sheets if not sheet.crs]
    for own in sorted({sheet.crs for sheet in sheets if sheet.crs}):
        members = [sheet for sheet in sheets if sheet.crs == own]
        corners = np.vstack([sheet.corners() for sheet in members])
        operation = operation_between(own, crs.to_wkt(), corners, members[0].path)
        result += [replace(sheet, operation=operation) for sheet in members]
    return sorted(result, key=lambda sheet: sheet.path)


def _notes(sheets: Sequence[Sheet], crs: CRS, what: str) -> tuple[Doubt, ...]:
    """One note for every other CRS among the sheets."""
    notes: list[Doubt] = []
    for own in sorted({sheet.crs for sheet in sheets if sheet.crs}):
        files = [sheet.path for sheet in sheets if sheet.crs == own]
        operation = next(sheet.operation for sheet in sheets if sheet.crs == own)
        assert operation is not None
        accuracy, lossless = operation.accuracy_m, operation.accuracy_m == 0
        known = (
            "of unknown accuracy"
            if np.isnan(accuracy)
            else say("good to {accuracy:g} m", accuracy=accuracy)
        )
        lack = "" if operation.best else " A better operation needs a grid that is not installed."
        # design: gravity of a note; graver where a better operation exists
        notes.append(
            Doubt(
                kind="reference-reprojected",
                subject=files[0],
                message=say(
                    "{count} {what} sheet(s) in {own} are reprojected to {crs} while reading "
                    "({words}, {known}).{lack}",
                    count=len(files),
                    what=what,
                    own=short_name(CRS(own)),
                    crs=short_name(crs),
                    words=operation.words,
                    known="without loss" if lossless else known,
                    lack=lack,
                ),
                gravity=0.2 if operation.best else 0.5,
                evidence={"files": files, "accuracy_m": None if np.isnan(accuracy) else accuracy},
            )
        )
    return tuple(notes)


def _half_pixel_notes(lattices: Sequence[Lattice], what: str) -> list[Doubt]:
    """Sheets half a pixel beside their fellows: some world files mean the corner (METHODS 10)."""
    notes: list[Doubt] = []
    for index, lattice in enumerate(lattices):
        for other in lattices[:index]:
            one, two = other.sheets[0], lattice.sheets[0]
            if one.crs != two.crs or not _same_size(one, two):
                continue
            phase = _offset(one, two) % 1
            if np.abs(phase - HALF_PIXEL).max() < HALF_TOLERANCE_PX:
                files = [sheet.path for sheet in lattice.sheets]
                # design: gravity of a note, between those of the two
                # reprojections
                notes.append(
                    Doubt(
                        kind="reference-half-pixel",
                        subject=files[0],
                        message=say(
                            "{count} {what} sheet(s) lie half a pixel ({half:g} m) beside the "
                            "others: the world files of one kind seem to mean the corner of the "
                            "first pixel, not "
                            "its centre. Sheets cut before 2016 may do so.",
                            count=len(files),
                            what=what,
                            half=lattice.ground_sample_distance_m / 2,
                        ),
                        gravity=0.4,
                        evidence={"files": files, "beside": one.path},
                    )
                )
    return notes


def _lattices(sheets: Sequence[Sheet]) -> list[Lattice]:
    """Group the sheets by CRS, pixel size and phase."""
    groups: list[list[Sheet]] = []
    for sheet in sheets:
        home = next((g for g in groups if _share_lattice(g[0], sheet)), None)
        groups.append([sheet]) if home is None else home.append(sheet)
    return [_lattice(group) for group in groups]


def _share_lattice(one: Sheet, other: Sheet) -> bool:
    """Whether the pixels of two sheets fall on one raster."""
    if one.crs != other.crs or one.bands != other.bands or not _same_size(one, other):
        return False
    offset = _offset(one, other)
    return bool(np.abs(offset - np.round(offset)).max() < PHASE_TOLERANCE_PX)


def _same_size(one: Sheet, other: Sheet) -> bool:
    """Whether the pixels of two sheets are of one size and lie the same way."""
    linear = one.plane_from_pixel[:, :2]
    difference = np.abs(other.plane_from_pixel[:, :2] - linear).max()
    return bool(difference <= SIZE_TOLERANCE * np.abs(linear).max())


def _offset(one: Sheet, other: Sheet) -> Float64[np.ndarray, "2"]:
    """Column and row of the other sheet's first pixel in pixels of the one."""
    shift = other.plane_from_pixel[:, 2] - one.plane_from_pixel[:, 2]
    return np.linalg.solve(one.plane_from_pixel[:, :2], shift)


def _lattice(group: Sequence[Sheet]) -> Lattice:
    """One lattice, counted from the first pixel of its first sheet."""
    first = group[0]
    files = repr([(sheet.path, sheet.stamp, sheet.bands) for sheet in group])
    outline = block_outline(first)
    east, north = outline.T
    area = 0.5 * abs(float(np.sum(east * np.roll(north, -1) - np.roll(east, -1) * north)))
    return Lattice(
        sheets=tuple(group),
        offsets=locked(np.round([_offset(first, sheet) for sheet in group]), np.int64),
        plane_from_lattice=first.plane_from_pixel,
        operation=first.operation,
        ground_sample_distance_m=float(np.sqrt(area / (first.columns * first.rows))),
        key=blake2b(files.encode(), digest_size=DIGEST_BYTES).hexdigest(),
    )


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
    # GDAL would mix what is no height into its means.
    exact = exact or any(sheet.strays for sheet in lattice.sheets)
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
    own = _content(raw, sheet, content)
    if content == "heights":
        # Nodata that the file does not name, and damaged pixels, are gaps.
        usable &= (own[0] > LOWEST_M) & (own[0] < HIGHEST_M)
    free = usable & (weight[cells] == 0)
    weight[cells][free] = 1
    values[(slice(None), *cells)] += np.where(free, own, 0)


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
        return gray_from_colour(raw)[None]
    with np.errstate(over="ignore"):
        values = raw.astype(np.float32)
    if content == "heights":
        with np.errstate(over="ignore", invalid="ignore"):
            return values * np.float32(sheet.factor) + np.float32(sheet.addend)
    if content == "colour":
        values *= 255.0 / sheet.white
        return np.repeat(values, 3, axis=0) if len(values) == 1 else values
    return values
