"""All that the desk knows at one moment, as one frozen value."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from core.block import Block
from core.doubts import Doubt
from core.quality.job_rules import USUAL_RULES, JobRules
from core.sheets.map_sheets import MapSheet
from sessions.decisions import Decision, Recorded
from sessions.replay import replay
from ui.review.compare import Drawn, HeightSource
from ui.review.history import AdjustmentRecord
from ui.review.queue import keep_seat_up
from ui.review.rows import NO_ROWS, QueueTable, Row
from ui.review.scene import Segments
from ui.review.state import NOTHING_INITIAL, DeskState, Draft, InitialState, Key, Seat
from ui.review.trial import Trial

NO_SEGMENTS = np.zeros((0, 2, 3))


@dataclass(frozen=True, slots=True, eq=False)
class DeskSnapshot:
    """All that can be shown, and all that a gesture may be about."""

    base: Block
    """The block as the engine left it, before any decision."""
    state: DeskState
    """The block and its adjustment."""
    dem: HeightSource
    """Heights of the ground."""
    drawn: Drawn
    """Photos as their tiles are drawn."""
    initial: InitialState = NOTHING_INITIAL
    """What the photos began from."""
    doubts: tuple[Doubt, ...] = ()
    """What the engine was unsure of."""
    table: QueueTable = NO_ROWS
    """Rows of the queue."""
    stale: tuple[str, ...] = ()
    """Photos with stale orthos."""
    outlines: Segments = field(default_factory=lambda: NO_SEGMENTS)
    """Footprints, local frame."""
    tie_vectors: Segments = field(default_factory=lambda: NO_SEGMENTS)
    """Residual vectors of tie points, local frame."""
    trials: Mapping[Key | Draft, Trial | None] = field(
        default_factory=dict[Key | Draft, Trial | None]
    )
    """What turning a measurement or keeping a draft would do; None where that was not found."""
    recorded: Sequence[Recorded] = ()
    """Every decision."""
    height_sigma_m: float = 0.5
    """Standard deviation of the heights of the ground, metres."""
    ortho_sigma_m: float = 0.25
    """Standard deviation per axis of the reference ortho, metres."""
    ortho_pixel_m: float = 0.0
    """Its pixel, metres; nought without one."""
    mosaic_version: str = ""
    """What the mosaic on disk was made of; empty where there is none."""
    rules: JobRules = USUAL_RULES
    """Limits by which the block is judged."""
    rules_stand: bool = True
    """Whether they are those on disk: nobody signs while their file is broken."""
    sheets: tuple[MapSheet, ...] = ()
    """Map sheets as they were cut last."""
    exposed: Mapping[str, str] = field(default_factory=dict[str, str])
    """When each photo was taken, as far as that is known."""
    adjustments: tuple[AdjustmentRecord, ...] = ()
    """Adjustments of this sitting."""
    seats: Mapping[str, Seat] = field(default_factory=dict[str, Seat])
    """Everybody who ever sat down, by seat."""
    present: frozenset[str] = frozenset()
    """Seats with an open page."""

    def after(self, decision: Decision) -> Block:
        """The block with one more decision laid over it, beside all that was decided."""
        number = 1 + max((one.decision_id for one in self.recorded), default=0)
        recorded = *self.recorded, Recorded(number, "", "", decision)
        return replay(self.base, recorded, self.initial.films, self.initial.cameras).block

    @property
    def mosaic_gone(self) -> bool:
        """Whether the file of the mosaic that is shown is no longer there, or another one."""
        return self.state.mosaic is not None and not self.mosaic_version

    @property
    def rows(self) -> Mapping[Key, Row]:
        """The queue's rows by key."""
        return self.table.rows

    def present_seats(self) -> list[Seat]:
        """Who sits at the desk."""
        return [seat for seat_id, seat in self.seats.items() if seat_id in self.present]

    def others(self, seat_id: str) -> list[Seat]:
        """Who else sits at the desk."""
        return [seat for seat in self.present_seats() if seat.seat_id != seat_id]

    def taken(self, seat_id: str) -> frozenset[Key]:
        """What the others are looking at."""
        return frozenset(other.current for other in self.others(seat_id) if other.current)

    def with_seat(self, seat: Seat) -> "DeskSnapshot":
        """The same with one seat changed."""
        return replace(self, seats={**self.seats, seat.seat_id: seat})

    def with_table(self, table: QueueTable) -> "DeskSnapshot":
        """The same with other rows, and every seat's queue kept up with them."""
        same = table.rows.keys() == self.table.rows.keys()
        seats = {
            name: seat if same and seat.current else keep_seat_up(seat, table.rows)
            for name, seat in self.seats.items()
        }
        return replace(self, table=table, seats=seats)
