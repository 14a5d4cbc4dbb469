"""What a reviewer does: a place read in mosaic and reference, a block signed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, cast, get_args

from sessions.decisions import ACCEPTANCES, Acceptance

Place = tuple[float, float]
Unreadable = Literal["changed", "hidden", "blurred", "other"]
UNREADABLE: tuple[Unreadable, ...] = get_args(Unreadable)
"""Why no detail can be identified at a place."""
LONGEST_REMARK = 2000
"""Signs of a remark."""


@dataclass(frozen=True, slots=True)
class CheckRead:
    """The same detail marked in mosaic and reference, or a word why it cannot be."""

    seat_id: str
    place_id: str
    mosaic: Place | None
    reference: Place | None
    reason: str


@dataclass(frozen=True, slots=True)
class BlockSigned:
    """A verdict on the whole block, in the name of who sits there."""

    seat_id: str
    verdict: Acceptance
    remark: str


def signature_from_message(seat_id: str, message: Mapping[str, Any]) -> BlockSigned:
    """The gesture of a message.

    Raises:
        ValueError: No verdict, or a remark that is a book.
    """
    verdict, remark = message["verdict"], " ".join(str(message.get("remark", "")).split())
    if verdict not in ACCEPTANCES or len(remark) > LONGEST_REMARK:
        raise ValueError(verdict)
    return BlockSigned(seat_id, verdict, remark)


def reading_from_message(seat_id: str, message: Mapping[str, Any]) -> CheckRead:
    """The gesture of a message.

    Raises:
        ValueError: Neither two places nor a reason.
    """
    reason = str(message.get("reason", ""))
    if reason:
        if reason not in UNREADABLE:
            raise ValueError(reason)
        return CheckRead(seat_id, str(message["place"]), None, None, reason)
    mosaic, reference = _place(message["mosaic"]), _place(message["reference"])
    return CheckRead(seat_id, str(message["place"]), mosaic, reference, "")


def _place(value: object) -> Place:
    east, north = (float(one) for one in cast("list[float]", value))
    if not (abs(east) < 1e9 and abs(north) < 1e9):
        raise ValueError("not a place")
    return east, north
