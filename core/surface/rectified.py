"""Pairs of photos, laid on a start surface in a frame turned along their base, for matching.

In the turned frame, the direction of the base is the easting, so what lies h above the start
surface is displaced along rows alone: by h times base over height. Refraction, curvature, lens and
interior orientation are in the places that `core/orthos/scan_places.py` computes, to 0.05 px.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import cv2
import numpy as np
from jaxtyping import Float32, Float64
from shapely import Polygon
from shapely.geometry import box

from core.arrays import Mask, PlanPosition
from core.block import Block, Photo, footprint
from core.frames import HALF_PIXEL
from core.geometry.crs import Bounds
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation
from core.orthos.rectification import MARGIN_PX, PictureMask, picture_mask
from core.orthos.scan_places import ScanPlaces, places_at, spread
from core.raster.files import TILES, file_stamp
from core.raster.grid import Grid, Pixels
from core.raster.scan_file import GrayWindow, ScanFile, open_scan, read_window

# source: METHODS 8 asks for 0.25 to 0.7; wide angles with a quarter of overlap have 0.9, and better
# pairs go first.
BASE_TO_HEIGHT = (0.2, 1.0)
"""Below, heights are not fixed; above, slopes and houses look too different."""
# design: less is a strip in which the frame's edges and marks take most.
LEAST_OVERLAP = 0.1
"""Share of the smaller footprint that both photos show, at least."""
# design: a window of one photo is then at most half as fine again in the other.
MOST_SCALE_RATIO = 1.5
"""Ground pixels of the two photos differ by this factor at most."""
# design: METHODS 8, 60 per cent overlap gives 0.34 and 80 per cent two bases of it; in the middle.
BEST_RATIO = 0.45
"""Base to height that is taken first where many pairs see a place."""
# design: a tenth of the flying height of relief, seen at 40 degrees.
RELIEF = 0.05
"""Footprints at mean height are wider or narrower by this share of their side."""
# design: memory and time; the median of six leaves two wrong ones behind.
MOST_PAIRS = 6
"""Pairs that are matched at one place at most."""


@dataclass(frozen=True, slots=True)
class Pair:
    """Two photos that are matched with each other."""

    left: str
    """Photo with the smaller name."""
    right: str
    """The other one."""
    base_to_height: float
    """Length of the base over the height above ground."""
    shared: Polygon
    """Ground that both may show, whatever the relief."""


# design: four megabytes of 8 bits; strips of a wide scan are decoded once for a row of pieces.
PIECE_PX = 2048
"""Side of the pieces in which scans are read and kept, reduced pixels."""
# design: the soft shadow of the frame is narrower.
FRAME_MARGIN_MM = 1.0
"""Strip along the edge of the picture area that is left out, millimetres of film."""
# design: speed; the start surface is smoother than this.
POST_PX = 4
"""Pixels between the posts of the start surface; between them it is bilinear."""

Picture = Float32[np.ndarray, "rows columns"]
HeightsAt = Callable[[Float64[np.ndarray, "n 2"]], Float64[np.ndarray, "n"]]
"""Heights of easting and northing, metres; NaN where there is none."""


@dataclass(frozen=True, slots=True, eq=False)
class Turned:
    """A frame turned about a point of the ground; heights stay."""

    pivot: PlanPosition
    """The point, easting and northing, metres."""
    angle: float
    """Direction of the turned frame's easting, radians from grid east."""

    def from_object(self, plan: Float64[np.ndarray, "n 2"]) -> Float64[np.ndarray, "n 2"]:
        """Turned places of eastings and northings."""
        return (plan - self.pivot) @ self._matrix

    def to_object(self, places: Float64[np.ndarray, "n 2"]) -> Float64[np.ndarray, "n 2"]:
        """Eastings and northings of turned places."""
        return places @ self._matrix.T + self.pivot

    def photo(self, photo: Photo) -> Photo:
        """A photo carried along; what bends its rays is the same all around the vertical."""
        centre = photo.exterior.centre
        plan = self.from_object(centre[None, :2])[0]
        turn = np.eye(3)
        turn[:2, :2] = self._matrix.T
        angles = angles_from_rotation(turn @ photo.exterior.object_from_image)
        return replace(photo, exterior=ExteriorOrientation(np.array([*plan, centre[2]]), *angles))

    @property
    def _matrix(self) -> Float64[np.ndarray, "2 2"]:
        """Columns: the turned axes."""
        along = np.array([np.cos(self.angle), np.sin(self.angle)])
        return np.column_stack([along, [-along[1], along[0]]])


@dataclass(frozen=True, slots=True, eq=False)
class LaidPhoto:
    """One photo on the start surface."""

    gray: Picture
    """Gray values of the scan; meaningless where it is not seen."""
    seen: Mask
    """Where it may be used."""
    centre: Float64[np.ndarray, "3"]
    """Perspective centre in the turned frame, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class RectifiedPair:
    """Both photos of a pair over one part of the ground."""

    frame: Turned
    """The turned frame."""
    grid: Grid
    """Where the pixels lie in it."""
    start: Picture
    """Heights of the start surface at the pixels' centres, metres."""
    left: LaidPhoto
    """The photo from whose side higher ground is displaced to the right."""
    right: LaidPhoto
    """The other one."""


@dataclass(frozen=True, slots=True, eq=False)
class Scans:
    """The scans of a block, opened and masked once."""

    block: Block
    """The adjusted block."""
    files: dict[str, ScanFile]
    """By photo."""
    masks: dict[str, PictureMask]
    """What of each scan shows the ground."""


def open_scans(block: Block, names: set[str], usable: Callable[[str], Mask | None]) -> Scans:
    """Open the scans of some photos.

    Raises:
        ScanError: One cannot be read.
    """
    files = {name: open_scan(block.photos[name].scan) for name in sorted(names)}
    masks = {
        name: picture_mask(block.photos[name], block.camera_of(name), FRAME_MARGIN_MM, usable(name))
        for name in files
    }
    return Scans(block, files, masks)


def rectify_pair(
    scans: Scans, pair: Pair, part: Grid, pixel_m: float, *, margin_px: int, heights: HeightsAt
) -> RectifiedPair | None:
    """Both photos of a pair over a part of the ground; None where one of them shows nothing.

    Args:
        scans: The block with its scans.
        pair: The pair.
        part: What is to be covered, in the block's CRS.
        pixel_m: Pixel on the ground, metres.
        margin_px: Pixels around the part.
        heights: The start surface.
    """
    frame, first, second = _frame_of(scans.block, pair, part)
    grid = _grid_over(frame, part, pixel_m, margin_px)
    start = _start_surface(frame, grid, heights)
    if start is None:
        return None
    laid: list[LaidPhoto] = []
    for name in (first, second):
        found = _lay(scans, name, frame, grid, start)
        if found is None:
            return None
        laid.append(found)
    inner = start[1:-1, 1:-1].astype(np.float32)
    return RectifiedPair(frame, grid, inner, laid[0], laid[1])


def _frame_of(block: Block, pair: Pair, part: Grid) -> tuple[Turned, str, str]:
    """The frame along which height displaces one photo against the other, and the photos."""
    west, south, east, north = part.bounds
    middle = np.array([(west + east) / 2, (south + north) / 2])
    leans = []
    for name in (pair.left, pair.right):
        photo = block.photos[name]
        above = float(photo.exterior.centre[2]) - photo.ground_height_m
        leans.append((middle - photo.exterior.centre[:2]) / above)
    apart = leans[0] - leans[1]
    return Turned(middle, float(np.arctan2(apart[1], apart[0]))), pair.left, pair.right


def _grid_over(frame: Turned, part: Grid, pixel_m: float, margin_px: int) -> Grid:
    west, south, east, north = part.bounds
    corners = np.array([[west, south], [east, south], [east, north], [west, north]])
    turned = frame.from_object(corners)
    low, high = turned.min(axis=0), turned.max(axis=0)
    columns, rows = np.ceil((high - low) / pixel_m).astype(int) + 2 * margin_px
    margin = margin_px * pixel_m
    return Grid(float(low[0]) - margin, float(high[1]) + margin, pixel_m, int(columns), int(rows))


def _start_surface(
    frame: Turned, grid: Grid, heights: HeightsAt
) -> Float64[np.ndarray, "rows columns"] | None:
    """Heights at the centres of a grid and of one pixel around it; None without any."""
    step = grid.ground_sample_distance_m
    wide = Grid(grid.west - step, grid.north + step, step, grid.columns + 2, grid.rows + 2)
    posts_m = POST_PX * step
    size = (-(-wide.columns // POST_PX) + 2, -(-wide.rows // POST_PX) + 2)
    posts = Grid(wide.west - posts_m, wide.north + posts_m, posts_m, *size)
    east, north = np.meshgrid(*posts.centres())
    found = heights(frame.to_object(np.column_stack([east.ravel(), north.ravel()])))
    if not np.isfinite(found).any():
        return None
    level = float(np.nanmean(found))
    relative = (found - level).reshape(posts.rows, posts.columns).astype(np.float32)
    return spread(relative, POST_PX, wide.rows, wide.columns).astype(np.float64) + level


def _lay(
    scans: Scans, name: str, frame: Turned, grid: Grid, start: Float64[np.ndarray, "r c"]
) -> LaidPhoto | None:
    photo, camera = frame.photo(scans.block.photos[name]), scans.block.camera_of(name)
    places = places_at(photo, camera, grid, start)
    seen = scans.masks[name].at(places.columns, places.rows, places.origin)
    if not seen.any():
        return None
    pixel_m = photo.ground_pixel_m(camera)
    reduction = max(1, int(grid.ground_sample_distance_m / pixel_m + 0.5))
    gray = _sample(scans.files[name], places, seen, reduction)
    return LaidPhoto(gray, seen, photo.exterior.centre)


def _sample(scan: ScanFile, places: ScanPlaces, seen: Mask, reduction: int) -> Picture:
    """Gray values at places of a scan."""
    maps: list[Picture] = []
    first: list[int] = []
    size: list[int] = []
    for axis, values in enumerate((places.columns, places.rows)):
        reduced = (values + np.float32(places.origin[axis])) / np.float32(reduction)
        low = max(int(reduced[seen].min()) - MARGIN_PX, 0)
        high = int(reduced[seen].max()) + 1 + MARGIN_PX
        first.append(low)
        size.append(min(high, -(-scan.size_px[axis] // reduction)) - low)
        maps.append(np.nan_to_num(reduced - np.float32(low + HALF_PIXEL), nan=-1.0))
    pixels = scan_pixels(scan, (first[0], first[1], size[0], size[1]), reduction)
    values = cv2.remap(pixels, maps[0], maps[1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values, dtype=np.float32)


def scan_pixels(scan: ScanFile, window: tuple[int, int, int, int], reduction: int) -> Pixels:
    """A window of the reduced scan, from pieces that all tiles share."""
    column, row, columns, rows = window
    values = np.empty((rows, columns), dtype=np.dtype(scan.dtype))
    for i in range(row // PIECE_PX, -(-(row + rows) // PIECE_PX)):
        for j in range(column // PIECE_PX, -(-(column + columns) // PIECE_PX)):
            piece = TILES.get(
                (scan.path, file_stamp(scan.path), "scan", reduction, i, j),
                partial(_read_piece, scan, i, j, reduction),
            )
            top, left = i * PIECE_PX - row, j * PIECE_PX - column
            down = slice(max(top, 0), min(top + piece.shape[0], rows))
            across = slice(max(left, 0), min(left + piece.shape[1], columns))
            values[down, across] = piece[
                down.start - top : down.stop - top, across.start - left : across.stop - left
            ]
    return values


def _read_piece(scan: ScanFile, i: int, j: int, reduction: int) -> Pixels:
    side = PIECE_PX * reduction
    columns, rows = (
        min(side, -(-size // reduction) * reduction - start * side)
        for size, start in zip(scan.size_px, (j, i), strict=True)
    )
    values: GrayWindow = read_window(
        scan, j * side, i * side, columns, rows, reduction, outside="edge"
    )
    return np.rint(values).astype(np.dtype(scan.dtype))


def sound_pairs(block: Block) -> tuple[Pair, ...]:
    """All pairs of oriented photos whose base, scale and overlap allow heights, by name."""
    photos = {name: photo for name, photo in block.photos.items() if photo.oriented}
    areas = {name: footprint(photo, block.camera_of(name)) for name, photo in photos.items()}
    pixels = {name: photo.ground_pixel_m(block.camera_of(name)) for name, photo in photos.items()}
    found: list[Pair] = []
    for left, right in combinations(sorted(photos), 2):
        one, other = photos[left].exterior.centre, photos[right].exterior.centre
        ground = (photos[left].ground_height_m + photos[right].ground_height_m) / 2
        above = float(one[2] + other[2]) / 2 - ground
        ratio = float(np.hypot(*(one - other)[:2])) / above
        scale = pixels[left] / pixels[right]
        if not BASE_TO_HEIGHT[0] <= ratio <= BASE_TO_HEIGHT[1]:
            continue
        if max(scale, 1 / scale) > MOST_SCALE_RATIO:
            continue
        shared = areas[left].intersection(areas[right])
        smaller = min(areas[left].area, areas[right].area)
        if isinstance(shared, Polygon) and shared.area >= LEAST_OVERLAP * smaller:
            room = RELIEF * float(np.sqrt(smaller))
            found.append(Pair(left, right, ratio, shared.buffer(room, join_style="mitre")))
    return tuple(found)


def part_of(pair: Pair, cells: Grid) -> Grid:
    """The part of a grid that a pair may show; it shows some of it."""
    return cells.covering(pair.shared.intersection(box(*cells.bounds)).bounds)


def pairs_over(pairs: tuple[Pair, ...], bounds: Bounds) -> tuple[Pair, ...]:
    """The pairs to match over a part of the ground, those with the best rays first."""
    part = box(*bounds)
    seen = [pair for pair in pairs if pair.shared.intersection(part).area > 0]
    # Near one another in ratio, the one that shows more of the part goes first.
    seen.sort(
        key=lambda pair: (
            abs(np.log(pair.base_to_height / BEST_RATIO))
            - pair.shared.intersection(part).area / part.area
        )
    )
    return tuple(seen[:MOST_PAIRS])
