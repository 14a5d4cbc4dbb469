"""Drafts: where a draft lies in the block, and whether to ask before it is kept."""

from dataclasses import replace

from core.block import Measurement
from sessions.decisions import Recorded
from sessions.replay import replay
from ui.review.misfit import misfits
from ui.review.state import DeskState, Draft, Seat

ASKING_SIGMA = 3.0
"""A draft further than this from where the block expects it is asked about before it is kept: one
good measurement in eight thousand lies so far off in both directions together."""


def apply_draft(state: DeskState, draft: Draft) -> DeskState:
    """The desk as it would be with a draft kept, before the block is adjusted to it."""
    block = replay(state.block, (Recorded(0, "", "", draft.decision),)).block
    return replace(state, block=block)


def draft_ratio(state: DeskState, draft: Draft) -> float:
    """How far a draft lies from where the block expects its point, in standard deviations."""
    expected = state.to_measure.predictions.get(draft.key)
    placed = apply_draft(state, draft).measurement_of(draft.key)
    if expected is not None and placed is not None and state.is_waiting(draft.key):
        return expected.sigmas_away(placed.column, placed.row, placed.sigma_px)
    misfit = misfits(apply_draft(state, draft), (draft.key,)).get(draft.key)
    return misfit.ratio if misfit else 0.0


def is_to_be_asked(state: DeskState, seat: Seat, draft: Draft) -> bool:
    """True for a draft that contradicts the block and was not accepted once already."""
    return seat.asking != draft and draft_ratio(state, draft) > ASKING_SIGMA


def by_hand(measurement: Measurement) -> bool:
    """True where a hand placed a measurement: no likeness was found there, and none is shown."""
    return measurement.score >= 1.0 and any(p.operator == "operator" for p in measurement.peaks)
