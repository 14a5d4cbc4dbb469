"""Windows of a scan, and the reference about points warped to look as that photo would see it."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Float32, Float64

from core.arrays import Mask, ObjectPoints, PixelPoints
from core.block import Photo
from core.frames import HALF_PIXEL
from core.geometry.camera import Camera
from core.geometry.collinearity import object_on_rays, rays_from_film
from core.geometry.exterior import ExteriorOrientation
from core.matching.peaks import Image
from core.matching.reference import Reference
from core.raster.dem import HeightSource
from core.raster.grid import Grid
from core.raster.scan_file import ScanFile, read_window

# design: 12 m at half a metre a pixel, about the spacing of usual terrain models.
LATTICE_PX = 24
"""Spacing of the nodes that are followed to the ground, in pixels of the window."""
# design: each step gains a factor of tan(tilt) * slope, a half at most as a rule: twelve bring a
# kilometre to a quarter of a metre.
ITERATIONS = 12
# design: a hundredth of a pixel of ten centimetres.
SETTLED_M = 1e-3
"""A ray that moves less than this in height has met the ground."""
# design: relief of 300 m seen 35 degrees off the vertical.
ROAD_MARGIN_M = 200.0
"""Relief displaces roads: so far outside a window on level ground they are still drawn."""
# design: a sixteenth of a pixel.
SHIFT = 4
"""Bits after the point of what is drawn."""
# design: whole numbers of 32 bits hold such coordinates with their fractions.
FAR_PX = 1e5
"""No road is drawn that far outside a window."""


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """A rectangle of a scan, read at a reduction."""

    column: int
    """Scan column of its outer left edge."""
    row: int
    """Scan row of its outer top edge."""
    columns: int
    """Width in reduced pixels."""
    rows: int
    """Height in reduced pixels."""
    reduction: int
    """Scan pixels to one reduced pixel, per axis."""

    def pixel_from_window(self, points: Float64[np.ndarray, "n 2"]) -> PixelPoints:
        """Scan pixels of window points (reduced pixels from the window's outer corner)."""
        return points * self.reduction + np.array([self.column, self.row])

    def window_from_pixel(self, pixels: PixelPoints) -> Float64[np.ndarray, "n 2"]:
        """Window points of scan pixels."""
        return (pixels - np.array([self.column, self.row])) / self.reduction


@dataclass(frozen=True, slots=True, eq=False)
class ScanPart:
    """A window of a scan."""

    window: Window
    """Where it lies."""
    grey: Image
    """Grey values."""
    usable: Mask
    """Where the scan is photograph."""


@dataclass(frozen=True, slots=True, eq=False)
class Templates:
    """The reference about points as a photo would see it: square cells side by side in one picture.

    The point lies in the very middle of its cell, wherever the photo is thought to be: what is
    found of it hangs on the scan, and hardly on the prediction.
    """

    side: int
    """Width of a cell, an odd number of pixels."""
    across: int
    """Cells to a row of the picture; they are counted row by row."""
    reference: Image
    """Grey values of the ortho, warped through orientation and DEM into the scan's geometry."""
    known: Mask
    """Where the reference is known."""
    roads: Image
    """255 where the map has a road, drawn into the scan's geometry; else 0."""

    def cell(self, number: int, half_px: int) -> tuple[slice, slice]:
        """Rows and columns of the 2 n + 1 pixels about the middle of a cell."""
        row, column = divmod(number, self.across)
        first = (self.side - 2 * half_px - 1) // 2
        rows, columns = (
            slice(place * self.side + first, place * self.side + first + 2 * half_px + 1)
            for place in (row, column)
        )
        return rows, columns


@dataclass(frozen=True, slots=True, eq=False)
class OpenPhoto:
    """A photo with its camera and its scan at hand."""

    photo: Photo
    """The photo."""
    camera: Camera
    """Its camera."""
    scan: ScanFile
    """Its scan."""

    def at(self, exterior: ExteriorOrientation) -> "OpenPhoto":
        """The same photo with another exterior orientation."""
        return replace(self, photo=self.photo.with_exterior(exterior, self.photo.oriented))

    @property
    def ground_pixel_m(self) -> float:
        """Size of a scan pixel on the ground under the photo, metres."""
        return self.photo.ground_pixel_m(self.camera)

    @property
    def width_m(self) -> float:
        """Shorter side of the picture on the ground, metres."""
        return self.photo.width_m(self.camera)


def object_on_ground(
    photo: Photo, camera: Camera, pixels: PixelPoints, dem: HeightSource
) -> ObjectPoints:
    """Follow scan pixels down to the DEM; NaN heights where the ray finds none.

    Fixed-point iteration on the height, halved when it swings, which converges as long as the
    ground is not steeper than the ray.
    """
    film = photo.interior.film_from_pixel(pixels)
    rays = rays_from_film(film, photo.exterior, camera, photo.atmosphere)
    heights = np.full(len(pixels), photo.ground_height_m)
    step = np.zeros(len(pixels))
    for _ in range(ITERATIONS):
        ground = object_on_rays(rays, heights, photo.exterior, photo.atmosphere)
        found = dem.heights(ground[:, :2])
        change = np.where(np.isnan(found), 0.0, found - heights)
        swings = change * step < 0
        step = np.where(swings, change / 2, change)
        heights = heights + step
        if np.abs(step).max(initial=0.0) < SETTLED_M:
            break
    ground = object_on_rays(rays, heights, photo.exterior, photo.atmosphere)
    ground[np.isnan(dem.heights(ground[:, :2])), 2] = np.nan
    return ground


def read_scan(opened: OpenPhoto, window: Window) -> ScanPart:
    """A window of a scan; beyond the scan the values of its rim go on."""
    size = window.reduction
    grey = read_window(
        opened.scan,
        window.column,
        window.row,
        window.columns * size,
        window.rows * size,
        size,
        outside="edge",
    )
    usable = np.ones((window.rows, window.columns), bool)
    if opened.scan.usable is not None:
        place, shape = (window.column, window.row), (window.columns, window.rows)
        usable = opened.scan.usable.within(*place, *shape, size)
    return ScanPart(window, np.asarray(grey, np.float32), usable)


def read_templates(
    opened: OpenPhoto, reference: Reference, pixels: PixelPoints, half_px: int, reduction: int
) -> Templates:
    """The reference about places of a photo, as its orientation has it.

    Args:
        opened: The photo.
        reference: Ortho, heights and roads.
        pixels: Scan pixels that shall lie in the middle of a cell.
        half_px: A cell is 2 n + 1 pixels wide.
        reduction: Scan pixels to a pixel of the cells.
    """
    side, count = 2 * half_px + 1, len(pixels)
    across = int(np.ceil(np.sqrt(count)))
    steps = np.arange(0, side + LATTICE_PX, LATTICE_PX, dtype=np.float64)
    lattice = np.stack(np.meshgrid(steps, steps), axis=2).reshape(-1, 2) - side / 2
    nodes = (pixels[:, None] + lattice * reduction).reshape(-1, 2)
    ground = object_on_ground(opened.photo, opened.camera, nodes, reference.dem)
    seen = ~np.isnan(ground[:, 2])
    shape = (-(-count // across) * side, across * side)
    roads = drawn_roads(opened, reference, pixels, (side, across), reduction)
    if not seen.any():
        return Templates(side, across, np.zeros(shape, np.float32), np.zeros(shape, bool), roads)
    sample = opened.ground_pixel_m * reduction
    grid = grid_over(ground[seen, :2], shared_gsd_m(reference, sample))
    patch = reference.ortho.read(grid)
    lattices = (count, len(steps), len(steps))
    places = grid.grid_from_object(ground[:, :2])
    right, down = (
        side_by_side(upsampled(places[:, axis].reshape(lattices), side), across)
        - np.float32(HALF_PIXEL)
        for axis in range(2)
    )
    values = filled(patch.values, patch.mask)
    image = cv2.remap(values, right, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    known = np.ones(shape, bool)
    if not patch.mask.all():
        # design: rounding of the resampling; less has met an unknown pixel.
        known &= cv2.remap(patch.mask.astype(np.float32), right, down, cv2.INTER_LINEAR) > 0.99
    if not seen.all():
        weights = upsampled(seen.reshape(lattices).astype(np.float64), side)
        # design: the same.
        known &= side_by_side(weights, across) > 0.99
    return Templates(side, across, np.asarray(image, np.float32), known, roads)


def side_by_side(cells: Float32[np.ndarray, "cells side side"], across: int) -> Image:
    """Square cells as one picture, so many to a row; where the last row ends early they begin anew.

    Nothing flat stands between them that would count for what is usual on this ground.
    """
    count, side = len(cells), cells.shape[1]
    rows = -(-count // across)
    whole = cells[np.arange(rows * across) % count]
    picture = whole.reshape(rows, across, side, side).swapaxes(1, 2)
    return np.ascontiguousarray(picture.reshape(rows * side, across * side))


def drawn_roads(
    opened: OpenPhoto,
    reference: Reference,
    pixels: PixelPoints,
    cells: tuple[int, int],
    reduction: int,
) -> Image:
    """The roads of the map as strips of their width, as the photo would see them.

    Args:
        opened: The photo.
        reference: With its roads, or without.
        pixels: Scan pixels in the middle of each cell.
        cells: Width of a cell, and how many are side by side.
        reduction: Scan pixels to a pixel of the cells.
    """
    (side, across), count = cells, len(pixels)
    drawn = np.zeros((count, side, side), np.float32)
    if reference.roads is None:
        return side_by_side(drawn, across)
    photo, pixel_m = opened.photo, opened.ground_pixel_m * reduction
    low, high = (edge(pixels, axis=0) for edge in (np.min, np.max))
    reach = side / 2 * reduction
    rim = np.array([low - reach, [high[0] + reach, low[1] - reach], high + reach,
                    [low[0] - reach, high[1] + reach]])  # fmt: skip
    corners = photo.object_from_pixel(rim, np.full(4, photo.ground_height_m), opened.camera)
    west, south = corners[:, :2].min(axis=0) - ROAD_MARGIN_M
    east, north = corners[:, :2].max(axis=0) + ROAD_MARGIN_M
    for points, width_m in reference.roads.within((west, south, east, north)):
        line = photo.pixel_from_object(points, opened.camera)
        if not np.all(np.isfinite(line)):
            continue
        thick = max(1, round(width_m / pixel_m))
        room = reach + thick * reduction
        near = (line.min(axis=0) < pixels + room) & (line.max(axis=0) > pixels - room)
        for number in np.flatnonzero(near.all(axis=1)):
            places = (line - pixels[number]) / reduction + side / 2
            if np.abs(places).max() < FAR_PX:
                fixed = np.round((places - HALF_PIXEL) * (1 << SHIFT)).astype(np.int32)
                cv2.polylines(
                    drawn[number], [fixed[:, None]], False, 255.0, thick, cv2.LINE_8, SHIFT
                )
    return side_by_side(drawn, across)


def shared_gsd_m(reference: Reference, sample_m: float) -> float:
    """Pixel size to read the ortho with for photos of nearly one scale, metres.

    Pieces of one pixel size serve all photos and rounds: it grows in steps of a fourth root of
    two, and never exceeds that of the photo unless the ortho itself is coarser.
    """
    finest = reference.ortho.ground_sample_distance_m
    # design: rounding must not drop a step.
    steps = np.floor(4 * np.log2(max(sample_m / finest, 1.0)) + 1e-6)
    return float(finest * 2 ** (steps / 4))


def grid_over(points: Float64[np.ndarray, "n 2"], gsd_m: float) -> Grid:
    """A grid that covers ground points with a margin of four pixels."""
    margin = 4 * gsd_m
    west, south = points.min(axis=0) - margin
    east, north = points.max(axis=0) + margin
    return Grid.over((float(west), float(south), float(east), float(north)), gsd_m)


def upsampled(
    nodes: Float64[np.ndarray, "cells nodes nodes"], side: int
) -> Float32[np.ndarray, "cells side side"]:
    """Values of lattice nodes (every LATTICE_PX pixels from the corner) at all pixel centres.

    Bilinear by matrices: the resampling of OpenCV quantises its weights to 1/32.
    """
    weights = interpolation_matrix(side, nodes.shape[1])
    # Less their mean the nodes lose nothing in single precision.
    middle = nodes.mean(axis=(1, 2), keepdims=True)
    left = (weights @ (nodes - middle)).astype(np.float32)
    return left @ weights.T.astype(np.float32) + middle.astype(np.float32)


def interpolation_matrix(pixels: int, nodes: int) -> Float64[np.ndarray, "pixels nodes"]:
    """Linear weights of the nodes at every pixel centre."""
    place = (np.arange(pixels) + HALF_PIXEL) / LATTICE_PX
    left = np.minimum(place.astype(np.int64), nodes - 2)
    share = place - left
    matrix = np.zeros((pixels, nodes))
    matrix[np.arange(pixels), left] = 1 - share
    matrix[np.arange(pixels), left + 1] = share
    return matrix


def filled(values: Image, mask: Mask) -> Image:
    """Unknown places take the mean, so that their edges do not look like detail."""
    if mask.all() or not mask.any():
        return values
    return np.where(mask, values, np.float32(values[mask].mean())).astype(np.float32)
