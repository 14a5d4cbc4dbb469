"""What a reviewer does: a place read, a block signed, a fault marked, a word said."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, cast, get_args

from sessions.decisions import (
    ACCEPTANCES,
    FAULT_KINDS,
    SUBJECTS,
    Acceptance,
    Remark,
)

Place = tuple[float, float]
Unreadable = Literal["changed", "hidden", "blurred", "other"]
UNREADABLE: tuple[Unreadable, ...] = get_args(Unreadable)
"""Why no detail can be identified at a place."""
LONGEST_REMARK, LONGEST_NAME = 2000, 40
"""Signs of a remark, and of the name of a person."""


@dataclass(frozen=True, slots=True)
class CheckRead:
    """The same detail marked in mosaic and reference, or a word why it cannot be."""

    seat_id: str
    place_id: str
    mosaic: Place | None
    reference: Place | None
    reason: str
    version: int
    """Of the mosaic in which it was marked, as the page was told."""


@dataclass(frozen=True, slots=True)
class SheetJudged:
    """A map sheet of the sample is good, or is not."""

    seat_id: str
    sheet: str
    good: bool
    words: str
    version: int
    """Of the mosaic in which it was seen, as the page was told."""


@dataclass(frozen=True, slots=True)
class BlockSigned:
    """A verdict on the whole block, in the name of who sits there."""

    seat_id: str
    verdict: Acceptance
    remark: str
    judged: Mapping[str, str]
    """Digest of each part of the block, as the page was told."""


@dataclass(frozen=True, slots=True)
class Remarked:
    """Words about a place, a photo, a point or a decision."""

    seat_id: str
    said: Remark


def remark_from_message(seat_id: str, message: Mapping[str, Any]) -> Remarked:
    """The gesture of a message.

    Raises:
        ValueError: It is about nothing, says nothing, or is a book.
    """
    subject, fault = message["subject"], message.get("fault", "")
    words, assigned = _words(message, "words"), _words(message, "assigned")
    closes = message.get("closes")
    of_photo = subject == "photo" and bool(fault)
    about = _place(message["place"]) if subject == "place" or of_photo else None
    if subject not in SUBJECTS or fault not in ("", *FAULT_KINDS):
        raise ValueError(subject)
    if len(assigned) > LONGEST_NAME or closes not in (None, True, False):
        raise ValueError(assigned)
    # A fault is a place with a kind; what closes one says so without words.
    if (about is None and fault) or not (words or fault or closes is not None):
        raise ValueError("nothing is said")
    name = "" if subject == "place" else str(message["name"])
    return Remarked(seat_id, Remark(subject, name, words, about, fault, assigned, closes))


def signature_from_message(seat_id: str, message: Mapping[str, Any]) -> BlockSigned:
    """The gesture of a message.

    Raises:
        ValueError: No verdict, or a remark that is a book.
    """
    verdict, remark = message["verdict"], _words(message, "remark")
    if verdict not in ACCEPTANCES:
        raise ValueError(verdict)
    judged = {str(part): str(digest) for part, digest in dict(message["judged"]).items()}
    return BlockSigned(seat_id, verdict, remark, judged)


def reading_from_message(seat_id: str, message: Mapping[str, Any]) -> CheckRead:
    """The gesture of a message.

    Raises:
        ValueError: Neither two places nor a reason.
    """
    reason, version = str(message.get("reason", "")), int(message["version"])
    if reason:
        if reason not in UNREADABLE:
            raise ValueError(reason)
        return CheckRead(seat_id, str(message["place"]), None, None, reason, version)
    mosaic, reference = _place(message["mosaic"]), _place(message["reference"])
    return CheckRead(seat_id, str(message["place"]), mosaic, reference, "", version)


def sheet_from_message(seat_id: str, message: Mapping[str, Any]) -> SheetJudged:
    """The gesture of a message.

    Raises:
        ValueError: It says neither good nor bad, or is a book.
    """
    good = message["good"]
    if not isinstance(good, bool):
        raise ValueError(good)
    words, version = _words(message, "words"), int(message["version"])
    return SheetJudged(seat_id, str(message["sheet"]), good, words, version)


def _words(message: Mapping[str, Any], name: str) -> str:
    """A text in one line.

    Raises:
        ValueError: It is a book.
    """
    words = " ".join(str(message.get(name, "")).split())
    if len(words) > LONGEST_REMARK:
        raise ValueError(name)
    return words


def _place(value: object) -> Place:
    east, north = (float(one) for one in cast("list[float]", value))
    if not (abs(east) < 1e9 and abs(north) < 1e9):
        raise ValueError("not a place")
    return east, north


Reviewed = CheckRead | SheetJudged | BlockSigned | Remarked
"""A gesture that judges and changes nothing of the block."""
REVIEWING: Mapping[str, Callable[[str, Mapping[str, Any]], Reviewed]] = {
    "check-read": reading_from_message,
    "sheet-judged": sheet_from_message,
    "sign": signature_from_message,
    "remark": remark_from_message,
}
"""What a message of each kind comes to."""
