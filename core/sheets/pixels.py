"""Which pixels a map sheet has, in the mosaic's own CRS and in others.

A pixel belongs to the sheet in which its centre lies; a centre on an edge lies in the sheet to the
east or south of it. Grids of all sheets share their pixels. So neighbours leave no gap and show
nothing twice, whatever the pixel size and the slant of their edges.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from affine import Affine
from jaxtyping import Float64
from pyproj import CRS
from shapely.geometry import MultiPolygon, Polygon, box

from core.arrays import Mask
from core.errors import CrsError
from core.frames import HALF_PIXEL
from core.geometry.crs import (
    SAME_PLACE_M,
    Bounds,
    Operation,
    horizontal,
    in_metres,
    operation_between,
    read_crs,
    short_name,
)
from core.raster.grid import ROUNDING_PX, Grid, burn
from core.raster.sampling import between_nodes, node_places

# design: an edge between two CRS bends by less than a millimetre between places so near.
STEP_M = 50.0
"""Edges of sheets are taken into another CRS place by place, so far apart, metres."""
EDGE_PX = 2.0  # design: far more than edges drawn in either CRS are apart, and few pixels.
"""Pixels so near to an edge are decided one by one, in the block's CRS."""


@dataclass(frozen=True, slots=True, eq=False)
class TargetSystem:
    """A CRS in which sheets are delivered."""

    crs: str
    """As the user names it."""
    turn: Float64[np.ndarray, "2 2"] | None
    """Where its axes only count otherwise than the block's: its coordinates from the block's. The
    pixels are then the mosaic's own. None where the picture is resampled."""
    operation: Operation | None
    """From the block's CRS, where the picture is resampled."""

    @property
    def resampled(self) -> bool:
        """Whether its pixels are other ones than the mosaic's."""
        return self.operation is not None

    def transform(self, grid: Grid) -> Affine:
        """Coordinates from (column, row) of a grid; the outer corner of the first pixel (0, 0)."""
        north_up = Affine.from_gdal(*grid.geotransform)
        if self.turn is None:
            return north_up
        (a, b), (d, e) = self.turn.tolist()
        turned = Affine(a, b, 0.0, d, e, 0.0) @ north_up
        return Affine(*(value + 0.0 for value in tuple(turned)[:6]))  # no minus before a nought

    def sheet_in(self, area: Polygon | MultiPolygon) -> Polygon | MultiPolygon:
        """A sheet where its pixels are counted: in this CRS where it is resampled."""
        if self.operation is None:
            return area
        return shapely.transform(shapely.segmentize(area, STEP_M), self.operation.forward)


def own_system(crs: str) -> TargetSystem:
    """The block's own CRS."""
    return TargetSystem(crs, None, None)


def target_system(text: str, block: str, bounds: Bounds, where: str | Path) -> TargetSystem:
    """A CRS that sheets are wanted in.

    Args:
        text: What the user names.
        block: The block's CRS.
        bounds: Of the mosaic, in the block's CRS.
        where: File and key, for the message.

    Raises:
        CrsError: PROJ does not know it or cannot reach it, or it does not count in metres.
    """
    own, wanted = horizontal(read_crs(block, where)), metric_crs(text, where)
    west, south, east, north = bounds
    corners = np.array([[west, south], [east, south], [east, north], [west, north]])
    operation = operation_between(own.to_wkt(), wanted.to_wkt(), corners, where)
    moved = operation.forward(corners)
    turn = np.rint(np.linalg.lstsq(corners, moved, rcond=None)[0].T)
    if np.abs(corners @ turn.T - moved).max() < SAME_PLACE_M:
        return TargetSystem(text, turn, None)
    if not _counts_east_and_north(wanted):
        raise CrsError(
            where,
            "the axes of {crs} do not point east and north.",
            "Name its variant that counts east and north, or use it in a block of the same datum.",
            crs=short_name(wanted),
        )
    return TargetSystem(text, None, operation)


def metric_crs(text: str, where: str | Path) -> CRS:
    """A CRS of the plane in which pixels of sheets have a size.

    Raises:
        CrsError: PROJ does not know it, or it does not count in metres.
    """
    wanted = horizontal(read_crs(text, where))
    if wanted.is_projected and in_metres(wanted):
        return wanted
    raise CrsError(
        where,
        "{crs} does not count in metres on a map plane, so sheets have no pixel size in it.",
        "Name a projected CRS in metres, such as EPSG:5513 or EPSG:32633.",
        crs=short_name(wanted),
    )


def _counts_east_and_north(crs: CRS) -> bool:
    return {axis.direction for axis in crs.axis_info[:2]} == {"east", "north"}


def enlarged(area: Polygon | MultiPolygon, overlap_m: float) -> Polygon | MultiPolygon:
    """A sheet with a rim of its neighbours, corners kept square."""
    return area.buffer(overlap_m, join_style="mitre") if overlap_m else area


def sheet_grid(area: Polygon | MultiPolygon, gsd: float, origin: tuple[float, float]) -> Grid:
    """The pixels whose centres lie between the outermost edges of an area.

    Args:
        area: The sheet, in the CRS of the pixels.
        gsd: Pixel size, metres.
        origin: Any corner of pixels: easting and northing.
    """
    west, south, east, north = area.bounds
    columns = _centres_before((np.array([west, east]) - origin[0]) / gsd)
    rows = _centres_before((origin[1] - np.array([north, south])) / gsd)
    left, right = columns.tolist()
    top, bottom = rows.tolist()
    return Grid(origin[0] + left * gsd, origin[1] - top * gsd, gsd, right - left, bottom - top)


def _centres_before(edges: Float64[np.ndarray, "n"]) -> np.ndarray:
    """Number of the first pixel whose centre does not lie before an edge."""
    return np.ceil(edges - HALF_PIXEL - ROUNDING_PX).astype(np.int64)


def origin_of(grid: Grid, system: TargetSystem) -> tuple[float, float]:
    """Where pixels are counted from: the mosaic's corner, or nought of a CRS resampled to."""
    return (0.0, 0.0) if system.resampled else (grid.west, grid.north)


def pixels_inside(
    area: Polygon | MultiPolygon, moved: Polygon | MultiPolygon, part: Grid, system: TargetSystem
) -> Mask:
    """Which pixels of a part of a sheet's grid have their centres in the sheet.

    Args:
        area: The sheet in the block's CRS: there it is decided.
        moved: The sheet in the CRS of the pixels.
        part: Some of its pixels.
        system: The CRS of the pixels.
    """
    gsd = part.ground_sample_distance_m
    around = box(*part.bounds).buffer(EDGE_PX * gsd, join_style="mitre")
    if shapely.contains(moved, around):
        return np.ones((part.rows, part.columns), dtype=np.bool_)
    if not shapely.intersects(moved, around):
        return np.zeros((part.rows, part.columns), dtype=np.bool_)
    inside = burn([(moved, 1)], part, empty=0) > 0
    edges = shapely.intersection(shapely.boundary(moved), around)
    doubtful = burn([(edges.buffer(EDGE_PX * gsd), 1)], part, empty=0) > 0
    rows, columns = np.nonzero(doubtful)
    plane = part.object_from_grid(np.column_stack([columns, rows]) + HALF_PIXEL)
    if system.operation is not None:
        plane = system.operation.backward(plane)
    # A little to the south-east, so that no centre lies on an edge.
    nudge = ROUNDING_PX * gsd
    inside[rows, columns] = shapely.contains_xy(area, plane[:, 0] + nudge, plane[:, 1] - nudge)
    return inside


def mosaic_places(
    part: Grid, mosaic: Grid, operation: Operation
) -> tuple[Float64[np.ndarray, "rows columns"], Float64[np.ndarray, "rows columns"]]:
    """Column and row of the mosaic (outer corner (0, 0)) under every pixel of a resampled sheet."""
    across, down = node_places(part.columns), node_places(part.rows)
    nodes = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    plane = operation.backward(part.object_from_grid(nodes))
    places = mosaic.grid_from_object(plane).reshape(len(down), len(across), 2)
    return (
        between_nodes(places[..., 0], across, down, part),
        between_nodes(places[..., 1], across, down, part),
    )
