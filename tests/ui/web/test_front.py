"""The front: pages with their policy, texts in the browser's language, results to take away."""

import asyncio
import gc
import http.client
import json
import socket
import sys
import threading
import time
import warnings
import weakref
from contextlib import suppress
from dataclasses import replace

import aiohttp
import pytest
from aiohttp import web

from core.errors import PhotogrammetryError
from tests.ui.desk_block import tiny_block
from ui.review.tiles import Lattice
from ui.web.access import Access, Door
from ui.web.channel import Channel
from ui.web.front import Front, FrontInputs, as_json
from ui.web.tiles import Sources, TileStore
from ui.words.catalogue import KEYS, words


@pytest.fixture
def inputs(tmp_path):
    tiny = tiny_block()
    lattice = Lattice.over(tiny.land.today.bounds, 1.0)
    tiles = TileStore(Sources(tiny.land.today, tiny.land.dem, tiny.scans, lattice))
    results = tmp_path / "results"
    results.mkdir()
    (results / "report.html").write_text("<p>report</p>")
    (results / "control_points.csv").write_text("point_id")
    (results / "secret.key").write_text("k")
    (results / "surface.copc.laz").write_bytes(b"LASF")
    (results / "adjustment.txt").write_text("sigma nought")
    (results / "Ori-InterneScan").mkdir()
    (results / "Ori-InterneScan" / "MeasuresIm-a.tif.xml").write_text("<Global/>")
    (results / "ortho").mkdir()
    (results / "ortho" / "a.tif").write_bytes(b"II")
    (results / "sheets" / "EPSG-5513").mkdir(parents=True)
    (results / "sheets" / "HUST25.tif").write_bytes(b"II")
    (results / "sheets" / "EPSG-5513" / "HUST25.tif").write_bytes(b"II*")
    (results / "sheets" / "linked").symlink_to(results / "ortho")
    (results / "linked").symlink_to(results / "ortho")
    (results / "link.csv").symlink_to("/etc/hostname")
    yield FrontInputs(
        Access(Door("127.0.0.1"), "t" * 32), None, tiles, None, {"name": "kobyli"}, results
    )
    tiles.close()


class Visitor:
    """Somebody with the token."""

    def __init__(self, inputs: FrontInputs) -> None:
        self.front = Front(inputs)
        self.front.start()
        self.cookie = f"{inputs.access.cookie}={inputs.access.token}"

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.front.close()

    def get(self, path: str, **headers: str):
        connection = http.client.HTTPConnection("127.0.0.1", self.front.port, timeout=10)
        given = {name.replace("_", "-"): value for name, value in headers.items()}
        connection.request("GET", path, headers={"Cookie": self.cookie, **given})
        answer = connection.getresponse()
        body = answer.read().decode(errors="replace")
        connection.close()
        return answer, body


@pytest.mark.parametrize(
    ("chosen", "accepted", "language"),
    [("", "cs-CZ,cs;q=0.9", "cs"), ("", "de", "en"), ("en", "cs", "en"), ("cs", "", "cs")],
)
def test_texts_are_in_the_language_chosen_or_else_the_browsers__law(
    inputs, chosen, accepted, language
):
    with Visitor(replace(inputs, language=chosen)) as visitor:
        start = json.loads(visitor.get("/start", Accept_Language=accepted)[1])
    assert start["language"] == language
    assert start["words"] == words(language)
    assert start["keys"] == [list(pair) for pair in KEYS]
    assert (start["name"], start["guest"]) == ("kobyli", False)


@pytest.mark.parametrize(("kept", "language"), [("cs", "cs"), ("de", "en"), ("", "en")])
def test_a_language_chosen_on_a_page_goes_before_all_others__law(inputs, kept, language):
    with Visitor(replace(inputs, language="en")) as visitor:
        cookie = f"{visitor.cookie}; gruber-language={kept}"
        start = json.loads(visitor.get("/start", Cookie=cookie)[1])
    assert start["language"] == language


def test_pages_have_their_policy_and_nothing_else_is_served__law(inputs):
    with Visitor(inputs) as visitor:
        page, body = visitor.get("/")
        assert "default-src 'self'" in page.headers["Content-Security-Policy"]
        assert "desk.js" in body
        assert visitor.get("/pages/desk.css")[0].headers["Content-Type"].startswith("text/css")
        font, _ = visitor.get("/pages/inter-latin.woff2")
        assert font.headers["Content-Type"] == "font/woff2"
        for path in ("/pages/none.js", "/pages/..%2Ffront.py", "/pages/front.py", "/scene/x/"):
            assert visitor.get(path)[0].status == 404, path


def test_results_are_listed_report_first_and_links_are_not_followed__law(inputs):
    with Visitor(inputs) as visitor:
        listed = json.loads(visitor.get("/results/")[1])
        names = ["report.html", "adjustment.txt", "control_points.csv", "surface.copc.laz"]
        names += ["ortho/a.tif"]
        names += ["sheets/EPSG-5513/HUST25.tif", "sheets/HUST25.tif"]
        names += ["Ori-InterneScan/MeasuresIm-a.tif.xml"]
        assert [name for name, _ in listed] == names
        ortho, _ = visitor.get("/results/ortho/a.tif")
        assert ortho.headers["Content-Disposition"] == 'attachment; filename="a.tif"'
        cloud, _ = visitor.get("/results/surface.copc.laz")
        assert cloud.headers["Content-Type"] == "application/vnd.laszip"
        report, _ = visitor.get("/results/report.html")
        assert "default-src 'none'" in report.headers["Content-Security-Policy"]
        table, body = visitor.get("/results/control_points.csv")
        assert (body, table.headers["Content-Disposition"].split(";")[0]) == (
            "point_id",
            "attachment",
        )
        assert visitor.get("/results/sheets/EPSG-5513/HUST25.tif")[1] == "II*"
        for name in (
            "secret.key",
            "link.csv",
            "..%2Fblock.toml",
            "linked/a.tif",
            "sheets/linked/a.tif",
            "sheets/EPSG-5513/../../../block.toml",
        ):
            assert visitor.get(f"/results/{name}")[0].status == 404, name


def test_a_seat_is_given_and_an_own_one_is_kept__law(inputs):
    with Visitor(inputs) as visitor:
        fresh = json.loads(visitor.get("/start")[1])["seat"]
        assert len(fresh) >= 6
        kept = json.loads(visitor.get("/start?seat=seat-number-1&own=1")[1])["seat"]
        assert kept == "seat-number-1"
        assert json.loads(visitor.get("/start?seat=%3Cb%3E&own=1")[1])["seat"] != "<b>"


def test_a_port_that_is_taken_is_an_error__law(inputs):
    with Visitor(inputs) as visitor:
        taken = Access(Door(port=visitor.front.port), "t" * 32)
        other = Front(replace(inputs, access=taken))
        with pytest.raises(PhotogrammetryError, match=r"in use.*--port"):
            other.start()


def test_a_page_that_comes_back_at_once_does_not_hold_up_the_end__law(inputs):
    """As the desk's page does when its channel is closed."""
    met, here = [], threading.Event()

    async def come_back(front, cookie):
        headers = {"Cookie": cookie}
        address = f"http://127.0.0.1:{front.port}/desk/{'s' * 8}"
        async with aiohttp.ClientSession(headers=headers) as session:
            with suppress(aiohttp.ClientError):
                while True:
                    async with session.ws_connect(address) as page:
                        await page.receive()

    def taken(seat):
        met.append(seat)
        here.set()

    class Slow(Channel):
        async def close(self):
            await super().close()
            await asyncio.sleep(0.3)

    channel = Slow(list, taken, lambda seat: None)
    visitor = Visitor(replace(inputs, channel=channel))
    page = threading.Thread(
        target=lambda: asyncio.run(come_back(visitor.front, visitor.cookie)), daemon=True
    )
    page.start()
    assert here.wait(timeout=30)
    begun = time.perf_counter()
    visitor.front.close()
    # Held up by the page it is two seconds.
    assert time.perf_counter() - begun < 1.5
    assert met == ["s" * 8]
    page.join(timeout=5)


def test_json_knows_no_nan__law():
    assert as_json({"a": "\u010d", "b": [1]}) == '{"a":"\u010d","b":[1]}'
    with pytest.raises(ValueError, match="not JSON compliant"):
        as_json(float("nan"))


def test_who_comes_while_the_front_closes_leaves_no_connection_open__law(inputs) -> None:
    """About every fourth front left one or two, which Python tells when they are cleared away."""
    told: list[str] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            sys, "unraisablehook", lambda unraisable: told.append(str(unraisable.err_msg))
        )
        patch.setattr(warnings, "showwarning", lambda message, *_: told.append(str(message)))
        warnings.simplefilter("always", ResourceWarning)
        for _ in range(12):
            visitor, over = Visitor(inputs), threading.Event()
            came: list[socket.socket] = []
            crowd = [
                threading.Thread(target=come, args=(visitor.front.port, over, came))
                for _ in range(3)
            ]
            for one in crowd:
                one.start()
            time.sleep(0.05)
            visitor.front.close()
            over.set()
            for one in crowd:
                one.join()
            for one in came:
                one.close()
            del visitor
            gc.collect()
    assert not told


def test_an_answer_given_up_as_the_front_closes_ends_before_it_does__law(inputs) -> None:
    """Else Python tells in the terminal that a task was destroyed."""
    begun, ended = threading.Event(), threading.Event()

    async def draw(request: web.Request) -> web.StreamResponse:
        begun.set()
        try:
            await asyncio.sleep(60)
        finally:
            for _ in range(5):  # as many turns as what it holds takes to be let go of
                await asyncio.sleep(0)
            ended.set()
        return web.Response()

    visitor = Visitor(replace(inputs, routes=(web.get("/slow", draw),)))
    page = http.client.HTTPConnection("127.0.0.1", visitor.front.port)
    page.request("GET", "/slow", headers={"Cookie": visitor.cookie})
    assert begun.wait(timeout=10)
    visitor.front.close()
    page.close()
    assert ended.is_set()


def test_a_page_that_goes_away_while_it_speaks_is_no_error__law(inputs, caplog):
    """On a slow machine a traceback stood in the terminal."""
    begun, ended = threading.Event(), threading.Event()

    async def hear(request: web.Request) -> web.StreamResponse:
        begun.set()
        try:
            await request.text()
        finally:
            ended.set()
        return web.Response()

    with Visitor(replace(inputs, routes=(web.post("/told", hear),))) as visitor:
        page = http.client.HTTPConnection("127.0.0.1", visitor.front.port)
        page.putrequest("POST", "/told")
        for name, value in (("Cookie", visitor.cookie), ("Content-Length", "9")):
            page.putheader(name, value)
        page.endheaders(b"half")
        assert begun.wait(timeout=10)
        page.close()
        assert ended.wait(timeout=10)
    assert caplog.text == ""


def come(port: int, over: threading.Event, came: list[socket.socket]) -> None:
    """Knock again and again."""
    while not over.is_set():
        try:
            came.append(socket.create_connection(("127.0.0.1", port), timeout=0.2))
        except OSError:
            # Nobody opens: to hammer on a closed door would only slow who closes it.
            time.sleep(0.001)


class Answerer:
    async def serve(self, request: web.Request) -> web.StreamResponse:
        return web.Response(text="here")


def test_what_is_no_request_is_answered_and_fills_no_terminal__law(inputs, caplog):
    with (
        Visitor(inputs) as visitor,
        socket.create_connection(("127.0.0.1", visitor.front.port)) as line,
    ):
        line.sendall(b"GET / HTTP/1.1\r\nX-Long: " + b"a" * 200_000 + b"\r\n\r\n")
        assert b" 400 " in line.recv(1000)
    assert caplog.records == []


def test_a_front_that_is_closed_lets_go_of_what_answered__law(inputs):
    """Every desk that had been open stayed in memory, with the scans and tiles it had read."""
    answerer = Answerer()
    visitor = Visitor(replace(inputs, routes=(web.get("/here", answerer.serve),)))
    with visitor:
        assert visitor.get("/here")[1] == "here"
    gone = weakref.ref(answerer)
    del answerer, visitor
    gc.collect()
    assert gone() is None
