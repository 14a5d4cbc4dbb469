"""Tiles over HTTP: drawn in two threads, encoded, cached within a memory limit."""

import asyncio
import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
from aiohttp import web

from core.arrays import ObjectPoints
from core.control.likeness import Likeness
from core.doubts import Failure
from core.errors import PhotogrammetryError
from core.raster.grid import Grid
from ui.review.compare import Drawn, DrawnPhoto, HeightSource, LikenessSource, PlanePoints
from ui.review.photo_points import Frame, corrections_part
from ui.review.tiles import (
    LARGE_PX,
    WALLIS_RADIUS,
    Clear,
    Colour,
    Grey,
    Lattice,
    OrthoSource,
    ScanWindow,
    Stretch,
    fit_stretch,
    frame_picture,
    local_contrast,
    mosaic_tile,
    ortho_tile,
    overview_of,
    raw_tile,
    sparse_sample,
    warped_tile,
    window_picture,
)

CACHE_BYTES = 192 * 2**20
"""Encoded tiles kept in memory."""
JPEG_QUALITY = 90
Picture = Grey | Colour | Clear
THUMBNAIL = 96
"""Width and height of the small pictures of a point in its other scans, pixels."""


MosaicTiles = Callable[[int, int], OrthoSource | None]
"""(version, edition of its seams) -> the mosaic; None where there is none."""
PNG = b"\x89PNG"


def _always(grid: Grid) -> bool:
    return True


def no_tiles(version: int, edition: int) -> OrthoSource | None:
    """There is no mosaic."""
    return None


@dataclass(frozen=True, slots=True)
class Sources:
    """Where tiles come from."""

    ortho: OrthoSource
    """Reference ortho."""
    dem: HeightSource
    """Heights."""
    read: ScanWindow
    """Windows of raw scans."""
    lattice: Lattice
    """Where ground tiles lie."""
    likeness: LikenessSource | None = None
    """Compares reference and scan."""
    ready: Callable[[Grid], bool] = _always
    """False while a tile of the ortho would have to wait for its files to be read whole."""
    mosaic: MosaicTiles = no_tiles
    """The mosaic by its version."""
    years: tuple[OrthoSource, ...] = ()
    """Orthos and mosaics of other years, in their order."""


class ScanTiles:
    """Draws tiles of raw scans on request and keeps the encoded ones; asked from any thread."""

    def __init__(self, read: ScanWindow) -> None:
        self.read = read
        self._drawn: dict[tuple[str, int], DrawnPhoto] = {}
        self._stretches: dict[Path, Stretch] = {}
        self._kept: OrderedDict[str, bytes] = OrderedDict()
        self._bytes = 0
        self._lock = threading.Lock()
        self._pool = ThreadPoolExecutor(max_workers=2, thread_name_prefix="tiles")

    def publish(self, drawn: Drawn) -> None:
        """Tell which orientations the addresses of tiles now mean; older ones stay drawable."""
        for name, photo in drawn.items():
            self._drawn[name, photo.version] = photo
            self._drawn.pop((name, photo.version - 4), None)

    def newest(self, photo_id: str) -> int:
        """The version of a photo's tiles that was told last."""
        return max((version for name, version in self._drawn if name == photo_id), default=1)

    def close(self) -> None:
        """Stop drawing."""
        self._pool.shutdown(wait=False, cancel_futures=True)

    async def tile(self, address: str, draw: Callable[[], Picture]) -> bytes:
        """The encoded tile of an address, drawn when it is not kept."""
        kept = self._kept.get(address)
        if kept is not None:
            return kept
        loop = asyncio.get_running_loop()
        encoded = await loop.run_in_executor(self._pool, lambda: encoded_tile(draw()))
        with self._lock:
            if address not in self._kept:
                self._kept[address] = encoded
                self._bytes += len(encoded)
            while self._bytes > CACHE_BYTES:
                self._bytes -= len(self._kept.popitem(last=False)[1])
        return encoded

    def raw(self, photo: DrawnPhoto, place: tuple[int, int, int], wallis: bool) -> Grey:
        """A tile of a scan as it is."""
        stretch = self._stretch(photo)
        if not wallis:
            return raw_tile(photo, self.read, stretch, place)
        return _inner(local_contrast(raw_tile(photo, self.read, stretch, place, WALLIS_RADIUS)))

    def near(self, photo: DrawnPhoto, window: tuple[int, int, int, int]) -> Grey:
        """A window of a scan as it is, in contrast of its own: marks lie in black margins."""
        return window_picture(photo, self.read, *window)

    def photo(self, photo_id: str, version: int) -> DrawnPhoto:
        """The orientation a tile's address means."""
        found = self._drawn.get((photo_id, version))
        if found is None:
            raise web.HTTPNotFound(text="No such photo or version.")
        return found

    def _stretch(self, photo: DrawnPhoto) -> Stretch:
        if photo.photo.scan not in self._stretches and max(photo.photo.size_px) > LARGE_PX:
            sample = sparse_sample(photo, self.read)
            self._stretches[photo.photo.scan] = fit_stretch(sample, margin=0)
        if photo.photo.scan not in self._stretches:
            overview = overview_of(photo, self.read)
            self._stretches[photo.photo.scan] = fit_stretch(overview.values)
        return self._stretches[photo.photo.scan]


class TileStore(ScanTiles):
    """The same with the reference beside the scans."""

    def __init__(self, sources: Sources) -> None:
        super().__init__(sources.read)
        self.sources = sources

    def ortho(self, place: tuple[int, int, int], wallis: bool, year: int | None = None) -> Colour:
        """A tile of the reference ortho, or of another year by its number."""
        grid, years = self.sources.lattice.tile(*place), self.sources.years
        if year is not None and year >= len(years):
            raise web.HTTPNotFound(text="No such year.")
        source = self.sources.ortho if year is None else years[year]
        if not wallis:
            return ortho_tile(source, grid)
        return _inner(_evened(ortho_tile(source, _wider(grid))))

    def mosaic(
        self, version: int, edition: int, place: tuple[int, int, int], wallis: bool
    ) -> Clear:
        """A tile of the mosaic, clear where it shows nothing."""
        source, grid = self.sources.mosaic(version, edition), self.sources.lattice.tile(*place)
        if source is None:
            raise web.HTTPNotFound(text="There is no mosaic.")
        if not wallis:
            return mosaic_tile(source, grid, lambda colour: colour)
        return _inner(mosaic_tile(source, _wider(grid), _evened))

    def scan(self, photo: DrawnPhoto, grid: Grid, wallis: bool) -> Grey:
        """A part of a scan warped to a ground grid."""
        stretch, sources = self._stretch(photo), self.sources
        if not wallis:
            return warped_tile(photo, sources.dem, self.read, stretch, grid)
        wider = warped_tile(photo, sources.dem, self.read, stretch, _wider(grid))
        return _inner(local_contrast(wider))

    async def likeness(self, photo: DrawnPhoto, position: ObjectPoints) -> Likeness | Failure:
        """How alike reference and scan are about a position."""
        source = self.sources.likeness
        if source is None:
            return Failure("there is nothing to compare with")
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._pool, source, photo.photo, photo.camera, position)

    async def corrections(
        self, photo: DrawnPhoto, frame: Frame, place: PlanePoints
    ) -> list[list[Any]]:
        """What moved the image point at a place of a scan."""
        # Heights may be read from a file; tiles are drawn in threads of their own meanwhile.
        return await asyncio.to_thread(corrections_part, photo, self.sources.dem, frame, place)

    def thumbnail(self, photo: DrawnPhoto) -> Colour:
        """A photo's picture area, small; its grey range is known from then on."""
        overview = overview_of(photo, self.read)
        # Tiles that are shown already keep their greys.
        stretch = self._stretches.setdefault(photo.photo.scan, fit_stretch(overview.values))
        return frame_picture(photo, overview, stretch)

    def frame(self, photo: DrawnPhoto, width: int) -> Colour:
        """A photo's picture area, as large as is wanted."""
        # A reduction by twos leaves at least half of what is asked for.
        return frame_picture(
            photo, overview_of(photo, self.read, 2 * width), self._stretch(photo), width
        )


# Milliseconds since 1970, which versions are, have thirteen digits.
TILE = r"/{level:\d{1,15}}/{column:-?\d{1,15}}/{row:-?\d{1,15}}"
PHOTO = r"/{photo}/{version:\d{1,15}}"
"""A version in the address lets the browser keep tiles for good."""


def tile_routes(store: ScanTiles) -> list[web.RouteDef]:
    """Addresses of tiles; those of the ground where there is a reference."""

    async def raw(request: web.Request) -> web.StreamResponse:
        place, wallis, photo = _place(request), _wallis(request), _photo(store, request)
        return await _answer(store, request, lambda: store.raw(photo, place, wallis))

    async def near(request: web.Request) -> web.StreamResponse:
        photo, window = _photo(store, request), _window(request)
        return await _answer(store, request, lambda: store.near(photo, window))

    window = r"/{column:-?\d{1,15}}/{row:-?\d{1,15}}/{side:\d{1,15}}/{reduction:\d{1,15}}"
    return [
        web.get("/tiles/raw" + PHOTO + TILE, raw),
        web.get("/tiles/near" + PHOTO + window, near),
        *(_ground_routes(store) if isinstance(store, TileStore) else ()),
    ]


def _ground_routes(store: TileStore) -> list[web.RouteDef]:

    async def ortho(request: web.Request) -> web.StreamResponse:
        place, wallis = _place(request), _wallis(request)
        if not store.sources.ready(store.sources.lattice.tile(*place)):
            # The page asks again; other tiles are not to wait for this one.
            raise web.HTTPServiceUnavailable(headers={"Cache-Control": "no-store"})
        return await _answer(store, request, lambda: store.ortho(place, wallis))

    async def of_year(request: web.Request) -> web.StreamResponse:
        place, wallis, year = _place(request), _wallis(request), int(request.match_info["year"])
        return await _answer(store, request, lambda: store.ortho(place, wallis, year))

    async def mosaic(request: web.Request) -> web.StreamResponse:
        version, edition = (int(request.match_info[name]) for name in ("version", "edition"))
        place, wallis = _place(request), _wallis(request)
        return await _answer(store, request, lambda: store.mosaic(version, edition, place, wallis))

    async def scan(request: web.Request) -> web.StreamResponse:
        place, wallis, photo = _place(request), _wallis(request), _photo(store, request)
        grid = store.sources.lattice.tile(*place)
        return await _answer(store, request, lambda: store.scan(photo, grid, wallis))

    async def thumbnail(request: web.Request) -> web.StreamResponse:
        photo, grid = _photo(store, request), _grid_about(request)
        return await _answer(store, request, lambda: store.scan(photo, grid, False))

    async def likeness(request: web.Request) -> web.StreamResponse:
        photo = _photo(store, request)
        position = np.array([_numbers(request, "east", "north", "height")])
        found = await store.likeness(photo, position)
        if isinstance(found, Failure):
            return web.Response(status=204)
        place = f"{found.first[0, 0]:.3f} {found.first[0, 1]:.3f} {found.reduction}"
        headers = {"X-Place": place, "Cache-Control": "private, max-age=3600"}
        return web.Response(body=as_veil(found.values), content_type="image/png", headers=headers)

    async def corrections(request: web.Request) -> web.StreamResponse:
        photo, place = _photo(store, request), np.array([_numbers(request, "x", "y")])
        frame: Frame = "scan" if request.match_info["frame"] == "scan" else "ground"
        rows = await store.corrections(photo, frame, place)
        return web.json_response(rows, headers={"Cache-Control": "no-store"})

    position = "".join(f"/{{{name}:-?[0-9.]+}}" for name in ("east", "north", "height"))
    return [
        web.get("/tiles/ortho" + TILE, ortho),
        web.get(r"/tiles/year/{year:\d{1,15}}" + TILE, of_year),
        web.get("/tiles/scan" + PHOTO + TILE, scan),
        web.get(r"/tiles/mosaic/{version:\d{1,15}}/{edition:\d{1,15}}" + TILE, mosaic),
        web.get("/tiles/likeness" + PHOTO + position, likeness),
        web.get("/tiles/point" + PHOTO + "/{east}/{north}/{pixel}", thumbnail),
        web.get("/tiles/corrections" + PHOTO + "/{frame:scan|ground}/{x}/{y}", corrections),
    ]


def encoded_tile(picture: Picture) -> bytes:
    """JPEG of a picture, grey or red-green-blue; PNG of one that is clear in places."""
    if picture.ndim == 3 and picture.shape[2] == 4:
        if picture[:, :, 3].all():
            return encoded_tile(picture[:, :, :3])
        done, data = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGBA2BGRA))
        assert done
        return cast(np.ndarray, data).tobytes()
    ordered = picture if picture.ndim == 2 else picture[:, :, ::-1]
    done, data = cv2.imencode(".jpg", ordered, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    assert done
    return cast(np.ndarray, data).tobytes()


def as_veil(values: np.ndarray) -> bytes:
    """PNG to lay over a scan: clear where nothing is alike, warm and dense at the peaks."""
    middle, top = float(np.median(values)), float(values.max())
    share = np.clip((values - middle) / max(top - middle, 1e-6), 0.0, 1.0)[..., None]
    low, high = np.array([130.0, 40.0, 200.0]), np.array([60.0, 225.0, 255.0])
    colour = low + share * (high - low)
    veil = np.concatenate([colour, 235.0 * share**1.25], axis=2)
    done, data = cv2.imencode(".png", np.rint(veil).astype(np.uint8))
    assert done
    return cast(np.ndarray, data).tobytes()


async def _answer(
    store: ScanTiles, request: web.Request, draw: Callable[[], Picture]
) -> web.StreamResponse:
    try:
        data = await store.tile(request.path_qs, draw)
    except PhotogrammetryError as error:
        raise web.HTTPNotFound(text=str(error)) from error
    headers = {"Cache-Control": "private, max-age=86400, immutable"}
    kind = "image/png" if data.startswith(PNG) else "image/jpeg"
    return web.Response(body=data, content_type=kind, headers=headers)


def _place(request: web.Request) -> tuple[int, int, int]:
    level, column, row = (int(request.match_info[name]) for name in ("level", "column", "row"))
    if level > 20 or max(abs(column), abs(row)) > 10**6:
        raise web.HTTPNotFound
    return level, column, row


def _window(request: web.Request) -> tuple[int, int, int, int]:
    """Column, row, side in pixels of the picture, reduction."""
    names = ("column", "row", "side", "reduction")
    column, row, side, reduction = (int(request.match_info[name]) for name in names)
    powers = (1, 2, 4, 8, 16, 32, 64)
    if max(abs(column), abs(row)) > 10**6 or not 1 <= side <= 1024 or reduction not in powers:
        raise web.HTTPNotFound
    return column, row, side, reduction


def _photo(store: ScanTiles, request: web.Request) -> DrawnPhoto:
    return store.photo(request.match_info["photo"], int(request.match_info["version"]))


def _wallis(request: web.Request) -> bool:
    return request.query.get("wallis") == "1"


def _numbers(request: web.Request, *names: str) -> list[float]:
    """Numbers of an address, each finite."""
    try:
        found = [float(request.match_info[name]) for name in names]
    except ValueError as error:
        raise web.HTTPNotFound from error
    if not all(abs(number) < 1e9 for number in found):
        raise web.HTTPNotFound
    return found


def _grid_about(request: web.Request) -> Grid:
    """A small grid about a place on the ground."""
    east, north, pixel = _numbers(request, "east", "north", "pixel")
    if not 1e-3 < pixel < 1e3:
        raise web.HTTPNotFound
    half = THUMBNAIL / 2 * pixel
    return Grid(east - half, north + half, pixel, THUMBNAIL, THUMBNAIL)


def _wider(grid: Grid) -> Grid:
    """A grid with the margin that local contrast looks at, so that tiles fit together."""
    return grid.window(
        -WALLIS_RADIUS,
        -WALLIS_RADIUS,
        grid.columns + 2 * WALLIS_RADIUS,
        grid.rows + 2 * WALLIS_RADIUS,
    )


def _inner(picture: np.ndarray) -> np.ndarray:
    """A picture without that margin."""
    margin = WALLIS_RADIUS
    return np.ascontiguousarray(picture[margin:-margin, margin:-margin])


def _evened(picture: Colour) -> Colour:
    """Local contrast of a colour picture, by its luminance."""
    grey = cast(Grey, cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY))
    gain = (local_contrast(grey).astype(np.float32) + 1) / (grey.astype(np.float32) + 1)
    return np.clip(picture * gain[..., None], 0, 255).astype(np.uint8)
