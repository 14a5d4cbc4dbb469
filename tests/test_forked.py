"""Forked processes end, whatever they say and however long they take."""

import sys
import time

import pytest

from tests.forked import Forked


def speak(characters: int) -> int:
    """Says so much on both pipes, errors first."""
    sys.stderr.write("e" * characters)
    sys.stdout.write("o" * characters)
    return 3


def sleep(seconds: float) -> int:
    time.sleep(seconds)
    return 0


def test_more_than_a_pipe_holds_is_read_from_both__truth() -> None:
    many = 1 << 20
    with Forked(speak, many) as process:
        told = process.ended(60)
    assert (told.code, told.out, told.err) == (3, "o" * many, "e" * many)


def test_who_does_not_end_in_time_is_killed__truth() -> None:
    with Forked(sleep, 600.0) as process, pytest.raises(TimeoutError, match="not ended in 1 s"):
        process.ended(1)
