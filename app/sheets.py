"""Map sheets of a block: read, cut where their pixels have changed, kept in `results/sheets`."""

from collections.abc import Generator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import shapely

from app.orthos import read_area, read_polygons
from app.project import Project
from app.sheets_section import SheetsSection
from core.errors import ProjectError
from core.geometry.areas import Area, only_areas
from core.mosaic.composition import MosaicProduct
from core.progress import Progress
from core.raster.ortho import open_ortho
from core.said import Said, say
from core.sheets.delivery import CHECK_SUMS, INDEX, Delivery, SheetFile
from core.sheets.map_sheets import (
    Corner,
    MapSheet,
    corner_line,
    read_sheet_index,
    state_map_sheets,
    unknown_corners,
)
from core.sheets.pixels import target_system
from core.sheets.stage import VERSION, SheetOptions, cut_sheets
from sessions.atomic_write import whole_file, whole_folder
from sessions.checks import version_on_disk
from sessions.disk import explain_disk_errors
from sessions.products import stamp_of
from sessions.session import Session

FOLDER = "sheets"
"""Folder of the sheets among the results."""
WIDEST_M = 200_000.0  # design: wider than any block, narrower than a web map of a country.
"""A reference that is wider does not say where the mosaic will lie, metres."""
COMPANIONS: Mapping[str, tuple[str, ...]] = {
    ".tif": (".tfw",),
    ".jp2": (".j2w", ".jp2.msk", ".jp2.aux.xml"),
}
"""Files that may belong to a sheet, by what its name ends with."""
PRODUCT = "sheets"
"""Product that keeps the last delivery."""


def check_sheets(project: Project) -> tuple[MapSheet, ...]:
    """The sheets of the index layer, before anything is computed; none where a rule makes them.

    Raises:
        ProjectError: No sheets are named, or their files need a year that nobody states.
        ReferenceDataError: The index cannot be used, or the rule knows no sheet where the
            reference lies.
        CrsError: Index or border lie in a CRS that PROJ cannot bring to the block's, or sheets are
            wanted in one that it cannot be brought to.
    """
    section, crs = project.sheets, project.block.crs
    if not section.asked:
        raise ProjectError(
            project.file,
            "names no map sheets.",
            'Give their polygons, [ortho] sheets = "sheets.gpkg", or [sheets] rule = "sm5".',
        )
    undated = [scan.photo_id for scan in project.scans.listed if not scan.taken]
    if section.product and section.year is None and undated:
        raise ProjectError(
            project.file,
            "names of sheets need a year, and nobody says when {photo} was taken.",
            "Give [scans] taken, or [sheets] year.",
            photo=undated[0],
        )
    read_border(project)
    ground = _likely_ground(project)
    if ground is not None:
        for text in section.crs:
            target_system(text, crs, ground.bounds, f"{project.file} [sheets] crs")
        _unnamed_corners(project, ground)
    return () if section.index is None else read_sheet_index(section.index, crs)


def _likely_ground(project: Project) -> Area | None:
    """Where the mosaic will lie, as far as area and reference say; None where they do not.

    A web map of a country says nothing of where in it the block lies.
    """
    area, files = read_area(project), project.reference.ortho
    if not files:
        return area
    bounds = open_ortho(files, project.block.crs).bounds
    ground = shapely.box(*bounds) if area is None else only_areas(area & shapely.box(*bounds))
    west, south, east, north = ground.bounds
    known = not ground.is_empty and max(east - west, north - south) <= WIDEST_M
    return ground if known else None


def _unnamed_corners(project: Project, ground: Area) -> tuple[Corner, ...]:
    """Corners of the sheets 1:50 000 over ground for which the rule has no letters."""
    section = project.sheets
    if section.index is not None:
        return ()
    return unknown_corners(ground, project.block.crs, section.sm50, _place_of_rule(project))


def _place_of_rule(project: Project) -> str:
    return f"{project.file} [sheets] rule"


def sheet_notes(project: Project, sheets: Sequence[MapSheet]) -> tuple[Said, ...]:
    """A note where sheets of the index or the rule do not fit the reference; told early.

    Args:
        project: Which sheets, and where the block lies.
        sheets: Those of `check_sheets`.
    """
    index, files = project.sheets.index, project.reference.ortho
    if index is None:
        ground = _likely_ground(project)
        unnamed = () if ground is None else _unnamed_corners(project, ground)
        return (_letters_note(unnamed),) if unnamed else ()
    if not files:
        return ()
    ground = shapely.box(*open_ortho(files, project.block.crs).bounds)
    if any(sheet.area.intersects(ground) for sheet in sheets):
        return ()
    return (
        say(
            "{name}: none of its {count:# sheet|# sheets} lies where the reference ortho does, so "
            "there will be nothing to cut. Give the index of the country the block lies in, and "
            "check its CRS.",
            name=index.name,
            count=len(sheets),
        ),
    )


def _letters_note(unnamed: Sequence[Corner]) -> Said:
    east, north = unnamed[0]
    return say(
        "The letters of {count:# sheet|# sheets} 1:50 000 on the reference are not known, such as "
        "the one with its north-east corner at {corner} (EPSG:5514): where the mosaic reaches "
        "there, no sheets can be cut. Give the letters in [sheets], {line}.",
        count=len(unnamed), corner=f"[{east:.0f}, {north:.0f}]", line=corner_line(unnamed[0]),
    )  # fmt: skip


def unasked_sheets(project: Project) -> tuple[Said, ...]:
    """A note where `[sheets]` says how sheets are to be, and nothing says which."""
    if project.sheets.asked or project.sheets == SheetsSection():
        return ()
    alone = (
        '{file}: [sheets] names no map sheets, so none are cut. Add rule = "sm5" to it, or sheets, '
        "an index layer, to [ortho]."
    )
    return (say(alone, file=project.file),)


def read_border(project: Project) -> Area | None:
    """Where sheets may show something, in the block's CRS; None for everywhere."""
    section = project.sheets
    if section.border is None:
        return None
    area = read_polygons(section.border, project)
    return only_areas(area.buffer(section.border_m, join_style="mitre"))


def make_sheets(
    session: Session,
    project: Project,
    mosaic: MosaicProduct,
    progress: Progress,
    *,
    anew: bool = False,
) -> Delivery:
    """The map sheets of a mosaic; those whose pixels have not changed stay as they are.

    Args:
        session: Where they are kept.
        project: Which sheets, and how.
        mosaic: The mosaic on disk.
        progress: Told after every window.
        anew: Make all of them again.

    Raises:
        PhotogrammetryError: Something named in `block.toml` cannot be used.
        StorageError: The disk is full or may not be written; whole sheets stay.
    """
    products, folder = session.products, session.results / FOLDER
    inputs = products.digest_of(
        "sheets", VERSION, mosaic.path, mosaic.seams, project.sheets, project.taken,
        project.block.crs,
    )  # fmt: skip
    former: Delivery | None = products.latest_value(PRODUCT)
    kept: Delivery | None = None
    if former is not None and not anew:
        kept = products.load_value(PRODUCT, _digest(session, inputs, former))
    version = version_on_disk(products)
    fresh = kept is not None and all((folder / name).is_file() for name in _files(kept))
    if kept is not None and fresh and kept.mosaic == version:
        return replace(kept, made=0)
    sheets = check_sheets(project)
    where = project.sheets.index or _place_of_rule(project)
    if project.sheets.index is None:
        shown = only_areas(shapely.union_all([seam.area for seam in mosaic.seams]))
        sheets = state_map_sheets(shown, project.block.crs, project.sheets.sm50, where)
    delivery = cut_sheets(
        mosaic.path, mosaic.seams, sheets, folder, options=_options(project),
        keeper=Keeper(session, anew), where=where, progress=progress,
    )  # fmt: skip
    if former is not None:
        _remove(folder, set(_files(former)) - set(_files(delivery)))
    delivery = replace(delivery, mosaic=version)
    products.save_value(PRODUCT, _digest(session, inputs, delivery), delivery)
    return delivery


def gone_sheets(session: Session) -> tuple[Path, ...]:
    """Sheets of the last delivery, and what belongs to them, that are no longer there."""
    delivery: Delivery | None = session.products.latest_value(PRODUCT)
    files = () if delivery is None else delivery.files
    paths = [session.results / FOLDER / name for one in files for name in one.every_file]
    return tuple(path for path in paths if not path.is_file())


def sheets_line(delivery: Delivery) -> Said:
    """How many sheets, how many of their files are new, and how many lie outside."""
    told = say(
        "{count:# sheet|# sheets} in {files:# file|# files}, {made} made now",
        count=len(delivery.sheets), files=len(delivery.files), made=delivery.made,
    )  # fmt: skip
    if not delivery.outside:
        return told
    outside = "{told}; {outside:# sheet|# sheets} outside the mosaic left out"
    return say(outside, told=told, outside=delivery.outside)


def _options(project: Project) -> SheetOptions:
    section = project.sheets
    return SheetOptions(
        formats=section.formats,
        crs=section.crs,
        overlap_m=section.overlap_m,
        border=read_border(project),
        lossy_percent=section.lossy_percent,
        product=section.product,
        year=section.year,
        taken=project.taken,
    )


def _files(delivery: Delivery) -> tuple[str, ...]:
    """All files of a delivery, from its folder."""
    return (INDEX, CHECK_SUMS, *(name for one in delivery.files for name in one.every_file))


def _digest(session: Session, inputs: str, delivery: Delivery) -> str:
    """What a delivery was made from, and its files as they stand."""
    folder = session.results / FOLDER
    return session.products.digest_of(inputs, [folder / name for name in _files(delivery)])


def _remove(folder: Path, names: set[str]) -> None:
    """Take away what an earlier delivery made and this one has not; folders that are then empty."""
    for name in sorted(names):
        with explain_disk_errors(folder / name):
            (folder / name).unlink(missing_ok=True)
        if (folder / name).parent != folder:
            with suppress(OSError):
                (folder / name).parent.rmdir()


class Keeper:
    """Keeps sheets in `results/sheets`, and what they were made from among the products."""

    def __init__(self, session: Session, anew: bool = False) -> None:
        """The keeper of a session; one that knows nothing where all is to be made anew."""
        self._session, self._anew = session, anew
        self._folder = session.results / FOLDER

    def kept(self, file: str, made_from: tuple[Any, ...]) -> SheetFile | None:
        """The entry of a file that is there as it was made, from the same."""
        if self._anew:
            return None
        entry: SheetFile | None = self._session.products.load_value(
            f"sheet/{file}", self._digest(file, made_from)
        )
        if entry is None or not all((self._folder / name).is_file() for name in entry.every_file):
            return None
        return entry

    @contextmanager
    def making(self, file: str) -> Generator[Path]:
        """A temporary that takes the file's place when all went well."""
        target = self._folder / file
        endings = COMPANIONS.get(target.suffix, ())
        try:
            with whole_file(target) as temporary:
                yield temporary
                beside = {end: temporary.with_name(temporary.stem + end) for end in endings}
                made = [end for end, path in beside.items() if path.exists()]
        except BaseException:
            # The folder was made for it if it holds nothing else.
            if target.parent != self._folder:
                with suppress(OSError):
                    target.parent.rmdir()
            raise
        # What an earlier file of another format had beside it would speak of this one.
        for end in set(endings) - set(made):
            target.with_name(target.stem + end).unlink(missing_ok=True)

    def making_folder(self, folder: str) -> AbstractContextManager[Path]:
        """The same for a folder."""
        return whole_folder(self._folder / folder)

    def keep(self, made_from: tuple[Any, ...], entry: SheetFile) -> SheetFile:
        """Remember an entry, completed by the companions of its file."""
        target = self._folder / entry.file
        beside = [target.with_name(target.stem + end) for end in COMPANIONS[target.suffix]]
        companions = tuple(
            path.relative_to(self._folder).as_posix() for path in beside if path.is_file()
        )
        entry = replace(entry, companions=companions)
        digest = self._digest(entry.file, made_from)
        self._session.products.save_value(f"sheet/{entry.file}", digest, entry)
        return entry

    def _digest(self, file: str, made_from: tuple[Any, ...]) -> str:
        target = self._folder / file
        # World files of the other formats lie beside it and say nothing of it.
        own = [target.with_name(target.stem + end) for end in COMPANIONS.get(target.suffix, ())]
        stamps = [stamp_of(path) for path in (target, *own)]
        return self._session.products.digest_of("sheet", *made_from, stamps)
