"""What references are off as a whole: what one says = where a point lies + shift + slope.

Points of another year's mosaic are off over large parts, neighbours alike: by what the mosaic is
off, and by what all of them share in these photos. Their shift, and how that grows from the middle
to the edges, are unknowns known to what the reference is said to be worth. They come from the
control of the reference that defines the datum; the other one gives the shape between its points.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int

from core.arrays import ObjectPoints
from core.block import ShiftedReference

AXES = "ENH"
TERMS = ("shift_{axis}_m", "slope_{axis}_east_m", "slope_{axis}_north_m")
"""Shift of an axis in the middle; by how much more at the eastern and the northern edge."""
# source: mean over a square of 1 + x^2 + y^2, x and y from -1 to 1.
MEAN_SQUARE = 5 / 3
"""So much larger than that of one of them is the variance of all three over the whole area."""
# design: keeps a division from failing.
SMALLEST_EXTENT_M = 1.0
"""A reference's points are taken to spread over no less than twice this, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceShifts:
    """The unknowns that the known coordinates of many points share."""

    owners: tuple[str, ...]
    """Reference of each unknown."""
    names: tuple[str, ...]
    """What each is called, with its unit."""
    rows: Int[np.ndarray, "shifted"]
    """Points that have any."""
    design: Float64[np.ndarray, "shifted 3 shifts"]
    """What each unknown adds to their known coordinates, metres per metre."""
    weights: Float64[np.ndarray, "shifts"]
    """Roots of the weights of their priors about nought, 1 / metres."""

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return len(self.names)

    def added(self, points: ObjectPoints, shifts: Float64[np.ndarray, "shifts"]) -> ObjectPoints:
        """Points as their references have them, metres."""
        if not self.count:
            return points
        moved = points.copy()
        moved[self.rows] += self.design @ shifts
        return moved


def shifts_of(
    references: Sequence[ShiftedReference | None], known: ObjectPoints, first: int
) -> ReferenceShifts:
    """Which unknowns some points share.

    Args:
        references: The reference of each point that lies off as a whole; None for none.
        known: Their coordinates, metres.
        first: Number of the first of them among all points.
    """
    rows = np.array([k for k, one in enumerate(references) if one is not None], dtype=np.int64)
    own = [one for one in references if one is not None]
    owners, names, sigmas = list[str](), list[str](), list[float]()
    columns: list[Float64[np.ndarray, "shifted 3"]] = []
    for one in sorted(set(own), key=lambda one: one.name):
        members = np.array([other == one for other in own])
        terms = members[:, None] * _terms(known[rows, :2], members)
        for axis in np.flatnonzero(one.sigma_m).tolist():
            columns += [np.outer(term, np.eye(3)[axis]) for term in terms.T]
            names += [name.format(axis=AXES[axis]) for name in TERMS]
            owners += [one.name] * len(TERMS)
            # Together they are what the reference is said to be worth.
            sigmas += [one.sigma_m[axis] / np.sqrt(MEAN_SQUARE)] * len(TERMS)
    design = np.stack(columns, axis=2) if columns else np.zeros((len(rows), 3, 0))
    return ReferenceShifts(tuple(owners), tuple(names), first + rows, design, 1 / np.array(sigmas))


def _terms(
    plan: Float64[np.ndarray, "shifted 2"], members: np.ndarray
) -> Float64[np.ndarray, "shifted 3"]:
    """One, and the place between the edges (-1 to 1 for the members) to the east and the north."""
    low, high = plan[members].min(axis=0), plan[members].max(axis=0)
    half = np.maximum((high - low) / 2, SMALLEST_EXTENT_M)
    return np.column_stack([np.ones(len(plan)), (plan - (low + high) / 2) / half])
