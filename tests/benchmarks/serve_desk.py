"""Open the benchmark's desk in a process of its own, to be measured, or killed, from another."""

import argparse
import threading
from dataclasses import replace
from pathlib import Path

from app.desk.wiring import open_desk
from tests.benchmarks.desk_film import with_film
from tests.benchmarks.large_desk import Size, large_inputs, say, with_huge_scan


def main() -> None:
    """Print the address, then serve until the standard input closes."""
    asked = argparse.ArgumentParser()
    asked.add_argument("folder", type=Path)
    asked.add_argument("--port", type=int, default=0)
    asked.add_argument("--proposals", type=int, default=1500)
    asked.add_argument("--ties", type=int, default=3000)
    asked.add_argument("--photos", type=int, nargs=2)
    asked.add_argument("--huge-px", type=int, default=0)
    asked.add_argument("--film", action="store_true", help="marks, and patches to compare")
    given = asked.parse_args()
    size = Size(proposals=given.proposals, ties=given.ties)
    if given.photos:
        strips, along = given.photos
        size = replace(size, strips=strips, photos_a_strip=along)
    inputs = large_inputs(given.folder, size, port=given.port)
    if given.huge_px:
        inputs = with_huge_scan(inputs, given.huge_px)
    if given.film:
        inputs = with_film(inputs, given.folder)
    with open_desk(inputs) as desk:
        say(desk.url)
        threading.Event().wait()


if __name__ == "__main__":
    main()
