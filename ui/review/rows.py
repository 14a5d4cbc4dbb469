"""Rows: one for each measurement, with its doubts."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from core.adjustment.expected_gain import Gain
from core.block import Measurement
from core.quality.controllability import controllability, is_unchecked
from ui.review.drafts import by_hand
from ui.review.grounds import grounds_of
from ui.review.looks import ShownState, short
from ui.review.misfit import Misfit, misfits, ramp_top_m
from ui.review.second_reading import readings_of
from ui.review.state import DeskState, DoubtReason, Key, Kind
from ui.review.to_measure import worth_of_rows

Gains = Mapping[Key, Gain]
INFLUENCE_FLOOR = 0.4
"""Share of the gain that does not depend on how much a measurement steers the block."""
MOVES_NOTHING = 0.02
"""So much of the gain by rule of thumb counts where others are known in metres."""
UNUSED_GAIN = 1e-6
"""What the engine left out comes after what steers the block."""


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
    """Likeness, 0 to 1; NaN where a hand placed it."""
    controlled: float | None
    """Share of an error here that would show, 0 to 1."""
    grounds: tuple[DoubtReason, ...]
    """Why it is doubtful, heaviest first."""
    disputed_m: float = math.nan
    """Where a human accepted what the block contradicts: how far apart, metres; else NaN."""
    readings: int = 0
    """So many operators have placed it, of points of the user."""
    sigmas: float = math.nan
    """The misfit in its standard deviations; NaN when it is not known."""
    place: tuple[float, float] = (math.nan, math.nan)
    """Easting and northing of the point, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class QueueFigures:
    """How every measurement lies to one adjustment; found once for each."""

    misfits: Mapping[Key, Misfit]
    """Misfits by measurement."""
    controlled: Mapping[Key, float]
    """Controllability by measurement."""
    gains: Gains = field(default_factory=dict[Key, Gain])
    """What looking at one is expected to bring; empty where that was not found."""
    disputed: Mapping[Key, float] = field(default_factory=dict[Key, float])
    """How far the block puts an accepted measurement from where it is, metres."""
    worth: Mapping[Key, float] = field(default_factory=dict[Key, float])
    """What measuring a point in a photo where nobody did would bring, metres."""
    ramp_top_m: float = 1.0
    """Where the ramp of the misfits' sizes ends, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class QueueTable:
    """Rows of everything that can be judged, and the same as lines for the pages."""

    rows: Mapping[Key, Row]
    """Rows by key, in their order."""
    places: Mapping[Key, int]
    """Number of each row in that order."""
    lines: list[list[Any]]
    """The rows as the pages get them."""
    by_point: Mapping[str, Sequence[Key]]
    """Keys of each point."""
    figures: QueueFigures
    """What the rows were made of."""

    def renewed(self, state: DeskState) -> "QueueTable":
        """After an adjustment, or when rows came or went.

        Lines that say the same are the same objects, so that they are not written again.
        """
        figures = queue_figures(state)
        rows = {row.key: row for row in queue_rows(state, figures)}
        by_point: dict[str, list[Key]] = {}
        for key in rows:
            by_point.setdefault(key[0], []).append(key)
        places = {key: number for number, key in enumerate(rows)}
        lines = [self._line(key, row_line(row)) for key, row in rows.items()]
        return QueueTable(rows, places, lines, by_point, figures)

    def with_changes(self, before: DeskState, after: DeskState) -> "QueueTable":
        """After a decision, in the same adjustment: only the rows that it was about."""
        keys = changed_keys(before, after)
        if not self.rows or keys is None or not keys <= self.rows.keys():
            return self.renewed(after)
        fresh = {**self.figures.misfits, **misfits(after, keys)}
        figures = replace(self.figures, misfits=fresh)
        rows, lines = dict(self.rows), list(self.lines)
        for key in keys:
            rows[key] = queue_row(after, figures, key)
            lines[self.places[key]] = row_line(rows[key])
        return replace(self, rows=rows, lines=lines, figures=figures)

    def with_point(self, state: DeskState, name: str) -> "QueueTable":
        """With the rows of one more point behind all others: a draft, so nobody decided them."""
        every = {**state.to_measure.waiting, **state.block.measurements}
        keys = sorted(key for key in every if key[0] == name and key not in self.rows)
        fresh = {**self.figures.misfits, **misfits(state, keys)}
        figures = replace(self.figures, misfits=fresh)
        more = {key: replace(queue_row(state, figures, key), human=False) for key in keys}
        rows = {**self.rows, **more}
        return QueueTable(
            rows,
            {key: number for number, key in enumerate(rows)},
            [*self.lines, *(row_line(row) for row in more.values())],
            {**self.by_point, name: keys},
            figures,
        )

    def _line(self, key: Key, line: list[Any]) -> list[Any]:
        place = self.places.get(key)
        return self.lines[place] if place is not None and self.lines[place] == line else line


NO_ROWS = QueueTable({}, {}, [], {}, QueueFigures({}, {}))


def changed_keys(before: DeskState, after: DeskState) -> set[Key] | None:
    """Rows that a decision changed; None when rows came or went."""
    one, other = before.block, after.block
    if one.measurements.keys() != other.measurements.keys():
        return None
    if before.to_measure.waiting is not after.to_measure.waiting:
        return None
    extra, fresh = before.extra.measurements, after.extra.measurements
    if extra.keys() != fresh.keys():
        return None
    changed = _differing(one.measurements, other.measurements) | _differing(extra, fresh)
    turned = {
        name
        for name, point in other.surveyed.items()
        if (known := one.surveyed.get(name)) is not point
        and (known is None or known.role != point.role)
    }
    photos = {photo_id for name, photo_id in changed if after.extra.kinds.get(name) == "photo"}
    if not turned and not photos:
        return changed
    return changed | {key for key in other.measurements if key[0] in turned or key[1] in photos}


def _differing(one: Mapping[Key, object], other: Mapping[Key, object]) -> set[Key]:
    """Keys whose value is another; the same object is never looked into."""
    return {key for key, value in other.items() if one[key] is not value and one[key] != value}


def row_line(row: Row) -> list[Any]:
    """One line of the table."""
    return [*row.key, row.role, row.state, int(row.human), short(row.doubt, 2),
            short(row.misfit_px, 2), short(row.score, 2), short(row.disputed_m, 1),
            short(row.sigmas, 1), row.readings, *(short(value, 1) for value in row.place),
            int(is_unchecked(row.controlled))]  # fmt: skip


def queue_figures(state: DeskState) -> QueueFigures:
    """Misfits and controllability of all measurements of a state."""
    keys = (*state.block.measurements, *state.extra.measurements, *state.to_measure.proposals)
    disputed = {one.key: one.metres for one in state.report.contradictions}
    away = misfits(state, keys)
    return QueueFigures(
        away, controllability(state.report), state.evidence.gains, disputed, worth_of_rows(state),
        ramp_top_m(state, away),
    )  # fmt: skip


def queue_rows(state: DeskState, figures: QueueFigures | None = None) -> tuple[Row, ...]:
    """Every measurement of a surveyed point, in the order of point and photo; then the rest.

    What is to be measured stands among the measured.
    """
    figures = figures or queue_figures(state)
    keys = sorted({*state.block.measurements, *state.to_measure.waiting})
    known = [key for key in keys if key[0] in state.block.surveyed]
    return tuple(
        queue_row(state, figures, key) for key in (*known, *sorted(state.extra.measurements))
    )


def queue_row(state: DeskState, figures: QueueFigures, key: Key) -> Row:
    """One row."""
    measurement = state.measurement_of(key)
    assert measurement is not None, "rows are made of measurements"
    if key in state.extra.measurements:
        row = _extra_row(state, measurement, figures.misfits.get(key))
    elif state.is_waiting(key):
        row = _waiting_row(state, measurement, figures)
    else:
        row = _row(state, measurement, figures)
    point = state.point_of(key[0])
    if point is None:
        return row
    return replace(row, place=(float(point.position[0]), float(point.position[1])))


def _row(state: DeskState, measurement: Measurement, figures: QueueFigures) -> Row:
    misfit = figures.misfits.get(measurement.key)
    controlled = figures.controlled.get(measurement.key)
    shown = state.shown_state(measurement)
    accepted = measurement.status == "accepted"
    disputed = figures.disputed.get(measurement.key, math.nan) if accepted else math.nan
    grounds = grounds_of(measurement, misfit, controlled, disputed)
    doubt = 1 - math.prod(1 - ground.weight for ground in grounds)
    human = measurement.status in ("accepted", "rejected", "dubious")
    if misfit and not math.isnan(disputed):
        gain = misfit.ratio / (1 + misfit.ratio)
    elif human or state.is_idle(measurement.key):
        gain = 0.0
    elif shown == "unused":
        # What the block nearly agrees with is the likeliest to be taken in after all.
        gain = UNUSED_GAIN / (1 + (misfit.ratio if misfit else 9.0))
    else:
        gain = _gain(doubt, controlled, figures, measurement.key)
    return Row(
        key=measurement.key,
        role=state.block.surveyed[measurement.point_id].role,
        state=shown,
        human=human,
        doubt=doubt,
        gain=gain,
        misfit_px=math.hypot(*misfit.pixels) if misfit else math.nan,
        sigmas=misfit.ratio if misfit else math.nan,
        score=math.nan if by_hand(measurement) else measurement.score,
        controlled=controlled,
        grounds=grounds,
        disputed_m=disputed,
        readings=readings_of(state, measurement),
    )


def _waiting_row(state: DeskState, expected: Measurement, figures: QueueFigures) -> Row:
    """A point of the user that nobody has measured in this photo."""
    key = expected.key
    shown, misfit = state.shown_state(expected), figures.misfits.get(key)
    proposed = shown == "proposed"
    worth = figures.worth.get(key, 0.0)
    return Row(
        key=key,
        role=state.block.surveyed[key[0]].role,
        state=shown,
        human=False,
        doubt=1 - expected.score if proposed else 0.0,
        gain=worth / (1 + worth),
        misfit_px=math.hypot(*misfit.pixels) if misfit and proposed else math.nan,
        sigmas=misfit.ratio if misfit and proposed else math.nan,
        score=expected.score if proposed else math.nan,
        controlled=None,
        grounds=(),
    )


def _gain(doubt: float, controlled: float | None, figures: QueueFigures, key: Key) -> float:
    """Doubt times influence: in metres of m_p where the block was asked, else by rule of thumb."""
    if key in figures.gains:
        expected = figures.gains[key].expected_m
        return expected / (1 + expected)
    influence = 1 - (controlled if controlled is not None else 0.8)
    gain = doubt * (INFLUENCE_FLOOR + (1 - INFLUENCE_FLOOR) * influence)
    # Check points and the like move nothing.
    return MOVES_NOTHING * gain if figures.gains else gain


def _extra_row(state: DeskState, measurement: Measurement, misfit: Misfit | None) -> Row:
    """Tie point, photo or fiducial: doubtful by what made it one."""
    human = measurement.status in ("accepted", "rejected")
    doubt, reason = 1.0 - measurement.score, state.extra.reasons.get(measurement.key)
    return Row(
        key=measurement.key,
        role=state.extra.kinds[measurement.point_id],
        state=measurement.status,
        human=human,
        doubt=doubt,
        gain=0.0 if human else doubt,
        misfit_px=math.hypot(*misfit.pixels) if misfit else math.nan,
        sigmas=misfit.ratio if misfit else math.nan,
        score=math.nan,
        controlled=None,
        grounds=(reason,) if reason else (),
    )
