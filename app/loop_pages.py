"""What each seat's pages show of one moment of the desk."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from app.loop_doors import LoopInputs, Screen
from app.loop_table import Table
from sessions.decisions import Recorded
from ui.review.board import board_part
from ui.review.compare import Drawn
from ui.review.history import history_of
from ui.review.milestones import Milestone
from ui.review.picture import (
    Part,
    Pictured,
    order_part,
    point_part,
    queue_part,
    scene_part,
    status_part,
)
from ui.review.placement import placement_part
from ui.review.quality import quality_part
from ui.review.scene import Segments
from ui.review.state import DeskState, Key, Seat
from ui.review.trial import Trial


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """All that can be shown."""

    state: DeskState
    """The block and its adjustment."""
    table: Table
    """Rows of the queue."""
    drawn: Drawn
    """Photos as their tiles are drawn."""
    stale: tuple[str, ...]
    """Photos with stale orthos."""
    outlines: Segments
    """Footprints, local frame."""
    present: Sequence[Seat]
    """Who sits at the desk."""
    trials: Mapping[Key, Trial]
    """What turning a measurement would do."""
    recorded: Sequence[Recorded]
    """Every decision."""
    milestones: tuple[Milestone, ...]
    """Adjustments of this sitting."""


class Pages:
    """Makes the parts of a page and hands them to the screen."""

    def __init__(self, screen: Screen, inputs: LoopInputs) -> None:
        self._screen, self._dem, self._inputs = screen, inputs.dem, inputs

    def show(self, seat: Seat, moment: Moment) -> None:
        """Everything of one seat."""
        table, others = moment.table, elsewhere(seat, moment.present)
        looked_at = [(other.current, other.operator) for other in others if other.current]
        parts: dict[str, Part] = {
            "point": self.point(seat, moment),
            "rows": table.lines,
            "order": order_part(seat, table.places),
            "queue": queue_part(seat, table.places, looked_at),
            "scene": scene_part(seat),
            "status": status_part(moment.state, table.rows, moment.stale, seat, others),
        }
        if seat.quality:
            parts["quality"] = quality_part(
                moment.state, moment.outlines, moment.milestones, seat.pair
            )
        if seat.sheet == "board":
            parts["board"] = board_part(
                moment.state, self._inputs.origins, moment.drawn, moment.recorded
            )
        if seat.sheet == "placement":
            given = self._inputs
            parts["placement"] = placement_part(moment.state, given.origins, given.doubts)
        self._screen.show(seat.seat_id, parts)

    def show_point(self, seat: Seat, moment: Moment) -> None:
        """Only the numbers of what is current."""
        self._screen.show(seat.seat_id, {"point": self.point(seat, moment)})

    def show_status(self, moment: Moment) -> None:
        """Only the status line, for everybody."""
        for seat in moment.present:
            others = elsewhere(seat, moment.present)
            part = status_part(moment.state, moment.table.rows, moment.stale, seat, others)
            self._screen.show(seat.seat_id, {"status": part})

    def show_people(self, seat: Seat, moment: Moment) -> None:
        """Where the others are: to everybody but the seat that moved."""
        for other in elsewhere(seat, moment.present):
            others = elsewhere(other, moment.present)
            looked_at = [(one.current, one.operator) for one in others if one.current]
            status = status_part(moment.state, moment.table.rows, moment.stale, other, others)
            queue = queue_part(other, moment.table.places, looked_at)
            self._screen.show(other.seat_id, {"queue": queue, "status": status})

    def point(self, seat: Seat, moment: Moment) -> Part:
        """The numbers of what a seat looks at."""
        key, table = seat.current, moment.table
        if key is None:
            return None
        pictured = Pictured(
            moment.drawn,
            self._dem,
            moment.trials.get(key),
            history_of(key, moment.recorded, moment.state.extra),
            table.by_point.get(key[0], ()),
        )
        return point_part(moment.state, seat, table.rows, pictured)


def elsewhere(seat: Seat, present: Sequence[Seat]) -> list[Seat]:
    """The others at the desk."""
    return [other for other in present if other.seat_id != seat.seat_id]
