"""Read any table of surveyed points into the block's CRS.

What the list does not state is recognised and reported with the evidence; what remains open is a
question to the user; a row that cannot be used is refused with a reason. Nothing is guessed
silently.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from core.errors import CrsError, ProjectError
from core.formats.delimited_table import DelimitedTable, TableRow, number_of, read_table
from core.formats.listed_point import (
    COORDINATES,
    HIGHEST_M,
    LOWEST_M,
    ROLES,
    SCALES,
    SIGMAS,
    Choice,
    ListedPoint,
    ListedRole,
    PointList,
    PointListReading,
    Quantity,
    Question,
    ReadRow,
    RefusedRow,
    Triple,
    guessed_columns,
    known_words,
    named_columns,
    role_of,
    unit_of,
)
from core.formats.point_axes import (
    AS_WRITTEN,
    Surroundings,
    asked_of_system,
    evidence_of_crs,
    on_the_ground,
    placed_rows,
    settle_axes,
    within_reach,
    without_own,
)
from core.geometry.crs import horizontal, read_crs
from core.said import say

COMMENT = re.compile(r"#\s*(?:CRS|CoordinateSystem)\s*:\s*(.+)", re.IGNORECASE)
"""How a table names its CRS."""
# design: a name must fit into a label beside its point.
LONGEST_NAME = 60
SPREADSHEET_REMEDY = "Save decimal commas with semicolons between the columns, or write points."


class UnusableRow(Exception):
    """A row that brings no point: its arguments are cause and remedy."""


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
    found = _read_list(path, around, reading or PointListReading())
    if not found.table.rows:
        raise ProjectError(path, "The list holds no rows.", "Give a table with a row for a point.")
    return found


def _read_list(path: Path, around: Surroundings, given: PointListReading) -> PointList:
    """A list, which may hold a header alone."""
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
        crs=given.crs or _foreign_crs(table, around.crs),
    )
    found = PointList(settled, table, _evidence_of_form(settled, table))
    if question := _asked_of_columns(columns, table):
        return replace(found, questions=(question,))
    return _with_points(found, around, path)


def stated_crs(comments: Iterable[str]) -> str:
    """The CRS that a comment above a table names, as it is written; empty where none does."""
    heads = (COMMENT.match(line) for line in comments)
    return next((head[1].strip() for head in heads if head), "")


def _foreign_crs(table: DelimitedTable, crs: str) -> str:
    """The CRS above a table where PROJ knows it and it is not the block's; else empty."""
    stated = stated_crs(table.comments)
    if not stated:
        return ""
    try:
        theirs, ours = (horizontal(read_crs(text, "")) for text in (stated, crs))
    except CrsError:
        return ""
    return "" if theirs == ours else stated


def read_control_points(path: Path, crs: str) -> tuple[ListedPoint, ...]:
    """Read a list that has to be whole and beyond doubt, as `[control] points` names one.

    Args:
        path: The table.
        crs: The block's CRS.

    Raises:
        ProjectError: Not to be read; a row is refused; a question is left.
    """
    # Heights of another system are a doubt of every run, and nothing to be asked before it.
    reading = PointListReading(axes=AS_WRITTEN, height_system="keep")
    found = _read_list(path, Surroundings(crs), reading)
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
            rows.append(ReadRow(row, read_row(found, row)))
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
        placed, clashing, told = without_own(placed, around)
        refused += clashing
        evidence += told
        placed, beyond, question = within_reach(placed, reading, around)
        refused += beyond
        asked += question
        if not question:
            placed, off, question = on_the_ground(placed, reading, around, path.name)
            refused += off
            asked += question or asked_of_system(placed, found, around, path.name)
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


def read_row(found: PointList, row: TableRow) -> ListedPoint:
    """One row; its plane coordinates as they are written."""
    columns, header = found.reading.columns or (), found.table.header
    cells = _fitted(row, len(header) or len(columns), found)
    text: dict[Quantity, str] = {
        quantity: cells[n] if n < len(cells) else "" for n, quantity in enumerate(columns)
    }
    name = text["id"]
    if not name:
        raise UnusableRow(say("the point has no name."), say("Give every point one."))
    if not name.isprintable() or len(name) > LONGEST_NAME:
        raise UnusableRow(say("the name cannot be used."), say("Give it a short name in one line."))
    east, north, height = (
        _coordinate(text[quantity], quantity, found.table.decimal) for quantity in COORDINATES
    )
    if not LOWEST_M < height < HIGHEST_M:
        raise UnusableRow(
            say("{height} is no height on the ground in metres.", height=text["Z"]),
            say("Give the height, if only roughly, and the role plan where it is not known."),
        )
    return ListedPoint(
        name,
        east,
        north,
        height,
        _sigmas(text, found),
        _role(text.get("role", ""), found.reading.role),
        text.get("description", ""),
        text.get("sketch", ""),
    )


def _fitted(row: TableRow, width: int, found: PointList) -> tuple[str, ...]:
    """Cells of a row; words of a description that blanks have parted are joined again."""
    if len(row.cells) <= width:
        return row.cells
    columns = found.reading.columns or ()
    if found.table.delimiter == " " and columns[-1:] == ("description",):
        return (*row.cells[: width - 1], " ".join(row.cells[width - 1 :]))
    raise UnusableRow(
        say(
            "the row has {count:# cell|# cells} and there are {width:# column|# columns}.",
            count=len(row.cells),
            width=width,
        ),
        say(SPREADSHEET_REMEDY),
    )


def _coordinate(cell: str, quantity: str, decimal: str) -> float:
    """A coordinate of a row."""
    value = number_of(cell, decimal)
    if value is None or not np.isfinite(value):
        raise UnusableRow(
            say("{quantity} is '{cell}', which is not a number.", quantity=quantity, cell=cell)
            if cell
            else say("{quantity} is empty.", quantity=quantity),
            say("Numbers have one decimal sign in the whole list and no unit."),
        )
    return value


def _sigmas(text: dict[Quantity, str], found: PointList) -> Triple:
    """Standard deviations of a row, metres; the usual ones where it says none."""
    columns, header = found.reading.columns or (), found.table.header
    known: dict[str, float] = {}
    for n, quantity in enumerate(columns):
        if quantity not in SIGMAS or not text[quantity]:
            continue
        value = number_of(text[quantity], found.table.decimal)
        scale = SCALES.get(unit_of(header[n]) if n < len(header) else "", 1.0)
        if value is None or not 0 < value < np.inf:
            raise UnusableRow(
                say(
                    "{quantity} is '{cell}', which is no standard deviation.",
                    quantity=quantity,
                    cell=text[quantity],
                ),
                say("Standard deviations are above 0; leave the cell empty where it is not known."),
            )
        known[quantity] = value * scale
    plan = known.get("sigma_xy", found.reading.sigma_plan_m)
    height = known.get("sigma_Z", found.reading.sigma_height_m)
    return known.get("sigma_X", plan), known.get("sigma_Y", plan), height


def _role(cell: str, usual: ListedRole) -> ListedRole:
    """The role a row gives."""
    if not cell:
        return usual
    for role in ROLES:
        if role == role_of(cell):
            return role
    raise UnusableRow(
        say("the role '{cell}' is unknown.", cell=cell),
        say("It is control, plan, height or check."),
    )


def without_duplicates(
    rows: Sequence[ReadRow], reading: PointListReading
) -> tuple[list[ReadRow], tuple[Question, ...]]:
    """One row a name: rows that say the same are one; those that differ are asked about."""
    kept: dict[str, ReadRow] = {}
    differing: list[tuple[str, int, int]] = []
    for row in rows:
        name = row.point.point_id
        before = kept.setdefault(name, row)
        if before is row or _figures(before.point) == _figures(row.point):
            continue
        differing.append((name, before.source.number, row.source.number))
        if reading.duplicates == "last":
            kept[name] = row
    if not differing or reading.duplicates:
        return list(kept.values()), ()
    name, first, again = differing[0]
    words = say(
        "{count:# name stands|# names stand} twice with different values, such as {name} in lines "
        "{first} and {again}. Which row holds?",
        count=len({one[0] for one in differing}),
        name=name,
        first=first,
        again=again,
    )
    choices = Choice("first", say("the first")), Choice("last", say("the last"))
    return list(kept.values()), (Question("duplicates", words, choices),)


def _figures(point: ListedPoint) -> tuple[object, ...]:
    """What has to be alike where a point is listed once for each of its scans."""
    return point.easting, point.northing, point.height, point.sigma_m, point.role
