"""Real browsers at the desk: two that decide at once, and one whose desk is killed under it.

Run: python -m tests.benchmarks.prove_desk_browsers [pages] [back] [--count N] [--times N]

pages  two Chromiums, 500 keystrokes each at the same time: what is on disk, and is any doubled?
back   `kill -9` of the desk and a new one on the same port: seconds from its first answer until
       the page shows the same point with all its tiles, untouched by a hand

24 scans and 1,500 proposals.
"""

import argparse
import multiprocessing
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
from playwright.sync_api import Page
from playwright.sync_api import TimeoutError as PlaywrightTimeout

from sessions.decisions import Accept, MarkDubious, Recorded, Reject
from sessions.session import Session
from tests.benchmarks.desk_browser import browser, served, sit_down
from tests.benchmarks.large_desk import say_row

NAMES = ("berta", "cyril")
SMALL = {"width": 1366, "height": 768}
NARROW = {"width": 1060, "height": 1000}
"""The 3D scene is a small part of it: without a GPU it keeps the browser's only thread busy."""
BACK_S = 3.0
WAIT_S = 1200
NEXT = "before => gruber.parts.point && gruber.parts.point.key.join('|') !== before"
PATIENCE_MS, TURNS = 2000, 15
HERE = "gruber.parts.point.key.join('|')"
THERE = """place => !window.killed && window.gruber?.parts.point?.key.join('|') === place
  && gruber.compareState().drawn.key === gruber.parts.point.key.join('|')
  && gruber.compareState().drawn.whole"""


def pages(count: int) -> bool:
    """Two browsers, each under a name of its own, none waiting for the other."""
    spawn = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "desk"
        with served(folder) as (url, _):
            begun, gate = time.perf_counter(), spawn.Barrier(len(NAMES))
            sitters = [
                spawn.Process(target=decide, args=(url, name, count, gate)) for name in NAMES
            ]
            for sitter in sitters:
                sitter.start()
            for sitter in sitters:
                sitter.join(WAIT_S)
            seconds = time.perf_counter() - begun
        kept = recorded(folder)
    by_name = dict(Counter(item.who for item in kept))
    judged = [item.decision for item in kept]
    places = [
        (one.point_id, one.photo_id)
        for one in judged
        if isinstance(one, Accept | Reject | MarkDubious)
    ]
    doubled = len(places) - len(set(places))
    printed = f"{count} keystrokes each: {len(kept)} decisions on disk, {by_name}, "
    printed += f"{len(set(places))} measurements judged, {doubled} twice; {seconds:.0f} s"
    say_row("two Chromiums deciding at the same time", printed)
    whole = len(kept) == len(places) == len(NAMES) * count
    return whole and doubled == 0 and set(by_name.values()) == {count}


def decide(url: str, name: str, count: int, gate) -> None:
    """One browser: a name, then one keystroke after the other as soon as the next point shows."""
    with browser() as chromium:
        page = sit_down(chromium, url, SMALL)
        page.click("#who")
        page.fill("#name-field", name)
        page.keyboard.press("Enter")
        page.wait_for_function("n => gruber.parts.status.operator === n", arg=name)
        page.wait_for_function("!document.querySelector('dialog[open]')")
        page.set_viewport_size(NARROW)
        gate.wait(WAIT_S)
        for number in range(count):
            before = page.evaluate(HERE)
            press_until_next(page, "ynm"[number % 3], before)


def press_until_next(page: Page, key: str, before: str) -> None:
    """A verdict by key; said again where the desk asks back, or where the other one was faster."""
    for _ in range(TURNS):
        page.keyboard.press(key)
        with suppress(PlaywrightTimeout):
            page.wait_for_function(NEXT, arg=before, polling=10, timeout=PATIENCE_MS)
            return
    raise AssertionError(f"nothing came of {key} at {before}")


def back(times: int) -> bool:
    """The desk killed and opened again; nobody touches the page."""
    seconds: list[float] = []
    with tempfile.TemporaryDirectory() as temporary, browser() as chromium:
        folder = Path(temporary) / "desk"
        desk = served(folder)
        url, process = desk.__enter__()
        page = sit_down(chromium, url)
        page.select_option("#sort-column", "score")
        for number in range(times):
            here = walked(page, number)
            page.evaluate("window.killed = true")
            process.kill()
            process.wait()
            page.wait_for_selector("#lost:not([hidden])")
            desk = served(folder, "--port", str(urlsplit(url).port))
            _, process = desk.__enter__()
            begun = time.perf_counter()
            page.wait_for_function(THERE, arg=here, polling=10)
            seconds.append(time.perf_counter() - begun)
        desk.__exit__(None, None, None)
    printed = f"{times} times: median {np.median(seconds):.1f} s, largest {max(seconds):.1f} s"
    say_row("page back by itself after the desk was killed", printed)
    return max(seconds) <= BACK_S


def walked(page: Page, number: int) -> str:
    """Some steps along the queue and a decision: where the page is then."""
    for key in ("j" * (1 + number % 4), "m")[number % 2]:
        before = page.evaluate(HERE)
        page.keyboard.press(key)
        page.wait_for_function(NEXT, arg=before, polling=10)
    page.wait_for_function("gruber.compareState().drawn.whole")
    return page.evaluate(HERE)


def recorded(folder: Path) -> tuple[Recorded, ...]:
    """What is on disk, as another reader finds it."""
    with Session.open(folder, "reader") as session:
        return session.decisions()


def main() -> int:
    """Run what is asked for, both by default; 1 when a promise is broken."""
    asked = argparse.ArgumentParser()
    asked.add_argument("proofs", nargs="*", choices=["pages", "back", []])
    asked.add_argument("--count", type=int, default=500)
    asked.add_argument("--times", type=int, default=20)
    given = asked.parse_args()
    proofs: dict[str, Callable[[], bool]] = {
        "pages": lambda: pages(given.count),
        "back": lambda: back(given.times),
    }
    kept = [proofs[name]() for name in given.proofs or proofs]
    return 0 if all(kept) else 1


if __name__ == "__main__":
    sys.exit(main())
