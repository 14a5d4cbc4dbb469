"""Many orthos composed into one: seams, tones, feathering, Cloud Optimized GeoTIFF.

Tile by tile, so memory does not grow with the number of photos. A tile is named by a digest of all
that it is composed from, so that the next mosaic takes it over where nothing of it has changed.
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import rasterio
import rasterio.shutil
from jaxtyping import Float32, Int32
from shapely import STRtree
from shapely.geometry import box

from core.mosaic.blending import cells_about, spread, tone_corrections
from core.mosaic.drawing import FEATHER_PX, balanced, lay_seams, read_overviews, shown_ground
from core.mosaic.layers import Kind, Layers, OrthoFiles, common_kind
from core.mosaic.radiometry import Balance, FilmPlane
from core.mosaic.seam_cut import SeamGuides
from core.mosaic.seams import Area, EditedSeams, Seam, write_seams
from core.orthos.rectification import COMPRESSION_LEVEL, OrthoProduct
from core.progress import SILENT, Part, Progress
from core.raster.grid import (
    BLOCK_PX,
    NODATA,
    Grid,
    Pixels,
    Tile,
    burn,
    refuse_incomplete,
    tell_full_disk,
    tiled_profile,
    tiles_on_multiples,
    window_of,
    write_tiles,
)
from core.raster.holes import Hole, find_holes
from core.raster.ortho import Ortho

# design: about what they take
READ, LAID = 0.2, 0.4
"""Shares of the work after which orthos are read small, and seams laid."""
# design: a change of what is composed from the same inputs
TILE_VERSION = 2


@dataclass(frozen=True, slots=True)
class MosaicOptions:
    """How orthos are composed."""

    # design: some megabytes a photo in memory, and four blocks of the file
    tile_px: int = 1024
    """Side of the tiles that are composed at a time, pixels."""
    # design: the cores of the smallest machine
    threads: int = 2
    """Tiles composed side by side."""
    balance: bool = True
    """Correct the tones of the photos."""
    seams_by_nadir: bool = False
    """Lay seams midway between nadirs, to compare with."""
    feather_only: bool = False
    """Leave tones beside seams as the balance makes them, to compare with."""
    area: Area | None = None
    """Ground that the orthos were made for; None for all that the photos show."""


@dataclass(frozen=True, slots=True, eq=False)
class FormerMosaic:
    """A mosaic that is there, from which tiles may be taken over."""

    path: Path
    """Its file, as it was written."""
    tiles: Mapping[str, str]
    """Digest of each of its tiles."""


@dataclass(frozen=True, slots=True, eq=False)
class MosaicProduct:
    """A mosaic on disk."""

    path: Path
    """Cloud Optimized GeoTIFF, one band, 0 (nodata) where no photo shows anything."""
    grid: Grid
    """Where its pixels lie."""
    seams: tuple[Seam, ...]
    """Which photo shows which part."""
    balances: Mapping[str, Balance]
    """Radiometric correction by photo."""
    covered_share: float
    """Share of it that shows the ground, 0 to 1; of the area where one was asked for."""
    holes: tuple[Hole, ...] = ()
    """Ground inside it, or of the area asked for, that no photo shows, largest first."""
    tiles: Mapping[str, str] = field(default_factory=dict[str, str])
    """Digest of all that each tile was composed from; empty where orthos have no stamps."""
    composed: int = 0
    """How many of its tiles were composed now; the rest was taken over."""
    notes: tuple[str, ...] = ()
    """What was done to edited seams."""
    shown: Mapping[str, Area] = field(default_factory=dict[str, Area])
    """The ground that each photo shows, by photo; empty where that is not known."""
    area: Area | None = None
    """Ground that was asked for; None for all that the photos show."""

    @property
    def asked_m2(self) -> float:
        """Size of what the covered share is a share of, square metres."""
        if self.area is not None:
            return self.area.area
        return self.grid.columns * self.grid.rows * self.grid.ground_sample_distance_m**2


COG = {
    "blocksize": BLOCK_PX,
    "compress": "deflate",
    "level": COMPRESSION_LEVEL,
    "predictor": "yes",
    "overview_resampling": "average",
    "num_threads": 2,
    "bigtiff": "if_safer",
}


@dataclass(frozen=True, slots=True, eq=False)
class _Work:
    """What the tiles of one mosaic are composed from."""

    orthos: tuple[OrthoProduct, ...]
    grid: Grid
    seams: tuple[Seam, ...]
    seam_orthos: tuple[int, ...]
    balances: Mapping[str, Balance]
    kind: Kind
    seam_tree: STRtree
    ortho_tree: STRtree
    former: FormerMosaic | None
    stamps: Mapping[str, str]
    digests: dict[str, str]
    composed: list[str]
    files: OrthoFiles
    even: bool


Labels = Int32[np.ndarray, "_ _"]
"""Index of the ortho that shows each pixel or cell, -1 for none."""
Redraw = Callable[[tuple[Seam, ...], Mapping[str, Area]], Sequence[Seam]]
"""What is done to seams before the mosaic is composed by them, with what each photo shows."""


def _as_laid(seams: tuple[Seam, ...], _shown: Mapping[str, Area]) -> Sequence[Seam]:
    """The seams as they are."""
    return seams


def mosaic_grid(orthos: Sequence[OrthoProduct]) -> Grid:
    """Grid over all orthos, which share one ground sample distance."""
    bounds = np.array([ortho.grid.bounds for ortho in orthos])
    west, south = bounds[:, :2].min(axis=0)
    east, north = bounds[:, 2:].max(axis=0)
    gsd = orthos[0].grid.ground_sample_distance_m
    return Grid.over((float(west), float(south), float(east), float(north)), gsd)


def compose_mosaic(
    orthos: Sequence[OrthoProduct],
    grid: Grid,
    path: Path,
    seams_path: Path | None,
    *,
    seams: Sequence[Seam] | EditedSeams | None = None,
    dates: Mapping[str, str] | None = None,
    guides: SeamGuides | None = None,
    planes: Mapping[str, FilmPlane] | None = None,
    former: FormerMosaic | None = None,
    stamps: Mapping[str, str] | None = None,
    redraw: Redraw = _as_laid,
    like: Ortho | str = "",
    options: MosaicOptions | None = None,
    progress: Progress = SILENT,
) -> MosaicProduct:
    """Compose orthos into one Cloud Optimized GeoTIFF and write the seams beside it.

    Args:
        orthos: At least one; all on multiples of the pixels of the mosaic's grid.
        grid: That grid.
        path: Mosaic to write; hand over a temporary name and rename it.
        seams_path: GeoPackage for the seams; likewise. None leaves them unwritten.
        seams: Seams to use instead of drawing them; what edited ones leave open is filled.
        dates: Date of each photo, for the seams.
        guides: Buildings and roads, for the seams.
        planes: Where the ground lies on the film, for vignetting.
        former: Mosaic whose tiles are taken over where nothing has changed; needs stamps.
        stamps: What names the content of each ortho's file.
        redraw: Changes the seams, as operators did.
        like: The reference or the photo whose tone the block is given; else their mean.
        options: Tiles, and whether to balance.
        progress: Told after every ortho and tile.
    """
    options, notes, kind = options or MosaicOptions(), (), common_kind(orthos)
    scale = float(np.iinfo(kind.dtype).max)
    overviews = read_overviews(orthos, grid, scale, Part(progress, 0.0, READ))
    toned = like if options.balance else None
    balances = balanced(orthos, overviews, planes, scale, toned, kind.bands)
    shown = shown_ground(overviews)
    if seams is None or isinstance(seams, EditedSeams):
        seams, notes = lay_seams(
            overviews,
            balances,
            scale,
            shown,
            edited=seams,
            dates=dates,
            guides=guides,
            by_nadir=options.seams_by_nadir,
            progress=Part(progress, READ, LAID),
        )
    overviews.clear()
    laid = redraw(tuple(seams), shown)
    work = _prepare(orthos, grid, laid, balances, kind, former, stamps, not options.feather_only)
    if seams_path is not None:
        write_seams(work.seams, seams_path, kind.crs)
    covered = _write(work, path, options, Part(progress, LAID, 1.0))
    return replace(_product(work, path, covered, notes, planes or {}, options.area), shown=shown)


def _product(
    work: _Work,
    path: Path,
    covered: int,
    notes: tuple[str, ...],
    planes: Mapping[str, FilmPlane],
    area: Area | None,
) -> MosaicProduct:
    """What was made of some work, of which so many pixels show the ground."""
    grid, tiles = work.grid, dict(sorted(work.digests.items()))
    holes, composed = _explained(find_holes(path, area), planes), len(work.composed)
    made = MosaicProduct(
        path, grid, work.seams, work.balances, 1.0, holes, tiles, composed, notes, area=area
    )
    share = covered * grid.ground_sample_distance_m**2 / made.asked_m2
    # Pixels at its edges may count for a little more than an area is.
    return replace(made, covered_share=min(share, 1.0))


def compose_window(
    orthos: Sequence[OrthoProduct], made: MosaicProduct, seams: Sequence[Seam], part: Tile
) -> Pixels:
    """A part of a mosaic as it would be with other seams; nothing is written.

    Args:
        orthos: Those that the mosaic was composed of.
        made: The mosaic; its tones hold.
        seams: The other seams.
        part: Column, row, columns, rows of the part, pixels of the mosaic.

    Returns:
        Gray values in the type of the mosaic, 0 where no photo shows anything.
    """
    with rasterio.open(made.path) as file:
        kind = Kind(file.crs.to_string(), np.dtype(file.dtypes[0]), file.count)
    work = _prepare(orthos, made.grid, seams, made.balances, kind, None, None)
    try:
        found = _compose(work, part)
    finally:
        work.files.close()
    if found is not None:
        return found
    shape = (part[3], part[2]) if kind.bands == 1 else (part[3], part[2], kind.bands)
    return np.zeros(shape, kind.dtype)


def _explained(holes: Sequence[Hole], planes: Mapping[str, FilmPlane]) -> tuple[Hole, ...]:
    """Holes with the photos that reach over them and are left out there."""
    return tuple(
        replace(
            hole,
            masked_in=tuple(
                name for name in sorted(planes) if planes[name].reaches(hole.east, hole.north)
            ),
        )
        for hole in holes
    )


def _write(work: _Work, path: Path, options: MosaicOptions, progress: Progress) -> int:
    """Compose all tiles and write the mosaic; the number of pixels that show the ground."""
    grid = work.grid
    tiles_path = path.with_name(f".{path.name}.tiles.tif")
    try:
        covered = write_tiles(
            tiles_path,
            tiled_profile(grid, work.kind.crs, work.kind.dtype.name, work.kind.bands),
            {},
            partial(_compose, work),
            tiles=list(tiles_on_multiples(grid, options.tile_px)),
            threads=options.threads,
            progress=progress,
            what="mosaic",
        )
        with tell_full_disk(path):
            rasterio.shutil.copy(tiles_path, path, driver="COG", **COG)
        refuse_incomplete(path, -(-grid.columns // BLOCK_PX) * -(-grid.rows // BLOCK_PX))
    finally:
        work.files.close()
        tiles_path.unlink(missing_ok=True)
    return covered


def _prepare(
    orthos: Sequence[OrthoProduct],
    grid: Grid,
    seams: Sequence[Seam],
    balances: Mapping[str, Balance],
    kind: Kind,
    former: FormerMosaic | None,
    stamps: Mapping[str, str] | None,
    even: bool = True,
) -> _Work:
    """What the tiles need, with trees to find it by place."""
    # Where tones are left untouched, every photo has the balance of nothing.
    even = even and any(balance != Balance() for balance in balances.values())
    index = {ortho.photo_id: number for number, ortho in enumerate(orthos)}
    known = tuple(seam for seam in seams if seam.photo_id in index)
    return _Work(
        tuple(orthos),
        grid,
        known,
        tuple(index[seam.photo_id] for seam in known),
        balances,
        kind,
        STRtree([seam.area for seam in known]),
        STRtree([box(*ortho.grid.bounds) for ortho in orthos]),
        former,
        stamps or {},
        {},
        [],
        OrthoFiles(orthos, balances, kind.dtype),
        even,
    )


def _compose(work: _Work, tile: Tile) -> Pixels | None:
    """One tile of the mosaic; None where no photo shows anything."""
    halo = FEATHER_PX // 2 + 1
    column, row, columns, rows = tile
    part = work.grid.window(column - halo, row - halo, columns + 2 * halo, rows + 2 * halo)
    labels, seams = _burnt(work, part)
    cells, pixels, corner = cells_about(work.grid, part)
    about = _burnt(work, cells)[0] if work.even else labels[:0]
    name, digest = _digest(work, tile, pixels if work.even else part, (labels, about))
    work.digests[name] = digest
    if work.former is not None and digest and work.former.tiles.get(name) == digest:
        return _taken_over(work.former.path, work.grid, tile)
    work.composed.append(name)
    layers = Layers(work.files, part)
    _show(work, part, layers, labels, seams)
    inner = np.s_[halo : halo + rows, halo : halo + columns]
    near = sorted(int(k) for k in work.ortho_tree.query(box(*part.bounds)))
    present = [k for k in near if (labels == k).any()]
    if not present or not (labels[inner] >= 0).any():
        return None
    bands = range(work.kind.bands)
    if (about != about[:1, :1]).any():
        for band in bands:
            found = tone_corrections(work.files, about, cells, pixels, band)
            for k, correction in found.items():
                layers.corrections[k, band] = spread(correction, part, corner)
    values = [_band(layers, labels, present, band) for band in bands]
    largest = np.iinfo(work.kind.dtype).max
    whole = np.clip(np.rint(values[0] if len(bands) == 1 else np.dstack(values)), 1, largest)
    whole[labels < 0] = NODATA
    return np.ascontiguousarray(whole[inner].astype(work.kind.dtype))


def _band(layers: Layers, labels: Labels, present: list[int], band: int) -> np.ndarray:
    """One band of a tile, of one photo or of several that blend."""
    if len(present) == 1:
        return layers.toned(present[0], band)
    return _blend(layers, labels, present, FEATHER_PX, band)


def _digest(work: _Work, tile: Tile, part: Grid, labels: tuple[Labels, Labels]) -> tuple[str, str]:
    """Name of a tile by its place, and the digest of all that it is composed from."""
    corner = work.grid.on_multiples
    if corner is None or not work.stamps:
        return str(tile), ""
    column, row, columns, rows = tile
    name = f"{corner[0] + column} {corner[1] + row} {columns} {rows}"
    kind = (work.kind.dtype.name, *([work.kind.bands] if work.kind.bands > 1 else []))
    total = hashlib.sha256(repr((TILE_VERSION, name, *kind, FEATHER_PX, work.even)).encode())
    # Numbers of orthos change when a photo is added; their order does not.
    ranks = np.full(len(work.orthos) + 1, -1, np.int16)
    near = sorted(
        (int(k) for k in work.ortho_tree.query(box(*part.bounds))),
        key=lambda k: work.orthos[k].photo_id,
    )
    for rank, k in enumerate(near):
        ortho, ranks[k] = work.orthos[k], rank
        said = (ortho.photo_id, work.stamps[ortho.photo_id], ortho.nadir, ortho.grid)
        total.update(repr((*said, work.balances[ortho.photo_id])).encode())
    for kind in labels:
        total.update(ranks[kind].tobytes())
    return name, total.hexdigest()


def _taken_over(path: Path, grid: Grid, tile: Tile) -> Pixels | None:
    """A tile of a mosaic that was made before; None where it shows nothing."""
    column, row, columns, rows = tile
    with rasterio.open(path) as file:
        gsd = grid.ground_sample_distance_m
        west = round((grid.west - file.transform.c) / gsd) + column
        north = round((file.transform.f - grid.north) / gsd) + row
        bands = file.read(window=window_of((west, north, columns, rows)))
    values = bands[0] if len(bands) == 1 else np.ascontiguousarray(np.moveaxis(bands, 0, -1))
    return values if values.any() else None


def _burnt(work: _Work, part: Grid) -> tuple[Int32[np.ndarray, "rows columns"], list[int]]:
    """Index of the ortho that the seams give each pixel, -1 for none; the seams that are there."""
    gsd = part.ground_sample_distance_m
    here = box(*part.bounds).buffer(gsd, join_style="mitre")
    near = work.seam_tree.query(here, predicate="intersects")
    chosen = sorted(int(k) for k in near)
    if len(chosen) == 1 and work.seams[chosen[0]].area.covers(here):
        return np.full((part.rows, part.columns), work.seam_orthos[chosen[0]], np.int32), chosen
    # Burning costs time for every vertex, wherever it lies.
    shapes = [(work.seams[k].area.intersection(here), work.seam_orthos[k]) for k in chosen]
    return burn(shapes, part.aside, empty=-1), chosen


def _show(
    work: _Work,
    part: Grid,
    layers: Layers,
    labels: Int32[np.ndarray, "rows columns"],
    chosen: list[int],
) -> None:
    """Where the seams give a photo that does not show the place, take the nearest nadir."""
    for k in chosen:
        index = work.seam_orthos[k]
        labels[(labels == index) & (layers.pixels(index) == NODATA)] = -1
    if (labels < 0).any():
        _fill(work, part, layers, labels)


def _fill(
    work: _Work, part: Grid, layers: Layers, labels: Int32[np.ndarray, "rows columns"]
) -> None:
    """Where no seam gives a photo that shows the place, take the nearest nadir that does."""
    eastings, northings = part.centres()
    empty = labels < 0
    nearest = np.full(labels.shape, np.inf)
    for index in sorted(int(k) for k in work.ortho_tree.query(box(*part.bounds))):
        shown = empty & (layers.pixels(index) != NODATA)
        if not shown.any():
            continue
        east, north = work.orthos[index].nadir
        distance = (eastings[None, :] - east) ** 2 + (northings[:, None] - north) ** 2
        better = shown & (distance < nearest)
        labels[better] = index
        nearest[better] = distance[better]


def _blend(
    layers: Layers,
    labels: Int32[np.ndarray, "rows columns"],
    present: list[int],
    width: int,
    band: int,
) -> Float32[np.ndarray, "rows columns"]:
    """Weights fall from 1 to 0 across a seam; a photo never weighs where it shows nothing."""
    side = width // 2 * 2 + 1
    total = np.zeros(labels.shape, dtype=np.float32)
    weights = np.zeros(labels.shape, dtype=np.float32)
    for index in present:
        own = (labels == index).astype(np.float32)
        # Sums of ones are whole numbers: the same in whatever tile a pixel lies.
        weight = cv2.boxFilter(
            own, -1, (side, side), normalize=False, borderType=cv2.BORDER_REPLICATE
        )
        weight = np.where(layers.pixels(index) != NODATA, np.asarray(weight), np.float32(0))
        total += weight * layers.toned(index, band)
        weights += weight
    # Where nothing has weight nothing is shown: 0 by 1.
    return total / np.maximum(weights, np.float32(1))
