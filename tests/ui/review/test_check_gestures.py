"""What a reviewer's page may send."""

import json
import re
from pathlib import Path

import pytest

from sessions.decisions import FAULT_KINDS, Remark
from ui.review.check_gestures import BlockSigned, CheckRead, Remarked, SheetJudged
from ui.review.gestures import gesture_from_message

READ = {"kind": "check-read", "place": "1-01", "mosaic": [10.5, 20], "reference": [10, 20.25],
        "version": 7}  # fmt: skip


def test_two_places_or_a_reason_are_a_reading__law() -> None:
    read = gesture_from_message("s", READ)
    assert read == CheckRead("s", "1-01", (10.5, 20.0), (10.0, 20.25), "", 7)
    not_seen = gesture_from_message(
        "s", {"kind": "check-read", "place": "1-01", "reason": "hidden", "version": 7}
    )
    assert not_seen == CheckRead("s", "1-01", None, None, "hidden", 7)


@pytest.mark.parametrize(
    "wrong",
    [
        {"mosaic": None},
        {"mosaic": [1]},
        {"reference": [float("nan"), 0]},
        {"mosaic": [1e12, 0]},
        {"reason": "because"},
        {"version": None},
    ],
)
def test_half_a_reading_is_none__truth(wrong: dict[str, object]) -> None:
    assert gesture_from_message("s", {**READ, **wrong}) is None


def test_a_signature_has_one_of_three_verdicts__law() -> None:
    message = {"kind": "sign", "verdict": "reject", "remark": " a \n b ", "judged": {"block": "1f"}}
    signed = gesture_from_message("s", message)
    assert signed == BlockSigned("s", "reject", "a b", {"block": "1f"})
    for wrong in ({"verdict": "perhaps"}, {"remark": "x" * 9999}, {"judged": 7}, {"judged": None}):
        assert gesture_from_message("s", {**message, **wrong}) is None


def test_a_fault_is_a_place_with_a_kind_and_words_are_about_something__law() -> None:
    marked = gesture_from_message(
        "s",
        {"kind": "remark", "subject": "place", "place": [1, 2], "fault": "tone", "words": " a  b"},
    )
    assert marked == Remarked("s", Remark("place", "", "a b", (1.0, 2.0), "tone"))
    closed = {"kind": "remark", "subject": "decision", "name": "3", "closes": True}
    assert gesture_from_message("s", closed) == Remarked(
        "s", Remark("decision", "3", "", closes=True)
    )
    of_photo = {"subject": "photo", "name": "A", "place": [1, 2], "fault": "smear", "words": ""}
    assert gesture_from_message("s", {"kind": "remark", **of_photo}) == Remarked(
        "s", Remark("photo", "A", "", (1.0, 2.0), "smear")
    )
    for wrong in (
        {"subject": "place", "place": [1, 2], "fault": "ugly"},
        {"subject": "place", "fault": "tone"},
        {"subject": "photo", "name": "A", "fault": "tone"},
        {"subject": "photo", "name": "A", "words": " "},
        {"subject": "photo", "name": "A", "words": "x" * 9999},
        {"subject": "moon", "name": "A", "words": "far"},
        {"subject": "decision", "name": "3", "closes": "perhaps"},
    ):
        assert gesture_from_message("s", {"kind": "remark", **wrong}) is None


def test_the_page_offers_every_kind_of_fault__law() -> None:
    page = Path("ui/web/pages/faults.js").read_text(encoding="utf-8")
    offered = re.search(r"KINDS = (\[.*\]);", page)
    assert offered is not None
    assert tuple(json.loads(offered[1])) == FAULT_KINDS


def test_a_word_about_a_sheet_is_good_or_bad__law() -> None:
    says = {
        "kind": "sheet-judged",
        "sheet": "S1",
        "good": False,
        "words": " a  smear",
        "version": 7,
    }
    assert gesture_from_message("s", says) == SheetJudged("s", "S1", False, "a smear", 7)
    for wrong in ({"good": None}, {"good": "yes"}, {"version": "?"}, {"words": "x" * 9999}):
        assert gesture_from_message("s", {**says, **wrong}) is None
