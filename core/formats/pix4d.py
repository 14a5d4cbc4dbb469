"""Pix4D: tables of control and checks, and of the marks where photos show them.

Source: Pix4D's support pages on GCP files (label, three coordinates, horizontal and vertical
accuracy) and on files of marks (image, label, x, y, accuracy in pixels; from the upper left).
"""

import csv
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from core.errors import ExchangeError
from core.formats.exchange import (
    Conventions,
    ExchangeBlock,
    ExchangeFormat,
    ExchangeMeasurement,
    ExchangePhoto,
    ExchangePoint,
)
from core.formats.point_axes import are_degrees
from core.formats.records import (
    Record,
    read_records,
    read_text,
    scan_stem,
    unguarded,
    write_rows,
)
from core.said import say

POINTS, CHECKS, MARKS = "gcp.csv", "checkpoints.csv", "marks.csv"
"""Files we write: control, checks, and where they are seen."""
TEXTS = (".csv", ".txt")
"""Endings of its tables."""
DELIMITERS = (";", "\t", ",")
"""What may part the cells: that which makes the most of them, else blanks."""
AGAIN = "Export it again from Pix4D."


def write_pix4d_points(path: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write control, checks and their marks, without heads, into a folder.

    Returns:
        What was left out.
    """
    path.mkdir(parents=True, exist_ok=True)
    for file, role in ((POINTS, "control"), (CHECKS, "check")):
        rows = [[p.point_id, *_numbers(p)] for p in block.points.values() if p.role == role]
        if rows or role == "control":
            write_rows(path / file, rows)
    files = {name: photo.file for name, photo in block.photos.items()}
    write_rows(path / MARKS, [_mark(one, files[one.photo_id]) for one in block.measurements])
    if any(photo.exterior is not None for photo in block.photos.values()):
        return (say("The table holds points alone: no orientations and no cameras."),)
    return ()


def _numbers(point: ExchangePoint) -> tuple[float, ...]:
    """Coordinates, then accuracy in plan and height."""
    sigma = point.sigma_m
    return (*point.position, *((max(sigma[:2]), sigma[2]) if sigma is not None else ()))


def _mark(one: ExchangeMeasurement, file: str) -> list[object]:
    """Cells of a mark, the accuracy last."""
    sigma = () if one.sigma_px is None else (one.sigma_px,)
    return [file, one.point_id, one.column, one.row, *sigma]


def read_pix4d_points(path: Path) -> ExchangeBlock:
    """Read one table, or all of a folder; what a table holds is told by its first line.

    Args:
        path: A table of points or marks, or a folder of such. A name with `check` holds checks.

    Raises:
        ProjectError: A table cannot be read, or a line holds no numbers.
        ExchangeError: There are neither points nor marks, or places in degrees.
    """
    files = [path]
    if path.is_dir():
        files = sorted(one for one in path.iterdir() if one.suffix.lower() in TEXTS)
    points: dict[str, ExchangePoint] = {}
    photos: dict[str, ExchangePhoto] = {}
    measurements: list[ExchangeMeasurement] = []
    for file in files:
        records = _rows(file)
        if _are_marks(file, records):
            measurements += [_measured(record, photos) for record in records]
        else:
            _add_points(records, points)
    if not points and not measurements:
        raise ExchangeError(path, "It holds neither points nor marks.", AGAIN)
    places = [one.position[:2] for one in points.values()]
    if places and are_degrees(np.array(places)):
        raise ExchangeError(
            path, "Its points are in degrees.", "Export them in the projection of the block."
        )
    return ExchangeBlock(photos=photos, points=points, measurements=tuple(measurements))


def _rows(path: Path) -> list[Record]:
    """Lines of a table, whatever parts its cells, without a line of heads."""
    first = next(iter(read_text(path).lstrip().splitlines()), "")
    delimiter = max(DELIMITERS, key=lambda sign: len(_cells(sign, first)))
    parted = partial(_cells, delimiter) if len(_cells(delimiter, first)) > 1 else str.split
    records = read_records(path, parted, comment="")
    return records[_is_head(records[0].cells) if records else 0 :]


def _cells(delimiter: str, line: str) -> Sequence[str]:
    return [unguarded(one.strip()) for one in next(csv.reader([line], delimiter=delimiter), [])]


def _is_head(cells: Sequence[str]) -> bool:
    """Whether a line names columns: nothing in it is a number."""
    return not any(cell.lstrip("+-")[:1].isdigit() for cell in cells[1:])


def _are_marks(path: Path, records: Sequence[Record]) -> bool:
    """Whether a table is of marks: its name says so, or it begins with the file of an image."""
    if path.name.lower() == MARKS:
        return True
    return any(scan_stem(one.text(0)) != _plain(one.text(0)) for one in records[:1])


def _plain(name: str) -> str:
    """A file name without the folder that Pix4D may put before it."""
    return name.strip().replace("\\", "/").rsplit("/", 1)[-1]


def _measured(record: Record, photos: dict[str, ExchangePhoto]) -> ExchangeMeasurement:
    """A mark; its photo is put among the others."""
    file = _plain(record.text(0))
    photo = photos.setdefault(scan_stem(file), ExchangePhoto(scan_stem(file), file))
    if photo.file != file:
        raise record.refused(
            "{name} would be two scans.", "Rename one of the two scans.", name=photo.photo_id
        )
    sigma = record.value(4) if len(record.cells) > 4 and record.cells[4] else 0.0
    return ExchangeMeasurement(
        record.text(1), photo.photo_id, record.value(2), record.value(3), sigma or None
    )


def _add_points(records: Sequence[Record], points: dict[str, ExchangePoint]) -> None:
    """Put the points of a table among those of the others."""
    for record in records:
        name = record.text(0)
        record.refuse_again(name, points)
        accuracy = [n for n, cell in enumerate(record.cells) if n > 3 and cell][:2]
        plan, height = map(record.value, accuracy) if len(accuracy) == 2 else (0.0, 0.0)
        points[name] = ExchangePoint(
            name,
            record.triple(1),
            (plan, plan, height) if min(plan, height) > 0 else None,
            "check" if "check" in record.path.name.lower() else "control",
        )


PIX4D_POINTS = ExchangeFormat(
    name="pix4d-points",
    title="Pix4D: control, checks and marks",
    conventions=Conventions(
        pixels="column right, row down, outer corner of the first pixel",
        object_space="easting, northing, height, metres; the CRS is not said",
        sigmas="points, metres, plan and height; marks, pixels (a fifth column; export marks "
        "without their zoom level)",
        lost="all but surveyed points and their measurements",
    ),
    holds="upright",
    write=write_pix4d_points,
    read=read_pix4d_points,
    default_name="pix4d",
)
"""Pix4D's tables of points, both ways."""
