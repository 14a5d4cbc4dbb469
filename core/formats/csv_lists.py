"""Surveyed points of the user as CSV: `id,X,Y,Z,sigma_xy,sigma_z,role`; and names of scans."""

import csv
from pathlib import Path

import numpy as np

from core.errors import ProjectError
from core.formats.point_list import ROLES, ListedPoint, ListedRole
from core.said import say

POINT_COLUMNS = ("id", "X", "Y", "Z")


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
