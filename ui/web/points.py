"""Addresses of point lists: preview, import, and single points."""

import asyncio
from collections.abc import Mapping
from typing import Any, Protocol

from aiohttp import web

from ui.web.channel import object_from_text
from ui.web.running import fresh_json, operators_only, told

# design: as much as a list may hold.
MOST_BYTES = 20_000_000


class PointDoor(Protocol):
    """What reads lists of points and brings them into the block."""

    def read(self, name: str, data: bytes, reading: Mapping[str, Any]) -> dict[str, Any]:
        """A list as it would come in."""
        ...

    def bring(
        self, seat_id: str, name: str, data: bytes, reading: Mapping[str, Any]
    ) -> dict[str, Any]:
        """A list as it came in; as `read` where something is left to ask."""
        ...

    def known(self, name: str) -> dict[str, Any]:
        """A surveyed point of the block; empty where there is none."""
        ...


def point_routes(door: PointDoor) -> tuple[web.RouteDef, ...]:
    """Reading and bringing, for operators only."""

    async def read(request: web.Request) -> web.StreamResponse:
        name, data, reading = await _list_of(request)
        return await asyncio.to_thread(told, lambda: door.read(name, data, reading))

    async def bring(request: web.Request) -> web.StreamResponse:
        name, data, reading = await _list_of(request)
        seat_id = request.query.get("seat", "")
        return await asyncio.to_thread(told, lambda: door.bring(seat_id, name, data, reading))

    async def known(request: web.Request) -> web.StreamResponse:
        operators_only(request)
        name = request.query.get("name", "")
        return fresh_json(await asyncio.to_thread(door.known, name))

    return (
        web.post("/points/read", read),
        web.post("/points/bring", bring),
        web.get("/points/known", known),
    )


async def _list_of(request: web.Request) -> tuple[str, bytes, Mapping[str, Any]]:
    """Name and bytes of a list, and how it is to be read."""
    operators_only(request)
    if request.content_length is None or request.content_length > MOST_BYTES:
        raise web.HTTPRequestEntityTooLarge(MOST_BYTES, request.content_length or 0)
    try:
        reading = object_from_text(request.query.get("reading", "{}"))
    except ValueError as error:
        raise web.HTTPBadRequest(text="The reading is an object of JSON.") from error
    data = await request.content.read(-1)
    return request.query.get("name", ""), data, reading
