"""What follows from an adjustment: found beside it, so that no key waits for it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

from app.loop_doors import LoopInputs
from app.loop_table import Table
from core.block.adjusted import AdjustmentReport
from sessions.decisions import Recorded
from ui.review.compare import Drawn, redrawn, stale_photos
from ui.review.doubtful import extra_of
from ui.review.scene import Footprints, ScenePicture, Segments, scene_picture, tie_vectors
from ui.review.state import DeskState


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """All that the desk shows of one adjustment."""

    state: DeskState
    """Captured when the block was handed over, with the new report in it."""
    drawn: Drawn
    """Photos as their tiles are drawn from now on."""
    stale: tuple[str, ...]
    """Photos with stale orthos."""
    outlines: Segments
    """Footprints, local frame."""
    tied: Segments
    """Residual vectors of tie points, local frame."""
    table: Table
    """Rows of the queue."""


@dataclass(frozen=True, slots=True, eq=False)
class Following:
    """Captured beside a block that is adjusted: finds what follows from the report."""

    state: DeskState
    """The desk as the block was handed over."""
    drawn: Drawn
    """Photos as they are drawn then."""
    recorded: Sequence[Recorded]
    """Every decision until then."""
    table: Table
    """Rows of the queue then."""
    inputs: LoopInputs
    """What the loop began with."""
    footprints: Footprints
    """Outlines found before; only one thread at a time asks for more."""

    def __call__(self, report: AdjustmentReport) -> Followed:
        """Everything that follows."""
        state = replace(self.state, report=report, before=self.state.report, adjusting=False)
        given = self.inputs
        extra = extra_of(state, given.base, self.recorded, given.doubts, given.dem)
        state = replace(state, extra=extra)
        drawn = redrawn(self.drawn, state.oriented)
        return Followed(
            state,
            drawn,
            stale_photos(state, given.stale_m),
            self.footprints.of(drawn, state.oriented.origin),
            tie_vectors(state),
            self.table.renewed(state, given.gains(report)),
        )


def adopted(
    now: DeskState, followed: Followed, stale_m: float
) -> tuple[DeskState, tuple[str, ...]]:
    """The state with what follows from its adjustment, and the photos with stale orthos."""
    then = followed.state
    state = replace(now, report=then.report, before=then.before, adjusting=False, extra=then.extra)
    # Orthos may have been made meanwhile.
    stale = followed.stale if now.made is then.made else stale_photos(state, stale_m)
    return state, stale


def scene_once(
    state: DeskState, stale: tuple[str, ...], table: Table, outlines: Segments, tied: Segments
) -> Callable[[], ScenePicture]:
    """The 3D scene of a moment, made by who draws it, once for all seats."""
    away = table.away.misfits
    return cache(lambda: scene_picture(state, stale, outlines, away, tied))
