"""Roads of two epochs: a planar network between villages, of which a part changed."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Int64
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import Delaunay, KDTree

from core.arrays import Scalars, locked
from core.synthetic.random_surfaces import Bounds, PlanPoints

RoadKind = Literal["main", "street", "track"]
Pairs = Int64[np.ndarray, "_ 2"]
"""Nodes that are joined, the smaller number first."""
Numbers = Int64[np.ndarray, "_"]
"""One number per pair."""
VERTEX_M = 6.0
"""Distance of the vertices of a road's line."""
TRACK_SPACING_M = 235.0
STREET_SPACING_M = 78.0
VILLAGE_SPACING_M = 1250.0


@dataclass(frozen=True, slots=True, eq=False)
class Road:
    """One piece of road between two nodes of the network, as it is now and as it was."""

    start: int
    """Node the line begins at."""
    end: int
    """Node the line ends at."""
    kind: RoadKind
    """main: between villages; street: within one; track: between fields."""
    route: int
    """Pieces with one number look alike: the same road goes on."""
    now: PlanPoints
    """Centre line at present."""
    then: PlanPoints
    """Centre line in the archival epoch."""
    exists_now: bool = True
    """False when it has been ploughed over since."""
    existed_then: bool = True
    """False when it was built since."""
    moved: bool = False
    """True when it was laid elsewhere since."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "now", locked(self.now))
        object.__setattr__(self, "then", locked(self.then))

    @property
    def length_m(self) -> float:
        """Length of the present line, metres."""
        return float(np.linalg.norm(np.diff(self.now, axis=0), axis=1).sum())

    def line(self, past: bool) -> PlanPoints:
        """Centre line in the archival epoch or now."""
        return self.then if past else self.now

    def exists(self, past: bool) -> bool:
        """Whether the road is there in the archival epoch or now."""
        return self.existed_then if past else self.exists_now


@dataclass(frozen=True, slots=True, eq=False)
class Village:
    """A settlement about a node of the network."""

    centre: tuple[float, float]
    """Easting, northing, metres."""
    radius_m: float
    """How far its houses reach, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class Network:
    """All roads, their nodes and the villages they serve."""

    nodes: PlanPoints
    """Where roads meet or end, at present."""
    roads: tuple[Road, ...]
    """The pieces between them."""
    villages: tuple[Village, ...]
    """The settlements."""

    def village_distance(self, points: PlanPoints) -> Scalars:
        """Distance to the nearest village's edge, metres, negative within."""
        nearest = np.full(len(points), np.inf)
        for village in self.villages:
            away = np.linalg.norm(points - np.array(village.centre), axis=1) - village.radius_m
            nearest = np.minimum(nearest, away)
        return nearest

    def lasting_junctions(self) -> PlanPoints:
        """Nodes of which three arms or more stood in the archival epoch and still stand."""
        both = [r for r in self.roads if r.exists_now and r.existed_then]
        ends = np.array([(road.start, road.end) for road in both], dtype=np.int64)
        arms = np.bincount(ends.ravel(), minlength=len(self.nodes))
        return self.nodes[arms >= 3]


def make_network(bounds: Bounds, change: float, rng: np.random.Generator) -> Network:
    """Roads of both epochs over an area.

    Args:
        bounds: Area to cover, metres.
        change: Share of the road length that shall have changed since.
        rng: Source of chance.

    Returns:
        The network, every piece with its line and its existence in both epochs.
    """
    centres = _scatter(bounds, np.zeros((0, 2)), VILLAGE_SPACING_M, rng)
    villages = tuple(
        Village((float(c[0]), float(c[1])), float(rng.uniform(130.0, 270.0))) for c in centres
    )
    nodes = centres
    for village in villages:
        nodes = _scatter(_around(village), nodes, STREET_SPACING_M, rng, within=village)
    nodes = _scatter(bounds, nodes, TRACK_SPACING_M, rng)
    pairs = _neighbours(nodes, rng)
    routes = _main_routes(nodes, pairs, len(centres))
    nodes = _straightened(nodes, pairs, routes, len(centres))
    roads = _drawn(nodes, pairs, routes, villages, rng)
    roads = _in_two_epochs(roads, nodes, rng)
    return Network(locked(nodes), tuple(_changed(roads, change, rng)), villages)


def _around(village: Village) -> Bounds:
    (east, north), radius = village.centre, village.radius_m
    return east - radius, north - radius, east + radius, north + radius


def _scatter(
    bounds: Bounds,
    taken: PlanPoints,
    spacing_m: float,
    rng: np.random.Generator,
    *,
    within: Village | None = None,
) -> PlanPoints:
    """Points at least a distance apart, thrown like darts."""
    west, south, east, north = bounds
    throws = int(14 * (east - west) * (north - south) / spacing_m**2) + 20
    darts = rng.uniform((west, south), (east, north), (throws, 2))
    if within is not None:
        away = np.linalg.norm(darts - np.array(within.centre), axis=1)
        darts = darts[away < within.radius_m]
    points = np.empty((len(taken) + len(darts), 2))
    points[: len(taken)] = taken
    count = len(taken)
    for dart in darts:
        if count == 0 or np.min(np.sum((points[:count] - dart) ** 2, axis=1)) > spacing_m**2:
            points[count] = dart
            count += 1
    return points[:count].copy()


def _neighbours(nodes: PlanPoints, rng: np.random.Generator) -> Pairs:
    """Pairs of nodes joined by a road: relative neighbours, and some Gabriel neighbours."""
    simplices = Delaunay(nodes).simplices
    pairs = np.vstack([simplices[:, [0, 1]], simplices[:, [1, 2]], simplices[:, [2, 0]]])
    pairs = np.unique(np.sort(pairs, axis=1), axis=0)
    tree = KDTree(nodes)
    kept: list[tuple[int, int]] = []
    for one, other in pairs:
        length = float(np.linalg.norm(nodes[one] - nodes[other]))
        middle = (nodes[one] + nodes[other]) / 2
        if tree.query(middle)[0] < length / 2 - 1e-6:
            continue
        near = [k for k in tree.query_ball_point(middle, 0.87 * length) if k not in (one, other)]
        reach = np.maximum(
            np.linalg.norm(nodes[near] - nodes[one], axis=1),
            np.linalg.norm(nodes[near] - nodes[other], axis=1),
        )
        relative = len(near) == 0 or float(reach.min()) >= length
        if relative or (length < 2.2 * TRACK_SPACING_M and rng.random() < 0.4):
            kept.append((int(one), int(other)))
    return np.array(kept, dtype=np.int64).reshape(-1, 2)


def _main_routes(nodes: PlanPoints, pairs: Pairs, villages: int) -> Numbers:
    """Number of the main road each pair belongs to, -1 for none: shortest ways between villages."""
    index = {(int(a), int(b)): k for k, (a, b) in enumerate(pairs)}
    lengths = np.linalg.norm(nodes[pairs[:, 0]] - nodes[pairs[:, 1]], axis=1) ** 1.15
    routes = np.full(len(pairs), -1, dtype=np.int64)
    apart = np.linalg.norm(nodes[:villages, None] - nodes[None, :villages], axis=2)
    wanted = sorted(
        (float(apart[i, j]), i, j)
        for i in range(villages)
        for j in range(i)
        if apart[i, j] < 2.1 * VILLAGE_SPACING_M
    )
    for number, (_, origin, goal) in enumerate(wanted[: 2 * villages]):
        costs = np.where(routes >= 0, 0.45, 1.0) * lengths
        matrix = csr_matrix((costs, (pairs[:, 0], pairs[:, 1])), shape=(len(nodes), len(nodes)))
        _, before = dijkstra(matrix, False, origin, return_predecessors=True)
        at = goal
        while before[at] >= 0:
            step = index[(min(at, int(before[at])), max(at, int(before[at])))]
            routes[step] = number if routes[step] < 0 else routes[step]
            at = int(before[at])
    return routes


def _straightened(nodes: PlanPoints, pairs: Pairs, routes: Numbers, villages: int) -> PlanPoints:
    """Nodes passed by one main road drawn towards its smooth course."""
    main = pairs[routes >= 0]
    moved = nodes.copy()
    for node in range(villages, len(nodes)):
        ends = main[(main == node).any(axis=1)]
        if len(ends) == 2:
            others = [int(b if a == node else a) for a, b in ends]
            moved[node] = 0.45 * nodes[node] + 0.55 * nodes[others].mean(axis=0)
    return moved


def _drawn(
    nodes: PlanPoints,
    pairs: Pairs,
    routes: Numbers,
    villages: tuple[Village, ...],
    rng: np.random.Generator,
) -> list[Road]:
    """Curved lines between the nodes; the straightest pair at each node passes through it."""
    tangents = _through_directions(nodes, pairs, routes)
    inner = np.zeros(len(nodes), dtype=bool)
    for village in villages:
        away = np.linalg.norm(nodes - np.array(village.centre), axis=1)
        inner |= away < 1.08 * village.radius_m
    roads: list[Road] = []
    for number, (start, end) in enumerate(pairs):
        line = _curve(nodes[start], nodes[end], tangents[(number, 0)], tangents[(number, 1)])
        length = float(np.linalg.norm(nodes[end] - nodes[start]))
        line = sway_line(line, min(3.5, 0.012 * length), rng)
        within = bool(inner[start] and inner[end])
        kind: RoadKind = "main" if routes[number] >= 0 else "street" if within else "track"
        route = int(routes[number]) if routes[number] >= 0 else 1000 + number
        roads.append(Road(int(start), int(end), kind, route, locked(line), locked(line)))
    return roads


def _through_directions(
    nodes: PlanPoints, pairs: Pairs, routes: Numbers
) -> dict[tuple[int, int], PlanPoints]:
    """Direction (1, 2) in which each pair leaves its first (0) and second (1) node."""
    leaving: dict[int, list[tuple[int, int]]] = {}
    tangents: dict[tuple[int, int], PlanPoints] = {}
    for number, (start, end) in enumerate(pairs):
        way = (nodes[end] - nodes[start])[None, :]
        way = way / np.linalg.norm(way)
        tangents[(number, 0)], tangents[(number, 1)] = way, -way
        leaving.setdefault(int(start), []).append((number, 0))
        leaving.setdefault(int(end), []).append((number, 1))
    straight = dict(tangents)
    for arms in leaving.values():
        open_arms = sorted(arms)
        options = [
            (float(np.sum(straight[a] * straight[b])) - 0.4 * _both_main(a, b, routes), a, b)
            for i, a in enumerate(open_arms)
            for b in open_arms[:i]
        ]
        for cosine, a, b in sorted(options):
            if cosine < -0.7 and a in open_arms and b in open_arms:
                way = straight[a] - straight[b]
                tangents[a] = way / np.linalg.norm(way)
                tangents[b] = -tangents[a]
                open_arms = [arm for arm in open_arms if arm not in (a, b)]
    return tangents


def _both_main(one: tuple[int, int], other: tuple[int, int], routes: Numbers) -> bool:
    return bool(routes[one[0]] >= 0 and routes[other[0]] >= 0)


def _curve(
    start: Scalars, end: Scalars, leave_start: PlanPoints, leave_end: PlanPoints
) -> PlanPoints:
    """Cubic Hermite curve between two nodes."""
    length = float(np.linalg.norm(end - start))
    t = np.linspace(0.0, 1.0, max(3, int(np.ceil(length / VERTEX_M)) + 1))[:, None]
    out, back = leave_start * length, -leave_end * length
    return (
        (2 * t**3 - 3 * t**2 + 1) * start
        + (t**3 - 2 * t**2 + t) * out
        + (3 * t**2 - 2 * t**3) * end
        + (t**3 - t**2) * back
    )


def sway_line(line: PlanPoints, amplitude_m: float, rng: np.random.Generator) -> PlanPoints:
    """The line moved sideways by smooth chance, its ends kept."""
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    share = along / along[-1]
    sway = np.zeros(len(line))
    for wave in (1.0, 2.0, 3.0, 5.0):
        sway += rng.normal() / np.sqrt(wave) * np.sin(np.pi * wave * share)
    forward = np.gradient(line, axis=0)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    left = np.column_stack([-forward[:, 1], forward[:, 0]])
    return line + left * (amplitude_m * 0.8 * sway)[:, None]


def _in_two_epochs(roads: list[Road], nodes: PlanPoints, rng: np.random.Generator) -> list[Road]:
    """Even a road that stayed is not where it was: widened, resurfaced, worn aside."""
    shifts = rng.normal(0.0, 0.25, nodes.shape)
    sway = {"main": 0.3, "street": 0.25, "track": 0.6}
    return [
        replace(
            road,
            then=locked(
                sway_line(
                    _end_moved(road.now, shifts[road.start], shifts[road.end]), sway[road.kind], rng
                )
            ),
        )
        for road in roads
    ]


def _end_moved(line: PlanPoints, at_start: Scalars, at_end: Scalars) -> PlanPoints:
    """The line with its ends moved and the rest following."""
    share = np.linspace(0.0, 1.0, len(line))[:, None]
    return line + (1 - share) * at_start + share * at_end


def _changed(roads: list[Road], change: float, rng: np.random.Generator) -> list[Road]:
    """Removes, adds and moves roads until the wanted share of the length has changed."""
    liability = {"main": 0.3, "street": 0.7, "track": 1.4}
    order = sorted(range(len(roads)), key=lambda k: float(rng.random()) / liability[roads[k].kind])
    target = change * sum(road.length_m for road in roads)
    result = list(roads)
    done = 0.0
    for number in order:
        road = roads[number]
        if done + road.length_m / 2 > target:
            break
        done += road.length_m
        result[number] = _with_change(road, rng)
    return result


def _with_change(road: Road, rng: np.random.Generator) -> Road:
    """One road that changed, in the manner of its kind."""
    lot = float(rng.random())
    if road.kind == "track" and lot < 0.55:
        return replace(road, exists_now=False)
    if (road.kind == "track" and lot < 0.75) or (road.kind == "street" and lot < 0.75):
        return replace(road, existed_then=False)
    bulge = float(rng.uniform(9.0, 30.0) * rng.choice([-1.0, 1.0])) * min(1, road.length_m / 200)
    forward = np.gradient(road.then, axis=0)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    share = np.sin(np.linspace(0.0, np.pi, len(road.then))) ** 2
    left = np.column_stack([-forward[:, 1], forward[:, 0]])
    return replace(road, then=locked(road.then + left * (bulge * share)[:, None]), moved=True)
