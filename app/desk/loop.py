"""The one thread that owns session, state and screen: takes gestures, sends pictures, in order."""

import queue
import threading
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

from app.desk.background import (
    AfterAdjustment,
    Beside,
    Filler,
    Measurer,
    Remaker,
    Worker,
    adopt_adjustment,
    survived,
)
from app.desk.inputs import DeskInputs, first_snapshot
from app.desk.measuring import MeasuringTool, Proposer, is_overtaken, notice_of_point, with_name
from app.desk.messages import (
    Adjusted,
    Closed,
    Event,
    FillEnded,
    FillStep,
    Making,
    Measured,
    MeasuringBegun,
    Proposed,
    RemakeEnded,
    RemakeStep,
    SceneOpened,
    Screen,
    SeatLeft,
    SeatTaken,
    Tried,
    WrittenBeside,
)
from core.doubts import Failure
from core.mosaic.seam_edits import SeamArea, SeamEdit, SeamLine
from sessions.decisions import Accept, AddPoint, Decision, Place, PlaceFiducial, Recorded, changing
from sessions.seam_decisions import standing_seam_edits
from ui.review.check_gestures import Reviewed
from ui.review.compare import stale_photos, with_made
from ui.review.doubtful import extra_of
from ui.review.drafts import left_seats, with_left, with_measured
from ui.review.gestures import AnswerAsked, Freed, Gesture, QualityAsked, SheetAsked
from ui.review.history import (
    count_standing,
    key_of,
    mark_of,
    nothing_notice,
    touched_by,
    turn_back,
    turn_notice,
    with_adjustment,
)
from ui.review.mark_gestures import MarkPlaced
from ui.review.mosaic import with_seam_edits
from ui.review.new_points import ORTHO, act_of, next_name, with_begun
from ui.review.outcome import Act, outcome_of
from ui.review.pages import Pages
from ui.review.queue import keep_seat_up, seat_down, showing
from ui.review.scene import Footprints, readable_scale, tie_vectors
from ui.review.snapshot import DeskSnapshot
from ui.review.state import DeskState, Draft, Notice, Remaking, SceneOptions, Seat, ShownMosaic
from ui.review.to_measure import kept_up, with_predictions, with_proposals
from ui.review.trial import Trial, TrialWork
from ui.review.verdicts import still_asked

MANY_ROWS = 5000  # design: going through them takes ten milliseconds, which nobody feels.


class ReviewLoop:
    """Takes events in order, one at a time; nothing else changes what the desk knows."""

    def __init__(
        self, inputs: DeskInputs, screen: Screen, inbox: "queue.SimpleQueue[Event] | None" = None
    ) -> None:
        self._inputs, self._screen, self._session = inputs, screen, inputs.session
        self._inbox: queue.SimpleQueue[Event] = inbox or queue.SimpleQueue()
        self._now = first_snapshot(inputs)
        self.beside = Beside(inputs.written_ms, inputs.engine_digest)
        self._pages, self._footprints = Pages(), Footprints(inputs.dem)
        self._scenes: set[str] = set()
        self._seen: dict[str, tuple[object, DeskSnapshot]] = {}
        self._made: dict[int, str] = {}
        self._edits: tuple[SeamEdit, ...] | None = None
        self._replay_due = self._adjust_due = self._only_seams = False
        self._work: AfterAdjustment | None = None
        self._trial: TrialWork | None = None
        self._worker = Worker(inputs.adjust, self.submit)
        self._remaker = Remaker(inputs.remake, self.submit)
        self._filler = None if inputs.fill is None else Filler(inputs.fill, self.submit)
        tool = MeasuringTool(inputs.likeness, inputs.sigmas_m, inputs.transfer)
        self._measurer, self._proposer = Measurer(tool, self.submit), Proposer()
        self._thread = threading.Thread(target=self._run, name="review", daemon=True)

    def start(self) -> None:
        """Begin: lay earlier decisions over the block, and adjust if there are any."""
        now, state = self._now, self._now.state
        state = replace(state, evidence=self._inputs.evidence(state.report))
        state = with_predictions(state, now.dem)
        self._screen.publish(now.drawn)
        self._now = replace(
            now,
            state=state,
            stale=stale_photos(state, self._inputs.stale_m),
            outlines=self._footprints.of(now.drawn, state.oriented.origin),
            tie_vectors=tie_vectors(state),
            adjustments=with_adjustment((), state.report, state),
        )
        self._replay()
        for left in self._inputs.left:
            seat = with_left(self._seat(left.seat_id), left, self._now.rows, self._now.drawn)
            self._now = self._now.with_seat(keep_seat_up(seat, self._seen_by(seat).rows))
        self._worker.start()
        if self._now.state.decided:
            self._change_state(adjusting=True)
            self._adjust()
        self._thread.start()

    @property
    def left(self) -> tuple[Seat, ...]:
        """Seats with drafts, for the desk after this one."""
        return left_seats(self._now.seats.values(), self._now.state.block)

    def submit(self, event: Event) -> None:
        """Hand in an event, from any thread."""
        self._inbox.put(event)

    def close(self) -> None:
        """Stop the work beside it, and end after what is already in the inbox."""
        self._remaker.close()
        if self._filler is not None:
            self._filler.close()
        self._worker.close()
        self._measurer.close()
        self._inbox.put(Closed())
        self._thread.join(timeout=10)

    def _run(self) -> None:
        while True:
            event = self.beside.next_event(self._inbox, self._shown_ms)
            if isinstance(event, Closed):
                return
            failures = survived(self._handle, event), survived(self._catch_up, event)
            for failure in filter(None, failures):
                self._screen.tell("", Notice("notice.not-done", {"why": failure}, grave=True))

    def _shown_ms(self) -> int | None:
        return None if self._remaker.busy else self._now.state.written_ms

    def _handle(self, event: Event) -> None:
        match event:
            case SeatTaken() | SeatLeft() | SceneOpened():
                self._take_page(event)
            case Adjusted():
                self._take_adjustment(event)
            case Tried():
                self._take_trial(event)
            case MeasuringBegun():
                self._screen.tell(event.seat_id, event.notice)
            case Measured():
                self._take_measured(event)
            case Proposed():
                self._take_proposals(event)
            case RemakeStep() | FillStep() | RemakeEnded() | FillEnded() | WrittenBeside():
                self._take_long_work(event)
            case Closed():
                pass
            case gesture:
                self._take_gesture(gesture)

    def _catch_up(self, event: Event) -> None:
        """After every event: new decisions over the block, the picture, then the background."""
        # Who acted sees it first, and the next point before very many rows are gone through.
        first, many = getattr(event, "seat_id", ""), len(self._now.rows) > MANY_ROWS
        if many and self._replay_due and first in self._now.present:
            self._show(self._seat(first), 1)
        self._follow_decisions()
        seats = sorted(self._now.present_seats(), key=lambda seat: seat.seat_id != first)
        for seat in seats:
            self._show(seat)
        if self._adjust_due:
            self._adjust_due = False
            self._adjust()
        for seat in seats:
            drawn = seat.seat_id in self._scenes
            if drawn and (picture := self._pages.changed_scene(seat, self._now)):
                self._screen.scene(seat.seat_id, picture, seat, self._now.state.oriented)
        self._try_out(seats)
        for wanted in self._proposer.wanted(self._now.state, seats):
            self._measurer.measure(wanted, self._now)

    def _show(self, seat: Seat, most: int | None = None) -> None:
        """What changed on a page; of its first so many parts."""
        if parts := self._pages.changed_parts(seat, self._seen_by(seat), most):
            self._screen.show(seat.seat_id, parts)

    def _follow_decisions(self) -> None:
        """Lay new decisions over the block, if there are any."""
        if self._replay_due and changing(self._now.recorded) == self._session.changing():
            # Nothing was said of the block itself: a reading moves no photo.
            self._take_judgements()
        elif self._replay_due:
            self._replay()
            if not self._only_seams:
                self._change_state(adjusting=True)
                self._adjust_due = True
            self._only_seams = False

    def _take_judgements(self) -> None:
        """Show plans, readings and signatures as they stand now."""
        self._replay_due = False
        recorded = self._session.decisions()
        self._now = replace(self._now, recorded=recorded)
        self._change_state(decided=count_standing(recorded))

    def _replay(self) -> None:
        """Lay all decisions that stand over the block as the engine left it."""
        self._replay_due = False
        now, recorded = self._now, self._session.decisions()
        block = self._session.replayed(now.base, now.initial.films, now.initial.cameras)
        state = replace(now.state, block=block, decided=count_standing(recorded))
        state = replace(state, mosaic=self._with_edits(state.mosaic, recorded))
        extra = extra_of(state, now.base, recorded, now.doubts, now.dem)
        state = kept_up(now.state, replace(state, extra=extra), now.dem)
        table = now.table.with_changes(now.state, state)
        self._now = replace(now, state=state, recorded=recorded).with_table(table)

    def _with_edits(
        self, mosaic: ShownMosaic | None, recorded: Sequence[Recorded]
    ) -> ShownMosaic | None:
        """The mosaic with the seams that stand, for the tiles too; the same where none changed."""
        if mosaic is None:
            return None
        edits = standing_seam_edits(recorded)
        if edits == self._edits and mosaic is self._now.state.mosaic:
            return mosaic
        self._edits = edits
        mosaic = with_seam_edits(mosaic, edits)
        if self._inputs.mosaic is not None:
            self._inputs.mosaic.publish(mosaic)
        return mosaic

    def _adjust(self) -> None:
        """Capture the desk and hand it to the worker, in place of what it may be doing."""
        inputs = self._inputs
        self._work = AfterAdjustment(self._now, inputs.evidence, inputs.stale_m, self._footprints)
        self._trial = None
        self._worker.submit(self._work)

    def _try_out(self, seats: Sequence[Seat]) -> None:
        """Find out what turning a measurement or keeping a draft would do, while it is shown."""
        if self._now.state.adjusting:
            return
        looked_at = {seat.draft_of(seat.current) or seat.current: seat for seat in seats}
        wanted = [one for one in looked_at if one and one not in self._now.trials]
        if wanted and (self._trial is None or self._trial.subject not in wanted):
            state = self._seen_by(looked_at[wanted[0]]).state
            self._trial = TrialWork(state, wanted[0], self._now.after)
            self._worker.try_out(self._trial)

    def _take_page(self, event: SeatTaken | SeatLeft | SceneOpened) -> None:
        """A page or a scene was opened, or the last page of a seat closed."""
        seat_id, present = event.seat_id, self._now.present
        match event:
            case SeatTaken():
                self._seat(seat_id)
                self._now = replace(self._now, present=present | {seat_id})
            case SeatLeft():
                self._now = replace(self._now, present=present - {seat_id})
            case SceneOpened():
                self._scenes.add(seat_id)
        self._pages.forget(seat_id)

    def _take_gesture(self, gesture: Gesture) -> None:
        """What a gesture comes to: the decision on the disk before anything else."""
        before = still_asked(self._seat(gesture.seat_id), gesture)
        if isinstance(gesture, QualityAsked | SheetAsked | Reviewed):  # Others may have changed it.
            self._now = self._inputs.with_products(self._now)
            self._replay_due |= len(self._session.decisions()) > len(self._now.recorded)
            self._follow_decisions()
        outcome = outcome_of(gesture, before, self._seen_by(before))
        seat = outcome.seat
        if outcome.decisions:
            seat = seat.once_decided(self._record(outcome.decisions, seat))
        elif seat.begun or before.begun:
            seat = keep_seat_up(seat, self._seen_by(seat).rows)
        self._now = self._now.with_seat(seat)
        for notice in filter(None, (*outcome.left, outcome.notice)):
            self._screen.tell(seat.seat_id, notice)
        if outcome.answer is not None:
            self._screen.show(seat.seat_id, dict([outcome.answer]))
        if outcome.act:
            self._do(outcome.act, gesture, seat)

    def _record(self, decisions: Sequence[Decision], seat: Seat) -> int:
        """Only once it is on disk does anything else happen; the number of the first one."""
        state = self._now.state
        with_it = act_of(decisions, state, self._now.recorded)
        recorded = self._session.record_all(decisions, state.block, seat.operator, with_it)
        self._made |= {item.decision_id: seat.seat_id for item in recorded}
        self._replay_due = True
        # Seams move no photo.
        self._only_seams = all(isinstance(one, SeamLine | SeamArea) for one in decisions)
        return recorded[0].decision_id

    def _do(self, act: Act, gesture: Gesture, seat: Seat) -> None:
        state = self._now.state
        match act:
            case "measure":
                self._measurer.measure(gesture, self._seen_by(seat))
            case "answer" if isinstance(gesture, AnswerAsked):
                self._screen.show(seat.seat_id, {"answered": gesture.number})
            case "free" if isinstance(gesture, Freed) and self._inputs.choose is not None:
                free = self._inputs.choose(gesture.cameras, gesture.robust)
                self._change_state(free=free, adjusting=True)
                self._adjust_due = True
            case "undo" | "redo":
                self._turn_back(act, seat, getattr(gesture, "mark", None))
            case "remake":
                self._remake(seat)
            case "cancel" if state.remaking is not None:
                self._remaker.cancel()
                self._change_state(remaking=replace(state.remaking, cancelling=True))
            case "fill" if isinstance(gesture, MarkPlaced):
                self._fill(gesture)
            case "cancel filling" if self._filler is not None and state.filling is not None:
                self._filler.cancel()
                self._change_state(filling=replace(state.filling, cancelling=True))
            case "fit whole" | "fit current":
                self._screen.fit(seat.seat_id, seat, state.oriented, act == "fit whole")
            case _:
                pass

    def _turn_back(
        self, act: Literal["undo", "redo"], was: Seat, mark: tuple[str, str] | None
    ) -> None:
        """Undo or redo the operator's own last decision, in a sheet of those made there; look."""
        made, seat = turn_back(self._session, act, was, self._made, self._now.present, mark=mark)
        if was.begun:
            seat = keep_seat_up(seat, self._seen_by(seat).rows)
        self._now = self._now.with_seat(seat)
        touched = touched_by(made[-1], self._session.decisions()) if made else None
        if touched is None:
            if notice := nothing_notice(act, was, seat):
                self._screen.tell(seat.seat_id, notice)
            return
        self._made |= {item.decision_id: seat.seat_id for item in made}
        self._replay_due = True
        key = key_of(touched.decision, self._now.state.extra)
        if key is not None:
            self._now = self._now.with_seat(replace(seat, current=key))
            self._follow_decisions()
            seat, rows = self._seat(seat.seat_id), self._seen_by(seat).rows
            if key in rows:
                self._now = self._now.with_seat(showing(seat, rows, key))
        if mark := mark_of(touched.decision):
            self._screen.show(seat.seat_id, {"board_mark": [*mark, made[-1].decision_id]})
        self._screen.tell(seat.seat_id, turn_notice(act, touched.decision, key, len(made)))

    def _take_measured(self, event: Measured) -> None:
        """Record or draft it, unless somebody decided meanwhile; told is of a draft in sight."""
        decision, notice, seat = event.decision, event.notice, self._seat(event.seat_id)
        if isinstance(decision, AddPoint):
            # Two may have been asked for before either was found: the second has the next name.
            decision = with_name(decision, next_name(ORTHO, self._now))
            best = max(decision.measured, key=lambda item: item.score)
            notice = replace(notice_of_point(decision), draft=best.key)
            accepted = Accept(*best.key, best.column, best.row)
            seat = replace(seat, current=best.key, explaining=())
            seat = seat.with_draft(Draft(best.key, accepted, decision))
            seat, decision = keep_seat_up(seat, self._seen_by(seat).rows), None
        elif isinstance(decision, Place | PlaceFiducial):
            drafted = with_measured(seat, decision, event.since)
            if drafted is None or is_overtaken(decision, self._now.recorded[event.known :]):
                self._screen.tell(event.seat_id, Notice("notice.overtaken"))
                return
            seat, decision = drafted, None
        if decision is not None:
            self._now = self._inputs.with_products(self._now)
        if decisions := (*((decision,) if decision else ()), *event.more):
            self._record(decisions, seat)
        self._now = self._now.with_seat(seat)
        if notice.draft in (None, seat.current):
            self._screen.tell(event.seat_id, notice)

    def _take_proposals(self, event: Proposed) -> None:
        """Show where other photos show a point, in the place of what was found before."""
        now, name = self._now, event.point_id
        others = now.state.to_measure.proposals
        kept = {key: item for key, item in others.items() if key[0] != name}
        state = with_proposals(now.state, {**kept, **{item.key: item for item in event.found}})
        if state is not now.state:
            self._now = replace(now, state=state).with_table(now.table.renewed(state))

    def _take_adjustment(self, event: Adjusted) -> None:
        if event.work is not self._work:
            return
        if isinstance(event.result, Failure):
            self._change_state(adjusting=False)
            why = {"why": event.result.reason}
            self._screen.tell("", Notice("notice.adjustment-failed", why, grave=True))
            return
        assert isinstance(event.conclusion, DeskSnapshot), "asked for with every block"
        self._now = adopt_adjustment(self._now, event.conclusion, self._inputs.stale_m)
        self._screen.publish(self._now.drawn)
        self._inputs.adopted(event.result)

    def _take_trial(self, event: Tried) -> None:
        trial, found = self._trial, event.conclusion
        if trial is None or event.work is not trial:
            return
        assert found is None or isinstance(found, Trial), "asked for with every trial"
        self._trial = None
        self._now = replace(self._now, trials={**self._now.trials, trial.subject: found})

    def _remake(self, seat: Seat) -> None:
        state, stale = self._now.state, self._now.stale
        if self._remaker.busy:
            return
        if state.written and not stale and not self._now.mosaic_gone:
            self._screen.tell(seat.seat_id, Notice("notice.remake-none"))
            return
        self._change_state(remaking=Remaking())
        self._remaker.start(stale, state.report)

    def _take_long_work(self, event: Making) -> None:
        match event:
            case WrittenBeside(notice=notice):
                self._show_made(self._inputs.on_disk(self._now.state))
                self._screen.tell("", notice)
            case RemakeStep() | FillStep():
                self._take_step(event)
            case RemakeEnded():
                self._take_remake(event)
            case FillEnded():
                self._take_filled(event)

    def _take_step(self, step: RemakeStep | FillStep) -> None:
        name = "remaking" if isinstance(step, RemakeStep) else "filling"
        before: Remaking | None = getattr(self._now.state, name)
        cancelling = before is not None and before.cancelling
        making = Remaking(step.done, step.total, step.what, step.seconds_left, cancelling)
        self._change_state(**{name: making})

    def _take_filled(self, event: FillEnded) -> None:
        """Record marks that were found by an example, and show them."""
        self._change_state(filling=None)
        if event.decision is not None:
            self._record((event.decision,), self._seat(event.seat_id))
        self._screen.tell(event.seat_id, event.notice)

    def _fill(self, gesture: MarkPlaced) -> None:
        """Look for all marks like one, unless that is being done."""
        if self._filler is not None and not self._filler.busy:
            self._change_state(filling=Remaking())
            self._filler.start(gesture, self._now)

    def _take_remake(self, ended: RemakeEnded) -> None:
        state = replace(self._now.state, remaking=None)
        if ended.failure or ended.cancelled:
            state = self._inputs.on_disk(state)
        else:
            state = with_made(self._inputs.files(state), ended.photo_ids, ended.made_with)
        self._show_made(state)
        self._screen.tell("", ended.notice)

    def _show_made(self, state: DeskState) -> None:
        """Show what is on disk now."""
        state = replace(state, mosaic=self._with_edits(state.mosaic, self._now.recorded))
        stale = stale_photos(state, self._inputs.stale_m)
        self._now = self._inputs.with_products(replace(self._now, state=state, stale=stale))

    def _seen_by(self, seat: Seat) -> DeskSnapshot:
        """The desk with what drafts of a seat add to it: the same values until one changes."""
        now = self._now
        if not seat.begun:
            return now
        made_of = now.state, now.table, seat.begun
        known, seen = self._seen.get(seat.seat_id, (None, now))
        if known != made_of:
            seen = with_begun(now, seat)
            self._seen[seat.seat_id] = made_of, seen
        return replace(now, state=seen.state, table=seen.table)

    def _change_state(self, **changes: Any) -> None:
        self._now = replace(self._now, state=replace(self._now.state, **changes))

    def _seat(self, seat_id: str) -> Seat:
        now = self._now
        if seat_id not in now.seats:
            scale = readable_scale(now.state, now.table.figures.misfits)
            fresh = Seat(seat_id, self._inputs.operator, scene=SceneOptions(vector_scale=scale))
            self._now = now.with_seat(seat_down(fresh, now.rows, now.taken(seat_id)))
        return self._now.seats[seat_id]
