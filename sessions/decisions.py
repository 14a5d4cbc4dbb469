"""Decisions of the operator as frozen values; the session appends and replays them."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

from core.block import Measurement, Role
from core.formats.listed_point import ListedPoint
from core.mosaic.seam_edits import SeamEdit
from core.quality.check_plan import CheckPlace
from core.scans.judging import FiducialMeasurement
from core.sheets.acceptance import DrawnSheet, SamplingPlan

Reason = Literal["wrong object", "changed", "hidden", "blurred", "other"]
"""Why a measurement is rejected."""
REASONS: tuple[Reason, ...] = get_args(Reason)
NOT_VISIBLE = "not visible"
"""Reason of a measurement whose point cannot be seen in the photo at all."""


@dataclass(frozen=True, slots=True)
class Accept:
    """The measurement is right."""

    point_id: str
    """The surveyed point."""
    photo_id: str
    """The photo."""
    column: float | None = None
    """Where it lay then, pixels: no later proposal moves it. None accepts what is proposed."""
    row: float | None = None
    """As `column`."""


@dataclass(frozen=True, slots=True)
class Reject:
    """The measurement is wrong."""

    point_id: str
    """The surveyed point."""
    photo_id: str
    """The photo."""
    reason: Reason
    """Why."""


@dataclass(frozen=True, slots=True)
class MarkDubious:
    """The operator cannot say; the measurement is not used."""

    point_id: str
    """The surveyed point."""
    photo_id: str
    """The photo."""


@dataclass(frozen=True, slots=True)
class MarkNotVisible:
    """The point cannot be seen in this photo."""

    point_id: str
    """The surveyed point."""
    photo_id: str
    """The photo."""


@dataclass(frozen=True, slots=True)
class Place:
    """The operator's own measurement."""

    point_id: str
    """The surveyed point."""
    photo_id: str
    """The photo."""
    column: float
    """Pixels, corner origin."""
    row: float
    """Pixels, corner origin."""
    sigma_px: float | None = None
    """Standard deviation per axis, pixels, of a measurement moved onto the peak it lay beside, or
    of a proposal that was accepted; None where a hand placed it."""
    seen: bool = True
    """False for a proposal accepted with others: nobody looked at it."""


@dataclass(frozen=True, slots=True)
class ChoosePeak:
    """Another of the engine's candidates is the right one."""

    point_id: str
    """The surveyed point."""
    photo_id: str
    """The photo."""
    index: int
    """Index into the peaks of the measurement as it was shown."""
    column: float | None = None
    """Where that peak lay, pixels: finds it again when a later run orders its peaks otherwise."""
    row: float | None = None
    """As `column`."""


@dataclass(frozen=True, slots=True)
class SetRole:
    """The surveyed point steers (control) or only judges (check)."""

    point_id: str
    """The surveyed point."""
    role: Role
    """Control or check."""


@dataclass(frozen=True, slots=True)
class AddPoint:
    """A new point: chosen in the reference ortho and measured by the program in every scan.

    Or a detail of photos, whose coordinates are not known at all (`sigma_m` of `UNKNOWN_M`): then
    its measurements give them, and the coordinates here only say where about it is.
    """

    point_id: str
    """Its name, new in the block."""
    east: float
    """Easting, metres."""
    north: float
    """Northing, metres."""
    height: float
    """Height of the DEM there, metres."""
    sigma_m: tuple[float, float, float]
    """A-priori standard deviations of the three, metres."""
    measured: tuple[Measurement, ...]
    """What was found in each scan that shows it: kept, so that it need not be found again."""


@dataclass(frozen=True, slots=True)
class BringPoints:
    """Surveyed points of the user's own, new or in place of those of the same names."""

    points: tuple[ListedPoint, ...]
    """The points, in the block's CRS."""
    source: str
    """Name of the list they came from; empty where they were typed."""


@dataclass(frozen=True, slots=True)
class JudgeTie:
    """A tie point is right, or is not to be used."""

    photo_id: str
    """A photo that shows it."""
    column: float
    """Where one of its rays was measured, pixels: tie points have no lasting names."""
    row: float
    """As `column`."""
    use: bool
    """Whether it takes part."""


@dataclass(frozen=True, slots=True)
class JudgePhoto:
    """A photo lies where it should, or is not to be used."""

    photo_id: str
    """The photo."""
    use: bool
    """Whether it takes part."""


@dataclass(frozen=True, slots=True)
class JudgeFiducial:
    """A fiducial was measured rightly, or is not to be used."""

    photo_id: str
    """The photo."""
    name: str
    """The mark, as the certificate names it."""
    use: bool
    """Whether it takes part."""


@dataclass(frozen=True, slots=True)
class PlaceFiducial:
    """The operator's own measurement of a fiducial."""

    photo_id: str
    """The photo."""
    name: str
    """The mark, as the certificate names it."""
    column: float
    """Pixels, corner origin."""
    row: float
    """Pixels, corner origin."""


@dataclass(frozen=True, slots=True)
class DrawMask:
    """Part of a scan, or of every scan of a camera, is no photograph; or is one after all."""

    subject: str
    """The photo, or the camera where `on_film`."""
    outline: tuple[tuple[float, float], ...]
    """Corners, or the middle line of a brush: scan pixels, film millimetres where `on_film`."""
    width: float
    """Of the brush, in the same unit; 0 for an outline that is filled."""
    hides: bool
    """False for the eraser."""
    on_film: bool = False
    """Whether it holds for every scan of a camera."""


@dataclass(frozen=True, slots=True)
class PlacePhoto:
    """A photo lies where the same places were clicked in it and in the ortho."""

    photo_id: str
    """The photo."""
    pairs: tuple[tuple[float, float, float, float], ...]
    """Column, row, easting, northing; none gives the photo back to its sources."""


@dataclass(frozen=True, slots=True)
class FillMarks:
    """The marks of a camera that are like one which the operator pointed at."""

    camera: str
    """Name of the camera."""
    photo_id: str
    """The photo with the example."""
    column: float
    """Middle of the example, pixels, corner origin."""
    row: float
    """As `column`."""
    found: Mapping[str, tuple[FiducialMeasurement, ...]]
    """What was found, by photo: kept, so that it need not be found again."""
    places_mm: Mapping[str, tuple[float, float]] = field(
        default_factory=dict[str, tuple[float, float]]
    )
    """Where marks lie on the film, millimetres, by the roll; empty where a certificate says so."""
    sigma_mm: float = 0.0
    """Standard deviation of such a place per axis, millimetres."""


@dataclass(frozen=True, slots=True)
class PlanChecks:
    """Places at which the mosaic is to be checked; a later plan stands beside it."""

    places: tuple[CheckPlace, ...]
    """The places and their spares; their names bear the number of the plan."""
    cells: tuple[int, int]
    """Columns and rows of the grid they were drawn on; (0, 0) for a list of the user."""
    seed: int
    """What they were drawn with."""
    source: str
    """Name of the user's list; empty where they were drawn."""
    beforehand: bool
    """Whether no control had been searched yet."""
    digest: str
    """Of all this: two plans are the same when it is."""

    @property
    def count(self) -> int:
        """Places without the spares."""
        return sum(not place.after for place in self.places)

    @property
    def number(self) -> str:
        """Its number in the session, with which the names of its places begin."""
        return self.places[0].place_id.partition("-")[0] if self.places else ""


@dataclass(frozen=True, slots=True)
class ReadCheck:
    """The same detail in mosaic and reference, as one observer saw it; or that there is none."""

    place_id: str
    """The place of the plan."""
    mosaic: tuple[float, float] | None
    """Easting and northing of the detail in the mosaic, metres; None where none is to be seen."""
    reference: tuple[float, float] | None
    """Easting and northing in the reference, or of the surveyed point, metres; None likewise."""
    version: str
    """Of the mosaic that was looked at."""
    reason: str = ""
    """Why nothing could be read."""


@dataclass(frozen=True, slots=True)
class DrawSheets:
    """A sample of the block's map sheets, drawn to be judged for all; a later one replaces it."""

    plan: SamplingPlan
    """How many were drawn of how many, and how many may be bad."""
    sheets: tuple[DrawnSheet, ...]
    """The sheets, in the order of their names."""
    seed: int
    """What they were drawn with."""
    lot: str
    """Digest of all sheets of the lot."""
    digest: str
    """Of all this: two samples are the same when it is."""

    @property
    def count(self) -> int:
        """Sheets that were drawn."""
        return len(self.sheets)


@dataclass(frozen=True, slots=True)
class JudgeSheet:
    """A drawn sheet is good, or is not, as one saw it in the mosaic."""

    sheet: str
    """Its name."""
    good: bool
    """What is said."""
    version: str
    """Of the mosaic that was looked at."""
    words: str = ""
    """Why; empty where nothing is added."""
    lot: str = ""
    """Digest of the lot it was drawn from: a name may be given to other ground."""


Acceptance = Literal["accept", "accept-with-remarks", "reject"]
"""What a reviewer says of a whole block."""
ACCEPTANCES: tuple[Acceptance, ...] = get_args(Acceptance)


@dataclass(frozen=True, slots=True)
class SignBlock:
    """A reviewer's verdict on the block and its mosaic, under the name it is recorded with."""

    verdict: Acceptance
    """What is said."""
    remark: str
    """In the reviewer's words; empty where nothing is added."""
    judged: Mapping[str, str]
    """Digest of each part that was judged."""


Subject = Literal["place", "photo", "point", "decision"]
"""What words are about: a place of the mosaic, a photo, a point, or an earlier decision."""
SUBJECTS: tuple[Subject, ...] = get_args(Subject)
FaultKind = Literal["double", "smear", "cloud", "cut", "tone", "shift", "other"]
"""What is wrong at a place: seen twice, smeared, clouded, cut by a seam, toned, displaced."""
FAULT_KINDS: tuple[FaultKind, ...] = get_args(FaultKind)


@dataclass(frozen=True, slots=True)
class Remark:
    """Free words about something; with a kind they mark a fault, about a fault they answer it."""

    subject: Subject
    """What they are about."""
    name: str
    """The photo, the point, or the number of the decision; empty for a place."""
    words: str
    """What is said."""
    place: tuple[float, float] | None = None
    """Easting and northing of a place, metres."""
    fault: FaultKind | Literal[""] = ""
    """What is wrong there; empty where nothing is."""
    assigned: str = ""
    """Who is asked to mend the fault; empty says nothing of it."""
    closes: bool | None = None
    """Of an answer: the fault is mended, or is open again; None says nothing of it."""


@dataclass(frozen=True, slots=True)
class Withdraw:
    """An earlier decision no longer stands; withdrawing a withdrawal is redo."""

    decision_id: int
    """The decision that is taken back."""


PhotoDecision = Accept | Reject | MarkDubious | MarkNotVisible | Place | ChoosePeak
"""A decision about one point in one photo."""
FiducialDecision = JudgeFiducial | PlaceFiducial | FillMarks
"""A decision about one fiducial of one scan, or about those of a camera that look alike."""
Kinds = tuple[type, ...]
"""Kinds of decisions."""
PointsDecision = SetRole | AddPoint | BringPoints
"""A decision about surveyed points themselves."""
ScanDecision = DrawMask | PlacePhoto
"""A decision about a whole scan: its mask, or where it lies."""
SeamDecision = SeamEdit
"""A decision about the mosaic: a seam along a line, or the photo of a polygon."""
JudgingDecision = PlanChecks | ReadCheck | DrawSheets | JudgeSheet | SignBlock | Remark
"""A decision that judges the block and changes nothing of it."""
Decision = (
    PhotoDecision | PointsDecision | JudgeTie | JudgePhoto | FiducialDecision | ScanDecision
    | SeamDecision | JudgingDecision | Withdraw
)  # fmt: skip
"""Everything an operator can decide."""
DECISIONS: tuple[type, ...] = get_args(Decision)


@dataclass(frozen=True, slots=True)
class Recorded:
    """A decision on disk."""

    decision_id: int
    """Counts upwards in the order of recording, over all operators; never used twice."""
    when: str
    """Time of recording, UTC, ISO 8601."""
    who: str
    """The operator."""
    decision: Decision
    """What was decided."""


def standing(decisions: Sequence[Recorded]) -> tuple[Recorded, ...]:
    """The decisions that stand, withdrawals among them, in order.

    Read backwards, since only a later record can take back an earlier one: a withdrawal that was
    itself withdrawn takes nothing back.
    """
    withdrawn: set[int] = set()
    kept: list[Recorded] = []
    for recorded in reversed(decisions):
        if recorded.decision_id in withdrawn:
            continue
        kept.append(recorded)
        if isinstance(recorded.decision, Withdraw):
            withdrawn.add(recorded.decision.decision_id)
    return tuple(reversed(kept))


def withdrawals(decisions: Sequence[Recorded]) -> Mapping[int, Recorded]:
    """The withdrawal of each decision that no longer stands, by the number of that decision."""
    return {
        item.decision.decision_id: item
        for item in standing(decisions)
        if isinstance(item.decision, Withdraw)
    }


def changing(decisions: Sequence[Recorded]) -> tuple[Recorded, ...]:
    """Records that say something of the block itself: nothing that judges, nor its undoing."""
    judging: set[int] = set()
    kept: list[Recorded] = []
    for item in decisions:
        said = item.decision
        back = isinstance(said, Withdraw) and said.decision_id in judging
        if back or isinstance(said, JudgingDecision):
            judging.add(item.decision_id)
        else:
            kept.append(item)
    return tuple(kept)


def last_to_undo(
    decisions: Sequence[Recorded],
    operator: str,
    kinds: Kinds = (),
    others: Collection[int] = frozenset(),
    own: Collection[int] = frozenset(),
) -> Recorded | None:
    """The operator's last decision that stands, of some kinds or of all, but for some numbers.

    Numbers of `own` are the operator's under whatever name.
    """
    mine = [item for item in standing(decisions) if _is_by(item, operator, others, own)]
    return next((item for item in reversed(mine) if _is_of(item, kinds)), None)


def last_to_redo(
    decisions: Sequence[Recorded],
    operator: str,
    kinds: Kinds = (),
    others: Collection[int] = frozenset(),
    own: Collection[int] = frozenset(),
) -> Recorded | None:
    """The operator's last undo that stands; None once something new was decided after it."""
    plain = {item.decision_id for item in decisions if _is_of(item, kinds)}
    mine = {item.decision_id for item in decisions if _is_by(item, operator, others, own)}
    last_decided = max(plain.intersection(mine), default=0)
    for item in reversed(standing(decisions)):
        undoes = isinstance(item.decision, Withdraw) and item.decision.decision_id in plain
        if item.decision_id in mine and undoes and item.decision_id > last_decided:
            return item
    return None


def _is_by(item: Recorded, operator: str, others: Collection[int], own: Collection[int]) -> bool:
    """True for a decision under the operator's name that nobody else made, or for an own one."""
    number = item.decision_id
    return number not in others and (item.who == operator or number in own)


def _is_of(item: Recorded, kinds: Kinds) -> bool:
    """True for a decision of one of some kinds, of any where there are none."""
    said = item.decision
    return isinstance(said, kinds) if kinds else not isinstance(said, Withdraw)
