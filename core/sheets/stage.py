"""The door of the stage: a mosaic cut into the map sheets of a delivery.

Every file is whole or not there, and is made again only where its pixels, or what is said of it,
have changed: who keeps files and knows what they were made from is handed in.
"""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import rasterio
from shapely.geometry import MultiPolygon, Polygon

from core.errors import ProjectError, ReferenceDataError
from core.mosaic.seams import Seam
from core.progress import Part, Progress
from core.sheets.cutting import (
    RIM_PX,
    SUFFIXES,
    Form,
    Look,
    OpenMosaic,
    SheetCut,
    look_at,
    plan_cut,
    write_sheet,
)
from core.sheets.delivery import (
    CHECK_SUMS,
    INDEX,
    STAC,
    Delivery,
    SheetFile,
    check_sum,
    write_check_sums,
    write_index,
    write_items,
)
from core.sheets.map_sheets import MapSheet, file_stem, refuse_twins
from core.sheets.pixels import TargetSystem, own_system, target_system

VERSION = 1  # design: counted up when the same pixels give another file than before.
LOSSY_PERCENT = 10.0  # design: a tenth shows no loss at 1:1; lossless takes about half.
"""Size of a lossy file, in hundredths of the uncompressed one."""


@dataclass(frozen=True, slots=True, eq=False)
class SheetOptions:
    """How sheets are cut, named and written."""

    formats: tuple[Form, ...] = ("geotiff",)
    """Formats, each of every sheet."""
    crs: tuple[str, ...] = ()
    """CRS beside the block's own that sheets are wanted in."""
    # design: neighbours then repeat nothing.
    overlap_m: float = 0.0
    """Rim of its neighbours that a sheet shows too, metres."""
    border: Polygon | MultiPolygon | None = None
    """Outside this nothing is shown, in the block's CRS."""
    lossy_percent: float = LOSSY_PERCENT
    """Size of a lossy file, in hundredths of the uncompressed one."""
    product: str = ""
    """Four letters of the product, for names PPPPHH.RRRR.MMMMLL; empty: sheets keep their names."""
    year: int | None = None
    """Year in names; None takes that of the latest photo shown."""
    taken: Mapping[str, str] = field(default_factory=dict[str, str])
    """Day, month or year of exposure by photo."""


@runtime_checkable
class SheetKeeper(Protocol):
    """Who keeps the files of a delivery and knows what they were made from."""

    def kept(self, file: str, made_from: tuple[Any, ...]) -> SheetFile | None:
        """The entry of a file that was made from the same; None where it must be made."""
        ...

    def making(self, file: str) -> AbstractContextManager[Path]:
        """A temporary that takes the file's place, with its companions, when all went well."""
        ...

    def making_folder(self, folder: str) -> AbstractContextManager[Path]:
        """The same for a folder."""
        ...

    def keep(self, made_from: tuple[Any, ...], entry: SheetFile) -> SheetFile:
        """Remember an entry, completed by the companions of its file."""
        ...


def cut_sheets(
    mosaic: Path,
    seams: Sequence[Seam],
    sheets: Sequence[MapSheet],
    folder: Path,
    *,
    options: SheetOptions,
    keeper: SheetKeeper,
    where: str | Path,
    progress: Progress,
) -> Delivery:
    """Cut the sheets that a mosaic shows anything of, and write index map, check sums and items.

    Args:
        mosaic: Raster with square pixels, north up.
        seams: Which photo shows which part of it.
        sheets: All sheets of the index.
        folder: That of the delivery.
        options: How they are cut, named and written.
        keeper: Keeps the files.
        where: File and key of the sheets, for messages.
        progress: Told after every window.

    Raises:
        ReferenceDataError: The mosaic shows no sheet, or two would have one file.
        ProjectError: Names need a year and none is known.
        CrsError: A CRS cannot be used.
        OSError: The disk is full.
    """
    with rasterio.open(mosaic) as file:
        opened, crs = OpenMosaic(file), file.crs.to_string()
        others = [
            target_system(text, crs, opened.grid.bounds, "block.toml [sheets] crs")
            for text in options.crs
        ]
        work = _Work(opened, tuple(seams), (own_system(crs), *others), options, keeper)
        shown = _shown_sheets(work, sheets, Part(progress, 0.0, SHARE_OF_LOOKING))
        if not shown:
            raise ReferenceDataError(
                where,
                "the mosaic shows none of its {count:# sheet|# sheets}.",
                "Give the index of the country the block lies in, and check its CRS.",
                count=len(sheets),
            )
        names = [work.stem(one) for one in shown]
        refuse_twins(Path(where), names)
        done, made = [], 0
        step = (1 - SHARE_OF_LOOKING) / len(shown)
        for number, (one, name) in enumerate(zip(shown, names, strict=True)):
            begin = SHARE_OF_LOOKING + number * step
            files, fresh = _deliver(work, one, name, Part(progress, begin, begin + step))
            done += files
            made += len(files) - fresh
    _write_lists(keeper, folder, done, crs)
    progress.report(1, 1)
    return Delivery(tuple(done), len(sheets) - len(shown), made)


def _write_lists(keeper: SheetKeeper, folder: Path, files: Sequence[SheetFile], crs: str) -> None:
    """Index map, STAC items, and check sums of all."""
    with keeper.making(INDEX) as temporary:
        write_index(temporary, files, crs)
    with keeper.making_folder(STAC) as temporary:
        write_items(temporary, files, crs)
    with keeper.making(CHECK_SUMS) as temporary:
        write_check_sums(temporary, folder, files)


SHARE_OF_LOOKING = 0.2  # design: reading beside reading and packing.
"""Part of the work that looks at what the mosaic shows."""


@dataclass(frozen=True, slots=True, eq=False)
class _Shown:
    """A sheet that the mosaic shows something of."""

    sheet: MapSheet
    cut: SheetCut
    look: Look
    photos: tuple[str, ...]
    dates: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Work:
    """What the sheets of one delivery are cut from and by."""

    mosaic: OpenMosaic
    seams: tuple[Seam, ...]
    systems: tuple[TargetSystem, ...]
    options: SheetOptions
    keeper: SheetKeeper

    def cut(self, sheet: MapSheet, system: TargetSystem) -> SheetCut:
        """A sheet in one of the systems."""
        options = self.options
        return plan_cut(sheet, self.mosaic.grid, system, options.overlap_m, options.border)

    def photos_in(self, cut: SheetCut) -> tuple[str, ...]:
        """Photos that show at least a pixel of a sheet."""
        pixel = cut.grid.ground_sample_distance_m**2
        return tuple(
            seam.photo_id
            for seam in self.seams
            if seam.area.intersects(cut.area) and seam.area.intersection(cut.area).area >= pixel
        )

    def stem(self, shown: _Shown) -> str:
        """Name of a sheet's files without suffix: PPPPHH.RRRR.MMMMLL, or that of the sheet."""
        plain = file_stem(shown.sheet.name)
        options = self.options
        if not options.product:
            return plain
        years = [date[:4] for date in shown.dates]
        year = options.year or max(years, default=None)
        if year is None:
            raise ProjectError(
                "block.toml [sheets] year",
                "names of sheets need a year, and no photo of {name} says when it was taken.",
                "Give [scans] taken, or year.",
                name=shown.sheet.name,
            )
        return f"{options.product}{self.mosaic.bits:02d}.{year}.{plain}"

    def files(self) -> list[tuple[TargetSystem, Form, str]]:
        """System, format and folder of each file of a sheet.

        The first format of a suffix lies in the folder itself, others in folders of their own.
        """
        found: list[tuple[TargetSystem, Form, str]] = []
        for system in self.systems:
            words = (
                [] if system is self.systems[0] else [file_stem(system.crs.replace(":", "-"))[:40]]
            )
            suffixes: set[str] = set()
            for form in self.options.formats:
                again = SUFFIXES[form] in suffixes
                suffixes.add(SUFFIXES[form])
                found.append((system, form, "-".join([*words, form] if again else words)))
        return found


def _shown_sheets(work: _Work, sheets: Sequence[MapSheet], progress: Progress) -> list[_Shown]:
    """Sheets of which at least a pixel is seen, with what is seen of them."""
    rim = RIM_PX if any(system.resampled for system in work.systems) else 0
    shown: list[_Shown] = []
    for done, sheet in enumerate(sheets):
        progress.report(done, len(sheets), sheet.name)
        cut = work.cut(sheet, work.systems[0])
        west, south, east, north = work.mosaic.grid.bounds
        left, bottom, right, top = cut.grid.bounds
        if not (left < east and right > west and bottom < north and top > south):
            continue
        if cut.area.is_empty or min(cut.grid.columns, cut.grid.rows) < 1:
            continue
        look = look_at(work.mosaic, cut, rim)
        if look.covered_share > 0:
            photos = work.photos_in(cut)
            dates = {work.options.taken.get(photo, "") for photo in photos} - {""}
            shown.append(_Shown(sheet, cut, look, photos, tuple(sorted(dates))))
    return shown


def _deliver(
    work: _Work, shown: _Shown, stem: str, progress: Progress
) -> tuple[list[SheetFile], int]:
    """All files of a sheet, and how many of them were fresh."""
    done: list[SheetFile] = []
    fresh = 0
    every = work.files()
    for number, (system, form, folder) in enumerate(every):
        part = Part(progress, number / len(every), (number + 1) / len(every))
        part.report(0, 1, stem)
        file = f"{folder}/{stem}{SUFFIXES[form]}".lstrip("/")
        cut = shown.cut if system is work.systems[0] else work.cut(shown.sheet, system)
        size = (cut.grid.columns, cut.grid.rows)
        transform = tuple(system.transform(cut.grid))[:6]
        percent = work.options.lossy_percent if form == "jp2-lossy" else 0.0
        made_from = (VERSION, shown.look.digest, cut.area, size, transform, system.crs, form,
                     percent)  # fmt: skip
        kept = work.keeper.kept(file, made_from)
        if kept is None:
            with work.keeper.making(file) as temporary:
                write_sheet(
                    work.mosaic, cut, form, temporary,
                    lossy_percent=work.options.lossy_percent, progress=part,
                )  # fmt: skip
                total, size_bytes = check_sum(temporary), temporary.stat().st_size
            entry = SheetFile(
                shown.sheet.name, file, form, system.crs, cut.area, shown.photos, shown.dates,
                shown.look.covered_share, size, transform, total, size_bytes, (),
            )  # fmt: skip
            kept = work.keeper.keep(made_from, entry)
        else:
            fresh += 1
        # What is said of a file may have changed though its pixels have not.
        done.append(
            replace(kept, name=shown.sheet.name, photos=shown.photos, dates=shown.dates,
                    covered_share=shown.look.covered_share)
        )  # fmt: skip
    return done, fresh
