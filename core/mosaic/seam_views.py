"""Photos as seams are sought in them: a pyramid of cells that all photos of a block share."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float16, Float32

from core.arrays import Mask, locked
from core.mosaic.overview import Overview
from core.raster.grid import Grid

Cells = Float32[np.ndarray, "rows columns"]
Part = tuple[slice, slice]
"""Rows and columns of the block's cells."""
# design: a flow through so many cells a side takes a few tenths of a second
COARSEST_CELLS = 80
"""Cells along the longest side of a photo in the coarsest level, at most."""
# design: eight by eight cells; smaller ones are marks and scratches that the composition fills
SMALLEST_HOLE_CELLS = 64
"""Holes in a photo smaller than this are left to the composition, cells."""


@dataclass(frozen=True, slots=True, eq=False)
class SeamView:
    """One photo in the cells of a level."""

    photo_id: str
    """The photo."""
    nadir: tuple[float, float]
    """Easting and northing below the perspective centre, metres."""
    grid: Grid
    """Where its cells lie, on multiples of their size."""
    gray: Float16[np.ndarray, "rows columns"]
    """Balanced gray values of 255, half precision; 0 where nothing is shown."""
    full: Mask
    """Cells that are shown wholly, small holes closed."""
    touched: Mask
    """Cells of which anything is shown."""
    inner: Mask
    """Full cells away from the edge of the picture."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "gray", locked(self.gray, np.float16))

    def coarser(self) -> "SeamView":
        """The same in cells twice as large; rows and columns must be even."""
        grid = self.grid
        rows, columns = grid.rows // 2, grid.columns // 2
        gray = cv2.resize(
            self.gray.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA
        )
        step = 2 * grid.ground_sample_distance_m
        return replace(
            self,
            grid=Grid(grid.west, grid.north, step, columns, rows),
            gray=np.asarray(gray).astype(np.float16),
            full=_fourfold(self.full, np.logical_and),
            touched=_fourfold(self.touched, np.logical_or),
            inner=_fourfold(self.inner, np.logical_and),
        )


@dataclass(frozen=True, slots=True, eq=False)
class SeamLevel:
    """All photos of a block in cells of one size."""

    grid: Grid
    """The block's cells."""
    views: tuple[SeamView, ...]
    """The photos."""
    places: tuple[Part, ...]
    """Where the cells of each photo lie among those of the block."""

    def window(self, number: int, part: Part) -> "tuple[Cells, Mask, Mask, Mask]":
        """Gray values, and what is full, touched and inner, of a photo over a part of the block."""
        view, place = self.views[number], self.places[number]
        shape = tuple(side.stop - side.start for side in part)
        gray = np.zeros(shape, np.float32)
        masks = np.zeros((3, *shape), np.bool_)
        low = [max(a.start, b.start) for a, b in zip(part, place, strict=True)]
        high = [min(a.stop, b.stop) for a, b in zip(part, place, strict=True)]
        if low[0] < high[0] and low[1] < high[1]:
            here = tuple(
                slice(a - side.start, b - side.start)
                for a, b, side in zip(low, high, part, strict=True)
            )
            there = tuple(
                slice(a - side.start, b - side.start)
                for a, b, side in zip(low, high, place, strict=True)
            )
            gray[here] = view.gray[there]
            for kind, its in enumerate((view.full, view.touched, view.inner)):
                masks[kind][here] = its[there]
        return gray, masks[0], masks[1], masks[2]

    def view_cost(self, number: int, part: Part) -> Cells:
        """Squared distance to a photo's nadir over a part of the block, in half its width."""
        view, cell = self.views[number], self.grid.ground_sample_distance_m
        half = max(view.grid.columns, view.grid.rows) * cell / 2
        eastings, northings = self.grid.centres()
        east = (eastings[part[1]] - view.nadir[0]) / half
        north = (northings[part[0]] - view.nadir[1]) / half
        return (north[:, None] ** 2 + east[None, :] ** 2).astype(np.float32)


def _fourfold(mask: Bool[np.ndarray, "_ _"], joined: np.ufunc) -> Bool[np.ndarray, "_ _"]:
    """Cells twice as large, of four each."""
    pairs = joined(mask[::2], mask[1::2])
    return joined(pairs[:, ::2], pairs[:, 1::2])


def seam_view(overview: Overview, gray: Cells, keep_inside_m: float) -> SeamView:
    """One photo on the finest level.

    Args:
        overview: The ortho in small.
        gray: Its balanced values, of 255; anything where nothing is shown.
        keep_inside_m: What is nearer to the edge of the picture is its rim, metres.
    """
    full = _without_small_holes(overview.full)
    padded = np.pad(full, 1).astype(np.uint8)
    away = np.asarray(cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_5))[1:-1, 1:-1]
    return SeamView(
        overview.photo_id,
        overview.nadir,
        overview.grid,
        np.where(overview.touched, gray, np.float32(0)).astype(np.float16),
        full,
        overview.touched | full,
        away > keep_inside_m / overview.grid.ground_sample_distance_m,
    )


def _without_small_holes(full: Mask) -> Mask:
    """A mask with its small holes closed; what is open to the outside is no hole."""
    count, found, figures, _ = cv2.connectedComponentsWithStats(
        (~full).astype(np.uint8), connectivity=4
    )
    if count < 2:
        return full
    numbers = np.asarray(found, dtype=np.int32)
    small = np.asarray(figures)[:, cv2.CC_STAT_AREA] < SMALLEST_HOLE_CELLS
    small[0] = False
    for edge in (numbers[0], numbers[-1], numbers[:, 0], numbers[:, -1]):
        small[edge] = False
    return full | small[numbers]


def seam_levels(views: Sequence[SeamView]) -> list[SeamLevel]:
    """All photos in cells of growing size, finest first; each level has half the cells a side."""
    longest = max(max(view.grid.columns, view.grid.rows) for view in views)
    count = 1
    while longest > COARSEST_CELLS << (count - 1):
        count += 1
    side = 1 << (count - 1)
    step = views[0].grid.ground_sample_distance_m * side
    bounds = np.array([view.grid.bounds for view in views])
    low, high = bounds.min(axis=0).tolist(), bounds.max(axis=0).tolist()
    whole = Grid.over((low[0], low[1], high[2], high[3]), step)
    level = [_padded(view, side) for view in views]
    levels: list[SeamLevel] = []
    for number in range(count):
        if number:
            level = [view.coarser() for view in level]
        cell = step / (side >> number)
        rows, columns = whole.rows * side >> number, whole.columns * side >> number
        grid = Grid(whole.west, whole.north, cell, columns, rows)
        levels.append(SeamLevel(grid, tuple(level), tuple(_place(v.grid, grid) for v in level)))
    return levels


def _padded(view: SeamView, side: int) -> SeamView:
    """A photo with empty cells about it, so that all levels have whole cells."""
    cell = view.grid.ground_sample_distance_m
    outer = Grid.over(view.grid.bounds, cell * side)
    grid = Grid(outer.west, outer.north, cell, outer.columns * side, outer.rows * side)
    place = _place(view.grid, grid)

    def put(values: np.ndarray) -> np.ndarray:
        wide = np.zeros((grid.rows, grid.columns), values.dtype)
        wide[place] = values
        return wide

    return replace(
        view,
        grid=grid,
        gray=put(view.gray),
        full=put(view.full),
        touched=put(view.touched),
        inner=put(view.inner),
    )


def _place(part: Grid, whole: Grid) -> Part:
    """Where the cells of a grid lie in another of the same cells."""
    corner = whole.grid_from_object(np.array([[part.west, part.north]]))[0]
    column, row = round(float(corner[0])), round(float(corner[1]))
    return slice(row, row + part.rows), slice(column, column + part.columns)
