"""Where the system's allocator takes memory from."""

import ctypes
from contextlib import suppress

# source: malloc.h of the GNU C library.
M_ARENA_MAX = -8
# measured: tests/benchmarks/bench_rolls.py, 24 photos up to control: peaks of 1.28, 1.30, 1.35 and
# 1.89 GiB with 1, 2, 4 and 16 heaps, in the same time; with two, one thread waits for no other.
HEAPS = 2
"""Heaps of the whole program."""


def share_heaps() -> None:
    """Let all threads allocate from two heaps, where the system has the GNU allocator.

    Threads otherwise have heaps of their own: what one frees no other takes, and a run over many
    photos holds twice what it needs.
    """
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).mallopt(M_ARENA_MAX, HEAPS)
