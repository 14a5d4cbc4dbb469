"""Text files of other programs, line by line; errors name the line."""

import csv
import errno
import io
import json
import os
import re
import stat
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from core.errors import ProjectError
from core.formats.rotations import Triple, triple_of

MOST = 1e300  # design: finite, and whole numbers beyond it are no float.
"""Numbers of JSON are smaller."""
# design: tie points of thousands of photos take less.
MOST_BYTES = 1_000_000_000
"""Of a file that is read whole."""
# design: no program heads a column with more; what a damaged file has there is not looked through.
LONGEST_HEAD = 80
"""Characters of the head of a column."""
FORMULA = re.compile(r"'*(?:[=@\t\r]|[+-].*[(|!])", re.DOTALL)
"""Text that spreadsheets run: what begins as a formula; after + or - only what calls something."""
# A damaged table may be one long cell; Python's own limit would be an error of another kind.
csv.field_size_limit(MOST_BYTES)


@dataclass(frozen=True, slots=True)
class Record:
    """One line, taken apart."""

    path: Path
    """The file."""
    number: int
    """Of the line, from 1."""
    cells: tuple[str, ...]
    """What stands between blanks, or between the delimiters that were asked for."""

    def text(self, index: int) -> str:
        """A cell.

        Raises:
            ProjectError: The line ends before it.
        """
        if index >= len(self.cells):
            raise ProjectError(
                self.path,
                "Line {number} ends after {count:# entry|# entries}; at least {needed} are needed.",
                "The file was cut off, or is of another format.",
                number=self.number,
                count=len(self.cells),
                needed=index + 1,
            )
        return self.cells[index]

    def value(self, index: int) -> float:
        """A cell as a finite number.

        Raises:
            ProjectError: It is none.
        """
        cell = self.text(index)
        try:
            value = float(cell)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise ProjectError(
                self.path,
                "Line {number}: '{cell}' is not a number.",
                "Numbers have a decimal point and no unit.",
                number=self.number,
                cell=cell,
            )
        return value

    def triple(self, first: int) -> Triple:
        """Three numbers that follow one another."""
        return self.value(first), self.value(first + 1), self.value(first + 2)

    def refused(self, cause: str, remedy: str, **values: object) -> ProjectError:
        """An error about this line, whose number and the values stand in cause and remedy."""
        return ProjectError(self.path, cause, remedy, number=self.number, **values)

    def refuse_again(self, name: str, known: Container[str]) -> None:
        """Refuse a name that another line has.

        Raises:
            ProjectError: It is known.
        """
        if name in known:
            raise self.refused(
                "Line {number}: {name} stands twice.",
                "Give every photo and every point one line.",
                name=name,
            )


@dataclass(frozen=True, slots=True)
class Row(Record):
    """One line of a table, by the heads of its columns."""

    heads: Mapping[str, int]
    """Index of each column."""

    def cell(self, key: str) -> str:
        """What stands in a column; nothing where there is none, or the row ends before it."""
        index = self.heads.get(key, len(self.cells))
        return self.cells[index] if index < len(self.cells) else ""

    def filled(self, key: str) -> str:
        """A cell that must hold something.

        Raises:
            ProjectError: It is empty.
        """
        if not self.cell(key):
            raise self.refused(
                "Line {number}: the column {column} is empty.", "Fill it in.", column=key
            )
        return self.cell(key)

    def number_in(self, key: str) -> float:
        """A cell as a finite number.

        Raises:
            ProjectError: It is empty, or none.
        """
        self.filled(key)
        return self.value(self.heads[key])

    def triple_in(self, keys: Sequence[str]) -> Triple:
        """Three cells as numbers."""
        return triple_of(self.number_in(key) for key in keys)


def read_rows(path: Path, needed: Sequence[str]) -> list[Row]:
    """Rows of a table with commas between its columns and their names above.

    Raises:
        ProjectError: It cannot be read, has no rows, or lacks a needed column.
    """
    first, *rows = (*csv.reader(read_text(path).splitlines()), [])
    heads = {head.strip(): index for index, head in enumerate(first)}
    for name in needed:
        if name not in heads:
            raise ProjectError(
                path,
                "The column {missing} is missing.",
                "The table needs the columns {needed}.",
                missing=name,
                needed=needed,
            )
    found = [
        Row(path, number, tuple(unguarded(cell.strip()) for cell in cells), heads)
        for number, cells in enumerate(rows, 2)
        if cells
    ]
    if not found:
        raise ProjectError(path, "The list holds no rows.", "Give the whole file.")
    return found


def write_rows(path: Path, rows: Iterable[Sequence[object]], above: Sequence[str] = ()) -> None:
    """Write a table with commas between its columns, numbers with all their digits.

    Args:
        path: The file.
        rows: Its rows, the names of the columns first.
        above: Lines above them, comments perhaps.
    """
    with path.open("w", encoding="utf-8", newline="") as stream:
        stream.writelines(f"{line}\n" for line in above)
        _put_rows(stream, rows)


def spreadsheet_bytes(rows: Iterable[Sequence[object]]) -> bytes:
    """The same table with the mark at its beginning by which Excel knows UTF-8."""
    stream = io.StringIO(newline="")
    _put_rows(stream, rows)
    return stream.getvalue().encode("utf-8-sig")


def _put_rows(stream: TextIO, rows: Iterable[Sequence[object]]) -> None:
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerows([guarded(cell) for cell in row] for row in rows)


def guarded(cell: object) -> object:
    """A cell of a table for people, which a spreadsheet shows and never runs.

    Text that a spreadsheet would take for a formula gets an apostrophe before it, the
    spreadsheets' own sign for text. Readers of our tables take it off (`unguarded`).
    """
    return f"'{cell}" if isinstance(cell, str) and FORMULA.match(cell) else cell


def unguarded(cell: str) -> str:
    """The text of a cell that `guarded` wrote."""
    return cell[1:] if cell.startswith("'") and FORMULA.match(cell) else cell


def write_lines(path: Path, lines: Iterable[str]) -> None:
    """Write lines of text; no file where there are none."""
    text = "".join(f"{line}\n" for line in lines)
    if text:
        path.write_text(text, encoding="utf-8")


def write_json(path: Path, value: object) -> None:
    """Write JSON, accents as they are."""
    text = json.dumps(value, ensure_ascii=False, indent=1, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def read_json(path: Path) -> Any:
    """What a file of JSON holds.

    Raises:
        ProjectError: It cannot be read, is none, or is nested beyond reason.
    """
    try:
        return json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise ProjectError(
            path,
            "is no JSON that can be read ({error}).",
            "Export it again from the program that wrote it.",
            error=error,
        ) from error


def json_numbers(where: str | Path, fields: Mapping[str, Any], key: str, count: int) -> list[float]:
    """A field of JSON that holds so many finite numbers.

    Raises:
        ProjectError: It does not.
    """
    value: Any = fields.get(key)
    values: list[Any] = value if isinstance(value, list) else [value]
    plain = [
        float(one)
        for one in values
        if isinstance(one, int | float) and not isinstance(one, bool) and abs(one) < MOST
    ]
    if len(plain) != count or len(values) != count:
        raise ProjectError(
            where,
            "{key} is {value!r}, not {count:# number|# numbers}.",
            "Numbers have a decimal point and no unit.",
            key=key,
            value=str(value)[:60],
            count=count,
        )
    return plain


def scan_stem(name: str) -> str:
    """A scan's name without folder (of any system) and image extension; case is kept."""
    plain = name.strip().replace("\\", "/").rsplit("/", 1)[-1]
    stem, dot, extension = plain.rpartition(".")
    known = {"tif", "tiff", "jpg", "jpeg", "jp2", "j2k", "png", "img", "vrt"}
    return stem if dot and extension.lower() in known else plain


def one_word(name: str) -> str:
    """A name as one word, for files in which blanks part the columns."""
    return "_".join(name.split()) or "-"


def read_records(
    path: Path, parted: Callable[[str], Sequence[str]] = str.split, comment: str = "#"
) -> list[Record]:
    """Lines of a file that hold something.

    Args:
        path: Text in UTF-8 or, failing that, Latin-1.
        parted: What takes a line apart.
        comment: Sign that begins lines to be left out; empty where there is none.

    Raises:
        ProjectError: It cannot be read, or is no text.
    """
    text = read_text(path)
    lines = ((number, line.strip()) for number, line in enumerate(text.splitlines(), 1))
    return [
        Record(path, number, tuple(cell.strip() for cell in parted(line)))
        for number, line in lines
        if line and not (comment and line.startswith(comment))
    ]


def status_of(path: Path) -> os.stat_result:
    """The status of a file or folder.

    Raises:
        OSError: It is not there, a pipe or device, whose reading might never end, or has a name
            that is no text.
    """
    if not str(path).isascii() and any("\ud800" <= sign <= "\udfff" for sign in str(path)):
        raise OSError(errno.EILSEQ, "its name is no UTF-8", str(path))
    found = path.stat()
    if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):
        raise OSError(errno.ENXIO, "a pipe or device, no file", str(path))
    return found


def plain_bytes(path: Path) -> bytes:
    """All bytes of a file that is read whole.

    Raises:
        OSError: It is not there, may not be read, is no plain file, or is too large.
    """
    if status_of(path).st_size > MOST_BYTES:
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))
    return path.read_bytes()


def read_bytes(path: Path) -> bytes:
    """All bytes of a file that is read whole.

    Raises:
        ProjectError: It cannot be read.
    """
    try:
        return plain_bytes(path)
    except OSError as error:
        raise ProjectError(
            path,
            "cannot be read ({error}).",
            "Check the path, and that you may read it.",
            error=error.strerror or error,
        ) from error


def read_text(path: Path) -> str:
    """A text file in UTF-8 or, failing that, Latin-1.

    Raises:
        ProjectError: It cannot be read, or holds bytes that no text has.
    """
    data = read_bytes(path)
    if b"\0" in data:
        raise ProjectError(path, "is no text file.", "Give the file that the program wrote.")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def only_file(folder: Path, *patterns: str) -> Path | None:
    """The one file of a folder that matches, in whatever case; None where there is none.

    Raises:
        ProjectError: There are several.
    """
    try:
        found = sorted(
            one
            for one in folder.iterdir()
            if any(fnmatch(one.name.lower(), pattern.lower()) for pattern in patterns)
        )
    except OSError as error:
        raise ProjectError(
            folder,
            "cannot be read ({error}).",
            "Check the path, and that you may read it.",
            error=error.strerror or error,
        ) from error
    if len(found) > 1:
        raise ProjectError(
            folder,
            "holds several files of one kind: {names}.",
            "Leave the one that belongs to this block.",
            names=[one.name for one in found],
        )
    return found[0] if found else None
