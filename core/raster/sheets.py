"""Reference sheets: one raster file each, inspected once for kind, place and resolution."""

import os
import re
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
import rasterio
from jaxtyping import Bool, Float64, Int32, Num, Shaped
from pyproj import CRS
from rasterio.enums import ColorInterp, MaskFlags
from rasterio.errors import RasterioError
from scipy import ndimage

from core.arrays import Affine2, Mask, locked
from core.errors import ReferenceDataError
from core.formats.listed_point import HIGHEST_M, LOWEST_M
from core.geometry.crs import (
    FARTHEST_M,
    Operation,
    check_range,
    horizontal,
    in_metres,
    infer_crs,
    read_crs,
    same_coordinates,
)
from core.raster.files import FILES, Stamp, file_stamp, web_map_of
from core.raster.grid import window_of
from core.said import say

SheetKind = Literal["ortho", "DEM"]
"""What a sheet holds, in the words of messages."""

# design: one block of JPEG, the smallest piece a lossy codec keeps flat.
CORNER_PX = 8
"""A corner this large, black or white in every band, makes a collar suspected."""
# design: what JPEG of quality 75 and above leaves beside an edge, after `SMEARED_PX`.
NOISE = 3
"""Gray values a lossy collar wanders from pure black or white."""
# design: an eighth of the range; a cell of the picture that dark and inside the rough shape is rim.
HALF_RANGE = 32
"""The same of reduced pixels, which mix collar and picture."""
# design: the codec's kernel decays to half a gray value over two pixels.
SMEARED_PX = 2
"""Pixels beside a collar into which a lossy codec smears it."""
# design: one megabyte a sheet, and cells of some ten pixels.
REDUCED_PX = 1024
"""A collar's shape is found on a reduction of the sheet to at most this size."""
# design: only for showing; clouds and roofs may burn out.
WHITE_SAMPLE_PX = 256
# design: only for showing; clouds and roofs may burn out
WHITE_PERCENTILE = 99.5
"""White of sheets with more than 8 bits: this percentile of so many pixels a side."""
# design: half a gigabyte of collars at worst, which only slanted sheets have.
MOST_SHEETS = 512
"""Sheets whose properties are remembered."""
# design: a second of reading.
LOOKED_THROUGH_PX = 40_000_000
"""DEM files up to this size are looked through for heights when they are opened."""
# design: a thousandth of a second, and nearly every DEM shows a height among them; numbers that are
# no heights and fall between them move its mean by centimetres.
EMPTY_SAMPLE_PX = 500
"""So many of its pixels a side are looked at first."""
# design: what is larger than a twentieth of a side is seen, in a third of a second.
PLACES = 20
"""Rows and columns of windows that are looked at in a large file."""


@dataclass(frozen=True, slots=True, eq=False)
class Collar:
    """The constant black or white margin of slanted orthos without nodata, roughly.

    The pixels themselves decide within.
    """

    value: float
    """Gray value of the margin."""
    reduced: Mask
    """True where a cell of the reduced sheet may hold collar."""

    def within(
        self,
        values: Num[np.ndarray, "bands rows columns"],
        places: tuple[Float64[np.ndarray, "rows"], Float64[np.ndarray, "columns"]],
        whole: bool,
    ) -> Mask:
        """Which pixels belong to the collar.

        Args:
            values: The bands of a window of the sheet.
            places: Where its rows and columns lie, as shares of the sheet.
            whole: True for original pixels, False for means over several.
        """
        down, across = (
            (share * size).astype(int)
            for share, size in zip(places, self.reduced.shape, strict=True)
        )
        away = np.abs(values.astype(np.float32) - self.value)
        flat = np.all(away <= (NOISE if whole else HALF_RANGE), axis=0)
        flat &= self.reduced[np.ix_(down, across)]
        if whole and flat.any():
            return ndimage.binary_dilation(flat, iterations=SMEARED_PX)
        return flat


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """One raster file of the reference; it holds no open file."""

    path: str
    """The file."""
    stamp: Stamp
    """The state of the file when it was looked at."""
    columns: int
    """Width, pixels."""
    rows: int
    """Height, pixels."""
    plane_from_pixel: Affine2
    """Coordinates in the sheet's own CRS from pixels (corner origin)."""
    crs: str
    """The sheet's own horizontal CRS; empty where it gives the block's coordinates."""
    operation: Operation | None
    """From the sheet's CRS to the block's, where they differ."""
    bands: tuple[int, ...]
    """Band of gray or heights, or the bands of red, green and blue; counted from 1."""
    masked: bool
    """Whether the file has nodata, alpha or a mask."""
    white: float
    """Value of white, for showing; 255 in 8-bit sheets."""
    collar: Collar | None
    """Constant margin round a slanted ortho, where there is one."""
    factor: float
    """Heights are the file's numbers times this, ..."""
    addend: float
    """... plus this, metres."""
    strays: bool
    """Whether a DEM has numbers that are no heights, such as a nodata value it does not name."""

    def corners(self) -> Float64[np.ndarray, "4 2"]:
        """The four outer corners in the sheet's own CRS."""
        pixels = np.array(
            [[0, 0], [self.columns, 0], [self.columns, self.rows], [0, self.rows]], dtype=np.float64
        )
        return pixels @ self.plane_from_pixel[:, :2].T + self.plane_from_pixel[:, 2]


def block_outline(sheet: Sheet) -> Float64[np.ndarray, "n 2"]:
    """Outline of a sheet in the block's CRS: corners, and points between where it is bent."""
    corners = sheet.corners()
    if sheet.operation is None:
        return corners
    # design: eight chords a side; a sheet of 10 km then leaves its outline by centimetres
    share, side = np.linspace(0, 1, 9)[:-1, None], np.roll(corners, -1, axis=0) - corners
    outline = (corners[:, None] + share * side[:, None]).reshape(-1, 2)
    return sheet.operation.forward(outline)


@contextmanager
def sheet_file(path: str | Path, **options: str) -> Generator[Any]:
    """A raster of the reference, open; or one message why it cannot be opened, or not be read."""
    with ExitStack() as stack:
        try:
            file = stack.enter_context(FILES.borrow(Path(path), **options))
        except (RasterioError, OSError) as error:
            raise ReferenceDataError(path, *_cause_and_remedy(Path(path), error)) from error
        try:
            yield file
        except RasterioError as error:
            raise ReferenceDataError(
                path,
                *_web_cause(Path(path), error)
                or (
                    "the file is damaged or cut off: GDAL cannot read its pixels.",
                    "Copy it again from its source.",
                ),
            ) from error


def _cause_and_remedy(path: Path, error: Exception) -> tuple[str, str]:
    """Cause and remedy of a file that GDAL does not open."""
    if not path.exists():
        return "the file is not there.", "Correct the path under [reference]."
    if not os.access(path, os.R_OK):
        return "the file may not be read.", "Give yourself the right to read it."
    return _web_cause(path, error) or (
        "the file cannot be read as a raster: GDAL does not know what it is.",
        "Copy it again from its source, or take it out of [reference].",
    )


def _web_cause(path: Path, error: Exception) -> tuple[str, str] | None:
    """Cause and remedy where the file describes a web map; None for any other file."""
    if not web_map_of(path):
        return None
    told = str(error.__cause__ or error)
    answer = re.search(r"HTTP status code: .*", told)
    return (
        say("the server that it describes gives no picture: {why}", why=(answer or [told])[0]),
        "Check its address and the network, or save what lies under the block as a GeoTIFF, for "
        "example with gdal_translate.",
    )


def open_sheet(path: str | Path, crs: CRS, what: SheetKind) -> Sheet:
    """Look at one file: size, place, bands, mask, collar; remembered while it does not change."""
    try:
        stamp = file_stamp(Path(path))
    except OSError as error:
        raise ReferenceDataError(path, *_cause_and_remedy(Path(path), error)) from error
    return _sheet(str(path), stamp, crs.to_wkt(), what)


@lru_cache(maxsize=MOST_SHEETS)
def _sheet(name: str, stamp: Stamp, crs: str, what: SheetKind) -> Sheet:
    """Everything about one file that later reads need."""
    path = Path(name)
    with sheet_file(path) as raster:
        if raster.transform.is_identity or not _is_place(raster.transform):
            raise ReferenceDataError(
                path,
                say("this {what} sheet has no place on the ground.", what=what),
                "Put its world file beside it, with the same name.",
            )
        strays = False
        if what == "DEM":
            _refuse_feet(raster, path)
            strays = _has_strays(raster, path)
        a, b, c, d, e, f = raster.transform[:6]
        bands = (1,) if what == "DEM" else _picture_bands(raster, path)
        flags = raster.mask_flag_enums[bands[0] - 1]
        return Sheet(
            path=name,
            stamp=stamp,
            columns=raster.width,
            rows=raster.height,
            plane_from_pixel=locked([[a, b, c], [d, e, f]]),
            crs=_own_crs(raster, (a, b, c, d, e, f), CRS(crs), path),
            operation=None,
            bands=bands,
            masked=MaskFlags.all_valid not in flags,
            white=_white_value(raster, bands[0]) if what != "DEM" else 0.0,
            collar=None if what == "DEM" else detect_collar(raster, bands),
            factor=float(raster.scales[bands[0] - 1]),
            addend=float(raster.offsets[bands[0] - 1]),
            strays=strays,
        )


def _is_place(transform: rasterio.Affine) -> bool:
    """Whether pixels have a size and a place on some map."""
    values = np.array(transform[:6])
    # design: a micrometre; smaller pixels and places beyond all maps are damage.
    return bool((np.abs(values) < FARTHEST_M).all() and abs(transform.determinant) > 1e-12)


def _picture_bands(raster: rasterio.DatasetReader, path: Path) -> tuple[int, ...]:
    """The bands of red, green and blue, or the one of gray."""
    meaning = raster.colorinterp
    if meaning[0] == ColorInterp.palette:
        raise ReferenceDataError(
            path,
            "the sheet has a colour table, whose numbers cannot be averaged.",
            "Convert it: gdal_translate -expand rgb.",
        )
    colours = (ColorInterp.red, ColorInterp.green, ColorInterp.blue)
    if all(colour in meaning for colour in colours):
        return tuple(meaning.index(colour) + 1 for colour in colours)
    return (1, 2, 3) if raster.count >= 3 else (1,)


def _refuse_feet(raster: rasterio.DatasetReader, path: Path) -> None:
    """Heights said to be in another unit than metres; silence means metres on a map in metres."""
    unit = (raster.units[0] or "").strip().lower()
    factor, told = 1.0, unit != ""
    if raster.crs is not None:
        own = read_crs(raster.crs.to_wkt(version="WKT2_2019"), path)
        for part in own.sub_crs_list[1:]:
            factor, told = part.axis_info[0].unit_conversion_factor, True
        plan = horizontal(own)
        if plan.is_projected and not told and not in_metres(plan):
            raise ReferenceDataError(
                path,
                say(
                    "the DEM does not say the unit of its heights, and its map counts in {unit}.",
                    unit=plan.axis_info[0].unit_name,
                ),
                "Convert heights in feet to metres, for example with gdal_calc, and state the "
                "unit: gdal_edit.py -units m FILE.",
            )
    # design: rounding; feet differ by two thirds
    if unit in ("", "m", "metre", "meter", "metres", "meters") and abs(factor - 1) < 1e-6:
        return
    raise ReferenceDataError(
        path,
        say(
            "the DEM says that its heights are not in metres ({unit}).",
            unit=unit or f"{factor:.4f} m each",
        ),
        "Convert it to metres, for example with gdal_calc, and take the unit out of its CRS.",
    )


def _has_strays(raster: rasterio.DatasetReader, path: Path) -> bool:
    """Whether a DEM file has numbers that are no heights; too few to be seen change no mean.

    Raises:
        ReferenceDataError: It is nothing but nodata: it was cut in the wrong place.
    """
    heights = _sample(raster, 1, EMPTY_SAMPLE_PX)
    if not len(heights):
        if raster.width * raster.height > LOOKED_THROUGH_PX:
            return False
        # A few scattered pixels may fall between those that are looked at first.
        heights = _sample(raster, 1, max(raster.shape))
    if len(heights):
        heights = heights.astype(np.float64) * raster.scales[0] + raster.offsets[0]
        return bool(((heights <= LOWEST_M) | (heights >= HIGHEST_M)).any())
    raise ReferenceDataError(
        path,
        "the DEM holds no height at all: every pixel is nodata.",
        "Export it again over the block, or check its nodata value.",
    )


def _sample(raster: rasterio.DatasetReader, band: int, side_px: int) -> Shaped[np.ndarray, "n"]:
    """Finite numbers of a band, spread over it: so many pixels a side, without nodata."""
    rows, columns = (min(side, side_px) for side in raster.shape)
    if raster.width * raster.height <= LOOKED_THROUGH_PX or raster.overviews(band):
        numbers = raster.read(band, masked=True, out_shape=(rows, columns)).compressed()
        return numbers[np.isfinite(numbers)]
    # A large file without reduced copies would be read through, and takes minutes.
    high, wide = (max(1, side // PLACES) for side in (rows, columns))
    tops, lefts = (
        np.linspace(0, side - own, PLACES).astype(int).tolist()
        for side, own in zip(raster.shape, (high, wide), strict=True)
    )
    windows = (window_of((left, top, wide, high)) for top in tops for left in lefts)
    pieces = [raster.read(band, masked=True, window=one).compressed() for one in windows]
    numbers = np.concatenate(pieces)
    return numbers[np.isfinite(numbers)]


def _white_value(raster: rasterio.DatasetReader, band: int) -> float:
    """The value to show as white: 255, or a high percentile where pixels have more bits."""
    if raster.dtypes[band - 1] == "uint8":
        return 255.0
    sample = _sample(raster, band, WHITE_SAMPLE_PX)
    # design: no division by nought
    return max(float(np.percentile(sample, WHITE_PERCENTILE)), 1e-6) if len(sample) else 255.0


def _own_crs(
    raster: rasterio.DatasetReader, affine: tuple[float, ...], block: CRS, path: Path
) -> str:
    """WKT of the sheet's horizontal CRS, or empty where it gives the block's coordinates."""
    a, b, c, d, e, f = affine
    pixels = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (raster.width, raster.height)
    corners = pixels @ np.array([[a, d], [b, e]]) + (c, f)
    if raster.crs is None:
        own = infer_crs(corners, block, path)
    else:
        own = horizontal(read_crs(raster.crs.to_wkt(version="WKT2_2019"), path))
        if own.is_projected:
            check_range(own, corners, path)
    return "" if same_coordinates(own.to_wkt(), block.to_wkt(), corners) else own.to_wkt()


def detect_collar(raster: rasterio.DatasetReader, bands: tuple[int, ...]) -> Collar | None:
    """Find a black or white margin that reaches a corner of an 8-bit sheet; None without one."""
    if any(raster.dtypes[band - 1] != "uint8" for band in bands):
        return None
    value = _corner_value(raster, bands)
    if value is None:
        return None
    shape = (min(raster.height, REDUCED_PX), min(raster.width, REDUCED_PX))
    reduced = raster.read(list(bands), out_shape=(len(bands), *shape))
    flat = np.all(np.abs(reduced.astype(np.int16) - value) <= NOISE, axis=0)
    margin = _parts_at_edge(flat)
    if not margin.any():
        return None
    reach = ndimage.binary_dilation(margin, structure=np.ones((3, 3)), iterations=2)
    return Collar(value, locked(reach, bool))


def _corner_value(raster: rasterio.DatasetReader, bands: tuple[int, ...]) -> float | None:
    """0 or 255 where a corner of the sheet is nothing but that."""
    width, height = min(CORNER_PX, raster.width), min(CORNER_PX, raster.height)
    for column in (0, raster.width - width):
        for row in (0, raster.height - height):
            window = ((row, row + height), (column, column + width))
            corner = raster.read(list(bands), window=window).astype(np.int16)
            for value in (0.0, 255.0):
                if np.all(np.abs(corner - value) <= NOISE):
                    return value
    return None


def _parts_at_edge(flat: Bool[np.ndarray, "rows columns"]) -> Bool[np.ndarray, "rows columns"]:
    """The connected parts that reach the sheet's edge over a length no shadow has."""
    labels, count = label_parts(flat)
    edge = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    lengths = np.bincount(edge, minlength=count + 1)
    # design: cells; a two-hundredth of a side is longer than the shadow of a house
    wanted = np.flatnonzero(lengths >= max(3, min(flat.shape) // 200))
    return np.isin(labels, wanted[wanted > 0])


def label_parts(
    flags: Bool[np.ndarray, "rows columns"],
) -> tuple[Int32[np.ndarray, "rows columns"], int]:
    """Number of the connected part (eight neighbours) of every pixel, 0 outside; how many."""
    labels = np.zeros(flags.shape, dtype=np.int32)
    count = ndimage.label(flags, structure=np.ones((3, 3)), output=labels)
    return labels, cast(int, count)
