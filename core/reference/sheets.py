"""Reference sheets: raster files opened once for what they are, and laid on common pixel lattices.

Sheets of one pixel size and phase share a lattice, on which neighbours join without a seam: a
resampling kernel that crosses a sheet edge finds the neighbour's pixels there.
"""

import os
import warnings
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from jaxtyping import Float64, Int64
from pyproj import CRS
from rasterio.enums import ColorInterp, MaskFlags
from rasterio.errors import NotGeoreferencedWarning, RasterioError

from core.arrays import Affine2, locked
from core.doubts import Doubt
from core.errors import ReferenceDataError
from core.geometry.crs import (
    Bounds,
    Operation,
    check_range,
    horizontal,
    infer_crs,
    operation_between,
    read_crs,
    same_coordinates,
    short_name,
)
from core.reference.collars import Collar, detect_collar

PHASE_TOLERANCE_PX = 0.02
"""Origins that differ from whole pixels by less than this lie on one lattice."""
SIZE_TOLERANCE = 1e-6
"""Relative difference below which two pixel sizes are one."""


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """One raster file of the reference; it is opened anew for every read."""

    path: str
    """The file."""
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

    def corners(self) -> Float64[np.ndarray, "4 2"]:
        """The four outer corners in the sheet's own CRS."""
        pixels = np.array(
            [[0, 0], [self.columns, 0], [self.columns, self.rows], [0, self.rows]], dtype=np.float64
        )
        return pixels @ self.plane_from_pixel[:, :2].T + self.plane_from_pixel[:, 2]


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

    @property
    def north_up(self) -> bool:
        """Whether rows run east and columns south in the block's CRS."""
        (a, b, _), (d, e, _) = self.plane_from_lattice
        slant = abs(b) + abs(d)
        return self.operation is None and a > 0 > e and bool(slant < 1e-9 * (a - e))


@dataclass(frozen=True, slots=True, eq=False)
class SheetSet:
    """All sheets of an ortho or a DEM: finest lattice first."""

    crs: str
    """The block's CRS."""
    lattices: tuple[Lattice, ...]
    """Groups of sheets, finest pixels first."""
    bounds: Bounds
    """West, south, east, north over all sheets, in the block's CRS, metres."""
    notes: tuple[Doubt, ...]
    """What the operator should know, such as sheets reprojected on the fly."""

    @property
    def sheets(self) -> tuple[Sheet, ...]:
        """Every sheet."""
        return tuple(sheet for lattice in self.lattices for sheet in lattice.sheets)


def open_sheets(
    paths: Sequence[str | Path], crs: CRS, what: str, collars: bool = False
) -> SheetSet:
    """Look at every file once: size, place, bands, mask, collar; nothing stays open.

    Args:
        paths: GeoTIFF, JPEG 2000, JPEG with world file: whatever GDAL reads.
        crs: The block's CRS.
        what: `ortho` or `DEM`, for messages.
        collars: Look for black or white margins without nodata.
    """
    if not paths:
        raise ReferenceDataError(
            f"[reference] {what.lower()}", f"no {what} is given.", "Name at least one file."
        )
    # Each file once, whatever globs overlap; sorted, so that the result hangs on no order.
    sheets = [_open_sheet(Path(p), crs, what, collars) for p in sorted({str(p) for p in paths})]
    sheets = _with_operations(sheets, crs)
    lattices = sorted(_lattices(sheets), key=lambda g: g.ground_sample_distance_m)
    corners = np.vstack([block_outline(sheet) for sheet in sheets])
    low, high = corners.min(axis=0), corners.max(axis=0)
    bounds = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    notes = (*_notes(sheets, crs, what), *_half_pixel_notes(lattices, what))
    return SheetSet(crs.to_wkt(), tuple(lattices), bounds, notes)


def block_outline(sheet: Sheet) -> Float64[np.ndarray, "n 2"]:
    """Outline of a sheet in the block's CRS: corners, and points between where it is bent."""
    corners = sheet.corners()
    if sheet.operation is None:
        return corners
    share, side = np.linspace(0, 1, 9)[:-1, None], np.roll(corners, -1, axis=0) - corners
    outline = (corners[:, None] + share * side[:, None]).reshape(-1, 2)
    return sheet.operation.forward(outline)


def open_raster(path: str | Path, **options: Any) -> rasterio.DatasetReader:
    """Open a raster of the reference, or say in one message why that cannot be done."""
    try:
        return rasterio.open(path, **options)
    except RasterioError as error:
        cause, remedy = _why_not(Path(path))
        raise ReferenceDataError(path, cause, remedy) from error


def _why_not(path: Path) -> tuple[str, str]:
    """Cause and remedy of a file that GDAL does not open."""
    if not path.exists():
        return "the file is not there.", "Correct the path under [reference]."
    if not os.access(path, os.R_OK):
        return "the file may not be read.", "Give yourself the right to read it."
    return (
        "the file cannot be read as a raster: GDAL does not know what it is.",
        "Copy it again from its source, or take it out of [reference].",
    )


@contextmanager
def damage_told(path: str | Path) -> Generator[None]:
    """Pixels that GDAL cannot read are told with the file's name."""
    try:
        yield
    except RasterioError as error:
        raise ReferenceDataError(
            path,
            "the file is damaged or cut off: GDAL cannot read its pixels.",
            "Copy it again from its source.",
        ) from error


def _open_sheet(path: Path, crs: CRS, what: str, collars: bool) -> Sheet:
    """Everything about one file that later reads need."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)  # told as an error of our own
        file = open_raster(path)
    with file as raster, damage_told(path):
        if raster.transform.is_identity:
            raise ReferenceDataError(
                path,
                f"this {what} sheet has no place on the ground.",
                "Put its world file beside it, with the same name.",
            )
        if what == "DEM":
            _refuse_feet(raster, path)
        a, b, c, d, e, f = raster.transform[:6]
        bands = (1,) if what == "DEM" else _picture_bands(raster, path)
        flags = raster.mask_flag_enums[bands[0] - 1]
        return Sheet(
            path=str(path),
            columns=raster.width,
            rows=raster.height,
            plane_from_pixel=locked([[a, b, c], [d, e, f]]),
            crs=_own_crs(raster, (a, b, c, d, e, f), crs, path),
            operation=None,
            bands=bands,
            masked=MaskFlags.all_valid not in flags,
            white=_white(raster, bands[0]) if what != "DEM" else 0.0,
            collar=detect_collar(raster, bands) if collars else None,
            factor=float(raster.scales[bands[0] - 1]),
            addend=float(raster.offsets[bands[0] - 1]),
        )


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
    """Heights that are said to be in another unit than metres; silence means metres."""
    unit = (raster.units[0] or "").strip().lower()
    factor = 1.0
    if raster.crs is not None:
        for part in read_crs(raster.crs.to_wkt(version="WKT2_2019"), path).sub_crs_list[1:]:
            factor = part.axis_info[0].unit_conversion_factor
    if unit in ("", "m", "metre", "meter", "metres", "meters") and abs(factor - 1) < 1e-6:
        return
    raise ReferenceDataError(
        path,
        f"the DEM says that its heights are not in metres ({unit or f'{factor:.4f} m each'}).",
        "Convert it to metres, for example with gdal_calc, and take the unit out of its CRS.",
    )


def _white(raster: rasterio.DatasetReader, band: int) -> float:
    """The value to show as white: 255, or a high percentile where pixels have more bits."""
    if raster.dtypes[band - 1] == "uint8":
        return 255.0
    shape = (min(raster.height, 256), min(raster.width, 256))
    sample = raster.read(band, out_shape=shape, masked=True).compressed()
    sample = sample[np.isfinite(sample)]
    return max(float(np.percentile(sample, 99.5)), 1e-6) if len(sample) else 255.0


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
        known = "of unknown accuracy" if np.isnan(accuracy) else f"good to {accuracy:g} m"
        lack = "" if operation.best else " A better operation needs a grid that is not installed."
        notes.append(
            Doubt(
                kind="reference-reprojected",
                subject=files[0],
                message=f"{len(files)} {what} sheet(s) in {short_name(CRS(own))} are reprojected "
                f"to {short_name(crs)} while reading ({operation.words}, "
                f"{'without loss' if lossless else known}).{lack}",
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
            if np.abs(phase - 0.5).max() < 0.05:
                files = [sheet.path for sheet in lattice.sheets]
                notes.append(
                    Doubt(
                        kind="reference-half-pixel",
                        subject=files[0],
                        message=f"{len(files)} {what} sheet(s) lie half a pixel "
                        f"({lattice.ground_sample_distance_m / 2:g} m) beside the others: the "
                        "world files of one kind seem to mean the corner of the first pixel, not "
                        "its centre. Sheets cut before 2016 may do so.",
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
    outline = block_outline(first)
    east, north = outline.T
    area = 0.5 * abs(float(np.sum(east * np.roll(north, -1) - np.roll(east, -1) * north)))
    return Lattice(
        sheets=tuple(group),
        offsets=locked(np.round([_offset(first, sheet) for sheet in group]), np.int64),
        plane_from_lattice=first.plane_from_pixel,
        operation=first.operation,
        ground_sample_distance_m=float(np.sqrt(area / (first.columns * first.rows))),
    )
