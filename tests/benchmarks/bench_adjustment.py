"""Seconds of the bundle adjustment beside Ceres: `python -m tests.benchmarks.bench_adjustment`.

Runs of both alternate, medians count, two threads for Ceres, one for us. Without pycolmap and
pyceres (`pip install pycolmap pyceres`) only our own figures are told. `--large` adds 2,000 photos.
Ends with 1 when a promise is broken.
"""

import json
import resource
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter, process_time

import numpy as np

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block, adjust_with_solution, one_thread
from core.adjustment.factorisation import invert_bordered
from core.adjustment.gauss_newton import begin, initial_state, minimise
from core.adjustment.influence import Influence
from core.adjustment.network import network_of
from core.adjustment.solver import normals_of, pattern_of
from core.block import Block
from core.progress import Silent
from tests.benchmarks.blocks import comparable, sized
from tests.flights import fly

HOME = Path(__file__).resolve().parents[2]
PLAIN = AdjustmentOptions(robust=False)
SNOOPING = AdjustmentOptions()
SEED = 1
ROUNDS = 5
PEER = bool(find_spec("pyceres") and find_spec("pycolmap"))


def main() -> int:
    """Print every table."""
    say("| figure | found | promised | |")
    say("|---|---|---|---|")
    kept = [beside_ceres("60", 5, 12, 1.0), beside_ceres("400", 16, 25, 0.5), decisions()]
    if "--large" in sys.argv:
        kept.append(large())
    return int(not all(kept))


def say(line: str) -> None:
    """One line at once, also into a pipe."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def promise(what: str, value: float, limit: float, unit: str = "") -> bool:
    """One line of the table; no number is no promise broken."""
    good = not value > limit
    mark = "not run" if np.isnan(value) else "kept" if good else "BROKEN"
    say(f"| {what} | {value:.3g}{unit} | at most {limit:g}{unit} | {mark} |")
    return good


def beside_ceres(name: str, strips: int, photos: int, ratio: float) -> bool:
    """The same observations, the same start: seconds, minimum and covariance of both."""
    block = comparable(strips, photos, SEED)
    ours, theirs = [], []
    for _ in range(ROUNDS):
        with one_thread(0):
            ours.append(our_run(block))
        theirs.append(ceres_run(strips, photos))
    mine = {key: float(np.median([run[key] for run in ours])) for key in ours[0]}
    peer = {key: float(np.median([run[key] for run in theirs])) for key in theirs[0]}
    say(
        f"| {name} photos, seconds: ours / Ceres | {mine['solve_s']:.3f} / {peer['solve_s']:.3f}, "
        f"{mine['steps']:.0f} / {peer['steps']:.0f} steps | | |"
    )
    say(
        f"| {name} photos, set-up besides: ours / Ceres | {mine['set_up_s']:.3f} / "
        f"{peer['set_up_s']:.3f} | | |"
    )
    say(
        f"| {name} photos, covariance of all orientations: ours / pycolmap | "
        f"{mine['covariance_s']:.3f} / {peer['covariance_s']:.3f} | | |"
    )
    pairs = list(zip(ours, theirs, strict=True))
    solved = float(np.median([one["solve_s"] / other["solve_s"] for one, other in pairs]))
    known = float(np.median([one["covariance_s"] / other["covariance_s"] for one, other in pairs]))
    same = abs(mine["cost"] / peer["cost"] - 1)
    return all(
        [
            promise(f"{name} photos, adjustment, ours over Ceres", solved, ratio),
            promise(f"{name} photos, relative difference of the minimum", same, 1e-6),
            promise(f"{name} photos, covariance, ours over pycolmap", known, 0.4),
        ]
    )


def our_run(block: Block) -> dict[str, float]:
    """One adjustment without and with what comes before and after it."""
    begun = perf_counter()
    network = network_of(block, PLAIN)
    start = begin(network, *initial_state(network))
    pattern = pattern_of(network)
    ready = perf_counter()
    fit = minimise(network, pattern, start, False, steps=50, progress=Silent())
    done = perf_counter()
    factor = normals_of(network, pattern, fit.lin, fit.weights, damping=0.0).factor
    inverse = invert_bordered(factor, pattern.reach)
    inverse.pairs(pattern.place, pattern.place)
    inverse.with_border(pattern.place)
    return {
        "set_up_s": ready - begun,
        "solve_s": done - ready,
        "covariance_s": perf_counter() - done,
        "cost": fit.cost(),
        "steps": float(fit.steps),
    }


def ceres_run(strips: int, photos: int) -> dict[str, float]:
    """The peer in a process of its own; no numbers where it is not installed."""
    names = ("set_up_s", "solve_s", "covariance_s", "cost", "steps")
    if not PEER:
        return dict.fromkeys(names, float("nan"))
    command = [sys.executable, "-m", "tests.benchmarks.ceres_peer"]
    words = [str(strips), str(photos), str(SEED)]
    done = subprocess.run(command + words, cwd=HOME, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def decisions() -> bool:
    """Warm adjustment after a decision, and all control without itself."""
    kept: list[bool] = []
    for name, plan, limit in (("30", sized(3, 10), 0.3), ("100", sized(5, 20), 1.0)):
        block = fly(plan, np.random.default_rng(SEED)).block
        adjusted = adjust_block(block, SNOOPING).block
        key = next(iter(adjusted.measurements))
        changed = adjusted.with_measurement(replace(adjusted.measurements[key], status="rejected"))
        wall, busy = timed(lambda b=changed: adjust_block(b, SNOOPING))
        say(f"| {name} photos, warm after a decision, by the clock | {wall:.3g} s | | |")
        what = f"{name} photos, warm after a decision, one processor"
        kept.append(promise(what, busy, limit, " s"))
    report, solution = adjust_with_solution(adjusted, SNOOPING)
    assert solution is not None
    ahead = Influence(report.block, solution)
    wall, busy = timed(ahead.leave_one_out)
    say(f"| 100 photos, all control without itself, by the clock | {wall:.3g} s | | |")
    kept.append(promise("100 photos, all control without itself, one processor", busy, 0.05, " s"))
    one = timed(ahead.reliabilities)[0] / len(report.redundancy_numbers)
    kept.append(promise("100 photos, what one control measurement steers", one, 0.02, " s"))
    return all(kept)


def timed(work: Callable[[], object]) -> tuple[float, float]:
    """Median seconds by the clock and of the processor: a shared machine stretches the first."""
    work()
    seconds: list[tuple[float, float]] = []
    for _ in range(ROUNDS):
        begun, busy = perf_counter(), process_time()
        work()
        seconds.append((perf_counter() - begun, process_time() - busy))
    wall, processor = np.median(seconds, axis=0)
    return float(wall), float(processor)


def large() -> bool:
    """2,000 photos, and how seconds grow from 400."""
    busy: list[float] = []
    wall = 0.0
    for strips, photos in ((16, 25), (40, 50)):
        block = fly(sized(strips, photos), np.random.default_rng(SEED)).block
        assert adjust_block(block, PLAIN).converged
        wall, processor = timed(lambda block=block: adjust_block(block, PLAIN))
        busy.append(processor)
    gigabytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    growth = float(np.log(busy[1] / busy[0]) / np.log(2000 / 400))
    return all(
        [
            promise("2,000 photos, whole adjustment with report", wall / 60, 10, " min"),
            promise("2,000 photos, memory", gigabytes, 8, " GiB"),
            promise("growth from 400 to 2,000 photos, exponent", growth, 1.3),
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
