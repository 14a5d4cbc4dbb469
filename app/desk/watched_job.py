"""Long work that one hand begins at the desk: all see how far it is, and it can be stopped."""

import threading
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

from aiohttp import web

from core.errors import Cancelled, PhotogrammetryError
from ui.web.running import fresh_json, operators_only


class WatchedJob:
    """One such work at a time; also the progress of it."""

    def __init__(self, busy: PhotogrammetryError) -> None:
        """A job that says `busy` to whoever begins it a second time."""
        self._busy = busy
        self._turn, self._asked = threading.Lock(), threading.Event()
        self._share, self._what = 0.0, ""

    def report(self, done: float, total: float, what: str = "") -> None:
        """Take note of how far it is; raises `Cancelled` when it was asked to stop."""
        if self._asked.is_set():
            raise Cancelled
        self._share, self._what = done / total if total else 1.0, what

    def status(self) -> dict[str, Any]:
        """Whether it is at work, the share done, and what is at work."""
        busy = self._turn.locked()
        return {"busy": busy, "share": self._share if busy else 0.0, "what": self._what}

    def cancel(self) -> None:
        """Ask it to stop."""
        self._asked.set()

    @contextmanager
    def begun(self) -> Generator[None]:
        """While it is at work; raises `busy` when it is already."""
        if not self._turn.acquire(blocking=False):
            raise self._busy
        try:
            self._asked.clear()
            self._share, self._what = 0.0, ""
            yield
        finally:
            self._turn.release()

    def routes(self, address: str) -> tuple[web.RouteDef, ...]:
        """How far it is, for everybody; stopping it, for operators."""

        async def status(request: web.Request) -> web.StreamResponse:
            return fresh_json(self.status())

        async def cancel(request: web.Request) -> web.StreamResponse:
            operators_only(request)
            self.cancel()
            return fresh_json(self.status())

        return web.get(address, status), web.post(f"{address}/cancel", cancel)
