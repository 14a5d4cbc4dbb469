"""Gestures on the fiducial board, and what a message of the page says of them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class MarkPlaced:
    """A fiducial drafted by hand, in pixels of the raw scan."""

    seat_id: str
    photo_id: str
    name: str
    column: float
    row: float
    snap: bool = False
    """True to move it onto the mark beside that place."""
    fill: bool = False
    """True to look for all marks like the one at that place, whatever its name."""


@dataclass(frozen=True, slots=True)
class MarkDropped:
    """The draft of a fiducial given up."""

    seat_id: str
    photo_id: str
    name: str


@dataclass(frozen=True, slots=True)
class MarkJudged:
    """A fiducial is in use as it is, or as it is drafted; or it cannot be seen."""

    seat_id: str
    photo_id: str
    name: str
    use: bool


MarkGesture = MarkPlaced | MarkDropped | MarkJudged


def placed_from_message(seat_id: str, message: Mapping[str, Any]) -> MarkPlaced:
    """What a message says of where a mark lies.

    Raises:
        ValueError: It says no place.
    """
    column, row = (float(value) for value in message["place"])
    if not (abs(column) < 1e6 and abs(row) < 1e6):
        raise ValueError("not a place")
    names = str(message["photo"]), str(message["name"])
    snap, fill = bool(message.get("snap", False)), bool(message.get("fill", False))
    return MarkPlaced(seat_id, *names, column, row, snap, fill)


MARKING: Mapping[str, Callable[[str, Mapping[str, Any]], MarkGesture]] = {
    "mark": placed_from_message,
    "mark-drop": lambda seat, message: MarkDropped(
        seat, str(message["photo"]), str(message["name"])
    ),
    "mark-use": lambda seat, message: MarkJudged(
        seat, str(message["photo"]), str(message["name"]), bool(message["use"])
    ),
}
"""What a message of each kind comes to."""
