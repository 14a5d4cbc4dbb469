"""An operator without a browser: the messages that the pages send, into the desk's own loop."""

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from app.desk.inputs import DeskInputs, desk_inputs
from app.desk.loop import ReviewLoop
from app.desk.measuring import PhotoToPhoto
from app.desk.messages import Screen, SeatTaken
from app.project import read_project
from core.adjustment.adjusted import AdjustmentReport
from sessions.session import Session
from ui.review.gestures import gesture_from_message
from ui.web.access import Door

SEAT = "hand-1"
PATIENCE_S = 300.0
Key = tuple[str, str]
Parts = dict[str, Any]
Proposing = Callable[[PhotoToPhoto | None], PhotoToPhoto]


class LoopHand:
    """Sits at the desk of a block that was run; what it decides is on the disk."""

    def __init__(self, folder: Path, name: str, proposing: Proposing | None = None) -> None:
        """Sit down.

        Args:
            folder: The block.
            name: Of the operator.
            proposing: What stands between the desk and what proposes places; without it none are.
        """
        project = read_project(folder)
        self.session = Session.open(project.folder, name)
        inputs = desk_inputs(project, self.session, name, Door())
        self.inputs: DeskInputs = replace(
            inputs,
            adopted=self._adopt,
            likeness=None,
            transfer=proposing and proposing(inputs.transfer),
        )
        self.report: AdjustmentReport = inputs.report
        self.parts: Parts = {}
        self._change = threading.Condition()
        screen = Screen(self._show, _nothing, _nothing, _nothing, _nothing)
        self.loop = ReviewLoop(self.inputs, screen)
        self.loop.start()
        self.loop.submit(SeatTaken(SEAT))
        self.until(lambda parts: "rows" in parts and "status" in parts)

    def send(self, kind: str, **content: Any) -> None:
        """One message of a page."""
        gesture = gesture_from_message(SEAT, {"kind": kind, **content})
        assert gesture is not None, (kind, content)
        self.loop.submit(gesture)

    def until(self, test: Callable[[Parts], bool]) -> None:
        """Wait for what the page shows."""
        with self._change:
            assert self._change.wait_for(lambda: test(self.parts), PATIENCE_S)

    def states(self) -> dict[Key, str]:
        """The state of every row of the queue."""
        return {(row[0], row[1]): row[3] for row in self.parts["rows"]}

    def look(self, key: Key) -> None:
        """Choose a row."""
        self.send("select", key=list(key))
        self.until(lambda parts: tuple(parts["point"]["key"]) == key)

    def place(self, key: Key, column: float, row: float) -> bool:
        """Click at a pixel of the raw scan and keep it; whether the desk asked about it."""
        self.send("place", key=list(key), frame="scan", place=[column, row])
        return self.keep(key)

    def keep(self, key: Key) -> bool:
        """`Y`, and once more where the desk asks."""
        decided = self.parts["status"]["decided"]
        self.send("judge", key=list(key), verdict="accept")
        self.until(lambda parts: parts["status"]["decided"] > decided or _asks(parts, key))
        asked = self.parts["status"]["decided"] == decided
        if asked:
            self.send("judge", key=list(key), verdict="accept")
            self.until(lambda parts: parts["status"]["decided"] > decided)
        return asked

    def settle(self) -> None:
        """Wait until everything that was decided is adjusted."""
        self.until(lambda parts: not parts["status"]["adjusting"])

    def close(self) -> None:
        """Leave."""
        self.loop.close()
        self.session.close()

    def _adopt(self, report: AdjustmentReport) -> None:
        self.report = report

    def _show(self, seat_id: str, parts: Parts) -> None:
        with self._change:
            self.parts.update(parts)
            self._change.notify_all()


def _asks(parts: Parts, key: Key) -> bool:
    """Whether the desk asks if a draft is meant."""
    point = parts["point"]
    draft = point and tuple(point["key"]) == key and point.get("draft")
    return bool(draft and draft["asking"])


def _nothing(*_: Any) -> None:
    """What is not looked at."""
