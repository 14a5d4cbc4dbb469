"""The one public port: own pages, tiles, results, the wire to the loop, and a proxy to viser."""

import asyncio
import gzip
import json
import logging
import re
import secrets
import socket
import threading
from collections.abc import Awaitable, Callable, Coroutine, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Self, cast

import aiohttp
from aiohttp import WSMsgType, web
from aiohttp.http_exceptions import HttpProcessingError

from core.errors import PhotogrammetryError
from core.said import Said, say
from ui.web.access import Access, is_guest
from ui.web.channel import MESSAGE_BYTES, Channel
from ui.web.tiles import ScanTiles, tile_routes
from ui.words.catalogue import KEYS, LANGUAGES, messages, preferred_language, words

PAGES = Path(__file__).parent / "pages"
SCENE_PATH = "/scene"
"""Where viser is reached, with the seat behind it: `/scene/SEAT/`."""
SEAT_HEADER = "X-Gruber-Seat"
"""Tells viser's side which seat a connection belongs to."""
SEAT_NAME = re.compile(r"[A-Za-z0-9_-]{6,40}")
SEAT = f"{{seat:{SEAT_NAME.pattern}}}"
CONTENT = {
    ".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml",
    ".woff2": "font/woff2",
}  # fmt: skip
PAGE_POLICY = (
    "default-src 'self'; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; "
    "connect-src 'self' ws: wss:; frame-ancestors 'self'; base-uri 'none'; form-action 'none'"
)
SCRIPT = re.compile(r'<script type="module" src="/pages/([a-z_]+\.js)"')
IMPORTED = re.compile(r' from "\./([a-z_]+\.js)"')
INTO_SCENE = (
    '<link rel="stylesheet" href="/pages/scene.css"><script src="/pages/scene.js"></script></head>'
)
"""Put into viser's page: hides its panel and hands our keys up to the desk."""
LANGUAGE_COOKIE = "gruber-language"
"""Set by `words.js`; cookies know no ports: what is chosen on one page holds on all."""
Serve = Callable[[web.Request], Awaitable[web.StreamResponse]]
PLAIN_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,80}")
RESULT_CONTENT = {
    ".csv": "text/csv", ".html": "text/html", ".json": "application/json", ".tif": "image/tiff",
    ".gpkg": "application/geopackage+sqlite3", ".txt": "text/plain", ".xml": "application/xml",
    ".zip": "application/zip", ".geojson": "application/geo+json", ".points": "text/plain",
    ".jp2": "image/jp2", ".msk": "image/tiff",
    ".tfw": "text/plain", ".jgw": "text/plain", ".j2w": "text/plain",
    ".laz": "application/vnd.laszip",
    ".prj": "text/plain", ".opk": "text/plain", ".gcp": "text/plain", ".qgs": "application/xml",
}  # fmt: skip
FOLDERS = 2
"""So deep lie results: `sheets/FOLDER/` holds sheets of another CRS or format."""
LISTED_FIRST = {".html": 0, ".tif": 1}
"""What is looked for most stands first: the report, then the mosaic."""
REPORT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:; "
    "frame-ancestors 'self'"
)
"""The report needs nothing but itself."""


@dataclass(frozen=True, slots=True)
class Upstream:
    """Where viser listens, closed to everyone who does not know the secret."""

    port: int
    """On 127.0.0.1."""
    header: str
    """Name of the secret header."""
    secret: str
    """Its value."""


@dataclass(frozen=True, slots=True, eq=False)
class FrontInputs:
    """What the front serves."""

    access: Access
    """The lock."""
    channel: Channel | None
    """The wire to the loop; None for a page that works without one."""
    tiles: ScanTiles | None
    """Pictures; None for a page without any."""
    upstream: Upstream | None
    """Viser; None without a 3D scene."""
    start: dict[str, Any]
    """What a page needs once beside its texts: palette, lattice, photos."""
    results: Path | None = None
    """Folder of tables and report."""
    page: str = "desk.html"
    """What is served first."""
    told: Callable[[], dict[str, Any]] = dict
    """What a page needs once and what changes while the desk is open."""
    routes: tuple[web.RouteDef, ...] = ()
    """Addresses of this desk's own."""
    language: str = ""
    """Of the texts until a page chooses; that of each browser when empty."""


def is_ours(record: logging.LogRecord) -> bool:
    """False for what came in and was no request: it was answered, and is not told again here."""
    return not (record.exc_info and isinstance(record.exc_info[1], HttpProcessingError))


logger = logging.getLogger(__name__)
logger.addFilter(is_ours)


class Front:
    """An aiohttp server in a thread of its own."""

    def __init__(self, inputs: FrontInputs) -> None:
        self._inputs, self._door = inputs, inputs.access.door
        self._loop = asyncio.new_event_loop()
        self._ready = threading.Event()
        self._stop = asyncio.Event()
        self._failure: OSError | None = None
        self._scene_page = b""
        self._client: aiohttp.ClientSession | None = None
        self._answers: list[Serve] = []
        self.port = 0
        self._thread = threading.Thread(target=self._run, name="front", daemon=True)

    @property
    def access(self) -> Access:
        """The lock on the door."""
        return self._inputs.access

    def start(self) -> None:
        """Begin to listen.

        Raises:
            PhotogrammetryError: The port cannot be had.
        """
        self._thread.start()
        self._ready.wait()
        if self._failure is not None:
            raise PhotogrammetryError(
                f"{self._door.host}:{self._door.port}",
                say(
                    "cannot be listened on ({error}).",
                    error=self._failure.strerror or self._failure,
                ),
                "Choose another port with --port, or close the desk that is open there.",
            ) from self._failure

    def call(self, function: Callable[..., None], *arguments: Any) -> None:
        """Run a function on the front's event loop, from any thread."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(function, *arguments)

    def close(self) -> None:
        """Stop listening and end the thread."""
        self.call(self._stop.set)
        self._thread.join(timeout=5)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        except OSError as error:
            self._failure = error
        finally:
            self._ready.set()
            self._loop.close()

    async def _serve(self) -> None:
        runner = web.AppRunner(
            self._application(), access_log=None, shutdown_timeout=1, logger=logger
        )
        await runner.setup()
        try:
            family = socket.AF_INET6 if ":" in self._door.host else socket.AF_INET
            listening = socket.create_server((self._door.host, self._door.port), family=family)
            site = web.SockSite(runner, listening)
            await site.start()
            self.port = runner.addresses[0][1]
            self._ready.set()
            await self._stop.wait()
            # Who is let in at this moment would be forgotten, and the connection stay open.
            self._loop.remove_reader(listening)
            await asyncio.sleep(0)
            # Before its pages are let go: they come back at once.
            await site.stop()
            if self._inputs.channel is not None:
                await self._inputs.channel.close()
        finally:
            if self._client is not None:
                await self._client.close()
            await runner.cleanup()
            # Answers given up end, and connections let go of are closed, in turns of the loop.
            given_up = asyncio.all_tasks() - {asyncio.current_task()}
            await asyncio.gather(asyncio.sleep(0), *given_up, return_exceptions=True)
            self._answers.clear()

    def _application(self) -> web.Application:
        application = web.Application(middlewares=[self._inputs.access.guard()])
        routes = [
            web.get("/", self._page(self._inputs.page)),
            web.get("/pages/{name}", self._file),
            web.get("/start", self._start),
            *(tile_routes(self._inputs.tiles) if self._inputs.tiles else ()),
            *result_routes(self._inputs.results),
            *self._inputs.routes,
        ]
        if self._inputs.channel is not None:
            routes.append(web.get(f"/desk/{SEAT}", self._inputs.channel.serve))
        if self._inputs.upstream is not None:
            addresses = (f"{SCENE_PATH}/{SEAT}/", f"{SCENE_PATH}/{SEAT}")
            routes += [web.get(address, self._scene) for address in addresses]
        application.add_routes([self._until_closed(route) for route in routes])
        return application

    def _until_closed(self, route: web.RouteDef) -> web.RouteDef:
        """A route that lets go of who answers it: aiohttp keeps what it has once called for good.

        With them it would keep every desk that was open, with its scans and tiles.
        """
        answers, number = self._answers, len(self._answers)
        answers.append(cast("Serve", route.handler))

        async def answer(request: web.Request) -> web.StreamResponse:
            try:
                return await answers[number](request)
            except ConnectionResetError:
                if request.transport is not None:
                    raise
                # The page went away before all it said had come: nobody waits for an answer.
                return web.Response()

        return web.route(route.method, route.path, answer, **route.kwargs)

    def _page(self, name: str) -> Serve:
        async def serve(request: web.Request) -> web.StreamResponse:
            return _own_file(name)

        return serve

    async def _file(self, request: web.Request) -> web.StreamResponse:
        return _own_file(request.match_info["name"])

    async def _start(self, request: web.Request) -> web.StreamResponse:
        """What a page needs once, with a seat: the wanted one if it is its own or free."""
        wanted = request.query.get("seat", "")
        channel = self._inputs.channel
        taken = channel is not None and channel.taken(wanted)
        own = request.query.get("own") == "1" or not taken
        seat = wanted if SEAT_NAME.fullmatch(wanted) and own else secrets.token_urlsafe(9)
        language = self._language(request)
        texts = {"words": words(language), "language": language, "keys": KEYS,
                 "messages": messages(language)}  # fmt: skip
        told = {**texts, **self._inputs.start, **self._inputs.told()}
        whole = as_json({**told, "seat": seat, "guest": is_guest(request)})
        return web.Response(text=whole, content_type="application/json")

    def _language(self, request: web.Request) -> str:
        """Chosen on a page; else at the start of the program; else the browser's own."""
        chosen = request.cookies.get(LANGUAGE_COOKIE, "")
        if chosen in LANGUAGES:
            return chosen
        accepted = request.headers.get("Accept-Language", "")
        return self._inputs.language or preferred_language(accepted)

    @property
    def _upstream(self) -> Upstream:
        """Viser, of which only its own addresses ask."""
        assert self._inputs.upstream is not None
        return self._inputs.upstream

    async def _scene(self, request: web.Request) -> web.StreamResponse:
        """Viser's page, or its websocket."""
        if request.headers.get("Upgrade", "").lower() == "websocket":
            return await self._scene_socket(request)
        if not self._scene_page:
            upstream = self._upstream
            address = f"http://127.0.0.1:{upstream.port}/"
            headers = {upstream.header: upstream.secret, "Accept-Encoding": "identity"}
            async with self._session().get(address, headers=headers) as answer:
                page = await answer.text()
            place = page.index("</head>")
            page = page[:place] + INTO_SCENE + page[place + len("</head>") :]
            self._scene_page = gzip.compress(page.encode())
        return web.Response(
            body=self._scene_page, content_type="text/html", charset="utf-8",
            headers={"Content-Encoding": "gzip"},
        )  # fmt: skip

    async def _scene_socket(self, request: web.Request) -> web.StreamResponse:
        """Pass messages both ways until either side closes."""
        upstream = self._upstream
        offered = request.headers.get("Sec-WebSocket-Protocol", "")
        protocols = [name.strip() for name in offered.split(",") if name.strip()]
        headers = {upstream.header: upstream.secret, SEAT_HEADER: request.match_info["seat"]}
        inner = await self._session().ws_connect(
            f"ws://127.0.0.1:{upstream.port}/",
            headers=headers, protocols=protocols, max_msg_size=0, autoping=True,
        )  # fmt: skip
        outer = web.WebSocketResponse(
            protocols=protocols, max_msg_size=MESSAGE_BYTES, compress=False
        )
        await outer.prepare(request)
        passing: list[Coroutine[Any, Any, None]] = [_pass(inner, outer), _pass(outer, inner)]
        tasks = [asyncio.create_task(one) for one in passing]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            await inner.close()
            await outer.close()
        return outer

    def _session(self) -> aiohttp.ClientSession:
        if self._client is None:
            self._client = aiohttp.ClientSession(auto_decompress=True)
        return self._client


class Opened:
    """What is open in the browser: its addresses; closed at the end of a `with`."""

    def __init__(self, front: Front) -> None:
        self._front = front

    @property
    def url(self) -> str:
        """The address to open, with the token."""
        return self._front.access.url(self.port)

    @property
    def guest_url(self) -> str:
        """The address for those who look and decide nothing."""
        return self._front.access.guest_url(self.port)

    @property
    def token(self) -> str:
        """The operator's secret; what follows at this address takes it over."""
        return self._front.access.token

    @property
    def port(self) -> int:
        """The port it listens on."""
        return self._front.port

    def listen(self) -> None:
        """Open the port; where it cannot be had all is closed again.

        Raises:
            PhotogrammetryError: The port cannot be had.
        """
        try:
            self._front.start()
        except PhotogrammetryError:
            self.close()
            raise

    def close(self) -> None:
        """Close the port."""
        self._front.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _own_file(name: str) -> web.Response:
    """One of our own pages; only plain names of files that are there."""
    path = PAGES / name
    if "/" in name or "\\" in name or path.suffix not in CONTENT or not path.is_file():
        raise web.HTTPNotFound
    kind = CONTENT[path.suffix]
    charset = None if kind.startswith("font/") else "utf-8"
    response = web.Response(body=path.read_bytes(), content_type=kind, charset=charset)
    response.headers["Cache-Control"] = "no-cache" if charset else "max-age=86400"
    if path.suffix == ".html":
        response.headers["Content-Security-Policy"] = PAGE_POLICY
        response.text = path.read_text("utf-8").replace("</head>", f"{_all_modules(path)}</head>")
    return response


@cache
def _all_modules(page: Path) -> str:
    """Has a browser ask at once for what a page imports, and not file by file as it reads them."""
    seen: list[str] = []
    waiting = SCRIPT.findall(page.read_text("utf-8"))
    while waiting:
        name = waiting.pop()
        if name not in seen:
            seen.append(name)
            waiting += IMPORTED.findall((PAGES / name).read_text("utf-8"))
    return "".join(f'<link rel="modulepreload" href="/pages/{name}">' for name in seen)


async def _pass(
    source: aiohttp.ClientWebSocketResponse | web.WebSocketResponse,
    target: aiohttp.ClientWebSocketResponse | web.WebSocketResponse,
) -> None:
    async for message in source:
        if message.type == WSMsgType.BINARY:
            await target.send_bytes(message.data)
        elif message.type == WSMsgType.TEXT:
            await target.send_str(message.data)


def as_json(value: Any) -> str:
    """JSON text as the wire carries it."""
    whole = _with_sentences(value)
    return json.dumps(whole, ensure_ascii=False, separators=(",", ":"), allow_nan=False)


def _with_sentences(value: Any) -> Any:
    """The same with each sentence of the engine as template and figures, for any language."""
    match value:
        case Said():
            return {"said": value.template, "values": _with_sentences(value.values)}
        case dict():
            inside = cast("dict[str, Any]", value)
            return {key: _with_sentences(part) for key, part in inside.items()}
        case list() | tuple():
            return [_with_sentences(part) for part in cast("Sequence[Any]", value)]
        case _:
            return value


def result_routes(folder: Path | None) -> list[web.RouteDef]:
    """A list of what there is, and each file; none where there is no folder."""
    if folder is None:
        return []

    async def listed(request: web.Request) -> web.StreamResponse:
        found = sorted(
            _results(folder).items(),
            key=lambda item: (
                "/" in item[0], LISTED_FIRST.get(item[1].suffix, len(LISTED_FIRST)), item[0]
            ),
        )  # fmt: skip
        return web.json_response([[name, path.stat().st_size] for name, path in found])

    async def one(request: web.Request) -> web.StreamResponse:
        found = _results(folder).get(request.match_info["name"])
        if found is None:
            raise web.HTTPNotFound(text="There is no such result.")
        headers = {"Content-Type": RESULT_CONTENT[found.suffix], "Cache-Control": "no-cache"}
        if found.suffix == ".html":
            headers["Content-Security-Policy"] = REPORT_POLICY
        else:
            headers["Content-Disposition"] = f'attachment; filename="{found.name}"'
        return web.FileResponse(found, headers=headers)

    return [web.get("/results/", listed), web.get("/results/{name:.+}", one)]


def _results(folder: Path) -> dict[str, Path]:
    """Files with a plain name in the folder and in folders below it, by name; no links."""
    return {path.relative_to(folder).as_posix(): path for path in _plain_files(folder, FOLDERS)}


def _plain_files(folder: Path, below: int) -> Iterator[Path]:
    """Files that may be taken away, so many folders deep."""
    for path in folder.iterdir() if folder.is_dir() else ():
        if path.is_symlink() or not PLAIN_NAME.fullmatch(path.name):
            continue
        if path.is_dir() and below:
            yield from _plain_files(path, below - 1)
        elif path.suffix in RESULT_CONTENT and path.is_file():
            yield path
