"""The queue: rows sorted, filtered and walked through."""

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import chain

from core.quality.controllability import is_unchecked
from ui.review.rows import Row
from ui.review.state import (
    POINT_KINDS,
    Key,
    QueueFilter,
    Seat,
    SortColumn,
    Sorting,
    StateFilter,
)
from ui.review.to_measure import WAITING

UNDECIDED = ("auto", *WAITING)
"""States of what there is to do."""


def sort_keys(rows: Iterable[Row], sorting: Sorting) -> tuple[Key, ...]:
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
    return tuple(_shown(rows, seat, seat.order))


def passes(row: Row, wanted: QueueFilter) -> bool:
    """True when a filter lets a row through."""
    if not _is_in(row, wanted.state) or (wanted.photo_id and wanted.photo_id != row.key[1]):
        return False
    if row.role != wanted.role if wanted.role else row.role not in POINT_KINDS:
        return False
    named = not wanted.text or wanted.is_named(row.key[0])
    return named and (not wanted.area or wanted.is_within(row.place))


def _is_in(row: Row, wanted: StateFilter) -> bool:
    """True for a row of one state, or of any."""
    match wanted:
        case "all":
            return True
        case "open":
            return row.state == "auto"
        case "measure":
            return row.state in WAITING
        case "second":
            return row.readings == 1 and row.state == "accepted"
        case "unchecked":
            return is_unchecked(row.controlled)
        case "disputed":
            return not math.isnan(row.disputed_m)
        case _:
            return row.state == wanted


def neighbour(
    rows: Mapping[Key, Row], seat: Seat, step: int, *, undecided: bool = False
) -> Key | None:
    """The next (+1) or previous (-1) key of the queue from the current one; stays at the ends.

    Args:
        rows: All rows.
        seat: The seat.
        step: Which way.
        undecided: Only what nobody has decided.
    """
    here = _place(seat)
    before, after = reversed(seat.order[: max(here, 0)]), iter(seat.order[here + 1 :])
    # Behind the last one nothing comes: then it is the last one.
    turned = chain(after, reversed(seat.order)) if step > 0 else chain(before, iter(seat.order))
    return next(_shown(rows, seat, turned, undecided=undecided), None)


def next_open(rows: Mapping[Key, Row], seat: Seat) -> Key | None:
    """The next undecided key of the queue; simply the next one where all of it is decided."""
    return neighbour(rows, seat, 1, undecided=True) or neighbour(rows, seat, 1)


def _shown(
    rows: Mapping[Key, Row], seat: Seat, keys: Iterable[Key], *, undecided: bool = False
) -> Iterator[Key]:
    """Those of some keys that the seat's queue shows, as they are asked for."""
    for key in keys:
        row = rows.get(key)
        if row is None or (undecided and row.state not in UNDECIDED):
            continue
        if passes(row, seat.filter):
            yield key


def _place(seat: Seat) -> int:
    """Where the current key stands in the queue's order; -1 where it does not."""
    return seat.order.index(seat.current) if seat.current in seat.order else -1


def with_filter(seat: Seat, rows: Mapping[Key, Row], wanted: QueueFilter) -> Seat:
    """The seat under another filter, where it was under it before, or at the next thing there."""
    # A name that is being typed is a filter with every letter: none is come back to.
    kept = seat.current and not seat.filter.text
    places = {**dict(seat.places), **({seat.filter: seat.current} if kept else {})}
    # What a search found stays in sight when the field is emptied.
    found = replace(wanted, text=seat.filter.text) == seat.filter and seat.current
    there = found or places.get(wanted, seat.current)
    if wanted.area not in ((), seat.filter.area) and not seat.scene.inside:
        # An area takes points of all photos: those of a chosen one are no longer shown alone.
        seat = replace(seat, scene=replace(seat.scene, photo=""))
    # What is disputed has become so since the queue was sorted.
    anew = wanted == seat.filter or seat.filter.state != "disputed"
    worst_first = wanted.state == "disputed" and anew
    if worst_first:
        seat = replace(seat, order=sort_keys(rows.values(), seat.sorting))
    seat = replace(seat, filter=wanted, places=tuple(places.items()))
    shown = visible(rows, seat)
    if worst_first:
        there = next(iter(shown), there)
    if there not in shown:
        beside = neighbour(rows, replace(seat, current=there), 1)
        there = seat.current if seat.current in shown else beside
    return replace(seat, current=there)


def showing(seat: Seat, rows: Mapping[Key, Row], key: Key) -> Seat:
    """The seat at a measurement; a filter that hides it gives way as little as it can."""
    row, wanted = rows[key], seat.filter
    if not passes(row, replace(wanted, state="all")):
        role = wanted.role if row.role == wanted.role else ""
        photo_id = wanted.photo_id if row.key[1] == wanted.photo_id else ""
        text = wanted.text if wanted.is_named(row.key[0]) else ""
        area = wanted.area if wanted.is_within(row.place) else ()
        role = role if row.role in POINT_KINDS else row.role
        wanted = QueueFilter(wanted.state, photo_id, role, text, area)
    if not passes(row, wanted):
        wanted = replace(wanted, state=_filter_of(row))
    if wanted != seat.filter:
        seat = with_filter(seat, rows, wanted)
    return replace(seat, current=key)


def coming(rows: Mapping[Key, Row], seat: Seat, taken: Collection[Key] = ()) -> Iterator[Key]:
    """Measurements of the queue nobody has looked at: those behind the current one, then before.

    Those that others are looking at are left to them.
    """
    here = _place(seat)
    turned = chain(seat.order[here + 1 :], seat.order[: max(here, 0)])
    shown = _shown(rows, seat, turned, undecided=True)
    return (key for key in shown if key not in taken)


def seat_down(seat: Seat, rows: Mapping[Key, Row], taken: Collection[Key] = ()) -> Seat:
    """The seat with its queue sorted and something to look at that nobody else looks at."""
    order = sort_keys(rows.values(), seat.sorting)
    current = seat.current if seat.current in rows else None
    seat = replace(seat, order=order, current=current)
    if current is None:
        shown = visible(rows, seat)
        if not shown and any(row.state in WAITING for row in rows.values()):
            seat = replace(seat, filter=replace(seat.filter, state="measure"))
            shown = visible(rows, seat)
        undecided = [key for key in shown if rows[key].state in UNDECIDED]
        free = [key for key in undecided if key not in taken]
        seat = replace(seat, current=next(iter(free or undecided or shown), None))
    return seat


def keep_seat_up(seat: Seat, rows: Mapping[Key, Row]) -> Seat:
    """The seat with measurements that are new at the end of its queue, and no vanished ones.

    Drafts of what has vanished go as well; new points that only drafts begin are not in the rows.
    A seat whose queue was empty looks at what has come to it.
    """
    known, begun, before = set(seat.order), seat.begun, seat.current
    if before is not None and known == set(rows):
        return seat
    order = tuple(key for key in seat.order if key in rows or key[0] in begun)
    fresh = tuple(sorted(key for key in rows if key not in known))
    stays = before is None or before in rows or before[0] in begun
    current = before if stays else _beside(seat, rows)
    drafts = tuple(one for one in seat.drafts if one.key in rows or one.begins)
    seat = replace(seat, order=order + fresh, current=current, drafts=drafts)
    if not stays and current is None and seat.filter.state == "measure":
        # What there was to measure is gone: back to what there is to do.
        return with_filter(seat, rows, QueueFilter())
    if current is None and visible(rows, seat):
        return with_filter(seat, rows, seat.filter)
    return seat


def _beside(seat: Seat, rows: Mapping[Key, Row]) -> Key | None:
    """What stood beside a measurement that has vanished: the next in the queue, or the first."""
    shown = visible(rows, seat)
    here = seat.order.index(seat.current) if seat.current in seat.order else 0
    behind = {key for key in seat.order[here:] if key in rows}
    return next((key for key in shown if key in behind), next(iter(shown), None))


def _filter_of(row: Row) -> StateFilter:
    """The filter that shows a row and what is like it."""
    match row.state:
        case "auto":
            return "open"
        case "predicted" | "proposed":
            return "measure"
        case state:
            return state


def _figure(row: Row, sorting: Sorting) -> float | tuple[str, str]:
    figures: dict[SortColumn, float | tuple[str, str]] = {
        "photo": (row.key[1], row.key[0]), "point": row.key, "misfit": row.misfit_px,
        "doubt": row.doubt, "score": row.score, "gain": row.gain,
        "distance": math.dist(row.place, sorting.place),
    }  # fmt: skip
    return figures[sorting.column]
