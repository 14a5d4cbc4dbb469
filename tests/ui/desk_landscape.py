"""The painted landscape under the desk's tiny block: fields, lanes and houses, today and then."""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from scipy.ndimage import map_coordinates

from core.raster.grid import Grid

WEST, NORTH = -742000.0, -1040000.0
EXTENT_M = (2400.0, 2000.0)
ORTHO_M = 0.5
DEM_M = 10.0


@dataclass(frozen=True)
class ArrayDem:
    """Heights from an array."""

    grid: Grid
    values: np.ndarray

    def heights(self, points: np.ndarray) -> np.ndarray:
        place = self.grid.grid_from_object(points) - 0.5
        return map_coordinates(self.values, place.T[::-1], order=1, mode="nearest")

    def on(self, grid: Grid) -> np.ndarray:
        across, down = np.meshgrid(*grid.centres())
        points = np.column_stack([across.ravel(), down.ravel()])
        return self.heights(points).reshape(grid.rows, grid.columns)


@dataclass(frozen=True)
class ArrayOrtho:
    """Colours from an array."""

    grid: Grid
    values: np.ndarray

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        return self.grid.bounds

    @property
    def ground_sample_distance_m(self) -> float:
        return self.grid.ground_sample_distance_m

    def read_colour(self, grid: Grid) -> np.ndarray:
        return sampled(self.values, self.grid, grid)


def sampled(values: np.ndarray, own: Grid, grid: Grid) -> np.ndarray:
    """An array on another grid, smoothed first where that is coarser."""
    ratio = grid.ground_sample_distance_m / own.ground_sample_distance_m
    step = max(1, int(ratio))
    source = _reduced(id(values), step) if step > 1 else values
    across, down = np.meshgrid(*grid.centres())
    place = own.grid_from_object(np.column_stack([across.ravel(), down.ravel()])) / step - 0.5
    place = place.astype(np.float32).reshape(grid.rows, grid.columns, 2)
    mode, outside = cv2.BORDER_CONSTANT, (20, 20, 20)
    x, y = np.ascontiguousarray(place[..., 0]), np.ascontiguousarray(place[..., 1])
    return cv2.remap(source, x, y, cv2.INTER_LINEAR, borderMode=mode, borderValue=outside)


_KEPT: dict[int, np.ndarray] = {}


def keep_for_reduction(values: np.ndarray) -> None:
    """Let an array be shown smaller than it is; it is kept for good."""
    _KEPT[id(values)] = values


@cache
def _reduced(number: int, step: int) -> np.ndarray:
    values = _KEPT[number]
    size = (values.shape[1] // step, values.shape[0] // step)
    return cv2.resize(
        values[: size[1] * step, : size[0] * step], size, interpolation=cv2.INTER_AREA
    )


@dataclass(frozen=True)
class Landscape:
    """Terrain, road nodes, and what it looked like today and then."""

    dem: ArrayDem
    today: ArrayOrtho
    then: np.ndarray
    nodes: np.ndarray


@cache
def landscape(seed: int = 3) -> Landscape:
    """Rolling fields with a network of lanes; some parcels and houses differ between epochs."""
    rng = np.random.default_rng(seed)
    dem_grid = Grid(WEST - 400, NORTH + 400, DEM_M, 320, 280)
    noise = sum(
        cv2.resize(rng.normal(size=(n, n)), (320, 280), interpolation=cv2.INTER_CUBIC) * a
        for n, a in ((4, 18), (8, 8), (20, 2))
    )
    dem = ArrayDem(dem_grid, 280 + noise)
    grid = Grid(WEST, NORTH, ORTHO_M, int(EXTENT_M[0] / ORTHO_M), int(EXTENT_M[1] / ORTHO_M))
    nodes = _nodes(rng)
    today = _painted(rng, grid, nodes, np.random.default_rng(seed + 1), colour=True)
    rng_then = np.random.default_rng(seed + 1)
    then = _painted(np.random.default_rng(seed + 7), grid, nodes, rng_then, colour=False)
    keep_for_reduction(today)
    return Landscape(dem, ArrayOrtho(grid, today), then, nodes)


def _nodes(rng: np.random.Generator) -> np.ndarray:
    """Crossings of lanes, eastings and northings, (rows, columns, 2)."""
    east = np.linspace(-90, EXTENT_M[0] + 90, 14)
    north = np.linspace(-90, EXTENT_M[1] + 90, 12)
    across, down = np.meshgrid(east, north)
    nodes = np.stack([WEST + across, NORTH - down], axis=-1)
    return nodes + rng.uniform(-45, 45, nodes.shape)


def _painted(
    rng: np.random.Generator,
    grid: Grid,
    nodes: np.ndarray,
    parcels: np.random.Generator,
    colour: bool,
) -> np.ndarray:
    """Parcels between lanes, trees and houses beside them, the lanes on top."""
    picture = np.zeros((grid.rows, grid.columns, 3), dtype=np.uint8)
    pixels = grid.grid_from_object(nodes.reshape(-1, 2)).reshape(nodes.shape)
    for i in range(nodes.shape[0] - 1):
        for j in range(nodes.shape[1] - 1):
            corners = pixels[[i, i, i + 1, i + 1], [j, j + 1, j + 1, j]]
            _parcel(picture, corners, parcels if rng.random() < 0.6 else rng)
    for line in [*pixels, *pixels.swapaxes(0, 1)]:
        cv2.polylines(
            picture, [np.rint(line * 8).astype(int)], False, (150, 146, 132), 17, cv2.LINE_AA, 3
        )
        cv2.polylines(
            picture, [np.rint(line * 8).astype(int)], False, (214, 208, 196), 10, cv2.LINE_AA, 3
        )
    _houses(picture, pixels, rng)
    grain = rng.normal(0, 5, picture.shape[:2]).astype(np.float32)
    coarse = cv2.resize(rng.normal(0, 9, (300, 360)).astype(np.float32), grain.shape[::-1])
    shaded = picture.astype(np.float32) + (grain + coarse)[..., None]
    shaded = np.clip(shaded, 0, 255).astype(np.uint8)
    return shaded if colour else cv2.cvtColor(shaded, cv2.COLOR_RGB2GRAY)


def _parcel(picture: np.ndarray, corners: np.ndarray, rng: np.random.Generator) -> None:
    """Strips of fields between four crossings."""
    strips = int(rng.integers(2, 7))
    turned = corners if rng.random() < 0.5 else np.roll(corners, 1, axis=0)
    for k in range(strips):
        a, b = k / strips, (k + 1) / strips
        quad = np.array([
            turned[0] + a * (turned[1] - turned[0]), turned[0] + b * (turned[1] - turned[0]),
            turned[3] + b * (turned[2] - turned[3]), turned[3] + a * (turned[2] - turned[3]),
        ])  # fmt: skip
        base = rng.choice(
            [[104, 118, 72], [128, 132, 88], [146, 128, 92], [84, 104, 64], [160, 150, 112]]
        )
        shade = base + rng.normal(0, 7, 3)
        cv2.fillPoly(picture, [np.rint(quad * 8).astype(int)], shade.tolist(), cv2.LINE_AA, 3)
    if rng.random() < 0.16:
        for _ in range(160):
            u, v = rng.random(2)
            place = (
                (1 - u) * (1 - v) * corners[0]
                + u * (1 - v) * corners[1]
                + u * v * corners[2]
                + (1 - u) * v * corners[3]
            )
            dark = (np.array([52, 70, 44]) + rng.normal(0, 8, 3)).tolist()
            cv2.circle(
                picture,
                np.rint(place).astype(int).tolist(),
                int(rng.integers(5, 12)),
                dark,
                -1,
                cv2.LINE_AA,
            )


def _houses(picture: np.ndarray, pixels: np.ndarray, rng: np.random.Generator) -> None:
    for place in pixels.reshape(-1, 2):
        for _ in range(int(rng.integers(0, 5))):
            centre = place + rng.choice([-1, 1], 2) * rng.uniform(26, 70, 2)
            box = cv2.boxPoints(
                (tuple(centre), tuple(rng.uniform(16, 34, 2)), float(rng.uniform(0, 90)))
            )
            cv2.fillPoly(picture, [np.rint(box + 5).astype(int)], (60, 60, 58), cv2.LINE_AA)
            roof = [[168, 92, 74], [176, 170, 164], [140, 84, 70]][int(rng.integers(3))]
            cv2.fillPoly(picture, [np.rint(box).astype(int)], roof, cv2.LINE_AA)
