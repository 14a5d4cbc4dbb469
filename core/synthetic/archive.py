"""Writes a synthetic block as the folder a user's archive would be, with the truth beside it."""

import shutil
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from rasterio.errors import NotGeoreferencedWarning
from shapely.geometry import Polygon

from core.arrays import Affine2, ObjectPoints, PixelPoints, Scalars
from core.formats.world_file import write_world_file
from core.progress import Progress, Silent
from core.raster.grid import Grid
from core.synthetic.film import draw_margin, draw_scars, make_scan
from core.synthetic.flight import Exposure, Flight, make_flight
from core.synthetic.landscape import Landscape, make_landscape
from core.synthetic.options import CRS, PRESENT_YEAR, Scale, SyntheticOptions, seeded
from core.synthetic.painting import Ground, Picture, paint
from core.synthetic.reference import (
    blur_ground,
    write_dem,
    write_layer,
    write_roads,
    write_sheets,
    write_terrain,
    write_truth_ortho,
)
from core.synthetic.truth import write_truth


def make_block(
    folder: Path, options: SyntheticOptions | None = None, progress: Progress | None = None
) -> None:
    """A complete block folder: scans, reference, `block.toml`, and `truth/`.

    Args:
        folder: Where to write; made if it is not there.
        options: What is wanted.
        progress: Told how far the work is, and asked whether to stop.
    """
    options = options or SyntheticOptions()
    flight = make_flight(options)
    landscape = make_landscape(options, flight.terrain, flight.bounds)
    write_block(folder, flight, landscape, options, progress)


def write_block(
    folder: Path,
    flight: Flight,
    landscape: Landscape,
    options: SyntheticOptions,
    progress: Progress | None = None,
    *,
    present: Path | None = None,
) -> None:
    """Write the folder of a block.

    Args:
        folder: Where to write; made if it is not there.
        flight: The flight.
        landscape: The place.
        options: What film, georeference and sizes are.
        progress: Told how far the work is, and asked whether to stop.
        present: Folder of another block over the same place, whose reference is taken; None paints
            the present.
    """
    progress, scale = progress or Silent(), options.scale
    grid = Grid.over(flight.bounds, scale.texture_m)
    folder.mkdir(parents=True, exist_ok=True)
    progress.report(0.0, 100.0, "the ground of today")
    if present is None:
        _write_present(folder, landscape, flight, grid, scale=scale)
    else:
        for name in ("ortho", "roads"):
            shutil.copytree(present / name, folder / name, dirs_exist_ok=True)
        shutil.copy(present / "dem.tif", folder)
    progress.report(35.0, 100.0, "the ground of the archival epoch")
    ground = paint(landscape.scene(True, grid), grid)
    write_truth_ortho(folder / "truth" / "archival_ortho.tif", ground, scale.ortho_m[0])
    write_terrain(folder / "truth" / "terrain.tif", flight.terrain, flight.bounds)
    blur_ground(ground, max(0.3, 0.42 * scale.scan_ground_m / scale.texture_m))
    _write_scans(folder, flight, ground, options, progress)
    write_approximations(folder, flight, options)
    (folder / "block.toml").write_text(_block_toml(flight, options), encoding="utf-8")
    write_truth(folder, flight, landscape.network, options)
    progress.report(100.0, 100.0, "block written")


def _write_present(
    folder: Path, landscape: Landscape, flight: Flight, grid: Grid, *, scale: Scale
) -> None:
    """Ortho sheets, roads and DEM of today."""
    scene = landscape.scene(False, grid)
    ground = paint(scene, grid)
    write_sheets(folder / "ortho", ground, scene, scale.ortho_m, year=PRESENT_YEAR)
    seed = landscape.options.seed
    write_roads(folder / "roads", landscape.network, seed)
    write_dem(folder / "dem.tif", landscape.terrain, flight.bounds, scale.dem_m, seed)


def _write_scans(
    folder: Path, flight: Flight, ground: Ground, options: SyntheticOptions, progress: Progress
) -> None:
    (folder / "scans").mkdir(exist_ok=True)
    seed, film = options.seed, options.developed

    def finished(exposure: Exposure) -> Picture:
        scan = make_scan(ground, flight.terrain, exposure, flight.camera, seed=seed, options=film)
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


def write_approximations(folder: Path, flight: Flight, options: SyntheticOptions) -> None:
    """The files of the wanted kind of georeference; `world-file` comes with footprints.

    Args:
        folder: The block's folder; world files and points go beside the scans.
        flight: The true flight.
        options: Which georeference, and how good.
    """
    if options.georeference == "world-file":
        for exposure in flight.exposures:
            _write_world_file(
                folder / "scans" / f"{exposure.photo_id}.tfw", exposure, flight, options
            )
    if options.georeference in ("world-file", "footprints"):
        _write_footprints(folder / "footprints.gpkg", flight, options)
    if options.georeference == "points":
        for exposure in flight.exposures:
            _write_points(
                folder / "scans" / f"{exposure.photo_id}.tif.points", exposure, flight, options
            )
    if options.georeference == "exterior":
        _write_exterior(folder / "eo.csv", flight, options)


def _frame(exposure: Exposure, flight: Flight) -> tuple[PixelPoints, ObjectPoints]:
    """Corners of the frame in the scan and on the terrain."""
    pixels = exposure.pixels(flight.camera.frame_corners_mm)
    return pixels, exposure.ground_from_pixel(pixels, flight.terrain, flight.camera)


def _error(options: SyntheticOptions, name: str) -> tuple[Scalars, float, float]:
    """Shift (metres), turn (radians) and scale by which a georeference is wrong."""
    rng = seeded(options.seed, "georeference", name)
    bad = options.georeference_quality == "bad"
    length = rng.uniform(100.0, 300.0) if bad else rng.uniform(5.0, 10.0)
    way = rng.uniform(0.0, 2 * np.pi)
    turn = rng.normal(0.0, np.radians(1.0 if bad else 0.3))
    scale = 1.0 + (rng.normal(0.0, 0.02) if bad else rng.normal(0.0, 0.002))
    return length * np.array([np.cos(way), np.sin(way)]), float(turn), float(scale)


def _displaced(points: np.ndarray, options: SyntheticOptions, name: str) -> np.ndarray:
    """Plan points moved, turned and scaled about their middle."""
    shift, turn, scale = _error(options, name)
    turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    middle = points.mean(axis=0)
    return middle + scale * (points - middle) @ turned.T + shift


def world_file_matrix(pixels: PixelPoints, plan: np.ndarray) -> Affine2:
    """Similarity of an un-mirrored photo, plan = matrix (column, row, 1), by least squares."""
    column, row = pixels[:, 0], pixels[:, 1]
    ones, none = np.ones(len(pixels)), np.zeros(len(pixels))
    design = np.vstack(
        [np.column_stack([column, row, ones, none]), np.column_stack([-row, column, none, ones])]
    )
    values = np.concatenate([plan[:, 0], plan[:, 1]])
    a, b, east, north = np.linalg.lstsq(design, values, rcond=None)[0]
    return np.array([[a, b, east], [b, -a, north]])


def _write_world_file(
    path: Path, exposure: Exposure, flight: Flight, options: SyntheticOptions
) -> None:
    pixels, ground = _frame(exposure, flight)
    plan = _displaced(ground[:, :2], options, exposure.photo_id)
    write_world_file(path, world_file_matrix(pixels, plan))


def _write_footprints(path: Path, flight: Flight, options: SyntheticOptions) -> None:
    shapes = []
    for exposure in flight.exposures:
        _, ground = _frame(exposure, flight)
        shapes.append(Polygon(_displaced(ground[:, :2], options, f"footprint {exposure.photo_id}")))
    names = [f"{exposure.photo_id}.tif" for exposure in flight.exposures]
    write_layer(path, shapes, {"LMS_TIF_UP": np.array(names, dtype=object)})


def _write_points(
    path: Path, exposure: Exposure, flight: Flight, options: SyntheticOptions
) -> None:
    """Five points clicked in QGIS: corner origin, rows counted negative, one switched off."""
    rng = seeded(options.seed, "clicks", exposure.photo_id)
    film = np.array([[-70.0, -66.0], [68.0, -71.0], [72.0, 64.0], [-66.0, 70.0], [4.0, 2.0]])
    pixels = exposure.pixels(film + rng.uniform(-5.0, 5.0, film.shape))
    ground = exposure.ground_from_pixel(pixels, flight.terrain, flight.camera)[:, :2]
    sigma = 30.0 if options.georeference_quality == "bad" else 3.0
    ground = ground + rng.normal(0.0, sigma, ground.shape)
    rows = [f"#CRS: {CRS}", "mapX,mapY,sourceX,sourceY,enable,dX,dY,residual"]
    for number, ((east, north), (column, row)) in enumerate(zip(ground, pixels, strict=True)):
        used = 0 if number == 4 else 1
        rows.append(f"{east:.3f},{north:.3f},{column:.3f},{-row:.3f},{used},0,0,0")
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


def _write_exterior(path: Path, flight: Flight, options: SyntheticOptions) -> None:
    bad = options.georeference_quality == "bad"
    metres, degrees = (200.0, 1.0) if bad else (5.0, 0.1)
    names = "scan,X,Y,Z,omega_deg,phi_deg,kappa_deg"
    sigmas = "sigma_X,sigma_Y,sigma_Z,sigma_omega_deg,sigma_phi_deg,sigma_kappa_deg"
    lines = [f"{names},{sigmas}"]
    for exposure in flight.exposures:
        rng = seeded(options.seed, "exterior", exposure.photo_id)
        true = exposure.exterior
        centre = true.centre + rng.normal(0.0, metres, 3)
        angles = np.degrees(true.angles) + rng.normal(0.0, degrees, 3)
        values = [*(f"{v:.3f}" for v in centre), *(f"{v:.5f}" for v in angles)]
        known = [f"{metres:g}"] * 3 + [f"{degrees:g}"] * 3
        lines.append(",".join([exposure.photo_id, *values, *known]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
