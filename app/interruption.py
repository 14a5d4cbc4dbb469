"""Ctrl-C that cannot get lost.

Python raises KeyboardInterrupt wherever the main thread happens to be. Inside a callback of a
library, or while an object is being destroyed, it is printed and forgotten, and the work would go
on. So it is noted as well, and the next report of progress stops the work.
"""

import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field

from core.errors import Cancelled
from core.progress import Progress


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
