"""Blocks run one after another or side by side, where no failure stops the others."""

import csv
import glob
import io
import os
import time
from collections.abc import Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, get_args

from app.block_tasks import BlockState, BlockTask, State, read_list
from app.block_toml import BATCH_TABLE, FILE
from app.report.against import REPORT
from app.run import STAGE_NAMES
from app.runners import Apart, OnCluster, Runner, dask_client
from app.settings import Settings
from app.terminal import Voice, interruptible
from core.errors import ProjectError
from core.formats.records import guarded, plain_bytes, unguarded
from core.said import say
from sessions.atomic_write import whole_file
from sessions.processes import is_held, only_run

Executor = Literal["threads", "processes", "dask"]
EXECUTORS: tuple[Executor, ...] = ("threads", "processes", "dask")
LOCK = ".batch.lock"
COLUMNS = ("block", "state", "stage", "seconds", "findings", "message")
# design: often enough for an eye, and nothing for a processor
LOOK_S = 0.5
"""How often the blocks under way are looked at, seconds."""


def listed(sources: Sequence[Path], voice: Voice, language: str) -> "Batch":
    """The blocks of some lists, with their table beside them.

    Args:
        sources: As `read_list` takes them.
        voice: Told of all.
        language: Of the reports; empty for that of each last one.
    """
    tasks = [replace(task, language=language) for task in read_list(*sources)]
    first = sources[0]
    if len(sources) > 1 or glob.has_magic(str(first)) or (first / FILE).is_file():
        # The shell may have spelt a pattern out: its blocks have a folder above them.
        first = Path(os.path.commonpath([os.path.abspath(task.block.parent) for task in tasks]))
    table = (first if first.is_dir() else first.parent) / BATCH_TABLE
    if any(os.path.realpath(source) == os.path.realpath(table) for source in sources):
        cause, remedy = "has the name of the table that shows how far each block is.", "Rename it."
        raise ProjectError(table, cause, remedy)
    return Batch(tasks, table, voice)


def _is_state(row: list[str]) -> bool:
    """True for a row of the table as `Batch` writes it."""
    if len(row) != len(COLUMNS):
        return False
    return row[1] in get_args(State) and row[2] in ("", *STAGE_NAMES)


def batch_told(folder: Path) -> dict[str, Any] | None:
    """How far the blocks of the last batch in a folder are, by their paths; None without one."""
    table = folder / BATCH_TABLE
    try:
        text, written = plain_bytes(table).decode("utf-8"), table.stat().st_mtime
        head, *rows = csv.reader(io.StringIO(text, newline=""))
    except (OSError, ValueError, csv.Error):
        return None
    # Another program may have one of that name, and a person may have changed ours.
    if tuple(head) != COLUMNS or not all(_is_state(row) for row in rows):
        return None
    under_way = is_held(folder / LOCK)
    told = {
        unguarded(block): [
            _told(state, under_way, folder / unguarded(block), written), stage, unguarded(message)
        ]
        for block, state, stage, _, _, message in rows
    }  # fmt: skip
    when = datetime.fromtimestamp(written, UTC).isoformat(timespec="seconds")
    return {"written": when, "blocks": told}


def _told(state: str, under_way: bool, block: Path, written: float) -> str:
    """What a state of the table means now: whoever was killed could not write it."""
    if under_way or state in ("done", "failed"):
        return state
    report = block / REPORT
    return "done" if report.is_file() and report.stat().st_mtime > written else "left"


class Batch:
    """One run over blocks; a table on disk, where one is wanted, always tells how far each is."""

    def __init__(self, tasks: Sequence[BlockTask], table: Path | None, voice: Voice) -> None:
        """Blocks that are to run.

        Args:
            tasks: The blocks, in the order to run.
            table: Where it is written how far each is; None: nowhere.
            voice: Told of each stage, and of each block that ends.
        """
        self.voice, self.table = voice, table
        self.states = {task.block: BlockState(task) for task in tasks}
        self._written: tuple[BlockState, ...] = ()

    def run(self, executor: Executor, workers: int, scheduler: str = "") -> None:
        """Run all blocks; a finished block is looked through in seconds and left as it is.

        Args:
            executor: `threads`: one block after another, its pieces in threads. `processes`:
                as many blocks side by side as there are workers, with one thread each; a single
                one with all of them. `dask`: each worker of a Dask cluster takes one block at a
                time.
            workers: Threads, processes, or workers of a cluster of this machine.
            scheduler: Address of the Dask scheduler; a cluster on this machine without one.

        Raises:
            ProjectError: Some blocks failed; all others are done.
            Cancelled: Stopped; what is done stays, and the next call resumes.
        """
        progress = self.voice.stage("batch", "Blocks")
        started = time.monotonic()
        width = {"threads": 1, "processes": workers, "dask": len(self.states)}[executor]
        # The pool is left last: what a cluster did not stop ends when its client closes.
        with (
            self._alone(),
            ThreadPoolExecutor(width, thread_name_prefix="block") as pool,
            self._runner(executor, workers, scheduler) as runner,
            interruptible() as ask,
        ):
            waiting = {pool.submit(self._follow, runner, task) for task in self.tasks}
            try:
                while waiting:
                    done, waiting = wait(waiting, LOOK_S, FIRST_COMPLETED)
                    for one in done:
                        one.result()
                    self._write()
                    ask.watching(progress).report(*self._progress())
            finally:
                pool.shutdown(wait=False, cancel_futures=True)
                runner.stop()
        told = str(self.table or self.tasks[0].block)
        self.voice.ended("batch", "Blocks", time.monotonic() - started, told)
        self._refuse_failed()

    @property
    def tasks(self) -> tuple[BlockTask, ...]:
        """The blocks in the order they begin."""
        return tuple(state.task for state in self.states.values())

    @contextmanager
    def _alone(self) -> Generator[None]:
        """Be the only one who writes the table."""
        if self.table is None:
            yield
            return
        with only_run(self.table.parent / LOCK, Settings().operator, batch=True):
            try:
                yield
            finally:
                self._write()

    @contextmanager
    def _runner(self, executor: Executor, workers: int, scheduler: str) -> Generator[Runner]:
        """What runs one block."""
        if executor == "dask":
            with dask_client(scheduler, workers) as client:
                if not client.scheduler_info()["workers"]:
                    self.voice.say(say("The cluster has no workers yet. Blocks wait."))
                yield OnCluster(client, self._tell, self.tasks)
        elif executor == "processes" and len(self.states) > 1:
            yield Apart(1, self._tell)
        else:
            yield Apart(workers, self._tell)

    def _follow(self, runner: Runner, task: BlockTask) -> None:
        """Run one block and keep how it went."""
        try:
            self.states[task.block] = state = runner.run(task)
        except ProjectError:
            self.states[task.block] = BlockState(task)
            raise
        self.voice.say(
            say("{block}: {state}", block=task.block, state=state.message or state.state)
        )

    def _tell(self, task: BlockTask, stage: str) -> None:
        self.states[task.block] = BlockState(task, "running", stage)

    def _progress(self) -> tuple[float, int, str]:
        """Share of the list that is done, and what is under way."""
        states = tuple(self.states.values())
        share = sum(
            1.0 if state.state in ("done", "failed")
            else STAGE_NAMES.index(state.stage) / len(STAGE_NAMES) if state.stage else 0.0
            for state in states
        )  # fmt: skip
        under_way = (f"{s.task.block.name} {s.stage}" for s in states if s.state == "running")
        return share, len(states), ", ".join(under_way)

    def _write(self) -> None:
        """Write the table of all blocks where it has changed."""
        states = tuple(self.states.values())
        if self.table is None or states == self._written:
            return
        odd = "backslashreplace"  # of a name that is no UTF-8
        with (
            whole_file(self.table) as temporary,
            temporary.open("w", encoding="utf-8", errors=odd) as file,
        ):
            rows = csv.writer(file, lineterminator="\n")
            rows.writerow(COLUMNS)
            for state in states:
                row = (state.state, state.stage, state.seconds, state.findings, state.message)
                rows.writerow([guarded(cell) for cell in (self._listed(state.task.block), *row)])
        self._written = states

    def _listed(self, block: Path) -> str:
        """A block as the table names it: by its path from the table where it lies below it."""
        assert self.table is not None
        whole, beside = Path(os.path.abspath(block)), Path(os.path.abspath(self.table.parent))
        return str(whole.relative_to(beside) if beside in whole.parents else whole)

    def _refuse_failed(self) -> None:
        failed = [state for state in self.states.values() if state.state == "failed"]
        if failed and self.table is None and failed[0].ended_early:
            return  # as `gruber run` ends in this process, having said so
        if failed and self.table is None:
            remedy = "Correct what it names and give the same command again; what is done stays."
            raise ProjectError(failed[0].task.block, failed[0].message, remedy)
        if failed and self.table is not None:
            cause = "{failed} of {count} blocks failed, {block} first: {why}"
            remedy = "Correct what it names and give the same command again; finished blocks stay."
            values = {"failed": len(failed), "count": len(self.states), "why": failed[0].message}
            raise ProjectError(self.table, cause, remedy, block=failed[0].task.block, **values)
