"""New points by hand: found where they are, in every scan that shows them."""

import numpy as np
import pytest

from core.block.registration.likeness import Likeness
from core.progress import Silent
from tests.ui.desk_block import adjust, tiny_block
from ui.review.adding import measured_point, next_name, seen_in
from ui.review.compare import made_with
from ui.review.state import DeskState

SIGMA = (0.25, 0.25, 0.5)


@pytest.fixture(scope="module")
def state() -> DeskState:
    report = adjust(tiny_block().block)
    return DeskState(tiny_block().block, report, made=made_with(report.block))


def hill(photo, camera, position) -> Likeness:
    """A likeness whose only peak lies 1.3 columns beside and 0.6 rows above the prediction."""
    pixel = photo.pixel_from_object(position, camera)
    across, down = np.meshgrid(np.arange(21.0) - 10 - 1.3, np.arange(21.0) - 10 + 0.6)
    values = np.exp(-(across**2 + down**2) / 8).astype(np.float32)
    return Likeness(values, pixel - 10.0, 1)


def test_every_scan_that_shows_the_place_is_searched__truth(state):
    dem, place = tiny_block().land.dem, state.block.surveyed["J150"].position[:2]
    shown = seen_in(state, place[None], dem)
    measured = {key[1] for key in state.block.measurements if key[0] == "J150"}
    assert measured <= set(shown)
    assert seen_in(state, place[None] + 1e5, dem) == {}


def test_a_new_point_lies_on_the_peak_of_likeness__truth(state):
    dem, place = tiny_block().land.dem, state.block.surveyed["J150"].position[:2]
    east, north = (float(value) for value in place)
    found = measured_point(state, "H1", (east, north), (dem, hill), SIGMA, Silent())
    shown = seen_in(state, place[None], dem)
    assert len(found.measured) == len(shown) >= 2
    for item in found.measured:
        away = item.pixel - shown[item.photo_id]
        assert away[0] == pytest.approx([1.3, -0.6], abs=0.05)
        assert item.status == "auto"
        assert item.peaks[0].score > 10.0


def bare_field(photo, camera, position) -> Likeness:
    """A likeness of chance alone, with some maximum beside the prediction."""
    pixel = photo.pixel_from_object(position, camera)
    values = np.random.default_rng(8).normal(0.05, 0.03, (35, 35)).astype(np.float32)
    values[16:19, 16:19] = 0.1
    values[17, 17] = 0.14
    return Likeness(values, pixel - 17.0, 1)


def test_on_a_bare_field_a_point_waits_for_the_operator__truth(state):
    """A height of 3 sigma: below what chance brings, said so, and no part of the adjustment."""
    dem, place = tiny_block().land.dem, state.block.surveyed["J150"].position[:2]
    east, north = (float(value) for value in place)
    found = measured_point(state, "H1", (east, north), (dem, bare_field), SIGMA, Silent())
    assert found.measured
    for item in found.measured:
        assert (item.status, item.used) == ("dubious", False)
        assert item.peaks[0].score == pytest.approx(3.0, abs=0.3)
        assert "chance alone" in item.reason


def test_names_are_never_given_twice__law(state):
    assert next_name(state, ()) == "H1"
