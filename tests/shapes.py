"""Shapes of arrays are checked in the first calls of each function that a test makes.

To be imported before anything that is to be checked.
"""

import functools
from collections.abc import Callable
from typing import Any

import jaxtyping

CALLS = 20
"""Checked calls of a function in one test; at every call checks double the time of long tests."""
_JAXTYPED = jaxtyping.jaxtyped
_tests = 0


def begin(checked: bool) -> None:
    """Before a test, and before what it asks for is made."""
    global _tests
    _tests += 1
    jaxtyping.config.update("jaxtyping_disable", not checked)


def _at_first(**how: Any) -> Callable[[Any], Any]:
    """What jaxtyping lays around every function of a package that it is told to check."""

    def decorate(called: Any) -> Any:
        checked = _JAXTYPED(**how)(called)
        if isinstance(called, type):
            return checked
        test, left = 0, 0

        @functools.wraps(called)
        def counted(*args: Any, **named: Any) -> Any:
            nonlocal test, left
            if test != _tests:
                test, left = _tests, CALLS
            if not left or jaxtyping.config.jaxtyping_disable:
                return called(*args, **named)
            left -= 1
            return checked(*args, **named)

        return counted

    return decorate


jaxtyping.jaxtyped = _at_first
