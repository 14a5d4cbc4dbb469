"""What was decided about a point, by whom and when, and whether it still stands."""

from collections.abc import Sequence
from typing import Any

from sessions.decisions import (
    REASONS,
    AddPoint,
    Decision,
    JudgeFiducial,
    JudgePhoto,
    JudgeTie,
    Place,
    PlaceFiducial,
    Recorded,
    Reject,
    SetRole,
    Withdraw,
    standing,
)
from ui.review.doubtful import key_of_verdict
from ui.review.state import Extra, Key

LONGEST = 30


def history_of(key: Key, recorded: Sequence[Recorded], extra: Extra) -> list[dict[str, Any]]:
    """Decisions about a measurement or its point, newest first, for the page."""
    stands = {item.decision_id for item in standing(recorded)}
    withdrawn_by = {
        item.decision.decision_id: item.who
        for item in recorded
        if isinstance(item.decision, Withdraw) and item.decision_id in stands
    }
    about = [item for item in recorded if concerns(item.decision, key, extra)]
    return [
        {
            "id": item.decision_id,
            "when": item.when,
            "who": item.who,
            "what": type(item.decision).__name__,
            "detail": _detail(item.decision),
            "stands": item.decision_id in stands,
            "by": withdrawn_by.get(item.decision_id, ""),
        }
        for item in reversed(about[-LONGEST:])
    ]


def concerns(decision: Decision, key: Key, extra: Extra) -> bool:
    """True when a decision is about a measurement, or about its whole point."""
    match decision:
        case Withdraw():
            return False
        case JudgeTie() | JudgePhoto() | JudgeFiducial() | PlaceFiducial():
            return key_of_verdict(extra, decision) == key
        case SetRole(point_id=point_id) | AddPoint(point_id=point_id):
            return point_id == key[0]
        case _:
            return (decision.point_id, decision.photo_id) == key


def key_of(decision: Decision, extra: Extra) -> Key | None:
    """The measurement a decision is about; None where it is about more than one."""
    match decision:
        case Withdraw() | SetRole():
            return None
        case AddPoint(point_id=point_id, measured=measured):
            return (point_id, measured[0].photo_id) if measured else None
        case JudgeTie() | JudgePhoto() | JudgeFiducial() | PlaceFiducial():
            return key_of_verdict(extra, decision)
        case _:
            return decision.point_id, decision.photo_id


def subject_of(decision: Decision) -> str:
    """What a decision is about, for a word to the operator."""
    match decision:
        case (
            JudgeFiducial(photo_id=photo_id, name=name)
            | PlaceFiducial(photo_id=photo_id, name=name)
        ):
            return f"{name} \u00b7 {photo_id}"
        case _:
            return getattr(decision, "point_id", "")


def touched_by(recorded: Recorded, decisions: Sequence[Recorded]) -> Recorded | None:
    """The decision that a withdrawal, or the withdrawal of a withdrawal, is about."""
    by_number = {item.decision_id: item for item in decisions}
    found: Recorded | None = recorded
    while found is not None and isinstance(found.decision, Withdraw):
        found = by_number.get(found.decision.decision_id)
    return found


def gives_reason(before: Decision, now: Decision) -> bool:
    """True when a rejection is the reason of the rejection just made."""
    if not isinstance(before, Reject) or not isinstance(now, Reject):
        return False
    return (before.point_id, before.photo_id) == (now.point_id, now.photo_id)


def _detail(decision: Decision) -> tuple[str, dict[str, str]]:
    """What was decided in more detail: key of a text and its values; no key where there is none."""
    match decision:
        case Reject(reason=reason):
            return f"reason.{REASONS.index(reason) + 1}", {}
        case Place(column=column, row=row) | PlaceFiducial(column=column, row=row):
            return "detail.pixel", {"column": f"{column:.1f}", "row": f"{row:.1f}"}
        case SetRole(role=role):
            return f"role.{role}", {}
        case JudgeTie(use=use) | JudgePhoto(use=use) | JudgeFiducial(use=use):
            return "detail.used" if use else "detail.left-out", {}
        case AddPoint(measured=measured):
            return "detail.scans", {"count": str(len(measured))}
        case _:
            return "", {}
