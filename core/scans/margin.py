"""Read the print beside the picture: lines of text, and the values they state.

No stage uses any of it before a person accepts or corrects it.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from typing import Literal

import numpy as np

from core.raster.scan_file import ScanFile, read_window
from core.scans.candidates import fill_window
from core.scans.film_area import SIDES, FilmArea, Side
from core.scans.text_reader import TextLine, TextReader

FieldName = Literal["number", "run", "date", "time", "altitude", "scale", "distance"]
MARGIN_SHARE = 0.14  # design: a data strip and what is written beside it
"""Width of a margin, as a share of the picture's side."""
OVERLAP_SHARE = 0.015  # design: 3 mm of 23 cm: writing may begin within the border
"""What of the picture is read along with its margin."""
LONGEST_PX = 2400  # design: print of 2 mm is then 20 pixels high on film of 23 cm
"""The longer side of a margin as it is read, pixels."""
SURE = 0.6  # measured: prove_margin: of what was read below, less than half is right
"""Mean probability of its characters below which a line tells nothing."""
FEET_M = 0.3048  # source: the international foot of 1959
"""Metres of an international foot."""
LATEST = 2020  # design: no film camera flew later
"""Years of two digits are the last such ones up to it."""
CENTURY = 100  # source: the calendar
MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
DISTANCES_MM = (80.0, 320.0)  # source: camera_types.csv of core/georeference: 85 to 306 mm
"""Principal distances that print may mean."""
ALTITUDES_M = (300.0, 15000.0)  # design: aircraft that flew for mapping
"""Flying heights that print may mean."""


SCALES = (1000, 200_000)  # design: from low flights over towns to high ones over deserts
"""Scale numbers that print may mean."""
CONCATENATED = 3  # source: camera_types.csv: no distance has four
"""Digits of a principal distance before its point; more are the number of the lens before it."""


@dataclass(frozen=True, slots=True)
class MarginText:
    """What is written on one side of a scan."""

    side: Side
    """Which side of the picture, as it lies in the scan."""
    lines: tuple[TextLine, ...]
    """Its lines, with corners in pixels of the scan."""


@dataclass(frozen=True, slots=True)
class MarginField:
    """Something that a line seems to tell."""

    name: FieldName
    """What it is."""
    value: str
    """ISO date or time, metres, millimetres, a scale number; a run or number as written."""
    line: TextLine
    """Where it stands."""


def read_margin(
    scan: ScanFile, reader: TextReader, area: FilmArea | None = None
) -> tuple[MarginText, ...]:
    """Read what is written on the four sides of a picture.

    Args:
        scan: The scan.
        reader: What finds and reads lines.
        area: The exposed picture, where it is known; else the margins of the scan itself.

    Raises:
        ScanError: The scan cannot be read.
        ProjectError: The networks cannot be run.
    """
    return tuple(MarginText(side, _read_side(scan, reader, area, side)) for side in SIDES)


def _read_side(
    scan: ScanFile, reader: TextReader, area: FilmArea | None, side: Side
) -> tuple[TextLine, ...]:
    left, top, right, bottom = _margin_box(scan, area, side)
    columns, rows = right - left, bottom - top
    if min(columns, rows) < 2:
        return ()
    reduction = max(1, round(max(columns, rows) / LONGEST_PX))
    gray = fill_window(read_window(scan, left, top, columns, rows, reduction))
    along = side in ("top", "bottom")
    picture = gray if along else np.ascontiguousarray(np.rot90(gray, -1))
    lines: list[TextLine] = []
    for line in reader.lines(picture):
        corners = np.array(line.corners)
        if not along:
            # A quarter clockwise put the first column of the margin at the top.
            corners = np.column_stack([corners[:, 1], gray.shape[0] - corners[:, 0]])
        placed = (corners * reduction + (left, top)).tolist()
        lines.append(replace(line, corners=tuple((x, y) for x, y in placed)))
    return tuple(lines)


def _margin_box(scan: ScanFile, area: FilmArea | None, side: Side) -> tuple[int, int, int, int]:
    """First column and row, end column and row of what is read on a side.

    Where the picture seems to reach the edge of the scan, the margin is taken within it: a border
    that was not seen may lie there as well.
    """
    size = np.array(scan.size_px, np.float64)
    corners = np.array([(0, 0), size]) if area is None else area.corners
    low, high = corners.min(axis=0), corners.max(axis=0)
    width, over = MARGIN_SHARE * (high - low), OVERLAP_SHARE * (high - low)
    first, last = np.clip([low - width, high + width], 0, size)
    before, after = np.maximum(low + over, first + width), np.minimum(high - over, last - width)
    box = {
        "left": (first[0], low[1], before[0], high[1]),
        "right": (after[0], low[1], last[0], high[1]),
        "top": (low[0], first[1], high[0], before[1]),
        "bottom": (low[0], after[1], high[0], last[1]),
    }[side]
    left, top, right, bottom = np.clip(np.round(box), 0, (*size, *size)).astype(int).tolist()
    return left, top, right, bottom


def fields_of(margin: Sequence[MarginText]) -> tuple[MarginField, ...]:
    """What the lines of a margin seem to tell, surest first within each kind."""
    lines = [line for text in margin for line in text.lines if line.probability > SURE]
    found = [field for line in lines for field in _told_by(line)]
    found += _numbers(lines)
    days = [field.value for field in found if field.name == "date"]
    # A month says no more than a day in it.
    known = {day.rpartition("-")[0] for day in days}
    found = [field for field in found if field.name != "date" or field.value not in known]
    return tuple(sorted(found, key=lambda field: -field.line.probability))


def _told_by(line: TextLine) -> Iterator[MarginField]:
    """What one line tells by itself."""
    readings: Mapping[FieldName, Callable[[str], Iterable[str]]] = {
        "date": _dates, "time": _times, "altitude": _altitudes, "run": _runs, "scale": _scales,
        "distance": _distances,
    }  # fmt: skip
    for name, values_in in readings.items():
        for value in values_in(line.text):
            yield MarginField(name, value, line)


def _dates(text: str) -> Iterator[str]:
    """Day, month and year in figures or with the month in letters; a month with its year."""
    for day, _, month, year in re.findall(
        r"(?<!\d)(\d{1,2})\s*([./-])\s*(\d{1,2})\s*\2\s*(\d{4}|\d{2})(?!\d)", text
    ):
        yield from _calendar(_year(year), int(month), int(day))
    words = "|".join(MONTHS)
    pattern = rf"(?i)(?<!\d)(?:(\d{{1,2}})[\s.-]*)?\b({words})[a-z]*[\s.,-]*(\d{{4}}|\d{{2}})(?!\d)"
    for day, month, year in re.findall(pattern, text):
        number = MONTHS.index(month.lower()) + 1
        if day:
            yield from _calendar(_year(year), number, int(day))
        else:
            yield f"{_year(year):04d}-{number:02d}"


def _year(digits: str) -> int:
    """Of two digits the last such year in which film was exposed."""
    year = int(digits)
    return year if len(digits) > 2 else LATEST - (LATEST - year) % CENTURY


def _calendar(year: int, month: int, day: int) -> Iterator[str]:
    """The date as ISO has it; nothing where there is no such day."""
    try:
        yield date(year, month, day).isoformat()
    except ValueError:
        return


def _times(text: str) -> Iterator[str]:
    """Hours and minutes: 10:42, 10h42, 10.42 h."""
    for hour, minute in re.findall(r"(?<![\d:])([01]?\d|2[0-3])[:hH]([0-5]\d)(?![\w,.])", text):
        yield f"{int(hour):02d}:{minute}"


def _altitudes(text: str) -> Iterator[str]:
    """Heights in feet or metres, as metres."""
    for digits, unit in re.findall(r"(?i)(\d[\d,. ]*\d)\s*(ft|feet|'|m\b|m(?=[\s-]*a))", text):
        metres = float(re.sub(r"[,. ]", "", digits)) * (1.0 if unit.lower() == "m" else FEET_M)
        if ALTITUDES_M[0] <= metres <= ALTITUDES_M[1]:
            yield f"{metres:.0f}"


def _runs(text: str) -> Iterator[str]:
    """The strip: RUN 7, RUN 72C1, STRIP 3."""
    yield from re.findall(r"(?i)\b(?:run|strip|rada)\s*[:.]?\s*([0-9]+[a-z]?[0-9]*|[ivx]+)\b", text)


def _scales(text: str) -> Iterator[str]:
    """The denominator of 1:10,000."""
    for digits in re.findall(r"\b1\s*[:/]\s*(\d[\d,. ]*\d)", text):
        number = int(re.sub(r"[,. ]", "", digits))
        if SCALES[0] <= number <= SCALES[1]:
            yield str(number)


def _distances(text: str) -> Iterator[str]:
    """Millimetres with two decimals, or three behind a point; 152.44 of UAg1003152.44 as well."""
    pattern = r"(?<![\d.,/-])(\d{2,})([.,]\d\d|\.\d{3})(?![\d.,/-])"
    for digits, decimals in re.findall(pattern, text):
        # The number of a lens and its distance are often read as one.
        parts = [digits] if len(digits) <= CONCATENATED else [digits[-3:], digits[-2:]]
        values = [float(part + decimals.replace(",", ".")) for part in parts]
        usual = [one for one in values if DISTANCES_MM[0] <= one <= DISTANCES_MM[1]]
        yield from (f"{one:g}" for one in usual[:1])


def _numbers(lines: Sequence[TextLine]) -> Iterator[MarginField]:
    """Numbers that stand alone; where a run names its first and last photo, only those in it."""
    ranges = [
        (int(first), int(last))
        for line in lines
        for first, last in re.findall(
            r"(?<![\d.,-])(\d{2,5})\s*-\s*(\d{2,5})(?![\d.,-])", line.text
        )
        if int(first) < int(last)
    ]
    for line in lines:
        digits = re.fullmatch(r"[^\dA-Za-z]*(\d{1,5})[^\dA-Za-z]*", line.text)
        if digits and (
            not ranges or any(first <= int(digits[1]) <= last for first, last in ranges)
        ):
            yield MarginField("number", digits[1], line)
