"""Readings: one point measured in one photo by several operators.

The measurement is the mean of each operator's latest reading. A single reading has the standard
deviation of a hand; several give their own. Readings further apart than the size of a detail show
different details: then the newest counts, and the others are kept beside it.
"""

from collections.abc import Sequence

import numpy as np

from core.block import HAND_SIGMA_PX, Measurement, Peak, Reading
from core.said import say
from sessions.decisions import Place, Recorded

SAME_PLACE_PX = 2.0
"""Two places nearer than this, scan pixels, are taken as the same detail."""
PRIOR_COORDINATES = 2.0
"""What is known of hands beforehand weighs as many coordinates as one reading has: two readings
that agree by chance are not taken for perfect."""


def placed(proposed: Measurement | None, decision: Place, recorded: Recorded) -> Measurement:
    """An operator's own measurement beside those of others.

    Its peak comes last, so that the others keep their index.

    Args:
        proposed: The measurement before; None where there was none.
        decision: Where it was placed; one with a standard deviation of its own was measured by the
            program, and is no reading.
        recorded: Who placed it, and when; a draft, which nobody has recorded yet, stands by itself.
    """
    before = () if proposed is None or not recorded.who else proposed.readings
    own = Reading(recorded.who, decision.column, decision.row, recorded.when)
    readings = (*(one for one in before if one.operator != own.operator), own)
    together = agreeing(readings)
    column, row = np.mean([(one.column, one.row) for one in together], axis=0).tolist()
    sigma = mean_sigma_px(together) if decision.sigma_px is None else decision.sigma_px
    peaks = () if proposed is None else tuple(p for p in proposed.peaks if p.operator != "operator")
    who = ", ".join(one.operator for one in together)
    reason = (
        say("placed by {who}", who=who)
        if decision.seen
        else say("accepted with others by {who}", who=who)
    )
    return Measurement(
        decision.point_id,
        decision.photo_id,
        column,
        row,
        sigma,
        score=1.0,
        status="accepted",
        reason=reason,
        peaks=(*peaks, Peak(column, row, sigma, 1.0, "operator")),
        readings=readings if decision.sigma_px is None else (),
        seen=decision.seen,
    )


def agreeing(readings: Sequence[Reading]) -> tuple[Reading, ...]:
    """The newest reading, which is the last, and all that are of the same detail."""
    newest = readings[-1]
    return tuple(
        one
        for one in readings
        if np.hypot(one.column - newest.column, one.row - newest.row) <= SAME_PLACE_PX
    )


def mean_sigma_px(readings: Sequence[Reading]) -> float:
    """Standard deviation per axis of the mean of readings, scan pixels."""
    places = np.array([(one.column, one.row) for one in readings])
    squares = float(np.sum((places - places.mean(axis=0)) ** 2))
    freedom = 2.0 * (len(readings) - 1)
    known = PRIOR_COORDINATES * HAND_SIGMA_PX**2
    variance = (known + squares) / (PRIOR_COORDINATES + freedom)
    return float(np.sqrt(variance / len(readings)))
