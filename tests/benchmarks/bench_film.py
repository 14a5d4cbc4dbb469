"""Fiducials and mask of a scan of 12 000 pixels: seconds of processor time and peak of memory.

`python -m tests.benchmarks.bench_film` draws one scan of a 230 mm frame at 20 micrometres, by bands
of rows, orients it and makes its mask in a process of its own, prints one row of a table and ends
with 1 when that took more than 6 s of processor time or 1 GiB.
"""

import resource
import sys
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import cv2
import numpy as np

from core.geometry.camera import Camera
from core.scans.interior_orientation import orient_scan
from tests.core.scans import film_maker
from tests.core.scans.film_maker import Film, film_from_pixel, write_gray

MARKS = {"1": (-106.0, 106.1), "2": (106.2, 106.0), "3": (105.9, -106.0), "4": (-106.0, -106.3)}
FILM = Film(kind="cross", pixel_mm=0.02, half_mm=115.0, fiducials=MARKS, turn_deg=0.3)
SECONDS = 6.0
MEMORY_KIB = 1 << 20
BAND = 500


def draw(path: Path, seed: int) -> None:
    """The scan, written to a file."""
    size = round((2 * FILM.half_mm + 5.0) / FILM.pixel_mm)
    rng = np.random.default_rng(seed)
    coarse = rng.normal(120, 40, (size // 40, size // 40)).clip(20, 230).astype(np.uint8)
    gray = np.asarray(cv2.resize(coarse, (size, size), interpolation=cv2.INTER_CUBIC))
    matrix = film_from_pixel(FILM, size)
    columns = np.arange(size, dtype=np.float32) + 0.5
    for top in range(0, size, BAND):
        rows = np.arange(top, min(top + BAND, size), dtype=np.float32)[:, None] + 0.5
        x = matrix[0, 0] * columns + matrix[0, 1] * rows + matrix[0, 2]
        y = matrix[1, 0] * columns + matrix[1, 1] * rows + matrix[1, 2]
        band = gray[top : top + BAND]
        band[np.maximum(np.abs(x), np.abs(y)) >= FILM.half_mm] = FILM.margin
        noise = rng.normal(0, FILM.noise, band.shape)
        band[:] = np.clip(band + noise, 0, 255).astype(np.uint8)
    for place in MARKS.values():
        at = np.linalg.solve(matrix[:, :2], np.array(place) - matrix[:, 2])
        left, top = (int(value) - 200 for value in at)
        part = gray[top : top + 400, left : left + 400].astype(np.float64)
        shifted = matrix.copy()
        shifted[:, 2] += matrix[:, :2] @ np.array([left, top])
        beside = at - np.array([left, top])
        film_maker.expose_mark(part, FILM, shifted, np.array(place), beside)
        part += rng.normal(0, FILM.noise, part.shape)
        gray[top : top + 400, left : left + 400] = np.clip(part, 0, 255)
    write_gray(path, gray, tiled=True)


def measured(path: Path) -> tuple[int, int, float, int]:
    """Columns, marks found, seconds of processor time and peak of memory (KiB) of this process."""
    cv2.setNumThreads(1)
    camera = Camera("made", 150.0, (230.0, 230.0), fiducials_mm=MARKS)
    began = process_time()
    found = orient_scan(path, camera, FILM.pixel_mm * 1000)
    found.masked()
    seconds = process_time() - began
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return found.size_px[0], len(found.fiducials), seconds, peak


def main() -> int:
    """Run the measurement; 1 when the promise is broken."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "film.tif"
        draw(path, 1)
        with get_context("spawn").Pool(1) as pool:
            columns, marks, seconds, peak = pool.apply(measured, (path,))
    sys.stdout.write(
        "| columns | marks | seconds of processor time | peak GiB |\n|---|---|---|---|\n"
    )
    sys.stdout.write(f"| {columns} | {marks} of 4 | {seconds:.1f} | {peak / (1 << 20):.2f} |\n")
    return int(seconds > SECONDS or peak > MEMORY_KIB or marks < 4)


if __name__ == "__main__":
    sys.exit(main())
