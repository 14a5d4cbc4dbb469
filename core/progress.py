"""Progress and cancellation of long work, and how it is split among workers."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from hashlib import sha256
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np

T = TypeVar("T")
Mapper = Callable[..., Iterable[Any]]
"""Runs a function over items, such as `map` or the `map` of a pool of threads."""


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


SILENT = Silent()


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


@dataclass(frozen=True, slots=True)
class Work:
    """How a stage is to run: what it tells, what runs its pieces, and where its chance is from."""

    progress: Progress = field(default_factory=Silent)
    """Told how far it is; asks it to stop."""
    mapper: Mapper = map
    """Runs independent pieces side by side."""
    seed: str = ""
    """Name of the block: the same block gives the same result."""

    def part(self, begin: float, end: float) -> "Work":
        """The work of one part of a stage, from `begin` to `end`, shares of the whole."""
        return replace(self, progress=Part(self.progress, begin, end))

    def random(self, *names: str) -> np.random.Generator:
        """A generator that depends on names alone, whichever thread asks first."""
        digest = sha256("/".join((self.seed, *names)).encode()).digest()
        return np.random.default_rng(int.from_bytes(digest[:8], "big"))
