"""The queue: one row per measurement, how doubtful each is and why, sorted and sieved."""

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field

from core.block.block import Measurement
from core.block.expected_gain import Gain
from ui.review.misfit import Misfit, controllability, misfits
from ui.review.palette import ShownState
from ui.review.state import (
    POINT_KINDS,
    DeskState,
    Key,
    Kind,
    Seat,
    Sieve,
    Sorting,
)

Gains = Mapping[Key, Gain]
INFLUENCE_FLOOR = 0.4
"""Share of the gain that does not depend on how much a measurement steers the block."""
MOVES_NOTHING = 0.02
"""So much of the gain by rule of thumb counts where others are known in metres."""
UNUSED_GAIN = 1e-6
"""What the engine left out comes after what steers the block."""


@dataclass(frozen=True, slots=True)
class Ground:
    """One ground for doubt."""

    text: str
    """Key of the sentence in `wording`."""
    value: float
    """The figure in it."""
    weight: float
    """How much it alone makes the measurement doubtful, 0 to 1."""


@dataclass(frozen=True, slots=True)
class Row:
    """One measurement as the queue shows it."""

    key: Key
    """Point and photo."""
    role: Kind
    """What it is: control, check, or something else that is doubtful."""
    state: ShownState
    """State on screen."""
    human: bool
    """True once an operator decided it."""
    doubt: float
    """How doubtful, 0 to 1."""
    gain: float
    """What looking at it is expected to bring, 0 to 1."""
    misfit_px: float
    """Distance from where the block expects it, scan pixels; NaN when that is not known."""
    score: float
    """Likeness, 0 to 1."""
    controlled: float | None
    """Share of an error here that would show, 0 to 1."""
    grounds: tuple[Ground, ...]
    """Why it is doubtful, heaviest first."""


@dataclass(frozen=True, slots=True, eq=False)
class Away:
    """How every measurement lies to one adjustment; found once for each."""

    misfits: Mapping[Key, Misfit]
    """Misfits by measurement."""
    controlled: Mapping[Key, float]
    """Controllability by measurement."""
    gains: Gains = field(default_factory=dict[Key, Gain])
    """What looking at one is expected to bring; empty where that was not found."""


def away_of(state: DeskState, gains: Gains | None = None) -> Away:
    """Misfits and controllability of all measurements of a state."""
    keys = (*state.block.measurements, *state.extra.measurements)
    return Away(misfits(state, keys), controllability(state), gains or {})


def moved_away(away: Away, state: DeskState, keys: Iterable[Key]) -> Away:
    """The same with the misfits of a few measurements found anew, in the same adjustment."""
    fresh = {**away.misfits, **misfits(state, keys)}
    return Away(fresh, away.controlled, away.gains)


def queue_rows(state: DeskState, away: Away | None = None) -> tuple[Row, ...]:
    """Every measurement of a surveyed point, in the order of point and photo; then the rest."""
    away = away or away_of(state)
    keys = [key for key in sorted(state.block.measurements) if key[0] in state.block.surveyed]
    return tuple(queue_row(state, away, key) for key in (*keys, *sorted(state.extra.measurements)))


def queue_row(state: DeskState, away: Away, key: Key) -> Row:
    """One row."""
    measurement = state.measurement_of(key)
    assert measurement is not None, "rows are made of measurements"
    if key in state.extra.measurements:
        return _extra_row(state, measurement, away.misfits.get(key))
    return _row(state, measurement, away)


def ordered(rows: Iterable[Row], sorting: Sorting) -> tuple[Key, ...]:
    """Keys of all rows in the order asked for; rows without the figure come last."""

    def place(row: Row) -> tuple[bool, float | tuple[str, str]]:
        figure = _figure(row, sorting)
        if isinstance(figure, float):
            missing = math.isnan(figure)
            return missing, 0.0 if missing else (-figure if sorting.descending else figure)
        return False, figure

    if sorting.column in ("photo", "point"):
        return tuple(row.key for row in sorted(rows, key=place, reverse=sorting.descending))
    return tuple(row.key for row in sorted(rows, key=place))


def visible(rows: Mapping[Key, Row], seat: Seat) -> tuple[Key, ...]:
    """Keys the seat's queue shows, in its own order."""
    return tuple(key for key in seat.order if key in rows and passes(rows[key], seat.sieve))


def passes(row: Row, sieve: Sieve) -> bool:
    """True when a sieve lets a row through."""
    if sieve.photo_id and sieve.photo_id != row.key[1]:
        return False
    if row.role != sieve.role if sieve.role else row.role not in POINT_KINDS:
        return False
    match sieve.state:
        case "all":
            return True
        case "review":
            return row.state != "unused"
        case "open":
            return row.state == "auto"
        case _:
            return row.state == sieve.state


def neighbour(shown: tuple[Key, ...], seat: Seat, step: int) -> Key | None:
    """The next (+1) or previous (-1) key from the seat's current one; stays at the ends."""
    if not shown:
        return None
    if seat.current in shown:
        place = shown.index(seat.current) + step
        return shown[min(max(place, 0), len(shown) - 1)]
    after = {key: number for number, key in enumerate(seat.order)}
    here = after.get(seat.current, -1) if seat.current else -1
    behind = [key for key in shown if after[key] > here]
    ahead = [key for key in shown if after[key] < here]
    if step > 0:
        return behind[0] if behind else shown[-1]
    return ahead[-1] if ahead else shown[0]


def coming(rows: Mapping[Key, Row], seat: Seat, taken: Collection[Key] = ()) -> tuple[Key, ...]:
    """Measurements of the queue nobody has looked at: those behind the current one, then before.

    Those that others are looking at are left to them.
    """
    shown = visible(rows, seat)
    here = shown.index(seat.current) if seat.current in shown else -1
    turned = (*shown[here + 1 :], *shown[: max(here, 0)])
    return tuple(key for key in turned if rows[key].state == "auto" and key not in taken)


def _row(state: DeskState, measurement: Measurement, away: Away) -> Row:
    misfit = away.misfits.get(measurement.key)
    controlled = away.controlled.get(measurement.key)
    shown = state.shown_state(measurement)
    grounds = _grounds(measurement, misfit, controlled)
    doubt = 1 - math.prod(1 - ground.weight for ground in grounds)
    human = measurement.status in ("accepted", "rejected", "dubious")
    if human:
        gain = 0.0
    elif shown == "unused":
        # What the block nearly agrees with is the likeliest to be taken in after all.
        gain = UNUSED_GAIN / (1 + (misfit.ratio if misfit else 9.0))
    else:
        gain = _gain(doubt, controlled, away, measurement.key)
    return Row(
        key=measurement.key,
        role=state.block.surveyed[measurement.point_id].role,
        state=shown,
        human=human,
        doubt=doubt,
        gain=gain,
        misfit_px=math.hypot(*misfit.pixels) if misfit else math.nan,
        score=measurement.score,
        controlled=controlled,
        grounds=grounds,
    )


def _gain(doubt: float, controlled: float | None, away: Away, key: Key) -> float:
    """Doubt times influence: in metres of m_p where the block was asked, else by rule of thumb."""
    if key in away.gains:
        expected = away.gains[key].expected_m
        return expected / (1 + expected)
    influence = 1 - (controlled if controlled is not None else 0.8)
    gain = doubt * (INFLUENCE_FLOOR + (1 - INFLUENCE_FLOOR) * influence)
    # Check points and the like move nothing.
    return MOVES_NOTHING * gain if away.gains else gain


def _extra_row(state: DeskState, measurement: Measurement, misfit: Misfit | None) -> Row:
    """Tie point, photo or fiducial: doubtful by what made it one, with that said in words."""
    human = measurement.status in ("accepted", "rejected")
    doubt = 1.0 - measurement.score
    return Row(
        key=measurement.key,
        role=state.extra.kinds[measurement.point_id],
        state=measurement.status,
        human=human,
        doubt=doubt,
        gain=0.0 if human else doubt,
        misfit_px=math.hypot(*misfit.pixels) if misfit else math.nan,
        score=math.nan,
        controlled=None,
        grounds=(),
    )


def _grounds(
    measurement: Measurement, misfit: Misfit | None, controlled: float | None
) -> tuple[Ground, ...]:
    found = [
        _ground_of_misfit(misfit),
        _ground_of_peaks(measurement),
        _ground_of_score(measurement),
        _ground_of_control(controlled),
    ]
    kept = [ground for ground in found if ground is not None and ground.weight > 0.02]
    return tuple(sorted(kept, key=lambda ground: -ground.weight))


def _ground_of_misfit(misfit: Misfit | None) -> Ground | None:
    """Misfit against its standard deviation: normal below one, certain trouble from 3.5."""
    if misfit is None:
        return None
    return Ground("doubt.misfit", misfit.ratio, _share((misfit.ratio - 0.8) / 2.7))


def _ground_of_peaks(measurement: Measurement) -> Ground | None:
    """A second peak nearly as high as the best one."""
    if len(measurement.peaks) < 2 or measurement.peaks[0].score <= 0:
        return None
    ratio = float(measurement.peaks[1].score / measurement.peaks[0].score)
    return Ground("doubt.peaks", 100 * ratio, 0.5 * _share((ratio - 0.7) / 0.3))


def _ground_of_score(measurement: Measurement) -> Ground:
    weight = 0.5 * _share((0.6 - measurement.score) / 0.5)
    return Ground("doubt.score", measurement.score, weight)


def _ground_of_control(controlled: float | None) -> Ground | None:
    """Below a tenth no other measurement could find an error in this one."""
    if controlled is None:
        return None
    return Ground("doubt.redundancy", controlled, 0.6 * _share((0.3 - controlled) / 0.3))


def _share(value: float) -> float:
    return min(max(value, 0.0), 1.0)


def _figure(row: Row, sorting: Sorting) -> float | tuple[str, str]:
    match sorting.column:
        case "photo":
            return row.key[1], row.key[0]
        case "point":
            return row.key
        case "misfit":
            return row.misfit_px
        case "doubt":
            return row.doubt
        case "score":
            return row.score
        case _:
            return row.gain
