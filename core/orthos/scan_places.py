"""Where the pixels of an ortho tile lie in the scan: a lattice is projected, the rest interpolated.

Collinearity is smooth in the plane and in height, relief is not. So coarse nodes are projected
exactly on three height planes, the parabola through them gives the scan pixel for any height,
and the height itself comes from the DEM at fine nodes. Frames: grid of the tile to pixel.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import cv2
import numpy as np
from jaxtyping import Float32, Float64

from core.arrays import Matrix, Scalars
from core.block import Photo
from core.frames import HALF_PIXEL
from core.geometry.camera import Camera
from core.raster.grid import Grid

# design: speed alone; the check halves it where it is too wide
LARGEST_SPACING = 8
"""Output pixels between fine nodes at most."""
# design: speed alone; the check halves it where it is too wide
COARSE_SPACING = 32
"""Output pixels between coarse nodes at first: tilt bends the image by 0.003 px in between."""
# design: planes are cheap from here on; what is left is the lens
FINEST_COARSE = 8
"""Output pixels between coarse nodes at last."""
# design: 256 places, one for every four thousand pixels of a tile
CHECKED_PER_AXIS = 16
"""The lattice is compared with exact projection at this many places along each axis of a tile."""
# design: a tenth of what a tie point is measured to, 0.5 px (METHODS 7)
LIMIT_PX = 0.05
"""Largest error of an interpolated scan place, scan pixels."""
# design: no division by nought; nobody photographs from a metre
LEAST_DEPTH_M = 1.0
"""Ground nearer below the perspective centre is not looked for, metres."""

PixelMap = Float32[np.ndarray, "rows columns"]


@runtime_checkable
class Heights(Protocol):
    """What is asked of a DEM."""

    @property
    def ground_sample_distance_m(self) -> float:
        """Spacing of its posts, metres."""
        ...

    def heights(self, points: Float64[np.ndarray, "n 2"]) -> Scalars:
        """Heights at easting, northing, metres; NaN where there is none."""
        ...

    def on(self, grid: Grid) -> Float64[np.ndarray, "rows columns"]:
        """Heights at the pixel centres of a grid, metres; NaN where there is none."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class ScanPlaces:
    """For every pixel centre of a tile its place in the scan, relative to a whole-pixel origin."""

    origin: tuple[int, int]
    """Scan column and row that the maps count from."""
    columns: PixelMap
    """Scan columns minus the origin; NaN where the DEM has no height."""
    rows: PixelMap
    """Scan rows minus the origin; NaN likewise."""


def locate_tile(
    photo: Photo,
    camera: Camera,
    dem: Heights,
    tile: Grid,
) -> ScanPlaces | None:
    """Scan places of every pixel centre of a tile; None where the DEM has no height at all.

    Fine nodes start at the spacing of the DEM; both spacings are halved until relief between the
    nodes and the check against exact projection stay below `LIMIT_PX`.
    """
    spacing, coarse = starting_spacing(dem, tile), COARSE_SPACING
    while True:
        heights = dem.on(_nodes(tile, spacing))
        if not (heights < photo.exterior.centre[2] - LEAST_DEPTH_M).any():
            return None
        places, unevenness_px = _interpolate(
            photo, camera, tile, spacing, coarse // spacing, heights
        )
        error = max(_largest_error(photo, camera, dem, tile, places), unevenness_px)
        if error <= LIMIT_PX or (spacing == 1 and coarse <= FINEST_COARSE):
            return places
        spacing, coarse = max(spacing // 2, 1), max(coarse // 2, FINEST_COARSE)


def places_at(photo: Photo, camera: Camera, tile: Grid, heights: Matrix) -> ScanPlaces:
    """Scan places of every pixel centre of a tile whose heights are known pixel by pixel.

    Args:
        photo: The photo.
        camera: Its camera.
        tile: Where the pixels lie.
        heights: At the pixel centres and at those of one pixel all round, metres.
    """
    return _interpolate(photo, camera, tile, 1, FINEST_COARSE, heights)[0]


def spread(
    values: Float32[np.ndarray, "r c"], factor: int, rows: int, columns: int
) -> Float32[np.ndarray, "rows columns"]:
    """Bilinear values between nodes that stand in the middle of blocks, one block wider all round.

    OpenCV's enlargement takes source pixels for areas, so a node is the centre of its block.
    """
    if factor == 1:
        return values[1 : 1 + rows, 1 : 1 + columns]
    size = (values.shape[1] * factor, values.shape[0] * factor)
    wide = cv2.resize(values, size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(wide[factor : factor + rows, factor : factor + columns])


def starting_spacing(dem: Heights, tile: Grid) -> int:
    """Pixels between nodes that are as far apart as the posts of a DEM, a power of two."""
    ratio = dem.ground_sample_distance_m / tile.ground_sample_distance_m
    return min(int(2 ** np.floor(np.log2(max(ratio, 1.0)) + 1e-6)), LARGEST_SPACING)


def _nodes(tile: Grid, spacing: int) -> Grid:
    """Grid whose pixel centres are nodes: blocks of the tile, and one block more all round."""
    step = tile.ground_sample_distance_m * spacing
    columns, rows = -(-tile.columns // spacing) + 2, -(-tile.rows // spacing) + 2
    return Grid(tile.west - step, tile.north + step, step, columns, rows)


def _interpolate(
    photo: Photo, camera: Camera, tile: Grid, spacing: int, ratio: int, heights: Matrix
) -> tuple[ScanPlaces, float]:
    """Places at the fine nodes from three height planes, spread to pixels; and the unevenness."""
    fine = _nodes(tile, spacing)
    coarse = _nodes(fine, ratio)
    # Along a plumb line a vertical photo's image moves in proportion to 1 / depth, not to height.
    depths = float(photo.exterior.centre[2]) - heights
    inverse = 1 / np.where(depths > LEAST_DEPTH_M, depths, np.nan)
    low, high = (float(f(inverse)) for f in (np.nanmin, np.nanmax))
    # design: level ground needs three different planes too
    middle, half = (low + high) / 2, max((high - low) / 2, low * 1e-3)
    planes = np.stack(
        [
            _project(photo, camera, coarse, photo.exterior.centre[2] - 1 / (middle + sign * half))
            for sign in (-1.0, 0.0, 1.0)
        ]
    )
    origin = np.nan_to_num(np.floor(planes[1, coarse.rows // 2, coarse.columns // 2]))
    bent = np.stack(
        [planes[1] - origin, (planes[2] - planes[0]) / 2, (planes[2] + planes[0]) / 2 - planes[1]]
    ).astype(np.float32)
    relative = ((inverse - middle) / half).astype(np.float32)
    maps = [
        spread(_parabola(bent[..., axis], relative, ratio), spacing, tile.rows, tile.columns)
        for axis in (0, 1)
    ]
    lean = np.hypot(bent[1, ..., 0], bent[1, ..., 1]) * middle**2 / half
    steepest = float(np.max(lean, initial=0.0, where=np.isfinite(lean)))
    unevenness = _unevenness(heights) * steepest if spacing > 1 else 0.0
    return ScanPlaces((int(origin[0]), int(origin[1])), maps[0], maps[1]), unevenness


def _project(
    photo: Photo, camera: Camera, grid: Grid, height: float
) -> Float64[np.ndarray, "rows columns 2"]:
    eastings, northings = grid.centres()
    east, north = np.meshgrid(eastings, northings)
    points = np.column_stack([east.ravel(), north.ravel(), np.full(east.size, height)])
    return photo.pixel_from_object(points, camera).reshape(grid.rows, grid.columns, 2)


def _parabola(
    coefficients: Float32[np.ndarray, "3 r c"],
    relative: Float32[np.ndarray, "rows columns"],
    ratio: int,
) -> PixelMap:
    rows, columns = relative.shape
    at_nodes = [spread(plane, ratio, rows, columns) for plane in coefficients]
    places = at_nodes[2] * relative
    places += at_nodes[1]
    places *= relative
    places += at_nodes[0]
    return places


def _unevenness(heights: Matrix) -> float:
    """How far linear interpolation between nodes may miss a bend of the relief, metres."""
    bends = [np.abs(np.diff(heights, 2, axis=axis)) for axis in (0, 1) if heights.shape[axis] > 2]
    largest = [float(np.max(bend, initial=0.0, where=np.isfinite(bend))) for bend in bends]
    return max(largest, default=0.0) / 4


def _largest_error(
    photo: Photo, camera: Camera, dem: Heights, tile: Grid, places: ScanPlaces
) -> float:
    """Compare interpolated with exact places at pixels spread unevenly over the tile."""
    steps = np.arange(CHECKED_PER_AXIS)
    columns = np.unique(((steps + HALF_PIXEL) / CHECKED_PER_AXIS * tile.columns).astype(int))
    # design: golden section, so that places fall on no regular pattern of nodes
    rows = np.unique(((steps * 0.618 + 0.31) % 1.0 * tile.rows).astype(int))
    column, row = (part.ravel() for part in np.meshgrid(columns, rows))
    ground = tile.object_from_grid(np.column_stack([column, row]) + HALF_PIXEL)
    exact = photo.pixel_from_object(np.column_stack([ground, dem.heights(ground)]), camera)
    seen = np.column_stack([places.columns[row, column], places.rows[row, column]])
    difference = np.linalg.norm(seen + np.array(places.origin, dtype=np.float64) - exact, axis=1)
    # What lies far outside the scan is never sampled, and the lens polynomial is wild there.
    # design: a tenth of the scan beside it
    reach = 0.1 * np.array(photo.size_px)
    counts = ((exact > -reach) & (exact < photo.size_px + reach)).all(axis=1)
    return float(np.max(difference, initial=0.0, where=counts & np.isfinite(difference)))
