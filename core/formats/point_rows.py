"""One row of a list as a surveyed point, or the reason why it is refused."""

from collections.abc import Sequence

import numpy as np

from core.formats.delimited_table import TableRow, number_of
from core.formats.listed_point import (
    ROLES,
    Choice,
    ListedPoint,
    ListedRole,
    PointList,
    PointListReading,
    Question,
    ReadRow,
    Triple,
)
from core.formats.point_columns import (
    COORDINATES,
    HIGHEST_M,
    LOWEST_M,
    SCALES,
    SIGMAS,
    Quantity,
    role_of,
    unit_of,
)
from core.said import say

# design: a name must fit into a label beside its point.
LONGEST_NAME = 60
SPREADSHEET_REMEDY = "Save decimal commas with semicolons between the columns, or write points."


class UnusableRow(Exception):
    """A row that brings no point: its arguments are cause and remedy."""


def read_row(found: PointList, row: TableRow, taken: frozenset[str]) -> ListedPoint:
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
    if name in taken:
        raise UnusableRow(
            say("the block has a point of another kind that is called {name}.", name=name),
            say("Give the point another name."),
        )
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
