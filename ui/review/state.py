"""State of the desk and of each seat, as frozen values."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

from core.adjustment.adjusted import OUT, AdjustmentReport
from core.adjustment.expected_gain import Gain
from core.adjustment.influence import Influence
from core.block import Block, Measurement, Photo, SurveyedPoint
from core.control.prediction import Covariances, Prediction
from core.geometry.camera import Camera
from core.geometry.crs import Bounds
from core.geometry.exterior import ExteriorOrientation
from core.mosaic.composition import MosaicProduct
from core.mosaic.fault_places import FaultPlace
from core.mosaic.seam_edits import SeamEdit
from core.mosaic.seams import Seam
from core.orthos.rectification import OrthoProduct
from core.raster.holes import Hole
from core.said import say
from core.scans.interior_orientation import ScanOrientation
from sessions.checks import results_digest
from sessions.decisions import Accept, AddPoint, ChoosePeak, Place, PlaceFiducial
from ui.review.looks import ShownState

Key = tuple[str, str]
"""Point and photo: what names a measurement."""
Made = Mapping[str, tuple[Photo, Camera]]
"""Photos, each with the orientation and the camera its ortho was made with."""
Kind = Literal["control", "check", "new", "tie", "photo", "fiducial"]
"""What a row of the queue is about."""
KINDS: tuple[Kind, ...] = get_args(Kind)
POINT_KINDS: tuple[Kind, ...] = ("control", "check", "new")
SortColumn = Literal["gain", "doubt", "misfit", "photo", "point", "score", "distance"]
SORT_COLUMNS: tuple[SortColumn, ...] = get_args(SortColumn)
StateFilter = Literal[
    "open", "measure", "second", "all", "disputed", "unchecked", "accepted", "rejected", "dubious",
    "unused",
]  # fmt: skip
STATE_FILTERS: tuple[StateFilter, ...] = get_args(StateFilter)
Sheet = Literal["", "board", "placement", "mask", "mosaic", "checks"]
"""A view laid over the desk, beside that of the block's quality."""
SHEETS: tuple[Sheet, ...] = ("board", "placement", "mask", "mosaic", "checks")
LAYERS: tuple[str, ...] = (
    "terrain", "hillshade", "photos", "footprints", "areas", "points", "vectors", "ellipses",
    "checks", "ties", "tie_vectors", "labels", "specials",
)  # fmt: skip
"""Layers of the 3D scene that can be switched."""
Area = tuple[tuple[float, float], ...]
"""Corners on the ground, metres east and north."""
RELIEFS = (1.0, 2.0, 5.0)
"""So many times as high as they are, heights can be drawn."""


@dataclass(frozen=True, slots=True)
class Sorting:
    """How a queue is ordered."""

    column: SortColumn = "gain"
    """What by."""
    descending: bool = True
    """Largest first."""
    place: tuple[float, float] = (math.nan, math.nan)
    """What distances are counted from, metres east and north."""


@dataclass(frozen=True, slots=True)
class QueueFilter:
    """What a queue lets through."""

    state: StateFilter = "open"
    """One state, or all; `open`: used and not looked at, which is what there is to do; `measure`:
    to be measured yet; `second`: placed by one operator alone; `disputed`: accepted by
    a human, contradicted by the block; `unchecked`: no other could find it wrong."""
    photo_id: str = ""
    """One photo, or all when empty."""
    role: str = ""
    """One kind; control and check points when empty."""
    text: str = ""
    """Parts of the point's name, between spaces; all points when empty."""
    area: Area = ()
    """Corners about the points; all points when empty."""

    def is_named(self, point_id: str) -> bool:
        """True when a name holds every part of the text, whatever the case."""
        return all(part in point_id.lower() for part in self.text.lower().split())

    def is_within(self, place: tuple[float, float]) -> bool:
        """True when a place lies inside the area: a line from it to the east crosses it oddly."""
        east, north = place
        crossed = not self.area
        for (e1, n1), (e2, n2) in zip(self.area, self.area[1:] + self.area[:1], strict=True):
            if (n1 > north) != (n2 > north) and east < e1 + (e2 - e1) * (north - n1) / (n2 - n1):
                crossed = not crossed
        return crossed


@dataclass(frozen=True, slots=True)
class SceneOptions:
    """What one seat sees of the 3D scene."""

    hidden: frozenset[str] = frozenset(
        {"hillshade", "areas", "ellipses", "ties", "tie_vectors", "labels", "specials"}
    )
    """Layers that are switched off."""
    vector_scale: float = 20.0
    """Residual vectors on screen are this many times as long as on the ground."""
    relief: float = 1.0
    """Heights on screen are this many times as large."""
    rays: int = 0
    """Only tie points of so many photos are shown; all of them when 0."""
    light: bool = False
    """Whether its ground is light, as its page is."""
    photo: str = ""
    """The chosen photo, whose footprint and points stand out; empty without one."""
    inside: str = ""
    """The photo whose perspective centre the eye is in; empty outside."""

    @property
    def seen_relief(self) -> float:
        """Exaggeration of heights; none in a perspective centre, where the photo must fit."""
        return 1.0 if self.inside else self.relief


@dataclass(frozen=True, slots=True)
class Draft:
    """A place for a measurement that nobody has decided yet: it becomes a decision or is dropped.

    Where the point lies by hand, by refinement or on another peak, scan pixels. Drafts live as long
    as the program runs, and are not in the session.
    """

    key: Key
    """Point and photo."""
    decision: Place | ChoosePeak | Accept
    """What it becomes once it is kept."""
    begins: AddPoint | None = None
    """The new point it is a draft of as well: recorded with it."""


@dataclass(frozen=True, slots=True)
class Seat:
    """One browser at the desk: who sits there, and where in the queue."""

    seat_id: str
    """Random name kept by the browser, so that a reload finds its seat again."""
    operator: str
    """Who sits there."""
    current: Key | None = None
    """The measurement being looked at."""
    places: tuple[tuple[QueueFilter, Key], ...] = ()
    """What was looked at last under each filter that was left."""
    sorting: Sorting = Sorting()
    """Order of the queue."""
    filter: QueueFilter = QueueFilter()
    """Filter of the queue."""
    order: tuple[Key, ...] = ()
    """Queue in the order it had when it was last sorted: decisions do not shuffle it underfoot."""
    explaining: tuple[Key, ...] = ()
    """The measurements just rejected, whose reason a digit may still give."""
    drafts: tuple[Draft, ...] = ()
    """Places not decided yet, one for a measurement at most."""
    older: Mapping[Key, int] = field(default_factory=dict[Key, int])
    """Number of the first decision made since each draft of a measurement or mark."""
    marks: tuple[PlaceFiducial, ...] = ()
    """Drafts of fiducials, by hand or snapped, one for each at most."""
    asking: Draft | PlaceFiducial | None = None
    """The draft against the block that was accepted once: once more keeps it."""
    turning: "tuple[int, Notice] | None" = None
    """The weighty decision that undo was asked to take back, and the question: once more does."""
    scene: SceneOptions = SceneOptions()
    """What of the 3D scene is shown."""
    quality: bool = False
    """True while the view of the block's quality is open."""
    sheet: Sheet = ""
    """The fiducial board or the map of placements while one is open."""
    pair: tuple[int, int] | None = None
    """Numbers of two adjustments compared there; first and last when None."""

    def draft_of(self, key: Key | None) -> Draft | None:
        """The draft about a measurement."""
        return next((draft for draft in self.drafts if draft.key == key), None)

    @property
    def begun(self) -> dict[str, AddPoint]:
        """New points that are nothing but drafts so far, by name."""
        return {draft.key[0]: draft.begins for draft in self.drafts if draft.begins}

    def without_draft(self, key: Key) -> "Seat":
        """The seat without a draft about a measurement."""
        kept = tuple(draft for draft in self.drafts if draft.key != key)
        return replace(self, drafts=kept)._asking_still(key)

    def with_draft(self, draft: Draft) -> "Seat":
        """The seat with a draft in the place of an earlier one about the same measurement."""
        draft = replace(draft, begins=draft.begins or self.begun.get(draft.key[0]))
        seat = self.without_draft(draft.key)
        return replace(seat, drafts=(*seat.drafts, draft))

    def once_decided(self, number: int) -> "Seat":
        """The seat once a decision was made: the drafts that are left are older than it."""
        drafted = (*(draft.key for draft in self.drafts), *map(_key_of, self.marks))
        return replace(self, older={key: self.older.get(key, number) for key in drafted})

    def _asking_still(self, gone: Key) -> "Seat":
        """A question about a draft that is gone goes with it; a new one is asked about anew."""
        older = {key: number for key, number in self.older.items() if key != gone}
        asking = self.asking if self.asking in (*self.drafts, *self.marks) else None
        return replace(self, older=older, asking=asking)

    def with_recorded(self, name: str) -> "Seat":
        """The seat once a new point is on disk: its other drafts are about a point that exists."""
        drafts = (
            replace(draft, begins=None) if draft.key[0] == name else draft for draft in self.drafts
        )
        return replace(self, drafts=tuple(drafts))

    def mark_of(self, photo_id: str, name: str) -> PlaceFiducial | None:
        """The draft of a fiducial."""
        return next((mark for mark in self.marks if _key_of(mark) == (photo_id, name)), None)

    def without_mark(self, photo_id: str, name: str) -> "Seat":
        """The seat without a draft of a fiducial."""
        kept = tuple(mark for mark in self.marks if _key_of(mark) != (photo_id, name))
        return replace(self, marks=kept)._asking_still((photo_id, name))

    def with_mark(self, mark: PlaceFiducial) -> "Seat":
        """The seat with the draft of a fiducial in the place of an earlier one."""
        seat = self.without_mark(mark.photo_id, mark.name)
        return replace(seat, marks=(*seat.marks, mark))


def _key_of(mark: PlaceFiducial) -> Key:
    return mark.photo_id, mark.name


@dataclass(frozen=True, slots=True)
class Remaking:
    """How far the making of orthos is, or the search for marks."""

    done: float = 0.0
    """Share done, of `total`."""
    total: float = 1.0
    """Whole."""
    what: str = ""
    """What is being made, or searched."""
    seconds_left: float | None = None
    """Estimate, seconds."""
    cancelling: bool = False
    """True once it was asked to stop."""


@dataclass(frozen=True, slots=True)
class Notice:
    """One message to a seat, in words of the catalogue."""

    text: str
    """Key of its sentence in `ui/words`."""
    values: Mapping[str, str] = field(default_factory=dict[str, str])
    """What stands in its places."""
    grave: bool = False
    """True when something went wrong."""
    draft: Key | None = None
    """The draft that it is about: it goes with that one."""


@dataclass(frozen=True, slots=True)
class DoubtReason:
    """One reason why something is doubtful."""

    text: str
    """Key of its sentence in `ui/words`."""
    value: float
    """The figure in it."""
    weight: float
    """How much it alone makes the measurement doubtful, 0 to 1."""


@dataclass(frozen=True, slots=True, eq=False)
class Extra:
    """What is doubtful beside surveyed points, put as points that are measured in photos.

    So that a tie point, a photo's place or a fiducial is looked at and judged as control is.
    """

    points: Mapping[str, SurveyedPoint] = field(default_factory=dict[str, SurveyedPoint])
    """Places on the ground by name."""
    measurements: Mapping[Key, Measurement] = field(default_factory=dict[Key, Measurement])
    """Where each lies in a scan."""
    kinds: Mapping[str, Kind] = field(default_factory=dict[str, Kind])
    """Kind of each, by name."""
    reasons: Mapping[Key, DoubtReason] = field(default_factory=dict[Key, DoubtReason])
    """Why each is doubtful, beside what the engine remarked of its measurement."""


NO_EXTRA = Extra()


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """What the equations of one adjustment tell beside its report."""

    gains: Mapping[Key, Gain] = field(default_factory=dict[Key, Gain])
    """What looking at each measurement is expected to bring."""
    covariances: Covariances = field(default_factory=dict[str, Any])
    """How well each photo that took part is known."""
    worth: Mapping[Key, float] = field(default_factory=dict[Key, float])
    """What measuring a point of the user in a photo would bring, metres."""
    influence: Influence | None = None
    """The equations themselves."""


NO_EVIDENCE = Evidence()


@dataclass(frozen=True, slots=True, eq=False)
class ToMeasure:
    """Points of the user in photos where nobody has measured them yet."""

    places: Mapping[str, SurveyedPoint] = field(default_factory=dict[str, SurveyedPoint])
    """New points where their measurements put them, with their standard deviations."""
    predictions: Mapping[Key, Prediction] = field(default_factory=dict[Key, Prediction])
    """Every point of the user in every photo that shows it, measured or not; best view first."""
    proposals: Mapping[Key, Measurement] = field(default_factory=dict[Key, Measurement])
    """Where a point was found by what other photos show of it; `score` is the probability."""
    waiting: Mapping[Key, Measurement] = field(default_factory=dict[Key, Measurement])
    """What is to be measured: at its proposal, or where it is predicted."""


NOTHING_TO_MEASURE = ToMeasure()


@dataclass(frozen=True, slots=True, eq=False)
class ShownMosaic:
    """The mosaic on disk as the desk shows it."""

    product: MosaicProduct
    """The file, its seams and holes."""
    version: int
    """When it was written, milliseconds since 1970: part of the address of its tiles."""
    seams: tuple[Seam, ...]
    """Seams with every edit that stands: those of the next mosaic."""
    drawn: tuple[Seam, ...] = ()
    """Seams before any edit."""
    edits: tuple[SeamEdit, ...] = ()
    """The edits that the mosaic was made with."""
    orthos: tuple[OrthoProduct, ...] = ()
    """What it was composed of."""
    edition: int = 0
    """Names the seams where they are not those of the file, which is 0."""
    misfit: tuple[FaultPlace, ...] = ()
    """Where it is likely to be wrong, worst first."""
    changed: Bounds | None = None
    """Where another photo shows the ground than in the file: west, south, east, north, metres."""
    outside: Literal["", "composed", "waiting"] = ""
    """Whether its seams were edited outside of the desk: they hold alone, composed or not yet."""


@dataclass(frozen=True, slots=True, eq=False)
class DeskState:
    """The block, its adjustment, and what is going on."""

    block: Block
    """The engine's block with the standing decisions laid over it."""
    report: AdjustmentReport
    """The newest adjustment."""
    made: Made
    """What the orthos on disk were made with."""
    before: AdjustmentReport | None = None
    """The adjustment before the newest, for the old numbers; None until something moved."""
    decided: int = 0
    """Number of standing decisions, all of them on disk."""
    adjusting: bool = False
    """True while the numbers shown are older than the decisions."""
    remaking: Remaking | None = None
    """Set while orthos are being made."""
    filling: Remaking | None = None
    """Set while marks like an example are being searched."""
    written_of: str = ""
    """Digest of the results that tables and report on disk tell; empty where there are none."""
    written_ms: int = 0
    """When that report was written, milliseconds since 1970; 0 where there is none."""
    free: tuple[bool, bool] = (True, True)
    """Whether cameras are estimated, and whether gross errors are looked for."""
    mosaic: "ShownMosaic | None" = None
    """The mosaic on disk; None where there is none."""
    extra: Extra = NO_EXTRA
    """Tie points, photos and fiducials to be judged."""
    evidence: Evidence = NO_EVIDENCE
    """What the equations of the newest adjustment tell."""
    to_measure: ToMeasure = NOTHING_TO_MEASURE
    """Points of the user that wait to be measured."""

    @property
    def holes(self) -> tuple[Hole, ...] | None:
        """Holes inside the mosaic on disk; None where there is none."""
        return None if self.mosaic is None else self.mosaic.product.holes

    @property
    def written(self) -> bool:
        """False while results on disk are other than the newest, or do not follow edited seams."""
        mosaic = self.mosaic
        if mosaic is not None and (mosaic.edition or mosaic.outside == "waiting"):
            return False
        return not self.adjusting and self.written_of == results_digest(self.report)

    @property
    def oriented(self) -> Block:
        """The block with the newest orientations and camera constants, to project with."""
        adjusted = self.report.block
        return replace(
            self.block,
            photos={**self.block.photos, **adjusted.photos},
            cameras={**self.block.cameras, **adjusted.cameras},
        )

    def measurement_of(self, key: Key) -> Measurement | None:
        """The measurement a row is about, of a surveyed point or of anything else.

        Of what waits to be measured, the place where it is expected.
        """
        return (
            self.block.measurements.get(key)
            or self.extra.measurements.get(key)
            or self.to_measure.waiting.get(key)
        )

    def is_waiting(self, key: Key) -> bool:
        """True for a point that nobody has measured in this photo."""
        return key in self.to_measure.waiting and key not in self.block.measurements

    def is_idle(self, key: Key) -> bool:
        """True where no verdict changes anything, for the photo was rejected.

        The photo itself can be accepted, and other photos show a tie point.
        """
        photo = self.extra.measurements.get((f"photo {key[1]}", key[1]))
        rejected = photo is not None and photo.status == "rejected"
        return rejected and self.extra.kinds.get(key[0]) not in ("photo", "tie")

    def point_of(self, name: str) -> SurveyedPoint | None:
        """The place on the ground a row is about; of a new point, where it is known to be."""
        known = self.block.surveyed.get(name)
        if known is not None and known.role == "new":
            return self.to_measure.places.get(name, known)
        return known or self.extra.points.get(name)

    def shown_state(self, measurement: Measurement) -> ShownState:
        """The state on screen: what was left out with its photo, or by itself, shows as unused."""
        if self.is_waiting(measurement.key):
            proposed = measurement.key in self.to_measure.proposals
            return "proposed" if proposed else "predicted"
        if measurement.status == "auto" and self.left_out(measurement.key):
            return "unused"
        return measurement.status

    def left_out(self, key: Key) -> str:
        """Why the adjustment did not use a measurement it might have used; empty when it did."""
        if self.is_idle(key):
            return OUT
        judged = self.report.block.measurements.get(key)
        if judged is not None and judged.status == "unused":
            return judged.reason or say("the adjustment did not use it")
        return self.report.rejected.get(key, "")

    def remark(self, measurement: Measurement) -> str:
        """Why a measurement is not used, or who placed it, in words."""
        if measurement.used and self.is_idle(measurement.key):
            return OUT
        left_out = self.left_out(measurement.key) if measurement.status == "auto" else ""
        return measurement.reason or left_out

    def residual_px(self, key: Key) -> tuple[float, float] | None:
        """Residual (column, row) of one measurement, pixels; None before it was adjusted."""
        return self.report.residuals_px.get(key)


@dataclass(frozen=True, slots=True, eq=False)
class InitialState:
    """What is known of the photos before the block was adjusted."""

    films: Mapping[str, ScanOrientation] = field(default_factory=dict[str, ScanOrientation])
    """Scans with their marks as they were found, by photo; empty where that was not kept."""
    pixel_mm: Mapping[str, float] = field(default_factory=dict[str, float])
    """Nominal size of a scan pixel by photo, millimetres."""
    sources: Mapping[str, str] = field(default_factory=dict[str, str])
    """What placed each photo at first: `world-file`, `points`, `footprints` or `exterior`."""
    set_aside: Mapping[str, str] = field(default_factory=dict[str, str])
    """Scans that could not be used or placed at all, with the reason."""
    exterior: Mapping[str, ExteriorOrientation] = field(
        default_factory=dict[str, ExteriorOrientation]
    )
    """Where its source put each photo."""
    cameras: Mapping[str, Camera] = field(default_factory=dict[str, Camera])
    """The cameras as the block describes them, without marks that only photos tell."""


NOTHING_INITIAL = InitialState()
