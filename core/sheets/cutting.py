"""One map sheet out of the mosaic: its pixels window by window, and its file in any format."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal

import numpy as np
import rasterio
import rasterio.shutil
from jaxtyping import Shaped
from rasterio.enums import Resampling
from shapely.geometry import MultiPolygon, Polygon, box

from core.arrays import Mask
from core.formats.world_file import world_file_suffix, write_world_file
from core.geometry.areas import only_areas
from core.progress import Progress
from core.raster.grid import (
    BLOCK_PX,
    NODATA,
    Grid,
    Tile,
    disk_full,
    refuse_incomplete,
    tell_full_disk,
    tiled_profile,
    tiles_of,
    window_of,
)
from core.raster.lattices import Cells
from core.raster.ortho import LEAST_COVERAGE
from core.raster.sampling import sample_warped
from core.sheets.map_sheets import MapSheet
from core.sheets.pixels import (
    TargetSystem,
    enlarged,
    mosaic_places,
    origin_of,
    pixels_inside,
    sheet_grid,
)

Form = Literal["geotiff", "cog", "jp2", "jp2-lossy"]
SUFFIXES: Mapping[Form, str] = {
    "geotiff": ".tif",
    "cog": ".tif",
    "jp2": ".jp2",
    "jp2-lossy": ".jp2",
}
"""Formats that sheets are written in, with what their files end with."""
TILE_PX = 2048  # design: four megabytes a band, and whole blocks of the file.
"""Side of the windows that are read and written at a time, pixels."""
RIM_PX = 3  # source: reach of the cubic kernel, and a pixel.
"""Pixels around a sheet that a resampled one hangs on."""
JP2_TILE_PX = 1024  # source: default of GDAL's driver JP2OpenJPEG.
"""Side of the tiles of JPEG 2000, which are coded one by one."""
END_OF_JP2 = b"\xff\xd9"  # source: ISO/IEC 15444-1, marker EOC, ends every codestream.
Bands = Shaped[np.ndarray, "bands rows columns"]
"""Values of all bands in the type of the mosaic."""


@dataclass(frozen=True, slots=True, eq=False)
class SheetCut:
    """A sheet as it is cut in one CRS."""

    area: Polygon | MultiPolygon
    """What of it is shown, in the block's CRS."""
    moved: Polygon | MultiPolygon
    """The same in the CRS of its pixels."""
    grid: Grid
    """Its pixels: the whole sheet, shown or not."""
    system: TargetSystem
    """Their CRS."""
    square: bool
    """Whether all of its pixels lie inside."""


def plan_cut(
    sheet: MapSheet,
    mosaic: Grid,
    system: TargetSystem,
    overlap_m: float = 0.0,
    border: Polygon | MultiPolygon | None = None,
) -> SheetCut:
    """Which pixels a sheet has.

    Args:
        sheet: The sheet.
        mosaic: Grid of the mosaic.
        system: CRS of its pixels.
        overlap_m: Rim of its neighbours that it shows too, metres.
        border: Outside this nothing is shown, in the block's CRS.
    """
    whole = enlarged(sheet.area, overlap_m)
    gsd = mosaic.ground_sample_distance_m
    grid = sheet_grid(system.sheet_in(whole), gsd, origin_of(mosaic, system))
    area = whole if border is None else only_areas(whole.intersection(border))
    square = not system.resampled and bool(area.equals(box(*whole.bounds)))
    return SheetCut(area, system.sheet_in(area), grid, system, square)


@dataclass(frozen=True, slots=True)
class Look:
    """What the mosaic shows of a sheet."""

    digest: str
    """SHA-256 of its pixels and a rim of them."""
    covered_share: float
    """Share of its pixels that show the ground, 0 to 1."""


class OpenMosaic:
    """A mosaic that is read in windows."""

    def __init__(self, file: rasterio.DatasetReader) -> None:
        """An open file, whose pixels are square and north up."""
        gsd, _, west, _, _, north = tuple(file.transform)[:6]
        self.file = file
        self.grid = Grid(west, north, gsd, file.width, file.height)
        self.dtype = np.dtype(file.dtypes[0])

    @property
    def bits(self) -> int:
        """Bits of a pixel, all bands together."""
        return self.file.count * self.dtype.itemsize * 8  # source: bits of a byte

    def read(self, tile: Tile) -> Bands:
        """A window that may reach beyond the mosaic, where nothing is seen."""
        column, row, columns, rows = tile
        values = np.full((self.file.count, rows, columns), NODATA, dtype=self.dtype)
        first, last = max(column, 0), min(column + columns, self.grid.columns)
        top, bottom = max(row, 0), min(row + rows, self.grid.rows)
        if first < last and top < bottom:
            window = window_of((first, top, last - first, bottom - top))
            inside = np.s_[:, top - row : bottom - row, first - column : last - column]
            values[inside] = self.file.read(window=window)
        return values

    def tile_at(self, part: Grid) -> Tile:
        """A grid that shares the mosaic's pixels, as a window of it."""
        corner = np.rint(self.grid.grid_from_object(np.array([[part.west, part.north]])))[0]
        return int(corner[0]), int(corner[1]), part.columns, part.rows


def look_at(mosaic: OpenMosaic, cut: SheetCut, rim_px: int = 0) -> Look:
    """What the mosaic shows of a sheet that is cut in the block's own CRS."""
    total, seen = sha256(), 0
    column, row, columns, rows = mosaic.tile_at(cut.grid)
    around = Grid.window(cut.grid, -rim_px, -rim_px, columns + 2 * rim_px, rows + 2 * rim_px)
    for tile in tiles_of(around, TILE_PX):
        values = mosaic.read((column - rim_px + tile[0], row - rim_px + tile[1], *tile[2:]))
        total.update(np.ascontiguousarray(values).tobytes())
        if values.any():
            seen += int(np.count_nonzero(_seen(values) & _inside(cut, around.window(*tile))))
    total.update(str((around.columns, around.rows)).encode())
    return Look(total.hexdigest(), seen / (cut.grid.columns * cut.grid.rows))


def _seen(values: Bands) -> Mask:
    return (values != NODATA).any(axis=0)


def _inside(cut: SheetCut, part: Grid) -> Mask:
    """Pixels of a window that belong to a sheet; the rim of it belongs to its neighbours."""
    if not cut.square:
        return pixels_inside(cut.area, cut.moved, part, cut.system)
    east, north = part.centres()
    west, south, end, top = cut.grid.bounds
    return ((north > south) & (north < top))[:, None] & ((east > west) & (east < end))


def sheet_pixels(mosaic: OpenMosaic, cut: SheetCut, tile: Tile) -> Bands | None:
    """A window of a sheet; None where it shows nothing."""
    part = cut.grid.window(*tile)
    if cut.system.operation is None:
        values = mosaic.read(mosaic.tile_at(part))
    else:
        values = _resampled(mosaic, cut, part)
    if values is None or not values.any():
        return None
    if not cut.square:
        values[:, ~_inside(cut, part)] = NODATA
    return values


def _resampled(mosaic: OpenMosaic, cut: SheetCut, part: Grid) -> Bands | None:
    """The mosaic on the pixels of another CRS, cubic; what is seen stays at least 1."""
    assert cut.system.operation is not None
    columns, rows = mosaic_places(part, mosaic.grid, cut.system.operation)
    if not (np.isfinite(columns).all() and np.isfinite(rows).all()):
        return None
    left, top = int(np.floor(columns.min())) - RIM_PX, int(np.floor(rows.min())) - RIM_PX
    width = int(np.ceil(columns.max())) + RIM_PX - left
    height = int(np.ceil(rows.max())) + RIM_PX - top
    source = mosaic.read((left, top, width, height))
    seen = _seen(source)
    if not seen.any():
        return None
    cells = Cells(source.astype(np.float32), seen.astype(np.float32))
    across, down = (columns - left).astype(np.float32), (rows - top).astype(np.float32)
    sampled = sample_warped(cells, across, down, 1.0, "cubic")
    largest = np.iinfo(mosaic.dtype).max
    values = np.clip(np.rint(sampled.values), 1, largest).astype(mosaic.dtype)
    values[:, sampled.coverage < LEAST_COVERAGE] = NODATA
    return values


def write_sheet(
    mosaic: OpenMosaic,
    cut: SheetCut,
    form: Form,
    path: Path,
    *,
    lossy_percent: float,
    progress: Progress,
) -> None:
    """Write a sheet with its world file, overviews and what it says where nothing is seen.

    Of lossless formats that is the value 0. A lossy one has no such value: a mask lies beside it.

    Args:
        mosaic: The mosaic.
        cut: The sheet's pixels.
        form: Format.
        path: File to write; hand over a temporary name and rename it with its companions.
        lossy_percent: Size of a lossy file, in hundredths of the uncompressed one.
        progress: Told after every window.

    Raises:
        OSError: The disk is full.
    """
    transform = cut.system.transform(cut.grid)
    if form == "geotiff":
        packed = {"compress": "deflate", "predictor": 2}
        blocks = _write_tiff(mosaic, cut, path, packed, progress)
        _build_overviews(path)
        refuse_incomplete(path, blocks)
    else:
        tiles = path.with_name(f".{path.name}.tiles.tif")
        try:
            plain = {"nodata": None} if form == "jp2-lossy" else {}
            _write_tiff(mosaic, cut, tiles, plain, progress)
            _write_copy(tiles, form, path, lossy_percent)
            if form == "jp2-lossy":
                _write_mask(mosaic, cut, path.with_name(f"{path.name}.msk"), progress)
        finally:
            tiles.unlink(missing_ok=True)
    world = np.array([[transform.a, transform.b, transform.c],
                      [transform.d, transform.e, transform.f]])  # fmt: skip
    write_world_file(path.with_suffix(world_file_suffix(path)), world)


def _profile(mosaic: OpenMosaic, cut: SheetCut) -> dict[str, Any]:
    profile = tiled_profile(cut.grid, cut.system.crs, mosaic.dtype.name)
    return profile | {
        "count": mosaic.file.count,
        "transform": cut.system.transform(cut.grid),
        "interleave": "pixel",
    }


def _write_tiff(
    mosaic: OpenMosaic, cut: SheetCut, path: Path, how: Mapping[str, Any], progress: Progress
) -> int:
    """All windows of a sheet into a GeoTIFF; the number of blocks that hold something."""
    filled = 0
    tiles = list(tiles_of(cut.grid, TILE_PX))
    with tell_full_disk(path), rasterio.open(path, "w", **_profile(mosaic, cut) | {**how}) as out:
        out.colorinterp = mosaic.file.colorinterp
        for done, tile in enumerate(tiles, start=1):
            values = sheet_pixels(mosaic, cut, tile)
            if values is not None:
                filled += sum(1 for block in _blocks(values) if block.any())
                out.write(values, window=window_of(tile))
            progress.report(done, len(tiles), path.name)
    refuse_incomplete(path, filled)
    return filled


def _blocks(values: Bands) -> Iterator[Bands]:
    for top in range(0, values.shape[1], BLOCK_PX):
        for left in range(0, values.shape[2], BLOCK_PX):
            yield values[:, top : top + BLOCK_PX, left : left + BLOCK_PX]


def _build_overviews(path: Path) -> None:
    in_blocks = rasterio.Env(GDAL_TIFF_OVR_BLOCKSIZE=BLOCK_PX)
    with tell_full_disk(path), in_blocks, rasterio.open(path, "r+") as file:
        halvings = int(np.ceil(np.log2(max(file.width, file.height) / BLOCK_PX)))
        factors = [2**level for level in range(1, halvings + 1)]
        if factors:
            file.build_overviews(factors, Resampling.average)


def _write_copy(tiles: Path, form: Form, path: Path, lossy_percent: float) -> None:
    """A sheet in a format that is written in one go, block by block, from its tiles."""
    with tell_full_disk(path):
        if form == "cog":
            rasterio.shutil.copy(
                tiles, path, driver="COG", blocksize=BLOCK_PX, compress="deflate",
                predictor="yes", overview_resampling="average", bigtiff="if_safer",
            )  # fmt: skip
        else:
            lossless = form == "jp2"
            rasterio.shutil.copy(
                tiles, path, driver="JP2OpenJPEG", blockxsize=JP2_TILE_PX, blockysize=JP2_TILE_PX,
                quality=100.0 if lossless else lossy_percent,
                reversible="yes" if lossless else "no", ycbcr420="no",
            )  # fmt: skip
    if form == "cog":
        refuse_incomplete(path, 0)
        return
    with path.open("rb") as file, tell_full_disk(path):
        file.seek(-len(END_OF_JP2), 2)
        whole = file.read() == END_OF_JP2
    if not whole:
        raise disk_full(path)


def _write_mask(mosaic: OpenMosaic, cut: SheetCut, path: Path, progress: Progress) -> None:
    """Where a sheet shows something (255) and where not (0), as GDAL expects it beside a file."""
    profile = _profile(mosaic, cut)
    profile |= {"count": 1, "dtype": "uint8", "nodata": None, "compress": "deflate"}
    tiles = list(tiles_of(cut.grid, TILE_PX))
    filled = 0
    with tell_full_disk(path), rasterio.open(path, "w", **profile) as out:
        out.update_tags(INTERNAL_MASK_FLAGS_1="2")
        for done, tile in enumerate(tiles, start=1):
            values = sheet_pixels(mosaic, cut, tile)
            if values is not None:
                seen = np.where(_seen(values), np.uint8(255), np.uint8(0))
                filled += sum(1 for block in _blocks(seen[None]) if block.any())
                out.write(seen, 1, window=window_of(tile))
            progress.report(done, len(tiles), path.name)
    refuse_incomplete(path, filled)
