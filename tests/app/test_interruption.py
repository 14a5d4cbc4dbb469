"""Ctrl-C stops the work even where Python forgets it."""

import os
import signal

import pytest

from app.cli import end_as_ctrl_c
from app.terminal import interruptible
from core.errors import Cancelled
from core.progress import Silent


def pressed() -> None:
    os.kill(os.getpid(), signal.SIGINT)


def test_ctrl_c_that_a_callback_swallows_stops_at_the_next_report__law() -> None:
    with interruptible() as noted:
        progress = noted.watching(Silent())
        progress.report(1, 2)
        with pytest.raises(KeyboardInterrupt):
            pressed()
        with pytest.raises(Cancelled):
            progress.report(2, 2)


def test_ctrl_c_is_handled_as_before_afterwards__law() -> None:
    before = signal.getsignal(signal.SIGINT)
    with interruptible():
        assert signal.getsignal(signal.SIGINT) is not before
    assert signal.getsignal(signal.SIGINT) is before


def test_what_runs_in_the_background_of_a_shell_ends_when_asked__law() -> None:
    """A shell without a terminal keeps Ctrl-C from what it begins with `&`; SIGTERM did nothing."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with pytest.raises(KeyboardInterrupt):
            end_as_ctrl_c()
    finally:
        signal.signal(signal.SIGINT, before)
    with interruptible(), pytest.raises(KeyboardInterrupt):
        end_as_ctrl_c()
