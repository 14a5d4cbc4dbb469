"""A block for measuring the desk: 24 scans as small tiled TIFFs, 1,500 proposals, blunders."""

import os
import sys
import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import rasterio
from rasterio.errors import NotGeoreferencedWarning
from rasterio.windows import Window

from app.desk.inputs import Adjusting, DeskInputs
from core.adjustment.adjusted import AdjustmentOptions
from core.block import (
    Block,
    ExteriorPrior,
    Measurement,
    Peak,
    Photo,
    SurveyedPoint,
    TiePoints,
)
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation
from core.progress import Silent
from core.raster.grid import Grid
from core.raster.scan_file import ScanFiles
from sessions.session import HIDDEN, Session
from tests.ui.desk_landscape import ArrayDem, ArrayOrtho, keep_for_reduction
from ui.web.access import Door, lasting_token

FRAME_MM, PRINCIPAL_MM, FLYING_M = 180.0, 210.0, 1650.0
SIDE_M = FRAME_MM / PRINCIPAL_MM * FLYING_M
BASE_M, SPACING_M, MARGIN_M = 0.4 * SIDE_M, 0.7 * SIDE_M, 80.0
WEST, NORTH, GROUND_M = -742000.0, -1040000.0, 280.0
CAMERA = Camera("wide", PRINCIPAL_MM, (FRAME_MM, FRAME_MM))
NOISE_PX = 0.35


@dataclass(frozen=True)
class Size:
    """How large the block is, and how much of it is wrong."""

    strips: int = 4
    photos_a_strip: int = 6
    proposals: int = 1500
    ties: int = 3000
    scan_px: int = 1200
    wrong: float = 0.07
    seed: int = 1


@dataclass(frozen=True)
class LargeBlock:
    """The block as an engine would leave it, and the truth about it."""

    block: Block
    true_photos: dict[str, Photo]
    blunders: frozenset[tuple[str, str]]
    true_pixels: dict[tuple[str, str], np.ndarray]
    dem: ArrayDem
    extent_m: tuple[float, float]


def large_block(size: Size, scans: Path = Path("scans")) -> LargeBlock:
    """Numbers only: photos, points, measurements and ties; the scans need not exist."""
    rng = np.random.default_rng(size.seed)
    extent = (
        SIDE_M + (size.photos_a_strip - 1) * BASE_M + 2 * MARGIN_M,
        SIDE_M + (size.strips - 1) * SPACING_M + 2 * MARGIN_M,
    )
    dem = _terrain(rng, extent)
    truth = _photos(rng, size, scans)
    surveyed, measurements, blunders, pixels = _control(rng, size, truth, dem, extent)
    moved = {name: _blurred(rng, photo) for name, photo in truth.items()}
    ties = _ties(rng, truth, dem, extent, size)
    block = Block("EPSG:5514", {"wide": CAMERA}, moved, surveyed, measurements, ties)
    return LargeBlock(block, truth, blunders, pixels, dem, extent)


def large_inputs(folder: Path, size: Size, robust: bool = True, port: int = 0) -> DeskInputs:
    """Everything a desk needs over the block; scans are written into the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    made = large_block(size, folder / "scans")
    rng = np.random.default_rng(size.seed + 1)
    grid = Grid(WEST, NORTH, 1.0, round(made.extent_m[0]), round(made.extent_m[1]))
    grey = _texture(rng, grid.rows, grid.columns)
    _write_scans(made, grid, grey)
    tint = np.array([0.92, 1.0, 0.78], dtype=np.float32)
    colour = (grey[..., None] * tint).astype(np.uint8)
    keep_for_reduction(colour)
    options = AdjustmentOptions(robust=robust)
    adjust = Adjusting(options)
    return DeskInputs(
        name="desk-benchmark",
        block=made.block,
        report=adjust(made.block),
        session=Session.open(folder, "anna"),
        ortho=ArrayOrtho(grid, colour),
        dem=made.dem,
        read_scan=ScanFiles(folder),
        adjust=adjust,
        choose=adjust.choose,
        evidence=adjust.evidence,
        remake=lambda photo_ids, progress, report: None,
        operator="anna",
        door=Door(port=port),
        token=lasting_token(folder / HIDDEN),
    )


def with_huge_scan(inputs: DeskInputs, side_px: int) -> DeskInputs:
    """The desk with its first scan enlarged to a side of very many pixels, without overviews."""
    block = inputs.block
    name, photo = next(iter(block.photos.items()))
    factor = side_px // photo.size_px[0]
    side = factor * photo.size_px[0]
    path = photo.scan.with_name(f"{name}_huge.tif")
    if not path.exists():
        _enlarge(photo.scan, path, factor)
    interior = photo.interior
    matrix = interior.film_from_pixel_matrix.copy()
    matrix[:, :2] /= factor
    fine = replace(
        photo,
        scan=path,
        size_px=(side, side),
        interior=replace(interior, film_from_pixel_matrix=matrix),
    )
    measured = {
        key: replace(m, column=m.column * factor, row=m.row * factor, peaks=())
        if key[1] == name
        else m
        for key, m in block.measurements.items()
    }
    ties = block.ties
    pixels = np.where(
        (ties.photo == ties.photo_ids.index(name))[:, None], ties.pixels * factor, ties.pixels
    )
    fresh = replace(
        block,
        photos={**block.photos, name: fine},
        measurements=measured,
        ties=replace(ties, pixels=pixels),
    )
    return replace(inputs, block=fresh, report=inputs.adjust(fresh, Silent()))


def _enlarge(source: Path, target: Path, factor: int) -> None:
    """Every pixel of a scan as a square of pixels with some grain, strip by strip."""
    with rasterio.open(source) as file:
        values = file.read(1)
    rng, side = np.random.default_rng(2), factor * values.shape[0]
    profile = {"driver": "GTiff", "dtype": "uint8", "count": 1, "width": side, "height": side}
    with rasterio.open(target, "w", **profile, tiled=True, blockxsize=256, blockysize=256) as file:
        for row in range(0, values.shape[0], 64):
            part = values[row : row + 64].repeat(factor, axis=0).repeat(factor, axis=1)
            part = part ^ rng.integers(0, 8, part.shape, dtype=np.uint8)
            window = Window(0, row * factor, side, part.shape[0])
            file.write(part, 1, window=window)


def _terrain(rng: np.random.Generator, extent: tuple[float, float]) -> ArrayDem:
    columns, rows = (round(side / 10) + 80 for side in extent)
    size = (columns, rows)
    noise = sum(
        cv2.resize(rng.normal(size=(n, n)), size, interpolation=cv2.INTER_CUBIC) * a
        for n, a in ((4, 18), (9, 8), (24, 2))
    )
    return ArrayDem(Grid(WEST - 400, NORTH + 400, 10.0, columns, rows), GROUND_M + noise)


def _photos(rng: np.random.Generator, size: Size, scans: Path) -> dict[str, Photo]:
    pixel_mm = FRAME_MM / size.scan_px
    matrix = pixel_mm * np.array([[1.0, 0.0], [0.0, -1.0]])
    offset = -matrix @ np.full(2, size.scan_px / 2)
    interior = InteriorOrientation(
        "nominal", np.column_stack([matrix, offset]), (), np.zeros((0, 2)), np.zeros((0, 2)),
        float("nan"),
    )  # fmt: skip
    prior = ExteriorPrior(np.full(3, 150.0), np.full(3, 0.06))
    photos: dict[str, Photo] = {}
    for number in range(size.strips * size.photos_a_strip):
        strip, along = divmod(number, size.photos_a_strip)
        east = WEST + MARGIN_M + SIDE_M / 2 + along * BASE_M
        north = NORTH - MARGIN_M - SIDE_M / 2 - strip * SPACING_M
        centre = np.array([east, north, GROUND_M + FLYING_M]) + rng.normal(0, 12, 3)
        angles = rng.normal(0, 0.01, 3)
        kappa = (np.pi if strip % 2 else 0.0) + angles[2]
        exterior = ExteriorOrientation(centre, angles[0], angles[1], kappa)
        name = f"1938_{strip + 1:02d}_{along + 11:03d}"
        photos[name] = Photo(
            name, scans / f"{name}.tif", (size.scan_px, size.scan_px), "wide", interior,
            exterior, exterior, prior, GROUND_M, True,
        )  # fmt: skip
    return photos


def _places(
    rng: np.random.Generator, count: int, dem: ArrayDem, extent: tuple[float, float]
) -> np.ndarray:
    low, high = np.array([WEST, NORTH - extent[1]]), np.array([WEST + extent[0], NORTH])
    plane = low + MARGIN_M + rng.random((count, 2)) * (high - low - 2 * MARGIN_M)
    return np.column_stack([plane, dem.heights(plane)])


def _seen(photos: dict[str, Photo], ground: np.ndarray, edge: float) -> tuple[np.ndarray, ...]:
    """Pixels of all ground points in all photos, and which lie inside."""
    pixels = np.stack([photo.pixel_from_object(ground, CAMERA) for photo in photos.values()])
    side = next(iter(photos.values())).size_px[0]
    return pixels, np.all((pixels > edge) & (pixels < side - edge), axis=2)


def _control(rng, size, truth, dem, extent):
    """Points with measurements in most photos that see them, until there are enough."""
    ground = _places(rng, size.proposals, dem, extent)
    pixels, inside = _seen(truth, ground, 0.03 * size.scan_px)
    names = list(truth)
    surveyed, measurements, blunders, true_pixels = {}, {}, set(), {}
    for number, position in enumerate(ground):
        if len(measurements) >= size.proposals:
            break
        point_id = f"J{number + 101}"
        role = "check" if number % 12 == 7 else "control"
        given = position + rng.normal(0, 1, 3) * (0.25, 0.25, 0.5)
        surveyed[point_id] = SurveyedPoint(
            point_id, given, np.array([0.25, 0.25, 0.5]), role, "junction"
        )
        for k in np.flatnonzero(inside[:, number]):
            if rng.random() < 0.2 or len(measurements) >= size.proposals:
                continue
            made, wrong = _measured(rng, point_id, names[k], pixels[k, number], size.wrong)
            measurements[made.key] = made
            true_pixels[made.key] = pixels[k, number]
            if wrong:
                blunders.add(made.key)
    return surveyed, measurements, frozenset(blunders), true_pixels


def _measured(rng, point_id: str, photo_id: str, pixel: np.ndarray, share: float):
    """One proposal; a wrong one lies at another detail, and its score is hardly lower."""
    place = pixel + rng.normal(0, NOISE_PX, 2)
    wrong = bool(rng.random() < share)
    turn = rng.uniform(0, 2 * np.pi)
    away = place + rng.uniform(2.0, 12.0) * np.array([np.cos(turn), np.sin(turn)])
    score = float(np.clip(rng.normal(0.6 if wrong else 0.7, 0.1), 0.2, 0.97))
    best, second = (away, place) if wrong else (place, away)
    peaks = [Peak(float(best[0]), float(best[1]), 0.4, score, "ncc")]
    if wrong or rng.random() < 0.3:
        other = score * float(rng.uniform(0.75, 0.99))
        peaks.append(Peak(float(second[0]), float(second[1]), 0.5, other, "gradient"))
    made = Measurement(
        point_id, photo_id, float(best[0]), float(best[1]), 0.4, score, peaks=tuple(peaks)
    )
    return made, wrong


def _blurred(rng: np.random.Generator, photo: Photo) -> Photo:
    """The photo with the orientation an engine would begin from."""
    true = photo.exterior
    about = ExteriorOrientation(
        true.centre + rng.normal(0, 4, 3),
        *(np.array([true.omega, true.phi, true.kappa]) + rng.normal(0, 0.003, 3)),
    )
    return replace(photo, exterior=about, approximate=about)


def _ties(rng, truth, dem, extent, size: Size) -> TiePoints:
    ground = _places(rng, 2 * size.ties, dem, extent)
    pixels, inside = _seen(truth, ground, 0.02 * size.scan_px)
    chosen = np.flatnonzero(inside.sum(axis=0) >= 2)[: size.ties]
    point, photo = np.nonzero(inside[:, chosen].T)
    rays = pixels[photo, chosen[point]] + rng.normal(0, 0.3, (len(point), 2))
    return TiePoints(tuple(truth), point, photo, rays, np.full(len(point), 0.35))


def _texture(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    """Fields of every size, lanes over them."""
    size, grey = (columns, rows), np.full((rows, columns), 118, dtype=np.float32)
    for cells, strength in ((12, 22), (60, 18), (300, 14)):
        blocks = rng.normal(0, strength, (cells, cells)).astype(np.float32)
        grey += cv2.resize(blocks, size, interpolation=cv2.INTER_NEAREST)
    grain = rng.normal(0, 7, (rows // 2, columns // 2)).astype(np.float32)
    grey += cv2.resize(grain, size)
    for _ in range(90):
        ends = (rng.random((2, 2)) * (columns, rows)).astype(int)
        cv2.line(grey, tuple(ends[0].tolist()), tuple(ends[1].tolist()), 205, 5, cv2.LINE_AA)
    return np.clip(grey, 0, 255).astype(np.uint8)


def _write_scans(made: LargeBlock, grid: Grid, grey: np.ndarray) -> None:
    """Every scan of the true block, exposed with its true orientation."""
    for photo in made.true_photos.values():
        path = photo.scan
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            continue
        side = photo.size_px[0]
        write_scan(path, _exposed(photo, made.dem, grid, grey, side))


def _exposed(photo: Photo, dem: ArrayDem, grid: Grid, grey: np.ndarray, side: int) -> np.ndarray:
    """Every eighth ray down to the terrain, the rest interpolated."""
    steps = np.arange(0, side + 8, 8, dtype=np.float64)
    across, down = np.meshgrid(steps, steps)
    pixels = np.column_stack([across.ravel(), down.ravel()])
    heights = np.full(len(pixels), GROUND_M)
    for _ in range(4):
        ground = photo.object_from_pixel(pixels, heights, CAMERA)
        heights = dem.heights(ground[:, :2])
    nodes = grid.grid_from_object(ground[:, :2]).reshape(*across.shape, 2).astype(np.float32)
    columns, rows = np.meshgrid(*([(np.arange(side, dtype=np.float32) + 0.5) / 8] * 2))
    place = cv2.remap(nodes, columns, rows, cv2.INTER_LINEAR) - 0.5
    return cv2.remap(grey, place, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)


def say(text: str) -> None:
    """A line on the terminal, at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def say_row(what: str, printed: str) -> None:
    """A table of one row for the notebook, with the load of the machine."""
    say("\n| what | printed | load |\n|---|---|---|")
    say(f"| {what} | {printed} | {os.getloadavg()[0]:.1f} |")


def write_scan(path: Path, values: np.ndarray) -> None:
    """A tiled TIFF without overviews, as a scanner leaves it."""
    rows, columns = values.shape
    profile = {"driver": "GTiff", "dtype": "uint8", "count": 1, "width": columns, "height": rows}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with rasterio.open(
            path, "w", **profile, tiled=True, blockxsize=256, blockysize=256, compress="deflate"
        ) as file:
            file.write(values, 1)
