"""Where the ground has changed: the mosaic of the archive beside the ortho of today, cell by cell.

Doubled gradient angles of both are compared at their own place, give or take what orientation and
relief leave. The same cell compared at places further off tells what chance brings: those places
are certainly wrong. A cell that is no more like its own place than like wrong ones shows other
ground; where both show hardly anything, nobody can tell.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import rasterio.features
from affine import Affine
from jaxtyping import Float32, Int8
from numpy.lib.stride_tricks import as_strided
from shapely.geometry import shape
from shapely.geometry.base import BaseGeometry

from core.arrays import Mask
from core.formats.vectors import write_polygons
from core.geometry.crs import Bounds
from core.matching.global_search import AngleField, angle_field
from core.matching.patches import filled
from core.progress import SILENT, Progress
from core.raster.grid import RASTERIZING, Grid
from core.raster.ortho import Ortho

# design: names of the states
SAME, UNSURE, DIFFERENT = 1, 0, -1
LAYERS = {"different": DIFFERENT, "same": SAME}
"""Layers of the file; what is in neither nobody can tell."""
# design: a thousand pixels a side at a time, some tens of megabytes
TILE_CELLS = 16
# design: grain of a scan is one or two pixels of a metre wide, fields and roads are tens long
EDGE_PX = 3.0
"""Edges run on for more than this, grain does not, pixels."""
# design: the upper quartile; a block has detail in a quarter of its cells at least
RICH = 75
"""Percentile of the cells that counts as rich in detail."""
Cells = Float32[np.ndarray, "rows columns"]
Offset = tuple[int, int]
# design: narrower than a field, and four thousand pixels to tell likeness from chance
CELL_PX = 64
"""Side of a cell, pixels of the common grid."""
# design: relief and orientation alone leave some tenths of a metre (docs/accuracy.md)
LEAST_GSD_M = 1.0
"""Finer detail is not compared, metres."""
# design: two metres at a metre a pixel, more than orientation and relief leave
PLAY_PX = 2
"""Largest shift that is still the cell's own place, pixels per axis; every second is tried."""
# design: clear of the play and of an edge, and inside the next cell, so the content is alike
AWAY_PX = (20, 36)
"""Wrong places lie so far off, pixels; four at each distance."""
# design: one wrong cell in fifty is called the same
SAME_CHANCE = 0.02
"""Fewer wrong places than this share are as like: the ground is the same."""
# design: what is the same passes for different only where it ranks with a fifth of wrong places
DIFFERENT_CHANCE = 0.2
"""More of them than this are: it is another."""
# design: half of what a rich cell has still ranks above grain
LEAST_DETAIL = 0.5
"""A cell with less detail than this share of what a rich cell has says nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class ChangeMap:
    """What became of every cell."""

    grid: Grid
    """Where the cells lie; its pixel is a cell."""
    state: Int8[np.ndarray, "rows columns"]
    """`SAME`, `UNSURE` or `DIFFERENT`."""
    seen: Mask
    """Cells that both show."""
    chance: Cells
    """Share of wrong places that are as like as the cell's own; NaN where not seen."""

    @property
    def shares(self) -> dict[str, float]:
        """Share of the seen cells that are the same, and that are different."""
        seen = max(int(self.seen.sum()), 1)
        return {
            name: float((self.state[self.seen] == value).sum()) / seen
            for name, value in LAYERS.items()
        }


def find_change(
    mosaic: Ortho,
    reference: Ortho,
    bounds: Bounds,
    progress: Progress = SILENT,
) -> ChangeMap:
    """Compare the mosaic with the ortho of today.

    Args:
        mosaic: The archive's ground.
        reference: Today's.
        bounds: West, south, east, north of the mosaic, metres.
        progress: Told per tile; may raise `Cancelled`.
    """
    gsd = max(
        LEAST_GSD_M,
        mosaic.ground_sample_distance_m,
        reference.ground_sample_distance_m,
    )
    west, south, east, north = bounds
    side = CELL_PX * gsd
    columns, rows = max(int((east - west) / side), 1), max(int((north - south) / side), 1)
    grid = Grid(west, north, side, columns, rows)
    own, detail = np.full((2, rows, columns), np.nan, np.float32)
    wrong = np.full((8, rows, columns), np.nan, np.float32)
    parts = list(_tiles(grid))
    for done, (down, across) in enumerate(parts):
        progress.report(done, len(parts), "change")
        place = np.s_[down, across]
        own[place], wrong[:, *place], detail[place] = _tile(
            mosaic, reference, grid, (down, across), gsd
        )
    return _judge_cells(grid, own, wrong, detail)


def _tiles(grid: Grid) -> Iterator[tuple[slice, slice]]:
    for row in range(0, grid.rows, TILE_CELLS):
        for column in range(0, grid.columns, TILE_CELLS):
            yield (
                slice(row, min(row + TILE_CELLS, grid.rows)),
                slice(column, min(column + TILE_CELLS, grid.columns)),
            )


def _tile(
    mosaic: Ortho,
    reference: Ortho,
    cells: Grid,
    part: tuple[slice, slice],
    gsd_m: float,
) -> tuple[Cells, Float32[np.ndarray, "8 rows columns"], Cells]:
    """Likeness of some cells at their own place and at eight wrong ones, and their detail."""
    rim = AWAY_PX[1] + PLAY_PX
    down, across = part
    size = CELL_PX
    shape_px = ((down.stop - down.start) * size, (across.stop - across.start) * size)
    grid = Grid(
        cells.west + (across.start * size - rim) * gsd_m,
        cells.north - (down.start * size - rim) * gsd_m,
        gsd_m,
        shape_px[1] + 2 * rim,
        shape_px[0] + 2 * rim,
    )
    then, now = _field(mosaic, grid), _field(reference, grid)
    middle = np.ascontiguousarray(then[rim:-rim, rim:-rim])
    power = _products(middle, middle, size)
    # Grain turns every way and cancels out; edges of fields and roads run on.
    lasting = cv2.GaussianBlur(middle.view(np.float32).reshape(*middle.shape, 2), (0, 0), EDGE_PX)
    detail = _means(np.hypot(lasting[:, :, 0], lasting[:, :, 1]), size)
    known = _means((middle != 0).astype(np.float32), size) > 0.5

    def like(shift: Offset) -> Cells:
        beside = now[
            rim + shift[0] : rim + shift[0] + shape_px[0],
            rim + shift[1] : rim + shift[1] + shape_px[1],
        ]
        other = _products(beside, beside, size)
        common = _products(middle, beside, size)
        # design: no division by nought
        return np.where(other > 0, common / np.sqrt(power * other + 1e-9), np.float32(np.nan))

    def best(centre: Offset) -> Cells:
        play = range(-PLAY_PX, PLAY_PX + 1, 2)
        found = np.max([like((centre[0] + dy, centre[1] + dx)) for dy in play for dx in play], 0)
        return np.where(known, found, np.nan)

    centres = [c for ring, away in enumerate(AWAY_PX) for c in _places_around(away, ring)]
    wrong = [best(centre) for centre in centres]
    seen = _means((now[rim:-rim, rim:-rim] != 0).astype(np.float32), size) > 0.5
    own = np.where(seen, best((0, 0)), np.nan)
    return own, np.array(wrong, np.float32), detail


def _places_around(away: int, ring: int) -> list[Offset]:
    """Four places at a distance; those of every other ring lie between those of the one before."""
    angles = ring * np.pi / 4 + np.arange(4) * np.pi / 2
    return [(round(away * float(np.sin(a))), round(away * float(np.cos(a)))) for a in angles]


def _field(ortho: Ortho, grid: Grid) -> AngleField:
    """Doubled gradient angles, 0 where the ortho shows nothing or its edge is felt."""
    patch = ortho.read(grid)
    return angle_field(filled(patch.values, patch.mask), patch.mask)


def _means(values: np.ndarray, size: int) -> Cells:
    """Means over cells of so many pixels a side."""
    rows, columns = values.shape[0] // size, values.shape[1] // size
    cells = np.asarray(values, np.float32).reshape(rows, size, columns, size)
    return np.asarray(cells.mean(axis=(1, 3)), np.float32)


def _products(one: AngleField, other: AngleField, size: int) -> Float32[np.ndarray, "_ _"]:
    """Means over cells of the real part of one times the conjugate of the other."""
    # Cells side by side without a copy: real and imaginary parts follow one another.
    parts = [
        as_strided(
            field.view(np.float32),
            (field.shape[0] // size, size, field.shape[1] // size, 2 * size),
            (size * field.strides[0], field.strides[0], size * field.itemsize, field.itemsize // 2),
            writeable=False,
        )
        for field in (one, other)
    ]
    return np.asarray(np.einsum("aibj,aibj->ab", *parts) / size**2, np.float32)


def _judge_cells(
    grid: Grid,
    own: Cells,
    wrong: Float32[np.ndarray, "8 rows columns"],
    detail: Cells,
) -> ChangeMap:
    """Hold every cell against the wrong places of all cells."""
    seen = np.isfinite(own)
    rich = float(np.percentile(detail[seen], RICH)) if seen.any() else 0.0
    told = seen & (detail >= LEAST_DETAIL * rich)
    null = np.sort(wrong[:, told][np.isfinite(wrong[:, told])])
    chance = np.full(own.shape, np.nan, np.float32)
    if len(null):
        chance[seen] = 1 - np.searchsorted(null, own[seen]) / len(null)
    state = np.zeros(own.shape, np.int8)
    state[told & (chance <= SAME_CHANCE)] = SAME
    state[told & (chance >= DIFFERENT_CHANCE)] = DIFFERENT
    return ChangeMap(grid, state, seen, chance)


def areas_of(change: ChangeMap, state: int) -> list[BaseGeometry]:
    """Connected cells of one state that both show, along their edges."""
    transform = Affine.from_gdal(*change.grid.geotransform)
    mask = change.seen & (change.state == state)
    with RASTERIZING:
        found = rasterio.features.shapes(mask.astype(np.uint8), mask=mask, transform=transform)
        return [shape(outline) for outline, _ in found]


def write_change(change: ChangeMap, path: Path, crs: str) -> None:
    """Write a GeoPackage with the layers `different` and `same`, polygons with their area.

    Raises:
        OSError: The disk is full.
    """
    for number, (layer, value) in enumerate(LAYERS.items()):
        areas = areas_of(change, value)
        sizes = np.array([area.area for area in areas], dtype=np.float64)
        write_polygons(path, layer, areas, {"area_m2": sizes}, crs=crs, append=number > 0)
