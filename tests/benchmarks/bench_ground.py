"""Processor seconds and memory of a mosaic and of the ortho of a large scan.

Run: python -m tests.benchmarks.bench_ground mosaic|ortho [frame px]

`mosaic`: three orthos of about 63 megapixels are composed, 190 in all, with seams, tones and
overviews. `ortho`: a scan of 25,000 px becomes an ortho.
Scans and DEM are those of `bench_ortho`. What is timed runs in a fresh process, so that its peak is
its own.
"""

import multiprocessing
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import perf_counter

from core.block import Photo
from core.geometry.camera import Camera
from core.mosaic.composition import compose_mosaic, mosaic_grid
from core.orthos.rectification import OrthoProduct, rectify_photo
from core.raster.dem import Dem, open_dem
from tests.benchmarks.bench_ortho import CRS, GSD, PIXEL_MM, peak_gib, processor_seconds, write_dem
from tests.benchmarks.bench_ortho import write_photo as written
from tests.benchmarks.large_desk import say

SIDES = {"mosaic": 7600, "ortho": 25_000}
PHOTOS = {"mosaic": 3, "ortho": 1}


def main() -> None:
    """Make scans, and measure what is asked for."""
    what = sys.argv[1]
    side = int(sys.argv[2]) if len(sys.argv) > 2 else SIDES[what]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        camera = Camera("wide", side * PIXEL_MM * 1.17, (side * PIXEL_MM, side * PIXEL_MM))
        heights = write_dem(folder, side)
        photos = {f"p{k}": written(folder, f"p{k}", side, k) for k in range(PHOTOS[what])}
        if what == "mosaic":
            orthos = [ortho_of(photo, camera, heights, folder) for photo in photos.values()]
            megapixels = sum(ortho.grid.columns * ortho.grid.rows for ortho in orthos) / 1e6
            report(f"mosaic of {megapixels:.0f} MP", partial(composed, orthos, folder))
        else:
            work = partial(ortho_of, photos["p0"], camera, heights, folder)
            report(f"ortho of a scan of {side} px", work)


def report(what: str, work: Callable[[], object]) -> None:
    """Run in a fresh process and print what it took."""
    held = multiprocessing.get_context("spawn")
    reading, writing = held.Pipe(duplex=False)
    began = perf_counter()
    child = held.Process(target=measured, args=(work, writing))
    child.start()
    child.join()
    assert child.exitcode == 0, what
    seconds, peak = reading.recv()
    say(f"{what}: {seconds:.1f} CPU s, {perf_counter() - began:.1f} s, peak {peak:.2f} GiB")


def measured(work: Callable[[], object], told) -> None:
    """Processor seconds of the work, and most memory of this process."""
    began = processor_seconds()
    work()
    told.send((processor_seconds() - began, peak_gib()))


def dem_of(path: Path) -> Dem:
    """The whole DEM."""
    heights = open_dem([path], CRS)
    return heights.cropped(heights.bounds)


def ortho_of(photo: Photo, camera: Camera, heights: Path, folder: Path) -> OrthoProduct:
    """An ortho on the DEM."""
    path = folder / f"{photo.photo_id}_ortho.tif"
    return rectify_photo(photo, camera, dem_of(heights), GSD, path, CRS)


def composed(orthos: list[OrthoProduct], folder: Path) -> None:
    """The mosaic with its seams."""
    compose_mosaic(orthos, mosaic_grid(orthos), folder / "m.tif", folder / "s.gpkg")


if __name__ == "__main__":
    main()
