"""Blocks without pictures: stand-ins for their scans, and the tables that end their run."""

from pathlib import Path

from app.project import Project
from app.report.protocol import write_protocol
from app.report.tables import write_results
from core.adjustment.adjusted import AdjustmentReport
from core.adjustment.influence import influence_of
from core.block import Block
from core.errors import ProjectError
from core.formats.headed_rows import HeadedForm, headed_rows
from core.formats.records import Row, scan_stem
from core.raster.dem import Dem
from core.raster.scan_file import MOST_SIDE_PX
from core.raster.scan_pixels import open_dataset
from core.raster.stand_in import is_stand_in, write_stand_in
from core.said import say
from sessions.atomic_write import whole_file
from sessions.session import Session

SIZES = HeadedForm(
    {
        "scan": "scan scanname photo photoid photoname image imageid imagename img picture file "
        "filename name id snimek sken bild",
        "columns": "columns column cols ncols ncolumns width widthpx samples sloupce sloupcu",
        "rows": "rows row nrows height heightpx lines radky radku",
    },
    (("scan",), ("columns",), ("rows",)),
    ("columns", "rows"),
    say("The list of scans without pictures needs the columns scan, columns, rows."),
)
"""Heads of a list of scans with their sizes."""


def make_stand_ins(folder: Path, table: Path) -> int:
    """Put a stand-in into a folder for every scan of a list; returns how many.

    Args:
        folder: The block's folder; made where it is not there.
        table: A list with name, columns and rows of each scan.

    Raises:
        ProjectError: The list cannot be used, or a file of that name is there; nothing was made.
    """
    sizes: dict[Path, tuple[int, int]] = {}
    for row in headed_rows(table, SIZES):
        path = folder / f"{scan_stem(row.filled('scan'))}.tif"
        row.refuse_again(path.stem, {known.stem for known in sizes})
        size = _side(row, "columns"), _side(row, "rows")
        if path.exists() and not _is_that(path, size):
            raise ProjectError(path, "is there already.", "Take it out of the list of scans.")
        sizes[path] = size
    folder.mkdir(parents=True, exist_ok=True)
    for path, size in sizes.items():
        with whole_file(path) as temporary:
            write_stand_in(temporary, size)
    return len(sizes)


def _is_that(path: Path, size: tuple[int, int]) -> bool:
    """Whether an earlier start has made this stand-in."""
    if not is_stand_in(path):
        return False
    with open_dataset(path) as dataset:
        return (dataset.width, dataset.height) == size


def _side(row: Row, name: str) -> int:
    """Columns or rows of a scan."""
    value = row.number_in(name)
    if not 1 <= value <= MOST_SIDE_PX or value != int(value):
        raise row.refused(
            "Line {number}: {value:g} pixels are no side of a scan.",
            "Give columns and rows of the scan in whole pixels.",
            value=value,
        )
    return int(value)


def has_pictures(block: Block) -> bool:
    """Whether any scan of a block has a picture."""
    return not all(is_stand_in(photo.scan) for photo in block.photos.values())


def write_adjusted(session: Session, project: Project, report: AdjustmentReport, dem: Dem) -> None:
    """Tables and protocol of an adjusted block that no report follows."""
    options = project.adjustment
    ahead = influence_of(report, options, terrain=lambda points: dem.heights(points[:, :2]))
    write_results(session.results, report)
    told = project.block.name, report, options, ahead
    write_protocol(session.results, *told, rules=project.rules)
