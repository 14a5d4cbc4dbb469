"""The effect of a decision before it is made: the block adjusted with one measurement switched."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from core.adjustment.adjusted import AdjustmentReport, Contradiction
from core.block import USED, Block, Measurement
from sessions.decisions import Recorded
from ui.review.compare import shift_px
from ui.review.doubtful import Verdict, verdict_on
from ui.review.drafts import ASKING_SIGMA, apply_draft, draft_ratio, opponent_of
from ui.review.misfit import misfits
from ui.review.state import DeskState, Draft, Key, Seat

After = Callable[[Verdict], Block]
"""The block with one more verdict laid over it, beside all that was decided."""
NEIGHBOURS = 3
"""So many measurements beside the one looked at are told."""


@dataclass(frozen=True, slots=True)
class Neighbour:
    """A measurement nearby, whose misfit a decision would change."""

    key: Key
    """The measurement."""
    now_px: float
    """Misfit as it is, scan pixels."""
    then_px: float
    """Misfit as it would be, scan pixels."""


@dataclass(frozen=True, slots=True)
class Trial:
    """What would come of rejecting what is used, accepting what is not, or keeping a draft."""

    key: Key
    """The measurement."""
    rejects: bool
    """True when the trial leaves the measurement out, False when it takes it in or moves it."""
    sigma_nought: float
    """It would be this."""
    shift_m: float
    """Largest shift of a corner of a photo, metres on the ground."""
    photo_id: str
    """The photo that would shift most."""
    neighbours: tuple[Neighbour, ...] = ()
    """The nearest measurements in the same photo."""
    against: Contradiction | None = None
    """What the verdict would tell of it; None where the block would not contradict it."""
    left_out: tuple[Key, ...] = ()
    """Other measurements that the adjustment would leave out as gross errors because of it."""


@dataclass(frozen=True, slots=True, eq=False)
class TrialWork:
    """One measurement of a state, to be turned or moved in a trial adjustment."""

    state: DeskState
    """The desk with the adjustment on screen."""
    subject: Key | Draft
    """The measurement, or the place drafted for it."""
    after: After
    """What a verdict makes of the block."""

    def block(self) -> Block | None:
        """The block with the measurement turned; None where that can change nothing."""
        return turn_measurement(self.state, self.subject, self.after)

    def conclude(self, report: AdjustmentReport) -> Trial | None:
        """The figures of the trial; None when it did not settle."""
        return trial_of(self.state, self.subject, report)


def turn_measurement(state: DeskState, subject: Key | Draft, after: After) -> Block | None:
    """The block with one measurement turned, or moved; None where that can change nothing."""
    key = key_of(subject)
    measurement, point = state.measurement_of(key), state.point_of(key[0])
    if point is None or point.role == "check" or state.is_idle(key):
        return None
    if isinstance(subject, Draft):
        return apply_draft(state, subject).block
    unplaced = state.is_waiting(key) and key not in state.to_measure.proposals
    if measurement is None or unplaced:
        return None
    if key in state.extra.measurements:
        verdict = verdict_on(state.extra, key, use=not _takes_part(state, measurement))
        return after(verdict) if verdict else None
    status = "rejected" if _takes_part(state, measurement) else "accepted"
    return state.block.with_measurement(replace(measurement, status=status))


def key_of(subject: Key | Draft) -> Key:
    """The measurement a trial is about."""
    return subject.key if isinstance(subject, Draft) else subject


def trial_of(state: DeskState, subject: Key | Draft, report: AdjustmentReport) -> Trial | None:
    """The figures of a trial against the adjustment on screen; None when it did not settle."""
    key = key_of(subject)
    measurement = state.measurement_of(key)
    if measurement is None or not report.converged:
        return None
    shift, most = largest_shift(state.oriented, report.block)
    turned = not isinstance(subject, Draft) and _takes_part(state, measurement)
    against = next((one for one in report.contradictions if one.key == key), None)
    neighbours = _neighbours(state, key, report)
    return Trial(
        key, turned, report.sigma_nought, shift, most, neighbours, against,
        left_out=_left_out_then(state, key, report),
    )  # fmt: skip


def _left_out_then(state: DeskState, key: Key, report: AdjustmentReport) -> tuple[Key, ...]:
    """Other measurements that a trial leaves out and the adjustment on screen does not."""
    then = replace(state, report=report)
    return tuple(sorted(
        one
        for one in {*state.block.measurements, *report.rejected} - {key}
        if then.left_out(one) and not state.left_out(one)
    ))  # fmt: skip


def largest_shift(now: Block, then: Block) -> tuple[float, str]:
    """The largest shift of a corner of a photo between two adjustments, metres; and the photo."""
    shifts = {
        name: shift_px(photo, now.camera_of(name), then.photos[name], then.camera_of(name))
        * photo.ground_pixel_m(now.camera_of(name))
        for name, photo in now.photos.items()
        if name in then.photos
    }
    most = max(shifts, key=lambda name: shifts[name], default="")
    return shifts.get(most, 0.0), most


def _neighbours(state: DeskState, key: Key, report: AdjustmentReport) -> tuple[Neighbour, ...]:
    """The nearest measurements in the same photo, with their misfits now and then."""
    here = state.measurement_of(key)
    assert here is not None, "asked for by the caller"
    within = [
        item
        for item in state.block.measurements.values()
        if item.photo_id == key[1] and item.key != key and state.shown_state(item) in USED
    ]
    within.sort(key=lambda item: np.hypot(item.column - here.column, item.row - here.row))
    keys = [item.key for item in within[:NEIGHBOURS]]
    now, then = misfits(state, keys), misfits(state, keys, report)
    return tuple(
        Neighbour(name, float(np.hypot(*now[name].pixels)), float(np.hypot(*then[name].pixels)))
        for name in keys
        if name in now and name in then
    )


def _takes_part(state: DeskState, measurement: Measurement) -> bool:
    """True when the adjustment on screen used it."""
    if measurement.key in state.extra.measurements:
        return measurement.status in USED
    return state.shown_state(measurement) in USED


def is_to_be_asked(
    state: DeskState,
    seat: Seat,
    draft: Draft,
    recorded: Sequence[Recorded],
    trial: Trial | None = None,
) -> bool:
    """True for a draft that contradicts block or colleague, or puts others out of the adjustment.

    Not for one that was accepted once already.
    """
    if seat.asking == draft:
        return False
    if (trial and trial.left_out) or opponent_of(draft.key, seat.operator, recorded):
        return True
    return draft_ratio(state, draft, trial and trial.against) > ASKING_SIGMA
