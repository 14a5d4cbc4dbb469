"""Progress of long work on a terminal or as JSON lines, and how Ctrl-C stops it.

Python raises KeyboardInterrupt wherever the main thread happens to be. Inside a callback of a
library, or while an object is being destroyed, it is printed and forgotten, and the work would go
on. So Ctrl-C is noted as well, and the next report of progress stops the work.
"""

import json
import os
import signal
import sys
import threading
import time
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TextIO

from rich.console import Console
from rich.progress import BarColumn, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as ProgressBar

from core.errors import Cancelled, PhotogrammetryError
from core.progress import Progress
from ui.words.catalogue import LANGUAGES, Teller


class LastingConsole(Console):
    """A console whose work goes on when the other end of the pipe is closed."""

    def on_broken_pipe(self) -> None:
        """Say nothing more: `gruber review | head -1` must not close the desk."""
        self.quiet = True
        let_go_of_output()


class StageProgress:
    """One stage's bar; satisfies `core.progress.Progress`."""

    def __init__(self, bars: ProgressBar, task: TaskID, tell: Teller) -> None:
        self.bars, self.task, self.tell = bars, task, tell

    def report(self, done: float, total: float, what: str = "") -> None:
        """Move the bar."""
        self.bars.update(
            self.task, completed=done, total=max(total, 1e-9), what=self.tell.again(what)
        )


class Terminal:
    """Bars with time left on a terminal, one plain line a stage elsewhere."""

    def __init__(self, console: Console | None = None, language: str = LANGUAGES[0]) -> None:
        self.tell = Teller(language)
        self.console = console or LastingConsole(highlight=False, soft_wrap=True)
        self.bars: ProgressBar | None = None

    def stage(self, name: str, title: str) -> StageProgress:
        """Begin a stage."""
        self.bars = ProgressBar(
            TextColumn("{task.description:<34}"),
            BarColumn(bar_width=24),
            TimeElapsedColumn(),
            TextColumn(self.tell("terminal.left")),
            TimeRemainingColumn(compact=True),
            TextColumn("{task.fields[what]}", style="dim"),
            console=self.console,
            transient=True,
            disable=not self.console.is_terminal,
        )
        self.bars.start()
        task = self.bars.add_task(self.tell.again(title), total=None, what="")
        return StageProgress(self.bars, task, self.tell)

    def ended(self, name: str, title: str, seconds: float, said: str) -> None:
        """End a stage with one line."""
        if self.bars is not None:
            self.bars.stop()
            self.bars = None
        title, said = self.tell.again(title), self.tell.again(said)
        took = self.tell.number(seconds, "7.1f")
        self.console.print(f"{title:<34}{took} s  {said}", markup=False)

    def say(self, text: str) -> None:
        """A sentence for the operator."""
        self.console.print(self.tell.again(text), markup=False)

    def figures(self, name: str, figures: Mapping[str, object]) -> None:
        """What sentences have told already is for machines."""

    def ended_early(self, why: str) -> None:
        """Tell why the rest of a block cannot be made."""
        self.say(why)

    def failed(self, error: PhotogrammetryError) -> None:
        """The work cannot go on; the message itself goes to the standard error output."""
        self.close()

    def close(self) -> None:
        """Leave the terminal as it was, whatever happened."""
        if self.bars is not None:
            self.bars.stop()


class JsonLines:
    """One JSON object a line: stage begun, progress (at most one a second), stage ended, text.

    Machines are told everything in English.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self.tell = Teller()
        self.stream = stream or sys.stdout
        self.current, self.last = "", 0.0

    def stage(self, name: str, title: str) -> "JsonLines":
        """Begin a stage."""
        self.current = name
        self.write({"event": "stage", "stage": name})
        return self

    def report(self, done: float, total: float, what: str = "") -> None:
        """Progress of the stage."""
        now = time.monotonic()
        if now - self.last >= 1.0:
            self.last = now
            self.write(
                {
                    "event": "progress",
                    "stage": self.current,
                    "done": done,
                    "total": total,
                    "what": what,
                }
            )

    def ended(self, name: str, title: str, seconds: float, said: str) -> None:
        """End a stage."""
        self.write({"event": "done", "stage": name, "seconds": round(seconds, 2), "said": said})

    def say(self, text: str) -> None:
        """A sentence for the operator."""
        self.write({"event": "message", "text": text})

    def figures(self, name: str, figures: Mapping[str, object]) -> None:
        """All figures of what was asked for."""
        self.write({"event": "figures", "of": name, "figures": figures})

    def ended_early(self, why: str) -> None:
        """Tell why the rest of a block cannot be made."""
        self.write({"event": "ended-early", "text": why})

    def failed(self, error: PhotogrammetryError) -> None:
        """The work cannot go on; `told` can be told in any language."""
        from sessions.codec import to_json  # brings the engine, for which no help waits

        parts = {"file": error.file, "cause": error.cause, "remedy": error.remedy}
        self.write({"event": "error", **parts, "told": to_json(error.told)})

    def close(self) -> None:
        """Nothing to put in order."""

    def write(self, message: dict[str, object]) -> None:
        """One line; none when nobody reads any more."""
        try:
            self.stream.write(json.dumps(message, ensure_ascii=False) + "\n")
            self.stream.flush()
        except BrokenPipeError:
            let_go_of_output()


def let_go_of_output() -> None:
    """Send what is still printed nowhere, so that the end of the program does not fail either."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


Voice = Terminal | JsonLines
"""Who tells the operator how the work goes."""


@dataclass(slots=True)
class Interruption:
    """Whether the operator has asked to stop."""

    asked: threading.Event = field(default_factory=threading.Event)
    """Set by the first Ctrl-C."""

    def check(self) -> None:
        """Stop here when asked to; raises `Cancelled`."""
        if self.asked.is_set():
            raise Cancelled

    def watching(self, progress: Progress) -> Progress:
        """The same progress, which also stops the work when asked to."""
        return _Watched(progress, self)


@dataclass(frozen=True, slots=True)
class _Watched:
    progress: Progress
    interruption: Interruption

    def report(self, done: int | float, total: int | float, what: str = "") -> None:
        """Pass the report on; raises `Cancelled` when asked to stop."""
        self.interruption.check()
        self.progress.report(done, total, what)


@contextmanager
def interruptible() -> Generator[Interruption]:
    """Note every Ctrl-C while the block lasts; outside the main thread none arrives."""
    noted = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield noted
        return

    def stop(*_: object) -> None:
        noted.asked.set()
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield noted
    finally:
        signal.signal(signal.SIGINT, before)
