"""Apply the operator's standing decisions to the scans and to the block."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from core.block import (
    HAND_SIGMA_PX,
    UNKNOWN_M,
    Block,
    Measurement,
    Peak,
    Photo,
    SurveyedPoint,
    TiePoints,
    surveyed_point,
)
from core.geometry.camera import Camera
from core.localisation.tied_block import stand_on_points
from core.mosaic.seam_edits import SeamArea, SeamLine
from core.said import say
from sessions.decisions import (
    NOT_VISIBLE,
    Accept,
    AddPoint,
    BringPoints,
    ChoosePeak,
    Decision,
    DrawMask,
    DrawSheets,
    FiducialDecision,
    FillMarks,
    JudgeFiducial,
    JudgePhoto,
    JudgeSheet,
    JudgeTie,
    JudgingDecision,
    MarkDubious,
    MarkNotVisible,
    PhotoDecision,
    Place,
    PlaceFiducial,
    PlacePhoto,
    PlanChecks,
    PointsDecision,
    ReadCheck,
    Recorded,
    Reject,
    Remark,
    ScanDecision,
    SeamDecision,
    SetRole,
    SignBlock,
    Withdraw,
    standing,
)
from sessions.readings import SAME_PLACE_PX, placed
from sessions.scan_decisions import (
    Films,
    knows,
    knows_subject,
    standing_masks,
    with_marks,
    with_masks,
    with_placed,
)

SAME_RAY_PX = 1.0
"""Two rays of a photo nearer than this, scan pixels, are the same."""


@dataclass(frozen=True, slots=True, eq=False)
class Replayed:
    """The block as the operators want it, and what they said that finds no place in it."""

    block: Block
    """The block with every decision laid over it."""
    unmatched: tuple[Recorded, ...]
    """Standing decisions whose point, photo or measurement is not proposed at present: kept in the
    session and tried again at every replay."""


def replay(
    block: Block,
    decisions: Sequence[Recorded],
    found: Films | None = None,
    given: Mapping[str, Camera] | None = None,
) -> Replayed:
    """The block with the standing decisions laid over it, in the order they were made.

    Args:
        block: As the engine left it.
        decisions: Everything recorded.
        found: Scans with their fiducials as they were found; see `with_changes`.
        given: The cameras as the block describes them; by default those of the block.
    """
    given = block.cameras if given is None else given
    block = with_placed(block, decisions, given)
    measurements, surveyed = dict(block.measurements), dict(block.surveyed)
    known_photos, unmatched = block.photos, list[Recorded]()
    verdicts = dict[str | int, bool]()
    known = {recorded.decision_id for recorded in decisions}
    # What was measured of a point holds whenever its list comes in again.
    for recorded in standing(decisions):
        if isinstance(recorded.decision, BringPoints):
            _bring_points(surveyed, recorded.decision)
    for recorded in standing(decisions):
        match recorded.decision:
            case Withdraw(decision_id):
                matched = decision_id in known
            case SetRole() | AddPoint() | BringPoints() as decision:
                matched = _change_points(known_photos, surveyed, measurements, decision)
            case JudgeTie() | JudgePhoto() as decision:
                subject = _subject(block, decision)
                matched = subject is not None
                if subject is not None:
                    verdicts[subject] = decision.use
            case (
                JudgeFiducial()
                | PlaceFiducial()
                | FillMarks()
                | DrawMask()
                | PlacePhoto()
                | PlanChecks()
                | ReadCheck()
                | DrawSheets()
                | JudgeSheet()
                | SignBlock()
                | Remark()
                | SeamLine()
                | SeamArea()
            ) as decision:
                matched = _is_known(block, decision)
            case decision:
                matched = _decide(block, surveyed, measurements, decision, recorded=recorded)
        if not matched:
            unmatched.append(recorded)
    block = _without(block, {name for name, use in verdicts.items() if not use})
    block = with_marks(block, decisions, found, given)
    block = replace(block, surveyed=surveyed, measurements=measurements)
    block = with_masks(block, standing_masks(decisions))
    return Replayed(stand_on_points(block, taken_out(decisions)), tuple(unmatched))


def _is_known(
    block: Block, decision: FiducialDecision | ScanDecision | JudgingDecision | SeamDecision
) -> bool:
    """Whether what a decision is about is in this block; a check is always of it."""
    match decision:
        case SeamLine(first=first, second=second):
            return first in block.photos and second in block.photos
        case SeamArea(photo_id=photo_id):
            return photo_id in block.photos
        case JudgeFiducial() | PlaceFiducial() | FillMarks():
            return knows(block, decision)
        case DrawMask() | PlacePhoto():
            return knows_subject(block, decision)
        case _:
            return True


def taken_out(decisions: Sequence[Recorded]) -> frozenset[str]:
    """Photos that somebody does not want to be used."""
    said = [item.decision for item in standing(decisions)]
    last = {one.photo_id: one.use for one in said if isinstance(one, JudgePhoto)}
    return frozenset(name for name, use in last.items() if not use)


def with_place(decision: Decision, block: Block) -> Decision:
    """The decision with the place the operator saw filled in from the block that was on screen.

    What a human has accepted then stays where it was looked at, whatever a later run proposes.
    """
    if not isinstance(decision, (Accept, ChoosePeak)) or decision.column is not None:
        return decision
    measurement = block.measurements.get((decision.point_id, decision.photo_id))
    if measurement is None:
        return decision
    if isinstance(decision, Accept):
        return replace(decision, column=measurement.column, row=measurement.row)
    if not 0 <= decision.index < len(measurement.peaks):
        return decision
    peak = measurement.peaks[decision.index]
    return replace(decision, column=peak.column, row=peak.row)


def _change_points(
    photos: Mapping[str, Photo],
    surveyed: dict[str, SurveyedPoint],
    measurements: dict[tuple[str, str], Measurement],
    decision: PointsDecision,
) -> bool:
    """Change the points themselves; False when the decision has nothing to hold on to."""
    match decision:
        case SetRole():
            return _set_role(surveyed, decision)
        case AddPoint():
            return _add_point(photos, surveyed, measurements, decision)
        case BringPoints():
            return _bring_points(surveyed, decision)


def _set_role(surveyed: dict[str, SurveyedPoint], decision: SetRole) -> bool:
    """Give the point its role; False without a point, or where its coordinates are not known."""
    point = surveyed.get(decision.point_id)
    if point is None or point.role == "new":
        return False
    surveyed[decision.point_id] = replace(point, role=decision.role)
    return True


def _add_point(
    photos: Mapping[str, Photo],
    surveyed: dict[str, SurveyedPoint],
    measurements: dict[tuple[str, str], Measurement],
    decision: AddPoint,
) -> bool:
    """A point by hand with what was measured of it; False when the engine took its name since."""
    known = surveyed.get(decision.point_id)
    if known is not None and known.source != "hand":
        return False
    position = np.array([decision.east, decision.north, decision.height])
    sigma = np.array(decision.sigma_m)
    role = "new" if bool((sigma >= UNKNOWN_M).all()) else "control"
    surveyed[decision.point_id] = SurveyedPoint(decision.point_id, position, sigma, role, "hand")
    for measured in decision.measured:
        if measured.photo_id in photos:
            measurements[measured.key] = measured
    return True


def _bring_points(surveyed: dict[str, SurveyedPoint], decision: BringPoints) -> bool:
    """The user's points under their names; False when another kind of point has one of these."""
    free = [
        point
        for point in decision.points
        if point.point_id not in surveyed or surveyed[point.point_id].source == "surveyed"
    ]
    surveyed.update((point.point_id, surveyed_point(point)) for point in free)
    return len(free) == len(decision.points)


def _decide(
    block: Block,
    surveyed: Mapping[str, SurveyedPoint],
    measurements: dict[tuple[str, str], Measurement],
    decision: PhotoDecision,
    *,
    recorded: Recorded,
) -> bool:
    """Change the measurement the decision is about; False when there is nothing to change."""
    if decision.point_id not in surveyed or decision.photo_id not in block.photos:
        return False
    key = decision.point_id, decision.photo_id
    known = measurements.get(key)
    point = surveyed[decision.point_id]
    dismissed = isinstance(decision, Reject) and (point.source == "surveyed" or point.role == "new")
    if known is None and (dismissed or isinstance(decision, MarkNotVisible)):
        known = _expected(block, point, decision.photo_id)
    decided = _decided(known, decision, recorded)
    if decided is None:
        return False
    measurements[key] = decided
    return True


def _expected(block: Block, point: SurveyedPoint, photo_id: str) -> Measurement | None:
    """Where a point that nobody measured ought to lie, for who says that it is not to be seen."""
    camera = block.camera_of(photo_id)
    pixel = block.photos[photo_id].pixel_from_object(point.position[None], camera)[0]
    if not np.isfinite(pixel).all():
        return None
    column, row = (float(value) for value in pixel)
    return Measurement(point.point_id, photo_id, column, row, HAND_SIGMA_PX, 0.0, "unused")


def _decided(
    proposed: Measurement | None, decision: PhotoDecision, recorded: Recorded
) -> Measurement | None:
    """The measurement after the decision; None when the decision has nothing to hold on to."""
    match decision:
        case Place(sigma_px=sigma) if proposed is not None and sigma is not None:
            return _refined(proposed, decision, sigma, recorded.who)
        case Place():
            return placed(proposed, decision, recorded)
        case Accept(column=column, row=row) if column is not None and row is not None:
            return _held(proposed, decision, column, row)
        case ChoosePeak():
            return _chosen(proposed, decision)
        case _ if proposed is None:
            return None
        case Accept():
            return replace(proposed, status="accepted", reason="", seen=True)
        case Reject(reason=reason):
            return replace(proposed, status="rejected", reason=reason, readings=())
        case MarkNotVisible():
            return replace(proposed, status="rejected", reason=NOT_VISIBLE, readings=())
        case MarkDubious():
            reason = say("dubious to {who}", who=recorded.who)
            return replace(proposed, status="dubious", reason=reason)


def _refined(proposed: Measurement, decision: Place, sigma_px: float, who: str) -> Measurement:
    """A refined measurement remains the engine's: same peak, same score, same weight."""
    return replace(
        proposed, column=decision.column, row=decision.row, sigma_px=sigma_px,
        status="accepted", reason=say("refined by {who}", who=who), readings=(),
    )  # fmt: skip


def _held(
    proposed: Measurement | None, decision: Accept | ChoosePeak, column: float, row: float
) -> Measurement:
    """Accepted where the operator saw it, even when the engine has since gone elsewhere."""
    if proposed is None:
        return Measurement(
            decision.point_id, decision.photo_id, column, row, HAND_SIGMA_PX, status="accepted"
        )
    if isinstance(decision, Accept) and _near(proposed, column, row):
        return replace(proposed, status="accepted", reason="", seen=True)
    peaks = [peak for peak in proposed.peaks if _near(peak, column, row)]
    if not peaks:
        return replace(
            proposed, column=column, row=row, sigma_px=HAND_SIGMA_PX, status="accepted",
            reason="", readings=(),
        )  # fmt: skip
    nearest = min(peaks, key=lambda peak: (peak.column - column) ** 2 + (peak.row - row) ** 2)
    return _at_peak(proposed, nearest)


def _chosen(proposed: Measurement | None, decision: ChoosePeak) -> Measurement | None:
    """Moved to the peak: by its place where that is known, else by its index."""
    if decision.column is not None and decision.row is not None:
        return _held(proposed, decision, decision.column, decision.row)
    if proposed is None or not 0 <= decision.index < len(proposed.peaks):
        return None
    return _at_peak(proposed, proposed.peaks[decision.index])


def _at_peak(proposed: Measurement, peak: Peak) -> Measurement:
    """The measurement at one of its peaks, accepted."""
    return replace(
        proposed, column=peak.column, row=peak.row, sigma_px=peak.sigma_px, status="accepted",
        reason="", readings=(),
    )  # fmt: skip


def _near(place: Measurement | Peak, column: float, row: float) -> bool:
    """True when a measurement or peak lies on the place."""
    return (place.column - column) ** 2 + (place.row - row) ** 2 <= SAME_PLACE_PX**2


def _subject(block: Block, decision: JudgeTie | JudgePhoto) -> str | int | None:
    """The photo, or the number of the tie point, that a verdict is about; None without it."""
    photo_id = decision.photo_id
    if isinstance(decision, JudgeTie):
        return tie_at(block.ties, photo_id, decision.column, decision.row)
    return photo_id if photo_id in block.photos else None


def _without(block: Block, subjects: Collection[str | int]) -> Block:
    """Without photos and tie points that are not to be used; other ties keep their numbers."""
    if not subjects:
        return block
    photos = {
        name: replace(photo, oriented=False) if name in subjects else photo
        for name, photo in block.photos.items()
    }
    wrong = [subject for subject in subjects if isinstance(subject, int)]
    ties = block.ties.kept(~np.isin(block.ties.point, wrong))
    return replace(block.with_photos(photos), ties=ties)


def tie_at(ties: TiePoints, photo_id: str, column: float, row: float) -> int | None:
    """Number of the tie point that has a ray at a pixel of a photo; None without one."""
    if photo_id not in ties.photo_ids:
        return None
    rays = np.flatnonzero(ties.photo == ties.photo_ids.index(photo_id))
    away = np.hypot(*(ties.pixels[rays] - (column, row)).T)
    if not len(away) or float(away.min()) > SAME_RAY_PX:
        return None
    return int(ties.point[rays[int(np.argmin(away))]])
