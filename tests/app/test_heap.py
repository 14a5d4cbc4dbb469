"""Threads take memory from the same heaps."""

import subprocess
import sys

import pytest

PROGRAM = """
import ctypes, sys, threading
from app.heap import share_heaps

if sys.argv[1] == "shared":
    share_heaps()
all_hold = threading.Barrier(5)


def hold():
    held = bytearray(10_000)
    all_hold.wait()


threads = [threading.Thread(target=hold) for _ in range(4)]
for thread in threads:
    thread.start()
all_hold.wait()
system = ctypes.CDLL(None)
system.fdopen.restype = ctypes.c_void_p
out = ctypes.c_void_p(system.fdopen(1, b"w"))
system.malloc_info(0, out)
system.fflush(out)
"""


@pytest.mark.parametrize(("heaps", "told"), [("shared", 2), ("own", 5)])
def test_threads_share_heaps_once_told__oracle(heaps, told):
    """As the allocator itself tells it."""
    ended = subprocess.run(
        [sys.executable, "-c", PROGRAM, heaps], capture_output=True, text=True, check=True
    )
    assert ended.stdout.count("<heap nr=") == told
