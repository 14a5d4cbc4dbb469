"""Addresses of the start page: the folder's content, uploads, the form, and the run."""

import asyncio
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import Any, Protocol

from aiohttp import ClientPayloadError, web

from core.errors import PhotogrammetryError
from ui.web.running import Runner, error_message, fresh_json, json_of, operators_only, run_routes

CHUNK_BYTES = 1 << 20
"""An upload goes to the disk in pieces of this size."""
MOST_FIELDS = 300
Fields = Mapping[str, Any] | None
"""What the file had of each field, as the page showed it; None for all fields."""


class Starter(Runner, Protocol):
    """What the page asks for and sets off; each call may take a second."""

    def found(self) -> dict[str, Any]:
        """What the folder holds and lacks."""
        ...

    def batch(self) -> dict[str, Any]:
        """How far the blocks of the folder are that were run together."""
        ...

    def neighbours(self) -> dict[str, Any]:
        """What the blocks of the folder share; many of them take a while."""
        ...

    def judge(self, values: Mapping[str, Any], written: Fields) -> dict[str, Any]:
        """What is wrong with the form, of which a hand has written so many fields."""
        ...

    def save(self, values: Mapping[str, Any], written: Fields) -> dict[str, Any]:
        """Write the form into `block.toml`."""
        ...

    def receive(self, name: str, size: int) -> AbstractContextManager[Path]:
        """Where an upload of so many bytes is written."""
        ...

    def folders(self, path: str) -> dict[str, Any]:
        """Folders of this computer."""
        ...

    def link(self, path: str) -> dict[str, Any]:
        """Show another folder's files here."""
        ...

    def unlink(self, name: str) -> dict[str, Any]:
        """Take such a link away."""
        ...

    def margin(self, photo: str, values: Mapping[str, Any]) -> dict[str, Any]:
        """What is written beside the picture of a scan, with the form as it stands."""
        ...

    def open(self, path: str) -> dict[str, Any]:
        """Go on with the desk, or with another folder."""
        ...


def start_routes(starter: Starter) -> tuple[web.RouteDef, ...]:
    """Addresses of the page; guests look at what was found and at the run, no farther."""

    async def found(request: web.Request) -> web.StreamResponse:
        return await _aside(starter.found)

    async def batch(request: web.Request) -> web.StreamResponse:
        return await _aside(starter.batch)

    async def neighbours(request: web.Request) -> web.StreamResponse:
        return await _aside(starter.neighbours)

    async def receive(request: web.Request) -> web.StreamResponse:
        operators_only(request)
        return await _received(request, starter.receive)

    async def margin(request: web.Request) -> web.StreamResponse:
        return await _margin(request, starter)

    def with_path(act: Callable[[str], dict[str, Any]]) -> Any:
        async def answer(request: web.Request) -> web.StreamResponse:
            operators_only(request)
            path = (await json_of(request)).get("path")
            if not isinstance(path, str) or "\0" in path:
                raise web.HTTPBadRequest(text="A path is expected.")
            return await _aside(lambda: act(path))

        return answer

    return (
        web.get("/found", found),
        web.get("/batch", batch),
        web.get("/neighbours", neighbours),
        web.put("/files/{name:.+}", receive),
        web.post("/form/judge", _with_form(starter.judge)),
        web.post("/form", _with_form(starter.save)),
        web.post("/folders", with_path(starter.folders)),
        web.post("/link", with_path(starter.link)),
        web.post("/unlink", with_path(starter.unlink)),
        web.post("/open", with_path(starter.open)),
        web.post("/margin", margin),
        *run_routes(starter),
    )


def _with_form(act: Callable[[Mapping[str, Any], Fields], dict[str, Any]]) -> Any:
    """What is done with the form as it stands, and the fields of it that a hand has written."""

    async def answer(request: web.Request) -> web.StreamResponse:
        operators_only(request)
        asked = await json_of(request)
        values, written = asked.get("values"), asked.get("written")
        if not isinstance(values, dict) or len(values) > MOST_FIELDS:
            raise web.HTTPBadRequest(text="The values of the form are expected.")
        if not isinstance(written, dict | None):
            raise web.HTTPBadRequest(text="Fields with what the file had of them are expected.")
        return await _aside(lambda: act(values, written))

    return answer


async def _margin(request: web.Request, starter: Starter) -> web.StreamResponse:
    """What is written beside the picture of a scan."""
    operators_only(request)
    asked = await json_of(request)
    photo, values = asked.get("photo"), asked.get("values")
    if not isinstance(photo, str) or not isinstance(values, dict) or len(values) > MOST_FIELDS:
        raise web.HTTPBadRequest(text="A photo and the values of the form are expected.")
    return await _aside(lambda: starter.margin(photo, values))


async def _aside(work: Callable[[], dict[str, Any]]) -> web.Response:
    """Work that reads the disk, in a thread of its own; its result or the words of its error."""
    try:
        return fresh_json(await asyncio.to_thread(work))
    except PhotogrammetryError as error:
        return error_message(error)


async def _received(
    request: web.Request, receive: Callable[[str, int], AbstractContextManager[Path]]
) -> web.Response:
    """Stream a body to the disk; a file is there whole or not at all."""
    size, name = request.content_length, request.match_info["name"]
    if size is None:
        raise web.HTTPLengthRequired
    try:
        with ExitStack() as stack:
            temporary = await asyncio.to_thread(stack.enter_context, receive(name, size))
            written = await _written(request, temporary)
            if written != size:
                raise web.HTTPBadRequest(text=f"{name} broke off.")
            # What ends the context waits for the disk.
            await asyncio.to_thread(stack.pop_all().close)
    except PhotogrammetryError as error:
        return error_message(error)
    except (ClientPayloadError, web.RequestPayloadError, ConnectionError) as error:
        raise web.HTTPBadRequest(text=f"{name} broke off.") from error
    return fresh_json({"name": name, "bytes": size})


async def _written(request: web.Request, path: Path) -> int:
    """Bytes that came and are written."""
    written = 0
    with path.open("wb") as file:
        async for chunk in request.content.iter_chunked(CHUNK_BYTES):
            await asyncio.to_thread(file.write, chunk)
            written += len(chunk)
    return written
