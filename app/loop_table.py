"""The queue's rows, kept up with no more work than each change needs."""

from collections.abc import Collection, Mapping

from ui.review.picture import row_line
from ui.review.queue import Away, Gains, Row, away_of, moved_away, queue_row, queue_rows
from ui.review.state import DeskState, Key


class Table:
    """Rows of everything that can be judged, and the same as lines for the pages."""

    def __init__(self) -> None:
        self.rows: dict[Key, Row] = {}
        self.places: dict[Key, int] = {}
        self.lines: list[list[object]] = []
        self.by_point: dict[str, list[Key]] = {}
        self.away = Away({}, {})

    def renewed(self, state: DeskState, gains: Gains | None = None) -> "Table":
        """After an adjustment, or when rows came or went: another table, this one stays as it is.

        Lines that say the same are the same objects, so that they are not written again.
        """
        fresh = Table()
        fresh.away = away_of(state, self.away.gains if gains is None else gains)
        fresh.rows = {row.key: row for row in queue_rows(state, fresh.away)}
        fresh.places = {key: number for number, key in enumerate(fresh.rows)}
        fresh.lines = [self._line(key, row_line(row)) for key, row in fresh.rows.items()]
        for key in fresh.rows:
            fresh.by_point.setdefault(key[0], []).append(key)
        return fresh

    def _line(self, key: Key, line: list[object]) -> list[object]:
        place = self.places.get(key)
        return self.lines[place] if place is not None and self.lines[place] == line else line

    def touch(self, state: DeskState, keys: Collection[Key]) -> None:
        """After a decision: only what it was about, in the same adjustment."""
        self.away = moved_away(self.away, state, keys)
        self.lines = list(self.lines)
        for key in keys:
            self.rows[key] = queue_row(state, self.away, key)
            self.lines[self.places[key]] = row_line(self.rows[key])


def changed_keys(before: DeskState, after: DeskState) -> set[Key] | None:
    """Rows that a decision changed; None when rows came or went."""
    one, other = before.block, after.block
    if one.measurements.keys() != other.measurements.keys():
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
    return changed | {key for key in other.measurements if turned and key[0] in turned}


def _differing(one: Mapping[Key, object], other: Mapping[Key, object]) -> set[Key]:
    """Keys whose value is another; the same object is never looked into."""
    return {key for key, value in other.items() if one[key] is not value and one[key] != value}
