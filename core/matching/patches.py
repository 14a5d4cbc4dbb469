"""A window of a scan beside the reference ortho, warped to look as that photo would see it."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Float64

from core.arrays import Mask, ObjectPoints, PixelPoints
from core.block import Photo
from core.geometry.camera import Camera
from core.geometry.exterior import ExteriorOrientation
from core.matching.reference import Reference
from core.matching.template_search import Image
from core.raster.dem import Dem
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
class Pair:
    """One window of a scan and what the reference would look like in it."""

    window: Window
    """Where it lies."""
    scan: Image
    """Grey values of the scan."""
    reference: Image
    """Grey values of the ortho, warped through orientation and DEM into the scan's geometry."""
    known: Mask
    """Where the reference is known."""
    usable: Mask
    """Where the scan is photograph."""
    roads: Image
    """255 where the map has a road, drawn into the scan's geometry; else 0."""


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


def object_on_ground(photo: Photo, camera: Camera, pixels: PixelPoints, dem: Dem) -> ObjectPoints:
    """Follow scan pixels down to the DEM; NaN heights where the ray finds none.

    Fixed-point iteration on the height, halved when it swings, which converges as long as the
    ground is not steeper than the ray.
    """
    heights = np.full(len(pixels), photo.ground_height_m)
    step = np.zeros(len(pixels))
    for _ in range(ITERATIONS):
        ground = photo.object_from_pixel(pixels, heights, camera)
        found = dem.heights(ground[:, :2])
        change = np.where(np.isnan(found), 0.0, found - heights)
        swings = change * step < 0
        step = np.where(swings, change / 2, change)
        heights = heights + step
        if np.abs(step).max(initial=0.0) < SETTLED_M:
            break
    ground = photo.object_from_pixel(pixels, heights, camera)
    ground[np.isnan(dem.heights(ground[:, :2])), 2] = np.nan
    return ground


def read_pair(opened: OpenPhoto, reference: Reference, window: Window) -> Pair:
    """Read a window of a scan and warp the reference into it with the current orientation.

    Args:
        opened: The photo.
        reference: Ortho, heights and roads.
        window: What is read.
    """
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
    image, known = warped_reference(opened, reference, window)
    usable = usable_in(opened.scan, window)
    roads = drawn_roads(opened, reference, window)
    return Pair(window, np.asarray(grey, np.float32), image, known, usable, roads)


def usable_in(scan: ScanFile, window: Window) -> Mask:
    """Where a scan is photograph in a window; everywhere if nobody has told."""
    if scan.usable is None:
        return np.ones((window.rows, window.columns), bool)
    place, shape = (window.column, window.row), (window.columns, window.rows)
    return scan.usable.within(*place, *shape, window.reduction)


def drawn_roads(opened: OpenPhoto, reference: Reference, window: Window) -> Image:
    """The roads of the map as strips of their width, as the photo would see them in a window."""
    picture = np.zeros((window.rows, window.columns), np.float32)
    if reference.roads is None:
        return picture
    photo, pixel_m = opened.photo, opened.ground_pixel_m * window.reduction
    rim = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * [window.columns, window.rows]
    heights = np.full(4, photo.ground_height_m)
    corners = photo.object_from_pixel(
        window.pixel_from_window(rim.astype(np.float64)), heights, opened.camera
    )
    west, south = corners[:, :2].min(axis=0) - ROAD_MARGIN_M
    east, north = corners[:, :2].max(axis=0) + ROAD_MARGIN_M
    for points, width_m in reference.roads.within((west, south, east, north)):
        pixels = window.window_from_pixel(photo.pixel_from_object(points, opened.camera))
        if np.all(np.isfinite(pixels)) and np.abs(pixels).max() < FAR_PX:
            fixed = np.round((pixels - 0.5) * (1 << SHIFT)).astype(np.int32)
            thick = max(1, round(width_m / pixel_m))
            cv2.polylines(picture, [fixed[:, None]], False, 255.0, thick, cv2.LINE_8, SHIFT)
    return picture


def warped_reference(opened: OpenPhoto, reference: Reference, window: Window) -> tuple[Image, Mask]:
    """The ortho as the photo would see it in a window, and where it is known."""
    columns = np.arange(0, window.columns + LATTICE_PX, LATTICE_PX, dtype=np.float64)
    rows = np.arange(0, window.rows + LATTICE_PX, LATTICE_PX, dtype=np.float64)
    nodes = np.stack(np.meshgrid(columns, rows), axis=2).reshape(-1, 2)
    pixels = window.pixel_from_window(nodes)
    ground = object_on_ground(opened.photo, opened.camera, pixels, reference.dem)
    seen = ~np.isnan(ground[:, 2])
    shape = (window.rows, window.columns)
    if not seen.any():
        return np.zeros(shape, np.float32), np.zeros(shape, bool)
    sample = opened.ground_pixel_m * window.reduction
    grid = grid_over(ground[seen, :2], shared_gsd_m(reference, sample))
    patch = reference.ortho.read(grid)
    maps = grid.grid_from_object(ground[:, :2]).reshape(len(rows), len(columns), 2)
    across = upsampled(maps[:, :, 0], shape) - 0.5
    down = upsampled(maps[:, :, 1], shape) - 0.5
    values = filled(patch.values, patch.mask)
    image = cv2.remap(values, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    known = np.ones(shape, bool)
    if not patch.mask.all():
        # design: rounding of the resampling; less has met an unknown pixel.
        known &= cv2.remap(patch.mask.astype(np.float32), across, down, cv2.INTER_LINEAR) > 0.99
    if not seen.all():
        weights = upsampled(seen.reshape(len(rows), len(columns)).astype(np.float64), shape)
        # design: the same.
        known &= weights > 0.99
    return np.asarray(image, np.float32), known


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
    nodes: Float64[np.ndarray, "node_rows node_columns"], shape: tuple[int, int]
) -> Image:
    """Values of lattice nodes (every LATTICE_PX pixels from the corner) at all pixel centres.

    Bilinear by matrices: the resampling of OpenCV quantises its weights to 1/32.
    """
    down = interpolation_matrix(shape[0], nodes.shape[0])
    across = interpolation_matrix(shape[1], nodes.shape[1])
    # Less their mean the nodes lose nothing in single precision.
    middle = nodes.mean()
    left = (down @ (nodes - middle)).astype(np.float32)
    return left @ across.T.astype(np.float32) + np.float32(middle)


def interpolation_matrix(pixels: int, nodes: int) -> Float64[np.ndarray, "pixels nodes"]:
    """Linear weights of the nodes at every pixel centre."""
    place = (np.arange(pixels) + 0.5) / LATTICE_PX
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
