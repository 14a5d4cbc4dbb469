"""Angles as other programs count them: three orders, three units.

Every order turns image space (x right, y up, z backwards) into object space.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from core.arrays import Rotation
from core.geometry.exterior import angles_from_rotation, rotation_from_angles

Triple = tuple[float, float, float]
AngleOrder = Literal["omega-phi-kappa", "phi-omega-kappa", "yaw-pitch-roll"]
"""Sequence of the three turns, and so of three angles in a row of a list."""
AngleUnit = Literal["deg", "gon", "rad"]
# source: definition of degree and gon.
RADIANS: Mapping[AngleUnit, float] = {"deg": np.pi / 180, "gon": np.pi / 200, "rad": 1.0}
"""Radians of one unit."""
# source: definition of degree and gon.
FULL_TURN: Mapping[AngleUnit, float] = {"deg": 360.0, "gon": 400.0, "rad": 2 * np.pi}
"""A whole turn in each unit."""
# source: definition of the two frames: north, east, down against east, north, up; a photo whose
# upper edge looks ahead has the body's axes forward, right, down in the same relation.
NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""East, north, up from north, east, down; it undoes itself."""


@dataclass(frozen=True, slots=True)
class AngleConvention:
    """How a list counts angles."""

    order: AngleOrder
    """Sequence of the turns."""
    unit: AngleUnit
    """Unit of all three."""

    @property
    def name(self) -> str:
        """Short name, as formats bear it: `opk-deg`."""
        return "".join(word[0] for word in self.order.split("-")) + f"-{self.unit}"


CONVENTIONS = tuple(
    AngleConvention(order, unit) for order in get_args(AngleOrder) for unit in get_args(AngleUnit)
)
"""Every way a list may count."""


def triple_of(values: Iterable[float]) -> Triple:
    """Three plain floats."""
    first, second, third = (float(value) for value in values)
    return first, second, third


def is_rotation(matrix: Rotation) -> bool:
    """Whether a matrix of a file is a rotation, as far as its digits tell."""
    # design: digits that a file keeps; a matrix farther off is no rotation.
    orthogonal = np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-6)
    return orthogonal and float(np.linalg.det(matrix)) > 0


def rotation_of(order: AngleOrder, angles: Triple) -> Rotation:
    """Object space from image space.

    Args:
        order: Sequence of the turns.
        angles: In that sequence, radians. Yaw is clockwise from grid north, pitch lifts the upper
            edge of the photo, roll lowers its right edge; all nought looks straight down.
    """
    first, second, third = angles
    if order == "omega-phi-kappa":
        return rotation_from_angles(first, second, third)
    if order == "phi-omega-kappa":
        phi = rotation_from_angles(0.0, first, 0.0)
        return phi @ rotation_from_angles(second, 0.0, third)
    yaw = rotation_from_angles(0.0, 0.0, first)
    pitch = rotation_from_angles(0.0, second, 0.0)
    return NED @ yaw @ pitch @ rotation_from_angles(third, 0.0, 0.0) @ NED


def angles_of(order: AngleOrder, rotation: Rotation) -> Triple:
    """The three angles of a rotation, radians, in the sequence of the order."""
    if order == "omega-phi-kappa":
        return angles_from_rotation(rotation)
    if order == "phi-omega-kappa":
        return (
            float(np.arctan2(rotation[0, 2], rotation[2, 2])),
            float(np.arcsin(np.clip(-rotation[1, 2], -1.0, 1.0))),
            float(np.arctan2(rotation[1, 0], rotation[1, 1])),
        )
    body = NED @ rotation @ NED
    return (
        float(np.arctan2(body[1, 0], body[0, 0])),
        float(np.arcsin(np.clip(-body[2, 0], -1.0, 1.0))),
        float(np.arctan2(body[2, 1], body[2, 2])),
    )
