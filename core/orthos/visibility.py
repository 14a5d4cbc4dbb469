"""Which pixels of an ortho its photo sees, above the heights that the ortho stands on.

On the way out from the nadir the ray to a place is free where the tangent of its angle from the
plumb line is larger than that of every place before: the angle-based method of Habib, Kim and Kim
(2007, PE&RS 73(1)). Rays are straight lines in plan through the nadir. They are sampled where they
cross the rows or columns of the heights, whichever they cross faster, so that a height is
interpolated once, between two posts, and a place is compared with its own ray alone. So a surface
that is nowhere steeper than the rays hides nothing, whatever its cells: only rounding needs a
tolerance. Frames: pixels of the ortho's grid; within a quarter about the nadir outward and sideways
from it, pixels too.
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, Float64, Shaped, UInt8
from shapely.geometry import MultiPoint, Polygon, box
from shapely.prepared import prep

from core.arrays import Flags, Mask, Position, locked
from core.frames import HALF_PIXEL
from core.orthos.bridges import BridgedHeights
from core.orthos.scan_places import LEAST_DEPTH_M, Heights, starting_spacing
from core.progress import SILENT, Progress, tracked
from core.raster.grid import Grid, Tile

# design: as the tiles of an ortho, each of which then asks for one block
BLOCK_PX = 1024
"""Side of the squares in which rays are swept; they do not depend on the tiles of an ortho."""
# design: a megabyte at a time stays in the processor's cache
RAYS_AT_ONCE = 256
# design: half of the cubic kernel, which mixes what hides a pixel into those beside it; posts know
# walls no better
RIM_PX = 1
"""Pixels beside what is hidden that are left out, too."""
# design: rounding in single precision; some millimetres of height
ROUNDING = 1e-6
"""One tangent is larger than another if it is by more than this share."""
# design: beyond half of it
SHOWN = 127
"""A pixel is hidden if the mean of the samples about it is more than this of 255."""

Depths = Float32[np.ndarray, "outward sideways"]
"""Below the perspective centre, metres; NaN where no height is known."""
Line = Float64[np.ndarray, "_"]
"""Places along an axis, or slopes of rays."""
Block = tuple[int, int]
"""Column and row of a block, counted in blocks."""
Extent = tuple[float, float, float, float]
"""First column and row, last column and row, pixels."""


@dataclass(frozen=True, slots=True)
class Relief:
    """What must be known of a block before rays are swept."""

    lowest: float
    """Lowest height, metres."""
    highest: float
    """Highest height, metres."""
    steepest: float
    """Rise over run at most."""


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What one photo sees of the pixels of a grid."""

    centre: Position
    """Perspective centre, metres."""
    heights: Heights
    """What rays must stay above."""
    grid: Grid
    """The ortho's pixels."""
    reliefs: dict[Block, Relief]
    """Of blocks that the photo may look at or over."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", locked(self.centre))

    @property
    def nadir(self) -> tuple[float, float]:
        """Column and row below the perspective centre."""
        column, row = self.grid.grid_from_object(self.centre[None, :2])[0].tolist()
        return column, row

    def seen(self, tile: Tile) -> Mask:
        """True where nothing hides a pixel of a part of the grid nor one beside it.

        Where no height is known nothing hides. Rays count as straight: what air and Earth bend them
        over the length of a shadow is not seen.
        """
        column, row, columns, rows = tile
        found = np.ones((rows, columns), dtype=bool)
        for block in _blocks_over((column, row, column + columns, row + rows)):
            reach = self._reach(block)
            if reach is None:
                continue
            hidden = self._hidden(block, reach)
            left, top = block[0] * BLOCK_PX - column, block[1] * BLOCK_PX - row
            here = found[max(top, 0) : top + BLOCK_PX, max(left, 0) : left + BLOCK_PX]
            there = hidden[max(-top, 0) :, max(-left, 0) :]
            here &= ~there[: here.shape[0], : here.shape[1]]
        return found

    def _hidden(self, block: Block, reach: float) -> Mask:
        """True where a pixel of a block is hidden by something within a reach, pixels, and beside.

        As far as the block lies on the grid.
        """
        first, top, last, bottom = _extent_of(block)
        last, bottom = min(last, self.grid.columns), min(bottom, self.grid.rows)
        shown = (first - RIM_PX, top - RIM_PX, last + RIM_PX, bottom + RIM_PX)
        hidden = np.zeros((int(shown[3] - shown[1]), int(shown[2] - shown[0])), dtype=bool)
        turns = ((0, 1), (0, -1), (1, 1), (1, -1))
        every = [_quarter(shown, self.nadir, axis, sign) for axis, sign in turns]
        quarters = [quarter for quarter in every if quarter is not None]
        needed = np.array([quarter.needed(reach) for quarter in quarters])
        low, high = needed[:, :2].min(axis=0).tolist(), needed[:, 2:].max(axis=0).tolist()
        extent = (low[0], low[1], high[0], high[1])
        heights, step = _posts_in(self.heights, self.grid, extent)
        nodes = _nodes_over(extent, step)
        depths = self._depths(heights, nodes, step)
        for quarter in quarters:
            _sweep(quarter, reach, (depths, nodes, step), hidden)
        side = 2 * RIM_PX + 1
        wide = cv2.dilate(hidden.view(np.uint8), np.ones((side, side), np.uint8))
        inner = np.s_[RIM_PX : len(hidden) - RIM_PX, RIM_PX : hidden.shape[1] - RIM_PX]
        return np.asarray(wide)[inner] > 0

    def _depths(self, heights: Heights, nodes: Tile, step: int) -> Float32[np.ndarray, "r c"]:
        """How far below the perspective centre the heights at nodes lie, metres; NaN if unknown."""
        depths = float(self.centre[2]) - heights.on(_grid_of(self.grid, nodes, step))
        return np.where(depths > LEAST_DEPTH_M, depths, np.nan).astype(np.float32)

    def relief(self, block: Block) -> Relief | None:
        """The relief of a block and to the next posts about it; None where no height is known.

        Every other node is looked at, unless heights are finer than pixels, as at bridges.
        """
        size = np.array([self.grid.columns, self.grid.rows])
        low, high = np.minimum(self.nadir, 0), np.maximum(self.nadir, size)
        edges = np.clip(np.reshape(_extent_of(block), (2, 2)), low, high).ravel().tolist()
        extent = (edges[0], edges[1], edges[2], edges[3])
        heights, step = _posts_in(self.heights, self.grid, extent)
        ratio = heights.ground_sample_distance_m / self.grid.ground_sample_distance_m
        step *= 2 if ratio >= 1 - ROUNDING else 1
        depths = self._depths(heights, _nodes_over(extent, step), step)
        known = depths[np.isfinite(depths)]
        if not known.size:
            return None
        rises = [np.abs(np.diff(depths, axis=axis)).ravel() for axis in (0, 1)]
        most = [float(np.fmax.reduce(rise, initial=0.0)) for rise in rises]
        steepest = float(np.hypot(most[0], most[1])) / (step * self.grid.ground_sample_distance_m)
        top = float(self.centre[2])
        return Relief(top - float(known.max()), top - float(known.min()), steepest)

    def _reach(self, block: Block) -> float | None:
        """How far inward something may hide a place of a block, pixels; None where nothing does.

        A slope that falls outward, less steeply than its rays, hides nothing.
        """
        own = self.reliefs.get(block)
        if own is None:
            return None
        farthest = _farthest(_extent_of(block), self.nadir)
        depth = max(float(self.centre[2]) - own.lowest, LEAST_DEPTH_M)
        between, reach = list(self.reliefs.values()), farthest
        for _ in range(2):
            # First as if the highest place of all stood nearby, then with what does.
            top = max(relief.highest for relief in between)
            reach = min(farthest * max(top - own.lowest, 0.0) / depth, farthest)
            near = _blocks_over(_inward(_extent_of(block), self.nadir, reach))
            between = [self.reliefs[one] for one in near if one in self.reliefs]
        top = max(relief.highest for relief in between)
        steepest = max(relief.steepest for relief in between)
        run = farthest * self.grid.ground_sample_distance_m
        return reach if steepest * run >= float(self.centre[2]) - top else None


def look_down(
    centre: Position,
    heights: Heights,
    grid: Grid,
    footprint: Polygon,
    *,
    threads: int = 1,
    progress: Progress = SILENT,
) -> Sight:
    """Look over the relief that stands between a photo and its footprint.

    Args:
        centre: Perspective centre of the photo, metres.
        heights: Those that its ortho stands on, metres.
        grid: Pixels of the ortho.
        footprint: What of the ground it shows, in the block's CRS.
        threads: Blocks looked at side by side.
        progress: Told after every block; may raise `Cancelled`.
    """
    sight = Sight(centre, heights, grid, {})
    east, north = centre[:2].tolist()
    between = MultiPoint([*footprint.exterior.coords, (east, north)]).convex_hull
    west, south, right, top = between.bounds
    (first, above), (last, below) = grid.grid_from_object(
        np.array([[west, top], [right, south]])
    ).tolist()
    over = prep(between)
    blocks = [
        block
        for block in _blocks_over((first, above, last, below))
        if over.intersects(box(*_grid_of(grid, _whole(_extent_of(block)), 1).bounds))
    ]
    with ThreadPoolExecutor(threads) as pool:
        found = tracked(pool.map(sight.relief, blocks), len(blocks), progress)
        for block, relief in zip(blocks, found, strict=True):
            if relief is not None:
                sight.reliefs[block] = relief
    return sight


def hidden_places(
    centre: Position, heights: Heights, places: Float64[np.ndarray, "n 2"], step_m: float
) -> Flags:
    """Whether something hides single places, sampled along their whole rays.

    Args:
        centre: Perspective centre, metres.
        heights: What rays must stay above, metres.
        places: Easting and northing.
        step_m: From one sample to the next, metres.
    """
    found = np.zeros(len(places), dtype=bool)
    for number, place in enumerate(places):
        away = place - centre[:2]
        run = float(np.hypot(*away))
        outward = np.arange(run, 0, -step_m)
        along = centre[:2] + outward[:, None] * (away / max(run, step_m))
        tangents = outward / (float(centre[2]) - heights.heights(along))
        found[number] = bool((tangents[1:] > tangents[:1] * (1 + ROUNDING)).any())
    return found


@dataclass(frozen=True, slots=True)
class _Quarter:
    """The part of an extent where rays run along one axis more than along the other."""

    extent: Extent
    nadir: tuple[float, float]
    axis: int
    """0: outward is along rows, to the east or west; 1: along columns."""
    sign: int
    near: float
    """From the nadir along the axis, pixels."""
    far: float
    left: float
    """Sideways over outward, of the first ray."""
    right: float

    def turned(self, raster: Shaped[np.ndarray, "r c"]) -> Shaped[np.ndarray, "o s"]:
        """A raster with outward down its rows and sideways along them; a view."""
        lines = raster if self.axis else raster.T
        return lines if self.sign > 0 else lines[::-1]

    def needed(self, reach: float) -> Extent:
        """What rays pass within a reach, and to the next pixels about it."""
        begin = max(self.near - reach, 0.0)
        sides = [slope * run for slope in (self.left, self.right) for run in (begin, self.far)]
        ends = sorted(self.nadir[self.axis] + self.sign * run for run in (begin, self.far))
        across = [self.nadir[1 - self.axis] + side for side in (min(sides), max(sides))]
        (first, last), (top, bottom) = (across, ends) if self.axis else (ends, across)
        return first - 1, top - 1, last + 1, bottom + 1

    def places_of(self, nodes: Tile, step: int) -> tuple[Line, Line]:
        """Where nodes lie outward and sideways of the nadir, pixels, both rising."""
        column, row, columns, rows = nodes
        lines = [
            (start + np.arange(count) + HALF_PIXEL) * step - origin
            for start, count, origin in zip((column, row), (columns, rows), self.nadir, strict=True)
        ]
        outward = self.sign * lines[self.axis]
        return outward if self.sign > 0 else outward[::-1], lines[1 - self.axis]

    def fan(self, step: int) -> Line:
        """Rays, sideways over outward, no farther apart than posts where the block ends."""
        count = int(np.ceil((self.right - self.left) * self.far / step)) + 1
        return np.linspace(self.left, self.right, max(count, 2))

    def mark(
        self,
        hidden: Mask,
        shadow: UInt8[np.ndarray, "outward rays"],
        posts: tuple[float, int],
        fan: Line,
    ) -> None:
        """Mark pixels of the block by the samples of rays about them.

        Args:
            hidden: The block.
            shadow: 255 where a sample of a ray is hidden.
            posts: Where the first samples lie outward, and their spacing, pixels.
            fan: The rays.
        """
        pixels = _whole(self.extent)
        outward, sideways = self.places_of(pixels, 1)
        within = (outward > 0) & (outward >= self.near - 1)
        run = outward[within, None]
        place = ((sideways / run - fan[0]) / (fan[1] - fan[0])).astype(np.float32)
        line = np.broadcast_to((run - posts[0]) / posts[1], place.shape).astype(np.float32)
        found = cv2.remap(shadow, place, line, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        block = self.turned(hidden)
        block[within] |= (np.asarray(found) > SHOWN) & (np.abs(sideways) <= run)


@dataclass(frozen=True, slots=True, eq=False)
class _Fall:
    """How the surface of a quarter falls below the perspective centre."""

    depths: Depths
    outward: Line
    first: float
    """Sideways of the first post."""
    step: int

    def shadow(self, fan: Line) -> UInt8[np.ndarray, "outward rays"]:
        """255 where a sample of a ray is hidden by one before it."""
        found = np.zeros((len(self.outward), len(fan)), dtype=np.uint8)
        for start in range(0, len(fan), RAYS_AT_ONCE):
            rays = np.s_[start : start + RAYS_AT_ONCE]
            tangents = self.outward[:, None].astype(np.float32) / self._along(fan[rays])
            largest = np.fmax.accumulate(tangents, axis=0)
            behind = largest[:-1] > tangents[1:] * np.float32(1 + ROUNDING)
            found[1:, rays] = behind.view(np.uint8) * np.uint8(255)
        return found

    def _along(self, fan: Line) -> Depths:
        """Depths of rays, linear between the two posts beside them."""
        lines, across = self.depths.shape
        place = (self.outward[:, None] * fan - self.first) / self.step
        before = np.clip(place.astype(np.int64), 0, across - 2)
        share = (place - before).astype(np.float32)
        before += (np.arange(lines) * across)[:, None]
        one, other = self.depths.take(before), self.depths.take(before + 1)
        other -= one
        other *= share
        one += other
        return one


def _sweep(quarter: _Quarter, reach: float, posts: tuple[Depths, Tile, int], hidden: Mask) -> None:
    """Mark what is hidden of the part of a block that lies in a quarter.

    Args:
        quarter: The part.
        reach: How far inward something may hide it, pixels.
        posts: Depths, rows from the north, the nodes they stand at and their spacing.
        hidden: The block.
    """
    depths, (column, row, _, _), step = posts
    nodes = _nodes_over(quarter.needed(reach), step)
    left, top = nodes[0] - column, nodes[1] - row
    part = quarter.turned(depths[top : top + nodes[3], left : left + nodes[2]])
    outward, sideways = quarter.places_of(nodes, step)
    beyond, fan = outward > 0, quarter.fan(step)
    fall = _Fall(np.ascontiguousarray(part[beyond]), outward[beyond], sideways[0], step)
    quarter.mark(hidden, fall.shadow(fan), (float(fall.outward[0]), step), fan)


def _quarter(extent: Extent, nadir: tuple[float, float], axis: int, sign: int) -> _Quarter | None:
    """The part of an extent in a quarter about the nadir; None where it has none."""
    ends = sorted(sign * (extent[axis + k] - nadir[axis]) for k in (0, 2))
    low, high = (extent[1 - axis + k] - nadir[1 - axis] for k in (0, 2))
    beside = max(low, -high, 0.0)
    near, far = max(ends[0], beside), ends[1]
    if near >= far:
        return None
    # design: a place below the nadir itself lies on every ray
    least = max(near, 1e-6)
    left = max(low / (least if low < 0 else far), -1.0)
    right = min(high / (least if high > 0 else far), 1.0)
    return _Quarter(extent, nadir, axis, sign, near, far, left, right)


def _posts_in(heights: Heights, grid: Grid, extent: Extent) -> tuple[Heights, int]:
    """Heights over an extent, and the pixels between the posts at which they are asked."""
    if isinstance(heights, BridgedHeights):
        heights = heights.around(_grid_of(grid, _whole(extent), 1).bounds)
    # Two nodes a post, so that peaks between nodes are seen; those of a surface are broader.
    spacing = starting_spacing(heights, grid)
    return heights, min(spacing, max(spacing // 2, 2))


def _nodes_over(extent: Extent, step: int) -> Tile:
    """Column, row, columns, rows of the posts in an extent and about it."""
    first, top, last, bottom = (edge / step - HALF_PIXEL for edge in extent)
    column, row = int(np.floor(first)), int(np.floor(top))
    return column, row, int(np.ceil(last)) - column + 1, int(np.ceil(bottom)) - row + 1


def _grid_of(grid: Grid, nodes: Tile, step: int) -> Grid:
    """Nodes as the pixels of a grid; they stand in the middle of squares of pixels."""
    size = step * grid.ground_sample_distance_m
    column, row, columns, rows = nodes
    return Grid(grid.west + column * size, grid.north - row * size, size, columns, rows)


def _extent_of(block: Block) -> Extent:
    column, row = block[0] * BLOCK_PX, block[1] * BLOCK_PX
    return column, row, column + BLOCK_PX, row + BLOCK_PX


def _whole(extent: Extent) -> Tile:
    """Column, row, columns, rows of the pixels that an extent meets."""
    column, row = (int(np.floor(edge)) for edge in extent[:2])
    return column, row, int(np.ceil(extent[2])) - column, int(np.ceil(extent[3])) - row


def _blocks_over(extent: Extent) -> Iterator[Block]:
    """Blocks that an extent meets."""
    first, top = (int(np.floor(edge / BLOCK_PX)) for edge in extent[:2])
    last, bottom = (int(np.ceil(edge / BLOCK_PX)) for edge in extent[2:])
    for row in range(top, bottom):
        for column in range(first, last):
            yield column, row


def _inward(extent: Extent, nadir: tuple[float, float], reach: float) -> Extent:
    """An extent, and what lies within a reach of it towards the nadir."""
    low = (min(e, max(e - reach, n)) for e, n in zip(extent[:2], nadir, strict=True))
    high = (max(e, min(e + reach, n)) for e, n in zip(extent[2:], nadir, strict=True))
    first, top = low
    last, bottom = high
    return first, top, last, bottom


def _farthest(extent: Extent, nadir: tuple[float, float]) -> float:
    """From the nadir to the farthest corner of an extent, pixels."""
    sides = [max(abs(extent[k] - nadir[k]), abs(extent[k + 2] - nadir[k])) for k in (0, 1)]
    return float(np.hypot(sides[0], sides[1]))
