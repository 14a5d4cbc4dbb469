"""The block as the 3D scene shows it: arrays in the local frame."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import takewhile
from string import ascii_letters, digits

import numpy as np
from jaxtyping import Bool, Float64, Int64

from core.adjustment.adjusted import AdjustmentReport
from core.arrays import Indices, ObjectPoints, Position
from core.block import Block, Photo
from core.frames import local_from_object
from core.geometry.camera import Camera
from core.quality.residuals import CELLS, area_counts
from ui.review.compare import Drawn, DrawnPhoto, HeightSource, ground_from_pixel
from ui.review.looks import LOOKS, ShownState
from ui.review.misfit import Misfit, misfits, ramp_top_m, shown_misfits
from ui.review.photo_points import special_grounds
from ui.review.state import DeskState, Key

Segments = Float64[np.ndarray, "n 2 3"]
"""Line segments, local frame, metres."""
Points = Float64[np.ndarray, "n 3"]
"""Points, local frame, metres."""
FRUSTUM_SHARE = 0.17
"""Length of the frustums as a share of the flying height."""
EDGE_PARTS = 12
"""Parts of each edge of a footprint, so that it follows the terrain."""
VECTOR_SHARE = 0.03
"""A misfit of ordinary size is drawn at most as long as this share of the block."""
ELLIPSE_PARTS = 24
"""Lines of one error ellipse."""
AREA_SHARE = 0.86
"""A Gruber area is drawn this much smaller than it is, so that it does not touch the next."""
WORST: tuple[ShownState, ...] = ("rejected", "dubious", "auto", "accepted", "unused")
"""Which state a point shows that has several measurements: the first of these it has."""


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
class Cloud:
    """Points, and which of them a photo shows."""

    points: Points
    """All of them."""
    in_photo: Callable[[str], Indices]
    """Numbers of those that a photo shows."""

    def shown_in(self, photo_id: str) -> Indices:
        """Numbers of the points of a photo; of all without one."""
        return self.in_photo(photo_id) if photo_id else np.arange(len(self.points))


@dataclass(frozen=True, slots=True, eq=False)
class Areas:
    """Gruber areas of photos."""

    photo_ids: tuple[str, ...]
    """Photo of each area."""
    outlines: Float64[np.ndarray, "n corners 3"]
    """Ring of each area on the ground, local frame, metres."""
    served: Bool[np.ndarray, " n"]
    """True where something is measured in the area."""


@dataclass(frozen=True, slots=True, eq=False)
class ScenePicture:
    """Everything in the 3D scene that a decision can change."""

    depth_m: float
    """Length of the frustums, metres."""
    level_m: float
    """Height of the ground about which it is exaggerated, metres."""
    frustums: tuple[FrustumPicture, ...]
    """Photos."""
    footprints: Segments
    """Outlines of the photos on the ground."""
    points: Mapping[ShownState, Cloud]
    """Control points by state."""
    checks: Cloud
    """Check points."""
    vectors: Segments
    """Surveyed point of each used measurement, and the end of its misfit at true length."""
    vector_keys: tuple[Key, ...]
    """Point and photo of each of these measurements."""
    vectors_top_m: float
    """Misfit at the end of the ramp of colours, metres."""
    ellipses: Cloud
    """Control points that took part: middles of error ellipses."""
    half_axes: Float64[np.ndarray, "n 2"]
    """Of each ellipse along easting and northing, metres; one standard deviation."""
    areas: Callable[[], Areas]
    """Gruber areas; found when they are first shown."""
    ties: Cloud
    """Tie points."""
    rays: Int64[np.ndarray, " n"]
    """Number of rays of each tie point."""
    tie_vectors: Segments
    """Each tie point and the end of its longest residual on the ground, at true length."""
    labels: Mapping[str, Position]
    """Names of the photos, without what all of them share, at their perspective centres."""
    specials: Callable[[str], Mapping[str, Points]]
    """Where the plumb line and the rays of the special points of a photo end, by letter, (1, 3)."""

    def without_vectors(self, hidden: Collection[Key]) -> "ScenePicture":
        """The scene without the misfits of some measurements."""
        shown = [key not in hidden for key in self.vector_keys]
        keys = tuple(key for key in self.vector_keys if key not in hidden)
        return replace(self, vectors=self.vectors[np.array(shown, dtype=bool)], vector_keys=keys)

    def ties_shown(self, photo_id: str, rays: int) -> Indices:
        """Numbers of the tie points of a photo with so many rays; of all without one or the other.

        Args:
            photo_id: Name of the photo; empty for all.
            rays: Number of rays; 0 for any.
        """
        chosen = self.ties.shown_in(photo_id)
        return chosen[self.rays[chosen] == rays] if rays else chosen


def scene_picture(
    state: DeskState,
    stale: tuple[str, ...],
    outlines: Segments,
    dem: HeightSource,
    *,
    away: Mapping[Key, Misfit] | None = None,
    top_m: float | None = None,
    tied: Segments | None = None,
) -> ScenePicture:
    """The scene of a state.

    Args:
        state: Block and adjustment.
        stale: Photos with stale orthos.
        outlines: What `footprints` says.
        dem: Heights of the ground.
        away: Misfits, where they are known already.
        top_m: Where their ramp ends, where that is known already.
        tied: What `tie_vectors` says, where that is known already.
    """
    oriented, origin = state.oriented, state.block.origin
    away = misfits(state) if away is None else away
    states = point_states(state)
    checks = [name for name, point in state.block.surveyed.items() if point.role == "check"]
    keys, vectors = misfit_vectors(state, away)
    adjusted = {
        name: sigma
        for name, sigma in state.report.surveyed_sigmas_m.items()
        if name in state.block.surveyed and np.isfinite(sigma[:2]).all()
    }
    ties, rays = tie_cloud(state)
    return ScenePicture(
        depth_m=frustum_depth_m(oriented),
        level_m=ground_level_m(oriented),
        frustums=tuple(_frustum(oriented, name, name in stale) for name in oriented.photos),
        footprints=outlines,
        points={
            name: _cloud(state.block, [key for key, value in states.items() if value == name])
            for name in LOOKS
        },
        checks=_cloud(state.block, checks),
        vectors=vectors,
        vector_keys=tuple(keys),
        vectors_top_m=ramp_top_m(state, away) if top_m is None else top_m,
        ellipses=_cloud(state.block, adjusted),
        half_axes=np.array([sigma[:2] for sigma in adjusted.values()]).reshape(-1, 2),
        areas=cache(lambda: gruber_areas(state.report, oriented, dem)),
        ties=ties,
        rays=rays,
        tie_vectors=tie_vectors(state) if tied is None else tied,
        labels={
            short: oriented.photos[name].exterior.centre - origin
            for name, short in short_names(list(oriented.photos)).items()
        },
        specials=cache(lambda name: _specials(oriented, name, dem)),
    )


def _specials(block: Block, photo_id: str, dem: HeightSource) -> Mapping[str, Points]:
    """Special points of a photo on the ground, local frame; none without a photo."""
    photo = block.photos.get(photo_id)
    if photo is None:
        return {}
    grounds = special_grounds(DrawnPhoto(photo, block.camera_of(photo_id), 1), dem)
    return {letter: local_from_object(place, block.origin) for letter, place in grounds.items()}


def ground_level_m(block: Block) -> float:
    """Height of the ground under the block, about which it is exaggerated, metres."""
    heights = [photo.ground_height_m for photo in block.photos.values()]
    return float(np.median(heights)) if heights else 0.0


def exaggerate_heights(points: Points, level_m: float, relief: float) -> Points:
    """Places on the ground with heights about a level so many times as large."""
    higher = points.copy()
    higher[..., 2] = level_m + relief * (points[..., 2] - level_m)
    return higher


def short_names(names: Sequence[str]) -> dict[str, str]:
    """Names without what all begin or end with; the same that the pages leave out."""
    before = _shared_start(names)
    after = _shared_start([name[: before - 1 if before else None : -1] for name in names])
    return {name: name[before : len(name) - after] for name in names}


def _shared_start(names: Sequence[str]) -> int:
    """So many letters all begin with, up to a sign between words."""
    first, last = min(names, default=""), max(names, default="")
    alike = takewhile(lambda pair: pair[0] == pair[1], zip(first, last, strict=False))
    shared = "".join(letter for letter, _ in alike) if len(names) > 1 else ""
    return len(shared.rstrip(ascii_letters + digits))


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


def misfit_vectors(
    state: DeskState, away: Mapping[Key, Misfit] | None = None
) -> tuple[list[Key], Segments]:
    """Misfits of all measurements that take part or judge, as displacements on the ground."""
    shown = shown_misfits(state, misfits(state) if away is None else away)
    positions = np.array([state.block.surveyed[key[0]].position for key in shown]).reshape(-1, 3)
    metres = np.array([(*misfit.metres, 0.0) for misfit in shown.values()]).reshape(-1, 3)
    starts = positions - state.block.origin
    return list(shown), np.stack([starts, starts + metres], axis=1)


def ellipse_lines(middles: Points, half_axes: Float64[np.ndarray, "n 2"], scale: float) -> Segments:
    """Rings of error ellipses, drawn so many times larger than they are.

    The adjustment tells standard deviations of coordinates, so that the axes lie along them.
    """
    turn = np.linspace(0, 2 * np.pi, ELLIPSE_PARTS + 1)
    circle = np.column_stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)])
    axes = scale * np.column_stack([half_axes, np.zeros(len(half_axes))])
    ring = middles[:, None] + axes[:, None] * circle
    return np.stack([ring[:, :-1], ring[:, 1:]], axis=2).reshape(-1, 2, 3)


def gruber_areas(report: AdjustmentReport, block: Block, dem: HeightSource) -> Areas:
    """The nine Gruber areas of each photo on the ground, and which of them have a point."""
    counts = area_counts(report)
    names = [name for name, photo in block.photos.items() if photo.oriented and name in counts]
    outlines = [
        _areas_of(block.photos[name], block.camera_of(name), dem) - block.origin for name in names
    ]
    corners = outlines[0].shape[1] if outlines else 0
    return Areas(
        tuple(name for name in names for _ in range(CELLS**2)),
        np.array(outlines).reshape(-1, corners, 3),
        np.array([counts[name].ravel() > 0 for name in names], dtype=bool).ravel(),
    )


def _areas_of(photo: Photo, camera: Camera, dem: HeightSource) -> ObjectPoints:
    """Rings of the areas of a photo on the ground, top row first."""
    width, height = camera.frame_mm
    half = AREA_SHARE / 2
    corners = half * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1], [-1, 1]])
    # Parts of each edge, so that it follows the terrain.
    ring = np.concatenate(
        [np.linspace(corners[i], corners[i + 1], EDGE_PARTS // CELLS + 1)[:-1] for i in range(4)]
    )
    middles = np.arange(CELLS) + 0.5
    across, down = np.meshgrid(middles, CELLS - middles)
    places = (np.column_stack([across.ravel(), down.ravel()])[:, None] + ring) / CELLS - 0.5
    film = (places * np.array([width, height])).reshape(-1, 2)
    pixels = photo.interior.pixel_from_film(film)
    drawn = DrawnPhoto(photo, camera, 1)
    ground = ground_from_pixel(pixels, drawn, dem, photo.ground_height_m)
    return ground.reshape(CELLS**2, len(ring), 3)


def area_lines(areas: Areas, photo_id: str) -> tuple[Segments, Bool[np.ndarray, " n"]]:
    """Outlines of a photo's areas, those without a point crossed; of all without one otherwise.

    Returns:
        Lines, and whether each belongs to an area that has a point.
    """
    photos = np.array(areas.photo_ids)
    chosen = np.flatnonzero(photos == photo_id if photo_id else ~areas.served)
    rings = areas.outlines[chosen]
    edges = np.stack([rings, np.roll(rings, -1, axis=1)], axis=2)
    side = rings.shape[1] // 4
    crossed = rings[~areas.served[chosen]]
    crosses = np.stack([crossed[:, [0, side]], crossed[:, [2 * side, 3 * side]]], axis=2)
    served = np.repeat(areas.served[chosen], rings.shape[1])
    lines = np.concatenate([edges.reshape(-1, 2, 3), crosses.reshape(-1, 2, 3)])
    return lines, np.r_[served, np.zeros(crosses.shape[0] * crosses.shape[1], dtype=bool)]


def tie_cloud(state: DeskState) -> tuple[Cloud, Int64[np.ndarray, " n"]]:
    """Tie points that were adjusted, and how many rays each has."""
    report = state.report
    ties = report.block.ties
    sound = np.flatnonzero(np.isfinite(report.tie_positions).all(axis=1))
    used = np.isfinite(report.tie_residuals_px).all(axis=1)
    rays = np.bincount(ties.point[used], minlength=len(report.tie_positions))

    def in_photo(photo_id: str) -> Indices:
        if photo_id not in ties.photo_ids:
            return np.zeros(0, dtype=np.int64)
        seen = ties.point[used & (ties.photo == ties.photo_ids.index(photo_id))]
        return np.flatnonzero(np.isin(sound, seen))

    points = local_from_object(report.tie_positions[sound], state.block.origin)
    return Cloud(points, in_photo), rays[sound]


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


def readable_scale(state: DeskState, away: Mapping[Key, Misfit] | None = None) -> float:
    """How many times longer than on the ground vectors must be drawn to be seen: 1, 2 or 5 tens."""
    _, vectors = misfit_vectors(state, away)
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


def _cloud(block: Block, names: Collection[str]) -> Cloud:
    """Surveyed points by name."""
    points = np.array([block.surveyed[name].position for name in names]).reshape(-1, 3)
    numbers = {name: number for number, name in enumerate(names)}

    def in_photo(photo_id: str) -> Indices:
        seen = [numbers[p] for p, photo in block.measurements if photo == photo_id and p in numbers]
        return np.array(seen, dtype=np.int64)

    return Cloud(local_from_object(points, block.origin), in_photo)


def frustum_depth_m(block: Block) -> float:
    """Depth of the frustums on screen: a part of the flying height, the same for all."""
    heights = [
        float(photo.exterior.centre[2]) - photo.ground_height_m for photo in block.photos.values()
    ]
    return FRUSTUM_SHARE * float(np.median(heights)) if heights else 100.0


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
