"""Features of one scan: places with a description that is the same in the next photo.

SIFT on a reduced scan, by tiles so that memory stays small; places are scan pixels.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float32, Float64, UInt8

from core.arrays import Flags, Mask, PixelPoints, Scalars, locked
from core.block.block import Photo
from core.frames import pixel_from_opencv
from core.geometry.camera import Camera
from core.scan.raster import ScanFile, read_window

Descriptors = UInt8[np.ndarray, "n 128"]
"""RootSIFT times 512: whole numbers, so that products in single precision are exact."""
Gray = Float32[np.ndarray, "rows columns"]
"""Grey values of a reduced scan."""
Usable = Callable[[PixelPoints], Flags]
"""Says of scan pixels whether features may lie there."""
DESCRIPTOR_LENGTH = 128


@dataclass(frozen=True, slots=True)
class FeatureOptions:
    """How features are looked for; pixels of the reduced scan unless said otherwise."""

    longest_side_px: int = 3600
    """The scan is reduced by the smallest whole factor that makes its longer side this short."""
    tile_px: int = 1024
    """Side of a tile."""
    margin_px: int = 48
    """Each tile sees this much of its neighbours."""
    threads: int = 2
    """Tiles at work at the same time."""
    max_features: int = 16_000
    """Features kept of one scan."""
    cells: int = 16
    """Cells along each side among which the features are shared out, strongest first."""
    contrast_threshold: float = 0.015
    """SIFT's own measure of contrast."""
    shading_px: float = 64.0
    """Gaussian radius of the mean and deviation that are evened out (Wallis filter)."""
    grain_px: float = 0.6
    """Gaussian radius against film grain; scans that are not reduced get twice as much."""


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """The features of one scan, as parallel arrays."""

    size_px: tuple[int, int]
    """Columns and rows of the scan."""
    reduction: int
    """Scan pixels per pixel of the reduced scan."""
    pixels: PixelPoints
    """Where they are, scan pixels."""
    radii_px: Scalars
    """SIFT's radius of each, scan pixels."""
    strengths: Scalars
    """Contrast of each."""
    descriptors: Descriptors
    """What they look like."""

    def __post_init__(self) -> None:
        for name in ("pixels", "radii_px", "strengths"):
            object.__setattr__(self, name, locked(getattr(self, name)))
        object.__setattr__(self, "descriptors", locked(self.descriptors, np.uint8))

    def chosen(self, which: Any) -> "Features":
        """Some of them, by index or by flag."""
        return Features(
            self.size_px,
            self.reduction,
            self.pixels[which],
            self.radii_px[which],
            self.strengths[which],
            self.descriptors[which],
        )


def detect_features(
    scan: ScanFile, usable: Usable | Mask | None = None, options: FeatureOptions | None = None
) -> Features:
    """Features of a scan where it may be used, spread over the frame.

    Args:
        scan: The scan.
        usable: Where features may lie: a function of scan pixels, or a mask of any resolution
            that covers the whole scan; everywhere when None.
        options: How features are looked for.
    """
    options = options or FeatureOptions()
    may = usable_from_mask(usable, scan.size_px) if isinstance(usable, np.ndarray) else usable
    reduction = max(1, int(np.ceil(max(scan.size_px) / options.longest_side_px)))
    even = evened(read_reduced(scan, reduction), reduction, may, options)
    tiles = list(_tiles(even.shape[0], even.shape[1], options))
    with ThreadPoolExecutor(options.threads) as pool:
        found = list(pool.map(partial(_detect_in_tile, even, options), tiles))
    parts = [part for part in found if len(part[0])]
    if not parts:
        return _features(scan.size_px, reduction, np.zeros((0, 4)), _no_descriptors())
    keypoints = np.vstack([part[0] for part in parts])
    descriptors = np.vstack([part[1] for part in parts])
    everything = _features(scan.size_px, reduction, keypoints, descriptors)
    kept = everything if may is None else everything.chosen(may(everything.pixels))
    return kept.chosen(_spread(kept, options))


def usable_from_mask(mask: Mask, size_px: tuple[int, int]) -> Usable:
    """A mask over the whole scan as a function of scan pixels."""
    rows, columns = mask.shape

    def usable(pixels: PixelPoints) -> Flags:
        column = np.floor(pixels[:, 0] * columns / size_px[0]).astype(np.int64)
        row = np.floor(pixels[:, 1] * rows / size_px[1]).astype(np.int64)
        inside = (column >= 0) & (row >= 0) & (column < columns) & (row < rows)
        return inside & mask[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]

    return usable


def picture_area(
    photo: Photo, camera: Camera, inset_mm: float = 1.0, mark_mm: float = 3.0
) -> Usable:
    """The camera's picture area without its rim and without the fiducials, millimetres."""
    half = np.array(camera.frame_mm) / 2 - inset_mm
    marks = np.array(list(camera.fiducials_mm.values()), dtype=np.float64).reshape(-1, 2)

    def usable(pixels: PixelPoints) -> Flags:
        film = photo.interior.film_from_pixel(pixels)
        good = np.all(np.abs(film) <= half, axis=1)
        for mark in marks:
            good &= np.sum((film - mark) ** 2, axis=1) > mark_mm**2
        return good

    return usable


def read_reduced(scan: ScanFile, reduction: int) -> Gray:
    """The whole scan, averaged over blocks of `reduction` pixels, read in bands."""
    columns, rows = (side // reduction for side in scan.size_px)
    gray = np.empty((rows, columns), dtype=np.float32)
    band = max(1, 2048 // reduction)
    for row in range(0, rows, band):
        height = min(band, rows - row)
        gray[row : row + height] = read_window(
            scan, 0, row * reduction, columns * reduction, height * reduction, reduction
        )
    return gray


def evened(
    gray: Gray, reduction: int, usable: Usable | None, options: FeatureOptions
) -> UInt8[np.ndarray, "rows columns"]:
    """Grey values with equal mean and contrast everywhere (Wallis), middle grey where unusable."""
    rows, columns = gray.shape
    step = 8
    small = (max(1, columns // step), max(1, rows // step))
    weight = _weight(small, (columns, rows), reduction, usable)
    blur = partial(cv2.GaussianBlur, ksize=(0, 0), sigmaX=options.shading_px / step)
    share = np.maximum(blur(weight), 1e-3)
    thumbnail = cv2.resize(gray, small, interpolation=cv2.INTER_AREA)
    square = cv2.resize(gray * gray, small, interpolation=cv2.INTER_AREA)
    mean = blur(thumbnail * weight) / share
    deviation = np.sqrt(np.maximum(blur(square * weight) / share - mean * mean, 0.0))
    used = weight > 0.5
    # Empty sky or deep shade must not be blown up into grain.
    floor = 0.25 * float(np.median(deviation[used])) if used.any() else 1.0
    gain = 40.0 / np.maximum(deviation, max(floor, 1e-3))
    grain = options.grain_px * (2.0 if reduction == 1 else 1.0)
    smooth = cv2.GaussianBlur(gray, (0, 0), grain) if grain > 0 else gray
    full = {"dsize": (columns, rows), "interpolation": cv2.INTER_LINEAR}
    smooth = (smooth - cv2.resize(mean, **full)) * cv2.resize(gain, **full)
    smooth *= cv2.resize(weight, **full)
    return np.clip(np.rint(smooth + 128.0), 0, 255).astype(np.uint8)


def _weight(
    small: tuple[int, int], size: tuple[int, int], reduction: int, usable: Usable | None
) -> Gray:
    """1 where the reduced scan may be used and 0 elsewhere, on a thumbnail."""
    if usable is None:
        return np.ones((small[1], small[0]), dtype=np.float32)
    column = (np.arange(small[0]) + 0.5) * size[0] / small[0] * reduction
    row = (np.arange(small[1]) + 0.5) * size[1] / small[1] * reduction
    grid = np.stack(np.meshgrid(column, row), axis=-1).reshape(-1, 2)
    return usable(grid).reshape(small[1], small[0]).astype(np.float32)


def _tiles(rows: int, columns: int, options: FeatureOptions) -> Iterator[tuple[int, int, int, int]]:
    """Column, row, columns and rows of each tile's own part."""
    for row in range(0, rows, options.tile_px):
        for column in range(0, columns, options.tile_px):
            width = min(options.tile_px, columns - column)
            yield column, row, width, min(options.tile_px, rows - row)


def _detect_in_tile(
    even: UInt8[np.ndarray, "rows columns"],
    options: FeatureOptions,
    tile: tuple[int, int, int, int],
) -> tuple[Float64[np.ndarray, "n 4"], Descriptors]:
    """Column, row (reduced, corner origin), radius and strength of a tile's own features."""
    column, row, width, height = tile
    left, top = max(0, column - options.margin_px), max(0, row - options.margin_px)
    right, bottom = column + width + options.margin_px, row + height + options.margin_px
    # Without the precise upscale every place is a quarter of a pixel too far right and down.
    sift = cv2.SIFT_create(
        contrastThreshold=options.contrast_threshold, enable_precise_upscale=True
    )
    found, descriptors = sift.detectAndCompute(even[top:bottom, left:right], None)
    if not found:
        return np.zeros((0, 4)), _no_descriptors()
    raw = np.array([(*key.pt, key.size / 2, key.response) for key in found], dtype=np.float64)
    raw[:, :2] = pixel_from_opencv(raw[:, :2]) + [left, top]
    own = (raw[:, 0] >= column) & (raw[:, 0] < column + width)
    own &= (raw[:, 1] >= row) & (raw[:, 1] < row + height)
    return raw[own], _root(np.asarray(descriptors, dtype=np.float32)[own])


def _root(descriptors: Float32[np.ndarray, "n 128"]) -> Descriptors:
    """RootSIFT: the square root of the description normed to a sum of one, times 512."""
    total = np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-6)
    root = np.sqrt(np.maximum(descriptors, 0.0) / total) * 512.0
    return np.clip(np.rint(root), 0, 255).astype(np.uint8)


def _spread(features: Features, options: FeatureOptions) -> np.ndarray:
    """Indices of the strongest features of every cell, in a fixed order."""
    if len(features.pixels) <= options.max_features:
        return np.arange(len(features.pixels))
    cell = np.floor(features.pixels * options.cells / np.array(features.size_px)).astype(np.int64)
    number = cell[:, 1] * options.cells + cell[:, 0]
    quota = int(np.ceil(options.max_features / len(np.unique(number))))
    order = np.lexsort((-features.strengths, number))
    first = np.searchsorted(number[order], number[order], side="left")
    return np.sort(order[np.arange(len(order)) - first < quota])


def _features(
    size_px: tuple[int, int],
    reduction: int,
    keypoints: Float64[np.ndarray, "n 4"],
    descriptors: Descriptors,
) -> Features:
    """Keypoints of the reduced scan as features of the scan."""
    return Features(
        size_px,
        reduction,
        keypoints[:, :2] * reduction,
        keypoints[:, 2] * reduction,
        keypoints[:, 3],
        descriptors,
    )


def _no_descriptors() -> Descriptors:
    """None at all."""
    return np.zeros((0, DESCRIPTOR_LENGTH), dtype=np.uint8)
