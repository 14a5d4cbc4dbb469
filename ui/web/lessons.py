"""Addresses of the page of lessons: a state in, figures and a drawing out."""

import asyncio
from collections.abc import Callable, Mapping
from typing import Any, Protocol, cast

from aiohttp import web

from ui.web.running import fresh_json, json_of, told

MOST_SLIDERS = 60
TIPS = "A lesson's name, and its values as numbers, are expected."


class Teacher(Protocol):
    """What the page asks; nothing of it is kept, so that every student has a place of their own."""

    def listed(self, language: str) -> dict[str, Any]:
        """All lessons, with their texts."""
        ...

    def view(self, name: str, values: Mapping[str, Any], truth: bool) -> dict[str, Any]:
        """What a lesson shows in a state."""
        ...

    def question(self, name: str, which: int, seed: int) -> dict[str, Any]:
        """A question with its numbers."""
        ...

    def judge(self, name: str, which: int, seed: int, answer: float | None) -> dict[str, Any]:
        """Whether an answer is right; None gives up."""
        ...


def lesson_routes(teacher: Teacher) -> tuple[web.RouteDef, ...]:
    """Addresses of the page; guests may do all of it."""

    async def listed(request: web.Request) -> web.StreamResponse:
        return fresh_json(teacher.listed(request.match_info["language"]))

    async def view(request: web.Request) -> web.StreamResponse:
        asked = await json_of(request)
        values = asked.get("state")
        if not isinstance(values, dict) or len(values) > MOST_SLIDERS:
            raise web.HTTPBadRequest(text=TIPS)
        state, truth = cast("dict[str, Any]", values), asked.get("truth") is True
        name = request.match_info["name"]
        return await _aside(lambda: teacher.view(name, state, truth))

    async def question(request: web.Request) -> web.StreamResponse:
        name, which, seed = await _numbered(request)
        return await _aside(lambda: teacher.question(name, which, seed))

    async def answer(request: web.Request) -> web.StreamResponse:
        name, which, seed = await _numbered(request)
        given = (await json_of(request)).get("answer")
        if given is not None and not isinstance(given, int | float):
            raise web.HTTPBadRequest(text=TIPS)
        return await _aside(lambda: teacher.judge(name, which, seed, given))

    return (
        web.get("/lessons/{language:en|cs}", listed),
        web.post("/lesson/{name}", view),
        web.post("/lesson/{name}/question", question),
        web.post("/lesson/{name}/answer", answer),
    )


async def _numbered(request: web.Request) -> tuple[str, int, int]:
    """Which question, with which numbers."""
    asked = await json_of(request)
    which, seed = asked.get("which"), asked.get("seed")
    if not isinstance(which, int) or not isinstance(seed, int):
        raise web.HTTPBadRequest(text=TIPS)
    return request.match_info["name"], which, seed


async def _aside(work: Callable[[], dict[str, Any]]) -> web.Response:
    """Work in a thread of its own, so that one student does not wait for another."""
    return await asyncio.to_thread(told, work)
