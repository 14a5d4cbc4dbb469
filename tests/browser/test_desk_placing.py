"""How exactly a click or an arrow places a point, and what the screen shows meanwhile."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from app.desk.measuring import Measured
from app.desk.wiring import open_desk
from sessions.decisions import Place
from sessions.session import Session
from tests.browser.hands import accept, caught_up, current, gone_on, wire_cut
from tests.ui.desk_block import desk_inputs
from ui.review.state import Draft, Notice

STEP, OFFSET, ZOOM = 16, np.array([0.37, 0.61]), 8.0
CENTROID = """([x, y]) => {
  const canvas = document.querySelector('.pane[data-pane=right] .picture');
  const ratio = window.devicePixelRatio, half = Math.round(40 * ratio);
  const [left, top] = [Math.round(x * ratio) - half, Math.round(y * ratio) - half];
  const { data } = canvas.getContext('2d').getImageData(left, top, 2 * half, 2 * half);
  let [sum, across, down] = [0, 0, 0];
  for (let j = 0; j < 2 * half; j += 1) for (let i = 0; i < 2 * half; i += 1) {
    const weight = Math.max(data[4 * (j * 2 * half + i)] - 90, 0);
    sum += weight; across += weight * (i + 0.5); down += weight * (j + 0.5);
  }
  return [(left + across / sum) / ratio, (top + down / sum) / ratio];
}"""

SCALE = """() => { const s = gruber.compareState(); const [[a, b], [c, d]] = s.point.raw.matrix;
  return s.view.scale / Math.sqrt(Math.abs(a * d - b * c)); }"""
PLACE = "gruber.compareState().drawn.measured"
WATCH = f"""() => {{
  window.seen = [];
  const look = () => {{
    seen.push({PLACE});
    requestAnimationFrame(look);
  }};
  look();
}}"""
"""Note where the mark is drawn, frame by frame."""
DRAFTED = "gruber.parts.point.draft"
MIDDLE = """() => {
  const { point: { raw, marks }, view } = gruber.compareState();
  const [[a, b], [c, d]] = raw.matrix;
  const [e, n] = [view.east - marks.predicted[0], view.north - marks.predicted[1]];
  return [raw.predicted[0] + a * e + b * n, raw.predicted[1] + c * e + d * n];
}"""


def dotted(scan, column, row, columns, rows, reduction):
    """A scan of round dots, every sixteen pixels, beside the middle of a pixel."""
    across = column + (np.arange(columns // reduction) + 0.5) * reduction
    down = row + (np.arange(rows // reduction) + 0.5) * reduction
    beside, below = (
        (values - offset + STEP / 2) % STEP - STEP / 2
        for values, offset in zip((across, down), OFFSET, strict=True)
    )
    squares = below[:, None] ** 2 + beside[None, :] ** 2
    return (20 + 230 * np.exp(-squares / 8)).astype(np.float32)


def test_clicks_on_dots_place_within_a_tenth_of_a_pixel__truth(tmp_path, sit_at, monkeypatch):
    inputs = replace(desk_inputs(tmp_path), read_scan=dotted)
    errors = []
    with open_desk(inputs) as desk:
        monkeypatch.setattr(desk.loop, "_adjust", lambda: None)
        page = sit_at(desk.url, scene=False)
        page.keyboard.press("r")
        for _ in range(12):
            if page.evaluate(SCALE) > ZOOM:
                break
            page.keyboard.press("+")
        for _ in range(6):
            errors.append(placed_error(page))
            before = current(page)
            accept(page)
            gone_on(page, before)
        settled_count = page.evaluate("gruber.parts.status.decided")
    with Session.open(tmp_path, "reader") as session:
        assert len(session.decisions()) == settled_count == len(errors)
    inputs.session.close()
    assert max(errors) < 0.1, errors


def placed_error(page) -> float:
    """Click the dot nearest to the middle; pixels between what is recorded and the dot."""
    page.wait_for_function(
        "() => { const { drawn, point } = gruber.compareState();"
        " return drawn.whole && drawn.key === point.key.join('|'); }"
    )
    pane = page.locator('.pane[data-pane="right"]')
    box = pane.bounding_box()
    size = pane.evaluate("pane => [pane.clientWidth, pane.clientHeight]")
    scale, middle = page.evaluate(SCALE), np.array(page.evaluate(MIDDLE))
    dot = np.rint((middle + 4 - OFFSET) / STEP) * STEP + OFFSET
    near = (dot - middle) * scale + np.array(size) / 2
    page.mouse.move(box["x"] + 5, box["y"] + 5)
    seen = np.array(page.evaluate(CENTROID, near.tolist()))
    page.mouse.click(*np.rint(seen + np.array([box["x"], box["y"]])))
    page.wait_for_function("gruber.parts.point.draft")
    settled_place = page.evaluate("gruber.parts.point.draft.raw")
    return float(np.hypot(*(np.array(settled_place) - dot)))


def test_a_mark_nudged_where_no_draft_comes_of_it_goes_back__law(sit, desk):
    """It stayed until another point was shown, and a verdict was about the old place."""
    for url, lost in ((desk.guest_url, nullcontext), (desk.url, wire_cut)):
        page = sit(url, scene=False)
        page.wait_for_function("gruber.compareState().drawn.whole")
        before = page.evaluate(PLACE)
        page.evaluate(WATCH)
        with lost(page):
            page.keyboard.press("Shift+ArrowRight")
            page.wait_for_function("before => seen.some(place => place !== before)", arg=before)
            page.wait_for_selector(".notice")
            page.wait_for_function(f"before => {PLACE} === before", arg=before)
        assert not page.evaluate(DRAFTED)


def test_what_is_only_in_use_or_not_is_not_moved__law(sit):
    """A nudge looked as if it moved a photo's middle, and a quick `Y` took the photo into use."""
    page = sit(scene=False)
    page.wait_for_function("gruber.compareState().drawn.whole")
    page.wait_for_function("!gruber.parts.status.adjusting")
    caught_up(page)
    before = page.evaluate(PLACE)
    # What is told of the point meanwhile is of one that is placed: each look says otherwise.
    page.evaluate("""setInterval(() => { gruber.compareState().point.fixed = true; }, 5)""")
    page.wait_for_function("gruber.compareState().point.fixed")
    page.keyboard.press("Shift+ArrowRight")
    page.wait_for_selector(".notice:has-text('Only yes and no')")
    assert page.evaluate(PLACE) == before
    box = page.locator('.pane[data-pane="right"]').bounding_box()
    page.mouse.click(box["x"] + 90, box["y"] + 90)
    assert page.evaluate(PLACE) == before
    assert not page.evaluate(DRAFTED)


def test_a_mark_follows_the_hand_and_never_leaps_back__law(sit):
    page = sit(scene=False)
    page.wait_for_function("gruber.compareState().drawn.whole")
    page.evaluate(WATCH)
    for pause in (0, 0, 380, 20, 400, 30, 60, 0):
        page.keyboard.press("Shift+ArrowRight")
        page.wait_for_timeout(pause)
    page.wait_for_timeout(500)
    caught_up(page)
    page.wait_for_function("!gruber.parts.status.adjusting")
    east = np.array(page.evaluate("seen.map(place => Number(place.split(',')[0]))"))
    steps = (east - east[0]) / page.evaluate("gruber.parts.point.scan.pixel")
    assert steps[-1] == pytest.approx(8, abs=0.01)
    assert np.diff(steps).min() > -0.01


def test_a_nudge_stays_in_its_frame_whatever_is_shown_next__law(sit):
    """Ground coordinates were sent as pixels of the scan."""
    page = sit(scene=False)
    page.locator('.row[data-key*="|1938_02"]').first.click()
    page.wait_for_function("gruber.parts.point.key[1].startsWith('1938_02')")
    caught_up(page)
    raw, place = page.evaluate(
        "(({ raw, marks }) => [raw.measured, marks.measured])(gruber.parts.point)"
    )
    for key in ("Shift+ArrowRight", "r", "Shift+ArrowDown"):
        page.keyboard.press(key)
    # Two drafts may come of it, the second with both.
    page.wait_for_function(
        f"was => {DRAFTED}?.raw.every((now, axis) => Math.abs(now - was[axis]) > 0.5)", arg=raw
    )
    caught_up(page)
    # On the way back the photo was flown upside down.
    moved = np.subtract(page.evaluate(f"{DRAFTED}.raw"), raw)
    assert moved == pytest.approx([-1, 1], abs=0.1)
    page.keyboard.press("Escape")
    page.wait_for_function(f"!{DRAFTED}")
    # Beside each other with the ortho the scan lies as the ground does.
    page.click('[data-mode="blend"]')
    page.keyboard.press("Shift+ArrowRight")
    page.wait_for_function(DRAFTED)
    moved = np.subtract(page.evaluate(f"{DRAFTED}.place"), place)
    assert moved == pytest.approx([page.evaluate("gruber.parts.point.scan.pixel"), 0], abs=0.01)


def test_notices_of_a_draft_follow_one_another_and_go_with_it__law(sit, desk):
    """Two equal ones stood there, and lay over the next point once the draft was kept."""
    page = sit(scene=False)
    point, photo = key = tuple(current(page).split("|"))
    seat = page.evaluate("sessionStorage.getItem('gruber.seat')")
    column, row = page.evaluate("gruber.parts.point.raw.measured")
    since = None
    for distance in ("0.10", "0.00"):
        values = {"distance": distance, "column": distance, "row": "+0.00"}
        place = Place(point, photo, column + 0.1, row)
        told = Notice("notice.refined", values, draft=key)
        desk.loop.submit(Measured(seat, place, told, since))
        page.wait_for_selector(f".notice:has-text('{distance}')")
        since = Draft(key, place)
    page.wait_for_function(DRAFTED)
    assert page.locator(".notice").count() == 1
    accept(page)
    gone_on(page, f"{point}|{photo}")
    assert page.locator(".notice").all_inner_texts() == []


def test_what_a_draft_leaves_out_is_said_once__law(sit):
    page = sit(scene=False)
    page.keyboard.press("Shift+ArrowRight")
    page.wait_for_function(f"{DRAFTED} && gruber.parts.point.trial")
    said = page.evaluate("""async () => {
      const { showPoint } = await import("/pages/point.js");
      const { askAbout } = await import("/pages/asked.js");
      const { point } = gruber.parts;
      const told = { ...point, trial: { ...point.trial, out: [["J102", "1938_01_015"]] } };
      showPoint(told);
      askAbout(told);
      return document.body.innerText;
    }""")
    assert said.count("leaves out") == 1
