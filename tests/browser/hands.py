"""What a hand does at the desk, and what an eye reads off it."""

import time
from collections.abc import Callable
from contextlib import contextmanager
from typing import Any

import numpy as np

from tests.browser.conftest import PATIENCE_MS


def sigma(page) -> float:
    return float(page.get_attribute("#sigma", "data-value"))


def current(page) -> str:
    drawn(page)
    return page.get_attribute(".row.current", "data-key")


def state_of(page, key: str) -> str:
    """The state of a measurement as the page knows it; the table draws only rows in sight."""
    return page.evaluate(
        "key => gruber.parts.rows.find(row => `${row[0]}|${row[1]}` === key)[3]", key
    )


def becomes(page, key: str, state: str) -> None:
    """Wait until a measurement is in a state, wherever the queue shows it."""
    page.wait_for_function(
        "([key, state]) => gruber.parts.rows"
        ".find(row => `${row[0]}|${row[1]}` === key)?.[3] === state",
        arg=[key, state],
    )


def caught_up(page) -> None:
    """Wait until the desk is done with every gesture: before, a key to decide is refused."""
    page.wait_for_function("!gruber.isAhead()")


def drawn(page) -> None:
    """Wait until what was asked is on screen: pages draw once per frame."""
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


def until(page: Any, is_so: Callable[[], object]) -> None:
    """Wait for what no page tells, as the session on the disk does; the page lives meanwhile."""
    deadline = time.monotonic() + PATIENCE_MS / 1000
    while not is_so():
        assert time.monotonic() < deadline, "it has not come to be so"
        page.wait_for_timeout(20)


def gone_on(page, key: str) -> None:
    """Wait until the desk shows another point than this one and takes a decision on it."""
    page.wait_for_function("key => gruber.parts.point.key.join('|') !== key", arg=key)
    caught_up(page)


def look_at(page, key: str) -> None:
    """Choose a measurement among all, decided or not, once the rows no longer move."""
    caught_up(page)
    page.click('.chip[data-state="all"]')
    caught_up(page)
    page.click(f'.row[data-key="{key}"]')
    page.wait_for_function("key => gruber.parts.point.key.join('|') === key", arg=key)


def unfold(page) -> None:
    """Show what is folded away at first: all figures, other scans, history."""
    if not page.locator("#details").is_visible():
        page.keyboard.press(".")
    page.wait_for_selector("#details:not([hidden])")


def grow(page, part: str) -> None:
    """Give one part of the desk the whole window."""
    page.click(f'[data-grow="{part}"]')
    page.wait_for_selector(f'#desk[data-grown="{part}"]')


def press(page, key: str) -> tuple[str, float, float]:
    """Press a key on the current point: its name, sigma nought before, seconds until it changed."""
    # What an adjustment under way comes to is not of this key.
    settled(page)
    caught_up(page)
    point, before = current(page), page.get_attribute("#sigma", "data-value")
    begun = time.perf_counter()
    page.keyboard.press(key)
    changed = "before => document.getElementById('sigma').dataset.value !== before"
    page.wait_for_function(changed, arg=before, polling=10)
    return point, float(before), time.perf_counter() - begun


AT_ONCE = """keys => keys.forEach(key => (document.activeElement ?? document.body).dispatchEvent(
  new KeyboardEvent("keydown", { key, code: `Key${key.toUpperCase()}`, view: window,
    bubbles: true })))"""


def at_once(page, *letters: str) -> None:
    """Letters pressed in one breath: however slow the page, it draws nothing between them."""
    page.evaluate(AT_ONCE, list(letters))


def settled(page) -> None:
    """Wait until no adjustment is under way."""
    page.wait_for_function("!gruber.parts.status.adjusting")


def accept(page) -> None:
    """Accept what is in sight, once more where the desk asks; then the next point is shown."""
    caught_up(page)
    page.keyboard.press("y")
    page.wait_for_function("!gruber.parts.point.draft || gruber.parts.point.draft.asking")
    caught_up(page)
    if page.evaluate("gruber.parts.point.draft"):
        page.keyboard.press("y")
    page.wait_for_function("!gruber.parts.point.draft")


def place_wrongly(page, away_px: float = 60) -> str:
    """Draft a place beside the measurement and keep it in spite of the question: photos move."""
    point = current(page)
    box = page.locator('.pane[data-pane="right"]').bounding_box()
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.click(middle[0] + away_px, middle[1] - away_px)
    page.wait_for_function("gruber.parts.point.draft")
    accept(page)
    becomes(page, point, "accepted")
    settled(page)
    return point


WIRE = """open => {
  const { prototype } = WebSocket;
  window.known ??= Object.getOwnPropertyDescriptor(prototype, "readyState");
  const shut = { configurable: true, get: () => WebSocket.CLOSED };
  Object.defineProperty(prototype, "readyState", open ? window.known : shut);
}"""


@contextmanager
def wire_cut(page):
    """A page whose wire to the desk takes nothing for a moment."""
    caught_up(page)
    page.evaluate(WIRE, False)
    yield
    page.evaluate(WIRE, True)


PLACE = """() => { const { current, found } = gruber.checksState();
  return found.places.find(one => one.place === current); }"""


def sit_down_as(page: Any, who: str) -> Any:
    """The page, once its seat bears a name."""
    settled(page)
    page.click("#who")
    page.fill("#name-field", who)
    page.keyboard.press("Enter")
    page.wait_for_function("name => document.getElementById('who').dataset.name === name", arg=who)
    return page


def open_checks(page: Any) -> None:
    page.keyboard.press("Shift+B")
    page.wait_for_selector("#checks[open] .check-room >> nth=1", timeout=PATIENCE_MS)
    page.wait_for_function("gruber.checksState().toScreen(0, [0, 0]) !== undefined")


def read_place(page: Any, off: np.ndarray) -> str:
    """Mark the current place with a difference, and keep it, also where the desk asks."""
    name, gone = mark_place(page, off), "gruber.checksState().current !== name"
    page.keyboard.press("y")
    page.wait_for_function(
        f"name => {gone} || document.querySelector('#checks-state.against')", arg=name
    )
    if page.evaluate("gruber.checksState().current") == name:
        caught_up(page)
        page.keyboard.press("y")
        page.wait_for_function(f"name => {gone}", arg=name)
    return name


def mark_place(page: Any, off: np.ndarray) -> str:
    """Mark the current place with a difference."""
    state = page.evaluate(PLACE)
    name, at = state["place"], np.array(state["at"])
    for side, ground in enumerate((at + off, at)):
        box = page.locator("#checks .check-room").nth(side).bounding_box()
        x, y = page.evaluate(
            "([side, ground]) => gruber.checksState().toScreen(side, ground)",
            [side, ground.tolist()],
        )
        page.mouse.click(box["x"] + x, box["y"] + y)
    return name
