"""Addresses of the placing page: pairs of points of one photo, and the run that follows."""

import json
from collections.abc import Awaitable, Callable
from typing import Any, Protocol, cast

from aiohttp import web

from core.errors import PhotogrammetryError
from ui.web.access import is_guest

MOST_PAIRS = 200
Pair = tuple[float, float, float, float]
"""Column, row, easting, northing."""


class Placer(Protocol):
    """What the page sets off; each call returns at once, or after writing one small file."""

    def fitted(self, photo_id: str, pairs: list[Pair]) -> dict[str, Any]:
        """How well a similarity takes the scan's points to the map's."""
        ...

    def save(self, photo_id: str, pairs: list[Pair]) -> dict[str, Any]:
        """Write them beside the scan; nothing is left when there are none."""
        ...

    def status(self) -> dict[str, Any]:
        """How far the run is."""
        ...

    def start_run(self) -> None:
        """Begin to run the block."""
        ...

    def cancel_run(self) -> None:
        """Ask the run to stop."""
        ...


def placing_routes(placer: Placer) -> tuple[web.RouteDef, ...]:
    """Addresses of the page; guests change nothing."""

    async def fit(request: web.Request) -> web.StreamResponse:
        return await _with_pairs(request, placer.fitted)

    async def save(request: web.Request) -> web.StreamResponse:
        _operators_only(request)
        return await _with_pairs(request, placer.save)

    async def status(request: web.Request) -> web.StreamResponse:
        return web.json_response(placer.status(), headers={"Cache-Control": "no-store"})

    async def run(request: web.Request) -> web.StreamResponse:
        _operators_only(request)
        placer.start_run()
        return web.json_response(placer.status())

    async def cancel(request: web.Request) -> web.StreamResponse:
        _operators_only(request)
        placer.cancel_run()
        return web.json_response(placer.status())

    return (
        web.post("/fit/{photo}", fit),
        web.post("/points/{photo}", save),
        web.get("/run", status),
        web.post("/run", run),
        web.post("/run/cancel", cancel),
    )


def _operators_only(request: web.Request) -> None:
    if is_guest(request):
        raise web.HTTPForbidden


async def _with_pairs(
    request: web.Request, work: Callable[[str, list[Pair]], dict[str, Any]]
) -> web.StreamResponse:
    """Read pairs, hand them on, answer with what came of it or with the words of the error."""
    pairs = await _pairs(request.text)
    try:
        found = work(request.match_info["photo"], pairs)
    except PhotogrammetryError as error:
        return web.json_response({"error": str(error)}, status=409)
    return web.json_response(found)


async def _pairs(text: Callable[[], Awaitable[str]]) -> list[Pair]:
    """Pairs of points of a request, each number finite."""
    try:
        read: Any = json.loads(await text())
        rows = cast("list[list[float]]", read["pairs"])
        pairs = [(float(a), float(b), float(c), float(d)) for a, b, c, d in rows]
    except (ValueError, TypeError, KeyError) as error:
        raise web.HTTPBadRequest(text="Pairs of points are expected.") from error
    if len(pairs) > MOST_PAIRS or not all(abs(value) < 1e9 for pair in pairs for value in pair):
        raise web.HTTPBadRequest(text="Pairs of points are expected.")
    return pairs
