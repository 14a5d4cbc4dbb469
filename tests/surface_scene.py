"""Photos of a ground with hills, houses, woods and changes, whose true surface is known."""

import warnings
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import rasterio
from rasterio.errors import NotGeoreferencedWarning
from scipy import ndimage

from core.block import Block, ExteriorPrior, Photo
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation
from core.raster.grid import Grid

CRS = "EPSG:5514"
MIDDLE = np.array([-545_000.0, -1_160_000.0])
LEVEL_M = 300.0
STEP_M = 0.5
"""Rays go down in steps of this, metres of height."""
NODE_PX = 16
BAND = 512


@dataclass(frozen=True)
class SurfacePlan:
    """The angles of an archival camera at any number of pixels: base to height is 0.34."""

    photos: int = 3
    strips: int = 1
    size_px: int = 3000
    pixel_mm: float = 0.06
    ground_pixel_m: float = 0.6
    relief_m: float = 60.0
    houses: int = 400
    woods: int = 12
    changes_m: float = 8.0
    grain: float = 6.0
    forward: float = 0.6
    side: float = 0.27

    @property
    def principal_distance_mm(self) -> float:
        """As 211.59 mm is to a frame of 180 mm."""
        return 211.59 / 180 * self.size_px * self.pixel_mm

    @property
    def height_m(self) -> float:
        """Above ground."""
        return self.ground_pixel_m / self.pixel_mm * self.principal_distance_mm

    @property
    def sigma_m(self) -> float:
        """0.3 px sqrt(2) H / B, what METHODS 8 allows on open ground."""
        base = (1 - self.forward) * self.size_px * self.ground_pixel_m
        return 0.3 * np.sqrt(2) * self.ground_pixel_m * self.height_m / base


@dataclass(frozen=True)
class SurfaceScene:
    """A block at its true orientations, its true surface, and the DEM of another time."""

    plan: SurfacePlan
    block: Block
    grid: Grid
    surface: np.ndarray
    ground: np.ndarray
    dem: np.ndarray
    open_ground: np.ndarray
    changed: np.ndarray

    def heights(self, points: np.ndarray) -> np.ndarray:
        """The DEM of another time, bilinear: what a surface begins from."""
        place = self.grid.grid_from_object(points) - 0.5
        return ndimage.map_coordinates(self.dem, place.T[::-1], order=1, mode="nearest")

    def on(self, raster: np.ndarray, grid: Grid, how=np.mean) -> np.ndarray:
        """One of the rasters on a coarser grid: mean (or another measure) of each cell."""
        ratio = round(grid.ground_sample_distance_m / self.grid.ground_sample_distance_m)
        corner = self.grid.grid_from_object(np.array([[grid.west, grid.north]]))[0]
        left, top = np.rint(corner).astype(int)
        part = raster[top : top + grid.rows * ratio, left : left + grid.columns * ratio]
        cells = part.reshape(grid.rows, ratio, grid.columns, ratio).swapaxes(1, 2)
        return how(cells.reshape(grid.rows, grid.columns, -1), axis=2)


def make_scene(plan: SurfacePlan, folder: Path, seed: int) -> SurfaceScene:
    """Scans of a block, written into a folder, and the truth."""
    rng = np.random.default_rng(seed)
    photos, camera = _photos(plan, folder, rng)
    grid = _grid(plan, photos)
    ground, changed, dem = _grounds(plan, grid, rng)
    standing = _objects(plan, grid, rng, changed)
    surface = ground + standing
    gray = _texture(grid, standing, rng)
    block = Block(CRS, {"wide": camera}, {photo.photo_id: photo for photo in photos})
    for photo in photos:
        scan = _expose(plan, photo, camera, grid, surface.astype(np.float32), gray, rng)
        _write(photo.scan, scan)
    beside = ndimage.binary_dilation(
        standing > 0.3, iterations=round(6 / grid.ground_sample_distance_m)
    )
    return SurfaceScene(plan, block, grid, surface, ground, dem, ~beside, changed)


def _photos(plan, folder, rng):
    half = plan.size_px * plan.pixel_mm / 2
    camera = Camera(
        "wide", plan.principal_distance_mm, (2 * half, 2 * half), (0.02, -0.03), (2e-8, -1e-12, 0.0)
    )
    side = plan.size_px * plan.ground_pixel_m
    photos = []
    for strip in range(plan.strips):
        for number in range(plan.photos):
            along = (number - (plan.photos - 1) / 2) * (1 - plan.forward) * side
            across = (strip - (plan.strips - 1) / 2) * (1 - plan.side) * side
            heading = np.radians(20)
            turn = np.array(
                [[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]]
            )
            plane = MIDDLE + turn @ [along, across] + rng.normal(0, 0.005 * side, 2)
            centre = np.array([*plane, LEVEL_M + plan.height_m * (1 + rng.normal(0, 0.003))])
            angles = rng.normal(0, np.radians(1.0), 3)
            angles[2] += heading + np.pi * (strip % 2)
            exterior = ExteriorOrientation(centre, *angles)
            linear = plan.pixel_mm * np.array([[1.0, 1e-3], [1e-3, -1.0]])
            matrix = np.column_stack([linear, -linear @ np.full(2, plan.size_px / 2)])
            empty = np.zeros((0, 2))
            name = f"{strip}_{number}"
            photos.append(
                Photo(
                    name,
                    folder / f"{name}.tif",
                    (plan.size_px,) * 2,
                    "wide",
                    InteriorOrientation("affine", matrix, (), empty, empty, np.nan),
                    exterior,
                    exterior,
                    ExteriorPrior(np.full(3, 1.0), np.full(3, 1e-3)),
                    LEVEL_M,
                    oriented=True,
                )
            )
    return photos, camera


def _grid(plan, photos):
    side = plan.size_px * plan.ground_pixel_m
    centres = np.array([photo.exterior.centre[:2] for photo in photos])
    reach = 0.85 * side
    low, high = centres.min(axis=0) - reach, centres.max(axis=0) + reach
    cell = plan.ground_pixel_m * 8
    # A third of the scans' pixel is too fine to be seen, half of it is fine enough.
    wide = Grid.over((*low, *high), cell)
    return Grid(wide.west, wide.north, cell / 16, wide.columns * 16, wide.rows * 16)


def _waves(shape, width_px, rng):
    """A field of chance of unit deviation, smooth over a width."""
    step = max(1, int(width_px / 4))
    small = rng.normal(size=(shape[0] // step + 9, shape[1] // step + 9))
    small = ndimage.gaussian_filter(small, width_px / step / 2)
    field = cv2.resize(
        small, (shape[1] + 8 * step, shape[0] + 8 * step), interpolation=cv2.INTER_CUBIC
    )
    field = field[4 * step : 4 * step + shape[0], 4 * step : 4 * step + shape[1]]
    return (field - field.mean()) / field.std()


def _grounds(plan, grid, rng):
    """Ground of the flight, where it has changed since, and the DEM of today with its errors."""
    shape, gsd = (grid.rows, grid.columns), grid.ground_sample_distance_m
    hills = _waves(shape, 350 / gsd, rng)
    ground = LEVEL_M + hills * plan.relief_m / max(np.ptp(hills), 1e-9)
    today = ground.copy()
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    for sign in (1, -1) if plan.changes_m else ():
        middle = np.array(shape) / 2 + rng.uniform(-0.18, 0.18, 2) * min(shape)
        long, wide = 0.11 * min(shape), 0.05 * min(shape)
        away = np.maximum(np.abs(rows - middle[0]) - wide, np.abs(columns - middle[1]) - long)
        # Slopes of 1 : 2.
        rise = np.clip(-away * gsd / 2, 0, plan.changes_m)
        today += sign * rise
    # Where an embankment crosses a quarry both may cancel: what is level there has not changed.
    changed = np.abs(today - ground) > 1.0
    noise = 0.15 * _waves(shape, 20 / gsd, rng)
    return ground, changed, today + noise


def _objects(plan, grid, rng, changed):
    """Heights of houses with gable roofs and of woods above the ground."""
    shape, gsd = (grid.rows, grid.columns), grid.ground_sample_distance_m
    standing = np.zeros(shape)
    for _ in range(plan.houses):
        row, column = rng.uniform(0.05, 0.95, 2) * shape
        long, wide, eave = rng.uniform(8, 16), rng.uniform(6, 10), rng.uniform(3, 7)
        turn = rng.uniform(0, np.pi)
        reach = int(20 / gsd)
        r0, c0 = int(row), int(column)
        window = np.s_[max(r0 - reach, 0) : r0 + reach, max(c0 - reach, 0) : c0 + reach]
        if changed[window].any():
            continue
        y, x = np.mgrid[
            window[0].start : min(window[0].stop, shape[0]),
            window[1].start : min(window[1].stop, shape[1]),
        ]
        u = ((x - column) * np.cos(turn) + (y - row) * np.sin(turn)) * gsd
        v = ((y - row) * np.cos(turn) - (x - column) * np.sin(turn)) * gsd
        inside = (np.abs(u) < long / 2) & (np.abs(v) < wide / 2)
        roof = eave + 0.8 * (wide / 2 - np.abs(v))
        part = standing[window]
        part[inside] = np.maximum(part[inside], roof[inside])
    crowns = 1.5 * _waves(shape, 5 / gsd, rng)
    for _ in range(plan.woods):
        row, column = rng.uniform(0.3, 0.7, 2) * shape
        reach = rng.uniform(25, 80) / gsd
        y, x = np.ogrid[: shape[0], : shape[1]]
        edge = reach * (1 + 0.2 * np.sin(3 * np.arctan2(y - row, x - column)))
        wood = (np.hypot(y - row, x - column) < edge) & ~changed
        standing[wood] = np.maximum(standing[wood], 14 + crowns[wood])
    return standing


def _texture(grid, standing, rng):
    shape, gsd = (grid.rows, grid.columns), grid.ground_sample_distance_m
    gray = 120 + 14 * _waves(shape, 40 / gsd, rng) + 9 * _waves(shape, 6 / gsd, rng)
    gray += 7 * _waves(shape, 2 / gsd, rng) + 6 * _waves(shape, 1.2 / gsd, rng)
    strips = np.sin(np.arange(shape[1]) * gsd / 4 + 6 * _waves(shape, 150 / gsd, rng))
    gray += 9 * strips * (_waves(shape, 120 / gsd, rng) > 0)
    house = (standing > 2) & (standing < 12.5)
    gray += np.where(house, 35 * np.sign(_waves(shape, 9 / gsd, rng)), 0)
    gray += np.where(standing > 12.5, -35 + 16 * _waves(shape, 4 / gsd, rng), 0)
    return np.clip(gray, 5, 250).astype(np.float32)


def _expose(plan, photo, camera, grid, surface, gray, rng):
    """Each ray goes down until it meets the surface."""
    size, low, high = plan.size_px, float(surface.min()) - 1, float(surface.max()) + 1
    scan = np.empty((size, size), dtype=np.uint8)
    for first in range(0, size, BAND):
        last = min(first + BAND, size)
        ends = [_rays(photo, camera, grid, size, (first, last), height) for height in (high, low)]
        scan[first:last] = _band(ends, high, low, surface, gray)
    soft = cv2.GaussianBlur(scan.astype(np.float32), (0, 0), 0.6)
    grain = cv2.GaussianBlur(rng.normal(size=scan.shape).astype(np.float32), (0, 0), 0.7)
    values = soft * rng.uniform(0.85, 1.1) + plan.grain * 2 * np.sqrt(np.pi) * 0.7 * grain
    return np.clip(values, 1, 255).astype(np.uint8)


def _rays(photo, camera, grid, size, band, height):
    """Raster places (OpenCV's count) of a band of pixels at a height, from nodes."""
    columns = np.arange(-(-size // NODE_PX) + 1) * NODE_PX
    rows = band[0] + np.arange(-(-(band[1] - band[0]) // NODE_PX) + 1) * NODE_PX
    across, down = np.meshgrid(columns + 0.5, rows + 0.5)
    pixels = np.column_stack([across.ravel(), down.ravel()]).astype(float)
    points = photo.object_from_pixel(pixels, np.full(len(pixels), height), camera)
    places = (grid.grid_from_object(points[:, :2]) - 0.5).reshape(len(rows), len(columns), 2)
    column = np.arange(size, dtype=np.float32) / NODE_PX
    row = np.arange(band[1] - band[0], dtype=np.float32) / NODE_PX
    column, row = np.meshgrid(column, row)
    return [
        cv2.remap(places[..., axis].astype(np.float32), column, row, cv2.INTER_LINEAR)
        for axis in (0, 1)
    ]


def _band(ends, high, low, surface, gray):
    (x0, y0), (x1, y1) = ends
    share = np.full(x0.shape, 1.0, dtype=np.float32)
    open_rays = np.ones(x0.shape, dtype=bool)
    before = np.full(x0.shape, np.float32(1e3))
    steps = int((high - low) / STEP_M)
    for step in range(1, steps + 1):
        t = np.float32(step / steps)
        ground = cv2.remap(
            surface,
            x0 + (x1 - x0) * t,
            y0 + (y1 - y0) * t,
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        above = high + (low - high) * t - ground
        hit = open_rays & (above <= 0)
        back = np.where(hit, -above / np.maximum(before - above, 1e-6), 0)
        share[hit] = (t - back / steps)[hit]
        open_rays &= ~hit
        before = above
        if not open_rays.any():
            break
    return np.clip(
        cv2.remap(
            gray,
            x0 + (x1 - x0) * share,
            y0 + (y1 - y0) * share,
            cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_REPLICATE,
        ),
        0,
        255,
    ).astype(np.uint8)


def _write(path, scan):
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
            tiled=True,
        ) as file:
            file.write(scan, 1)
