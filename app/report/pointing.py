"""Pointing precision of the operators, from points that two of them measured."""

from collections import defaultdict
from collections.abc import Iterable
from itertools import permutations
from typing import Any

import numpy as np

from core.block import Measurement, Reading
from sessions.readings import SAME_PLACE_PX


def pointing_figures(measurements: Iterable[Measurement]) -> list[dict[str, Any]]:
    """One row for each operator who measured what somebody else measured too.

    Args:
        measurements: Of the block with its decisions.

    Returns:
        `who`; `count` of differences to others; `sigma_px`, the standard deviation per axis of one
        reading (both being alike, the RMS difference over the root of two); the mean difference,
        own minus others', `column_px` and `row_px`; and `other_detail`, how many lay too far apart
        to be of the same detail, which count in none of these.
    """
    differences: dict[str, list[tuple[float, float]]] = defaultdict(list)
    apart: dict[str, int] = defaultdict(int)
    for item in measurements:
        for own, other in permutations(item.readings, 2):
            off = _difference(own, other)
            if np.hypot(*off) <= SAME_PLACE_PX:
                differences[own.operator].append(off)
            else:
                apart[own.operator] += 1
    return [
        _row(who, np.array(differences[who]).reshape(-1, 2), apart[who])
        for who in sorted({*differences, *apart})
    ]


def _difference(own: Reading, other: Reading) -> tuple[float, float]:
    return own.column - other.column, own.row - other.row


def _row(who: str, off: np.ndarray, apart: int) -> dict[str, Any]:
    some = len(off) > 0
    return {
        "who": who,
        "count": len(off),
        "sigma_px": float(np.sqrt(np.mean(off**2) / 2)) if some else float("nan"),
        "column_px": float(off[:, 0].mean()) if some else float("nan"),
        "row_px": float(off[:, 1].mean()) if some else float("nan"),
        "other_detail": apart,
    }
