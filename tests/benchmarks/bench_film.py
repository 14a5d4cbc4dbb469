"""Marks of a scan of 12 000 pixels, and of a coarse one: seconds of processor time, peak of memory.

`python -m tests.benchmarks.bench_film` draws one scan of a 230 mm frame at 20 micrometres, by bands
of rows, and one at 127. It orients them with and without a certificate of their marks, and finds
the marks like one that is shown; each in a process of its own. It prints a table and ends with 1
when a case with its mask took more than 6 s of processor time or 1 GiB.
"""

import sys
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import cv2
import numpy as np

from core.geometry.camera import Camera
from core.raster.scan_file import open_scan
from core.scans.copies import mark_shown_at, measure_like
from core.scans.film_area import detect_film_area
from core.scans.interior_orientation import orient_scan
from tests.benchmarks.bench_ortho import peak_gib
from tests.core.scans import film_maker
from tests.core.scans.film_maker import Film, film_from_pixel, write_gray

MARKS = {"1": (-106.0, 106.1), "2": (106.2, 106.0), "3": (105.9, -106.0), "4": (-106.0, -106.3)}
FILM = Film(kind="cross", pixel_mm=0.02, half_mm=115.0, fiducials=MARKS, turn_deg=0.3)
FILMS = {"20 um": FILM, "127 um": replace(FILM, pixel_mm=0.127)}
CASES = ("certified", "certified, with mask", "no certificate", "example, certified", "example")
CELLS, AROUND_MM = 40, 4.0
SECONDS = 6.0
MEMORY_GIB = 1.0
BAND = 500


def draw(path: Path, film: Film, seed: int) -> None:
    """The scan, written to a file."""
    size = round((2 * film.half_mm + 5.0) / film.pixel_mm)
    rng = np.random.default_rng(seed)
    coarse = rng.normal(120, 40, (size // CELLS, size // CELLS)).clip(20, 230).astype(np.uint8)
    gray = np.asarray(cv2.resize(coarse, (size, size), interpolation=cv2.INTER_CUBIC))
    matrix = film_from_pixel(film, size)
    columns = np.arange(size, dtype=np.float32) + 0.5
    for top in range(0, size, BAND):
        rows = np.arange(top, min(top + BAND, size), dtype=np.float32)[:, None] + 0.5
        x = matrix[0, 0] * columns + matrix[0, 1] * rows + matrix[0, 2]
        y = matrix[1, 0] * columns + matrix[1, 1] * rows + matrix[1, 2]
        band = gray[top : top + BAND]
        band[np.maximum(np.abs(x), np.abs(y)) >= film.half_mm] = film.margin
        noise = rng.normal(0, film.noise, band.shape)
        band[:] = np.clip(band + noise, 0, 255).astype(np.uint8)
    reach = round(AROUND_MM / film.pixel_mm)
    for place in MARKS.values():
        at = np.linalg.solve(matrix[:, :2], np.array(place) - matrix[:, 2])
        left, top = (int(value) - reach for value in at)
        part = gray[top : top + 2 * reach, left : left + 2 * reach].astype(np.float64)
        shifted = matrix.copy()
        shifted[:, 2] += matrix[:, :2] @ np.array([left, top])
        beside = at - np.array([left, top])
        film_maker.expose_mark(part, film, shifted, np.array(place), beside)
        part += rng.normal(0, film.noise, part.shape)
        gray[top : top + 2 * reach, left : left + 2 * reach] = np.clip(part, 0, 255)
    write_gray(path, gray, tiled=True)


def measured(path: Path, film: Film, how: str) -> tuple[int, int, float, float]:
    """Columns, marks found, seconds of processor time and most memory (GiB) of this process."""
    cv2.setNumThreads(1)
    known = MARKS if "certified" in how else {}
    camera = Camera("made", 150.0, (230.0, 230.0), fiducials_mm=known)
    began = process_time()
    if "example" in how:
        scan = open_scan(path)
        area = detect_film_area(scan, camera, film.pixel_mm)
        matrix = film_from_pixel(film, scan.size_px[0])
        column, row = np.linalg.solve(matrix[:, :2], np.array(MARKS["1"]) - matrix[:, 2]).tolist()
        shown = mark_shown_at(scan, area, (column, row), film.pixel_mm)
        marks = len(measure_like(scan, camera, film.pixel_mm, area, shown).marks)
        columns = scan.size_px[0]
    else:
        found = orient_scan(path, camera, film.pixel_mm * 1000)
        columns, marks = found.size_px[0], len(found.fiducials)
        if "mask" in how:
            found.masked()
    seconds = process_time() - began
    return columns, marks, seconds, peak_gib()


def main() -> int:
    """Run the measurements; 1 when the promise is broken."""
    sys.stdout.write(
        "| marks of a scan | columns | marks | seconds of processor time | peak GiB |\n"
        "|---|---|---|---|---|\n"
    )
    kept = True
    with TemporaryDirectory() as folder:
        for name, film in FILMS.items():
            path = Path(folder) / "film.tif"
            draw(path, film, 1)
            for how in CASES:
                with get_context("spawn").Pool(1) as pool:
                    columns, marks, seconds, gib = pool.apply(measured, (path, film, how))
                sys.stdout.write(
                    f"| {name}, {how} | {columns} | {marks} of 4 | {seconds:.1f} | {gib:.2f} |\n"
                )
                sys.stdout.flush()
                kept &= seconds <= SECONDS and gib <= MEMORY_GIB and marks == len(MARKS)
    return int(not kept)


if __name__ == "__main__":
    sys.exit(main())
