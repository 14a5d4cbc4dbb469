"""What a gesture means: a changed seat, perhaps a decision, perhaps an act of the loop."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from core.doubts import Failure
from sessions.decisions import (
    NOT_VISIBLE,
    REASONS,
    Accept,
    ChoosePeak,
    Decision,
    MarkDubious,
    MarkNotVisible,
    Place,
    Recorded,
    Reject,
    SetRole,
    Withdraw,
    standing,
)
from ui.review.adding import seen_in
from ui.review.compare import Drawn, HeightSource, LikenessSource, pixel_from_ground
from ui.review.doubtful import verdict_on
from ui.review.gestures import (
    Explained,
    Filtered,
    Fitted,
    Freed,
    Gesture,
    Judged,
    LayerSwitched,
    MarkJudged,
    MarkPlaced,
    Named,
    PeakChosen,
    PlacedInScan,
    PlacedOnGround,
    PointAsked,
    QualityAsked,
    RayPicked,
    Redone,
    Refined,
    RemakeAsked,
    RemakeCancelled,
    RoleSwitched,
    Selected,
    SheetAsked,
    Sorted,
    Stepped,
    TakenBack,
    Undone,
    VectorsScaled,
    Verdict,
)
from ui.review.marking import marked
from ui.review.origins import NO_ORIGINS, Origins
from ui.review.picking import Picked, pick
from ui.review.queue import Row, coming, neighbour, ordered, visible
from ui.review.state import DeskState, Key, Notice, Seat, Sieve, Sorting

Act = Literal[
    "", "amend", "undo", "redo", "remake", "cancel", "fit whole", "fit current", "add", "free"
]
"""What the loop shall do beyond recording a decision."""


@dataclass(frozen=True, slots=True, eq=False)
class Desk:
    """All that a gesture may be about."""

    state: DeskState
    """The block and its adjustment."""
    rows: Mapping[Key, Row]
    """The queue's rows by key."""
    drawn: Drawn
    """Photos as they are drawn on the pages."""
    dem: HeightSource
    """Heights of the ground."""
    likeness: LikenessSource | None = None
    """Compares reference and scan; None where there is nothing to compare with."""
    taken: frozenset[Key] = frozenset()
    """What others are looking at now."""
    recorded: Sequence[Recorded] = ()
    """Every decision so far."""
    origins: Origins = NO_ORIGINS
    """Scans as they were found."""


@dataclass(frozen=True, slots=True)
class Meaning:
    """What a gesture comes to."""

    seat: Seat
    """The seat afterwards."""
    decision: Decision | None = None
    """To be recorded before anything is shown."""
    act: Act = ""
    """What else the loop shall do."""
    notice: Notice | None = None
    """What to tell the operator."""


def meaning(gesture: Gesture, seat: Seat, desk: Desk) -> Meaning:
    """What a gesture of one seat means now."""
    match gesture:
        case Judged():
            return _judge(gesture, seat, desk)
        case Explained():
            return _explain(gesture, seat)
        case PlacedInScan() | PlacedOnGround() | PeakChosen() | MarkPlaced() | MarkJudged():
            return _measure(gesture, seat, desk)
        case Refined():
            return _refine(gesture, seat, desk)
        case RoleSwitched():
            return _switch_role(gesture, seat, desk)
        case Undone() | Redone() | RemakeAsked() | RemakeCancelled() | Fitted() | Freed():
            return _act(gesture, seat)
        case PointAsked():
            return _ask_point(gesture, seat, desk)
        case TakenBack(decision_id=decision_id):
            return Meaning(seat, decision=taken_back(decision_id, desk.recorded))
        case RayPicked():
            return _pick(gesture, seat, desk)
        case _:
            return Meaning(_moved(gesture, seat, desk))


def seated(seat: Seat, rows: Mapping[Key, Row], taken: Collection[Key] = ()) -> Seat:
    """The seat with its queue sorted and something to look at that nobody else looks at."""
    order = ordered(rows.values(), seat.sorting)
    current = seat.current if seat.current in rows else None
    seat = replace(seat, order=order, current=current)
    if current is None:
        shown = visible(rows, seat)
        undecided = [key for key in shown if rows[key].state == "auto"]
        free = [key for key in undecided if key not in taken]
        seat = replace(seat, current=next(iter(free or undecided or shown), None))
    return seat


def kept_up(seat: Seat, rows: Mapping[Key, Row]) -> Seat:
    """The seat with measurements that are new at the end of its queue, and no vanished ones."""
    known = set(seat.order)
    if len(known) == len(rows) and all(key in known for key in rows):
        return seat
    order = tuple(key for key in seat.order if key in rows)
    fresh = tuple(sorted(key for key in rows if key not in known))
    current = seat.current if seat.current in rows else _beside(seat, rows)
    return replace(seat, order=order + fresh, current=current)


def _beside(seat: Seat, rows: Mapping[Key, Row]) -> Key | None:
    """What stood beside a measurement that has vanished: the next in the queue, or the first."""
    if seat.current is None:
        return None
    shown = visible(rows, seat)
    here = seat.order.index(seat.current) if seat.current in seat.order else 0
    behind = {key for key in seat.order[here:] if key in rows}
    return next((key for key in shown if key in behind), next(iter(shown), None))


def _act(
    gesture: Undone | Redone | RemakeAsked | RemakeCancelled | Fitted | Freed, seat: Seat
) -> Meaning:
    """What only the loop can do."""
    match gesture:
        case Freed():
            return Meaning(seat, act="free")
        case Undone():
            return Meaning(replace(seat, explaining=None), act="undo")
        case Redone():
            return Meaning(replace(seat, explaining=None), act="redo")
        case RemakeAsked():
            return Meaning(seat, act="remake")
        case RemakeCancelled():
            return Meaning(seat, act="cancel")
        case Fitted(whole=whole):
            return Meaning(seat, act="fit whole" if whole else "fit current")


def _judge(gesture: Judged, seat: Seat, desk: Desk) -> Meaning:
    """Record the verdict and go on; a key pressed again on a point already left does nothing."""
    measurement = desk.state.measurement_of(gesture.key)
    if measurement is None or gesture.key not in desk.rows:
        return Meaning(seat)
    verdict = gesture.verdict
    extra = gesture.key in desk.state.extra.measurements
    if extra and verdict not in ("accept", "reject"):
        return Meaning(seat, notice=Notice("notice.yes-or-no"))
    stands = _standing_verdict(measurement.status, measurement.reason) == verdict
    here = gesture.key == seat.current
    after = replace(seat, current=_next_open(seat, desk)) if here else seat
    rejected = verdict == "reject" and not stands and not extra
    after = replace(after, explaining=gesture.key if rejected else None)
    last = here and desk.rows[gesture.key].state == "auto" and not coming(desk.rows, seat)
    decided = (
        verdict_on(desk.state.extra, gesture.key, verdict == "accept")
        if extra
        else _decision_of(verdict, gesture.key)
    )
    return Meaning(
        after,
        decision=None if stands else decided,
        notice=Notice("notice.queue-done") if last else None,
    )


def _decision_of(verdict: Verdict, key: Key) -> Decision:
    match verdict:
        case "accept":
            return Accept(*key)
        case "reject":
            return Reject(*key, reason="other")
        case "dubious":
            return MarkDubious(*key)
        case _:
            return MarkNotVisible(*key)


def _standing_verdict(status: str, reason: str) -> Verdict | None:
    match status:
        case "accepted":
            return "accept"
        case "rejected":
            return "invisible" if reason == NOT_VISIBLE else "reject"
        case "dubious":
            return "dubious"
        case _:
            return None


def _next_open(seat: Seat, desk: Desk) -> Key | None:
    """The next measurement in the queue nobody has looked at; else simply the next."""
    following = coming(desk.rows, seat, desk.taken) or coming(desk.rows, seat)
    return following[0] if following else neighbour(visible(desk.rows, seat), seat, +1)


def taken_back(decision_id: int, recorded: Sequence[Recorded]) -> Withdraw | None:
    """What turns one decision round: withdrawn when it stands, else its withdrawal withdrawn."""
    if not any(item.decision_id == decision_id for item in recorded):
        return None
    stands = standing(recorded)
    if any(item.decision_id == decision_id for item in stands):
        return Withdraw(decision_id)
    undone = [
        item.decision_id
        for item in stands
        if isinstance(item.decision, Withdraw) and item.decision.decision_id == decision_id
    ]
    return Withdraw(undone[-1]) if undone else None


def _ask_point(gesture: PointAsked, seat: Seat, desk: Desk) -> Meaning:
    """A new point is measured in the background, for it takes a while in many scans."""
    shown = seen_in(desk.state, np.array([[gesture.east, gesture.north]]), desk.dem)
    if not shown:
        return Meaning(seat, notice=Notice("notice.no-scan", grave=True))
    notice = Notice("notice.measuring", {"count": str(len(shown))})
    return Meaning(seat, act="add", notice=notice)


def _explain(gesture: Explained, seat: Seat) -> Meaning:
    if seat.explaining is None or not 1 <= gesture.digit <= len(REASONS):
        return Meaning(seat)
    decision = Reject(*seat.explaining, reason=REASONS[gesture.digit - 1])
    return Meaning(replace(seat, explaining=None), decision=decision, act="amend")


def _measure(
    gesture: PlacedInScan | PlacedOnGround | PeakChosen | MarkPlaced | MarkJudged,
    seat: Seat,
    desk: Desk,
) -> Meaning:
    """A place set by hand, or another peak: the seat stays, to look at what it did."""
    if isinstance(gesture, MarkPlaced | MarkJudged):
        decision, notice = marked(gesture, desk.state, desk.origins)
        return Meaning(seat, decision=decision, notice=notice)
    point_id, photo_id = gesture.key
    if gesture.key in desk.state.extra.measurements:
        return Meaning(seat, notice=Notice("notice.yes-or-no"))
    if point_id not in desk.state.block.surveyed or photo_id not in desk.drawn:
        return Meaning(seat)
    seat = replace(seat, current=gesture.key, explaining=None)
    if isinstance(gesture, PeakChosen):
        measurement = desk.state.block.measurements.get(gesture.key)
        if measurement is None or not 0 <= gesture.index < len(measurement.peaks):
            return Meaning(seat)
        return Meaning(seat, decision=ChoosePeak(point_id, photo_id, gesture.index))
    if isinstance(gesture, PlacedOnGround):
        plane = np.array([[gesture.east, gesture.north]])
        pixel = pixel_from_ground(plane, desk.drawn[photo_id], desk.dem)[0]
    else:
        pixel = np.array([gesture.column, gesture.row])
    columns, rows = desk.drawn[photo_id].photo.size_px
    if not (0 <= pixel[0] <= columns and 0 <= pixel[1] <= rows):
        return Meaning(seat, notice=Notice("notice.outside", {"scan": photo_id}, grave=True))
    return Meaning(seat, decision=Place(point_id, photo_id, float(pixel[0]), float(pixel[1])))


def _refine(gesture: Refined, seat: Seat, desk: Desk) -> Meaning:
    """The measurement on the peak of likeness beside it, and by how much that moved it."""
    measurement = desk.state.block.measurements.get(gesture.key)
    point = desk.state.block.surveyed.get(gesture.key[0])
    oriented = desk.state.oriented
    if desk.likeness is None or measurement is None or point is None:
        return Meaning(seat)
    photo, camera = oriented.photos[gesture.key[1]], oriented.camera_of(gesture.key[1])
    likeness = desk.likeness(photo, camera, point.position[None, :])
    found = likeness if isinstance(likeness, Failure) else likeness.refined(measurement.pixel)
    seat = replace(seat, current=gesture.key, explaining=None)
    if isinstance(found, Failure):
        return Meaning(seat, notice=Notice("notice.not-refined", {"why": found.reason}))
    column, row = (float(value) for value in found[0])
    moved = column - measurement.column, row - measurement.row
    values = {
        "distance": f"{np.hypot(*moved):.2f}",
        "column": f"{moved[0]:+.2f}",
        "row": f"{moved[1]:+.2f}",
    }
    notice = Notice("notice.refined", values)
    return Meaning(seat, decision=Place(*gesture.key, column, row), notice=notice)


def _switch_role(gesture: RoleSwitched, seat: Seat, desk: Desk) -> Meaning:
    point = desk.state.block.surveyed.get(gesture.point_id)
    if point is None:
        return Meaning(seat)
    role = "check" if point.role == "control" else "control"
    return Meaning(replace(seat, explaining=None), decision=SetRole(gesture.point_id, role))


def _pick(gesture: RayPicked, seat: Seat, desk: Desk) -> Meaning:
    """A click in 3D: the measurement of a point nearest in doubt, or the worst of a photo."""
    found = pick(gesture.origin, gesture.direction, desk.state.oriented, seat.scene.hidden)
    if found is None:
        return Meaning(seat)
    key = _worst(found, seat, desk)
    if key is None:
        return Meaning(seat, notice=Notice("notice.nothing-measured", {"name": found.name}))
    return Meaning(replace(seat, current=key))


def _worst(found: Picked, seat: Seat, desk: Desk) -> Key | None:
    """The most doubtful measurement of what was picked; a point keeps the photo looked at."""
    place = 0 if found.kind == "point" else 1
    rows = [row for row in desk.rows.values() if row.key[place] == found.name]
    if not rows:
        return None
    photo_id = seat.current[1] if seat.current else ""
    best = max(rows, key=lambda row: (place == 0 and row.key[1] == photo_id, row.gain, row.doubt))
    return best.key


def _with_scene(gesture: LayerSwitched | VectorsScaled, seat: Seat) -> Seat:
    if isinstance(gesture, VectorsScaled):
        return replace(seat, scene=replace(seat.scene, vector_scale=gesture.scale))
    hidden = seat.scene.hidden - {gesture.layer}
    if not gesture.shown:
        hidden = hidden | {gesture.layer}
    return replace(seat, scene=replace(seat.scene, hidden=frozenset(hidden)))


def _moved(gesture: Gesture, seat: Seat, desk: Desk) -> Seat:
    """Walks through the queue, sorting and sieving, and the like: nothing is decided."""
    match gesture:
        case LayerSwitched() | VectorsScaled():
            return _with_scene(gesture, seat)
        case Named(name=name):
            return replace(seat, operator=name)
        case QualityAsked(shown=shown, pair=pair):
            return replace(seat, quality=shown, pair=pair or seat.pair)
        case SheetAsked(sheet=sheet, shown=shown):
            return replace(seat, sheet=sheet if shown else "")
        case Stepped(step=step):
            current = neighbour(visible(desk.rows, seat), seat, step)
            return replace(seat, current=current or seat.current)
        case Selected(key=key) if key in desk.rows:
            return replace(seat, current=key)
        case Sorted(column=column, descending=descending):
            sorting = Sorting(column, descending)
            return replace(seat, sorting=sorting, order=ordered(desk.rows.values(), sorting))
        case Filtered(state=state, photo_id=photo_id, role=role):
            seat = replace(seat, sieve=Sieve(state, photo_id, role))
            shown = visible(desk.rows, seat)
            if seat.current in shown:
                return seat
            # Where nothing is left nothing is shown; then one is back where one was.
            wanted = seat.left if seat.current is None else seat.current
            current = wanted if wanted in shown else next(iter(shown), None)
            return replace(seat, current=current, left=wanted)
        case _:
            return seat
