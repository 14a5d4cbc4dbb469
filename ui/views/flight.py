"""Where the eye of the 3D scene is, and its flight into a perspective centre, local frame."""

from dataclasses import dataclass

import numpy as np

from core.arrays import ObjectPoints, Position
from ui.review.scene import FrustumPicture

ROOM = 1.06
"""Seen from its perspective centre, a photo has this much room in the window."""
WHOLE_ROOM = 1.2
"""The whole block has this much room in the window, so that nothing lies under its tools."""
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


def pose_around(places: ObjectPoints, from_eye: Position, fov: float, window: float) -> Pose:
    """The nearest eye that sees all places, from a given side.

    Args:
        places: What is to be in the window.
        from_eye: Direction of the eye as seen from there; not straight up.
        fov: Opening over the height of the window, radians.
        window: Width of the window over its height.
    """
    up = np.array([0.0, 0.0, 1.0])
    back = from_eye / np.linalg.norm(from_eye)
    right = np.cross(up, back) / np.linalg.norm(np.cross(up, back))
    middle = places.mean(axis=0)
    seen = (places - middle) @ np.column_stack((right, np.cross(back, right), back))
    # A place is in the window where it lies beside the axis by less than the opening at its depth;
    # the places furthest out on both sides say where the axis lies, and how far off the eye.
    half = np.tan(fov / 2) / WHOLE_ROOM * np.array([window, 1.0])
    above, below = (seen[:, 2:] * half + side * seen[:, :2] for side in (1, -1))
    above, below = above.max(axis=0), below.max(axis=0)
    axis = middle + (above - below) / 2 @ np.array([right, np.cross(back, right)])
    away = float(((above + below) / 2 / half).max())
    return Pose(axis + away * back, axis, up, fov)


def flight_between(here: Pose, there: Pose) -> list[Pose]:
    """Places of the eye on its way, the last one at its end."""
    return [here.on_the_way(there, float(share)) for share in np.linspace(0, 1, STEPS + 1)[1:]]
