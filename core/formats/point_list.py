"""Read any table of surveyed points into the block's CRS.

What the list does not state is recognised and reported with the evidence; what remains open is a
question to the user; a row that cannot be used is refused with a reason. Nothing is guessed
silently.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from core.errors import ProjectError
from core.formats.delimited_table import DelimitedTable, read_table
from core.formats.listed_point import (
    Choice,
    ListedPoint,
    PointList,
    PointListReading,
    Question,
    ReadRow,
    RefusedRow,
)
from core.formats.point_axes import (
    AS_WRITTEN,
    Surroundings,
    evidence_of_crs,
    placed_rows,
    settle_axes,
    within_reach,
)
from core.formats.point_columns import (
    COORDINATES,
    Quantity,
    guessed_columns,
    known_words,
    named_columns,
    unit_of,
)
from core.formats.point_rows import UnusableRow, read_row, without_duplicates
from core.said import say


def read_point_list(
    path: Path, around: Surroundings, reading: PointListReading | None = None
) -> PointList:
    """Read a list of surveyed points.

    Args:
        path: The table.
        around: Where its points ought to lie.
        reading: What is known of it.

    Raises:
        ProjectError: Not to be read, no table, or empty.
        CrsError: The CRS named for the list is unknown or leads nowhere.
    """
    given = reading or PointListReading()
    table = read_table(
        path,
        known_words,
        encoding=given.encoding,
        delimiter=given.delimiter,
        decimal=given.decimal,
        header=given.header,
    )
    columns = given.columns
    if columns is None:
        cells = [row.cells for row in table.rows]
        columns = named_columns(table.header)
        if not set(COORDINATES) & set(columns):
            columns = guessed_columns(cells, table.decimal)
    settled = replace(
        given,
        encoding=table.encoding,
        delimiter=table.delimiter,
        decimal=table.decimal,
        header=bool(table.header),
        columns=columns,
    )
    found = PointList(settled, table, _evidence_of_form(settled, table))
    if question := _asked_of_columns(columns, table):
        return replace(found, questions=(question,))
    return _with_points(found, around, path)


def read_control_points(path: Path, crs: str) -> tuple[ListedPoint, ...]:
    """Read a list that has to be whole and beyond doubt, as `[control] points` names one.

    Args:
        path: The table.
        crs: The block's CRS.

    Raises:
        ProjectError: Not to be read; a row is refused; a question is left.
    """
    found = read_point_list(path, Surroundings(crs), PointListReading(axes=AS_WRITTEN))
    if not found.table.rows:
        return ()
    refuse_doubtful(path, found, "Name the columns as id,X,Y,Z,sigma_xy,sigma_z,role.")
    return found.points


def refuse_doubtful(path: Path, found: PointList, remedy: str) -> None:
    """Refuse a list that leaves something to be asked, or a row of it out.

    Raises:
        ProjectError: It does.
    """
    if found.refused:
        row = found.refused[0]
        cause = say("line {line}: {cause}", line=row.number, cause=row.cause)
        raise ProjectError(path, cause, row.remedy)
    if found.questions:
        raise ProjectError(path, found.questions[0].words, remedy)


def _evidence_of_form(reading: PointListReading, table: DelimitedTable) -> tuple[str, ...]:
    """What was recognised of the table itself."""
    names = {"\t": say("tab"), ";": say("semicolon"), ",": say("comma"), " ": say("blanks")}
    found: list[str] = [
        say(
            "Text in {encoding}; columns are divided by: {delimiter}; decimal sign: {decimal}",
            encoding=table.encoding,
            delimiter=names.get(table.delimiter, table.delimiter),
            decimal=table.decimal,
        )
    ]
    unread = [
        table.header[n] if n < len(table.header) else f"{n + 1}"
        for n, quantity in enumerate(reading.columns or ())
        if not quantity
    ]
    if not table.header:
        found.append(say("No line names the columns: what they hold is told by their values."))
    if unread:
        found.append(say("Columns that are not read: {unread}", unread=unread))
    return tuple(found)


def _asked_of_columns(columns: Sequence[Quantity], table: DelimitedTable) -> Question | None:
    """A question where the columns cannot be told."""
    for needed in ("id", *COORDINATES):
        if needed not in columns:
            return Question("columns", say("The column {missing} is missing.", missing=needed))
        if columns.count(needed) > 1:
            twice = [n for n, quantity in enumerate(columns) if quantity == needed]
            names = [table.header[n] if n < len(table.header) else f"{n + 1}" for n in twice]
            return Question(
                "columns", say("Several columns hold {needed}: {names}", needed=needed, names=names)
            )
    for n, quantity in enumerate(columns):
        unit = unit_of(table.header[n]) if n < len(table.header) else ""
        if quantity in COORDINATES and unit not in ("", "m", "deg", "\u00b0"):
            return Question(
                "columns",
                say(
                    "The column {name} counts in {unit}, not in metres.",
                    name=table.header[n],
                    unit=unit,
                ),
            )
    return None


def _with_points(found: PointList, around: Surroundings, path: Path) -> PointList:
    """The list with its points, its refused rows and what is left to ask."""
    rows: list[ReadRow] = []
    refused: list[RefusedRow] = []
    for row in found.table.rows:
        try:
            rows.append(ReadRow(row, read_row(found, row, around.taken)))
        except UnusableRow as error:
            cause, remedy = error.args
            refused.append(RefusedRow(row.number, row.text, cause, remedy))
    if not rows:
        none = Question("columns", say("No row can be used as a point."))
        return replace(found, refused=tuple(refused), questions=(none,))
    rows, asked = without_duplicates(rows, found.reading)
    reading, evidence, more = settle_axes(found, rows, around)
    asked += more
    placed = placed_rows(rows, reading, around, path)
    if reading.crs:
        evidence += (evidence_of_crs(rows, reading, around, path),)
    if not more:
        placed, beyond, question = within_reach(placed, reading, around)
        refused += beyond
        asked += question
    refused.sort(key=lambda row: row.number)
    if refused and reading.refused == "":
        asked += (_asked_of_refused(refused, len(placed)),)
    return replace(
        found,
        reading=reading,
        evidence=found.evidence + evidence,
        points=tuple(row.point for row in placed),
        refused=tuple(refused),
        questions=asked,
    )


def _asked_of_refused(refused: Sequence[RefusedRow], left: int) -> Question:
    """Whether the rest of the list comes in without the refused rows."""
    words = say(
        "{count:# row is|# rows are} refused, the first in line {line}: {cause}",
        count=len(refused),
        line=refused[0].number,
        cause=refused[0].cause,
    )
    choice = Choice(
        "leave out", say("bring the other {left:# point|# points} without them", left=left)
    )
    return Question("refused", words, (choice,))
