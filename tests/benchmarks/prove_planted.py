"""Blunders that look right: what finds the same wrong object in every photo, what a hand accepted.

Run: python -m tests.benchmarks.prove_planted [--cases N] [--by-hand BLOCK ...] [--metres M ...]

Flights with known truth, sixty junctions each; one junction of two photos or more is found at the
same wrong place, 4 to 12 m off, in all of them, so that no epipolar line tells. Printed: planted
points left out in every photo, and good measurements lost. Ends with 1 when fewer than 95 % are
left out or more than 1 % of the good is lost.

`--by-hand`: on copies of blocks, run where they lie, a measurement in use is placed 3, 8 and 18 m
off (or as `--metres` says, for pixels of many metres) and accepted at the desk, one at a time.
Printed after one adjustment: what the verdict, the queue's filter and the report say of it. Ends
with 1 when one of the three does not name what is six standard deviations off (the test's limit is
3.7, and luck may hide two), states a size that is three of its own standard deviations wrong, or
names another measurement.
"""

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from core.adjustment.adjusted import AdjustmentOptions
from core.block import HAND_SIGMA_PX
from core.control.stage import adjusted_without_gross
from core.quality.assessment import assess_block
from core.quality.rules import judge_block
from sessions.session import Session
from tests.benchmarks.loop_hand import Key, LoopHand
from tests.flights import FlightPlan, fly

PLAN = FlightPlan(ties=200, control=60, check=0, camera_errors=False, start_m=3.0, start_rad=0.001)
BY_HAND_M = (3.0, 8.0, 18.0)
CLEAR = 6.0
"""Standard deviations from which on a blunder has to be named."""
Said = dict[Key, tuple[float, float]]
"""Metres, and how many standard deviations they are, by measurement."""


def planted(seed: int) -> tuple[float, bool, int, int]:
    """Metres off, whether it was left out everywhere, good measurements lost, and all of them."""
    rng = np.random.default_rng(seed)
    block = fly(PLAN, rng).block
    seen = [key[0] for key in block.measurements]
    names = sorted(name for name in set(seen) if seen.count(name) >= 2)
    name = names[int(rng.integers(len(names)))]
    away, azimuth = rng.uniform(4.0, 12.0), rng.uniform(0, 2 * np.pi)
    point = block.surveyed[name]
    off = away * np.array([np.sin(azimuth), np.cos(azimuth), 0.0])
    wrong = replace(point, position=point.position + off)
    spoilt = replace(block, surveyed={**block.surveyed, name: wrong})
    found = adjusted_without_gross(spoilt, AdjustmentOptions(estimate_cameras=False)).block
    own = [m.used for key, m in found.measurements.items() if key[0] == name]
    good = [m.used for key, m in found.measurements.items() if key[0] != name]
    return away, not any(own), len(good) - sum(good), len(good)


@dataclass(frozen=True)
class Told:
    """What is said of one blunder after one adjustment."""

    key: Key
    metres: float
    sigmas: float
    """Of the hand and of the point; that the photo is not exact either comes on top."""
    verdict: Said
    queue: dict[Key, float]
    report: Said

    def is_right(self) -> bool:
        """True where all three say the same, and that is right."""
        if not self.verdict and not self.queue and not self.report:
            return self.sigmas < CLEAR
        if not set(self.verdict) == set(self.queue) == set(self.report) == {self.key}:
            return False
        size, test = self.verdict[self.key]
        same = self.report[self.key][0] == size == self.queue[self.key]
        return same and abs(size - self.metres) <= 3 * size / test


def by_hand(folder: Path, metres: float, rng: np.random.Generator) -> Told:
    """Place one measurement of a block so far off, accept it, adjust once and ask everybody."""
    hand = LoopHand(folder, "planted")
    try:
        block = hand.report.block
        used = sorted(
            key
            for key, item in block.measurements.items()
            if item.used and block.surveyed[key[0]].role == "control"
        )
        key = used[int(rng.integers(len(used)))]
        turn, item = rng.uniform(0, 2 * np.pi), block.measurements[key]
        per_pixel = block.photos[key[1]].ground_pixel_m(block.camera_of(key[1]))
        pixels = metres / per_pixel
        known = max(block.surveyed[key[0]].sigma_m[:2])
        hand.look(key)
        hand.place(key, item.column + pixels * np.cos(turn), item.row + pixels * np.sin(turn))
        hand.settle()
        findings = judge_block(assess_block(hand.report), hand.report)
        verdict = _named([{"kind": one.kind, **one.values} for one in findings])
        queue = {(row[0], row[1]): row[8] for row in hand.parts["rows"] if row[8] is not None}
    finally:
        hand.close()
    command = [sys.executable, "-m", "gruber", "report", str(folder)]
    subprocess.run(command, check=True, capture_output=True)
    model = json.loads((folder / "results/report.json").read_text(encoding="utf-8"))
    page = (folder / "results/report.html").read_text(encoding="utf-8")
    report = {name: told for name, told in _named(model["verdict"]).items() if name[0] in page}
    sigma = float(np.hypot(known, HAND_SIGMA_PX * per_pixel))
    return Told(key, metres, metres / sigma, verdict, queue, report)


def _named(findings: list[dict[str, Any]]) -> Said:
    """What findings say of measurements that the block contradicts."""
    return {
        (one["worst"], photo): (float(one["metres"]), float(one["test"]))
        for one in findings
        if one["kind"].startswith("contradicted") and "worst" in one
        for photo in one["photo"].split(", ")
    }


def all_by_hand(blocks: list[Path], sizes: Sequence[float]) -> int:
    """All sizes on a copy of each block, run where it lies; 1 where one was not told right."""
    wrong = 0
    for number, block in enumerate(blocks):
        made = tempfile.TemporaryDirectory()
        folder = Path(made.name) / block.name
        shutil.copytree(block, folder)
        run = [sys.executable, "-m", "gruber", "run", str(folder)]
        subprocess.run(run, check=True, capture_output=True)
        for metres in sizes:
            told = by_hand(folder, metres, np.random.default_rng((number, int(metres))))
            with Session.open(folder, "planted") as session:
                session.undo("planted")
            wrong += not told.is_right()
            said = "not named"
            if told.verdict or told.queue or told.report:
                said = f"verdict {told.verdict}, queue {told.queue}, report {told.report}"
            sys.stdout.write(
                f"{block.name}: {'|'.join(told.key)} off by {metres:g} m, {told.sigmas:.1f} sigma: "
                f"{said}{'' if told.is_right() else '  WRONG'}\n"
            )
            sys.stdout.flush()
        made.cleanup()
    return min(wrong, 1)


def main() -> int:
    """Plant one in each of many blocks."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--by-hand", type=Path, nargs="+", default=[])
    parser.add_argument("--metres", type=float, nargs="+", default=BY_HAND_M)
    given = parser.parse_args()
    if given.by_hand:
        return all_by_hand(given.by_hand, given.metres)
    results = [planted(seed) for seed in range(given.cases)]
    caught = sum(out for _, out, _, _ in results)
    lost, good = sum(r[2] for r in results), sum(r[3] for r in results)
    missed = ", ".join(f"{away:.1f} m" for away, out, _, _ in results if not out) or "none"
    sys.stdout.write(
        f"{caught} of {given.cases} planted points left out (missed: {missed}); "
        f"{lost} of {good} good measurements lost ({lost / good:.2%})\n"
    )
    return 0 if caught >= 0.95 * given.cases and lost <= 0.01 * good else 1


if __name__ == "__main__":
    sys.exit(main())
