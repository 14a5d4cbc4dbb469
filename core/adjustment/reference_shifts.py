"""What references are off as a whole: their known coordinates = the points' own + the shift.

The mosaic of another year is shifted over large parts, all its points alike. As an unknown of its
own, known to what the reference is said to be worth, the shift comes from the control of the
reference that defines the datum; the other gives the shape between its points.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int

from core.block import ShiftedReference

AXES = "ENH"


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceShifts:
    """The unknowns that the known coordinates of many points share."""

    owners: tuple[str, ...]
    """Reference of each unknown."""
    names: tuple[str, ...]
    """What each is called, with its unit."""
    of_point: Int[np.ndarray, "points 3"]
    """Unknown of each coordinate of each point, -1 for none."""
    weights: Float64[np.ndarray, "shifts"]
    """Roots of the weights of their priors about nought, 1 / metres."""

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return len(self.names)

    def on_points(self, shifts: Float64[np.ndarray, "shifts"]) -> Float64[np.ndarray, "points 3"]:
        """What the known coordinates of every point are off, metres."""
        # The last one stands for none.
        return np.append(shifts, 0.0)[self.of_point]


def shifts_of(points: Sequence[ShiftedReference | None]) -> ReferenceShifts:
    """Which unknowns some points share.

    Args:
        points: The reference of each point that lies off as a whole; None for none.
    """
    references = sorted({one for one in points if one is not None}, key=lambda one: one.name)
    unknowns = [
        (one, axis) for one in references for axis, sigma in enumerate(one.sigma_m) if sigma > 0
    ]
    rows = {one: np.full(3, -1) for one in references}
    for number, (one, axis) in enumerate(unknowns):
        rows[one][axis] = number
    none = np.full(3, -1)
    return ReferenceShifts(
        tuple(one.name for one, _ in unknowns),
        tuple(f"shift_{AXES[axis]}_m" for _, axis in unknowns),
        np.array([none if one is None else rows[one] for one in points]).reshape(-1, 3),
        np.array([1 / one.sigma_m[axis] for one, axis in unknowns]),
    )
