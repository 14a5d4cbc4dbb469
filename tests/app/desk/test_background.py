"""The background: newest wins, errors stay small, making orthos can be stopped."""

import threading
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from app.desk.background import (
    Adjusted,
    AfterAdjustment,
    Filler,
    RemakeEnded,
    Remaker,
    RemakeStep,
    Worker,
    adopt_adjustment,
)
from app.desk.messages import FillEnded, FillStep
from core.doubts import Failure
from core.errors import ReferenceDataError
from tests.ui.desk_block import adjust, tiny_block, tiny_snapshot
from ui.review.compare import made_with
from ui.review.mark_gestures import MarkPlaced
from ui.review.scene import Footprints
from ui.review.snapshot import DeskSnapshot
from ui.review.state import NO_EVIDENCE, Notice


@dataclass(frozen=True)
class Captured:
    """A block to adjust, and nothing that follows from it."""

    name: str

    def block(self):
        return tiny_block().block

    def conclude(self, report: Any):
        return None


FIRST, SECOND = Captured("first"), Captured("second")


class Inbox:
    def __init__(self):
        self.items, self.change = [], threading.Condition()

    def __call__(self, item: Any):
        with self.change:
            self.items.append(item)
            self.change.notify_all()

    def until(self, test: Any, seconds: Any = 10) -> list[Any]:
        with self.change:
            assert self.change.wait_for(lambda: test(self.items), seconds), self.items
            return self.items


def test_a_newer_block_takes_the_place_of_an_older_one__law():
    inbox, begun = Inbox(), threading.Event()
    tiny_block()  # made before the clock runs

    def slow(captured: Any, progress: Any):
        begun.set()
        for _ in range(1000):
            progress.report(0, 1)
            if threading.Event().wait(0.005):
                break
        return adjust(captured)

    worker = Worker(slow, inbox)
    worker.start()
    worker.submit(FIRST)
    assert begun.wait(5)
    worker.submit(SECOND)
    worker.close()
    assert all(item.work is not FIRST for item in inbox.items)


@pytest.mark.parametrize("error", [ValueError("odd"), ReferenceDataError("a", "b", "c")])
def test_an_adjustment_that_fails_is_told_not_fatal__law(error: Any, caplog: Any):
    inbox, calls = Inbox(), []

    def failing(block: Any, progress: Any):
        calls.append(block)
        if len(calls) == 1:
            raise error
        return adjust(block)

    worker = Worker(failing, inbox)
    worker.start()
    worker.submit(FIRST)
    inbox.until(lambda items: len(items) == 1)
    worker.submit(SECOND)
    first, second = inbox.until(lambda items: len(items) == 2)
    worker.close()
    assert isinstance(first, Adjusted)
    assert isinstance(first.result, Failure)
    assert not isinstance(second.result, Failure)


def test_making_orthos_reports_and_can_be_cancelled__law():
    inbox, block = Inbox(), tiny_block().block
    report = adjust(block)

    def long(photo_ids: Any, progress: Any, made_with: Any):
        assert made_with is report
        for step in range(10000):
            progress.report(step, 10000, photo_ids[0])
            threading.Event().wait(0.002)

    remaker = Remaker(long, inbox)
    remaker.start(("a",), report)
    inbox.until(lambda items: any(isinstance(item, RemakeStep) for item in items))
    assert remaker.busy
    remaker.cancel()
    ended = inbox.until(lambda items: isinstance(items[-1], RemakeEnded))[-1]
    assert ended.cancelled
    assert ended.failure == ""
    remaker.close()


def test_a_search_for_marks_tells_each_scan_and_can_be_cancelled__law():
    inbox, going = Inbox(), threading.Event()

    def search(gesture: Any, desk: Any, progress: Any):
        if going.is_set():
            return None, Notice("notice.not-filled", {"why": gesture.photo_id})
        for step in range(10000):
            progress.report(step, 10000, f"scan {step}")
            threading.Event().wait(0.002)
        raise AssertionError("nobody stopped it")

    filler = Filler(search, inbox)
    shown = MarkPlaced("anna-1", "a", "", 1.0, 2.0, fill=True)
    filler.start(shown, tiny_snapshot())
    steps = inbox.until(lambda items: any(isinstance(item, FillStep) for item in items))
    assert steps[0].what.startswith("scan ")
    filler.start(shown, tiny_snapshot())
    filler.cancel()
    ended = inbox.until(lambda items: isinstance(items[-1], FillEnded))[-1]
    assert (ended.seat_id, ended.decision, ended.notice.text) == (
        "anna-1",
        None,
        "notice.fill-cancelled",
    )
    filler.close()
    going.set()
    filler.start(shown, tiny_snapshot())
    ended = inbox.until(lambda items: isinstance(items[-1], FillEnded) and not filler.busy)[-1]
    assert ended.notice.text == "notice.not-filled"
    filler.close()


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
