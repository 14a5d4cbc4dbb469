"""Drafts: where a draft lies in block or scan, and whether to ask before it is kept."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from core.adjustment.adjusted import Contradiction
from core.block import Block, Measurement
from core.geometry.interior import InteriorOrientation
from core.scans.fiducials import HAND_SIGMA_PX
from sessions.decisions import (
    Accept,
    ChoosePeak,
    MarkDubious,
    MarkNotVisible,
    PhotoDecision,
    Place,
    PlaceFiducial,
    Recorded,
    Reject,
    standing,
)
from sessions.replay import replay, with_place
from sessions.scan_decisions import mark_changes, with_changes
from ui.review.misfit import Misfit, misfits
from ui.review.state import DeskState, Draft, InitialState, Key, Seat

ASKING_SIGMA = 3.0
"""A draft further than this from where the block expects it is asked about before it is kept: one
good measurement in ninety lies so far off."""


def apply_draft(state: DeskState, draft: Draft) -> DeskState:
    """The desk as it would be with a draft kept, before the block is adjusted to it."""
    block = replay(state.block, (Recorded(0, "", "", draft.decision),)).block
    return replace(state, block=block)


def draft_ratio(state: DeskState, draft: Draft, against: Contradiction | None = None) -> float:
    """How far a draft lies from where the block expects its point, in standard deviations.

    Args:
        state: The desk.
        draft: The draft.
        against: What the block adjusted with it has against it.
    """
    expected = state.to_measure.predictions.get(draft.key)
    placed = apply_draft(state, draft).measurement_of(draft.key)
    if expected is not None and placed is not None and state.is_waiting(draft.key):
        return expected.sigmas_away(placed.column, placed.row, placed.sigma_px)
    if against is not None:
        return against.test
    misfit = misfits(apply_draft(state, draft), (draft.key,)).get(draft.key)
    return misfit.ratio if misfit else 0.0


def opponent_of(key: Key, operator: str, recorded: Sequence[Recorded]) -> str:
    """Who else took a measurement out of use, if that is what was decided last; else nobody."""
    for item in reversed(standing(recorded)):
        said = item.decision
        if isinstance(said, PhotoDecision) and (said.point_id, said.photo_id) == key:
            refused = isinstance(said, Reject | MarkDubious | MarkNotVisible)
            return item.who if refused and item.who != operator else ""
    return ""


def lies_against(state: DeskState, misfits: Mapping[Key, Misfit], key: Key) -> bool:
    """True for a place that is to be asked about, too, where nobody has moved the measurement."""
    placed, expected = state.measurement_of(key), state.to_measure.predictions.get(key)
    if placed is not None and expected is not None and state.is_waiting(key):
        return expected.sigmas_away(placed.column, placed.row, placed.sigma_px) > ASKING_SIGMA
    return key in misfits and misfits[key].ratio > ASKING_SIGMA


@dataclass(frozen=True, slots=True, eq=False)
class MarkEffect:
    """What the draft of a fiducial would make of its scan."""

    interior: InteriorOrientation
    """The interior orientation with it."""
    residual_um: np.ndarray | None
    """Measured minus certified place, (2,) micrometres; None without a certified one."""
    is_against: bool
    """True when the other marks contradict it: the fit leaves it out, or its residual is beyond
    three sigmas of scan and hand."""

    @property
    def length_um(self) -> float | None:
        """Length of the residual, micrometres."""
        return None if self.residual_um is None else float(np.hypot(*self.residual_um))


def mark_effect(
    state: DeskState, initial: InitialState, recorded: Sequence[Recorded], mark: PlaceFiducial
) -> MarkEffect:
    """What the draft of a fiducial would make of its scan."""
    photo_id, name = mark.photo_id, mark.name
    alone = state.block.with_photos({photo_id: state.block.photos[photo_id]})
    marks = mark_changes((*recorded, Recorded(0, "", "", mark)))
    interior = with_changes(alone, marks, initial.films).photos[photo_id].interior
    certified = state.block.camera_of(photo_id).fiducials_mm.get(name)
    # One mark far off makes the sigma of its own fit large: the scan as it stands is the measure.
    before = state.block.photos[photo_id].interior
    hand_um = 1000 * HAND_SIGMA_PX * before.pixel_size_mm
    limit = ASKING_SIGMA * np.hypot(np.nan_to_num(before.sigma_um), hand_um)
    if name in interior.names:
        residual = interior.residuals_um[interior.names.index(name)]
        return MarkEffect(interior, residual, bool(np.hypot(*residual) > limit))
    if certified is None or not interior.names:
        return MarkEffect(interior, None, False)
    film = interior.film_from_pixel(np.array([[mark.column, mark.row]]))[0]
    return MarkEffect(interior, 1000 * (film - np.array(certified)), True)


def with_measured(
    seat: Seat, measured: Place | PlaceFiducial, since: Draft | PlaceFiducial | None
) -> Seat | None:
    """The seat with what was measured as a draft; None where its draft was changed meanwhile."""
    if isinstance(measured, PlaceFiducial):
        same = seat.mark_of(measured.photo_id, measured.name) == since
        return seat.with_mark(measured) if same else None
    draft = Draft((measured.point_id, measured.photo_id), measured)
    return seat.with_draft(draft) if seat.draft_of(draft.key) == since else None


def left_seats(seats: Iterable[Seat], block: Block) -> tuple[Seat, ...]:
    """Seats with drafts, as a desk leaves them to the next: each draft at its place there."""
    return tuple(
        replace(seat, drafts=tuple(_at_its_place(draft, block) for draft in seat.drafts))
        for seat in seats
        if seat.drafts or seat.marks
    )


def _at_its_place(draft: Draft, block: Block) -> Draft:
    decision = with_place(draft.decision, block)
    assert isinstance(decision, Place | ChoosePeak | Accept), "the same decision, with its place"
    return replace(draft, decision=decision)


def with_left(seat: Seat, left: Seat, rows: Collection[Key], photos: Collection[str]) -> Seat:
    """The seat with what the desk before left it, where what it is about is here too.

    Args:
        seat: Who sits here.
        left: The same seat, as it was left.
        rows: All measurements here.
        photos: All photos here.
    """
    drafts = tuple(
        draft
        for draft in left.drafts
        if draft.key in rows or (draft.begins and draft.key[1] in photos)
    )
    marks = tuple(mark for mark in left.marks if mark.photo_id in photos)
    return replace(seat, operator=left.operator, drafts=drafts, marks=marks)


def by_hand(measurement: Measurement) -> bool:
    """True where a hand placed a measurement: no likeness was found there, and none is shown."""
    return measurement.score >= 1.0 and any(p.operator == "operator" for p in measurement.peaks)
