"""Numbers as the pages get them: rounded, and none where there is none, for JSON knows no NaN."""

import math
from typing import Any


def short(value: float | None, digits: int) -> float | None:
    """A rounded number, None for what is not one."""
    if value is None or not math.isfinite(value):
        return None
    return round(float(value), digits)


def shortened(values: Any, digits: int) -> list[float | None] | None:
    """The same of several."""
    return None if values is None else [short(float(value), digits) for value in values]
