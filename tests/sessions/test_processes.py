"""Names of processes: alive, dead, and of a number used anew."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from core.errors import StorageError
from sessions.processes import is_alive, is_held, only_run, this_process


def test_a_process_is_alive_until_it_ends_even_if_nobody_asked_how__truth() -> None:
    asks = "from sessions.processes import this_process; print(this_process(), flush=True); input()"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", asks], text=True, **pipes) as other:
        assert other.stdout is not None
        name = other.stdout.readline().strip()
        assert is_alive(name)
        host, number, start = name.split("-")
        assert int(number) == other.pid
        assert not is_alive(f"{host}-{number}-{int(start) + 1}"), "the number was used anew"
        assert is_alive(f"00000000-{number}-{int(start) + 1}"), "another machine cannot be asked"
        other.kill()
        os.waitid(os.P_PID, other.pid, os.WEXITED | os.WNOWAIT)
        assert not is_alive(name), "it has ended, though its number is not free yet"
    assert not is_alive(name)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="the kernel is not Linux")
def test_a_start_is_counted_as_the_kernel_counts_it__oracle() -> None:
    """proc(5), field 22 of stat: names that earlier versions left are understood."""
    stat = Path("/proc/self/stat").read_text()
    assert this_process().split("-")[1:] == [str(os.getpid()), stat.rpartition(")")[2].split()[19]]


def test_a_pipe_for_a_lock_is_refused__law(tmp_path):
    """Opening it would wait for a reader."""
    os.mkfifo(tmp_path / "lock")
    with pytest.raises(StorageError, match="is not a file"), only_run(tmp_path / "lock", "ada"):
        pass


def test_a_lock_is_held_while_its_process_is_at_work__law(tmp_path):
    lock = tmp_path / "lock"
    assert not is_held(lock)
    with only_run(lock, "ada"):
        assert is_held(lock)
        killed = lock.read_bytes().replace(this_process().encode(), b"here-1-2")
    assert not is_held(lock)
    for left in (killed, b" {}", b" 3", b"\xff"):
        lock.write_bytes(left)
        assert is_held(lock) == (left is killed)  # another machine's cannot be asked
