"""The state: what a measurement shows depends on the decision and on the adjustment."""

from dataclasses import replace

import pytest

from core.adjustment.adjusted import OUT
from sessions.checks import results_digest
from tests.ui.desk_block import tiny_snapshot
from ui.review.state import DeskState, Extra


@pytest.fixture(scope="module")
def state() -> DeskState:
    return tiny_snapshot().state


def one_used(state: DeskState):
    return next(item for item in state.block.measurements.values() if item.status == "auto")


def test_what_the_adjustment_left_out_shows_as_unused_with_its_reason__law(state):
    item = one_used(state)
    assert state.shown_state(item) == "auto"
    judged = replace(state, report=replace(state.report, rejected={item.key: "gross error"}))
    assert judged.shown_state(item) == "unused"
    assert judged.remark(item) == "gross error"


def test_what_a_person_decided_stands_against_the_adjustment__law(state):
    item = replace(one_used(state), status="accepted")
    judged = replace(state, report=replace(state.report, rejected={item.key: "gross error"}))
    assert judged.shown_state(item) == "accepted"
    assert judged.remark(item) == ""


def test_what_is_measured_in_a_rejected_photo_is_unused_and_says_so__law(state):
    """It stood as in use, and waited to be looked at."""
    item = one_used(state)
    name = f"photo {item.photo_id}"
    photo = replace(item, point_id=name, status="rejected")
    out = replace(state, extra=Extra(measurements={photo.key: photo}, kinds={name: "photo"}))
    accepted, rejected = (replace(item, status=one, reason="") for one in ("accepted", "rejected"))
    assert [out.shown_state(one) for one in (item, accepted)] == ["unused", "accepted"]
    assert [out.remark(one) for one in (item, accepted, rejected)] == [OUT, OUT, ""]


def test_the_oriented_block_has_the_new_orientations_and_the_old_measurements__law(state):
    assert state.oriented.measurements is state.block.measurements
    for name, photo in state.oriented.photos.items():
        assert photo is state.report.block.photos[name]


def test_rows_are_found_among_points_and_among_other_doubts__law(state):
    item = one_used(state)
    extra = replace(item, point_id="tie 7")
    both = replace(
        state,
        extra=Extra({"tie 7": state.block.surveyed[item.point_id]}, {extra.key: extra}),
    )
    assert both.measurement_of(item.key) is item
    assert both.measurement_of(extra.key) is extra
    assert both.point_of("tie 7") is state.block.surveyed[item.point_id]
    assert both.measurement_of(("none", "none")) is None


def test_what_tables_tell_is_written_until_any_of_it_changes__law(state):
    """A check point judges only: what is said of it leaves every orientation as it was."""
    report, block = state.report, state.report.block
    state = replace(state, written_of=results_digest(report))
    again = replace(report, block=replace(block, measurements={**block.measurements}))
    assert replace(state, report=again).written
    assert not replace(state, adjusting=True).written
    item = next(one for one in block.measurements.values() if one.used)
    point = block.surveyed[item.point_id]
    others = [
        block.with_measurement(replace(item, column=item.column + 0.5)),
        block.with_measurement(replace(item, seen=not item.seen)),
        block.with_measurement(replace(item, status="dubious")),
    ]
    for changes in (
        {"position": point.position + 1.0},
        {"role": "check" if point.role == "control" else "control"},
        {"description": "a stone"},
    ):
        surveyed = {**block.surveyed, point.point_id: replace(point, **changes)}
        others.append(replace(block, surveyed=surveyed))
    reports = [replace(report, block=other) for other in others]
    reports.append(replace(report, sigma_nought=report.sigma_nought + 1e-9))
    assert not any(replace(state, report=other).written for other in reports)
