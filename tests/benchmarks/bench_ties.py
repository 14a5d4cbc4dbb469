"""Verified matches per second beside pycolmap, and memory on a large scan.

`python -m tests.benchmarks.bench_ties [FOLDER] [--scan PIXELS]`, from the project's folder. FOLDER
is a block with a truth (the vovcha block of `GRUBER_DATA` by default). Both match all photos of it,
each in a process of its own, on two threads; seconds of the processor count, for a machine that
others use stretches the clock. Without pycolmap (`pip install pycolmap`) only our own figures are
told. Ends with 1 when a promise is broken.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import cv2
import numpy as np
import rasterio

from core.progress import Silent
from core.raster.scan_file import open_scan
from core.ties.features import FeatureOptions, detect_features
from core.ties.matches import VerifiedMatches
from core.ties.pair_search import match_pairs
from core.ties.stage import TieOptions, detect_block_features, match_block_features

HOME = Path(__file__).resolve().parents[2]
FASTER = 3.0
MOST_GIB = 1.5
THREADS = 2


def main() -> int:
    """Print the table; with an inner word, be one of the runs it compares."""
    parser = argparse.ArgumentParser()
    data = Path(os.environ.get("GRUBER_DATA", "."))
    parser.add_argument("folder", nargs="?", type=Path, default=data / "vovcha-film")
    parser.add_argument("--scan", type=int, default=12_000)
    parser.add_argument("--inner", choices=("ours", "peer", "scan"))
    asked = parser.parse_args()
    if asked.inner:
        run = {"ours": our_run, "peer": peer_run, "scan": scan_run}[asked.inner]
        told = run(asked.scan if asked.inner == "scan" else asked.folder)
        told["gib"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        say(json.dumps(told))
        return 0
    say("| run | verified matches | s of the processor | s by the clock | per s | GiB |")
    say("|---|---|---|---|---|---|")
    ours = row("ours, all pairs by what is known of them", asked, "ours")
    peer = row("pycolmap, all pairs", asked, "peer") if find_spec("pycolmap") else None
    scan = row(f"ours, features of one scan of {asked.scan} px a side", asked, "scan")
    kept = scan["gib"] < MOST_GIB and ours["gib"] < MOST_GIB
    say(f"\nmemory below {MOST_GIB} GiB: {'kept' if kept else 'BROKEN'}")
    if peer:
        ratio = ours["per_s"] / peer["per_s"]
        kept &= ratio >= FASTER
        mark = "kept" if ratio >= FASTER else "BROKEN"
        say(f"verified matches per second over pycolmap's: {ratio:.1f}, at least {FASTER}: {mark}")
    return int(not kept)


def say(line: str) -> None:
    """One line at once, also into a pipe."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def row(name: str, asked: argparse.Namespace, inner: str) -> dict[str, float]:
    """One run in a process of its own, and its line of the table."""
    words = [str(asked.folder), "--scan", str(asked.scan), "--inner", inner]
    command = [sys.executable, "-m", "tests.benchmarks.bench_ties", *words]
    done = subprocess.run(command, cwd=HOME, capture_output=True, text=True, check=True)
    told = json.loads(done.stdout.splitlines()[-1])
    told["per_s"] = told["matches"] / told["busy_s"]
    say(
        f"| {name} | {told['matches']:.0f} | {told['busy_s']:.1f} | {told['wall_s']:.1f} | "
        f"{told['per_s']:.0f} | {told['gib']:.2f} |"
    )
    return told


def our_run(folder: Path) -> dict[str, float]:
    """Features and verified matches of a block; the tie points themselves are timed besides."""
    blocks = import_module("tests.benchmarks.tie_blocks")
    case = blocks.known("block", folder)
    begun, busy = perf_counter(), process_time()
    options = TieOptions()
    features = detect_block_features(case.block, options, Silent(), case.usable)
    found = match_pairs(case.block, features, np.random.default_rng(1), Silent())
    told = {"wall_s": perf_counter() - begun, "busy_s": process_time() - busy}
    verified = [r.found for r in found.values() if isinstance(r.found, VerifiedMatches)]
    match_block_features(case.block, features, options, Silent(), np.random.default_rng(0))
    return told | {"matches": float(sum(len(pair.matches.first) for pair in verified))}


def peer_run(folder: Path) -> dict[str, float]:
    """pycolmap with its own settings, on the processor."""
    colmap: Any = import_module("pycolmap")
    scans = folder / "scans"
    names = sorted(path.name for path in scans.glob("*.tif"))
    with tempfile.TemporaryDirectory() as home:
        base = Path(home) / "colmap.db"
        extraction = colmap.FeatureExtractionOptions()
        matching = colmap.FeatureMatchingOptions()
        extraction.num_threads = matching.num_threads = THREADS
        extraction.use_gpu = matching.use_gpu = False
        begun, busy = perf_counter(), process_time()
        colmap.extract_features(
            base,
            scans,
            image_names=names,
            camera_mode=colmap.CameraMode.SINGLE,
            extraction_options=extraction,
            device=colmap.Device.cpu,
        )
        colmap.match_exhaustive(base, matching_options=matching, device=colmap.Device.cpu)
        told = {"wall_s": perf_counter() - begun, "busy_s": process_time() - busy}
        _, pairs = colmap.Database.open(base).read_two_view_geometries()
        return told | {"matches": float(sum(len(pair.inlier_matches) for pair in pairs))}


def scan_run(side: int) -> dict[str, float]:
    """Features of one large scan of noise of all scales, as grainy as film."""
    with tempfile.TemporaryDirectory() as home:
        path = Path(home) / "large.tif"
        write_scan(path, side)
        begun, busy = perf_counter(), process_time()
        found = detect_features(open_scan(path), None, FeatureOptions())
        told = {"wall_s": perf_counter() - begun, "busy_s": process_time() - busy}
    return told | {"matches": float(len(found.pixels))}


def write_scan(path: Path, side: int, band: int = 500) -> None:
    """A scan written in bands, so that making it needs no memory of its own."""
    rng = np.random.default_rng(1)
    coarse = rng.normal(size=(side // 20, side // 20)).astype(np.float32)
    profile = {"driver": "GTiff", "count": 1, "dtype": "uint8", "tiled": True}
    with rasterio.open(path, "w", width=side, height=side, **profile) as dataset:
        for row in range(0, side, band):
            rows = min(band, side - row)
            part = coarse[row // 20 : (row + rows) // 20]
            gray = 128 + 40 * cv2.resize(part, (side, rows), interpolation=cv2.INTER_CUBIC)
            gray += rng.normal(0, 10, gray.shape).astype(np.float32)
            window = rasterio.windows.Window(0, row, side, rows)  # pyright: ignore
            dataset.write(np.clip(gray, 0, 255).astype(np.uint8), 1, window=window)


if __name__ == "__main__":
    sys.exit(main())
