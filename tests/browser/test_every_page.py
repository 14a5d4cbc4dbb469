"""Every page by keyboard alone, and by a monkey."""

import time
from collections import Counter

import pytest

from tests.browser.conftest import PATIENCE_MS, VIOLATIONS
from tests.browser.walk import Ear, files_of, open_rooms, walk_once

pytestmark = pytest.mark.browser
SEEDS = range(3)


@pytest.fixture(scope="module")
def rooms(tiny_run, tmp_path_factory):
    """Every page, open on copies of one block that was run."""
    with open_rooms(tiny_run.folder, tmp_path_factory.mktemp("rooms")) as opened:
        yield {room.kind.__name__: room for room in opened}


@pytest.fixture
def enter(sit_at):
    """Open one of the rooms."""

    def open_page(room, **how):
        if room.url.startswith("file:"):
            how["storage_state"] = None
        return sit_at(room.url, scene=False, ready=room.kind.ready, **how)

    return open_page


def test_random_walks_decide_nothing_unmeant_and_end_at_a_usable_page__law(chromium, rooms):
    with Ear() as ear:
        wrong = {seed: walk_once(chromium, [*rooms.values()], seed, 25, ear) for seed in SEEDS}
    assert {seed: steps for seed, steps in wrong.items() if steps} == {}


CONTROLS = """() => {
  const room = document.querySelector("dialog[open]") ?? document.body;
  const nameOf = e => e.id || Object.entries(e.dataset).filter(([, value]) => value.length < 40)
    .map(([name, value]) => `${name}=${value}`)[0] || e.textContent.trim().slice(0, 30);
  const every = [...room.querySelectorAll(
    "button, select, input, textarea, summary, iframe, a[href], [tabindex]")];
  window.controls = every.filter(e => e.tabIndex >= 0 && !e.disabled && e.id !== "scene"
    && e.checkVisibility({ visibilityProperty: true }));
  return window.controls.map(e => [e.tagName, e.type ?? "", nameOf(e)]);
}"""
"""Everything that a keyboard must reach: tag, type and name."""
FOCUSED = """() => {
  const { activeElement: e } = document;
  const { outlineStyle, outlineWidth } = getComputedStyle(e);
  return [window.controls.indexOf(e), outlineStyle !== "none" && outlineWidth !== "0px"];
}"""
AIM = """index => {
  const e = window.controls[index];
  window.presses = 0;
  // On the document: the control may be drawn anew before it is pressed.
  if (!window.counting) document.addEventListener("click", event => {
    window.presses += 1;
    if (event.target.closest("a")) event.preventDefault();
  }, true);
  window.counting = true;
  e.focus();
}"""


def unseen_or_unreached(page) -> list[str]:
    """Controls that Tab does not reach, or whose focus nobody sees."""
    controls = page.evaluate(CONTROLS)
    reached = set()
    page.evaluate("document.activeElement.blur()")
    for _ in range(len(controls) + 3):
        page.keyboard.press("Tab")
        index, seen = page.evaluate(FOCUSED)
        reached |= {index} if seen else set()
    return [name for index, (_, _, name) in enumerate(controls) if index not in reached]


def presses_of(tag: str, kind: str, key: str) -> int:
    """How often a key presses a control."""
    if tag in ("BUTTON", "SUMMARY"):
        return 1
    return int((tag, key) == ("A", "Enter") or (kind, key) == ("checkbox", " "))


DECIDING = {
    "act=accept": "Accept", "act=reject": "Reject", "act=dubious": "MarkDubious",
    "act=invisible": "MarkNotVisible", "act=role": "SetRole",
}  # fmt: skip
ON_BOARD = {"keep": "JudgeFiducial", "hide": "JudgeFiducial", "snap": "PlaceFiducial"}
AWAY = {"act=placing.run", "act=start.desk", "act=start.place", "act=start.save", "placing-start"}
"""Write settings, begin a run or leave the page: tests of the start page go that way."""
MANY = 2
"""Of controls of one name so many are pressed."""


def press_everything(page, again, written) -> list[str]:
    """Enter and Space on every control of a page; what did not do what it says, or wrote."""
    wrong, alike, before = [], Counter(), written()
    for control in map(tuple, page.evaluate(CONTROLS)):
        tag, kind, name = control
        alike[control] += 1
        if name in AWAY or name in DECIDING or alike[control] > MANY:
            continue
        for key in ("Enter", " "):
            there = [*map(tuple, page.evaluate(CONTROLS))]
            if control not in there:
                page.reload()
                again()
                there = [*map(tuple, page.evaluate(CONTROLS))]
            if control not in there:
                wrong.append(f"{control} is gone")
                break
            page.evaluate(AIM, there.index(control))
            page.keyboard.press(key)
            if (presses := page.evaluate("window.presses")) != presses_of(tag, kind, key):
                wrong.append(f"{key!r} on {control}: {presses} presses")
            if tag == "SELECT":
                page.keyboard.press("Escape")
            again()
            if written() != before:
                return [*wrong, f"{key!r} on {control} wrote"]
    return wrong


@pytest.mark.parametrize("kind", ["StartWalk", "PlacingWalk", "ReportWalk"])
def test_tab_reaches_every_control_of_the_other_pages__law(rooms, enter, kind):
    room = rooms[kind]
    page = enter(room)
    assert unseen_or_unreached(page) == []

    def again() -> None:
        page.wait_for_selector(room.kind.ready, state="attached")
        page.evaluate("document.querySelectorAll('dialog[open]').forEach(sheet => sheet.close())")

    assert press_everything(page, again, lambda: files_of(room.folder)) == []


def test_enter_on_a_button_that_decides_decides_that_and_nothing_else__law(rooms, enter):
    room = rooms["DeskWalk"]
    page, session = enter(room), room.session
    begun = len(session.decisions())

    def decided(name: str, button: str, after: int) -> None:
        page.wait_for_selector(f"{button}:not(:disabled)")
        page.focus(button)
        page.keyboard.press("Enter")
        wait_until(lambda: len(session.decisions()) > after)
        page.wait_for_timeout(50)
        made = session.decisions()[after:]
        assert [type(item.decision).__name__ for item in made] == [name], button

    for number, (button, name) in enumerate(DECIDING.items()):
        decided(name, f"#acts [data-{button}]", begun + number)
        page.wait_for_function("!gruber.parts.status.adjusting")
    page.keyboard.press("i")
    begun = len(session.decisions())
    for number, (button, name) in enumerate(ON_BOARD.items()):
        decided(name, f"#board [data-board={button}]", begun + number)
    for _ in range(len(DECIDING) + len(ON_BOARD)):
        known = len(session.decisions())
        page.keyboard.press("u")
        wait_until(lambda known=known: len(session.decisions()) > known)


@pytest.mark.parametrize("language", ["en-GB", "cs-CZ"])
def test_axe_finds_nothing_on_pages_with_content__oracle(rooms, enter, axe, language):
    """What only a block that was run has, in both themes."""
    found = {}

    def look(name: str, page) -> None:
        for theme in ("one", "other"):
            page.wait_for_timeout(100)
            found[name, theme] = page.evaluate(VIOLATIONS)
            page.evaluate("document.querySelector('[data-act=theme]')?.click()")

    for kind in ("PlacingWalk", "ReportWalk"):
        page = enter(rooms[kind], language=language)
        page.evaluate(axe)
        look(kind, page)
    page = enter(rooms["DeskWalk"], language=language)
    page.evaluate(axe)
    page.keyboard.press("i")
    page.wait_for_selector("#board[open] table.marks")
    look("board", page)
    page.click('#board [data-tab="film"]')
    look("film", page)
    page.keyboard.press("Escape")
    page.click("#results-open")
    page.wait_for_selector("#results[open]")
    look("results", page)
    assert {name: lines for name, lines in found.items() if lines} == {}


def wait_until(condition) -> None:
    begun = time.monotonic()
    while not condition():
        assert time.monotonic() - begun < PATIENCE_MS / 1000
        time.sleep(0.02)
