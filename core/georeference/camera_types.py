"""Typical constants of camera types, aggregated from many certificates.

`camera_types.csv` beside this file is written by `tests/camera_types.py`.
"""

import csv
from dataclasses import dataclass
from functools import cache
from pathlib import Path

FILE = Path(__file__).with_name("camera_types.csv")
HEAD = (
    "make", "model", "lens", "first_year", "last_year", "certificates",
    "distance_mm", "distance_spread_mm", "marks_apart_mm", "marks_spread_mm",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class CameraType:
    """One kind of lens of a camera type."""

    make: str
    """Who made it; `any` for all cameras together."""
    model: str
    """Name of the type."""
    certificates: int
    """How many certificates there are of it."""
    distance_mm: float
    """Median of their principal distances, millimetres."""
    spread_mm: float
    """Standard deviation of one camera's about it, millimetres."""
    marks_apart_mm: float
    """Median distance of opposite marks, millimetres; NaN where nobody measured it."""


@cache
def camera_types() -> tuple[CameraType, ...]:
    """All lenses of all types, of each type the most frequent first."""
    with FILE.open(encoding="utf-8", newline="") as rows:
        return tuple(
            CameraType(
                row["make"],
                row["model"],
                int(row["certificates"]),
                float(row["distance_mm"]),
                float(row["distance_spread_mm"]),
                float(row["marks_apart_mm"] or "nan"),
            )
            for row in csv.DictReader(rows)
        )
