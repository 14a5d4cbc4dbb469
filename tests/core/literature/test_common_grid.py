"""Scan and ortho on one grid, and junctions sought there as the thesis does."""

from dataclasses import replace

import numpy as np

from core.literature.common_grid import (
    candidates_in,
    correlated,
    grid_about,
    lay_on_grid,
    looked_at_on_grid,
    sizes_px,
)
from core.literature.published_chains import KOBYLI_1984
from tests.tiny import Tiny, ground_over

ONE = replace(KOBYLI_1984, window=82.0, best=1, least_ncc=-1.0)


def test_a_place_of_the_grid_is_the_pixel_that_shows_it__law(tiny: Tiny) -> None:
    opened = tiny.opened(tiny.names[0])
    middle = np.append(opened.photo.exterior.centre[:2], 0.0)
    pair = lay_on_grid(
        opened, tiny.reference.ortho, tiny.reference.dem, grid_about(middle, 20, 1.0), 0.0
    )
    place = np.array([[12.3, 30.6]])
    plan = pair.grid.object_from_grid(place)
    point = np.column_stack([plan, tiny.reference.dem.heights(plan)])
    expected = opened.photo.pixel_from_object(point, opened.camera)
    # OpenCV rounds places to a thirty-second of a pixel of the grid.
    assert np.abs(pair.scan_pixels(place) - expected).max() < 1 / 32
    assert pair.scan_pixels(np.zeros((0, 2))).shape == (0, 2)


def test_on_the_ground_of_its_own_day_every_place_is_found__truth(tiny: Tiny) -> None:
    """Textured ground at the true orientation, sought in windows of 15 m to either side."""
    opened, ortho = tiny.opened(tiny.names[0]), tiny.archival().ortho
    places = ground_over(tiny)
    misses = []
    for number, pair in looked_at_on_grid(opened, ortho, tiny.reference.dem, places, ONE):
        (found,) = candidates_in(number, pair, ONE)
        heights = places[number, 2:]
        shown = tiny.truth.ground_of(opened.photo.photo_id, found.pixel, heights)
        misses.append(float(np.linalg.norm(shown[0] - places[number, :2])))
    assert len(misses) > 50
    # A pixel of the scan is 1.2 m; fields of one tone have no place of their own.
    assert np.mean(np.array(misses) < 2.0) > 0.8


def test_bands_of_a_grey_ortho_are_alike_and_nearest_pixels_are_its_own__law(tiny: Tiny) -> None:
    opened = tiny.opened(tiny.names[0])
    middle = np.append(np.floor(opened.photo.exterior.centre[:2]) + 0.3, 0.0)
    grid = grid_about(middle, 30, 1.0)
    grey, green, nearest = (
        lay_on_grid(opened, tiny.archival().ortho, tiny.reference.dem, grid, 0.0, band).reference
        for band in ("grey", "green", "nearest")
    )
    assert np.abs(grey - green).max() < 1.0
    assert np.corrcoef(grey.ravel(), nearest.ravel())[0, 1] > 0.8
    assert not np.array_equal(grey, nearest)


def test_a_mirrored_patch_is_not_where_the_patch_is__law(tiny: Tiny) -> None:
    opened, ortho = tiny.opened(tiny.names[0]), tiny.archival().ortho
    inner, half = sizes_px(ONE)
    assert (inner, half) == (25, 16)
    seen = list(looked_at_on_grid(opened, ortho, tiny.reference.dem, ground_over(tiny), ONE))
    higher = [
        correlated(pair, ONE)[half, half] > correlated(pair, ONE, mirrored=True)[half, half]
        for _, pair in seen
    ]
    assert np.mean(higher) > 0.95
