"""A scan and the ortho laid on one grid, as the thesis compares them, and junctions sought there.

The scan is rectified where its assumed orientation puts it, so that a place of it and the same
place of the ortho differ by what the orientation is off. The DEM takes part in that, which is
kinder than the similarities of the thesis.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
import shapely
from jaxtyping import Float64

from core.arrays import Mask, ObjectPoints, PixelPoints, Position
from core.formats.roads import Roads
from core.frames import HALF_PIXEL
from core.literature.published_chains import NCC, PublishedOptions, joined_pixels
from core.matching.local_search import reduction_for
from core.matching.patches import SHIFT, OpenPhoto, Window, filled, read_scan
from core.matching.peaks import Image, ScoreMap
from core.matching.reference import Reference
from core.raster.dem import Dem
from core.raster.grid import Grid
from core.raster.ortho import LEAST_COVERAGE, Ortho
from core.raster.sampling import ReadOptions, read_onto

Band = Literal["grey", "green", "nearest"]
"""RGB2grey, the green band alone, or grey of the nearest pixel without interpolation."""
STREETS = ("ulice", "street", "residential", "living_street")
"""Words of a layer's name or a road's class that tell a street among houses (ZABAGED, OSM)."""
# design: the depth of a plot: house, yard and garden beside its street.
BUILT_UP_M = 40.0
"""Land is built up so far from a street, metres."""
Places = Float64[np.ndarray, "_ 2"]
"""Grid points (column, row)."""


@dataclass(frozen=True, slots=True, eq=False)
class GridPair:
    """A scan and the ortho on one grid."""

    grid: Grid
    """The grid."""
    archival: Image
    """Grey values of the scan, rectified."""
    reference: Image
    """The ortho."""
    seen: Mask
    """Where both are known."""
    pixels: Float64[np.ndarray, "rows columns 2"]
    """Scan pixel that each pixel of the grid shows."""

    def scan_pixels(self, places: Places) -> PixelPoints:
        """Scan pixels of places on the grid."""
        if not len(places):
            return np.zeros((0, 2))
        at = (places - HALF_PIXEL).astype(np.float32)
        found = [
            cv2.remap(self.pixels[:, :, axis], at[:, :1], at[:, 1:], cv2.INTER_LINEAR)
            for axis in range(2)
        ]
        return np.column_stack(found).astype(np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A place of the scan that may show a junction."""

    junction: int
    """Number of the junction."""
    pixel: PixelPoints
    """Scan pixel, (1, 2)."""
    score: float
    """Correlation."""


def lay_on_grid(
    opened: OpenPhoto, ortho: Ortho, dem: Dem, grid: Grid, border_m: float, band: Band = "grey"
) -> GridPair:
    """Scan and ortho on a grid.

    Args:
        opened: The photo at its assumed orientation.
        ortho: The reference.
        dem: Heights.
        grid: Any grid.
        border_m: So far from the border of the picture nothing counts as seen, metres.
        band: What is taken of the ortho.
    """
    photo, camera = opened.photo, opened.camera
    east, north = np.meshgrid(*grid.centres())
    heights = np.nan_to_num(dem.on(grid), nan=photo.ground_height_m)
    points = np.column_stack([east.ravel(), north.ravel(), heights.ravel()])
    pixels = photo.pixel_from_object(points, camera)
    film = photo.interior.film_from_pixel(pixels)
    margin = border_m / opened.ground_pixel_m * photo.interior.pixel_size_mm
    inside = np.all(np.abs(film) < np.array(camera.frame_mm) / 2 - margin, axis=1)
    shape = (grid.rows, grid.columns)
    reduction = reduction_for(opened, grid.ground_sample_distance_m)
    low = np.clip(np.floor(pixels.min(axis=0)).astype(int) - reduction, 0, None)
    high = np.clip(np.ceil(pixels.max(axis=0)).astype(int) + reduction, None, photo.size_px)
    columns, rows = np.maximum(-(-(high - low) // reduction), 1).tolist()
    window = Window(int(low[0]), int(low[1]), columns, rows, reduction)
    at = (window.window_from_pixel(pixels) - HALF_PIXEL).astype(np.float32).reshape(*shape, 2)
    grey = read_scan(opened, window).grey
    archival = cv2.remap(grey, at[:, :, 0], at[:, :, 1], cv2.INTER_LINEAR)
    values, known = _read_band(ortho, grid, band)
    return GridPair(
        grid,
        np.asarray(archival, np.float32),
        filled(values, known),
        inside.reshape(shape) & known,
        pixels.reshape(*shape, 2),
    )


def _read_band(ortho: Ortho, grid: Grid, band: Band) -> tuple[Image, Mask]:
    """One band of the ortho, and where it is known."""
    if band == "grey":
        patch = ortho.read(grid)
        return patch.values, patch.mask
    if band == "green":
        sampled = read_onto(ortho.sheets, grid, ReadOptions("colour"))
        green = sampled.values[min(1, len(sampled.values) - 1)]
        return np.asarray(green, np.float32), sampled.coverage >= LEAST_COVERAGE
    gsd = ortho.ground_sample_distance_m
    west, south, east, north = grid.bounds
    own = Grid.over((west - gsd, south - gsd, east + gsd, north + gsd), gsd)
    patch = ortho.read(own)
    columns, rows = (np.array(line) for line in grid.centres())
    right = np.floor((columns - own.west) / gsd).astype(int)
    down = np.floor((own.north - rows) / gsd).astype(int)
    nearest = np.ix_(down, right)
    return np.ascontiguousarray(patch.values[nearest]), patch.mask[nearest]


def roads_on_grid(reference: Reference, grid: Grid) -> Image:
    """The roads of the map as strips of their width."""
    drawn = np.zeros((grid.rows, grid.columns), np.float32)
    if reference.roads is not None:
        for points, width_m in reference.roads.within(grid.bounds):
            _draw(
                drawn, grid.grid_from_object(points[:, :2]), width_m / grid.ground_sample_distance_m
            )
    return drawn


def built_up(roads: Roads, grid: Grid) -> Mask:
    """Land near a street: what the thesis would have masked the ortho with (its chapter 6.1)."""
    drawn = np.zeros((grid.rows, grid.columns), np.float32)
    wide = 2 * BUILT_UP_M / grid.ground_sample_distance_m
    for line, *words in zip(roads.lines, roads.layer, roads.kind, strict=True):
        if any(street in str(word).lower() for word in words for street in STREETS):
            _draw(drawn, grid.grid_from_object(shapely.get_coordinates(line)), wide)
    return drawn > 0


def _draw(picture: Image, places: Places, width_px: float) -> None:
    """A line on a grid, of a width."""
    fixed = np.round((places - HALF_PIXEL) * (1 << SHIFT)).astype(np.int32)
    thick = max(1, round(width_px))
    cv2.polylines(picture, [fixed[:, None]], False, 255.0, thick, cv2.LINE_8, SHIFT)


def grid_about(position: Position, half_px: int, gsd_m: float) -> Grid:
    """A square grid whose middle pixel has a point in its middle."""
    reach = (half_px + HALF_PIXEL) * gsd_m
    side = 2 * half_px + 1
    return Grid(float(position[0]) - reach, float(position[1]) + reach, gsd_m, side, side)


def sizes_px(options: PublishedOptions) -> tuple[int, int]:
    """Half the template, and how far it is moved, pixels of the grid."""
    unit = 1.0 if options.in_pixels else 1.0 / options.gsd_m
    inner = round((options.template * unit - 1) / 2)
    return inner, round((options.window - options.template) * unit / 2)


def looked_at_on_grid(
    opened: OpenPhoto,
    ortho: Ortho,
    dem: Dem,
    junctions: ObjectPoints,
    options: PublishedOptions,
    band: Band = "grey",
) -> Iterator[tuple[int, GridPair]]:
    """The search window of every junction whose patch and surroundings both pictures show."""
    inner, half = sizes_px(options)
    pixels = opened.photo.pixel_from_object(junctions, opened.camera)
    within = np.all((pixels > 0) & (pixels < np.array(opened.photo.size_px)), axis=1)
    for number in np.flatnonzero(within).tolist():
        grid = grid_about(junctions[number], inner + half, options.gsd_m)
        pair = lay_on_grid(opened, ortho, dem, grid, options.border_m, band)
        if pair.seen.all():
            yield number, pair


def correlated(pair: GridPair, options: PublishedOptions, mirrored: bool = False) -> ScoreMap:
    """Correlation of the junction's patch at every place of its window.

    Args:
        pair: The window.
        options: Sizes.
        mirrored: Whether the patch is mirrored first: whatever is found then is wrong.
    """
    _, half = sizes_px(options)
    patch = pair.reference[half : len(pair.reference) - half, half : len(pair.reference) - half]
    patch = np.ascontiguousarray(patch[:, ::-1] if mirrored else patch)
    return NCC.scores((pair.archival,), (patch,))


def candidates_in(
    number: int, pair: GridPair, options: PublishedOptions, mirrored: bool = False
) -> list[Candidate]:
    """The best pixels of a window, neighbours joined, as the thesis exports them."""
    inner, _ = sizes_px(options)
    clusters = joined_pixels(correlated(pair, options, mirrored), options)
    return [
        Candidate(number, pair.scan_pixels(np.array([[across, down]]) + inner + HALF_PIXEL), score)
        for across, down, score in clusters
    ]
