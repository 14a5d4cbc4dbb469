"""Surfaces of likeness laid by in a file until all photos of a point are searched.

Of many photos they are too much for memory. A temporary file holds them in half precision, which is
a hundredth of their spread, and is gone when the work is done or the program ends.
"""

import math
import tempfile
from threading import Lock
from types import TracebackType

import numpy as np

from core.errors import PhotogrammetryError
from core.matching.peaks import ScoreMap


class KeptSurfaces:
    """The latest surface of every point in every photo; threads may share it."""

    def __init__(self) -> None:
        self.file = tempfile.TemporaryFile(prefix="gruber-surfaces-")  # noqa: SIM115
        self.lock = Lock()
        self.slots: dict[tuple[str, str], tuple[int, tuple[int, ...]]] = {}
        self.end = 0

    def __enter__(self) -> "KeptSurfaces":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.file.close()

    def keep(self, point_id: str, photo_id: str, surface: ScoreMap) -> None:
        """Lay a surface by; an earlier one of the same point and photo gives way.

        Raises:
            PhotogrammetryError: The file cannot be written.
        """
        content = surface.astype(np.float16).tobytes()
        with self.lock:
            start, shape = self.slots.get((point_id, photo_id), (self.end, ()))
            if shape != surface.shape:
                start, self.end = self.end, self.end + len(content)
            self.slots[point_id, photo_id] = start, surface.shape
            try:
                self.file.seek(start)
                self.file.write(content)
            except OSError as error:
                raise PhotogrammetryError(
                    tempfile.gettempdir(),
                    f"surfaces of likeness cannot be laid by ({error.strerror}).",
                    "Free some space there, or set TMPDIR to a folder that has it.",
                ) from error

    def surface(self, point_id: str, photo_id: str) -> ScoreMap:
        """A surface that was laid by."""
        start, shape = self.slots[point_id, photo_id]
        with self.lock:
            self.file.seek(start)
            content = self.file.read(2 * math.prod(shape))
        return np.frombuffer(content, np.float16).reshape(shape).astype(np.float32)
