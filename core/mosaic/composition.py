"""Many orthos composed into one: seams, radiometric balance, feathering, Cloud Optimized GeoTIFF.

Tile by tile, so memory does not grow with the number of photos.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any

import cv2
import numpy as np
import rasterio
import rasterio.features
import rasterio.shutil
from affine import Affine
from jaxtyping import Float32, Int32
from shapely import STRtree
from shapely.geometry import box

from core.mosaic.overview import Overview, read_overview
from core.mosaic.radiometry import Balance, balance_orthos
from core.mosaic.seams import KEEP_INSIDE_M, PhotoArea, Seam, area_of, draw_seams, write_seams
from core.orthos.rectification import OrthoProduct
from core.progress import SILENT, Progress
from core.raster.grid import (
    BLOCK_PX,
    NODATA,
    Grid,
    Pixels,
    Tile,
    refuse_incomplete,
    tell_full_disk,
    tiled_profile,
    tiles_of,
    window_of,
    write_tiles,
)
from core.raster.holes import Hole, find_holes

# design: METHODS 8 gives 2 to 10; it hides a step of gray and is narrower than a road
FEATHER_PX = 8
"""Width over which one photo fades into the next, pixels."""
# design: a few metres, less than a seam keeps from the edge of a photo
PIXELS_PER_CELL = 8
"""Ortho pixels a side per cell of the overviews that seams are drawn from."""
# design: ten thousand cells for two unknowns of a photo, and grain is averaged away
BALANCE_CELLS = 128
"""Cells along the longest side of an ortho from which the balance is estimated."""


@dataclass(frozen=True, slots=True)
class MosaicOptions:
    """How orthos are composed."""

    # design: some megabytes a photo in memory, and four blocks of the file
    tile_px: int = 1024
    """Side of the tiles that are composed at a time, pixels."""
    # design: the cores of the smallest machine
    threads: int = 2
    """Tiles composed side by side."""
    balance: bool = True
    """Correct gain and offset of the photos."""


@dataclass(frozen=True, slots=True, eq=False)
class MosaicProduct:
    """A mosaic on disk."""

    path: Path
    """Cloud Optimized GeoTIFF, one band, 0 (nodata) where no photo shows anything."""
    grid: Grid
    """Where its pixels lie."""
    seams: tuple[Seam, ...]
    """Which photo shows which part."""
    balances: Mapping[str, Balance]
    """Radiometric correction by photo."""
    covered_share: float
    """Share of its pixels that show the ground, 0 to 1."""
    holes: tuple[Hole, ...] = ()
    """Ground inside it that no photo shows, largest first."""


def mosaic_grid(orthos: Sequence[OrthoProduct]) -> Grid:
    """Grid over all orthos, which share one ground sample distance."""
    bounds = np.array([ortho.grid.bounds for ortho in orthos])
    west, south = bounds[:, :2].min(axis=0)
    east, north = bounds[:, 2:].max(axis=0)
    gsd = orthos[0].grid.ground_sample_distance_m
    return Grid.over((float(west), float(south), float(east), float(north)), gsd)


def compose_mosaic(
    orthos: Sequence[OrthoProduct],
    grid: Grid,
    path: Path,
    seams_path: Path,
    *,
    seams: Sequence[Seam] | None = None,
    dates: Mapping[str, str] | None = None,
    options: MosaicOptions | None = None,
    progress: Progress = SILENT,
) -> MosaicProduct:
    """Compose orthos into one Cloud Optimized GeoTIFF and write the seams beside it.

    Args:
        orthos: At least one; all on multiples of the grid's pixels.
        grid: Grid of the mosaic.
        path: Mosaic to write; hand over a temporary name and rename it.
        seams_path: GeoPackage to write the seams to; likewise.
        seams: Seams to use instead of nearest nadir, such as edited ones.
        dates: Date of each photo, for the seams.
        options: Tiles, and whether to balance.
        progress: Told after every ortho and tile.

    Returns:
        The mosaic.
    """
    assert orthos
    options = options or MosaicOptions()
    work = _prepare(orthos, grid, seams, dates, options, progress)
    with rasterio.open(orthos[0].path) as first:
        crs = first.crs.to_string()
    write_seams(work.seams, seams_path, crs)
    tiles_path = path.with_name(f".{path.name}.tiles.tif")
    try:
        covered = write_tiles(
            tiles_path,
            tiled_profile(grid, crs, work.dtype.name),
            {},
            partial(_compose, work),
            tiles=list(tiles_of(grid, options.tile_px)),
            threads=options.threads,
            progress=progress,
            what="mosaic",
        )
        with tell_full_disk(path):
            rasterio.shutil.copy(tiles_path, path, driver="COG", **COG)
        refuse_incomplete(path, -(-grid.columns // BLOCK_PX) * -(-grid.rows // BLOCK_PX))
    finally:
        tiles_path.unlink(missing_ok=True)
    share = covered / (grid.columns * grid.rows)
    return MosaicProduct(path, grid, work.seams, work.balances, share, find_holes(path))


RASTERIZING = Lock()
"""rasterio silences a warning of its own while it rasterizes, which is one thread's business."""
COG = {
    "blocksize": BLOCK_PX,
    "compress": "deflate",
    "predictor": "yes",
    "overview_resampling": "average",
    "num_threads": 2,
    "bigtiff": "if_safer",
}


@dataclass(frozen=True, slots=True, eq=False)
class _Work:
    """What the tiles of one mosaic are composed from."""

    orthos: tuple[OrthoProduct, ...]
    grid: Grid
    seams: tuple[Seam, ...]
    seam_orthos: tuple[int, ...]
    balances: Mapping[str, Balance]
    dtype: np.dtype[Any]
    seam_tree: STRtree
    ortho_tree: STRtree


def _prepare(
    orthos: Sequence[OrthoProduct],
    grid: Grid,
    seams: Sequence[Seam] | None,
    dates: Mapping[str, str] | None,
    options: MosaicOptions,
    progress: Progress,
) -> _Work:
    """Seams and balance from the orthos in small."""
    areas: list[PhotoArea] = []
    overviews: list[Overview] = []
    room_m = FEATHER_PX * grid.ground_sample_distance_m
    keep_m = max(KEEP_INSIDE_M, room_m)
    longest = max(max(ortho.grid.columns, ortho.grid.rows) for ortho in orthos)
    coarsening = max(1, longest // PIXELS_PER_CELL // BALANCE_CELLS)
    for done, ortho in enumerate(orthos):
        _assert_aligned(ortho.grid, grid)
        overview = read_overview(ortho, PIXELS_PER_CELL)
        areas.append(area_of(overview, keep_m))
        overviews.append(overview.coarser(coarsening))
        progress.report(float(done), float(len(orthos)), "seams and balance")
    with rasterio.open(orthos[0].path) as file:
        dtype = np.dtype(file.dtypes[0])
    balances: Mapping[str, Balance] = {ortho.photo_id: Balance() for ortho in orthos}
    if options.balance:
        scale = float(np.iinfo(dtype).max)
        balances = balance_orthos(overviews, scale)
    drawn = draw_seams(areas, dates, keep_m) if seams is None else tuple(seams)
    index = {ortho.photo_id: number for number, ortho in enumerate(orthos)}
    drawn = tuple(seam for seam in drawn if seam.photo_id in index)
    return _Work(
        tuple(orthos),
        grid,
        drawn,
        tuple(index[seam.photo_id] for seam in drawn),
        balances,
        dtype,
        STRtree([seam.area for seam in drawn]),
        STRtree([box(*ortho.grid.bounds) for ortho in orthos]),
    )


def _assert_aligned(part: Grid, whole: Grid) -> None:
    # design: rounding of metres
    assert abs(part.ground_sample_distance_m - whole.ground_sample_distance_m) < 1e-9
    corner = whole.grid_from_object(np.array([[part.west, part.north]]))
    # design: a thousandth of a pixel is not seen
    assert np.abs(corner - np.rint(corner)).max() < 1e-3, "orthos must share the mosaic's pixels"


def _compose(work: _Work, tile: Tile) -> Pixels | None:
    """One tile of the mosaic; None where no photo shows anything."""
    halo = FEATHER_PX // 2 + 1
    column, row, columns, rows = tile
    part = work.grid.window(column - halo, row - halo, columns + 2 * halo, rows + 2 * halo)
    layers = _Layers(work, part)
    labels = _label(work, part, layers)
    inner = np.s_[halo : halo + rows, halo : halo + columns]
    present = np.unique(labels[labels >= 0]).tolist()
    if not present or not (labels[inner] >= 0).any():
        return None
    if len(present) == 1:
        values = layers.balanced(present[0])
    else:
        values = _blend(layers, labels, present, FEATHER_PX)
    largest = np.iinfo(work.dtype).max
    whole = np.clip(np.rint(values), 1, largest).astype(work.dtype)
    whole[labels < 0] = NODATA
    return np.ascontiguousarray(whole[inner])


class _Layers:
    """The orthos over one tile, each read once when it is first needed."""

    def __init__(self, work: _Work, part: Grid) -> None:
        self.work, self.part = work, part
        self._read: dict[int, Pixels] = {}

    def pixels(self, index: int) -> Pixels:
        """Gray values of an ortho over the tile, 0 outside it."""
        if index not in self._read:
            self._read[index] = _read_part(self.work.orthos[index], self.part)
        return self._read[index]

    def balanced(self, index: int) -> Float32[np.ndarray, "rows columns"]:
        """Gray values after gain and offset."""
        balance = self.work.balances[self.work.orthos[index].photo_id]
        values = self.pixels(index).astype(np.float32)
        values *= np.float32(balance.gain)
        values += np.float32(balance.offset)
        return values


def _read_part(ortho: OrthoProduct, part: Grid) -> Pixels:
    corner = ortho.grid.grid_from_object(np.array([[part.west, part.north]]))[0]
    column, row = (int(value) for value in np.rint(corner))
    first, last = max(column, 0), min(column + part.columns, ortho.grid.columns)
    top, bottom = max(row, 0), min(row + part.rows, ortho.grid.rows)
    with rasterio.open(ortho.path) as file:
        values = np.zeros((part.rows, part.columns), dtype=file.dtypes[0])
        if first < last and top < bottom:
            window = window_of((first, top, last - first, bottom - top))
            values[top - row : bottom - row, first - column : last - column] = file.read(
                1, window=window
            )
    return values


def _label(work: _Work, part: Grid, layers: _Layers) -> Int32[np.ndarray, "rows columns"]:
    """Index of the ortho that shows each pixel, -1 for none: the seams, else the nearest nadir."""
    frame = box(*part.bounds)
    chosen = [int(k) for k in work.seam_tree.query(frame, predicate="intersects")]
    labels = np.full((part.rows, part.columns), -1, dtype=np.int32)
    if chosen:
        shapes = [(work.seams[k].area, work.seam_orthos[k]) for k in sorted(chosen)]
        transform = Affine.from_gdal(*part.geotransform)
        with RASTERIZING:
            burnt = rasterio.features.rasterize(
                shapes, labels.shape, -1, transform=transform, dtype="int32"
            )
        labels = np.asarray(burnt)
    for k in chosen:
        index = work.seam_orthos[k]
        labels[(labels == index) & (layers.pixels(index) == NODATA)] = -1
    if (labels < 0).any():
        _fill(work, part, layers, labels)
    return labels


def _fill(
    work: _Work, part: Grid, layers: _Layers, labels: Int32[np.ndarray, "rows columns"]
) -> None:
    """Where no seam gives a photo that shows the place, take the nearest nadir that does."""
    eastings, northings = part.centres()
    empty = labels < 0
    nearest = np.full(labels.shape, np.inf)
    for index in sorted(int(k) for k in work.ortho_tree.query(box(*part.bounds))):
        east, north = work.orthos[index].nadir
        distance = (eastings[None, :] - east) ** 2 + (northings[:, None] - north) ** 2
        better = empty & (layers.pixels(index) != NODATA) & (distance < nearest)
        labels[better] = index
        nearest[better] = distance[better]


def _blend(
    layers: _Layers, labels: Int32[np.ndarray, "rows columns"], present: list[int], width: int
) -> Float32[np.ndarray, "rows columns"]:
    """Weights fall from 1 to 0 across a seam; a photo never weighs where it shows nothing."""
    side = width // 2 * 2 + 1
    total = np.zeros(labels.shape, dtype=np.float32)
    weights = np.zeros(labels.shape, dtype=np.float32)
    for index in present:
        own = (labels == index).astype(np.float32)
        weight = cv2.blur(own, (side, side), borderType=cv2.BORDER_REPLICATE)
        weight = np.where(layers.pixels(index) != NODATA, np.asarray(weight), np.float32(0))
        total += weight * layers.balanced(index)
        weights += weight
    # design: no division by nought
    return total / np.maximum(weights, np.float32(1e-6))
