"""How fast the desk answers: 24 scans, 1,500 proposals, a real Chromium, adjustment beside.

Run: python -m tests.benchmarks.bench_desk [keys] [click] [filter] [large] [coarse] [ties] [sigma]
     [roll] [--flat]

`roll` is a desk of 406 photos and 60,000 proposals beside that of 24 and 1,500; `--flat` leaves out
the 3D scene, whose frames keep the browser's only thread busy where there is no GPU.
"""

import os
import random
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import psutil
import rasterio
from playwright.sync_api import Page
from rasterio.transform import from_origin
from rasterio.windows import Window

from app.desk.wiring import open_desk
from core.raster.ortho import open_ortho
from tests.benchmarks.desk_browser import (
    browser,
    click_for_mark,
    press_for_point,
    served,
    sit_down,
    told,
)
from tests.benchmarks.large_desk import NORTH, WEST, say, say_row
from tests.browser.conftest import scene_of
from tests.browser.hands import press
from tests.ui.desk_block import desk_inputs
from ui.review.tiles import CoarseOrtho, Lattice

PROMISES_MS = {
    "keys": (150, 300),
    "click": 60,
    "filter": 100,
    "large": 1000,
    "ties": 5000,
    "sigma": 1000,
}
ROLL_RATIO = 1.5
"""Times that a desk of hundreds of photos may take, by those of the small one."""
ROLL = ("--photos", "14", "29", "--proposals", "60000", "--ties", "50000")


PAUSES_S = (0.2, 1.6)
"""Between two keys: so short that an adjustment is overtaken, so long that it comes in."""


def keys(folder: Path) -> bool:
    """A hundred decisions in a row, with adjustments running and coming in between."""
    with served(folder) as (url, _), browser() as chromium:
        page = at_desk(chromium, url)
        page.wait_for_timeout(5000)
        first, whole = decide(page, 100)
        decided = page.evaluate("gruber.parts.status.decided")
        came = page.evaluate("watched.adjusted")
    say_row("key to the new point drawn", told(first))
    say_row("key to the new point with all its tiles", told(whole))
    say(f"decided {decided}, {came} adjustments came in meanwhile")
    middle, most = PROMISES_MS["keys"]
    return bool(np.median(first) <= middle and np.percentile(first, 95) <= most)


def decide(page: Page, count: int) -> tuple[list[float], list[float]]:
    """So many decisions: milliseconds to the new point drawn, and to all its tiles."""
    rng, times = random.Random(6), list[tuple[float, float]]()
    for number in range(count):
        # What lies far off is asked about before it is accepted.
        far = page.evaluate("gruber.parts.point.figures.ratio > 3")
        times.append(press_for_point(page, ("nnnm" if far else "ynym")[number % 4]))
        page.wait_for_timeout(1000 * rng.uniform(*PAUSES_S))
    return [one for one, _ in times], [one for _, one in times]


def place(page: Page, count: int) -> list[float]:
    """So many clicks: milliseconds to the mark."""
    times = list[float]()
    for number in range(count):
        times.append(click_for_mark(page, (-60, 60, 0)[number % 3], (40, -40)[number % 2]))
        page.wait_for_timeout(400)
    return times


def click(folder: Path) -> bool:
    """Placing by a click."""
    with served(folder) as (url, _), browser() as chromium:
        page = at_desk(chromium, url)
        page.wait_for_timeout(5000)
        times = place(page, 30)
    say_row("click to the placed mark", told(times))
    return bool(np.median(times) <= PROMISES_MS["click"])


FILTERED = """state => {
  const frame = () => new Promise(requestAnimationFrame);
  const chip = document.querySelector(`.chip[data-state=${state}]`);
  window.filtered = new Promise(resolve => chip.addEventListener("click", async () => {
    while (!chip.classList.contains("on")) await frame();
    await frame();
    await frame();
    const painted = performance.now() - watched.pressed;
    while (gruber.parts.queue.filter.state !== state) await frame();
    resolve([painted, performance.now() - watched.pressed]);
  }, { once: true }));
}"""
"""Milliseconds from the pointer's button until the rows are on the screen (two frames), and until
the desk agrees."""


def click_filter(page: Page, state: str) -> list[float]:
    """A filter chosen by hand: the scene gives way to a pointer, not to a script."""
    page.evaluate(FILTERED, state)
    page.click(f".chip[data-state={state}]")
    return page.evaluate("filtered")


def filtered(folder: Path) -> bool:
    """A filter over 5,000 rows."""
    with served(folder, "--proposals", "5000") as (url, _), browser() as chromium:
        page = at_desk(chromium, url)
        page.wait_for_timeout(5000)
        rows = page.evaluate("gruber.parts.rows.length")
        pairs = [
            click_filter(page, state)
            for _ in range(6)
            for state in ("unused", "dubious", "all", "open")
        ]
    painted, answered = np.array(pairs).T
    say_row(f"filter of {rows} rows, on screen", told(painted))
    say_row("filter, and the desk's answer", told(answered))
    return bool(np.median(painted) <= PROMISES_MS["filter"])


def large(folder: Path) -> bool:
    """The first pixels of a scan of 25,000 pixels a side, never looked at before."""
    with served(folder, "--photos", "2", "3", "--proposals", "150", "--huge-px", "25000") as (
        url, _), browser() as chromium:  # fmt: skip
        page = at_desk(chromium, url)
        name = page.evaluate("gruber.parts.rows.map(row => row[1]).sort()[0]")
        other = page.evaluate("gruber.parts.rows.map(row => row[1]).sort().at(-1)")
        page.select_option("#sieve-photo", other)
        page.wait_for_function(
            "n => gruber.compareState().drawn.whole && gruber.compareState().drawn.key.endsWith(n)",
            arg=other,
        )
        page.evaluate("name => document.querySelector('#sieve-photo').value = name", name)
        times = page.evaluate(
            """name => new Promise((done) => {
              const begun = performance.now();
              const select = document.querySelector('#sieve-photo');
              select.dispatchEvent(new Event('change'));
              let first = 0;
              const look = () => {
                const drawn = gruber.compareState().drawn;
                if (!first && drawn.key?.endsWith(name)) first = performance.now();
                if (drawn.key?.endsWith(name) && drawn.whole) return done([first - begun, performance.now() - begun]);
                setTimeout(look, 5);
              };
              look();
            })""",  # noqa: E501
            name,
        )
        side = page.evaluate("gruber.parts.point.scan.size[0]")
    say_row("large scan without overviews, all tiles in sight", f"{side} px: {times[1]:.0f} ms")
    return bool(times[1] <= PROMISES_MS["large"])


def coarse(folder: Path) -> bool:
    """The coarsest tiles of an ortho without overviews: processor time, which other work spares."""
    folder.mkdir(parents=True)
    side, row = 10_000, np.random.default_rng(1).integers(0, 255, (3, 500, 10_000), np.uint8)
    profile = {"driver": "GTiff", "dtype": "uint8", "count": 3, "width": side, "height": side,
               "crs": "EPSG:5514", "transform": from_origin(WEST, NORTH, 0.25, 0.25),
               "tiled": True, "blockxsize": 256, "blockysize": 256}  # fmt: skip
    with rasterio.open(folder / "ortho.tif", "w", **profile) as file:
        for first in range(0, side, 500):
            file.write(row, window=Window(0, first, side, 500))
    ortho = open_ortho([folder / "ortho.tif"], "EPSG:5514")
    small, lattice = CoarseOrtho(ortho), Lattice.over(ortho.bounds, 0.25)
    grids = [lattice.tile(lattice.levels - 1, *place) for place in ((0, 0), (1, 0), (0, 1), (1, 1))]
    before = _processor_ms(lambda: [ortho.read_colour(grid) for grid in grids])
    read = _processor_ms(small.prepare)
    after = _processor_ms(lambda: [small.read_colour(grid) for grid in grids])
    say(
        f"ortho of {side} px without overviews, four coarsest tiles: {before:.0f} ms from its "
        f"files, {after:.0f} ms once it was read in the background ({read:.0f} ms)"
    )
    return after < before / 10


def _processor_ms(work: Callable[[], object]) -> float:
    begun = time.process_time()
    work()
    return 1000 * (time.process_time() - begun)


def ties(folder: Path) -> bool:
    """A hundred thousand tie points and their vectors, from the click to the picture."""
    with served(folder, "--ties", "100000") as (url, _), browser() as chromium:
        page = at_desk(chromium, url)
        scene = scene_of(page)
        page.wait_for_timeout(8000)
        page.click('[data-grow="block"]')
        begun = time.perf_counter()
        page.click('[data-layer="ties"]')
        page.click('[data-layer="tie_vectors"]')
        scene.wait_for_function("!!window.__viserMutable.nodeRefFromName['/tie_vectors']")
        here = time.perf_counter() - begun
        page.locator("#scene").screenshot(timeout=90_000)
        painted = time.perf_counter() - begun
    printed = f"in the scene {1000 * here:.0f} ms, painted {1000 * painted:.0f} ms"
    say_row("100,000 tie points with vectors, painted", printed)
    return bool(1000 * painted <= PROMISES_MS["ties"])


def sigma(folder: Path) -> bool:
    """A decision until sigma nought changes on the small block."""
    inputs = desk_inputs(folder)
    times = []
    with open_desk(inputs) as desk, browser() as chromium:
        page = sit_down(chromium, desk.url)
        scene_of(page)
        for _ in range(10):
            for key in ("n", "u"):
                times.append(1000 * press(page, key)[2])
                page.wait_for_timeout(200)
    inputs.session.close()
    say_row("decision to new sigma nought", told(times))
    return bool(np.median(times) <= PROMISES_MS["sigma"])


def roll(folder: Path) -> bool:
    """Decisions, clicks and filters over hundreds of photos, beside the small block's."""
    medians: list[list[float]] = []
    for name, arguments in (("small", ()), ("roll", ROLL)):
        begun = time.perf_counter()
        with served(folder / name, *arguments) as (url, process), browser() as chromium:
            page = at_desk(chromium, url)
            opened = time.perf_counter() - begun
            page.wait_for_timeout(5000)
            sets = [*decide(page, 40), place(page, 20)]
            states = ("unused", "dubious", "all", "open") * 3
            sets += zip(*(click_filter(page, state) for state in states), strict=True)
            rows = page.evaluate("gruber.parts.rows.length")
            peak = psutil.Process(process.pid).memory_info().rss / 2**30
        say(f"{name}: {rows} rows, opened after {opened:.0f} s, {peak:.2f} GiB")
        medians.append([float(np.median(times)) for times in sets])
        for what, times in zip(ROLL_FIGURES, sets, strict=True):
            say_row(f"{name}: {what}", told(list(times)))
    ratios = np.divide(medians[1], medians[0])
    say(f"roll by small: {', '.join(f'{one:.2f}' for one in ratios)}")
    return bool(ratios.max() <= ROLL_RATIO)


ROLL_FIGURES = (
    "key to the new point drawn",
    "key to all its tiles",
    "click to the placed mark",
    "filter on screen",
    "filter, and the desk's answer",
)


def at_desk(chromium: object, url: str) -> Page:
    """A page at the desk, without its scene when asked for `--flat`."""
    page = sit_down(chromium, url)
    if "--flat" in sys.argv:
        page.add_style_tag(content="#scene-room { display: none }")
    return page


BENCHES: dict[str, Callable[[Path], bool]] = {
    "keys": keys,
    "click": click,
    "filter": filtered,
    "large": large,
    "coarse": coarse,
    "ties": ties,
    "sigma": sigma,
    "roll": roll,
}


def main() -> int:
    """Run what is asked for, all by default; 1 when a promise is broken."""
    asked = [name for name in sys.argv[1:] if name in BENCHES] or list(BENCHES)
    say(f"load of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    kept = True
    with tempfile.TemporaryDirectory() as temporary:
        for name in asked:
            begun = time.perf_counter()
            kept = BENCHES[name](Path(temporary) / name) and kept
            say(f"  [{name}: {time.perf_counter() - begun:.0f} s, load {os.getloadavg()[0]:.1f}]")
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
