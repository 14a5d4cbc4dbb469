"""The meaning of a gesture: a changed seat, perhaps a decision, perhaps an act of the loop."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Literal

import numpy as np

from core.arrays import PixelPoints
from sessions.decisions import (
    REASONS,
    Accept,
    ChoosePeak,
    Decision,
    JudgeFiducial,
    Place,
    PlaceFiducial,
    Reject,
    SetRole,
    Withdraw,
)
from ui.review import mosaic, sight
from ui.review.check_gestures import BlockSigned, CheckRead, Remarked, Reviewed, SheetJudged
from ui.review.checking import decided_judgement
from ui.review.compare import pixel_from_ground
from ui.review.doubtful import verdict_on
from ui.review.drafts import lies_against, mark_effect
from ui.review.drawing import MaskDrawn, decided_mask
from ui.review.gestures import (
    Aimed,
    AnswerAsked,
    Dropped,
    Explained,
    Filtered,
    Fitted,
    Freed,
    Gesture,
    Judged,
    JudgedTogether,
    LayerSwitched,
    Named,
    PeakChosen,
    PhotoEntered,
    PlacedInScan,
    PlacedOnGround,
    PointAsked,
    QualityAsked,
    Redone,
    Refined,
    ReliefRaised,
    RemakeAsked,
    RemakeCancelled,
    RoleSwitched,
    SceneGesture,
    Selected,
    SheetAsked,
    Sorted,
    Stepped,
    TakenBack,
    ThemeChosen,
    Undone,
    VectorsScaled,
)
from ui.review.history import asked_back, own_rejections
from ui.review.mark_gestures import MarkDropped, MarkGesture, MarkJudged, MarkPlaced
from ui.review.new_points import begun
from ui.review.picture import Part
from ui.review.queue import UNDECIDED, coming, neighbour, next_open, showing, sort_keys, with_filter
from ui.review.snapshot import DeskSnapshot
from ui.review.state import Draft, Key, Notice, Seat
from ui.review.to_measure import WAITING, by_view
from ui.review.trial import is_to_be_asked
from ui.review.verdicts import decision_of, not_placed, refusal, standing_verdict

Act = Literal[
    "", "undo", "redo", "remake", "cancel", "fit whole", "fit current",
    "cancel filling", "measure", "fill", "free", "answer",
]  # fmt: skip
"""What the loop shall do beyond recording a decision."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a gesture comes to."""

    seat: Seat
    """The seat afterwards."""
    decisions: tuple[Decision, ...] = ()
    """To be recorded, as one act, before anything is shown."""
    act: Act = ""
    """What else the loop shall do."""
    notice: Notice | None = None
    """What to tell the operator."""
    left: tuple[Notice, ...] = ()
    """Why some of several were left as they are."""
    answer: tuple[str, Part] | None = None
    """Name and content of what only answers this gesture, for the page to show."""


def outcome_of(gesture: Gesture, seat: Seat, desk: DeskSnapshot) -> Outcome:
    """What a gesture of one seat comes to now."""
    match gesture:
        case Judged():
            return _judge_one(gesture, seat, desk)
        case JudgedTogether():
            return _judge_together(gesture, seat, desk)
        case Explained():
            return _explain(gesture, seat, desk)
        case PlacedInScan() | PlacedOnGround() | PeakChosen():
            return _place(gesture, seat, desk)
        case MarkPlaced() | MarkDropped() | MarkJudged() | MaskDrawn() | mosaic.SeamDrawn():
            return _mark(gesture, seat, desk)
        case PointAsked() | Refined():
            return _measure(gesture, seat, desk)
        case RoleSwitched():
            return _switch_role(gesture, seat, desk)
        case TakenBack() | CheckRead() | SheetJudged() | BlockSigned() | Remarked():
            return _record(gesture, seat, desk)
        case Aimed() | mosaic.MosaicPicked() | sight.Outlined():
            return _aim(gesture, seat, desk)
        case _:
            return _act(gesture, seat, desk)


def _record(gesture: TakenBack | Reviewed, seat: Seat, desk: DeskSnapshot) -> Outcome:
    """A decision turned round, or one that judges the block and changes nothing of it."""
    if isinstance(gesture, TakenBack):
        number, again = gesture.decision_id, gesture.again
        decided, seat, notice = asked_back(number, desk.recorded, seat, again=again)
        return Outcome(seat, decided, notice=notice)
    decided, notice = decided_judgement(gesture, desk, seat.operator)
    return Outcome(seat, decided, notice=notice)


def _act(gesture: Gesture, seat: Seat, desk: DeskSnapshot) -> Outcome:
    """What only the loop can do, drafts given up, and walks that decide nothing."""
    match gesture:
        case Dropped(key=key):
            return Outcome(seat.without_draft(key))
        case Freed():
            return Outcome(seat, act="free")
        case AnswerAsked():
            return Outcome(seat, act="answer")
        case Undone(asked=asked):
            turning = seat.turning if asked else None
            return Outcome(replace(seat, explaining=(), turning=turning), act="undo")
        case Redone():
            return Outcome(replace(seat, explaining=()), act="redo")
        case RemakeAsked():
            return Outcome(seat, act="remake")
        case RemakeCancelled(filling=filling):
            return Outcome(seat, act="cancel filling" if filling else "cancel")
        case Fitted(whole=whole):
            seat = _with_photo(seat, seat.scene.photo)
            return Outcome(seat, act="fit whole" if whole else "fit current")
        case _:
            return Outcome(_moved(gesture, seat, desk))


def _judge_one(gesture: Judged, seat: Seat, desk: DeskSnapshot) -> Outcome:
    """Record the verdict and go on; a key pressed again on a point already left does nothing."""
    key, verdict = gesture.key, gesture.verdict
    measurement = desk.state.measurement_of(key)
    if measurement is None or key not in desk.rows:
        return Outcome(seat)
    if notice := refusal(desk.state, seat, desk.rows[key].state, measurement, verdict):
        return Outcome(seat, notice=notice)
    extra, begins = key in desk.state.extra.measurements, seat.begun.get(key[0])
    draft = seat.draft_of(key) if verdict == "accept" else None
    if draft and _is_asked(draft, seat, desk):
        return Outcome(replace(seat, asking=draft))
    stands = not draft and standing_verdict(measurement) == verdict
    here = key == seat.current
    after = replace(seat, current=_next_open(seat, desk)) if here else seat
    rejected = verdict == "reject" and not stands and not extra
    after = replace(after.without_draft(key), explaining=(key,) if rejected else ())
    last = here and desk.rows[key].state in UNDECIDED and not any(coming(desk.rows, seat))
    notice = Notice("notice.queue-done") if last else None
    if draft:
        decided = draft.decision
    elif extra:
        decided = verdict_on(desk.state.extra, key, verdict == "accept")
    else:
        decided = decision_of(verdict, key)
        if verdict == "accept" and desk.state.is_waiting(key):
            decided = Place(*key, measurement.column, measurement.row, measurement.sigma_px)
        if isinstance(decided, Accept | Place) and _lies_against(key, desk):
            asked = seat.with_draft(Draft(key, decided))
            return Outcome(replace(asked, asking=asked.draft_of(key)))
    if begins:
        after = after.with_recorded(key[0])
    if stands or decided is None:
        return Outcome(after, notice=notice)
    return Outcome(after, (begins, decided) if begins else (decided,), notice=notice)


def _is_asked(draft: Draft, seat: Seat, desk: DeskSnapshot) -> bool:
    return is_to_be_asked(desk.state, seat, draft, desk.recorded, desk.trials.get(draft))


def _lies_against(key: Key, desk: DeskSnapshot) -> bool:
    """True for a measurement that nobody accepted yet and that contradicts the block."""
    state, measurement = desk.state, desk.state.measurement_of(key)
    if measurement is None or standing_verdict(measurement) == "accept":
        return False
    is_control = key not in state.extra.measurements
    return is_control and lies_against(state, desk.table.figures.misfits, key)


def _judge_together(gesture: JudgedTogether, seat: Seat, desk: DeskSnapshot) -> Outcome:
    """One verdict on several, recorded as one act; what contradicts the block is not accepted."""
    decided, done, left = list[Decision](), list[Key](), list[Notice]()
    drafts, far, looked_at, moved = 0, 0, seat.current, False
    for key in sorted(gesture.keys, key=lambda key: seat.order.index(key)):
        draft = seat.draft_of(key) if gesture.verdict == "accept" else None
        if draft and _is_asked(draft, seat, desk):
            drafts += 1
            continue
        if gesture.verdict == "accept" and not draft and _lies_against(key, desk):
            far += 1
            continue
        one = _judge_one(Judged(seat.seat_id, key, gesture.verdict), seat, desk)
        unseen = draft is None and key != looked_at
        decided += [
            replace(made, seen=False) if unseen and isinstance(made, Place) else made
            for made in one.decisions
        ]
        done.append(key)
        moved = moved or one.seat.current != looked_at
        seat = replace(one.seat, current=looked_at)
        if one.notice and one.notice not in left:
            left.append(one.notice)
    counted = ("notice.still-drafts", drafts), ("notice.far-off", far)
    left += [Notice(text, {"count": f"{count}"}) for text, count in counted if count]
    if moved:
        seat = replace(seat, current=_next_open(seat, desk, done))
    asked = [(one.point_id, one.photo_id) for one in decided if isinstance(one, Reject)]
    # One reason for all, where there is nothing else among them.
    seat = replace(seat, explaining=tuple(asked) if len(asked) == len(decided) else ())
    return Outcome(seat, tuple(decided), left=tuple(left))


def _next_open(seat: Seat, desk: DeskSnapshot, done: Sequence[Key] = ()) -> Key | None:
    """What is next that nobody has looked at, the same point's best view first; or simply next."""
    rows, left = desk.rows, {*desk.taken(seat.seat_id), *done}
    left = left if any(coming(rows, seat, left)) else set(done)
    beside = desk.table.by_point.get(seat.current[0], ()) if seat.current else ()
    waiting = {key for key in beside if key in rows and rows[key].state in WAITING}
    same = [key for key in coming(rows, seat, left) if key in waiting] if waiting else []
    following = (*by_view(desk.state.to_measure, same), *islice(coming(rows, seat, left), 1))
    return following[0] if following else neighbour(rows, seat, +1)


def _explain(gesture: Explained, seat: Seat, desk: DeskSnapshot) -> Outcome:
    """Rejections with their reason, in place of those just made, where they stand: one act."""
    made = own_rejections(seat.explaining, seat.operator, desk.recorded)
    seat = replace(seat, explaining=())
    if not made or not 1 <= gesture.digit <= len(REASONS):
        # What was done last, before the page heard of it, has closed the question.
        return Outcome(seat, notice=Notice("notice.no-reason"))
    rejected = (Reject(*key, reason=REASONS[gesture.digit - 1]) for key in made)
    return Outcome(seat, (*map(Withdraw, made.values()), *rejected))


def _mark(
    gesture: MarkGesture | MaskDrawn | mosaic.SeamDrawn,
    seat: Seat,
    desk: DeskSnapshot,
) -> Outcome:
    """A fiducial in use or not, or a draft of its place; what was drawn on scan or mosaic."""
    block = desk.state.block
    if isinstance(gesture, mosaic.SeamDrawn):
        edit, notice = mosaic.decided_seam(gesture, desk)
        return Outcome(seat, () if edit is None else (edit,), notice=notice)
    if isinstance(gesture, MaskDrawn):
        return Outcome(seat, decided_mask(gesture, block))
    photo = block.photos.get(gesture.photo_id)
    if photo is None:
        return Outcome(seat)
    known = (*block.camera_of(gesture.photo_id).fiducials_mm, *photo.interior.names)
    fill = isinstance(gesture, MarkPlaced) and gesture.fill
    if gesture.name not in known and not fill:
        return Outcome(seat)
    mark = gesture.photo_id, gesture.name
    if isinstance(gesture, MarkDropped):
        return Outcome(seat.without_mark(*mark))
    if isinstance(gesture, MarkJudged):
        drafted = seat.mark_of(*mark) if gesture.use else None
        known = desk.state, desk.initial, desk.recorded
        if drafted and seat.asking != drafted and mark_effect(*known, drafted).is_against:
            return Outcome(replace(seat, asking=drafted))
        judged = JudgeFiducial(*mark, gesture.use)
        return Outcome(seat.without_mark(*mark), (drafted or judged,))
    place = gesture.column, gesture.row
    if not lies_within(*place, photo.size_px):
        return _outside(seat, gesture.photo_id)
    if gesture.snap or fill:
        return Outcome(seat, act="fill" if fill else "measure")
    return Outcome(seat.with_mark(PlaceFiducial(*mark, *place)))


def lies_within(column: float, row: float, size_px: tuple[int, int]) -> bool:
    """True for a pixel on a scan."""
    return 0 <= column <= size_px[0] and 0 <= row <= size_px[1]


def _outside(seat: Seat, photo_id: str) -> Outcome:
    return Outcome(seat, notice=Notice("notice.outside", {"scan": photo_id}, grave=True))


def _place(
    gesture: PlacedInScan | PlacedOnGround | PeakChosen, seat: Seat, desk: DeskSnapshot
) -> Outcome:
    """A place set by hand, or another peak: a draft, until a verdict keeps it."""
    point_id, photo_id = gesture.key
    if notice := not_placed(desk.state, seat, gesture):
        return Outcome(seat, notice=notice)
    if (gesture.key not in desk.rows and point_id) or photo_id not in desk.drawn:
        return Outcome(seat)
    seat = replace(seat, explaining=())
    if isinstance(gesture, PeakChosen):
        measurement = desk.state.measurement_of(gesture.key)
        if measurement is None or not 0 <= gesture.index < len(measurement.peaks):
            return Outcome(seat)
        return _drafted(seat, ChoosePeak(point_id, photo_id, gesture.index))
    if isinstance(gesture, PlacedOnGround):
        plane = np.array([[gesture.east, gesture.north]])
        pixel = pixel_from_ground(plane, desk.drawn[photo_id], desk.dem)[0]
    else:
        pixel = np.array([gesture.column, gesture.row])
    if not lies_within(float(pixel[0]), float(pixel[1]), desk.drawn[photo_id].photo.size_px):
        return _outside(seat, photo_id)
    if not point_id:
        return _begin(seat, desk, photo_id, pixel[None])
    return _drafted(seat, Place(point_id, photo_id, float(pixel[0]), float(pixel[1])))


def _begin(seat: Seat, desk: DeskSnapshot, photo_id: str, pixel: PixelPoints) -> Outcome:
    """A new point at a detail of a scan."""
    after = begun(seat, desk, photo_id, pixel)
    if after is None or after.current is None:
        return _outside(seat, photo_id)
    told = Notice("notice.begun", {"what": after.current[0]}, draft=after.current)
    return Outcome(after, notice=told)


def _drafted(seat: Seat, decision: Place | ChoosePeak) -> Outcome:
    return Outcome(seat.with_draft(Draft((decision.point_id, decision.photo_id), decision)))


def _measure(gesture: PointAsked | Refined, seat: Seat, desk: DeskSnapshot) -> Outcome:
    """What is looked for in the scans, and so in the background; a refined point is waited for."""
    if isinstance(gesture, PointAsked):
        return Outcome(seat, act="measure")
    if notice := not_placed(desk.state, seat, gesture):
        return Outcome(seat, notice=notice)
    if gesture.key not in desk.rows or gesture.key[0] not in desk.state.block.surveyed:
        return Outcome(seat)
    return Outcome(replace(seat, current=gesture.key, explaining=()), act="measure")


def _switch_role(gesture: RoleSwitched, seat: Seat, desk: DeskSnapshot) -> Outcome:
    if gesture.point_id in desk.state.extra.kinds:
        return Outcome(seat, notice=Notice("notice.yes-or-no"))
    if gesture.point_id in seat.begun:
        told = Notice("notice.only-draft", {"what": gesture.point_id}, draft=seat.current)
        return Outcome(seat, notice=told)
    point = desk.state.block.surveyed.get(gesture.point_id)
    if point is None:
        return Outcome(seat)
    if point.role == "new":
        return Outcome(seat, notice=Notice("notice.no-role", {"what": gesture.point_id}))
    role = "check" if point.role == "control" else "control"
    return Outcome(replace(seat, explaining=()), (SetRole(gesture.point_id, role),))


def _aim(
    gesture: Aimed | mosaic.MosaicPicked | sight.Outlined, seat: Seat, desk: DeskSnapshot
) -> Outcome:
    """What the pointer meets in 3D, or on the mosaic."""
    if isinstance(gesture, sight.Outlined):
        area = sight.area_under(gesture.rays, desk.state.oriented, desk.dem, seat.scene)
        if not area:
            return Outcome(seat, notice=Notice("notice.area.sky"))
        within = with_filter(seat, desk.rows, replace(seat.filter, area=area))
        return Outcome(within, notice=Notice("notice.area"))
    if isinstance(gesture, mosaic.MosaicPicked):
        return Outcome(seat, answer=("picked", mosaic.picked_part(gesture, desk)))
    match gesture.act:
        case "pick":
            return _pick(gesture, seat, desk)
        case "hover":
            return _hover(gesture, seat, desk)
        case "follow":
            return _follow(gesture, seat, desk)


def _pick(gesture: Aimed, seat: Seat, desk: DeskSnapshot) -> Outcome:
    """A click in 3D: the measurement of a point nearest in doubt, or a photo and its worst.

    Beside both, the photo that was chosen is let go.
    """
    found = sight.pick(gesture.origin, gesture.direction, desk.state.oriented, seat.scene)
    if found is None:
        return Outcome(seat if seat.scene.inside else _with_photo(seat, ""))
    if found.kind == "photo":
        seat = _with_photo(seat, found.name)
    key = sight.worst_of(found, seat, desk)
    if key is None:
        return Outcome(seat, notice=Notice("notice.nothing-measured", {"name": found.name}))
    after = showing(seat, desk.rows, key)
    told = Notice("notice.filter", {"name": found.name}) if after.filter != seat.filter else None
    return Outcome(after, notice=told)


def _hover(gesture: Aimed, seat: Seat, desk: DeskSnapshot) -> Outcome:
    """What lies under the pointer in 3D."""
    found = sight.pick(gesture.origin, gesture.direction, desk.state.oriented, seat.scene)
    card = {} if found is None else sight.card_part(found, seat, desk)
    return Outcome(seat, answer=("card", {"number": gesture.number, **card}))


def _follow(gesture: Aimed, seat: Seat, desk: DeskSnapshot) -> Outcome:
    """A double click in 3D: into the photo, out of it, or the photos that see the place."""
    if seat.scene.inside:
        return Outcome(_with_photo(seat, seat.scene.photo))
    block, scene = desk.state.oriented, seat.scene
    ray = gesture.origin, gesture.direction
    found = sight.pick(*ray, block, scene)
    if found is not None and found.kind == "photo":
        return Outcome(_with_photo(seat, found.name, inside=True))
    place = sight.ground_under(*ray, block, desk.dem, scene)
    if place is None:
        return Outcome(seat)
    seen = sight.sight_part(place, sight.photos_over(place, block, desk.dem))
    return Outcome(seat, answer=("sight", {"number": gesture.number, **seen}))


def _with_photo(seat: Seat, photo_id: str, inside: bool = False) -> Seat:
    """The seat with a photo chosen in its scene, and the eye inside or outside of it."""
    scene = replace(seat.scene, photo=photo_id, inside=photo_id if inside else "")
    return replace(seat, scene=scene)


def _with_scene(gesture: SceneGesture, seat: Seat, desk: DeskSnapshot) -> Seat:
    """The seat with its scene as a gesture wants it."""
    match gesture:
        case VectorsScaled(scale=scale):
            return replace(seat, scene=replace(seat.scene, vector_scale=scale))
        case ReliefRaised(relief=relief):
            return replace(seat, scene=replace(seat.scene, relief=relief))
        case ThemeChosen(light=light):
            return replace(seat, scene=replace(seat.scene, light=light))
        case PhotoEntered(photo_id=photo_id) if photo_id in desk.state.block.photos:
            return _with_photo(seat, photo_id, inside=True)
        case PhotoEntered():
            return _with_photo(seat, seat.scene.photo)
        case LayerSwitched(layer=layer, shown=shown):
            hidden = seat.scene.hidden - {layer} if shown else seat.scene.hidden | {layer}
            rays = gesture.rays if layer == "ties" else seat.scene.rays
            return replace(seat, scene=replace(seat.scene, hidden=hidden, rays=rays))


def _moved(gesture: Gesture, seat: Seat, desk: DeskSnapshot) -> Seat:
    """Walks through the queue, sorting and filtering, and the like: nothing is decided."""
    match gesture:
        case LayerSwitched() | VectorsScaled() | ReliefRaised() | PhotoEntered() | ThemeChosen():
            return _with_scene(gesture, seat, desk)
        case Named(name=name):
            return replace(seat, operator=name)
        case QualityAsked(shown=shown, pair=pair):
            return replace(seat, quality=shown, pair=pair or seat.pair)
        case mosaic.NearAsked():
            return mosaic.near_place(gesture, seat, desk)
        case SheetAsked(sheet=sheet, shown=shown):
            return replace(seat, sheet=sheet if shown else "")
        case Stepped(step=step, undecided=undecided):
            current = (
                next_open(desk.rows, seat)
                if undecided and step > 0
                else neighbour(desk.rows, seat, step)
            )
            return replace(seat, current=current or seat.current)
        case Selected(key=key) if key in desk.rows:
            return showing(seat, desk.rows, key)
        case Sorted(column=column, descending=descending):
            sorting = replace(seat.sorting, column=column, descending=descending)
            return replace(seat, sorting=sorting, order=sort_keys(desk.rows.values(), sorting))
        case Filtered(wanted=wanted):
            return with_filter(seat, desk.rows, wanted)
        case _:
            return seat
