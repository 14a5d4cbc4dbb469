"""Blocks of several years over one place: each is compared with the one before it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from shapely.geometry.base import BaseGeometry

from app.block_toml import FILE, folder_of
from app.epochs import Epoch, epoch_of
from app.project import read_project
from core.errors import ProjectError
from core.formats.vectors import write_polygons
from core.geometry.crs import Bounds, shared_bounds
from core.mosaic.change import DIFFERENT, ChangeMap, areas_of, find_change
from core.progress import Part, Progress
from core.raster.dem import open_dem
from core.raster.grid import Grid
from core.raster.ortho import Ortho, open_ortho
from core.said import say
from core.surface.change import DatedSurface, HeightChange, compare_surfaces
from sessions.atomic_write import whole_file
from sessions.disk import explain_disk_errors

CHANGE = "change.gpkg"
"""The areas that have changed, a layer for each pair of years."""
# design: what is counted is told to a thousandth
COUNTED_CELLS = 400
"""Cells along the longer side in which ground that both mosaics show is counted."""
# design: 10 000 square metres
HECTARE_M2 = 1e4
RAISED, LOWERED, PICTURE = "raised", "lowered", "different picture"


@dataclass(frozen=True, slots=True)
class DatedBlock:
    """A block that was run, and when it was flown."""

    epoch: Epoch
    """Its mosaic and surface."""
    year: int
    """Median year of its scans."""
    crs: str
    """Of its coordinates."""


@dataclass(frozen=True, slots=True, eq=False)
class YearPair:
    """What has changed from one year to another."""

    earlier: int
    """The first year."""
    later: int
    """The second."""
    common_m2: float
    """Ground that both mosaics show."""
    picture: ChangeMap
    """What became of the picture."""
    heights: HeightChange | None
    """What became of the heights; None where one has no surface, or none in common."""

    @property
    def name(self) -> str:
        """Layer of the file."""
        return f"{self.earlier}-{self.later}"

    @property
    def figures(self) -> Mapping[str, object]:
        """For machines."""
        told: dict[str, object] = {
            "earlier": self.earlier,
            "later": self.later,
            "common_m2": self.common_m2,
            "picture": self.picture.shares,
        }
        if self.heights is not None:
            trend = self.heights.trend
            told["heights"] = {
                "compared_m2": self.heights.compared_m2,
                "systematic_m": trend.coefficients.tolist(),
                "nmad_m": trend.nmad_m,
                "scatter": self.heights.scatter,
            } | {
                kind: {"areas": count, "area_m2": area, "volume_m3": volume}
                for kind, count, area, volume in sums(self.heights)
            }
        return told


def dated_blocks(blocks: Sequence[Path]) -> tuple[DatedBlock, ...]:
    """The blocks in the order of their years.

    Raises:
        ProjectError: One is no block, was not run, or has no date; or two are of one year.
    """
    found = sorted((_dated(folder_of(block).resolve()) for block in blocks), key=lambda b: b.year)
    if len(found) < 2:
        remedy = "Name two blocks or more, of different years."
        raise ProjectError(blocks[0], "one block alone shows no change.", remedy)
    for one, other in pairwise(found):
        if one.year == other.year:
            cause = say(
                "it is of {year}, and so is {other}.", year=one.year, other=other.epoch.folder
            )
            raise ProjectError(one.epoch.folder, cause, "Name one of them.")
    return tuple(found)


def _dated(folder: Path) -> DatedBlock:
    epoch = epoch_of(folder)
    if not isinstance(epoch, Epoch):
        raise ProjectError(folder, epoch, "Name folders of blocks that were run.")
    project = read_project(folder)
    years = [int(day[:4]) for day in project.taken.values()]
    if not years:
        cause = "no scan has a date, so nobody knows which year it shows."
        raise ProjectError(project.file, cause, "Add taken to [scans].")
    return DatedBlock(epoch, round(float(np.median(years))), project.block.crs)


def compare_years(
    blocks: Sequence[DatedBlock], out: Path, progress: Progress
) -> tuple[YearPair, ...]:
    """Compare each block with the one before it, and write what has changed.

    Args:
        blocks: In the order of their years.
        out: The folder: `change.gpkg`, and a raster of the height differences of each pair.
        progress: Told of all; may raise `Cancelled`.

    Raises:
        ProjectError: Two that follow each other have no ground in common; or the folder lies in
            a block, whose files are its own.
    """
    pairs: list[YearPair] = []
    inside = next((one for one in (out, *out.resolve().parents) if (one / FILE).is_file()), None)
    if inside is not None:
        remedy = "Name a folder of its own with --out."
        raise ProjectError(out, "lies in the block {block}.", remedy, block=inside)
    with explain_disk_errors(out):
        for number, (earlier, later) in enumerate(pairwise(blocks)):
            part = Part(progress, number / (len(blocks) - 1), (number + 1) / (len(blocks) - 1))
            pairs.append(_compare(earlier, later, out, part))
        crs = blocks[-1].crs
        with whole_file(out / CHANGE) as path:
            for number, pair in enumerate(pairs):
                _write_layer(path, pair, blocks[number + 1].crs or crs, append=number > 0)
    return tuple(pairs)


def _compare(earlier: DatedBlock, later: DatedBlock, out: Path, progress: Progress) -> YearPair:
    """One pair, in the CRS of the later block."""
    crs, folder = later.crs, later.epoch.folder
    then, now = (open_ortho([one.epoch.mosaic], crs) for one in (earlier, later))
    bounds = shared_bounds(then.bounds, now.bounds)
    common_m2 = _common_m2(then, now, bounds)
    if not common_m2:
        cause = say("it has no ground in common with {other}.", other=earlier.epoch.folder)
        raise ProjectError(folder, cause, "Compare blocks over one place.")
    picture = find_change(now, then, bounds, Part(progress, 0.0, 0.6))
    heights = None
    out.mkdir(parents=True, exist_ok=True)
    target = out / f"height_change_{earlier.year}_{later.year}.tif"
    if earlier.epoch.has_surface and later.epoch.has_surface:
        heights = _compare_heights(earlier, later, target, Part(progress, 0.6, 1.0))
    if heights is None:
        target.unlink(missing_ok=True)
    return YearPair(earlier.year, later.year, common_m2, picture, heights)


def _compare_heights(
    earlier: DatedBlock, later: DatedBlock, target: Path, progress: Progress
) -> HeightChange | None:
    crs = later.crs
    first, second = (
        DatedSurface(open_dem(files.surface, crs), open_dem(files.sigma, crs))
        for files in (earlier.epoch.surface, later.epoch.surface)
    )
    west, south, east, north = shared_bounds(first.heights.bounds, second.heights.bounds)
    if west >= east or south >= north:
        return None
    with whole_file(target) as path:
        return compare_surfaces(first, second, (west, south, east, north), path, crs, progress)


def _common_m2(one: Ortho, other: Ortho, bounds: Bounds) -> float:
    """Ground that both mosaics show."""
    west, south, east, north = bounds
    if west >= east or south >= north:
        return 0.0
    finest = max(one.ground_sample_distance_m, other.ground_sample_distance_m)
    grid = Grid.over(bounds, max(finest, max(east - west, north - south) / COUNTED_CELLS))
    shown = np.minimum(one.read_coverage(grid), other.read_coverage(grid))
    return float(shown.sum()) * grid.ground_sample_distance_m**2


def _write_layer(path: Path, pair: YearPair, crs: str, *, append: bool) -> None:
    """What has changed between two years, a polygon each."""
    heights = () if pair.heights is None else pair.heights.areas
    pictures = areas_of(pair.picture, DIFFERENT)
    areas: list[BaseGeometry] = [*(one.outline for one in heights), *pictures]
    kinds = [*(_kind(one.mean_m) for one in heights), *[PICTURE] * len(pictures)]
    unknown = np.full(len(pictures), np.nan)
    fields = {
        "kind": np.array(kinds, dtype=object),
        "first": np.full(len(areas), pair.earlier),
        "last": np.full(len(areas), pair.later),
        "area_m2": np.array([area.area for area in areas], dtype=np.float64),
        "mean_m": np.append([one.mean_m for one in heights], unknown),
        "sigma_m": np.append([one.sigma_m for one in heights], unknown),
        "volume_m3": np.append([one.volume_m3 for one in heights], unknown),
    }
    write_polygons(path, pair.name, areas, fields, crs=crs, append=append)


def _kind(mean_m: float) -> str:
    return RAISED if mean_m > 0 else LOWERED


def sums(change: HeightChange) -> Iterator[tuple[str, int, float, float]]:
    """Kind, number of areas, their ground (m2) and volume (m3)."""
    for kind in (RAISED, LOWERED):
        found = [one for one in change.areas if _kind(one.mean_m) == kind]
        area, volume = sum(one.area_m2 for one in found), sum(one.volume_m3 for one in found)
        yield kind, len(found), area, volume


def told_lines(pair: YearPair) -> Iterator[str]:
    """What has changed between two years, in sentences."""
    heights, shares = pair.heights, pair.picture.shares
    yield say(
        "{earlier} to {later}: {area:.1f} ha in both mosaics, picture different in "
        "{different:.0f} %, the same in {same:.0f} %",
        earlier=pair.earlier,
        later=pair.later,
        area=pair.common_m2 / HECTARE_M2,
        different=100 * shares["different"],
        same=100 * shares["same"],
    )
    if heights is None:
        yield "  heights are not compared: surfaces of both years are needed ([surface])"
        return
    yield say(
        "  heights: {share:.0f} % compared, {size:.2f} m systematic (taken out), {nmad:.2f} m "
        "scatter",
        share=100 * min(heights.compared_m2 / pair.common_m2, 1.0),
        size=heights.trend.size_m,
        nmad=heights.trend.nmad_m,
    )
    told = {
        RAISED: "  raised {count:# area|# areas}, {area:.2f} ha, {volume:.0f} m³",
        LOWERED: "  lowered {count:# area|# areas}, {area:.2f} ha, {volume:.0f} m³",
    }
    for kind, count, area, volume in sums(heights):
        yield say(told[kind], count=count, area=area / HECTARE_M2, volume=volume)
