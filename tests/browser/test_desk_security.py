"""Who may come in and what may be asked for: every refusal is a test."""

import json
import urllib.error
import urllib.request
from dataclasses import replace

import pytest

from app.desk.wiring import open_desk
from sessions.session import Session
from tests.browser.hands import accept
from tests.ui.desk_block import desk_inputs, tiny_block

HOSTILE = '"><img src=x onerror=window.hurt=1>.tif'


class NoRedirect(urllib.request.HTTPRedirectHandler):
    def redirect_request(self, *_):
        return None


def asked(url: str, cookie: str = "", **headers: str) -> tuple[int, bytes, dict[str, str]]:
    """Status, body and headers of an answer, redirections not followed."""
    headers |= {"Cookie": cookie} if cookie else {}
    request = urllib.request.Request(url, headers=headers)
    try:
        with urllib.request.build_opener(NoRedirect).open(request) as answer:
            return answer.status, answer.read(), dict(answer.headers)
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read(), dict(error.headers)


def entered(url: str) -> tuple[str, str]:
    """Root of a desk and the cookie its address gives."""
    root = url.partition("/?")[0]
    status, _, headers = asked(url)
    assert status == 303
    return root, headers["Set-Cookie"].partition(";")[0]


@pytest.fixture
def rich(tmp_path):
    """A desk with results beside it, and something that is none of its business."""
    inputs = desk_inputs(tmp_path / "block")
    results = tmp_path / "block" / "results"
    (results / "report.html").write_text("<p>report</p>", encoding="utf-8")
    (results / "control_points.csv").write_text("point_id\n", encoding="utf-8")
    (tmp_path / "block" / "secret.csv").write_text("secret", encoding="utf-8")
    (results / "link.csv").symlink_to(tmp_path / "block" / "secret.csv")
    with open_desk(replace(inputs, results=results)) as opened:
        yield opened
    inputs.session.close()


@pytest.mark.parametrize("path", [
    "/", "/start", "/results/", "/results/report.html", "/pages/desk.js", "/desk/abcdefgh",
    "/tiles/ortho/0/0/0", "/tiles/raw/1938_01_014/1/0/0/0", "/scene/abcdefgh/",
    "/tiles/near/1938_01_014/1/0/0/96/1",
])  # fmt: skip
def test_without_a_token_nothing_is_served__law(rich, path):
    root = rich.url.partition("/?")[0]
    assert asked(root + path)[0] == 401
    assert asked(root + path, cookie="gruber_00000000=guess")[0] == 401


@pytest.mark.parametrize("path", ["/", "/start", "/results/", "/tiles/ortho/0/0/0"])
def test_other_origins_and_names_are_refused_with_the_token_too__law(rich, path):
    root, cookie = entered(rich.url)
    assert asked(root + path, cookie)[0] == 200
    assert asked(root + path, cookie, Origin="http://evil.example")[0] == 403
    assert asked(root + path, cookie, Origin="null")[0] == 403
    assert asked(root + path, cookie, Host="evil.example")[0] == 421


@pytest.mark.parametrize("path", [
    "/pages/../access.py", "/pages/..%2Faccess.py", "/pages/%2e%2e%2faccess.py",
    "/pages/..%5Caccess.py", "/pages/desk.js%00.html", "/results/..%2Fsecret.csv",
    "/results/../secret.csv", "/results/%2e%2e%2fsecret.csv", "/results/link.csv",
    "/results/..%2F..%2Fblock%2Fsecret.csv", "/results/.hidden", "/results/session.gpkg",
    "/tiles/raw/..%2F..%2Fsecret/1/0/0/0", "/tiles/scan/%2Fetc%2Fpasswd/1/0/0/0",
    "/tiles/raw/1938_01_014/999/0/0/0", "/tiles/ortho/99/0/0", "/tiles/ortho/0/9999999/0",
    "/tiles/point/1938_01_014/1/nan/0/1", "/tiles/point/1938_01_014/1/0/0/1e9",
    "/tiles/near/..%2Fsecret/1/0/0/96/1", "/tiles/near/1938_01_014/1/0/0/9999/1",
    "/tiles/near/1938_01_014/1/0/0/96/3", "/tiles/near/1938_01_014/1/99999999/0/96/1",
    "/scene/../start", "/desk/..%2F..%2Fstart",
])  # fmt: skip
def test_tricks_with_paths_find_nothing__law(rich, path):
    root, cookie = entered(rich.url)
    status, body, _ = asked(root + path, cookie)
    assert status in (400, 404, 426), (path, status)
    assert b"secret" not in body
    assert b"import" not in body


def test_results_are_served_with_a_policy_of_their_own__law(rich):
    root, cookie = entered(rich.url)
    listed = json.loads(asked(f"{root}/results/", cookie)[1])
    assert [name for name, _ in listed] == ["report.html", "control_points.csv"]
    _, body, headers = asked(f"{root}/results/report.html", cookie)
    assert body == b"<p>report</p>"
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert headers["X-Content-Type-Options"] == "nosniff"


def test_a_guest_sees_everything_and_decides_nothing__law(rich, sit_at):
    guest = sit_at(rich.guest_url, scene=False)
    before = guest.get_attribute(".row.current", "data-key")
    assert guest.evaluate("document.body.classList.contains('guest')")
    guest.keyboard.press("y")
    guest.wait_for_selector(".notice:has-text('Guests')")
    guest.keyboard.press("j")
    guest.wait_for_function("gruber.parts.queue.current !== gruber.parts.queue.shown[0]")
    assert guest.evaluate("gruber.parts.status.decided") == 0
    operator = sit_at(rich.url, scene=False)
    assert operator.get_attribute(".row.current", "data-key") == before
    assert not operator.evaluate("document.body.classList.contains('guest')")


def test_a_guests_token_is_not_the_operators__law(rich):
    _, guest = entered(rich.guest_url)
    _, operator = entered(rich.url)
    assert guest.partition("=")[0] == operator.partition("=")[0]
    assert guest.partition("=")[2] not in rich.url


def test_hostile_names_are_only_ever_text__law(tmp_path, sit_at):
    tiny = tiny_block()
    block = tiny.block
    name = next(iter(block.photos))
    photos = {HOSTILE if key == name else key: p for key, p in block.photos.items()}
    photos[HOSTILE] = replace(photos[HOSTILE], photo_id=HOSTILE)
    measured = [
        replace(m, photo_id=HOSTILE, reason="<b onclick=window.hurt=1>r</b>", status="dubious")
        if m.photo_id == name
        else m
        for m in block.measurements.values()
    ]
    ties = replace(
        block.ties, photo_ids=tuple(HOSTILE if n == name else n for n in block.ties.photo_ids)
    )
    hostile = replace(
        block,
        photos=dict(sorted(photos.items())),
        measurements={m.key: m for m in measured},
        ties=ties,
    )
    inputs = desk_inputs(tmp_path)
    inputs = replace(
        inputs,
        block=hostile,
        report=inputs.adjust(hostile, None),
        name="<script>window.hurt=1</script>",
    )
    with open_desk(inputs) as desk:
        page = sit_at(desk.url, scene=False)
        page.select_option("#sieve-photo", HOSTILE)
        page.click('.chip[data-state="dubious"]')
        page.click(".row >> nth=0")
        page.wait_for_function("name => gruber.parts.point?.key[1] === name", arg=HOSTILE)
        page.click('[data-act="quality"]')
        page.wait_for_selector("#quality p.verdict")
        page.keyboard.press("Escape")
        page.keyboard.press("g")
        page.wait_for_selector("#placement tr[data-photo]")
        page.keyboard.press("Escape")
        page.keyboard.press("i")
        page.wait_for_selector("#board .view-body p, #board .mark")
        page.wait_for_timeout(300)
        assert page.evaluate("window.hurt") is None
        assert page.locator("img[src='x']").count() == 0
        assert page.inner_text("#name") == "<script>window.hurt=1</script>"
    inputs.session.close()


def test_names_people_give_are_kept_short_and_plain__law(tmp_path, sit_at):
    inputs = desk_inputs(tmp_path)
    with open_desk(inputs) as desk:
        page = sit_at(desk.url, scene=False)
        page.click("#who")
        page.fill("#name-field", '  <img src=x onerror="window.hurt=1">  Berta ')
        page.click("#naming button")
        page.wait_for_function(
            "gruber.parts.status.operator.includes('Berta') || "
            "gruber.parts.status.operator.startsWith('<img')"
        )
        point = page.get_attribute(".row.current", "data-key").split("|")
        accept(page)
        page.wait_for_function("gruber.parts.status.decided === 1")
        assert page.evaluate("window.hurt") is None
        with Session.open(tmp_path, "reader") as session:
            recorded = session.decisions()[0]
        assert len(recorded.who) <= 40
        assert (recorded.decision.point_id, recorded.decision.photo_id) == tuple(point)
    inputs.session.close()
