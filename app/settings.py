"""Settings of this start of the program: machine, operator, and worker threads."""

import getpass
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from typing import TypeVar

A = TypeVar("A")
B = TypeVar("B")
# design: who cancels sees it happen at once; looking so often costs nothing.
LOOKS_S = 0.2
"""How often is asked whether work is still wanted, seconds."""


def default_workers() -> int:
    """One process for each processor this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def default_operator() -> str:
    """The name the operator is logged in under."""
    try:
        return os.environ.get("USER") or getpass.getuser()
    except (KeyError, OSError):
        # A container may run under a number that has no name.
        return "operator"


@dataclass(frozen=True, slots=True)
class Settings:
    """How this start is to run."""

    workers: int = field(default_factory=default_workers)
    """Processes that work side by side."""
    operator: str = field(default_factory=default_operator)
    """Name under which decisions are recorded."""
    port: int = 8765
    """TCP port of the desk."""
    host: str = "127.0.0.1"
    """Address the desk listens at; this machine only by default."""


class Threads:
    """A pool of threads; numpy, OpenCV and GDAL leave the interpreter while they compute."""

    def __init__(self, workers: int, check: Callable[[], None] | None = None) -> None:
        """So many workers; `check` is called while they are waited for, and raises to stop."""
        self.workers, self._check = workers, check
        self.pool = ThreadPoolExecutor(workers, thread_name_prefix="gruber")

    def map(self, function: Callable[[A], B], items: Iterable[A]) -> Iterator[B]:
        """Results in the order of the items; the first error cancels what has not begun."""
        futures: list[Future[B]] = [self.pool.submit(function, item) for item in items]
        try:
            for future in futures:
                # One item can take half a minute: cancelling does not wait for it.
                while self._check is not None and not wait([future], LOOKS_S).done:
                    self._check()
                yield future.result()
        finally:
            for future in futures:
                future.cancel()

    def close(self, wait: bool = True) -> None:
        """Let go of the threads, having waited for what they do unless told not to."""
        self.pool.shutdown(wait=wait, cancel_futures=True)
