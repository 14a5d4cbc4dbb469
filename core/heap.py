"""Where the system's allocator takes memory from."""

import ctypes
from contextlib import suppress

# source: malloc.h of the GNU C library.
M_ARENA_MAX = -8


def share_one_heap() -> None:
    """Let all threads allocate from one heap, where the system has the GNU allocator.

    Threads otherwise have heaps of their own: what one frees no other takes, and a run over many
    photos holds twice what it needs.
    """
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).mallopt(M_ARENA_MAX, 1)
