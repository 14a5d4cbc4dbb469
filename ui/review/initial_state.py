"""What the photos began from: scans as the engine found them, and those it could not place."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from core.geometry.exterior import ExteriorOrientation
from core.scans.interior_orientation import ScanOrientation


@dataclass(frozen=True, slots=True, eq=False)
class InitialState:
    """What is known of the photos before the block was adjusted."""

    films: Mapping[str, ScanOrientation] = field(default_factory=dict[str, ScanOrientation])
    """Scans with their marks as they were found, by photo; empty where that was not kept."""
    pixel_mm: Mapping[str, float] = field(default_factory=dict[str, float])
    """Nominal size of a scan pixel by photo, millimetres."""
    sources: Mapping[str, str] = field(default_factory=dict[str, str])
    """What placed each photo at first: `world-file`, `points`, `footprints` or `exterior`."""
    set_aside: Mapping[str, str] = field(default_factory=dict[str, str])
    """Scans that could not be used or placed at all, with the reason."""
    exterior: Mapping[str, ExteriorOrientation] = field(
        default_factory=dict[str, ExteriorOrientation]
    )
    """Where its source put each photo."""


NOTHING_INITIAL = InitialState()
