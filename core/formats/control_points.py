"""Surveyed points of the user: a CSV of `id,X,Y,Z,sigma_xy,sigma_z,role`."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.errors import ProjectError

COLUMNS = ("id", "X", "Y", "Z")
ROLES = ("control", "plan", "height", "check")
"""plan: control in X and Y alone; height: control in Z alone."""


@dataclass(frozen=True, slots=True)
class ListedPoint:
    """One row."""

    point_id: str
    """Name."""
    easting: float
    """Metres."""
    northing: float
    """Metres."""
    height: float
    """Metres."""
    sigma_plan_m: float
    """Standard deviation of easting and northing each, metres."""
    sigma_height_m: float
    """Standard deviation of the height, metres."""
    role: str
    """control, plan, height or check."""


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
        raise ProjectError(path, f"cannot be read ({error}).", remedy) from error
    rows = csv.DictReader(text.splitlines())
    missing = [name for name in COLUMNS if name not in (rows.fieldnames or ())]
    if missing:
        raise ProjectError(
            path,
            f"the column {missing[0]} is missing.",
            "The header row must be id,X,Y,Z,sigma_xy,sigma_z,role.",
        )
    points = tuple(listed(path, number, row) for number, row in enumerate(rows, start=2))
    names = [point.point_id for point in points]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ProjectError(path, f"the point {twice} stands twice.", "Give every point one name.")
    return points


def listed(path: Path, line: int, row: dict[str, str | None]) -> ListedPoint:
    """One row as a value."""
    role = (row.get("role") or "control").strip()
    if role not in ROLES:
        raise ProjectError(
            path,
            f"line {line}: the role {role!r} is unknown.",
            "It is control, plan, height or check.",
        )
    try:
        east, north, height = (float(row[name] or "") for name in COLUMNS[1:])
        plan, vertical = (float(row.get(name) or "0.1") for name in ("sigma_xy", "sigma_z"))
    except ValueError as error:
        raise ProjectError(
            path, f"line {line}: {error}.", "Numbers have a decimal point and no unit."
        ) from error
    name = (row["id"] or "").strip()
    if not name:
        raise ProjectError(path, f"line {line}: the point has no name.", "Give every point one.")
    if not np.isfinite([east, north, height]).all() or not (plan > 0 and vertical > 0):
        raise ProjectError(
            path,
            f"line {line}: {name} has a coordinate or a standard deviation that cannot be.",
            "Coordinates are finite; standard deviations are in metres and above 0.",
        )
    return ListedPoint(name, east, north, height, plan, vertical, role)
