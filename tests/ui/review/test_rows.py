"""Rows say what is doubtful about a measurement, and change with it."""

from dataclasses import replace

import numpy as np

from tests.ui.desk_block import tiny_block
from ui.review.misfit import Misfit
from ui.review.rows import queue_row, row_line
from ui.review.state import Extra


def test_a_decision_changes_its_row_only_as_if_all_were_made_anew__law(desk, seat):
    rejected = replace(desk.state.block.measurements[seat.current], status="rejected")
    after = replace(desk.state, block=desk.state.block.with_measurement(rejected))
    quick, whole = desk.table.with_changes(desk.state, after), desk.table.renewed(after)
    assert quick.lines == whole.lines
    changed = [old is not new for old, new in zip(desk.table.lines, quick.lines, strict=True)]
    assert sum(changed) == 1
    assert quick.rows[seat.current].human


def test_a_rejected_photo_changes_the_rows_of_what_is_measured_in_it__law(desk, seat):
    key = next(one for one, row in desk.rows.items() if row.state == "auto" and row.gain > 0)
    name, item = f"photo {key[1]}", desk.state.block.measurements[key]
    point, photo = desk.state.block.surveyed[key[0]], replace(item, point_id=name)
    doubtful = Extra({name: point}, {photo.key: photo}, {name: "photo"})
    before = replace(desk.state, extra=doubtful)
    rejected = {photo.key: replace(photo, status="rejected")}
    after = replace(before, extra=replace(doubtful, measurements=rejected))
    quick, whole = desk.table.renewed(before).with_changes(before, after), desk.table.renewed(after)
    assert quick.lines == whole.lines
    assert (quick.rows[key].state, quick.rows[key].gain) == ("unused", 0.0)


def test_rows_that_went_are_gone__law(desk):
    gone = next(iter(desk.state.block.measurements))
    left = {k: m for k, m in desk.state.block.measurements.items() if k != gone}
    after = replace(desk.state, block=replace(desk.state.block, measurements=left))
    assert gone not in desk.table.with_changes(desk.state, after).rows


def test_a_large_misfit_and_a_low_score_are_named_as_reasons__truth(desk):
    key = next(k for k in desk.rows if k not in tiny_block().blunders)
    figures = desk.table.figures
    calm = queue_row(desk.state, figures, key)
    far = replace(figures, misfits={**figures.misfits, key: Misfit((40.0, 0.0), (7.0, 0.0), 20.0)})
    row = queue_row(desk.state, far, key)
    assert row.grounds[0].text == "doubt.misfit"
    assert row.grounds[0].value == 20.0
    assert row.doubt > 0.95 > calm.doubt
    assert row_line(row)[-5] == 20.0
    usual = replace(figures, misfits={**figures.misfits, key: Misfit((9.0, 0.0), (1.0, 0.0), 1.4)})
    assert "doubt.misfit" not in {g.text for g in queue_row(desk.state, usual, key).grounds}
    poor = replace(desk.state.block.measurements[key], score=0.1)
    state = replace(desk.state, block=desk.state.block.with_measurement(poor))
    assert "doubt.score" in {ground.text for ground in queue_row(state, figures, key).grounds}


def test_a_line_holds_what_the_page_expects__law(desk):
    row = next(iter(desk.rows.values()))
    line = row_line(replace(row, misfit_px=np.pi, score=float("nan"), sigmas=1.25))
    assert line[:2] == list(row.key)
    assert line[6:] == [3.14, None, None, 1.2, 0, *(round(value, 1) for value in row.place), 0]
