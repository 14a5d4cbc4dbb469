"""Seconds of the bundle adjustment: `python -m tests.benchmarks.bench_adjustment`.

Blocks as in the comparison of programs: 200 rays a photo, about 2.8 rays a point, 30 control
points (0.5, 0.5, 1 m), priors of 20 m, start 20 m and 1 degree off, c, x0, y0, k1, k2 estimated.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter, process_time

import numpy as np

from core.block.adjusted import AdjustmentOptions, AdjustmentReport
from core.block.adjustment import adjust_block
from core.block.block import Block
from tests.flights import FlightPlan, fly

PLAIN = AdjustmentOptions(robust=False)
ROBUST = AdjustmentOptions()
ROUNDS = 5


@dataclass(frozen=True)
class Case:
    """One block and what of it is timed."""

    name: str
    plan: FlightPlan


def sized(strips: int, photos_per_strip: int, rays_per_photo: int = 200) -> FlightPlan:
    """A block of strips with 60 % and 30 % overlap and about so many tie rays in each photo."""
    photos = strips * photos_per_strip
    # About 3.5 photos show a point at these overlaps, 2.8 are kept.
    return FlightPlan(
        strips=strips,
        photos_per_strip=photos_per_strip,
        ties=round(photos * rays_per_photo / 2.45),
        control=30,
        check=0,
        control_sigma_m=(0.5, 0.5, 1.0),
        start_m=20.0,
        start_rad=np.radians(1.0),
        side=0.3,
        most_rays=3,
    )


CASES = (
    Case("6", sized(2, 3, rays_per_photo=750)),
    Case("60", sized(5, 12)),
    Case("400", sized(16, 25)),
)


def main() -> None:
    """Print wall and processor seconds of each case."""
    say("photos    rays  what                      median s   best s   CPU s  steps  sigma0")
    for case in CASES:
        block = fly(case.plan, np.random.default_rng(1)).block
        rays = len(block.ties.point)
        for what, start, options in scenarios(block):
            seconds, cpu, report = timed(lambda b=start, o=options: adjust_block(b, o))
            say(
                f"{case.name:>6} {rays:>7}  {what:<25} {np.median(seconds):8.3f} "
                f"{min(seconds):8.3f} {cpu:7.3f} {report.iterations:>6}  {report.sigma_nought:.4f}"
            )


def say(line: str) -> None:
    """One line at once, also into a pipe."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def scenarios(block: Block) -> list[tuple[str, Block, AdjustmentOptions]]:
    """Cold least squares, cold with gross error search, and warm after one changed status."""
    adjusted = adjust_block(block, ROBUST).block
    key = next(iter(adjusted.measurements))
    changed = adjusted.with_measurement(replace(adjusted.measurements[key], status="rejected"))
    return [
        ("least squares, cold", block, PLAIN),
        ("with data snooping, cold", block, ROBUST),
        ("with data snooping, warm", changed, ROBUST),
    ]


def timed(
    work: Callable[[], AdjustmentReport],
) -> tuple[list[float], float, AdjustmentReport]:
    """Seconds of several rounds, the least processor seconds of one, and the result."""
    seconds: list[float] = []
    processor: list[float] = []
    report = work()
    for _ in range(ROUNDS):
        start, busy = perf_counter(), process_time()
        report = work()
        seconds.append(perf_counter() - start)
        processor.append(process_time() - busy)
    return seconds, min(processor), report


if __name__ == "__main__":
    main()
