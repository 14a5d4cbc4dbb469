"""Lists of the user as CSV: exterior orientations, and surveyed points.

Exterior orientations have the columns `scan,X,Y,Z,omega_deg,phi_deg,kappa_deg[,sigma_*]`; angles
may be left empty (position only), and `_gon` in place of `_deg` is read as gon. Surveyed points
have `id,X,Y,Z,sigma_xy,sigma_z,role`.
"""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.errors import ProjectError
from core.formats.point_list import ROLES, ListedPoint, ListedRole, Triple
from core.said import say

POSITION = ("X", "Y", "Z")
ANGLES = ("omega", "phi", "kappa")
# source: definition of degree and gon.
RADIANS = {"_deg": np.pi / 180, "_gon": np.pi / 200}
REMEDY = "The list needs the columns scan,X,Y,Z,omega_deg,phi_deg,kappa_deg[,sigma_X, ...]."
POINT_COLUMNS = ("id", "X", "Y", "Z")


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
    """Standard deviations of the angles, radians, where given."""


def read_eo_list(path: Path) -> Mapping[str, EoRecord]:
    """Read a list, by scan name (without folder and extension).

    Raises:
        ProjectError: Missing, empty, without a needed column, or with words for numbers.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ProjectError(
            path, say(
"The exterior orientation list cannot be read ({error}).",
error=error
),
            "Check the path of `exterior` in [scans]; the list is UTF-8 text.",
        ) from error  # fmt: skip
    lines = [line for line in text.splitlines() if line.strip()]
    if len(lines) < 2:
        raise ProjectError(path, "The list holds no rows.", REMEDY)
    delimiter = max(",;\t", key=lines[0].count)
    rows = csv.DictReader(lines, delimiter=delimiter, skipinitialspace=True)
    header = {name.strip().lstrip("#").strip().lower(): name for name in rows.fieldnames or ()}
    for needed in ("scan", "x", "y", "z"):
        if needed not in header:
            shown = needed if needed == "scan" else needed.upper()
            raise ProjectError(
                path,
                say("The column {shown} is missing.", shown=shown),
                REMEDY,
            )
    _check_angle_columns(path, header)
    records = [_record(path, _Row(path, number, row, header)) for number, row in enumerate(rows, 2)]
    return {record.scan: record for record in records}


@dataclass(frozen=True, slots=True)
class _Row:
    """One row of the file, looked up by the header's words whatever their case."""

    path: Path
    number: int
    cells: Mapping[str, str | None]
    header: Mapping[str, str]

    def number_of(self, column: str) -> float | None:
        """The value of a column; None when the column or the cell is empty."""
        cell = (self.cells.get(self.header.get(column.lower(), "")) or "").strip()
        if not cell:
            return None
        try:
            value = float(cell)
        except ValueError as error:
            raise ProjectError(
                self.path,
                say(
                    "Row {number}, column {column}: '{cell}' is not a number.",
                    number=self.number,
                    column=column,
                    cell=cell,
                ),
                REMEDY,
            ) from error
        return value if np.isfinite(value) else None

    def triple(self, columns: tuple[str, str, str]) -> Triple | None:
        """Three values, or None unless all three are there."""
        first, second, third = (self.number_of(column) for column in columns)
        if first is None or second is None or third is None:
            return None
        return first, second, third

    def angles(self, prefix: str) -> Triple | None:
        """Three angles in radians, from degree or gon columns."""
        for unit, factor in RADIANS.items():
            omega, phi, kappa = ANGLES
            columns = (prefix + omega + unit, prefix + phi + unit, prefix + kappa + unit)
            found = self.triple(columns)
            if found is not None:
                return found[0] * factor, found[1] * factor, found[2] * factor
        return None


def _check_angle_columns(path: Path, header: Mapping[str, str]) -> None:
    """Either all three angle columns in one unit, or none at all."""
    for unit in RADIANS:
        given = [name for name in ANGLES if name + unit in header]
        if given and len(given) < len(ANGLES):
            missing = ", ".join(name + unit for name in ANGLES if name not in given)
            raise ProjectError(
                path,
                say("The column {missing} is missing.", missing=missing),
                REMEDY,
            )
    bare = [name for name in ANGLES if name in header]
    if bare:
        raise ProjectError(
            path,
            say("The column {bare} does not say its unit.", bare=bare[0]),
            "Name it _deg or _gon.",
        )


def _record(path: Path, row: _Row) -> EoRecord:
    """One row as a value."""
    scan = (row.cells.get(row.header["scan"]) or "").strip()
    if not scan:
        raise ProjectError(
            path,
            say("Row {number} names no scan.", number=row.number),
            REMEDY,
        )
    centre = row.triple(("X", "Y", "Z"))
    if centre is None:
        empty = next(name for name in POSITION if row.number_of(name) is None)
        raise ProjectError(
            path,
            say(
                "Row {number} ({scan}), column {empty} is empty.",
                number=row.number,
                scan=scan,
                empty=empty,
            ),
            REMEDY,
        )
    return EoRecord(
        scan_stem(scan),
        centre,
        row.angles(""),
        row.triple(("sigma_X", "sigma_Y", "sigma_Z")),
        row.angles("sigma_"),
    )


def scan_stem(name: str) -> str:
    """A scan's name without folder (of any system) and image extension; case is kept."""
    plain = name.strip().replace("\\", "/").rsplit("/", 1)[-1]
    stem, dot, extension = plain.rpartition(".")
    known = {"tif", "tiff", "jpg", "jpeg", "jp2", "j2k", "png", "img", "vrt"}
    return stem if dot and extension.lower() in known else plain


def read_control_points(path: Path) -> tuple[ListedPoint, ...]:
    """Read a list of surveyed points.

    Args:
        path: CSV with a header row; sigma_xy and sigma_z default to 0.1 m, role to control.

    Raises:
        ProjectError: Not UTF-8; a column is missing; a number is none or cannot be; a role is
            unknown; a name is missing or stands twice.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        remedy = "Save it as a UTF-8 text file that you may read."
        raise ProjectError(
            path,
            say("cannot be read ({error}).", error=error),
            remedy,
        ) from error
    rows = csv.DictReader(text.splitlines())
    missing = [name for name in POINT_COLUMNS if name not in (rows.fieldnames or ())]
    if missing:
        raise ProjectError(
            path,
            say("the column {missing} is missing.", missing=missing[0]),
            "The header row must be id,X,Y,Z,sigma_xy,sigma_z,role.",
        )
    points = tuple(_read_point(path, number, row) for number, row in enumerate(rows, start=2))
    names = [point.point_id for point in points]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ProjectError(
            path,
            say("the point {twice} stands twice.", twice=twice),
            "Give every point one name.",
        )
    return points


def _read_point(path: Path, line: int, row: dict[str, str | None]) -> ListedPoint:
    """One row as a value."""
    said = (row.get("role") or "control").strip()
    role: ListedRole | None = next((known for known in ROLES if known == said), None)
    if role is None:
        raise ProjectError(
            path,
            say("line {line}: the role {role!r} is unknown.", line=line, role=said),
            "It is control, plan, height or check.",
        )
    try:
        east, north, height = (float(row[name] or "") for name in POINT_COLUMNS[1:])
        plan, vertical = (float(row.get(name) or "0.1") for name in ("sigma_xy", "sigma_z"))
    except ValueError as error:
        raise ProjectError(
            path,
            say("line {line}: {error}.", line=line, error=error),
            "Numbers have a decimal point and no unit.",
        ) from error
    name = (row["id"] or "").strip()
    if not name:
        raise ProjectError(
            path,
            say("line {line}: the point has no name.", line=line),
            "Give every point one.",
        )
    if not np.isfinite([east, north, height]).all() or not (plan > 0 and vertical > 0):
        raise ProjectError(
            path,
            say(
                "line {line}: {name} has a coordinate or a standard deviation that cannot be.",
                line=line,
                name=name,
            ),
            "Coordinates are finite; standard deviations are in metres and above 0.",
        )
    return ListedPoint(name, east, north, height, (plan, plan, vertical), role)
