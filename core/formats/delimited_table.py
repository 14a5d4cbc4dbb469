"""Any delimited table as rows of cells: its encoding, delimiter and decimal sign are recognised."""

import csv
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from core.errors import ProjectError
from core.formats.records import status_of, unguarded

DELIMITERS = ("\t", ";", ",", " ")
"""Those that are recognised, the safest first; a blank stands for any run of blanks."""
DECIMALS = (".", ",")
COMMENTS = ("#", "//", "%", "!")
"""A line that begins so is none of the table's, except where it names the columns."""
# source: Czech and Slovak lists of older programs; UTF-16 is what Excel calls Unicode text.
ENCODINGS = ("utf-8", "utf-16", "cp1250")
"""Those that are recognised."""
MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
"""Byte order marks."""
# source: first bytes of zip (xlsx, ods), old Excel, PDF, TIFF, PNG, SQLite and gzip files.
BINARY = (
    b"PK\x03\x04",
    b"\xd0\xcf\x11\xe0",
    b"%PDF",
    b"II*\x00",
    b"MM\x00*",
    b"\x89PNG",
    b"SQLite format",
    b"\x1f\x8b",
)
# design: a hundred times the longest list of control known to us.
MOST_BYTES = 20_000_000
# design: name and three coordinates, with one column to spare for a comment.
FEWEST_NUMBERS = 3
"""A line of coordinates holds so many numbers."""
NUMBER = {
    decimal: re.compile(
        rf"[+-]?(?:\d+|\d{{1,3}}(?:[ ']\d{{3}})+"
        rf"|\d{{1,3}}(?:{other}\d{{3}})+(?={decimal})|\d{{1,3}}(?:{other}\d{{3}}){{2,}})"
        rf"(?:{decimal}\d*)?(?:[eE][+-]?\d+)?|[+-]?{decimal}\d+"
    )
    for decimal, other in ((r"\.", ","), (",", r"\."))
}
"""Numbers with a decimal sign; thousands may be parted where that cannot be mistaken."""
SIGNS = str.maketrans({"\u2212": "-", "\u2013": "-", "\u00a0": " ", "\u202f": " ", "\u2009": " "})
"""Signs that programs write for a minus and a blank."""


@dataclass(frozen=True, slots=True)
class TableRow:
    """One line of a table."""

    number: int
    """Line of the file, from 1."""
    cells: tuple[str, ...]
    """Its cells without blanks around them; empty ones at the end are left out."""
    text: str
    """The line as it stands."""


@dataclass(frozen=True, slots=True)
class DelimitedTable:
    """A table with what was recognised of its form."""

    encoding: str
    """Of the file."""
    delimiter: str
    """One of `DELIMITERS`."""
    decimal: str
    """One of `DECIMALS`."""
    header: tuple[str, ...]
    """Names of the columns; empty where there are none."""
    rows: tuple[TableRow, ...]
    """All other lines, comments and empty ones left out."""
    comments: tuple[str, ...] = ()
    """Comments above the first row."""


def number_of(cell: str, decimal: str) -> float | None:
    """The number in a cell; None where there is none."""
    text = cell.strip().translate(SIGNS)
    if NUMBER[r"\." if decimal == "." else ","].fullmatch(text) is None:
        return None
    other = "," if decimal == "." else "."
    return float(re.sub(rf"[ '{other}]", "", text).replace(decimal, "."))


def read_table(
    path: Path,
    known_words: Callable[[Sequence[str]], int],
    *,
    encoding: str = "",
    delimiter: str = "",
    decimal: str = "",
    header: bool | None = None,
) -> DelimitedTable:
    """Read a table.

    Args:
        path: The file.
        known_words: How many of some cells are known names of columns.
        encoding: As Python calls it; recognised where empty, as are the others.
        delimiter: One of `DELIMITERS`.
        decimal: One of `DECIMALS`.
        header: Whether the first line names the columns.

    Raises:
        ProjectError: Not to be read, no text, or empty.
    """
    text, encoding = _text(path, encoding)
    numbered = [
        (n, line) for n, line in enumerate(re.split(r"\r\n|\r|\n", text), 1) if line.strip()
    ]
    if numbered and (named := re.fullmatch(r"\s*sep=(.)\s*", numbered[0][1])):
        delimiter, numbered = delimiter or named[1], numbered[1:]
    lines = [(n, line) for n, line in numbered if not line.lstrip().startswith(COMMENTS)]
    comments = [line for n, line in numbered if not lines or n < lines[0][0]]
    comments = [line for line in comments if line.lstrip().startswith(COMMENTS)]
    if not lines:
        raise ProjectError(path, "The list holds no rows.", "Give a table with a row for a point.")
    if not delimiter:
        delimiter = _delimiter([line for _, line in lines], known_words)
    rows = [TableRow(n, _cells(line, delimiter), line.strip()) for n, line in lines]
    names, rows = _header(rows, comments, delimiter, known_words, header)
    return DelimitedTable(
        encoding, delimiter, decimal or _decimal([row.cells for row in rows]), names, tuple(rows),
        tuple(line.strip() for line in comments),
    )  # fmt: skip


def _text(path: Path, encoding: str) -> tuple[str, str]:
    """The file's text and its encoding."""
    try:
        size = status_of(path).st_size
        data = path.read_bytes() if size <= MOST_BYTES else b""
    except OSError as error:
        raise ProjectError(
            path, "cannot be read ({error}).", "Give a file that you may read.", error=error
        ) from error
    if size > MOST_BYTES:
        raise ProjectError(
            path,
            "is too large for a list of points ({size} bytes).",
            "Give a list that holds the points of this block.",
            size=size,
        )
    if data.startswith(BINARY):
        raise ProjectError(
            path,
            "is no text but a spreadsheet, picture or archive.",
            "Save the table as CSV or as text.",
        )
    if not encoding:
        encoding = _encoding(data)
    try:
        text = data.decode(encoding)
    except (UnicodeDecodeError, LookupError) as error:
        raise ProjectError(
            path,
            "is no text in {encoding} ({error}).",
            "Save it as UTF-8 text, or name its encoding.",
            encoding=encoding,
            error=error,
        ) from error
    if "\0" in text:
        raise ProjectError(path, "is no text.", "Save the table as CSV or as text.")
    if text.lstrip().startswith(("<", "{")):
        raise ProjectError(
            path,
            "is XML or JSON, not a table.",
            "Name its format with --from, or save the points as a table.",
        )
    return text.removeprefix("\ufeff"), encoding


def _encoding(data: bytes) -> str:
    """UTF-8 where the bytes are that, UTF-16 where every second one is nought, else cp1250."""
    for mark, name in MARKS.items():
        if data.startswith(mark):
            return name
    start = data[:4096]  # design: some dozen lines.
    for offset, name in ((1, "utf-16-le"), (0, "utf-16-be")):
        if len(start) > 1 and start[offset::2].count(0) * 2 > len(start[offset::2]):
            return name
    try:
        data.decode("utf-8")
    except UnicodeDecodeError:
        return "cp1250"
    return "utf-8"


def _cells(line: str, delimiter: str) -> tuple[str, ...]:
    """One line cut; a quote that never closes costs its own line only."""
    if delimiter == " ":
        found = [quoted or bare for quoted, bare in re.findall(r'"([^"]*)"|(\S+)', line)]
    else:
        found = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    while found and not found[-1].strip():
        found.pop()
    return tuple(unguarded(cell.strip()) for cell in found)


def _is_number(cell: str) -> bool:
    return any(number_of(cell, decimal) is not None for decimal in DECIMALS)


def _delimiter(lines: Sequence[str], known_words: Callable[[Sequence[str]], int]) -> str:
    """What cuts most lines into numbers, and the first one into known words."""

    def worth(delimiter: str) -> tuple[int, bool, int, int]:
        cut = [_cells(line, delimiter) for line in lines]
        coordinates = sum(sum(map(_is_number, cells)) >= FEWEST_NUMBERS for cells in cut)
        alike = Counter(map(len, cut)).most_common(1)[0][1] if cut else 0
        # Blanks stand in names and remarks, too: whatever else cuts a line goes before them.
        parted = coordinates > 0 and delimiter != " "
        return coordinates, parted, known_words(cut[0]) if cut else 0, alike

    return max(DELIMITERS, key=worth)


def _header(
    rows: list[TableRow],
    comments: Sequence[str],
    delimiter: str,
    known_words: Callable[[Sequence[str]], int],
    header: bool | None,
) -> tuple[tuple[str, ...], list[TableRow]]:
    """Names of the columns, from the first line or from a comment before it, and the rest."""
    first = rows[0].cells
    numbers = sum(map(_is_number, first))
    if header or (header is None and (numbers < FEWEST_NUMBERS and known_words(first) > 1)):
        return first, rows[1:]
    if header is None and numbers == 0 and len(rows) > 1:
        return first, rows[1:]
    if header is None:
        for line in reversed(comments):
            plain = re.sub(r"^[#/%!\s]+(?:F=)?", "", line)
            for cut in (delimiter, ",", " "):
                names = _cells(plain, cut)
                # design: fewer known words may be prose.
                if known_words(names) >= max(FEWEST_NUMBERS, len(names) / 2):
                    return names, rows
    return (), rows


def _decimal(rows: Sequence[Sequence[str]]) -> str:
    """The sign that stands once in most numbers that have one."""
    cells = [cell.translate(SIGNS) for row in rows for cell in row]
    commas = sum(re.fullmatch(r"[+-]?[\d '.]*\d,\d+", cell) is not None for cell in cells)
    points = sum(re.fullmatch(r"[+-]?[\d ',]*\d\.\d+", cell) is not None for cell in cells)
    return "," if commas > points else "."
