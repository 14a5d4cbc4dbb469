"""Messages of the fiducial board."""

import pytest

from ui.review.gestures import gesture_from_message
from ui.review.mark_gestures import MarkDropped, MarkJudged, MarkPlaced


@pytest.mark.parametrize(
    ("message", "gesture"),
    [
        (
            {"kind": "mark", "place": [3, 4], "snap": True},
            MarkPlaced("s", "a", "1", 3.0, 4.0, True),
        ),
        ({"kind": "mark-drop"}, MarkDropped("s", "a", "1")),
        ({"kind": "mark-use", "use": 0}, MarkJudged("s", "a", "1", False)),
        ({"kind": "mark", "place": [3, 1e7]}, None),
        ({"kind": "mark", "place": [3]}, None),
        ({"kind": "mark-use"}, None),
    ],
)
def test_a_message_is_its_gesture_and_a_broken_one_is_none__truth(message, gesture):
    assert gesture_from_message("s", {"photo": "a", "name": "1", **message}) == gesture
