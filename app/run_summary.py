"""What is told after a run: scans set aside, and the gravest doubts, in a few lines."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice

from core.doubts import Doubt

LINES = 8
"""No more than this; the report has them all."""
GRAVE = 0.5
"""Doubts of at least this gravity are told."""
SET_ASIDE = "scan-set-aside"
"""The doubts that repeat why a scan was set aside."""


def remarks(set_aside: Mapping[str, str], doubts: Sequence[Doubt], where: str) -> list[str]:
    """One line for each scan set aside, and for each kind of grave doubt.

    Args:
        set_aside: Reason by photo.
        doubts: Gravest first.
        where: The file that has all of it, for what there is no room for.
    """
    lines = [f"Set aside: {reason}" for reason in set_aside.values()]
    lines += list(_of_kinds([doubt for doubt in doubts if doubt.gravity >= GRAVE]))
    hidden = len(lines) - LINES
    return lines if hidden <= 0 else [*islice(lines, LINES), f"... {hidden} more in {where}"]


def _of_kinds(doubts: Sequence[Doubt]) -> Iterator[str]:
    """The first doubt of each kind, and how many others are like it."""
    kinds: dict[str, list[Doubt]] = {}
    for doubt in doubts:
        if doubt.kind != SET_ASIDE:
            kinds.setdefault(doubt.kind, []).append(doubt)
    for first, *others in kinds.values():
        named = "" if first.subject in first.message else f"{first.subject}: "
        like = f" ({len(others)} more like this)" if others else ""
        yield f"Doubt: {named}{first.message}{like}"
