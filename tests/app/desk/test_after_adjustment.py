"""After an adjustment: all that follows from it is found beside it, and adopted at once."""

from dataclasses import replace

import numpy as np
import pytest

from app.desk.after_adjustment import AfterAdjustment, adopt_adjustment
from tests.ui.desk_block import adjust, tiny_block, tiny_snapshot
from ui.review.compare import made_with
from ui.review.scene import Footprints
from ui.review.snapshot import DeskSnapshot
from ui.review.state import NO_EVIDENCE


@pytest.fixture(scope="module")
def decided() -> DeskSnapshot:
    """The desk with every blunder rejected, before it is adjusted again."""
    desk = tiny_snapshot()
    block = desk.state.block
    for key in tiny_block().blunders:
        block = block.with_measurement(replace(block.measurements[key], status="rejected"))
    return replace(desk, state=replace(desk.state, block=block, adjusting=True))


@pytest.fixture(scope="module")
def concluded(decided) -> DeskSnapshot:
    work = AfterAdjustment(decided, lambda _: NO_EVIDENCE, 0.1, Footprints(decided.dem))
    assert work.block() is decided.state.block
    return work.conclude(adjust(work.block()))


def test_what_follows_is_found_of_the_new_report__law(decided, concluded):
    state = concluded.state
    assert state.report.sigma_nought < decided.state.report.sigma_nought
    assert state.before is decided.state.report
    assert not state.adjusting
    assert len(concluded.outlines) == 48 * len(state.block.photos)
    blunder = sorted(tiny_block().blunders)[0]
    assert concluded.rows[blunder].state == "rejected"


def test_photos_that_moved_are_drawn_anew_and_their_orthos_stale__law(concluded):
    moved = {name for name, one in concluded.drawn.items() if one.version > 1}
    assert moved
    assert set(concluded.stale) <= set(concluded.state.block.photos)
    assert set(concluded.stale) & moved


def test_what_was_decided_meanwhile_stays__law(decided, concluded):
    key = next(k for k in decided.state.block.measurements if k not in tiny_block().blunders)
    accepted = replace(decided.state.block.measurements[key], status="accepted")
    block = decided.state.block.with_measurement(accepted)
    now = replace(decided, state=replace(decided.state, block=block, decided=9))
    fresh = adopt_adjustment(now, concluded, 0.1)
    assert fresh.state.block is block
    assert fresh.state.report is concluded.state.report
    assert fresh.state.decided == 9
    assert [one.decided for one in fresh.adjustments] == [9]
    assert fresh.trials == {}


def test_orthos_made_meanwhile_are_not_stale__law(decided, concluded):
    made = made_with(concluded.state.oriented)
    now = replace(decided, state=replace(decided.state, made=made))
    assert adopt_adjustment(now, concluded, 0.1).stale == ()
    assert adopt_adjustment(decided, concluded, 0.1).stale == concluded.stale
    assert np.isfinite(concluded.outlines).any()
