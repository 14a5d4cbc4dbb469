"""Threads take memory from one heap."""

import subprocess
import sys

import pytest

PROGRAM = """
import ctypes, sys, threading
from core.heap import share_one_heap

if sys.argv[1] == "one":
    share_one_heap()
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


@pytest.mark.parametrize(("heaps", "told"), [("one", 1), ("many", 5)])
def test_threads_share_a_heap_only_when_told__oracle(heaps, told):
    """As the allocator itself tells it."""
    ended = subprocess.run(
        [sys.executable, "-c", PROGRAM, heaps], capture_output=True, text=True, check=True
    )
    assert ended.stdout.count("<heap nr=") == told
