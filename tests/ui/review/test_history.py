"""The history: what was decided about a point, and what every adjustment came to."""

from dataclasses import replace

import numpy as np
import pytest
from shapely.geometry import box

from core.formats.listed_point import ListedPoint
from core.quality.check_plan import CheckPlace
from core.sheets.map_sheets import MapSheet
from sessions.decisions import (
    DECISIONS,
    REASONS,
    Accept,
    AddPoint,
    BringPoints,
    JudgeFiducial,
    JudgePhoto,
    Place,
    PlaceFiducial,
    PlanChecks,
    ReadCheck,
    Recorded,
    Reject,
    Remark,
    SetRole,
    SignBlock,
    Withdraw,
)
from sessions.session import Session
from sessions.sheet_samples import new_sample
from tests.ui.desk_block import tiny_snapshot
from ui.review.history import (
    KEPT,
    asked_back,
    history_of,
    key_of,
    own_rejections,
    record_line,
    shifts_m,
    subject_of,
    taken_back,
    touched_by,
    turn_back,
    turn_notice,
    with_adjustment,
)
from ui.review.state import NO_EXTRA, Draft, Notice, Seat
from ui.words.catalogue import LANGUAGES, Teller, words

KEY = ("J101", "a")
LISTED = ListedPoint("J101", 0.0, 0.0, 0.0, (0.1, 0.1, 0.1))


def said(*decisions, who="anna") -> tuple[Recorded, ...]:
    return tuple(
        Recorded(number, "2026-01-01T00:00:00", who, decision)
        for number, decision in enumerate(decisions, start=1)
    )


def test_only_what_concerns_the_point_is_told_newest_first__law():
    recorded = said(
        Accept(*KEY), Accept("J101", "b"), SetRole("J101", "check"), Reject("J102", "a", "hidden"),
        Reject(*KEY, "changed"),
    )  # fmt: skip
    told = history_of(KEY, recorded, NO_EXTRA, "anna")
    assert [line["what"] for line in told] == ["Reject", "SetRole", "Accept"]
    assert all(line["stands"] for line in told)


def test_words_about_point_photo_and_decisions_are_told_with_them__law():
    words = (
        Remark("point", "J101", "a"), Remark("photo", "a", "b"), Remark("photo", "b", "c"),
        Remark("decision", "1", "d"), Remark("decision", "6", "e"),
    )  # fmt: skip
    told = history_of(
        KEY, said(Reject(*KEY, "changed"), *words, Accept("J9", "b")), NO_EXTRA, "anna"
    )
    assert [line["detail"] for line in told[:-1]] == [
        ("detail.words", {"words": one}) for one in "dba"
    ]


def test_a_withdrawn_decision_says_by_whom__law():
    first, *_ = said(Accept(*KEY))
    back = Recorded(2, "2026-01-01T00:01:00", "berta", Withdraw(1))
    line = history_of(KEY, (first, back), NO_EXTRA, "anna")[0]
    assert (line["stands"], line["by"]) == (False, "berta")
    again = Recorded(3, "2026-01-01T00:02:00", "anna", Withdraw(2))
    assert history_of(KEY, (first, back, again), NO_EXTRA, "anna")[0]["stands"]
    assert touched_by(again, (first, back, again)) is first


def test_a_fault_is_taken_back_by_whom_marked_it_alone__law():
    (fault,) = said(Remark("photo", "a", "two roads", fault="double"))
    (line,), (other,) = (history_of(KEY, (fault,), NO_EXTRA, who) for who in ("anna", "berta"))
    assert line["turns"]
    assert not other["turns"]
    assert taken_back(fault.decision_id, (fault,), "berta", again=False)[1] is not None


@pytest.mark.parametrize(
    ("decision", "detail"),
    [
        *((Reject(*KEY, reason), reason) for reason in REASONS),
        (Place(*KEY, 3.25, 4.0), "3.2, 4.0 px"),
        (SetRole("J101", "check"), "Check"),
        (Accept(*KEY), ""),
        (AddPoint("J101", 0.0, 0.0, 0.0, (1.0, 1.0, 1.0), ()), "0 scans"),
        (BringPoints((LISTED,), "body.txt"), "from body.txt"),
        (BringPoints((LISTED,), ""), "typed in"),
    ],
)
def test_details_read_as_they_were_decided__truth(decision, detail):
    text, values = history_of(KEY, said(decision), NO_EXTRA, "anna")[0]["detail"]
    assert (Teller()(text, **values) if text else "") == detail


def test_a_rejection_and_its_reason_are_one_line__law():
    """Of rows rejected together each had two: the plain rejection, taken back, and the reason."""
    plain, reason = Reject(*KEY, "other"), Reject(*KEY, "changed")
    others = Reject("J102", "a", "other"), Reject("J102", "a", "changed")
    together = said(plain, others[0], Withdraw(1), Withdraw(2), reason, others[1])
    for key in (KEY, ("J102", "a")):
        lines = history_of(key, together, NO_EXTRA, "anna")
        assert [line["detail"][0] for line in lines] == ["reason.2"]
    # What was withdrawn and not given a reason at once stays in sight.
    assert len(history_of(KEY, said(plain, Withdraw(1), Accept(*KEY)), NO_EXTRA, "anna")) == 2
    *before, later = said(plain, Withdraw(1), reason)
    apart = (*before, replace(later, when="2026-01-01T00:01:00"))
    assert len(history_of(KEY, apart, NO_EXTRA, "anna")) == 2


def test_the_measurement_a_decision_is_about__truth():
    assert key_of(Accept(*KEY), NO_EXTRA) == KEY
    assert key_of(SetRole("J101", "check"), NO_EXTRA) is None
    assert key_of(JudgePhoto("a", use=False), NO_EXTRA) is None
    assert subject_of(SetRole("J101", "check")) == "J101"
    assert key_of(BringPoints((LISTED,), ""), NO_EXTRA) is None
    assert subject_of(BringPoints((LISTED,), "")) == "J101"
    assert subject_of(BringPoints((LISTED,) * 3, "")) == "J101 + 2"


def test_a_reason_replaces_the_own_rejection_that_stands__law():
    plain, other = Reject(*KEY, "other"), Reject("J102", "a", "hidden")
    assert own_rejections((KEY,), "anna", said(Accept(*KEY), plain, other)) == {KEY: 2}
    assert own_rejections((KEY,), "berta", said(plain)) == {}
    for recorded in (said(other), said(plain, Withdraw(1)), said(plain, Accept(*KEY))):
        assert own_rejections((KEY,), "anna", recorded) == {}


def test_the_first_adjustment_is_kept_for_good__law():
    state = tiny_snapshot().state
    kept = ()
    for _ in range(KEPT + 5):
        kept = with_adjustment(kept, state.report, state)
    assert len(kept) == KEPT
    assert [kept[0].number, kept[1].number, kept[-1].number] == [1, 7, KEPT + 5]
    line = record_line(kept[-1])
    assert line["sigma"] == pytest.approx(state.report.sigma_nought, abs=1e-4)
    control = [k for k in state.block.measurements if state.block.surveyed[k[0]].role == "control"]
    assert 0 < line["used"] <= len(control)


def test_shifts_between_two_adjustments_are_metres_on_the_ground__truth():
    state = tiny_snapshot().state
    (one,) = with_adjustment((), state.report, state)
    name, photo = next(iter(state.report.block.photos.items()))
    exterior = replace(photo.exterior, centre=photo.exterior.centre + np.array([3.0, 0.0, 0.0]))
    moved = state.report.block.with_photos(
        {**state.report.block.photos, name: photo.with_exterior(exterior, True)}
    )
    (other,) = with_adjustment((), replace(state.report, block=moved), state)
    shifts = shifts_m(one, other)
    # Ground of level height moves with the centre.
    assert shifts.pop(name) == pytest.approx(3.0, rel=0.1)
    assert max(shifts.values()) < 1e-6


def test_a_plan_is_named_by_its_number_and_its_places_without_spares__law(tmp_path):
    names = ("2-01", ""), ("2-01a", "2-01"), ("2-02", "")
    places = tuple(CheckPlace(name, 1.0, 2.0, after=after) for name, after in names)
    plan = PlanChecks(places, (2, 1), 1, "", True, "b47ec5c8e26954fa")
    with Session.open(tmp_path, "ada") as session:
        session.record(plan)
        _, seat = turn_back(session, "undo", Seat("s", "ada"), {}, ())
    told = turn_notice("undo", plan, None, 1)
    assert seat.turning is not None
    assert (
        Teller()(seat.turning[1].text, **{**seat.turning[1].values, "count": 2})
        == "Withdraw check plan 2 of 2 places? Press U again to withdraw it."
    )
    assert dict(told.values) == dict(seat.turning[1].values) == {"what": "2", "count": "2"}


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("act", ["undo", "redo"])
def test_every_kind_of_decision_has_a_text_of_its_undo_and_redo__law(language, act):
    kinds = {one.__name__ for one in DECISIONS} - {"Withdraw"}
    assert {f"notice.{act}.{name}" for name in kinds} <= set(words(language))


@pytest.mark.parametrize(
    ("decision", "told"),
    [
        (Remark("point", "J101", "wet"), "Undone: remark \u201cwet\u201d"),
        (Remark("place", "", "", (1.0, 2.0), "cloud"), "Undone: fault marked"),
        (Remark("decision", "7", "", closes=True), "Undone: answer to a fault"),
    ],
)
def test_a_remark_without_words_is_told_by_what_it_did__truth(decision, told):
    notice = turn_notice("undo", decision, None, 1)
    assert Teller()(notice.text, **notice.values) == told


@pytest.mark.parametrize(
    ("sheet", "own"),
    [("checks", (1,)), ("mosaic", (3, 4)), ("", (1, 2, 3, 4, 5, 6))],
)
def test_a_sheet_takes_back_only_what_was_said_there__law(tmp_path, sheet, own):
    """U on the checks withdrew words about a point, and left the reading."""
    said = (
        ReadCheck("1-01", (1.0, 2.0), (1.0, 2.0), "v"), Remark("photo", "a", "plain"),
        Remark("place", "", "a cloud", (1.0, 2.0), "cloud"), Remark("decision", "3", "yes"),
        Remark("decision", "1", "sure?"), Remark("point", "J101", "wet"),
    )  # fmt: skip
    seat = Seat("s", "ada", sheet=sheet)
    with Session.open(tmp_path, "ada") as session:
        for one in said:
            session.record(one)
        undone = [turn_back(session, "undo", seat, {}, ())[0] for _ in range(len(said))]
        back = [one.decision for (one,) in filter(None, undone)]
        assert back == [Withdraw(number) for number in reversed(own)]
        redone = [turn_back(session, "redo", seat, {}, ())[0] for _ in range(len(said))]
        assert len([one for one in redone if one]) == len(own)


def test_a_word_at_the_desk_keeps_nothing_from_being_done_again_in_a_sheet__law(tmp_path):
    seat = Seat("s", "ada", sheet="mosaic")
    with Session.open(tmp_path, "ada") as session:
        session.record(Remark("place", "", "a cloud", (1.0, 2.0), "cloud"))
        turn_back(session, "undo", seat, {}, ())
        session.record(Remark("point", "J101", "wet"))
        session.undo()
        (again,), _ = turn_back(session, "redo", seat, {}, ())
    assert again.decision == Withdraw(2)


@pytest.mark.parametrize("sheet", ["", "board"])
def test_undo_takes_back_what_was_done_last__law(tmp_path, sheet):
    """A draft older than a decision went first, and one newer than what stands stayed."""
    there = ("a", "1")
    seat, mark = Seat("s", "ada", sheet=sheet, current=there), there if sheet else None

    def drafted(at: Seat) -> Seat:
        place = Place(*there, 1.0, 2.0)
        return (
            at.with_mark(PlaceFiducial(*there, 1.0, 2.0))
            if sheet
            else at.with_draft(Draft(there, place))
        )

    with Session.open(tmp_path, "ada") as session:
        session.record(JudgeFiducial("b", "1", False))
        seat = drafted(seat)
        session.record(JudgeFiducial("c", "1", False))
        (undone,), after = turn_back(session, "undo", seat.once_decided(2), {}, (), mark=mark)
        assert undone.decision == Withdraw(2)
        assert (after.drafts, after.marks) == (seat.drafts, seat.marks)
        none, after = turn_back(session, "undo", after, {}, (), mark=mark)
        assert (none, after.drafts, after.marks) == ((), (), ())
        # Moved since the decision, it is what was done last.
        _, moved = turn_back(session, "undo", drafted(seat.once_decided(1)), {}, (), mark=mark)
        assert (moved.drafts, moved.marks) == ((), ())
        (undone,), _ = turn_back(session, "undo", after, {}, (), mark=mark)
        assert undone.decision == Withdraw(1)


def test_a_new_name_keeps_the_own_decisions_within_reach_of_undo__law(tmp_path):
    seat, present = Seat("s", "ada lovelace"), {"s", "t"}
    with Session.open(tmp_path, "ada") as session:
        session.record(Remark("photo", "a", "by ada"))
        session.record(Remark("photo", "b", "by eve"), operator="eve")
        made = {1: "s", 2: "t"}
        (undone,), _ = turn_back(session, "undo", seat, made, present)
        assert (undone.decision, undone.who) == (Withdraw(1), "ada lovelace")
        made |= {3: "s"}
        assert turn_back(session, "undo", seat, made, present)[0] == ()
        (redone,), _ = turn_back(session, "redo", seat, made, present)
    assert redone.decision == Withdraw(3)


def test_signatures_and_faults_are_withdrawn_by_those_whose_they_are__law():
    """One click of anybody took them away, and the report did not say by whom."""
    said = [
        SignBlock("reject", "", {}),
        Remark("place", "", "dark", (1.0, 2.0), "tone"),
        Remark("place", "", "a church", (1.0, 2.0)),
        Accept("A", "one"),
    ]
    recorded = [Recorded(n, "2026-11-27T10:00:00", "bob", one) for n, one in enumerate(said, 1)]
    for number in range(1, 5):
        turned, notice = taken_back(number, recorded, "eve", again=False)
        told = None if notice is None else (notice.text, notice.values)
        if number <= 2:
            assert (turned, told) == ((), ("notice.not-yours", {"who": "bob"}))
        else:
            assert (turned, told) == ((Withdraw(number),), None)
        assert taken_back(number, recorded, "bob", again=False)[0] == (Withdraw(number),)


def test_a_signature_is_asked_about_before_its_button_withdraws_it__law(tmp_path):
    """As undo asks; the answer is about what was asked, whatever was decided since."""
    with Session.open(tmp_path, "ada") as session:
        session.record(SignBlock("reject", "", {}))
        session.record(Accept("A", "one"))
        decided, seat, notice = asked_back(1, session.decisions(), Seat("s", "ada"), again=False)
        assert (decided, notice) == ((), None)
        assert seat.turning is not None
        assert (seat.turning[0], seat.turning[1].text) == (1, "undo.ask.SignBlock")
        (withdrawn,), after = turn_back(session, "undo", seat, {}, ())
        assert (withdrawn.decision, after.turning) == (Withdraw(1), None)
        # Anything else goes at once, and nobody else's signature is asked about.
        decided, seat, _ = asked_back(2, session.decisions(), after, again=False)
        assert (decided, seat) == ((Withdraw(2),), after)
        lot = tuple(MapSheet(f"S{n}", box(n, 0, n + 1, 1)) for n in range(9))
        drawn = session.record(new_sample(lot, 3))
        _, seat, _ = asked_back(drawn.decision_id, session.decisions(), after, again=False)
        assert seat.turning is not None
        assert seat.turning[1] == Notice("undo.ask.DrawSheets", {"count": "6"})
        # One that stands again is told.
        first, second = (session.record(SignBlock("reject", words, {})) for words in "ab")
        _, seat, _ = asked_back(second.decision_id, session.decisions(), after, again=False)
        assert seat.turning is not None
        told = {"when": first.when[:16].replace("T", " ")}
        assert seat.turning[1] == Notice("undo.ask.SignBlock.earlier", told)
        session.record(SignBlock("accept", "", {}), operator="bob")
        decided, seat, notice = asked_back(7, session.decisions(), after, again=False)
        assert (decided, seat) == ((), after)
        assert notice is not None
        assert notice.text == "notice.not-yours"
