"""`[reference]` and `[[reference.other]]` of `block.toml`: what is known of the ground."""

import os
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from app.block_schema import missing_reference
from app.block_toml import FILE, Document, Table
from app.epochs import YearsOf, named_epoch
from core.adjustment.adjusted import AdjustmentReport
from core.block import USED
from core.matching.reference import (
    DEM_SIGMA,
    ORTHO_SIGMA,
    ReferenceFiles,
    ReferenceLayer,
)
from core.raster.dem import open_dem
from core.raster.ortho import Ortho, open_ortho
from core.said import say


@dataclass(frozen=True, slots=True)
class DatedReference:
    """Ortho and heights of one time."""

    ortho: tuple[Path, ...] = ()
    """Sheets of an orthophoto."""
    dem: tuple[Path, ...] = ()
    """Files of terrain heights."""
    year: int | None = None
    """Of the ortho; None where it is not stated."""
    ortho_sigma_m: float | None = None
    """Standard deviation of a coordinate of the ortho, metres; None where it is not stated."""
    dem_sigma_m: float | None = None
    """Standard deviation of a height, metres; None where it is not stated."""

    def name(self, folder: Path) -> str:
        """What the report calls it: path from a folder to its file or files; its year."""
        files = self.ortho or self.dem
        file = files[0] if len(files) == 1 else files[0].parent
        return named(file, folder, self.year)

    def sigmas_m(self, crs: str) -> tuple[float, float]:
        """Standard deviations of ortho and heights, metres: as stated, else by their pixels.

        Raises:
            PhotogrammetryError: Nothing is stated, and a file cannot be read.
        """
        ortho, dem = self.ortho_sigma_m, self.dem_sigma_m
        if ortho is None:
            pixel_m = open_ortho(self.ortho, crs).ground_sample_distance_m if self.ortho else 0.0
            ortho = ORTHO_SIGMA.expected_m(pixel_m)
        if dem is None:
            cell_m = open_dem(self.dem, crs).ground_sample_distance_m if self.dem else 0.0
            dem = DEM_SIGMA.expected_m(cell_m)
        return ortho, dem


@dataclass(frozen=True, slots=True)
class OtherReference(DatedReference):
    """A table of `[[reference.other]]`: it judges mosaic and heights, and may tie photos."""

    ties: bool = False
    """Whether photos are tied to it as well, where it is nearer in time or alone."""
    block: Path | None = None
    """The folder of the block whose mosaic is the ortho; None where files are named."""

    def name(self, folder: Path) -> str:
        """What the report calls it: path from a folder to the block or the files; its year."""
        if self.block is None:
            return DatedReference.name(self, folder)
        return named(self.block, folder, self.year)


@dataclass(frozen=True, slots=True)
class ReferenceSection(DatedReference):
    """`[reference]`: without an ortho no control is proposed, without heights ground is level."""

    roads: tuple[Path, ...] = ()
    """Road layers; without any, salient points of the ortho serve as control."""
    buildings: Path | None = None
    """Polygons that seams keep away from."""
    woods: Path | None = None
    """Polygons that seams cross less than fields."""
    water: Path | None = None
    """Polygons that seams cross still less."""
    bridges: Path | None = None
    """3D polygons that replace the DEM under them."""
    mask: Path | None = None
    """Polygons within which nothing is matched."""
    other: tuple[OtherReference, ...] = ()
    """Further references."""

    def years(self, crs: str) -> tuple[tuple[int, Ortho], ...]:
        """Orthos of other years, in their order, opened in a CRS."""
        dated = [(one.year, one.ortho) for one in self.other if one.ortho and one.year is not None]
        return tuple((year, open_ortho(files, crs)) for year, files in sorted(dated))

    def layers(self, crs: str, taken: Collection[str], folder: Path) -> Iterator[ReferenceLayer]:
        """What photos are tied to, nearest in time first; nothing where it is this one alone.

        This one says where the block lies; the others may be shifted against it.

        Args:
            crs: The block's CRS.
            taken: Days, months or years of exposure.
            folder: What names are counted from.
        """
        if not any(one.ties for one in self.other):
            return
        flown = float(np.median([int(day[:4]) for day in taken]))
        tied = [self, *(one for one in self.other if one.ties)]
        # What has no year is today's.
        away = [np.inf if one.year is None else abs(one.year - flown) for one in tied]
        for number in np.argsort(away, kind="stable"):
            one = tied[number]
            layer = ReferenceLayer(one.name(folder), one.ortho, one.dem, *one.sigmas_m(crs))
            yield replace(layer, datum=one is self)


def named(path: Path, folder: Path, year: int | None) -> str:
    """A path as seen from a folder, with its year."""
    told = Path(os.path.relpath(path, folder)).as_posix()
    return told if year is None else f"{told} ({year})"


def read_reference(
    document: Document, brought: bool, dated: bool, years_of: YearsOf
) -> ReferenceSection:
    """The section with its further references.

    Args:
        document: The `block.toml`.
        brought: Whether points were brought into the block, which may tell where it lies.
        dated: Whether a scan has a day of exposure.
        years_of: Tells the years of another block that is named.

    Raises:
        ProjectError: Something in it cannot be used.
    """
    table = document.table("reference")
    for needed in missing_reference(document.values, brought=brought):
        if table.has("ortho"):
            cause = say("is missing: without heights an ortho gives no control.")
            remedy = say("Add terrain heights, or leave `ortho` out.")
        else:
            cause = say("is missing, and nothing else says where the block lies.")
            remedy = say(
                "Add ortho and dem, or surveyed points ([control] points), or exterior "
                "orientations ([scans] exterior)."
            )
        raise table.error(needed, cause, remedy)
    tables = [one for one in document.tables("reference.other") if one.values]
    others = tuple(_other(one, years_of) for one in tables)
    first = next((one for one in tables if one.flag("ties")), None)
    if first is not None and not table.has("ortho"):
        cause = say("[reference] itself names no ortho.")
        raise first.error("ties", cause, "Name this one in [reference] itself.")
    if first is not None and not dated:
        cause = say("no scan has a date, so nobody knows which reference is nearest in time.")
        raise first.error("ties", cause, "Add taken to [scans], or leave ties out.")
    return ReferenceSection(
        *_dated(table),
        table.files("roads"),
        table.file("buildings"),
        table.file("woods"),
        table.file("water"),
        table.file("bridges"),
        table.file("mask"),
        others,
    )


def tied_to(files: ReferenceFiles, report: AdjustmentReport) -> dict[ReferenceLayer, int]:
    """How many control points in use each reference gave; nothing where there is but one."""
    block = report.block
    used = {key[0] for key, m in block.measurements.items() if report.final_status(m)[0] in USED}
    given = (block.surveyed[name] for name in used)
    counts = Counter(
        point.shifted for point in given if point.role == "control" and point.source != "surveyed"
    )
    return {one: counts[one.shifted] for one in files.layers}


def _other(table: Table, years_of: YearsOf) -> OtherReference:
    if table.has("block"):
        return _other_block(table, years_of)
    ortho, dem, year, ortho_m, dem_m = _dated(table)
    if not ortho and not dem:
        cause = "names neither an ortho nor heights."
        raise table.error("ortho", cause, "Name one of them, or take the table away.")
    if table.flag("surface"):
        raise table.error("surface", "no block is named.", "Add block, or name heights in dem.")
    _check_year(table, year)
    return OtherReference(ortho, dem, year, ortho_m, dem_m, table.flag("ties"))


def _other_block(table: Table, years_of: YearsOf) -> OtherReference:
    """Mosaic and surface of another block; what the table states goes before what it predicts."""
    for key in ("ortho", "dem") if table.flag("surface") else ("ortho",):
        if table.has(key):
            raise table.error(key, "the block is to give it.", "Name one of the two.")
    _, dem, year, ortho_m, dem_m = _dated(table)
    epoch = named_epoch(table, table.flag("ties"))
    if year is None:
        years = years_of(Document(epoch.folder / FILE))
        year = round(float(np.median(years))) if years else None
    _check_year(table, year)
    if table.flag("surface"):
        if not epoch.has_surface:
            cause = say("{folder} has no surface.", folder=epoch.folder)
            command = f"gruber run {epoch.folder} --until surface"
            raise table.error("surface", cause, say("Make one: {command}", command=command))
        dem = (epoch.surface.surface,)
        dem_m = epoch.surface_sigma_m() if dem_m is None else dem_m
    ortho_m = epoch.mosaic_sigma_m() if ortho_m is None else ortho_m
    return OtherReference(
        (epoch.mosaic,), dem, year, ortho_m, dem_m, table.flag("ties"), epoch.folder
    )


def _check_year(table: Table, year: int | None) -> None:
    if table.flag("ties") and year is None:
        cause = say("it has no year, so nobody knows which reference is nearest in time.")
        raise table.error("ties", cause, "Add year, or leave ties out.")


def _dated(
    table: Table,
) -> tuple[tuple[Path, ...], tuple[Path, ...], int | None, float | None, float | None]:
    ortho_m, dem_m = (
        table.number(key) if table.has(key) else None for key in ("ortho_sigma_m", "dem_sigma_m")
    )
    year = int(table.number("year")) if table.has("year") else None
    return table.files("ortho"), table.files("dem"), year, ortho_m, dem_m
