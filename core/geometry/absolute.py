"""Absolute orientation: a whole block shifted, turned and scaled in object space."""

from dataclasses import dataclass

import numpy as np

from core.arrays import ObjectPoints, Position, Rotation, Scalars
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation, rotation_from_angles

# source: three shifts, three turns, one scale.
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


@dataclass(frozen=True, slots=True, eq=False)
class Similarity:
    """target = scale x rotation x source + shift: one body laid onto another."""

    scale: float
    """Change of scale, above nought."""
    rotation: Rotation
    """Turns the source into the target."""
    shift: Position
    """Of the turned and scaled source, metres of the target."""

    def moved(self, points: ObjectPoints) -> ObjectPoints:
        """Points carried along."""
        return self.scale * points @ self.rotation.T + self.shift


def fit_similarity(source: ObjectPoints, target: ObjectPoints, weights: Scalars) -> Similarity:
    """The similarity in space that lays points onto their targets by least squares.

    Closed form by singular values (Umeyama 1991, IEEE PAMI 13(4)).

    Args:
        source: Three points or more, not on a line.
        target: The same points in the other body.
        weights: One for each pair.
    """
    share = weights / weights.sum()
    middle, aim = share @ source, share @ target
    inner, outer = source - middle, target - aim
    left, values, right = np.linalg.svd((outer * share[:, None]).T @ inner)
    flip = np.array([1.0, 1.0, np.sign(np.linalg.det(left) * np.linalg.det(right))])
    rotation = (left * flip) @ right
    scale = float(np.sum(values * flip) / np.sum(share @ inner**2))
    return Similarity(scale, rotation, aim - scale * rotation @ middle)
