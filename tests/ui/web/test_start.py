"""Addresses of the start page: guests change nothing, uploads are whole or not there."""

import asyncio
import io
from contextlib import contextmanager

import pytest

from core.errors import StorageError
from tests.ui.web.visits import visited
from ui.web.start import start_routes


class Starter:
    """Remembers what it was asked for, and writes into a folder."""

    def __init__(self, folder) -> None:
        self.folder, self.asked = folder, []

    def __getattr__(self, name):
        def act(*given):
            if given == ("broken",):
                raise StorageError("a", "cannot be read.", "Choose another.")
            self.asked.append(name)
            return {"state": "idle"}

        return act

    @contextmanager
    def receive(self, name, size):
        if name == "taken":
            raise StorageError(name, "is there already.", "Rename it.")
        temporary = self.folder / ".part"
        try:
            yield temporary
            temporary.rename(self.folder / name)
        finally:
            temporary.unlink(missing_ok=True)


def seen(folder, visit, guest=False):
    """What a visit of the page's addresses comes to, and what was asked for."""
    starter = Starter(folder)
    return visited(start_routes(starter), visit, guest), starter.asked


ACTS = [("/form", {"values": {}}), ("/form/judge", {"values": {}}), ("/folders", {"path": ""}),
        ("/link", {"path": "a"}), ("/unlink", {"path": "a"}), ("/open", {"path": "a"}),
        ("/run", {}), ("/run/cancel", {})]  # fmt: skip

LOOKS = ("/found", "/run", "/neighbours")


@pytest.mark.parametrize("guest", [True, False])
def test_guests_look_and_change_nothing__law(tmp_path, guest):
    async def visit(client):
        found = [(await client.post(path, json=body)).status for path, body in ACTS]
        put = (await client.put("/files/a.tif", data=b"abc")).status
        return [*found, put], [(await client.get(path)).status for path in LOOKS]

    (changing, looking), _ = seen(tmp_path, visit, guest)
    assert set(changing) == {403 if guest else 200}
    assert looking == [200] * len(LOOKS)
    assert (tmp_path / "a.tif").exists() != guest


def test_large_uploads_are_streamed_and_errors_are_told__law(tmp_path):
    async def visit(client):
        large = await client.put("/files/large.tif", data=io.BytesIO(b"x" * 5_000_001))
        taken = await client.put("/files/taken", data=b"x")
        return large.status, taken.status, await taken.json()

    (large, taken, said), _ = seen(tmp_path, visit)
    assert (large, taken) == (200, 409)
    assert said["error"]["values"]["remedy"] == "Rename it."
    assert (tmp_path / "large.tif").stat().st_size == 5_000_001


def test_a_broken_upload_leaves_nothing__law(tmp_path):
    async def visit(client):
        reader, writer = await asyncio.open_connection("127.0.0.1", client.port)
        writer.write(b"PUT /files/a.tif HTTP/1.1\r\nHost: x\r\nContent-Length: 1000\r\n\r\nabc")
        await writer.drain()
        await asyncio.sleep(0.2)
        writer.close()
        await asyncio.sleep(0.5)
        return reader

    seen(tmp_path, visit)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("path", "body"), [
    ("/form", {}), ("/form", {"values": [1]}), ("/link", {}), ("/link", {"path": 3}),
    ("/open", {"path": "a\0"}), ("/form", {"values": {str(n): n for n in range(400)}}),
])  # fmt: skip
def test_what_is_no_request_of_the_page_is_refused__law(tmp_path, path, body):
    async def visit(client):
        return (await client.post(path, json=body)).status

    status, asked = seen(tmp_path, visit)
    assert (status, asked) == (400, [])
