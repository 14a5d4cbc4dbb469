"""Every gesture that decides, by key and by pointer, on 24 scans and 1,500 proposals.

Run: python -m tests.benchmarks.prove_gestures

Each gesture is made in a real Chromium; then the session is opened from disk by another reader:
what is new there must be one decision, as the gesture means it, about the point that was shown.
"""

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from playwright.sync_api import Page

from sessions.decisions import Recorded
from sessions.session import Session
from tests.benchmarks.desk_browser import browser, served, sit_down
from tests.benchmarks.large_desk import say

Gesture = Callable[[Page], None]
PATIENCE_TICKS, TICK_MS = 100, 100


def key(name: str) -> Gesture:
    """A key pressed."""
    return lambda page: page.keyboard.press(name)


def button(name: str) -> Gesture:
    """The button of an act clicked."""
    return lambda page: page.click(f'[data-act="{name}"]')


def click_in_scan(page: Page) -> None:
    """A place clicked beside the middle of the scan."""
    right, down = _middle(page, "right")
    page.mouse.click(right + 45, down - 30)


def drag_mark(page: Page) -> None:
    """The mark of the measurement dragged."""
    right, down = _middle(page, "right")
    away = page.evaluate(
        """() => { const { point, view } = gruber.compareState();
        const [east, north] = point.marks.measured;
        return [(east - view.east) * view.scale, (view.north - north) * view.scale]; }"""
    )
    page.mouse.move(right + away[0], down + away[1])
    page.mouse.down()
    page.mouse.move(right + away[0] + 24, down + away[1] + 18, steps=4)
    page.mouse.up()


def new_point(page: Page) -> None:
    """A new point clicked in the ortho."""
    page.keyboard.press("p")
    page.wait_for_selector("#adding:not([hidden])")
    right, down = _middle(page, "left")
    page.mouse.click(right + 20, down + 10)


def other_peak(page: Page) -> None:
    """Another of the engine's places."""
    page.click(".peak:not(.on)")


def history(page: Page) -> None:
    """A decision of the history taken back by its button."""
    page.click("#history button")


def _middle(page: Page, pane: str) -> tuple[float, float]:
    box = page.locator(f'.pane[data-pane="{pane}"]').bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


GESTURES: tuple[tuple[str, Gesture, str], ...] = (
    ("Y", key("y"), "Accept"), ("accept button", button("accept"), "Accept"),
    ("N", key("n"), "Reject"), ("reject button", button("reject"), "Reject"),
    ("M", key("m"), "MarkDubious"), ("dubious button", button("dubious"), "MarkDubious"),
    ("V", key("v"), "MarkNotVisible"),
    ("not-visible button", button("invisible"), "MarkNotVisible"),
    ("C", key("c"), "SetRole"), ("role button", button("role"), "SetRole"),
    ("U", key("u"), "Withdraw"), ("undo button", button("undo"), "Withdraw"),
    ("Shift+U", key("Shift+U"), "Withdraw"), ("redo button", button("redo"), "Withdraw"),
    ("click in the scan", click_in_scan, "Place"), ("mark dragged", drag_mark, "Place"),
    ("arrow", key("ArrowRight"), "Place"), ("Shift+arrow", key("Shift+ArrowUp"), "Place"),
    ("history button", history, "Withdraw"),
    ("other peak", other_peak, "ChoosePeak"),
    ("P, click in the ortho", new_point, "AddPoint"), ("U after it", key("u"), "Withdraw"),
)  # fmt: skip


def recorded(folder: Path) -> tuple[Recorded, ...]:
    """What is on disk, as another reader finds it."""
    with Session.open(folder, "reader") as session:
        return session.decisions()


def made(page: Page, folder: Path, gesture: Gesture) -> list[Recorded]:
    """Make a gesture; what is on disk after it that was not there before."""
    before = len(recorded(folder))
    gesture(page)
    for _ in range(PATIENCE_TICKS):
        page.wait_for_timeout(TICK_MS)
        fresh = list(recorded(folder)[before:])
        if fresh:
            page.wait_for_timeout(300)
            return fresh
    return []


def prepare(page: Page, name: str) -> None:
    """For another peak: a measurement that has one."""
    if name != "other peak":
        return
    for _ in range(30):
        if page.locator(".peak:not(.on)").count():
            return
        before = page.evaluate("gruber.parts.point.key.join('|')")
        page.keyboard.press("j")
        page.wait_for_function("k => gruber.parts.point.key.join('|') !== k", arg=before)


def main() -> int:
    """A line for each gesture; 1 when one of them is not on disk as it was meant."""
    broken = 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "desk"
        with served(folder) as (url, _), browser() as chromium:
            page = sit_down(chromium, url)
            page.wait_for_timeout(4000)
            for name, gesture, kind in GESTURES:
                prepare(page, name)
                point = page.evaluate("gruber.parts.point.key")
                fresh = made(page, folder, gesture)
                found = [type(item.decision).__name__ for item in fresh]
                about = {getattr(item.decision, "point_id", point[0]) for item in fresh}
                good = found == [kind] and (kind == "AddPoint" or about == {point[0]})
                broken += not good
                say(f"{name:24} {kind:16} {'on disk' if good else f'BROKEN: {found} {about}'}")
    say(f"{len(GESTURES)} gestures on 24 scans, {broken} broken")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
