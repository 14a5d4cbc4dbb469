"""A tiny block in memory for the desk: six photos over a made-up landscape, with known blunders."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from app.desk.inputs import DeskInputs
from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
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
from sessions.checks import results_digest
from sessions.session import Session
from tests.ui.desk_landscape import EXTENT_M, NORTH, WEST, ArrayDem, Landscape, landscape
from ui.review.compare import drawn_from_block, made_with
from ui.review.rows import NO_ROWS
from ui.review.scene import Footprints, Segments
from ui.review.snapshot import DeskSnapshot
from ui.review.state import DeskState

FLYING_HEIGHT_M = 1650.0
FRAME_MM = 180.0
CAMERA = Camera("wide", 210.0, (FRAME_MM, FRAME_MM))
NOISE_PX = 0.35


def true_photos(scan_px: int, dem: ArrayDem) -> dict[str, Photo]:
    """Two strips of three, flown the other way round on the way back, as they really were."""
    rng = np.random.default_rng(11)
    pixel_mm = FRAME_MM / scan_px
    photos: dict[str, Photo] = {}
    for number in range(6):
        strip, along = divmod(number, 3)
        east = WEST + (700 + 500 * along if strip == 0 else 1700 - 500 * along)
        north = NORTH - (680 if strip == 0 else 1320)
        kappa = 0.02 if strip == 0 else np.pi + 0.03
        centre = np.array([east, north, 280 + FLYING_HEIGHT_M]) + rng.normal(0, 15, 3)
        angles = rng.normal(0, 0.012, 3)
        exterior = ExteriorOrientation(centre, angles[0], angles[1], kappa + angles[2])
        turn = rng.normal(0, 0.01)
        c, s = np.cos(turn), np.sin(turn)
        matrix = pixel_mm * np.array([[c, s], [s, -c]])
        offset = -matrix @ np.array([scan_px / 2, scan_px / 2])
        interior = InteriorOrientation(
            "nominal", np.column_stack([matrix, offset]), (), np.zeros((0, 2)), np.zeros((0, 2)),
            float("nan"),
        )  # fmt: skip
        name = f"1938_{strip + 1:02d}_{along + 14:03d}"
        prior = ExteriorPrior(np.full(3, 150.0), np.full(3, 0.06))
        photos[name] = Photo(
            name, Path(f"memory/{name}.tif"), (scan_px, scan_px), "wide", interior, exterior,
            exterior, prior, 280.0, True,
        )  # fmt: skip
    return photos


class ArrayScans:
    """Scans in memory: the old landscape seen by the true photos."""

    def __init__(self, photos: dict[str, Photo], land: Landscape) -> None:
        self._scans = {photo.scan: _exposed(photo, land) for photo in photos.values()}

    def __call__(
        self, scan: Path, column: int, row: int, columns: int, rows: int, reduction: int
    ) -> np.ndarray:
        part = self._scans[scan][row : row + rows, column : column + columns]
        size = (columns // reduction, rows // reduction)
        return cv2.resize(part, size, interpolation=cv2.INTER_AREA).astype(np.float32)


def _exposed(photo: Photo, land: Landscape) -> np.ndarray:
    """One scan: every pixel's ray down to the terrain, with a border and vignetting."""
    columns, rows = photo.size_px
    across, down = np.meshgrid(np.arange(0, columns, 8) + 4, np.arange(0, rows, 8) + 4)
    pixels = np.column_stack([across.ravel(), down.ravel()]).astype(np.float64)
    heights = np.full(len(pixels), 280.0)
    for _ in range(4):
        ground = photo.object_from_pixel(pixels, heights, CAMERA)
        heights = land.dem.heights(ground[:, :2])
    place = land.today.grid.grid_from_object(ground[:, :2]).reshape(*across.shape, 2)
    place = cv2.resize(place, (columns, rows), interpolation=cv2.INTER_LINEAR) - 0.5
    values = cv2.remap(
        cv2.GaussianBlur(land.then, (0, 0), 0.7), place.astype(np.float32), None, cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REFLECT_101,
    ).astype(np.float32)  # fmt: skip
    radius = np.hypot(*np.meshgrid(np.linspace(-1, 1, columns), np.linspace(-1, 1, rows)))
    values = values * (1.05 - 0.28 * radius**2)
    values += np.random.default_rng(5).normal(0, 5, values.shape).astype(np.float32)
    edge = max(4, columns // 90)
    values[:edge], values[-edge:], values[:, :edge], values[:, -edge:] = 12, 12, 12, 12
    return np.clip(values, 0, 255).astype(np.uint8)


@dataclass(frozen=True)
class TinyBlock:
    """The block as an engine would leave it, and what only we know of it."""

    block: Block
    blunders: frozenset[tuple[str, str]]
    land: Landscape
    scans: ArrayScans


@cache
def tiny_block(scan_px: int = 1200) -> TinyBlock:
    """Measurements with noise; every fifteenth is wrong by many pixels, some check points."""
    land = landscape()
    rng = np.random.default_rng(17)
    photos = true_photos(scan_px, land.dem)
    surveyed, measurements, blunders = {}, {}, set()
    places = land.nodes.reshape(-1, 2)
    heights = land.dem.heights(places)
    for number, (place, height) in enumerate(zip(places, heights, strict=True)):
        point_id = f"J{number + 101}"
        role = "check" if number % 9 == 4 else "control"
        position = np.array([*(place + rng.normal(0, 0.1, 2)), height + rng.normal(0, 0.15)])
        sigma = np.array([0.25, 0.25, 0.5])
        surveyed[point_id] = SurveyedPoint(point_id, position, sigma, role, "junction")
        for name, photo in photos.items():
            pixel = photo.pixel_from_object(np.array([[*place, height]]), CAMERA)[0]
            if not np.all((pixel > 40) & (pixel < scan_px - 40)) or rng.random() < 0.2:
                continue
            measured, wrong = _measured(rng, point_id, name, pixel, role)
            measurements[measured.key] = measured
            if wrong:
                blunders.add(measured.key)
    ties = _ties(rng, photos, land.dem, scan_px)
    moved = {name: _blurred(rng, photo) for name, photo in photos.items()}
    block = Block("EPSG:5514", {"wide": CAMERA}, moved, surveyed, measurements, ties)
    return TinyBlock(block, frozenset(blunders), land, ArrayScans(photos, land))


def _measured(
    rng: np.random.Generator, point_id: str, photo_id: str, pixel: np.ndarray, role: str
) -> tuple[Measurement, bool]:
    truth = pixel + rng.normal(0, NOISE_PX, 2)
    score = float(np.clip(rng.normal(0.72, 0.1), 0.25, 0.97))
    wrong = role == "control" and rng.random() < 0.07
    away = truth + rng.choice([-1, 1], 2) * rng.uniform(2.5, 14, 2)
    best, second = (away, truth) if wrong else (truth, away)
    peaks = [Peak(*best, 0.4, score, "ncc")]
    if wrong or rng.random() < 0.3:
        peaks.append(Peak(*second, 0.5, score * float(rng.uniform(0.72, 0.99)), "gradient"))
    status = "unused" if rng.random() < 0.05 else "auto"
    reason = "residual too large in resection" if status == "unused" else ""
    measured = Measurement(
        point_id, photo_id, *best, 0.4, score, status, reason, peaks=tuple(peaks)
    )
    return measured, wrong and status == "auto"


def _blurred(rng: np.random.Generator, photo: Photo) -> Photo:
    """The photo with the orientation an engine would begin from."""
    exterior = photo.exterior
    about = ExteriorOrientation(
        exterior.centre + rng.normal(0, 6, 3),
        exterior.omega + rng.normal(0, 0.004),
        exterior.phi + rng.normal(0, 0.004),
        exterior.kappa + rng.normal(0, 0.004),
    )
    return replace(photo, exterior=about, approximate=about)


def _ties(
    rng: np.random.Generator, photos: dict[str, Photo], dem: ArrayDem, scan_px: int
) -> TiePoints:
    places = np.array([WEST, NORTH - EXTENT_M[1]]) + rng.random((900, 2)) * EXTENT_M
    ground = np.column_stack([places, dem.heights(places)])
    point, photo, pixels = [], [], []
    seen = np.stack([p.pixel_from_object(ground, CAMERA) for p in photos.values()])
    inside = np.all((seen > 20) & (seen < scan_px - 20), axis=2)
    for number, i in enumerate(np.flatnonzero(inside.sum(axis=0) >= 2)):
        for k in np.flatnonzero(inside[:, i]):
            point.append(number)
            photo.append(k)
            pixels.append(seen[k, i] + rng.normal(0, 0.3, 2))
    return TiePoints(
        tuple(photos), np.array(point), np.array(photo), np.array(pixels), np.full(len(point), 0.35)
    )


OPTIONS = AdjustmentOptions(estimate_cameras=False, robust=False)
"""Not robust: then a blunder moves sigma nought, and rejecting it moves it back."""


def adjust(block: Block, progress=None):
    """The real adjustment, as the desk calls it."""
    return (
        adjust_block(block, OPTIONS) if progress is None else adjust_block(block, OPTIONS, progress)
    )


def outlines(state: DeskState) -> Segments:
    """Outlines of the photos as they stand now."""
    oriented = state.oriented
    return Footprints(tiny_block().land.dem).of(drawn_from_block(oriented), oriented.origin)


@cache
def tiny_snapshot() -> DeskSnapshot:
    """The desk over the tiny block, adjusted, before anybody sat down."""
    tiny = tiny_block()
    state = DeskState(tiny.block, _report(1200), made=made_with(_report(1200).block))
    drawn = drawn_from_block(state.oriented)
    return DeskSnapshot(tiny.block, state, tiny.land.dem, drawn, table=NO_ROWS.renewed(state))


def desk_inputs(folder: Path, scan_px: int = 1200, remake=None, **changes) -> DeskInputs:
    """Everything a desk needs, over the tiny block."""
    tiny = tiny_block(scan_px)
    report = _report(scan_px)
    return DeskInputs(
        name="kobyli-1938",
        block=tiny.block,
        report=report,
        session=Session.open(folder, "anna"),
        ortho=tiny.land.today,
        dem=tiny.land.dem,
        read_scan=tiny.scans,
        adjust=adjust,
        remake=remake or (lambda photo_ids, progress, report: None),
        operator="anna",
        written_of=results_digest(report),
        **changes,
    )


@cache
def _report(scan_px: int):
    return adjust(tiny_block(scan_px).block)
