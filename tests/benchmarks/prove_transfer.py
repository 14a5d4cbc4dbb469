"""Reliability of points proposed photo to photo: what is said of them, and how many lie right.

Run: python -m tests.benchmarks.prove_transfer SEED... [--points 40] [--data FOLDER]

Rendered blocks with 40 m of relief whose orientations are off by half a metre and 3e-4 rad. Grey
values are drawn together to a share of their contrast, grain of six grey values is laid over them,
and each scan is compressed as JPEG. Points are pointed at in one photo with 0.3 px and proposed in
the others. With a folder of real data also the published picks of SXB Strasbourg, which differ by
0.6 px themselves: there no deviation is compared.

Printed: share of proposals within 2 px of the truth and the mean probability that was said; the
same by what was said, as said / right (count); the median of error over stated deviation, 1 where
these are right. Ends with 1 where said and right differ by more than three binomial
deviations, 0.03 at least.
"""

import argparse
import sys
import tempfile
import warnings
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from rasterio.errors import NotGeoreferencedWarning

from core.control.transfer import RIGHT_PX
from tests.core.control.test_transfer import (
    RELIEF_M,
    as_adjusted,
    compressed,
    error_over_stated,
    judged,
)
from tests.core.ties.rendered import rendered_block
from tests.real.test_transfer import proposed, strasbourg

FILMS = ((100, 1.0), (100, 0.2), (30, 0.12), (15, 0.25), (8, 0.3), (3, 0.5))
"""Quality of the compression, 100 for none, and share of the contrast."""
BINS = (0.0, 0.5, 0.8, 0.95, 1.01)


def rendered(seeds: Sequence[int], quality: int, contrast: float, points: int) -> np.ndarray:
    """Error, probability and stated deviation of every proposal of some blocks."""
    rows: list[np.ndarray] = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        with tempfile.TemporaryDirectory() as folder:
            _, true = rendered_block(Path(folder), RELIEF_M, noise=0.0, seed=seed)
            compressed(true, quality, contrast, rng)
            around = as_adjusted(true, rng)
            rows.append(judged(around, true, rng, votes=1, listed=False, points=points))
    return np.concatenate(rows)


def told(film: str, rows: np.ndarray, *, deviations: bool) -> bool:
    """Print a row of the table; whether what was said is right as far as chance lets it be."""
    off, said, sigma = rows.T
    right = off <= RIGHT_PX
    cells = [film, f"{len(off)}", f"{right.mean():.0%}", f"{said.mean():.2f}"]
    for low, high in pairwise(BINS):
        here = (said >= low) & (said < high)
        cells.append(
            f"{said[here].mean():.2f} / {right[here].mean():.2f} ({here.sum()})"
            if here.any()
            else "none"
        )
    cells.append(f"{error_over_stated(off, sigma):.2f}" if deviations else "")
    sys.stdout.write(f"| {' | '.join(cells)} |\n")
    sys.stdout.flush()
    chance = 3 * np.sqrt(np.mean(said * (1 - said)) / len(off))
    return bool(abs(said.mean() - right.mean()) <= max(chance, 0.03))


def main(arguments: list[str] | None = None) -> int:
    """Print a row for each kind of film; 1 where probabilities are off."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", type=int, nargs="+")
    parser.add_argument("--points", type=int, default=40)
    parser.add_argument("--data", type=Path)
    given = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    warnings.simplefilter("ignore", NotGeoreferencedWarning)
    spans = " | ".join(f"said {low:g} to {min(high, 1):g}" for low, high in pairwise(BINS))
    sys.stdout.write(f"| film | proposals | within 2 px | said | {spans} | error over stated |\n")
    sys.stdout.write(9 * "|---" + "|\n")
    good = True
    for quality, contrast in FILMS:
        rows = rendered(given.seeds, quality, contrast, given.points)
        kind = f"quality {quality}" if quality < 100 else "not compressed"
        good &= told(f"{kind}, contrast {contrast:g}", rows, deviations=True)
    if given.data:
        with tempfile.TemporaryDirectory() as folder:
            rows = proposed(strasbourg(given.data, Path(folder)), votes=1)
        good &= told("SXB Strasbourg", rows, deviations=False)
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())
