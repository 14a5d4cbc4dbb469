"""Blocks on which tie points are proved: photos as the stages before leave them, and the truth."""

import csv
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import rasterio

from app.project import described, read_project
from core.block import (
    Block,
    ExteriorPrior,
    Measurement,
    Photo,
    SurveyedPoint,
    TiePoints,
    ground_of,
)
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation
from core.pipeline import STAGES, made
from core.progress import Work
from core.raster.grid import Grid
from core.results import StageResults
from core.scans.interior_orientation import ScanOrientation, orient_scan
from core.synthetic.archive import make_block
from core.synthetic.options import SyntheticOptions
from core.synthetic.truth import Truth, read_truth
from core.ties.features import Usable
from tests.real.readers import SXB, read_sxb

WILD_MM = 106.0
"""The corner marks of a Wild camera, millimetres from the middle."""


@dataclass(frozen=True)
class TieCase:
    """A block ready for its tie points."""

    name: str
    block: Block
    usable: dict[str, Usable]
    truth: Truth | None = None


def synthetic(folder: Path, options: SyntheticOptions) -> TieCase:
    """A synthetic block, made where it is not there yet, up to its approximate orientation."""
    if not (folder / "block.toml").is_file():
        make_block(folder, options)
    level = "flat" if options.relief_m < 50 else "hilly"
    change = f"{100 * options.road_change:.0f} % changed"
    return known(f"{options.epoch}, {level}, {change}, seed {options.seed}", folder)


def known(name: str, folder: Path) -> TieCase:
    """A block with a `block.toml` and a truth, up to its approximate orientation."""
    given = described(read_project(folder))
    results, work = StageResults(), Work(seed=given.name)
    for stage in STAGES[:2]:
        results = replace(results, **{stage.name: stage.run(given, results, work)})
    scans, block = made(results.scans).oriented, made(results.georeference).block
    masks = {photo: usable_of(scans[photo]) for photo in block.photos}
    truth = read_truth(folder)
    if truth.heights is None:
        truth = replace(truth, heights=heights_of(folder / "dem.tif"))
    return TieCase(name, block, masks, truth)


def usable_of(scan: ScanOrientation) -> Usable:
    """Where features may lie in a scan."""
    return scan.usable().at


def heights_of(dem: Path) -> tuple[Grid, np.ndarray]:
    """Heights of a file on its grid."""
    with rasterio.open(dem) as raster:
        west, north, gsd = raster.transform.c, raster.transform.f, raster.transform.a
        grid = Grid(float(west), float(north), float(gsd), int(raster.width), int(raster.height))
        return grid, raster.read(1).astype(np.float64)


def strasbourg(data: Path) -> TieCase:
    """Five digital frames of which nothing is known but the camera and a place within 50 m."""
    block = read_sxb(data / SXB)
    images = data / "sxb-strasbourg/prague2016_sxb/images"
    photos = {
        name: replace(photo, scan=images / f"{name}.jpg", ground_height_m=140.0)
        for name, photo in block.photos.items()
    }
    return TieCase("sxb-strasbourg", replace(block, photos=photos), {})


def canberra(data: Path, films: tuple[str, ...] = ("1985", "1968")) -> TieCase:
    """Prints of several decades; nothing is known but the camera: all pairs are tried."""
    folder = data / "act-canberra-film"
    signs = {"1": (-1.0, 1.0), "2": (1.0, 1.0), "3": (1.0, -1.0), "4": (-1.0, -1.0)}
    marks = {name: (WILD_MM * x, WILD_MM * y) for name, (x, y) in signs.items()}
    camera = Camera("wild", 152.75, (230.0, 230.0), fiducials_mm=marks)
    scans: dict[str, ScanOrientation] = {}
    places: dict[str, np.ndarray] = {}
    with (folder / "frames.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            path = folder / "frames" / row["file"]
            if path.is_file() and row["year"] in films:
                scans[path.stem] = orient_scan(path, camera, 25400.0 / float(row["dpi"]))
                height = 600.0 + float(row["HAGL_m"])
                east, north = (row[f"centre_{axis}_agd66_actgrid"] for axis in "EN")
                places[path.stem] = np.array([float(east), float(north), height])
    photos = {}
    for name, scan in scans.items():
        start = ExteriorOrientation(places[name], 0.0, 0.0, 0.0)
        prior = ExteriorPrior(np.full(3, 1e5), np.full(3, 100.0))
        photos[name] = Photo(
            name, scan.scan.path, scan.size_px, "wild", scan.interior, start, start, prior,
            600.0,
        )  # fmt: skip
    masks = {name: usable_of(scan) for name, scan in scans.items()}
    return TieCase("act-canberra-film", Block("ESRI:102071", {"wild": camera}, photos), masks)


def true_block(case: TieCase) -> Block:
    """The block with true interiors, orientations and camera."""
    assert case.truth is not None
    photos = {}
    none = np.zeros((0, 2))
    for name, photo in case.block.photos.items():
        exposure = case.truth.photos[name]
        inverse = np.linalg.inv(exposure.pixel_from_film[:, :2])
        matrix = np.column_stack([inverse, -inverse @ exposure.pixel_from_film[:, 2]])
        interior = InteriorOrientation("affine", matrix, (), none, none, float("nan"))
        photos[name] = replace(photo, interior=interior, exterior=exposure.exterior)
    cameras = {name: replace(case.truth.camera, name=name) for name in case.block.cameras}
    return Block(case.block.crs, cameras, photos)


def with_control(case: TieCase, ties: TiePoints, rng: np.random.Generator) -> Block:
    """The block with its ties and surveyed points on a grid: 0.2 m, measured to 0.3 pixels."""
    true, inset = true_block(case), 0.46
    camera = next(iter(true.cameras.values()))
    corners = np.vstack(
        [
            ground_of(photo, camera, photo.interior.pixel_from_film(camera.frame_corners_mm))
            for photo in true.photos.values()
        ]
    )
    low, high = np.quantile(corners[:, :2], 0.05, axis=0), np.quantile(corners[:, :2], 0.95, axis=0)
    lines = [np.linspace(low[axis], high[axis], 5) for axis in range(2)]
    plan = np.stack(np.meshgrid(*lines), axis=-1).reshape(-1, 2)
    ground = np.column_stack([plan, np.full(len(plan), corners[:, 2].mean())])
    ground[:, 2] = case.truth.heights_at(ground)  # pyright: ignore
    surveyed, measured = {}, {}
    for number, place in enumerate(ground):
        name = f"P{number}"
        for photo in true.photos.values():
            pixel = photo.pixel_from_object(place[None], camera)
            film = photo.interior.film_from_pixel(pixel)
            if np.all(np.abs(film) < inset * np.array(camera.frame_mm)):
                column, row = (pixel[0] + rng.normal(0, 0.3, 2)).tolist()
                measured[name, photo.photo_id] = Measurement(
                    name, photo.photo_id, column, row, 0.3, status="accepted"
                )
                known = place + rng.normal(0, 0.2, 3)
                surveyed.setdefault(
                    name, SurveyedPoint(name, known, np.full(3, 0.2), "control", "surveyed")
                )
    photos = {name: replace(photo, oriented=True) for name, photo in case.block.photos.items()}
    return replace(case.block, photos=photos, surveyed=surveyed, measurements=measured, ties=ties)


def wrong_points(case: TieCase, ties: TiePoints, limit_px: float = 3.0) -> np.ndarray:
    """Points whose rays, on the true ground, lie more than so many scan pixels apart (flags)."""
    assert case.truth is not None
    ground = np.full((len(ties.point), 3), np.nan)
    for number, name in enumerate(ties.photo_ids):
        rays = np.flatnonzero(ties.photo == number)
        height = np.full(len(rays), case.block.photos[name].ground_height_m)
        for _ in range(8):
            plan = case.truth.ground_of(name, ties.pixels[rays], height)
            places = np.column_stack([plan, height])
            height = 0.2 * height + 0.8 * case.truth.heights_at(places)
        ground[rays] = places
    low, high = np.full((ties.count, 2), np.inf), np.full((ties.count, 2), -np.inf)
    np.minimum.at(low, ties.point, ground[:, :2])
    np.maximum.at(high, ties.point, ground[:, :2])
    photo = next(iter(case.block.photos.values()))
    pixel_m = (
        (photo.exterior.centre[2] - photo.ground_height_m)
        * photo.interior.pixel_size_mm
        / case.block.camera_of(photo.photo_id).principal_distance_mm
    )
    return np.linalg.norm(high - low, axis=1) > limit_px * pixel_m
