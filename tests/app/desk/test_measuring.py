"""New points by hand: found where they are, in every scan that shows them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.desk.inputs import desk_inputs, first_snapshot
from app.desk.measuring import (
    Filling,
    MeasuringTool,
    is_overtaken,
    measure_point,
    photos_showing,
)
from app.project import described, read_project
from core.control.likeness import Likeness
from core.control.prediction import shown_in
from core.doubts import Failure
from core.geometry.interior import nominal_interior
from core.geometry.transforms import fit_similarity
from core.progress import SILENT
from core.scans.stage import ScanSet
from sessions.decisions import (
    Accept,
    FillMarks,
    JudgeFiducial,
    Place,
    PlaceFiducial,
    Recorded,
    Reject,
    Withdraw,
)
from sessions.replay import replay
from sessions.scan_decisions import judged_scans, said_of_scans
from sessions.session import Session
from tests.ui.desk_block import adjust, tiny_block, tiny_snapshot
from tests.ui.unmarked import as_found, without_marks
from ui.review.board import board_part
from ui.review.compare import made_with
from ui.review.gestures import PointAsked, Refined, gesture_from_message
from ui.review.mark_gestures import MarkPlaced
from ui.review.new_points import ORTHO, next_name
from ui.review.outcome import outcome_of
from ui.review.state import DeskState, Seat
from ui.web.access import Door

KNOWN_M = np.array([0.25, 0.5])


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
    heights = np.array([280.0])
    for _ in range(9):
        place = photo.object_from_pixel(pixel, heights, camera)[:, :2]
        heights = dem.heights(place)
    _, margins = shown_in(photo, camera, np.column_stack([place, heights]))
    assert margins == pytest.approx(1.0, abs=0.05)
    assert set(photos_showing(alone, place, dem)) == {name}


def test_a_new_point_lies_on_the_peak_of_likeness__truth(state):
    dem, place = tiny_block().land.dem, state.block.surveyed["J150"].position[:2]
    east, north = (float(value) for value in place)
    found = measure_point(state, "H1", (east, north), (dem, hill), KNOWN_M)
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
    found = measure_point(state, "H1", (east, north), (dem, bare_field), KNOWN_M)
    assert found.measured
    for item in found.measured:
        assert (item.status, item.used) == ("dubious", False)
        assert item.peaks[0].score == pytest.approx(3.0, abs=0.3)
        assert "chance alone" in item.reason


def test_names_are_never_given_twice__law():
    assert next_name(ORTHO, tiny_snapshot()) == "H1"


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
    assert found.notice.draft == key
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


@pytest.fixture(scope="module")
def given(tiny_run: Any):
    """What the desk begins with on the tiny block, and the description of its engine."""
    project = read_project(tiny_run.folder)
    with Session.open(project.folder, "anna") as session:
        yield desk_inputs(project, session, "anna", Door()), described(project)


def said(*decisions: Any) -> tuple[Recorded, ...]:
    return tuple(
        Recorded(number, "2026-01-01T00:00:00", "anna", decision)
        for number, decision in enumerate(decisions, start=1)
    )


def snapshot(inputs: Any, recorded: Any = ()):
    """The desk as it stands with what was said."""
    desk = first_snapshot(inputs)
    block = replay(inputs.block, recorded, inputs.initial.films, inputs.initial.cameras).block
    return replace(desk, state=replace(desk.state, block=block), recorded=recorded)


def filled(inputs: Any, desk: Any, found: Any) -> Any:
    """The decision that showing one mark comes to, where the search finds these."""
    photo, marks = next(iter(found.items()))
    asked = []

    def find(films: Any, camera: Any, pixels_mm: Any, photo_id: Any, place: Any, work: Any):
        asked.append((set(films), dict(camera.fiducials_mm), photo_id, place))
        return found

    gesture = MarkPlaced("s", photo, "", *marks.marks[0].place, fill=True)
    decision, notice = Filling(find)(gesture, desk, SILENT)
    assert asked == [
        (
            set(inputs.initial.films),
            dict(next(iter(inputs.initial.cameras.values())).fiducials_mm),
            photo,
            marks.marks[0].place,
        )
    ]
    return decision, notice


def scan_set(inputs: Any) -> ScanSet:
    return ScanSet(inputs.initial.films, {}, (), inputs.initial.cameras)


def test_films_nobody_knew_are_oriented_by_one_example__truth(given: Any, tiny_run: Any):
    inputs, engine = given
    bare = without_marks(inputs)
    engine = replace(engine, cameras=bare.initial.cameras)
    decision, notice = filled(bare, snapshot(bare), as_found(inputs.initial.films))
    assert isinstance(decision, FillMarks)
    assert (notice.text, notice.values["marks"]) == ("notice.filled-anew", "24")
    assert 0 < decision.sigma_mm < 0.02
    # Places on the film as its maker put them, but for shift and turn.
    names = {"L": "1", "R": "2", "T": "3", "B": "4"}
    true = np.array([tiny_run.truth.camera.fiducials_mm[names[n]] for n in decision.places_mm])
    fit: Any = fit_similarity(np.array(list(decision.places_mm.values())), true)
    assert np.abs(fit.residuals).max() < 0.01
    recorded = said(decision)
    at_desk = replay(bare.block, recorded, bare.initial.films, bare.initial.cameras)
    run = judged_scans(scan_set(bare), engine, recorded)
    camera = next(iter(bare.block.cameras))
    assert run.cameras[camera].fiducials_mm == decision.places_mm
    assert [d.kind for d in run.doubts if d.subject == camera] == ["fiducials-estimated"]
    assert not at_desk.unmatched
    for name, film in run.oriented.items():
        interior = at_desk.block.photos[name].interior
        assert interior.model != "nominal"
        assert np.array_equal(interior.film_from_pixel_matrix, film.interior.film_from_pixel_matrix)
        assert {mark.kind for mark in film.fiducials} == {"dotted-cross"}
    assert said_of_scans(recorded) != ()
    # Taken back as one: everything is as it was.
    back = (*recorded, Recorded(2, "2026-01-01T00:00:00", "anna", Withdraw(1)))
    again = replay(bare.block, back, bare.initial.films, bare.initial.cameras).block
    assert again == bare.block or all(
        again.photos[n].interior is bare.initial.films[n].interior for n in again.photos
    )
    assert judged_scans(scan_set(bare), engine, back).oriented == bare.initial.films
    assert said_of_scans(back) == ()


def test_a_certificate_that_comes_later_goes_before_estimated_places__law(given: Any):
    inputs, engine = given
    bare = without_marks(inputs)
    decision, _ = filled(bare, snapshot(bare), as_found(inputs.initial.films))
    recorded = said(decision)
    later = replay(inputs.block, recorded, inputs.initial.films, inputs.initial.cameras).block
    assert later.cameras == inputs.block.cameras
    oriented = judged_scans(scan_set(inputs), engine, recorded)
    assert oriented.cameras == engine.cameras
    for name, film in oriented.oriented.items():
        assert film.interior.names == inputs.initial.films[name].interior.names


def test_scans_that_were_oriented_keep_their_marks__law(given: Any):
    inputs, _ = given
    found = as_found(inputs.initial.films, named=True)
    lost, other = list(inputs.initial.films)[:2]
    films = dict(inputs.initial.films)
    camera = next(iter(inputs.initial.cameras.values()))
    nominal = nominal_interior(films[lost].size_px, camera, inputs.initial.pixel_mm[lost])
    films[lost] = replace(films[lost], interior=nominal, fiducials=(), doubts=())
    one = replace(inputs, initial=replace(inputs.initial, films=films))
    hidden = said(JudgeFiducial(other, "2", use=False))
    decision, _ = filled(one, snapshot(one, hidden), found)
    assert {name: [m.name for m in marks] for name, marks in decision.found.items()} == {
        lost: ["1", "2", "3", "4"],
        other: ["2"],
    }
    assert (decision.places_mm, decision.sigma_mm) == ({}, 0.0)


def test_with_every_certified_mark_in_use_the_search_says_so__law(given: Any):
    inputs, _ = given
    _, notice = filled(inputs, snapshot(inputs), as_found(inputs.initial.films))
    assert notice.values == {"why": "every mark of these scans is measured already"}


def test_what_a_person_said_goes_before_what_was_filled__law(given: Any):
    inputs, _ = given
    bare = without_marks(inputs)
    decision, _ = filled(bare, snapshot(bare), as_found(inputs.initial.films))
    name = next(iter(decision.found))
    left = next(mark for mark in decision.found[name] if mark.name == "L")
    moved = PlaceFiducial(name, "L", left.column + 0.5, left.row)
    for order in ((decision, moved), (decision, moved, decision)):
        block = replay(bare.block, said(*order), bare.initial.films, bare.initial.cameras).block
        interior = block.photos[name].interior
        at = interior.pixels[interior.names.index("L")]
        assert np.allclose(at, (left.column + 0.5, left.row))
    hidden = said(decision, JudgeFiducial(name, "T", use=False), decision)
    block = replay(bare.block, hidden, bare.initial.films, bare.initial.cameras).block
    assert "T" not in block.photos[name].interior.names


def test_a_second_example_adds_its_marks_to_those_of_the_first__truth(given: Any):
    inputs, _ = given
    bare = without_marks(inputs)
    every = as_found(inputs.initial.films)
    first = {
        name: replace(one, marks=tuple(m for m in one.marks if m.name != "B"))
        for name, one in every.items()
    }
    second = {
        name: replace(one, marks=tuple(m for m in one.marks if m.name == "B"))
        for name, one in every.items()
    }
    one, _ = filled(bare, snapshot(bare), first)
    assert set(one.places_mm) == {"L", "R", "T"}
    two, _ = filled(bare, snapshot(bare, said(one)), second)
    assert set(two.places_mm) == {"L", "R", "T", "B"}
    assert all([m.name for m in marks] == ["B"] for marks in two.found.values())
    block = replay(bare.block, said(one, two), bare.initial.films, bare.initial.cameras).block
    assert all(len(photo.interior.names) == 4 for photo in block.photos.values())
    assert max(photo.interior.rms_um for photo in block.photos.values()) < 20
    alone, notice = filled(bare, snapshot(bare), second)
    assert (alone, notice.text) == (None, "notice.not-filled")


def test_filled_marks_are_doubts_until_somebody_has_looked__law(given: Any):
    inputs, _ = given
    bare = without_marks(inputs)
    found = as_found(inputs.initial.films)
    worst = list(found)[2]
    marks = found[worst].marks
    found[worst] = replace(
        found[worst], marks=(replace(marks[0], disagreement_px=0.6, correlation=0.5), *marks[1:])
    )
    before = board_part(snapshot(bare).state, bare.initial, first_snapshot(bare).drawn, ())
    assert [row["cells"] for row in before["photos"]] == [[]] * 6
    assert not any(row["certified"] for row in before["photos"])
    decision, _ = filled(bare, snapshot(bare), found)
    recorded = said(decision)
    desk = snapshot(bare, recorded)
    board = board_part(desk.state, bare.initial, desk.drawn, recorded)
    cells = [cell for row in board["photos"] for cell in row["cells"]]
    assert [cell["state"] for cell in cells] == ["filled"] * 24
    assert all(cell["said"]["filled"] and 0.5 <= cell["doubt"] <= 1 for cell in cells)
    assert board["photos"][0]["photo"] == worst
    doubts = {c["name"]: c["doubt"] for c in board["photos"][0]["cells"]}
    assert max(doubts, key=doubts.__getitem__) == "L"
    assert board["examples"] == [
        {
            "id": 1,
            "camera": decision.camera,
            "photo": decision.photo_id,
            "place": [decision.column, decision.row],
        }
    ]
    accepted = said(decision, JudgeFiducial(worst, "L", use=True))
    desk = snapshot(bare, accepted)
    board = board_part(desk.state, bare.initial, desk.drawn, accepted)
    row = next(row for row in board["photos"] if row["photo"] == worst)
    cell = next(cell for cell in row["cells"] if cell["name"] == "L")
    assert (cell["state"], cell["doubt"], cell["said"]["filled"]) == ("used", 0.0, False)
    assert said_of_scans(accepted) == said_of_scans(recorded)


def test_an_example_needs_no_name_and_lies_on_the_scan__law(given: Any):
    inputs, _ = given
    bare = without_marks(inputs)
    name = next(iter(bare.block.photos))
    desk, seat = first_snapshot(bare), Seat("s", "anna")

    def act(place: Any, **more: Any) -> Any:
        message = {"kind": "mark", "photo": name, "name": "", "place": place, **more}
        gesture: Any = gesture_from_message("s", message)
        return outcome_of(gesture, seat, desk)

    assert act([40.0, 50.0], fill=True).act == "fill"
    assert act([40.0, 50.0]) == act([40.0, 50.0], snap=True)
    assert act([40.0, 50.0]).act == ""
    assert act([-4.0, 50.0], fill=True).notice.text == "notice.outside"
    cancel: Any = gesture_from_message("s", {"kind": "cancel", "filling": True})
    assert outcome_of(cancel, seat, desk).act == "cancel filling"
