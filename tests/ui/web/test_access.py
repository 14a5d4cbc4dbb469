"""The lock: who knows the token comes in, from our own pages only."""

import asyncio
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from aiohttp import web
from aiohttp.test_utils import TestClient, TestServer

from ui.web.access import Access, Door, is_guest, lasting_token, network_name


def test_addresses_carry_the_token_and_guests_get_another__law():
    access = Access(Door("0.0.0.0"), "secret-token")
    assert access.url(8765) == "http://127.0.0.1:8765/?token=secret-token"
    assert "secret-token" not in access.guest_url(8765)
    assert access.guest_token in access.guest_url(8765)
    assert Access(Door("localhost"), "other").cookie != access.cookie


def test_guests_of_the_network_get_an_address_they_can_reach__law():
    """Of this machine as others see it, at which the desk answers; at home all stays at home."""
    access = Access(Door("0.0.0.0"), "secret-token")
    guests = urlsplit(access.guest_url(8765))
    assert guests.hostname == network_name()
    assert access.host_is_ours(guests.netloc)
    assert Access(Door("127.0.0.1")).guest_url(1).startswith("http://127.0.0.1:1/")


def test_a_desk_behind_a_proxy_is_reached_by_its_name__law():
    """Both addresses name it; other names are strangers as ever."""
    access = Access(Door("0.0.0.0", address="https://desk.example.org"), "secret-token")
    assert access.url(8765) == "https://desk.example.org/?token=secret-token"
    assert access.guest_url(8765).startswith("https://desk.example.org/?token=")
    inner = Access(Door("0.0.0.0", address="http://127.0.0.1:80"))
    assert inner.guest_url(8765).startswith("http://127.0.0.1:80/")
    assert access.host_is_ours("desk.example.org")
    assert access.host_is_ours("Desk.Example.org:443")
    assert access.origin_is_ours("https://desk.example.org", "desk.example.org")
    assert access.origin_is_ours("https://desk.example.org", "127.0.0.1:8765")
    assert not access.origin_is_ours("http://desk.example.org", "127.0.0.1:8765")
    assert not access.host_is_ours("evil.example")
    assert not Access(Door("0.0.0.0")).host_is_ours("desk.example.org")


def test_a_cookie_given_through_tls_is_never_sent_without__law():
    access = Access(Door(address="https://desk.example.org"), "secret-token")

    async def visit() -> None:
        application = web.Application(middlewares=[access.guard()])
        async with TestServer(application) as server, TestClient(server) as client:
            for host, secure in (("desk.example.org", True), ("127.0.0.1", False)):
                entered = await client.get(
                    "/?token=secret-token", headers={"Host": host}, allow_redirects=False
                )
                assert ("Secure" in entered.headers["Set-Cookie"]) == secure

    asyncio.run(visit())


@pytest.mark.parametrize(
    ("listening", "asked", "ours"),
    [
        ("127.0.0.1", "127.0.0.1:8765", True),
        ("127.0.0.1", "localhost:8765", True),
        ("127.0.0.1", "[::1]:8765", True),
        ("127.0.0.1", "evil.example:8765", False),
        ("127.0.0.1", "192.168.1.7:8765", False),
        ("0.0.0.0", "192.168.1.7:8765", True),
        ("0.0.0.0", "evil.example:8765", False),
        ("127.0.0.1", "", False),
        ("0.0.0.0", "[::1", False),
        ("0.0.0.0", "a]b[", False),
    ],
)
def test_a_rebound_name_is_not_ours__truth(listening, asked, ours):
    assert Access(Door(listening)).host_is_ours(asked) == ours


def test_other_origins_are_not_ours__truth():
    access = Access(Door("127.0.0.1"))
    assert access.origin_is_ours(None, "127.0.0.1:1")
    assert access.origin_is_ours("http://127.0.0.1:1", "127.0.0.1:1")
    assert not access.origin_is_ours("http://127.0.0.1:2", "127.0.0.1:1")
    assert not access.origin_is_ours("null", "127.0.0.1:1")
    assert not access.origin_is_ours("http://[::1", "127.0.0.1:1")
    assert not access.origin_is_ours("", "127.0.0.1:1")


def test_operators_and_guests_come_in_and_strangers_do_not__law():
    access = Access(Door("127.0.0.1"), "secret-token")

    async def who(request: web.Request) -> web.Response:
        return web.Response(text="guest" if is_guest(request) else "operator")

    async def visit() -> None:
        application = web.Application(middlewares=[access.guard()])
        application.add_routes([web.get("/", who), web.get("/page", who)])
        async with TestServer(application) as server, TestClient(server) as client:
            assert (await client.get("/page")).status == 401
            assert (await client.get("/?token=guessed")).status == 401
            for token, name in (("secret-token", "operator"), (access.guest_token, "guest")):
                entered = await client.get(f"/?token={token}", allow_redirects=False)
                assert (entered.status, entered.headers["Location"]) == (303, "/")
                link = f"/?token={token}&lesson=relief"
                named = await client.get(link, allow_redirects=False)
                assert named.headers["Location"] == "/?lesson=relief"
                cookies = {access.cookie: token}
                answer = await client.get("/page", cookies=cookies)
                assert await answer.text() == name
                assert answer.headers["X-Frame-Options"] == "SAMEORIGIN"
            headers = {"Origin": "http://evil.example"}
            refused = await client.get("/page", cookies=cookies, headers=headers)
            assert refused.status == 403

    asyncio.run(visit())


def test_the_secret_lasts_and_is_the_owners_alone__law(tmp_path: Path):
    first = lasting_token(tmp_path)
    assert len(first) >= 32
    assert lasting_token(tmp_path) == first
    assert (tmp_path / "desk-token").stat().st_mode & 0o077 == 0


@pytest.mark.parametrize("spoilt", [b"short", b"\xff\xfe\x00"])
def test_a_spoilt_secret_is_made_anew__law(tmp_path: Path, spoilt: bytes):
    (tmp_path / "desk-token").write_bytes(spoilt)
    fresh = lasting_token(tmp_path)
    assert len(fresh) >= 32
    assert lasting_token(tmp_path) == fresh
