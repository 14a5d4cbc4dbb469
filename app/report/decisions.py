"""Every decision of a session: who, when, about what, from which state to which; JSON-able."""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from typing import Any, get_args

from core.block import Block, Role, Status
from core.mosaic.seam_edits import SeamArea, SeamLine
from sessions.checks import difference_m
from sessions.decisions import (
    ACCEPTANCES,
    NOT_VISIBLE,
    REASONS,
    AddPoint,
    BringPoints,
    Decision,
    DrawSheets,
    FillMarks,
    JudgeFiducial,
    JudgePhoto,
    JudgeSheet,
    JudgeTie,
    MarkDubious,
    MarkNotVisible,
    PhotoDecision,
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
    standing,
    withdrawals,
)
from ui.words.catalogue import Teller

Figures = dict[str, Any]
USE, LEFT_OUT = "in use", "left out"
"""States of ties, photos and fiducials."""
GOOD, BAD = "good", "bad"
"""States of map sheets."""
OPEN, CLOSED = "open", "closed"
"""States of faults."""
STATE_TEXTS: Mapping[str, str] = {
    **{name: f"report.status.{name}" for name in get_args(Status)},
    **{name: f"role.{name}" for name in get_args(Role)},
    **{name: f"accepted.{name}" for name in ACCEPTANCES},
    USE: "detail.used",
    LEFT_OUT: "detail.left-out",
    GOOD: "sheet.good",
    BAD: "sheet.bad",
    OPEN: "fault.open",
    CLOSED: "fault.closed",
}
"""Text of each state."""
REASON_TEXTS: Mapping[str, str] = {
    **{reason: f"reason.{number}" for number, reason in enumerate(REASONS, start=1)},
    NOT_VISIBLE: "did.MarkNotVisible",
}
"""Text of each reason."""
COUNT_TEXTS: Mapping[str, str] = {
    "AddPoint": "detail.scans",
    "FillMarks": "detail.scans",
    "PlacePhoto": "detail.pairs",
    "BringPoints": "detail.points",
    "PlanChecks": "detail.places",
    "DrawSheets": "detail.sheets",
}
"""Text of what a decision holds several of."""
KINDS = {
    "Accept": "accepted",
    "ChoosePeak": "accepted",
    "Place": "placed",
    "Reject": "rejected",
    "MarkNotVisible": "rejected",
    "MarkDubious": "unsure",
    "AddPoint": "points added",
    "BringPoints": "points brought",
    "SetRole": "roles set",
    "JudgeTie": "ties judged",
    "JudgePhoto": "photos judged",
    "JudgeFiducial": "fiducials",
    "PlaceFiducial": "fiducials",
    "DrawMask": "masks drawn",
    "PlacePhoto": "photos placed",
    "FillMarks": "fiducials",
    "SeamLine": "seams drawn",
    "SeamArea": "seams drawn",
    "PlanChecks": "checks planned",
    "ReadCheck": "checks read",
    "DrawSheets": "samples drawn",
    "JudgeSheet": "sheets judged",
    "SignBlock": "signatures",
    "Remark": "remarks",
}
"""What each kind of decision is counted as."""


def decision_figures(recorded: Sequence[Recorded], proposed: Block | None = None) -> Figures:
    """Decisions that stand, by operator and kind, and all of them one by one, newest first.

    Args:
        recorded: Every decision of the session, withdrawals included.
        proposed: The block before any decision, for the states that decisions changed; None where
            it is not known.
    """
    plain = [one for one in recorded if not isinstance(one.decision, Withdraw)]
    kept = [one for one in standing(recorded) if not isinstance(one.decision, Withdraw)]
    operators = sorted({one.who for one in kept})
    counts = {
        who: Counter(KINDS[type(one.decision).__name__] for one in kept if one.who == who)
        for who in operators
    }
    used = {kind for counter in counts.values() for kind in counter}
    return {
        "count": len(kept),
        "taken_back": len(plain) - len(kept),
        "kinds": [kind for kind in dict.fromkeys(KINDS.values()) if kind in used],
        "operators": [
            {
                "who": who,
                "first": min(one.when for one in kept if one.who == who),
                "last": max(one.when for one in kept if one.who == who),
                "count": sum(counts[who].values()),
                "by_kind": dict(counts[who]),
            }
            for who in operators
        ],
        "log": _log(recorded, plain, proposed),
    }


def _log(
    recorded: Sequence[Recorded], plain: Sequence[Recorded], proposed: Block | None
) -> list[Figures]:
    """One row for each decision, newest first."""
    back, before, words = withdrawals(recorded), states_before(recorded, proposed), _words(recorded)
    return [
        {
            "number": one.decision_id,
            "when": minute(one.when),
            "who": one.who,
            "kind": KINDS[type(one.decision).__name__],
            "decision": type(one.decision).__name__,
            "subject": one.decision.subject if isinstance(one.decision, Remark) else "",
            "about": _about(one.decision),
            **_where(one.decision),
            "before": before[one.decision_id],
            "after": state_after(one.decision),
            "difference_m": _difference(one.decision),
            "reason": _reason(one.decision),
            "words": [*_own_words(one.decision), *words[one.decision_id]],
            "stands": one.decision_id not in back,
            "withdrawn_by": back[one.decision_id].who if one.decision_id in back else "",
            "withdrawn_when": minute(back[one.decision_id].when) if one.decision_id in back else "",
        }
        for one in reversed(plain)
    ]


def minute(when: str) -> str:
    """A time of recording as the report tells it: UTC, to the minute."""
    return when[:16].replace("T", " ")


def state_after(decision: Decision) -> str:
    """What a decision makes of its subject; empty where no word says it."""
    match decision:
        case Reject() | MarkNotVisible():
            return "rejected"
        case MarkDubious():
            return "dubious"
        case JudgeTie(use=use) | JudgePhoto(use=use) | JudgeFiducial(use=use):
            return USE if use else LEFT_OUT
        case PlaceFiducial():
            return USE
        case SetRole(role=role):
            return role
        case SignBlock(verdict=verdict):
            return verdict
        case JudgeSheet(good=good):
            return GOOD if good else BAD
        case Remark(fault=fault, closes=closes) if fault or closes is not None:
            return CLOSED if closes else OPEN
        case _:
            return "accepted" if isinstance(decision, PhotoDecision) else ""


def states_before(recorded: Sequence[Recorded], proposed: Block | None) -> Mapping[int, str]:
    """State of the subject of each decision when it was taken, by number; empty: not known.

    That is the state of the last decision about the same subject that stood then, or the one in
    which the program had left it.
    """
    known = {item.decision_id: item.decision for item in recorded}
    stood: dict[int, bool] = {}
    about: dict[tuple[object, ...], list[int]] = defaultdict(list)
    found: dict[int, str] = {}

    def turn(number: int, on: bool) -> None:
        stood[number] = on
        inside = known.get(number)
        if isinstance(inside, Withdraw):
            turn(inside.decision_id, not on)

    for item in recorded:
        number, said = item.decision_id, item.decision
        turn(number, True)
        subject = _subject(number, said)
        earlier = [one for one in about[subject] if stood[one]]
        state = state_after(known[earlier[-1]]) if earlier else _proposed_state(said, proposed)
        found[number] = state
        if state_after(said):
            about[subject].append(number)
    return found


def _subject(number: int, decision: Decision) -> tuple[object, ...]:
    """What decisions about the same thing have in common."""
    match decision:
        case JudgeFiducial() | PlaceFiducial():
            return "fiducial", decision.photo_id, decision.name
        case JudgeTie():
            return "tie", decision.photo_id, decision.column, decision.row
        case JudgePhoto():
            return "photo", decision.photo_id
        case SetRole():
            return "role", decision.point_id
        case Remark(subject="decision", name=name) if decision.closes is not None:
            return "fault", name
        case Remark():
            return "fault", str(number)
        case _ if isinstance(decision, PhotoDecision):
            return "measurement", decision.point_id, decision.photo_id
        case _:
            return "alone", number


def _proposed_state(decision: Decision, proposed: Block | None) -> str:
    """In which state the program had left the subject of a decision."""
    if proposed is None:
        return ""
    match decision:
        case SetRole(point_id=name) if name in proposed.surveyed:
            return proposed.surveyed[name].role
        case JudgePhoto(photo_id=name) if name in proposed.photos:
            return USE if proposed.photos[name].oriented else LEFT_OUT
        case JudgeFiducial() | PlaceFiducial() if decision.photo_id in proposed.photos:
            names = proposed.photos[decision.photo_id].interior.names
            return USE if decision.name in names else LEFT_OUT
        case _ if isinstance(decision, PhotoDecision):
            found = proposed.measurements.get((decision.point_id, decision.photo_id))
            return "" if found is None else found.status
        case _:
            return ""


def _about(decision: Decision) -> str:
    """Names of the point, photo, place or seam that a decision is about."""
    match decision:
        case SeamLine(first=first, second=second):
            return f"{first} | {second}"
        case BringPoints(points=points, source=source):
            return source or ", ".join(point.point_id for point in points[:3])
        case PlanChecks():
            return decision.number
        case Remark(name=name):
            return name
        case _:
            fields = ("point_id", "place_id", "photo_id", "camera", "subject", "sheet", "name")
            named = (getattr(decision, name, "") for name in fields)
            return " ".join(str(name) for name in named if name)


def _where(decision: Decision) -> Figures:
    """Pixel in the scan and place on the ground, where a decision names them, and a count."""
    column, row = (getattr(decision, name, None) for name in ("column", "row"))
    known = column is not None and row is not None and not isinstance(decision, FillMarks)
    place = _place(decision)
    return {
        "pixel": [column, row] if known else None,
        "place": None if place is None else list(place),
        "count": _count(decision),
    }


def _place(decision: Decision) -> tuple[float, float] | None:
    """Easting and northing that a decision is about; None where it names none."""
    match decision:
        case Remark(place=place) | ReadCheck(reference=place):
            return place
        case AddPoint(east=east, north=north):
            return east, north
        case SeamLine(line=line):
            return line[len(line) // 2]
        case SeamArea(outline=outline):
            return outline[0]
        case _:
            return None


def _count(decision: Decision) -> int | None:
    """Scans, points, pairs or places that a decision holds; None where it holds one thing."""
    match decision:
        case AddPoint(measured=several) | FillMarks(found=several):
            return len(several)
        case BringPoints(points=several) | PlacePhoto(pairs=several):
            return len(several)
        case PlanChecks() | DrawSheets():
            return decision.count
        case _:
            return None


def _difference(decision: Decision) -> list[float] | None:
    """Mosaic minus reference of a reading, metres; None of anything else."""
    if isinstance(decision, ReadCheck) and decision.mosaic is not None:
        return list(difference_m(decision))
    return None


def _reason(decision: Decision) -> str:
    """Why something was rejected, or could not be read; empty without a reason."""
    match decision:
        case Reject(reason=reason) | ReadCheck(reason=reason):
            return reason
        case MarkNotVisible():
            return NOT_VISIBLE
        case _:
            return ""


def _own_words(decision: Decision) -> list[str]:
    """What a decision says in words of its own."""
    said = decision.remark if isinstance(decision, SignBlock) else ""
    said = decision.words if isinstance(decision, Remark | JudgeSheet) else said
    return [said] if said else []


def _words(recorded: Sequence[Recorded]) -> Mapping[int, list[str]]:
    """What others said of each decision, and did not take back, by its number."""
    words: dict[int, list[str]] = defaultdict(list)
    for item in standing(recorded):
        said = item.decision
        if isinstance(said, Remark) and said.subject == "decision" and said.words:
            words[int(said.name)].append(f"{said.words} ({item.who})")
    return words


def decisions_told(log: Sequence[Figures], tell: Teller) -> list[Figures]:
    """Rows of the page: about what, from which state to which, words, and who took it back."""
    return [
        {
            **one,
            "about": _about_told(one, tell),
            "change": _change_told(one, tell),
            "words": "; ".join(one["words"]),
            "back": tell("report.withdrawn", who=one["withdrawn_by"], when=one["withdrawn_when"])
            if not one["stands"]
            else "",
        }
        for one in log
    ]


def _about_told(one: Figures, tell: Teller) -> str:
    """What a decision is about, and where that lies."""
    named = one["subject"] not in ("", "place")
    said = [tell(f"remark.about.{one['subject']}", name=one["about"]) if named else one["about"]]
    if one["pixel"]:
        column, row = (tell.number(value, ".1f") for value in one["pixel"])
        said.append(tell("detail.pixel", column=column, row=row))
    if one["place"]:
        east, north = (tell.number(value, ".1f") for value in one["place"])
        said.append(f"E\u00a0{east} N\u00a0{north}")
    if one["count"] is not None:
        said.append(tell(COUNT_TEXTS[one["decision"]], count=one["count"]))
    return ", ".join(part for part in said if part)


def _change_told(one: Figures, tell: Teller) -> str:
    """The state before and after, and the reason; nothing where no word says it."""
    before, after = (tell(STATE_TEXTS[one[name]]) if one[name] else "" for name in
                     ("before", "after"))  # fmt: skip
    change = f"{before} \u2192 {after}" if before and after and before != after else after
    texts = REASON_TEXTS if one["decision"] != "ReadCheck" else {}
    reason = one["reason"] and tell(texts.get(one["reason"], f"unreadable.{one['reason']}"))
    if one["difference_m"]:
        east, north = (tell.number(value, "+.3f") for value in one["difference_m"])
        change = f"dX {east}, dY {north}\u00a0m"
    return ": ".join(part for part in (change, reason) if part)
