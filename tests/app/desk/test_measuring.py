"""New points by hand: found where they are, in every scan that shows them."""

from dataclasses import replace

import numpy as np
import pytest

from app.desk.measuring import (
    MeasuringTool,
    is_overtaken,
    measure_point,
    photos_showing,
)
from core.control.likeness import Likeness
from core.doubts import Failure
from sessions.decisions import Accept, JudgeFiducial, Place, PlaceFiducial, Recorded, Reject
from tests.ui.desk_block import adjust, tiny_block, tiny_snapshot
from ui.review.compare import made_with
from ui.review.gestures import PointAsked, Refined
from ui.review.new_points import ORTHO, next_name
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
    shown = photos_showing(state, place[None], dem)
    measured = {key[1] for key in state.block.measurements if key[0] == "J150"}
    assert measured <= set(shown)
    assert photos_showing(state, place[None] + 1e5, dem) == {}


def test_at_the_edge_of_the_only_frame_a_point_is_still_found__law(state):
    dem, name = tiny_block().land.dem, next(iter(state.oriented.photos))
    photo, camera = state.oriented.photos[name], state.oriented.camera_of(name)
    alone = replace(state, block=state.block.with_photos({name: photo}))
    alone = replace(alone, report=replace(state.report, block=alone.block))
    # A millimetre from the border: in sight, and refused before.
    film = np.array([[camera.frame_mm[0] / 2 - 1.0, 0.0]])
    pixel = photo.interior.pixel_from_film(film)
    place = photo.object_from_pixel(pixel, np.array([280.0]), camera)[:, :2]
    assert set(photos_showing(alone, place, dem)) == {name}


def test_a_new_point_lies_on_the_peak_of_likeness__truth(state):
    dem, place = tiny_block().land.dem, state.block.surveyed["J150"].position[:2]
    east, north = (float(value) for value in place)
    found = measure_point(state, "H1", (east, north), (dem, hill), SIGMA)
    shown = photos_showing(state, place[None], dem)
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
    found = measure_point(state, "H1", (east, north), (dem, bare_field), SIGMA)
    assert found.measured
    for item in found.measured:
        assert (item.status, item.used) == ("dubious", False)
        assert item.peaks[0].score == pytest.approx(3.0, abs=0.3)
        assert "chance alone" in item.reason


def test_names_are_never_given_twice__law(state):
    assert next_name(ORTHO, state, ()) == "H1"


def test_enter_moves_the_measurement_onto_the_peak_and_says_how_far__law():
    desk = tiny_snapshot()
    key = next(iter(desk.rows))
    measured = desk.state.block.measurements[key]
    values = np.zeros((41, 41), np.float32)
    values[17:24, 18:25] = np.exp(-np.add.outer(np.arange(-3, 4) ** 2, np.arange(-3, 4) ** 2) / 4)
    likeness = Likeness(values, measured.pixel - np.array([[20.0, 20.0]]), 1)
    found = MeasuringTool(lambda *_: likeness)(Refined("anna-1", key), desk, print)
    # The peak lies one pixel to the right of the measurement.
    assert found.decision == Place(
        *key,
        pytest.approx(measured.column + 1, abs=0.02),
        pytest.approx(measured.row, abs=0.02),
        # The same peak, measured anew, counts as much as before.
        measured.sigma_px,
    )
    assert (found.notice.text, found.notice.values["distance"]) == ("notice.refined", "1.00")
    flat = MeasuringTool(lambda *_: Failure("the point is not in this photo"))
    refused = flat(Refined("anna-1", key), desk, print)
    assert (refused.decision, refused.notice.text) == (None, "notice.not-refined")


def test_a_point_that_no_scan_shows_is_refused_in_words__law():
    begun = []
    tool = MeasuringTool(hill)
    found = tool(PointAsked("anna-1", 0.0, 0.0), tiny_snapshot(), begun.append)
    assert (found.decision, found.notice.text, begun) == (None, "notice.no-scan", [])
    place = tiny_block().block.surveyed["J150"].position
    found = tool(PointAsked("anna-1", *map(float, place[:2])), tiny_snapshot(), begun.append)
    assert begun[0].notice.values["count"] == found.notice.values["count"]
    assert found.notice.values["sure"] == str(sum(item.used for item in found.decision.measured))


@pytest.mark.parametrize(
    ("newer", "overtaken"),
    [
        (Accept("J1", "one"), True),
        (Reject("J1", "one", "other"), True),
        (Place("J1", "one", 5.0, 6.0), True),
        (Reject("J1", "two", "other"), False),
        (JudgeFiducial("one", "J1", use=False), False),
    ],
)
def test_what_was_decided_meanwhile_counts_more__law(newer, overtaken):
    recorded = [Recorded(2, "2026-01-01T00:00:00", "berta", newer)]
    assert is_overtaken(Place("J1", "one", 1.0, 2.0), recorded) is overtaken
    mark = PlaceFiducial("one", "3", 1.0, 2.0)
    hidden = [Recorded(2, "2026-01-01T00:00:00", "berta", JudgeFiducial("one", "3", use=False))]
    assert is_overtaken(mark, hidden)
    assert not is_overtaken(mark, recorded)
