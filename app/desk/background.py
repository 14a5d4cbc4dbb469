"""Background work of the desk: adjusting (newest wins) and what follows, measuring, orthos."""

import logging
import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from app.desk.messages import (
    Adjusted,
    Deliver,
    Delivery,
    Event,
    FillEnded,
    FillStep,
    Measured,
    ProposalsWanted,
    Proposed,
    RemakeEnded,
    RemakeStep,
    Tried,
    Work,
    WrittenBeside,
)
from core.adjustment.adjusted import AdjustmentReport
from core.block import Block
from core.doubts import Failure
from core.errors import Cancelled, PhotogrammetryError
from core.progress import Progress
from sessions.decisions import FillMarks
from ui.review.compare import redrawn, stale_photos
from ui.review.doubtful import extra_of
from ui.review.gestures import Gesture
from ui.review.history import with_adjustment
from ui.review.mark_gestures import MarkPlaced
from ui.review.scene import Footprints, tie_vectors
from ui.review.snapshot import DeskSnapshot
from ui.review.state import Evidence, Notice
from ui.review.to_measure import with_predictions, with_waiting

logger = logging.getLogger(__name__)
Adjust = Callable[[Block, Progress], AdjustmentReport]
BEGIN_AFTER_S = 0.1
"""An adjustment begins this much later: first the picture of what was decided goes out."""
REPORT_EVERY_S = 0.15
"""Progress is passed on no more often than this."""
LOOK_S = 1.0
"""An idle desk looks so often whether a run beside it has written results."""

Remake = Callable[[tuple[str, ...], Progress, AdjustmentReport], None]
"""(photo_ids, progress, report): make these orthos, and the mosaic, with these orientations."""
Fill = Callable[[MarkPlaced, DeskSnapshot, Progress], tuple[FillMarks | None, Notice]]
"""(gesture, desk, progress): look for all marks like the one that was pointed at."""
Step = Callable[[float, float, str, float | None], Delivery]
"""(done, total, what, seconds left): how far long work is, as a message."""
T = TypeVar("T")
Measure = Callable[[Gesture | ProposalsWanted, DeskSnapshot, Deliver], Measured | Proposed]
"""(gesture, desk, begun): measure what a gesture asks for, or propose places."""


class Worker:
    """Adjusts captured blocks, one at a time; a newer block takes the place of an older one.

    Trials wait until nothing else is to be done, and are given up as soon as there is.
    """

    def __init__(self, adjust: Adjust, deliver: Deliver) -> None:
        self._adjust, self._deliver = adjust, deliver
        self._wanted: _Job | None = None
        self._trial: _Job | None = None
        self._closed = False
        self._change = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="adjustment", daemon=True)

    def start(self) -> None:
        """Begin to wait for work."""
        self._thread.start()

    def submit(self, work: Work) -> None:
        """Adjust this next; whatever is being adjusted now is given up."""
        with self._change:
            self._wanted, self._trial = _Job(work), None
            self._change.notify()

    def try_out(self, work: Work) -> None:
        """Adjust this when there is time, in place of an earlier trial."""
        with self._change:
            self._trial = _Job(work, trial=True)
            self._change.notify()

    def close(self) -> None:
        """Give up and end the thread."""
        with self._change:
            self._closed = True
            self._change.notify()
        self._thread.join(timeout=10)

    def overtaken(self, job: "_Job") -> bool:
        """True when a job need not be finished."""
        newer = self._wanted is not None or (job.trial and self._trial is not None)
        return self._closed or newer

    def _run(self) -> None:
        while True:
            with self._change:
                self._change.wait_for(lambda: self._wanted or self._trial or self._closed)
                self._change.wait_for(lambda: self._closed, timeout=BEGIN_AFTER_S)
                if self._closed:
                    return
                if self._wanted is not None:
                    job, self._wanted = self._wanted, None
                else:
                    job, self._trial = self._trial, None
            if job is not None:
                self._one(job)

    def _one(self, job: "_Job") -> None:
        begun, conclusion = time.perf_counter(), None
        progress = _UntilNewer(self, job)
        try:
            block = job.work.block()
            result = Failure("there is nothing to adjust")
            if block is not None:
                result = self._adjust(block, progress)
                progress.report(1.0, 1.0)
                conclusion = job.work.conclude(result)
        except Cancelled:
            return
        except PhotogrammetryError as error:
            result = Failure(error.told)
        except Exception as error:
            # Whatever went wrong, the desk must go on with the numbers it has.
            logger.exception("The adjustment failed.")
            result = Failure(f"{type(error).__name__}: {error}")
        if job.trial:
            self._deliver(Tried(job.work, conclusion))
        else:
            self._deliver(Adjusted(job.work, result, time.perf_counter() - begun, conclusion))


@dataclass(frozen=True, slots=True, eq=False)
class _Job:
    """Captured work."""

    work: Work
    trial: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class _UntilNewer:
    """Progress that stops a job once a newer one waits."""

    worker: Worker
    job: _Job

    def report(self, done: float, total: float, what: str = "") -> None:
        """Accept the report; raise when the job is overtaken."""
        if self.worker.overtaken(self.job):
            raise Cancelled


class Measurer:
    """Measures in scans in a thread of its own, one gesture after the other."""

    def __init__(self, measure: Measure, deliver: Deliver) -> None:
        self._measure, self._deliver = measure, deliver
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="measuring")

    def measure(self, gesture: Gesture | ProposalsWanted, desk: DeskSnapshot) -> None:
        """Begin; what comes of it is delivered."""
        self._pool.submit(self._run, gesture, desk)

    def close(self) -> None:
        """Give up what has not begun."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _run(self, gesture: Gesture | ProposalsWanted, desk: DeskSnapshot) -> None:
        try:
            found = self._measure(gesture, desk, self._deliver)
        except PhotogrammetryError as error:
            found = _not_measured(gesture, error.told)
        except Exception as error:
            logger.exception("What a gesture asked for could not be measured.")
            found = _not_measured(gesture, f"{type(error).__name__}: {error}")
        self._deliver(found)


@dataclass(frozen=True, slots=True, eq=False)
class AfterAdjustment:
    """Captured beside a block that is adjusted: finds what follows from the report."""

    desk: DeskSnapshot
    """The desk as the block was handed over."""
    evidence: Callable[[AdjustmentReport], Evidence]
    """What the equations tell beside the report."""
    stale_m: float
    """An ortho is stale when the photo moved by more than this on the ground, metres."""
    footprints: Footprints
    """Outlines found before; only one thread at a time asks for more."""

    def block(self) -> Block:
        """What is adjusted."""
        return self.desk.state.block

    def conclude(self, report: AdjustmentReport) -> DeskSnapshot:
        """The captured desk with all that follows from the report."""
        desk = self.desk
        state = replace(
            desk.state, report=report, before=desk.state.report, adjusting=False,
            evidence=self.evidence(report),
        )  # fmt: skip
        extra = extra_of(state, desk.base, desk.recorded, desk.doubts, desk.dem)
        state = with_predictions(replace(state, extra=extra), desk.dem)
        drawn = redrawn(desk.drawn, state.oriented)
        return replace(
            desk,
            state=state,
            drawn=drawn,
            stale=stale_photos(state, self.stale_m),
            outlines=self.footprints.of(drawn, state.oriented.origin),
            tie_vectors=tie_vectors(state),
            table=desk.table.renewed(state),
        )


def _not_measured(gesture: Gesture | ProposalsWanted, why: str) -> Measured:
    return Measured(gesture.seat_id, None, Notice("notice.not-done", {"why": why}, grave=True))


class LongWork:
    """One long piece of work at a time in a thread of its own, so that deciding goes on."""

    def __init__(self, name: str, step: Step, deliver: Deliver) -> None:
        self._name, self._step, self._deliver = name, step, deliver
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def busy(self) -> bool:
        """True while it is done."""
        return self._thread is not None and self._thread.is_alive()

    def begin(
        self, work: Callable[[Progress], T], ended: Callable[[T | None, str, bool], Delivery]
    ) -> None:
        """Begin, unless something is being done.

        Args:
            work: Told of `Cancelled` by its progress.
            ended: (what came of it, why nothing did, whether it was stopped), as a message.
        """
        if self.busy:
            return
        self._stop.clear()
        self._thread = threading.Thread(
            target=self._run, args=(work, ended), name=self._name, daemon=True
        )
        self._thread.start()

    def cancel(self) -> None:
        """Ask it to stop at its next report."""
        self._stop.set()

    def close(self) -> None:
        """Stop and wait."""
        self.cancel()
        if self._thread is not None:
            self._thread.join(timeout=30)

    def _run(
        self, work: Callable[[Progress], T], ended: Callable[[T | None, str, bool], Delivery]
    ) -> None:
        made, failure, cancelled = None, "", False
        try:
            made = work(_Watched(self._stop, self._deliver, self._step))
        except Cancelled:
            cancelled = True
        except PhotogrammetryError as error:
            failure = error.told
        except Exception as error:
            logger.exception("Long work failed (%s).", self._name)
            failure = f"{type(error).__name__}: {error}"
        self._deliver(ended(made, failure, cancelled))


class Remaker(LongWork):
    """Makes orthos again."""

    def __init__(self, remake: Remake, deliver: Deliver) -> None:
        super().__init__("orthos", RemakeStep, deliver)
        self._remake = remake

    def start(self, photo_ids: tuple[str, ...], report: AdjustmentReport) -> None:
        """Begin; only one making at a time."""
        self.begin(
            lambda progress: self._remake(photo_ids, progress, report),
            lambda _, failure, cancelled: RemakeEnded(photo_ids, report, failure, cancelled),
        )


class Filler(LongWork):
    """Looks for marks like one that was pointed at."""

    def __init__(self, fill: Fill, deliver: Deliver) -> None:
        super().__init__("marks", FillStep, deliver)
        self._fill = fill

    def start(self, gesture: MarkPlaced, desk: DeskSnapshot) -> None:
        """Begin; only one search at a time."""

        def ended(
            found: tuple[FillMarks | None, Notice] | None, failure: str, cancelled: bool
        ) -> FillEnded:
            if found is not None:
                return FillEnded(gesture.seat_id, *found)
            notice = Notice("notice.fill-cancelled")
            if not cancelled:
                notice = Notice("notice.not-done", {"why": failure}, grave=True)
            return FillEnded(gesture.seat_id, None, notice)

        self.begin(lambda progress: self._fill(gesture, desk, progress), ended)


class _Watched:
    """Progress that is passed on with an estimate of the time left, and can be stopped."""

    def __init__(self, stop: threading.Event, deliver: Deliver, step: Step) -> None:
        self._stop, self._deliver, self._step = stop, deliver, step
        self._begun = time.perf_counter()
        self._told = 0.0

    def report(self, done: float, total: float, what: str = "") -> None:
        """Pass the report on; raise when asked to stop."""
        if self._stop.is_set():
            raise Cancelled
        now = time.perf_counter()
        if now - self._told < REPORT_EVERY_S and done < total:
            return
        self._told = now
        share = done / total if total else 0.0
        left = (now - self._begun) * (1 - share) / share if share > 0.02 else None
        self._deliver(self._step(done, total, what, left))


class Beside:
    """Looks for results that another process wrote while nothing happens at the desk."""

    def __init__(self, written_ms: Callable[[], int], engine: Callable[[], str]) -> None:
        """Ask when the report on disk was written, and what the engine's block was made from."""
        self._written_ms, self._engine, self._block = written_ms, engine, engine()
        self.outdated = threading.Event()
        """Set once another block was made: the desk is to be opened anew."""

    def next_event(
        self, inbox: "queue.SimpleQueue[Event]", shown_ms: Callable[[], int | None]
    ) -> Event:
        """The next event; `WrittenBeside` when the report is not the one that is shown.

        Args:
            inbox: What the desk is told.
            shown_ms: When the report was written that the desk tells of; None while it writes one.
        """
        while True:
            try:
                return inbox.get(timeout=LOOK_S)
            except queue.Empty:
                if shown_ms() in (None, self._written_ms()):
                    continue
            if self._engine() != self._block:
                self.outdated.set()
            return WrittenBeside()


def survived(function: Callable[[Any], None], argument: Any) -> str:
    """Run a function and log what goes wrong; the words of the error, empty when all went well.

    For threads that must not end: an error in one gesture must not take the desk away.
    """
    try:
        function(argument)
    except PhotogrammetryError as error:
        logger.warning("%s", error)
        return error.told
    except Exception as error:
        logger.exception("%s could not be handled.", type(argument).__name__)
        return f"{type(error).__name__}: {error}"
    return ""


def adopt_adjustment(now: DeskSnapshot, found: DeskSnapshot, stale_m: float) -> DeskSnapshot:
    """The desk as it stands now, with what follows from the newest adjustment."""
    then = found.state
    measured = replace(then.to_measure, proposals=now.state.to_measure.proposals)
    state = with_waiting(replace(
        now.state, report=then.report, before=then.before, adjusting=False, extra=then.extra,
        evidence=then.evidence, to_measure=measured,
    ))  # fmt: skip
    # Orthos may have been made meanwhile.
    same = now.state.made is then.made
    fresh = replace(
        now,
        state=state,
        stale=found.stale if same else stale_photos(state, stale_m),
        drawn=found.drawn,
        outlines=found.outlines,
        tie_vectors=found.tie_vectors,
        trials={},
        adjustments=with_adjustment(now.adjustments, then.report, state),
    )
    # Proposals may have come meanwhile.
    same = state.to_measure.waiting == then.to_measure.waiting
    return fresh.with_table(found.table if same else found.table.renewed(state))
