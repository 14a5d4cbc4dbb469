"""What a ray in the 3D scene hits: a surveyed point or a photo, in double precision."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from core.arrays import Position
from core.block import Block
from core.frames import object_from_local

POINT_ANGLE = np.radians(0.9)
"""How far beside a point a click still means it, seen from the eye."""


@dataclass(frozen=True, slots=True)
class Picked:
    """What was hit."""

    kind: Literal["point", "photo"]
    """Surveyed point or photo."""
    name: str
    """Its name."""


def pick(
    origin: tuple[float, float, float],
    direction: tuple[float, float, float],
    block: Block,
    hidden: Collection[str],
) -> Picked | None:
    """The point or photo under a ray given in the local frame.

    The picture of a frustum hides what lies behind it; through its open sides points are seen, so
    that these count only where no point is meant.
    """
    eye = object_from_local(np.array([origin], dtype=np.float64), block.origin)[0]
    towards = np.array(direction, dtype=np.float64)
    towards = towards / np.linalg.norm(towards)
    point, beyond = (None, np.inf) if "points" in hidden else _nearest_point(eye, towards, block)
    photos = [] if "photos" in hidden else list(block.photos)
    picture, before = _nearest_photo(eye, towards, block, photos, sides=False)
    if picture is not None and before < beyond:
        return Picked("photo", picture)
    if point is not None:
        return Picked("point", point)
    photo, _ = _nearest_photo(eye, towards, block, photos, sides=True)
    return None if photo is None else Picked("photo", photo)


def frustum_corners(block: Block, photo_id: str, depth_m: float) -> np.ndarray:
    """Four corners of a photo's frustum at a depth before its perspective centre, object frame."""
    photo, camera = block.photos[photo_id], block.camera_of(photo_id)
    half = np.array(camera.frame_mm) / 2 / camera.principal_distance_mm * depth_m
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    image = np.column_stack([corners, np.full(4, -depth_m)])
    return image @ photo.exterior.object_from_image.T + photo.exterior.centre


def frustum_depth_m(block: Block) -> float:
    """Depth of the frustums on screen: a part of the flying height, the same for all."""
    heights = [
        float(photo.exterior.centre[2]) - photo.ground_height_m for photo in block.photos.values()
    ]
    return 0.17 * float(np.median(heights)) if heights else 100.0


def _nearest_point(eye: Position, towards: Position, block: Block) -> tuple[str | None, float]:
    """The point nearest to the ray as the eye sees it, and how far away it is, metres."""
    names = list(block.surveyed)
    if not names:
        return None, float("inf")
    offset = np.array([block.surveyed[name].position for name in names]) - eye
    along = offset @ towards
    beside = np.linalg.norm(offset - along[:, None] * towards, axis=1)
    angle = np.where(along > 0, np.arctan2(beside, along), np.inf)
    best = int(np.argmin(angle))
    return (names[best], float(along[best])) if angle[best] < POINT_ANGLE else (None, float("inf"))


def _nearest_photo(
    eye: Position, towards: Position, block: Block, photo_ids: Iterable[str], sides: bool
) -> tuple[str | None, float]:
    """The nearest photo whose picture, or also whose sides, a ray passes; and how far away."""
    depth = frustum_depth_m(block)
    best, nearest = None, float("inf")
    for name in photo_ids:
        corners = frustum_corners(block, name, depth)
        centre = block.photos[name].exterior.centre
        faces = [(corners[0], corners[1], corners[2]), (corners[0], corners[2], corners[3])]
        if sides:
            faces += [(centre, corners[i], corners[(i + 1) % 4]) for i in range(4)]
        for face in faces:
            distance = _ray_triangle(eye, towards, *face)
            if distance < nearest:
                best, nearest = name, distance
    return best, nearest


def _ray_triangle(
    eye: Position, towards: Position, first: Position, second: Position, third: Position
) -> float:
    """Distance to a triangle along a ray (Moeller and Trumbore 1997); infinite when it misses."""
    edge, other = second - first, third - first
    normal = np.cross(towards, other)
    volume = float(edge @ normal)
    if abs(volume) < 1e-12:
        return float("inf")
    offset = eye - first
    u = float(offset @ normal) / volume
    around = np.cross(offset, edge)
    v = float(towards @ around) / volume
    distance = float(other @ around) / volume
    return distance if u >= 0 and v >= 0 and u + v <= 1 and distance > 0 else float("inf")
