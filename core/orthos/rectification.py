"""One photo made into an ortho: every output pixel is one sample of the raw scan.

Indirect rectification (METHODS 8): easting, northing and DEM height of the pixel's centre go
through collinearity and interior orientation to a place in the scan, which is sampled once. A mask
keeps what of the scan shows the ground.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import shapely
from jaxtyping import Float32, Int32, Shaped, UInt8
from shapely import segmentize
from shapely.geometry import Polygon, box
from shapely.geometry.base import BaseGeometry
from shapely.prepared import prep

from core.arrays import FilmPoints, Mask, ObjectPoints, PixelPoints
from core.block import Photo
from core.frames import HALF_PIXEL, opencv_from_pixel
from core.geometry.areas import Area, only_areas
from core.geometry.camera import Camera
from core.orthos.bridges import BridgedHeights
from core.orthos.scan_places import Heights, PixelMap, ScanPlaces, locate_tile
from core.orthos.visibility import Sight, look_down
from core.progress import SILENT, Part, Progress
from core.raster.grid import (
    NODATA,
    Grid,
    Pixels,
    Tile,
    burn_area,
    tiled_profile,
    tiles_of,
    write_tiles,
)
from core.raster.scan_file import ScanSource, UsableArea
from core.scans.photo_mask import with_drawn

# design: pieces of one or two centimetres of film, over which tilt and lens are all but straight
RAYS_PER_SIDE = 16
"""Rays of the footprint along each side of the frame."""
# design: a sixteenth of a mask pixel is 12 micrometres
BINARY_PLACES = 4
"""Of the fractions of a pixel that OpenCV draws."""
# design: a fifth of the margin that is left out
MASK_STEP_MM = 0.2
"""The mask is drawn with pixels of about this size on the film."""
# source: OpenCV, remap holds places as signed 16 bit (32767)
FAR = 32000.0
"""Mask pixels beyond this would wrap around inside OpenCV."""
OPENCV_BANDS = 4  # source: OpenCV, remap
"""Bands that are sampled together at most."""
# design: two pixels of the kernel, one of rounding and one to spare
MARGIN_PX = 4
"""Pixels around a window so that the cubic kernel never meets its edge."""
# source: Lanczos' kernel reaches four pixels, two more than the cubic one
LANCZOS_MARGIN_PX = 6
"""The same of Lanczos' kernel."""
Resampling = Literal["nearest", "bilinear", "cubic", "lanczos"]
KERNELS: Mapping[Resampling, int] = {
    "nearest": cv2.INTER_NEAREST,
    "bilinear": cv2.INTER_LINEAR,
    "cubic": cv2.INTER_CUBIC,
    "lanczos": cv2.INTER_LANCZOS4,
}
"""What OpenCV calls them."""
# design: a twentieth of its side, more than relief and lens move it
REACH_SHARE = 0.05
"""A photo shows nothing so far beyond its footprint, in sides of it."""
# design: fiducials of aerial cameras are smaller than 4 mm
MARK_RADIUS_MM = 2.0
"""Disc around each fiducial that is left out, millimetres of film."""
# design: speed; grain hardly gets smaller at higher levels
COMPRESSION_LEVEL = 1
"""Deflate level of the file; grain hardly gets smaller at higher ones."""
# design: share of the bar on the screen; nothing is computed from it
LOOKED = 0.2


@dataclass(frozen=True, slots=True)
class OrthoOptions:
    """How photos are rectified."""

    # design: a megabyte, and four blocks of the file
    tile_px: int = 1024
    """Side of the tiles that are computed at a time, output pixels."""
    # design: the cores of the smallest machine
    threads: int = 2
    """Tiles computed side by side."""
    # design: the soft shadow of the frame is narrower
    edge_mm: float = 1.0
    """Strip along the edge of the picture area that is left out, millimetres of film."""
    resampling: Resampling = "cubic"
    """Which sample of the scan a pixel takes; the nearest one is a pixel of the scan itself."""
    # design: a scan of 23 cm at 10 um, with room; the smallest machine has 8 GB
    scan_budget_bytes: int = 800_000_000
    """A scan up to this size is held in memory, a larger one is read by windows."""
    visibility: bool = False
    """Whether places that something hides from the photo are left out: a true ortho."""


@dataclass(frozen=True, slots=True)
class OrthoProduct:
    """One rectified photo on disk."""

    photo_id: str
    """The photo it was made from."""
    path: Path
    """GeoTIFF with the bands of the scan, 0 (nodata) where there is nothing, else at least 1."""
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
    area: Area | None = None,
    options: OrthoOptions = OrthoOptions(),
    progress: Progress = SILENT,
) -> OrthoProduct:
    """Rectify one photo onto a north-up grid and write it, tile by tile, as a GeoTIFF.

    Args:
        photo: The photo with its orientations.
        camera: Its camera.
        dem: Heights in the block's CRS, metres.
        grid: Output grid, or the ground sample distance in metres of one over the footprint.
        path: File to write; hand over a temporary name and rename it.
        crs: The block's CRS.
        usable: True where the scan may be shown, over the whole scan at any reduction.
        area: Nothing is shown outside of it; None for no limit.
        options: Tile size, threads, edge, kernel, memory.
        progress: Told after every tile.

    Returns:
        The product. Pixels outside the picture area, without height or hidden are 0 (nodata).
    """
    grid = grid if isinstance(grid, Grid) else ortho_grid(photo, camera, dem, grid)
    reduction = 1 if options.resampling == "nearest" else _reduction(photo, camera, grid)
    source = ScanSource(photo.scan, reduction, options.threads, options.scan_budget_bytes)
    mask = picture_mask(photo, camera, options.edge_mm, usable)
    footprint = footprint_of(photo, camera, dem)
    sight, progress = _looked_down(photo, dem, grid, footprint, options, progress)
    work = _Work(photo, camera, dem, grid, source, mask, sight, options.resampling, area)
    nadir = (float(photo.exterior.centre[0]), float(photo.exterior.centre[1]))
    tiles = _tiles_near(reach_of(footprint), grid, options.tile_px)
    profile = tiled_profile(grid, crs, source.dtype.name, source.bands) | {
        "compress": "deflate",
        "zlevel": COMPRESSION_LEVEL,
        "predictor": 2,
        "num_threads": options.threads,
    }
    tags = {"PHOTO_ID": photo.photo_id, "NADIR": f"{nadir[0]!r} {nadir[1]!r}"}
    covered = write_tiles(
        path,
        profile,
        tags,
        partial(_tile, work),
        tiles=tiles,
        threads=options.threads,
        progress=progress,
        what=photo.photo_id,
    )
    share = covered / (grid.columns * grid.rows)
    return OrthoProduct(photo.photo_id, path, grid, share, nadir)


def _looked_down(
    photo: Photo,
    dem: Heights,
    grid: Grid,
    footprint: Polygon,
    options: OrthoOptions,
    progress: Progress,
) -> tuple[Sight | None, Progress]:
    """What the photo sees, where that is asked, and the progress that is left."""
    if not options.visibility:
        return None, progress
    part, centre = Part(progress, 0.0, LOOKED), photo.exterior.centre
    sight = look_down(centre, dem, grid, footprint, threads=options.threads, progress=part)
    return sight, Part(progress, LOOKED, 1.0)


def ortho_grid(photo: Photo, camera: Camera, dem: Heights, ground_sample_distance_m: float) -> Grid:
    """Smallest grid on multiples of the pixel size that covers a photo's footprint."""
    return Grid.over(footprint_of(photo, camera, dem).bounds, ground_sample_distance_m)


def footprint_of(photo: Photo, camera: Camera, dem: Heights, margin_mm: float = 0.0) -> Polygon:
    """Outline of the picture area on the terrain, in the block's CRS.

    Each ray of the outline goes down to the DEM by iteration; where the DEM has no height, to the
    mean ground height of the photo.
    """
    outline = picture_area_mm(photo, camera, margin_mm)
    dense = segmentize(outline.exterior, max(camera.frame_mm) / RAYS_PER_SIDE)
    film: FilmPoints = np.array(dense.coords, dtype=np.float64)
    polygon = Polygon(_down_to_terrain(photo, camera, dem, film)[:, :2])
    if polygon.is_valid:
        return polygon
    hull = polygon.convex_hull
    assert isinstance(hull, Polygon)
    return hull


def _down_to_terrain(photo: Photo, camera: Camera, dem: Heights, film: FilmPoints) -> ObjectPoints:
    """Where the rays of film points meet the DEM."""
    pixels = photo.interior.pixel_from_film(film)
    heights = np.full(len(film), photo.ground_height_m)
    points = photo.object_from_pixel(pixels, heights, camera)
    for _ in range(30):
        found = dem.heights(points[:, :2])
        wanted = np.where(np.isfinite(found), found, photo.ground_height_m)
        # design: metres; a centimetre of height is below any DEM
        if np.max(np.abs(wanted - heights)) < 0.01:
            break
        # Half steps: a full step swings for ever where the slope is as steep as the ray.
        heights = (wanted + heights) / 2
        points = photo.object_from_pixel(pixels, heights, camera)
    return points


def picture_area_mm(photo: Photo, camera: Camera, margin_mm: float) -> Polygon:
    """The picture area as far as it was scanned, less a margin along its edge, film mm."""
    width, height = (side / 2 - margin_mm for side in camera.frame_mm)
    columns, rows = photo.size_px
    corners = np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]], dtype=np.float64)
    scanned = Polygon(photo.interior.film_from_pixel(corners))
    area = box(-width, -height, width, height).intersection(scanned)
    assert isinstance(area, Polygon)
    return area


def area_within(
    area: Area | None, photo: Photo, camera: Camera, dem: Heights, grid: Grid, edge_mm: float = 0.0
) -> Area | None:
    """What of an area the ortho of a photo shows: empty where the photo does not reach it.

    Args:
        area: In the block's CRS; None for everywhere.
        photo: The photo.
        camera: Its camera.
        dem: Heights in the block's CRS, metres.
        grid: Over the photo's footprint.
        edge_mm: Strip along the edge of the picture that is left out, millimetres.

    Returns:
        None where the area cuts nothing off.
    """
    if area is None:
        return None
    if only_areas(area.intersection(footprint_of(photo, camera, dem, edge_mm))).is_empty:
        return Polygon()
    reach = reach_of(footprint_of(photo, camera, dem)).intersection(box(*grid.bounds))
    # In normal form, so that what was changed elsewhere leaves it as it is.
    if area.covers(reach):
        return None
    return only_areas(shapely.normalize(area.intersection(reach)))


def reach_of(footprint: Polygon) -> Polygon:
    """All that a photo of such a footprint may show."""
    return footprint.buffer(REACH_SHARE * np.sqrt(footprint.area))


def _tiles_near(reach: BaseGeometry, grid: Grid, tile_px: int) -> list[Tile]:
    """Tiles that a photo may reach; far outside its frame the lens polynomial means nothing."""
    near = prep(reach)
    return [
        tile for tile in tiles_of(grid, tile_px) if near.intersects(box(*grid.window(*tile).bounds))
    ]


@dataclass(frozen=True, slots=True, eq=False)
class PictureMask:
    """Which pixels of a scan show the ground, drawn at a reduction."""

    values: UInt8[np.ndarray, "rows columns"]
    """255 where the scan may be used."""
    reduction: float
    """Scan pixels per mask pixel, along each axis."""

    def at(
        self,
        columns: Float32[np.ndarray, "r c"],
        rows: Float32[np.ndarray, "r c"],
        origin: tuple[int, int],
    ) -> Mask:
        """True where scan places (counted from an origin) are usable; NaN never is."""
        if self._holds_all(columns, rows, origin):
            return np.ones(columns.shape, dtype=bool)
        places = [
            (values + np.float32(start)) * np.float32(1 / self.reduction) - np.float32(HALF_PIXEL)
            for values, start in zip((columns, rows), origin, strict=True)
        ]
        for values in places:
            # design: a place beside the mask, further than its interpolation reaches
            np.nan_to_num(values, copy=False, nan=-9.0)
            # design: a place beside the mask, further than its interpolation reaches
            np.clip(values, -9.0, FAR, out=values)
        found = cv2.remap(self.values, places[0], places[1], cv2.INTER_NEAREST, borderValue=(0,))
        return np.asarray(found > 0)

    def _holds_all(
        self,
        columns: Float32[np.ndarray, "r c"],
        rows: Float32[np.ndarray, "r c"],
        origin: tuple[int, int],
    ) -> bool:
        """True when the mask has no gap around all places, as for most tiles of an ortho."""
        window: list[slice] = []
        for values, start, size in zip(
            (rows, columns), origin[::-1], self.values.shape, strict=True
        ):
            low = (float(values.min()) + start) / self.reduction
            high = (float(values.max()) + start) / self.reduction
            if not (low >= 1 and high < size - 1):
                return False
            window.append(slice(int(low) - 1, int(high) + 2))
        return bool(self.values[window[0], window[1]].all())


def picture_mask(
    photo: Photo, camera: Camera, margin_mm: float, usable: Mask | None
) -> PictureMask:
    """The picture area less a margin, discs around the fiducials, and what is not usable.

    What a hand drew on the scan goes before what is said to be usable.

    Args:
        photo: The photo.
        camera: Its camera.
        margin_mm: Strip along the edge of the picture area, millimetres.
        usable: True where the scan may be shown, over the whole scan at any reduction.

    Returns:
        The mask.
    """
    reduction = max(1.0, float(np.floor(MASK_STEP_MM / photo.interior.pixel_size_mm)))
    columns, rows = (int(np.ceil(size / reduction)) for size in photo.size_px)
    mask = np.zeros((rows, columns), dtype=np.uint8)
    area: FilmPoints = np.array(picture_area_mm(photo, camera, margin_mm).exterior.coords)
    corners = _fixed_point(photo.interior.pixel_from_film(area) / reduction)
    cv2.fillPoly(mask, [corners], (255,), shift=BINARY_PLACES)
    if camera.fiducials_mm:
        marks = np.array(list(camera.fiducials_mm.values()), dtype=np.float64)
        radius = MARK_RADIUS_MM / photo.interior.pixel_size_mm / reduction
        for x, y in _fixed_point(photo.interior.pixel_from_film(marks) / reduction).tolist():
            cv2.circle(
                mask,
                (x, y),
                round(radius * (1 << BINARY_PLACES)),
                (0,),
                cv2.FILLED,
                shift=BINARY_PLACES,
            )
    if photo.mask:
        found = None if usable is None else UsableArea.of(usable, photo.size_px)
        usable = with_drawn(found, photo.mask, photo.size_px).mask
    if usable is not None:
        shown = cv2.resize(
            usable.astype(np.uint8), (columns, rows), interpolation=cv2.INTER_NEAREST
        )
        mask[np.asarray(shown) == 0] = 0
    return PictureMask(mask, reduction)


def _fixed_point(points: PixelPoints) -> Int32[np.ndarray, "n 2"]:
    """Pixels as OpenCV draws them: counted from the centre, integers with four binary places."""
    return np.rint(opencv_from_pixel(points) * (1 << BINARY_PLACES)).astype(np.int32)


@dataclass(frozen=True, slots=True, eq=False)
class _Work:
    """What the tiles of one ortho are computed from."""

    photo: Photo
    camera: Camera
    dem: Heights
    grid: Grid
    source: ScanSource
    mask: PictureMask
    sight: Sight | None
    resampling: Resampling
    area: Area | None


def _tile(work: _Work, window: Tile) -> Pixels | None:
    """Values of one tile in the type of the scan, 0 where nothing is seen; None if nowhere."""
    tile = work.grid.window(*window)
    dem = work.dem.around(tile.bounds) if isinstance(work.dem, BridgedHeights) else work.dem
    places = locate_tile(work.photo, work.camera, dem, tile)
    if places is None:
        return None
    seen = work.mask.at(places.columns, places.rows, places.origin)
    if work.area is not None:
        seen &= burn_area(work.area, tile)
    if work.sight is not None:
        seen &= work.sight.seen(window)
    if not seen.any():
        return None
    part = _window_of(work, places, seen)
    pixels = work.source.window(*part)
    columns, rows = (
        _reduce_places(values, origin - start * work.source.reduction, work.source.reduction)
        for values, origin, start in zip(
            (places.columns, places.rows), places.origin, part[:2], strict=True
        )
    )
    values = _sampled(pixels, columns, rows, KERNELS[work.resampling])
    np.maximum(values, 1, out=values)
    if not seen.all():
        values[~seen] = NODATA
    return values


def _sampled(
    pixels: Shaped[np.ndarray, "_ _ ..."], columns: PixelMap, rows: PixelMap, kernel: int
) -> Shaped[np.ndarray, "rows columns ..."]:
    """Samples of each band by one of OpenCV's kernels."""
    if pixels.ndim == 2 or pixels.shape[2] <= OPENCV_BANDS:
        found = cv2.remap(pixels, columns, rows, kernel, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(found)
    return np.dstack([_sampled(band, columns, rows, kernel) for band in np.moveaxis(pixels, -1, 0)])


def _window_of(work: _Work, places: ScanPlaces, seen: Mask) -> tuple[int, int, int, int]:
    """Column, row, columns, rows of the window that the seen places need, reduced pixels."""
    starts: list[int] = []
    sizes: list[int] = []
    step, whole = work.source.reduction, bool(seen.all())
    margin = LANCZOS_MARGIN_PX if work.resampling == "lanczos" else MARGIN_PX
    for axis, values in enumerate((places.columns, places.rows)):
        counted = values if whole else values[seen]
        low = places.origin[axis] + float(counted.min())
        high = places.origin[axis] + float(counted.max())
        last = -(-work.photo.size_px[axis] // step)
        start = max(int(low / step) - margin, 0)
        starts.append(start)
        sizes.append(min(int(high / step) + 1 + margin, last) - start)
    return starts[0], starts[1], sizes[0], sizes[1]


def _reduce_places(values: PixelMap, shift: int, step: int) -> PixelMap:
    """Places counted from a window of reduced pixels, in OpenCV's centre origin."""
    moved = values + np.float32(shift)
    if step > 1:
        moved *= np.float32(1 / step)
    moved -= np.float32(HALF_PIXEL)
    return moved


def _reduction(photo: Photo, camera: Camera, grid: Grid) -> int:
    """Whole number of scan pixels a side that are averaged before the one sample."""
    east, north = photo.exterior.centre[:2]
    step = grid.ground_sample_distance_m
    height = photo.ground_height_m
    points = np.array(
        [[east, north, height], [east + step, north, height], [east, north + step, height]]
    )
    pixels = photo.pixel_from_object(points, camera)
    sides = np.linalg.norm(pixels[1:] - pixels[0], axis=1)
    return max(1, int(np.mean(sides) + 0.5))
