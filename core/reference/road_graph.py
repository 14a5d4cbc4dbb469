"""The road network as a planar graph: lines of any layer cut where they meet, ends joined.

Nodes are found by distance (union-find over neighbours), never by rounding coordinates: two ends
a millimetre apart are one node wherever they lie. Parallel edges stay apart.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Bool, Float64, Int64
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from core.arrays import locked
from core.formats.roads import Roads
from core.geometry.crs import SAME_PLACE_M

PlanePoints = Float64[np.ndarray, "n 2"]
"""Easting and northing, metres."""
NodePairs = Int64[np.ndarray, "edges 2"]
"""First and last node of every edge."""
# design: layers of one survey meet to decimetres; no two crossings are that close.
SNAP_M = 0.5
"""Ends closer than this to each other or to a line meet it: how well layers fit each other."""
VERTEX_M = 1e-9  # design: a nanometre, the rounding of coordinates of a million metres.
"""No vertex is put nearer to the end of a line, so that ends stay ends."""


@dataclass(frozen=True, slots=True, eq=False)
class RoadGraph:
    """An undirected multigraph: between two nodes there may be several edges, also loops."""

    roads: Roads
    """The lines it was made of."""
    nodes: PlanePoints
    """Places where edges end, metres."""
    edges: np.ndarray
    """Shapely LineStrings; no two meet but in nodes, and no node joins only two."""
    edge_nodes: NodePairs
    """The nodes each edge leads from and to."""
    lengths: Float64[np.ndarray, "edges"]
    """Length of each edge, metres."""
    crossing: Bool[np.ndarray, "nodes"]
    """True where no line of the layers ends: lines only run through each other."""
    snap_m: float
    """Distance that counted as meeting, metres."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", locked(self.nodes))
        object.__setattr__(self, "edge_nodes", locked(self.edge_nodes, np.int64))

    @property
    def degrees(self) -> Int64[np.ndarray, "nodes"]:
        """Number of edge ends at each node; a loop counts twice."""
        return np.bincount(self.edge_nodes.ravel(), minlength=len(self.nodes)).astype(np.int64)


def planar_graph(roads: Roads, snap_m: float = SNAP_M) -> RoadGraph:
    """Make any lines planar.

    Ends that nearly touch another end or line are drawn to it, lines are cut at all
    intersections, and pieces that only continue each other become one edge.

    Args:
        roads: Lines with attributes, from any number of layers.
        snap_m: Distance below which an end meets, metres.
    """
    lines, ends = _join_ends(roads.lines, snap_m)
    if not len(lines):
        return _empty(roads, snap_m)
    pieces = shapely.get_parts(shapely.unary_union(lines))
    pieces = _with_clustered_nodes(pieces, snap_m)
    edges = shapely.get_parts(shapely.line_merge(shapely.multilinestrings(pieces)))
    nodes, edge_nodes = _number_nodes(edges)
    distance = KDTree(ends).query(nodes, distance_upper_bound=max(snap_m, SAME_PLACE_M))[0]
    return RoadGraph(
        roads, nodes, edges, edge_nodes, shapely.length(edges), ~np.isfinite(distance), snap_m
    )


def clusters(points: PlanePoints, reach_m: float) -> Int64[np.ndarray, "n"]:
    """Number of each point's cluster; a cluster is what links shorter than the reach connect."""
    pairs = KDTree(points).query_pairs(reach_m, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(len(points), len(points)))
    return connected_components(links, directed=False)[1].astype(np.int64)


def _empty(roads: Roads, snap_m: float) -> RoadGraph:
    """The graph of no roads."""
    return RoadGraph(
        roads,
        np.zeros((0, 2)),
        np.empty(0, dtype=object),
        np.zeros((0, 2), dtype=np.int64),
        np.zeros(0),
        np.zeros(0, dtype=bool),
        snap_m,
    )


def _join_ends(lines: np.ndarray, snap_m: float) -> tuple[np.ndarray, PlanePoints]:
    """The lines with ends drawn to each other and to lines they nearly touch; where they end."""
    lines = lines[shapely.length(lines) > 0]
    if not len(lines):
        return lines, np.zeros((0, 2))
    ends = np.vstack([_end_points(lines, 0), _end_points(lines, -1)])
    cluster = clusters(ends, snap_m)
    places = _means(ends, cluster)
    places, line, measure, at = _meetings(lines, cluster, places, snap_m)
    lines = _with_vertices(_with_ends(lines, places[cluster]), line, measure, places[at])
    return lines[shapely.length(lines) > 0], places


def _end_points(lines: np.ndarray, index: int) -> PlanePoints:
    """First (0) or last (-1) point of every line."""
    return shapely.get_coordinates(shapely.get_point(lines, index))


def _means(
    points: PlanePoints, cluster: Int64[np.ndarray, "n"]
) -> Float64[np.ndarray, "clusters 2"]:
    """Middle of every cluster."""
    count = np.bincount(cluster)
    # About one of the points: sums of seven-digit coordinates would lose what is to be kept.
    origin = points[0]
    sums = [np.bincount(cluster, weights=axis) for axis in (points - origin).T]
    return np.column_stack(sums) / count[:, None] + origin


def _meetings(
    lines: np.ndarray, cluster: Int64[np.ndarray, "ends"], places: PlanePoints, snap_m: float
) -> tuple[PlanePoints, Int64[np.ndarray, "k"], Float64[np.ndarray, "k"], Int64[np.ndarray, "k"]]:
    """Where ends nearly touch the course of another line.

    Returns:
        The clusters of ends, moved onto the nearest line they touch; then for every meeting the
        line, how far along it (metres), and the cluster.
    """
    tree = shapely.STRtree(lines)
    at, line = tree.query(shapely.points(places), predicate="dwithin", distance=snap_m)
    count = len(lines)
    own = (cluster[line] == at) | (cluster[count + line] == at)
    at, line = at[~own], line[~own]
    points = shapely.points(places[at])
    measure = shapely.line_locate_point(lines[line], points)
    distance = shapely.distance(lines[line], points)
    # The nearest line is met where it runs; others near are drawn to that same place.
    order = np.lexsort((distance, at))
    first = order[np.concatenate([[True], np.diff(at[order]) > 0])] if len(at) else order
    moved = places.copy()
    moved[at[first]] = shapely.get_coordinates(
        shapely.line_interpolate_point(lines[line[first]], measure[first])
    )
    return moved, line.astype(np.int64), measure, at.astype(np.int64)


def _with_ends(lines: np.ndarray, ends: PlanePoints) -> np.ndarray:
    """The lines with other first and last points (all first ones, then all last ones)."""
    coordinates = shapely.get_coordinates(lines)
    last = np.cumsum(shapely.get_num_coordinates(lines)) - 1
    first = np.concatenate([[0], last[:-1] + 1])
    coordinates[first], coordinates[last] = ends[: len(lines)], ends[len(lines) :]
    return shapely.set_coordinates(lines.copy(), coordinates)


def _with_vertices(
    lines: np.ndarray,
    line: Int64[np.ndarray, "k"],
    measure: Float64[np.ndarray, "k"],
    points: PlanePoints,
) -> np.ndarray:
    """The lines with further vertices, each on one line at a distance along it."""
    if not len(line):
        return lines
    touched, inverse = np.unique(line, return_inverse=True)
    coordinates, owner = shapely.get_coordinates(lines[touched], return_index=True)
    step = np.r_[0.0, np.linalg.norm(np.diff(coordinates, axis=0), axis=1)]
    along = np.cumsum(step)
    first = np.searchsorted(owner, np.arange(len(touched)))
    along -= along[first][owner]
    # Ends stay ends, whatever rounding says of a vertex close to them.
    length = np.maximum.reduceat(along, first)
    inner = np.clip(measure, VERTEX_M, np.maximum(length[inverse] - VERTEX_M, VERTEX_M))
    owners = np.concatenate([owner, inverse])
    order = np.lexsort((np.concatenate([along, inner]), owners))
    merged = np.vstack([coordinates, points])[order]
    result = lines.copy()
    result[touched] = shapely.linestrings(merged, indices=owners[order])
    return shapely.remove_repeated_points(result)


def _with_clustered_nodes(pieces: np.ndarray, snap_m: float) -> np.ndarray:
    """Pieces whose ends lie close together end in one point; splinters within one vanish."""
    ends = np.vstack([_end_points(pieces, 0), _end_points(pieces, -1)])
    cluster = clusters(ends, snap_m)
    count = len(pieces)
    splinter = (cluster[:count] == cluster[count:]) & (shapely.length(pieces) < 2 * snap_m)
    moved = _with_ends(pieces, _means(ends, cluster)[cluster])
    return moved[~splinter & (shapely.length(moved) > 0)]


def _number_nodes(edges: np.ndarray) -> tuple[PlanePoints, NodePairs]:
    """Nodes of edges whose ends agree to the last digit."""
    ends = np.vstack([_end_points(edges, 0), _end_points(edges, -1)])
    nodes, number = np.unique(ends, axis=0, return_inverse=True)
    return nodes, np.ascontiguousarray(number.reshape(2, -1).T).astype(np.int64)
