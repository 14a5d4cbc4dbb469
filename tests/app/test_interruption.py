"""Ctrl-C stops the work even where Python forgets it."""

import os
import signal

import pytest

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
