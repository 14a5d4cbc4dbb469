"""Viser is closed to everyone who does not know the secret."""

import http.client

import numpy as np
import pytest

from ui.views.block_view import Stage
from ui.views.server import SECRET_HEADER, SceneServer


@pytest.fixture
def server():
    made = SceneServer(Stage(1000.0, np.zeros(3)), "X-Seat", lambda _: None, lambda _: None)
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
