"""Film and scan: what is shown lies where the true orientations put it, marks included."""

import warnings

import cv2
import numpy as np
import pytest
import rasterio
from rasterio.errors import NotGeoreferencedWarning

from core.raster.grid import Grid
from core.synthetic.film import expose_band, pixel_maps
from core.synthetic.flight import make_flight
from core.synthetic.options import SyntheticOptions
from core.synthetic.painting import Ground
from core.synthetic.truth import read_truth


@pytest.fixture(scope="module")
def flight():
    return make_flight(SyntheticOptions(size="tiny", seed=3, relief_m=120.0))


@pytest.fixture(scope="module")
def empty_ground(flight):
    grid = Grid.over(flight.bounds, 0.8)
    return Ground(grid, np.zeros((grid.rows, grid.columns), dtype=np.uint8))


def test_maps_between_nodes_are_those_of_the_exact_ray__truth(flight, empty_ground):
    exposure = flight.exposures[1]
    maps = pixel_maps(empty_ground, flight.terrain, exposure, flight.camera)
    columns, rows = maps.band(300, 312)
    at = np.arange(60, 1000, 7)
    pixels = np.column_stack([at + 0.5, np.full(len(at), 305.5)])
    ground = exposure.ground_from_pixel(pixels, flight.terrain, flight.camera)
    exact = empty_ground.grid.grid_from_object(ground[:, :2]) - 0.5
    # 0.02 scan pixels are 0.03 pixels of the ground raster.
    assert np.abs(columns[5, at] - exact[:, 0]).max() < 0.02
    assert np.abs(rows[5, at] - exact[:, 1]).max() < 0.02


def test_rays_end_on_the_terrain_and_return__law(flight):
    exposure = flight.exposures[4]
    pixels = np.random.default_rng(1).uniform(50, 1020, (200, 2))
    ground = exposure.ground_from_pixel(pixels, flight.terrain, flight.camera)
    assert np.abs(flight.terrain.heights(ground[:, :2]) - ground[:, 2]).max() < 1e-3
    assert np.abs(exposure.pixel_from_object(ground, flight.camera) - pixels).max() < 1e-4


def test_dots_on_the_ground_are_imaged_where_projection_puts_them__truth(flight, empty_ground):
    grid = empty_ground.grid
    exposure = flight.exposures[3]
    film = np.random.default_rng(2).uniform(-80, 80, (60, 2))
    ground = exposure.ground_from_pixel(exposure.pixels(film), flight.terrain, flight.camera)
    painted = np.zeros((grid.rows, grid.columns), dtype=np.float32)
    place = grid.grid_from_object(ground[:, :2]) - 0.5
    for column, row in place:
        left, top = int(column) - 12, int(row) - 12
        x, y = np.arange(left, left + 25) - column, np.arange(top, top + 25) - row
        dot = np.exp(-(x[None, :] ** 2 + y[:, None] ** 2) / (2 * 2.5**2))
        window = painted[top : top + 25, left : left + 25]
        np.maximum(window, 250.0 * dot, out=window)
    dotted = Ground(grid, np.round(painted).astype(np.uint8))
    maps = pixel_maps(dotted, flight.terrain, exposure, flight.camera)
    light = expose_band(dotted, maps, 0, 1078)
    expected = exposure.pixel_from_object(ground, flight.camera)
    errors = []
    for k, (column, row) in enumerate(expected):
        others = np.delete(expected, k, axis=0)
        if np.linalg.norm(others - expected[k], axis=1).min() < 20:
            continue
        left, top = int(column) - 8, int(row) - 8
        window = light[top : top + 17, left : left + 17]
        x = (np.arange(left, left + 17) + 0.5) @ window.sum(axis=0) / window.sum()
        y = (np.arange(top, top + 17) + 0.5) @ window.sum(axis=1) / window.sum()
        errors.append((x - column, y - row))
    assert len(errors) > 30
    assert np.abs(np.mean(errors, axis=0)).max() < 0.005
    assert np.abs(errors).max() < 0.03


def test_fiducials_lie_where_the_certificate_says__truth(tiny_block):
    truth = read_truth(tiny_block)
    for name, exposure in truth.photos.items():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with rasterio.open(tiny_block / "scans" / f"{name}.tif") as raster:
                scan = raster.read(1).astype(np.float64)
        found = []
        for place in truth.camera.fiducials_mm.values():
            column, row = exposure.pixels(np.array([place]))[0]
            left, top = int(column) - 16, int(row) - 16
            window = np.clip(scan[top : top + 33, left : left + 33] - 40.0, 0, None)
            x, y = np.meshgrid(np.arange(left, left + 33) + 0.5, np.arange(top, top + 33) + 0.5)
            near = np.hypot(x - column, y - row) < 2.7 / 0.18
            weight = window * near
            found.append(
                (
                    (weight * x).sum() / weight.sum() - column,
                    (weight * y).sum() / weight.sum() - row,
                )
            )
        assert np.median(np.abs(found)) < 0.1, name
        assert np.abs(found).max() < 0.3, name  # a speck of dust may lie on one


def test_true_ground_and_scan_show_the_same__truth(tiny_block):
    """Phase correlation of the true archival ground, brought into the scan by the truth."""
    truth = read_truth(tiny_block)
    with rasterio.open(truth.archival_ortho) as raster:
        ortho = raster.read(1).astype(np.float32)
        west, north, gsd = raster.transform.c, raster.transform.f, raster.transform.a
    name = next(iter(truth.photos))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with rasterio.open(tiny_block / "scans" / f"{name}.tif") as raster:
            scan = raster.read(1).astype(np.float32)
    shifts = []
    for left, top in [(150, 150), (700, 200), (300, 700), (750, 760), (450, 420)]:
        x, y = np.meshgrid(np.arange(left, left + 128) + 0.5, np.arange(top, top + 128) + 0.5)
        pixels = np.column_stack([x.ravel(), y.ravel()])
        heights = np.full(len(pixels), 250.0)
        for _ in range(6):
            ground = truth.photos[name].object_from_pixel(pixels, heights, truth.camera)
            heights = truth.heights_at(ground)
        columns = ((ground[:, 0] - west) / gsd - 0.5).reshape(x.shape).astype(np.float32)
        rows = ((north - ground[:, 1]) / gsd - 0.5).reshape(x.shape).astype(np.float32)
        there = cv2.remap(ortho, columns, rows, cv2.INTER_LINEAR)
        here = scan[top : top + 128, left : left + 128]
        window = cv2.createHanningWindow((128, 128), cv2.CV_32F)
        there = cv2.GaussianBlur(there, (0, 0), 1.0)
        here = cv2.GaussianBlur(here, (0, 0), 1.0)
        shifts.append(cv2.phaseCorrelate(there, here, window)[0])
    assert np.abs(np.median(shifts, axis=0)).max() < 0.1
