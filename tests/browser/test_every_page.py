"""Every page by keyboard alone, and by a monkey."""

import re

import pytest

from tests.browser.conftest import VIOLATIONS
from tests.browser.hands import caught_up, until
from tests.browser.monkey import files_of
from tests.browser.walk import Ear, Machines, open_rooms, walk_once

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
        machines = Machines(chromium)
        wrong = {seed: walk_once(machines, [*rooms.values()], seed, 25, ear) for seed in SEEDS}
    assert not any(wrong.values()), "\n".join(line for steps in wrong.values() for line in steps)


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
REMEMBER = """() => {
  document.activeElement.blur();
  window.lookOf = e => {
    const { outlineStyle, outlineWidth, boxShadow } = getComputedStyle(e);
    return JSON.stringify([outlineStyle, outlineWidth, boxShadow]);
  };
  window.before = window.controls.map(window.lookOf);
}"""
FOCUSED = """() => {
  const { activeElement: e } = document;
  const index = window.controls.indexOf(e);
  const { left, top, right, bottom } = e.getBoundingClientRect();
  const inSight = right > 0 && bottom > 0 && left < innerWidth && top < innerHeight;
  return [index, index >= 0 && inSight && window.lookOf(e) !== window.before[index]];
}"""
"""Which control has the focus, and whether an eye can tell: it looks otherwise than without."""
AIM = """control => {
  // On the document: the control may be drawn anew before it is pressed.
  if (!window.counting) {
    document.addEventListener("click", event => {
      window.presses += Number(event.isTrusted);
      if (event.target.closest("a")) event.preventDefault();
    }, true);
    document.addEventListener("change", () => { window.changes += 1; }, true);
  }
  const index = CONTROLS().findIndex(one => JSON.stringify(one) === JSON.stringify(control));
  const e = window.controls[index];
  Object.assign(window, { counting: true, presses: 0, changes: 0, options: e?.options?.length });
  document.activeElement.blur();
  e?.focus();
  return Boolean(e);
}""".replace("CONTROLS", f"({CONTROLS})")
"""Give the first control of these words the focus; false when there is none."""


def unseen_or_unreached(page) -> list[str]:
    """Controls that Tab does not reach, or whose focus nobody sees."""
    controls = page.evaluate(CONTROLS)
    reached = set()
    page.evaluate(REMEMBER)
    keyboard = getattr(page, "page", page).keyboard
    for _ in range(len(controls) + 5):
        keyboard.press("Tab")
        index, seen = page.evaluate(FOCUSED)
        reached |= {index} if seen else set()
        if len(reached) == len(controls):
            break
    if page.evaluate("window.controls.some(e => !e.isConnected)"):
        return unseen_or_unreached(page)  # Drawn anew meanwhile, with what the server sent.
    return [name for index, (_, _, name) in enumerate(controls) if index not in reached]


OPEN = "window.gruber?.parts.queue && (document.querySelector('dialog[open]')?.id ?? '')"
CLOSE = """() => {
  document.querySelectorAll("dialog[open]").forEach(sheet => sheet.close());
  document.activeElement.blur();
}"""
LIST = "[window.options, window.changes, document.activeElement.tagName]"


def wrong_with_list(page) -> list[str]:
    """What goes wrong with the list that has the focus: all keys are its own, arrows choose."""
    for key in ("ArrowDown", "ArrowUp", "y", "n"):
        page.keyboard.press(key)
    options, changes, tag = page.evaluate(LIST)
    if tag != "SELECT":
        return ["loses the focus, and keys decide"]
    return [] if changes or options < 2 else ["is not moved by arrows"]


def presses_of(tag: str, kind: str, key: str) -> set[int]:
    """How often a key may press a control; in a form Enter presses its button."""
    if tag in ("BUTTON", "SUMMARY") or kind == "file":
        return {1}
    if kind in ("text", "number") and key == "Enter":
        return {0, 1}
    return {int((tag, key) == ("A", "Enter") or (kind, key) == ("checkbox", " "))}


DECIDING = {
    "act=accept": "Accept", "act=reject": "Reject", "act=dubious": "MarkDubious",
    "act=invisible": "MarkNotVisible", "act=role": "SetRole",
}  # fmt: skip
ON_BOARD = {"keep": "JudgeFiducial", "hide": "JudgeFiducial"}
AWAY = {
    "act=placing.run", "act=start.desk", "act=start.place", "act=start.save", "placing-start",
    "language", "settings-open", "mosaic-remake",
}  # fmt: skip
"""Write settings, begin a run, leave the page, or go once their work is done: others test them."""
DECIDING_ELSEWHERE = {f"board={name}" for name in (*ON_BOARD, "undo", "fill")}
DECIDING_ELSEWHERE |= {"act=undo", "act=redo", "sign", "fault-mark"}
SHEETS = {
    "": "", "help": "h", "quality": "b", "board": "i", "mask": "Shift+I", "placement": "g",
    "mosaic": "Shift+O", "checks": "Shift+B",
    "results": "#results-open", "points": "#points-open", "naming": "#who", "placed": "Shift+G",
}  # fmt: skip
"""Everything that opens at the desk: by a key or a button."""


def open_sheet(page, sheet: str) -> None:
    """Open a sheet of the desk and wait until it is drawn; whatever is open is closed."""
    page.wait_for_function("window.gruber?.parts.point && !gruber.isAhead()")
    page.evaluate(CLOSE)
    if (opener := SHEETS[sheet]).startswith("#"):
        page.click(opener)
    elif opener:
        page.keyboard.press(opener)
    if sheet:
        page.wait_for_selector(f"#{sheet}[open]:not(:has([aria-busy])) :is(button, iframe)")


def frame_of_placing(page):
    """The frame in which a photo is placed by hand, once it can be used."""
    frame = page.wait_for_selector("#placed iframe").content_frame()
    frame.wait_for_selector("#placing-save", state="attached")
    # The fit of the clicks comes from the server, and with it the buttons are drawn anew.
    frame.wait_for_load_state("networkidle")
    return frame


FORGET = """addEventListener("pagehide", () => {
  sessionStorage.clear();
  localStorage.removeItem("gruber.seat");
})"""


def press_everything(page, again, written) -> list[str]:
    """Enter and Space on every control of a page; what did not do what it says, or wrote."""
    wrong, alike, before = [], set(), written()
    for control in page.evaluate(CONTROLS):
        tag, kind, name = control
        plain = tag, kind, re.sub(r"\d+", "#", name)
        if name in {*AWAY, *DECIDING, *DECIDING_ELSEWHERE} or plain in alike:
            continue
        alike.add(plain)
        for key in ("Enter", " "):
            if not page.evaluate(AIM, control):
                # A new seat: filters and what is folded are as at first.
                page.evaluate(FORGET)
                page.reload()
                again()
                # What a sheet asks the desk for comes a moment after it; what is gone never does.
                page.wait_for_function(AIM, arg=control)
            page.keyboard.press(key)
            if (presses := page.evaluate("window.presses")) not in presses_of(tag, kind, key):
                wrong.append(f"{key!r} on {control}: {presses} presses")
            if tag == "SELECT" and key == " ":
                # What Enter and Space unfold is folded again by leaving it.
                page.evaluate(AIM, control)
                wrong += [f"{control} {why}" for why in wrong_with_list(page)]
            again()
            if written() != before:
                return [*wrong, f"{key!r} on {control} wrote"]
    return wrong


@pytest.mark.parametrize("kind", ["StartWalk", "PlacingWalk", "ReportWalk"])
def test_tab_reaches_every_control_of_the_other_pages__law(rooms, enter, kind):
    room = rooms[kind]
    page = enter(room)
    page.wait_for_load_state("networkidle")
    assert unseen_or_unreached(page) == []

    def again() -> None:
        page.wait_for_selector(room.kind.ready, state="attached")
        page.evaluate("document.querySelectorAll('dialog[open]').forEach(sheet => sheet.close())")

    assert press_everything(page, again, lambda: files_of(room.folder)) == []


def test_tab_reaches_every_control_of_the_lessons__law(rooms, enter):
    assert unseen_or_unreached(enter(rooms["LessonsWalk"])) == []


def test_tab_reaches_every_control_of_the_desk_and_its_sheets__law(rooms, enter):
    """Each seen with the focus, each doing what it says by Enter and Space, nothing decided."""
    room = rooms["DeskWalk"]
    page, session = enter(room), room.session
    begun = len(session.decisions())
    page.wait_for_function("gruber.parts.point.trial")
    wrong = {}
    for sheet in SHEETS:

        def again(sheet=sheet) -> None:
            if page.evaluate(OPEN) == sheet:
                # A key that goes down on a control and up on its successor presses neither.
                page.wait_for_function("!gruber.isAhead() && !gruber.parts.status.adjusting")
                return
            open_sheet(page, sheet)

        again()
        if sheet == "placed":
            wrong[sheet] = unseen_or_unreached(frame_of_placing(page))
            continue
        wrong[sheet] = unseen_or_unreached(page)
        wrong[sheet] += press_everything(page, again, lambda: len(session.decisions()))
    page.evaluate(CLOSE)
    page.evaluate("document.querySelector('[data-act=tour]').click()")
    for _ in range(6):
        page.keyboard.press("Enter")
    page.wait_for_selector("#tour", state="hidden")
    caught_up(page)
    wrong["late"] = [type(item.decision).__name__ for item in session.decisions()[begun:]]
    assert {sheet: names for sheet, names in wrong.items() if names} == {}


def test_enter_on_a_button_that_decides_decides_that_and_nothing_else__law(rooms, enter):
    room = rooms["DeskWalk"]
    page, session = enter(room), room.session
    begun = len(session.decisions())

    def decided(name: str, button: str, after: int) -> None:
        page.wait_for_selector(f"{button}:not(:disabled)")
        page.focus(button)
        page.keyboard.press("Enter")
        until(page, lambda: len(session.decisions()) > after)
        caught_up(page)
        made = session.decisions()[after:]
        assert [type(item.decision).__name__ for item in made] == [name], button

    for number, (button, name) in enumerate(DECIDING.items()):
        decided(name, f"#acts [data-{button}]", begun + number)
        page.wait_for_function("!gruber.isAhead() && !gruber.parts.status.adjusting")
    page.keyboard.press("i")
    begun = len(session.decisions())
    for number, (button, name) in enumerate(ON_BOARD.items()):
        decided(name, f"#board [data-board={button}]", begun + number)
        page.wait_for_function("!gruber.isAhead() && !gruber.parts.status.adjusting")
        assert page.evaluate("document.activeElement.dataset.board") == button
    # On the board U takes back what was decided there, on the desk the rest.
    for decisions in (ON_BOARD, DECIDING):
        for _ in decisions:
            known = len(session.decisions())
            # A hand that is ahead of the desk is told to wait, by design.
            page.wait_for_function("!gruber.isAhead() && !gruber.parts.status.adjusting")
            page.keyboard.press("u")
            until(page, lambda known=known: len(session.decisions()) > known)
        page.keyboard.press("Escape")
    for act in ("redo", "undo"):
        decided("Withdraw", f"[data-act={act}]", len(session.decisions()))


DROPPED = """() => {
  const dataTransfer = new DataTransfer();
  dataTransfer.items.add(new File(["id;X;Y;Z\\na;1;2;3\\nb;here;2;3\\n"], "list.csv"));
  dispatchEvent(new DragEvent("drop", { dataTransfer, cancelable: true }));
}"""


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
    page.wait_for_selector("#results[open] li")
    look("results", page)
    page.keyboard.press("Escape")
    page.keyboard.press("Shift+O")
    page.wait_for_selector("#mosaic[open] aside:not([aria-busy])")
    page.keyboard.press("l")
    look("mosaic", page)
    page.keyboard.press("Escape")
    page.keyboard.press("Escape")
    page.keyboard.press("Shift+B")
    page.wait_for_selector("#checks[open] .check-room >> nth=1")
    page.keyboard.press("n")
    look("checks", page)
    page.evaluate("document.getElementById('checks').close()")
    page.evaluate(DROPPED)
    page.wait_for_selector("#points[open] .points-table")
    look("points", page)
    page = enter(rooms["LessonsWalk"], language=language)
    page.evaluate(axe)
    page.wait_for_selector("#check")
    look("lessons", page)
    assert {name: lines for name, lines in found.items() if lines} == {}
