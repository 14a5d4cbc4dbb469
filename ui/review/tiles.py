"""Square tiles of the reference ortho and of the scans, warped to the ground or raw.

Ground tiles lie on one lattice: level 0 has the finest pixel, each level above it double, and
tile (0, 0) begins in the north-west corner. The scan is warped by projecting a lattice of ground
nodes through DEM and orientation, interpolating between them, and one resampling of a window of
the raw scan.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, cast

import cv2
import numpy as np
from jaxtyping import Float32, Float64, UInt8

from core.arrays import Raster
from core.frames import HALF_PIXEL
from core.raster.grid import Grid, Pixels
from ui.review.compare import DrawnPhoto, HeightSource, pixel_from_ground

TILE = 256
"""Width and height of a tile, pixels."""
NODES = 17
"""Nodes along a tile's side that are projected; pixels between them are interpolated."""
OUTSIDE = 20
"""Grey of what no picture covers: nearly the ground of the page."""
WALLIS_RADIUS = 40
"""Half window of the local contrast, pixels."""
SAMPLE_PX = 512
"""Longest side of the small picture of a whole scan, pixels."""
SPARSE_WINDOWS, SPARSE_PX = 5, 96
"""Windows a side, and pixels a side of each, from which grey values are first learnt."""
LEAST_CONTRAST = 24.0
"""Grays between black and white of a window at least: noise is not to look like a mark."""
LARGE_PX = 4000
"""Scans larger than this are not read whole before their first tile is shown."""
Grey = UInt8[np.ndarray, "rows columns"]
Colour = UInt8[np.ndarray, "rows columns 3"]
Clear = UInt8[np.ndarray, "rows columns 4"]
"""Red, green, blue and opacity."""
ScanWindow = Callable[[Path, int, int, int, int, int], Raster]
"""(scan, column, row, columns, rows, reduction) -> grey values of a window of a raw scan."""
LONGEST_PX = 3072
"""Longer side of the small ortho, pixels."""
STRIPS = 24
"""It is read in so many strips from north to south; each can be shown at once."""


class OrthoSource(Protocol):
    """What the desk asks of the reference ortho."""

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north, metres."""
        ...

    @property
    def ground_sample_distance_m(self) -> float:
        """Finest pixel, metres."""
        ...

    def read_colour(self, grid: Grid) -> Colour:
        """Colours on a grid."""
        ...


@dataclass(frozen=True, slots=True)
class Stretch:
    """Grey values shown as black and as white."""

    black: float
    white: float

    def applied(self, values: Pixels) -> Float32[np.ndarray, "rows columns *bands"]:
        """Values from 0 to 255."""
        span = max(self.white - self.black, 1e-6)
        scaled = (np.asarray(values, dtype=np.float32) - self.black) * (255.0 / span)
        return np.clip(scaled, 0.0, 255.0).astype(np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class Overview:
    """A whole scan, small."""

    values: Raster
    """Grey values."""
    reduction: int
    """Scan pixels a side that became one."""


@dataclass(frozen=True, slots=True)
class Lattice:
    """Where ground tiles lie."""

    west: float
    """Easting of the first tile's left edge, metres."""
    north: float
    """Northing of the first tile's top edge, metres."""
    pixel_m: float
    """Pixel of level 0, metres."""
    levels: int
    """Number of levels."""

    @staticmethod
    def over(bounds: tuple[float, float, float, float], pixel_m: float) -> "Lattice":
        """A lattice that covers bounds (west, south, east, north), the top level in few tiles."""
        west, south, east, north = bounds
        extent = max(east - west, north - south) / pixel_m
        levels = 1 + max(0, int(np.ceil(np.log2(max(extent / (2 * TILE), 1.0)))))
        return Lattice(float(np.floor(west)), float(np.ceil(north)), pixel_m, levels)

    def part(self, bounds: tuple[float, float, float, float]) -> dict[str, float]:
        """As the pages get it, with how far the ortho's bounds reach from its corner, metres."""
        _, south, east, _ = bounds
        return {
            "west": self.west, "north": self.north, "pixel": self.pixel_m, "levels": self.levels,
            "width": east - self.west, "height": self.north - south,
        }  # fmt: skip

    def tile(self, level: int, column: int, row: int) -> Grid:
        """The grid of one tile."""
        pixel = self.pixel_m * 2**level
        west = self.west + column * TILE * pixel
        return Grid(west, self.north - row * TILE * pixel, pixel, TILE, TILE)


def ortho_tile(ortho: OrthoSource, grid: Grid) -> Colour:
    """The reference ortho on a grid, dark where it has nothing."""
    west, south, east, north = ortho.bounds
    left, bottom, right, top = grid.bounds
    if left >= east or right <= west or bottom >= north or top <= south:
        return np.full((grid.rows, grid.columns, 3), OUTSIDE, dtype=np.uint8)
    return ortho.read_colour(grid)


def mosaic_tile(mosaic: OrthoSource, grid: Grid, even: Callable[[Colour], Colour]) -> Clear:
    """The mosaic on a grid with its opacity: clear where no photo shows the ground.

    Args:
        mosaic: Black where it shows nothing, and nowhere else.
        grid: Where.
        even: What is done to the colours before they are shown.
    """
    colour = mosaic.read_colour(grid)
    opacity = np.where(colour.any(axis=2), 255, 0).astype(np.uint8)
    return np.dstack([even(colour), opacity])


def warped_tile(
    drawn: DrawnPhoto, dem: HeightSource, read: ScanWindow, stretch: Stretch, grid: Grid
) -> Grey:
    """The scan on a ground grid, dark outside the scan."""
    pixels = scan_map(drawn, dem, grid)
    columns, rows = drawn.photo.size_px
    inside = (
        (pixels[..., 0] > 0) & (pixels[..., 0] < columns)
        & (pixels[..., 1] > 0) & (pixels[..., 1] < rows)
    )  # fmt: skip
    empty = np.full((grid.rows, grid.columns), OUTSIDE, dtype=np.uint8)
    if not inside.any():
        return empty
    near = np.where(np.isfinite(pixels), pixels, 0.0)
    reduction = _reduction(near)
    # Columns and rows by themselves: pairs of numbers are handled several times as slowly.
    across, down = near[..., 0], near[..., 1]
    window = _window_around(across[inside], down[inside], (columns, rows), reduction)
    values = stretch.applied(read(drawn.photo.scan, *window, reduction))
    warped = cv2.remap(
        values,
        ((across - window[0]) / reduction - HALF_PIXEL).astype(np.float32),
        ((down - window[1]) / reduction - HALF_PIXEL).astype(np.float32),
        cv2.INTER_CUBIC if reduction == 1 else cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    shown = np.clip(np.rint(cast(Raster, warped)), 0, 255).astype(np.uint8)
    return np.where(inside, shown, empty)


def raw_tile(
    drawn: DrawnPhoto,
    read: ScanWindow,
    stretch: Stretch,
    place: tuple[int, int, int],
    margin: int = 0,
) -> Grey:
    """A tile (level, column, row) of the scan as it is, with a margin, dark outside."""
    level, column, row = place
    reduction = 2**level
    side = TILE + 2 * margin
    tile = np.full((side, side), OUTSIDE, dtype=np.uint8)
    first = np.array([column, row]) * TILE - margin
    limits = np.array(drawn.photo.size_px) // reduction
    low, high = np.clip(first, 0, limits), np.clip(first + side, 0, limits)
    if np.any(high <= low):
        return tile
    left, top, width, height = (int(v) * reduction for v in (*low, *(high - low)))
    values = stretch.applied(read(drawn.photo.scan, left, top, width, height, reduction))
    (x, y), (columns, rows) = low - first, high - low
    tile[y : y + rows, x : x + columns] = np.rint(values)
    return tile


def window_picture(
    drawn: DrawnPhoto, read: ScanWindow, column: int, row: int, side: int, reduction: int
) -> Grey:
    """A square window of the scan as it is, stretched by its own grays, dark outside the scan.

    Args:
        drawn: The photo.
        read: Windows of raw scans.
        column: First column of the window, scan pixels; may lie outside the scan.
        row: First row.
        side: Width and height of the picture, pixels.
        reduction: Scan pixels a side that make one pixel of the picture.
    """
    picture = np.full((side, side), OUTSIDE, dtype=np.uint8)
    columns, rows = drawn.photo.size_px
    left, right = _covered(column, columns, side, reduction)
    top, bottom = _covered(row, rows, side, reduction)
    if right <= left or bottom <= top:
        return picture
    values = read(
        drawn.photo.scan,
        column + left * reduction,
        row + top * reduction,
        (right - left) * reduction,
        (bottom - top) * reduction,
        reduction,
    )
    stretch = fit_stretch(values, margin=0)
    white = max(stretch.white, stretch.black + LEAST_CONTRAST)
    picture[top:bottom, left:right] = np.rint(Stretch(stretch.black, white).applied(values))
    return picture


def _covered(first: int, extent: int, side: int, reduction: int) -> tuple[int, int]:
    """Which pixels of a window, of `side` of them, lie wholly within a scan's `extent`."""
    low = max(0, -(first // reduction)) if first < 0 else 0
    high = min(side, (extent - first) // reduction)
    return low, high


def scan_map(
    drawn: DrawnPhoto, dem: HeightSource, grid: Grid
) -> Float64[np.ndarray, "rows columns 2"]:
    """Scan pixel of every pixel centre of a grid: nodes projected, the rest interpolated."""
    across = np.linspace(0, grid.columns, NODES)
    down = np.linspace(0, grid.rows, NODES)
    node_columns, node_rows = np.meshgrid(across, down)
    plane = grid.object_from_grid(np.column_stack([node_columns.ravel(), node_rows.ravel()]))
    nodes = pixel_from_ground(plane, drawn, dem).reshape(NODES, NODES, 2)
    by_row, by_column = _between(grid.rows, down), _between(grid.columns, across)
    return np.einsum("rn,nmc,km->rkc", by_row, nodes, by_column, optimize=True)


def overview_of(drawn: DrawnPhoto, read: ScanWindow, most_px: int = SAMPLE_PX) -> Overview:
    """The whole scan, reduced to so many pixels a side at most."""
    columns, rows = drawn.photo.size_px
    reduction = max(1, 2 ** int(np.ceil(np.log2(max(columns, rows) / most_px))))
    width, height = (side // reduction * reduction for side in (columns, rows))
    return Overview(read(drawn.photo.scan, 0, 0, width, height, reduction), reduction)


def frame_picture(
    drawn: DrawnPhoto, overview: Overview, stretch: Stretch, width: int = 224
) -> Colour:
    """The picture area of a scan, small, upright in the film frame: for the frustums."""
    photo, (frame_width, frame_height) = drawn.photo, drawn.camera.frame_mm
    height = max(1, round(width * frame_height / frame_width))
    across = (np.arange(width) + HALF_PIXEL) / width * frame_width - frame_width / 2
    down = frame_height / 2 - (np.arange(height) + HALF_PIXEL) / height * frame_height
    film = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    pixels = photo.interior.pixel_from_film(film).reshape(height, width, 2)
    there = (pixels / overview.reduction - HALF_PIXEL).astype(np.float32)
    small = cv2.remap(
        stretch.applied(overview.values),
        np.ascontiguousarray(there[..., 0]),
        np.ascontiguousarray(there[..., 1]),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=float(OUTSIDE),
    )
    grey = np.clip(np.rint(cast(Raster, small)), 0, 255).astype(np.uint8)
    return np.repeat(grey[:, :, None], 3, axis=2)


def local_contrast(grey: Grey) -> Grey:
    """Wallis filter: local mean and contrast brought to those of a well exposed picture."""
    values = grey.astype(np.float32)
    side = (2 * WALLIS_RADIUS + 1, 2 * WALLIS_RADIUS + 1)
    mean = cast(Raster, cv2.boxFilter(values, -1, side))
    square = cast(Raster, cv2.boxFilter(values * values, -1, side))
    deviation = np.sqrt(np.maximum(square - mean * mean, 0.0))
    gain = 45.0 / (0.75 * deviation + 0.25 * 45.0)
    result = (values - mean) * gain + 0.6 * 120.0 + 0.4 * mean
    return np.clip(np.rint(result), 0, 255).astype(np.uint8)


def sparse_sample(drawn: DrawnPhoto, read: ScanWindow) -> Raster:
    """Small windows spread over the inner part of a scan: its grey values without reading it all.

    A scan of 25,000 pixels a side without overviews takes seconds to be read as a whole.
    """
    columns, rows = drawn.photo.size_px
    side = max(1, min(SPARSE_PX, columns // SPARSE_WINDOWS, rows // SPARSE_WINDOWS))
    places = (np.arange(SPARSE_WINDOWS) + HALF_PIXEL) / SPARSE_WINDOWS * 2 / 3 + 1 / 6
    lines = [
        np.hstack(
            [
                read(
                    drawn.photo.scan,
                    min(int(across * columns), columns - side),
                    min(int(down * rows), rows - side),
                    side, side, 1,
                )
                for across in places
            ]
        )
        for down in places
    ]  # fmt: skip
    return np.vstack(lines)


def fit_stretch(sample: Raster, margin: int = 6) -> Stretch:
    """Black and white of a scan from a small picture of it: half a per cent at either end.

    Only the inner part counts, without one `margin`-th at every side: margins, fiducials and notes
    are blacker and whiter than ground. 0 takes everything.
    """
    rows, columns = (side // margin if margin else 0 for side in sample.shape)
    inner = sample[rows : sample.shape[0] - rows, columns : sample.shape[1] - columns]
    values = np.asarray(inner, dtype=np.float64)
    values = values[np.isfinite(values)]
    if values.size == 0:
        return Stretch(0.0, 255.0)
    low, high = np.percentile(values, [0.5, 99.5])
    return Stretch(float(low), float(max(high, low + 1.0)))


def _between(pixels: int, nodes: Float64[np.ndarray, "n"]) -> Float64[np.ndarray, "pixels n"]:
    """Weights that interpolate pixel centres linearly between nodes."""
    centres = np.arange(pixels) + HALF_PIXEL
    identity = np.eye(len(nodes))
    return np.column_stack([np.interp(centres, nodes, column) for column in identity])


def _reduction(pixels: Float64[np.ndarray, "rows columns 2"]) -> int:
    """Power of two by which the scan may be reduced before it is resampled."""
    middle = pixels[pixels.shape[0] // 2, :, :]
    step = float(np.median(np.linalg.norm(np.diff(middle, axis=0), axis=1)))
    return 2 ** int(np.floor(np.log2(step))) if step >= 2 else 1


def _window_around(
    columns: Float64[np.ndarray, "n"],
    rows: Float64[np.ndarray, "n"],
    size_px: tuple[int, int],
    reduction: int,
) -> tuple[int, int, int, int]:
    """Column, row, columns, rows of the window that holds some pixels, with a margin."""
    margin = 3 * reduction
    first, last = np.array([[of.min(), of.max()] for of in (columns, rows)]).T
    low = np.maximum(np.floor(first).astype(int) - margin, 0)
    high = np.minimum(np.ceil(last).astype(int) + margin, np.array(size_px))
    low = low // reduction * reduction
    extent = np.maximum((high - low) // reduction, 1) * reduction
    return int(low[0]), int(low[1]), int(extent[0]), int(extent[1])


@dataclass(eq=False)
class CoarseOrtho:
    """An ortho that answers for coarse grids from memory and for fine ones from its files."""

    ortho: OrthoSource
    """The files."""
    longest_px: int = LONGEST_PX
    """Longer side of what is kept."""
    _halves: list[Colour] = field(default_factory=list[Colour])
    _rows_read: int = 0
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        west, south, east, north = self.ortho.bounds
        longer = max(east - west, north - south)
        pixel = max(longer / self.longest_px, 2 * self.ortho.ground_sample_distance_m)
        self.grid = Grid.over(self.ortho.bounds, pixel)
        self._whole = np.zeros((self.grid.rows, self.grid.columns, 3), np.uint8)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north, metres."""
        return self.ortho.bounds

    @property
    def ground_sample_distance_m(self) -> float:
        """Finest pixel, metres."""
        return self.ortho.ground_sample_distance_m

    def prepare(self) -> None:
        """Read it, strip by strip; a second call waits for the first."""
        with self._lock:
            step = -(-self.grid.rows // STRIPS)
            while self._rows_read < self.grid.rows:
                first = self._rows_read
                rows = min(step, self.grid.rows - first)
                part = self.grid.window(0, first, self.grid.columns, rows)
                self._whole[first : first + rows] = self.ortho.read_colour(part)
                self._rows_read = first + rows
            self._halves = self._halves or _halved(self._whole)

    def ready(self, grid: Grid) -> bool:
        """True when a grid can be answered without reading the files whole."""
        if self._fine(grid):
            return True
        _, bottom = self.grid.grid_from_object(np.array([[grid.bounds[0], grid.bounds[1]]]))[0]
        return self._rows_read >= min(float(bottom), self.grid.rows)

    def read_colour(self, grid: Grid) -> Colour:
        """Colours on a grid, black where there are none."""
        if self._fine(grid) or not self.ready(grid):
            return self.ortho.read_colour(grid)
        ratio = grid.ground_sample_distance_m / self.grid.ground_sample_distance_m
        level = min(int(np.log2(max(ratio, 1.0))), max(len(self._halves) - 1, 0))
        source = self._halves[level] if self._halves else self._whole
        across, down = grid.centres()
        scale = self.grid.ground_sample_distance_m * 2**level
        columns = (across - self.grid.west) / scale - HALF_PIXEL
        rows = (self.grid.north - down) / scale - HALF_PIXEL
        x, y = np.meshgrid(columns.astype(np.float32), rows.astype(np.float32))
        return np.asarray(cv2.remap(source, x, y, cv2.INTER_LINEAR), np.uint8)

    def _fine(self, grid: Grid) -> bool:
        own = self.grid.ground_sample_distance_m
        return grid.ground_sample_distance_m < own * (1 - 1e-6)


def _halved(whole: Colour) -> list[Colour]:
    """The picture and its halves, down to a few pixels."""
    found = [whole]
    while min(found[-1].shape[:2]) > 64:
        rows, columns = (side // 2 for side in found[-1].shape[:2])
        even = found[-1][: 2 * rows, : 2 * columns]
        found.append(
            np.asarray(cv2.resize(even, (columns, rows), interpolation=cv2.INTER_AREA), np.uint8)
        )
    return found
