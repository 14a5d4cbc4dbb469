"""An operator who measures listed points at the desk in Chromium, by row, strip, click and key."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from playwright.sync_api import Page

from tests.benchmarks.desk_browser import browser, sit_down
from tests.browser.hands import becomes, caught_up, settled, state_of
from tests.browser.test_desk_measuring import AT
from tests.journeys.copies import reviewing

Key = tuple[str, str]
SEARCH_MS = 8000
"""A proposal that has not come after so long is none."""
NEAR_PX = 0.5
"""A draft so near is left; further off it is clicked again, closer to the picture."""
CLICKS, NOTCH, NOTCHES = 4, 240, 3
ROW_PX = 25
OPEN = """() => gruber.parts.queue.shown.map(place => gruber.parts.rows[place])
  .filter(row => ["predicted", "proposed"].includes(row[3])).map(row => [row[0], row[1]])"""
INTO_SIGHT = """([point, photo, high]) => {
  const { queue, rows } = gruber.parts;
  const place = queue.shown.findIndex(n => rows[n][0] === point && rows[n][1] === photo);
  document.getElementById("table").scrollTop = Math.max(0, place * high - 100);
}"""
IN_PANE = """([x, y]) => {
  const box = document.querySelector(".pane[data-pane=right]").getBoundingClientRect();
  const rim = 40;
  return x > box.left + rim && x < box.right - rim && y > box.top + rim && y < box.bottom - rim;
}"""


class BrowserOperator:
    """The hand of `prove_surveyed`, on a page."""

    def __init__(self, page: Page) -> None:
        self.page = page
        page.click('.chip[data-state="measure"]')
        page.wait_for_function("gruber.parts.queue.filter.state === 'measure'")

    def waiting(self) -> list[Key]:
        """In the order of the queue."""
        settled(self.page)
        caught_up(self.page)
        return [(point, photo) for point, photo in self.page.evaluate(OPEN)]

    def look(self, key: Key) -> int:
        """By the strip of the point's photos, or by the row."""
        page, (point, photo) = self.page, key
        here = page.evaluate("gruber.parts.point?.key")
        if here == [point, photo]:
            return 0
        if here and here[0] == point:
            page.click(f'#others .other[title^="{photo}"]')
        else:
            page.evaluate(INTO_SIGHT, [point, photo, ROW_PX])
            page.click(f'.row[data-key="{point}|{photo}"]')
        page.wait_for_function("key => gruber.parts.point?.key.join() === key.join()", arg=key)
        caught_up(page)
        return 1

    def place(self, key: Key, column: float, row: float) -> int:
        """Click, closer and once more where that was too coarse; then keep it."""
        page = self.page
        page.wait_for_function("gruber.compareState().drawn.whole")
        for _ in range(CLICKS):
            at = page.evaluate(AT, [column, row])
            while not page.evaluate(IN_PANE, at):
                self._wheel(page.evaluate(AT, page.evaluate("gruber.parts.point.raw.predicted")), 1)
                at = page.evaluate(AT, [column, row])
            self._wheel(at, -NOTCHES)
            page.mouse.click(*page.evaluate(AT, [column, row]))
            page.wait_for_function("gruber.parts.point.draft")
            caught_up(page)
            drafted = np.array(page.evaluate("gruber.parts.point.draft.raw"))
            if np.hypot(*(drafted - [column, row])) < NEAR_PX:
                break
        return self.keep(key)

    def keep(self, key: Key) -> int:
        """`Y`, and once more where the desk asks; wait until the block is adjusted."""
        page, name = self.page, "|".join(key)
        page.keyboard.press("y")
        page.wait_for_function(
            "key => gruber.parts.point?.draft?.asking || gruber.parts.rows"
            ".find(row => `${row[0]}|${row[1]}` === key)?.[3] === 'accepted'",
            arg=name,
        )
        caught_up(page)
        asked = state_of(page, name) != "accepted"
        if asked:
            page.keyboard.press("y")
        becomes(page, name, "accepted")
        settled(page)
        return 1 + asked

    def proposed(self, key: Key) -> tuple[np.ndarray, float] | None:
        """Waits for the search by what is measured now."""
        page, name = self.page, "|".join(key)
        until = time.monotonic() + SEARCH_MS / 1000
        while state_of(page, name) != "proposed":
            if time.monotonic() > until:
                return None
            page.wait_for_timeout(100)
        caught_up(page)
        place = page.evaluate("gruber.parts.point.raw.measured")
        score = page.evaluate(
            "key => gruber.parts.rows.find(row => `${row[0]}|${row[1]}` === key)[7]", name
        )
        return np.array(place), float(score)

    def turn_role(self, key: Key) -> int:
        """`C`."""
        clicks = self.look(key)
        self.page.keyboard.press("c")
        caught_up(self.page)
        return clicks

    def _wheel(self, at: list[float], notches: int) -> None:
        self.page.mouse.move(*at)
        for _ in range(abs(notches)):
            self.page.mouse.wheel(0, NOTCH if notches > 0 else -NOTCH)
            self.page.wait_for_timeout(60)


@contextmanager
def seated(folder: Path) -> Iterator[BrowserOperator]:
    """At the desk of a block, until the measuring is over."""
    with reviewing(folder) as url, browser() as launched:
        yield BrowserOperator(sit_down(launched, url))
