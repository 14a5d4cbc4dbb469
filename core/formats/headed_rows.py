"""Tables whose columns are known by their heads, in the words of many programs, or by an answer."""

import csv
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from core.errors import ProjectError
from core.formats.listed_point import plain_word
from core.formats.records import Row, read_text, unguarded

DELIMITERS = ("\t", ";", ",")
"""Signs between columns; where a head has none of them, blanks part the columns."""
COMMENT = "#"


@dataclass(frozen=True, slots=True)
class HeadedForm:
    """What the columns of a kind of table may be called, and which of them it needs."""

    words: Mapping[str, str]
    """By what a column holds, the heads that lists have for it, as `plain_word` makes them."""
    needed: tuple[tuple[str, ...], ...]
    """Columns it must have: one of each group."""
    numbers: Collection[str]
    """Columns that hold numbers."""
    remedy: str
    """What to do where columns cannot be told."""

    def meant(self, head: str) -> str:
        """What a column holds by its head; empty where that is not known."""
        word = plain_word(head)
        return next((name for name, words in self.words.items() if word in words.split()), "")


def headed_rows(path: Path, form: HeadedForm, columns: Sequence[str] | None = None) -> list[Row]:
    """Rows of a table by what its columns hold.

    Args:
        path: The table; commas, semicolons, tabs or blanks part its columns.
        form: What its columns may be called.
        columns: What each column holds, from the first on, empty where it is not read; None where
            its heads say it.

    Raises:
        ProjectError: It cannot be read, has no rows, or its columns cannot be told.
    """
    lines = [
        (number, line)
        for number, line in enumerate(read_text(path).splitlines(), 1)
        if line.strip() and not line.lstrip().startswith(COMMENT)
    ]
    if not lines:
        raise ProjectError(path, "The list holds no rows.", "Give the whole file.")
    delimiter = max(DELIMITERS, key=lines[0][1].count)
    delimiter = delimiter if delimiter in lines[0][1] else " "
    rows = [(number, _cells(line, delimiter)) for number, line in lines]
    first = rows[0][1]
    meant = [form.meant(head) for head in first] if columns is None else list(columns)
    heads = _heads(path, form, meant, first)
    if columns is None or not _holds_numbers(first, heads, form):
        rows = rows[1:]
    if not rows:
        raise ProjectError(path, "The list holds no rows.", "Give the whole file.")
    decimal_commas = [heads[name] for name in form.numbers if name in heads and delimiter != ","]
    return [Row(path, number, _points(cells, decimal_commas), heads) for number, cells in rows]


def _heads(
    path: Path, form: HeadedForm, meant: Sequence[str], heads: Sequence[str]
) -> dict[str, int]:
    """Index of each column by what it holds.

    Raises:
        ProjectError: A needed one is missing, or several hold the same.
    """
    for group in form.needed:
        known = [index for index, name in enumerate(meant) if name in group]
        if not known:
            raise ProjectError(
                path,
                "The column {missing} is missing.",
                form.remedy,
                missing=" / ".join(group),
            )
        if len(known) > 1:
            raise ProjectError(
                path,
                "Several columns hold {needed}: {names}",
                form.remedy,
                needed=" / ".join(group),
                names=[heads[i] if i < len(heads) else str(i + 1) for i in known],
            )
    return {name: index for index, name in reversed([*enumerate(meant)]) if name}


def _holds_numbers(cells: Sequence[str], heads: Mapping[str, int], form: HeadedForm) -> bool:
    """Whether a first line is a row: a needed column of numbers holds one."""
    needed = [name for group in form.needed for name in group if name in form.numbers]
    places = [heads[name] for name in needed if name in heads]
    return any(i < len(cells) and _is_number(cells[i]) for i in places)


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    return [unguarded(cell.strip()) for cell in next(csv.reader([line], delimiter=delimiter))]


def _points(cells: list[str], columns: Collection[int]) -> tuple[str, ...]:
    """Cells with decimal points where commas part no columns."""
    return tuple(c.replace(",", ".") if i in columns else c for i, c in enumerate(cells))
