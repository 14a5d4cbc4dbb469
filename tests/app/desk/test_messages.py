"""What comes to the loop: every message is frozen, and there is one kind for each."""

from dataclasses import FrozenInstanceError, is_dataclass
from typing import get_args

import pytest

from app.desk.messages import Delivery, Event, MeasuringBegun, SeatTaken
from ui.review.gestures import Gesture
from ui.review.state import Notice


def test_the_loop_takes_gestures_and_what_the_background_delivers__law():
    taken = set(get_args(Event))
    assert set(get_args(Gesture)) < taken
    assert set(get_args(Delivery)) < taken
    assert all(is_dataclass(kind) for kind in taken)
    assert len({kind.__name__ for kind in taken}) == len(taken)


def test_a_message_cannot_be_changed_on_its_way__law():
    for message in (SeatTaken("a"), MeasuringBegun("a", Notice("notice.guest"))):
        with pytest.raises(FrozenInstanceError):
            message.seat_id = "b"
