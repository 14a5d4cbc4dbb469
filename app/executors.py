"""Where a stage's independent pieces run: threads of this process, which share its open files."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

A = TypeVar("A")
B = TypeVar("B")


class Threads:
    """A pool of threads; numpy, OpenCV and GDAL leave the interpreter while they compute."""

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self.pool = ThreadPoolExecutor(workers, thread_name_prefix="gruber")

    def map(self, function: Callable[[A], B], items: Iterable[A]) -> Iterator[B]:
        """Results in the order of the items; the first error cancels what has not begun."""
        futures: list[Future[B]] = [self.pool.submit(function, item) for item in items]
        try:
            for future in futures:
                yield future.result()
        finally:
            for future in futures:
                future.cancel()

    def close(self, wait: bool = True) -> None:
        """Let go of the threads, having waited for what they do unless told not to."""
        self.pool.shutdown(wait=wait, cancel_futures=True)
