"""`gruber run` from the placing page, in a thread of its own, with progress and a way to stop."""

import threading
import time
from pathlib import Path
from typing import Any, Literal

from app.desk.background import survived
from app.project import read_project
from app.run import LAST_STAGES, STAGE_NAMES, Run, RunOptions
from app.settings import Settings
from app.terminal import JsonLines
from core.errors import Cancelled
from core.pipeline import STAGES
from sessions.session import Session

State = Literal["idle", "running", "cancelled", "failed", "done"]
TITLES = {**{stage.name: stage.title for stage in STAGES}, **LAST_STAGES}


class Running:
    """One run at a time; asked from any thread."""

    def __init__(self, block: Path) -> None:
        self._block = block
        self._lock = threading.Lock()
        self._state: State = "idle"
        self._said: dict[str, Any] = {}
        self._walk: Run | None = None
        self._thread: threading.Thread | None = None
        self.gone_through = threading.Event()

    def start(self) -> None:
        """Begin, unless a run is under way."""
        with self._lock:
            if self._state == "running":
                return
            self._state, self._said = "running", {"begun": time.monotonic()}
            self._thread = threading.Thread(target=self._go, name="run", daemon=True)
            self._thread.start()

    def cancel(self) -> None:
        """Ask it to stop at its next report; nothing finished is lost."""
        if self._walk is not None:
            self._walk.interruption.asked.set()

    def close(self) -> None:
        """Stop and wait."""
        self.cancel()
        if self._thread is not None:
            self._thread.join(timeout=30)

    def status(self) -> dict[str, Any]:
        """State, stage, its place among all, share of it that is done, and the error if any."""
        with self._lock:
            said = {key: value for key, value in self._said.items() if key != "begun"}
            seconds = time.monotonic() - self._said.get("begun", time.monotonic())
            return {"state": self._state, "seconds": round(seconds), **said}

    def _go(self) -> None:
        why = survived(lambda _: self._run(), self)
        with self._lock:
            if why:
                self._state, self._said["why"] = "failed", why
            elif self._state == "running":
                self._state = "done"
            through = self._state == "done"
        if through:
            self.gone_through.set()

    def _run(self) -> None:
        project = read_project(self._block)
        options = RunOptions(workers=Settings().workers)
        with Session.open(project.folder, "gruber") as session:
            self._walk = Run(project, session, Telling(self.tell), options)
            try:
                self._walk.walk()
            except (Cancelled, KeyboardInterrupt):
                with self._lock:
                    self._state = "cancelled"
            finally:
                self._walk = None

    def tell(self, message: dict[str, Any]) -> None:
        """Take a line of the run."""
        stage = str(message.get("stage", ""))
        with self._lock:
            match message["event"]:
                case "stage":
                    place = STAGE_NAMES.index(stage)
                    self._said |= {
                        "stage": stage, "title": TITLES[stage], "share": 0.0, "what": "",
                        "place": place + 1, "stages": len(STAGE_NAMES),
                    }  # fmt: skip
                case "progress":
                    share = message["done"] / message["total"] if message["total"] else 0.0
                    self._said |= {"share": round(share, 3), "what": message["what"]}
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
