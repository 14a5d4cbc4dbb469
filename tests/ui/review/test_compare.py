"""Both pictures of a point show the same place, and are drawn anew only where that moved."""

from dataclasses import replace

import numpy as np
import pytest

from tests.ui.desk_block import tiny_block, tiny_snapshot
from ui.review.compare import (
    drawn_from_block,
    ground_from_pixel,
    made_with,
    overlay_of,
    pixel_from_ground,
    redrawn,
    stale_photos,
    with_made,
)
from ui.review.state import DeskState


@pytest.fixture(scope="module")
def state() -> DeskState:
    return tiny_snapshot().state


def test_overlays_lie_within_a_pixel_of_what_they_mark__truth(state):
    dem = tiny_block().land.dem
    drawn = drawn_from_block(state.oriented)
    good = [key for key in state.block.measurements if key not in tiny_block().blunders]
    offsets = []
    for key in good[:60]:
        overlay = overlay_of(state, drawn, dem, key)
        assert overlay is not None
        offsets.append(np.linalg.norm(overlay.surveyed - overlay.predicted))
    # The DEM is interpolated, the survey has noise: decimetres, not metres.
    assert np.median(offsets) < 0.5


def test_photos_are_drawn_anew_only_when_they_moved__law(state):
    drawn = drawn_from_block(state.oriented)
    assert all(photo.version == 1 for photo in redrawn(drawn, state.oriented).values())
    photos = dict(state.oriented.photos)
    name, photo = next(iter(photos.items()))
    exterior = replace(photo.exterior, centre=photo.exterior.centre + np.array([3.0, 0, 0]))
    photos[name] = photo.with_exterior(exterior, True)
    moved = redrawn(drawn, state.oriented.with_photos(photos))
    assert [n for n, p in moved.items() if p.version == 2] == [name]


def test_orthos_are_stale_until_they_are_made_again__law(state):
    assert stale_photos(state, 0.1) == ()
    older = replace(state, made=made_with(state.block))
    stale = stale_photos(older, 0.1)
    assert set(stale) == set(state.block.photos)
    assert stale_photos(with_made(older, stale, older.report), 0.1) == ()


def test_pixels_on_the_ground_come_back_to_themselves__law(state):
    dem, pixels = tiny_block().land.dem, np.array([[200.0, 300.0], [900.0, 700.0]])
    for drawn in drawn_from_block(state.oriented).values():
        plane = ground_from_pixel(pixels, drawn, dem, 280.0)[:, :2]
        assert np.abs(pixel_from_ground(plane, drawn, dem) - pixels).max() < 0.05


def test_nothing_is_laid_over_a_measurement_that_is_gone__law(state):
    drawn, dem = drawn_from_block(state.oriented), tiny_block().land.dem
    assert overlay_of(state, drawn, dem, ("none", next(iter(drawn)))) is None
    key = next(iter(state.block.measurements))
    assert overlay_of(state, {}, dem, key) is None
