"""Names of running processes, and a lock that lets one run at a time work on a block."""

import json
import os
import signal
import socket
import time
import zlib
from collections.abc import Generator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from threading import Thread

import psutil
from filelock import lock_descriptor

from core.errors import StorageError
from core.said import say
from sessions.disk import explain_disk_errors

# design: Windows keeps the locked byte from every reader; JSON may begin with a blank.
LOCKED = b" "
"""What stands before the holder in a lock file."""
# design: Linux counts in hundredths of a second; nothing starts twice under one number in less.
TICKS_A_SECOND = 100
UNSIGNED = (OSError, ValueError, LookupError, TypeError, AttributeError)
"""Raised over a lock file that is not there, or holds something else."""
STARTED_BY = "GRUBER_STARTED_BY"
"""Variable of the environment that names the process with which one is to end."""
# design: a block that nobody waits for is let go of in seconds.
LOOK_S = 2.0
"""How often it is looked whether the other one is alive."""


def this_process() -> str:
    """A name for this process that no later one on this machine bears: host, number, start."""
    return f"{_host()}-{os.getpid()}-{_start_of(os.getpid())}"


def is_alive(process: str) -> bool:
    """True when the process of that name may still be at work.

    A process of another machine cannot be asked and counts as alive.
    """
    host, number, start = process.split("-")
    try:
        return host != _host() or _start_of(int(number)) == start
    except psutil.AccessDenied:
        return True


def end_with_starter() -> None:
    """Interrupt this process, as Ctrl-C does, once the one that started it for its own is gone."""
    starter = os.environ.get(STARTED_BY, "")
    if starter:
        Thread(target=_wait_for_end, args=(starter,), name="starter", daemon=True).start()


def _wait_for_end(starter: str) -> None:
    while is_alive(starter):
        time.sleep(LOOK_S)
    os.kill(os.getpid(), signal.SIGINT)


@contextmanager
def only_run(path: Path, operator: str, batch: bool = False) -> Generator[None]:
    """Hold a lock on a block; the kernel lets go of it when the process dies, however it dies.

    Args:
        path: The lock file; what it holds is only for the message to others.
        operator: Who runs.
        batch: The lock is one on a batch of many blocks.

    Raises:
        StorageError: Another run is at work in the same block, or the same batch.
    """
    if path.exists() and not path.is_file():
        raise StorageError(path, "is not a file.", "Remove it.")
    with explain_disk_errors(path):
        file = path.open("ab")
    with file:
        _lock(path, file.fileno(), batch)
        with explain_disk_errors(path):
            _sign(file.fileno(), operator)
        try:
            yield
        finally:
            os.ftruncate(file.fileno(), 0)


def _lock(path: Path, descriptor: int, batch: bool) -> None:
    try:
        # A child that was forked would keep the lock; one started by a command does not, and the
        # program starts no others.
        if not lock_descriptor(descriptor, blocking=False):
            raise _taken(path, _holder(path), batch)
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
    text = json.dumps({"operator": operator, "process": this_process(), "since": since})
    os.ftruncate(descriptor, 0)
    os.write(descriptor, LOCKED + text.encode())


def is_held(path: Path) -> bool:
    """True while the process that last held a lock may be at work; the lock is not touched."""
    try:
        return is_alive(_signature(path)["process"])
    except UNSIGNED:
        return False


def _holder(path: Path) -> str:
    """Who holds a lock, in words."""
    try:
        holder = _signature(path)
        number = holder["process"].split("-")[1]
        return f"{holder['operator']} (process {number}, since {holder['since']})"
    except UNSIGNED:
        return "another process"


def _signature(path: Path) -> dict[str, str]:
    """What `_sign` wrote."""
    with path.open("rb", buffering=0) as file:
        file.seek(len(LOCKED))
        return json.loads(file.read())


def _taken(path: Path, who: str, batch: bool) -> StorageError:
    one = say("shows that {who} is working on this block.", who=who)
    many = say("shows that {who} is running this batch.", who=who)
    return StorageError(path, many if batch else one, "Wait for that run, or end it.")


def _host() -> str:
    """Eight hexadecimal digits for this machine."""
    return f"{zlib.crc32(socket.gethostname().encode()):08x}"


def _start_of(number: int) -> str:
    """When a process began, in hundredths of a second; empty when it is not alive.

    Raises:
        psutil.AccessDenied: The system tells nothing of that process.
    """
    try:
        process = psutil.Process(number)
        if process.status() in (psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD):
            return ""
        began = process.create_time()
    except psutil.NoSuchProcess:
        return ""
    # Linux knows it from the start of the machine, so that setting the clock changes nothing.
    since = psutil.boot_time() if psutil.LINUX else 0.0
    return str(round((began - since) * TICKS_A_SECOND))
