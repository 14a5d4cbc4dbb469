"""What covers the land in each epoch: parcels between the roads, houses, trees and hedges."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
import shapely.ops
from jaxtyping import Float32
from scipy import ndimage
from scipy.spatial import KDTree
from shapely.geometry import LineString, Polygon

from core.arrays import Scalars, locked
from core.synthetic.network import Network, Road
from core.synthetic.options import seeded
from core.synthetic.random_surfaces import Bounds, PlanPoints

Cover = Literal["arable", "meadow", "orchard", "garden"]
PROFILE_STEP_M = 0.125
PROFILE_LENGTH = 65536
"""A profile repeats after 8 km, and every tract begins somewhere else in it."""
STRIPS, GARDENS, BROAD, PLAIN = 0, 1, 2, 3
Site = tuple[PlanPoints, PlanPoints, bool, bool]
"""Place (1, 2), direction (1, 2), whether a barn, whether the road was there in the old epoch."""


@dataclass(frozen=True, slots=True, eq=False)
class Tract:
    """Land ploughed in one direction: its strips follow from a profile across that direction."""

    outline: PlanPoints
    """Boundary (easting, northing), metres."""
    cover: Cover
    """What grows there."""
    profile: int
    """Row of the profile table."""
    offset_m: float
    """Where in the profile the tract begins."""
    across: tuple[float, float]
    """Unit vector across the strips."""
    tone: float
    """Mean gray, 0 to 255."""
    contrast: float
    """Factor on the profile."""
    mottle: float
    """Factor on the irregular texture."""
    tint: tuple[float, float, float]
    """Colour, red, green, blue, of mean luminance 1."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "outline", locked(self.outline))


def make_tracts(
    network: Network,
    past: bool,
    change: float,
    recency: float,
    *,
    seed: int,
    season: object = None,
    still: float | None = None,
) -> list[Tract]:
    """All tracts of one epoch; land whose bounds did not change keeps its tracts and strips.

    Args:
        network: Roads of both epochs.
        past: The archival epoch, or the present.
        change: Share of the land that was parcelled anew although its roads stayed.
        recency: 0 where the old epoch lies before the consolidation of land, 1 where after it.
        seed: Seed of the block.
        season: What crops go with; None: the epoch.
        still: Share of the land that has not been parcelled anew yet; None: all that ever is.

    Returns:
        Tracts that cover all land enclosed by roads.
    """
    tracts: list[Tract] = []
    for face in _faces(network, past):
        centre = np.array([[face.centroid.x, face.centroid.y]])
        key = f"{centre[0, 0]:.1f} {centre[0, 1]:.1f}"
        lot = seeded(seed, "stayed", key).random()
        stayed = lot > change
        old = past and (still is None or lot <= still)
        # Bounds and direction of unchanged land come from a generator without the epoch.
        shape = seeded(seed, "tracts", key, "both" if stayed else old)
        crops = seeded(seed, "crops", key, past if season is None else season)
        consolidated = seeded(seed, "consolidated", key).random() < 0.75 * recency
        small = (old or stayed) and not consolidated
        garden = float(network.village_distance(centre)[0]) < 40.0
        for piece in _halved(face, shape.uniform(2.5e4, 7e4) if small else 2.4e5, shape):
            tracts.append(_tract(piece, small, garden, past, shape=shape, crops=crops))
    return tracts


def _faces(network: Network, past: bool) -> list[Polygon]:
    """Land enclosed by the roads of an epoch; worn roads keep their bounds, moved ones do not."""
    lines = [
        LineString(road.then if past and road.moved else road.now)
        for road in network.roads
        if road.exists(past)
    ]
    noded = shapely.get_parts(shapely.unary_union(lines))
    faces = shapely.get_parts(shapely.polygonize(noded))
    return sorted(
        (face for face in faces if face.area > 200.0), key=lambda f: (f.centroid.x, f.centroid.y)
    )


def _halved(face: Polygon, limit_m2: float, rng: np.random.Generator) -> list[Polygon]:
    """The face cut across its longer side until no piece is larger than the limit."""
    if face.area < limit_m2:
        return [face]
    along, _ = _long_axis(face)
    middle = np.array([face.centroid.x, face.centroid.y])
    middle += along * rng.uniform(-0.1, 0.1) * np.sqrt(face.area)
    turn = rng.normal(0.0, 0.12)
    across = np.array([-along[1], along[0]]) + turn * along
    reach = 4.0 * float(np.hypot(*(np.array(face.bounds[2:]) - np.array(face.bounds[:2]))))
    knife = LineString([middle - across * reach, middle + across * reach])
    pieces = [p for p in shapely.ops.split(face, knife).geoms if isinstance(p, Polygon)]
    if len(pieces) < 2:
        return [face]
    return [part for piece in pieces for part in _halved(piece, limit_m2, rng)]


def _long_axis(face: Polygon) -> tuple[np.ndarray, float]:
    """Unit vector along the longer side of the smallest rectangle about a face, and its length."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(face))
    sides = np.diff(corners[:3], axis=0)
    lengths = np.linalg.norm(sides, axis=1)
    longer = int(np.argmax(lengths))
    return sides[longer] / max(float(lengths[longer]), 1e-9), float(lengths[longer])


def _tract(
    piece: Polygon,
    small: bool,
    garden: bool,
    past: bool,
    *,
    shape: np.random.Generator,
    crops: np.random.Generator,
) -> Tract:
    along, _ = _long_axis(piece)
    if shape.random() < 0.3:
        along = np.array([-along[1], along[0]])
    turn = shape.normal(0.0, 0.05)
    across = np.array([-along[1] + turn * along[0], along[0] + turn * along[1]])
    across /= np.linalg.norm(across)
    offset = float(shape.uniform(0.0, PROFILE_LENGTH * PROFILE_STEP_M))
    lot = float(shape.random())
    cover: Cover = "arable" if lot < 0.77 else "meadow" if lot < 0.94 else "orchard"
    cover = "garden" if garden else cover
    kind = {"arable": STRIPS if small else BROAD, "garden": GARDENS}.get(cover, PLAIN)
    tone, contrast, mottle, tint = _look(cover, past, small, crops)
    return Tract(
        shapely.get_coordinates(piece.exterior),
        cover,
        2 * kind + past,
        offset,
        (float(across[0]), float(across[1])),
        tone,
        contrast,
        mottle,
        tint,
    )


def _look(
    cover: Cover, past: bool, small: bool, rng: np.random.Generator
) -> tuple[float, float, float, tuple[float, float, float]]:
    """Tone, contrast of the strips, mottle and tint of a tract."""
    green, soil, straw = (0.93, 1.06, 0.82), (1.1, 0.98, 0.84), (1.08, 1.02, 0.76)
    if cover == "arable":
        tone = rng.normal(132.0, 16.0 if small else 27.0)
        tint = (green, soil, straw)[int(rng.integers(3))]
        return float(np.clip(tone, 70, 200)), float(rng.uniform(0.6, 1.25)), 1.0, tint
    if cover == "garden":
        return float(rng.normal(118.0, 12.0)), float(rng.uniform(0.7, 1.2)), 1.6, green
    mean = 112.0 if past else 122.0
    return float(rng.normal(mean, 12.0)), 1.0, float(rng.uniform(1.0, 1.9)), green


def make_profiles(
    seed: int, texture_m: float, season: object = None
) -> Float32[np.ndarray, "profiles steps"]:
    """Gray across the strips: row 2 k + past of kind k (strips, gardens, broad, plain).

    Strips and gardens have the same bounds in both epochs and other crops; furrows, ridges and
    tramlines always differ.
    """
    rows = []
    widths = {STRIPS: (9.0, 46.0), GARDENS: (6.0, 19.0), BROAD: (90.0, 420.0)}
    for kind in (STRIPS, GARDENS, BROAD, PLAIN):
        for past in (False, True):
            shape = seeded(seed, "strips", kind)
            crops = seeded(seed, "profile", kind, season if past and season else past)
            row = _furrows(crops, past, kind)
            if kind in widths:
                row += _strips(*widths[kind], shape, crops)
            if kind == BROAD:
                row += _tramlines(crops)
            rows.append(
                ndimage.gaussian_filter1d(row, 0.4 * texture_m / PROFILE_STEP_M, mode="wrap")
            )
    return np.array(rows, dtype=np.float32)


def _strips(
    least_m: float, most_m: float, shape: np.random.Generator, crops: np.random.Generator
) -> np.ndarray:
    """Steps of tone from strip to strip with a grass balk between them."""
    row = np.zeros(PROFILE_LENGTH)
    at = 0
    while at < PROFILE_LENGTH:
        width = int(np.exp(shape.uniform(np.log(least_m), np.log(most_m))) / PROFILE_STEP_M)
        row[at : at + width] = np.clip(crops.normal(0.0, 19.0), -48.0, 48.0)
        balk = int(shape.uniform(0.4, 1.1) / PROFILE_STEP_M)
        row[at : at + balk] = crops.uniform(-20.0, 14.0)
        at += width
    return row


def _furrows(rng: np.random.Generator, past: bool, kind: int) -> np.ndarray:
    """Lines of sowing and ploughing: chance smoothed at two widths."""
    fine = rng.standard_normal(PROFILE_LENGTH)
    row = 3.8 * _unit(ndimage.gaussian_filter1d(fine, 3.0, mode="wrap"))
    ridges = rng.standard_normal(PROFILE_LENGTH)
    row += (3.8 if past else 2.5) * _unit(ndimage.gaussian_filter1d(ridges, 14.0, mode="wrap"))
    knots = rng.standard_normal(PROFILE_LENGTH // 256)
    slow = 3.0 * np.interp(
        np.arange(PROFILE_LENGTH) / 256.0, np.arange(len(knots)), knots, period=len(knots)
    )
    return (row + slow) * (0.35 if kind == PLAIN else 1.0)


def _tramlines(rng: np.random.Generator) -> np.ndarray:
    """Pairs of wheel tracks at the working width of the sprayer."""
    row = np.zeros(PROFILE_LENGTH)
    at = 0.0
    while at < PROFILE_LENGTH * PROFILE_STEP_M:
        for wheel in (0.0, 1.9):
            begin = int((at + wheel) / PROFILE_STEP_M)
            row[begin : begin + 5] = rng.uniform(8.0, 26.0)
        at += 21.0
    return row


def _unit(values: np.ndarray) -> np.ndarray:
    return values / values.std()


@dataclass(frozen=True, slots=True, eq=False)
class House:
    """A building with a ridge roof."""

    corners: PlanPoints
    """Four corners; the ridge runs from the middle of 0-3 to the middle of 1-2."""
    height_m: float
    """Height of the ridge, metres: how far its shadow reaches."""
    tone: float
    """Mean gray of the roof."""
    red: bool
    """Tiles rather than slate or sheet."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "corners", locked(self.corners))


@dataclass(frozen=True, slots=True, eq=False)
class Trees:
    """Single trees and shrubs as parallel arrays."""

    places: PlanPoints
    """Easting, northing, metres."""
    radii_m: Scalars
    """Radius of the crown, metres."""
    tones: Scalars
    """Gray of the crown."""

    def __post_init__(self) -> None:
        for name in ("places", "radii_m", "tones"):
            object.__setattr__(self, name, locked(getattr(self, name)))


def make_houses(network: Network, seed: int, recency: float) -> tuple[list[House], list[House]]:
    """The houses of the archival epoch and of the present; most of the old ones still stand.

    Args:
        network: Roads and villages.
        seed: Seed of the block.
        recency: 0 for 1938, 1 for 1984: how much of the present stood already.

    Returns:
        Houses then, houses now.
    """
    rng = seeded(seed, "houses")
    sites = _sites(network, rng)
    then: list[House] = []
    now: list[House] = []
    for place, direction, barn, old in sites:
        stays = 0.55 + 0.33 * recency
        lot = float(rng.random())
        size = (
            (rng.uniform(12, 26), rng.uniform(6.5, 9))
            if barn
            else (rng.uniform(9, 19), rng.uniform(7, 10))
        )
        corners = _rectangle(place, direction, size)
        height = float(rng.uniform(5.0, 8.5))
        if old and lot < stays + (1 - stays) * 0.35:
            then.append(House(corners, height, float(rng.uniform(80, 190)), True))
        if not old or lot < stays or lot > stays + (1 - stays) * 0.35:
            tone = float(rng.choice([rng.uniform(70, 110), rng.uniform(130, 215)]))
            now.append(House(corners, height, tone, bool(rng.random() < 0.75)))
    now.extend(_halls(network, rng))
    return then, now


def _sites(network: Network, rng: np.random.Generator) -> list[Site]:
    """Places beside village roads with the direction of the road; barns stand behind houses."""
    found: list[Site] = []
    roads = [r for r in network.roads if r.kind != "track"]
    for road in roads:
        for at in np.arange(9.0, road.length_m - 9.0, 4.0):
            if rng.random() > 0.27:
                continue
            place, way = _along(road.now, float(at))
            if float(network.village_distance(place)[0]) > 25.0:
                continue
            left = np.array([[-way[0, 1], way[0, 0]]]) * float(rng.choice([-1.0, 1.0]))
            turned = way if rng.random() < 0.6 else left
            found.append((place + left * rng.uniform(10.0, 15.0), turned, False, road.existed_then))
            if rng.random() < 0.6:
                behind = place + left * rng.uniform(30.0, 42.0)
                found.append((behind, way, True, road.existed_then))
    return _apart(found, network, rng)


def _apart(sites: list[Site], network: Network, rng: np.random.Generator) -> list[Site]:
    """Sites that collide neither with each other nor with a road of either epoch."""
    if not sites:
        return []
    places = np.vstack([site[0] for site in sites])
    close = KDTree(places).query_ball_point(places, 16.0)
    lines = [LineString(line) for road in network.roads for line in (road.now, road.then)]
    tree = shapely.STRtree(lines)
    blocked = set(tree.query(shapely.points(places), "dwithin", 8.5)[0].tolist())
    kept: set[int] = set()
    for number in rng.permutation(len(sites)).tolist():
        if number not in blocked and not kept.intersection(close[number]):
            kept.add(number)
    return [sites[number] for number in sorted(kept)]


def _along(line: PlanPoints, at_m: float) -> tuple[PlanPoints, PlanPoints]:
    """Point (1, 2) and unit direction (1, 2) of a line at a distance from its start."""
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    k = int(np.clip(np.searchsorted(along, at_m) - 1, 0, len(steps) - 1))
    way = ((line[k + 1] - line[k]) / steps[k])[None, :]
    return line[k][None, :] + way * (at_m - along[k]), way


def _rectangle(place: PlanPoints, way: PlanPoints, size_m: tuple[float, float]) -> PlanPoints:
    left = np.array([[-way[0, 1], way[0, 0]]])
    half, deep = way * size_m[0] / 2, left * size_m[1] / 2
    return np.vstack(
        [place - half - deep, place + half - deep, place + half + deep, place - half + deep]
    )


def _halls(network: Network, rng: np.random.Generator) -> list[House]:
    """Halls of the farms of today at the edge of the villages."""
    halls: list[House] = []
    for village in network.villages:
        turn = float(rng.uniform(0, 2 * np.pi))
        middle = np.array(village.centre) + (village.radius_m + 70.0) * np.array(
            [np.cos(turn), np.sin(turn)]
        )
        way = np.array([[np.cos(turn + 0.4), np.sin(turn + 0.4)]])
        left = np.array([[-way[0, 1], way[0, 0]]])
        for number in range(int(rng.integers(2, 5))):
            place = middle[None, :] + left * 24.0 * (number - 1.5)
            size = (float(rng.uniform(38, 65)), float(rng.uniform(11, 16)))
            tone = float(rng.uniform(150, 225))
            halls.append(House(_rectangle(place, way, size), 7.0, tone, False))
    return halls


def make_trees(
    network: Network, tracts: list[Tract], bounds: Bounds, past: bool, *, seed: int
) -> Trees:
    """Trees along roads, on bounds of tracts, in orchards and gardens, and alone in the fields."""
    rng = seeded(seed, "trees", past)
    places = [_avenue(road, past, seed) for road in network.roads if road.exists(past)]
    places += [_in_tract(tract, network, past, rng) for tract in tracts]
    area = (bounds[2] - bounds[0]) * (bounds[3] - bounds[1])
    lonely = rng.uniform(bounds[:2], bounds[2:], (int(area / 1e6 * (22 if past else 14)), 2))
    points = np.vstack([*places, lonely])
    radii = np.exp(rng.normal(np.log(2.3), 0.32, len(points)))
    tones = rng.normal(66.0 if past else 74.0, 11.0, len(points))
    return Trees(points, np.clip(radii, 1.0, 5.5), np.clip(tones, 38.0, 115.0))


def _avenue(road: Road, past: bool, seed: int) -> PlanPoints:
    """Rows of trees beside a road; most of the old fruit trees are gone today."""
    rng = seeded(seed, "avenue", road.route, past)
    share = (
        {"main": 0.7, "street": 0.15, "track": 0.22}
        if past
        else {"main": 0.4, "street": 0.3, "track": 0.2}
    )
    if rng.random() > share[road.kind]:
        return np.zeros((0, 2))
    rng = seeded(seed, "avenue", road.start, road.end, past)
    side = {"main": 5.2, "street": 4.8, "track": 3.6}[road.kind]
    sides = [-side, side] if road.kind == "main" or rng.random() < 0.3 else [side]
    rows: list[PlanPoints] = []
    for offset in sides:
        gap = float(rng.uniform(8.0, 13.0))
        for at in np.arange(10.0, road.length_m - 10.0, gap):
            if rng.random() < (0.8 if past else 0.55):
                place, way = _along(road.line(past), float(at + rng.normal(0, 1.0)))
                left = np.array([[-way[0, 1], way[0, 0]]])
                rows.append(place + left * (offset + rng.normal(0.0, 0.5)))
    return np.vstack(rows) if rows else np.zeros((0, 2))


def _in_tract(tract: Tract, network: Network, past: bool, rng: np.random.Generator) -> PlanPoints:
    outline = Polygon(tract.outline)
    rows = [np.zeros((0, 2))]
    if tract.cover == "orchard":
        rows.append(_orchard(tract, rng))
    if tract.cover == "garden":
        count = int(outline.area / 1e4 * rng.uniform(12, 34))
        rows.append(rng.uniform(outline.bounds[:2], outline.bounds[2:], (count, 2)))
    if tract.cover == "meadow":
        count = int(outline.area / 1e4 * rng.uniform(0, 5))
        rows.append(rng.uniform(outline.bounds[:2], outline.bounds[2:], (count, 2)))
    points = np.vstack(rows)
    inside = shapely.contains_xy(outline, points[:, 0], points[:, 1])
    points = points[inside]
    if rng.random() < (0.16 if past else 0.3):
        points = np.vstack([points, _hedge(tract, rng)])
    return points


def _orchard(tract: Tract, rng: np.random.Generator) -> PlanPoints:
    """A lattice of trees over the tract's rectangle."""
    low, high = tract.outline.min(axis=0), tract.outline.max(axis=0)
    reach = float(np.hypot(*(high - low))) / 2
    gap, between = float(rng.uniform(6.0, 10.0)), float(rng.uniform(6.0, 10.0))
    steps = np.meshgrid(np.arange(-reach, reach, gap), np.arange(-reach, reach, between))
    across = np.array(tract.across)
    along = np.array([across[1], -across[0]])
    lattice = steps[0].reshape(-1, 1) * across + steps[1].reshape(-1, 1) * along
    points = (low + high) / 2 + lattice + rng.normal(0.0, 0.5, (steps[0].size, 2))
    return points[rng.random(len(points)) < 0.88]


def _hedge(tract: Tract, rng: np.random.Generator) -> PlanPoints:
    """Shrubs along a part of the tract's boundary."""
    boundary = LineString(tract.outline)
    begin = float(rng.uniform(0, boundary.length))
    at = (begin + np.arange(0.0, 0.35 * boundary.length, 3.0)) % boundary.length
    at = at[rng.random(len(at)) < 0.75]
    points = shapely.get_coordinates(shapely.line_interpolate_point(boundary, at))
    return points + rng.normal(0.0, 0.9, points.shape)
