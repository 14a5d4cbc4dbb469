"""Arrays laid by in a file: all of them together would be too much for memory."""

import math
import tempfile
from dataclasses import dataclass
from threading import Lock
from typing import Any
from weakref import finalize

import numpy as np

from core.errors import PhotogrammetryError
from core.said import say


class KeptArrays:
    """A temporary file with arrays of any kind; threads may share it.

    It has no name, and is gone when nobody knows it any more or the program ends.
    """

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile(prefix="gruber-")  # noqa: SIM115
        self.close = finalize(self, self._file.close)
        self._lock = Lock()
        self._end = 0

    def keep(self, array: np.ndarray, instead: "KeptArray | None" = None) -> "KeptArray":
        """Lay an array by.

        Args:
            array: Of any shape and type.
            instead: An earlier one that gives way if it is as large.

        Raises:
            PhotogrammetryError: The file cannot be written.
        """
        with self._lock:
            as_large = instead is not None and instead.bytes == array.nbytes
            start = instead.start if instead is not None and as_large else self._end
            self._end = max(self._end, start + array.nbytes)
            try:
                self._file.seek(start)
                self._file.write(array.tobytes())
                self._file.flush()
            except OSError as error:
                raise PhotogrammetryError(
                    tempfile.gettempdir(),
                    say(
                        "intermediate results cannot be laid by ({strerror}).",
                        strerror=error.strerror,
                    ),
                    "Free some space there, or set TMPDIR to a folder that has it.",
                ) from error
        return KeptArray(self, start, array.shape, array.dtype)

    def read(self, start: int, size: int) -> bytes:
        """Bytes of an array."""
        with self._lock:
            self._file.seek(start)
            return self._file.read(size)


@dataclass(frozen=True, slots=True, eq=False)
class KeptArray:
    """One array that was laid by."""

    store: KeptArrays
    """Where it lies."""
    start: int
    """Its first byte."""
    shape: tuple[int, ...]
    """Its shape."""
    dtype: np.dtype[Any]
    """Type of its values."""

    @property
    def bytes(self) -> int:
        """How much room it takes."""
        return math.prod(self.shape) * self.dtype.itemsize

    def read(self) -> np.ndarray:
        """The array, read-only."""
        content = self.store.read(self.start, self.bytes)
        return np.frombuffer(content, self.dtype).reshape(self.shape)
