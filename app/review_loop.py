"""The one thread that owns session, state and screen: gesture in, picture out, in order."""

import queue
import threading
from dataclasses import replace

import numpy as np

from app.loop_doors import Closed, Event, LoopInputs, SceneOpened, Screen, SeatLeft, SeatTaken
from app.worker import (
    Adjusted,
    RemakeEnded,
    Remaker,
    RemakeStep,
    Tried,
    Worker,
    survived,
)
from core.doubts import Failure
from sessions.decisions import Decision, Recorded, Reject, Withdraw, standing
from ui.review.compare import (
    Drawn,
    drawn_from_block,
    redrawn,
    stale_photos,
    with_made,
)
from ui.review.gestures import Gesture
from ui.review.picture import (
    Part,
    Pictured,
    point_part,
    queue_part,
    rows_part,
    scene_part,
    status_part,
)
from ui.review.queue import Row, queue_rows
from ui.review.scene import (
    ScenePicture,
    Segments,
    footprints,
    readable_scale,
    scene_picture,
)
from ui.review.state import Key, Notice, Remaking, SceneOptions, Seat
from ui.review.tools import Desk, Meaning, kept_up, meaning, seated
from ui.review.trial import Trial, trial_of, tried_block


class ReviewLoop:
    """Takes events in order, one at a time; nothing else changes what the desk knows."""

    def __init__(self, inputs: LoopInputs, screen: Screen) -> None:
        self._inputs, self._screen = inputs, screen
        self._session = inputs.session
        self._inbox: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._seats: dict[str, Seat] = {}
        self._present: set[str] = set()
        self._scenes: set[str] = set()
        self._state = inputs.state
        self._drawn: Drawn = drawn_from_block(inputs.state.oriented)
        self._rows: dict[Key, Row] = {}
        self._stale: tuple[str, ...] = ()
        self._outlines: Segments = np.zeros((0, 2, 3))
        self._job, self._tried = 0, 0
        self._trials: dict[Key, Trial] = {}
        self._trying: Key | None = None
        self._last: Recorded | None = None
        self._scene: ScenePicture | None = None
        self._worker: Worker | None = None
        self._remaker: Remaker | None = None
        self._thread = threading.Thread(target=self._run, name="review", daemon=True)

    def start(self, worker: Worker, remaker: Remaker) -> None:
        """Begin: lay earlier decisions over the block, and adjust if there are any."""
        self._worker, self._remaker = worker, remaker
        self._screen.publish(self._drawn)
        self._reorient()
        self._replay()
        if self._state.decided:
            self._state = replace(self._state, adjusting=True)
            self._adjust()
        self._thread.start()

    def submit(self, event: Event) -> None:
        """Hand in an event, from any thread."""
        self._inbox.put(event)

    def close(self) -> None:
        """End after what is already in the inbox."""
        self._inbox.put(Closed())
        self._thread.join(timeout=10)

    def _run(self) -> None:
        while True:
            event = self._inbox.get()
            if isinstance(event, Closed):
                return
            failure = survived(self._handle, event)
            if failure:
                self._screen.tell("", Notice("notice.not-done", {"why": failure}, grave=True))

    def _handle(self, event: Event) -> None:
        match event:
            case SeatTaken(seat_id=seat_id):
                self._present.add(seat_id)
                self._show_seat(self._seat(seat_id))
            case SeatLeft(seat_id=seat_id):
                self._present.discard(seat_id)
            case SceneOpened(seat_id=seat_id):
                self._scenes.add(seat_id)
                self._show_scene(self._seat(seat_id))
            case Adjusted():
                self._take_adjustment(event)
            case Tried():
                self._take_trial(event)
            case RemakeStep() | RemakeEnded():
                self._take_remake(event)
            case Closed():
                pass
            case gesture:
                self._take_gesture(gesture)

    def _take_gesture(self, gesture: Gesture) -> None:
        """Meaning, then disk, then picture, then background."""
        seat = self._seat(gesture.seat_id)
        found = meaning(gesture, seat, self._desk())
        recorded = self._record(found)
        self._seats[seat.seat_id] = found.seat
        if found.notice is not None:
            self._screen.tell(seat.seat_id, found.notice)
        if recorded is not None:
            self._decided()
        elif found.act:
            self._do(found)
        else:
            self._show_seat(found.seat)
            self._show_scene(found.seat)

    def _record(self, found: Meaning) -> Recorded | None:
        """Only once it is on disk does anything else happen."""
        if found.decision is None:
            return None
        operator, last = found.seat.operator, self._last
        if found.act == "amend" and last is not None and _same_point(last, found.decision):
            # The reason belongs to the rejection just made: one decision, one undo.
            self._session.undo(operator)
        self._last = self._session.record(found.decision, seen=self._state.block, operator=operator)
        return self._last

    def _do(self, found: Meaning) -> None:
        match found.act:
            case "undo" | "redo":
                self._turn_back(found)
            case "remake":
                self._remake(found.seat)
            case "cancel" if self._state.remaking is not None and self._remaker is not None:
                self._remaker.cancel()
                remaking = replace(self._state.remaking, cancelling=True)
                self._state = replace(self._state, remaking=remaking)
                self._show_status()
            case "fit whole" | "fit current":
                whole = found.act == "fit whole"
                self._screen.fit(found.seat.seat_id, found.seat, self._state.oriented, whole)
            case _:
                pass

    def _turn_back(self, found: Meaning) -> None:
        """Undo or redo the operator's own last decision, and look at what it was about."""
        seat = found.seat
        door = self._session.undo if found.act == "undo" else self._session.redo
        recorded = door(seat.operator)
        if recorded is None:
            self._screen.tell(seat.seat_id, Notice(f"notice.nothing-to-{found.act}"))
            return
        self._last = None
        touched = _touched(recorded, self._session.decisions())
        self._decided()
        if touched is None:
            return
        key = _key_of(touched.decision)
        if key is not None and key in self._rows:
            self._seats[seat.seat_id] = replace(self._seats[seat.seat_id], current=key)
            self._show_seat(self._seats[seat.seat_id])
            self._show_scene(self._seats[seat.seat_id])
        about = " \u00b7 ".join(key) if key else getattr(touched.decision, "point_id", "")
        notice = f"notice.{found.act}.{type(touched.decision).__name__}"
        self._screen.tell(seat.seat_id, Notice(notice, {"what": about}))

    def _decided(self) -> None:
        """Something new is on disk: lay it over the block, show it, and adjust."""
        self._replay()
        self._state = replace(self._state, adjusting=True, written=False)
        self._show_all()
        self._adjust()

    def _replay(self) -> None:
        decisions = self._session.decisions()
        plain = [d for d in standing(decisions) if not isinstance(d.decision, Withdraw)]
        block = self._session.replayed(self._inputs.base)
        self._state = replace(self._state, block=block, decided=len(plain))
        self._recount()

    def _adjust(self) -> None:
        """Capture the block and hand it to the worker, in place of what it may be doing."""
        if self._worker is None:
            return
        self._job += 1
        self._worker.submit(self._job, self._state.block)

    def _take_adjustment(self, event: Adjusted) -> None:
        if event.number != self._job:
            return
        if isinstance(event.result, Failure):
            self._state = replace(self._state, adjusting=False)
            why = {"why": event.result.reason}
            self._screen.tell("", Notice("notice.adjustment-failed", why, grave=True))
            self._show_status()
            return
        self._state = replace(
            self._state, report=event.result, before=self._state.report, adjusting=False
        )
        self._trials.clear()
        self._drawn = redrawn(self._drawn, self._state.oriented)
        self._screen.publish(self._drawn)
        self._inputs.adopted(event.result)
        self._reorient()
        self._recount()
        self._show_all()

    def _try_out(self, key: Key | None) -> None:
        """Find out what turning a measurement would do, while the operator looks at it."""
        if key is None or key in self._trials or self._state.adjusting or self._worker is None:
            return
        block = tried_block(self._state, key)
        self._tried += 1
        if block is not None:
            self._trying = key
            self._worker.try_out(self._tried, block)

    def _take_trial(self, event: Tried) -> None:
        if event.number != self._tried or self._state.adjusting or self._trying is None:
            return
        trial = trial_of(self._state, self._trying, event.report)
        if trial is None:
            return
        self._trials[trial.key] = trial
        for seat in self._present_seats():
            if seat.current == trial.key:
                self._screen.show(seat.seat_id, {"point": self._point(seat)})
        for seat in self._present_seats():
            if seat.current not in self._trials:
                self._try_out(seat.current)

    def _remake(self, seat: Seat) -> None:
        if self._remaker is None or self._remaker.busy:
            return
        if self._state.written and not self._stale:
            self._screen.tell(seat.seat_id, Notice("notice.remake-none"))
            return
        self._state = replace(self._state, remaking=Remaking())
        self._remaker.start(self._stale, self._state.report)
        self._show_status()

    def _take_remake(self, event: RemakeStep | RemakeEnded) -> None:
        if isinstance(event, RemakeStep):
            cancelling = self._state.remaking is not None and self._state.remaking.cancelling
            remaking = Remaking(event.done, event.total, event.what, event.seconds_left, cancelling)
            self._state = replace(self._state, remaking=remaking)
            self._show_status()
            return
        self._state = replace(self._state, remaking=None)
        if event.failure:
            notice = Notice("notice.remake-failed", {"why": event.failure}, grave=True)
        elif event.cancelled:
            notice = Notice("notice.remake-cancelled")
        else:
            made = replace(self._state, report=event.made_with).oriented
            self._state = with_made(self._state, event.photo_ids, made)
            written = event.made_with is self._state.report and not self._state.adjusting
            self._state = replace(self._state, written=written)
            notice = Notice("notice.remade" if event.photo_ids else "notice.written")
        self._reorient()
        self._scene = None
        self._screen.tell("", notice)
        self._show_all()

    def _reorient(self) -> None:
        """What follows from the orientations."""
        self._stale = stale_photos(self._state, self._inputs.stale_m)
        self._outlines = footprints(self._state.oriented, self._inputs.dem)

    def _recount(self) -> None:
        """What follows from the measurements."""
        self._rows = {row.key: row for row in queue_rows(self._state)}
        self._scene = None
        self._seats = {name: kept_up(seat, self._rows) for name, seat in self._seats.items()}

    def _seat(self, seat_id: str) -> Seat:
        if seat_id not in self._seats:
            scene = SceneOptions(vector_scale=readable_scale(self._state))
            fresh = Seat(seat_id, self._inputs.operator, scene=scene)
            self._seats[seat_id] = seated(fresh, self._rows)
        return self._seats[seat_id]

    def _present_seats(self) -> list[Seat]:
        return [seat for seat_id, seat in self._seats.items() if seat_id in self._present]

    def _desk(self) -> Desk:
        return Desk(self._state, self._rows, self._drawn, self._inputs.dem, self._inputs.likeness)

    def _show_all(self) -> None:
        rows = rows_part(self._rows)
        for seat in self._present_seats():
            self._show_seat(seat, rows)
        for seat in self._present_seats():
            self._show_scene(seat)

    def _show_seat(self, seat: Seat, rows: Part = None) -> None:
        parts = {
            "rows": rows if rows is not None else rows_part(self._rows),
            "queue": queue_part(seat, self._rows),
            "scene": scene_part(seat),
            "status": self._status(seat),
            "point": self._point(seat),
        }
        self._screen.show(seat.seat_id, parts)
        self._try_out(seat.current)

    def _point(self, seat: Seat) -> Part:
        trial = self._trials.get(seat.current) if seat.current else None
        dem = self._inputs.dem
        return point_part(self._state, seat, self._rows, Pictured(self._drawn, dem, trial))

    def _show_status(self) -> None:
        for seat in self._present_seats():
            self._screen.show(seat.seat_id, {"status": self._status(seat)})

    def _status(self, seat: Seat) -> Part:
        return status_part(self._state, self._rows, self._stale, seat)

    def _show_scene(self, seat: Seat) -> None:
        if seat.seat_id not in self._scenes:
            return
        if self._scene is None:
            self._scene = scene_picture(self._state, self._stale, self._outlines)
        self._screen.scene(seat.seat_id, self._scene, seat, self._state.oriented)


def _touched(recorded: Recorded, decisions: tuple[Recorded, ...]) -> Recorded | None:
    """The decision that a withdrawal, or the withdrawal of a withdrawal, is about."""
    by_number = {item.decision_id: item for item in decisions}
    found: Recorded | None = recorded
    while found is not None and isinstance(found.decision, Withdraw):
        found = by_number.get(found.decision.decision_id)
    return found


def _key_of(decision: Decision) -> Key | None:
    point_id, photo_id = getattr(decision, "point_id", None), getattr(decision, "photo_id", None)
    return (point_id, photo_id) if point_id is not None and photo_id is not None else None


def _same_point(last: Recorded, decision: Decision) -> bool:
    """True when the last decision is the rejection that this one gives the reason of."""
    return isinstance(last.decision, Reject) and _key_of(last.decision) == _key_of(decision)
