"""Viser on a port that only our front can use, with one view for each browser."""

import hmac
import io
import logging
import secrets
import threading
from collections import OrderedDict
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any, cast

import numpy as np
import viser
import websockets.asyncio.server as websockets_server
from viser import _messages as viser_messages  # pyright: ignore[reportPrivateUsage]
from websockets.datastructures import Headers
from websockets.http11 import Response

from ui.review.scene import ScenePicture
from ui.review.state import SceneOptions
from ui.review.tiles import Colour
from ui.views.block_view import FIELD_OF_VIEW, TERRAIN, BlockView, Pointed, Stage

logger = logging.getLogger(__name__)
SECRET_HEADER = "X-Gruber-Scene"
"""Only the front knows its value, so that no page in a browser can reach viser directly."""
STEP_S = 0.035
"""Between two places of an eye on its way."""
KEPT_SHEETS = 8
"""Meshes that are shown on demand, of a few megabytes each."""


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """A mesh that a seat wants to see, made when it is first wanted."""

    node: str
    """Name of its node in the scene."""
    key: str
    """Says what it shows: the same key, the same mesh."""
    make: Callable[[], bytes]
    """Makes the GLB, in a thread of its own."""


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """What one seat's scene shows."""

    picture: Callable[[], ScenePicture]
    """Makes the block's picture; called in the scene's thread only."""
    options: SceneOptions
    """The seat's switches."""
    pointed: Pointed | None
    """What is current."""
    sheets: tuple[Sheet, ...] = ()
    """Meshes it needs beside the terrain."""


class SceneServer:
    """Viser, closed to strangers; one `BlockView` per browser, changed in one thread in order."""

    def __init__(self, stage: Stage, seat_header: str, opened: Callable[[str], None]) -> None:
        self.secret = secrets.token_urlsafe(24)
        self._stage, self._seat_header = stage, seat_header
        self._opened = opened
        self._clients: dict[int, tuple[str, viser.ClientHandle]] = {}
        self._views: dict[int, BlockView] = {}
        self._wanted: dict[str, Shown] = {}
        self._latest: dict[str, Shown] = {}
        self._distances: dict[int, tuple[float, float]] = {}
        self._sheets: OrderedDict[str, bytes] = OrderedDict()
        self._making: set[str] = set()
        self._terrain = b""
        self._pictures: dict[str, Colour] = {}
        self._closed = threading.Event()
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="scene")
        self._maker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="scene-sheets")
        # Viser prints an address that nobody can open; ours is printed by the caller.
        with closed_to_strangers(SECRET_HEADER, self.secret), redirect_stdout(io.StringIO()):
            self._server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        # Viser keeps both to itself: its server of websockets and that one's open connections.
        self._infrastructure: Any = vars(self._server)["_websock_server"]
        # Any client could otherwise open a public tunnel to the desk.
        self._infrastructure.unregister_handler(viser_messages.ShareUrlRequest)
        self._prepare()

    @property
    def port(self) -> int:
        """Where viser listens on 127.0.0.1."""
        return self._server.get_port()

    @property
    def infrastructure(self) -> Any:
        """Viser's websocket server, for tests of what it answers to."""
        return self._infrastructure

    def show(self, seat_id: str, shown: Shown) -> None:
        """Bring every scene of a seat up to date, in the scene thread."""
        self._wanted[seat_id] = shown
        self._thread.submit(self._told, self._show, seat_id)

    def drape(self, terrain: bytes) -> None:
        """Lay the terrain, a GLB, under every scene, those opened later included."""
        self._thread.submit(self._told, self._drape, terrain)

    def picture(self, photo_id: str, thumbnail: Colour) -> None:
        """Show a photo's small picture in every scene, those opened later included."""
        self._thread.submit(self._told, self._picture, photo_id, thumbnail)

    def fit(self, seat_id: str, pointed: Pointed | None) -> None:
        """Move a seat's eye to the whole block, or to what is current."""
        self._thread.submit(self._told, self._fit, seat_id, pointed)

    def close(self) -> None:
        """End viser."""
        self._closed.set()
        self._maker.shutdown(wait=True, cancel_futures=True)
        self._thread.shutdown(wait=True, cancel_futures=True)
        with redirect_stdout(io.StringIO()):
            self._server.stop()

    def _prepare(self) -> None:
        server = self._server
        server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        server.scene.set_up_direction("+z")
        server.scene.configure_default_lights(False)
        server.scene.configure_environment_map(None)
        reach, middle = self._stage.extent_m, self._stage.middle
        server.initial_camera.position = (middle[0], middle[1] - 0.62 * reach, middle[2] + reach)
        server.initial_camera.look_at = (middle[0], middle[1], middle[2])
        server.initial_camera.near = reach * 1e-3
        server.initial_camera.far = reach * 40

        @server.on_client_connect
        async def connected(client: viser.ClientHandle) -> None:
            self._welcome(client)

        @server.on_client_disconnect
        async def disconnected(client: viser.ClientHandle) -> None:
            self._clients.pop(client.client_id, None)
            self._views.pop(client.client_id, None)
            self._distances.pop(client.client_id, None)

    def _welcome(self, client: viser.ClientHandle) -> None:
        connection = vars(self._infrastructure)["_live_connections"].get(client.client_id)
        if connection is None:
            return
        seat_id = connection.request.headers.get(self._seat_header, "")
        self._clients[client.client_id] = seat_id, client

        async def moved(camera: viser.CameraHandle) -> None:
            distance = float(np.linalg.norm(camera.position - camera.look_at))
            # As far away as it looks through the ordinary opening.
            distance *= float(np.tan(camera.fov / 2) / np.tan(FIELD_OF_VIEW / 2))
            pixel = 2 * distance * float(np.tan(FIELD_OF_VIEW / 2)) / max(camera.image_height, 1)
            _, before = self._distances.get(client.client_id, (0.0, 0.0))
            if not 0.85 * before < pixel < 1.15 * before:
                self._distances[client.client_id] = distance, pixel
                self._thread.submit(self._told, self._resize, client.client_id)
            elif (view := self._views.get(client.client_id)) is not None and view.is_outgrown:
                # The eye may arrive where it was sent after the window took another shape.
                self._thread.submit(self._told, view.fit_again)

        client.camera.on_update(cast(Any, moved))
        self._opened(seat_id)

    def _show(self, seat_id: str) -> None:
        shown = self._wanted.pop(seat_id, None)
        if shown is None:
            return  # A newer picture has been shown already.
        self._latest[seat_id] = shown
        for sheet in shown.sheets:
            self._make(sheet)
        picture = shown.picture()
        for client_id, (sitting, client) in list(self._clients.items()):
            if sitting != seat_id:
                continue
            view = self._views.get(client_id)
            if view is None:
                view = self._views[client_id] = BlockView(client, self._stage, picture)
                if self._terrain:
                    view.lay(TERRAIN, self._terrain)
                for photo_id, thumbnail in self._pictures.items():
                    view.picture(photo_id, thumbnail)
                if client_id in self._distances:
                    view.seen_from(*self._distances[client_id])
            with client.atomic():
                view.show(picture, shown.options, shown.pointed)
            self._lay(view, shown)
            self._fly(client_id)

    def _make(self, sheet: Sheet) -> None:
        """Have a mesh made beside the scene's thread, unless it is there or on its way."""
        if sheet.key in self._sheets or sheet.key in self._making:
            return

        def made() -> None:
            self._told(self._keep, sheet.key, sheet.make)
            self._making.discard(sheet.key)
            self._later(self._lay_all)

        self._making.add(sheet.key)
        self._maker.submit(made)

    def _keep(self, key: str, make: Callable[[], bytes]) -> None:
        self._sheets[key] = make()
        while len(self._sheets) > KEPT_SHEETS:
            self._sheets.popitem(last=False)

    def _lay_all(self) -> None:
        for client_id, (seat_id, _) in list(self._clients.items()):
            if client_id in self._views and seat_id in self._latest:
                self._lay(self._views[client_id], self._latest[seat_id])

    def _lay(self, view: BlockView, shown: Shown) -> None:
        """What a seat wants and what is made."""
        for sheet in shown.sheets:
            if (made := self._sheets.get(sheet.key)) is not None:
                view.lay(sheet.node, made)

    def _fly(self, client_id: int) -> None:
        """Move an eye that is on its way, and again after a while."""
        view = self._views.get(client_id)
        if view is not None and view.fly_on():
            timer = threading.Timer(STEP_S, self._later, (self._fly, client_id))
            timer.daemon = True
            timer.start()

    def _later(self, function: Callable[..., None], *arguments: Any) -> None:
        """Run in the scene's thread, unless the desk was closed meanwhile."""
        if not self._closed.is_set():
            self._thread.submit(self._told, function, *arguments)

    def _resize(self, client_id: int) -> None:
        view = self._views.get(client_id)
        if view is not None:
            view.seen_from(*self._distances[client_id])

    def _drape(self, terrain: bytes) -> None:
        self._terrain = terrain
        for view in list(self._views.values()):
            view.lay(TERRAIN, terrain)

    def _picture(self, photo_id: str, thumbnail: Colour) -> None:
        self._pictures[photo_id] = thumbnail
        for view in list(self._views.values()):
            view.picture(photo_id, thumbnail)

    def _fit(self, seat_id: str, pointed: Pointed | None) -> None:
        for client_id, (sitting, _) in list(self._clients.items()):
            if sitting == seat_id and client_id in self._views:
                self._views[client_id].fit(pointed)

    def _told(self, function: Callable[..., None], *arguments: Any) -> None:
        """Run and log: a browser that went away must not stop the scenes of the others."""
        try:
            function(*arguments)
        except Exception:
            logger.exception("The 3D scene could not be shown.")


@contextmanager
def closed_to_strangers(header: str, secret: str) -> Generator[None]:
    """While inside, websocket servers that are made answer only requests with a secret header.

    Viser has no hook for this: it calls `websockets.asyncio.server.serve` once, when it is made.
    """
    module: Any = websockets_server
    serve = module.serve

    def guarded(*arguments: Any, process_request: Any, **options: Any) -> Any:
        def checked(connection: Any, request: Any) -> Any:
            if not hmac.compare_digest(request.headers.get(header, "").encode(), secret.encode()):
                return Response(HTTPStatus.FORBIDDEN.value, "Forbidden", Headers(), b"")
            return process_request(connection, request)

        return serve(*arguments, process_request=checked, **options)

    module.serve = guarded
    try:
        yield
    finally:
        module.serve = serve
