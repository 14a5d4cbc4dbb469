"""Results derived from an adjustment, computed outside the review thread: keys never wait."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from core.adjustment.adjusted import AdjustmentReport
from core.block import Block
from ui.review.compare import redrawn, stale_photos
from ui.review.doubtful import extra_of
from ui.review.history import with_adjustment
from ui.review.scene import Footprints, tie_vectors
from ui.review.snapshot import DeskSnapshot
from ui.review.state import Evidence
from ui.review.to_measure import with_predictions, with_waiting


@dataclass(frozen=True, slots=True, eq=False)
class AfterAdjustment:
    """Captured beside a block that is adjusted: finds what follows from the report."""

    desk: DeskSnapshot
    """The desk as the block was handed over."""
    evidence: Callable[[AdjustmentReport], Evidence]
    """What the equations tell beside the report."""
    stale_m: float
    """An ortho is stale when the photo moved by more than this on the ground, metres."""
    footprints: Footprints
    """Outlines found before; only one thread at a time asks for more."""

    def block(self) -> Block:
        """What is adjusted."""
        return self.desk.state.block

    def conclude(self, report: AdjustmentReport) -> DeskSnapshot:
        """The captured desk with all that follows from the report."""
        desk = self.desk
        state = replace(
            desk.state, report=report, before=desk.state.report, adjusting=False,
            evidence=self.evidence(report),
        )  # fmt: skip
        extra = extra_of(state, desk.base, desk.recorded, desk.doubts, desk.dem)
        state = with_predictions(replace(state, extra=extra), desk.dem)
        drawn = redrawn(desk.drawn, state.oriented)
        return replace(
            desk,
            state=state,
            drawn=drawn,
            stale=stale_photos(state, self.stale_m),
            outlines=self.footprints.of(drawn, state.oriented.origin),
            tie_vectors=tie_vectors(state),
            table=desk.table.renewed(state),
        )


def adopt_adjustment(now: DeskSnapshot, found: DeskSnapshot, stale_m: float) -> DeskSnapshot:
    """The desk as it stands now, with what follows from the newest adjustment."""
    then = found.state
    measured = replace(then.to_measure, proposals=now.state.to_measure.proposals)
    state = with_waiting(replace(
        now.state, report=then.report, before=then.before, adjusting=False, extra=then.extra,
        evidence=then.evidence, to_measure=measured,
    ))  # fmt: skip
    # Orthos may have been made meanwhile.
    same = now.state.made is then.made
    fresh = replace(
        now,
        state=state,
        stale=found.stale if same else stale_photos(state, stale_m),
        drawn=found.drawn,
        outlines=found.outlines,
        tie_vectors=found.tie_vectors,
        trials={},
        adjustments=with_adjustment(now.adjustments, then.report, state),
    )
    # Proposals may have come meanwhile.
    same = state.to_measure.waiting == then.to_measure.waiting
    return fresh.with_table(found.table if same else found.table.renewed(state))
