"""Tiles show the ground where it is: the warped scan lies on the ortho."""

import cv2
import numpy as np
import pytest

from core.raster.grid import Grid
from tests.ui.desk_block import CAMERA, tiny_block, true_photos
from ui.review.compare import DrawnPhoto
from ui.review.tiles import (
    TILE,
    CoarseOrtho,
    Lattice,
    Stretch,
    fit_stretch,
    local_contrast,
    ortho_tile,
    raw_tile,
    scan_map,
    warped_tile,
)

PLAIN = Stretch(0.0, 255.0)


@pytest.fixture(scope="module")
def drawn() -> DrawnPhoto:
    tiny = tiny_block()
    photo = true_photos(1200, tiny.land.dem)["1938_01_015"]
    return DrawnPhoto(photo, CAMERA, 1)


def about(drawn: DrawnPhoto, pixel_m: float) -> Grid:
    east, north = drawn.photo.exterior.centre[:2]
    half = TILE / 2 * pixel_m
    return Grid(east - half, north + half, pixel_m, TILE, TILE)


def test_the_map_between_nodes_is_the_projection__law(drawn):
    tiny, grid = tiny_block(), about(drawn, 1.0)
    pixels = scan_map(drawn, tiny.land.dem, grid)
    columns, rows = np.meshgrid(np.arange(0, TILE, 37) + 0.5, np.arange(0, TILE, 41) + 0.5)
    places = np.column_stack([columns.ravel(), rows.ravel()])
    plane = grid.object_from_grid(places)
    ground = np.column_stack([plane, tiny.land.dem.heights(plane)])
    exact = drawn.photo.pixel_from_object(ground, CAMERA)
    found = pixels[places[:, 1].astype(int), places[:, 0].astype(int)]
    assert np.abs(found - exact).max() < 0.1


def test_the_warped_scan_lies_on_the_landscape_it_shows__truth(drawn):
    tiny, grid = tiny_block(), about(drawn, 1.0)
    warped = warped_tile(drawn, tiny.land.dem, tiny.scans, PLAIN, grid).astype(np.float32)
    then = type(tiny.land.today)(tiny.land.today.grid, tiny.land.then)
    across, down = np.meshgrid(*grid.centres())
    place = then.grid.grid_from_object(np.column_stack([across.ravel(), down.ravel()])) - 0.5
    place = place.reshape(TILE, TILE, 2).astype(np.float32)
    truth = cv2.remap(
        cv2.GaussianBlur(then.values, (0, 0), 1.0),
        np.ascontiguousarray(place[..., 0]),
        np.ascontiguousarray(place[..., 1]),
        cv2.INTER_LINEAR,
    ).astype(np.float32)
    shift, response = cv2.phaseCorrelate(truth, warped, cv2.createHanningWindow((TILE, TILE), 5))
    assert response > 0.2
    assert np.hypot(*shift) < 0.15


def test_tiles_beyond_everything_are_dark__law(drawn):
    tiny = tiny_block()
    far = Grid(0.0, 0.0, 1.0, TILE, TILE)
    assert warped_tile(drawn, tiny.land.dem, tiny.scans, PLAIN, far).max() < 30
    assert ortho_tile(tiny.land.today, far).max() < 30
    assert raw_tile(drawn, tiny.scans, PLAIN, (0, 99, 99)).max() < 30


def test_raw_tiles_are_the_scan__law(drawn):
    tiny = tiny_block()
    tile = raw_tile(drawn, tiny.scans, PLAIN, (0, 1, 2))
    window = tiny.scans(drawn.photo.scan, TILE, 2 * TILE, TILE, TILE, 1)
    assert np.array_equal(tile, window.astype(np.uint8))
    wider = raw_tile(drawn, tiny.scans, PLAIN, (0, 1, 2), margin=10)
    assert np.array_equal(wider[10:-10, 10:-10], tile)
    last = raw_tile(drawn, tiny.scans, PLAIN, (1, 2, 2))
    assert last.shape == (TILE, TILE)


def test_tiles_of_a_lattice_touch__law():
    bounds = (1000.0, 2000.0, 5000.0, 4000.0)
    lattice = Lattice.over(bounds, 0.5)
    # The pages fit what the ortho has, not the tiles that reach beyond it.
    part = lattice.part(bounds)
    assert (part["width"], part["height"]) == (4000.0, 2000.0)
    first, right, below = lattice.tile(0, 0, 0), lattice.tile(0, 1, 0), lattice.tile(0, 0, 1)
    assert first.bounds[2] == right.bounds[0]
    assert first.bounds[1] == below.bounds[3]
    top = lattice.tile(lattice.levels - 1, 0, 0)
    assert top.bounds[2] - top.bounds[0] >= 2000


def test_local_contrast_brings_dark_and_bright_together__law():
    rng = np.random.default_rng(1)
    ramp = np.linspace(30, 210, TILE)[None, :] + rng.normal(0, 6, (TILE, TILE))
    evened = local_contrast(np.clip(ramp, 0, 255).astype(np.uint8)).astype(float)
    assert abs(evened[:, :60].mean() - evened[:, -60:].mean()) < 0.6 * 140
    assert evened.std() > 10


def test_the_stretch_leaves_half_a_per_cent_at_either_end_and_margins_out__law():
    values = np.random.default_rng(2).uniform(50, 90, (600, 600)).astype(np.float32)
    values[:20], values[-20:] = 0, 255
    stretch = fit_stretch(values)
    assert stretch.black == pytest.approx(50.2, abs=0.1)
    assert stretch.white == pytest.approx(89.8, abs=0.1)


def test_the_small_ortho_shows_what_the_files_show__truth():
    ortho = tiny_block().land.today
    coarse = CoarseOrtho(ortho, longest_px=600)
    west, _, _, north = ortho.bounds
    fine, wide = (Grid(west + 300, north - 300, pixel, 128, 128) for pixel in (1.0, 8.0))
    assert coarse.ready(fine)
    assert not coarse.ready(wide)
    coarse.prepare()
    assert coarse.ready(wide)
    assert np.array_equal(coarse.read_colour(fine), ortho.read_colour(fine))
    off = coarse.read_colour(wide).astype(float) - ortho.read_colour(wide)
    assert np.abs(off).mean() < 4
    assert abs(off.mean()) < 0.5
