"""Lists of exterior orientations as text: one photo a row, columns named by a header.

Columns may be parted by commas, semicolons, tabs or blanks. The plain list has the columns
`scan,X,Y,Z,omega_deg,phi_deg,kappa_deg[,sigma_*]`; `_gon` and `_rad` in place of `_deg` are read
as such, and angles may be left empty (position only). A comment such as
`# angles: phi-omega-kappa, gon` above the header says how a list counts; where neither says it,
the reader asks, unless who calls says it.
"""

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast, get_args

import numpy as np

from core.errors import ProjectError
from core.formats.records import LONGEST_HEAD, plain_bytes, scan_stem, unguarded
from core.formats.rotations import (
    FULL_TURN,
    RADIANS,
    AngleConvention,
    AngleOrder,
    AngleUnit,
    Triple,
    rotation_of,
)
from core.geometry.exterior import angles_from_rotation

REMEDY = "The list needs the columns scan,X,Y,Z,omega_deg,phi_deg,kappa_deg[,sigma_X, ...]."
NAMED = (
    "The list needs the columns scan,X,Y,Z,omega_deg,phi_deg,kappa_deg[,sigma_X, ...]; name "
    "them in order with gruber import --answer columns=...; leave unread ones empty."
)
"""What to do about a list whose columns are not known."""
ASKED = (
    "Say it in a comment above the header, such as `# angles: omega-phi-kappa, deg`, or take it in "
    "as eo-opk-deg, eo-opk-gon, eo-opk-rad, eo-pok-deg, eo-pok-gon, eo-pok-rad, eo-ypr-deg, "
    "eo-ypr-gon or eo-ypr-rad."
)
"""What to do about a list that does not say how it counts angles."""
POSITION = ("X", "Y", "Z")
PLAIN_UNIT = re.compile(r"(?:sigma_)?(?:omega|phi|kappa)_(deg|gon|rad)")
"""Columns of the plain list, whose angles are omega, phi, kappa whatever their sequence."""
UNIT_NAMES: Mapping[AngleUnit, tuple[str, ...]] = {
    "deg": ("deg", "degree", "degrees", "dd", "°"),
    "gon": ("gon", "gons", "grad", "grads", "grade"),
    "rad": ("rad", "radian", "radians"),
}
"""Words that headers write for a unit."""
UNIT_WORDS: Mapping[str, AngleUnit] = {
    word: unit for unit, words in UNIT_NAMES.items() for word in words
}
"""Units of angles, as headers write them."""
COLUMN_WORDS: Mapping[str, str] = {
    **dict.fromkeys(("scan", "photo", "photoid", "photo id", "image", "imagename", "name"), "scan"),
    **dict.fromkeys(("label", "file", "filename", "nom", "id"), "scan"),
    **dict.fromkeys(("x", "e", "easting", "east", "x/easting"), "x"),
    **dict.fromkeys(("y", "n", "northing", "north", "y/northing"), "y"),
    **dict.fromkeys(("z", "h", "height", "altitude", "z/altitude"), "z"),
    **dict.fromkeys(("omega", "o", "w"), "omega"),
    **dict.fromkeys(("phi", "p"), "phi"),
    **dict.fromkeys(("kappa", "k"), "kappa"),
    **dict.fromkeys(("yaw", "heading"), "yaw"),
    **{word: word for word in ("pitch", "roll")},
    **{f"sigma_{word}": f"sigma_{word}" for word in ("x", "y", "z", "omega", "phi", "kappa")},
}
"""What a column holds, by the words that programs head it with (in small letters)."""

ANSWERED = (
    *("scan", "X", "Y", "Z"),
    *(f"{name}_{unit}" for unit in UNIT_NAMES for name in ("omega", "phi", "kappa")),
    *(f"{name}_{unit}" for unit in UNIT_NAMES for name in ("yaw", "pitch", "roll")),
    *("omega", "phi", "kappa", "yaw", "pitch", "roll", "sigma_X", "sigma_Y", "sigma_Z"),
    *("sigma_omega", "sigma_phi", "sigma_kappa"),
)
"""What the columns of a list may be said to hold by whoever reads it."""


@dataclass(frozen=True, slots=True)
class EoRecord:
    """One row: a perspective centre, perhaps its rotation, perhaps how sure they are."""

    scan: str
    """File name of the scan without folder and extension."""
    centre: Triple
    """Easting, northing, height of the perspective centre, metres."""
    angles: Triple | None = None
    """omega, phi, kappa, radians; None where the row gives a position only."""
    sigma_centre_m: Triple | None = None
    """Standard deviations of the centre, metres, where given."""
    sigma_angles: Triple | None = None
    """Standard deviations of omega, phi, kappa, radians, where given for these angles."""
    file: str = ""
    """Name of the scan as the list gives it."""
    written: Triple | None = None
    """The three angles as the list gives them, in its own order and unit."""


@dataclass(frozen=True, slots=True)
class EoList:
    """A list, read."""

    records: Mapping[str, EoRecord]
    """By scan, in the order of the file."""
    crs: str = ""
    """CRS that a comment of the list names; empty where none does."""
    unread: Sequence[str] = ()
    """Heads of columns that are not read."""
    perhaps_angles: Sequence[str] = ()
    """Three of them with numbers behind the position, in a list without angles."""


def read_eo_list(path: Path) -> Mapping[str, EoRecord]:
    """Read a list, by scan name (without folder and extension).

    Raises:
        ProjectError: Missing, empty, without a needed column, with words for numbers, with a scan
            that stands twice, or without a word on how it counts angles.
    """
    return read_eo_records(path).records


def read_eo_records(
    path: Path, said: AngleConvention | None = None, heads: Sequence[str] = ()
) -> EoList:
    """Read a list whose angles count as it says, or as the caller says.

    Args:
        path: Text in UTF-8.
        said: How angles count where the list does not say it itself; with it a list may lack a
            header and then holds scan, X, Y, Z and the three angles.
        heads: What its columns hold, of `ANSWERED`, empty where one is not read; none where its
            header says it.

    Raises:
        ProjectError: As `read_eo_list`; or the list says otherwise than the caller.
    """
    lines = _lines(path)
    comments = [text for _, text in lines if text.startswith("#")]
    rows = [(number, text) for number, text in lines if not text.startswith("#")]
    if rows and comments and not _names_scan(rows[0][1]) and _names_scan(comments[-1]):
        rows = [(0, comments.pop().lstrip("# ")), *rows]
    headed = bool(rows) and (_names_scan(rows[0][1]) or (bool(heads) and _is_header(rows[0][1])))
    if len(rows) < 1 + headed:
        raise ProjectError(path, "The list holds no rows.", REMEDY)
    delimiter = _delimiter(rows[0][1])
    unread: Sequence[str] = ()
    if headed:
        unread = [] if heads else _cells(rows[0][1], delimiter)
        columns = _columns(path, heads or unread)
        rows = rows[1:]
        # Some programs part heads by commas and rows by tabs.
        delimiter = delimiter if delimiter in rows[0][1] else _delimiter(rows[0][1])
    elif heads:
        columns = _columns(path, heads)
    elif said is not None:
        names = ("scan", "x", "y", "z", *said.order.split("-"))
        columns = _Columns({name: index for index, name in enumerate(names)}, None, None)
    else:
        raise ProjectError(path, "The column {shown} is missing.", REMEDY, shown="scan")
    convention = _convention(path, columns, _stated(comments), said)
    table = _Table(path, delimiter, columns, convention)
    records: dict[str, EoRecord] = {}
    first: dict[str, int] = {}
    for number, text in rows:
        record = table.record(number, _cells(text, delimiter))
        if record.scan in first:
            raise ProjectError(
                path,
                "Row {number}: the scan {scan} stands twice, in row {first} already.",
                "Leave one row for every scan.",
                number=number,
                scan=record.scan,
                first=first[record.scan],
            )
        records[record.scan], first[record.scan] = record, number
    crs, cells = _stated_crs(comments), _cells(rows[0][1], delimiter)
    return EoList(records, crs, *_unread(unread, columns, cells))


@dataclass(frozen=True, slots=True)
class _Columns:
    """Where the columns of a list stand, and what their heads say of angles."""

    at: Mapping[str, int]
    """Index of each column by what it holds."""
    unit: AngleUnit | None
    """Unit that the heads of the angles bear."""
    order: AngleOrder | None
    """Order that the heads tell."""

    @property
    def last_angle(self) -> int:
        """Index of the last column of angles; -1 where there are none."""
        names = ("omega", "phi", "kappa", "yaw", "pitch", "roll")
        return max((self.at[name] for name in names if name in self.at), default=-1)


def _lines(path: Path) -> list[tuple[int, str]]:
    """Lines that are not empty, with their numbers."""
    try:
        text = plain_bytes(path).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ProjectError(
            path,
            "The exterior orientation list cannot be read ({error}).",
            "Give the path of a text file in UTF-8.",
            error=error,
        ) from error
    every = ((number, line.strip()) for number, line in enumerate(text.splitlines(), 1))
    return [(number, line) for number, line in every if line]


def _delimiter(header: str) -> str:
    """The sign between columns; a blank stands for any white space."""
    found = max(",;\t", key=header.count)
    return found if found in header else " "


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        parts = line.split()
    else:
        parts = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    return [unguarded(part.strip().strip('"')) for part in parts]


def _names_scan(line: str) -> bool:
    """Whether a line is a header: no cell is a number, and one names positions or scans."""
    cells = _cells(line.lstrip("# "), _delimiter(line))
    words = {_word(cell)[0] for cell in cells}
    return not any(_is_number(cell) for cell in cells) and bool(words & {"scan", "x", "y", "z"})


def _is_header(line: str) -> bool:
    """Whether no cell of a line is a number."""
    return not any(_is_number(cell) for cell in _cells(line, _delimiter(line)))


def _is_number(cell: str) -> bool:
    return re.fullmatch(r"[+-]?\d+([.,]\d*)?([eE][+-]?\d+)?", cell) is not None


def _word(cell: str) -> tuple[str, AngleUnit | None]:
    """What a head means, and the unit it bears."""
    plain = cell.lower().lstrip("#").strip()[:LONGEST_HEAD]
    found = re.fullmatch(r"(.*?)[\s_]*[\[(]\s*([^\])]*)\s*[\])]", plain) or re.fullmatch(
        r"(.*)_(deg|gon|rad)", plain
    )
    unit = UNIT_WORDS.get(found[2]) if found else None
    name = found[1].strip() if found else plain
    return COLUMN_WORDS.get(name, name), unit


def _columns(path: Path, heads: Sequence[str]) -> _Columns:
    """Columns by what they hold."""
    at: dict[str, int] = {}
    units: dict[str, AngleUnit | None] = {}
    for index, head in enumerate(heads):
        if not head:
            continue
        name, unit = _word(head)
        # Two columns may be names (an id and a label): the later one is nearer to a file's name.
        if name in at and name != "scan":
            raise ProjectError(
                path, "The column {shown} stands twice.", "Leave one of the two.", shown=head
            )
        at[name], units[name] = index, unit
    for needed in ("scan", "x", "y", "z"):
        if needed not in at:
            shown = needed if needed == "scan" else needed.upper()
            raise ProjectError(path, "The column {missing} is missing.", NAMED, missing=shown)
    given: set[AngleUnit] = {unit for unit in units.values() if unit is not None}
    if len(given) > 1:
        raise ProjectError(
            path,
            "The angles are headed in two units, {units}.",
            "Give all three angles in one unit.",
            units=", ".join(sorted(given)),
        )
    unit: AngleUnit | None = next(iter(given), None)
    plain = all(PLAIN_UNIT.fullmatch(h.strip("# ").lower()) for h in heads if _word(h)[1])
    return _Columns(at, unit, _order(path, at, unit, plain=plain and unit is not None))


def _order(
    path: Path, at: Mapping[str, int], unit: AngleUnit | None, *, plain: bool
) -> AngleOrder | None:
    """The order that heads tell; None where phi stands before omega and nothing more is said."""
    for order in get_args(AngleOrder):
        names = order.split("-")
        given = [name for name in names if name in at]
        if given and len(given) < len(names):
            missing = ", ".join(
                name + (f"_{unit}" if unit else "") for name in names if name not in at
            )
            raise ProjectError(path, "The column {missing} is missing.", REMEDY, missing=missing)
    if "yaw" in at:
        return "yaw-pitch-roll"
    if "omega" in at and (plain or at["omega"] < at["phi"]):
        return "omega-phi-kappa"
    return None


def _stated(comments: Sequence[str]) -> tuple[AngleOrder | None, AngleUnit | None]:
    """Order and unit that comments name."""
    text = " ".join(comments).lower()
    order = next((name for name in get_args(AngleOrder) if name in text), None)
    words = re.findall(r"angles?\b[^#]*", text)
    told = re.findall(r"[a-z°]+", " ".join(words))
    units: list[AngleUnit] = [UNIT_WORDS[word] for word in told if word in UNIT_WORDS]
    return order, units[0] if units else None


def _stated_crs(comments: Sequence[str]) -> str:
    """The CRS that a comment `# CRS: ...` names."""
    found = (re.match(r"#\s*crs\s*:\s*(.+)", text, re.IGNORECASE) for text in comments)
    return next((one[1].strip() for one in found if one), "")


def _convention(
    path: Path,
    columns: _Columns,
    stated: tuple[AngleOrder | None, AngleUnit | None],
    said: AngleConvention | None,
) -> AngleConvention | None:
    """How the angles count: by comment, heads, caller; None where the list holds none."""
    if columns.last_angle < 0:
        return None
    unit = stated[1] or columns.unit
    order = stated[0] or columns.order
    if said is not None:
        for theirs, ours in ((unit, said.unit), (stated[0], said.order)):
            if theirs is not None and theirs != ours:
                raise ProjectError(
                    path,
                    "The list says {theirs}, and is to be read as {ours}.",
                    "Correct the list or what you said.",
                    theirs=theirs,
                    ours=ours,
                )
        return said
    if unit is None:
        bare = next(n for n in ("omega", "yaw", "phi", "kappa") if n in columns.at)
        raise ProjectError(path, "The column {bare} does not say its unit.", ASKED, bare=bare)
    if order is None:
        raise ProjectError(
            path,
            "Phi stands before omega, and the list does not say which of them turns first.",
            ASKED,
        )
    return AngleConvention(order, unit)


def _unread(
    heads: Sequence[str], columns: _Columns, cells: Sequence[str]
) -> tuple[Sequence[str], Sequence[str]]:
    """Heads that are not read, and three of them that may be angles by the first row."""
    unread = [head for head in heads if head and _word(head)[0] not in COLUMN_WORDS.values()]
    start = 1 + max(columns.at[name] for name in ("x", "y", "z"))
    behind = slice(start, start + 3)
    numbers = [head for head, cell in zip(heads[behind], cells[behind], strict=False)
               if head in unread and _is_number(cell)]  # fmt: skip
    return unread, numbers if columns.last_angle < 0 and len(numbers) == 3 else ()


@dataclass(frozen=True, slots=True)
class _Table:
    """What turns rows into records."""

    path: Path
    delimiter: str
    columns: _Columns
    convention: AngleConvention | None

    def record(self, number: int, cells: Sequence[str]) -> EoRecord:
        """One row as a value."""
        name = self._cell("scan", cells)
        if not name:
            raise ProjectError(self.path, "Row {number} names no scan.", REMEDY, number=number)
        if len(cells) <= self.columns.last_angle:
            raise ProjectError(
                self.path,
                "Row {number} ({scan}) ends early.",
                "The file was cut off, or a column is missing in this row.",
                number=number,
                scan=name,
            )
        centre = self._triple(number, name, POSITION, cells)
        if centre is None:
            raise self._empty(number, name, "X")
        written = angles = sigma_angles = None
        if self.convention is not None:
            written = self._triple(number, name, self.convention.order.split("-"), cells)
        if written is not None and self.convention is not None:
            angles = self._omega_phi_kappa(number, name, written, self.convention)
            sigma_angles = self._sigma_angles(number, name, cells, self.convention)
        names = ("sigma_x", "sigma_y", "sigma_z")
        sigma = self._triple(number, name, names, cells)
        self._check_sigma(number, name, sigma)
        return EoRecord(scan_stem(name), centre, angles, sigma, sigma_angles, name, written)

    def _cell(self, name: str, cells: Sequence[str]) -> str:
        index = self.columns.at.get(name.lower(), -1)
        return cells[index] if 0 <= index < len(cells) else ""

    def _empty(self, number: int, scan: str, column: str) -> ProjectError:
        return ProjectError(
            self.path,
            "Row {number} ({scan}), column {empty} is empty.",
            REMEDY,
            number=number,
            scan=scan,
            empty=column,
        )

    def _triple(
        self, number: int, scan: str, names: Sequence[str], cells: Sequence[str]
    ) -> Triple | None:
        """Three values; None where all three are empty."""
        values = [self._number(number, name, self._cell(name, cells)) for name in names]
        if all(value is None for value in values):
            return None
        for name, value in zip(names, values, strict=True):
            if value is None:
                raise self._empty(number, scan, name)
        return cast("Triple", tuple(values))

    def _number(self, number: int, column: str, cell: str) -> float | None:
        """A value; None where the cell is empty or says that there is none."""
        if not cell:
            return None
        try:
            value = float(cell if self.delimiter == "," else cell.replace(",", "."))
        except ValueError as error:
            raise ProjectError(
                self.path,
                "Row {number}, column {column}: '{cell}' is not a number.",
                REMEDY,
                number=number,
                column=column,
                cell=cell,
            ) from error
        return value if np.isfinite(value) else None

    def _omega_phi_kappa(
        self, number: int, scan: str, written: Triple, convention: AngleConvention
    ) -> Triple:
        """Angles of a row, radians."""
        turn = FULL_TURN[convention.unit]
        beyond = next((value for value in written if abs(value) > turn), None)
        if beyond is not None:
            raise ProjectError(
                self.path,
                "Row {number} ({scan}): an angle of {value} {unit} is more than a whole turn.",
                "Head the angles with the unit they are in: _deg, _gon or _rad.",
                number=number,
                scan=scan,
                value=beyond,
                unit=convention.unit,
            )
        factor = RADIANS[convention.unit]
        radians = written[0] * factor, written[1] * factor, written[2] * factor
        if convention.order == "omega-phi-kappa":
            return radians
        return angles_from_rotation(rotation_of(convention.order, radians))

    def _sigma_angles(
        self, number: int, scan: str, cells: Sequence[str], convention: AngleConvention
    ) -> Triple | None:
        """Standard deviations of omega, phi, kappa, where the list gives these."""
        names = ("sigma_omega", "sigma_phi", "sigma_kappa")
        found = self._triple(number, scan, names, cells)
        self._check_sigma(number, scan, found)
        if found is None or convention.order != "omega-phi-kappa":
            return None
        factor = RADIANS[convention.unit]
        return found[0] * factor, found[1] * factor, found[2] * factor

    def _check_sigma(self, number: int, scan: str, sigma: Triple | None) -> None:
        if sigma is not None and min(sigma) < 0:
            raise ProjectError(
                self.path,
                "Row {number} ({scan}): a standard deviation is below nought.",
                "Standard deviations are in metres, and in the unit of the angles.",
                number=number,
                scan=scan,
            )
