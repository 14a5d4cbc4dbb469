"""Lists of image measurements: a point, or a fiducial, in one scan a row.

The plain list has the columns `point,scan,column,row,sigma_px`; with `fiducial` in place of `point`
it holds fiducials. `[scans] ties` names such a list, and other programs' lists are read by theirs.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from core.formats.exchange import (
    Conventions,
    ExchangeBlock,
    ExchangeFormat,
    ExchangePhoto,
    ExchangeTies,
    Pair,
)
from core.formats.headed_rows import HeadedForm, headed_rows
from core.formats.records import Row, scan_stem, write_rows
from core.frames import HALF_PIXEL
from core.said import say

HEAD = ("point", "scan", "column", "row", "sigma_px")
"""Columns as they are written; pixels count from the outer corner of the first pixel, and the last
may be empty."""
Origin = Literal["corner", "middle"]
"""Where pixels count from: outer corner or middle of the first pixel."""
COLUMNS = ("point", "fiducial", "scan", "column", "row", "sigma", "used")
"""What columns may hold."""
FORM = HeadedForm(
    {
        "point": "point pointid pointname pointno pt ptid ptname name id gcp gcpid marker tie "
        "tieid tiepoint track trackid bod cislobodu punkt punktnr",
        "fiducial": "fiducial fiducialid fiducialname fiducialmark fid mark markname znacka "
        "ramovaznacka rahmenmarke",
        "scan": "scan scanname photo photoid photoname image imageid imagename img picture file "
        "filename snimek sken bild",
        "column": "column columnpx col x px pxx xpx xpixel pixelx ximage imagex sample u sloupec",
        "row": "row rowpx y py pxy ypx ypixel pixely yimage imagey line v radek",
        "sigma": "sigma sigmapx std stdev stdpx accuracy",
        "used": "used use enabled active",
    },
    (("point", "fiducial"), ("scan",), ("column",), ("row",)),
    ("column", "row", "sigma"),
    say(
        "The list needs the columns point (or fiducial), scan, column, row; name them "
        "in order with gruber import --answer columns=...; leave unread ones empty."
    ),
)
"""Heads that lists have."""
UNUSED = ("false", "no", "n", "f", "0", "ne", "nein", "off")
"""Words of the column `used` that leave a row out."""


@dataclass(frozen=True, slots=True)
class MeasurementReading:
    """How a list is to be read, as far as somebody said it."""

    columns: tuple[str, ...] | None = None
    """What each column holds, of `COLUMNS`, empty where it is not read; None where heads say it."""
    origin: Origin | None = None
    """Where its pixels count from; None, which is the corner, where nobody says it."""
    sigma_px: float = float("nan")
    """Standard deviation per axis of rows that say none, pixels; NaN where nobody says it."""


AS_WRITTEN = MeasurementReading()


@dataclass(frozen=True, slots=True)
class MeasuredRow:
    """One measurement."""

    row: Row
    """Where it stands."""
    name: str
    """Of the point or fiducial."""
    scan: str
    """As the list names it."""
    column: float
    """Pixels from the outer corner of the first one."""
    line: float
    """The same downwards."""
    sigma_px: float
    """Standard deviation per axis; NaN where nobody says it."""


@dataclass(frozen=True, slots=True)
class MeasurementList:
    """A list, read."""

    fiducials: bool
    """Whether it holds fiducials, not points."""
    rows: tuple[MeasuredRow, ...]
    """Those that are used."""
    unused: int
    """Rows that the list itself does not use."""


def read_measurement_list(path: Path, reading: MeasurementReading = AS_WRITTEN) -> MeasurementList:
    """Read a list of measurements.

    Raises:
        ProjectError: It cannot be read, its columns cannot be told, a number in it is none, or a
            point stands twice in one scan.
    """
    rows = headed_rows(path, FORM, reading.columns)
    kind = "fiducial" if "fiducial" in rows[0].heads else "point"
    shift = HALF_PIXEL if reading.origin == "middle" else 0.0
    used: list[MeasuredRow] = []
    seen: dict[str, set[str]] = {}
    for row in rows:
        if row.cell("used").lower() in UNUSED:
            continue
        name, scan = row.filled(kind), row.filled("scan")
        row.refuse_again(name, seen.setdefault(scan_stem(scan), set()))
        seen[scan_stem(scan)].add(name)
        place = row.number_in("column") + shift, row.number_in("row") + shift
        used.append(MeasuredRow(row, name, scan, *place, _sigma(row, reading)))
    return MeasurementList(kind == "fiducial", tuple(used), len(rows) - len(used))


def _sigma(row: Row, reading: MeasurementReading) -> float:
    """Standard deviation of a row, pixels."""
    if not row.cell("sigma"):
        return reading.sigma_px
    value = row.number_in("sigma")
    if value <= 0:
        raise row.refused(
            "Line {number}: the standard deviation {value:g} is not above nought.",
            "Leave the cell empty where it is not known.",
            value=value,
        )
    return value


def ties_of_rows(rows: Sequence[MeasuredRow], photo_of: Callable[[str], str]) -> ExchangeTies:
    """Rays of points that two photos see or more.

    Args:
        rows: Measurements of points.
        photo_of: The photo of a scan as the list names it.
    """
    rays: dict[str, list[MeasuredRow]] = {}
    for row in rows:
        rays.setdefault(row.name, []).append(row)
    kept = {name: own for name, own in rays.items() if len(own) > 1}
    every = [row for own in kept.values() for row in own]
    scans = [photo_of(row.scan) for row in every]
    names = tuple(dict.fromkeys(scans))
    index = {name: number for number, name in enumerate(names)}
    return ExchangeTies(
        names,
        np.repeat(np.arange(len(kept)), [len(own) for own in kept.values()]),
        np.array([index[scan] for scan in scans], dtype=np.int64),
        np.array([(row.column, row.line) for row in every]).reshape(-1, 2),
        tuple(kept),
        sigma_px=np.array([row.sigma_px for row in every]),
    )


def read_measurements(path: Path) -> ExchangeBlock:
    """A list as a block: all of its points as ties, for no list says which are surveyed.

    Raises:
        ProjectError: As `read_measurement_list`.
    """
    found = read_measurement_list(path)
    marks: dict[str, dict[str, Pair]] = {}
    for row in found.rows:
        own = marks.setdefault(row.scan, {})
        if found.fiducials:
            own[row.name] = row.column, row.line
    photos = {scan: ExchangePhoto(scan, scan, fiducials_px=own) for scan, own in marks.items()}
    ties = ExchangeTies.none() if found.fiducials else ties_of_rows(found.rows, str)
    return ExchangeBlock(photos=photos, ties=ties)


def write_measurements(path: Path, block: ExchangeBlock) -> tuple[str, ...]:
    """Write the measurements of surveyed points and all ties, numbers with all their digits."""
    rows: list[tuple[object, ...]] = [
        (one.point_id, one.photo_id, one.column, one.row, one.sigma_px or "")
        for one in block.measurements
    ]
    taken = {one.point_id for one in block.measurements} | set(block.points)
    write_rows(path, [HEAD, *rows, *tie_rows(block.ties, taken)])
    if any(photo.exterior is not None for photo in block.photos.values()) or block.cameras:
        return (say("The list holds measurements alone: no points, orientations and cameras."),)
    return ()


def tie_rows(ties: ExchangeTies, taken: Collection[str]) -> list[tuple[object, ...]]:
    """Rays as rows of a list; a tie point with a name that is taken gets another."""
    names = list(ties.names or map(str, range(int(ties.point.max(initial=-1)) + 1)))
    known = {*taken, *names}
    for number, name in enumerate(names):
        if name in taken:
            while name in known:
                name = f"{name}-tie"
            known.add(name)
            names[number] = name
    sigmas = np.full(len(ties.point), np.nan) if ties.sigma_px is None else ties.sigma_px
    rays = zip(ties.point, ties.photo, ties.pixels.tolist(), sigmas.tolist(), strict=True)
    return [
        (names[point], ties.photo_ids[photo], *pixel, sigma if np.isfinite(sigma) else "")
        for point, photo, pixel, sigma in rays
    ]


MEASUREMENTS = ExchangeFormat(
    name="measurements",
    title="Image measurements as a table",
    conventions=Conventions(
        pixels="column right, row down, outer corner of the first pixel; lists that count from its "
        "middle are read with `--answer origin=middle`",
        object_space="none",
        sigmas="measurements, pixels",
        lost="all but measurements of surveyed points, ties and, when read, fiducials: a list with "
        "the column `fiducial` in place of `point`",
        tested="ERDAS (Addis Ababa): points, ties and fiducials of a block",
    ),
    holds="film",
    write=write_measurements,
    read=read_measurements,
    default_name="measurements.csv",
    folder=False,
)
"""Measurements of points and ties, or of fiducials."""
