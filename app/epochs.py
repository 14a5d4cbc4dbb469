"""Another block over the same ground as an epoch of it: mosaic, surface, and how sure both are."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import rasterio

from app.block_toml import FILE, Document, Table, folder_of
from core.errors import ProjectError
from core.matching.reference import ORTHO_SIGMA
from core.mosaic.origin import OriginFiles
from core.said import Said, say
from core.surface.ground import NODATA_M, TERMS, SystematicPart
from core.surface.stage import TREND_TAG, SurfaceFiles
from sessions.session import RESULTS

MOSAIC = "mosaic.tif"
"""Name of the mosaic among the results."""
# design: a quarter of a million places say what their mean square is
SAMPLE_CELLS = 512
"""Cells along the longer side that standard deviations are taken from at most."""
YearsOf = Callable[[Document], Sequence[int]]
"""Years in which the scans of a `block.toml` were taken."""


@dataclass(frozen=True, slots=True)
class Epoch:
    """What a block that was run knows of its ground."""

    folder: Path
    """The block's folder."""

    @property
    def mosaic(self) -> Path:
        """Its mosaic."""
        return self.folder / RESULTS / MOSAIC

    @property
    def surface(self) -> SurfaceFiles:
        """Its surface; the files need not be there."""
        return SurfaceFiles.within(self.folder / RESULTS)

    @property
    def has_surface(self) -> bool:
        """Whether heights were measured in its photos."""
        return self.surface.surface.is_file() and self.surface.sigma.is_file()

    def mosaic_sigma_m(self) -> float:
        """Standard deviation per axis of its mosaic, metres.

        What the block predicts, and what its own reference may be off: where control is dense,
        the errors of an ortho that hang together pass into the mosaic as they are.

        Raises:
            ProjectError: The report, which predicts it, was not written yet.
        """
        path = origin_files(self.folder / RESULTS).sigma
        found = _rms_m(path, path.stat().st_mtime_ns) if path.is_file() else float("nan")
        if not np.isfinite(found):
            cause = say("its mosaic has no standard deviations (results/{name}).", name=path.name)
            remedy = say("Run it up to its report: {command}", command=_command(self.folder))
            raise ProjectError(self.folder, cause, remedy)
        reference = Document(self.folder / FILE).table("reference")
        ortho_m = ORTHO_SIGMA.usual_m if reference.has("ortho") else 0.0
        if reference.has("ortho_sigma_m"):
            ortho_m = reference.number("ortho_sigma_m")
        return float(np.hypot(found, ortho_m))

    def surface_sigma_m(self) -> float:
        """Standard deviation of a height of its surface, what is systematic included, metres."""
        files = self.surface
        trend = _trend_in(files.difference)
        own_m = _rms_m(files.sigma, files.sigma.stat().st_mtime_ns)
        return own_m if trend is None else float(np.hypot(own_m, trend.size_m))


def origin_files(results: Path) -> OriginFiles:
    """The rasters that tell where each place of a mosaic comes from, in a folder of results."""
    names = ("origin_photo.tif", "origin_sigma.tif", "origin_ground.tif")
    return OriginFiles(*(results / name for name in names))


def epoch_of(folder: Path) -> Epoch | Said:
    """The epoch of a block's folder, or why it is none."""
    if not (folder / FILE).is_file():
        return say("is no block: it has no {file}.", file=FILE)
    epoch = Epoch(folder)
    if not epoch.mosaic.is_file():
        return say("has no mosaic yet. Run it first: {command}.", command=_command(folder))
    return epoch


def named_epoch(table: Table, ties: bool) -> Epoch:
    """The epoch that `block` of a table of `[[reference.other]]` names.

    Args:
        table: The table.
        ties: Whether photos are tied to its mosaic.

    Raises:
        ProjectError: It is no block that was run, or this one, or one whose mosaic hangs on this.
    """
    own, folder = table.document.path.parent, _folder_in(table)
    if folder == own.resolve():
        raise table.error("block", "it is this block itself.", "Name another, or leave it out.")
    found = epoch_of(folder)
    if not isinstance(found, Epoch):
        remedy = say("Correct the path; it is relative to {file}.", file=FILE)
        raise table.error("block", say("{folder} {why}", folder=folder, why=found), remedy)
    if ties and (way := _way_back(folder, own.resolve())):
        cause = say(
            "the blocks go in a circle: {names}.", names=" → ".join(one.name for one in way)
        )
        raise table.error("block", cause, "Leave ties out in one of them.")
    return found


def _folder_in(table: Table) -> Path:
    return folder_of((table.document.path.parent / table.text("block")).resolve())


def _way_back(begin: Path, own: Path) -> tuple[Path, ...]:
    """The blocks from one, each tied to the next, that lead to another; nothing where none do."""
    waiting: list[tuple[Path, ...]] = [(own, begin)]
    seen = {begin}
    while waiting:
        way = waiting.pop()
        for folder in _tied_blocks(way[-1]):
            if folder == own:
                return (*way, own)
            if folder not in seen:
                seen.add(folder)
                waiting.append((*way, folder))
    return ()


def _tied_blocks(folder: Path) -> Iterator[Path]:
    """Blocks that the photos of one are tied to."""
    if (folder / FILE).is_file():
        for table in Document(folder / FILE).tables("reference.other"):
            if table.has("block") and table.flag("ties"):
                yield _folder_in(table)


@lru_cache(maxsize=64)
def _rms_m(path: Path, changed: int) -> float:
    """Root mean square of standard deviations in a raster, over its bands, metres.

    Args:
        path: The raster.
        changed: When it was written.
    """
    with rasterio.open(path) as file:
        step = max(1, -(-max(file.width, file.height) // SAMPLE_CELLS))
        shape = (file.count, max(file.height // step, 1), max(file.width // step, 1))
        values: Any = file.read(out_shape=shape)
    known = values[(values != NODATA_M) & np.isfinite(values)]
    return float(np.sqrt(np.mean(np.square(known)))) if known.size else float("nan")


def _trend_in(path: Path) -> SystematicPart | None:
    """The systematic part that a difference of heights tells; None where it tells none."""
    if not path.is_file():
        return None
    with rasterio.open(path) as file:
        told: dict[str, str] = file.tags()
    try:
        terms = np.array([float(word) for word in told.get(TREND_TAG, "").split()])
    except ValueError:
        return None
    whole = (-1.0, -1.0, 1.0, 1.0)
    return SystematicPart(whole, terms, np.nan, 0) if len(terms) == TERMS else None


def _command(folder: Path) -> str:
    return f"gruber run {folder}"
