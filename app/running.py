"""A run started from a page: one at a time, reported line by line, stopped on request."""

import threading
import time
from pathlib import Path
from typing import Any, Literal, cast

from app.desk.background import survived
from app.project import read_project
from app.run import STAGE_NAMES, WHEN_ASKED, Run, RunOptions
from app.settings import Settings
from app.terminal import JsonLines
from core.errors import Cancelled
from sessions.session import Session

State = Literal["idle", "running", "cancelled", "failed", "done"]
# design: with less of a stage done, what is left of it cannot be told.
LEAST_SHARE = 0.03
"""Share of a stage from which the time it still takes is told."""


class Running:
    """One run at a time; asked from any thread."""

    def __init__(self, block: Path) -> None:
        self._block = block
        self._lock = threading.Lock()
        self._state: State = "idle"
        self._why = ""
        self._lines: list[dict[str, Any]] = []
        self._log: list[str] = []
        self._begun = 0.0
        self._asked = threading.Event()
        self._walk: Run | None = None
        self._thread: threading.Thread | None = None
        self.gone_through = threading.Event()

    @property
    def under_way(self) -> bool:
        """True while a run is at work."""
        return self._state == "running"

    def start(self) -> None:
        """Begin, unless a run is under way."""
        with self._lock:
            if self._state == "running":
                return
            self._state, self._why, self._lines, self._log = "running", "", [], []
            self._begun = time.monotonic()
            self._asked.clear()
            self._thread = threading.Thread(target=self._go, name="run", daemon=True)
            self._thread.start()

    def cancel(self) -> None:
        """Ask it to stop at its next report; nothing finished is lost."""
        self._asked.set()
        if self._walk is not None:
            self._walk.interruption.asked.set()

    def close(self) -> None:
        """Stop and wait."""
        self.cancel()
        if self._thread is not None:
            self._thread.join(timeout=30)

    def status(self) -> dict[str, Any]:
        """How far the run is.

        Returns:
            `state`, whether it is `cancelling`, `why` it failed, whole `seconds` since it began, a
            line for each stage in
            `lines` (name, how often it was walked before, seconds, what was said; of the last one
            its share, what it is at and the seconds it still takes), and sentences in `log`.
        """
        with self._lock:
            now = time.monotonic()
            lines = [_told(line, now) for line in self._lines]
            seconds = round(now - self._begun) if self._begun else 0
            cancelling = self._state == "running" and self._asked.is_set()
            return {
                "state": self._state, "cancelling": cancelling, "why": self._why,
                "seconds": seconds, "lines": lines,
                "log": list(self._log), "stages": self._names(),
            }  # fmt: skip

    def _names(self) -> list[str]:
        """Stages that the run goes through."""
        walk = self._walk
        return [
            name
            for name in STAGE_NAMES
            if name not in WHEN_ASKED or (walk is not None and walk.asked(name))
        ]

    def _go(self) -> None:
        why = survived(lambda _: self._run(), self)
        with self._lock:
            if why:
                self._state, self._why = "failed", why
            elif self._state == "running":
                self._state = "done"
            through = self._state == "done"
        if through:
            self.gone_through.set()

    def _run(self) -> None:
        project = read_project(self._block)
        settings = Settings()
        options = RunOptions(workers=settings.workers)
        with Session.open(project.folder, settings.operator) as session:
            self._walk = Run(project, session, Telling(self.tell), options)
            try:
                self._walk.walk()
            except (Cancelled, KeyboardInterrupt):
                with self._lock:
                    self._state = "cancelled"
            finally:
                self._walk = None

    def tell(self, message: dict[str, Any]) -> None:
        """Take a line of the run; raises `Cancelled` when it was asked to stop."""
        if self._asked.is_set():
            raise Cancelled
        with self._lock:
            match message["event"]:
                case "stage":
                    name = message["stage"]
                    passes = 1 + sum(line["stage"] == name for line in self._lines)
                    begun = {"stage": name, "pass": passes, "begun": time.monotonic()}
                    self._lines.append({**begun, "share": 0.0, "what": ""})
                case "progress":
                    share = message["done"] / message["total"] if message["total"] else 0.0
                    self._lines[-1] |= {"share": round(share, 3), "what": message["what"]}
                case "done":
                    ended = {"seconds": message["seconds"], "said": message["said"], "share": 1.0}
                    self._lines[-1] |= ended
                case "message" | "ended-early":
                    self._log.append(message["text"])
                case _:
                    pass


class Telling(JsonLines):
    """The voice of a run whose lines go to a function instead of a terminal."""

    def __init__(self, tell: Any) -> None:
        super().__init__()
        self._tell = tell

    def write(self, message: dict[str, object]) -> None:
        """Hand one line on."""
        self._tell(message)


def _told(line: dict[str, Any], now: float) -> dict[str, Any]:
    """A line as it is shown: without the clock, with the time left while it is at work."""
    shown = {key: value for key, value in line.items() if key != "begun"}
    if "seconds" in line:
        return shown
    taken, share = now - cast("float", line["begun"]), cast("float", line["share"])
    left = round(taken * (1 - share) / share) if share >= LEAST_SHARE else None
    return {**shown, "taken": round(taken), "left": left}
