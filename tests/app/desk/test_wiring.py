"""The open desk: its parts are joined, its page is told what it needs, its port is its own."""

import http.client
import json
import threading
from dataclasses import replace

import pytest

from app.desk.wiring import open_desk
from core.errors import PhotogrammetryError
from tests.ui.desk_block import desk_inputs, tiny_block
from ui.review.tiles import CoarseOrtho
from ui.views.server import SceneServer
from ui.web.access import Door


@pytest.fixture
def inputs(tmp_path):
    made = desk_inputs(tmp_path, language="cs", token="t" * 32)
    yield made
    made.session.close()


def told(port: int, path: str, cookie: str) -> dict:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    connection.request("GET", path, headers={"Cookie": cookie})
    answer = connection.getresponse()
    assert answer.status == 200
    found = json.loads(answer.read())
    connection.close()
    return found


def status(port: int, path: str, cookie: str) -> int:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    connection.request("GET", path, headers={"Cookie": cookie})
    found = connection.getresponse().status
    connection.close()
    return found


def test_a_page_is_told_what_it_needs_once__law(inputs):
    with open_desk(inputs) as desk:
        cookie = f"{desk._front.access.cookie}={'t' * 32}"
        start = told(desk.port, "/start", cookie)
        assert desk.url.endswith("t" * 32)
        assert desk.guest_url != desk.url
    assert start["language"] == "cs"
    assert start["photos"] == list(tiny_block().block.photos)
    assert start["lattice"]["levels"] > 1
    # Scan pixels are 1.18 m on the ground, the ortho's 0.5 m: tiles are as fine as the finer.
    assert start["lattice"]["pixel"] == pytest.approx(0.5, rel=0.01)
    # What is fitted into a pane is the ortho, without the rest of its last tile.
    west, south, east, north = inputs.ortho.bounds
    assert (start["lattice"]["width"], start["lattice"]["height"]) == (east - west, north - south)
    assert (start["results"], start["free"]) == (False, [])
    fixed = replace(inputs, free=(False, False), choose=lambda cameras, robust: (False, robust))
    with open_desk(fixed) as desk:
        start = told(desk.port, "/start", f"{desk._front.access.cookie}={'t' * 32}")
    assert start["free"] == [False, True], "cameras that the block holds cannot be freed here"


@pytest.fixture
def laid(monkeypatch):
    """Grounds of the scene in their order; what stands for reading the ortho adds `read`."""
    made, begun = [], threading.Event()

    def prepared(_):
        made.append(b"read")
        begun.set()

    monkeypatch.setattr(CoarseOrtho, "prepare", prepared)
    monkeypatch.setattr(SceneServer, "drape", lambda _, ground: made.append(ground[:4]))
    return made, begun


def test_the_scene_has_its_ground_before_the_ortho_is_read__law(inputs, laid):
    """It stayed black for seconds."""
    made, begun = laid
    with open_desk(inputs) as desk:
        desk.scene._opened("a")
        assert begun.wait(60)
    assert made[:2] == [b"glTF", b"read"]


def test_the_ortho_is_read_once_a_scene_or_a_coarse_tile_needs_it__law(inputs, laid):
    """Every desk began by reading it whole."""
    made, begun = laid
    with open_desk(inputs) as desk:
        cookie = f"{desk._front.access.cookie}={'t' * 32}"
        assert status(desk.port, "/tiles/ortho/0/1/1", cookie) == 200
        assert not begun.wait(1)
        assert made == []
        last = told(desk.port, "/start", cookie)["lattice"]["levels"] - 1
        assert status(desk.port, f"/tiles/ortho/{last}/0/0", cookie) == 503
        assert begun.wait(60)


def test_a_port_that_is_taken_is_told_with_the_remedy__law(inputs, tmp_path):
    with open_desk(inputs) as desk:
        other = replace(desk_inputs(tmp_path / "other"), door=Door(port=desk.port))
        with pytest.raises(PhotogrammetryError, match="--port"):
            open_desk(other)
        other.session.close()


def test_a_closed_desk_is_closed_once__law(inputs):
    desk = open_desk(inputs)
    desk.close()
    desk.close()
    desk.wait()


def test_a_block_that_may_not_be_written_is_only_looked_at__law(inputs):
    with open_desk(replace(inputs, looking=True)) as desk:
        cookie = f"{desk._front.access.cookie}={'t' * 32}"
        start = told(desk.port, "/start", cookie)
        assert (start["guest"], start["looking"]) == (True, True)
