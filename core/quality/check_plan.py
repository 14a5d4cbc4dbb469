"""Places at which a mosaic is to be checked, drawn before anybody knows how good it is.

One place for each cell of a grid over the block's ground. Each is a corner that the reference shows
well by itself: nothing here asks what the matcher can find, so the places do not favour ground on
which the program did well. The strongest corners are crowns of single trees more often than not,
and those change in fifty years: corners where long straight edges cross, as of roads, walls and
fields, come first. Places keep away from control, which lies better than the ground between.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import cast

import cv2
import numpy as np
import shapely
from jaxtyping import Float64
from shapely.geometry import Polygon, box
from shapely.geometry.base import BaseGeometry

from core.arrays import Raster, Scalars
from core.frames import pixel_from_opencv
from core.geometry.crs import Bounds, shared_bounds
from core.progress import SILENT, Progress
from core.quality.check_points import STANDARD_LEAST
from core.raster.grid import Grid
from core.raster.ortho import Ortho

PlanePoints = Float64[np.ndarray, "n 2"]
"""Easting and northing, metres."""
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
PICTURE_PX = 600
"""A cell is looked at in so many pixels a side at most."""
# design: the frame of a photo and the rim of the mosaic show nothing to compare.
RIM_M = 20.0
"""A place lies so far inside the block's ground, metres."""
# design: time; a tenth of a second a cell. Straight edges have weaker corners than crowns.
CANDIDATES = 400
"""Strongest corners of a cell that are looked at."""
# design: some of them, so that the seed and not the strongest detail decides where one looks.
DRAWN_FROM = 6
"""Of those that lie well, the place is drawn from so many of the best."""
# design: a fiftieth of the strongest corner of a cell is texture.
LEAST_STRENGTH = 0.02
"""Smaller eigenvalue of a corner, as a share of the largest in its cell."""
# design: two corners nearer than this are of one detail.
APART_PX = 6
# design: a quarter of the detail's own size at the pixel it is looked at.
CORNER_PX = 5
"""Side of the window over which gradients make a corner, pixels."""
# design: the window of the corner and its rim.
EDGE_PX = 4.0
"""An edge passes so near a corner that it is of it, pixels."""
# source: sine of 30 degrees; a place is well determined along both axes where edges cross so much.
CROSSING_SINE = 0.5


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
    cells: tuple[int, int] | None = None
    """Columns and rows of the grid; as many as give enough places when None."""


@dataclass(frozen=True, slots=True)
class DrawnPlan:
    """Places that were drawn."""

    places: tuple[CheckPlace, ...]
    """Row by row from the north-west."""
    cells: tuple[int, int]
    """Columns and rows of the grid."""
    empty: int
    """Cells with ground of the block in which the reference shows nothing well."""

    @property
    def enough(self) -> bool:
        """Whether the standard allows a statement when all places are read."""
        return len(self.places) >= STANDARD_LEAST


def draw_places(request: PlanRequest, progress: Progress = SILENT) -> DrawnPlan:
    """Draw one place for each cell of a grid over the block's ground.

    A grid that is not asked for is made finer until thirty cells have a place.

    Args:
        request: Ground, reference, control and grid.
        progress: Told per cell.
    """
    bounds = shared_bounds(request.ground.bounds, request.ortho.bounds)
    if bounds[0] >= bounds[2] or bounds[1] >= bounds[3]:
        return DrawnPlan((), request.cells or USUAL_CELLS, 0)
    drawn = _draw(request, bounds, request.cells or _turned(USUAL_CELLS, bounds), progress)
    finer = 1
    while request.cells is None and not drawn.enough:
        long, short = USUAL_CELLS[0] + finer, USUAL_CELLS[1] + finer
        if long > MOST_CELLS[0] or short > MOST_CELLS[1]:
            break
        drawn, finer = _draw(request, bounds, _turned((long, short), bounds), progress), finer + 1
    return drawn


def _draw(
    request: PlanRequest, bounds: Bounds, cells: tuple[int, int], progress: Progress
) -> DrawnPlan:
    """Places of one grid."""
    found: list[tuple[float, float]] = []
    rng = np.random.default_rng(request.seed)
    inside = [cell for cell in _cells(bounds, cells) if _is_ground(cell, request.ground)]
    within = request.ground.buffer(-RIM_M)
    for done, cell in enumerate(inside):
        progress.report(done, len(inside))
        places = _well_shown(request.ortho, cell)
        kept = places[shapely.contains_xy(within, places)]
        if len(request.control) and len(kept):
            away = np.linalg.norm(kept[:, None] - request.control[None], axis=2).min(axis=1)
            kept = kept[away >= request.apart_m]
        # Asked for in every cell, so that one cell does not change what is drawn in the next.
        chance = rng.random()
        if len(kept):
            east, north = kept[int(chance * min(len(kept), DRAWN_FROM))].tolist()
            found.append((round(east, 2), round(north, 2)))
    progress.report(1, 1)
    places = [CheckPlace(f"{number:02d}", *place) for number, place in enumerate(found, 1)]
    return DrawnPlan(tuple(places), cells, len(inside) - len(found))


def _well_shown(ortho: Ortho, cell: Polygon) -> PlanePoints:
    """Corners that the ortho shows in a cell (Shi and Tomasi, CVPR 1994), straight ones first."""
    west, south, east, north = cell.bounds
    pixel = max(ortho.ground_sample_distance_m, max(east - west, north - south) / PICTURE_PX)
    columns, rows = (max(1, int(side / pixel)) for side in (east - west, north - south))
    grid = Grid(west, north, pixel, columns, rows)
    patch = ortho.read(grid)
    # A corner at the rim of nodata is none.
    valid = cv2.erode(patch.mask.astype(np.uint8), np.ones((2 * CORNER_PX + 1,) * 2, np.uint8))
    found: object = cv2.goodFeaturesToTrack(
        patch.values,
        CANDIDATES,
        LEAST_STRENGTH,
        APART_PX,
        mask=np.asarray(valid, np.uint8),
        blockSize=CORNER_PX,
    )
    corners = cast("np.ndarray | None", found)
    if corners is None:
        return np.zeros((0, 2))
    pixels = np.asarray(corners).reshape(-1, 2).astype(np.float64)
    first = np.argsort(-crossing_edges_px(patch.values, pixels), kind="stable")
    return grid.object_from_grid(pixel_from_opencv(pixels[first]))


def crossing_edges_px(picture: Raster, corners: PlanePoints) -> Scalars:
    """How long straight edges cross at each corner: the shorter one of the best two, pixels.

    Segments of lines are those of von Gioi and others (PAMI 32, 2010), which look like chance
    nowhere; leaves of a crown have none.

    Args:
        picture: Gray values.
        corners: Column and row as OpenCV counts.
    """
    gray = cv2.normalize(picture, np.zeros_like(picture), 0, 255, cv2.NORM_MINMAX)
    found: object = cv2.createLineSegmentDetector().detect(gray.astype(np.uint8))[0]
    lines = cast("np.ndarray | None", found)
    if lines is None:
        return np.zeros(len(corners))
    ends = np.asarray(lines, dtype=np.float64).reshape(-1, 2, 2)
    along = ends[:, 1] - ends[:, 0]
    lengths = np.hypot(*along.T)
    way = along / lengths[:, None]
    best = np.zeros(len(corners))
    for number, corner in enumerate(corners):
        from_start = corner - ends[:, 0]
        on_line = np.clip((from_start * way).sum(axis=1), 0, lengths)
        near = np.hypot(*(from_start - on_line[:, None] * way).T) < EDGE_PX
        own, ways = lengths[near], way[near]
        sines = np.abs(np.outer(ways[:, 0], ways[:, 1]) - np.outer(ways[:, 1], ways[:, 0]))
        both = np.minimum.outer(own, own)[sines > CROSSING_SINE]
        best[number] = both.max(initial=0.0)
    return best


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
