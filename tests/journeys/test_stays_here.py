"""Nothing leaves the machine: a run speaks to nobody."""

import ipaddress
import socket
from collections.abc import Callable
from typing import Any

import pytest
from pyproj.network import is_network_enabled

from tests.journeys.copies import BlockCopy, gruber


def is_here(address: Any) -> bool:
    """Whether an address is of this machine: a name of a file, or of the loop."""
    if not isinstance(address, tuple):
        return True
    return address[0] == "localhost" or ipaddress.ip_address(address[0]).is_loopback


def test_a_run_opens_no_connection__law(
    copy_of: Callable[..., BlockCopy],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    asked: list[Any] = []

    def noted(name: str) -> None:
        own = getattr(socket.socket, name)

        def connect(self: socket.socket, address: Any) -> Any:
            asked.append(address)
            return own(self, address)

        monkeypatch.setattr(socket.socket, name, connect)

    noted("connect")
    noted("connect_ex")
    resolved: list[Any] = []
    monkeypatch.setattr(socket, "getaddrinfo", lambda *of, **more: resolved.append(of) or [])
    assert gruber(capsys, "run", copy_of(2).folder, "--until", "reference").code == 0
    assert all(map(is_here, asked))
    with socket.socket() as door:
        door.connect_ex(("127.0.0.1", 9))
    assert asked, "connections are seen"
    assert not resolved
    assert not is_network_enabled(), "PROJ would fetch grids"
