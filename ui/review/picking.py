"""What a ray in the 3D scene hits: a surveyed point or a photo, in double precision."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

import numpy as np

from core.arrays import Position
from core.block.block import Block
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
    """The point or photo under a ray given in the local frame; points go before photos."""
    eye = object_from_local(np.array([origin], dtype=np.float64), block.origin)[0]
    towards = np.array(direction, dtype=np.float64)
    towards = towards / np.linalg.norm(towards)
    if "points" not in hidden:
        name = _nearest_point(eye, towards, block)
        if name is not None:
            return Picked("point", name)
    name = None if "photos" in hidden else _nearest_photo(eye, towards, block)
    return Picked("photo", name) if name is not None else None


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


def _nearest_point(eye: Position, towards: Position, block: Block) -> str | None:
    names = list(block.surveyed)
    if not names:
        return None
    offset = np.array([block.surveyed[name].position for name in names]) - eye
    along = offset @ towards
    beside = np.linalg.norm(offset - along[:, None] * towards, axis=1)
    angle = np.where(along > 0, np.arctan2(beside, along), np.inf)
    best = int(np.argmin(angle))
    return names[best] if angle[best] < POINT_ANGLE else None


def _nearest_photo(eye: Position, towards: Position, block: Block) -> str | None:
    """The nearest photo whose frustum's film side the ray passes through."""
    depth = frustum_depth_m(block)
    best, nearest = None, np.inf
    for name, photo in block.photos.items():
        corners = frustum_corners(block, name, depth)
        faces = [(corners[0], corners[1], corners[2]), (corners[0], corners[2], corners[3])]
        centre = photo.exterior.centre
        faces += [(centre, corners[i], corners[(i + 1) % 4]) for i in range(4)]
        for face in faces:
            distance = _ray_triangle(eye, towards, *face)
            if distance < nearest:
                best, nearest = name, distance
    return best


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
