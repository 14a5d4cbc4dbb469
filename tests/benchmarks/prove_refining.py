"""How exactly Enter at the desk refines a place: synthetic dots, the true shift between them known.

Run: python -m tests.benchmarks.prove_refining [count]

A hundred dots of random place, size and strength; the scan shows them shifted by a part of a pixel,
without and with noise. A place up to a pixel off is refined with the operator of the desk and
with plain NCC.
"""

import sys

import numpy as np

from core.control.likeness import OPERATOR, Likeness
from core.doubts import Failure
from core.literature.baselines import NccOperator
from core.localisation.photo_orientation import OrientationOptions
from core.matching.local_search import cut
from core.matching.operators import Operator
from tests.benchmarks.large_desk import say

SIDE, REACH, PROMISE_PX = 201, 10, 0.05


def dots(places: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Round dots on a grey ground, (column, row, strength, radius) each, shifted."""
    row, column = np.mgrid[0:SIDE, 0:SIDE].astype(np.float64)
    image = np.full((SIDE, SIDE), 40.0)
    for x, y, strength, radius in places:
        squares = (column - x - shift[0]) ** 2 + (row - y - shift[1]) ** 2
        image += strength * np.exp(-squares / (2 * radius**2))
    return image.astype(np.float32)


def errors(operator: Operator, half: int, noise: float, count: int, seed: int) -> np.ndarray:
    """Distances of refined places from the true ones, pixels; those not refined are infinite."""
    rng, middle = np.random.default_rng(seed), SIDE // 2
    found: list[float] = []
    for _ in range(count):
        low, high = (5, 5, 30, 1.5), (SIDE - 5, SIDE - 5, 180, 3.0)
        places, shift = rng.uniform(low, high, (100, 4)), rng.uniform(-3, 3, 2)
        scan = dots(places, shift) + rng.normal(0, noise, (SIDE, SIDE)).astype(np.float32)
        inner, outer = (
            np.s_[middle - size : middle + size + 1, middle - size : middle + size + 1]
            for size in (half, half + REACH)
        )
        bare = np.zeros((SIDE, SIDE), dtype=np.float32)
        reference = operator.of_reference(dots(places, np.zeros(2)), bare, half)
        shown = cut(operator.of_scan(scan, half), outer)
        scores = operator.scores(shown, cut(reference, inner))
        likeness = Likeness(scores, np.full((1, 2), -float(REACH)), 1)
        refined = likeness.refined((shift + rng.uniform(-0.7, 0.7, 2))[None])
        missed = isinstance(refined, Failure)
        found.append(np.inf if missed else float(np.hypot(*(refined[0] - shift))))
    return np.array(found)


def main() -> int:
    """A row for each operator and noise; 1 when one in twenty of the desk's own is off by more."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    half, kept = OrientationOptions().template_half_px, True
    say("| operator | noise, grey values | median | 95 % | largest |")
    say("|---|---|---|---|---|")
    for operator in (OPERATOR, NccOperator()):
        for noise in (0.0, 3.0):
            off = errors(operator, half, noise, count, seed=71)
            median, most = np.percentile(off, (50, 95))
            kept = kept and (operator != OPERATOR or most <= PROMISE_PX)
            figures = " | ".join(f"{px:.3f} px" for px in (median, most, off.max()))
            say(f"| {operator.name} | {noise:.0f} | {figures} |")
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
