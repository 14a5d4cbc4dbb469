"""Why a measurement is doubtful: each reason by itself, with its weight."""

import math

from core.block import Measurement
from sessions.readings import SAME_PLACE_PX
from ui.review.misfit import Misfit
from ui.review.second_reading import apart_px
from ui.review.state import DoubtReason


def grounds_of(
    measurement: Measurement, misfit: Misfit | None, controlled: float | None, disputed_m: float
) -> tuple[DoubtReason, ...]:
    """Every reason why a measurement may be wrong, heaviest first."""
    found = [
        None if math.isnan(disputed_m) else DoubtReason("doubt.disputed", disputed_m, 1.0),
        _ground_of_misfit(misfit),
        _ground_of_peaks(measurement),
        _ground_of_score(measurement),
        _ground_of_readings(measurement),
        _ground_of_control(controlled),
    ]
    kept = [ground for ground in found if ground is not None and ground.weight > 0.02]
    return tuple(sorted(kept, key=lambda ground: -ground.weight))


def _ground_of_misfit(misfit: Misfit | None) -> DoubtReason | None:
    """Misfit against its standard deviation: one good point in ten is beyond 2.1, none at 5."""
    if misfit is None:
        return None
    return DoubtReason("doubt.misfit", misfit.ratio, _share((misfit.ratio - 2.1) / 2.9))


def _ground_of_peaks(measurement: Measurement) -> DoubtReason | None:
    """A second peak nearly as high as the best one."""
    if len(measurement.peaks) < 2 or measurement.peaks[0].score <= 0:
        return None
    ratio = float(measurement.peaks[1].score / measurement.peaks[0].score)
    return DoubtReason("doubt.peaks", 100 * ratio, 0.5 * _share((ratio - 0.7) / 0.3))


def _ground_of_score(measurement: Measurement) -> DoubtReason:
    weight = 0.5 * _share((0.6 - measurement.score) / 0.5)
    return DoubtReason("doubt.score", measurement.score, weight)


def _ground_of_readings(measurement: Measurement) -> DoubtReason | None:
    """Operators who do not mean the same detail."""
    apart = apart_px(measurement)
    if apart <= SAME_PLACE_PX:
        return None
    return DoubtReason("doubt.readings", apart, 0.8)


def _ground_of_control(controlled: float | None) -> DoubtReason | None:
    """Below a tenth no other measurement could find an error in this one."""
    if controlled is None:
        return None
    return DoubtReason("doubt.redundancy", controlled, 0.6 * _share((0.3 - controlled) / 0.3))


def _share(value: float) -> float:
    return min(max(value, 0.0), 1.0)
