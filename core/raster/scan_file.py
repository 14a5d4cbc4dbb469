"""A scan as a file that is read by windows; what cannot be read says why and what to do."""

import warnings
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Literal

import numpy as np
import rasterio
from jaxtyping import Float32
from rasterio.enums import ColorInterp, Resampling
from rasterio.errors import NotGeoreferencedWarning, RasterioError
from rasterio.windows import Window

from core.errors import ScanError
from core.geometry.camera import Camera
from core.raster.usable_area import UsableArea

GrayWindow = Float32[np.ndarray, "rows columns"]
"""Part of a scan as gray values."""
LUMA = (0.299, 0.587, 0.114)
"""Weights of red, green and blue in gray, ITU-R BT.601."""
READABLE = ("uint8", "uint16")
TAIL_BYTES = 65536
OPENING = Lock()
MIN_FIT, MAX_FIT = 0.9, 1.6
"""Side of the scan relative to the side of the frame that still counts as this camera's."""
PAGE_FIT = 5.0
"""The same of a whole page on a flat bed, on which the photo's border has to be seen."""


@dataclass(frozen=True, slots=True)
class ScanFile:
    """A scan that has been opened once and found readable."""

    path: Path
    """The file."""
    size_px: tuple[int, int]
    """Columns and rows."""
    bands: int
    """Bands of the file; colour is turned into gray when read."""
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
        ScanError: Missing, empty, not an image, cut off, or of a pixel type that is not a scan's.
    """
    _check_file(path)
    with _opened(path) as dataset:
        scan = ScanFile(path, (dataset.width, dataset.height), dataset.count, dataset.dtypes[0])
        if scan.dtype not in READABLE:
            raise ScanError(
                path,
                f"Its pixels are {scan.dtype}, not 8 or 16 bit gray or colour.",
                "Save the scan as an 8 or 16 bit TIFF, JPEG or JPEG 2000.",
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
        f"{scan.size_px[0]} x {scan.size_px[1]} pixels of {scan_pixel_mm * 1000:g} um are "
        f"{sides[0]:.0f} x {sides[1]:.0f} mm, which does not fit the {frame[0]:g} x "
        f"{frame[1]:g} mm frame of camera '{camera.name}'.",
        f"Check scan_pixel_um in [scans] (a frame that fills the scan would need "
        f"{implied_um.min():.1f} um) and frame_mm of the camera, or give this scan its own camera "
        "in [[scans.override]].",
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
    first_j, last_j = _cells_inside(column, shape[1], reduction, scan.size_px[0])
    first_i, last_i = _cells_inside(row, shape[0], reduction, scan.size_px[1])
    if first_j >= last_j or first_i >= last_i:
        return np.full(shape, np.nan, dtype=np.float32)
    window = Window(
        column + first_j * reduction,  # pyright: ignore[reportCallIssue]
        row + first_i * reduction,
        (last_j - first_j) * reduction,
        (last_i - first_i) * reduction,
    )
    inside = _read_gray(scan, window, (last_i - first_i, last_j - first_j))
    if inside.shape == shape:
        return inside
    margins = ((first_i, shape[0] - last_i), (first_j, shape[1] - last_j))
    if outside == "edge":
        return np.pad(inside, margins, mode="edge")
    return np.pad(inside, margins, constant_values=np.nan)


def read_overview(scan: ScanFile, reduction: int) -> GrayWindow:
    """The whole scan, reduced; cells that would be cut off at the right and bottom are left out."""
    return read_window(scan, 0, 0, scan.size_px[0], scan.size_px[1], reduction)


def _read_gray(scan: ScanFile, window: Window, shape: tuple[int, int]) -> GrayWindow:
    """A window that lies inside the scan.

    Never GDAL's `boundless` reading: with a rotated world file beside the scan it reads elsewhere.
    """
    bands = _gray_bands(scan.bands)
    with _opened(scan.path) as dataset:
        try:
            values: Any = dataset.read(
                list(range(1, len(bands) + 1)),
                window=window,
                out_shape=(len(bands), *shape),
                out_dtype="float32",
                resampling=Resampling.average,
            )
        except (RasterioError, OSError) as error:
            raise ScanError(
                scan.path,
                "Part of its pixels cannot be read: the file is damaged, or was cut off.",
                "Copy the scan again from the archive.",
            ) from error
        if dataset.colorinterp[0] == ColorInterp.palette:
            values = _through_palette(values, dataset.colormap(1))
    if len(bands) == 1:
        return values[0]
    return np.einsum("b,bij->ij", np.array(bands, dtype=np.float32), values)


def _gray_bands(bands: int) -> tuple[float, ...]:
    """Weights of the first bands: one or two bands are gray, more begin with red, green, blue."""
    return LUMA if bands >= 3 else (1.0,)


def _through_palette(values: Any, palette: dict[int, tuple[int, int, int, int]]) -> Any:
    """Gray of palette entries."""
    table = np.zeros(max(palette) + 1, dtype=np.float32)
    for index, colour in palette.items():
        table[index] = np.dot(LUMA, colour[:3])
    return table[np.rint(values).astype(np.int64)]


def _cells_inside(start: int, cells: int, reduction: int, size: int) -> tuple[int, int]:
    """First and past-the-last cell that lie wholly inside 0 to size."""
    first = max(0, -(start // reduction))
    last = min(cells, (size - start) // reduction)
    return min(first, cells), max(last, 0)


@contextmanager
def _opened(path: Path) -> Generator[Any]:
    """The open dataset; what GDAL cannot open is a ScanError."""
    # Python's warning filters belong to all threads, so only one may put them aside at a time.
    with OPENING, warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        try:
            dataset = rasterio.open(path)
        except (RasterioError, OSError) as error:
            raise ScanError(
                path,
                "It is not an image that can be read, or its file was cut off.",
                "Copy the scan again from the archive, or take it out of [scans] files.",
            ) from error
    with dataset:
        yield dataset


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
            path, f"It cannot be read ({error.strerror}).", "Give yourself the right to read it."
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
