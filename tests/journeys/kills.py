"""`kill -9` a thousand times at random over stages, decisions, exports, sheets and reports.

`python -m tests.journeys.kills --kills 1000 --seed 1 BLOCK` works on a copy of a block that was
run; with `--job readings` only a reviewer is killed, who reads the places of a plan. After each
kill the session opens with every decision that was said to be on the disk, all files of the results
are whole, and nothing is left over. At the end the block is run through: its tables and rasters are
those of a second copy that was given the same decisions in peace.
"""

import argparse
import json
import os
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyogrio
import rasterio

import app.verbs.exchange
import app.verbs.run  # noqa: F401
from app.check_plan import PlanWish, plan_checks
from app.cli import main as gruber
from app.exchange import format_names
from app.project import read_project
from app.run import STAGE_NAMES, WHEN_ASKED
from core.raster.grid import refuse_incomplete
from sessions.checks import version_on_disk
from sessions.decisions import Accept, ReadCheck, Reject, Withdraw
from sessions.session import Session
from tests.journeys.copies import BlockCopy
from tests.journeys.test_kills import TABLES, left_over, pixels

LONGEST = 2.5
"""Seconds after which a job is killed at the latest."""
SHEETS = '\n[sheets]\nrule = "sm5"\n'


class Killed:
    """A block whose jobs are killed, and what is known to be on its disk."""

    def __init__(self, folder: Path, rng: np.random.Generator, job: str = "") -> None:
        self.copy, self.rng, self.said, self.job = BlockCopy(folder), rng, set[int](), job
        with Session.open(folder, "reader") as session:
            made = plan_checks(read_project(folder), session, PlanWish())
        self.places = made.plan.places
        with Session.open(folder, "reader") as session:
            report = session.products.latest_value("control").report
            self.known = len(session.decisions())
        used = report.block.measurements.items()
        self.pairs = [key for key, value in used if value.used]

    def jobs(self) -> dict[str, Callable[[int], object]]:
        """What is killed; each is given where it may say how far it is."""
        folder = str(self.copy.folder)
        form = str(self.rng.choice(format_names(reads=False)))
        stage = str(self.rng.choice([one for one in STAGE_NAMES if one not in WHEN_ASKED]))
        out = str(self.copy.folder / "out" / form)
        return {
            "decisions": self.decide,
            "readings": self.read,
            f"export {form}": lambda _: gruber(["export", folder, "--to", form, "--out", out]),
            f"stage {stage}": lambda _: gruber(["run", folder, "--from", stage, "--workers", "1"]),
            "report": lambda _: gruber(["report", folder]),
            "sheets": lambda _: gruber(["run", folder, "--from", "sheets", "--workers", "1"]),
        }

    def decide(self, saying: int) -> None:
        """Decisions without end, each said once it is on the disk."""
        with Session.open(self.copy.folder, "operator") as session:
            number = 0
            for count in range(10_000):
                pair = self.pairs[(count * 7 + self.known) % len(self.pairs)]
                decision = Reject(*pair, "changed") if count % 7 == 3 else Accept(*pair)
                if count % 5 == 4:
                    decision = Withdraw(number)
                number = session.record(decision).decision_id
                os.write(saying, f"{number}\n".encode())

    def read(self, saying: int) -> None:
        """Readings without end, now and then of places where nothing is to be seen."""
        with Session.open(self.copy.folder, "reviewer") as session:
            version = version_on_disk(session.products)
            for count in range(10_000):
                place = self.places[(count * 7 + self.known) % len(self.places)]
                seen = None if count % 6 == 5 else (place.east + 0.4, place.north - 0.2)
                there = None if seen is None else (place.east, place.north)
                why = "changed" if seen is None else ""
                said = session.record(ReadCheck(place.place_id, seen, there, version, why))
                os.write(saying, f"{said.decision_id}\n".encode())

    def kill_one(self) -> tuple[str, bool, list[str]]:
        """The job, whether it was killed before its end, and what was wrong afterwards."""
        jobs = self.jobs()
        names = [one for one in jobs if one.startswith(self.job)]
        name = names[int(self.rng.integers(len(names)))]
        most = {"decisions": 0.05, "readings": 0.5}.get(name, LONGEST)
        heard, saying = os.pipe()
        child = os.fork()
        if child == 0:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, 1)
            os.dup2(nowhere, 2)
            jobs[name](saying)
            os._exit(0)
        os.close(saying)
        time.sleep(self.rng.uniform(0, most))
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        with os.fdopen(heard) as lines:
            told = {int(line) for line in lines}
        return name, os.WIFSIGNALED(status), self.wrong(told)

    def wrong(self, told: set[int]) -> list[str]:
        """What is not as promised after a kill."""
        found: list[str] = []
        self.said |= told
        with Session.open(self.copy.folder, "reader") as session:
            numbers = [one.decision_id for one in session.decisions()]
        if numbers != list(range(1, len(numbers) + 1)):
            found.append(f"decisions {numbers}")
        if not self.said <= set(numbers) or not self.known <= len(numbers):
            found.append(f"decisions lost: {sorted(self.said - set(numbers))}")
        if len(numbers) > self.known + len(told) + 1:
            found.append("decisions made up")
        self.known = len(numbers)
        found += [f"left over {path}" for path in left_over(self.copy)]
        for path in [*self.copy.results.rglob("*"), *(self.copy.folder / "out").rglob("*")]:
            if path.is_file() and (cause := half(path)):
                found.append(f"{path}: {cause}")
        return found


def half(path: Path) -> str:
    """What is wrong with a file that was written; empty where it is whole."""
    try:
        if path.suffix == ".tif":
            refuse_incomplete(path, 0)
            with rasterio.open(path) as file:
                file.checksum(1)
        elif path.suffix in (".json", ".geojson"):
            json.loads(path.read_text())
        elif path.suffix == ".gpkg":
            pyogrio.list_layers(path)
        elif path.suffix == ".csv" and not path.read_bytes().endswith(b"\n"):
            return "cut off"
    except (OSError, ValueError, RuntimeError) as error:
        return repr(error)
    return ""


def compare(killed: BlockCopy, calm: BlockCopy) -> list[str]:
    """Tables and rasters of the results that differ."""
    found = [
        name
        for name in TABLES
        if (killed.results / name).read_bytes() != (calm.results / name).read_bytes()
    ]
    rasters = sorted(path.relative_to(calm.results) for path in calm.results.rglob("*.tif"))
    there = sorted(path.relative_to(killed.results) for path in killed.results.rglob("*.tif"))
    if rasters != there:
        return [*found, f"rasters {set(rasters) ^ set(there)}"]
    return found + [
        str(one)
        for one in rasters
        if not np.array_equal(pixels(killed.results / one), pixels(calm.results / one))
    ]


def main() -> int:
    """The long run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("block", type=Path)
    parser.add_argument("--kills", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--job", default="", help="kill no other job: decisions, readings, ...")
    given = parser.parse_args()
    room = Path(tempfile.mkdtemp(prefix="kills-"))
    began, kills, faults = time.monotonic(), Counter[str](), 0
    for name in ("calm", "killed"):
        shutil.copytree(given.block, room / name)
        with (room / name / "block.toml").open("a") as file:
            file.write(SHEETS)
    work = Killed(room / "killed", np.random.default_rng(given.seed), given.job)
    while kills.total() < given.kills:
        job, was_killed, wrong = work.kill_one()
        kills[job.split()[0]] += was_killed
        faults += len(wrong)
        for line in wrong:
            sys.stdout.write(f"{given.seed}: {job}: {line}\n")
            sys.stdout.flush()
    with (
        Session.open(room / "killed", "reader") as session,
        Session.open(room / "calm", "operator") as other,
    ):
        first = len(other.decisions())
        for recorded in session.decisions()[first:]:
            other.record(recorded.decision, operator=recorded.who)
    for name in ("calm", "killed"):
        assert gruber(["run", str(room / name), "--workers", "2"]) == 0
    differing = compare(BlockCopy(room / "killed"), BlockCopy(room / "calm"))
    shutil.rmtree(room)
    seconds = time.monotonic() - began
    sys.stdout.write(f"{dict(kills)}, {work.known} decisions, {faults} faults, {seconds:.0f} s\n")
    sys.stdout.write(f"differing results: {differing}\n")
    return int(faults > 0 or bool(differing))


if __name__ == "__main__":
    sys.exit(main())
