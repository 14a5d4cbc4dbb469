"""The wire: only what changed goes down, and guests send nothing that decides."""

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from aiohttp import ClientWebSocketResponse, web
from aiohttp.test_utils import TestClient, TestServer

from ui.review.gestures import Judged, Stepped
from ui.web.access import GUEST
from ui.web.channel import PIECE, Channel, Lines

ONLY_LOOKING = '{"text":"notice.guest","values":{},"grave":false}'


def test_only_the_piece_with_the_changed_line_is_written_anew__law():
    lines, rows = Lines(), [["P", "a", number] for number in range(2 * PIECE + 10)]
    first = lines.told(rows)
    assert set(first) == {"rows/0", "rows/1", "rows/2", "rows/count"}
    assert json.loads(first["rows/count"]) == len(rows)
    changed = list(rows)
    changed[PIECE + 3] = ["P", "a", "new"]
    second = lines.told(changed)
    assert second["rows/0"] is first["rows/0"]
    assert second["rows/2"] is first["rows/2"]
    assert json.loads(second["rows/1"])[3] == ["P", "a", "new"]


def test_fewer_lines_are_fewer_pieces__law():
    lines = Lines()
    lines.told([[number] for number in range(2 * PIECE)])
    told = lines.told([[number] for number in range(PIECE)])
    assert set(told) == {"rows/0", "rows/count"}
    assert lines.told([])["rows/count"] == "0"


class Room:
    """A channel, and what came of what was said to it."""

    def __init__(self) -> None:
        self.gestures, self.taken, self.left = [], [], []
        self.channel = Channel(
            self.gestures.append, self.taken.append, self.left.append, ONLY_LOOKING
        )

    def application(self, guest: bool = False) -> web.Application:
        async def serve(request: web.Request) -> web.WebSocketResponse:
            request[GUEST] = guest
            return await self.channel.serve(request)

        application = web.Application()
        application.add_routes([web.get("/desk/{seat}", serve)])
        return application

    @asynccontextmanager
    async def page(self, guest: bool = False) -> AsyncIterator[ClientWebSocketResponse]:
        """A page that sits down in it."""
        async with (
            TestServer(self.application(guest)) as server,
            TestClient(server) as client,
            client.ws_connect("/desk/seat-one") as page,
        ):
            yield page


def test_a_page_gets_what_changed_since_it_last_heard__law():
    async def visit() -> None:
        room = Room()
        async with room.page() as page:
            room.channel.show("seat-one", {"status": "1", "queue": "2"})
            assert await page.receive_json() == {"status": 1, "queue": 2}
            room.channel.show("seat-one", {"status": "3", "queue": "2"})
            assert await page.receive_json() == {"status": 3}
            room.channel.tell("", '{"text":"t"}')
            assert await page.receive_json() == {"notices": [{"text": "t"}]}
            assert room.channel.taken("seat-one")
            await page.send_str("no json")
            await page.send_json({"kind": "nonsense"})
            await page.send_json({"kind": "step", "step": 1})
            while not room.gestures:
                await asyncio.sleep(0.01)
        assert room.gestures == [Stepped("seat-one", 1)]
        assert (room.taken, room.left) == (["seat-one"], ["seat-one"])

    asyncio.run(visit())


def test_pieces_that_were_cut_off_come_again_when_they_return__law():
    """Points that are undone and redone: the page ends with the rows that there are."""
    lines, many = Lines(), [["P", "a", number] for number in range(3 * PIECE)]

    async def visit() -> None:
        room, pieces = Room(), []
        async with room.page() as page:
            for rows in (many, many[:PIECE], many):
                room.channel.show("seat-one", lines.told(rows))
                pieces.append(set(await page.receive_json()))
        assert pieces[1] == {"rows/count"}
        assert pieces[2] == {"rows/1", "rows/2", "rows/count"}

    asyncio.run(visit())


def test_a_verdict_on_thousands_of_rows_at_once_arrives__law():
    keys = [[f"J-7432105_-1043050{number:05d}", f"roll-1938-{number}"] for number in range(5000)]

    async def visit() -> None:
        room = Room()
        async with room.page() as page:
            await page.send_json({"kind": "judge", "keys": keys, "verdict": "accept"})
            async with asyncio.timeout(30):
                while not room.gestures:
                    await asyncio.sleep(0.01)
        assert [len(one.keys) for one in room.gestures] == [5000]

    asyncio.run(visit())


def test_a_guest_may_step_and_is_told_why_not_decide__law():
    async def visit() -> None:
        room = Room()
        async with room.page(guest=True) as page:
            await page.send_json({"kind": "judge", "key": ["P", "a"], "verdict": "accept"})
            assert await page.receive_json() == {"notices": [json.loads(ONLY_LOOKING)]}
            await page.send_json({"kind": "step", "step": 1})
            while not room.gestures:
                await asyncio.sleep(0.01)
        assert not any(isinstance(one, Judged) for one in room.gestures)

    asyncio.run(visit())
