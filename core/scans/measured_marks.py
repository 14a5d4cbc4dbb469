"""The fiducials of a scan as they were found, and how the film lies by them."""

from dataclasses import dataclass

import numpy as np

from core.doubts import Doubt
from core.scans.layouts import UPRIGHT, Way
from core.scans.measuring import FittedMark


@dataclass(frozen=True, slots=True)
class FiducialMeasurement:
    """One fiducial in one scan."""

    name: str
    """Its name in the camera's certificate."""
    column: float
    """Pixels, outer corner of the first pixel (0, 0)."""
    row: float
    """Pixels."""
    sigma_px: float
    """Standard deviation per axis, pixels."""
    correlation: float
    """Likeness to the drawn mark, 0 to 1."""
    disagreement_px: float
    """Distance between its middles found in two ways, pixels."""
    kind: str
    """Shape of the mark."""

    @property
    def place(self) -> tuple[float, float]:
        """Column and row."""
        return self.column, self.row


@dataclass(frozen=True, slots=True)
class FiducialSet:
    """All marks of a scan, and how the film lies by them."""

    marks: tuple[FiducialMeasurement, ...]
    """Those that stand, in the order of the certificate."""
    doubts: tuple[Doubt, ...]
    """One for each that does not."""
    way: Way = UPRIGHT
    """How the film lies in the scan."""
    rivals: tuple[Way, ...] = ()
    """Ways that the certificate cannot tell from it."""
    fitted: tuple[FittedMark, ...] = ()
    """The marks as they look in this scan, a kind for each group."""
    guessed: bool = False
    """True where the certificate hardly tells which mark is which, and nothing else does."""

    @property
    def middle(self) -> tuple[float, float]:
        """Middle of the box about the marks, column and row."""
        places = np.array([(mark.column, mark.row) for mark in self.marks])
        column, row = ((places.min(axis=0) + places.max(axis=0)) / 2).tolist()
        return column, row
