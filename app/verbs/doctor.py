"""What this machine and a block lack."""

import argparse
import os
import shutil
import warnings
from collections.abc import Iterator
from pathlib import Path

import psutil
import pyogrio
import pyproj
import rasterio
from pyproj.transformer import TransformerGroup

from app.block_toml import FILE
from app.height_checks import height_doubts
from app.project import described, read_project
from app.terminal import Voice
from core.geometry.map_in_space import check_scale
from core.matching.reference import open_reference
from core.said import say

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox")
GIB = 1024**3
LEAST_MEMORY_GIB = 4.0
SPACE_PER_SCAN_GIB = 0.6


def doctor(given: argparse.Namespace, voice: Voice) -> None:
    """What this machine, and a block, lack; left out, that of the current folder, if any."""
    here = Path() if Path(FILE).is_file() else None
    for finding in examine(given.block or here):
        voice.say(finding)


def examine(block: Path | None) -> Iterator[str]:
    """Findings on the machine, then on a block; a line that begins with `!` needs attention."""
    yield f"GDAL {rasterio.__gdal_version__}, PROJ {pyproj.proj_version_str}"
    yield from drivers()
    yield from grids()
    browser = next((name for name in BROWSERS if shutil.which(name)), None)
    yield (
        say("Browser: {browser}", browser=browser)
        if browser
        else "! No browser found: open the desk's address by hand"
    )
    memory = psutil.virtual_memory().total / GIB
    yield attention(
        say(
            "Memory: {memory:.0f} GiB ({enough:.0f} GiB are enough for any scan)",
            memory=memory, enough=LEAST_MEMORY_GIB,
        ),
        memory < LEAST_MEMORY_GIB,
    )  # fmt: skip
    yield say("Processors: {count}", count=os.cpu_count() or 1)
    if block is not None:
        yield from of_block(block)
    else:
        yield say("Disk: {free:.1f} GiB free", free=free_gib(Path()))


def attention(finding: str, needed: bool = True) -> str:
    """A finding, marked where it needs attention."""
    return say("! {finding}", finding=finding) if needed else finding


def free_gib(folder: Path) -> float:
    """Space left on the disk of a folder."""
    return shutil.disk_usage(folder).free / GIB


def drivers() -> Iterator[str]:
    """Raster and vector formats that archives use."""
    with rasterio.Env() as env:
        known = env.drivers()
    for name, use in (("GTiff", "TIFF"), ("JP2OpenJPEG", "JPEG 2000"), ("COG", "mosaics")):
        if name not in known:
            yield say("! GDAL has no driver {name} ({use})", name=name, use=use)
    for name in ("ESRI Shapefile", "GPKG", "GeoJSON"):
        if name not in pyogrio.list_drivers():
            yield say("! GDAL has no vector driver {name}", name=name)


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
    told = "Block {name}: {count:# scan|# scans}, {crs}"
    yield say(told, name=given.name, count=len(given.scans), crs=given.crs)
    if not given.reference.ortho:
        yield "No reference ortho: nothing is proposed; measure your own points at the desk"
    else:
        gsd = reference.ortho.ground_sample_distance_m
        dem = reference.dem.ground_sample_distance_m
        yield say("Reference: ortho {gsd:g} m, DEM {dem:g} m", gsd=gsd, dem=dem)
        for doubt in check_scale(given.crs, reference.ortho.bounds):
            yield attention(doubt.message)
    if not given.reference.dem:
        yield "! No DEM: the ground is taken as level, and orthos are off by the relief"
    if given.reference.ortho and not given.reference.roads:
        yield "No road layers: control comes from salient points of the ortho alone"
    if not all(given.cameras[scan.camera].fiducials_mm for scan in given.scans):
        yield (
            "! Some cameras have no fiducials_mm: their marks are looked for, and placed by all "
            "photos together"
        )
    for doubt in height_doubts(project, given.surveyed, reference.dem):
        yield attention(doubt.message)
    free = free_gib(project.folder)
    needed = SPACE_PER_SCAN_GIB * len(given.scans)
    disk = "Disk: {free:.1f} GiB free, about {needed:.1f} GiB needed"
    yield attention(say(disk, free=free, needed=needed), free <= needed)
