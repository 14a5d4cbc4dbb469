"""Stage surface: the photos matched pixel by pixel, coarse to fine, tile by tile of the ground."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import rasterio
from jaxtyping import Float64

from core.arrays import Mask, ObjectPoints
from core.block import Block
from core.doubts import Failure
from core.geometry.areas import Area
from core.orthos.rectification import COMPRESSION_LEVEL
from core.progress import Work
from core.raster.dem import HeightSource
from core.raster.grid import (
    BLOCK_PX,
    Grid,
    Tile,
    burn_area,
    tell_full_disk,
    tiled_profile,
    tiles_of,
    window_of,
)
from core.said import say
from core.surface.fusion import CellHeights, PairHeights, cell_heights, fuse_pairs, object_points
from core.surface.ground import (
    NODATA_M,
    CorrectedHeights,
    SystematicPart,
    bridged,
    fit_trend,
    hillshade,
    read_smooth,
)
from core.surface.matching import match_pair
from core.surface.rectified import (
    Pair,
    Picture,
    RectifiedPair,
    Scans,
    open_scans,
    pairs_over,
    part_of,
    rectify_pair,
    sound_pairs,
)

# source: METHODS 8, height range of the search about the DEM
REACH_M = 40.0
"""Heights are sought so far above and below the DEM."""
# design: a wood of high trees, and a house at the edge of what the coarse level saw.
FINE_REACH_M = 15.0
"""Heights are sought so far above and below the coarse surface."""
# design: four pixels; then the search about the coarse surface is no wider than the first.
COARSER = 4
"""Fine pixels per coarse pixel."""
# source: METHODS 8, parallaxes from 0.3 to 0.5 px: four measurements and more a cell
PIXELS_PER_CELL = 2
"""Pixels that are matched along the side of a cell, at least."""
# design: a coarse surface is wanted for its speed.
MOST_PIXELS_PER_CELL = 4
"""Pixels along the side of a cell at most; finer scans are averaged first."""
# design: two hundred thousand pixels and what is computed of them: 100 MB for each thread.
TILE_CELLS = 256
"""Side of the tiles that are matched at a time, cells; they fit into the blocks of a file."""
# design: the range of parallaxes, and what semi-global matching needs to find its course.
MARGIN_PX = 48
"""Pixels matched around each tile."""
# design: 64 MB, whatever the block.
MOST_COARSE = 4096
"""Cells along the longer side of the coarse surface at most."""
# design: shares of the bar on the screen; nothing is computed from them.
COARSE_SHARE, FINE_SHARE = 0.2, 0.95
TREND_TAG = "TREND"
"""Tag of the difference that holds the systematic part."""
TREND_IS = "a b c d of a + b x + c y + d (x2 + y2), metres; x and y -1 to 1 along the longer side"
# design: some hundred thousand cells fix four coefficients.
TREND_CELLS = 400
"""Cells along the longer side that the trend is fitted to."""


@dataclass(frozen=True, slots=True)
class SurfaceOptions:
    """What surface is wanted."""

    cell_m: float | None = None
    """Size of its cells, metres; None: twice the scans' pixel on the ground."""
    point_cloud: bool = False
    """Write it as a point cloud, too."""
    contours_m: float | None = None
    """Draw contour lines at this interval, metres; None: none."""


@dataclass(frozen=True, slots=True)
class SurfaceFiles:
    """Where its rasters are written."""

    surface: Path
    """Heights, metres."""
    sigma: Path
    """Standard deviations of the heights, metres."""
    count: Path
    """Pairs of photos that agree; 0 in holes."""
    difference: Path
    """Surface minus DEM without the systematic part, metres."""
    hillshade: Path
    """Relief, 1 to 255."""

    @staticmethod
    def within(folder: Path) -> "SurfaceFiles":
        """Their names in a folder."""
        return SurfaceFiles(
            folder / "surface.tif",
            folder / "surface_sigma.tif",
            folder / "surface_count.tif",
            folder / "surface_difference.tif",
            folder / "surface_hillshade.tif",
        )

    @property
    def paths(self) -> tuple[Path, ...]:
        """All of them."""
        return (self.surface, self.sigma, self.count, self.difference, self.hillshade)


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceProduct:
    """A surface on disk."""

    files: SurfaceFiles
    """Its rasters."""
    grid: Grid
    """Where its cells lie."""
    pixel_m: float
    """Pixel that was matched, on the ground, metres."""
    pairs: tuple[tuple[str, str, float], ...]
    """Photos that were matched with each other, and base over height."""
    completeness: float
    """Share of the ground in two photos and more whose height is known, 0 to 1."""
    median_sigma_m: float
    """Median standard deviation of a height, metres."""
    trend: SystematicPart
    """Systematic part of its difference to the DEM."""


def make_surface(
    block: Block,
    dem: HeightSource,
    files: SurfaceFiles,
    usable: Callable[[str], Mask | None],
    *,
    ties: ObjectPoints,
    options: SurfaceOptions,
    work: Work,
    water: Area | None = None,
) -> SurfaceProduct | Failure:
    """Make a surface from all sound pairs of an adjusted block.

    Args:
        block: The adjusted block.
        dem: Heights to begin from, in the block's CRS, metres; safe to ask from threads.
        files: What to write; hand over temporary names and rename them.
        usable: True where a photo's scan may be used, over the whole scan at any reduction.
        ties: Adjusted tie points, metres, for how far the ground lies from the DEM.
        options: Size of the cells.
        work: Told after every tile; runs tiles side by side.
        water: Waves and glints are others in each photo: nothing is known here.

    Returns:
        The surface, or why there is none. Cells that no pairs agree on are holes.

    Raises:
        ScanError: A scan cannot be read.
        OSError: The disk is full.
    """
    pairs = sound_pairs(block)
    if not pairs:
        return Failure("No two photos see the same ground from places apart enough for heights.")
    names = {name for pair in pairs for name in (pair.left, pair.right)}
    pixel = float(np.mean([block.photos[n].ground_pixel_m(block.camera_of(n)) for n in names]))
    cell = options.cell_m or PIXELS_PER_CELL * pixel
    pixel = cell / int(np.clip(round(cell / pixel), 1, MOST_PIXELS_PER_CELL))
    bounds = np.array([pair.shared.bounds for pair in pairs])
    low, high = bounds[:, :2].min(axis=0), bounds[:, 2:].max(axis=0)
    grid = Grid.over((*low.tolist(), *high.tolist()), cell)
    scans = open_scans(block, names, usable)
    reach = _reach_m(dem, ties)
    coarse = _coarse_start(_Level(scans, pairs, _coarse_grid(grid, pixel), dem, reach), work)
    fine = _Level(scans, pairs, grid, coarse, FINE_REACH_M, pixel, water)
    shown, known, sigma = _write_surface(
        fine, files, block.crs, work.part(COARSE_SHARE, FINE_SHARE)
    )
    if known == 0:
        return Failure("Nothing of the ground was matched between the photos.")
    trend = _compare(files, grid, dem, block.crs, work.part(FINE_SHARE, 1.0))
    matched = tuple((pair.left, pair.right, pair.base_to_height) for pair in pairs)
    return SurfaceProduct(files, grid, pixel, matched, known / shown, sigma, trend)


def _reach_m(dem: HeightSource, ties: ObjectPoints) -> float:
    """How far from the DEM the ground is sought: more than any tie point lies from it."""
    known = ties[np.isfinite(ties).all(axis=1)]
    away = np.abs(known[:, 2] - dem.heights(known[:, :2])) if len(known) else np.zeros(0)
    away = away[np.isfinite(away)]
    # design: one tie point in a hundred may be wrong; houses and trees stand higher than ties.
    most = float(np.quantile(away, 0.99)) + FINE_REACH_M if len(away) else 0.0
    return max(REACH_M, most)


def _coarse_grid(grid: Grid, pixel_m: float) -> Grid:
    west, south, east, north = grid.bounds
    cell = PIXELS_PER_CELL * COARSER * pixel_m
    return Grid.over(grid.bounds, max(cell, max(east - west, north - south) / MOST_COARSE))


@dataclass(frozen=True, slots=True, eq=False)
class _Level:
    """One of the resolutions that are matched one after the other."""

    scans: Scans
    pairs: tuple[Pair, ...]
    grid: Grid
    start: HeightSource
    reach_m: float
    pixel_m: float | None = None
    water: Area | None = None

    @property
    def pixel(self) -> float:
        """Pixel that is matched, metres."""
        return self.pixel_m or self.grid.ground_sample_distance_m / PIXELS_PER_CELL

    def tile(self, tile: Tile) -> tuple[CellHeights, Mask]:
        """The surface of a tile, and which of its cells two photos show."""
        cells = self.grid.window(*tile)
        found: list[PairHeights] = []
        photos: list[tuple[str, str]] = []
        shown = np.zeros((cells.rows, cells.columns), dtype=bool)
        for pair in pairs_over(self.pairs, cells.bounds):
            reach = self.reach_m * pair.base_to_height / self.pixel
            laid = rectify_pair(
                self.scans,
                pair,
                part_of(pair, cells),
                self.pixel,
                margin_px=MARGIN_PX + round(reach / 2),
                heights=self.start.heights,
            )
            if laid is None:
                continue
            shown |= _shown(laid, cells)
            points, sigmas = object_points(laid, match_pair(laid, max(round(reach), 1)))
            if len(points):
                found.append(cell_heights(points, sigmas, cells, self.pixel))
                photos.append((pair.left, pair.right))
        fused = fuse_pairs(found, photos, cells)
        if self.water is None:
            return fused, shown
        wet = burn_area(self.water, cells)
        return fused.without(wet), shown & ~wet


def _shown(pair: RectifiedPair, cells: Grid) -> Mask:
    """Cells whose middle both photos of a pair show."""
    grid, seen = pair.grid, pair.left.seen & pair.right.seen
    turned = pair.frame.from_object(_centres(cells))
    column, row = np.floor(grid.grid_from_object(turned)).astype(int).T
    inside = (column >= 0) & (column < grid.columns) & (row >= 0) & (row < grid.rows)
    found = np.zeros(len(turned), dtype=bool)
    found[inside] = seen[row[inside], column[inside]]
    return found.reshape(cells.rows, cells.columns)


def _coarse_start(level: _Level, work: Work) -> CorrectedHeights:
    """The coarse surface, smooth and without holes, to begin the fine level from."""
    grid = level.grid
    differences = np.zeros((grid.rows, grid.columns), dtype=np.float32)
    for tile, (cells, _) in _tiles(level, work.part(0.0, COARSE_SHARE)):
        column, row, columns, rows = tile
        ground = level.start.heights(_centres(grid.window(*tile)))
        differences[row : row + rows, column : column + columns] = cells.heights - ground.reshape(
            rows, columns
        )
    return CorrectedHeights(level.start, grid, bridged(differences))


def _tiles(level: _Level, work: Work) -> Iterator[tuple[Tile, tuple[CellHeights, Mask]]]:
    """All tiles of a level, computed side by side, with progress."""
    tiles = [
        tile
        for tile in tiles_of(level.grid, TILE_CELLS)
        if pairs_over(level.pairs, level.grid.window(*tile).bounds)
    ]
    results = cast("Iterable[tuple[CellHeights, Mask]]", work.mapper(level.tile, tiles))
    for done, (tile, result) in enumerate(zip(tiles, results, strict=True), start=1):
        yield tile, result
        size = level.grid.ground_sample_distance_m
        work.progress.report(done, len(tiles), say("surface at {size:g} m", size=size))


def _profile(grid: Grid, crs: str, dtype: str, nodata: float) -> dict[str, Any]:
    profile = tiled_profile(grid, crs, dtype) | {"nodata": nodata, "sparse_ok": False}
    # source: TIFF, predictors 2 of whole and 3 of floating numbers
    predictor = 3 if dtype == "float32" else 2
    return profile | {"compress": "deflate", "zlevel": COMPRESSION_LEVEL, "predictor": predictor}


def _name(file: Any, what: str, unit: str) -> None:
    """Say in a file what its band holds."""
    file.set_band_description(1, what)
    file.set_band_unit(1, unit)


def _write_surface(
    level: _Level, files: SurfaceFiles, crs: str, work: Work
) -> tuple[int, int, float]:
    """Write heights, standard deviations and counts; cells shown, known, and the median sigma."""
    heights = _profile(level.grid, crs, "float32", NODATA_M)
    counts = _profile(level.grid, crs, "uint8", 0)
    shown = known = 0
    sigmas: list[Picture] = []
    with (
        tell_full_disk(files.surface),
        rasterio.open(files.surface, "w", **heights) as surface,
        rasterio.open(files.sigma, "w", **heights) as sigma,
        rasterio.open(files.count, "w", **counts) as count,
    ):
        _name(surface, "height", "metre")
        _name(sigma, "standard deviation of the height", "metre")
        _name(count, "pairs of photos that agree", "")
        for tile, (cells, seen) in _tiles(level, work):
            window = window_of(tile)
            surface.write(np.nan_to_num(cells.heights, nan=NODATA_M), 1, window=window)
            sigma.write(np.nan_to_num(cells.sigmas, nan=NODATA_M), 1, window=window)
            count.write(cells.pairs, 1, window=window)
            shown, known = shown + int(seen.sum()), known + int(np.count_nonzero(cells.pairs))
            sigmas.append(cells.sigmas[np.isfinite(cells.sigmas)][::16])
    every = np.concatenate(sigmas) if sigmas else np.zeros(0)
    return max(shown, 1), known, float(np.median(every)) if len(every) else float("nan")


def _compare(
    files: SurfaceFiles, grid: Grid, dem: HeightSource, crs: str, work: Work
) -> SystematicPart:
    """Write the difference to the DEM without its systematic part, and the relief."""
    with rasterio.open(files.surface) as surface:
        trend = _trend_of(surface, grid, dem)
        with (
            tell_full_disk(files.difference),
            rasterio.open(
                files.difference, "w", **_profile(grid, crs, "float32", NODATA_M)
            ) as difference,
            rasterio.open(files.hillshade, "w", **_profile(grid, crs, "uint8", 0)) as relief,
        ):
            _name(difference, "surface minus DEM, less a trend", "metre")
            told = " ".join(f"{v:.4f}" for v in trend.coefficients)
            difference.update_tags(**{TREND_TAG: told}, TREND_IS=TREND_IS)
            tiles = list(tiles_of(grid, BLOCK_PX))
            for done, tile in enumerate(tiles, start=1):
                heights = _read_heights(surface, tile)
                plan = _centres(grid.window(*tile))
                away = heights - (dem.heights(plan) + trend.at(plan)).reshape(heights.shape)
                window = window_of(tile)
                values = np.nan_to_num(away, nan=NODATA_M).astype(np.float32)
                difference.write(values, 1, window=window)
                shade = hillshade(read_smooth(surface, tile, 1), grid.ground_sample_distance_m)
                relief.write(shade[1:-1, 1:-1], 1, window=window)
                work.progress.report(done, len(tiles), "difference to the DEM")
    return trend


def _trend_of(surface: Any, grid: Grid, dem: HeightSource) -> SystematicPart:
    step = max(1, max(grid.columns, grid.rows) // TREND_CELLS)
    plans, values = [], []
    for tile in tiles_of(grid, BLOCK_PX):
        column, row, columns, rows = tile
        heights = _read_heights(surface, tile)[-row % step :: step, -column % step :: step]
        plan = _centres(grid.window(*tile)).reshape(rows, columns, 2)
        plan = plan[-row % step :: step, -column % step :: step].reshape(-1, 2)
        away = heights.ravel() - dem.heights(plan)
        known = np.isfinite(away)
        plans.append(plan[known])
        values.append(away[known])
    return fit_trend(np.concatenate(plans), np.concatenate(values), grid.bounds)


def _read_heights(surface: Any, tile: Tile) -> Picture:
    """Heights of a tile, NaN in holes."""
    values = surface.read(1, window=window_of(tile))
    values[values == NODATA_M] = np.nan
    return values


def _centres(cells: Grid) -> Float64[np.ndarray, "n 2"]:
    east, north = np.meshgrid(*cells.centres())
    return np.column_stack([east.ravel(), north.ravel()])


def with_files(product: SurfaceProduct, files: SurfaceFiles) -> SurfaceProduct:
    """The same surface under its final names."""
    return replace(product, files=files)
