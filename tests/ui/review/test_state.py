"""The state: what a measurement shows depends on the decision and on the adjustment."""

from dataclasses import replace

import pytest

from tests.ui.desk_block import tiny_snapshot
from ui.review.state import DeskState, Extra, same_results


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


def test_another_status_is_another_result__law():
    report = tiny_snapshot().state.report
    assert same_results(report, report)
    assert not same_results(report, replace(report, sigma_nought=report.sigma_nought + 1e-9))
    key, item = next(iter(report.block.measurements.items()))
    other = report.block.with_measurement(replace(item, status="dubious"))
    assert key in other.measurements
    assert not same_results(report, replace(report, block=other))
