"""What comes to the review loop, what it begins with, and where its pictures go."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from app.worker import Outcome
from core.block.adjusted import AdjustmentReport
from core.block.block import Block
from core.doubts import Doubt
from sessions.session import Session
from ui.review.compare import Drawn, HeightSource, LikenessSource
from ui.review.gestures import Gesture
from ui.review.origins import NO_ORIGINS, Origins
from ui.review.picture import Part
from ui.review.queue import Gains
from ui.review.scene import ScenePicture
from ui.review.state import DeskState, Notice, Seat


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
class Closed:
    """The desk closes."""


Event = Gesture | Outcome | SeatTaken | SeatLeft | SceneOpened | Closed


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


def no_gains(report: AdjustmentReport) -> Gains:
    """Nothing is known of what looking at a measurement brings."""
    return {}


@dataclass(frozen=True, slots=True, eq=False)
class LoopInputs:
    """What the loop begins with."""

    base: Block
    """The block as the engine left it."""
    state: DeskState
    """The first state."""
    session: Session
    """Memory."""
    dem: HeightSource
    """Heights."""
    operator: str
    """Who sits at new seats."""
    stale_m: float
    """An ortho is stale when the photo moved by more than this on the ground, metres."""
    adopted: Callable[[AdjustmentReport], None]
    """Called with every adjustment the desk shows, to keep it as a product."""
    likeness: LikenessSource | None = None
    """Compares reference and scan."""
    doubts: tuple[Doubt, ...] = ()
    """What the engine was unsure of."""
    reference_sigma_m: tuple[float, float, float] = (0.25, 0.25, 0.5)
    """Accuracy of ortho (east, north) and DEM, metres: of points chosen at the desk."""
    origins: Origins = NO_ORIGINS
    """What the photos began from."""
    gains: Callable[[AdjustmentReport], Gains] = no_gains
    """What looking at each measurement is expected to bring in an adjustment."""
    choose: Callable[[bool, bool], None] | None = None
    """(cameras, robust): what adjustments from now on estimate and how; None where it is fixed."""
