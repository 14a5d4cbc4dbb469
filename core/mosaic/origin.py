"""Where each place of a mosaic comes from: its photo, how surely it lies, the ground it stands on.

One raster each, all in the same cells: numbers of photos, metres and classes have types, nodata and
tables of their own, which bands of one file would have to share.
"""

import colorsys
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from jaxtyping import Float32, Int32, UInt8

from core.formats.raster_table import write_raster_table
from core.frames import HALF_PIXEL
from core.mosaic.drawing import CELL_M
from core.mosaic.misfit import BlockErrors, predicted_misfit
from core.mosaic.seams import Seam
from core.orthos.rectification import COMPRESSION_LEVEL
from core.raster.grid import NODATA, Grid, burn, tell_full_disk, tiled_profile
from core.raster.holes import missing_in_cells
from core.surface.ground import NODATA_M, Ground

# design: files of some megabytes, whatever the block
MOST_CELLS = 2048
"""Cells along the longer side at most."""
# design: memory; their errors take some megabytes
CELLS_AT_ONCE = 50_000
# design: a millimetre, and a power of two: what is rounded to it takes a tenth of the place
STEP_M = 1 / 1024
"""Standard deviations are rounded to it, metres."""
# source: the golden angle, by which neighbours on the circle of colours have far numbers
GOLDEN = 0.381966
# design: light enough for black letters, strong enough to be told apart
SATURATION, BRIGHTNESSES = 0.55, (0.95, 0.75)
MEANINGS = {
    Ground.DEM: ("DEM", "#d9c79a"),
    Ground.SURFACE: ("own surface", "#b3261e"),
    Ground.DEM_UNDER_SURFACE: ("DEM under another surface", "#2a9d3a"),
    Ground.DEM_ALONE: ("DEM without a surface", "#8a8a8a"),
}
"""Names and colours of what orthos stand on."""
Labels = Int32[np.ndarray, "rows columns"]


@dataclass(frozen=True, slots=True)
class OriginFiles:
    """The rasters of origin."""

    photo: Path
    """Number of the photo that is shown, 0 for none; names and dates in `.aux.xml`."""
    sigma: Path
    """Standard deviations east and north, metres; -9999 where they are not known."""
    ground: Path
    """Class of the ground that orthos stand on, 0 for none; names in `.aux.xml`."""

    @property
    def every(self) -> tuple[Path, ...]:
        """All of them, with the tables beside them."""
        tables = (self.photo, self.ground)
        beside = [path.with_name(f"{path.name}.aux.xml") for path in tables]
        return (self.photo, self.sigma, self.ground, *beside)


def origin_grid(mosaic: Grid) -> Grid:
    """Cells of whole pixels of a mosaic, of two metres, or larger so that they are not too many."""
    gsd = mosaic.ground_sample_distance_m
    side = max(1, round(CELL_M / gsd), -(-max(mosaic.columns, mosaic.rows) // MOST_CELLS))
    columns, rows = -(-mosaic.columns // side), -(-mosaic.rows // side)
    return Grid(mosaic.west, mosaic.north, gsd * side, columns, rows)


def write_origin(
    mosaic: Path,
    whole: Grid,
    seams: Sequence[Seam],
    dates: Mapping[str, str],
    errors: BlockErrors,
    classes: Path | None,
    files: OriginFiles,
    whole_file: Callable[[Path], AbstractContextManager[Path]] = nullcontext,
) -> None:
    """Write the rasters of origin of a mosaic, one after the other.

    Args:
        mosaic: Its file.
        whole: Where its pixels lie.
        seams: Which photo it shows where.
        dates: Date of every photo of the block; its photos are numbered from 1 in their order.
        errors: What the block predicts.
        classes: Classes of the ground; None where orthos stand on the DEM.
        files: To write.
        whole_file: Gives the place to write a file at, and puts it where it belongs.

    Raises:
        OSError: The disk is full.
    """
    grid, crs = origin_grid(whole), errors.report.block.crs
    names = dict(enumerate(dates, 1))
    shown = photo_numbers(mosaic, grid, seams, {name: number for number, name in names.items()})
    kind = np.min_scalar_type(max(names, default=1))
    table = {number: (name, dates[name]) for number, name in names.items()}
    with whole_file(files.photo) as path:
        with _opened(path, grid, crs, str(kind)) as file:
            file.write(shown.astype(kind), 1)
            _name(file, ["photo"], "")
            file.write_colormap(1, {number: _hue(number) for number in names})
        write_raster_table(path, {0: ("", "")} | table, ("scan", "date"))
    with whole_file(files.sigma) as path, _opened(path, grid, crs, "float32", 2) as file:
        file.write(plan_sigmas(shown, grid, names, errors))
        _name(file, ["standard deviation east", "standard deviation north"], "m")
    told = {int(one): (name,) for one, (name, _) in MEANINGS.items()}
    with whole_file(files.ground) as path:
        with _opened(path, grid, crs, "uint8") as file:
            file.write(ground_classes(shown, grid, classes), 1)
            _name(file, ["ground"], "")
            colours = {int(one): _rgb(colour) for one, (_, colour) in MEANINGS.items()}
            file.write_colormap(1, colours)
        write_raster_table(path, {int(Ground.NONE): ("",)} | told, ("ground",))


def photo_numbers(
    mosaic: Path, grid: Grid, seams: Sequence[Seam], numbers: Mapping[str, int]
) -> Labels:
    """Number of the photo that the seams give the middle of each cell; 0 where nothing is shown."""
    shapes = [(seam.area, numbers[seam.photo_id]) for seam in seams if seam.photo_id in numbers]
    shown = burn(shapes, grid.aside, empty=NODATA)
    with rasterio.open(mosaic) as file:
        side = round(grid.ground_sample_distance_m / file.res[0])
        shown[missing_in_cells(file, side) == side**2] = NODATA
    return shown


def plan_sigmas(
    shown: Labels, grid: Grid, names: Mapping[int, str], errors: BlockErrors
) -> Float32[np.ndarray, "2 rows columns"]:
    """Standard deviations (east, north) of the middle of each cell, as the desk tells them.

    Those of the photo's orientation, and what an error of the heights displaces; -9999 where no
    photo is shown, or one that took no part in the adjustment.
    """
    # A reference ortho has no part in where a photo lies: its covariance has it already.
    own = replace(errors, ortho_sigma_m=0.0)
    found = np.full((2, *shown.shape), NODATA_M, dtype=np.float32)
    rows, columns = np.nonzero(shown)
    for first in range(0, len(rows), CELLS_AT_ONCE):
        part = rows[first : first + CELLS_AT_ONCE], columns[first : first + CELLS_AT_ONCE]
        places = grid.object_from_grid(np.column_stack(part[::-1]) + HALF_PIXEL)
        photos = [names[number] for number in shown[part].tolist()]
        sigmas = np.sqrt(predicted_misfit(places, photos, own)[0][:, [0, 1], [0, 1]])
        told = np.rint(sigmas / STEP_M) * STEP_M
        found[:, *part] = np.where(np.isfinite(told), told, NODATA_M).T
    return found


def ground_classes(
    shown: Labels, grid: Grid, classes: Path | None
) -> UInt8[np.ndarray, "rows columns"]:
    """Class of the ground under the middle of each cell that shows a photo."""
    if classes is None:
        return np.where(shown > 0, Ground.DEM, Ground.NONE).astype(np.uint8)
    with rasterio.open(classes) as file:
        values = file.read(1)
        cell, _, west, _, _, north = tuple(file.transform)[:6]
    east, up = grid.centres()
    columns = np.floor((east - west) / cell).astype(np.int64)
    rows = np.floor((north - up) / cell).astype(np.int64)
    # Beyond what the surface was made of nothing is added to the DEM.
    padded = np.pad(values, 1, constant_values=Ground.DEM_ALONE)
    down, across = (
        np.clip(places + 1, 0, size + 1)
        for places, size in zip((rows, columns), values.shape, strict=True)
    )
    return np.where(shown > 0, padded[np.ix_(down, across)], Ground.NONE).astype(np.uint8)


@contextmanager
def _opened(path: Path, grid: Grid, crs: str, dtype: str, bands: int = 1) -> Generator[Any]:
    """A new raster of cells."""
    profile = tiled_profile(grid, crs, dtype, bands)
    profile |= {"compress": "deflate", "zlevel": COMPRESSION_LEVEL, "sparse_ok": False}
    if dtype == "float32":
        # source: TIFF, predictor of floating numbers
        profile |= {"nodata": NODATA_M, "predictor": 3, "interleave": "band"}
    with tell_full_disk(path), rasterio.open(path, "w", **profile) as file:
        yield file


def _name(file: Any, what: Sequence[str], unit: str) -> None:
    """Say in a file what its bands hold."""
    for band, said in enumerate(what, 1):
        file.set_band_description(band, said)
        file.set_band_unit(band, unit)


def _hue(number: int) -> tuple[int, int, int]:
    """A colour of its own for a photo, far from those of the numbers beside it."""
    hue, light = (number * GOLDEN) % 1, BRIGHTNESSES[number % len(BRIGHTNESSES)]
    red, green, blue = (round(255 * one) for one in colorsys.hsv_to_rgb(hue, SATURATION, light))
    return red, green, blue


def _rgb(colour: str) -> tuple[int, int, int]:
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue
