"""Houses, trees and hedges: what stands on the land in one epoch or in both."""

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import KDTree
from shapely.geometry import LineString, Polygon

from core.arrays import Scalars, locked
from core.synthetic.fields import Tract
from core.synthetic.network import Network, Road
from core.synthetic.options import seeded
from core.synthetic.terrain import Bounds, PlanPoints

Site = tuple[PlanPoints, PlanPoints, bool, bool]
"""Place (1, 2), direction (1, 2), whether a barn, whether the road was there in the old epoch."""


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
    network: Network, tracts: list[Tract], bounds: Bounds, past: bool, seed: int
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
