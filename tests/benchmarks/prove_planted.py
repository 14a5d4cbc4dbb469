"""A patch that finds the same wrong object in every photo: is it caught by the block?

Flights with known truth, sixty junctions each; one junction of two photos or more is found at the
same wrong place, 4 to 12 m off, in all of them, so that no epipolar line tells. Printed: planted
points left out in every photo, and good measurements lost. Ends with 1 when fewer than 95 % are
left out or more than 1 % of the good is lost.
"""

import argparse
import sys
from dataclasses import replace

import numpy as np

from core.adjustment.adjusted import AdjustmentOptions
from core.control.stage import adjusted_without_gross
from tests.flights import FlightPlan, fly

PLAN = FlightPlan(ties=200, control=60, check=0, camera_errors=False, start_m=3.0, start_rad=0.001)


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


def main() -> int:
    """Plant one in each of many blocks."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=100)
    given = parser.parse_args()
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
