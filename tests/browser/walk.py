"""Random walks over the pages: a monkey that knows what its keys mean and reads the session file.

`python -m tests.browser.walk --seeds 0-499 --steps 30` walks, and prints the steps of each walk
that went wrong; `--seeds 17` walks that one again.
"""

import argparse
import json
import logging
import random
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

from playwright.sync_api import Error as PageError
from playwright.sync_api import sync_playwright

from app.check_plan import PlanWish, plan_checks
from app.desk.inputs import desk_inputs
from app.desk.wiring import open_desk
from app.found_lessons import find_lessons
from app.placing import Placeable, open_placing
from app.project import described, read_project
from app.start import open_start
from app.teaching import open_teaching
from core.matching.reference import open_reference
from core.progress import Progress
from core.synthetic.archive import make_block
from core.synthetic.options import SyntheticOptions
from sessions.session import Session
from tests.browser.conftest import ARGUMENTS, chromium_path, without_viser
from tests.browser.meaning import EYE
from tests.browser.monkey import (
    LARGE,
    OPERATOR,
    PATIENCE_S,
    DeskWalk,
    PageWalk,
    PlacingWalk,
    ReportWalk,
    Room,
    StartWalk,
    Wrong,
)
from tests.tiny import open_tiny, with_check_points
from ui.web.access import Door

REPOSITORY = Path(__file__).resolve().parents[2]


def remake(photo_ids: tuple[str, ...], progress: Progress, report: object) -> None:
    """In the place of orthos, which take a minute of every walk."""
    for step in range(3):
        progress.report(step, 3, photo_ids[0] if photo_ids else "")
        time.sleep(0.1)


class LessonsWalk(PageWalk):
    """Over the lessons, which keep everything in the browser."""

    ready = "#figures b"

    def end(self) -> None:
        super().end()
        self.page.click("[data-lesson] >> nth=1")
        self.expect(
            "document.querySelectorAll('[data-lesson]')[1].getAttribute('aria-current') === 'true'",
            "a lesson is clicked and not shown",
        )


@contextmanager
def open_rooms(block: Path, folder: Path) -> Generator[list[Room]]:
    """Every page, each on a copy of a block that was run."""
    desk, start, placing = (folder / name for name in ("desk", "start", "placing"))
    for copy in (desk, placing):
        shutil.copytree(block, copy)
    for part in ("scans", "ortho"):
        shutil.copytree(block / part, start / part)
    with ExitStack() as stack:
        project = read_project(desk)
        with Session.open(desk, "planner") as planner:
            plan_checks(project, planner, PlanWish())
        session = stack.enter_context(Session.open(desk, OPERATOR))
        inputs = desk_inputs(project, session, OPERATOR, Door())
        opened = stack.enter_context(open_desk(replace(inputs, remake=remake)))
        reader = stack.enter_context(Session.open(desk, "reader"))
        started = stack.enter_context(open_start(start, Door()))
        project = read_project(placing)
        given = described(project)
        with Session.open(placing, OPERATOR) as placed:
            scans: Any = placed.products.latest_value("scans")
            archive: Any = placed.products.latest_value("georeference")
        found = Placeable(given, scans, open_reference(given.reference), archive.block)
        page = stack.enter_context(open_placing(project, found, Door()))
        lessons = stack.enter_context(open_teaching(find_lessons(), Door()))
        report = (desk / "results" / "report.html").as_uri()
        yield [
            Room(DeskWalk, opened.url, desk, reader),
            Room(StartWalk, started.url, start),
            Room(PlacingWalk, page.url, placing),
            Room(ReportWalk, report, desk / "results"),
            Room(LessonsWalk, lessons.url, desk / "results"),
        ]


GONE = ("net::ERR_ABORTED",)
"""What was asked for by a page that is no longer there."""
REFUSES = ("/sheets", "/points/read", "/points/bring")
"""What may be answered by a sentence that the page shows, with a status of its own."""


class Ear(logging.Handler):
    """Every error of the browser and of the server."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.heard: list[str] = []

    def __enter__(self) -> Self:
        logging.getLogger().addHandler(self)
        self.before = threading.excepthook
        threading.excepthook = lambda died: self.heard.append(repr(died.exc_value))
        return self

    def __exit__(self, *_: object) -> None:
        logging.getLogger().removeHandler(self)
        threading.excepthook = self.before

    def emit(self, record: logging.LogRecord) -> None:
        self.heard.append(self.format(record))

    def listen(self, page: Any) -> None:
        note = self.note
        page.on("pageerror", lambda error: note(f"script: {error}"))
        page.on("console", lambda said: note(f"console: {said.text}", is_error(said)))
        page.on("requestfailed", lambda one: note(f"failed: {one.url}", one.failure not in GONE))
        page.on("response", lambda one: note(f"{one.status}: {one.url}", is_failure(one)))
        page.on("filechooser", lambda _: None)

    def note(self, text: str, grave: bool = True) -> None:
        if grave:
            self.heard.append(text)


def is_refusal(status: int, url: str) -> bool:
    """True for an answer in words to what cannot be done, or to what is not ready to be drawn."""
    if status == 503:
        return "/tiles/ortho/" in url  # The page asks again.
    return status == 409 and url.partition("?")[0].endswith(REFUSES)


def is_failure(response: Any) -> bool:
    """True for an answer that no page expects."""
    return response.status >= 400 and not is_refusal(response.status, response.url)


def is_error(said: Any) -> bool:
    """True for an error of a script; the browser complains of refusals, too."""
    url = said.location.get("url", "")
    refused = any(f"{status}" in said.text and is_refusal(status, url) for status in (409, 503))
    return said.type == "error" and not refused


class Machines:
    """Browsers of both languages, which keep what they have loaded from one walk to the next."""

    def __init__(self, browser: Any) -> None:
        self._browser = browser
        self._contexts: dict[str, Any] = {}

    def page(self, language: str, kept: Mapping[str, str], size: tuple[int, int]) -> Any:
        """A fresh page in a language, whose storage holds these values and nothing else."""
        if language not in self._contexts:
            made = self._browser.new_context(locale=language, bypass_csp=True)
            made.set_default_timeout(1000 * PATIENCE_S)
            made.add_init_script(EYE)
            without_viser(made)
            self._contexts[language] = made
        page = self._contexts[language].new_page()
        page.set_viewport_size(dict(zip(("width", "height"), size, strict=True)))
        page.add_init_script(f"({FRESH})({json.dumps(kept)})")
        return page


FRESH = """kept => {
  if (window !== top || window.origin === "null" || sessionStorage.getItem("walk")) return;
  localStorage.clear();
  for (const [name, value] of Object.entries(kept)) localStorage.setItem(name, value);
  sessionStorage.setItem("walk", "begun");
}"""
"""Before the first page of a walk: storage as a browser has it that comes for the first time."""


def walk_once(
    machines: Machines, rooms: Sequence[Room], seed: int, steps: int, ear: Ear
) -> list[str]:
    """One walk; what went wrong and the steps to it, nothing where all was well."""
    rng = random.Random(seed)
    room = rng.choices(rooms, (14, 2, 3, 1, 2))[0]
    language, theme = rng.choice(("en-GB", "cs-CZ")), rng.choice(("dark", "light"))
    new = rng.random() < 0.15
    kept = {} if new else {"gruber.tour": "seen", "gruber.theme": theme}
    page = machines.page(language, kept, rng.choice(LARGE))
    ear.heard.clear()
    ear.listen(page)
    walk = room.kind(page, rng, [f"{room.kind.__name__} {language} {theme}"])
    wrong: list[str] = []
    try:
        page.goto(room.url)
        page.wait_for_selector(room.kind.ready)
        walk.begin(room)
        walk.walk(steps)
        walk.end()
    except (Wrong, PageError) as error:
        wrong = [str(error)]
        try:
            walk.tidy()
        except (Wrong, PageError) as untidy:
            wrong.append(f"not as it was for the walks after it: {untidy}")
    wrong += ear.heard
    page.close()
    return [*walk.steps, *(f"  WRONG {text}" for text in wrong)] if wrong else []


def made_block(folder: Path) -> Path:
    """The tiny block of the tests, run."""
    make_block(folder, SyntheticOptions("tiny"))
    with_check_points(open_tiny(folder))
    subprocess.run([sys.executable, "-m", "gruber", "run", str(folder)], cwd=REPOSITORY, check=True)
    return folder


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="0-499", help="one seed, or the first and the last")
    parser.add_argument("--steps", type=int, default=30, help="gestures of each walk")
    parser.add_argument("--block", type=Path, help="a block that was run; made without one")
    asked = parser.parse_args()
    first, _, last = asked.seeds.partition("-")
    seeds, failed, begun = range(int(first), int(last or first) + 1), 0, time.monotonic()
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright, Ear() as ear:
        block = asked.block or made_block(Path(folder) / "made")
        path = chromium_path(playwright)
        browser = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
        machines = Machines(browser)
        with open_rooms(block, Path(folder)) as rooms:
            for seed in seeds:
                wrong = walk_once(machines, rooms, seed, asked.steps, ear)
                failed += bool(wrong)
                if wrong:
                    say("\n  ".join([f"seed {seed}:", *wrong]))
        browser.close()
    took = f"{time.monotonic() - begun:.0f} s"
    say(f"{len(seeds)} walks of {asked.steps} steps in {took}, {failed} went wrong")
    return min(failed, 1)


def say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
