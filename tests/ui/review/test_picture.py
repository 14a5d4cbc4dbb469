"""Pictures can be sent: JSON without surprises, and every word they name exists."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.adjustment.adjusted import Contradiction
from sessions.decisions import Place
from tests.ui.desk_block import adjust, tiny_block
from ui.review.compare import (
    drawn_from_block,
    made_with,
)
from ui.review.picture import Pictured, point_part, queue_part, scene_part, status_part
from ui.review.queue import seat_down
from ui.review.rows import NO_ROWS
from ui.review.scene import scene_picture
from ui.review.state import DeskState, Draft, Seat
from ui.review.trial import Trial
from ui.web.front import as_json

PAGES = Path(__file__).resolve().parents[3] / "ui" / "web" / "pages"


@pytest.fixture(scope="module")
def state() -> DeskState:
    block = tiny_block().block
    report = adjust(block)
    return DeskState(block, report, made=made_with(report.block), before=report)


def test_every_part_can_be_sent__law(state):
    table = NO_ROWS.renewed(state)
    rows = table.rows
    seat = seat_down(Seat("seat-1", "anna"), rows)
    drawn, dem = drawn_from_block(state.oriented), tiny_block().land.dem
    parts = [
        table.lines,
        queue_part(seat, table.places),
        scene_part(seat, state, 1.0),
        status_part(state, rows, (), seat),
        point_part(state, seat, rows, Pictured(drawn, dem)),
    ]
    for part in parts:
        assert json.loads(as_json(part)) is not None


def test_a_draft_is_doubted_where_it_lies__law(state):
    rows = NO_ROWS.renewed(state).rows
    key = next(k for k in state.block.measurements if k not in tiny_block().blunders)
    pictured = Pictured(drawn_from_block(state.oriented), tiny_block().land.dem)
    seat = replace(seat_down(Seat("seat-1", "anna"), rows), current=key)
    place = Place(*key, *map(float, state.block.measurements[key].pixel[0] + 40.0))
    before = point_part(state, seat, rows, pictured)
    drafted = point_part(state, seat.with_draft(Draft(key, place)), rows, pictured)
    assert isinstance(before, dict)
    assert isinstance(drafted, dict)
    told = dict(drafted["why"])["doubt.misfit"]
    assert float(told) == pytest.approx(drafted["figures"]["ratio"], abs=0.051)
    assert float(told) > 5 > float(dict(before["why"]).get("doubt.misfit", 0.0))
    # Adjusted with it, metres and sigmas are those of one test.
    found = Contradiction(*key, pixels=8.0, metres=2.5, test=6.2, shift_m=0.4)
    pictured = replace(pictured, trial=Trial(key, False, 1.0, 0.0, key[1], (), against=found))
    tried = point_part(state, seat.with_draft(Draft(key, place)), rows, pictured)
    assert isinstance(tried, dict)
    assert tried["figures"]["ratio"] == 6.2
    assert math.hypot(*tried["figures"]["ground"]) == pytest.approx(2.5, abs=0.01)


def test_a_block_without_measurements_can_be_shown__law(state):
    empty = replace(state, block=replace(state.block, measurements={}))
    seat = seat_down(Seat("seat-1", "anna"), {})
    assert seat.current is None
    assert NO_ROWS.renewed(empty).lines == []
    assert point_part(empty, seat, {}, Pictured({}, tiny_block().land.dem)) is None
    assert scene_picture(empty, (), np.zeros((0, 2, 3)), tiny_block().land.dem).vectors.shape == (
        0,
        2,
        3,
    )


def test_nothing_on_the_pages_comes_from_elsewhere__law():
    for path in (path for path in PAGES.iterdir() if "inter-" not in path.name):
        found = re.findall(r"https?://[^\s\"'`)]+", path.read_text())
        assert [address for address in found if "www.w3.org" not in address] == []
