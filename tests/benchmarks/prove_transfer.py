"""Points proposed photo to photo on faint, grainy and compressed scans: how many lie right.

Run: python -m tests.benchmarks.prove_transfer SEED... [--points 40]

Rendered blocks with 40 m of relief whose orientations are off by half a metre and 3e-4 rad. Grey
values are drawn together to a share of their contrast, grain of six grey values is laid over them,
and each scan is compressed as JPEG. Points are pointed at in one photo with 0.3 px and proposed in
the others. Printed: share of proposals within 2 px of the truth, the mean probability that was
said, the same of those said to be surer than 0.9, and the RMS error per axis of places within 6 px
beside what was said of them. Ends with 1 where more was said than was right by 0.1 and more.
"""

import argparse
import sys
import tempfile
import warnings
from pathlib import Path

import cv2
import numpy as np
from rasterio.errors import NotGeoreferencedWarning

from core.block import Block
from core.control.transfer import RIGHT_PX, Transferred, transfer_point
from tests.core.control.test_transfer import as_adjusted, grounds, pixels_of, pointed
from tests.core.ties.rendered import rendered_block, write

FILMS = ((100, 0.2), (15, 0.25), (8, 0.3), (30, 0.12), (10, 0.2))
"""Quality of the compression, 100 for none, and share of the contrast."""
GRAIN, GRAIN_PX = 6.0, 0.7
NEAR_PX = 6.0


def compressed(block: Block, quality: int, contrast: float, rng: np.random.Generator) -> None:
    """Make the scans faint and grainy, and compress them."""
    for photo in block.photos.values():
        grey = cv2.imread(str(photo.scan), cv2.IMREAD_GRAYSCALE).astype(np.float32)
        noise = cv2.GaussianBlur(rng.normal(size=grey.shape).astype(np.float32), (0, 0), GRAIN_PX)
        grey = 120 + contrast * (grey - grey.mean()) + noise / noise.std() * GRAIN
        grey = np.clip(np.rint(grey), 0, 255).astype(np.uint8)
        if quality < 100:
            packed = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
            grey = cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE)
        write(photo.scan, grey)


def proposals(seed: int, quality: int, contrast: float, points: int) -> list[list[float]]:
    """Error, probability and stated standard deviation of every proposal."""
    rows: list[list[float]] = []
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        _, true = rendered_block(Path(folder), 40.0, noise=0.0, seed=seed)
        compressed(true, quality, contrast, rng)
        around = as_adjusted(true, rng)
        for number, ground in enumerate(grounds(rng, points)):
            places = pixels_of(true, ground)
            if len(places) < 2:
                continue
            first = str(rng.permutation(sorted(places))[0])
            name = f"P{number}"
            found = transfer_point(around, name, [pointed(name, first, places[first], rng)])
            assert isinstance(found, Transferred)
            for item in found.proposals:
                if item.photo_id in places:
                    off = float(np.hypot(*(item.pixel - places[item.photo_id])[0]))
                    rows.append([off, item.score, item.sigma_px])
            rows += [[np.inf, 0.0, np.nan]] * len(found.failures)
    return rows


def main(arguments: list[str] | None = None) -> int:
    """Print a row for each kind of film; 1 where probabilities are too high."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", type=int, nargs="+")
    parser.add_argument("--points", type=int, default=40)
    given = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    warnings.simplefilter("ignore", NotGeoreferencedWarning)
    sys.stdout.write("| film | seeds | proposals | within 2 px | said | sure | wrong of them ")
    sys.stdout.write("| RMS error | said |\n" + "|---" * 9 + "|\n")
    high = False
    for quality, contrast in FILMS:
        rows = [row for s in given.seeds for row in proposals(s, quality, contrast, given.points)]
        off, said, sigma = np.array(rows).T
        right, sure, near = off <= RIGHT_PX, said >= 0.9, off < NEAR_PX
        high |= bool(said.mean() > right.mean() + 0.1)
        error, stated = (np.sqrt(np.mean(v[near] ** 2)) for v in (off / np.sqrt(2), sigma))
        wrong = f"{np.mean(~right[sure]):.1%}" if sure.any() else ""
        film = f"quality {quality}" if quality < 100 else "not compressed"
        seeds = ", ".join(map(str, given.seeds))
        sys.stdout.write(
            f"| {film}, contrast {contrast} | {seeds} | {len(off)} | {right.mean():.1%} "
            f"| {said.mean():.1%} | {sure.mean():.1%} | {wrong} | {error:.2f} px "
            f"| {stated:.2f} px |\n"
        )
        sys.stdout.flush()
    return int(high)


if __name__ == "__main__":
    sys.exit(main())
