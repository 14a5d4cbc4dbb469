"""What is known of the ground today, in one value: ortho, heights, and how good they are."""

from dataclasses import dataclass

from core.reference.dem import Dem
from core.reference.ortho import Ortho
from core.reference.road_lines import RoadLines


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The reference a block is oriented on."""

    ortho: Ortho
    """Present-day ortho, seamless."""
    dem: Dem
    """Bare earth."""
    ortho_sigma_m: float
    """Standard deviation of the ortho per axis, metres."""
    dem_sigma_m: float
    """Standard deviation of a height, metres."""
    roads: RoadLines | None = None
    """Roads to be drawn into the photos; None where there are none."""
