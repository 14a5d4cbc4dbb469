"""The history of a point, and pairs of adjustments to compare."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from core.adjustment.adjusted import AdjustmentReport
from core.block import Block, Photo
from core.geometry.camera import Camera
from core.mosaic.seam_edits import SeamArea, SeamLine
from sessions.decisions import (
    REASONS,
    AddPoint,
    BringPoints,
    Decision,
    DrawMask,
    DrawSheets,
    FillMarks,
    JudgeFiducial,
    JudgePhoto,
    JudgeSheet,
    JudgeTie,
    Kinds,
    PhotoDecision,
    Place,
    PlaceFiducial,
    PlacePhoto,
    PlanChecks,
    ReadCheck,
    Recorded,
    Reject,
    Remark,
    SetRole,
    SignBlock,
    Withdraw,
    last_to_undo,
    standing,
    withdrawals,
)
from sessions.remarks import is_fault
from sessions.session import Session
from ui.review.compare import shift_px
from ui.review.doubtful import key_of_verdict
from ui.review.picture import position_error_m
from ui.review.state import DeskState, Extra, Key, Notice, Seat

SHEET_KINDS: Mapping[str, Kinds] = {
    "board": (JudgeFiducial, PlaceFiducial, FillMarks),
    "mask": (DrawMask,),
    "mosaic": (SeamLine, SeamArea, Remark, JudgeSheet),
    "checks": (PlanChecks, ReadCheck),
}
"""What undo takes back while a sheet lies over the desk: only what is decided there."""
LONGEST = 30
KEPT = 60
"""So many are kept; the first one always."""


def history_of(
    key: Key, recorded: Sequence[Recorded], extra: Extra, operator: str
) -> list[dict[str, Any]]:
    """Decisions about a measurement or its point, newest first, for the page of an operator."""
    stands = {item.decision_id for item in standing(recorded)}
    withdrawn = withdrawals(recorded)
    explained = _explained(recorded)
    about: list[Recorded] = []
    numbers: set[str] = set()
    for item in recorded:
        said = item.decision
        answers = isinstance(said, Remark) and said.subject == "decision" and said.name in numbers
        if item.decision_id not in explained and (answers or concerns(said, key, extra)):
            about.append(item)
            numbers.add(str(item.decision_id))
    return [
        {
            "id": item.decision_id,
            "when": item.when,
            "who": item.who,
            "what": type(item.decision).__name__,
            "detail": _detail(item.decision),
            "stands": item.decision_id in stands,
            "turns": _may_turn(item, operator),
            "by": withdrawn[item.decision_id].who if item.decision_id in withdrawn else "",
        }
        for item in reversed(about[-LONGEST:])
    ]


def _explained(recorded: Sequence[Recorded]) -> set[int]:
    """Rejections that were recorded anew with their reason: both together are one."""
    known = {item.decision_id: item.decision for item in recorded}
    explained: set[int] = set()
    replaced: dict[tuple[str, ...], int] = {}
    for item in recorded:
        back = known.get(item.decision.decision_id) if isinstance(item.decision, Withdraw) else None
        said = back or item.decision
        if not isinstance(said, Reject):
            continue
        act = item.when, item.who, said.point_id, said.photo_id
        if isinstance(item.decision, Withdraw):
            replaced[act] = item.decision.decision_id
        elif act in replaced:
            explained.add(replaced[act])
    return explained


def concerns(decision: Decision, key: Key, extra: Extra) -> bool:
    """True when a decision is about a measurement, or about its whole point."""
    match decision:
        case (
            Withdraw()
            | DrawMask()
            | FillMarks()
            | PlanChecks()
            | ReadCheck()
            | DrawSheets()
            | JudgeSheet()
            | SignBlock()
            | SeamLine()
            | SeamArea()
        ):
            return False
        case PlacePhoto(photo_id=photo_id):
            return photo_id == key[1]
        case Remark(subject=subject, name=name):
            return (subject, name) in (("point", key[0]), ("photo", key[1]))
        case JudgeTie() | JudgePhoto() | JudgeFiducial() | PlaceFiducial():
            return key_of_verdict(extra, decision) == key
        case SetRole(point_id=point_id) | AddPoint(point_id=point_id):
            return point_id == key[0]
        case BringPoints(points=points):
            return any(point.point_id == key[0] for point in points)
        case _:
            return (decision.point_id, decision.photo_id) == key


def key_of(decision: Decision, extra: Extra) -> Key | None:
    """The measurement a decision is about; None where it is about more than one."""
    match decision:
        case (
            Withdraw()
            | SetRole()
            | BringPoints()
            | DrawMask()
            | PlacePhoto()
            | FillMarks()
            | PlanChecks()
            | ReadCheck()
            | DrawSheets()
            | JudgeSheet()
            | SignBlock()
            | Remark()
            | SeamLine()
            | SeamArea()
        ):
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
        case DrawMask(subject=name) | PlacePhoto(photo_id=name) | FillMarks(camera=name):
            return name
        case SeamLine(first=first, second=second):
            return f"{first} | {second}"
        case SeamArea(photo_id=name):
            return name
        case BringPoints(points=points):
            rest = f" + {len(points) - 1}" if len(points) > 1 else ""
            return points[0].point_id + rest if points else ""
        case PlanChecks():
            return decision.number
        case ReadCheck(place_id=name) | JudgeSheet(sheet=name):
            return name
        case Remark(words=words):
            return words
        case _:
            return getattr(decision, "point_id", "")


def count_standing(recorded: Sequence[Recorded]) -> int:
    """How many decisions stand; a withdrawal is none."""
    return sum(not isinstance(item.decision, Withdraw) for item in standing(recorded))


def touched_by(recorded: Recorded, decisions: Sequence[Recorded]) -> Recorded | None:
    """The decision that a withdrawal, or the withdrawal of a withdrawal, is about."""
    by_number = {item.decision_id: item for item in decisions}
    found: Recorded | None = recorded
    while found is not None and isinstance(found.decision, Withdraw):
        found = by_number.get(found.decision.decision_id)
    return found


def turn_back(
    session: Session,
    act: Literal["undo", "redo"],
    seat: Seat,
    made: Mapping[int, str],
    present: Collection[str],
    *,
    mark: Key | None = None,
) -> tuple[tuple[Recorded, ...], Seat]:
    """What undoing or redoing a seat's last decision records; in a sheet, of those made there.

    Undo gives up the draft that is shown instead where nothing that stands was decided since.
    A plan of checks and a signature are asked about first: nothing is recorded, and the seat asks.
    What is asked about is answered, whatever was decided since.

    Args:
        session: Where it is recorded.
        act: Which of both.
        seat: Who asks.
        made: Seats by the numbers of the decisions made there: a seat's own are those of all its
            names, and people may share a name.
        present: Who sits here.
        mark: The fiducial that the board shows.
    """
    kinds, decisions = SHEET_KINDS.get(seat.sheet, ()), session.decisions()
    own = {number for number, seat_id in made.items() if seat_id == seat.seat_id}
    others = {number for number, seat_id in made.items() if seat_id in present} - own
    others |= _words_elsewhere(decisions) if seat.sheet == "mosaic" else set()
    whose = seat.operator, kinds, others, own
    last = last_to_undo(decisions, *whose) if act == "undo" else None
    asked = seat.turning[0] if seat.turning else 0
    if act == "undo" and asked and (last is None or last.decision_id != asked):
        back, _ = taken_back(asked, decisions, seat.operator, again=False)
        made_now = session.record_all(back, None, seat.operator) if back else ()
        return made_now, replace(seat, turning=None)
    shown = mark if seat.sheet else seat.current
    if act == "undo" and shown and is_newer(seat, shown, last):
        return (), seat.without_draft(shown).without_mark(*shown)
    if (
        last is not None
        and last.decision_id != asked
        and (about := _undo_question(last, decisions))
    ):
        return (), replace(seat, turning=(last.decision_id, about))
    known = len(decisions)
    turn = session.undo if act == "undo" else session.redo
    turn(*whose)
    return tuple(session.decisions()[known:]), replace(seat, turning=None)


def is_newer(seat: Seat, drafted: Key, last: Recorded | None) -> bool:
    """True where there is a draft of a measurement or mark, and no decision since that stands."""
    if not seat.draft_of(drafted) and not seat.mark_of(*drafted):
        return False
    return last is None or last.decision_id < seat.older.get(drafted, last.decision_id + 1)


def _words_elsewhere(decisions: Sequence[Recorded]) -> set[int]:
    """Words, said or withdrawn, that are neither about a place or a fault nor an answer to one."""
    faults: set[str] = set()
    elsewhere: set[int] = set()
    for item in decisions:
        match item.decision:
            case Remark(fault=fault) if fault:
                faults.add(str(item.decision_id))
            case Remark(subject=subject, name=name):
                if subject != "place" and not (subject == "decision" and name in faults):
                    elsewhere.add(item.decision_id)
            case Withdraw(decision_id=number) if number in elsewhere:
                elsewhere.add(item.decision_id)
            case _:
                pass
    return elsewhere


def _undo_question(item: Recorded, recorded: Sequence[Recorded]) -> Notice | None:
    """What is asked before a decision that took long or vouches for the block is taken back."""
    match item.decision:
        case PlanChecks():
            values = {"what": subject_of(item.decision), "count": f"{item.decision.count}"}
            return Notice("undo.ask.PlanChecks", values)
        case DrawSheets():
            return Notice("undo.ask.DrawSheets", {"count": f"{item.decision.count}"})
        case SignBlock():
            earlier = [
                one.when
                for one in standing(recorded)
                if isinstance(one.decision, SignBlock)
                and one.who == item.who
                and one.decision_id < item.decision_id
            ]
            if earlier:
                return Notice(
                    "undo.ask.SignBlock.earlier", {"when": earlier[-1][:16].replace("T", " ")}
                )
            return Notice("undo.ask.SignBlock")
        case _:
            return None


def nothing_notice(act: str, before: Seat, seat: Seat) -> Notice | None:
    """Told where there is nothing to undo or redo: neither a question nor a draft that went."""
    if seat.turning or (seat.drafts, seat.marks) != (before.drafts, before.marks):
        return None
    here = seat.sheet in SHEET_KINDS
    return Notice(f"notice.nothing-to-{act}.here" if here else f"notice.nothing-to-{act}")


def mark_of(decision: Decision) -> tuple[str, str] | None:
    """Photo and name of the fiducial that a decision is about; None for any other."""
    if isinstance(decision, JudgeFiducial | PlaceFiducial):
        return decision.photo_id, decision.name
    return None


def turn_notice(act: str, decision: Decision, key: Key | None, count: int) -> Notice:
    """What to tell of an undo or redo: of one decision, or of so many that were made as one."""
    if count > 1:
        return Notice(f"notice.{act}.several", {"count": f"{count}"})
    about = " \u00b7 ".join(key) if key else subject_of(decision)
    several = isinstance(decision, PlanChecks | DrawSheets)
    places = {"count": f"{decision.count}"} if several else {}
    name = type(decision).__name__
    if isinstance(decision, Remark) and not decision.words:
        name += ".fault" if decision.fault else ".answer"
    return Notice(f"notice.{act}.{name}", {"what": about, **places})


def own_rejections(
    keys: Collection[Key], operator: str, recorded: Sequence[Recorded]
) -> dict[Key, int]:
    """Numbers of an operator's rejections, of those measurements where they are the last word."""
    last = {
        (item.decision.point_id, item.decision.photo_id): item
        for item in standing(recorded)
        if isinstance(item.decision, PhotoDecision)
    }
    found = {key: last[key] for key in keys if key in last}
    return {
        key: item.decision_id
        for key, item in found.items()
        if item.who == operator and isinstance(item.decision, Reject)
    }


def _detail(decision: Decision) -> tuple[str, dict[str, str | int]]:
    """What was decided in more detail: key of a text and its values; no key where there is none."""
    match decision:
        case Reject(reason=reason):
            return f"reason.{REASONS.index(reason) + 1}", {}
        case Remark(words=words):
            return "detail.words", {"words": words}
        case Place(column=column, row=row) | PlaceFiducial(column=column, row=row):
            return "detail.pixel", {"column": f"{column:.1f}", "row": f"{row:.1f}"}
        case SetRole(role=role):
            return f"role.{role}", {}
        case JudgeTie(use=use) | JudgePhoto(use=use) | JudgeFiducial(use=use):
            return "detail.used" if use else "detail.left-out", {}
        case BringPoints(source=source):
            return ("detail.list", {"file": source}) if source else ("detail.typed", {})
        case PlacePhoto(pairs=pairs):
            return "detail.pairs", {"count": len(pairs)}
        case AddPoint(measured=found) | FillMarks(found=found):
            return "detail.scans", {"count": len(found)}
        case _:
            return "", {}


@dataclass(frozen=True, slots=True, eq=False)
class AdjustmentRecord:
    """One adjustment, without its residuals."""

    number: int
    """Counts from 1."""
    decided: int
    """Decisions it rests on."""
    sigma_nought: float
    """Standard deviation of unit weight."""
    position_error_m: float | None
    """m_p of the check points; None without any."""
    rms_px: Mapping[str, float]
    """RMS residual by class, pixels."""
    used: int
    """Control measurements in use."""
    photos: Mapping[str, tuple[Photo, Camera]]
    """Orientations."""


def record_of(
    report: AdjustmentReport, block: Block, decided: int, number: int
) -> AdjustmentRecord:
    """What is kept of an adjustment."""
    adjusted = report.block
    used = sum(
        item.used and key not in report.rejected and block.surveyed[key[0]].role == "control"
        for key, item in adjusted.measurements.items()
        if key[0] in block.surveyed
    )
    photos = {name: (photo, adjusted.camera_of(name)) for name, photo in adjusted.photos.items()}
    error = position_error_m(report)
    return AdjustmentRecord(
        number, decided, report.sigma_nought, error, dict(report.rms_px), used, photos
    )


def with_adjustment(
    kept: tuple[AdjustmentRecord, ...], report: AdjustmentReport, state: DeskState
) -> tuple[AdjustmentRecord, ...]:
    """The list with one more; the first stays, old ones behind it go."""
    number = kept[-1].number + 1 if kept else 1
    longer = (*kept, record_of(report, state.block, state.decided, number))
    return longer if len(longer) <= KEPT else (longer[0], *longer[2:])


def record_line(one: AdjustmentRecord) -> dict[str, Any]:
    """An adjustment in the list."""
    return {
        "number": one.number, "decided": one.decided, "used": one.used,
        "sigma": round(one.sigma_nought, 4),
        "mp": None if one.position_error_m is None else round(one.position_error_m, 3),
        "rms": {name: round(value, 3) for name, value in one.rms_px.items() if value == value},
    }  # fmt: skip


def shifts_m(one: AdjustmentRecord, other: AdjustmentRecord) -> dict[str, float]:
    """How far each photo's corners moved at most between two adjustments, metres on the ground."""
    return {
        name: shift_px(*one.photos[name], photo, camera) * photo.ground_pixel_m(camera)
        for name, (photo, camera) in other.photos.items()
        if name in one.photos
    }


def taken_back(
    decision_id: int, recorded: Sequence[Recorded], operator: str, *, again: bool
) -> tuple[tuple[Withdraw, ...], Notice | None]:
    """What takes one decision back, or decides it again; else what is told.

    Signatures and faults stay theirs who vouched for them: others sign too, or close the fault.
    """
    item = next((one for one in recorded if one.decision_id == decision_id), None)
    if item is not None and not _may_turn(item, operator):
        return (), Notice("notice.not-yours", {"who": item.who}, grave=True)
    stands = standing(recorded)
    if any(one.decision_id == decision_id for one in stands):
        turned = () if again else (Withdraw(decision_id),)
    else:
        undone = [
            one.decision_id
            for one in stands
            if isinstance(one.decision, Withdraw) and one.decision.decision_id == decision_id
        ]
        turned = (Withdraw(undone[-1]),) if again and undone else ()
    return turned, None if turned else Notice("notice.turned")


def asked_back(
    decision_id: int, recorded: Sequence[Recorded], seat: Seat, *, again: bool
) -> tuple[tuple[Withdraw, ...], Seat, Notice | None]:
    """The same for a seat, which asks first where undo would; undo answers it.

    A withdrawal is an undo of one decision: what brings it back is redo, and is told at once.
    """
    turned, notice = taken_back(decision_id, recorded, seat.operator, again=again)
    if turned and not again:
        item = next(one for one in recorded if one.decision_id == decision_id)
        if about := _undo_question(item, recorded):
            return (), replace(seat, turning=(decision_id, about)), None
        notice = Notice("notice.withdrawn")
    return turned, seat, notice


def _may_turn(item: Recorded, operator: str) -> bool:
    """Whether an operator may take a decision back: signatures and faults only their own."""
    vouches = isinstance(item.decision, SignBlock) or is_fault(item.decision)
    return item.who == operator or not vouches
