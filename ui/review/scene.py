"""The block as the 3D scene shows it, and what a ray in it hits: arrays in the local frame."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import Literal

import numpy as np
from jaxtyping import Float64

from core.arrays import ObjectPoints, Position
from core.block import Block
from core.frames import local_from_object, object_from_local
from ui.review.compare import Drawn, DrawnPhoto, HeightSource, ground_from_pixel
from ui.review.looks import LOOKS, ShownState
from ui.review.misfit import Misfit, misfits
from ui.review.state import DeskState, Key

Segments = Float64[np.ndarray, "n 2 3"]
"""Line segments, local frame, metres."""
Points = Float64[np.ndarray, "n 3"]
"""Points, local frame, metres."""
EDGE_PARTS = 12
"""Parts of each edge of a footprint, so that it follows the terrain."""
VECTOR_SHARE = 0.03
"""A misfit of ordinary size is drawn at most as long as this share of the block."""
MEASURE_SHARE = 0.1
"""The arrow that shows the scale of the vectors is at most this share of the block long."""
WORST: tuple[ShownState, ...] = ("rejected", "dubious", "auto", "accepted", "unused")
"""Which state a point shows that has several measurements: the first of these it has."""
POINT_ANGLE = np.radians(0.9)
"""How far beside a point a click still means it, seen from the eye."""


@dataclass(frozen=True, slots=True, eq=False)
class FrustumPicture:
    """One photo as a pyramid."""

    photo_id: str
    """The photo."""
    centre: Position
    """Perspective centre, local frame, metres."""
    object_from_image: Float64[np.ndarray, "3 3"]
    """Rotation."""
    vertical_fov: float
    """Opening over the frame's height, radians."""
    aspect: float
    """Width over height."""
    oriented: bool
    """False while the orientation could still be chance."""
    stale: bool
    """True when its ortho is older than its orientation."""


@dataclass(frozen=True, slots=True, eq=False)
class ScenePicture:
    """Everything in the 3D scene that a decision can change."""

    depth_m: float
    """Length of the frustums, metres."""
    frustums: tuple[FrustumPicture, ...]
    """Photos."""
    footprints: Segments
    """Outlines of the photos on the ground."""
    points: Mapping[ShownState, Points]
    """Control points by state."""
    checks: Points
    """Check points."""
    vectors: Segments
    """Surveyed point of each used measurement, and the end of its misfit at true length."""
    ties: Points
    """Tie points."""
    tie_vectors: Segments
    """Each tie point and the end of its longest residual on the ground, at true length."""
    labels: Mapping[str, Position]
    """Names of the photos, without what all of them share, at their perspective centres."""


def scene_picture(
    state: DeskState,
    stale: tuple[str, ...],
    outlines: Segments,
    away: Mapping[Key, Misfit] | None = None,
    tied: Segments | None = None,
) -> ScenePicture:
    """The scene of a state.

    Args:
        state: Block and adjustment.
        stale: Photos with stale orthos.
        outlines: What `footprints` says.
        away: Misfits, where they are known already.
        tied: What `tie_vectors` says, where that is known already.
    """
    oriented, origin = state.oriented, state.block.origin
    states = point_states(state)
    surveyed = state.block.surveyed
    ties = state.report.tie_positions
    ties = ties[np.all(np.isfinite(ties), axis=1)]
    return ScenePicture(
        depth_m=frustum_depth_m(oriented),
        frustums=tuple(_frustum(oriented, name, name in stale) for name in oriented.photos),
        footprints=outlines,
        points={
            name: _positions(state.block, [key for key, value in states.items() if value == name])
            for name in LOOKS
        },
        checks=_positions(
            state.block, [k for k, point in surveyed.items() if point.role == "check"]
        ),
        vectors=misfit_vectors(state, away),
        ties=local_from_object(ties, origin),
        tie_vectors=tie_vectors(state) if tied is None else tied,
        labels={
            short: oriented.photos[name].exterior.centre - origin
            for name, short in short_names(list(oriented.photos)).items()
        },
    )


def short_names(names: Sequence[str]) -> dict[str, str]:
    """Names without the words that all begin with; the same that the pages leave out."""
    first, last = min(names, default=""), max(names, default="")
    alike = takewhile(lambda pair: pair[0] == pair[1], zip(first, last, strict=False))
    shared = "".join(letter for letter, _ in alike) if len(names) > 1 else ""
    while shared and shared[-1].isalnum():
        shared = shared[:-1]
    return {name: name[len(shared) :] for name in names}


class Footprints:
    """Outlines of photos where they meet the ground, found anew for those drawn anew."""

    def __init__(self, dem: HeightSource) -> None:
        self._dem = dem
        self._known: dict[str, tuple[DrawnPhoto, ObjectPoints]] = {}

    def of(self, drawn: Drawn, origin: Position) -> Segments:
        """All outlines, local frame."""
        outlines: list[np.ndarray] = []
        for name, one in drawn.items():
            known = self._known.get(name)
            if known is None or known[0] is not one:
                known = self._known[name] = one, _outline(one, self._dem)
            ground = known[1] - origin
            outlines.append(np.stack([ground, np.roll(ground, -1, axis=0)], axis=1))
        return np.concatenate(outlines) if outlines else np.zeros((0, 2, 3))


def _outline(drawn: DrawnPhoto, dem: HeightSource) -> ObjectPoints:
    """The frame of a photo on the ground, in parts of each edge."""
    photo = drawn.photo
    corners = photo.interior.pixel_from_film(drawn.camera.frame_corners_mm)
    share = np.arange(EDGE_PARTS)[:, None] / EDGE_PARTS
    edges = [corners[i] + share * (corners[(i + 1) % 4] - corners[i]) for i in range(len(corners))]
    return ground_from_pixel(np.vstack(edges), drawn, dem, photo.ground_height_m)


def point_states(state: DeskState) -> dict[str, ShownState]:
    """One state for every surveyed control point that is measured anywhere."""
    found: dict[str, set[ShownState]] = {}
    for (point_id, _), measurement in state.block.measurements.items():
        point = state.block.surveyed.get(point_id)
        if point is not None and point.role == "control":
            found.setdefault(point_id, set()).add(state.shown_state(measurement))
    return {
        point_id: next(name for name in WORST if name in states)
        for point_id, states in found.items()
    }


def misfit_vectors(state: DeskState, away: Mapping[Key, Misfit] | None = None) -> Segments:
    """Misfits of all measurements that take part or judge, as displacements on the ground."""
    segments: list[np.ndarray] = []
    for key, misfit in (misfits(state) if away is None else away).items():
        if key not in state.block.measurements:
            continue
        shown = state.shown_state(state.block.measurements[key])
        if shown in ("unused", "rejected"):
            continue
        start = state.block.surveyed[key[0]].position - state.block.origin
        segments.append(np.array([start, start + np.array([*misfit.metres, 0.0])]))
    return np.array(segments).reshape(-1, 2, 3)


def tie_vectors(state: DeskState) -> Segments:
    """The longest residual of each tie point as a displacement on the ground, local frame.

    Of each photo the map from ground to scan in its middle is used: enough for an arrow.
    """
    report = state.report
    ties, block = report.block.ties, report.block
    if not len(ties.point) or len(report.tie_positions) < ties.count:
        return np.zeros((0, 2, 3))
    lengths = np.nan_to_num(np.linalg.norm(report.tie_residuals_px, axis=1), nan=-1.0)
    order = np.lexsort((lengths, ties.point))
    last = np.flatnonzero(np.r_[np.diff(ties.point[order]) > 0, True])
    longest = order[last]
    found = np.isfinite(report.tie_positions[ties.point[longest]]).all(axis=1)
    longest = longest[found & (lengths[longest] > 0)]
    inverse = np.zeros((len(ties.photo_ids), 2, 2))
    for number, name in enumerate(ties.photo_ids):
        if name in block.photos:
            inverse[number] = _ground_from_pixel(block, name)
    metres = np.einsum("nij,nj->ni", inverse[ties.photo[longest]], report.tie_residuals_px[longest])
    start = report.tie_positions[ties.point[longest]] - state.block.origin
    return np.stack([start, start + np.column_stack([metres, np.zeros(len(metres))])], axis=1)


def _ground_from_pixel(block: Block, photo_id: str) -> np.ndarray:
    """Metres east and north of a step of one pixel, in the middle of a photo, (2, 2)."""
    photo, camera = block.photos[photo_id], block.camera_of(photo_id)
    middle = photo.interior.pixel_from_film(np.zeros((1, 2)))
    pixels = middle + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    ground = photo.object_from_pixel(pixels, np.full(3, photo.ground_height_m), camera)[:, :2]
    return (ground[1:] - ground[0]).T


def readable_scale(state: DeskState) -> float:
    """How many times longer than on the ground vectors must be drawn to be seen: 1, 2 or 5 tens."""
    vectors = misfit_vectors(state)
    if not len(vectors):
        return 1.0
    lengths = np.linalg.norm(vectors[:, 1] - vectors[:, 0], axis=1)
    extent = float(np.max(np.ptp(vectors[:, 0, :2], axis=0)))
    typical = float(np.sqrt(np.mean(lengths**2)))
    if typical < 1e-9 or extent <= 0:
        return 1.0
    wanted = min(max(VECTOR_SHARE * extent / typical, 1.0), 1000.0)
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(step * power for step in (1, 2, 5) if step * power <= wanted))


def measure_m(extent_m: float, scale: float) -> float:
    """Length of the arrow that shows the scale of the vectors: 1, 2 or 5 of a power of ten, metres.

    Args:
        extent_m: Longer side of the block, metres.
        scale: How many times longer than on the ground vectors are drawn.
    """
    wanted = MEASURE_SHARE * extent_m / max(scale, 1.0)
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(step * power for step in (1, 2, 5) if step * power <= wanted))


def _positions(block: Block, names: list[str]) -> Points:
    points = np.array([block.surveyed[name].position for name in names]).reshape(-1, 3)
    return local_from_object(points, block.origin)


def _frustum(block: Block, photo_id: str, stale: bool) -> FrustumPicture:
    photo, camera = block.photos[photo_id], block.camera_of(photo_id)
    width, height = camera.frame_mm
    return FrustumPicture(
        photo_id=photo_id,
        centre=photo.exterior.centre - block.origin,
        object_from_image=photo.exterior.object_from_image,
        vertical_fov=2 * float(np.arctan(height / 2 / camera.principal_distance_mm)),
        aspect=width / height,
        oriented=photo.oriented,
        stale=stale,
    )


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
