"""Surveyed points of a list, how the list was read, and what has to be asked, as values."""

from dataclasses import dataclass
from typing import Literal, get_args

from core.formats.delimited_table import DelimitedTable, TableRow
from core.formats.point_columns import Quantity

Triple = tuple[float, float, float]
ListedRole = Literal["control", "plan", "height", "check"]
"""plan: control in X and Y alone; height: control in Z alone."""
ROLES: tuple[ListedRole, ...] = get_args(ListedRole)
# source: docs/formats.md: what Gruber's own list has where it says nothing.
USUAL_SIGMA_M = 0.1
Axes = Literal["E N", "N E", "-E -N", "-N -E"]
"""What the columns X and Y hold: easting and northing, swapped, with their signs turned, or both
(Czech lists: X = -northing, Y = -easting)."""


@dataclass(frozen=True, slots=True)
class ListedPoint:
    """One surveyed point of a list, in the block's CRS."""

    point_id: str
    """Name, without blanks around it."""
    easting: float
    """Metres."""
    northing: float
    """Metres."""
    height: float
    """Metres."""
    sigma_m: Triple
    """Standard deviations of easting, northing and height, metres."""
    role: ListedRole = "control"
    """What it is for."""
    description: str = ""
    """What it is, in the surveyor's words."""
    sketch: str = ""
    """Name of the file with its sketch or photograph."""


@dataclass(frozen=True, slots=True)
class PointListReading:
    """How a list is to be read: what is left at its default is recognised, or asked."""

    encoding: str = ""
    """As Python calls it."""
    delimiter: str = ""
    """Comma, semicolon, tab, or a blank for any run of blanks."""
    decimal: str = ""
    """Point or comma."""
    header: bool | None = None
    """Whether the first line names the columns."""
    columns: tuple[Quantity, ...] | None = None
    """What each column holds, from the first on."""
    axes: Axes | None = None
    """What the columns X and Y hold."""
    crs: str = ""
    """CRS of the list; the block's where empty."""
    role: ListedRole = "control"
    """Of points whose row says none."""
    sigma_plan_m: float = USUAL_SIGMA_M
    """Of points whose row says none: of easting and northing each, metres."""
    sigma_height_m: float = USUAL_SIGMA_M
    """Of points whose row says none, metres."""
    duplicates: Literal["", "first", "last"] = ""
    """Which row holds where two of one name differ; asked where empty."""
    outside: Literal["", "leave out", "keep"] = ""
    """What becomes of points that no photo can see; asked where empty."""
    refused: Literal["", "leave out"] = ""
    """Whether the others come in although rows are refused; asked where empty."""


@dataclass(frozen=True, slots=True)
class RefusedRow:
    """A row that brings no point."""

    number: int
    """Line of the file."""
    text: str
    """The row as it stands."""
    cause: str
    """What is wrong with it."""
    remedy: str
    """What to do about it."""


@dataclass(frozen=True, slots=True)
class Choice:
    """One answer to a question."""

    value: str
    """What the reading's field is set to."""
    words: str
    """What that means."""


@dataclass(frozen=True, slots=True)
class Question:
    """What the list does not say and the block does not tell."""

    about: str
    """Field of `PointListReading` that answers it."""
    words: str
    """The question with its evidence."""
    choices: tuple[Choice, ...] = ()
    """Answers; without any, the columns have to be named."""


@dataclass(frozen=True, slots=True)
class PointList:
    """A list as it was read."""

    reading: PointListReading
    """How it was read: everything recognised is filled in."""
    table: DelimitedTable
    """Its cells."""
    evidence: tuple[str, ...] = ()
    """What was recognised, and by what."""
    points: tuple[ListedPoint, ...] = ()
    """Points that may come in once no question is left."""
    refused: tuple[RefusedRow, ...] = ()
    """Rows that bring none."""
    questions: tuple[Question, ...] = ()
    """What has to be answered before anything comes in."""


@dataclass(frozen=True, slots=True)
class ReadRow:
    """A row that could be read."""

    source: TableRow
    """The row."""
    point: ListedPoint
    """Its point; easting and northing may still be the list's own X and Y."""
