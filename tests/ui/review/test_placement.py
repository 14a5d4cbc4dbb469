"""The map of placements: where photos were said to lie, and where they lie."""

from dataclasses import replace

import numpy as np
import pytest

from core.doubts import Doubt
from tests.ui.desk_block import tiny_snapshot
from ui.review.placement import placement_part
from ui.review.state import InitialState

AWAY = np.array([120.0, -50.0, 0.0])


@pytest.fixture(scope="module")
def initial() -> InitialState:
    """Every photo was said to lie 130 m off; of one only the scale was known."""
    photos = tiny_snapshot().state.oriented.photos
    exterior = {
        name: replace(photo.exterior, centre=photo.exterior.centre + AWAY)
        for name, photo in photos.items()
    }
    sources = {**dict.fromkeys(photos, "world-file"), next(iter(photos)): "area"}
    return InitialState({}, {}, sources, {"lost": "It cannot be read."}, exterior)


def test_shifts_are_those_put_in__truth(initial):
    part = placement_part(tiny_snapshot().state, initial, ())
    known = [row for row in part["photos"] if row["source"] == "world-file"]
    for row in known:
        # Relief under the photo: the same ray meets higher or lower ground elsewhere.
        assert row["shift"] == pytest.approx([-120.0, 50.0], abs=2.0)
        assert row["rms"] == pytest.approx(130.0, abs=3.0)
        assert row["turn"] == pytest.approx(0.0, abs=0.05)
        assert row["scale"] == pytest.approx(1.0, abs=2e-3)
        apart = np.array(row["after"]) - np.array(row["before"])
        assert np.allclose(apart, -AWAY[:2], atol=0.2)
    assert part["median"] == pytest.approx(130.0, abs=3.0)
    assert part["worst"] == max(row["rms"] for row in known)


def test_a_photo_of_unknown_place_has_no_shift__law(initial):
    part = placement_part(tiny_snapshot().state, initial, ())
    (row,) = (row for row in part["photos"] if row["source"] == "area")
    assert (row["before"], row["shift"], row["rms"]) == (None, None, None)
    assert row["after"] is not None
    assert part["set_aside"] == [["lost", "It cannot be read."]]


def test_photos_without_a_place_come_first_and_say_why__law(initial):
    state = tiny_snapshot().state
    name = list(state.block.photos)[3]
    loose = replace(state.report.block.photos[name], oriented=False)
    block = state.report.block.with_photos({**state.report.block.photos, name: loose})
    doubt = Doubt("orientation", name, "Too few matches.", 0.9)
    state = replace(state, report=replace(state.report, block=block))
    row = placement_part(state, initial, (doubt,))["photos"][0]
    assert (row["photo"], row["after"], row["why"]) == (name, None, ["Too few matches."])
