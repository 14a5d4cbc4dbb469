"""One list of blocks by every executor of `gruber batch`, also while a cluster is killed.

`python -m tests.journeys.batches --seeds 1-12 --kills 5` makes synthetic blocks and runs copies of
them, one after the other in the same place: in threads, in processes, by two workers of a Dask
cluster. Then workers of such a cluster are killed at random times and others put in their place;
then its scheduler, again and again, with a whole new cluster and the same command after each. Every
byte of what is made has to be that of the first run, as `prove_same` compares them, and nothing may
be left over. Ends with 1 when anything differs.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from app.batch import EXECUTORS
from core.synthetic.archive import make_block
from core.synthetic.options import SyntheticOptions
from core.synthetic.truth import read_truth
from tests.benchmarks.prove_same import differing, everything
from tests.journeys.copies import REPOSITORY, BlockCopy, copied, nearly_placed
from tests.journeys.test_kills import left_over

WORKERS = 2
AGAIN = 10
"""Calls after which a batch that does not end well is given up."""
PATIENCE_S = 3600.0
ENVIRONMENT = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(REPOSITORY)}


def begun(*words: object, **how: Any) -> "subprocess.Popen[str]":
    """A program of Python's, as a process of its own."""
    command = [sys.executable, "-m", *map(str, words)]
    return subprocess.Popen(command, text=True, env=ENVIRONMENT, **how)


@dataclass
class Cluster:
    """A scheduler and two workers, without anybody who would start them again."""

    folder: Path
    address: str = ""
    scheduler: "subprocess.Popen[str] | None" = None
    workers: "list[subprocess.Popen[str]]" = field(default_factory=list)

    def start(self) -> None:
        """All three; back once the scheduler answers."""
        told = self.folder / "scheduler.json"
        told.unlink(missing_ok=True)
        listed = ("--scheduler-file", told)
        self.scheduler = self._member(
            "scheduler", "--port", 0, "--dashboard-address", ":0", *listed
        )
        while not self.address:
            assert self.scheduler.poll() is None, (self.folder / "members.log").read_text()
            time.sleep(0.1)
            if told.is_file() and (text := told.read_text()):
                self.address = json.loads(text)["address"]
        self.workers = [self.worker() for _ in range(WORKERS)]

    def worker(self) -> "subprocess.Popen[str]":
        """One more."""
        return self._member("worker", self.address, "--nthreads", 1, "--no-nanny")

    def replace(self, number: int) -> None:
        """Kill a worker; another one comes."""
        self.workers[number].kill()
        self.workers[number].wait()
        self.workers[number] = self.worker()

    def close(self) -> None:
        """Kill whoever lives."""
        for member in (*self.workers, self.scheduler):
            if member is not None:
                member.kill()
                member.wait()

    def _member(self, *words: object) -> "subprocess.Popen[str]":
        with (self.folder / "members.log").open("a") as log:
            how = {"stdout": log, "stderr": log, "cwd": self.folder}
            return begun("dask", *words, "--no-dashboard", **how)


@contextmanager
def cluster(room: Path) -> Generator[Cluster]:
    """A cluster for one call or several."""
    folder = Path(tempfile.mkdtemp(prefix="cluster-", dir=room))
    made = Cluster(folder)
    try:
        made.start()
        yield made
    finally:
        made.close()


class Archive:
    """Copies of made blocks, always in the same place."""

    def __init__(self, room: Path, given: argparse.Namespace) -> None:
        self.room, self.given = room, given
        self.folder = room / "archive"
        for seed in given.seeds:
            options = SyntheticOptions(given.size, seed=seed)
            make_block(room / "made" / str(seed), options)

    def lay(self, count: int) -> None:
        """Copies of the first so many blocks, as nobody has run them."""
        shutil.rmtree(self.folder, ignore_errors=True)
        for seed in self.given.seeds[:count]:
            made = self.room / "made" / str(seed)
            copy = copied(made, self.folder / str(seed), self.given.scans)
            nearly_placed(copy, read_truth(made))

    def call(self, executor: str, address: str = "") -> "subprocess.Popen[str]":
        """`gruber batch`, begun."""
        words = ["batch", self.folder, "--executor", executor, "--workers", WORKERS]
        with (self.room / "batch.log").open("a") as log:
            how = {"stdout": log, "stderr": log, "cwd": self.room}
            return begun("gruber", *words, "--scheduler", address, **how)

    def digests(self) -> dict[str, str]:
        """Of all that was made, block by block."""
        found: dict[str, str] = {}
        for block in sorted(path for path in self.folder.iterdir() if path.is_dir()):
            own = everything(block) | {str(one): "left over" for one in left_over(BlockCopy(block))}
            found |= {f"{block.name}/{name}": digest for name, digest in own.items()}
        return found


def in_peace(archive: Archive, executor: str) -> float:
    """Seconds of one undisturbed call over all blocks."""
    archive.lay(len(archive.given.seeds))
    if executor != "dask":
        began = time.monotonic()
        assert archive.call(executor).wait(PATIENCE_S) == 0
        return time.monotonic() - began
    with cluster(archive.room) as members:
        began = time.monotonic()
        assert archive.call(executor, members.address).wait(PATIENCE_S) == 0
        return time.monotonic() - began


def with_workers_killed(archive: Archive, each_s: float, rng: np.random.Generator) -> str:
    """Workers killed one after the other, in as many calls as it takes; what came of it."""
    archive.lay(archive.given.killed)
    kills, codes = 0, list[int]()
    while not codes or (codes[-1] != 0 and len(codes) < AGAIN):
        with cluster(archive.room) as members:
            batch = archive.call("dask", members.address)
            while (
                kills < archive.given.kills and ended_within(batch, rng.uniform(0, each_s)) is None
            ):
                members.replace(int(rng.integers(WORKERS)))
                kills += 1
            codes.append(batch.wait(PATIENCE_S))
    return f"{kills} workers killed, exit codes {codes}"


def with_scheduler_killed(archive: Archive, each_s: float, rng: np.random.Generator) -> str:
    """The scheduler killed in one call after the other; what came of it."""
    archive.lay(archive.given.killed)
    kills, codes, waits = 0, list[int](), list[float]()
    while not codes or (codes[-1] != 0 and len(codes) < AGAIN + archive.given.kills):
        with cluster(archive.room) as members:
            batch = archive.call("dask", members.address)
            until = rng.uniform(0, each_s)
            if kills < archive.given.kills and ended_within(batch, until) is None:
                assert members.scheduler is not None
                members.scheduler.kill()
                kills, began = kills + 1, time.monotonic()
                codes.append(batch.wait(PATIENCE_S))
                waits.append(time.monotonic() - began)
            else:
                codes.append(batch.wait(PATIENCE_S))
    told = ", ".join(f"{wait:.0f}" for wait in waits)
    return f"{kills} schedulers killed, exit codes {codes}, told after {told} s"


def ended_within(process: "subprocess.Popen[str]", seconds: float) -> int | None:
    """Its exit code; None where it goes on."""
    try:
        return process.wait(seconds)
    except subprocess.TimeoutExpired:
        return None


def seeds(text: str) -> list[int]:
    """`3-5` is 3, 4 and 5."""
    first, _, last = text.partition("-")
    return list(range(int(first), int(last or first) + 1))


def said(line: str) -> None:
    """One line at once, however it is read."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def told_apart(name: str, found: dict[str, str], first: dict[str, str], seconds: float) -> int:
    """Say what differs from the first run in the blocks that there are, and how often."""
    blocks = {key.split("/")[0] for key in found}
    apart = differing({k: v for k, v in first.items() if k.split("/")[0] in blocks}, found)
    said(f"{name}: {seconds:.0f} s, {len(blocks)} blocks, {len(found)} files, {len(apart)} differ")
    for path in apart:
        said(f"  {path}")
    return len(apart)


def main() -> int:
    """Run them all, print what differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=seeds, default=seeds("1-12"), help="one block for each")
    parser.add_argument("--size", default="tiny", choices=("tiny", "small"))
    parser.add_argument("--scans", type=int, default=6, help="the first so many of each block")
    parser.add_argument("--kills", type=int, default=5, help="of workers, and of schedulers")
    parser.add_argument("--killed", type=int, default=12, help="blocks of the runs with kills")
    parser.add_argument("--folder", type=Path, help="where everything is kept")
    given = parser.parse_args()
    room = (given.folder or Path(tempfile.mkdtemp(prefix="batches-"))).resolve()
    archive, first, apart, seconds = Archive(room, given), dict[str, str](), 0, 0.0
    for executor in EXECUTORS:
        seconds = in_peace(archive, executor)
        found = archive.digests()
        first = first or found
        apart += told_apart(executor, found, first, seconds)
    rng = np.random.default_rng(given.seeds[0])
    # All kills fall within the time that the calm run would have taken.
    each_s = seconds * given.killed / len(given.seeds) / max(given.kills, 1)
    for kill in (with_workers_killed, with_scheduler_killed):
        began = time.monotonic()
        came = kill(archive, each_s, rng)
        took = time.monotonic() - began
        apart += told_apart(came, archive.digests(), first, took)
    if given.folder is None:
        shutil.rmtree(room)
    return int(apart > 0)


if __name__ == "__main__":
    sys.exit(main())
