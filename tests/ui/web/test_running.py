"""Addresses of a run: everybody sees how far it is, operators begin and stop it."""

import asyncio

import pytest
from aiohttp import web

from core.errors import ScanError
from tests.ui.web.visits import visited
from ui.web.running import Leaving, json_of, run_routes, told


class Runner:
    """Remembers what it was asked for."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def status(self):
        return {"state": "idle"}

    def start_run(self):
        self.asked.append("run")

    def cancel_run(self):
        self.asked.append("cancel")


def answers(*requests: tuple[str, str], guest: bool):
    """Status of each request (method, path), and what the runner was asked for."""
    runner = Runner()

    async def visit(client):
        return [(await client.request(*asked)).status for asked in requests]

    return visited(run_routes(runner), visit, guest), runner.asked


@pytest.mark.parametrize(
    ("guest", "status", "asked"), [(True, 403, []), (False, 200, ["run", "cancel"])]
)
def test_guests_see_a_run_and_begin_none__law(guest, status, asked):
    found = answers(("GET", "/run"), ("POST", "/run"), ("POST", "/run/cancel"), guest=guest)
    assert found == ([200, status, status], asked)


@pytest.mark.parametrize("guest", [True, False])
def test_who_closes_a_page_for_its_settings_is_known__truth(guest):
    leaving = Leaving()

    async def visit(client):
        said = {"who": "Anna" + 60 * "a", "mark": "0.5", "more": 1}
        return (await client.post("/settings", json=said)).status

    assert visited((leaving.route(),), visit, guest) == (403 if guest else 200)
    assert leaving.asked.is_set() is not guest
    assert leaving.told == ({} if guest else {"who": "Anna" + 36 * "a", "mark": "0.5"})


def test_errors_are_told_in_their_words__law():
    def broken():
        raise ScanError("a.tif", "is broken.", "Mend it.")

    assert told(lambda: {"a": 1}).status == 200
    answer = told(broken)
    assert answer.status == 409
    assert "Mend it." in str(answer.text)


@pytest.mark.parametrize("text", ["", "[1]", "{", '"a"'])
def test_what_is_no_object_is_refused__law(text):
    class Request:
        async def text(self):
            return text

    with pytest.raises(web.HTTPBadRequest):
        asyncio.run(json_of(Request()))
