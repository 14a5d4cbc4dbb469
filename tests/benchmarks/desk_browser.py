"""A Chromium at the desk that takes times inside the page, where an operator's eye would."""

import os
import re
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, sync_playwright

from tests.browser.conftest import ARGUMENTS, SIZE, chromium_path, toured

HOME = Path(__file__).resolve().parents[2]
WATCH = """() => {
  window.watched = { pressed: 0, log: [], adjusting: false, adjusted: 0 };
  for (const type of ['keydown', 'pointerup', 'pointerdown'])
    addEventListener(type, (event) => { watched.pressed = event.timeStamp; watched.log = []; }, true);
  const look = () => {
    const drawn = gruber.compareState().drawn;
    const name = `${drawn.key} ${drawn.measured}`;
    const last = watched.log.at(-1);
    if (!last || last.name !== name) watched.log.push({ name, key: drawn.key, first: drawn.at, whole: drawn.whole ? drawn.at : 0 });
    else if (!last.whole && drawn.whole) last.whole = drawn.at;
    const { adjusting } = gruber.parts.status;
    watched.adjusted += watched.adjusting && !adjusting;
    watched.adjusting = adjusting;
    requestAnimationFrame(look);
  };
  look();
}"""  # noqa: E501
NEW_POINT = """before => { const last = watched.log.at(-1);
  return last && last.key !== before && last.whole > 0; }"""
NEW_MARK = "before => { const last = watched.log.at(-1); return last && last.name !== before; }"


@contextmanager
def served(folder: Path, *arguments: str) -> Generator[tuple[str, subprocess.Popen[str]]]:
    """A desk in a process of its own: its address and the process."""
    command = [sys.executable, "-m", "tests.benchmarks.serve_desk", str(folder), *arguments]
    environment = {**os.environ, "PYTHONPATH": str(HOME)}
    process = subprocess.Popen(
        command, cwd=HOME, env=environment, stdout=subprocess.PIPE, text=True
    )
    try:
        yield address_of(process), process
    finally:
        process.kill()
        process.wait()


def address_of(process: subprocess.Popen[str]) -> str:
    """What the desk prints when it is open."""
    assert process.stdout is not None
    for line in process.stdout:
        found = re.search(r"http://\S+", line)
        if found:
            return found[0]
    raise RuntimeError("the desk did not open")


@contextmanager
def browser() -> Generator[object]:
    """A Chromium without a window."""
    with sync_playwright() as playwright:
        path = chromium_path(playwright)
        launched = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
        yield launched
        launched.close()


def sit_down(launched, url: str, size: dict[str, int] = SIZE) -> Page:
    """A page at the desk, once its first point is drawn; times are taken from then on."""
    context = launched.new_context(viewport=size, bypass_csp=True, storage_state=toured(url))
    context.set_default_timeout(30_000)
    page = context.new_page()
    page.goto(url)
    page.wait_for_selector(".row.current")
    page.evaluate(WATCH)
    page.wait_for_function("gruber.compareState().drawn.whole")
    return page


def press_for_point(page: Page, key: str) -> tuple[float, float]:
    """Press a key: milliseconds until another point is drawn, and until all its tiles are."""
    before = page.evaluate("gruber.compareState().drawn.key")
    page.keyboard.press(key)
    page.wait_for_function(NEW_POINT, arg=before, polling=20)
    return tuple(
        page.evaluate(
            """before => { const there = watched.log.findLast(e => e.key !== before);
            return [there.first - watched.pressed, there.whole - watched.pressed]; }""",
            before,
        )
    )


def click_for_mark(page: Page, right: float, down: float) -> float:
    """Click beside the middle of the scan: milliseconds until the mark is drawn there."""
    before = page.evaluate("watched.log.at(-1).name")
    box = page.locator('.pane[data-pane="right"]').bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + box["width"] / 2 + right, box["y"] + box["height"] / 2 + down)
    page.wait_for_function(NEW_MARK, arg=before, polling=20)
    return page.evaluate("watched.log.findLast(e => e.name).first - watched.pressed")


def told(times: list[float]) -> str:
    """Median, 95 % and largest."""
    return (
        f"median {np.median(times):.0f} ms, 95 % {np.percentile(times, 95):.0f} ms, "
        f"largest {max(times):.0f} ms (n {len(times)})"
    )
