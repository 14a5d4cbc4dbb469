"""Writes a synthetic block as the folder a user's archive would be, with the truth beside it."""

import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import rasterio
from rasterio.errors import NotGeoreferencedWarning

from core.progress import Progress, Silent
from core.raster.grid import Grid
from core.synthetic.approximations import write_approximations
from core.synthetic.film import make_scan
from core.synthetic.flight import Exposure, Flight, make_flight
from core.synthetic.landscape import Landscape, make_landscape
from core.synthetic.marks import draw_margin, draw_scars
from core.synthetic.options import CRS, Scale, SyntheticOptions, seeded
from core.synthetic.painting import Ground, Picture, paint
from core.synthetic.reference import (
    softened,
    write_dem,
    write_roads,
    write_sheets,
    write_terrain,
    write_truth_ortho,
)
from core.synthetic.truth import write_truth

PRESENT_YEAR = 2022


def make_block(
    folder: Path, options: SyntheticOptions | None = None, progress: Progress | None = None
) -> None:
    """A complete block folder: scans, reference, `block.toml`, and `truth/`.

    Args:
        folder: Where to write; made if it is not there.
        options: What is wanted.
        progress: Told how far the work is, and asked whether to stop.
    """
    options, progress = options or SyntheticOptions(), progress or Silent()
    scale = options.scale
    flight = make_flight(options)
    landscape = make_landscape(options, flight.terrain, flight.bounds)
    grid = Grid.over(flight.bounds, scale.texture_m)
    folder.mkdir(parents=True, exist_ok=True)
    progress.report(0.0, 100.0, "the ground of today")
    _write_present(folder, landscape, flight, grid, scale)
    progress.report(35.0, 100.0, "the ground of the archival epoch")
    ground = paint(landscape.scene(True, grid), grid)
    write_truth_ortho(folder / "truth" / "archival_ortho.tif", ground, scale.ortho_m[0])
    write_terrain(folder / "truth" / "terrain.tif", flight.terrain, flight.bounds)
    softened(ground, max(0.3, 0.42 * scale.scan_ground_m / scale.texture_m))
    _write_scans(folder, flight, ground, options, progress)
    write_approximations(folder, flight, options)
    (folder / "block.toml").write_text(_block_toml(flight, options), encoding="utf-8")
    write_truth(folder, flight, landscape.network, options)
    progress.report(100.0, 100.0, "block written")


def _write_present(
    folder: Path, landscape: Landscape, flight: Flight, grid: Grid, scale: Scale
) -> None:
    """Ortho sheets, roads and DEM of today."""
    scene = landscape.scene(False, grid)
    ground = paint(scene, grid)
    write_sheets(folder / "ortho", ground, scene, scale.ortho_m, PRESENT_YEAR)
    seed = landscape.options.seed
    write_roads(folder / "roads", landscape.network, seed)
    write_dem(folder / "dem.tif", flight.terrain, flight.bounds, scale.dem_m, seed)


def _write_scans(
    folder: Path, flight: Flight, ground: Ground, options: SyntheticOptions, progress: Progress
) -> None:
    (folder / "scans").mkdir(exist_ok=True)
    seed, film = options.seed, options.developed

    def finished(exposure: Exposure) -> Picture:
        scan = make_scan(ground, flight.terrain, exposure, flight.camera, seed, film)
        # The margin states the principal distance that everybody knows, not the true one.
        margin = seeded(seed, "margin", exposure.photo_id)
        draw_margin(scan, exposure, flight.nominal, margin)
        draw_scars(scan, exposure, seeded(seed, "scars", exposure.photo_id))
        return scan

    with ThreadPoolExecutor(2) as pool:
        for number, scan in enumerate(pool.map(finished, flight.exposures)):
            name = flight.exposures[number].photo_id
            pixel_um = options.scale.scan_pixel_um
            _write_scan(folder / "scans" / f"{name}.tif", scan, pixel_um, tiled=number % 2 == 0)
            progress.report(60.0 + 6.0 * (number + 1), 100.0, f"scan {name}")


def _write_scan(path: Path, scan: Picture, pixel_um: float, tiled: bool) -> None:
    """8-bit gray TIFF; an archive has tiled and stripped ones side by side."""
    options: dict[str, Any] = {"tiled": True, "blockxsize": 256, "blockysize": 256}
    if not tiled:
        options = {"tiled": False, "blockysize": 64}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with rasterio.open(
            path,
            "w",
            driver="GTiff",
            width=scan.shape[1],
            height=scan.shape[0],
            count=1,
            dtype="uint8",
            photometric="minisblack",
            **options,
        ) as raster:
            resolution = f"{25400.0 / pixel_um:.3f}"
            raster.update_tags(
                TIFFTAG_XRESOLUTION=resolution,
                TIFFTAG_YRESOLUTION=resolution,
                TIFFTAG_RESOLUTIONUNIT="2 (pixels/inch)",
            )
            raster.write(scan, 1)


def _block_toml(flight: Flight, options: SyntheticOptions) -> str:
    """The project as the user would have described it: nominal camera, no truth."""
    camera, scale = flight.nominal, options.scale
    marks = ", ".join(
        f"{name} = [{x:g}, {y:g}]" for name, (x, y) in sorted(camera.fiducials_mm.items())
    )
    begin = "none" if options.georeference == "exterior" else options.georeference
    lines = [
        "[block]",
        f'name = "synthetic-{options.epoch}-seed{options.seed}"',
        f'crs = "{CRS}"',
        'heights = "Bpv"',
        "",
        f"[camera.{camera.name}]",
        f"principal_distance_mm = {camera.principal_distance_mm:g}",
        f"frame_mm = [{camera.frame_mm[0]:.1f}, {camera.frame_mm[1]:.1f}]",
        f"fiducials_mm = {{ {marks} }}",
        "",
        "[scans]",
        'files = "scans/*.tif"',
        f'camera = "{camera.name}"',
        f"scan_pixel_um = {scale.scan_pixel_um:.1f}",
    ]
    if options.georeference in ("world-file", "footprints"):
        lines += ['footprints = "footprints.gpkg"', 'footprint_name = "LMS_TIF_UP"']
    if options.georeference == "exterior":
        lines += ['exterior = "eo.csv"']
    lines += [
        f'georeference = "{begin}"',
        "",
        "[reference]",
        'ortho = "ortho/*.tif"',
        'dem = "dem.tif"',
        'roads = ["roads/SilniceDalnice.shp", "roads/Ulice.shp", "roads/Cesta.shp"]',
        "ortho_sigma_m = 0.25",
        "dem_sigma_m = 0.5",
        "",
        "[ortho]",
        f"gsd_m = {scale.ortho_m[0]:g}",
        "",
    ]
    return "\n".join(lines)
