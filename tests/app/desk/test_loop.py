"""The second journey without a browser: gesture in, decision on disk, picture, new numbers."""

import threading
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.desk.loop import ReviewLoop
from app.desk.messages import Measured, Screen, SeatLeft, SeatTaken, WrittenBeside
from core.errors import Cancelled, StorageError
from core.quality.check_plan import CheckPlace
from core.sheets.delivery import Delivery
from sessions.checks import new_plan, version_on_disk
from sessions.decisions import (
    Accept,
    AddPoint,
    FillMarks,
    JudgeTie,
    Place,
    Recorded,
    Reject,
    SignBlock,
)
from sessions.replay import replay
from sessions.session import Session
from sessions.sheet_samples import new_sample, sheets_of
from tests.app.test_sheet_sample import LOT
from tests.ui.desk_block import adjust, desk_inputs, tiny_block, true_photos
from ui.review.check_gestures import BlockSigned
from ui.review.compare import made_with
from ui.review.gestures import (
    AnswerAsked,
    Dropped,
    Explained,
    Judged,
    JudgedTogether,
    Named,
    PlacedInScan,
    PointAsked,
    QualityAsked,
    Redone,
    RemakeAsked,
    RemakeCancelled,
    RoleSwitched,
    Selected,
    SheetAsked,
    Stepped,
    TakenBack,
    Undone,
)
from ui.review.mark_gestures import MarkPlaced
from ui.review.state import DeskState, Draft, Notice


def tiny_keys(desk: Any):
    return [tuple(row[:2]) for row in desk.glass.parts["anna-1"]["rows"] if row[3] == "auto"]


class Glass:
    """A screen that remembers the newest of every part."""

    def __init__(self):
        self.parts, self.notices, self.change = {}, [], threading.Condition()
        self.shown = []

    def show(self, seat_id: Any, parts: Any):
        with self.change:
            self.parts.setdefault(seat_id, {}).update(parts)
            self.shown.append((seat_id, time.perf_counter(), parts))
            self.change.notify_all()

    def tell(self, seat_id: Any, notice: Any):
        with self.change:
            self.notices.append((seat_id, notice.text))
            self.change.notify_all()

    def until(self, test: Any, seconds: Any = 60):
        with self.change:
            assert self.change.wait_for(lambda: test(self), seconds)

    def current(self, seat_id: Any = "anna-1") -> Any:
        part = self.parts[seat_id]
        row = part["rows"][part["queue"]["current"]]
        return row[0], row[1]

    def row(self, key: Any, seat_id: Any = "anna-1") -> Any:
        return next(row for row in self.parts[seat_id]["rows"] if (row[0], row[1]) == key)

    def status(self, seat_id: Any = "anna-1") -> Any:
        return self.parts[seat_id]["status"]


class Opened:
    def __init__(self, folder: Any, made: Any = None, **changes: Any):
        self.glass, self.made = Glass(), []
        inputs = desk_inputs(
            folder, remake=lambda ids, progress, report: self.made.append(ids), **changes
        )
        stands = made_with(made) if made else None
        inputs = replace(inputs, made=stands)
        self.session = inputs.session
        nothing = lambda *_: None  # noqa: E731
        screen = Screen(self.glass.show, self.glass.tell, nothing, nothing, nothing)
        self.loop = ReviewLoop(inputs, screen)
        self.loop.start()
        self.sit("anna-1")

    def sit(self, seat_id: Any):
        self.loop.submit(SeatTaken(seat_id))
        self.glass.until(lambda glass: seat_id in glass.parts)

    def settled(self, decided: Any):
        self.glass.until(
            lambda glass: glass.status()["decided"] == decided and not glass.status()["adjusting"]
        )

    def accept(self, key: Any, seat_id: str = "anna-1"):
        """`Y`, and once more in case the desk asks; of what is accepted it says nothing."""
        for _ in range(2):
            self.loop.submit(Judged(seat_id, key, "accept"))

    def close(self):
        self.loop.close()
        self.session.close()


@pytest.fixture
def desk(tmp_path: Any):
    opened = Opened(tmp_path)
    yield opened
    opened.close()


def test_a_rejection_is_on_disk_and_moves_sigma_nought__truth(desk: Any, tmp_path: Any):
    blunder = sorted(tiny_block().blunders)[0]
    before = desk.glass.status()["sigma"]
    desk.loop.submit(Judged("anna-1", blunder, "reject"))
    desk.settled(1)
    assert desk.glass.row(blunder)[3] == "rejected"
    assert desk.glass.status()["sigma"] < before
    assert desk.glass.status()["sigma_before"] == before
    with Session.open(tmp_path, "berta") as other:
        assert other.decisions()[0].decision == Reject(*blunder, reason="other")


def test_undo_brings_back_state_number_and_place__truth(desk: Any):
    first = desk.glass.current()
    before = desk.glass.status()["sigma"]
    desk.loop.submit(Judged("anna-1", first, "reject"))
    desk.settled(1)
    assert desk.glass.current() != first
    assert not desk.glass.status()["written"]
    desk.loop.submit(Undone("anna-1"))
    desk.settled(0)
    assert desk.glass.status()["written"], "the results on disk are those of this adjustment again"
    assert desk.glass.row(first)[3] == "auto"
    assert desk.glass.status()["sigma"] == pytest.approx(before, abs=1e-4)
    assert desk.glass.current() == first
    desk.loop.submit(Undone("anna-1"))
    desk.glass.until(lambda glass: ("anna-1", "notice.nothing-to-undo") in glass.notices)


def test_what_is_undone_or_redone_is_a_row_of_the_queue__law(desk: Any):
    first = desk.glass.current()
    desk.loop.submit(Judged("anna-1", first, "reject"))
    desk.settled(1)
    for gesture, decided in ((Undone("anna-1"), 0), (Redone("anna-1"), 1), (Undone("anna-1"), 0)):
        desk.loop.submit(gesture)
        desk.settled(decided)
        assert desk.glass.current() == first
        shown = desk.glass.parts["anna-1"]["queue"]["filter"]["state"]
        assert shown == ("rejected" if decided else "open")


def test_undo_of_a_signature_is_asked_about_first__law(desk: Any):
    def asked(glass: Any) -> str:
        turning = glass.parts["anna-1"]["queue"]["turning"]
        return turning["text"] if turning else ""

    desk.loop.submit(QualityAsked("anna-1", True))
    desk.glass.until(lambda glass: "quality" in glass.parts["anna-1"])
    judged = desk.glass.parts["anna-1"]["quality"]["judged"]
    desk.loop.submit(BlockSigned("anna-1", "reject", "a shifted corner", judged))
    desk.loop.submit(Undone("anna-1"))
    desk.glass.until(lambda glass: asked(glass) == "undo.ask.SignBlock")
    # Whatever else is done answers with no.
    desk.loop.submit(Dropped("anna-1", ("", "")))
    desk.glass.until(lambda glass: not asked(glass))
    desk.loop.submit(Undone("anna-1"))
    desk.glass.until(lambda glass: asked(glass) == "undo.ask.SignBlock")
    # What was pressed before it was asked is no answer.
    desk.loop.submit(Undone("anna-1"))
    desk.loop.submit(AnswerAsked("anna-1", 7))
    desk.glass.until(lambda glass: glass.parts["anna-1"].get("answered") == 7)
    assert [type(one.decision) for one in desk.session.decisions()] == [SignBlock]
    desk.loop.submit(Undone("anna-1", asked=True))
    desk.glass.until(lambda glass: ("anna-1", "notice.undo.SignBlock") in glass.notices)
    desk.glass.until(lambda glass: not asked(glass))
    assert len(desk.session.decisions()) == 2


def test_who_shares_a_name_undoes_nothing_of_the_other__law(desk: Any):
    first = desk.glass.current()
    desk.loop.submit(SeatTaken("anna-2"))
    desk.loop.submit(Judged("anna-1", first, "reject"))
    desk.settled(1)
    desk.loop.submit(Undone("anna-2"))
    desk.glass.until(lambda glass: ("anna-2", "notice.nothing-to-undo") in glass.notices)
    assert desk.glass.row(first)[3] == "rejected"
    # Who has gone leaves what was decided under that name.
    desk.loop.submit(SeatLeft("anna-1"))
    desk.loop.submit(Undone("anna-2"))
    desk.glass.until(lambda glass: ("anna-2", "notice.undo.Reject") in glass.notices)
    assert len(desk.session.decisions()) == 2


def test_the_reason_replaces_the_rejection_it_explains__law(desk: Any):
    first = desk.glass.current()
    desk.loop.submit(Judged("anna-1", first, "reject"))
    desk.loop.submit(Explained("anna-1", 1))
    desk.settled(1)
    desk.glass.until(lambda glass: glass.status()["decided"] == 1)
    assert desk.session.replayed(tiny_block().block).measurements[first].reason == "wrong object"
    desk.loop.submit(Undone("anna-1"))
    desk.settled(0)
    assert desk.glass.row(first)[3] == "auto"


def test_a_reason_is_on_disk_at_once_with_what_it_replaces__law(desk: Any, monkeypatch: Any):
    """A crash between taking back the rejection and recording it anew lost it."""
    keys = tuple(tiny_keys(desk)[:2])
    desk.loop.submit(JudgedTogether("anna-1", keys, "reject"))
    desk.settled(2)
    written, append = list[str](), desk.session._store.append

    def append_once(*what: Any) -> Any:
        if written:
            raise StorageError(desk.session.folder, "is gone.", "Look for it.")
        written.append("")
        return append(*what)

    monkeypatch.setattr(desk.session._store, "append", append_once)
    desk.loop.submit(Explained("anna-1", 1))
    desk.loop.submit(AnswerAsked("anna-1", 7))
    desk.glass.until(lambda glass: glass.parts["anna-1"].get("answered") == 7)
    known = desk.session.replayed(tiny_block().block).measurements
    assert [known[key].reason for key in keys] == ["wrong object"] * 2


def test_a_reason_finds_its_rejection_whatever_another_decides_between__law(desk: Any):
    desk.sit("berta-1")
    desk.loop.submit(Named("berta-1", "berta"))
    first, other = tiny_keys(desk)[:2]
    desk.loop.submit(Judged("anna-1", first, "reject"))
    desk.loop.submit(Judged("berta-1", other, "dubious"))
    desk.loop.submit(Explained("anna-1", 1))
    desk.settled(2)
    assert desk.session.replayed(tiny_block().block).measurements[first].reason == "wrong object"
    desk.loop.submit(Undone("anna-1"))
    desk.settled(1)
    assert desk.glass.row(first)[3] == "auto"


def test_what_was_judged_at_once_is_undone_at_once__law(desk: Any):
    keys = tuple(tiny_keys(desk)[:5])
    desk.loop.submit(Judged("anna-1", tiny_keys(desk)[7], "dubious"))
    desk.loop.submit(JudgedTogether("anna-1", keys, "reject"))
    desk.loop.submit(Explained("anna-1", 4))
    desk.settled(6)
    known = desk.session.replayed(tiny_block().block).measurements
    assert {known[key].reason for key in keys} == {"blurred"}
    desk.loop.submit(Undone("anna-1"))
    desk.settled(1)
    assert all(desk.glass.row(key)[3] == "auto" for key in keys)
    assert ("anna-1", "notice.undo.several") in desk.glass.notices
    desk.loop.submit(Redone("anna-1"))
    desk.settled(6)


def test_a_draft_is_shown_with_its_effect_and_is_not_on_disk__law(desk: Any):
    first = desk.glass.current()
    before = desk.glass.parts["anna-1"]["point"]["figures"]
    column, row = tiny_block().block.measurements[first].pixel[0] + 25.0
    desk.loop.submit(PlacedInScan("anna-1", first, float(column), float(row)))
    desk.glass.until(lambda glass: (glass.parts["anna-1"]["point"]["draft"] or {}).get("raw"))
    point = desk.glass.parts["anna-1"]["point"]
    assert np.allclose(point["draft"]["raw"], [column, row], atol=1e-3)
    assert point["figures"]["ratio"] > before["ratio"]
    assert (point["figures"]["hand"], point["figures"]["score"]) == (True, None)
    assert point["state"] == desk.glass.row(first)[3] == "auto"
    assert desk.glass.parts["anna-1"]["queue"]["drafts"] != []
    desk.glass.until(lambda glass: glass.parts["anna-1"]["point"]["trial"])
    desk.loop.submit(Stepped("anna-1", 1))
    desk.glass.until(lambda glass: glass.current() != first)
    assert desk.glass.status()["drafts"] == 1
    assert desk.session.decisions() == ()
    desk.loop.submit(Selected("anna-1", first))
    desk.accept(first)
    desk.settled(1)
    assert desk.glass.row(first)[3] == "accepted"
    assert desk.glass.row(first)[7] is None


def test_undo_takes_back_the_decision_that_is_newer_than_the_draft__law(desk: Any):
    first, second = list(tiny_block().block.measurements)[:2]
    column, row = tiny_block().block.measurements[first].pixel[0] + 0.1
    desk.loop.submit(PlacedInScan("anna-1", first, float(column), float(row)))
    desk.loop.submit(Judged("anna-1", second, "reject"))
    desk.settled(1)
    desk.loop.submit(Selected("anna-1", first))
    desk.loop.submit(Undone("anna-1"))
    desk.settled(0)
    assert desk.glass.status()["drafts"] == 1


def test_what_enter_refined_is_a_draft_until_it_is_kept__law(desk: Any):
    first = desk.glass.current()
    item = tiny_block().block.measurements[first]
    place = Place(*first, item.column + 0.1, item.row, item.sigma_px)
    desk.loop.submit(Measured("anna-1", place, Notice("notice.refined")))
    desk.glass.until(lambda glass: glass.parts["anna-1"]["point"]["draft"])
    assert desk.glass.row(first)[3] == "auto"
    assert desk.session.decisions() == ()
    # Of a draft that is no longer in sight nothing is told: over another point it would be false.
    desk.loop.submit(Stepped("anna-1", 1))
    desk.glass.until(lambda glass: glass.current() != first)
    again, since = replace(place, column=place.column + 1), Draft(first, place)
    told = Notice("notice.refined.photos", draft=first)
    desk.loop.submit(Measured("anna-1", again, told, since))
    desk.loop.submit(Undone("anna-1"))
    desk.glass.until(lambda glass: ("anna-1", "notice.nothing-to-undo") in glass.notices)
    assert ("anna-1", told.text) not in desk.glass.notices


def test_drafts_are_there_when_the_desk_is_opened_anew__law(tmp_path: Any):
    """A run that opened it on new results lost them."""
    desk = Opened(tmp_path)
    desk.sit("berta-1")
    first, second = tiny_keys(desk)[:2]
    desk.loop.submit(Named("anna-1", "ada"))
    for key in (first, ("", first[1])):
        desk.loop.submit(PlacedInScan("anna-1", key, 500.0, 400.0))
    desk.loop.submit(PlacedInScan("berta-1", second, 300.0, 200.0))
    desk.glass.until(lambda glass: glass.status("berta-1")["drafts"] == 1)
    desk.close()
    again = Opened(tmp_path, left=desk.loop.left)
    try:
        again.sit("berta-1")
        assert [again.glass.status(one)["drafts"] for one in ("anna-1", "berta-1")] == [2, 1]
        rows = [tuple(row[:2]) for row in again.glass.parts["anna-1"]["rows"]]
        drafted = [rows[place] for place in again.glass.parts["anna-1"]["queue"]["drafts"]]
        assert drafted == [first, ("N001", first[1])]
        again.accept(first)
        again.settled(1)
        assert again.session.decisions()[0].decision == Place(*first, 500.0, 400.0)
        assert again.session.decisions()[0].who == "ada"
    finally:
        again.close()


def test_two_seats_see_each_other_but_keep_their_places__law(desk: Any):
    desk.sit("berta-1")
    there = desk.glass.current("berta-1")
    first = desk.glass.current()
    desk.loop.submit(Stepped("berta-1", 1))
    desk.glass.until(lambda glass: glass.current("berta-1") != there)
    here = desk.glass.current("berta-1")
    desk.accept(first)
    desk.settled(1)
    desk.glass.until(lambda glass: glass.row(first, "berta-1")[3] == "accepted")
    assert desk.glass.current("berta-1") == here


def test_reopened_the_desk_is_where_it_was__law(desk: Any, tmp_path: Any):
    keys = []
    for verdict in ("reject", "accept", "dubious", "invisible"):
        keys.append(desk.glass.current())
        for _ in range(2 if verdict == "accept" else 1):
            desk.loop.submit(Judged("anna-1", keys[-1], verdict))
        desk.glass.until(lambda glass: glass.current() != keys[-1])
    desk.settled(4)
    sigma, rows = desk.glass.status()["sigma"], desk.glass.parts["anna-1"]["rows"]
    again = Opened(tmp_path)
    again.settled(4)
    assert again.glass.status()["sigma"] == pytest.approx(sigma, abs=2e-4)
    assert [row[3] for row in again.glass.parts["anna-1"]["rows"]] == [row[3] for row in rows]
    again.close()


def test_a_page_is_told_when_what_it_sent_before_is_done__law(desk: Any):
    before = desk.glass.current()
    desk.loop.submit(Stepped("anna-1", 1))
    desk.loop.submit(AnswerAsked("anna-1", 7))
    desk.glass.until(lambda glass: glass.parts["anna-1"].get("answered") == 7)
    assert desk.glass.current() != before


def test_a_hundred_gestures_keep_their_order__law(desk: Any):
    keys = desk.glass.parts["anna-1"]["order"][:100]
    rows = desk.glass.parts["anna-1"]["rows"]
    aimed = [(rows[i][0], rows[i][1]) for i in keys]
    for key in aimed:
        desk.accept(key)
    desk.settled(len(aimed))
    decided = [d.decision for d in desk.session.decisions()]
    assert [(d.point_id, d.photo_id) for d in decided] == aimed
    assert all(isinstance(d, Accept) for d in decided)


def test_check_points_leave_the_adjustment_and_judge__truth(desk: Any):
    before = desk.glass.status()
    point_id = next(
        name
        for (name, _), m in sorted(tiny_block().block.measurements.items())
        if tiny_block().block.surveyed[name].role == "control" and m.status == "auto"
    )
    desk.loop.submit(RoleSwitched("anna-1", point_id))
    desk.settled(1)
    after = desk.glass.status()
    assert after["counts"] == before["counts"]
    # One that was proposed and turned over is not independent of the reference.
    assert after["checks"]["kept"] == before["checks"]["kept"] + 1


def test_stale_orthos_are_made_again_and_then_fresh__law(tmp_path: Any):
    desk = Opened(tmp_path, made=tiny_block().block)
    stale = tuple(desk.glass.status()["stale"])
    assert set(stale) == set(tiny_block().block.photos)
    desk.loop.submit(RemakeAsked("anna-1"))
    desk.glass.until(lambda glass: ("", "notice.remade") in glass.notices)
    desk.glass.until(lambda glass: glass.status()["stale"] == [])
    assert desk.made == [stale]
    desk.close()


def test_what_a_cancelled_update_made_is_shown_as_made__law(tmp_path: Any):
    """Orthos made until then stood as out of date, and a new mosaic as the one before."""
    desk = Opened(tmp_path, made=tiny_block().block)
    first, *others = desk.glass.status()["stale"]
    photo = desk.loop._now.state.oriented.photos[first]

    def cancelled(ids: Any, progress: Any, report: Any):
        products = desk.session.products
        for name, kept in made_with(tiny_block().block).items():
            products.save_value(f"made-with/{name}", "0" * 64, kept)
        kept = photo, report.block.camera_of(first)
        products.save_value(f"made-with/{first}", "1" * 64, kept)
        raise Cancelled

    desk.loop._remaker._remake = cancelled
    desk.loop.submit(RemakeAsked("anna-1"))
    desk.glass.until(lambda glass: ("", "notice.remake-cancelled") in glass.notices)
    desk.glass.until(lambda glass: glass.status()["stale"] == others)
    desk.close()


def test_a_key_pressed_again_after_the_step_decides_nothing_more__law(desk: Any):
    first = desk.glass.current()
    for _ in range(5):
        desk.loop.submit(Judged("anna-1", first, "reject"))
    desk.settled(1)
    assert len(desk.session.decisions()) == 1


def test_a_seat_that_is_left_is_not_drawn_for_and_comes_back_where_it_was__law(desk: Any):
    place = desk.glass.parts["anna-1"]["order"][4]
    row = desk.glass.parts["anna-1"]["rows"][place]
    desk.loop.submit(Selected("anna-1", (row[0], row[1])))
    desk.glass.until(lambda glass: glass.current() == (row[0], row[1]))
    desk.loop.submit(SeatLeft("anna-1"))
    desk.sit("berta-1")
    count = len(desk.glass.shown)
    desk.accept(desk.glass.current("berta-1"), "berta-1")
    desk.glass.until(lambda glass: glass.status("berta-1")["decided"] == 1)
    assert {seat for seat, _, _ in desk.glass.shown[count:]} == {"berta-1"}
    desk.glass.parts.pop("anna-1")
    desk.sit("anna-1")
    assert desk.glass.current() == (row[0], row[1])


def test_a_desk_state_never_changes__law():
    block = tiny_block().block
    state = DeskState(block, adjust(block), made=made_with(block))
    assert replace(state, decided=3).decided == 3
    assert state.decided == 0


def test_a_new_point_is_a_draft_until_it_is_kept__truth(desk: Any, tmp_path: Any):
    place = tiny_block().block.surveyed["J150"].position[:2] + 7.0
    desk.loop.submit(PointAsked("anna-1", float(place[0]), float(place[1])))
    desk.glass.until(lambda glass: glass.current()[0] == "H1")
    # What keeping it would do is shown before it is kept, and nobody else sees the point.
    desk.glass.until(lambda glass: glass.parts["anna-1"]["point"]["trial"])
    assert desk.glass.parts["anna-1"]["point"]["draft"]
    desk.sit("berta-1")
    assert "H1" not in {row[0] for row in desk.glass.parts["berta-1"]["rows"]}
    assert desk.session.decisions() == ()
    dropped = desk.glass.current()
    desk.loop.submit(Dropped("anna-1", dropped))
    desk.glass.until(lambda glass: glass.current()[0] != "H1")
    assert desk.glass.status()["drafts"] == 0
    assert not [row for row in desk.glass.parts["anna-1"]["rows"] if row[0] == "H1"]
    desk.loop.submit(PointAsked("anna-1", float(place[0]), float(place[1])))
    desk.glass.until(lambda glass: glass.current() == dropped)
    desk.accept(dropped)
    desk.settled(2)
    with Session.open(tmp_path, "berta") as other:
        added = other.decisions()[0].decision
    assert isinstance(added, AddPoint)
    block, true = tiny_block().block, true_photos(1200, tiny_block().land.dem)
    assert added.measured
    for item in added.measured:
        position = np.array([[added.east, added.north, added.height]])
        there = true[item.photo_id].pixel_from_object(position, block.camera_of(item.photo_id))
        assert np.hypot(*(there - item.pixel)[0]) < 3
        # Without anything to compare with, the place is only predicted: not to be used.
        assert item.status == "dubious"
    # A draft of a place in another scan has nothing to be about once the point is taken back.
    other = next(item.key for item in added.measured if item.key != dropped)
    desk.loop.submit(PlacedInScan("anna-1", other, added.measured[0].column, 300.0))
    desk.glass.until(lambda glass: glass.status()["drafts"] == 1)
    desk.loop.submit(Selected("anna-1", next(iter(tiny_block().block.measurements))))
    desk.loop.submit(Undone("anna-1"))
    desk.settled(0)
    assert not [row for row in desk.glass.parts["anna-1"]["rows"] if row[0] == "H1"]
    assert desk.glass.status()["drafts"] == 0


def test_any_decision_of_a_history_is_taken_back_by_itself__law(desk: Any):
    first = desk.glass.current()
    desk.loop.submit(Judged("anna-1", first, "reject"))
    desk.settled(1)
    second = desk.glass.current()
    desk.accept(second)
    desk.settled(2)
    desk.loop.submit(Selected("anna-1", first))
    desk.glass.until(lambda glass: glass.current() == first)
    history = desk.glass.parts["anna-1"]["point"]["history"]
    assert [(item["what"], item["who"], item["stands"]) for item in history] == [
        ("Reject", "anna", True)
    ]
    desk.loop.submit(TakenBack("anna-1", history[0]["id"]))
    desk.settled(1)
    assert desk.glass.row(first)[3] == "auto"
    assert desk.glass.row(second)[3] == "accepted"
    # Undo takes the decision before it: that redo restores it is told at once.
    assert ("anna-1", "notice.withdrawn") in desk.glass.notices
    desk.loop.submit(Redone("anna-1"))
    desk.settled(2)
    assert desk.glass.row(first)[3] == "rejected"
    desk.loop.submit(TakenBack("anna-1", history[0]["id"]))
    desk.settled(1)
    # Asked twice, as by a click on what an undo has just taken back: it is not decided again.
    desk.loop.submit(TakenBack("anna-1", history[0]["id"]))
    desk.glass.until(lambda glass: ("anna-1", "notice.turned") in glass.notices)
    assert desk.glass.row(first)[3] == "auto"
    desk.loop.submit(TakenBack("anna-1", history[0]["id"], again=True))
    desk.settled(2)
    assert desk.glass.row(first)[3] == "rejected"


def test_people_see_each_other_and_are_not_sent_to_the_same_point__law(desk: Any):
    desk.sit("berta-1")
    desk.loop.submit(Named("berta-1", "berta"))
    desk.glass.until(lambda glass: [n for n, _ in glass.status()["people"]] == ["berta"])
    name, place = desk.glass.status("anna-1")["people"][0]
    assert (name, tuple(place)) == ("berta", desk.glass.current("berta-1"))
    both = desk.glass.current("berta-1")
    assert desk.glass.current("anna-1") != both
    desk.loop.submit(Selected("anna-1", both))
    desk.glass.until(lambda glass: glass.current("anna-1") == both)
    desk.accept(both, "berta-1")
    desk.settled(1)
    theirs = desk.glass.current("berta-1")
    desk.loop.submit(Stepped("anna-1", -1))
    desk.loop.submit(Judged("anna-1", both, "dubious"))
    desk.glass.until(lambda glass: glass.row(both)[3] == "dubious")
    assert desk.glass.current("anna-1") != theirs
    assert [item.who for item in desk.session.decisions()] == ["berta", "anna"]


def test_a_tie_point_left_out_is_out_and_comes_back__truth(desk: Any):
    block = tiny_block().block
    photo = block.ties.photo_ids[int(block.ties.photo[0])]
    column, row = (float(value) for value in block.ties.pixels[0])
    verdict = JudgeTie(photo, column, row, use=False)
    without = replay(block, (Recorded(1, "", "anna", verdict),)).block
    assert int(block.ties.point[0]) not in without.ties.point
    assert len(without.ties.point) < len(block.ties.point)
    elsewhere = Recorded(1, "", "anna", JudgeTie(photo, column + 50, row + 50.3, use=False))
    assert replay(block, (elsewhere,)).unmatched == (elsewhere,)
    desk.session.record(verdict)
    desk.accept(desk.glass.current())
    desk.settled(2)
    rows = [line for line in desk.glass.parts["anna-1"]["rows"] if line[2] == "tie"]
    mine = [line for line in rows if line[3] == "rejected"]
    assert {line[1] for line in mine} >= {photo}


def test_marks_are_searched_while_the_desk_decides_and_recorded_as_one__law(tmp_path: Any):
    going = threading.Event()
    decision = FillMarks("wide", "1938_01_014", 5.0, 6.0, {})

    def search(gesture: Any, desk: Any, progress: Any):
        while not going.wait(0.01):
            progress.report(1, 4, gesture.photo_id)
        return decision, Notice("notice.filled")

    desk = Opened(tmp_path, fill=search)
    shown = MarkPlaced("anna-1", "1938_01_014", "", 5.0, 6.0, fill=True)
    key = desk.glass.current()
    try:
        desk.loop.submit(shown)
        desk.glass.until(lambda glass: (glass.status()["filling"] or {}).get("share") == 0.25)
        desk.accept(key)
        desk.settled(1)
        assert desk.glass.status()["filling"]["what"] == "1938_01_014"
        desk.loop.submit(RemakeCancelled("anna-1", filling=True))
        desk.glass.until(lambda glass: glass.status()["filling"] is None)
        assert len(desk.session.decisions()) == 1
        going.set()
        desk.loop.submit(shown)
        desk.settled(2)
        assert desk.glass.status()["filling"] is None
        assert desk.session.decisions()[-1].decision == decision
        desk.loop.submit(Undone("anna-1"))
        desk.settled(1)
    finally:
        desk.close()
    texts = [text for _, text in desk.glass.notices]
    assert texts[-3:] == ["notice.fill-cancelled", "notice.filled", "notice.undo.FillMarks"]


def test_results_that_a_run_beside_the_desk_wrote_are_noticed__law(tmp_path: Any):
    """The desk went on telling of the report it had found when it opened."""
    results = tmp_path / "results"
    results.mkdir()
    (results / "report.html").write_text("old")
    desk = Opened(tmp_path, results=results)
    try:
        first = desk.glass.status()["written_ms"]
        products = desk.session.products
        newer = replace(adjust(tiny_block().block), sigma_nought=1.25)
        products.save_value("adjustment", products.digest_of("beside"), newer)
        (results / "report.html").write_text("new")
        desk.glass.until(lambda glass: ("", "notice.written-beside") in glass.notices)
        desk.glass.until(lambda glass: glass.status()["written_ms"] > first)
        assert not desk.glass.status()["written"]
        assert not desk.loop.beside.outdated.is_set()
        # Another block of the engine: what is open is no longer what the run left.
        products.save_value("control", products.digest_of("other"), ())
        (results / "report.html").write_text("newer")
        assert desk.loop.beside.outdated.wait(10)
    finally:
        desk.close()


def test_sheets_that_were_cut_are_there_to_be_drawn_from_and_another_lot_is_told__law(
    tmp_path: Any,
):
    """Who made map sheets at the desk could draw none of them before it was opened again."""
    desk = Opened(tmp_path)

    def sheets() -> Any:
        return desk.glass.parts["anna-1"]["quality"]["sheets"]

    def cut(lot: Delivery, digest: str) -> None:
        lot = replace(lot, mosaic=version_on_disk(desk.session.products))
        desk.session.products.save_value("sheets", digest * 64, lot)
        desk.loop.submit(WrittenBeside(Notice("notice.sheets-made")))
        desk.glass.until(lambda glass: sheets()["count"] == len(lot.sheets))

    try:
        desk.loop.submit(QualityAsked("anna-1", shown=True))
        desk.glass.until(lambda glass: "quality" in glass.parts["anna-1"])
        assert sheets() == {"count": 0, "sample": None}
        cut(LOT, "0")
        assert ("", "notice.sheets-made") in desk.glass.notices
        sample = new_sample(sheets_of(LOT, LOT.mosaic), 3)
        desk.loop.submit(Measured("anna-1", sample, Notice("notice.sampled", {"count": "15"})))
        desk.glass.until(lambda glass: sheets()["sample"])
        assert sheets()["sample"]["state"] == "open"
        cut(Delivery(LOT.files[1:], 0), "1")
        assert sheets()["sample"]["state"] == "changed"
    finally:
        desk.close()


def test_what_another_program_decided_is_there_when_a_sheet_is_opened__law(desk: Any) -> None:
    """A plan drawn in a terminal was not seen, and a place of the one before was read."""
    place = CheckPlace("01", 1.0, 2.0)
    plan = new_plan((place,), (1, 1), 1, "", beforehand=True, decisions=())
    with Session.open(desk.session.folder, "bob") as other:
        other.record(plan)
    desk.loop.submit(SheetAsked("anna-1", "checks", shown=True))
    desk.glass.until(lambda glass: glass.parts["anna-1"].get("checks", {}).get("plan"))
    assert [one["place"] for one in desk.glass.parts["anna-1"]["checks"]["places"]] == ["1-01"]


def test_the_next_point_comes_before_very_many_rows__law(desk, monkeypatch):
    monkeypatch.setattr("app.desk.loop.MANY_ROWS", 0)
    key, before = desk.glass.current(), len(desk.glass.shown)
    desk.loop.submit(Judged("anna-1", key, "reject"))
    desk.loop.submit(AnswerAsked("anna-1", 8))
    desk.glass.until(lambda glass: glass.parts["anna-1"].get("answered") == 8)
    first, *others = (parts for _, _, parts in desk.glass.shown[before:])
    assert set(first) == {"point"}
    assert tuple(first["point"]["key"]) != key
    assert any("rows" in parts for parts in others)
