"""One Chromium for all browser tests, and a desk on the tiny block for each."""

import os
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from app.check_plan import PlanWish, draw_plan
from app.desk.inputs import desk_inputs as run_inputs
from app.desk.wiring import OpenDesk, open_desk
from app.found_lessons import find_lessons
from app.project import read_project
from app.teaching import open_teaching
from sessions.session import Session
from tests.ui.desk_block import desk_inputs
from ui.web.access import Door

# As a computer without a GPU has it: pages are drawn by the processor, and so is the 3D scene.
ARGUMENTS = [
    "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--disable-gpu", "--enable-unsafe-swiftshader",
]  # fmt: skip
INSTALL = (
    "no Chromium: install it with `.venv/bin/python -m playwright install --with-deps chromium`"
)
SIZE = {"width": 1600, "height": 1000}
STAND_IN = """<!doctype html><title>3D</title><script src="/pages/scene.js"></script>
<script>window.__viserMutable = { nodeRefFromName: { "/terrain": 1 } };</script>"""
"""In the place of viser, which is not ours: it hands keys up as viser does, and draws nothing."""
AS_A_PERSON = "Object.defineProperty(navigator, 'webdriver', { get: () => false })"
TOOLS = Path(os.environ.get("GRUBER_PAGE_TOOLS", Path(sys.prefix) / "pages"))
AXE = TOOLS / "node_modules" / "axe-core" / "axe.min.js"
NO_AXE = "no axe-core: `make test` and `make check` install it"
VIOLATIONS = """async how => {
  // The frame of the scene is viser's own page.
  const found = await axe.run({ exclude: [["#scene"]] }, { iframes: false, ...how });
  return found.violations.map(({ id, nodes }) => `${id}, ${nodes.length} times: `
    + `${nodes[0].html.slice(0, 140)} ${nodes[0].any[0]?.message ?? ""}`);
}"""
# A browser that draws without a GPU on a busy machine is slow to begin.
PATIENCE_MS = 60_000


def chromium_path(playwright) -> str | None:
    """The system's Chromium without windows, Playwright's own Chromium, or the system's."""
    named = (shutil.which(name) for name in ("chromium", "chromium-browser", "google-chrome"))
    own = playwright.chromium.executable_path
    # measured: without windows a page costs a sixth less processor time.
    offered = shutil.which("chromium-headless-shell"), own if Path(own).exists() else None, *named
    return next((path for path in offered if path), None)


@pytest.fixture(scope="session")
def chromium():
    """A Chromium; without one the tests fail where `CI` is set and are skipped elsewhere."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        path = chromium_path(playwright)
        if path is None:
            (pytest.fail if os.environ.get("CI") else pytest.skip)(INSTALL)
        browser = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture
def axe():
    """Text of axe-core; without it the tests fail where `CI` is set and are skipped elsewhere."""
    if not AXE.exists():
        (pytest.fail if os.environ.get("CI") else pytest.skip)(NO_AXE)
    return AXE.read_text(encoding="utf-8")


@pytest.fixture
def desk(tmp_path, seats):
    """A desk on the tiny block."""
    inputs = desk_inputs(tmp_path)
    with open_desk(inputs) as opened:
        yield opened
        seats.leave()
    inputs.session.close()


@dataclass(frozen=True)
class RealDesk:
    """A desk open on a copy of the block that was run."""

    desk: OpenDesk
    session: Session
    folder: Path

    @property
    def results(self) -> Path:
        return self.folder / "results"


@pytest.fixture
def run_folder(tiny_run, tmp_path):
    """The tiny block as `gruber run` left it; what is done to it is undone afterwards.

    In its own place, because products are named by the paths of what made them.
    """
    shutil.copytree(tiny_run.folder, tmp_path / "kept")
    yield tiny_run.folder
    shutil.rmtree(tiny_run.folder)
    shutil.move(tmp_path / "kept", tiny_run.folder)


@pytest.fixture(scope="session")
def drawn_plan(tiny_run):
    """Places to be checked on the block that was run; drawing them takes seconds."""
    with Session.open(tiny_run.folder, "ada") as session:
        return draw_plan(read_project(tiny_run.folder), session, PlanWish()).plan


@pytest.fixture
def planned(drawn_plan, run_folder):
    """A plan recorded before the desk is opened."""
    with Session.open(run_folder, "ada") as session:
        session.record(drawn_plan)


@pytest.fixture
def real_desk(run_folder, seats):
    """A desk on the tiny block as `gruber run` left it."""
    project = read_project(run_folder)
    with (
        Session.open(project.folder, "anna") as session,
        open_desk(run_inputs(project, session, "anna", Door())) as opened,
    ):
        yield RealDesk(opened, session, run_folder)
        seats.leave()


AT_WORK = {"state": "running", "lines": [], "stages": [], "log": []}
"""What is told of a run that has begun."""


def toured(url: str) -> dict:
    """What a browser keeps that has been at the desk before: the tour does not open by itself."""
    origin = url.partition("/?")[0]
    seen = {"name": "gruber.tour", "value": "seen"}
    return {"cookies": [], "origins": [{"origin": origin, "localStorage": [seen]}]}


TOURED = "if (window.origin !== 'null') localStorage.setItem('gruber.tour', 'seen')"
"""The same, for a browser that goes to many desks."""


def without_viser(context) -> None:
    """Spare a browser the scene, which draws with the processor."""
    stand_in = {"body": STAND_IN, "content_type": "text/html"}
    context.route("**/scene/*/", lambda route: route.fulfill(**stand_in))


def machine(chromium, language="en-GB", **how):
    """A computer whose browser has been at the desk before."""
    # Waiting for a condition evaluates text, which the desk's own policy rightly forbids.
    how = {"color_scheme": "dark", "viewport": SIZE, "bypass_csp": True, **how}
    context = chromium.new_context(locale=language, **how)
    context.set_default_timeout(PATIENCE_MS)
    context.add_init_script(AS_A_PERSON)
    if "storage_state" not in how:
        context.add_init_script(TOURED)
    return context


class Seats:
    """Where operators sit: at a page that goes from desk to desk, others at a machine of their own.

    A browser of its own for every test would take as long as what most tests do in it.
    """

    def __init__(self, chromium) -> None:
        self._chromium, self._kept, self._known, self._taken = chromium, None, set(), []

    def take(self, url: str, language="en-GB", **how):
        """A page of which nobody can tell that it was elsewhere."""
        origin = url.partition("/?")[0]
        # What a page keeps it keeps by address: there, another is needed.
        if self._taken or how or language != "en-GB" or origin in self._known:
            page = machine(self._chromium, language, **how).new_page()
        else:
            if self._kept is None or self._kept.is_closed():
                self._kept = machine(self._chromium).new_page()
            page = self._kept
            self._known.add(origin)
        self._taken.append(page)
        return page

    def leave(self) -> None:
        """Close what was opened, and bring the page that is kept back to what it was."""
        for page in self._taken:
            if page is not self._kept:
                page.context.close()
            elif not page.is_closed():
                page.goto("about:blank")
                page.unroute_all()
                page.context.unroute_all()
                page.emulate_media(media="null", color_scheme="dark")
                page.mouse.move(-1, -1)
                page.context.clear_cookies()
                for other in page.context.pages[1:]:
                    other.close()
        self._taken = []


@pytest.fixture(scope="session")
def all_seats(chromium):
    return Seats(chromium)


@pytest.fixture
def seats(all_seats):
    """Whoever sits down in a test leaves after it."""
    yield all_seats
    all_seats.leave()


@pytest.fixture
def sit_at(seats):
    """Open a desk in a browser; every call in one test is another operator's machine.

    Without `scene` something stands in for viser.
    """

    def sit_down(
        url: str, scene: bool = True, language="en-GB", size=SIZE, ready=".row.current", **how
    ):
        page = seats.take(url, language, **how)
        page.set_viewport_size(size)
        if not scene:
            without_viser(page.context)
        page.goto(url)
        page.wait_for_selector(ready)
        if scene:
            scene_of(page)
        return page

    return sit_down


@pytest.fixture
def sit(sit_at, desk):
    """Open the desk on the made-up block, or another."""
    return lambda url="", scene=True, **how: sit_at(url or desk.url, scene, **how)


def scene_of(page):
    """The frame of the 3D scene, once the block is in it."""
    page.wait_for_function("document.getElementById('scene').contentWindow.__viserMutable")
    frame = next(frame for frame in page.frames if "/scene/" in frame.url)
    frame.wait_for_function("!!window.__viserMutable.nodeRefFromName['/terrain']")
    return frame


@pytest.fixture(scope="module")
def lessons(teaching_cache):
    with open_teaching(find_lessons(), Door()) as opened:
        yield opened


@pytest.fixture
def learn(sit_at, lessons):
    """Open a lesson; what its scripts complain of is kept."""

    def open_lesson(name, **how):
        page = sit_at(f"{lessons.url}&lesson={name}", scene=False, ready="#figures b", **how)
        wrong = []
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("console", lambda said: wrong.append(said.text) if said.type == "error" else None)
        return page, wrong

    return open_lesson
