"""Places at which a mosaic is to be checked, drawn before anybody knows how good it is.

One place for each cell of a grid over the block's ground, with others of the same cell to follow it
where it cannot be read. Each lasts and is well defined in the reference alone
(`core.quality.lasting`): nothing here asks what the matcher can find, so the places do not favour
ground on which the program did well. Places keep away from control, which lies better than the
ground between.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import shapely
from scipy.spatial import KDTree
from shapely.geometry import Polygon, box
from shapely.geometry.base import BaseGeometry

from core.geometry.crs import Bounds, PlanePoints, shared_bounds
from core.progress import SILENT, Progress
from core.quality.job_rules import USUAL_RULES
from core.quality.lasting import AROUND_PX, FINEST_M, LastingPlaces, best_first, lasting_places
from core.raster.grid import Grid
from core.raster.ortho import Ortho
from core.reference.junctions import Junction
from core.reference.salient import TEMPLATE_PX

# source: ASPRS Positional Accuracy Standards, edition 2 (2023): thirty check points at least.
USUAL_CELLS = (6, 5)
"""Cells along the longer and the shorter side of the block."""
# source: the same: no more than 120 are asked for.
MOST_CELLS = (12, 10)
"""A grid is made no finer than this by itself."""
# design: a cell with less ground of the block is the neighbour's.
LEAST_GROUND = 0.25
"""Share of a cell that photos must show for a place to be drawn in it."""
# design: one read of a few MB whatever the ortho's pixel and the cell's size are.
PICTURE_PX = 1000
"""A cell is looked at in so many pixels a side at most."""
# design: the frame of a photo and the rim of the mosaic show nothing to compare.
RIM_M = 20.0
"""A place lies so far inside the block's ground, metres."""
# design: some of them, so that the seed and not the strongest detail decides where one looks.
DRAWN_FROM = 4
"""The places of a cell are drawn from so many of the best."""
# design: where one place of two can be read, one cell of sixteen stays without a reading.
SPARES = 3
"""Places that follow the one of a cell where it cannot be read, at most."""


@dataclass(frozen=True, slots=True)
class CheckPlace:
    """One place to be checked."""

    place_id: str
    """Its name, new in the block."""
    east: float
    """Easting, metres."""
    north: float
    """Northing, metres."""
    sigma_m: float = 0.0
    """Standard deviation per axis of a surveyed point, metres; 0 where the reference is read."""
    after: str = field(default="", metadata={"later": True})
    """The place of the same cell that it stands in for where that cannot be read."""


@dataclass(frozen=True, slots=True, eq=False)
class PlanRequest:
    """What places are drawn on."""

    ground: BaseGeometry
    """Ground that photos show, in the block's CRS."""
    ortho: Ortho
    """The reference."""
    control: PlanePoints
    """Control that is known so far, metres."""
    apart_m: float
    """A place keeps so far from control, metres."""
    seed: int
    """Decides between places that are shown equally well."""
    junctions: tuple[Junction, ...] = ()
    """Of the road network."""
    pixel_m: float = 0.0
    """Of the photos on the ground, metres: what is finer in the reference they do not show."""
    cells: tuple[int, int] | None = None
    """Columns and rows of the grid; as many as give enough places when None."""
    least: int = USUAL_RULES.readings
    """So many places are enough."""


@dataclass(frozen=True, slots=True)
class DrawnPlan:
    """Places that were drawn."""

    places: tuple[CheckPlace, ...]
    """Row by row from the north-west, each followed by its spares."""
    cells: tuple[int, int]
    """Columns and rows of the grid."""
    empty: int
    """Cells with ground of the block in which the reference shows nothing well."""

    @property
    def count(self) -> int:
        """Places without the spares."""
        return sum(not place.after for place in self.places)


def draw_places(request: PlanRequest, progress: Progress = SILENT) -> DrawnPlan:
    """Draw one place, and spares, for each cell of a grid over the block's ground.

    A grid that is not asked for is made finer until enough cells have a place.

    Args:
        request: Ground, reference, control and grid.
        progress: Told per cell.
    """
    bounds = shared_bounds(request.ground.bounds, request.ortho.bounds)
    if bounds[0] >= bounds[2] or bounds[1] >= bounds[3]:
        return DrawnPlan((), request.cells or USUAL_CELLS, 0)
    first = request.cells or _turned(USUAL_CELLS, bounds)
    offered = _offered(request, list(_cells(bounds, first)), progress)
    drawn = _draw(request, bounds, first, offered)
    finer = 1
    while request.cells is None and drawn.count < request.least:
        long, short = USUAL_CELLS[0] + finer, USUAL_CELLS[1] + finer
        if long > MOST_CELLS[0] or short > MOST_CELLS[1]:
            break
        drawn, finer = _draw(request, bounds, _turned((long, short), bounds), offered), finer + 1
    return drawn


def _offered(request: PlanRequest, cells: list[Polygon], progress: Progress) -> LastingPlaces:
    """Clear places within the block's ground and away from control, the best first."""
    inside = [cell for cell in cells if cell.intersects(request.ground)]
    seen: list[LastingPlaces] = []
    finest = max(request.ortho.ground_sample_distance_m, request.pixel_m, FINEST_M)
    west, south, east, north = cells[0].bounds
    pixel = max(finest, max(east - west, north - south) / PICTURE_PX)
    # Neighbours overlap by what the measures look at.
    margin = TEMPLATE_PX * pixel
    for done, cell in enumerate(inside):
        progress.report(done, len(inside))
        grid = Grid.over(cell.buffer(margin, join_style="mitre").bounds, pixel)
        found = lasting_places(request.ortho, grid, request.junctions)
        seen.append(found.chosen(shapely.contains_xy(cell, found.places)))
    progress.report(1, 1)
    found = best_first(seen, 2 * AROUND_PX * pixel)
    # Thirty are asked for, so the thirtieth is clear; half as clear is still shown.
    clear = np.sort(found.clearness[~found.junction])[-request.least :]
    kept = found.clearness >= clear.min(initial=np.inf) / 2
    kept &= shapely.contains_xy(request.ground.buffer(-RIM_M), found.places)
    if len(request.control):
        kept &= KDTree(request.control).query(found.places)[0] >= request.apart_m
    return found.chosen(kept)


def _draw(
    request: PlanRequest, bounds: Bounds, cells: tuple[int, int], offered: LastingPlaces
) -> DrawnPlan:
    """Places of one grid."""
    inside = [cell for cell in _cells(bounds, cells) if _is_ground(cell, request.ground)]
    found: list[PlanePoints] = []
    for number, cell in enumerate(inside):
        own = offered.chosen(shapely.contains_xy(cell, offered.places))
        # One for each cell, so that one cell does not change what is drawn in the next.
        rng = np.random.default_rng((request.seed, number))
        order = rng.permutation(min(len(own.places), DRAWN_FROM))
        roads_first = order[np.argsort(~own.junction[order], kind="stable")]
        found.append(own.places[roads_first[: 1 + SPARES]])
    kept = [places for places in found if len(places)]
    named = [one for number, places in enumerate(kept, 1) for one in _named(number, places)]
    return DrawnPlan(tuple(named), cells, len(found) - len(kept))


def _named(number: int, places: PlanePoints) -> Iterator[CheckPlace]:
    """The place of a cell, and each spare after the one that it stands in for."""
    before = ""
    for spare, (east, north) in enumerate(places.tolist()):
        name = f"{number:02d}{' abc'[spare]}".strip()
        yield CheckPlace(name, round(east, 2), round(north, 2), after=before)
        before = name


def _cells(bounds: Bounds, cells: tuple[int, int]) -> Iterator[Polygon]:
    """The cells of a grid, row by row from the north-west."""
    west, south, east, north = bounds
    across = np.linspace(west, east, cells[0] + 1)
    down = np.linspace(north, south, cells[1] + 1)
    for high, low in pairwise(down):
        for left, right in pairwise(across):
            yield box(left, low, right, high)


def _is_ground(cell: Polygon, ground: BaseGeometry) -> bool:
    """Whether photos show enough of a cell."""
    return cell.intersection(ground).area >= LEAST_GROUND * cell.area


def _turned(cells: tuple[int, int], bounds: Bounds) -> tuple[int, int]:
    """More cells along the longer side."""
    west, south, east, north = bounds
    return cells if east - west >= north - south else (cells[1], cells[0])
