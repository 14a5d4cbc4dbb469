"""The reference as the user has it: present-day ortho sheets, DEM, and the archival truth."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rasterio
from jaxtyping import Float32, UInt8
from rasterio import Affine
from rasterio.io import DatasetWriter

from core.geometry.grid import Grid
from core.synthetic.fields import Tract
from core.synthetic.flight import SHEET
from core.synthetic.landscape import COARSE, Scene
from core.synthetic.noise import Field, fractal, smooth_step
from core.synthetic.options import seeded
from core.synthetic.painting import Ground, fixed_pixels
from core.synthetic.terrain import Bounds, Terrain

CRS = "EPSG:5514"
Tint = Float32[np.ndarray, "_ _ 3"]
BAND = 1024
NODATA = -9999.0
ORTHO_ERROR_M = 0.1
"""Deviation per axis of the slow displacement of the reference ortho, metres."""


def write_sheets(
    folder: Path, ground: Ground, scene: Scene, gsd_m: tuple[float, float], year: int
) -> None:
    """Two by two colour sheets of the present ground; the last one has another pixel size.

    Args:
        folder: Where to write them.
        ground: The painted present.
        scene: Its scene, for the colours.
        gsd_m: Ground sample distance of three sheets, and of the fourth, metres.
        year: Year of the flight, for the names.
    """
    folder.mkdir(parents=True, exist_ok=True)
    west, south, east, north = ground.grid.bounds
    middle_east = west + round((east - west) / 2 / 4.0) * 4.0
    middle_north = south + round((north - south) / 2 / 4.0) * 4.0
    tint, tint_grid = _tint(scene, ground.grid)
    rng = seeded(scene.seed, "ortho")
    shift = [ORTHO_ERROR_M * fractal((64, 64), 1.0, 8.0, 32.0, 1.0, rng) for _ in range(2)]
    for number, (box, name) in enumerate(
        (
            ((west, middle_north, middle_east, north), 35),
            ((middle_east, middle_north, east, north), 25),
            ((west, south, middle_east, middle_north), 36),
            ((middle_east, south, east, middle_north), 26),
        )
    ):
        grid = Grid.over(box, gsd_m[number == 3])
        gain = float(rng.uniform(0.94, 1.08))
        path = folder / f"ORTO24.{year}.{SHEET[:4]}{name}.tif"
        options = {"compress": "jpeg", "jpeg_quality": 93, "photometric": "ycbcr"}
        with _created(path, grid, 3, "uint8", options) as sheet:
            for row in range(0, grid.rows, BAND):
                part = grid.window(0, row, grid.columns, min(BAND, grid.rows - row))
                gray = gain * sampled(ground, part, (shift[0], shift[1]))
                colour = gray[:, :, None] * _tint_on(tint, tint_grid, part)
                bands = np.moveaxis(np.clip(colour, 0, 255).astype(np.uint8), 2, 0)
                sheet.write(bands, window=((row, row + part.rows), (0, part.columns)))


def write_truth_ortho(path: Path, ground: Ground, gsd_m: float) -> None:
    """The ground of the archival epoch, exactly where it was."""
    grid = Grid.over(ground.grid.bounds, gsd_m)
    with _created(path, grid, 1, "uint8", {"compress": "deflate", "zlevel": 1}) as raster:
        for row in range(0, grid.rows, BAND):
            part = grid.window(0, row, grid.columns, min(BAND, grid.rows - row))
            gray = np.clip(np.round(sampled(ground, part, None)), 0, 255).astype(np.uint8)
            raster.write(gray, 1, window=((row, row + part.rows), (0, part.columns)))


def write_dem(path: Path, terrain: Terrain, bounds: Bounds, gsd_m: float, seed: int) -> None:
    """Bare earth with an error of 0.4 m, half of it alike over some 30 m, and one gap."""
    grid = _around(bounds, 60.0, gsd_m)
    rng = seeded(seed, "dem")
    slow = fractal((grid.rows, grid.columns), gsd_m, 15.0, 60.0, 0.5, rng)
    noise = rng.standard_normal((grid.rows, grid.columns), dtype=np.float32)
    heights = terrain.on(grid) + 0.28 * slow + 0.28 * noise
    place = rng.uniform(0.25, 0.75, 2) * np.array([grid.columns, grid.rows])
    size = rng.uniform(12.0, 30.0, 2) / gsd_m
    column, row = np.meshgrid(np.arange(grid.columns), np.arange(grid.rows))
    gap = ((column - place[0]) / size[0]) ** 2 + ((row - place[1]) / size[1]) ** 2 < 1
    heights[gap] = NODATA
    with _created(
        path, grid, 1, "float32", {"compress": "deflate", "zlevel": 1, "nodata": NODATA}
    ) as raster:
        raster.write(heights.astype(np.float32), 1)


def write_terrain(path: Path, terrain: Terrain, bounds: Bounds) -> None:
    """The true heights, every five metres."""
    grid = _around(bounds, 60.0, 5.0)
    with _created(path, grid, 1, "float32", {"compress": "deflate", "zlevel": 1}) as raster:
        raster.write(terrain.on(grid).astype(np.float32), 1)


def softened(ground: Ground, sigma_px: float) -> None:
    """Blur the painted ground in place, so that a coarser raster may be taken from it."""
    reach = int(4 * sigma_px) + 2
    before = ground.gray[:0]
    for row in range(0, ground.grid.rows, BAND):
        below = ground.gray[row : row + BAND + reach]
        blurred = cv2.GaussianBlur(np.vstack([before, below]), (0, 0), sigma_px)
        fresh = np.asarray(blurred)[len(before) : len(before) + BAND]
        # The rows above have been overwritten: keep their old values for the next band.
        before = ground.gray[max(0, row + BAND - reach) : row + BAND].copy()
        ground.gray[row : row + BAND] = fresh


def sampled(ground: Ground, part: Grid, shift: tuple[Field, Field] | None) -> Field:
    """The painted ground on a grid of another size, antialiased, displaced in metres if asked."""
    ratio = part.ground_sample_distance_m / ground.grid.ground_sample_distance_m
    column, row = ground.grid.grid_from_object(np.array([[part.west, part.north]]))[0]
    columns = (column + (np.arange(part.columns) + 0.5) * ratio - 0.5)[None, :]
    rows = (row + (np.arange(part.rows) + 0.5) * ratio - 0.5)[:, None]
    columns = np.repeat(columns, part.rows, axis=0).astype(np.float32)
    rows = np.repeat(rows, part.columns, axis=1).astype(np.float32)
    if shift is not None:
        size = (ground.grid.columns, ground.grid.rows)
        for target, field in ((columns, shift[0]), (rows, shift[1])):
            place_x = columns * np.float32(field.shape[1] / size[0])
            place_y = rows * np.float32(field.shape[0] / size[1])
            moved = cv2.remap(
                field, place_x, place_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
            target += np.asarray(moved) / np.float32(ground.grid.ground_sample_distance_m)
    first = max(0, int(rows.min()) - 4)
    last = min(ground.grid.rows, int(rows.max()) + 5)
    left = max(0, int(columns.min()) - 4)
    right = min(ground.grid.columns, int(columns.max()) + 5)
    source = ground.gray[first:last, left:right].astype(np.float32)
    if ratio > 1.05:
        source = cv2.GaussianBlur(source, (0, 0), 0.42 * ratio)
    result = cv2.remap(
        source, columns - left, rows - first, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )
    return np.clip(np.asarray(result, dtype=np.float32), 0, 255)


def _around(bounds: Bounds, margin_m: float, gsd_m: float) -> Grid:
    west, south, east, north = bounds
    wider = (west - margin_m, south - margin_m, east + margin_m, north + margin_m)
    return Grid.over(wider, gsd_m)


def _created(
    path: Path, grid: Grid, bands: int, dtype: str, options: Mapping[str, Any]
) -> DatasetWriter:
    path.parent.mkdir(parents=True, exist_ok=True)
    gsd = grid.ground_sample_distance_m
    return rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=grid.columns,
        height=grid.rows,
        count=bands,
        dtype=dtype,
        crs=CRS,
        transform=Affine(gsd, 0.0, grid.west, 0.0, -gsd, grid.north),
        tiled=True,
        blockxsize=256,
        blockysize=256,
        BIGTIFF="IF_SAFER",
        **options,
    )


def _tint(scene: Scene, grid: Grid) -> tuple[UInt8[np.ndarray, "_ _ 3"], Grid]:
    """Colour at every fourth pixel: 128 times red, green, blue of mean luminance 1."""
    gsd = grid.ground_sample_distance_m * COARSE
    coarse = Grid(grid.west, grid.north, gsd, -(-grid.columns // COARSE), -(-grid.rows // COARSE))
    picture = np.full((coarse.rows, coarse.columns, 3), _coded((0.95, 1.05, 0.83)), dtype=np.uint8)
    for tract in scene.tracts:
        _fill(picture, tract, coarse)
    wood = smooth_step(scene.fields.wood, scene.fields.grid, coarse) > 0.5
    picture[wood] = _coded((0.92, 1.06, 0.86))
    thick = max(1, round(6.0 / gsd))
    for road, look in scene.roads:
        gray = _coded((1.03, 0.99, 0.95) if look.tone > 130 else (0.98, 1.0, 1.04))
        line = fixed_pixels(road.line(scene.past), coarse)
        cv2.polylines(picture, [line], False, gray, thick, cv2.LINE_8, 8)
    for house in scene.houses:
        roof = _coded((1.3, 0.9, 0.8) if house.red else (1.0, 1.0, 1.03))
        cv2.fillConvexPoly(picture, fixed_pixels(house.corners, coarse), roof, cv2.LINE_8, 8)
    return picture, coarse


def _fill(picture: UInt8[np.ndarray, "_ _ 3"], tract: Tract, grid: Grid) -> None:
    cv2.fillPoly(picture, [fixed_pixels(tract.outline, grid)], _coded(tract.tint), cv2.LINE_8, 8)


def _coded(tint: tuple[float, float, float]) -> tuple[int, int, int]:
    """Red, green, blue as bytes, scaled so that the luminance of a gray is kept."""
    luminance = 0.299 * tint[0] + 0.587 * tint[1] + 0.114 * tint[2]
    red, green, blue = (min(255, round(128 * value / luminance)) for value in tint)
    return red, green, blue


def _tint_on(tint: UInt8[np.ndarray, "_ _ 3"], source: Grid, part: Grid) -> Tint:
    """The colours brought onto a part of a sheet."""
    layers = [smooth_step(tint[:, :, k].astype(np.float32), source, part) for k in range(3)]
    return np.stack(layers, axis=2) / np.float32(128.0)
