"""Processor seconds and memory of a whole run, stage by stage, as blocks grow.

Run: python -m tests.benchmarks.bench_rolls [--size tiny|small] [--seed N] [--keep FOLDER] PHOTOS...

Blocks of about so many photos, twice as many in a strip as there are strips. Each stage runs in a
program of its own, so that its peak of memory is its own; localisation, ties and control are
repeated until they settle and count as one. The exponent is that of the seconds by the photos,
from the first block to the last: 1 is in proportion.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from app.project import read_project
from app.run import STAGE_NAMES
from core.synthetic.archive import make_block
from core.synthetic.options import SyntheticOptions
from core.synthetic.truth import judge_control, judge_orientations, read_truth
from sessions.session import HIDDEN, Session
from tests.benchmarks.large_desk import say

STAGES = (
    "scans",
    "georeference",
    "reference",
    "control",
    "adjustment",
    "orthos",
    "mosaic",
    "report",
)
"""What is run one after the other; control with what it repeats."""
assert set(STAGES) < set(STAGE_NAMES)


def plan_of(photos: int, size: str, seed: int) -> SyntheticOptions:
    """A flight of about so many photos; two strips of three at least."""
    strips = max(2, round(np.sqrt(photos / 2)))
    return SyntheticOptions(
        size, seed=seed, strips=strips, photos_per_strip=max(3, round(photos / strips))
    )


def run_stage(folder: Path, stage: str) -> tuple[float, float]:
    """Processor seconds and peak of memory, GiB, of one stage."""
    words = [sys.executable, "-m", "gruber", "run", str(folder), "--until", stage]
    with (folder / "run.log").open("ab") as log:
        child = subprocess.Popen(words, stdout=log, stderr=log)
        _, status, used = os.wait4(child.pid, 0)
    # The desk may find doubts in a block (1); anything else is a failure.
    assert os.waitstatus_to_exitcode(status) in (0, 1), (folder, stage)
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 2**20


def row(folder: Path, options: SyntheticOptions) -> list[float]:
    """Seconds of each stage of a block that is made if it is not there; nothing of it is kept."""
    if not (folder / "block.toml").exists():
        # In a program of its own: what is started here counts the memory held here as its peak.
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as other:
            other.submit(make_block, folder, options).result()
    for name in (HIDDEN, "results"):
        shutil.rmtree(folder / name, ignore_errors=True)
    (folder / "session.gpkg").unlink(missing_ok=True)
    found = [run_stage(folder, stage) for stage in STAGES]
    seconds, peaks = (list(values) for values in zip(*found, strict=True))
    project = read_project(folder)
    report = Session.open(project.folder, "bench").products.latest_value("adjustment")
    truth = read_truth(folder)
    photos, control = judge_orientations(truth, report.block), judge_control(truth, report.block)
    off = float(np.sqrt(np.mean(np.square(photos.ground_m))))
    count = options.strips * options.photos_per_strip
    cells = [f"{count}", *(f"{one:.0f}" for one in seconds), f"{sum(seconds):.0f}"]
    cells += [f"{max(peaks):.2f} ({STAGES[int(np.argmax(peaks))]})"]
    cells += [f"{len(photos.photo_ids)}", f"{off:.2f} m", f"{control.wrong} of {control.used}"]
    say(f"| {' | '.join(cells)} |")
    return [*seconds, sum(seconds)]


def main() -> int:
    """A row for each block, and the exponents."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("photos", nargs="+", type=int)
    parser.add_argument("--size", default="tiny", choices=("tiny", "small"))
    parser.add_argument("--seed", type=int, default=9001)
    parser.add_argument("--keep", type=Path, help="where the blocks are kept; else they are not")
    given = parser.parse_args()
    say(
        "| photos | " + " | ".join(STAGES) + " | all | peak GiB | oriented | ground error | wrong |"
    )
    say("|---" * (len(STAGES) + 6) + "|")
    with tempfile.TemporaryDirectory() as temporary:
        rows = [
            row(
                (given.keep or Path(temporary)) / f"{given.size}-{count}",
                plan_of(count, given.size, given.seed),
            )
            for count in given.photos
        ]
    if len(rows) > 1:
        growth = np.log(np.array(rows[-1]) / rows[0]) / np.log(given.photos[-1] / given.photos[0])
        say("| exponent | " + " | ".join(f"{one:.2f}" for one in growth) + " | | | | |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
