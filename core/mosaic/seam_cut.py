"""Seams where two photos agree: a minimal cut through the differences of neighbours.

Every cell of the block gets the photo that shows it. The labels begin with the nearest nadir; then
two neighbours at a time divide anew what both show (alpha-beta swap: Boykov, Veksler and Zabih
2001) by the minimal cut through their differences of gray and gradient, coarse to fine in a band
about the seam. Buildings repel seams, woods and water lengthen their way, roads and field edges
attract them, and a steep view of the ground is a mild wish.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import shapely
from jaxtyping import Float32, Int16
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order, maximum_flow
from shapely.geometry.base import BaseGeometry

from core.arrays import Flags, Mask
from core.mosaic.overview import Cells, Part, SeamLevel, SeamView, seam_levels
from core.progress import SILENT, Progress
from core.raster.grid import Grid, burn

Labels = Int16[np.ndarray, "_ _"]
"""Number of the photo that shows each cell, -1 where none does."""
Edges = tuple[Float32[np.ndarray, "_ _"], Float32[np.ndarray, "_ _"]]
"""Values between each cell and the next, along rows and down columns."""

# source: METHODS 8: forbidden is what is within 5 m of a building
BUILDING_M = 5.0
"""Seams keep this distance from buildings wherever a way round exists, metres."""
# design: a road of two narrow lanes; what of it a neighbour shows shifted is still road
ROAD_M = 2.5
"""Half the width of the strip along a road's centre line in which seams are welcome, metres."""
# design: half the length of a detour to a road is won back on it
ROAD_SHARE = 0.5
"""Cost of a seam on a road as a share of that beside it."""
# design: crowns lean away from each nadir; a wood is cut where the way round is twice as long
WOOD_SHARE = 2.0
"""Cost of a seam through a wood as a share of that through fields."""
# design: waves and glints are others in each photo, even where a detail larger than a cell is alike
WATER_SHARE = 4.0
"""Cost of a seam over water as a share of that over fields."""
# design: a way round of any length within the window is shorter than a metre through a house
THROUGH_BUILDING = 1000.0
"""What a metre of seam near a building costs, metres of usual seam."""
# design: half of what two photos usually differ by; else seams would wander for nothing
LENGTH_COST = 1.0
"""Cost of a metre of seam where both photos are alike; the usual difference costs 2 more."""
# design: a seam a quarter of a photo off the bisector costs as much as the usual difference
VIEW_COST = 16.0
"""Weight of the squared distance to the nadir, in half widths of a photo."""
# design: a strip along the edge of a picture narrower than the rim is not worth a seam
RIM_COST = 0.2
"""Cost of a square metre shown from the rim of a picture, metres of seam."""
# design: costs are whole numbers for the flow; a hundredth of a metre of seam counts
UNITS_PER_METRE = 128.0
# design: more than any cut costs, and far from the largest whole number of 32 bits
UNMOVABLE = 1 << 28
# design: a seam moves by two cells of the coarser level, which saw whatever is larger
BAND_CELLS = 5
"""Half the width of the band in which a seam is laid anew on a finer level, cells."""
# design: the second takes back what the first did with a neighbour not yet moved
SWEEPS = 2
"""Rounds over all pairs on the coarsest level."""
# design: a house with its garden; a row of them
WAYS_ROUND_CELLS = (24, 64)
"""How far beside the band a way round a building is looked for, cells of the finest level."""
# design: a jump that all see; a hundred times as dear, it stays far below a building
MOST_UNLIKE = 10.0
"""Differences beyond this count as this, usual differences."""
# design: below it is rounding of 8 bits
LEAST_DIFFERENCE = 1.0
"""Usual difference of two photos at least, gray values of 255."""


@dataclass(frozen=True, slots=True, eq=False)
class SeamGuides:
    """What on the ground repels and attracts seams, in the block's CRS."""

    buildings: tuple[BaseGeometry, ...] = ()
    """Polygons that seams keep away from."""
    roads: tuple[BaseGeometry, ...] = ()
    """Centre lines along which seams are welcome."""
    woods: tuple[BaseGeometry, ...] = ()
    """Polygons that seams cross where nothing shorter leads round."""
    water: tuple[BaseGeometry, ...] = ()
    """Polygons that seams cross still less."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelledGround:
    """Which photo shows which cell."""

    grid: Grid
    """Where the cells lie."""
    labels: Labels
    """Number of the photo by cell."""


def label_ground(
    views: Sequence[SeamView],
    guides: SeamGuides = SeamGuides(),
    *,
    by_nadir: bool = False,
    progress: Progress = SILENT,
) -> LabelledGround:
    """Say which photo shows which cell; every cell of which a photo shows anything gets one.

    Args:
        views: The photos, in cells of one size on multiples of it.
        guides: What seams keep away from and what they follow.
        by_nadir: Leave it at the nearest nadir, for comparison.
        progress: Told per pair of photos; may raise `Cancelled`.
    """
    levels = seam_levels(views)
    if by_nadir:
        return LabelledGround(levels[0].grid, _begin(levels[0], _nobody(levels[0].grid)))
    labels = _nobody(levels[-1].grid)
    for number, level in enumerate(reversed(levels)):
        coarsest = number == 0
        if not coarsest:
            labels = np.repeat(np.repeat(labels, 2, axis=0), 2, axis=1)
        labels = _begin(level, labels)
        ground = _Ground(level, labels, *_guiding(level.grid, guides))
        pairs = list(_meeting(labels)) * (SWEEPS if coarsest else 1)
        for done, (first, second) in enumerate(pairs):
            share = (number + done / len(pairs)) / len(levels)
            progress.report(share, 1.0, "seams")
            _divide_anew(ground, first, second, None if coarsest else BAND_CELLS)
        if number == len(levels) - 1 and len(guides.buildings):
            _go_round(ground)
    return LabelledGround(levels[0].grid, labels)


@dataclass(frozen=True, slots=True, eq=False)
class _Ground:
    """One level while its seams are sought; the labels change."""

    level: SeamLevel
    labels: Labels
    built: Cells
    """Share of each cell that is near a building."""
    kind: Cells
    """Share of the usual cost of a seam, by the kind of the ground."""


def _nobody(grid: Grid) -> Labels:
    return np.full((grid.rows, grid.columns), -1, np.int16)


def _begin(level: SeamLevel, labels: Labels) -> Labels:
    """Labels that stand where their photo shows the whole cell; elsewhere the best photo."""
    begun, whole = _nobody(level.grid), np.zeros(labels.shape, np.bool_)
    best = np.full(labels.shape, np.inf, np.float32)
    rim = np.float32(len(level.views) and 1e3)
    for number, place in enumerate(level.places):
        _, full, touched, inner = level.window(number, place)
        cost = level.view_cost(number, place)
        # The inside of any photo goes before the rim of another, and that before half a cell.
        cost = cost + np.where(inner, np.float32(0), np.where(full, rim, 2 * rim))
        better = touched & (cost < best[place])
        begun[place][better] = number
        best[place][better] = cost[better]
        whole[place] |= full & (labels[place] == number)
    return np.where(whole, labels, begun)


def _guiding(grid: Grid, guides: SeamGuides) -> tuple[Cells, Cells]:
    """Share of each cell near buildings, and what of the usual cost a seam has on its kind."""
    cell = grid.ground_sample_distance_m
    near = shapely.buffer(np.array(guides.buildings, dtype=object), BUILDING_M + cell / 2)
    built = burn(((shape, 1) for shape in near), grid, empty=0, touched=True)
    roads = shapely.buffer(np.array(guides.roads, dtype=object), max(ROAD_M, cell / 2))
    share = np.ones(built.shape, np.float32)
    # A pond in a wood is water, and a road through either is a road.
    for shapes, cost in (
        (guides.woods, WOOD_SHARE),
        (guides.water, WATER_SHARE),
        (roads, ROAD_SHARE),
    ):
        share[burn(((shape, 1) for shape in shapes), grid, empty=0) > 0] = cost
    return built.astype(np.float32), share


def _meeting(labels: Labels) -> Iterator[tuple[int, int]]:
    """Pairs of photos that have cells side by side, in order."""
    codes, count = set[tuple[int, int]](), int(labels.max(initial=0)) + 1
    for one, other in ((labels[:, :-1], labels[:, 1:]), (labels[:-1], labels[1:])):
        seam = (one != other) & (one >= 0) & (other >= 0)
        low, high = np.minimum(one[seam], other[seam]), np.maximum(one[seam], other[seam])
        found = np.unique(low.astype(np.int64) * count + high).tolist()
        codes.update(divmod(code, count) for code in found)
    yield from sorted(codes)


def _common(ground: _Ground, first: int, second: int) -> Part:
    """The part of the block that both photos may show, and a cell about it that stays."""
    places = [ground.level.places[number] for number in (first, second)]
    rows, columns = (
        slice(max(a.start, b.start, 1) - 1, min(a.stop, b.stop, size - 1) + 1)
        for a, b, size in zip(*places, ground.labels.shape, strict=True)
    )
    return rows, columns


def _divide_anew(ground: _Ground, first: int, second: int, band: int | None) -> None:
    """Let two photos divide anew what both show, in a band about their seam or everywhere."""
    part = _common(ground, first, second)
    labels = ground.labels[part]
    free = np.ones(labels.shape, np.bool_)
    if band is not None:
        near = _beside(labels, first, second)
        rows, columns = np.flatnonzero(near.any(axis=1)), np.flatnonzero(near.any(axis=0))
        if not len(rows):
            return
        # Beyond the band lies a cell that stays, so that a seam at its edge has its cost.
        part = (_stretch(part[0], rows, band + 1), _stretch(part[1], columns, band + 1))
        labels = ground.labels[part]
        free = _widened(_beside(labels, first, second), band)
    _cut(ground, first, second, part, free)


def _stretch(side: slice, found: np.ndarray, margin: int) -> slice:
    """The part of a side within a margin of what was found on it."""
    low = max(side.start, side.start + int(found[0]) - margin)
    return slice(low, min(side.stop, side.start + int(found[-1]) + 1 + margin))


def _beside(labels: Labels, first: int, second: int) -> Mask:
    """Cells of either photo that touch a cell of the other."""
    one, other = labels == first, labels == second
    found = np.zeros(labels.shape, np.bool_)
    for a, b in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        seam = (one[a] & other[b]) | (other[a] & one[b])
        found[a] |= seam
        found[b] |= seam
    return found


def _widened(mask: Mask, cells: int) -> Mask:
    kernel = np.ones((2 * cells + 1, 2 * cells + 1), np.uint8)
    return np.asarray(cv2.dilate(mask.astype(np.uint8), kernel)) > 0


def _cut(ground: _Ground, first: int, second: int, part: Part, free: Mask) -> None:
    """The minimal cut between two photos through the free cells of a part of the block."""
    labels = ground.labels[part]
    grays, fulls = [], []
    wishes: list[Cells] = []
    cell = ground.level.grid.ground_sample_distance_m
    for number in (first, second):
        gray, full, _, inner = ground.level.window(number, part)
        view = ground.level.views[number]
        half_m = max(view.grid.columns, view.grid.rows) * cell / 2
        wish = ground.level.view_cost(number, part) * np.float32(VIEW_COST / half_m)
        wishes.append(cell**2 * (wish + np.where(inner, np.float32(0), np.float32(RIM_COST))))
        grays.append(gray)
        fulls.append(full)
    pair = (labels == first) | (labels == second)
    movable = pair & free & fulls[0] & fulls[1]
    if not movable.any():
        return
    costs = _edge_costs(grays, fulls[0] & fulls[1], ground.built[part], ground.kind[part], cell)
    drawn = _flow(labels == first, labels == second, movable, wishes, costs)
    labels[movable] = np.where(drawn, first, second).astype(np.int16)


def _edge_costs(grays: list[Cells], both: Mask, built: Cells, kind: Cells, cell: float) -> Edges:
    """Cost of a seam between each cell and the next, along rows and down columns, metres."""
    slopes = [np.gradient(gray) if min(gray.shape) > 1 else [gray * 0] * 2 for gray in grays]
    apart = np.abs(grays[0] - grays[1])
    turned = np.hypot(slopes[0][0] - slopes[1][0], slopes[0][1] - slopes[1][1])
    # Squares: one jump is seen sooner than many slight differences.
    unlike = _squared_share(apart, both) + _squared_share(turned, both)
    costs: list[np.ndarray] = []
    for axis in (1, 0):
        before, after = (np.s_[:, :-1], np.s_[:, 1:]) if axis else (np.s_[:-1], np.s_[1:])
        # Along an edge that both show a seam is not seen (Kwatra et al. 2003, section 3.1).
        edge = np.minimum(*(np.abs(gray[after] - gray[before]) for gray in grays))
        edge = edge / _usual(edge, both[before] & both[after])
        cost = (LENGTH_COST + (unlike[before] + unlike[after]) / 2) / (1 + edge)
        cost = cost * (kind[before] + kind[after]) / 2
        cost = cost + THROUGH_BUILDING * np.maximum(built[before], built[after])
        costs.append((cell * cost).astype(np.float32))
    return costs[0], costs[1]


def _squared_share(values: Cells, where: Mask) -> Cells:
    """Squared differences as shares of the usual one, up to what all see."""
    return np.minimum(values / _usual(values, where), MOST_UNLIKE) ** 2


def _usual(values: np.ndarray, where: Mask) -> float:
    """The median where both photos show the ground."""
    known = values[where]
    return max(float(np.median(known)) if known.size else 0.0, LEAST_DIFFERENCE)


def _flow(ours: Mask, theirs: Mask, movable: Mask, wishes: list[Cells], costs: Edges) -> Flags:
    """For the movable cells, row by row, whether the minimal cut leaves them to the first photo."""
    count = int(movable.sum())
    nodes = np.full(movable.shape, -1, np.int64)
    nodes[movable] = np.arange(count)
    # What a cell costs with the second photo, less what it costs with the first.
    lean = np.rint((wishes[1] - wishes[0])[movable] * UNITS_PER_METRE).astype(np.int64)
    ends = np.stack([np.maximum(lean, 0), np.maximum(-lean, 0)])
    links: list[np.ndarray] = []
    for cost, (a, b) in zip(
        costs, ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])), strict=True
    ):
        weight = np.maximum(np.rint(cost * UNITS_PER_METRE), 1).astype(np.int64)
        inside = movable[a] & movable[b]
        links.append(np.stack([nodes[a][inside], nodes[b][inside], weight[inside]]))
        for here, there in ((a, b), (b, a)):
            for end, fixed in enumerate((ours, theirs)):
                border = movable[here] & fixed[there] & ~movable[there]
                np.add.at(ends[end], nodes[here][border], weight[border])
    ends = np.minimum(ends - ends.min(axis=0), UNMOVABLE)
    return _source_side(count, ends, np.concatenate(links, axis=1))


def _source_side(count: int, ends: np.ndarray, links: np.ndarray) -> Flags:
    """Which nodes stay with the source; on a tie all that can."""
    source, sink, every = count, count + 1, np.arange(count)
    rows = [links[0], links[1], np.full(count, source), every]
    columns = [links[1], links[0], every, np.full(count, sink)]
    weights = [links[2], links[2], ends[0], ends[1]]
    capacity = sparse.csr_array(
        (
            np.concatenate(weights).astype(np.int32),
            (np.concatenate(rows), np.concatenate(columns)),
        ),
        shape=(count + 2, count + 2),
    )
    flow = maximum_flow(capacity, source, sink, method="dinic").flow
    left = capacity - flow
    left.data = np.maximum(left.data, 0)
    left.eliminate_zeros()
    reached, _ = breadth_first_order(left, source, return_predecessors=True)
    stays = np.zeros(count + 2, np.bool_)
    stays[reached] = True
    return stays[:count]


def _go_round(ground: _Ground) -> None:
    """Look further for a way where a seam still passes a building."""
    for reach in WAYS_ROUND_CELLS:
        for first, second in _meeting(ground.labels):
            part = _common(ground, first, second)
            crossing = _beside(ground.labels[part], first, second) & (ground.built[part] > 0)
            count, _, figures, _ = cv2.connectedComponentsWithStats(
                _widened(crossing, 2).astype(np.uint8)
            )
            for left, top, wide, high, _ in figures[1:count].tolist():
                rows = _stretch(part[0], np.array([top, top + high - 1]), reach)
                columns = _stretch(part[1], np.array([left, left + wide - 1]), reach)
                free = np.zeros((rows.stop - rows.start, columns.stop - columns.start), np.bool_)
                free[1:-1, 1:-1] = True
                _cut(ground, first, second, (rows, columns), free)
