"""Position of the eye in the 3D scene and its flight into a perspective centre, local frame."""

from dataclasses import dataclass

import numpy as np

from core.arrays import Position
from ui.review.scene import FrustumPicture

ROOM = 1.06
"""Seen from its perspective centre, a photo has this much room in the window."""
STEPS = 14
"""Places of the eye on its way."""
LEAST_DOWN = 0.1
"""A photo that looks less far down than this has no ground to turn about."""


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Where an eye is, and what it sees."""

    position: Position
    """Of the eye, local frame, metres."""
    look_at: Position
    """What it turns about, local frame, metres."""
    up: Position
    """What is up on the screen."""
    fov: float
    """Opening over the height of the window, radians."""

    def on_the_way(self, other: "Pose", share: float) -> "Pose":
        """A pose on the way to another one; gently off and gently there."""
        even = share * share * (3 - 2 * share)

        def between(one: Position, two: Position) -> Position:
            return one + even * (two - one)

        return Pose(
            between(self.position, other.position),
            between(self.look_at, other.look_at),
            between(self.up, other.up),
            self.fov + even * (other.fov - self.fov),
        )


def pose_inside(frustum: FrustumPicture, level_m: float, window: float) -> Pose:
    """The eye in a perspective centre, so that the whole photo is in a window.

    Args:
        frustum: The photo.
        level_m: Height of the ground, metres.
        window: Width of the window over its height.
    """
    towards = -frustum.object_from_image[:, 2]
    above = float(frustum.centre[2]) - level_m
    half = np.tan(frustum.vertical_fov / 2) * max(1.0, frustum.aspect / window)
    return Pose(
        frustum.centre,
        frustum.centre + towards * above / max(-float(towards[2]), LEAST_DOWN),
        frustum.object_from_image[:, 1],
        2 * float(np.arctan(ROOM * half)),
    )


def flight_between(here: Pose, there: Pose) -> list[Pose]:
    """Places of the eye on its way, the last one at its end."""
    return [here.on_the_way(there, float(share)) for share in np.linspace(0, 1, STEPS + 1)[1:]]
