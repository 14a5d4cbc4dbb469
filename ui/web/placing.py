"""Addresses of the placing page: pairs of points of one photo, and the run after them."""

from collections.abc import Callable
from typing import Any, Protocol, cast

from aiohttp import web

from ui.web.running import Runner, json_of, operators_only, run_routes, told

MOST_PAIRS = 200
Pair = tuple[float, float, float, float]
"""Column, row, easting, northing."""


class Placer(Runner, Protocol):
    """What the page sets off; each call returns at once, or after writing one small file."""

    def fitted(self, photo_id: str, pairs: list[Pair]) -> dict[str, Any]:
        """How well a similarity takes the scan's points to the map's."""
        ...

    def save(self, photo_id: str, pairs: list[Pair], seat_id: str = "") -> dict[str, Any]:
        """Keep them; nothing is left when there are none."""
        ...


def placing_routes(placer: Placer) -> tuple[web.RouteDef, ...]:
    """Addresses of the page; guests change nothing."""

    async def fit(request: web.Request) -> web.StreamResponse:
        return await with_pairs(request, placer.fitted)

    async def save(request: web.Request) -> web.StreamResponse:
        operators_only(request)
        seat_id = request.query.get("seat", "")
        return await with_pairs(request, lambda photo, pairs: placer.save(photo, pairs, seat_id))

    return (
        web.post("/fit/{photo}", fit),
        web.post("/points/{photo}", save),
        *run_routes(placer),
    )


async def with_pairs(
    request: web.Request, work: Callable[[str, list[Pair]], dict[str, Any]]
) -> web.StreamResponse:
    """Read pairs, hand them on, answer with what came of it or with the words of the error."""
    pairs = _pairs(await json_of(request))
    return told(lambda: work(request.match_info["photo"], pairs))


def _pairs(read: dict[str, Any]) -> list[Pair]:
    """Pairs of points of a request, each number finite."""
    try:
        rows = cast("list[list[float]]", read["pairs"])
        pairs = [(float(a), float(b), float(c), float(d)) for a, b, c, d in rows]
    except (ValueError, TypeError, KeyError) as error:
        raise web.HTTPBadRequest(text="Pairs of points are expected.") from error
    if len(pairs) > MOST_PAIRS or not all(abs(value) < 1e9 for pair in pairs for value in pair):
        raise web.HTTPBadRequest(text="Pairs of points are expected.")
    return pairs
