"""One block run: in this process, in one of its own, or by a worker of a Dask cluster."""

import json
import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from threading import Lock
from typing import Any, Protocol, cast
from uuid import uuid4

from app.block_tasks import BlockState, BlockTask, State
from app.heap import share_heaps
from app.project import read_project
from app.run import Run, RunOptions
from app.settings import Settings
from app.terminal import JsonLines, Voice
from core.errors import Cancelled, PhotogrammetryError, ProjectError
from core.said import say
from sessions.codec import from_json
from sessions.processes import STARTED_BY, this_process
from sessions.session import Session

CANCELLED = 130
"""Exit code of a run that was asked to stop."""
# design: four workers die over a block before Dask gives it up; after eight a person is needed.
HANDED_OUT = 2
"""How often a block is handed to a cluster whose workers die over it."""
# design: a run asked to stop ends its piece within seconds; a minute is a machine that hangs.
PATIENCE_S = 60.0
"""How long a run may take to stop before it is killed, or left to its worker."""
# design: an answer of the scheduler takes milliseconds; who stops a run waits a second for it.
ASKED_EACH_S = 1.0
"""How often a worker asks whether it is to stop."""

Told = Callable[[BlockTask, str], None]
"""Handed a block and the stage that begins in it; no stage as the run begins."""


class Runner(Protocol):
    """Runs blocks, and stops those under way when asked."""

    def run(self, task: BlockTask) -> BlockState:
        """Run one block; one that was stopped is waiting again."""
        ...

    def stop(self) -> None:
        """Ask the runs under way to stop, and wait until they have."""
        ...


def run_block(block: Path, voice: Voice, options: RunOptions) -> Run:
    """Run a block in this process and return what was made."""
    project = read_project(block)
    with Session.open(project.folder, Settings().operator) as session:
        walk = Run(project, session, voice, options)
        walk.walk()
    return walk


class Apart:
    """Runs each block as `gruber run` does, in a process of its own."""

    def __init__(self, threads: int, told: Told) -> None:
        """Runs with so many pieces of a stage side by side."""
        self.threads, self.told = threads, told
        self._stopped = False
        self._processes: set[subprocess.Popen[str]] = set()

    def run(self, task: BlockTask) -> BlockState:
        """Run one block; done, failed, or waiting again where it was stopped."""
        # -P: a module beside the blocks that is called as one of Python's is none of ours.
        command = [sys.executable, "-P", "-m", "gruber", "--log-json", "run", str(task.block)]
        command += ["--workers", str(self.threads), *chain.from_iterable(task.options.items())]
        started, stage, why, last, early = time.monotonic(), "", "", "", False
        self.told(task, stage)
        # A session of its own: Ctrl-C reaches this program alone, which hands it on.
        with subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="backslashreplace",  # of a name that is no UTF-8
            start_new_session=True,
            env=os.environ | {STARTED_BY: this_process()},
        ) as process:
            self._processes.add(process)
            assert process.stdout is not None
            for text in process.stdout:
                line = _line_of(text)
                match line.get("event"):
                    case "stage":
                        stage = str(line["stage"])
                        self.told(task, stage)
                    case "error":
                        why = cast("str", from_json(line["told"]))
                    case "ended-early":
                        why, early = str(line["text"]), True
                    case None:
                        last = text.strip()
                    case _:
                        pass
            code = process.wait()
        self._processes.discard(process)
        seconds = round(time.monotonic() - started, 1)
        # Python tells of an interruption in its own way before the program has begun.
        if code == CANCELLED or (self._stopped and code and not why):
            return BlockState(task, "waiting", stage, seconds)
        if code == 0 and not why:
            return BlockState(task, "done", stage, seconds)
        ended = say("exit code {code}", code=code)
        if code < 0:
            ended = say(
                "its process was killed (signal {number}), often because memory ran out.",
                number=-code,
            )
        return BlockState(task, "failed", stage, seconds, why or last or ended, ended_early=early)

    def stop(self) -> None:
        """Hand Ctrl-C on, and wait until the processes have ended."""
        self._stopped = True
        for process in tuple(self._processes):
            process.send_signal(signal.SIGINT)
        for process in tuple(self._processes):
            try:
                process.wait(PATIENCE_S)
            except subprocess.TimeoutExpired:
                process.kill()


def _line_of(text: str) -> dict[str, Any]:
    """A line of JSON; empty for what is printed otherwise, such as the end of a traceback."""
    try:
        line = json.loads(text)
    except ValueError:
        return {}
    return cast("dict[str, Any]", line) if isinstance(line, dict) else {}


def dask_client(scheduler: str, workers: int) -> Any:
    """A client of a Dask cluster; one of this machine, of so many workers, where none is named.

    Raises:
        ProjectError: Dask is not installed, or the scheduler does not answer.
    """
    try:
        from distributed import Client
    except ImportError as error:
        remedy = "Install it: pip install 'gruber[cluster]'."
        raise ProjectError("dask", "is not installed.", remedy) from error
    # A lost connection stands in our error; its own words would be pages of calls.
    for room in ("client", "nanny"):
        logging.getLogger(f"distributed.{room}").setLevel(logging.CRITICAL)
    try:
        if scheduler:
            return Client(scheduler)
        # Its own pages at any free port: two clusters on one machine would want the same one.
        at = "127.0.0.1:0"
        return Client(n_workers=workers, threads_per_worker=1, dashboard_address=at)
    except (OSError, ValueError) as error:
        remedy = "Start it with `dask scheduler`, or correct --scheduler."
        raise ProjectError(scheduler, "does not answer.", remedy) from error


class OnCluster:
    """Runs each block on a worker of a Dask cluster, which sees the same folders.

    Another worker takes over from one that dies, where that one had got to: finished stages stay.
    """

    def __init__(self, client: Any, told: Told, tasks: Sequence[BlockTask]) -> None:
        """Runs of one call, which the cluster tells from others by a name of its own.

        They are handed out here, one after the other: a worker holds on to what it was given.
        """
        self.client, self.told = client, told
        self.name = f"gruber-{uuid4().hex}"
        self._lock = Lock()
        self._under_way: dict[str, tuple[BlockTask, Any]] = {}
        self._begun: set[str] = set()
        client.subscribe_topic(self.name, self._hear)
        for task in tasks:
            self._hand_out(task)

    def run(self, task: BlockTask) -> BlockState:
        """Run one block; done, failed, or waiting again where it was stopped.

        Raises:
            ProjectError: The scheduler answers no longer, or the block was taken back.
        """
        from distributed import KilledWorker

        block, error = str(task.block.resolve()), None
        for turn in range(HANDED_OUT):
            future = self._under_way[block][1] if turn == 0 else self._hand_out(task)
            error = future.exception()
            if not isinstance(error, KilledWorker):
                break
        with self._lock:  # what is heard of it from here on comes late
            _, future = self._under_way.pop(block)
        if future.cancelled():
            remedy = "Start it again and give the same command again; finished blocks stay."
            raise ProjectError("dask scheduler", "answers no longer.", remedy)
        if error is None:
            return replace(future.result(), task=task)
        died = say("every worker that ran it died; their logs say why, often too little memory.")
        why = died if isinstance(error, KilledWorker) else str(error)
        return BlockState(task, "failed", message=why)

    def _hand_out(self, task: BlockTask) -> Any:
        """Hand a block to the cluster; its future."""
        whole = replace(task, block=task.block.resolve())
        how = {"pure": False, "priority": task.priority}
        with self._lock:
            future = self.client.submit(run_there, whole, self.name, **how)
            self._under_way[str(whole.block)] = task, future
        return future

    def stop(self) -> None:
        """Take back what has not begun, and wait until the workers have stopped the rest."""
        from distributed import Event

        if not self._under_way or self.client.status != "running":
            return
        # It stays set: a worker that takes a block just now asks for it later.
        Event(self.name, client=self.client).set()
        with self._lock:
            waiting = [pair for block, pair in self._under_way.items() if block not in self._begun]
        for _, future in waiting:
            future.cancel()
        given_up = time.monotonic() + PATIENCE_S
        while self._runs() and time.monotonic() < given_up:
            time.sleep(ASKED_EACH_S / 10)

    def _runs(self) -> bool:
        """Whether a worker still holds a block."""
        with self._lock:
            return not self._begun.isdisjoint(self._under_way)

    def _hear(self, event: tuple[float, dict[str, str]]) -> None:
        """A worker told of a stage that begins."""
        _, said = event
        with self._lock:
            if said["block"] in self._under_way:
                self._begun.add(said["block"])
                self.told(self._under_way[said["block"]][0], said["stage"])


class FromWorker(JsonLines):
    """Tells the caller of a batch of each stage, and stops the run when the caller asks."""

    def __init__(self, block: Path, call: str) -> None:
        """The voice of one block, on the worker that runs it.

        Args:
            block: Its folder, as the caller knows it.
            call: Name of the call, by which both hear each other.
        """
        from distributed import Event, get_worker

        super().__init__()
        self.worker, self.call, self.block = get_worker(), call, str(block)
        self.key, self.stopped = self.worker.get_current_task(), Event(call)
        self.asked = 0.0

    def write(self, message: dict[str, object]) -> None:
        """Pass on where a run begins and each stage; the rest is in the block's report."""
        if message["event"] == "stage":
            self.worker.log_event(self.call, {"block": self.block, "stage": message["stage"]})

    def report(self, done: float, total: float, what: str = "") -> None:
        """Stop here when the caller has asked, or is gone; raises `Cancelled`."""
        if time.monotonic() - self.asked < ASKED_EACH_S:
            return
        task = self.worker.state.tasks.get(self.key)
        try:
            stop = task is None or task.state == "cancelled" or self.stopped.is_set()
        except OSError:
            stop = True  # without its scheduler nobody hears of the block any more
        if stop:
            raise Cancelled
        self.asked = time.monotonic()


def run_there(task: BlockTask, call: str) -> BlockState:
    """Run a block on a worker of a cluster, in its process, so that both end together."""
    share_heaps()
    started = time.monotonic()
    voice = FromWorker(task.block, call)
    state: State = "done"
    why, early = "", False
    try:
        voice.stage("", "")
        voice.report(0.0, 1.0)
        walk = run_block(
            task.block, voice, RunOptions(task.first or None, task.until or None, 1, task.language)
        )
        why, early = walk.ended_early, bool(walk.ended_early)
        state = "failed" if early else "done"
    except Cancelled:
        state = "waiting"
    except PhotogrammetryError as error:
        state, why = "failed", error.told
    seconds = round(time.monotonic() - started, 1)
    return BlockState(task, state, voice.current, seconds, why, ended_early=early)
