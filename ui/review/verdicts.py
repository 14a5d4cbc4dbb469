"""The decision that a verdict makes on one measurement, if any."""

from dataclasses import replace

from core.block import Measurement
from sessions.decisions import (
    NOT_VISIBLE,
    Accept,
    Decision,
    MarkDubious,
    MarkNotVisible,
    Reject,
)
from ui.review.gestures import (
    Aimed,
    AnswerAsked,
    Gesture,
    PeakChosen,
    PlacedInScan,
    PlacedOnGround,
    Refined,
    Undone,
    Verdict,
)
from ui.review.looks import ShownState
from ui.review.second_reading import is_blind
from ui.review.state import DeskState, Key, Notice, Seat
from ui.review.to_measure import WAITING


def refusal(
    state: DeskState, seat: Seat, shown: ShownState, measurement: Measurement, verdict: Verdict
) -> Notice | None:
    """Why a verdict cannot be given on a measurement; None where it can."""
    key = measurement.key
    if key in state.extra.measurements and verdict not in ("accept", "reject"):
        return Notice("notice.yes-or-no")
    if verdict == "accept" and seat.draft_of(key):
        return None
    if verdict != "accept" and key[0] in seat.begun:
        return Notice("notice.only-draft", {"what": key[0]}, draft=key)
    if notice := not_measured(shown, measurement, verdict):
        return notice
    return Notice("notice.read-first") if is_blind(state, seat, key) else None


def not_placed(
    state: DeskState, seat: Seat, gesture: PlacedInScan | PlacedOnGround | PeakChosen | Refined
) -> Notice | None:
    """Why a gesture cannot place a measurement; None where it can.

    Peaks, and what is refined without a draft, begin at the first reading.
    """
    key = gesture.key
    if key in state.extra.measurements:
        return Notice("notice.yes-or-no")
    own = isinstance(gesture, Refined) and seat.draft_of(key) is not None
    if own or isinstance(gesture, PlacedInScan | PlacedOnGround):
        return None
    return Notice("notice.read-first") if is_blind(state, seat, key) else None


def not_measured(state: ShownState, measurement: Measurement, verdict: Verdict) -> Notice | None:
    """Why a verdict says nothing of a point that is not measured yet; None where it does."""
    if state == "rejected":
        # Dismissed or hidden, and never measured: there is no place to be accepted.
        nowhere = measurement.score == 0.0 and not measurement.peaks
        return Notice("notice.place-first") if nowhere and verdict == "accept" else None
    if verdict == "invisible" or state not in WAITING:
        return None
    if state == "proposed" and verdict in ("accept", "reject"):
        return None
    return Notice("notice.place-first")


def decision_of(verdict: Verdict, key: Key) -> Decision:
    """A verdict as a decision."""
    match verdict:
        case "accept":
            return Accept(*key)
        case "reject":
            return Reject(*key, reason="other")
        case "dubious":
            return MarkDubious(*key)
        case _:
            return MarkNotVisible(*key)


def standing_verdict(measurement: Measurement) -> Verdict | None:
    """The verdict that stands; None of what nobody has seen."""
    match measurement.status:
        case "accepted" if not measurement.seen:
            return None
        case "accepted":
            return "accept"
        case "rejected":
            return "invisible" if measurement.reason == NOT_VISIBLE else "reject"
        case "dubious":
            return "dubious"
        case _:
            return None


def still_asked(seat: Seat, gesture: Gesture) -> Seat:
    """The seat with a question about undo only while nothing else is done.

    A pointer that rests in the scene and a page that asks for an answer do nothing.
    """
    rests = isinstance(gesture, Aimed) and gesture.act == "hover"
    kept = rests or isinstance(gesture, Undone | AnswerAsked)
    return seat if kept else replace(seat, turning=None)
