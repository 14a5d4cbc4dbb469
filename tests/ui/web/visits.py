"""A visit of a page's addresses, as an operator or a guest."""

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from typing import TypeVar

from aiohttp import web
from aiohttp.test_utils import TestClient, TestServer

from ui.web.access import GUEST

Seen = TypeVar("Seen")


def visited(
    routes: Sequence[web.RouteDef], visit: Callable[[TestClient], Awaitable[Seen]], guest: bool
) -> Seen:
    """What a visit comes to."""

    @web.middleware
    async def known(request, handler):
        request[GUEST] = guest
        return await handler(request)

    async def go():
        application = web.Application(middlewares=[known])
        application.add_routes(routes)
        async with TestServer(application) as server, TestClient(server) as client:
            return await visit(client)

    return asyncio.run(go())
