"""One photo made into an ortho: every output pixel is one sample of the raw scan.

Indirect rectification (METHODS 8): easting, northing and DEM height of the pixel's centre go
through collinearity and interior orientation to a place in the scan, which is sampled once.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import rasterio
from shapely.geometry import Polygon, box
from shapely.prepared import prep

from core.arrays import Mask
from core.block import Photo
from core.frames import HALF_PIXEL
from core.geometry.camera import Camera
from core.orthos.lattice import Heights, PixelMap, ScanPlaces, locate_tile
from core.orthos.picture import PictureMask, footprint_of, picture_mask
from core.progress import Progress
from core.raster.grid import Grid
from core.raster.scan_source import ScanSource
from core.raster.tiles import NODATA, SILENT, Pixels, Tile, tiled_profile, tiles_of, write_tiles

MARGIN_PX = 4
"""Pixels around a window so that the cubic kernel never meets its edge."""


@dataclass(frozen=True, slots=True)
class OrthoOptions:
    """How photos are rectified."""

    tile_px: int = 1024
    """Side of the tiles that are computed at a time, output pixels."""
    threads: int = 2
    """Tiles computed side by side."""
    lattice_limit_px: float = 0.05
    """Largest error of the interpolated scan place, scan pixels."""
    frame_margin_mm: float = 1.0
    """Strip along the edge of the picture area that is left out, millimetres of film."""
    mark_radius_mm: float = 2.0
    """Disc around each fiducial that is left out, millimetres of film."""
    scan_budget_bytes: int = 800_000_000
    """A scan up to this size is held in memory, a larger one is read by windows."""
    compression_level: int = 1
    """Deflate level of the file; grain hardly gets smaller at higher ones."""


@dataclass(frozen=True, slots=True)
class OrthoProduct:
    """One rectified photo on disk."""

    photo_id: str
    """The photo it was made from."""
    path: Path
    """GeoTIFF, one band, 0 (nodata) where there is nothing and at least 1 elsewhere."""
    grid: Grid
    """Where its pixels lie."""
    covered_share: float
    """Share of its pixels that show the ground, 0 to 1."""
    nadir: tuple[float, float]
    """Easting and northing straight below the perspective centre, metres."""


def rectify_photo(
    photo: Photo,
    camera: Camera,
    dem: Heights,
    grid: Grid | float,
    path: Path,
    crs: str,
    *,
    usable: Mask | None = None,
    options: OrthoOptions = OrthoOptions(),
    progress: Progress = SILENT,
) -> OrthoProduct:
    """Rectify one photo onto a north-up grid and write it, tile by tile, as a GeoTIFF.

    Args:
        photo: The photo with its orientations.
        camera: Its camera.
        dem: Heights in the block's CRS, metres.
        grid: Output grid, or only its ground sample distance in metres: the grid then covers
            the footprint.
        path: File to write; hand over a temporary name and rename it.
        crs: The block's CRS.
        usable: True where the scan may be shown, over the whole scan at any reduction.
        options: Tile size, margins, accuracy.
        progress: Told after every tile.

    Returns:
        The product. Pixels outside the picture area or without a height are 0 (nodata).
    """
    grid = grid if isinstance(grid, Grid) else ortho_grid(photo, camera, dem, grid)
    source = ScanSource(
        photo.scan,
        _reduction(photo, camera, grid),
        options.threads,
        options.scan_budget_bytes,
    )
    mask = picture_mask(photo, camera, options.frame_margin_mm, options.mark_radius_mm, usable)
    work = _Work(photo, camera, dem, grid, source, mask, options.lattice_limit_px)
    nadir = (float(photo.exterior.centre[0]), float(photo.exterior.centre[1]))
    tiles = _tiles_near(footprint_of(photo, camera, dem), grid, options.tile_px)
    profile = tiled_profile(grid, crs, source.dtype.name) | {
        "compress": "deflate",
        "zlevel": options.compression_level,
        "predictor": 2,
        "num_threads": options.threads,
    }
    tags = {"PHOTO_ID": photo.photo_id, "NADIR": f"{nadir[0]!r} {nadir[1]!r}"}
    covered = write_tiles(
        path, profile, tags, partial(_tile, work), tiles, options.threads, progress, photo.photo_id
    )
    share = covered / (grid.columns * grid.rows)
    return OrthoProduct(photo.photo_id, path, grid, share, nadir)


def read_ortho(path: Path) -> OrthoProduct:
    """An ortho that `rectify_photo` wrote, as a value again; its covered share is a sample's."""
    with rasterio.open(path) as file:
        transform, tags = file.transform, file.tags()
        grid = Grid(transform.c, transform.f, transform.a, file.width, file.height)
        sample = file.read(1, out_shape=(min(file.height, 512), min(file.width, 512)))
    east, north = (float(part) for part in tags["NADIR"].split())
    share = float(np.count_nonzero(sample) / sample.size)
    return OrthoProduct(tags["PHOTO_ID"], path, grid, share, (east, north))


def ortho_grid(photo: Photo, camera: Camera, dem: Heights, ground_sample_distance_m: float) -> Grid:
    """Smallest grid on multiples of the pixel size that covers a photo's footprint."""
    return Grid.over(footprint_of(photo, camera, dem).bounds, ground_sample_distance_m)


def _tiles_near(footprint: Polygon, grid: Grid, tile_px: int) -> list[Tile]:
    """Tiles that a photo may reach; far outside its frame the lens polynomial means nothing."""
    reach = prep(footprint.buffer(0.05 * np.sqrt(footprint.area)))
    return [
        tile
        for tile in tiles_of(grid, tile_px)
        if reach.intersects(box(*grid.window(*tile).bounds))
    ]


@dataclass(frozen=True, slots=True, eq=False)
class _Work:
    """What the tiles of one ortho are computed from."""

    photo: Photo
    camera: Camera
    dem: Heights
    grid: Grid
    source: ScanSource
    mask: PictureMask
    limit_px: float


def _tile(work: _Work, window: Tile) -> Pixels | None:
    """Values of one tile in the type of the scan, 0 where nothing is seen; None if nowhere."""
    tile = work.grid.window(*window)
    places = locate_tile(work.photo, work.camera, work.dem, tile, work.limit_px)
    if places is None:
        return None
    seen = work.mask.at(places.columns, places.rows, places.origin)
    if not seen.any():
        return None
    part = _part(work, places, seen)
    pixels = work.source.window(*part)
    columns, rows = (
        _reduced(values, origin - start * work.source.reduction, work.source.reduction)
        for values, origin, start in zip(
            (places.columns, places.rows), places.origin, part[:2], strict=True
        )
    )
    values = cv2.remap(pixels, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    np.maximum(values, 1, out=values)
    if not seen.all():
        values[~seen] = NODATA
    return values


def _part(work: _Work, places: ScanPlaces, seen: Mask) -> tuple[int, int, int, int]:
    """Column, row, columns, rows of the window that the seen places need, reduced pixels."""
    starts: list[int] = []
    sizes: list[int] = []
    step, whole = work.source.reduction, bool(seen.all())
    for axis, values in enumerate((places.columns, places.rows)):
        counted = values if whole else values[seen]
        low = places.origin[axis] + float(counted.min())
        high = places.origin[axis] + float(counted.max())
        last = -(-work.photo.size_px[axis] // step)
        start = max(int(low / step) - MARGIN_PX, 0)
        starts.append(start)
        sizes.append(min(int(high / step) + 1 + MARGIN_PX, last) - start)
    return starts[0], starts[1], sizes[0], sizes[1]


def _reduced(values: PixelMap, shift: int, step: int) -> PixelMap:
    """Places counted from a window of reduced pixels, in OpenCV's centre origin."""
    moved = values + np.float32(shift)
    if step > 1:
        moved *= np.float32(1 / step)
    moved -= np.float32(HALF_PIXEL)
    return moved


def _reduction(photo: Photo, camera: Camera, grid: Grid) -> int:
    """Whole number of scan pixels a side that are averaged before the one cubic sample."""
    east, north = photo.exterior.centre[:2]
    step = grid.ground_sample_distance_m
    height = photo.ground_height_m
    points = np.array(
        [[east, north, height], [east + step, north, height], [east, north + step, height]]
    )
    pixels = photo.pixel_from_object(points, camera)
    sides = np.linalg.norm(pixels[1:] - pixels[0], axis=1)
    return max(1, int(np.mean(sides) + 0.5))
