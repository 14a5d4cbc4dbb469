"""Blocks run: one in this process, or one or many elsewhere, where no failure stops the others."""

import csv
import glob
import io
import json
import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, Literal, cast

from app.block_list import blocks_in
from app.block_toml import FILE, folder_of
from app.heap import share_heaps
from app.project import read_project
from app.run import STAGE_NAMES, Run, RunOptions
from app.settings import Settings
from app.terminal import JsonLines, Voice, interruptible
from core.errors import PhotogrammetryError, ProjectError
from core.formats.records import guarded, plain_bytes
from core.said import say
from sessions.atomic_write import whole_file
from sessions.codec import from_json
from sessions.session import Session

Executor = Literal["threads", "processes", "dask"]
EXECUTORS: tuple[Executor, ...] = ("threads", "processes", "dask")
State = Literal["waiting", "running", "done", "failed"]
TABLE = "batch.csv"
COLUMNS = ("block", "state", "stage", "seconds", "findings", "message")
LISTED = ("block", "priority", "until")
CANCELLED = 130
"""Exit code of a run that was asked to stop."""
# design: four workers die over a block before Dask gives it up; after eight a person is needed.
HANDED_OUT = 2
"""How often a block is handed to a cluster whose workers die over it."""
# design: often enough for an eye, and nothing for a processor
LOOK_S = 0.5
"""How often the blocks under way are looked at, seconds."""
# design: a run asked to stop ends its piece within seconds; a minute is a machine that hangs.
PATIENCE_S = 60.0
"""How long a run may take to stop after Ctrl-C before it is killed."""


@dataclass(frozen=True, slots=True)
class BlockTask:
    """One block of a list."""

    block: Path
    """Its folder."""
    priority: float = 0.0
    """Blocks of a higher priority run first."""
    until: str = ""
    """Last stage to run; empty for all."""
    first: str = ""
    """Stage to make anew with all after it; empty for none."""
    language: str = ""
    """Of its report; that of the last one when left out."""

    @property
    def options(self) -> dict[str, str]:
        """What `gruber run` is asked for it, by option."""
        asked = {"--from": self.first, "--until": self.until, "--language": self.language}
        return {name: value for name, value in asked.items() if value}


@dataclass(frozen=True, slots=True)
class BlockState:
    """How far one block is."""

    task: BlockTask
    """The block."""
    state: State = "waiting"
    """What is happening to it."""
    stage: str = ""
    """The stage it is in, or was in when it ended."""
    seconds: float = 0.0
    """How long its run took."""
    message: str = ""
    """Why it failed."""
    ended_early: bool = False
    """Whether its run was sound, and the rest of it cannot be made."""

    @property
    def findings(self) -> str:
        """Grave findings of its report, by number and first sentence; empty without a report."""
        report = self.task.block / "results" / "report.json"
        if self.state != "done" or not report.is_file():
            return ""
        verdict = json.loads(report.read_text(encoding="utf-8"))["verdict"]
        grave = [finding["sentence"] for finding in verdict if finding["grave"] > 1]
        return f"{len(grave)}: {grave[0]}" if grave else "0"


def read_list(*sources: Path) -> tuple[BlockTask, ...]:
    """The blocks of folders, patterns, files with a path a line, or tables, in the order to run.

    A table is a CSV file whose head names `block` and, where wanted, `priority` and `until`.
    Paths are relative to the list.

    Raises:
        ProjectError: A list cannot be read, is empty, or names something that is no block.
    """
    tasks = [task for source in sources for task in _tasks(source)]
    folders = [os.path.realpath(task.block) for task in tasks]
    twice = sorted(
        {str(task.block) for task in tasks if folders.count(os.path.realpath(task.block)) > 1}
    )
    if twice:
        cause = "names {block} more than once."
        raise ProjectError(sources[-1], cause, "Name every block once.", block=twice[0])
    return tuple(sorted(tasks, key=lambda task: -task.priority))


def _tasks(source: Path) -> list[BlockTask]:
    """The blocks of one folder, pattern, file or table."""
    if (source / FILE).is_file():
        return [BlockTask(source)]
    if source.is_dir():
        tasks = [BlockTask(source / found["path"]) for found in blocks_in(source)]
    elif glob.has_magic(str(source)) and not source.exists():
        found = (Path(path) for path in sorted(glob.glob(str(source), recursive=True)))
        tasks = [BlockTask(path) for path in found if (path / FILE).is_file()]
    else:
        tasks = [_task(source, row) for row in _rows(source)]
    if not tasks:
        remedy = "Name a folder with blocks in it, or a file with the path of a block a line."
        raise ProjectError(source, "lists no block.", remedy)
    return tasks


def _rows(source: Path) -> list[dict[str, str]]:
    """Rows of a list, by column."""
    try:
        text = plain_bytes(source).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        remedy = "Name a folder, or a text file in UTF-8 with the path of a block a line."
        raise ProjectError(source, "cannot be read.", remedy) from error
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    head = [name.strip().lower() for name in lines[0].split(",")] if lines else []
    if "block" not in head:
        return [{"block": line.strip()} for line in lines]
    if unknown := [name for name in head if name not in LISTED]:
        cause, remedy = "has an unknown column {name}.", "Its columns are {names}."
        raise ProjectError(source, cause, remedy, name=unknown[0], names=LISTED)
    rows = [dict(zip(head, row, strict=False)) for row in csv.reader(lines[1:])]
    if any(not row.get("block", "").strip() for row in rows):
        raise ProjectError(source, "has a row without a block.", "Give every row the path of one.")
    return rows


def _task(source: Path, row: dict[str, str]) -> BlockTask:
    """One row of a list."""
    block = folder_of(source.parent / os.path.expanduser(row["block"].strip()))
    if not os.path.isfile(block / FILE):
        cause = "names {block}, where there is no block.toml."
        remedy = "Correct the path, or make the block with `gruber new`."
        raise ProjectError(source, cause, remedy, block=row["block"].strip())
    until, priority = row.get("until", "").strip(), row.get("priority", "").strip()
    if until and until not in STAGE_NAMES:
        cause, remedy = "names an unknown stage {name}.", "Stages are {names}."
        raise ProjectError(source, cause, remedy, name=until, names=", ".join(STAGE_NAMES))
    try:
        return BlockTask(block, float(priority or 0), until)
    except ValueError as error:
        cause = "gives {block} the priority {value}, which is no number."
        values = {"block": row["block"].strip(), "value": priority}
        raise ProjectError(source, cause, "Use a number; higher runs first.", **values) from error


def listed(sources: Sequence[Path], voice: Voice, language: str) -> "Batch":
    """The blocks of some lists, with their table beside them.

    Args:
        sources: As `read_list` takes them.
        voice: Told of all.
        language: Of the reports; empty for that of each last one.
    """
    tasks = [replace(task, language=language) for task in read_list(*sources)]
    first = sources[0]
    if len(sources) > 1 or glob.has_magic(str(first)):
        # The shell may have spelt a pattern out: its blocks have a folder above them.
        first = Path(os.path.commonpath([os.path.abspath(task.block.parent) for task in tasks]))
    table = (first if first.is_dir() else first.parent) / TABLE
    if any(os.path.realpath(source) == os.path.realpath(table) for source in sources):
        cause, remedy = "has the name of the table that shows how far each block is.", "Rename it."
        raise ProjectError(table, cause, remedy)
    return Batch(tasks, table, voice)


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
        self._processes: set[subprocess.Popen[str]] = set()
        self._written: tuple[BlockState, ...] = ()

    def run(self, executor: Executor, workers: int, scheduler: str = "") -> None:
        """Run all blocks; a finished block is looked through in seconds and left as it is.

        Args:
            executor: `threads`: one block after another, its pieces in threads. `processes`:
                as many blocks side by side as there are workers, with one thread each; a single
                one with all of them. `dask`: each worker of a Dask cluster takes one block at a
                time.
            workers: Threads, or processes.
            scheduler: Address of the Dask scheduler; a cluster on this machine without one.

        Raises:
            ProjectError: Some blocks failed; all others are done.
            Cancelled: Stopped; what is done stays, and the next call resumes.
        """
        progress = self.voice.stage("batch", "Blocks")
        started = time.monotonic()
        with self._runner(executor, workers, scheduler) as (run_one, width), interruptible() as ask:
            pool = ThreadPoolExecutor(width, thread_name_prefix="block")
            waiting = {pool.submit(self._follow, run_one, task) for task in self.tasks}
            try:
                while waiting:
                    done, waiting = wait(waiting, LOOK_S, FIRST_COMPLETED)
                    for one in done:
                        one.result()
                    self._write()
                    ask.watching(progress).report(*self._progress())
            finally:
                pool.shutdown(wait=False, cancel_futures=True)
                self._stop()
                # Futures of a cluster end when its client closes, the runs here when they stop.
                pool.shutdown(wait=executor != "dask")
                self._write()
        told = str(self.table or self.tasks[0].block)
        self.voice.ended("batch", "Blocks", time.monotonic() - started, told)
        self._refuse_failed()

    @property
    def tasks(self) -> tuple[BlockTask, ...]:
        """The blocks in the order they begin."""
        return tuple(state.task for state in self.states.values())

    @contextmanager
    def _runner(
        self, executor: Executor, workers: int, scheduler: str
    ) -> Generator[tuple[Callable[[BlockTask], BlockState], int]]:
        """What runs one block, and how many it may run side by side."""
        if executor == "dask":
            with dask_client(scheduler) as client:
                yield lambda task: run_on_cluster(client, task), len(self.states)
            return
        side_by_side = executor == "processes" and len(self.states) > 1
        threads, width = (1, workers) if side_by_side else (workers, 1)
        yield lambda task: run_apart(task, threads, self._tell, self._processes), width

    def _follow(self, run_one: Callable[[BlockTask], BlockState], task: BlockTask) -> None:
        """Run one block and keep how it went."""
        self.states[task.block] = BlockState(task, "running")
        try:
            self.states[task.block] = state = run_one(task)
        except ProjectError:
            self.states[task.block] = BlockState(task)
            raise
        self.voice.say(
            say("{block}: {state}", block=task.block, state=state.message or state.state)
        )

    def _tell(self, task: BlockTask, stage: str) -> None:
        self.states[task.block] = replace(self.states[task.block], stage=stage)

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
        with whole_file(self.table) as temporary, temporary.open("w", encoding="utf-8") as file:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerow(COLUMNS)
            for state in states:
                row = (state.state, state.stage, state.seconds, state.findings, state.message)
                rows.writerow([guarded(cell) for cell in (str(state.task.block), *row)])
        self._written = states

    def _stop(self) -> None:
        """Ask the runs under way to stop, and wait until they have."""
        for process in tuple(self._processes):
            process.send_signal(signal.SIGINT)
        for process in tuple(self._processes):
            try:
                process.wait(PATIENCE_S)
            except subprocess.TimeoutExpired:
                process.kill()

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


def run_block(block: Path, voice: Voice, options: RunOptions) -> Run:
    """Run a block in this process and return what was made."""
    project = read_project(block)
    with Session.open(project.folder, Settings().operator) as session:
        walk = Run(project, session, voice, options)
        walk.walk()
    return walk


def run_apart(
    task: BlockTask,
    threads: int,
    told: Callable[[BlockTask, str], None],
    running: "set[subprocess.Popen[str]]",
) -> BlockState:
    """Run one block as `gruber run` does, in a process of its own.

    Args:
        task: The block.
        threads: Pieces of a stage that run side by side.
        told: Handed the block and the stage that begins.
        running: Holds the process as long as it is at work.

    Returns:
        The block, done or failed.
    """
    # -P: a module beside the blocks that is called as one of Python's is none of ours.
    command = [sys.executable, "-P", "-m", "gruber", "--log-json", "run", str(task.block)]
    command += ["--workers", str(threads), *chain.from_iterable(task.options.items())]
    started, stage, why, last, early = time.monotonic(), "", "", "", False
    # A session of its own: Ctrl-C reaches this program alone, which hands it on.
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    ) as process:
        running.add(process)
        assert process.stdout is not None
        for text in process.stdout:
            line = _line_of(text)
            match line.get("event"):
                case "stage":
                    stage = str(line["stage"])
                    told(task, stage)
                case "error":
                    why = cast("str", from_json(line["told"]))
                case "ended-early":
                    why, early = str(line["text"]), True
                case None:
                    last = text.strip()
                case _:
                    pass
        code = process.wait()
    running.discard(process)
    seconds = round(time.monotonic() - started, 1)
    if code == CANCELLED:
        return BlockState(task, "waiting", stage, seconds)
    if code == 0 and not why:
        return BlockState(task, "done", stage, seconds)
    ended = say("exit code {code}", code=code)
    return BlockState(task, "failed", stage, seconds, why or last or ended, ended_early=early)


def _line_of(text: str) -> dict[str, Any]:
    """A line of JSON; empty for what is printed otherwise, such as the end of a traceback."""
    try:
        line = json.loads(text)
    except ValueError:
        return {}
    return cast("dict[str, Any]", line) if isinstance(line, dict) else {}


def dask_client(scheduler: str) -> Any:
    """A client of a Dask cluster, the one of this machine where none is named.

    Raises:
        ProjectError: Dask is not installed, or the scheduler does not answer.
    """
    try:
        from distributed import Client
    except ImportError as error:
        remedy = "Install it: pip install 'gruber[cluster]'."
        raise ProjectError("dask", "is not installed.", remedy) from error
    # A lost connection stands in our error; its own words would be pages of calls.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    try:
        if scheduler:
            return Client(scheduler)
        # Its own pages at any free port: two clusters on one machine would want the same one.
        return Client(threads_per_worker=1, dashboard_address="127.0.0.1:0")
    except (OSError, ValueError) as error:
        remedy = "Start it with `dask scheduler`, or correct --scheduler."
        raise ProjectError(scheduler, "does not answer.", remedy) from error


def run_on_cluster(client: Any, task: BlockTask) -> BlockState:
    """Run one block on a worker, which sees the same folders.

    Another worker takes over from one that dies, where that one had got to: finished stages stay.

    Raises:
        ProjectError: The scheduler answers no longer.
    """
    from distributed import KilledWorker

    started, whole = time.monotonic(), replace(task, block=task.block.resolve())
    future, error = None, None
    for _ in range(HANDED_OUT):
        future = client.submit(run_silently, whole, pure=False, priority=task.priority)
        error = future.exception()
        if not isinstance(error, KilledWorker):
            break
    assert future is not None
    if future.cancelled():
        remedy = "Start it again and give the same command again; finished blocks stay."
        raise ProjectError("dask scheduler", "answers no longer.", remedy)
    seconds = round(time.monotonic() - started, 1)
    if error is None and (why := future.result()):
        return BlockState(task, "failed", "adjustment", seconds, why, ended_early=True)
    if error is None:
        return BlockState(task, "done", task.until or STAGE_NAMES[-1], seconds)
    if isinstance(error, KilledWorker):
        why = say("every worker that ran it died; their logs say why, often too little memory.")
        return BlockState(task, "failed", "", seconds, why)
    why = error.told if isinstance(error, PhotogrammetryError) else str(error)
    return BlockState(task, "failed", "", seconds, why)


def run_silently(task: BlockTask) -> str:
    """Run a block on a worker of a cluster, in its process, so that both end together.

    Returns:
        Why it made no orthos, mosaic and report; empty where nothing was in the way.
    """
    share_heaps()
    options = RunOptions(task.first or None, task.until or None, 1, task.language)
    return run_block(task.block, JsonLines(io.StringIO()), options).ended_early
