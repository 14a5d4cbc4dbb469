"""A scan file, read by windows, with the mask of its usable part.

Errors of reading name the cause and the remedy.
"""

import zlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Literal

import numpy as np
from jaxtyping import UInt8
from rasterio._err import CPLE_BaseError

from core.arrays import Flags, Indices, Mask, PixelPoints, locked
from core.errors import ScanError
from core.frames import HALF_PIXEL
from core.geometry.camera import Camera
from core.raster.grid import Pixels, Tile
from core.raster.scan_pixels import (
    STRIP_ROWS,
    BandWindow,
    GrayWindow,
    band_means,
    gray_means,
    open_dataset,
    shown_count,
)
from core.said import say

READABLE = ("uint8", "uint16")
# design: a large sample for a mean, and one read
SAMPLE_PX = 512
"""Side of the middle of a scan that tells whether it has colours."""
# design: the chroma of a JPEG differs by less in gray pictures, tints of prints by more
ALIKE = 0.004
"""Mean difference of bands, as a share of white, below which a scan has no colours."""
# design: film of 24 cm at half a micrometre; a damaged file may claim any size.
MOST_SIDE_PX = 500_000
"""Columns or rows of a scan."""
# design: what programs append behind the picture is shorter, and this is one read
TAIL_BYTES = 65536
"""A JPEG or JPEG 2000 ends with its mark within so many bytes of the end of the file."""
# design: a scan may cut off a twentieth of the frame at either side, or show a rim of a quarter of
# it; a scan_pixel_um that is wrong by a factor of two is refused.
MIN_FIT, MAX_FIT = 0.9, 1.6
"""Side of the scan relative to the side of the frame that still counts as this camera's."""
# design: a frame of 6 cm on a page of A4.
PAGE_FIT = 5.0
"""The same of a whole page on a flat bed, on which the photo's border has to be seen."""
# design: a scratch is a pixel or two wide, and a cubic kernel reaches two beside it.
SCRATCH_PX = 3.0
"""What is no farther than this from a scratch is not used, pixels."""


@dataclass(frozen=True, slots=True)
class Scratch:
    """A thin line along the film that is no part of the picture."""

    axis: int
    """0 when it runs along the rows of the scan, 1 along its columns."""
    first: float
    """Column (of axis 1, row) of its beginning, pixels."""
    last: float
    """The same of its end."""
    course: tuple[float, float, float]
    """Its row (of axis 1, column): the factors of the square, of the column, and the constant."""

    def near(self, pixels: PixelPoints, reach_px: float) -> Flags:
        """Which pixels lie no farther from it."""
        along, across = pixels[:, self.axis], pixels[:, 1 - self.axis]
        beside = np.abs(across - np.polyval(self.course, along)) <= reach_px
        return beside & (along >= self.first - reach_px) & (along <= self.last + reach_px)


@dataclass(frozen=True, slots=True, eq=False)
class UsableArea:
    """True where a scan may be used, in cells of equal size that cover the whole scan."""

    size_px: tuple[int, int]
    """Columns and rows of the scan."""
    shape: tuple[int, int]
    """Rows and columns of cells."""
    packed: UInt8[np.ndarray, "n"]
    """The cells as bits, row by row, deflated."""
    scratches: tuple[Scratch, ...] = ()
    """Lines that are left out, thinner than a cell."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "packed", locked(self.packed, np.uint8))

    @staticmethod
    def of(
        mask: Mask, size_px: tuple[int, int], scratches: tuple[Scratch, ...] = ()
    ) -> "UsableArea":
        """A mask of any resolution that covers the whole scan."""
        rows, columns = mask.shape
        deflated = zlib.compress(np.packbits(mask).tobytes())
        return UsableArea(size_px, (rows, columns), np.frombuffer(deflated, np.uint8), scratches)

    @property
    def mask(self) -> Mask:
        """The cells; unpacked anew each time, so that a thousand scans need no room."""
        bits = np.frombuffer(zlib.decompress(self.packed.tobytes()), np.uint8)
        count = self.shape[0] * self.shape[1]
        return np.unpackbits(bits, count=count).astype(bool).reshape(self.shape)

    def at(self, pixels: PixelPoints) -> Flags:
        """Whether scan pixels may be used; none outside the scan, nor where there is no number."""
        places = np.where(np.isfinite(pixels), pixels, -1.0)
        column, across = self._cells(places[:, 0], 0)
        row, down = self._cells(places[:, 1], 1)
        usable = across & down & self.mask[row, column]
        for scratch in self.scratches:
            usable &= ~scratch.near(places, SCRATCH_PX)
        return usable

    def within(self, column: int, row: int, columns: int, rows: int, reduction: int) -> Mask:
        """The same for all pixels of a window of the reduced scan that begins at a scan pixel.

        Asked by what looks at areas, such as templates, to which a scratch matters little.
        """
        cells, across = self._cells(column + (np.arange(columns) + HALF_PIXEL) * reduction, 0)
        lines, down = self._cells(row + (np.arange(rows) + HALF_PIXEL) * reduction, 1)
        return self.mask[np.ix_(lines, cells)] & np.outer(down, across)

    def _cells(self, places: np.ndarray, axis: int) -> tuple[Indices, Flags]:
        """Cells of scan columns (axis 0) or rows (1), and which of them lie in the scan."""
        count = self.shape[1 - axis]
        cells = np.floor(places * (count / self.size_px[axis]))
        inside = (cells >= 0) & (cells < count)
        return np.clip(cells, 0, count - 1).astype(np.int64), inside


@dataclass(frozen=True, slots=True)
class ScanFile:
    """A scan that has been opened once and found readable."""

    path: Path
    """The file."""
    size_px: tuple[int, int]
    """Columns and rows."""
    bands: int
    """Bands that show the ground; they are turned into gray but for orthos."""
    dtype: str
    """Type of its values: `uint8` or `uint16`."""
    usable: UsableArea | None = None
    """Which part of it is photograph, once that is known."""


def photo_id_of(path: Path) -> str:
    """Name of the photo of a scan: the file's name without folder and last extension."""
    return path.stem


def open_scan(path: Path) -> ScanFile:
    """Open a scan and probe its end, so that a cut file is found before it is needed.

    Raises:
        ScanError: Missing, empty, not an image, cut off, of an absurd size, or of a pixel type that
            is not a scan's.
    """
    _check_file(path)
    with open_dataset(path) as dataset:
        size = dataset.width, dataset.height
        try:
            bands = shown_count(dataset)
        except CPLE_BaseError as error:
            # GDAL looks for colours beside the scan as well.
            raise ScanError(
                path,
                say("A file beside it cannot be read ({error}).", error=str(error)),
                "Correct it or its permissions, or remove it.",
            ) from error
        scan = ScanFile(path, size, bands, dataset.dtypes[0])
        if scan.dtype not in READABLE:
            raise ScanError(
                path,
                say("Its pixels are {dtype}, not 8 or 16 bit gray or colour.", dtype=scan.dtype),
                "Save the scan as an 8 or 16 bit TIFF, JPEG or JPEG 2000.",
            )
        if max(scan.size_px) > MOST_SIDE_PX:
            raise ScanError(
                path,
                say(
                    "It says it has {columns} x {rows} pixels, which no scan has.",
                    columns=dataset.width,
                    rows=dataset.height,
                ),
                "Copy the scan again from the archive.",
            )
        if dataset.driver == "GTiff":
            _check_blocks(path, dataset)
    if dataset.driver in ("JPEG", "JP2OpenJPEG"):
        _check_end_marker(path)
    _probe_last_block(scan)
    return scan


def check_fits_camera(
    scan: ScanFile, camera: Camera, scan_pixel_mm: float, page: bool = False
) -> None:
    """Refuse a scan whose size cannot be that of the camera's frame.

    Args:
        scan: The scan.
        camera: Camera with the size of its frame.
        scan_pixel_mm: Nominal size of a scan pixel, millimetres.
        page: True when the scan may be a page that is much larger than the photo on it.

    Raises:
        ScanError: The scan is smaller than the frame, or more than 1.6 times (5 times) as large.
    """
    sides = np.array(scan.size_px, dtype=np.float64) * scan_pixel_mm
    frame = np.array(camera.frame_mm)
    if any(_fits(sides, turned, page) for turned in (frame, frame[::-1])):
        return
    implied_um = 1000 * np.sort(frame) / np.sort(np.array(scan.size_px))
    raise ScanError(
        scan.path,
        say(
            "{columns} x {rows} pixels of {pixel:g} µm are {wide:.0f} x {high:.0f} mm, "
            "which does not fit the {frame_wide:g} x {frame_high:g} mm frame of camera "
            "'{name}'.",
            columns=scan.size_px[0],
            rows=scan.size_px[1],
            pixel=scan_pixel_mm * 1000,
            wide=sides[0],
            high=sides[1],
            frame_wide=frame[0],
            frame_high=frame[1],
            name=camera.name,
        ),
        say(
            "Check scan_pixel_um in [scans] (a frame that fills the scan would need "
            "{implied:.1f} µm) and frame_mm of the camera, or give this scan its own "
            "camera in [[scans.override]].",
            implied=implied_um.min(),
        ),
    )


def read_window(
    scan: ScanFile,
    column: int,
    row: int,
    columns: int,
    rows: int,
    reduction: int = 1,
    outside: Literal["nan", "edge"] = "nan",
) -> GrayWindow:
    """Gray values of a window, averaged over `reduction` x `reduction` pixels.

    Args:
        scan: The scan.
        column: First column, pixels; may lie outside the scan.
        row: First row, pixels; may lie outside the scan.
        columns: Width of the window, pixels.
        rows: Height of the window, pixels.
        reduction: How many pixels a side become one.
        outside: NaN outside the scan, or the nearest value inside.

    Returns:
        (rows // reduction, columns // reduction) values; cell (i, j) covers the scan from column
        `column + j * reduction` and row `row + i * reduction` on.
    """
    shape = (rows // reduction, columns // reduction)
    part = _inside(scan, (column, row), shape, reduction)
    if part is None:
        return np.full(shape, np.nan, dtype=np.float32)
    window, margins = part
    inside = gray_means(scan.path, window, reduction)
    if inside.shape == shape:
        return inside
    if outside == "edge":
        return np.pad(inside, margins, mode="edge")
    return np.pad(inside, margins, constant_values=np.nan)


def read_bands(scan: ScanFile, window: Tile, reduction: int = 1) -> BandWindow:
    """The same of each band, for a window that meets the scan; edge values go on outside."""
    column, row, columns, rows = window
    shape = (rows // reduction, columns // reduction)
    part = _inside(scan, (column, row), shape, reduction)
    assert part is not None, window
    inside = band_means(scan.path, part[0], reduction)
    return inside if inside.shape[1:] == shape else np.pad(inside, ((0, 0), *part[1]), mode="edge")


Margins = tuple[tuple[int, int], tuple[int, int]]
"""Cells above and below, left and right of what lies inside a scan."""


def _inside(
    scan: ScanFile, first: tuple[int, int], shape: tuple[int, int], reduction: int
) -> tuple[Tile, Margins] | None:
    """The window of whole cells within a scan, and what is missing around it; None for none."""
    (top, bottom), (left, right) = (
        _cells_inside(first[1 - axis], shape[axis], reduction, scan.size_px[1 - axis])
        for axis in (0, 1)
    )
    if left >= right or top >= bottom:
        return None
    corner = (first[0] + left * reduction, first[1] + top * reduction)
    size = ((right - left) * reduction, (bottom - top) * reduction)
    return (*corner, *size), ((top, shape[0] - bottom), (left, shape[1] - right))


def read_overview(scan: ScanFile, reduction: int) -> GrayWindow:
    """The whole scan, reduced; cells that would be cut off at the right and bottom are left out."""
    return read_window(scan, 0, 0, scan.size_px[0], scan.size_px[1], reduction)


def _cells_inside(start: int, cells: int, reduction: int, size: int) -> tuple[int, int]:
    """First and past-the-last cell that lie wholly inside 0 to size."""
    first = max(0, -(start // reduction))
    last = min(cells, (size - start) // reduction)
    return min(first, cells), max(last, 0)


def _check_file(path: Path) -> None:
    """Missing, a folder, empty or forbidden files, told apart."""
    if not path.exists():
        raise ScanError(path, "The file is missing.", "Check the path in [scans] files.")
    if not path.is_file():
        raise ScanError(path, "It is not a file.", "Let [scans] files name image files.")
    try:
        size = path.stat().st_size
        with path.open("rb"):
            pass
    except OSError as error:
        raise ScanError(
            path,
            say("It cannot be read ({strerror}).", strerror=error.strerror),
            "Give yourself the right to read it.",
        ) from error
    if size == 0:
        raise ScanError(path, "The file is empty.", "Copy the scan again from the archive.")


def _check_blocks(path: Path, dataset: Any) -> None:
    """A TIFF knows where its blocks lie: all of them must end before the file does."""
    size = path.stat().st_size
    height, width = dataset.block_shapes[0]
    across, down = -(-dataset.width // width), -(-dataset.height // height)
    last_rows, last_band = range(max(0, down - 4), down), dataset.count
    for j in range(across):
        for i in (0, *last_rows):
            offset = dataset.get_tag_item(f"BLOCK_OFFSET_{j}_{i}", "TIFF", bidx=last_band)
            length = dataset.get_tag_item(f"BLOCK_SIZE_{j}_{i}", "TIFF", bidx=last_band)
            if offset and length and int(offset) + int(length) > size:
                raise _cut_off(path)


def _check_end_marker(path: Path) -> None:
    """JPEG and JPEG 2000 end with FF D9; a file without it near its end was cut off."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - TAIL_BYTES))
        if b"\xff\xd9" not in file.read():
            raise _cut_off(path)


def _probe_last_block(scan: ScanFile) -> None:
    """Decode the last pixel of a TIFF: the end of the data is what a broken copy lacks."""
    if scan.path.suffix.lower() in (".tif", ".tiff"):
        columns, rows = scan.size_px
        read_window(scan, columns - 1, rows - 1, 1, 1)


def _cut_off(path: Path) -> ScanError:
    """The error of a file that ends before its data do."""
    return ScanError(
        path,
        "The file was cut off: its header is there, the end of its data is not.",
        "Copy the scan again from the archive.",
    )


def _fits(sides: np.ndarray, frame: np.ndarray, page: bool) -> bool:
    """True when a scan of these sides (mm) can hold the frame (mm)."""
    ratio = sides / frame
    return bool((ratio >= MIN_FIT).all() and (ratio <= (PAGE_FIT if page else MAX_FIT)).all())


class ScanSource:
    """Windows of one scan, averaged over `reduction` pixels a side, in the type of the scan.

    A scan is read once from end to end where it fits the budget: film scans come in strips as
    often as in tiles, and a turned photo would have every strip decoded for every ortho tile. Of a
    colour scan every band is read, unless they are alike: film without colours is often scanned so.
    """

    def __init__(self, path: Path, reduction: int, threads: int, budget_bytes: int) -> None:
        self.scan: ScanFile = open_scan(path)
        self.reduction = reduction
        self.dtype = np.dtype(self.scan.dtype)
        self.bands = 1 if self.scan.bands == 1 or _is_gray(self.scan) else self.scan.bands
        """How many bands it has; windows of one have none."""
        columns, rows = (-(-size // reduction) for size in self.scan.size_px)
        fits = columns * rows * self.bands * self.dtype.itemsize <= budget_bytes
        self._whole: Pixels | None = self._read_whole(columns, rows, threads) if fits else None

    def window(self, column: int, row: int, columns: int, rows: int) -> Pixels:
        """A window counted in reduced pixels; edge values go on outside the scan."""
        if self._whole is not None:
            return self._whole[row : row + rows, column : column + columns]
        return self._read(column, row, columns, rows)

    def _read_whole(self, columns: int, rows: int, threads: int) -> Pixels:
        shape = (rows, columns) if self.bands == 1 else (rows, columns, self.bands)
        whole = np.empty(shape, dtype=self.dtype)

        def read(start: int) -> None:
            end = min(start + STRIP_ROWS, rows)
            whole[start:end] = self._read(0, start, columns, end - start)

        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(read, range(0, rows, STRIP_ROWS)))
        return whole

    def _read(self, column: int, row: int, columns: int, rows: int) -> Pixels:
        step = self.reduction
        window = (column * step, row * step, columns * step, rows * step)
        if self.bands == 1:
            values = read_window(self.scan, *window, step, "edge")
        else:
            values = np.ascontiguousarray(np.moveaxis(read_bands(self.scan, window, step), 0, -1))
        np.rint(values, out=values)
        return values.astype(self.dtype)


def _is_gray(scan: ScanFile) -> bool:
    """Whether the first three bands of a scan are alike in its middle."""
    columns, rows = (min(size, SAMPLE_PX) for size in scan.size_px)
    column, row = (
        (size - side) // 2 for size, side in zip(scan.size_px, (columns, rows), strict=True)
    )
    red, *others = read_bands(scan, (column, row, columns, rows))[:3]
    least = ALIKE * float(np.iinfo(scan.dtype).max)
    return scan.bands <= 3 and all(float(np.abs(one - red).mean()) < least for one in others)


class ScanFiles:
    """Grey values of windows of scans, by their path; asked from several threads."""

    def __init__(self, folder: Path = Path()) -> None:
        """Paths of scans that are not absolute are counted from `folder`."""
        self._folder = folder
        self._opened: dict[Path, ScanFile] = {}
        self._lock = Lock()

    def __call__(
        self, scan: Path, column: int, row: int, columns: int, rows: int, reduction: int
    ) -> GrayWindow:
        """Grey values of a window, averaged over `reduction` pixels a side."""
        return read_window(self.opened(scan), column, row, columns, rows, reduction, "edge")

    def opened(self, scan: Path) -> ScanFile:
        """A scan by its path, looked at once."""
        with self._lock:
            if scan not in self._opened:
                self._opened[scan] = open_scan(self._folder / scan)
            return self._opened[scan]
