"""Raster files: those that wait open, decoded tiles of them (both bounded), and colour as gray."""

import os
import sys
import warnings
from collections import OrderedDict
from collections.abc import Callable, Generator, Hashable, Mapping
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import Any, Protocol, TypeVar, cast, runtime_checkable
from xml.sax.saxutils import escape

import numpy as np
import rasterio
from jaxtyping import Float32, Num
from rasterio._env import set_gdal_config
from rasterio.errors import NotGeoreferencedWarning, RasterioIOError

from core.formats.records import status_of

# source: Rec. ITU-R BT.601-7, section 2.5.1
LUMINANCE = (0.299, 0.587, 0.114)
"""Weights of red, green and blue in gray."""
# design: 128 million gray pixels, the ground of a dozen photos at half a metre; less than half of
# what a run needs besides, and it grows neither with the scans nor with the area of a block.
TILE_BYTES = 512_000_000
"""Most that decoded tiles take together, bytes."""
# design: the sheets under one photo and the scans beside it; systems allow a thousand and more.
OPEN_FILES = 32
"""Most files that wait open for their next read."""
# design: a row of blocks of a wide sheet, so that neighbouring tiles decode no block twice. Left to
# itself GDAL takes a twentieth of the machine's memory.
GDAL_BYTES = 128_000_000
"""Most that GDAL keeps of the blocks of open files, bytes."""
WEB_MAPS = ("GDAL_WMS", "GDAL_WMTS")
"""Roots of the XML in which GDAL describes maps of a server."""
# design: the tiles of a block of a thousand square kilometres at half a metre, and a year's work.
WEB_BYTES, WEB_SECONDS = 4_000_000_000, 31_536_000
"""How much of such maps is kept on disk, and for how long."""


@runtime_checkable
class Sized(Protocol):
    """A value that knows how much memory it takes."""

    @property
    def nbytes(self) -> int:
        """Bytes."""
        ...


T = TypeVar("T", bound=Sized)


class TileCache:
    """Decoded tiles, the one asked for longest ago dropped first; shared by all threads.

    The first thread that wants a tile makes it while others wait for it. What a tile holds depends
    on its key alone, so no result hangs on which thread came first.
    """

    def __init__(self, most_bytes: int) -> None:
        self.most_bytes = most_bytes
        self.nbytes = 0
        self._tiles: OrderedDict[Hashable, Sized] = OrderedDict()
        self._turns: dict[Hashable, Lock] = {}
        self._lock = Lock()

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        """The tile of a key; made, and kept for the next question, where it is not held."""
        with self._lock:
            tile = self._tile_of(key)
            turn = self._turns.setdefault(key, Lock()) if tile is None else None
        if turn is not None:
            with turn:
                with self._lock:
                    tile = self._tile_of(key)
                if tile is None:
                    tile = make()
                    self._keep(key, tile)
            with self._lock:
                self._turns.pop(key, None)
        return cast(T, tile)

    def clear(self) -> None:
        """Forget every tile."""
        with self._lock:
            self._tiles.clear()
            self.nbytes = 0

    def _tile_of(self, key: Hashable) -> Sized | None:
        if key in self._tiles:
            self._tiles.move_to_end(key)
        return self._tiles.get(key)

    def _keep(self, key: Hashable, tile: Sized) -> None:
        with self._lock:
            old = self._tiles.pop(key, None)
            self._tiles[key] = tile
            self.nbytes += tile.nbytes - (old.nbytes if old else 0)
            while self.nbytes > self.most_bytes and len(self._tiles) > 1:
                self.nbytes -= self._tiles.popitem(last=False)[1].nbytes


TILES = TileCache(TILE_BYTES)
"""The tiles of every reference that is open."""


Stamp = tuple[int, ...]
"""What tells one state of a file from the next."""


def file_stamp(path: Path) -> Stamp:
    """When a file and those beside it (world file, CRS, mask) were written, and its length.

    Raises:
        OSError: The file is not there, or is none.
    """
    status, kind = status_of(path), path.suffix
    beside = [path.with_suffix(s) for s in (f"{kind[:2]}{kind[-1:]}w", f"{kind}w", ".wld", ".prj")]
    beside += [path.with_name(path.name + ending) for ending in (".aux.xml", ".msk", ".ovr")]
    times = [
        status_of(file).st_mtime_ns if os.path.exists(file) else 0
        for file in beside
        if file != path
    ]
    return (status.st_mtime_ns, status.st_size, status.st_ino, *times)


class OpenFiles:
    """Rasters that wait open for their next read; each serves one thread at a time."""

    def __init__(self, most: int) -> None:
        self.most = most
        self.web_folder: Path | None = None
        """Where tiles of web maps are kept; None where they are fetched each time."""
        self._idle: list[tuple[Hashable, Any]] = []
        self._lock = Lock()

    @contextmanager
    def borrow(self, path: Path, **options: str) -> Generator[Any]:
        """An open dataset of a file as it stands on the disk now.

        Args:
            path: The file.
            options: Open options of GDAL.

        Raises:
            OSError: The file is not there, or GDAL does not open it.
        """
        key = (path, file_stamp(path), *options.items())
        with self._lock:
            match = next((i for i, (held, _) in enumerate(self._idle) if held == key), None)
            dataset = None if match is None else self._idle.pop(match)[1]
        if dataset is None:
            dataset = open_plain(_with_cache(path, self.web_folder), options)
        try:
            yield dataset
        except BaseException:
            # What could not be read once is opened anew next time.
            dataset.close()
            raise
        with self._lock:
            self._idle.append((key, dataset))
            old = [self._idle.pop(0)[1] for _ in range(len(self._idle) - self.most)]
        for dataset in old:
            dataset.close()


def web_map_of(path: Path) -> str:
    """The XML of a file by which GDAL describes a web map; empty for any other file."""
    if path.suffix.lower() != ".xml":
        return ""
    text = path.read_text(encoding="utf-8", errors="replace")
    return text if text.lstrip("\ufeff \t\r\n").startswith(tuple(f"<{r}" for r in WEB_MAPS)) else ""


def _with_cache(path: Path, folder: Path | None) -> Path | str:
    """What GDAL opens: the file, or a web map's description that says where tiles are kept."""
    text = web_map_of(path) if folder else ""
    if not text or "<Cache" in text:
        return path
    end = text.rindex("</")
    return (
        f"{text[:end]}<Cache><Path>{escape(str(folder))}</Path><MaxSize>{WEB_BYTES}</MaxSize>"
        f"<Expires>{WEB_SECONDS}</Expires></Cache>{text[end:]}"
    )


def open_plain(path: Path | str, options: Mapping[str, Any]) -> Any:
    """A file newly open; that it may lie nowhere on the ground is its reader's business."""
    # Python's warning filters belong to all threads, so only one may put them aside at a time.
    with OPENING, warnings.catch_warnings(), _quoting():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        set_gdal_config("GDAL_CACHEMAX", GDAL_BYTES)
        try:
            return rasterio.open(path, **options)
        except UnicodeDecodeError as error:
            # GDAL quotes what a spoilt file holds, and rasterio reads what GDAL says.
            raise RasterioIOError("the file holds what is no text") from error


@contextmanager
def _quoting() -> Generator[None]:
    """Around what makes GDAL quote a spoilt file: rasterio prints that it cannot read the quote."""
    shown, ignored = sys.excepthook, sys.unraisablehook

    def show(kind: type[BaseException], error: BaseException, trace: Any) -> None:
        if kind is not UnicodeDecodeError:
            shown(kind, error, trace)

    def ignore(told: "sys.UnraisableHookArgs") -> None:
        if told.exc_type is not UnicodeDecodeError:
            ignored(told)

    sys.excepthook, sys.unraisablehook = show, ignore
    try:
        yield
    finally:
        sys.excepthook, sys.unraisablehook = shown, ignored


OPENING = Lock()
FILES = OpenFiles(OPEN_FILES)
"""The scans and sheets of this process."""


def count_bands(path: Path) -> int:
    """How many bands a raster has."""
    with FILES.borrow(path) as file:
        return int(file.count)


def gray_from_colour(
    bands: Num[np.ndarray, "3 rows columns"],
) -> Float32[np.ndarray, "rows columns"]:
    """Luminance of red, green and blue."""
    gray = np.multiply(bands[0], LUMINANCE[0], dtype=np.float32)
    for band, share in zip(bands[1:], LUMINANCE[1:], strict=True):
        gray += np.multiply(band, share, dtype=np.float32)
    return gray
