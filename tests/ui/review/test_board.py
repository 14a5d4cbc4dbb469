"""Fiducials corrected at the desk: the block, the next run and the board agree on what was said."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.desk.inputs import desk_inputs, first_snapshot
from app.desk.measuring import MeasuringTool, snap_to_mark
from app.project import described, read_project
from core.geometry.interior import fit_interior
from core.scans.stage import ScanSet
from sessions.decisions import JudgeFiducial, PlaceFiducial, Recorded, Withdraw
from sessions.replay import replay
from sessions.scan_decisions import judged_scans, mark_changes
from sessions.session import Session
from ui.review.board import board_drafts_part, board_part
from ui.review.compare import drawn_from_block
from ui.review.drafts import mark_effect
from ui.review.gestures import gesture_from_message
from ui.review.mark_gestures import MarkPlaced
from ui.review.outcome import outcome_of
from ui.review.placement import placement_part
from ui.review.state import DeskState, Seat
from ui.web.access import Door
from ui.words.catalogue import words


@pytest.fixture(scope="module")
def given(tiny_run: Any):
    """What the desk begins with on the tiny block, and the description of its engine."""
    project = read_project(tiny_run.folder)
    with Session.open(project.folder, "anna") as session:
        yield desk_inputs(project, session, "anna", Door()), described(project)


@pytest.fixture(scope="module")
def state(given: Any) -> DeskState:
    return DeskState(given[0].block, given[0].report, made={})


def said(*decisions: Any) -> tuple[Recorded, ...]:
    return tuple(
        Recorded(number, "2026-01-01T00:00:00", "anna", decision)
        for number, decision in enumerate(decisions, start=1)
    )


def scan_set(inputs: Any) -> ScanSet:
    doubts = tuple(d for film in inputs.initial.films.values() for d in film.doubts)
    return ScanSet(inputs.initial.films, {}, doubts, inputs.block.cameras)


def a_mark(inputs: Any):
    name = next(iter(inputs.initial.films))
    return name, inputs.initial.films[name].fiducials[0]


def test_the_desk_and_the_next_run_orient_a_scan_the_same__law(given: Any):
    inputs, engine = given
    name, mark = a_mark(inputs)
    recorded = said(PlaceFiducial(name, mark.name, mark.column + 0.4, mark.row - 0.3))
    at_desk = replay(inputs.block, recorded, inputs.initial.films).block.photos[name].interior
    run = judged_scans(scan_set(inputs), engine, recorded)
    assert np.array_equal(
        at_desk.film_from_pixel_matrix, run.oriented[name].interior.film_from_pixel_matrix
    )
    # A block made by that run, opened at the desk: nothing moves; taken back: as it was found.
    photo = replace(inputs.block.photos[name], interior=run.oriented[name].interior)
    made = inputs.block.with_photos({**inputs.block.photos, name: photo})
    assert replay(made, recorded, inputs.initial.films).block.photos[name] is photo
    assert replay(made, recorded).block.photos[name] is photo
    back = replay(made, (*recorded, *said(None, Withdraw(1))[1:]), inputs.initial.films).block
    found = inputs.initial.films[name].interior
    assert back.photos[name].interior is found
    assert judged_scans(scan_set(inputs), engine, ()).oriented[name].interior is found


def test_a_mark_left_out_takes_no_part__oracle(given: Any):
    inputs, engine = given
    name, mark = a_mark(inputs)
    recorded = said(JudgeFiducial(name, mark.name, use=False))
    film, camera = inputs.initial.films[name], inputs.block.camera_of(name)
    others = [one for one in film.fiducials if one.name != mark.name]
    alone: Any = fit_interior(
        [one.name for one in others],
        np.array([(one.column, one.row) for one in others]),
        np.array([camera.fiducials_mm[one.name] for one in others]),
        sigmas_px=np.array([one.sigma_px for one in others]),
    )
    judged = judged_scans(scan_set(inputs), engine, recorded).oriented[name]
    assert np.allclose(
        judged.interior.film_from_pixel_matrix, alone.film_from_pixel_matrix, rtol=1e-9, atol=1e-9
    )
    assert mark in judged.fiducials
    assert not replay(inputs.block, recorded).unmatched
    again = said(*[item.decision for item in recorded], JudgeFiducial(name, mark.name, use=True))
    assert judged_scans(scan_set(inputs), engine, again).oriented == inputs.initial.films
    elsewhere = said(PlaceFiducial("nowhere", "1", 5.0, 5.0), PlaceFiducial(name, "99", 5.0, 5.0))
    assert replay(inputs.block, elsewhere).unmatched == elsewhere


def test_a_mark_pointed_at_roughly_is_centred__truth(given: Any):
    inputs, _ = given
    rng = np.random.default_rng(0)
    apart = []
    for name, film in inputs.initial.films.items():
        for mark in film.fiducials:
            right, down = rng.uniform(-2.0, 2.0, 2)
            found: Any = snap_to_mark(
                inputs.initial, name, mark.name, (mark.column + right, mark.row + down)
            )
            apart.append(np.hypot(found.column - mark.column, found.row - mark.row))
    # The example's own middle is as uncertain as the mark's.
    assert np.median(apart) < 0.1
    assert max(apart) < 0.4


def test_the_board_shows_every_mark_worst_first__law(state: Any, given: Any):
    inputs, _ = given
    drawn = drawn_from_block(inputs.block)
    name, mark = a_mark(inputs)
    board = board_part(state, inputs.initial, drawn, ())
    marks = len(inputs.block.camera_of(name).fiducials_mm)
    assert [len(row["cells"]) for row in board["photos"]] == [marks] * len(inputs.block.photos)
    doubts = [row["doubt"] for row in board["photos"]]
    assert doubts == sorted(doubts, reverse=True)
    recorded = said(PlaceFiducial(name, mark.name, mark.column + 9.0, mark.row))
    moved = replace(state, block=replay(inputs.block, recorded, inputs.initial.films).block)
    worst = board_part(moved, inputs.initial, drawn, recorded)["photos"][0]
    cell = next(one for one in worst["cells"] if one["name"] == mark.name)
    # So far off that the others contradict it: it is left out, and the board says so.
    assert (worst["photo"], cell["state"], cell["said"]["who"]) == (name, "unused", "anna")
    assert any("was left out" in why for why in worst["why"])
    assert np.hypot(*cell["residual"]) > 1000
    recorded = said(PlaceFiducial(name, mark.name, mark.column + 0.6, mark.row))
    moved = replace(state, block=replay(inputs.block, recorded, inputs.initial.films).block)
    rows = board_part(moved, inputs.initial, drawn, recorded)["photos"]
    row = next(one for one in rows if one["photo"] == name)
    cell = next(one for one in row["cells"] if one["name"] == mark.name)
    assert (cell["state"], cell["place"][0]) == (
        "placed",
        pytest.approx(mark.column + 0.6, abs=0.01),
    )
    hidden = said(JudgeFiducial(name, mark.name, use=False))
    row = next(
        r for r in board_part(state, inputs.initial, drawn, hidden)["photos"] if r["photo"] == name
    )
    cell = next(one for one in row["cells"] if one["name"] == mark.name)
    assert (cell["state"], cell["doubt"]) == ("hidden", 0.0)
    assert mark_changes(hidden)[name][mark.name].use is False


def test_photos_of_a_camera_without_marks_come_last__law(state: Any, given: Any):
    inputs, _ = given
    name = next(iter(inputs.block.photos))
    photo, camera = inputs.block.photos[name], inputs.block.camera_of(name)
    bare = replace(camera, name="bare", fiducials_mm={})
    none = np.zeros((0, 2))
    interior = replace(photo.interior, model="nominal", names=(), pixels=none, residuals_um=none)
    photos = {**inputs.block.photos, name: replace(photo, camera="bare", interior=interior)}
    block = replace(inputs.block, cameras={**inputs.block.cameras, "bare": bare}, photos=photos)
    rows = board_part(replace(state, block=block), inputs.initial, drawn_from_block(block), ())[
        "photos"
    ]
    assert {row["photo"] for row in rows} == set(photos)
    last = rows[-1]
    assert (last["photo"], last["cells"], last["doubt"]) == (name, [], 0.0)
    assert all(row["cells"] for row in rows[:-1])


def test_figures_of_the_films_are_those_of_the_table__oracle(state: Any, given: Any, tiny_run: Any):
    inputs, _ = given
    films = board_part(state, inputs.initial, drawn_from_block(inputs.block), ())["films"]
    lines = (tiny_run.folder / "results" / "film.csv").read_text(encoding="utf-8").splitlines()
    rows = [dict(zip(lines[0].split(","), line.split(","), strict=True)) for line in lines[1:]]
    told = {row["scan"]: row for row in rows}
    for film in films["films"]:
        row = told[film["photo"]]
        assert film["scale_x"] == pytest.approx(1e6 * (float(row["scale_x"]) - 1), abs=0.15)
        assert film["shear"] == pytest.approx(float(row["shear_mrad"]), abs=1e-3)
    roll = films["rolls"][films["films"][0]["camera"]]
    assert roll["count"] == len(films["films"])
    means = np.mean([[m[3], m[4]] for f in films["films"] for m in f["marks"][:1]], axis=0)
    assert np.allclose(roll["marks"][0][3:5], means, atol=0.011)


def test_the_map_says_how_far_each_photo_was_off__law(state: Any, given: Any):
    inputs, _ = given
    part = placement_part(state, inputs.initial, inputs.doubts)
    off = {row["photo"]: row for row in part["photos"]}
    assert set(off) == set(inputs.block.photos)
    for row in part["photos"]:
        apart = np.mean(np.array(row["after"]) - np.array(row["before"]), axis=0)
        # Corners of the picture against a lattice over the scan: nearly the same middle.
        assert np.hypot(*(apart - row["shift"])) < 0.5 * row["rms"]
        assert words()[f"placement.source.{row['source']}"]
    assert part["worst"] == max(row["rms"] for row in part["photos"])


def test_the_effect_of_a_draft_is_what_keeping_it_comes_to__law(given: Any):
    inputs, _ = given
    name, mark = a_mark(inputs)
    desk = first_snapshot(inputs)
    placed = PlaceFiducial(name, mark.name, mark.column + 0.3, mark.row)
    seat = Seat("s", "anna").with_mark(placed)
    (told,) = board_drafts_part(seat, desk.state, desk.initial, desk.recorded)
    kept = replay(inputs.block, (Recorded(1, "anna", "", placed),), inputs.initial.films).block
    interior = kept.photos[name].interior
    residual = interior.residuals_um[interior.names.index(mark.name)]
    assert told["rms"] == round(interior.rms_um, 1)
    assert told["off"] == round(float(np.hypot(*residual)), 1)
    assert told["rms"] != round(inputs.block.photos[name].interior.rms_um, 1)


def test_gestures_on_the_board_mean_decisions__law(given: Any):
    inputs, _ = given
    name, mark = a_mark(inputs)
    desk, seat = first_snapshot(inputs), Seat("s", "anna")

    def outcome(at: Seat = seat, **message: Any) -> Any:
        gesture: Any = gesture_from_message("s", {"photo": name, "name": mark.name, **message})
        return outcome_of(gesture, at, desk)

    place = [mark.column + 1.5, mark.row]
    plain = outcome(kind="mark", place=place)
    drafted = PlaceFiducial(name, mark.name, *place)
    assert (plain.decisions, plain.seat.marks) == ((), (drafted,))
    assert outcome(plain.seat, kind="mark-drop").seat.marks == ()
    kept = outcome(plain.seat, kind="mark-use", use=True)
    assert (kept.decisions, kept.seat.marks) == ((drafted,), ())
    # What the other marks contradict is asked about first.
    far = outcome(kind="mark", place=[mark.column + 40, mark.row]).seat
    assert mark_effect(desk.state, desk.initial, desk.recorded, far.marks[0]).is_against
    asked = outcome(far, kind="mark-use", use=True)
    assert (asked.decisions, asked.seat.asking) == ((), far.marks[0])
    assert outcome(asked.seat, kind="mark-use", use=True).decisions == far.marks
    hidden = outcome(plain.seat, kind="mark-use", use=False)
    assert (hidden.decisions, hidden.seat.marks) == ((JudgeFiducial(name, mark.name, False),), ())
    assert outcome(kind="mark", place=place, snap=True).act == "measure"
    snapped: Any = MeasuringTool()(MarkPlaced("s", name, mark.name, *place, snap=True), desk, print)
    assert isinstance(snapped.decision, PlaceFiducial)
    assert abs(snapped.decision.column - mark.column) < 0.4
    assert snapped.notice.text == "notice.snapped"
    wrong = outcome(kind="mark", place=[-5.0, 2.0])
    assert (wrong.decisions, wrong.notice.text) == ((), "notice.outside")
    strange = outcome(kind="mark-use", name="99", use=False)
    assert (strange.decisions, strange.notice, strange.act) == ((), None, "")
    assert gesture_from_message("s", {"kind": "sheet", "sheet": "other", "shown": True}) is None
