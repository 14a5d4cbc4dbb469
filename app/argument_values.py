"""Values of arguments: read from what was typed, or refused in a sentence."""

import argparse
import re
from collections.abc import Callable

MOST_RELIEF_M = 2000.0
ADDRESS = re.compile(r"https?://([a-z0-9-]+(\.[a-z0-9-]+)*|\[[0-9a-f:.]+\])(:\d{1,5})?")
"""Scheme, name or number, and port."""


def proxy_address(text: str) -> str:
    """An address such as https://desk.example.org, without a path; empty for none."""
    address = text.strip().rstrip("/").lower()
    # The pages ask for what they need from the root of their name.
    if address and not ADDRESS.fullmatch(address):
        raise argparse.ArgumentTypeError(f"must be like https://desk.example.org, not {text}")
    return address


def whole_number(least: int, most: int | None = None) -> Callable[[str], int]:
    """Reads a whole number within limits."""

    def number(text: str) -> int:
        if not text.lstrip("-").isdecimal():
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number")
        if int(text) < least or (most is not None and int(text) > most):
            limits = f"{least} or more" if most is None else f"from {least} to {most}"
            raise argparse.ArgumentTypeError(f"must be {limits}, not {text}")
        return int(text)

    return number


def operator_name(text: str) -> str:
    """A name, without blanks about it."""
    if not text.strip():
        raise argparse.ArgumentTypeError("must be a name: decisions are recorded under it")
    return text.strip()


def grid_size(text: str) -> tuple[int, int]:
    """Columns and rows of a grid, such as 6x5."""
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.isdecimal() and 1 <= int(part) <= 99 for part in parts):
        raise argparse.ArgumentTypeError(f"must be like 6x5, at most 99x99, not {text}")
    return int(parts[0]), int(parts[1])


def metres(text: str) -> float:
    """Metres of relief, from flat to mountains."""
    try:
        value = float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from error
    if not 0 <= value <= MOST_RELIEF_M:
        raise argparse.ArgumentTypeError(f"must be from 0 to {MOST_RELIEF_M:.0f}, not {text}")
    return value
