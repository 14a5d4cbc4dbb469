"""A picture of every page and sheet, in every size, theme and language, to be looked at.

`python -m tests.benchmarks.prove_pictures BLOCK OUT [--only NAME …] [--sizes …]`: BLOCK is a
folder of a block that was run, of which copies are used. A picture that failed is named with its
reason, and the program ends with 1.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

from playwright.sync_api import Error as PageError

from app.found_lessons import find_lessons
from app.start import open_start
from tests.benchmarks.desk_browser import HOME, browser
from tests.browser.conftest import PATIENCE_MS, machine, scene_of
from tests.browser.hands import caught_up, current, gone_on, grow, settled, unfold
from tests.browser.monkey import Wrong
from tests.browser.test_every_page import CLOSE, SHEETS, frame_of_placing, open_sheet
from tests.browser.walk import Ear, open_rooms, say
from ui.views.meshes import TerrainOptions
from ui.web.access import Door

SIZES = {"1366x768": (1366, 768), "1600x1000": (1600, 1000), "2560x1440": (2560, 1440)}
THEMES = ("light", "dark")
LANGUAGES = {"en": "en-GB", "cs": "cs-CZ"}
QUIET_S = 0.3  # A page that has asked for nothing in this time is drawn.
BEYOND = 20
"""Steps of one pixel that lead further than three sigma."""
WHOLE = "gruber.parts.point.trial && gruber.compareState().drawn.whole"
SCROLL = """([name, share]) => {
  for (const e of document.querySelectorAll(`${name}, ${name} *`))
    e.scrollTop = share * (e.scrollHeight - e.clientHeight);
}"""
SCENE_MS = 1000  # From one look at the scene to the next.
SCENE = """shade => {
  const { camera, nodeRefFromName } = window.__viserMutable, before = window.pictured, found = [];
  const now = window.pictured = JSON.stringify([innerWidth, innerHeight, camera]);
  nodeRefFromName["/terrain"].traverse(e => found.push(e.material?.map?.image));
  return before === now && !window.gruberLost
    && Math.abs(camera.aspect - innerWidth / innerHeight) < 0.01
    && found.some(image => Math.max(image?.width, image?.height) > shade);
}"""
"""The scene fills its room, its camera rests, and the ortho is on it, larger than the relief."""

Pictured = Iterator[str]
"""What is added to the name of each picture; after the last one the page is as it was."""


def as_it_is(page: Any) -> Pictured:
    yield ""


def draft(page: Any, steps: int = 1) -> Pictured:
    for _ in range(steps):
        page.keyboard.press("Shift+ArrowRight")
    page.wait_for_function("gruber.parts.point.draft && gruber.parts.point.trial")
    caught_up(page)
    yield ""
    page.keyboard.press("Escape")
    page.wait_for_function("!gruber.parts.point.draft")


def question(page: Any) -> Pictured:
    asked = draft(page, BEYOND)
    next(asked)
    page.keyboard.press("y")
    page.wait_for_function("gruber.parts.point.draft?.asking")
    yield ""
    yield from asked


def reasons(page: Any) -> Pictured:
    """Of the second point: the history of the first is seen elsewhere."""
    first, decided = current(page), page.evaluate("gruber.parts.status.decided")
    page.keyboard.press("j")
    gone_on(page, first)
    page.keyboard.press("n")
    page.wait_for_selector("#reasons:not([hidden])")
    yield ""
    caught_up(page)
    page.keyboard.press("u")
    page.wait_for_function("before => gruber.parts.status.decided === before", arg=decided)
    settled(page)


def details(page: Any) -> Pictured:
    folded = page.is_hidden("#details")  # A large window shows them at first.
    unfold(page)
    yield ""
    if folded:
        page.keyboard.press(".")


def all_scans(page: Any) -> Pictured:
    page.keyboard.press("z")
    page.wait_for_selector("#together canvas")
    yield ""
    page.keyboard.press("z")


def await_scene(page: Any) -> None:
    scene_of(page).wait_for_function(SCENE, arg=TerrainOptions().shade_px, polling=SCENE_MS)


def grown(page: Any, part: str) -> Pictured:
    grow(page, part)
    await_scene(page)
    yield ""
    page.click(f'[data-grow="{part}"]')
    await_scene(page)


def sheet(page: Any, name: str) -> Pictured:
    open_sheet(page, name)
    if name == "placed":
        frame_of_placing(page)
    if name == "mosaic":
        page.wait_for_function("gruber.mosaicState().drawn.whole")
    yield ""
    page.evaluate(CLOSE)


def quality(page: Any) -> Pictured:
    shown = sheet(page, "quality")
    next(shown)
    for share, place in ((0, "top"), (0.5, "middle"), (1, "bottom")):
        page.evaluate(SCROLL, ["#quality", share])
        yield f"-{place}"
    yield from shown


def tour(page: Any) -> Pictured:
    page.evaluate("document.querySelector('[data-act=tour]').click()")
    page.wait_for_selector("#tour[open] button")
    yield ""
    page.evaluate(CLOSE)


def screens(page: Any) -> Pictured:
    whole, height = page.evaluate("[document.documentElement.scrollHeight, innerHeight]")
    for number in range(-(-whole // height)):
        page.evaluate("top => scrollTo(0, top)", number * height)
        yield f"-{number + 1:02d}"


def lesson(page: Any, name: str) -> Pictured:
    page.click(f'[data-lesson="{name}"]')
    page.wait_for_function("!gruber.state.asking")
    yield ""


READY = {
    "desk": ".row.current", "start-empty": "#drop", "start-files": ".thumb",
    "start-block": ".thumb", "start-blocks": "#files li", "placing": "#placing-scans button",
    "lessons": "#figures b", "report": "table",
}  # fmt: skip
"""What is seen in a room that is open."""
PAGES: Mapping[str, tuple[str, Callable[[Any], Pictured]]] = {
    "desk": ("desk", as_it_is),
    "draft": ("desk", draft),
    "question": ("desk", question),
    "details": ("desk", details),
    "all-scans": ("desk", all_scans),
    "compare": ("desk", partial(grown, part="compare")),
    "scene": ("desk", partial(grown, part="block")),
    **{name: ("desk", partial(sheet, name=name)) for name in SHEETS if name},
    "quality": ("desk", quality),
    "tour": ("desk", tour),
    "reasons": ("desk", reasons),
    **{room: (room, as_it_is) for room in READY if room.startswith("start-")},
    "placing": ("placing", as_it_is),
    "report": ("report", screens),
    **{f"lesson-{name}": ("lessons", partial(lesson, name=name)) for name in find_lessons()},
}
"""Every page: the room it is in, and the way to it."""


@contextmanager
def rooms_of(block: Path, folder: Path) -> Generator[dict[str, str]]:
    """Addresses of all rooms, each on a copy of the block; `{}` stands for the language."""
    blocks, empty = folder / "blocks", folder / "empty"
    empty.mkdir()
    for language in LANGUAGES:
        copy = shutil.copytree(block, blocks / language)
        command = [sys.executable, "-m", "gruber", "report", str(copy), "--language", language]
        subprocess.run(command, cwd=HOME, check=True, stdout=subprocess.DEVNULL)
    starts = {"start-empty": empty, "start-block": blocks / "en", "start-blocks": blocks}
    with ExitStack() as stack:
        desk, files, placing, _, lessons = stack.enter_context(open_rooms(block, folder / "rooms"))
        rooms = {
            "desk": desk.url, "start-files": files.url, "placing": placing.url,
            "lessons": lessons.url, "report": f"{blocks.as_uri()}/{{}}/results/report.html",
        }  # fmt: skip
        for name, where in starts.items():
            rooms[name] = stack.enter_context(open_start(where, Door())).url
        yield rooms


class Seat:
    """A browser of one size, theme and language, with one page open."""

    def __init__(self, context: Any, rooms: Mapping[str, str], language: str, ear: Ear) -> None:
        self._context, self._rooms, self._language, self._ear = context, rooms, language, ear
        self._room, self._page, self._asked = "", None, set[Any]()

    def page_of(self, room: str) -> Any:
        """The page of a room, opened anew where another one is open."""
        if room != self._room or self._page is None:
            self.leave()
            self._room, self._page = room, self._context.new_page()
            self._ear.listen(self._page)
            asked = self._asked = set[Any]()
            self._page.on("request", lambda one: asked.add(one))
            for over in ("requestfinished", "requestfailed"):
                self._page.on(over, lambda one: asked.discard(one))
            self._page.goto(self._rooms[room].format(self._language))
            self._page.wait_for_selector(READY[room])
            if room == "desk":
                await_scene(self._page)
                self._page.wait_for_function(WHOLE)
        return self._page

    def leave(self) -> None:
        """Close the page: the next one begins as at first."""
        if self._page is not None:
            self._page.close()
        self._page = None

    def quiet(self) -> None:
        """Wait until the page asks for nothing more."""
        begun = last = time.monotonic()
        while time.monotonic() - last < QUIET_S:
            self._page.wait_for_timeout(20)  # Events come while it waits.
            last = time.monotonic() if self._asked else last
            if time.monotonic() - begun > PATIENCE_MS / 1000:
                raise Wrong(f"still asks for {[one.url for one in self._asked]}")


def take(seat: Seat, name: str, target: Path, ear: Ear) -> tuple[int, list[str]]:
    """All pictures of one page: how many were made, and what failed."""
    made, wrong, (room, way) = 0, list[str](), PAGES[name]
    ear.heard.clear()
    try:
        page = seat.page_of(room)
        for part in way(page):
            seat.quiet()
            page.screenshot(path=target.with_name(f"{name}{part}-{target.name}.png"))
            made += 1
    except (Wrong, PageError) as error:
        wrong.append(f"{error}")
    wrong += ear.heard
    if wrong:
        seat.leave()
    return made, [f"{name}-{target.name}: {text}" for text in wrong]


def pictures(block: Path, target: Path, only: Iterable[str], sizes: Iterable[str]) -> int:
    """Take them all; 1 where one failed."""
    begun, made, failed = time.monotonic(), 0, 0
    with tempfile.TemporaryDirectory() as folder, Ear() as ear, ExitStack() as stack:
        rooms = stack.enter_context(rooms_of(block, Path(folder)))
        chromium = stack.enter_context(browser())
        for size, theme, language in product(sizes, THEMES, LANGUAGES):
            window = dict(zip(("width", "height"), SIZES[size], strict=True))
            context = machine(chromium, LANGUAGES[language], color_scheme=theme, viewport=window)
            seat = Seat(context, rooms, language, ear)
            for name in only:
                count, wrong = take(seat, name, target / f"{size}-{theme}-{language}", ear)
                made, failed = made + count, failed + len(wrong)
                for line in wrong:
                    say(f"FAILED {line}")
            context.close()
    say(f"{made} pictures, {failed} failures, {time.monotonic() - begun:.0f} s")
    return min(failed, 1)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("block", type=Path, help="a folder of a block that was run")
    parser.add_argument("target", type=Path, help="the folder of the pictures")
    parser.add_argument("--only", nargs="+", choices=list(PAGES), default=list(PAGES))
    parser.add_argument("--sizes", nargs="+", choices=list(SIZES), default=list(SIZES))
    given = parser.parse_args()
    given.target.mkdir(parents=True, exist_ok=True)
    return pictures(given.block, given.target, given.only, given.sizes)


if __name__ == "__main__":
    sys.exit(main())
