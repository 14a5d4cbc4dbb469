"""Messages to the review loop, and the functions through which it sends pictures."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from core.adjustment.adjusted import AdjustmentReport
from core.block import Block, Measurement
from core.doubts import Failure
from sessions.decisions import (
    AddPoint,
    BringPoints,
    Decision,
    DrawSheets,
    FillMarks,
    Place,
    PlaceFiducial,
    PlacePhoto,
    PlanChecks,
)
from ui.review.compare import Drawn
from ui.review.gestures import Gesture
from ui.review.picture import Part
from ui.review.scene import ScenePicture
from ui.review.state import Draft, Notice, Seat


@dataclass(frozen=True, slots=True)
class SeatTaken:
    """A page opened at a seat."""

    seat_id: str


@dataclass(frozen=True, slots=True)
class SeatLeft:
    """The last page at a seat closed; the seat waits for its return."""

    seat_id: str


@dataclass(frozen=True, slots=True)
class SceneOpened:
    """A 3D scene opened at a seat."""

    seat_id: str


@dataclass(frozen=True, slots=True)
class WrittenBeside:
    """Something beside the loop wrote results of the block anew."""

    notice: Notice = field(default_factory=lambda: Notice("notice.written-beside"))
    """What to tell everybody."""


@dataclass(frozen=True, slots=True)
class Closed:
    """The desk closes."""


class Work(Protocol):
    """Something captured to be adjusted, and what is wanted of its adjustment."""

    def block(self) -> Block | None:
        """What is adjusted; None where that can change nothing."""
        ...

    def conclude(self, report: AdjustmentReport) -> object:
        """What follows from the adjustment; found in its thread, so that no key waits for it."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Adjusted:
    """What came of one captured block."""

    work: Work
    """What was captured; the loop takes only the newest."""
    result: AdjustmentReport | Failure
    """The adjustment, or why there is none."""
    seconds: float
    """How long it took."""
    conclusion: object = None
    """What was asked of it with the block."""


@dataclass(frozen=True, slots=True, eq=False)
class Tried:
    """What came of a block adjusted only to see what would be."""

    work: Work
    """What was captured; the loop takes only the newest."""
    conclusion: object
    """What was asked of it with the block; None when nothing came of it."""


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """Places measured in the scans, or points read from a list, as was asked."""

    seat_id: str
    """Who asked."""
    decision: (
        AddPoint | BringPoints | DrawSheets | Place | PlaceFiducial | PlacePhoto | PlanChecks | None
    )
    """To be recorded, but a place, which is a draft; None when nothing was found."""
    notice: Notice
    """What to tell the operator."""
    since: Draft | PlaceFiducial | None = None
    """The draft a refinement began from: another one that was made meanwhile stays."""
    known: int = 0
    """So many decisions were recorded when it was asked for."""
    more: tuple[Decision, ...] = ()
    """To be recorded with it, as one act."""


@dataclass(frozen=True, slots=True)
class ProposalsWanted:
    """Somebody looks at a point where it is not measured, but other photos show it measured."""

    seat_id: str
    """Who looks at it."""
    point_id: str
    """The point."""


@dataclass(frozen=True, slots=True, eq=False)
class Proposed:
    """Where other photos show a point, by what those show in which it is measured."""

    seat_id: str
    """Who looked at it."""
    point_id: str
    """The point."""
    found: tuple[Measurement, ...]
    """One for each photo in which something was found; `score` is the probability."""


@dataclass(frozen=True, slots=True)
class MeasuringBegun:
    """A measurement that takes a while has begun."""

    seat_id: str
    """Who asked."""
    notice: Notice
    """What to tell the operator."""


@dataclass(frozen=True, slots=True)
class RemakeStep:
    """How far the making of orthos is."""

    done: float
    total: float
    what: str
    seconds_left: float | None


@dataclass(frozen=True, slots=True, eq=False)
class RemakeEnded:
    """Orthos were made, or not."""

    photo_ids: tuple[str, ...]
    """What was asked for."""
    made_with: AdjustmentReport
    """The orientations they were made with."""
    failure: str = ""
    """Why not; empty when they were made."""
    cancelled: bool = False
    """True when the operator stopped it."""

    @property
    def notice(self) -> Notice:
        """What to tell the operators."""
        if self.failure:
            return Notice("notice.remake-failed", {"why": self.failure}, grave=True)
        if self.cancelled:
            return Notice("notice.remake-cancelled")
        return Notice("notice.remade" if self.photo_ids else "notice.written")


@dataclass(frozen=True, slots=True)
class FillStep:
    """How far the search for marks like an example is."""

    done: float
    total: float
    what: str
    seconds_left: float | None


@dataclass(frozen=True, slots=True, eq=False)
class FillEnded:
    """Marks like an example were found, or not."""

    seat_id: str
    """Who asked."""
    decision: FillMarks | None
    """To be recorded; None when nothing was found, or the operator stopped it."""
    notice: Notice
    """What to tell the operator."""


Making = RemakeStep | RemakeEnded | FillStep | FillEnded | WrittenBeside
"""How far long work is, here or beside the desk."""
Delivery = Adjusted | Tried | Measured | Proposed | MeasuringBegun | Making
"""What the work in the background hands back."""
Event = Gesture | Delivery | SeatTaken | SeatLeft | SceneOpened | Closed
"""All that the loop takes, in order."""
Deliver = Callable[[Delivery], None]


@dataclass(frozen=True, slots=True, eq=False)
class Screen:
    """Where pictures go: functions that only pass on and return at once."""

    show: Callable[[str, Mapping[str, Part]], None]
    """(seat, parts) to its pages."""
    tell: Callable[[str, Notice], None]
    """(seat, notice) to its pages; to all when the seat is empty."""
    scene: Callable[[str, Callable[[], ScenePicture], Seat, Block], None]
    """(seat, what makes the picture, its switches, block) to its 3D scenes."""
    fit: Callable[[str, Seat, Block, bool], None]
    """Move a seat's eye; the flag is True for the whole block."""
    publish: Callable[[Drawn], None]
    """Orientations that addresses of tiles mean from now on."""
