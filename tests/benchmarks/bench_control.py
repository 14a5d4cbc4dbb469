"""Speed of the control search in one large scan, and of robust resection, beside peers.

300 junctions are searched in a scan of 12 000 pixels by every operator there is, in windows of
160 m at 1 m, all in one pass. Tiles of the scan go to threads as photos do in the program, which
never has a single one.

AROSICS beside it, with `--arosics PYTHON`, an interpreter in which it is installed: its grid of tie
points over the same scan and the same ortho, which it is given reduced to 1 m and laid upon each
other, with one window after another. It chooses its points itself, as many as there are junctions.

Resection: 8 and 11 right of 90 candidates, one a point, the others anywhere within 29 m; PoseLib's
LO-RANSAC beside it where it is installed. Ends with 1 when a promise is broken.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import rasterio
from threadpoolctl import threadpool_limits

from app.settings import Threads
from core.block import Photo
from core.literature.baselines import OPERATORS, NccOperator
from core.literature.dense_descriptors import has_akaze
from core.matching.local_search import (
    TILE_PX,
    MatchingOptions,
    Prediction,
    looked_at,
    predict_pixels,
)
from core.matching.patches import OpenPhoto
from core.matching.reference import Reference
from tests.benchmarks.control_scene import (
    CAMERA,
    CRS,
    HEIGHT_M,
    NORTH,
    ORTHO_M,
    SCAN_PX,
    SIDE_M,
    WEST,
    scene,
)
from tests.benchmarks.resection_cases import NEAR_M, resections

WINDOW_M, TEMPLATE_M = 160.0, 51.0
PROMISED_S, CORES = 20.0, 2
FASTER = 20.0
"""So many times the points per second of AROSICS, at equal or better success."""
AROSICS_SHIFT_PX = 60
PEER = Path(__file__).with_name("arosics_peer.py")


@dataclass(frozen=True, slots=True)
class Task:
    """The scan and how it is searched."""

    opened: OpenPhoto
    true: Photo
    reference: Reference
    points: np.ndarray
    matching: MatchingOptions
    half: int

    def misses_m(self, point: int, pixel: np.ndarray) -> float:
        """How far from the truth a junction was found, metres on the ground."""
        exact = self.true.pixel_from_object(self.points[point : point + 1], CAMERA)[0]
        return float(np.hypot(*(pixel - exact))) * self.opened.ground_pixel_m


def say(line: str) -> None:
    """One line, at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def task_of(
    opened: OpenPhoto, true: Photo, reference: Reference, points: np.ndarray, names: Sequence[str]
) -> Task:
    """Windows of 160 m at 1 m."""
    reduction = max(1, round(1.0 / opened.ground_pixel_m))
    pixel_m = opened.ground_pixel_m * reduction
    inner = round((TEMPLATE_M / pixel_m - 1) / 2)
    half = round((WINDOW_M - TEMPLATE_M) / 2 / pixel_m)
    operators = tuple(OPERATORS[name] for name in names)
    matching = MatchingOptions(
        reduction, inner, min_search_px=half, max_search_px=half, operators=operators
    )
    return Task(opened, true, reference, points, matching, half)


def searched(task: Task, workers: int) -> tuple[dict[str, float], float, float]:
    """Share within 3 m by operator; seconds of the whole stage, wall and CPU."""
    names = [operator.name for operator in task.matching.operators]
    threads = Threads(workers)
    started, spent = time.perf_counter(), time.process_time()
    prediction = predict_pixels(
        task.opened, np.zeros((6, 6)), task.points, np.full(task.points.shape, 0.3)
    )
    cell = np.floor(prediction.pixels / (TILE_PX * task.matching.reduction)).astype(int)
    pieces = [np.all(cell == key, axis=1) for key in np.unique(cell, axis=0)]
    misses = [
        miss for found in threads.map(partial(in_tile, task, prediction), pieces) for miss in found
    ]
    seconds = time.perf_counter() - started, time.process_time() - spent
    threads.close()
    assert len(misses) == len(task.points)
    shares = np.mean(np.array(misses) <= NEAR_M, axis=0)
    return dict(zip(names, shares.tolist(), strict=True)), *seconds


def in_tile(task: Task, prediction: Prediction, members: np.ndarray) -> list[list[float]]:
    """How far from the truth each operator puts each junction of a tile, metres."""
    own = Prediction(prediction.pixels, prediction.sigma_px, prediction.inside & members)
    halves = np.full(len(members), task.half)
    misses: list[list[float]] = []
    for view, point in looked_at(task.opened, task.reference, own, halves, task.matching):
        row: list[float] = []
        for operator in task.matching.operators:
            surface = view.scores(operator.name)
            down, right = np.unravel_index(int(np.argmax(surface)), surface.shape)
            moved = (np.array([right, down]) - task.half) * task.matching.reduction
            row.append(task.misses_m(point, view.centre[0] + moved))
        misses.append(row)
    return misses


def phase_correlated(task: Task) -> tuple[float, float]:
    """Share within 3 m of the phase correlation of 256 pixels, and its seconds of CPU alone."""
    matching = MatchingOptions(task.matching.reduction, 128, operators=(NccOperator(),))
    prediction = predict_pixels(
        task.opened, np.zeros((6, 6)), task.points, np.full(task.points.shape, 0.3)
    )
    window = cv2.createHanningWindow((256, 256), cv2.CV_32F)
    seconds, right = 0.0, 0
    ones = np.ones(len(task.points), int)
    for view, point in looked_at(task.opened, task.reference, prediction, ones, matching):
        # The window has a pixel of room about the template on each side.
        rows, columns = (slice(part.start + 1, part.start + 257) for part in view.around)
        scan = np.ascontiguousarray(view.images.part.grey[rows, columns])
        template = view.images.templates.reference[view.patch][:256, :256]
        pair = np.ascontiguousarray(template), scan
        started = time.process_time()
        shift, _ = cv2.phaseCorrelate(*pair, window)
        seconds += time.process_time() - started
        right += (
            task.misses_m(point, view.centre[0] + np.array(shift) * matching.reduction) <= NEAR_M
        )
    return right / len(task.points), seconds


def laid_upon_each_other(folder: Path, task: Task) -> tuple[Path, Path]:
    """The ortho and the scan as GeoTIFFs on one grid, as far as the photo is known."""
    opened, size = task.opened, task.matching.reduction
    pixel_m = opened.ground_pixel_m * size
    scan = cv2.imread(str(folder / "scan.tif"), cv2.IMREAD_UNCHANGED)
    assert scan is not None
    small = cv2.resize(scan, None, fx=1 / size, fy=1 / size, interpolation=cv2.INTER_AREA)
    side = small.shape[0]
    edge = (SIDE_M - side * pixel_m) / 2
    with rasterio.open(folder / "ortho.tif") as raster:
        ortho = cv2.GaussianBlur(raster.read(1), (0, 0), 0.5)
    line = ((edge + (np.arange(side) + 0.5) * pixel_m) / ORTHO_M - 0.5).astype(np.float32)
    laid = cv2.remap(ortho, *np.meshgrid(line, line), cv2.INTER_LINEAR)
    transform = rasterio.Affine(pixel_m, 0, WEST + edge, 0, -pixel_m, NORTH - edge)
    for name, image in (("reference", laid), ("target", small)):
        with rasterio.open(
            folder / f"{name}.tif", "w", driver="GTiff", width=side, height=side, count=1,
            dtype=image.dtype, crs=CRS, transform=transform,
        ) as raster:  # fmt: skip
            raster.write(image, 1)
    return folder / "reference.tif", folder / "target.tif"


@dataclass(frozen=True, slots=True)
class Peer:
    """One run of AROSICS."""

    points: int
    returned: int
    right: float
    kept: int
    kept_right: float
    wall: float
    cpu: float


def arosics(python: str, rasters: tuple[Path, Path], task: Task, window_px: int) -> Peer:
    """Its tie points in windows of one size, judged by where the photo truly is."""
    side = SCAN_PX // task.matching.reduction
    grid = round(side / len(task.points) ** 0.5)
    words = [*map(str, rasters), *map(str, (grid, window_px, AROSICS_SHIFT_PX, CORES))]
    done = subprocess.run(
        [python, str(PEER), *words], capture_output=True, text=True, check=False, cwd="/"
    )
    if done.returncode:
        raise SystemExit(f"AROSICS did not run:\n{done.stderr}")
    told = json.loads(done.stdout.strip().splitlines()[-1])
    table = np.array(told["points"])
    heights = np.full(len(table), HEIGHT_M)
    thought = np.column_stack([table[:, :2], heights])
    pixels = task.opened.photo.pixel_from_object(thought, CAMERA)
    truth = task.true.object_from_pixel(pixels, heights, CAMERA)[:, :2] - thought[:, :2]
    right = np.hypot(*(table[:, 2:] - truth).T) <= NEAR_M
    kept = ~np.array(told["outlier"])
    return Peer(
        len(table),
        int((table[:, 2] > -9000).sum()),
        float(right.mean()),
        int(kept.sum()),
        float(right[kept].mean()) if kept.any() else 0.0,
        told["wall"],
        told["cpu"],
    )


def beside_arosics(
    python: str | None, windows: Sequence[int], folder: Path, task: Task, share: float, rate: float
) -> list[str]:
    """Print the rows of AROSICS; the promise that is broken, if it is.

    Args:
        python: The other interpreter.
        windows: Sides of its windows, pixels.
        folder: Where the scene is.
        task: The scene.
        share: Our own share within 3 m.
        rate: Our own points per second of CPU.
    """
    if python is None:
        say("  AROSICS: not run (--arosics PYTHON)")
        return []
    rasters = laid_upon_each_other(folder, task)
    runs: list[Peer] = []
    for window in windows:
        one = arosics(python, rasters, task, window)
        runs.append(one)
        theirs = one.points / one.cpu
        right = rate * share / max(theirs * one.right, 1e-9)
        say(
            f"| AROSICS | {window} pixels | {theirs:.1f} | {one.points / one.wall:.1f} "
            f"| {one.right:.1%} of {one.points} | {rate / theirs:.1f} times | {right:.1f} times "
            f"| {one.returned}; {one.kept}, {one.kept_right:.1%} of them right |"
        )
    best = max(runs, key=lambda one: one.right)
    if share < best.right or rate < FASTER * best.points / best.cpu:
        return [f"{rate * best.cpu / best.points:.1f} times AROSICS's speed at its best success"]
    return []


def searches(given: argparse.Namespace, folder: Path) -> list[str]:
    """Print the search by every operator and beside AROSICS; promises that are broken."""
    parts = scene(folder, given.seed)
    every = [name for name in OPERATORS if name != "akaze" or has_akaze()]
    task = task_of(*parts, every)
    shares, wall, cpu = searched(task, given.workers)
    count = len(task.points)
    say(
        f"{count} junctions, {len(every)} operators, {given.workers} workers: {wall:.1f} s, "
        f"{cpu:.1f} s of CPU; {PROMISED_S:.0f} s on {CORES} cores are promised"
    )
    say(f"\n| operator | within {NEAR_M:.0f} m |\n|---|---|")
    for operator, share in shares.items():
        say(f"| {operator} | {share:.1%} |")
    broken = [f"{cpu:.1f} s of CPU for the whole stage"] if cpu > PROMISED_S * CORES else []
    fused, wall, cpu = searched(task_of(*parts, ["fused"]), given.workers)
    say(
        "\n| program | windows | points per s of CPU | points per s by the clock | right | "
        "fused is faster | right ones per s | returned; kept |\n|---|---|---|---|---|---|---|---|"
    )
    say(
        f"| fused, the whole stage | 160 m, template 51 m | {count / cpu:.1f} | {count / wall:.1f} "
        f"| {fused['fused']:.1%} of {count} | | | |"
    )
    windows = [int(word) for word in given.windows.split(",")]
    broken += beside_arosics(given.arosics, windows, folder, task, fused["fused"], count / cpu)
    share, cpu = phase_correlated(task)
    say(
        f"  phase correlation alone, without reading and warping: {count / cpu:.0f} points per "
        f"second of CPU, {share:.1%} right"
    )
    return broken


def robust(given: argparse.Namespace) -> list[str]:
    """Print how robust resection is; promises that are broken."""
    table = resections(given.cases, given.seed, say)
    return [
        f"resection at {right} of 90: {share:.1%}, {each:.0f} ms"
        for right, least in ((8, 0.95), (11, 0.99))
        for share, each in [table["accepted", right]]
        if share < least or each > 50
    ]


def main() -> int:
    """Print what was measured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=71)
    parser.add_argument("--cases", type=int, default=200, help="of resection; 0 leaves it out")
    parser.add_argument("--workers", type=int, default=CORES)
    parser.add_argument("--arosics", help="an interpreter in which AROSICS is installed")
    parser.add_argument("--windows", default="152,256,512,768", help="of AROSICS, pixels")
    given = parser.parse_args()
    # As `app.cli` has it: many small products of matrices gain nothing from threads.
    with tempfile.TemporaryDirectory() as folder, threadpool_limits(1, "blas"):
        broken = searches(given, Path(folder))
        broken += robust(given) if given.cases else []
    for line in broken:
        say(f"BROKEN {line}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
