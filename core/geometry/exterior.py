"""Exterior orientation: where a photo's perspective centre was and how it was turned.

A similarity in space carries orientations and points along: absolute orientation.
"""

from dataclasses import dataclass

import numpy as np

from core.arrays import ObjectPoints, Position, Rotation, Scalars, locked

# source: three shifts, three turns, one scale.
UNKNOWNS = 7


@dataclass(frozen=True, slots=True, eq=False)
class ExteriorOrientation:
    """One photo's place in object space, in the block's CRS."""

    centre: Position
    """Perspective centre (easting, northing, height), metres."""
    omega: float
    """First rotation, about the x axis, radians."""
    phi: float
    """Second rotation, about the y axis, radians."""
    kappa: float
    """Third rotation, about the z axis, radians, counter-clockwise from grid east."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", locked(self.centre))

    @property
    def angles(self) -> Position:
        """omega, phi, kappa, radians."""
        return np.array([self.omega, self.phi, self.kappa])

    @property
    def object_from_image(self) -> Rotation:
        """R = R_omega R_phi R_kappa: turns image space into object space."""
        return rotation_from_angles(self.omega, self.phi, self.kappa)


def rotation_from_angles(omega: float, phi: float, kappa: float) -> Rotation:
    """R_x(omega) R_y(phi) R_z(kappa), METHODS 7.1: the rotation from image to object space."""
    so, co = np.sin(omega), np.cos(omega)
    sp, cp = np.sin(phi), np.cos(phi)
    sk, ck = np.sin(kappa), np.cos(kappa)
    return np.array(
        [
            [cp * ck, -cp * sk, sp],
            [co * sk + so * sp * ck, co * ck - so * sp * sk, -so * cp],
            [so * sk - co * sp * ck, so * ck + co * sp * sk, co * cp],
        ]
    )


def angles_from_rotation(rotation: Rotation) -> tuple[float, float, float]:
    """omega, phi, kappa in radians of R = R_omega R_phi R_kappa; phi within +-90 degrees."""
    phi = float(np.arcsin(np.clip(rotation[0, 2], -1.0, 1.0)))
    omega = float(np.arctan2(-rotation[1, 2], rotation[2, 2]))
    kappa = float(np.arctan2(-rotation[0, 1], rotation[0, 0]))
    return omega, phi, kappa


def turn_between(one: Rotation, other: Rotation) -> Position:
    """Axis times angle (radians) from one rotation to another, about the axes of image space."""
    relative = one.T @ other
    # The sine of small turns keeps the digits that the cosine of their trace loses.
    axis = np.array([relative[2, 1] - relative[1, 2], relative[0, 2] - relative[2, 0],
                     relative[1, 0] - relative[0, 1]])  # fmt: skip
    sine = float(np.linalg.norm(axis))
    angle = float(np.arctan2(sine, np.trace(relative) - 1))
    return axis * (angle / sine if sine > 0 else 1.0)


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
