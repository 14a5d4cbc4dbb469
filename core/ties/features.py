"""Features of one scan: keypoints with descriptors.

SIFT on a reduced scan, by tiles so that memory stays small; places are scan pixels.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, cast

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from core.arrays import Flags, Indices, Mask, PixelPoints, Scalars, locked
from core.block import Photo
from core.frames import pixel_from_opencv
from core.geometry.camera import Camera
from core.kept_arrays import KeptArray, KeptArrays
from core.raster.scan_file import ScanFile, UsableArea, read_window

Descriptors = UInt8[np.ndarray, "n 128"]
"""RootSIFT times 512: whole numbers, so that products in single precision are exact."""
Gray = Float32[np.ndarray, "rows columns"]
"""Grey values of a reduced scan."""
Usable = Callable[[PixelPoints], Flags]
"""Says of scan pixels whether features may lie there."""
DESCRIPTOR_LENGTH = 128  # source: Lowe 2004, section 6.1: 4 x 4 cells of 8 directions
MARGIN_PX = 48  # design: the descriptions of all but the few largest features reach no further
"""Each tile sees this much of its neighbours, pixels of the reduced scan."""
THREADS = 2  # design: memory; SIFT's pyramid of one tile takes some 300 MB
"""Tiles at work at the same time."""
CELLS = 16  # design: five cells along each side of one of the 3 x 3 Gruber areas
"""Cells along each side of the scan among which features are shared out, strongest first."""
# design: under half of OpenCV's 0.04: the evened scan has equal contrast, and cells choose anyway
LEAST_CONTRAST = 0.015
"""SIFT's own measure of contrast."""
SHADING_PX = 64.0  # design: wider than a field's texture, narrower than shading of the lens
"""Gaussian radius of the mean and deviation that are evened out, pixels of the reduced scan."""
STEP_PX = 8  # design: an eighth of SHADING_PX: what is blurred that far has no finer detail
"""Mean and deviation are found on a thumbnail with such pixels."""
DEVIATION = 40.0  # design: three deviations either side fill the range of 8 bits
"""Standard deviation of grey values after they are evened out."""
LEAST_DEVIATION = 0.25  # design: empty sky or deep shade must not be blown up into grain
"""Grey values that vary by less than this share of the usual are raised no further."""
# design: about the blur of half a pixel that SIFT takes every picture to have
GRAIN_PX = 0.6
"""Gaussian radius against film grain, pixels; scans that are not reduced get twice as much."""
DESCRIPTION_SCALE = 512.0  # source: factor of OpenCV's whole-numbered SIFT descriptions
BAND_ROWS = 2048  # design: memory; 130 MB of a scan 16,000 pixels wide
"""Rows of the scan read at a time."""
TINY = 1e-3  # design: numerical safety where nothing may be used or nothing varies


@dataclass(frozen=True, slots=True)
class FeatureOptions:
    """How features are looked for; pixels of the reduced scan unless said otherwise."""

    # design: time; finer places in film are mostly grain, and ties are measured on the scan later
    longest_side_px: int = 2000
    """The scan is reduced by the smallest whole factor that makes its longer side this short. SIFT
    begins at twice that scale."""
    tile_px: int = 1024  # design: memory, see THREADS
    """Side of a tile."""
    # design: some 60 to a cell, so that a pair that overlaps by a fifth still shares hundreds
    max_features: int = 16_000
    """Features kept of one scan."""


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
    descriptors: Descriptors | KeptArray
    """What they look like, laid by where all scans together would be too much for memory."""

    def __post_init__(self) -> None:
        for name in ("pixels", "radii_px", "strengths"):
            object.__setattr__(self, name, locked(getattr(self, name)))
        if isinstance(self.descriptors, np.ndarray):
            object.__setattr__(self, "descriptors", locked(self.descriptors, np.uint8))

    def described(self) -> Descriptors:
        """What they look like, in memory."""
        kept = self.descriptors
        return kept.read() if isinstance(kept, KeptArray) else kept

    def laid_by(self, store: KeptArrays) -> "Features":
        """The same with the descriptors in a file.

        Raises:
            PhotogrammetryError: The file cannot be written.
        """
        return replace(self, descriptors=store.keep(self.described()))

    @staticmethod
    def none(size_px: tuple[int, int]) -> "Features":
        """No features, of a scan without picture."""
        no_number, no_place = np.zeros(0), np.zeros((0, 2))
        descriptors = np.zeros((0, 128), dtype=np.uint8)
        return Features(size_px, 1, no_place, no_number, no_number, descriptors)

    def chosen(self, which: Any) -> "Features":
        """Some of them, by index or by flag."""
        return Features(
            self.size_px,
            self.reduction,
            self.pixels[which],
            self.radii_px[which],
            self.strengths[which],
            self.described()[which],
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
    may = UsableArea.of(usable, scan.size_px).at if isinstance(usable, np.ndarray) else usable
    reduction = max(1, int(np.ceil(max(scan.size_px) / options.longest_side_px)))
    even = even_contrast(read_reduced(scan, reduction), reduction, may)
    reduced = _Reduced(even, scan.size_px, reduction, may, _quota(scan.size_px, may, options))
    tiles = list(_tiles(even.shape[0], even.shape[1], options))
    with ThreadPoolExecutor(THREADS) as pool:
        found = list(pool.map(partial(_detect_in_tile, reduced), tiles))
    parts = [_no_features(scan.size_px, reduction), *found]
    together = Features(
        scan.size_px,
        reduction,
        np.vstack([part.pixels for part in parts]),
        np.concatenate([part.radii_px for part in parts]),
        np.concatenate([part.strengths for part in parts]),
        np.vstack([part.described() for part in parts]),
    )
    # Tiles cut through cells: only here is it known which features are a cell's strongest.
    return together.chosen(
        strongest_per_cell(reduced.cells_of(together.pixels), together.strengths, reduced.quota)
    )


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
    band = max(1, BAND_ROWS // reduction)
    for row in range(0, rows, band):
        height = min(band, rows - row)
        gray[row : row + height] = read_window(
            scan, 0, row * reduction, columns * reduction, height * reduction, reduction
        )
    return gray


def even_contrast(
    gray: Gray, reduction: int, usable: Usable | None
) -> UInt8[np.ndarray, "rows columns"]:
    """Grey values with equal mean and contrast everywhere (Wallis), middle grey where unusable."""
    rows, columns = gray.shape
    small = (max(1, columns // STEP_PX), max(1, rows // STEP_PX))
    weight = _weight(small, (columns, rows), reduction, usable)
    blur = partial(cv2.GaussianBlur, ksize=(0, 0), sigmaX=SHADING_PX / STEP_PX)
    share = np.maximum(blur(weight), TINY)
    thumbnail = cv2.resize(gray, small, interpolation=cv2.INTER_AREA)
    square = cv2.resize(gray * gray, small, interpolation=cv2.INTER_AREA)
    mean = blur(thumbnail * weight) / share
    deviation = np.sqrt(np.maximum(blur(square * weight) / share - mean * mean, 0.0))
    used = weight > 0.5
    floor = LEAST_DEVIATION * float(np.median(deviation[used])) if used.any() else 1.0
    gain = DEVIATION / np.maximum(deviation, max(floor, TINY))
    grain = GRAIN_PX * (2.0 if reduction == 1 else 1.0)
    smooth = cv2.GaussianBlur(gray, (0, 0), grain)
    smooth -= cv2.resize(mean, (columns, rows))
    smooth *= cv2.resize(gain * weight, (columns, rows))
    smooth += 256 / 2
    # Rounds, and clips to 0 to 255.
    return np.asarray(cv2.convertScaleAbs(np.maximum(smooth, 0.0)), dtype=np.uint8)


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


@dataclass(frozen=True, slots=True, eq=False)
class _Reduced:
    """A reduced scan, ready for detection."""

    even: UInt8[np.ndarray, "rows columns"]
    size_px: tuple[int, int]
    reduction: int
    usable: Usable | None
    quota: int
    """Features that one cell may keep."""

    def cells_of(self, pixels: PixelPoints) -> Indices:
        """Number of the cell of scan pixels."""
        cell = np.floor(pixels * CELLS / np.array(self.size_px)).astype(np.int64)
        return cell[:, 1] * CELLS + cell[:, 0]


def _quota(size_px: tuple[int, int], usable: Usable | None, options: FeatureOptions) -> int:
    """Features per cell such that all cells that may be used together hold the wanted number."""
    fine = 4 * CELLS
    line = (np.arange(fine) + 0.5) / fine
    grid = np.stack(np.meshgrid(line * size_px[0], line * size_px[1]), axis=-1).reshape(-1, 2)
    if usable is None:
        return int(np.ceil(options.max_features / CELLS**2))
    open_cells = usable(grid).reshape(CELLS, 4, CELLS, 4).any(axis=(1, 3))
    return int(np.ceil(options.max_features / max(int(open_cells.sum()), 1)))


def strongest_per_cell(cells: Indices, strengths: Scalars, quota: int) -> np.ndarray:
    """Indices, ascending, of at most `quota` of the strongest in each cell."""
    order = np.lexsort((-strengths, cells))
    first = np.searchsorted(cells[order], cells[order], side="left")
    return np.sort(order[np.arange(len(order)) - first < quota])


def _detect_in_tile(reduced: _Reduced, tile: tuple[int, int, int, int]) -> Features:
    """The strongest features in a tile's own part; only they are described."""
    column, row, width, height = tile
    left, top = max(0, column - MARGIN_PX), max(0, row - MARGIN_PX)
    right, bottom = column + width + MARGIN_PX, row + height + MARGIN_PX
    gray = reduced.even[top:bottom, left:right]
    # Without the precise upscale every place is a quarter of a pixel too far right and down.
    sift = cast(Any, cv2).SIFT_create(contrastThreshold=LEAST_CONTRAST, enable_precise_upscale=True)
    found = sift.detect(gray, None)
    raw = np.array([(*key.pt, key.response) for key in found], dtype=np.float64).reshape(-1, 3)
    place = pixel_from_opencv(raw[:, :2]) + np.array([left, top])
    own = (place[:, 0] >= column) & (place[:, 0] < column + width)
    own &= (place[:, 1] >= row) & (place[:, 1] < row + height)
    pixels = place * reduced.reduction
    if reduced.usable is not None:
        own &= reduced.usable(pixels)
    kept = np.flatnonzero(own)
    cells = reduced.cells_of(pixels[kept])
    kept = kept[strongest_per_cell(cells, raw[kept, 2], reduced.quota)]
    if len(kept) == 0:
        return _no_features(reduced.size_px, reduced.reduction)
    keys, descriptors = sift.compute(gray, [found[index] for index in kept.tolist()])
    # Keys that cannot be described are left out, hence places once more from what came back.
    raw = np.array([(*key.pt, key.response, key.size / 2) for key in keys], dtype=np.float64)
    return Features(
        reduced.size_px,
        reduced.reduction,
        (pixel_from_opencv(raw[:, :2]) + np.array([left, top])) * reduced.reduction,
        raw[:, 3] * reduced.reduction,
        raw[:, 2],
        _root(np.asarray(descriptors, dtype=np.float32)),
    )


def _root(descriptors: Float32[np.ndarray, "n 128"]) -> Descriptors:
    """RootSIFT: the square root of the description normed to a sum of one, as whole numbers."""
    # OpenCV's descriptions are whole numbers: the least sum that is not nought is one.
    total = np.maximum(descriptors.sum(axis=1, keepdims=True), 1.0)
    root = np.sqrt(np.maximum(descriptors, 0.0) / total) * DESCRIPTION_SCALE
    return np.clip(np.rint(root), 0, 255).astype(np.uint8)


def _no_features(size_px: tuple[int, int], reduction: int) -> Features:
    """None at all."""
    none = np.zeros(0)
    descriptors = np.zeros((0, DESCRIPTOR_LENGTH), dtype=np.uint8)
    return Features(size_px, reduction, np.zeros((0, 2)), none, none, descriptors)
