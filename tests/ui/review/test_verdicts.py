"""What a verdict comes to on one measurement."""

import pytest

from core.block import Measurement
from sessions.decisions import NOT_VISIBLE, Accept, MarkDubious, MarkNotVisible, Reject
from ui.review.gestures import (
    Aimed,
    AnswerAsked,
    Dropped,
    Redone,
    Selected,
    SheetAsked,
    Stepped,
    Undone,
)
from ui.review.state import Notice, Seat
from ui.review.verdicts import decision_of, not_measured, standing_verdict, still_asked

KEY = "P1", "one"


def measured(**changes) -> Measurement:
    return Measurement(*KEY, 10.0, 20.0, 0.5, **changes)


def test_every_verdict_is_a_decision__law():
    assert decision_of("accept", KEY) == Accept(*KEY)
    assert decision_of("reject", KEY) == Reject(*KEY, reason="other")
    assert decision_of("dubious", KEY) == MarkDubious(*KEY)
    assert decision_of("invisible", KEY) == MarkNotVisible(*KEY)


def test_what_nobody_saw_has_no_verdict_yet__law():
    assert standing_verdict(measured(status="accepted")) == "accept"
    assert standing_verdict(measured(status="accepted", seen=False)) is None
    assert standing_verdict(measured(status="rejected", reason=NOT_VISIBLE)) == "invisible"


@pytest.mark.parametrize(
    ("state", "score", "verdict", "says"),
    [
        ("predicted", 0.0, "accept", True), ("predicted", 0.0, "invisible", False),
        ("proposed", 0.9, "accept", False), ("proposed", 0.9, "reject", False),
        ("proposed", 0.9, "dubious", True), ("rejected", 0.0, "accept", True),
        ("rejected", 0.9, "accept", False), ("auto", 0.9, "reject", False),
    ],
)  # fmt: skip
def test_a_place_comes_before_a_verdict__law(state, score, verdict, says):
    found = not_measured(state, measured(score=score, status="rejected"), verdict)
    assert (found is not None) == says


def test_whatever_is_done_beside_undo_answers_its_question_with_no__law():
    asked = Seat("s", "ada", turning=(1, Notice("undo.ask.PlanChecks")))
    up, down = (0.0, 0.0, 9.0), (0.0, 0.0, -1.0)
    for gesture in (Undone("s"), AnswerAsked("s", 1), Aimed("s", "hover", up, down)):
        assert still_asked(asked, gesture) == asked
    for gesture in (
        Stepped("s", 1), Selected("s", KEY), SheetAsked("s", "checks", False), Redone("s"),
        Dropped("s", ("", "")), Aimed("s", "pick", up, down),
    ):  # fmt: skip
        assert still_asked(asked, gesture).turning is None
