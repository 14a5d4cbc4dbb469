"""Second readings: the second operator does not see the first place before measuring."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from core.block import Measurement
from sessions.decisions import Place
from ui.review.state import DeskState, Key, Seat
from ui.review.to_measure import with_waiting


def readings_of(state: DeskState, measurement: Measurement) -> int:
    """How many operators have placed a point of the user in a photo."""
    return len(measurement.readings) if measurement.key in state.to_measure.predictions else 0


def is_blind(state: DeskState, seat: Seat, key: Key) -> bool:
    """True where others have placed a point, and who reads it a second time has not yet."""
    measurement = state.block.measurements.get(key)
    if seat.filter.state != "second" or measurement is None or state.is_waiting(key):
        return False
    known = readings_of(state, measurement) > 0
    return known and all(one.operator != seat.operator for one in measurement.readings)


def blind_keys(state: DeskState, seat: Seat) -> tuple[Key, ...]:
    """Everything that a seat is to read a second time and does not see yet."""
    return tuple(key for key in state.to_measure.predictions if is_blind(state, seat, key))


def blinded(state: DeskState, seat: Seat, point_id: str) -> DeskState:
    """The desk as if nobody had placed what a seat has not placed itself, nor proposed it."""
    hidden = {key for key in blind_keys(state, seat) if key[0] == point_id}
    known, measurements = state.to_measure, state.block.measurements
    kept = {key: item for key, item in measurements.items() if key not in hidden}
    proposals = {key: item for key, item in known.proposals.items() if key not in hidden}
    block = replace(state.block, measurements=kept)
    return with_waiting(replace(state, block=block, to_measure=replace(known, proposals=proposals)))


def without_places(history: Iterable[dict[str, Any]], seat: Seat) -> list[dict[str, Any]]:
    """The history of a measurement that does not tell a seat where others have placed it."""
    return [
        {**line, "detail": ("", {})}
        if line["what"] == Place.__name__ and line["who"] != seat.operator
        else line
        for line in history
    ]


def apart_px(measurement: Measurement) -> float:
    """Greatest distance between two readings, scan pixels; 0 of a single one."""
    places = np.array([(one.column, one.row) for one in measurement.readings]).reshape(-1, 2)
    if len(places) < 2:
        return 0.0
    return float(np.linalg.norm(places[:, None] - places[None], axis=2).max())


def readings_part(measurement: Measurement) -> list[Mapping[str, object]]:
    """Every operator's place in the raw scan, where there are several."""
    if len(measurement.readings) < 2:
        return []
    return [
        {"who": one.operator, "raw": [round(one.column, 3), round(one.row, 3)]}
        for one in measurement.readings
    ]
