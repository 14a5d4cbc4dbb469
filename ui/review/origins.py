"""What the photos began from: scans as the engine found them, and those it could not place."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from core.doubts import Failure
from core.scan.centring import Centre
from core.scan.orientation import ScanOrientation
from core.scan.snapping import Example, snap_mark

SURE, AGREEING_PX = 0.7, 0.3
"""Likeness and agreement of its two ways that make a mark an example for others."""
SAME_PIXEL = 0.02
"""Share by which the pixels of two scans may differ for one to be an example for the other."""


@dataclass(frozen=True, slots=True, eq=False)
class Origins:
    """What is known of the photos before the block was adjusted."""

    films: Mapping[str, ScanOrientation] = field(default_factory=dict[str, ScanOrientation])
    """Scans with their marks as they were found, by photo; empty where that was not kept."""
    pixel_mm: Mapping[str, float] = field(default_factory=dict[str, float])
    """Nominal size of a scan pixel by photo, millimetres."""
    sources: Mapping[str, str] = field(default_factory=dict[str, str])
    """What placed each photo at first: `world-file`, `points`, `footprints` or `exterior`."""
    set_aside: Mapping[str, str] = field(default_factory=dict[str, str])
    """Scans that could not be used or placed at all, with the reason."""


NO_ORIGINS = Origins()


def snapped(
    origins: Origins, photo_id: str, name: str, place: tuple[float, float]
) -> Centre | Failure:
    """The middle of a mark beside the place that somebody pointed at."""
    film = origins.films.get(photo_id)
    if film is None:
        return Failure("the scan is not at hand")
    pixel_mm = film.interior.pixel_size_mm
    return snap_mark(film.scan, place, pixel_mm, _example(origins, photo_id, name))


def _example(origins: Origins, photo_id: str, name: str) -> Example | None:
    """The same mark of the camera where it is surest, in a scan that lies the same way."""
    own = origins.films[photo_id]
    size = own.interior.pixel_size_mm
    candidates = [
        (mark.correlation, Example(film.scan, (mark.column, mark.row)))
        for other, film in origins.films.items()
        if other != photo_id
        and film.way == own.way
        and abs(film.interior.pixel_size_mm / size - 1) < SAME_PIXEL
        for mark in film.fiducials
        if mark.name == name
        and mark.correlation > SURE
        and mark.disagreement_px < AGREEING_PX
        and name in film.interior.names
    ]
    return max(candidates, key=lambda pair: pair[0])[1] if candidates else None
