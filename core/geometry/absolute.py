"""Absolute orientation: a whole block shifted, turned and scaled in object space."""

from dataclasses import dataclass

import numpy as np

from core.arrays import Position, Rotation, Scalars
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation, rotation_from_angles

UNKNOWNS = 7


@dataclass(frozen=True, slots=True, eq=False)
class SimilarityInSpace:
    """A small shift, turn and change of scale about a point of object space."""

    about: Position
    """The point that is only shifted, metres."""
    step: Scalars
    """Shift E, N, H (m), turns about the three axes (rad), change of scale (1 = 100 %)."""

    @property
    def rotation(self) -> Rotation:
        """The turn as a matrix."""
        return rotation_from_angles(float(self.step[3]), float(self.step[4]), float(self.step[5]))

    def moved(self, exterior: ExteriorOrientation) -> ExteriorOrientation:
        """An exterior orientation carried along."""
        scale = 1.0 + float(self.step[6])
        centre = self.about + self.step[:3] + scale * self.rotation @ (exterior.centre - self.about)
        turned = self.rotation @ exterior.object_from_image
        return ExteriorOrientation(np.asarray(centre), *angles_from_rotation(turned))
