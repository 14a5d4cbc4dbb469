"""The desk in a real Chromium: open, press a key, see the number change, reload and find it."""

import re
import threading
import urllib.error
import urllib.request

import pytest
from viser import _messages as viser_messages

from app.desk.wiring import open_desk
from sessions.decisions import Accept, Reject, SetRole, Withdraw
from sessions.session import Session
from tests.browser.conftest import PATIENCE_MS, SIZE, scene_of, toured
from tests.browser.hands import (
    accept,
    becomes,
    caught_up,
    current,
    gone_on,
    grow,
    look_at,
    press,
    sigma,
    state_of,
    unfold,
    until,
)
from tests.ui.desk_block import desk_inputs, tiny_block
from ui.review.compare import made_with
from ui.views import block_view as names
from ui.views.server import SECRET_HEADER
from ui.words.catalogue import words

REMADE = f".notice:has-text('{words()['notice.remade']}')"


PRESSED = """keys => keys.forEach(key => key.includes("|")
  ? document.querySelector(`.row[data-key="${key}"]`).click()
  : document.body.dispatchEvent(
    new KeyboardEvent("keydown", { key, view: window, bubbles: true })))"""
"""Rows clicked and keys pressed, all before the desk can answer the first."""


def test_keys_ahead_of_the_row_just_chosen_are_about_it__law(sit, tmp_path):
    page = sit(scene=False)
    first, *rows = page.evaluate("[...document.querySelectorAll('.row')].map(r => r.dataset.key)")
    one, two, three, four, *_, five = rows
    page.evaluate(PRESSED, [one, "n", "2"])
    page.wait_for_function("gruber.parts.status.decided === 1")
    caught_up(page)
    page.evaluate(PRESSED, [two, "ArrowRight", "j"])
    page.wait_for_function("key => gruber.parts.point.key.join('|') === key", arg=three)
    page.evaluate(PRESSED, [two, "Escape", four, "c"])
    page.wait_for_function("gruber.parts.status.decided === 2 && !gruber.parts.status.drafts")
    caught_up(page)
    page.evaluate(PRESSED, [five, "y", "m"])
    page.wait_for_selector(f".notice:has-text('{words()['notice.ahead']}')")
    page.wait_for_function("gruber.parts.status.decided === 3")
    caught_up(page)
    page.keyboard.press("4")
    page.wait_for_selector(f".notice:has-text('{words()['notice.no-reason']}')")
    with Session.open(tmp_path, "reader") as session:
        made = [item.decision for item in session.decisions()]
    assert made[:2] == [Reject(*one.split("|"), "other"), Withdraw(1)]
    assert made[2] == Reject(*one.split("|"), "changed")
    assert (made[3].point_id, type(made[3])) == (four.split("|")[0], SetRole)
    assert [(type(item), item.point_id) for item in made[4:]] == [(Accept, five.split("|")[0])]
    assert state_of(page, first) == "auto"


def test_everything_of_the_block_is_in_the_scene__truth(sit):
    page = sit()
    scene = scene_of(page)
    expected = [names.TERRAIN, names.FOOTPRINTS, names.VECTORS, names.CHECKS, names.CURRENT]
    expected += [names.photo_node(name) for name in tiny_block().block.photos]
    expected += [names.points_node(state) for state in ("auto", "unused")]
    for name in expected:
        scene.wait_for_function("name => !!window.__viserMutable.nodeRefFromName[name]", arg=name)
    panel = scene.locator("[data-floating-window]").first
    assert not panel.is_visible()


def test_the_pages_keep_their_own_policy_and_report_no_error__law(chromium, desk):
    context = chromium.new_context(viewport=SIZE, storage_state=toured(desk.url))
    page, heard = context.new_page(), []
    page.on("pageerror", lambda error: heard.append(str(error)))
    page.on("console", lambda said: heard.append(said.text) if said.type == "error" else None)
    page.goto(desk.url)
    page.wait_for_selector(".row.current", timeout=PATIENCE_MS)
    unfold(page)
    page.wait_for_selector(".other img", timeout=PATIENCE_MS)
    page.wait_for_timeout(1500)
    assert heard == []
    assert "token" not in page.url
    context.close()


def test_nothing_overlaps_and_nothing_needs_scrolling__law(sit):
    page = sit(scene=False)
    boxes = {
        name: page.locator(f"#{name}").bounding_box()
        for name in ("bar", "queue", "block", "compare", "status")
    }
    for name, box in boxes.items():
        assert box["x"] >= 0, name
        assert box["x"] + box["width"] <= 1600.5, name
        assert box["y"] + box["height"] <= 1000.5, name
        for other, there in boxes.items():
            apart = (
                box["x"] + box["width"] <= there["x"] + 0.5
                or there["x"] + there["width"] <= box["x"] + 0.5
                or box["y"] + box["height"] <= there["y"] + 0.5
                or there["y"] + there["height"] <= box["y"] + 0.5
            )
            assert apart or name == other, (name, other)
    # Rows of measurements far off are those that are read first.
    assert page.evaluate("gruber.parts.queue.shown.some(at => gruber.parts.rows[at][6] > 3)")
    tall = "[...document.querySelectorAll('.row > *')].filter(e => e.offsetHeight > 25).length"
    assert page.evaluate(tall) == 0
    grow(page, "block")
    header = page.locator("#layers").bounding_box()
    last = page.locator("#layers button").last.bounding_box()
    assert last["x"] + last["width"] <= header["x"] + header["width"] + 0.5


def test_y_n_u_change_state_and_sigma_nought__truth(sit):
    page = sit(scene=False)
    first_sigma = sigma(page)
    rejected, _, _ = press(page, "n")
    assert state_of(page, rejected) == "rejected"
    assert sigma(page) < first_sigma
    assert current(page) != rejected
    accepted = current(page)
    accept(page)
    becomes(page, accepted, "accepted")
    page.wait_for_selector("#working:not(.busy)", state="attached")
    page.keyboard.press("Control+z")
    becomes(page, accepted, "auto")
    page.wait_for_selector("#working:not(.busy)", state="attached")
    press(page, "u")
    assert state_of(page, rejected) == "auto"
    assert sigma(page) == pytest.approx(first_sigma, abs=2e-4)
    press(page, "Control+y")
    assert state_of(page, rejected) == "rejected"


def test_a_row_that_moved_in_the_list_is_the_one_that_is_clicked__law(sit):
    """A point that came in moves the numbers of all rows behind it, and changes none of them."""
    page = sit(scene=False)
    wanted = page.evaluate("""async () => {
      const { showQueue } = await import("/pages/queue.js");
      const { rows, order, queue } = gruber.parts;
      const moved = [["A new one", ...rows[0].slice(1)], ...rows];
      const told = { ...queue, current: queue.current + 1 };
      showQueue({ rows: moved, order: order.map(one => one + 1), queue: told });
      return document.querySelectorAll(".row")[1].dataset.key;
    }""")
    page.click(f'.row[data-key="{wanted}"]')
    page.wait_for_function(
        "key => gruber.parts.point?.key.join('|') === key", arg=wanted, timeout=PATIENCE_MS
    )


def test_a_row_clicked_while_a_name_is_typed_is_chosen__law(sit):
    page = sit(scene=False)
    page.click('.chip[data-state="all"]')
    caught_up(page)
    rows = page.evaluate("[...document.querySelectorAll('.row')].map(row => row.dataset.key)")
    first, key = rows[0], next(row for row in rows if row.split("|")[0] != rows[0].split("|")[0])
    point = key.split("|")[0]
    look_at(page, first)
    page.fill("#sieve-text", point)
    page.wait_for_function("name => gruber.parts.point.key[0] === name", arg=point)
    caught_up(page)
    page.evaluate(
        """key => {
          const field = document.getElementById("sieve-text");
          field.value = "";
          field.dispatchEvent(new Event("input"));
          document.querySelector(`.row[data-key="${key}"]`).click();
        }""",
        key,
    )
    page.wait_for_function("gruber.parts.queue.filter.text === ''")
    caught_up(page)
    assert page.evaluate("gruber.parts.queue.filter.text") == ""
    assert current(page) == key


def test_a_key_held_down_decides_once__law(sit):
    page = sit(scene=False)
    page.keyboard.down("n")
    for _ in range(4):
        page.keyboard.down("n")
    page.keyboard.up("n")
    page.wait_for_function("gruber.parts.status.decided >= 1")
    caught_up(page)
    assert page.evaluate("gruber.parts.status.decided") == 1


def test_a_digit_gives_the_reason_of_a_rejection__law(sit):
    page = sit(scene=False)
    point = current(page)
    page.keyboard.press("n")
    page.wait_for_selector("#reasons:not([hidden])")
    for width, height in ((1366, 768), (1600, 1000)):
        page.set_viewport_size({"width": width, "height": height})
        panes, asked = (page.locator(name).bounding_box() for name in ("#panes", "#asked"))
        assert asked["y"] >= panes["y"] + panes["height"] - 0.5
        assert page.evaluate("(p => p.scrollWidth - p.clientWidth)"
                             "(document.querySelector('#reasons p'))") <= 1  # fmt: skip
    page.keyboard.press("2")
    page.wait_for_selector("#reasons", state="hidden")
    look_at(page, point)
    page.wait_for_selector('#why .remark:has-text("changed")')
    assert page.evaluate("gruber.parts.status.decided") == 1


def test_keys_pressed_in_the_scene_are_the_desks__law(sit):
    page = sit()
    # A scene that is still being loaded gives the focus back.
    scene_of(page)
    room = page.locator("#scene").bounding_box()

    def is_in_it() -> bool:
        page.mouse.click(room["x"] + 12, room["y"] + 40)
        return page.evaluate("document.activeElement.id === 'scene'")

    until(page, is_in_it)
    point = current(page)
    page.keyboard.press("m")
    becomes(page, point, "dubious")


def test_a_click_on_a_frustum_shows_its_photo__truth(sit):
    page = sit()
    scene = scene_of(page)
    grow(page, "block")
    scene.wait_for_function(
        "innerWidth > 1000 && "
        "Math.abs(__viserMutable.camera.aspect - innerWidth / innerHeight) < 0.01"
    )
    place_of = """name => {
          const at = __viserMutable.nodeRefFromName[name].getWorldPosition(
            __viserMutable.camera.position.clone());
          at.project(__viserMutable.camera);
          return [(at.x + 1) / 2 * innerWidth, (1 - at.y) / 2 * innerHeight];
        }"""
    room = page.locator("#scene").bounding_box()

    def is_shown() -> bool:
        """Clicked once more while the camera still moves."""
        x, y = scene.evaluate(place_of, names.photo_node("1938_02_014"))
        page.mouse.click(room["x"] + x, room["y"] + y + 40)
        page.wait_for_timeout(300)
        return page.evaluate("gruber.parts.point.key[1] === '1938_02_014'")

    until(page, is_shown)


def test_a_reload_finds_everything_as_it_was__law(sit):
    page = sit(scene=False)
    page.select_option("#sort-column", "score")
    page.click('.chip[data-state="all"]')
    point, _, _ = press(page, "n")
    here, number = current(page), sigma(page)
    page.reload()
    page.wait_for_selector(".row.current")
    assert current(page) == here
    assert sigma(page) == number
    assert page.input_value("#sort-column") == "score"
    assert page.locator('.chip.on[data-state="all"]').count() == 1
    page.click('.chip[data-state="rejected"]')
    becomes(page, point, "rejected")


def test_another_browser_sees_the_decision_and_keeps_its_place__law(sit):
    anna, berta = sit(scene=False), sit(scene=False)
    first = current(berta)
    assert first != current(anna)
    berta.keyboard.press("j")
    gone_on(berta, first)
    there = current(berta)
    point, _, _ = press(anna, "n")
    becomes(berta, point, "rejected")
    berta.wait_for_function(
        "value => +document.getElementById('sigma').dataset.value === value", arg=sigma(anna)
    )
    assert current(berta) == there


def test_a_click_in_the_scan_drafts_the_point_there__truth(sit):
    page = sit(scene=False)
    point = current(page)
    pane = page.locator('.pane[data-pane="right"]')
    box = pane.bounding_box()
    size = pane.evaluate("pane => [pane.clientWidth, pane.clientHeight]")
    # A mouse points at whole pixels; where a pane begins depends on the fonts of the machine.
    aim = [round(box["x"] + size[0] / 2 + 24), round(box["y"] + size[1] / 2 - 16)]
    right, down = aim[0] - box["x"] - size[0] / 2, aim[1] - box["y"] - size[1] / 2
    view = page.evaluate("gruber.compareState().view")
    aimed = [view["east"] + right / view["scale"], view["north"] - down / view["scale"]]
    page.mouse.click(*aim)
    page.wait_for_function("gruber.parts.point.draft")
    measured = page.evaluate("gruber.parts.point.draft.place")
    scale = page.evaluate("gruber.compareState().view.scale")
    # Half a pixel of the screen.
    assert abs(measured[0] - aimed[0]) * scale < 0.6
    assert abs(measured[1] - aimed[1]) * scale < 0.6
    assert current(page) == point
    before = page.evaluate("gruber.parts.point.figures.place")
    page.keyboard.press("r")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Shift+ArrowDown")
    page.wait_for_function(
        "before => gruber.parts.point.figures.place[1] !== before[1]", arg=before
    )
    after = page.evaluate("gruber.parts.point.figures.place")
    assert after[0] - before[0] == pytest.approx(0.1, abs=0.11)
    assert after[1] - before[1] == pytest.approx(1.0, abs=0.11)
    assert page.evaluate("gruber.parts.status.decided") == 0


def click_beside(page, right=140, down=-100, **how):
    """Click in the scan beside its middle."""
    box = page.locator('.pane[data-pane="right"]').bounding_box()
    place = box["x"] + box["width"] / 2 + right, box["y"] + box["height"] / 2 + down
    page.mouse.click(*place, **how)


def test_yes_right_after_an_arrow_keeps_the_place_it_nudged_to__law(sit, tmp_path):
    page = sit(scene=False)
    page.evaluate(
        "() => ['ArrowRight', 'ArrowRight', 'y'].forEach(key => "
        "window.dispatchEvent(new KeyboardEvent('keydown', { key, view: window })))"
    )
    page.wait_for_function("gruber.parts.status.decided === 1 || gruber.parts.point.draft?.asking")
    caught_up(page)
    if page.evaluate("gruber.parts.point.draft"):
        page.keyboard.press("y")
        page.wait_for_function("gruber.parts.status.decided === 1")
    with Session.open(tmp_path, "reader") as session:
        assert [type(item.decision).__name__ for item in session.decisions()] == ["Place"]


def test_yes_right_after_a_filter_decides_nothing__law(sit):
    page = sit(scene=False)
    page.evaluate(
        "() => { document.querySelector('.chip[data-state=all]').click(); "
        "dispatchEvent(new KeyboardEvent('keydown', { key: 'y', view: window })); }"
    )
    page.wait_for_selector(".notice")
    caught_up(page)
    assert page.evaluate("gruber.parts.status.decided") == 0
    accept(page)
    page.wait_for_function("gruber.parts.status.decided === 1")


def test_a_click_on_the_mark_itself_corrects_it__law(sit):
    page = sit(scene=False)
    # A press that moves is no click, however little.
    box = page.locator('.pane[data-pane="right"]').bounding_box()
    page.mouse.move(box["x"] + 90, box["y"] + 90)
    page.mouse.down()
    page.mouse.move(box["x"] + 93, box["y"] + 90)
    page.mouse.up()
    caught_up(page)
    assert not page.evaluate("gruber.parts.point.draft")
    click_beside(page, right=140)
    page.wait_for_function("gruber.parts.point.draft")
    caught_up(page)
    before = page.evaluate("gruber.parts.point.draft.place")
    click_beside(page, right=144)
    page.wait_for_function("x => gruber.parts.point.draft.place[0] !== x", arg=before[0])
    after = page.evaluate("gruber.parts.point.draft.place")
    step = 4 / page.evaluate("gruber.compareState().view.scale")
    assert after[0] - before[0] == pytest.approx(step, rel=0.2)
    assert after[1] - before[1] == pytest.approx(0, abs=step / 4)


def test_a_draft_waits_is_asked_about_and_kept_or_dropped__law(sit, tmp_path):
    page = sit(scene=False)
    first = current(page)
    # A hand that holds the picture still and other buttons place nothing.
    click_beside(page, delay=1500)
    click_beside(page, button="middle")
    click_beside(page, button="right")
    caught_up(page)
    assert page.evaluate("gruber.parts.point.draft") is None
    click_beside(page)
    page.wait_for_selector("#asked.draft #keep")
    page.wait_for_function("gruber.parts.point.trial && gruber.parts.point.draft")
    assert page.text_content("#trial h3") == words()["trial.draft"]
    assert page.text_content('[data-figure="score"] span:last-child') == words()["peak.hand"]
    page.keyboard.press("Escape")
    page.wait_for_function("!gruber.parts.point.draft")
    # What is hidden is read out all the same.
    assert page.text_content("#keep") == ""
    click_beside(page)
    page.wait_for_function("gruber.parts.point.draft")
    page.keyboard.press("j")
    page.wait_for_selector(f'.row.draft[data-key="{first}"]')
    assert state_of(page, first) == "auto"
    page.keyboard.press("k")
    page.wait_for_function("gruber.parts.point.draft && gruber.parts.point.trial")
    caught_up(page)
    page.keyboard.press("y")
    page.wait_for_selector("#asked.against")
    said = page.inner_text("#keep p")
    assert re.fullmatch(r"[\d.]+ sigma, moves \S+ by [\d.]+ m\. Keep\?", said)
    assert (
        page.evaluate("(p => p.scrollWidth - p.clientWidth)(document.querySelector('#keep p'))")
        <= 1
    )
    with Session.open(tmp_path, "reader") as session:
        assert session.decisions() == ()
    caught_up(page)
    page.click("#keep button")
    page.wait_for_function("gruber.parts.status.decided === 1")
    assert state_of(page, first) == "accepted"
    assert page.evaluate("gruber.parts.status.drafts") == 0


def test_pictures_are_drawn_and_blink_exchanges_them__law(sit):
    page = sit(scene=False)
    page.wait_for_function(
        """() => { const c = document.querySelector('.pane[data-pane=right] .picture');
        const d = c.getContext('2d').getImageData(c.width / 2 - 20, c.height / 2 - 20, 40, 40).data;
        return new Set(d).size > 20; }"""
    )
    label = page.locator('.pane[data-pane="left"] .label')
    assert label.inner_text() == "Ortho"
    page.keyboard.down(" ")
    page.wait_for_selector('.pane[data-pane="left"] .label:has-text("Scan")')
    assert page.evaluate("gruber.compareState().blink")
    page.keyboard.up(" ")
    page.wait_for_selector('.pane[data-pane="left"] .label:text-is("Ortho")')
    assert not page.evaluate("gruber.compareState().blink")


def test_orthos_are_made_again_with_progress_while_deciding_goes_on__law(chromium, tmp_path, sit):
    made, decided = [], threading.Event()

    def slow(photo_ids, progress, report):
        progress.report(1, 40, photo_ids[0])
        made.append(decided.wait(PATIENCE_MS / 1000))

    inputs = desk_inputs(tmp_path / "other", remake=slow, made=made_with(tiny_block().block))
    with open_desk(inputs) as desk:
        page = sit(desk.url, scene=False)
        page.click("#remake-start")
        page.wait_for_selector("#making:not([hidden])")
        point, _, _ = press(page, "n")
        assert state_of(page, point) == "rejected"
        decided.set()
        page.wait_for_selector(REMADE)
        assert made == [True]
    inputs.session.close()


def fetched(url: str, **headers: str) -> int:
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers)) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        error.close()
        return error.code


def test_strangers_are_kept_out__law(desk):
    root = f"http://127.0.0.1:{desk.port}"
    token = desk.url.partition("token=")[2]
    assert fetched(f"{root}/") == 401
    assert fetched(f"{root}/tiles/ortho/0/0/0") == 401
    assert fetched(f"{root}/scene/abcdefgh/") == 401
    assert fetched(f"{root}/?token=wrong") == 401
    assert fetched(f"{root}/?token={token}", Origin="http://evil.example") == 403
    assert fetched(f"{root}/?token={token}", Host="evil.example") == 421
    inner = f"http://127.0.0.1:{desk.scene.port}/"
    assert fetched(inner) == 403
    assert fetched(inner, **{SECRET_HEADER: desk.scene.secret}) == 200


def test_sockets_of_strangers_are_refused__law(desk):
    upgrade = {
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    }
    root = f"http://127.0.0.1:{desk.port}"
    assert fetched(f"{root}/desk/abcdefgh", **upgrade) == 401
    assert fetched(f"{root}/scene/abcdefgh", **upgrade) == 401
    assert fetched(f"{root}/desk/abcdefgh", Origin="http://evil.example", **upgrade) == 403
    assert fetched(f"http://127.0.0.1:{desk.scene.port}/", **upgrade) == 403


def test_no_client_can_open_a_public_tunnel__law(desk):
    assert viser_messages.ShareUrlRequest not in desk.scene.infrastructure._incoming_handlers


def test_a_hand_ahead_of_the_picture_judges_nothing_twice__law(sit):
    page = sit(scene=False)
    first = current(page)
    # Both keys fall before the answer to the first can be there.
    page.evaluate(
        "() => ['m', 'y'].forEach(key => "
        "window.dispatchEvent(new KeyboardEvent('keydown', { key })))"
    )
    page.wait_for_selector(f".notice:has-text('{words()['notice.ahead']}')")
    page.wait_for_function("gruber.parts.status.decided === 1")
    caught_up(page)
    assert state_of(page, first) == "dubious"
    assert page.evaluate("gruber.parts.status.decided") == 1
    second = current(page)
    accept(page)
    page.wait_for_function("gruber.parts.status.decided === 2")
    assert state_of(page, second) == "accepted"
