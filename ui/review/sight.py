"""What a ray in the 3D scene hits: point, photo or ground; and which photos see a place."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, cast

import numpy as np
from jaxtyping import Float64

from core.arrays import ObjectPoints, Position
from core.block import Block, Photo
from core.frames import object_from_local
from core.geometry.camera import Camera
from core.quality.residuals import photo_fit
from ui.review.compare import HeightSource
from ui.review.looks import short
from ui.review.queue import passes
from ui.review.scene import (
    FRUSTUM_SHARE,
    WORST,
    exaggerate_heights,
    frustum_depth_m,
    ground_level_m,
)
from ui.review.second_reading import is_blind
from ui.review.snapshot import DeskSnapshot
from ui.review.state import Area, Key, SceneOptions, Seat

POINT_ANGLE = np.radians(0.9)
"""How far beside a point or a perspective centre a click still means it, seen from the eye."""
RELIEF_SHARE = 0.5
"""The ground is looked for so many flying heights above and below its mean."""
STEPS = 600
"""Places along a ray at which the ground is looked for: between them it is taken as straight."""
SIGHT_STEPS = 80
"""Places between ground and photo at which a hill may stand."""
CLEARANCE = 0.01
"""A hill hides a place where it rises above the ray by this share of the flying height."""
PICTURE = np.array([[1, 2, 3], [1, 3, 4]])
"""Triangles of a frustum's picture: numbers of its corners, 0 being the perspective centre."""
SIDES = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]])
"""Triangles of its open sides."""
Place = tuple[float, float, float]
Ray = tuple[Place, Place]
"""Origin and direction, local frame."""
MOST_RAYS = 100
"""An outline has at most so many."""
Triangles = Float64[np.ndarray, "n 3 3"]


@dataclass(frozen=True, slots=True)
class Picked:
    """What was hit."""

    kind: Literal["point", "photo"]
    """Surveyed point or photo."""
    name: str
    """Its name."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """A photo that sees a place."""

    photo_id: str
    """The photo."""
    nadir_deg: float
    """Angle of the ray from the vertical, degrees."""
    pixel_m: float
    """Size of its pixel on the ground, metres."""


@dataclass(frozen=True, slots=True)
class Outlined:
    """An outline drawn over the 3D scene: what lies in it on the ground is to be in the queue."""

    seat_id: str
    rays: tuple[Ray, ...]
    """Through places along it, in their order."""


def outlined_from_message(seat_id: str, message: Mapping[str, Any]) -> Outlined:
    """The outline of a message."""
    rays = tuple(ray_of(ray) for ray in cast("list[Any]", message["rays"]))
    if not 3 <= len(rays) <= MOST_RAYS:
        raise ValueError("not an outline")
    return Outlined(seat_id, rays)


def ray_of(numbers: Iterable[Any]) -> Ray:
    """A ray of a message: where it begins, and its direction.

    Raises:
        ValueError: It begins nowhere or has no direction.
    """
    east, north, height, *towards = (float(value) for value in numbers)
    right, forward, up = towards
    if not all(abs(value) < 1e9 for value in (east, north, height)):
        raise ValueError("not a place")
    if not 0.5 < right**2 + forward**2 + up**2 < 2:
        raise ValueError("not a direction")
    return (east, north, height), (right, forward, up)


def area_under(rays: Iterable[Ray], block: Block, dem: HeightSource, scene: SceneOptions) -> Area:
    """Where the rays of an outline meet the ground; nothing where one of them does not."""
    found = [ground_under(*ray, block, dem, scene) for ray in rays]
    places = [(float(place[0]), float(place[1])) for place in found if place is not None]
    return tuple(places) if len(places) == len(found) else ()


def pick(origin: Place, direction: Place, block: Block, scene: SceneOptions) -> Picked | None:
    """The point or photo under a ray given in the local frame, as the scene is drawn.

    A perspective centre and the picture of a frustum hide what lies behind them; through its open
    sides points are seen, so that these count only where no point is meant. From inside a photo no
    frustum is seen.
    """
    eye, towards = _ray(origin, direction, block)
    hidden = scene.hidden | {"photos"} if scene.inside else scene.hidden
    point, beyond = None, np.inf
    if "points" not in hidden:
        places = np.array([one.position for one in block.surveyed.values()]).reshape(-1, 3)
        drawn = exaggerate_heights(places, ground_level_m(block), scene.seen_relief)
        point, beyond = _nearest(list(block.surveyed), drawn, eye, towards)
    photos = [] if "photos" in hidden else list(block.photos)
    pyramids = _pyramids(block, photos)
    for picture, before in (
        _nearest(photos, pyramids[:, 0], eye, towards),
        _nearest_face(photos, pyramids[:, PICTURE], eye, towards),
    ):
        if picture is not None and before < beyond:
            return Picked("photo", picture)
    if point is not None:
        return Picked("point", point)
    photo, _ = _nearest_face(photos, pyramids[:, SIDES], eye, towards)
    return None if photo is None else Picked("photo", photo)


def ground_under(
    origin: Place, direction: Place, block: Block, dem: HeightSource, scene: SceneOptions
) -> Position | None:
    """Where a ray in the local frame, as the scene is drawn, first meets the ground; or None."""
    eye, towards = _ray(origin, direction, block)
    level = ground_level_m(block)
    # The ground as it is, and the ray lowered instead: the same places lie on it.
    eye[2] = level + (eye[2] - level) / scene.seen_relief
    towards[2] /= scene.seen_relief
    if towards[2] >= 0:
        return None
    reach = RELIEF_SHARE * frustum_depth_m(block) / FRUSTUM_SHARE
    between = (level + reach - eye[2], level - reach - eye[2])
    first, last = (max(height / towards[2], 0.0) for height in between)
    path = eye + np.linspace(first, last, STEPS)[:, None] * towards
    above = path[:, 2] - dem.heights(path[:, :2])
    below = np.flatnonzero(above <= 0)
    if not len(below):
        return None
    end = max(int(below[0]), 1)
    share = above[end - 1] / (above[end - 1] - above[end])
    place = path[end - 1] + (share if np.isfinite(share) else 1.0) * (path[end] - path[end - 1])
    place[2] = dem.heights(place[None, :2])[0]
    return place


def photos_over(place: Position, block: Block, dem: HeightSource) -> tuple[Sighting, ...]:
    """Oriented photos that see a place on the ground, nearest to nadir first."""
    found = [
        Sighting(name, _nadir_deg(place, photo), photo.ground_pixel_m(block.camera_of(name)))
        for name, photo in block.photos.items()
        if photo.oriented and _sees(place, photo, block.camera_of(name), dem)
    ]
    return tuple(sorted(found, key=lambda one: one.nadir_deg))


def _nadir_deg(place: Position, photo: Photo) -> float:
    away = place - photo.exterior.centre
    return float(np.degrees(np.arctan2(np.hypot(away[0], away[1]), -away[2])))


def _sees(place: Position, photo: Photo, camera: Camera, dem: HeightSource) -> bool:
    """True when a place lies in the picture area and no hill stands between."""
    up = photo.exterior.centre - place
    if up[2] <= 0:
        return False
    film = photo.interior.film_from_pixel(photo.pixel_from_object(place[None], camera))[0]
    if not (np.abs(film) <= np.array(camera.frame_mm) / 2).all():
        return False
    path = place + np.linspace(0, 1, SIGHT_STEPS)[:, None] * up
    return not bool(np.any(dem.heights(path[:, :2]) - path[:, 2] > CLEARANCE * up[2]))


def card_part(found: Picked, seat: Seat, desk: DeskSnapshot) -> dict[str, Any]:
    """What a card says of a photo or a point to a seat."""
    if found.kind == "photo":
        fit = photo_fit(desk.state.report, found.name)
        return {"photo": found.name, "rms": short(fit.rms_px, 2), "control": fit.control,
                "ties": fit.ties}  # fmt: skip
    keys = desk.table.by_point.get(found.name, ())
    states = {desk.rows[key].state for key in keys}
    seen = [key for key in keys if not is_blind(desk.state, seat, key)]
    known = [misfit for key in seen if (misfit := desk.table.figures.misfits.get(key))]
    worst = max(known, key=lambda one: np.hypot(*one.metres), default=None)
    return {
        "point": found.name,
        "role": desk.state.block.surveyed[found.name].role,
        "state": next((state for state in WORST if state in states), None),
        "misfit_m": short(float(np.hypot(*worst.metres)), 2) if worst else None,
        "misfit_px": short(float(np.hypot(*worst.pixels)), 1) if worst else None,
        "photos": len(keys),
    }


def sight_part(place: Position, seen: Sequence[Sighting]) -> dict[str, Any]:
    """The list of photos that see a place."""
    return {
        "place": [short(float(value), 1) for value in place],
        "photos": [[one.photo_id, short(one.nadir_deg, 0), short(one.pixel_m, 2)] for one in seen],
    }


def _ray(origin: Place, direction: Place, block: Block) -> tuple[Position, Position]:
    """Eye and direction of unit length in the block's CRS."""
    eye = object_from_local(np.array([origin], dtype=np.float64), block.origin)[0]
    towards = np.array(direction, dtype=np.float64)
    return eye, towards / np.linalg.norm(towards)


def frustum_corners(block: Block, photo_id: str, depth_m: float) -> np.ndarray:
    """Four corners of a photo's frustum at a depth before its perspective centre, object frame."""
    photo, camera = block.photos[photo_id], block.camera_of(photo_id)
    half = np.array(camera.frame_mm) / 2 / camera.principal_distance_mm * depth_m
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    image = np.column_stack([corners, np.full(4, -depth_m)])
    return image @ photo.exterior.object_from_image.T + photo.exterior.centre


def _nearest(
    names: Sequence[str], places: ObjectPoints, eye: Position, towards: Position
) -> tuple[str | None, float]:
    """The place nearest to the ray as the eye sees it, and how far away it is, metres."""
    if not names:
        return None, float("inf")
    offset = places - eye
    along = offset @ towards
    beside = np.linalg.norm(offset - along[:, None] * towards, axis=1)
    angle = np.where(along > 0, np.arctan2(beside, along), np.inf)
    best = int(np.argmin(angle))
    return (names[best], float(along[best])) if angle[best] < POINT_ANGLE else (None, float("inf"))


def _pyramids(block: Block, photo_ids: Sequence[str]) -> Float64[np.ndarray, "n 5 3"]:
    """Perspective centre and four corners of each frustum."""
    depth = frustum_depth_m(block)
    found = [
        np.vstack([block.photos[name].exterior.centre, frustum_corners(block, name, depth)])
        for name in photo_ids
    ]
    return np.array(found).reshape(-1, 5, 3)


def _nearest_face(
    names: Sequence[str],
    faces: Float64[np.ndarray, "n faces 3 3"],
    eye: Position,
    towards: Position,
) -> tuple[str | None, float]:
    """Whose triangles a ray meets first, and how far away that is, metres."""
    distances = _ray_triangles(eye, towards, faces.reshape(-1, 3, 3))
    best = int(np.argmin(distances)) if len(distances) else 0
    if not len(distances) or not np.isfinite(distances[best]):
        return None, float("inf")
    each = len(distances) // len(names)
    return names[best // each], float(distances[best])


def _ray_triangles(
    eye: Position, towards: Position, triangles: Triangles
) -> Float64[np.ndarray, " n"]:
    """Distances to triangles along a ray (Moeller and Trumbore 1997); infinite where it misses."""
    first = triangles[:, 0]
    edge, other = triangles[:, 1] - first, triangles[:, 2] - first
    normal = np.cross(towards, other)
    volume = np.sum(edge * normal, axis=1)
    flat = np.abs(volume) < 1e-12
    volume = np.where(flat, 1.0, volume)
    offset = eye - first
    u = np.sum(offset * normal, axis=1) / volume
    around = np.cross(offset, edge)
    v = around @ towards / volume
    distance = np.sum(other * around, axis=1) / volume
    met = ~flat & (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)
    return np.where(met, distance, np.inf)


def worst_of(found: Picked, seat: Seat, desk: DeskSnapshot) -> Key | None:
    """The most doubtful measurement of what was picked, of those in the queue where it has any.

    A point keeps the photo looked at.
    """
    place = 0 if found.kind == "point" else 1
    rows = [row for row in desk.rows.values() if row.key[place] == found.name]
    if not rows:
        return None
    rows = [row for row in rows if passes(row, seat.filter)] or rows
    photo_id = seat.current[1] if seat.current else ""
    best = max(rows, key=lambda row: (place == 0 and row.key[1] == photo_id, row.gain, row.doubt))
    return best.key
