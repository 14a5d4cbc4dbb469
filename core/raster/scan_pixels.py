"""Gray pixels of a scan as its file has them: averages, levels of JPEG 2000, palettes, polarity."""

from collections.abc import Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64, Shaped
from rasterio._err import CPLE_AppDefinedError
from rasterio.enums import ColorInterp
from rasterio.errors import RasterioError

from core.errors import ScanError
from core.frames import HALF_PIXEL
from core.raster.files import FILES, gray_from_colour
from core.raster.grid import Tile, sums_over_cells, window_of

GrayWindow = Float32[np.ndarray, "rows columns"]
"""Part of a scan as gray values."""
BandWindow = Float32[np.ndarray, "bands rows columns"]
"""Part of a scan, band by band."""
# design: some tens of megabytes, and rows of strips or tiles are decoded once.
STRIP_ROWS = 1024
"""Rows that one thread reads at a time into memory."""
# source: ISO/IEC 15444-1, annex F: a level has every second sample of the one below.
LEAST_LEVEL = 2
"""Scan pixels per pixel of the first level of a JPEG 2000, along each axis."""


def gray_means(path: Path, window: Tile, side: int) -> GrayWindow:
    """Means over square cells of a window of whole cells that lies inside the scan.

    Averages are made here: GDAL takes overviews, which lie aside where they are nearest neighbours
    or levels of JPEG 2000, and leaves out pixels that have the value of nodata. Never GDAL's
    `boundless` reading: with a rotated world file beside the scan it reads elsewhere.
    One or two bands are gray, more begin with red, green, blue.
    """
    gray = np.empty((window[3] // side, window[2] // side), dtype=np.float32)
    for rows, bands in _strips(path, window, side, every=False):
        gray[rows] = bands[0] if len(bands) == 1 else gray_from_colour(bands)
    return gray


def band_means(path: Path, window: Tile, side: int) -> BandWindow:
    """The same of each band that shows the ground, infrared too; alpha is none."""
    return np.concatenate(
        [bands for _, bands in _strips(path, window, side, every=True)], axis=1, dtype=np.float32
    )


def _strips(
    path: Path, window: Tile, side: int, *, every: bool
) -> Iterator[tuple[slice, Shaped[np.ndarray, "_ _ _"]]]:
    """Rows of cells and their means by band, strip by strip."""
    column, row, columns, rows = window
    options, step = _level_of(path, side)
    strip = max(1, STRIP_ROWS // side)
    with open_dataset(path, **options) as dataset:
        for top in range(0, rows // side, strip):
            count = min(strip, rows // side - top)
            part = (column, row + top * side, columns, count * side)
            try:
                bands = _means(dataset, part, side, step, every=every)
            except (RasterioError, OSError) as error:
                raise ScanError(
                    path,
                    "Part of its pixels cannot be read: the file is damaged, or was cut off.",
                    "Copy the scan again from the archive.",
                ) from error
            yield slice(top, top + count), bands


def _level_of(path: Path, side: int) -> tuple[dict[str, str], int]:
    """Open options of the level of a JPEG 2000 that is enough for cells, and its pixels' side.

    A pixel of a level has two neighbours at least within a cell. Other files are read whole.
    """
    if side >= 2 * LEAST_LEVEL:
        with open_dataset(path) as dataset:
            foreign = any(file.endswith(".ovr") for file in dataset.files)
            if dataset.driver == "JP2OpenJPEG" and not foreign and not _has_palette(dataset):
                steps = [step for step in dataset.overviews(1) if 2 * step <= side]
                if steps:
                    return {"OVERVIEW_LEVEL": str(len(steps) - 1)}, steps[-1]
    return {}, 1


def _means(
    dataset: Any, part: Tile, side: int, step: int, *, every: bool
) -> Shaped[np.ndarray, "_ rows columns"]:
    """Means of each band over square cells of scan pixels, whole numbers, from pixels of a level.

    The middle of a level's pixel is not its own: it is that of every `step`-th pixel of the scan,
    beginning with the first, around which the wavelet is symmetric.
    """
    if step == 1:
        values = _pixels(dataset, part, every)
        return values if side == 1 else np.stack([_cell_means(band, side) for band in values])
    (left, right, across), (top, bottom, down) = (
        _edges(start, length, side, step, size)
        for start, length, size in zip(
            part[:2], part[2:], (dataset.width, dataset.height), strict=True
        )
    )
    values = _pixels(dataset, (left, top, right - left, bottom - top), every)
    most = np.iinfo(values.dtype).max
    means = [_means_between(_means_between(band, down).T, across).T for band in values]
    return np.stack([np.clip(np.floor(found + 0.5), 0, most) for found in means])


def _cell_means(values: Shaped[np.ndarray, "_ _"], side: int) -> Float32[np.ndarray, "_ _"]:
    """Means over square cells, rounded."""
    return ((sums_over_cells(values, side) + side**2 // 2) // side**2).astype(np.float32)


def _edges(
    start: int, length: int, side: int, step: int, size: int
) -> tuple[int, int, Float64[np.ndarray, "_"]]:
    """First and past-the-last pixel of a level under cells along one axis, and the cells' edges.

    Edges are counted in pixels of the level from the middle of that first one.
    """
    edges = (start + np.arange(0, length + 1, side) - HALF_PIXEL) / step
    first, last = max(int(edges[0]), 0), min(int(edges[-1]) + 2, size)
    return first, last, edges - first


def _means_between(
    values: Shaped[np.ndarray, "n across"], edges: Float64[np.ndarray, "_"]
) -> Float64[np.ndarray, "_ across"]:
    """Means between edges, counted from the first value's place, of what is straight between."""
    before = np.clip(np.floor(edges).astype(np.int64), 0, len(values) - 2)
    beyond = (edges - before)[:, None]
    rise = values[before + 1].astype(np.float64) - values[before]
    areas = np.cumsum(values, axis=0, dtype=np.float64)[before]
    areas += (beyond - 0.5) * values[before] + beyond**2 / 2 * rise
    return np.diff(areas, axis=0) / np.diff(edges)[:, None]


def shown_bands(dataset: Any) -> list[int]:
    """Numbers of the bands that show the ground; one of a palette, which stands for three."""
    if dataset.count < 3:
        return [1]
    kinds = zip(dataset.indexes, _kinds(dataset), strict=True)
    return [number for number, kind in kinds if kind != ColorInterp.alpha]


def shown_count(dataset: Any) -> int:
    """How many bands `band_means` tells."""
    return 3 if _has_palette(dataset) else len(shown_bands(dataset))


def _pixels(dataset: Any, window: Tile, every: bool) -> Shaped[np.ndarray, "_ rows columns"]:
    """Gray, or red, green and blue, or every band, as the file has them; more is brighter."""
    bands = shown_bands(dataset) if every else [1, 2, 3] if dataset.count >= 3 else [1]
    values: Any = dataset.read(bands, window=window_of(window))
    if _has_palette(dataset):
        table = np.zeros((int(np.iinfo(values.dtype).max) + 1, 3), dtype=np.uint8)
        for index, colour in dataset.colormap(1).items():
            table[index] = colour[:3]
        return np.moveaxis(table[values[0]], -1, 0)
    if white_is_nought(dataset):
        bits = dataset.tags(1, ns="IMAGE_STRUCTURE").get("NBITS")
        return (2 ** int(bits) - 1 if bits else np.iinfo(values.dtype).max) - values
    return values


def white_is_nought(dataset: Any) -> bool:
    """Whether a TIFF says that its values grow with darkness; GDAL leaves them as they are."""
    return dataset.tags(ns="IMAGE_STRUCTURE").get("MINISWHITE") == "YES"


def _has_palette(dataset: Any) -> bool:
    """Whether the values are numbers of colours."""
    return bool(_kinds(dataset)[0] == ColorInterp.palette)


def _kinds(dataset: Any) -> Sequence[ColorInterp]:
    """What each band shows."""
    try:
        return dataset.colorinterp
    except CPLE_AppDefinedError as error:
        # What a camera wrote of itself may be damaged. GDAL says so once; no pixel needs it.
        if "EXIF" not in str(error):
            raise
        return dataset.colorinterp


@contextmanager
def open_dataset(path: Path, **options: str) -> Generator[Any]:
    """The open dataset; what GDAL cannot open is a ScanError."""
    with ExitStack() as stack:
        try:
            dataset = stack.enter_context(FILES.borrow(path, **options))
        except (RasterioError, OSError) as error:
            raise ScanError(
                path,
                "It is not an image that can be read, or its file was cut off.",
                "Copy the scan again from the archive, or take it out of [scans] files.",
            ) from error
        yield dataset
