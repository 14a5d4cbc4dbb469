"""Surveyed points that the user brings, as they stand in a list."""

from dataclasses import dataclass
from typing import Literal, get_args

Triple = tuple[float, float, float]
ListedRole = Literal["control", "plan", "height", "check"]
"""plan: control in X and Y alone; height: control in Z alone."""
ROLES: tuple[ListedRole, ...] = get_args(ListedRole)


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
