"""What this machine and a block lack: PROJ grids, GDAL drivers, browser, disk, memory."""

import os
import shutil
import warnings
from collections.abc import Iterator
from pathlib import Path

import pyogrio
import pyproj
import rasterio
from pyproj.transformer import TransformerGroup

from app.block_input import described
from app.project import read_project
from core.matching.reference import open_reference

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox")
GIB = 1024**3
LEAST_MEMORY_GIB = 4.0
SPACE_PER_SCAN_GIB = 0.6


def examine(block: Path | None) -> Iterator[str]:
    """Findings on the machine, then on a block; a line that begins with `!` needs attention."""
    yield f"GDAL {rasterio.__gdal_version__}, PROJ {pyproj.proj_version_str}"
    yield from drivers()
    yield from grids()
    browser = next((name for name in BROWSERS if shutil.which(name)), None)
    yield (
        f"Browser: {browser}" if browser else "! No browser found: open the desk's address by hand"
    )
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / GIB
    note = "" if memory >= LEAST_MEMORY_GIB else "! "
    yield f"{note}Memory: {memory:.0f} GiB ({LEAST_MEMORY_GIB:.0f} GiB are enough for any scan)"
    yield f"Processors: {os.cpu_count()}"
    if block is not None:
        yield from of_block(block)


def drivers() -> Iterator[str]:
    """Raster and vector formats that archives use."""
    with rasterio.Env() as env:
        known = env.drivers()
    for name, use in (("GTiff", "TIFF"), ("JP2OpenJPEG", "JPEG 2000"), ("COG", "mosaics")):
        if name not in known:
            yield f"! GDAL has no driver {name} ({use})"
    for name in ("ESRI Shapefile", "GPKG", "GeoJSON"):
        if name not in pyogrio.list_drivers():
            yield f"! GDAL has no vector driver {name}"


def grids() -> Iterator[str]:
    """The grids that heights and datums of Czechia need."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what is missing is told below, in our words
        group = TransformerGroup("EPSG:5514+8357", "EPSG:4937", always_xy=True)
    if not group.best_available:
        yield (
            "! PROJ lacks the grids for S-JTSK and Bpv heights: keep reference and control in one "
            "CRS (nothing is then transformed), or install them with projsync"
        )


def of_block(block: Path) -> Iterator[str]:
    """What a block lacks: files, space for its results."""
    project = read_project(block)
    given = described(project)
    reference = open_reference(given.reference)
    yield f"Block {given.name}: {len(given.scans)} scans, {given.crs}"
    gsd = reference.ortho.ground_sample_distance_m
    yield f"Reference: ortho {gsd:g} m, DEM {reference.dem.ground_sample_distance_m:g} m"
    if not given.reference.roads:
        yield "No road layers: control comes from salient points of the ortho alone"
    if not all(given.cameras[scan.camera].fiducials_mm for scan in given.scans):
        yield (
            "! Some cameras have no fiducials_mm: their marks are looked for, and placed by all "
            "photos together"
        )
    free = shutil.disk_usage(project.folder).free / GIB
    needed = SPACE_PER_SCAN_GIB * len(given.scans)
    yield f"{'' if free > needed else '! '}Disk: {free:.1f} GiB free, about {needed:.1f} GiB needed"
