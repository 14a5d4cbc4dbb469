"""Names of running processes, and a lock that lets one run at a time work on a block."""

import fcntl
import json
import os
import socket
import zlib
from collections.abc import Generator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from core.errors import StorageError
from core.said import say
from sessions.disk import explain_disk_errors

_held: set[Path] = set()
"""Locks this process holds. The kernel's record locks do not keep a process from itself, and are
gone as soon as the process closes the file a second time: a held lock is never opened again."""


def this_process() -> str:
    """A name for this process that no later one on this machine bears: host, number, start."""
    return f"{_host()}-{os.getpid()}-{_start_of(os.getpid())}"


def is_alive(process: str) -> bool:
    """True when the process of that name may still be at work.

    A process of another machine cannot be asked and counts as alive.
    """
    host, number, start = process.split("-")
    return host != _host() or _start_of(int(number)) == start


@contextmanager
def only_run(path: Path, operator: str) -> Generator[None]:
    """Hold the block's lock; the kernel lets go of it when the process dies, however it dies.

    Args:
        path: The lock file; what it holds is only for the message to others.
        operator: Who runs.

    Raises:
        StorageError: Another run is at work in the same block.
    """
    path = path.resolve()
    if path in _held:
        raise _taken(path, "this very process")
    with explain_disk_errors(path):
        file = path.open("a+", encoding="utf-8")
    with file:
        _lock(path, file.fileno())
        _held.add(path)
        try:
            with explain_disk_errors(path):
                _sign(file.fileno(), operator)
            yield
        finally:
            _held.remove(path)


def _lock(path: Path, descriptor: int) -> None:
    try:
        # Record locks, not flock: the children of a killed run must not keep its lock.
        fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError) as error:
        raise _taken(path, _holder(path)) from error
    except OSError as error:
        remedy = "Copy the block to a local disk and work there."
        raise StorageError(
            path,
            say("cannot be locked ({strerror}).", strerror=error.strerror),
            remedy,
        ) from error


def _sign(descriptor: int, operator: str) -> None:
    """Write into the lock who holds it."""
    since = datetime.now(UTC).isoformat(timespec="seconds")
    text = json.dumps({"operator": operator, "process": os.getpid(), "since": since})
    os.ftruncate(descriptor, 0)
    os.pwrite(descriptor, text.encode(), 0)


def _holder(path: Path) -> str:
    """Who holds a lock, in words."""
    try:
        holder = json.loads(path.read_text(encoding="utf-8"))
        return f"{holder['operator']} (process {holder['process']}, since {holder['since']})"
    except (OSError, ValueError, KeyError, TypeError):
        return "another process"


def _taken(path: Path, who: str) -> StorageError:
    return StorageError(
        path,
        say("shows that {who} is working on this block.", who=who),
        "Wait for that run, or end it.",
    )


def _host() -> str:
    """Eight hexadecimal digits for this machine."""
    return f"{zlib.crc32(socket.gethostname().encode()):08x}"


def _start_of(number: int) -> str:
    """When a process began, in ticks since the machine started; empty when it is not alive.

    Field 22 of /proc/PID/stat, counted from behind the name, which may hold blanks and brackets.
    Where there is no /proc, every living process answers 0.
    """
    try:
        stat = Path(f"/proc/{number}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return "" if Path("/proc/self/stat").exists() else _answer(number)
    fields = stat.rpartition(")")[2].split()
    return "" if fields[0] in "ZX" else fields[19]


def _answer(number: int) -> str:
    """0 when a process of that number can be signalled, empty when there is none."""
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return ""
    except PermissionError:
        return "0"
    return "0"
