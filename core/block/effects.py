"""What a decision about one point would do, as figures."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from core.arrays import Position

Key = tuple[str, str]
"""Point and photo."""


@dataclass(frozen=True, slots=True, eq=False)
class Effect:
    """What rejecting or accepting one measurement would do."""

    key: Key
    """Point and photo."""
    rejects: bool
    """True for a measurement that takes part and would be left out."""
    residual_px: tuple[float, float]
    """Its residual then (column, row), computed minus measured, pixels, as a report would have it:
    rejected, that of the known coordinates; accepted, that of the adjusted ones."""
    test: float
    """Length of what it says against all others, in standard deviations (of two coordinates)."""
    redundancy: float
    """Share of an error in it that its own residual would show, 0 to 1, mean of both axes."""
    shift_m: float
    """Largest shift of a photo's ground, metres."""
    photo_id: str
    """The photo that would shift most."""
    sigma_nought: float
    """It would be this."""
    corner_sigma_ratio: float
    """Largest standard deviation of a photo's ground then, over that of now."""
    step: Float64[np.ndarray, "unknowns"]
    """Change of all photos' and shared unknowns; `Foresight.exteriors_after` reads it."""


@dataclass(frozen=True, slots=True, eq=False)
class LeftOut:
    """One control point judged by all others: where they put it, less where it is said to be."""

    point_id: str
    """The point."""
    difference_m: Position
    """Predicted minus known (E, N, H), metres; NaN where its coordinate takes no part."""
    sigma_m: Position
    """Standard deviation of that difference, metres, for a sigma nought of one."""
    test: float
    """Length of the difference in its standard deviations."""
    shift_m: float
    """Largest shift of a photo's ground if it were left out, metres."""
