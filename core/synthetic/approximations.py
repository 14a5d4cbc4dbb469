"""What the archive says of where its photos lie: world files, footprints, points, orientations."""

from pathlib import Path

import numpy as np
from shapely.geometry import Polygon

from core.arrays import Affine2, ObjectPoints, PixelPoints, Scalars
from core.synthetic.flight import Exposure, Flight
from core.synthetic.options import CRS, SyntheticOptions, seeded
from core.synthetic.reference import write_layer


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
    matrix = world_file_matrix(pixels, plan)
    first = matrix[:, :2] @ np.array([0.5, 0.5]) + matrix[:, 2]
    values = [*matrix[:, 0], *matrix[:, 1], *first]
    path.write_text("".join(f"{value:.10f}\n" for value in values), encoding="ascii")


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
        angles = np.degrees([true.omega, true.phi, true.kappa]) + rng.normal(0.0, degrees, 3)
        values = [*(f"{v:.3f}" for v in centre), *(f"{v:.5f}" for v in angles)]
        known = [f"{metres:g}"] * 3 + [f"{degrees:g}"] * 3
        lines.append(",".join([exposure.photo_id, *values, *known]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
