"""How fast a lesson's picture follows its slider, as the page itself measures it in Chromium.

Run: python -m tests.benchmarks.bench_lessons
"""

import sys
import time

import numpy as np

from app.teaching import find_lessons, open_teaching
from tests.benchmarks.desk_browser import browser, told
from tests.benchmarks.large_desk import say_row

PROMISES_MS = (100, 250)
"""Median, and the time that 95 of 100 moves keep."""
MOVES = 20
READY = "#figures b"


def main() -> int:
    """Every lesson's first slider, moved twenty times; 1 when a promise is broken."""
    lessons, waits = find_lessons(), []
    with open_teaching(lessons, "127.0.0.1", 0) as teaching, browser() as chromium:
        # The page forbids scripts made of text, by which Playwright waits.
        page = chromium.new_page(bypass_csp=True)
        for name, lesson in lessons.items():
            page.goto(f"{teaching.url}&lesson={name}")
            page.wait_for_selector(READY)
            slider = next(
                s
                for s in lesson.sliders
                if not s.moved_in and not s.is_switch and page.locator(f"#slider-{s.name}").count()
            )
            page.evaluate("gruber.state.waits.length = 0")
            for value in np.linspace(slider.low, slider.high, MOVES):
                page.locator(f"#slider-{slider.name}").fill(f"{value:.6g}")
                page.wait_for_function("!gruber.state.asking")
                time.sleep(0.01)
            waits += page.evaluate("gruber.state.waits")
            say_row(name, told(page.evaluate("gruber.state.waits")))
    say_row("all lessons", told(waits))
    median, most = PROMISES_MS
    return int(np.median(waits) > median or np.percentile(waits, 95) > most)


if __name__ == "__main__":
    sys.exit(main())
