"""Known changes of a place: ground cut away and filled up, halls built, woods felled."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
import shapely
from jaxtyping import Float32
from scipy import ndimage
from shapely.geometry import LineString, Polygon

from core.arrays import Matrix, locked
from core.frames import opencv_from_pixel
from core.raster.grid import Grid
from core.synthetic.land_cover import PLAIN, House, Tract
from core.synthetic.network import Network
from core.synthetic.options import seeded
from core.synthetic.random_surfaces import Bounds, PlanPoints, Terrain

Kind = Literal["cut", "fill", "hall", "wood"]
HEIGHTS_M: dict[Kind, float] = {"cut": -6.0, "fill": 6.0, "hall": 7.0, "wood": 14.0}
"""What stands above the ground, or is dug out of it, metres."""
SIZES_M: dict[Kind, tuple[float, float]] = {
    "cut": (110.0, 54.0),
    "fill": (110.0, 54.0),
    "hall": (56.0, 26.0),
    "wood": (120.0, 100.0),
}
"""Length and width, metres."""
RUNS: dict[Kind, float] = {"cut": 2.0, "fill": 2.0, "hall": 1.0, "wood": 1.0}
"""Run of the flanks for a rise of one: rays of a wide angle still meet each of them once."""
COUNTS: dict[Kind, int] = {"cut": 2, "fill": 2, "hall": 4, "wood": 2}
"""How many there are of each between two epochs."""
STEP_M = 4.0
"""Spacing of heights where something stands on the ground, metres."""
MIDDLE = 0.27
"""Changes lie within this share of the area to either side of its middle: several photos see it."""
ASIDE_M = 12.0
"""Clear of roads, villages and of each other by so much, metres."""
TRIES = 4000


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """One change: something comes in a year, or a wood that stood before goes."""

    kind: Kind
    """What it is."""
    year: int
    """The first epoch that shows it; a wood is gone there."""
    outline: PlanPoints
    """Easting and northing of its corners, metres."""
    tone: float
    """Gray of bare soil or of a roof."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "outline", locked(self.outline))

    def stands(self, year: int) -> bool:
        """Whether it is there in a year: a wood before, all else after."""
        return (year < self.year) if self.kind == "wood" else (year >= self.year)

    @property
    def of_ground(self) -> bool:
        """Whether bare earth has changed."""
        return self.kind in ("cut", "fill")


def make_changes(
    network: Network, bounds: Bounds, years: Sequence[int], seed: int
) -> tuple[Change, ...]:
    """Changes between each epoch and the one before, clear of roads and of each other.

    Where a place has no room for all of them, the last ones are left out.

    Args:
        network: Roads and villages.
        bounds: Area that all epochs show, metres.
        years: Years of the epochs, the first one first.
        seed: Seed of the place.
    """
    rng = seeded(seed, "changes")
    roads = [LineString(line) for road in network.roads for line in (road.now, road.then)]
    blocked = shapely.STRtree(roads)
    low, high = np.array(bounds[:2]), np.array(bounds[2:])
    middle, reach = (low + high) / 2, MIDDLE * (high - low)
    wanted: list[tuple[Kind, int]] = [
        (kind, year) for year in years[1:] for kind, n in COUNTS.items() for _ in range(n)
    ]
    found: list[Change] = []
    taken: list[Polygon] = []
    for _ in range(TRIES):
        if len(found) == len(wanted):
            break
        kind, year = wanted[len(found)]
        outline = _outline(kind, middle + rng.uniform(-reach, reach), rng.uniform(0, np.pi))
        area = Polygon(outline).buffer(ASIDE_M)
        away = float(network.village_distance(outline).min())
        if away < 2 * ASIDE_M or any(area.intersects(other) for other in taken):
            continue
        if len(blocked.query(area, "intersects")):
            continue
        found.append(Change(kind, year, outline, float(rng.uniform(160.0, 205.0))))
        taken.append(area)
    return tuple(found)


def _outline(kind: Kind, middle: PlanPoints | np.ndarray, turn: float) -> PlanPoints:
    long, wide = SIZES_M[kind]
    if kind == "wood":
        angles = np.arange(24) * (2 * np.pi / 24)
        corners = np.column_stack([np.cos(angles) * long, np.sin(angles) * wide]) / 2
    else:
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (long / 2, wide / 2)
    turned = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return middle + corners @ turned


def terrain_in(
    terrain: Terrain, changes: Iterable[Change], year: int, *, bare: bool = False
) -> Terrain:
    """The terrain with what stands on it in a year, in fine steps.

    Args:
        terrain: The ground without any change.
        changes: All of them.
        year: The epoch.
        bare: Leave out what is no ground: halls and woods.
    """
    grid = Grid.over(terrain.grid.bounds, STEP_M)
    heights = terrain.on(grid) + risen(grid, changes, year, bare=bare)
    return Terrain(grid, ndimage.spline_filter(heights, order=3, mode="nearest"))


def risen(grid: Grid, changes: Iterable[Change], year: int, *, bare: bool = False) -> Matrix:
    """Height of what has changed above the ground without it, on a grid, metres."""
    result = np.zeros((grid.rows, grid.columns))
    for change in changes:
        if change.stands(year) and (change.of_ground or not bare):
            height = HEIGHTS_M[change.kind]
            window, share = _share_of_full(grid, change, RUNS[change.kind] * abs(height))
            result[window] += height * share
    return result


def _share_of_full(
    grid: Grid, change: Change, run_m: float
) -> tuple[tuple[slice, slice], Float32[np.ndarray, "_ _"]]:
    """Part of a grid about a change, and there 0 outside to 1 where it has its full height."""
    low, high = change.outline.min(axis=0), change.outline.max(axis=0)
    part = grid.covering((float(low[0]), float(low[1]), float(high[0]), float(high[1])), 2)
    # As corners are seldom on middles of cells, the distance is measured to the outline itself.
    east, north = np.meshgrid(*part.centres())
    points = shapely.points(east.ravel(), north.ravel())
    area = Polygon(change.outline)
    inside = shapely.contains_xy(area, east.ravel(), north.ravel())
    depth = np.where(inside, shapely.distance(points, area.exterior), 0.0)
    share = np.clip(depth / run_m, 0.0, 1.0).reshape(east.shape).astype(np.float32)
    left, top = np.rint(grid.grid_from_object(np.array([[part.west, part.north]]))[0]).astype(int)
    return np.s_[top : top + part.rows, left : left + part.columns], share


def halls_in(changes: Iterable[Change], year: int) -> list[House]:
    """The halls that stand in a year."""
    return [
        House(change.outline, HEIGHTS_M["hall"], change.tone, False)
        for change in changes
        if change.kind == "hall" and change.stands(year)
    ]


def soil_in(changes: Iterable[Change], year: int) -> list[Tract]:
    """Bare soil where ground was cut away or filled up by a year."""
    return [
        Tract(
            change.outline,
            "arable",
            2 * PLAIN + 1,
            0.0,
            (1.0, 0.0),
            change.tone,
            0.6,
            1.6,
            (1.1, 0.98, 0.84),
        )
        for change in changes
        if change.of_ground and change.stands(year)
    ]


def with_woods(
    wood: Float32[np.ndarray, "_ _"], grid: Grid, changes: Iterable[Change], year: int
) -> Float32[np.ndarray, "_ _"]:
    """Share of wood on a grid with the woods that still stand in a year."""
    result = wood.copy()
    for change in changes:
        if change.kind == "wood" and change.stands(year):
            corners = opencv_from_pixel(grid.grid_from_object(change.outline)).round()
            cv2.fillPoly(result, [corners.astype(np.int32)], 1.0)
    return result
