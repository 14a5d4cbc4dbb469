"""Where things lie on the desk: nothing cut off at any width, large pictures, one part for all."""

import io

import numpy as np
import pytest
from PIL import Image

from tests.browser.conftest import SIZE
from tests.browser.hands import becomes, caught_up, current, drawn, grow
from ui.words.catalogue import words

SIZES = ((1366, 768), (1440, 900), (1600, 1000), (1920, 1080), (2560, 1440), (3840, 2160))
CUT_OFF = """() => {
  const controls = "button, select, input, h2, h3, label, .item, .badge, .large, #facts li, "
    + "#name, #stale, #trial .figure, #asked p:not([hidden])";
  const wide = e => e.tagName === "SELECT" ? textOf(e) > e.clientWidth - 18
    : getComputedStyle(e).display !== "inline" && e.scrollWidth > e.clientWidth + 1;
  const pen = document.createElement("canvas").getContext("2d");
  function textOf(select) {
    pen.font = getComputedStyle(select).font;
    return pen.measureText(select.selectedOptions[0]?.textContent ?? "").width;
  }
  function clipped(e) {
    const box = e.getBoundingClientRect();
    for (let up = e.parentElement; up && up !== document.body; up = up.parentElement) {
      const { overflowX, overflowY } = getComputedStyle(up);
      if (overflowX === "visible" && overflowY === "visible") continue;
      if (overflowX === "auto" || overflowY === "auto" || overflowY === "scroll") return false;
      const room = up.getBoundingClientRect();
      if (box.left < room.left - 1 || box.right > room.right + 1 || box.top < room.top - 1
        || box.bottom > room.bottom + 1) return true;
    }
    return box.left < -0.5 || box.right > innerWidth + 0.5 || box.top < -0.5
      || box.bottom > innerHeight + 0.5;
  }
  return [...document.querySelectorAll("#desk *")].filter(e => e.matches(controls))
    .filter(e => e.checkVisibility({ visibilityProperty: true }))
    .filter(e => wide(e) || clipped(e)).map(e => e.outerHTML.slice(0, 160));
}"""
"""Controls and figures in sight that are wider than their place, or lie beyond their room."""
IN_SIGHT = """names => names.every(name => {
  const box = document.querySelector(name).getBoundingClientRect();
  return box.width > 0 && box.top >= 0 && box.left >= 0 && box.bottom <= innerHeight
    && box.right <= innerWidth;
})"""
SCROLLED = """[...document.querySelectorAll("body, body *")]
  .filter(e => e.id !== "table" && (e.scrollTop > 0 || e.scrollLeft > 0)).map(e => e.id)"""
LONG = """([said, some, write]) => {
  for (const id of ["points-open", "results-open"]) document.getElementById(id).hidden = false;
  document.getElementById("remake-start").textContent = write;
  document.getElementById("name").textContent = "synthetic-1938-seed1";
  document.getElementById("stale").textContent = said;
  document.getElementById("stale").classList.toggle("some", some);
}"""
DECIDES = ["#panes", "#off", "#why", "#trial", "#asked", "#acts"]


@pytest.mark.parametrize("language", ["en", "cs"])
def test_nothing_is_cut_off_at_any_width__law(sit, language):
    page = sit(scene=False, language=language, size={"width": 1366, "height": 768})
    assert page.evaluate("document.documentElement.lang") == language
    assert page.text_content("#queue h2") == words(language)["queue"]
    wait = words(language)["trial.wait"]
    page.wait_for_function(
        "w => !document.querySelector('#trial .figure').textContent.includes(w)", arg=wait
    )
    page.keyboard.press("t")  # Its slider needs room as well.
    page.wait_for_selector("#rate")
    # As long as they usually become: a block's name, and that results are stale.
    said = words(language)
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        page.evaluate(LONG, [said["remake.fresh"], False, said["remake"]])
        assert page.evaluate(CUT_OFF) == [], (width, "current")
        page.evaluate(LONG, [said["remake.unwritten"], True, said["remake.write"]])
        for mode in ("side", "swipe", "blend"):
            page.click(f'[data-mode="{mode}"]')
            drawn(page)
            assert page.evaluate(CUT_OFF) == [], (width, mode)
            assert page.locator("#tools").bounding_box()["height"] < 50, (width, mode)
        page.keyboard.press(".")
        drawn(page)
        assert page.evaluate(CUT_OFF) == [], (width, "details")
        page.keyboard.press(".")
        for part in ("queue", "block", "compare"):
            grow(page, part)
            drawn(page)
            assert page.evaluate(CUT_OFF) == [], (width, part)
            page.keyboard.press("x")


BUSY = """() => {
  const say = (id, name, values) => {
    document.getElementById(id).textContent = window.words[name].replace(
      /\\{(\\w+)\\}/g, (_, key) => values[key] ?? "");
  };
  say("mp", "status.mp.short", { count: 12 });
  document.getElementById("mp").append(" 0.352 \u2192 0.347 m");
  document.getElementById("drafts").hidden = false;
  say("drafts", "status.drafts", { count: 12 });
  say("working", "status.diverged", {});
  say("saved", "status.saved", { count: 1234 });
  document.getElementById("wire").lastChild.textContent = window.words["status.connected"];
}"""
"""The status line at its longest."""


@pytest.mark.parametrize("language", ["en", "cs"])
def test_the_status_line_has_room_for_all_that_it_may_say__law(sit, language):
    page = sit(scene=False, language=language, size={"width": 1366, "height": 768})
    page.evaluate("words => { window.words = words; }", words(language))
    page.evaluate(BUSY)
    assert page.evaluate(CUT_OFF) == []


def test_the_ring_about_the_queue_that_has_the_focus_is_whole__law(sit):
    page = sit(scene=False)
    page.focus("#table")
    page.keyboard.press("ArrowDown")
    caught_up(page)
    box = page.locator("#table").bounding_box()
    picture = page.screenshot(clip={**box, "width": 1})
    with Image.open(io.BytesIO(picture)) as image:
        side = np.asarray(image.convert("RGB"))[2:-2, 0]
    assert np.ptp(side.astype(int), axis=0).max() < 10


def test_the_sheet_of_keys_begins_at_its_beginning__law(sit):
    page = sit(scene=False, size={"width": 1366, "height": 768})
    page.keyboard.press("h")
    page.wait_for_selector("#help[open]")
    assert page.evaluate("document.getElementById('help').scrollTop") == 0
    said = page.inner_text("#help")
    for sheet in ("mosaic", "checks", "board", "mask"):
        assert words("en")[f"{sheet}.hint"] in said


def test_pictures_have_more_than_half_of_the_window__law(sit):
    page = sit(scene=False)
    for width, height in SIZES[:3]:
        page.set_viewport_size({"width": width, "height": height})
        if page.locator("#details").is_visible():
            page.keyboard.press(".")
        room = page.locator("#panes").bounding_box()
        assert room["width"] * room["height"] > width * height / 2 * 0.94
        both = page.locator("#compare").bounding_box()
        assert both["width"] * both["height"] > 0.6 * width * height


def test_details_leave_the_pictures_and_the_decision_in_sight__law(sit):
    page = sit(scene=False, size={"width": 1366, "height": 768})
    page.wait_for_function("gruber.compareState().drawn.whole")
    if not page.locator("#details").is_visible():
        page.keyboard.press(".")
    assert page.locator("#panes").bounding_box()["height"] > 0.4 * 768
    assert page.evaluate(IN_SIGHT, [*DECIDES, "#details"])


def test_three_lines_of_an_effect_lie_in_their_bar__law(sit):
    """The third one lay under the question below."""
    page = sit(scene=False, size={"width": 1366, "height": 768})
    page.wait_for_function("gruber.parts.point.trial")
    over = page.evaluate("""() => {
      const trial = document.getElementById("trial"), line = trial.querySelector(".figure");
      while (trial.querySelectorAll(".figure").length < 3) trial.append(line.cloneNode(true));
      return [...trial.children].map(one => one.getBoundingClientRect().bottom)
        .map(bottom => bottom - document.getElementById("facts").getBoundingClientRect().bottom);
    }""")
    assert len(over) == 4
    assert max(over) <= 0


@pytest.mark.parametrize("language", ["en", "cs"])
def test_chips_of_the_queue_stand_in_columns__law(sit, language):
    page = sit(scene=False, language=language)
    for width in (1366, 2560):
        page.set_viewport_size({"width": width, "height": 1000})
        boxes = [chip.bounding_box() for chip in page.locator(".chip:visible").all()]
        assert np.ptp([box["width"] for box in boxes]) < 0.5
        assert page.evaluate(CUT_OFF) == []


def test_the_line_of_the_swipe_lies_beside_the_point__law(sit):
    page = sit(scene=False)
    page.wait_for_function("gruber.compareState().drawn.whole")
    page.click('[data-mode="swipe"]')
    room = page.locator("[data-pane=left]").bounding_box()
    assert page.locator("#swipe").bounding_box()["width"] > 70
    page.mouse.move(room["x"] + room["width"] / 2, room["y"] + room["height"] / 2)
    assert page.locator(".pane.wipes").count() == 0


def test_twenty_points_are_judged_and_nothing_is_scrolled__law(sit):
    """All that decides is in sight at 1366 by 768, from the first point to the twentieth."""
    page = sit(scene=False)
    page.set_viewport_size({"width": 1366, "height": 768})
    for number in range(20):
        point = current(page)
        page.wait_for_function("gruber.compareState().drawn.whole")
        page.wait_for_function("gruber.parts.point.trial || gruber.parts.point.role === 'check'")
        assert page.evaluate(IN_SIGHT, DECIDES)
        assert page.evaluate(CUT_OFF) == []
        assert page.text_content("#off").strip()
        assert page.locator("#why li").count() > 0
        # An operator who sees what stands beside "sigma" rejects what is far off.
        far = page.evaluate("gruber.parts.point.figures.ratio > 3")
        caught_up(page)
        page.keyboard.press("n" if far else "y")
        becomes(page, point, "rejected" if far else "accepted")
        page.wait_for_function("n => gruber.parts.status.decided === n", arg=number + 1)
        assert page.evaluate(SCROLLED) == []
    assert page.evaluate("gruber.parts.status.decided") == 20


def test_x_gives_a_part_the_window_and_brings_all_back__law(sit):
    page = sit()
    before = {part: page.locator(f"#{part}").bounding_box() for part in ("queue", "block")}
    for part in ("queue", "block", "panes"):
        box = page.locator(f"#{part}").bounding_box()
        page.mouse.move(box["x"] + 30, box["y"] + 14)
        page.keyboard.press("x")
        named = "compare" if part == "panes" else part
        page.wait_for_selector(f'#desk[data-grown="{named}"]')
        assert page.locator(f"#{named}").bounding_box()["width"] == SIZE["width"]
        assert page.get_attribute(f'[data-grow="{named}"]', "aria-pressed") == "true"
        page.keyboard.press("x")
        page.wait_for_selector("#desk:not([data-grown])")
    for part, box in before.items():
        assert page.locator(f"#{part}").bounding_box() == box
    assert page.evaluate(
        "!!document.getElementById('scene').contentWindow"
        ".__viserMutable.nodeRefFromName['/terrain']"
    )
    assert "X" in [key for key, _ in page.evaluate("fetch('/start').then(a => a.json())")["keys"]]


@pytest.mark.parametrize("side", ["left", "low"])
def test_splitters_fit_every_window_and_go_back_by_a_double_click__law(sit, side):
    page = sit(scene=False)
    usual = page.locator("#block").bounding_box()
    box = page.locator(f".split[data-side={side}]").bounding_box()
    page.mouse.move(box["x"] + 2, box["y"] + 2)
    page.mouse.down()
    page.mouse.move(box["x"] + 900, box["y"] - 900, steps=4)
    page.mouse.up()
    larger = page.locator("#block").bounding_box()
    assert larger["width"] * larger["height"] > 1.3 * usual["width"] * usual["height"]
    page.set_viewport_size({"width": 1366, "height": 768})
    page.reload()
    page.wait_for_selector(".row.current")
    assert page.evaluate(CUT_OFF) == []
    box = page.locator("#compare").bounding_box()
    assert box["x"] + box["width"] <= 1366.5
    page.set_viewport_size(SIZE)
    page.locator(f".split[data-side={side}]").dblclick()
    assert page.locator("#block").bounding_box() == usual
    # What was dragged does not keep the keys.
    assert page.evaluate("document.activeElement === document.body")


@pytest.mark.parametrize(
    ("side", "key", "back"),
    [("left", "ArrowRight", "ArrowLeft"), ("low", "ArrowUp", "ArrowDown")],
)
def test_splitters_move_by_keys_and_tell_where_they_are__law(sit, side, key, back):
    page = sit(scene=False)
    usual, before = page.locator("#block").bounding_box(), page.evaluate("gruber.parts.point.key")
    split = page.get_by_role("separator", name=words()[f"split.{side}"])

    def now():
        return int(split.get_attribute("aria-valuenow"))

    told = now()
    split.focus()
    for _ in range(3):
        page.keyboard.press(key)
    # Two hundredths of the window each time, rounded to whole ones.
    assert now() - told in (5, 6, 7)
    moved = page.locator("#block").bounding_box()
    side_px = "width" if side == "left" else "height"
    assert moved[side_px] - usual[side_px] == pytest.approx(0.06 * SIZE[side_px], abs=1)
    assert page.evaluate("gruber.parts.point.key") == before
    assert page.evaluate("gruber.parts.status.drafts") == 0
    for _ in range(40):
        page.keyboard.press(key)
    # Where the window lets it go no further, the first press back moves it.
    limit = now()
    assert told < limit <= int(split.get_attribute("aria-valuemax"))
    page.keyboard.press(back)
    assert now() == pytest.approx(limit - 2, abs=1)
    page.keyboard.press("Home")
    assert page.locator("#block").bounding_box() == usual
    assert now() == told


def test_the_theme_of_the_system_is_followed_while_the_page_is_open__law(sit):
    page = sit(scene=False)
    theme = "document.documentElement.dataset.theme"
    # Until one is chosen.
    assert page.evaluate(theme) == "dark"
    page.emulate_media(color_scheme="light")
    page.wait_for_function(f"{theme} === 'light'")
    page.reload()
    page.wait_for_selector(".row.current")
    assert page.evaluate(theme) == "light"
    page.emulate_media(color_scheme="dark")
    page.wait_for_function(f"{theme} === 'dark'")
    # A theme that was chosen stays whatever the system has.
    page.click('[data-act="theme"]')
    page.emulate_media(color_scheme="no-preference")
    page.emulate_media(color_scheme="dark")
    assert page.evaluate(theme) == "light"


def test_the_language_is_changed_at_the_desk_and_kept__law(sit):
    page = sit(scene=False)
    for language in ("cs", "en"):
        page.click("#language")
        page.wait_for_function(f"document.documentElement.lang === '{language}'")
        page.wait_for_selector(".row.current")
        assert page.text_content("#queue h2") == words(language)["queue"]
    page.click("#language")
    page.wait_for_function("document.documentElement.lang === 'cs'")
    page.reload()
    page.wait_for_selector(".row.current")
    assert page.text_content("#queue h2") == words("cs")["queue"]


OVER = """() => {
  const room = document.querySelector("#scene-room").getBoundingClientRect();
  const parts = ["#scene-legend", "#north", "#vectors", "#relief-room", "#scene-buttons"]
    .map(name => document.querySelector(name)).filter(e => e.checkVisibility())
    .map(e => [e.id, e.getBoundingClientRect()]);
  const apart = (a, b) => a.right <= b.left || b.right <= a.left || a.bottom <= b.top
    || b.bottom <= a.top;
  return parts.flatMap(([name, box], i) => [
    ...(box.bottom > room.bottom || box.top < room.top ? [`${name} leaves the room`] : []),
    ...parts.slice(0, i).filter(([, other]) => !apart(box, other))
      .map(([other]) => `${name} over ${other}`)]);
}"""


def test_lines_drawn_into_the_corner_lay_nothing_over_another__law(sit):
    page = sit(scene=False)
    for low in (12, 20, 70):
        page.evaluate(
            f"localStorage.setItem('gruber.share.low', {low});"
            "localStorage.setItem('gruber.share.left', 60)"
        )
        page.reload()
        page.wait_for_selector(".row.current")
        page.wait_for_function("gruber.parts.scene")
        assert page.evaluate(OVER) == []
        assert page.locator("#tools").bounding_box()["height"] < 40


ASKEW = """() => {
  const side = cell => getComputedStyle(cell).textAlign;
  return [...document.querySelectorAll("#quality table")].flatMap(({ rows: [head, first] }) =>
    [...head.cells].filter((cell, column) => first && side(cell) !== side(first.cells[column]))
      .map(cell => cell.textContent));
}"""


def test_heads_of_block_quality_stand_as_the_cells_below_them__law(sit):
    page = sit(scene=False)
    page.keyboard.press("b")
    page.wait_for_selector("#quality[open] table")
    assert page.evaluate(ASKEW) == []
