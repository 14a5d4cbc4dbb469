"""Junctions: where at least three roads meet on the ground.

Azimuths are grid azimuths, radians clockwise from grid north (the northing axis).
"""

from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Bool, Float64, Int64
from scipy.spatial import KDTree
from shapely.geometry.base import BaseGeometry

from core.arrays import Position, Scalars, locked
from core.geometry.crs import SAME_PLACE_M, Bounds
from core.matching.reference import SigmasAt
from core.raster.dem import Dem
from core.reference.road_graph import RoadGraph, clusters

TRACK_WORDS = ("track", "cesta", "path", "footway", "bridleway", "cycleway", "steps", "pesina")
"""Words in the class or layer of roads that keep their place less well than paved ones."""
FULL_TURN = 2 * np.pi  # source: definition.
# design: beyond the ends that were joined, before the next turn of the road.
AT_NODE_M = 1.0
"""An arm's attributes are those of the road this far from the node."""
# design: what lines overshoot a crossing by when they are digitised, and drives to a gate.
STUB_M = 5.0
"""Dead ends shorter than this are no arms, metres."""
# design: the two carriageways of a road, and arms of a crossing that miss each other by a width.
MERGE_M = 8.0
"""Junctions closer than this to each other are one, metres."""
# design: half a template at the usual scales; a road bends little within it.
ARM_M = 15.0
"""An arm's direction is taken to its point at this distance, metres."""
# design: two roads of 3 m are apart at ARM_M from this angle on.
LEAST_ANGLE = float(np.radians(12.0))
"""Arms closer in direction than this are one road drawn twice, radians."""
# design: a paved crossing is rebuilt within its own width, a track moves with its ruts.
CHANGE_M = {"paved": 0.3, "track": 0.6}
"""What a junction has moved in decades, per axis; added in squares, metres."""
# design: a new surface of the road, or none.
CHANGE_HEIGHT_M = 0.3
"""What its height has changed, metres."""
# design: the mean of hilly country.
USUAL_SLOPE = 0.1
"""Slope of the ground where the DEM does not tell it, as at its rim."""


@dataclass(frozen=True, slots=True, eq=False)
class Junction:
    """A place where roads meet on the ground."""

    junction_id: str
    """`J`, easting and northing in decimetres: it stays as long as the roads do."""
    position: Position
    """Easting, northing, height from the DEM (bilinear), metres."""
    sigma_m: Position
    """Standard deviations of the three, metres."""
    degree: int
    """Number of arms."""
    arm_azimuths: Scalars
    """Direction of each arm, radians clockwise from grid north, ascending."""
    arm_kinds: tuple[str, ...]
    """Class (layer where there is none) of the road of each arm."""
    arm_widths_m: Scalars
    """Width of the road of each arm, metres; NaN where unknown."""
    compact: bool
    """True where several close nodes were taken as one."""
    filled: bool = False
    """True where the height rests on a gap of the DEM that was closed."""

    def __post_init__(self) -> None:
        for name in ("position", "sigma_m", "arm_azimuths", "arm_widths_m"):
            object.__setattr__(self, name, locked(getattr(self, name)))


@dataclass(frozen=True, slots=True, eq=False)
class _Arms:
    """Ends of edges at the nodes they leave, as parallel arrays."""

    node: Int64[np.ndarray, "arms"]
    """Node the arm leaves; later the junction it belongs to."""
    edge: Int64[np.ndarray, "arms"]
    """Edge it runs on."""
    forward: Bool[np.ndarray, "arms"]
    """True where it leaves at the edge's first point."""

    def chosen(self, rows: np.ndarray) -> "_Arms":
        """Some of the arms."""
        return _Arms(self.node[rows], self.edge[rows], self.forward[rows])


def find_junctions(
    graph: RoadGraph,
    dem: Dem,
    *,
    sigmas_m: SigmasAt,
    bounds: Bounds | None = None,
    mask: BaseGeometry | None = None,
    bridges: BaseGeometry | None = None,
) -> tuple[Junction, ...]:
    """The junctions on the ground that have a height, from west to east.

    Args:
        graph: The planar graph of the roads.
        dem: Terrain; junctions outside it or in its gaps are left out.
        sigmas_m: Standard deviations at places: of the ortho per axis, since the patch comes from
            it and not from the lines, and of the DEM.
        bounds: Only junctions within these, metres.
        mask: Area where nothing may be matched.
        bridges: Bridge areas: roads that only run through each other within one do not meet.
    """
    arms = _ground_arms(graph, bridges)
    junction, compact = _junction_of_node(graph, arms)
    arms = _outgoing(graph, arms, junction)
    azimuths = _azimuths(graph, arms, ARM_M)
    order = np.lexsort((azimuths, junction[arms.node]))
    arms, azimuths = arms.chosen(order), azimuths[order]
    owner = junction[arms.node]
    distinct = _distinct(owner, azimuths, LEAST_ANGLE)
    arms, azimuths, owner = arms.chosen(distinct), azimuths[distinct], owner[distinct]
    degree = np.bincount(owner, minlength=len(compact))
    places = _places(graph, junction, len(compact))
    kept = np.flatnonzero((degree >= 3) & _is_allowed(places, bounds, mask))
    found = _Found(places, compact, kept, arms, azimuths, owner)
    return _with_heights(graph, dem, found, sigmas_m)


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    """Junctions in the plane, and their arms sorted by junction and azimuth."""

    places: Float64[np.ndarray, "junctions 2"]
    compact: Bool[np.ndarray, "junctions"]
    kept: Int64[np.ndarray, "kept"]
    arms: _Arms
    azimuths: Float64[np.ndarray, "arms"]
    owner: Int64[np.ndarray, "arms"]


def _ground_arms(graph: RoadGraph, bridges: BaseGeometry | None) -> _Arms:
    """Both ends of every edge, without stubs and without what passes over or under."""
    count = len(graph.edges)
    edge = np.tile(np.arange(count), 2)
    arms = _Arms(graph.edge_nodes.T.ravel(), edge, np.repeat([True, False], count))
    dead = (graph.degrees[graph.edge_nodes] == 1).any(axis=1)
    kept = ~(dead & (graph.lengths < STUB_M))[edge]
    if graph.roads.level.any():
        kept &= ~_passing(graph, arms)
    if bridges is not None and not bridges.is_empty:
        shapely.prepare(bridges)
        spanned = graph.crossing & shapely.contains_xy(bridges, *graph.nodes.T)
        kept &= ~spanned[arms.node]
    return arms.chosen(kept)


def _passing(graph: RoadGraph, arms: _Arms) -> Bool[np.ndarray, "arms"]:
    """Arms of a bridge or tunnel that does not end at the node: they meet nothing there."""
    level = graph.roads.level[_source(graph, arms)]
    raised = np.flatnonzero(graph.roads.level)
    lines = graph.roads.lines[raised]
    ends = np.vstack([shapely.get_coordinates(shapely.get_point(lines, i)) for i in (0, -1)])
    near = KDTree(graph.nodes).query_ball_point(ends, 2 * graph.snap_m + SAME_PLACE_M)
    at = np.repeat(np.arange(len(ends)), [len(nodes) for nodes in near])
    nodes = np.concatenate([np.asarray(found, dtype=np.int64) for found in near])
    levels = np.tile(graph.roads.level[raised], 2)[at]
    stride = int(np.abs(graph.roads.level).max()) * 2 + 1
    ending = np.isin(arms.node * stride + level, nodes * stride + levels)
    return (level != 0) & ~ending


def _source(graph: RoadGraph, arms: _Arms) -> Int64[np.ndarray, "arms"]:
    """Index of the road line that each arm runs on where it leaves its node."""
    points = _points_along(graph, arms, AT_NODE_M)
    tree = shapely.STRtree(graph.roads.lines)
    pairs = tree.query_nearest(points, all_matches=False)
    result = np.zeros(len(points), dtype=np.int64)
    result[pairs[0]] = pairs[1]
    return result


def _points_along(graph: RoadGraph, arms: _Arms, distance_m: float) -> np.ndarray:
    """Shapely points on the arms at a distance from their nodes, or as far as the arms reach."""
    edges, lengths = graph.edges[arms.edge], graph.lengths[arms.edge]
    pair = graph.edge_nodes[arms.edge]
    # Past the middle of a loop one would come back.
    reach = np.minimum(distance_m, np.where(pair[:, 0] == pair[:, 1], lengths / 3, lengths))
    return shapely.line_interpolate_point(edges, np.where(arms.forward, reach, lengths - reach))


def _junction_of_node(
    graph: RoadGraph, arms: _Arms
) -> tuple[Int64[np.ndarray, "nodes"], Bool[np.ndarray, "junctions"]]:
    """Number of the junction of each node (-1: none), and whether a junction has several nodes."""
    junction = np.full(len(graph.nodes), -1, dtype=np.int64)
    degree = np.bincount(arms.node, minlength=len(graph.nodes))
    meeting = np.flatnonzero(degree >= 3)
    if not len(meeting):
        return junction, np.zeros(0, dtype=bool)
    group = _tight(graph.nodes[meeting], MERGE_M)
    junction[meeting] = group
    return junction, np.bincount(group) > 1


def _tight(points: Float64[np.ndarray, "n 2"], reach_m: float) -> Int64[np.ndarray, "n"]:
    """Clusters of close points; chains longer than twice the reach are cut up.

    Along a street with a driveway every few metres all nodes hang together, but they are no
    single place: there, a node takes its free neighbours, beginning in the west.
    """
    group = clusters(points, reach_m)
    order = np.argsort(group, kind="stable")
    starts = np.searchsorted(group[order], np.arange(group.max() + 1))
    low = np.minimum.reduceat(points[order], starts, axis=0)
    high = np.maximum.reduceat(points[order], starts, axis=0)
    long = np.linalg.norm(high - low, axis=1) > 2 * reach_m
    free = long[group]
    if not free.any():
        return group
    rows = np.flatnonzero(free)
    near = KDTree(points[rows]).query_ball_point(points[rows], reach_m)
    number, taken = int(group.max()), np.zeros(len(rows), dtype=bool)
    for row in np.lexsort(points[rows].T[::-1]):
        if taken[row]:
            continue
        number += 1
        members = [member for member in near[row] if not taken[member]]
        taken[members] = True
        group[rows[members]] = number
    return np.unique(group, return_inverse=True)[1].astype(np.int64)


def _outgoing(graph: RoadGraph, arms: _Arms, junction: Int64[np.ndarray, "nodes"]) -> _Arms:
    """Arms that leave a junction, without the short links between its own nodes."""
    pair = junction[graph.edge_nodes[arms.edge]]
    inner = (pair[:, 0] == pair[:, 1]) & (graph.lengths[arms.edge] < 3 * MERGE_M)
    return arms.chosen((junction[arms.node] >= 0) & ~inner)


def _azimuths(graph: RoadGraph, arms: _Arms, distance_m: float) -> Float64[np.ndarray, "arms"]:
    """Grid azimuth of every arm, radians in 0 to 2 pi."""
    there = shapely.get_coordinates(_points_along(graph, arms, distance_m))
    east, north = (there - graph.nodes[arms.node]).T
    return np.arctan2(east, north) % FULL_TURN


def _distinct(
    owner: Int64[np.ndarray, "arms"], azimuths: Float64[np.ndarray, "arms"], least: float
) -> Bool[np.ndarray, "arms"]:
    """Of arms sorted by junction and azimuth, the first of each direction."""
    if not len(owner):
        return np.zeros(0, dtype=bool)
    begins = np.concatenate([[True], np.diff(owner) != 0])
    first = np.flatnonzero(begins)
    last = np.concatenate([first[1:], [len(owner)]]) - 1
    before = np.concatenate([[0.0], azimuths[:-1]])
    # Round the circle: before the first direction comes the last one.
    before[first] = azimuths[last] - FULL_TURN
    alone = np.zeros(len(owner), dtype=bool)
    alone[first[first == last]] = True
    return (azimuths - before >= least) | alone


def _places(
    graph: RoadGraph, junction: Int64[np.ndarray, "nodes"], count: int
) -> Float64[np.ndarray, "junctions 2"]:
    """Middle of the nodes of each junction."""
    members = junction >= 0
    if not count:
        return np.zeros((0, 2))
    origin = graph.nodes[members][0]
    sums = [
        np.bincount(junction[members], weights=axis, minlength=count)
        for axis in (graph.nodes[members] - origin).T
    ]
    number = np.bincount(junction[members], minlength=count)
    return np.column_stack(sums) / number[:, None] + origin


def _is_allowed(
    places: Float64[np.ndarray, "n 2"], bounds: Bounds | None, mask: BaseGeometry | None
) -> Bool[np.ndarray, "n"]:
    """Within the bounds and outside the mask."""
    allowed = np.ones(len(places), dtype=bool)
    if bounds is not None:
        west, south, east, north = bounds
        allowed &= ((places >= (west, south)) & (places <= (east, north))).all(axis=1)
    if mask is not None and not mask.is_empty:
        shapely.prepare(mask)
        allowed &= ~shapely.contains_xy(mask, *places.T)
    return allowed


def _with_heights(
    graph: RoadGraph, dem: Dem, found: _Found, sigmas_m: SigmasAt
) -> tuple[Junction, ...]:
    """The kept junctions with height, accuracy and what is known of their arms."""
    kept = found.kept[np.lexsort(found.places[found.kept].T[::-1])]
    places = found.places[kept]
    heights, slopes, filled = dem.heights(places), dem.slopes(places), dem.filled_at(places)
    known_m = sigmas_m(places)
    wanted = np.isin(found.owner, kept)
    source = np.zeros(len(found.owner), dtype=np.int64)
    source[wanted] = _source(graph, found.arms.chosen(wanted))
    words = np.where(graph.roads.kind == "", graph.roads.layer, graph.roads.kind)
    tracks = _is_track(graph)
    first = np.searchsorted(found.owner, kept)
    last = np.searchsorted(found.owner, kept, side="right")
    junctions: list[Junction] = []
    for row in np.flatnonzero(np.isfinite(heights)):
        own = slice(first[row], last[row])
        lines = source[own]
        change = CHANGE_M["paved" if np.count_nonzero(~tracks[lines]) >= 2 else "track"]
        east, north = (float(value) for value in places[row])
        junctions.append(
            Junction(
                junction_id=f"J{round(east * 10)}_{round(north * 10)}",
                position=np.array([east, north, heights[row]]),
                sigma_m=place_sigma_m(known_m[row], (change, CHANGE_HEIGHT_M), slopes[row]),
                degree=len(lines),
                arm_azimuths=found.azimuths[own],
                arm_kinds=tuple(str(words[line]) for line in lines),
                arm_widths_m=graph.roads.width_m[lines],
                compact=bool(found.compact[kept[row]]),
                filled=bool(filled[row]),
            )
        )
    return tuple(junctions)


def place_sigma_m(
    reference_m: Float64[np.ndarray, "2"],
    change_m: tuple[float, float],
    slope: Float64[np.ndarray, "2"],
) -> Position:
    """Standard deviations of easting, northing and height of a place of the reference, metres.

    sigma_H^2 = dem^2 + (slope sigma_xy)^2 + change^2, where the slope carries the plan into it.

    Args:
        reference_m: Standard deviation of the ortho per axis, and of the DEM.
        change_m: What the place has moved since the photos, per axis, and in height.
        slope: Rise per metre eastwards and northwards; NaN where it is unknown.
    """
    plane = float(np.hypot(reference_m[0], change_m[0]))
    steep = float(np.linalg.norm(slope)) if np.isfinite(slope).all() else USUAL_SLOPE
    height = np.sqrt(reference_m[1] ** 2 + (steep * plane) ** 2 + change_m[1] ** 2)
    return np.array([plane, plane, float(height)])


def _is_track(graph: RoadGraph) -> Bool[np.ndarray, "lines"]:
    """Which road lines are unpaved, by the words of their class and layer."""
    told = [
        f"{kind} {layer}".lower()
        for kind, layer in zip(graph.roads.kind, graph.roads.layer, strict=True)
    ]
    return np.array([any(word in text for word in TRACK_WORDS) for text in told], dtype=bool)
