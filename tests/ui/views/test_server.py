"""Viser is closed to everyone who does not know the secret."""

import http.client
import threading

import numpy as np
import pytest

from ui.views.block_view import Stage
from ui.views.server import KEPT_SHEETS, SECRET_HEADER, SceneServer, Sheet


@pytest.fixture
def server():
    made = SceneServer(Stage(1000.0, np.zeros(3)), "X-Seat", lambda _: None)
    yield made
    made.close()


def status(port: int, headers: dict[str, str]) -> int:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    connection.request("GET", "/", headers=headers)
    answer = connection.getresponse()
    connection.close()
    return answer.status


def test_only_the_secret_opens_the_scene__law(server):
    assert status(server.port, {}) == 403
    assert status(server.port, {SECRET_HEADER: "guessed"}) == 403
    assert status(server.port, {SECRET_HEADER: server.secret}) == 200


def test_an_error_in_one_scene_is_logged_and_goes_no_further__law(server, caplog):
    def spoilt(*_):
        raise ValueError("gone")

    server._told(spoilt)
    assert "could not be shown" in caplog.text


def test_a_mesh_is_made_once_beside_the_scene_and_few_are_kept__law(server):
    made: list[str] = []

    def make() -> bytes:
        made.append(threading.current_thread().name)
        return b"glb"

    for _ in range(2):
        server._make(Sheet("/veil", "one", make))
    for number in range(KEPT_SHEETS):
        server._make(Sheet("/veil", f"{number}", lambda: b"glb"))
    server._maker.submit(lambda: None).result(timeout=5)
    assert len(made) == 1
    assert "sheets" in made[0]
    assert len(server._sheets) == KEPT_SHEETS
    assert "one" not in server._sheets


def test_a_mesh_that_cannot_be_made_is_tried_again__law(server, caplog):
    def spoilt() -> bytes:
        raise ValueError("no scan")

    for _ in range(2):
        server._make(Sheet("/veil", "one", spoilt))
        server._maker.submit(lambda: None).result(timeout=5)
    assert caplog.text.count("could not be shown") == 2
