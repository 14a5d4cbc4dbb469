"""Processes forked from one that has loaded the program: loading it takes longer than most do."""

import multiprocessing
import os
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Self

FORKING = multiprocessing.get_context("forkserver")
FORKING.set_forkserver_preload(["app.run", "app.verbs.run", "pytest", "tests.forked"])


@dataclass(frozen=True)
class Told:
    """What the program said and how it ended."""

    code: int
    out: str
    err: str

    @property
    def message(self) -> str:
        """The one message of a program that could not go on: file, cause and remedy, no more."""
        assert self.code == 1, f"{self.code}\n{self.out}\n{self.err}"
        lines = self.err.splitlines()
        assert len(lines) == 1, self.err
        assert lines[0].startswith("gruber: "), self.err
        assert "Traceback" not in self.out + self.err
        return lines[0]

    def refuses(self, *words: str | Path) -> None:
        """One message that has these words in this order, ignoring case."""
        rest = self.message.lower()
        for word in words:
            _, found, rest = rest.partition(str(word).lower())
            assert found, f"{word!r} not in: {self.message}"


class Forked:
    """A function of a module in a process of its own, whose lines are read as it writes them."""

    def __init__(self, function: Callable[..., int], *arguments: object) -> None:
        pipes = [FORKING.Pipe(duplex=False) for _ in range(2)]
        theirs = [pipe for _, pipe in pipes]
        self._process = FORKING.Process(target=_speaking, args=(*theirs, function, arguments))
        self._process.start()
        self.out, self.err = (
            os.fdopen(os.dup(ours.fileno()), encoding="utf-8") for ours, _ in pipes
        )
        for pipe in (pipe for both in pipes for pipe in both):
            pipe.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()
        self._process.join()
        self._process.close()
        self.out.close()
        self.err.close()

    def kill(self) -> None:
        """`kill -9`."""
        self._process.kill()

    def ended(self, within_s: float = 600.0) -> Told:
        """What it said and how it ended: minus the signal where one killed it.

        Raises:
            TimeoutError: It had not ended in that time; it is killed.
        """
        late = threading.Timer(within_s, self.kill)
        # Both pipes at once: who fills the one that is not read waits for ever.
        with ThreadPoolExecutor(1) as beside:
            late.start()
            err = beside.submit(self.err.read)
            out = self.out.read()
            self._process.join()
        in_time = late.is_alive()
        late.cancel()
        if not in_time:
            raise TimeoutError(f"not ended in {within_s:.0f} s\n{out}\n{err.result()}")
        assert self._process.exitcode is not None
        return Told(self._process.exitcode, out, err.result())


def _speaking(
    out: Connection, err: Connection, function: Callable[..., int], arguments: tuple[object, ...]
) -> None:
    for number, pipe in enumerate((out, err), start=1):
        os.dup2(pipe.fileno(), number)
        pipe.close()
    sys.exit(function(*arguments))
