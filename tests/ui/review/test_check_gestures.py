"""What a reviewer's page may send."""

import pytest

from ui.review.check_gestures import BlockSigned, CheckRead
from ui.review.gestures import gesture_from_message

READ = {"kind": "check-read", "place": "1-01", "mosaic": [10.5, 20], "reference": [10, 20.25]}


def test_two_places_or_a_reason_are_a_reading__law() -> None:
    read = gesture_from_message("s", READ)
    assert read == CheckRead("s", "1-01", (10.5, 20.0), (10.0, 20.25), "")
    not_seen = gesture_from_message(
        "s", {"kind": "check-read", "place": "1-01", "reason": "hidden"}
    )
    assert not_seen == CheckRead("s", "1-01", None, None, "hidden")


@pytest.mark.parametrize(
    "wrong",
    [
        {"mosaic": None},
        {"mosaic": [1]},
        {"reference": [float("nan"), 0]},
        {"mosaic": [1e12, 0]},
        {"reason": "because"},
    ],
)
def test_half_a_reading_is_none__truth(wrong: dict[str, object]) -> None:
    assert gesture_from_message("s", {**READ, **wrong}) is None


def test_a_signature_has_one_of_three_verdicts__law() -> None:
    signed = gesture_from_message("s", {"kind": "sign", "verdict": "reject", "remark": " a \n b "})
    assert signed == BlockSigned("s", "reject", "a b")
    assert gesture_from_message("s", {"kind": "sign", "verdict": "perhaps"}) is None
    assert (
        gesture_from_message("s", {"kind": "sign", "verdict": "accept", "remark": "x" * 9999})
        is None
    )
