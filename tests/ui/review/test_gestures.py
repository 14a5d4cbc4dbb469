"""Messages of a page become gestures, or nothing."""

from typing import get_args

import pytest

from ui.review.gestures import (
    LONGEST_NAME,
    LOOKING,
    Aimed,
    AnswerAsked,
    Gesture,
    Judged,
    LayerSwitched,
    Named,
    PhotoEntered,
    PlacedInScan,
    PlacedOnGround,
    QualityAsked,
    ReliefRaised,
    Stepped,
    ThemeChosen,
    VectorsScaled,
    gesture_from_message,
)


@pytest.mark.parametrize(
    "message",
    [
        {},
        {"kind": "nonsense"},
        {"kind": "judge", "key": ["a", "b"], "verdict": "burn"},
        {"kind": "judge", "key": 7, "verdict": "accept"},
        {"kind": "place", "key": ["a", "b"], "place": ["nan", 1e300]},
        {"kind": "sort", "column": "colour", "descending": True},
        {"kind": "layer", "layer": "/secret", "shown": True},
        {"kind": "vectors", "scale": None},
        {"kind": "relief", "relief": 3},
        {"kind": "hover", "number": 1, "ray": [0, 0, 0, 0, 0, 0]},
        {"kind": "hover", "number": 1, "ray": [0, 0, 0, 1, 0]},
        {"kind": "follow", "number": 1, "ray": ["nan", 0, 0, 0, 0, 1]},
        {"kind": "outline", "rays": [[0, 0, 9, 0, 0, -1]] * 2},
        {"kind": "outline", "rays": [[0, 0, 9, 0, 0, -1]] * 101},
        {"kind": "filter", "state": "all", "photo": "", "role": "", "area": [[0, 0], [1, 1]]},
    ],
)
def test_messages_that_are_not_well_formed_are_no_gestures__law(message):
    assert gesture_from_message("seat-1", message) is None


@pytest.mark.parametrize(
    ("message", "gesture"),
    [
        (
            {"kind": "judge", "key": ["J1", "a"], "verdict": "reject"},
            Judged("s", ("J1", "a"), "reject"),
        ),
        (
            {"kind": "place", "key": ["J1", "a"], "place": [1, 2], "frame": "scan"},
            PlacedInScan("s", ("J1", "a"), 1.0, 2.0),
        ),
        (
            {"kind": "place", "key": ["J1", "a"], "place": [1, 2]},
            PlacedOnGround("s", ("J1", "a"), 1.0, 2.0),
        ),
        ({"kind": "step", "step": -7}, Stepped("s", -1)),
        ({"kind": "answer", "number": 7}, AnswerAsked("s", 7)),
        ({"kind": "layer", "layer": "ties", "shown": 1}, LayerSwitched("s", "ties", True)),
        (
            {"kind": "layer", "layer": "ties", "shown": 1, "rays": 4},
            LayerSwitched("s", "ties", True, 4),
        ),
        ({"kind": "vectors", "scale": 1e9}, VectorsScaled("s", 1000.0)),
        ({"kind": "relief", "relief": 5}, ReliefRaised("s", 5.0)),
        ({"kind": "theme", "light": True}, ThemeChosen("s", True)),
        ({"kind": "enter", "photo": "a"}, PhotoEntered("s", "a")),
        (
            {"kind": "follow", "number": 7, "ray": [1, 2, 3, 0, 0, -1]},
            Aimed("s", "follow", (1.0, 2.0, 3.0), (0.0, 0.0, -1.0), 7),
        ),
        (
            {"kind": "click", "number": 8, "ray": [1, 2, 3, 0, 0, -1]},
            Aimed("s", "pick", (1.0, 2.0, 3.0), (0.0, 0.0, -1.0), 8),
        ),
        ({"kind": "quality", "shown": True, "pair": [1, 3]}, QualityAsked("s", True, (1, 3))),
    ],
)
def test_a_message_is_its_gesture__truth(message, gesture):
    assert gesture_from_message("s", message) == gesture


def test_names_are_one_short_printable_line__law():
    told = gesture_from_message("s", {"kind": "name", "name": " Anna\x00\n  " + "x" * 99})
    assert isinstance(told, Named)
    assert told.name.startswith("Annax") or told.name.startswith("Anna x")
    assert len(told.name) == LONGEST_NAME
    assert gesture_from_message("s", {"kind": "name", "name": "\n "}) is None


def test_guests_may_only_do_what_changes_nothing__law():
    deciding = {kind.__name__ for kind in get_args(Gesture)} - {kind.__name__ for kind in LOOKING}
    assert {"Judged", "Explained", "PlacedInScan", "Undone", "RemakeAsked", "Freed"} <= deciding
    assert not {"Selected", "Filtered", "Sorted"} & deciding
