"""What a decision would do, before it is made: the block adjusted with one measurement turned."""

from dataclasses import dataclass, replace

from core.block.adjusted import AdjustmentReport
from core.block.block import USED, Block, Measurement
from ui.review.compare import ground_pixel_m, shift_px
from ui.review.state import DeskState, Key


@dataclass(frozen=True, slots=True)
class Trial:
    """What would come of rejecting a measurement that is used, or of accepting one that is not."""

    key: Key
    """The measurement."""
    rejects: bool
    """True when the trial leaves the measurement out, False when it takes it in."""
    sigma_nought: float
    """It would be this."""
    shift_m: float
    """Largest shift of an orientation, metres on the ground."""
    photo_id: str
    """The photo that would shift most."""


def tried_block(state: DeskState, key: Key) -> Block | None:
    """The block with one measurement turned; None where that can change nothing."""
    measurement = state.block.measurements.get(key)
    point = state.block.surveyed.get(key[0])
    if measurement is None or point is None or point.role == "check":
        return None
    status = "rejected" if _takes_part(state, measurement) else "accepted"
    return state.block.with_measurement(replace(measurement, status=status))


def trial_of(state: DeskState, key: Key, report: AdjustmentReport) -> Trial | None:
    """The figures of a trial against the adjustment on screen; None when it did not settle."""
    measurement = state.block.measurements.get(key)
    if measurement is None or not report.converged:
        return None
    now, then = state.oriented, report.block
    shifts = {
        name: shift_px(photo, now.camera_of(name), then.photos[name], then.camera_of(name))
        * ground_pixel_m(photo, now.camera_of(name))
        for name, photo in now.photos.items()
        if name in then.photos
    }
    most = max(shifts, key=lambda name: shifts[name], default="")
    return Trial(
        key, _takes_part(state, measurement), report.sigma_nought, shifts.get(most, 0.0), most
    )


def _takes_part(state: DeskState, measurement: Measurement) -> bool:
    """True when the adjustment on screen used it."""
    return state.shown_state(measurement) in USED
