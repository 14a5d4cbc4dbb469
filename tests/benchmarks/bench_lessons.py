"""How fast a lesson's picture follows its slider: alone in Chromium, and among a class of thirty.

Run: python -m tests.benchmarks.bench_lessons
"""

import asyncio
import os
import subprocess
import sys
import threading
import time
from collections.abc import Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import aiohttp
import numpy as np

from app.found_lessons import find_lessons
from app.lessons.sheet import Lesson, Slider
from tests.benchmarks.desk_browser import HOME, address_of, browser, told
from tests.benchmarks.large_desk import say_row

PROMISES_MS = (100, 250)
"""Median, and the time that 95 of 100 moves keep."""
CLASS, CLASS_MS = 30, 1000
"""Students besides the one in Chromium, and the time that every move of either keeps."""
PAUSE_S = 1.0
"""A student looks so long, at most, at what was moved."""
MOVES = 20
READY = "#figures b"


@contextmanager
def taught() -> Generator[str]:
    """`gruber teach` in a process of its own: its address."""
    command = [sys.executable, "-m", "gruber", "teach", "--no-browser", "--port", "0"]
    environment = {**os.environ, "PYTHONPATH": str(HOME), "PYTHONUNBUFFERED": "1"}
    process = subprocess.Popen(
        command, cwd=HOME, env=environment, stdout=subprocess.PIPE, text=True
    )
    try:
        yield address_of(process)
    finally:
        process.kill()
        process.wait()


def sliders_of(lesson: Lesson) -> list[Slider]:
    """Those that stand beside the drawing."""
    return [one for one in lesson.sliders if not one.moved_in and not one.is_switch]


def moved_in(page, url: str, lesson: Lesson, moves: int) -> list[float]:
    """The first slider of a lesson over its range: milliseconds until each picture stood."""
    page.goto(f"{url}&lesson={lesson.name}")
    page.wait_for_selector(READY)
    slider = next(one for one in sliders_of(lesson) if page.locator(f"#slider-{one.name}").count())
    page.evaluate("gruber.state.waits.length = 0")
    for value in np.linspace(slider.low, slider.high, moves):
        page.locator(f"#slider-{slider.name}").fill(f"{value:.6g}")
        page.wait_for_function("!gruber.state.asking")
        time.sleep(0.01)
    return page.evaluate("gruber.state.waits")


async def learn(url: str, lesson: Lesson, seed: int, over: threading.Event) -> list[float]:
    """One student without a browser, who moves sliders as the page would."""
    rng, waits = np.random.default_rng(seed), list[float]()
    jar = aiohttp.CookieJar(unsafe=True)
    async with aiohttp.ClientSession(cookie_jar=jar) as session:
        async with session.get(url) as page:
            base = page.url.origin()
        state = lesson.start
        while not over.is_set():
            slider = sliders_of(lesson)[rng.integers(len(sliders_of(lesson)))]
            steps = round((slider.high - slider.low) / slider.step)
            value = slider.low + slider.step * int(rng.integers(steps + 1))
            state[slider.name] = min(value, slider.high)
            began = time.perf_counter()
            asked = {"state": state, "truth": False}
            async with session.post(base / "lesson" / lesson.name, json=asked) as answer:
                assert answer.status == 200, await answer.text()
                await answer.read()
            waits.append(1000 * (time.perf_counter() - began))
            await asyncio.sleep(rng.uniform(0, PAUSE_S))
    return waits


def sit_class(url: str, lessons: list[Lesson], over: threading.Event) -> list[float]:
    """Thirty students at once, each at a lesson of the list in turn, until it is over."""

    async def all_of_them() -> list[list[float]]:
        students = (
            learn(url, lessons[number % len(lessons)], number, over) for number in range(CLASS)
        )
        return await asyncio.gather(*students)

    return [wait for each in asyncio.run(all_of_them()) for wait in each]


def main() -> int:
    """Every lesson's first slider, alone and in the class; 1 when a promise is broken."""
    lessons = list(find_lessons().values())
    alone, among = list[float](), list[float]()
    with taught() as url, browser() as chromium:
        # The page forbids scripts made of text, by which Playwright waits.
        page = chromium.new_page(bypass_csp=True)
        for lesson in lessons:
            waits = moved_in(page, url, lesson, MOVES)
            alone += waits
            say_row(lesson.name, told(waits))
        say_row("all lessons", told(alone))
        over = threading.Event()
        with ThreadPoolExecutor(1) as room:
            students = room.submit(sit_class, url, lessons, over)
            for lesson in lessons:
                among += moved_in(page, url, lesson, MOVES // 4)
            over.set()
            others = students.result()
        say_row(f"all lessons in Chromium, beside {CLASS} students", told(among))
        say_row(f"the {CLASS} students", told(others))
    median, most = PROMISES_MS
    slow = np.median(alone) > median or np.percentile(alone, 95) > most
    return int(slow or max(*among, *others) > CLASS_MS)


if __name__ == "__main__":
    sys.exit(main())
