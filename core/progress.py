"""How long work reports how far it is and learns that it shall stop."""

from collections.abc import Iterable, Iterator
from typing import Protocol, TypeVar, runtime_checkable

T = TypeVar("T")


@runtime_checkable
class Progress(Protocol):
    """What a stage is handed: it reports its share done, and is told by `Cancelled` to stop."""

    def report(self, done: int | float, total: int | float, what: str = "") -> None:
        """Say that `done` of `total` is finished; raises `Cancelled` when asked to stop."""
        ...


class Silent:
    """Progress that nobody watches."""

    def report(self, done: int | float, total: int | float, what: str = "") -> None:
        """Accept the report and do nothing."""


class Part:
    """Progress of one part of a longer work, passed on as that part's share of the whole."""

    def __init__(self, whole: Progress, begin: float, end: float) -> None:
        """A part from `begin` to `end`, shares of the whole between 0 and 1."""
        self._whole, self._begin, self._end = whole, begin, end

    def report(self, done: float, total: float, what: str = "") -> None:
        """Pass the report on."""
        share = done / total if total else 1.0
        self._whole.report(self._begin + (self._end - self._begin) * share, 1.0, what)


def tracked(items: Iterable[T], total: int, progress: Progress, what: str = "") -> Iterator[T]:
    """Yield the items, reporting before each one and once at the end."""
    for done, item in enumerate(items):
        progress.report(float(done), float(total), what)
        yield item
    progress.report(float(total), float(total), what)
