"""The one thread that owns session, state and screen: gesture in, picture out, in order."""

import queue
import threading
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from app.loop_doors import Closed, Event, LoopInputs, SceneOpened, Screen, SeatLeft, SeatTaken
from app.loop_following import Followed, Following, adopted, scene_once
from app.loop_pages import Moment, Pages, elsewhere
from app.loop_remaking import after_remake, while_remaking
from app.loop_table import Table, changed_keys
from app.worker import (
    Adjusted,
    Measurer,
    PointMeasured,
    RemakeEnded,
    Remaker,
    RemakeStep,
    Tried,
    Worker,
    survived,
)
from core.block.adjusted import AdjustmentReport
from core.doubts import Failure
from core.progress import Silent
from sessions.decisions import Recorded, Withdraw, standing
from ui.review.adding import measured_point, next_name, renamed
from ui.review.compare import Drawn, drawn_from_block, stale_photos
from ui.review.doubtful import extra_of
from ui.review.gestures import Freed, Gesture, PointAsked
from ui.review.history import gives_reason, key_of, subject_of, touched_by
from ui.review.milestones import Milestone, with_milestone
from ui.review.scene import (
    Footprints,
    ScenePicture,
    readable_scale,
    tie_vectors,
)
from ui.review.state import Key, Notice, Remaking, SceneOptions, Seat
from ui.review.tools import Desk, Meaning, kept_up, meaning, seated
from ui.review.trial import Trial, trial_of, tried_block


class ReviewLoop:
    """Takes events in order, one at a time; nothing else changes what the desk knows."""

    def __init__(self, inputs: LoopInputs, screen: Screen) -> None:
        self._inputs, self._screen = inputs, screen
        self._pages, self._table = Pages(screen, inputs), Table()
        self._session = inputs.session
        self._inbox: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._seats: dict[str, Seat] = {}
        self._present: set[str] = set()
        self._scenes: set[str] = set()
        self._state = inputs.state
        self._drawn: Drawn = drawn_from_block(inputs.state.oriented)
        self._recorded: tuple[Recorded, ...] = ()
        self._milestones: tuple[Milestone, ...] = ()
        self._stale: tuple[str, ...] = ()
        self._footprints = Footprints(inputs.dem)
        self._outlines = self._tied = np.zeros((0, 2, 3))
        self._job, self._tried = 0, 0
        self._trials: dict[Key, Trial] = {}
        self._last: Recorded | None = None
        self._scene: Callable[[], ScenePicture] | None = None
        self._worker: Worker | None = None
        self._remaker: Remaker | None = None
        self._measurer = Measurer(self.submit)
        self._thread = threading.Thread(target=self._run, name="review", daemon=True)

    def start(self, worker: Worker, remaker: Remaker) -> None:
        """Begin: lay earlier decisions over the block, and adjust if there are any."""
        self._worker, self._remaker = worker, remaker
        self._table = self._table.renewed(self._state, self._inputs.gains(self._state.report))
        self._screen.publish(self._drawn)
        self._stale = stale_photos(self._state, self._inputs.stale_m)
        self._outlines = self._footprints.of(self._drawn, self._state.oriented.origin)
        self._tied = tie_vectors(self._state)
        self._keep(self._state.report)
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
        self._measurer.close()
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
                self._pages.show_people(self._seat(seat_id), self._moment())
            case SeatLeft(seat_id=seat_id):
                self._present.discard(seat_id)
                self._pages.show_people(self._seat(seat_id), self._moment())
            case SceneOpened(seat_id=seat_id):
                self._scenes.add(seat_id)
                self._show_scene(self._seat(seat_id))
            case Adjusted():
                self._take_adjustment(event)
            case Tried():
                self._take_trial(event)
            case PointMeasured():
                self._take_point(event)
            case RemakeStep() | RemakeEnded():
                self._take_remake(event)
            case Closed():
                pass
            case gesture:
                self._take_gesture(gesture)

    def _take_gesture(self, gesture: Gesture) -> None:
        """Meaning, then disk, then picture, then background."""
        seat = self._seat(gesture.seat_id)
        found = meaning(gesture, seat, self._desk(seat))
        recorded = self._record(found)
        self._seats[seat.seat_id] = found.seat
        if found.notice is not None:
            self._screen.tell(seat.seat_id, found.notice)
        if recorded is not None:
            self._decided(found.seat)
        elif found.act:
            self._do(found, gesture)
        else:
            self._show_seat(found.seat)
            self._show_scene(found.seat)
        if (seat.current, seat.operator) != (found.seat.current, found.seat.operator):
            self._pages.show_people(found.seat, self._moment())

    def _record(self, found: Meaning) -> Recorded | None:
        """Only once it is on disk does anything else happen."""
        if found.decision is None:
            return None
        operator, last = found.seat.operator, self._last
        if (
            found.act == "amend"
            and last is not None
            and gives_reason(last.decision, found.decision)
        ):
            # The reason belongs to the rejection just made: one decision, one undo.
            self._session.undo(operator)
        self._last = self._session.record(found.decision, seen=self._state.block, operator=operator)
        return self._last

    def _do(self, found: Meaning, gesture: Gesture) -> None:
        match found.act:
            case "add" if isinstance(gesture, PointAsked):
                self._ask_point(gesture)
            case "free" if isinstance(gesture, Freed) and self._inputs.choose is not None:
                self._inputs.choose(gesture.cameras, gesture.robust)
                free = gesture.cameras, gesture.robust
                self._state = replace(self._state, free=free, adjusting=True)
                self._pages.show_status(self._moment())
                self._adjust()
            case "undo" | "redo":
                self._turn_back(found)
            case "remake":
                self._remake(found.seat)
            case "cancel" if self._state.remaking is not None and self._remaker is not None:
                self._remaker.cancel()
                remaking = replace(self._state.remaking, cancelling=True)
                self._state = replace(self._state, remaking=remaking)
                self._pages.show_status(self._moment())
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
        touched = touched_by(recorded, self._session.decisions())
        key = None if touched is None else key_of(touched.decision, self._state.extra)
        if key is not None:
            self._seats[seat.seat_id] = replace(self._seats[seat.seat_id], current=key)
        self._decided(self._seats[seat.seat_id])
        if touched is None:
            return
        about = " \u00b7 ".join(key) if key else subject_of(touched.decision)
        notice = f"notice.{found.act}.{type(touched.decision).__name__}"
        self._screen.tell(seat.seat_id, Notice(notice, {"what": about}))

    def _ask_point(self, gesture: PointAsked) -> None:
        """Let a new point be looked for; what comes of it is an event like any other."""
        inputs, state = self._inputs, self._state
        name = next_name(state, self._recorded)
        place, sources = (gesture.east, gesture.north), (inputs.dem, inputs.likeness)
        self._measurer.measure(
            gesture.seat_id,
            lambda: measured_point(state, name, place, sources, inputs.reference_sigma_m, Silent()),
        )

    def _take_point(self, event: PointMeasured) -> None:
        """Record a new point and look at it."""
        seat, found = self._seat(event.seat_id), event.found
        if isinstance(found, Failure):
            notice = Notice("notice.not-done", {"why": found.reason}, grave=True)
            self._screen.tell(seat.seat_id, notice)
            return
        if found.point_id in self._state.block.surveyed:
            # Two were asked for before either was found: the second takes the next name.
            found = renamed(found, next_name(self._state, self._recorded))
        self._last = self._session.record(found, operator=seat.operator)
        best = max(found.measured, key=lambda item: item.score)
        self._seats[seat.seat_id] = replace(seat, current=best.key)
        self._decided(self._seats[seat.seat_id])
        sure = sum(item.used for item in found.measured)
        values = {"what": found.point_id, "sure": f"{sure}", "count": f"{len(found.measured)}"}
        self._screen.tell(seat.seat_id, Notice("notice.added", values))

    def _decided(self, seat: Seat) -> None:
        """Something new is on disk: lay it over the block, show it, and adjust."""
        self._replay()
        self._state = replace(self._state, adjusting=True, written=False)
        # Who decided sees it first.
        self._show_seat(first := self._seats[seat.seat_id])
        for other in elsewhere(first, self._present_seats()):
            self._show_seat(other)
        self._adjust()
        for one in self._present_seats():
            self._show_scene(one)

    def _replay(self) -> None:
        before = self._state
        self._recorded = self._session.decisions()
        plain = [d for d in standing(self._recorded) if not isinstance(d.decision, Withdraw)]
        block = self._session.replayed(self._inputs.base, self._inputs.origins.films)
        self._state = replace(self._state, block=block, decided=len(plain))
        inputs = self._inputs
        extra = extra_of(self._state, inputs.base, self._recorded, inputs.doubts, inputs.dem)
        self._state = replace(self._state, extra=extra)
        self._recount(changed_keys(before, self._state) if self._table.rows else None)

    def _keep(self, report: AdjustmentReport) -> None:
        """Remember an adjustment, to compare others with it."""
        self._milestones = with_milestone(self._milestones, report, self._state)

    def _adjust(self) -> None:
        """Capture the block and hand it to the worker, in place of what it may be doing."""
        if self._worker is None:
            return
        self._job += 1
        following = Following(
            self._state, self._drawn, self._recorded, self._table, self._inputs, self._footprints
        )
        self._worker.submit(self._job, self._state.block, following)

    def _take_adjustment(self, event: Adjusted) -> None:
        if event.number != self._job:
            return
        if isinstance(event.result, Failure):
            self._state = replace(self._state, adjusting=False)
            why = {"why": event.result.reason}
            self._screen.tell("", Notice("notice.adjustment-failed", why, grave=True))
            self._pages.show_status(self._moment())
            return
        assert isinstance(event.followed, Followed), "the loop asks for it with every block"
        self._adopt(event.followed)
        self._inputs.adopted(event.result)
        self._keep(event.result)
        self._show_all()

    def _adopt(self, followed: Followed) -> None:
        """Show what follows from the newest adjustment; it was found beside it."""
        self._state, self._stale = adopted(self._state, followed, self._inputs.stale_m)
        self._trials.clear()
        self._drawn, self._table = followed.drawn, followed.table
        self._outlines, self._tied, self._scene = followed.outlines, followed.tied, None
        self._screen.publish(self._drawn)
        self._keep_up()

    def _try_out(self, key: Key | None) -> None:
        """Find out what turning a measurement would do, while the operator looks at it."""
        if key is None or key in self._trials or self._state.adjusting or self._worker is None:
            return
        block = tried_block(self._state, key)
        self._tried += 1
        if block is not None:
            state = self._state
            self._worker.try_out(self._tried, block, lambda then: trial_of(state, key, then))

    def _take_trial(self, event: Tried) -> None:
        trial = event.found
        if event.number != self._tried or self._state.adjusting or not isinstance(trial, Trial):
            return
        self._trials[trial.key] = trial
        for seat in self._present_seats():
            if seat.current == trial.key:
                self._pages.show_point(seat, self._moment())
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
        self._pages.show_status(self._moment())

    def _take_remake(self, event: RemakeStep | RemakeEnded) -> None:
        if isinstance(event, RemakeStep):
            self._state = while_remaking(self._state, event)
            self._pages.show_status(self._moment())
            return
        self._state, notice = after_remake(self._state, event)
        self._stale = stale_photos(self._state, self._inputs.stale_m)
        self._scene = None
        self._screen.tell("", notice)
        self._show_all()

    def _recount(self, changed: set[Key] | None = None) -> None:
        """What follows from the measurements: of some when only those changed."""
        self._scene = None
        if changed is not None and changed <= self._table.rows.keys():
            self._table.touch(self._state, changed)
            return
        self._table = self._table.renewed(self._state)
        self._keep_up()

    def _keep_up(self) -> None:
        rows = self._table.rows
        self._seats = {name: kept_up(seat, rows) for name, seat in self._seats.items()}

    def _seat(self, seat_id: str) -> Seat:
        if seat_id not in self._seats:
            scene = SceneOptions(vector_scale=readable_scale(self._state))
            fresh = Seat(seat_id, self._inputs.operator, scene=scene)
            taken = [seat.current for seat in self._present_seats() if seat.current]
            self._seats[seat_id] = seated(fresh, self._table.rows, taken)
        return self._seats[seat_id]

    def _present_seats(self) -> list[Seat]:
        return [seat for seat_id, seat in self._seats.items() if seat_id in self._present]

    def _desk(self, seat: Seat) -> Desk:
        taken = frozenset(
            other.current for other in elsewhere(seat, self._present_seats()) if other.current
        )
        given = self._inputs
        return Desk(
            self._state, self._table.rows, self._drawn, given.dem, given.likeness, taken,
            self._recorded, given.origins,
        )  # fmt: skip

    def _moment(self) -> Moment:
        return Moment(
            self._state, self._table, self._drawn, self._stale, self._outlines,
            self._present_seats(), self._trials, self._recorded, self._milestones,
        )  # fmt: skip

    def _show_all(self) -> None:
        for seat in self._present_seats():
            self._show_seat(seat)
        for seat in self._present_seats():
            self._show_scene(seat)

    def _show_seat(self, seat: Seat) -> None:
        self._pages.show(seat, self._moment())
        self._try_out(seat.current)

    def _show_scene(self, seat: Seat) -> None:
        if seat.seat_id not in self._scenes:
            return
        if self._scene is None:
            self._scene = scene_once(
                self._state, self._stale, self._table, self._outlines, self._tied
            )
        self._screen.scene(seat.seat_id, self._scene, seat, self._state.oriented)
