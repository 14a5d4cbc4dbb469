"""Addresses of a run started from a page, and the check that only operators use them."""

import threading
from collections.abc import Callable
from typing import Any, Protocol

from aiohttp import web

from core.errors import PhotogrammetryError
from ui.web.access import is_guest
from ui.web.channel import object_from_text
from ui.web.front import as_json

MOST_LETTERS = 40
"""Letters of a name."""


class Runner(Protocol):
    """What runs the block; each call returns at once."""

    def status(self) -> dict[str, Any]:
        """How far the run is."""
        ...

    def start_run(self) -> None:
        """Begin to run the block."""
        ...

    def cancel_run(self) -> None:
        """Ask the run to stop."""
        ...


def run_routes(runner: Runner) -> tuple[web.RouteDef, ...]:
    """How far it is, for everybody; beginning and stopping it, for operators."""

    async def status(request: web.Request) -> web.StreamResponse:
        return fresh_json(runner.status())

    async def run(request: web.Request) -> web.StreamResponse:
        operators_only(request)
        runner.start_run()
        return fresh_json(runner.status())

    async def cancel(request: web.Request) -> web.StreamResponse:
        operators_only(request)
        runner.cancel_run()
        return fresh_json(runner.status())

    return (web.get("/run", status), web.post("/run", run), web.post("/run/cancel", cancel))


class Leaving:
    """That an operator asks a page to make room for the start page, and who it is."""

    def __init__(self) -> None:
        self.asked = threading.Event()
        self.told: dict[str, str] = {}

    def route(self) -> web.RouteDef:
        """Where it is asked."""

        async def settings(request: web.Request) -> web.StreamResponse:
            operators_only(request)
            asked = await json_of(request)
            # Others are told the name; the page that asks knows itself by the mark.
            self.told = {name: str(asked.get(name, ""))[:MOST_LETTERS] for name in ("who", "mark")}
            self.asked.set()
            return fresh_json({})

        return web.post("/settings", settings)


def operators_only(request: web.Request) -> None:
    """Refuse a guest."""
    if is_guest(request):
        raise web.HTTPForbidden


def fresh_json(value: Any) -> web.Response:
    """An answer that no browser keeps."""
    headers = {"Cache-Control": "no-store"}
    return web.json_response(value, headers=headers, dumps=as_json)


def told(work: Callable[[], Any]) -> web.Response:
    """What came of some work, or the words of its error."""
    try:
        return fresh_json(work())
    except PhotogrammetryError as error:
        return error_message(error)


def error_message(error: PhotogrammetryError) -> web.Response:
    """The words of an error; each language tells them in its own."""
    return web.json_response({"error": error.told}, status=409, dumps=as_json)


async def json_of(request: web.Request) -> dict[str, Any]:
    """The object that a request carries."""
    try:
        return object_from_text(await request.text())
    except ValueError as error:
        raise web.HTTPBadRequest(text="A JSON object is expected.") from error
