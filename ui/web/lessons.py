"""Addresses of the page of lessons: a state in, figures and a drawing out."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, TypeGuard, cast

from aiohttp import web

from ui.web.access import is_guest
from ui.web.running import fresh_json, json_of, told

MOST_SLIDERS = 60
ATTEMPT = {"lesson": str, "which": int, "seed": int, "when": str, "state": dict}
"""What the page kept of each answer, beside the answer itself."""
# design: twice what the slowest lesson of ours takes.
PATIENCE_S = 1.0
"""What takes longer, such as a lesson of somebody's own, makes room for the others."""
TIPS = "A lesson's name, and its values as numbers, are expected."


class Teacher(Protocol):
    """What the page asks; nothing of it is kept, so that every student has a place of their own."""

    def listed(self, language: str, truth: bool) -> dict[str, Any]:
        """All lessons, with their texts, and whether they can show the truth."""
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

    def table(self, student: str, attempts: Sequence[Mapping[str, Any]]) -> bytes:
        """A student's attempts as a table for a spreadsheet."""
        ...


def lesson_routes(teacher: Teacher, hide_truth: bool = False) -> tuple[web.RouteDef, ...]:
    """Addresses of the page; guests may do all of it, but see no truth where it is hidden."""
    turn = asyncio.Lock()

    def may_see(request: web.Request) -> bool:
        return not (hide_truth and is_guest(request))

    async def listed(request: web.Request) -> web.StreamResponse:
        return fresh_json(teacher.listed(request.match_info["language"], may_see(request)))

    async def view(request: web.Request) -> web.StreamResponse:
        asked = await json_of(request)
        values = asked.get("state")
        if not isinstance(values, dict) or len(values) > MOST_SLIDERS:
            raise web.HTTPBadRequest(text=TIPS)
        state = cast("dict[str, Any]", values)
        truth = asked.get("truth") is True and may_see(request)
        name = request.match_info["name"]
        return await _aside(lambda: teacher.view(name, state, truth), turn)

    async def question(request: web.Request) -> web.StreamResponse:
        name, which, seed = await _numbered(request)
        return await _aside(lambda: teacher.question(name, which, seed), turn)

    async def answer(request: web.Request) -> web.StreamResponse:
        name, which, seed = await _numbered(request)
        given = (await json_of(request)).get("answer")
        if given is not None and not isinstance(given, int | float):
            raise web.HTTPBadRequest(text=TIPS)
        return await _aside(lambda: teacher.judge(name, which, seed, given), turn)

    async def table(request: web.Request) -> web.StreamResponse:
        asked = await json_of(request)
        student, attempts = asked.get("student"), asked.get("attempts")
        if not isinstance(student, str) or not _are_attempts(attempts):
            raise web.HTTPBadRequest(text=TIPS)
        made = await asyncio.to_thread(teacher.table, student, attempts)
        return web.Response(body=made, content_type="text/csv", charset="utf-8")

    return (
        web.get("/lessons/{language:en|cs}", listed),
        web.post("/answers", table),
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


def _are_attempts(given: object) -> TypeGuard[list[dict[str, Any]]]:
    """Whether each has all that a table of answers tells of it."""
    return isinstance(given, list) and all(
        isinstance(one, dict)
        and all(isinstance(one.get(name), kind) for name, kind in ATTEMPT.items())
        and isinstance(one.get("answer"), int | float | None)
        for one in cast("list[object]", given)
    )


async def _aside(work: Callable[[], dict[str, Any]], turn: asyncio.Lock) -> web.Response:
    """Work in a thread, one after another: side by side Python would make all of them late."""
    async with turn:
        done = asyncio.create_task(asyncio.to_thread(told, work))
        await asyncio.wait({done}, timeout=PATIENCE_S)
    return await done
