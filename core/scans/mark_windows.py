"""Windows at full resolution about the places where marks are, or should be."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32

from core.geometry.transforms import PlaneTransform, apply_affine, fit_similarity
from core.raster.scan_file import ScanFile, read_window
from core.scans.candidates import eighth
from core.scans.constellation import Constellation

RING_MM = 1.4
"""Greatest ring about a dot that is looked for, millimetres."""


@dataclass(frozen=True, slots=True, eq=False)
class Spot:
    """A window about one mark."""

    name: str
    """The fiducial's name."""
    corner: tuple[int, int]
    """First column and row in the scan."""
    gray: Float32[np.ndarray, "rows columns"]
    """Gray values."""
    start: tuple[float, float]
    """Approximate middle, window pixels."""
    outward: tuple[float, float]
    """Direction from the middle of the marks, in the film's axes (right, down)."""
    found: bool
    """False where the place only follows from the other marks."""


def open_spots(scan: ScanFile, found: Constellation, pixel_mm: float) -> Mapping[str, Spot]:
    """Full resolution windows about all marks; those not found yet where the others put them."""
    places = _all_places(found)
    middle = np.mean(list(places.values()), axis=0)
    spots: dict[str, Spot] = {}
    for name, (column, row) in places.items():
        outward = eighth((column - middle[0], row - middle[1]), within_eighth(found.turn))
        spot = open_spot(scan, name, (column, row), outward, found.mark.reach_mm, pixel_mm)
        if spot is not None:
            spots[name] = replace(spot, found=name in found.names)
    return spots


def open_spot(
    scan: ScanFile,
    name: str,
    place: tuple[float, float],
    outward: tuple[float, float],
    reach_mm: float,
    pixel_mm: float,
) -> Spot | None:
    """The full resolution window about one place; None outside the scan.

    Args:
        scan: The scan.
        name: The fiducial's name.
        place: Where it should be, scan pixels.
        outward: Direction from the middle of the marks, in the film's axes (right, down).
        reach_mm: How far the mark extends from its middle.
        pixel_mm: Size of a scan pixel, millimetres.
    """
    column, row = place
    if not (0 < column < scan.size_px[0] and 0 < row < scan.size_px[1]):
        return None
    # Room for a ring about what was found as a dot, and for a start that is a little off.
    half = int(np.ceil((max(reach_mm, RING_MM) * 1.8 + 0.6) / pixel_mm)) + 8
    corner = (round(column) - half, round(row) - half)
    gray = read_window(scan, *corner, 2 * half, 2 * half, outside="edge")
    if not np.isfinite(gray[half - 3 : half + 3, half - 3 : half + 3]).all():
        return None
    return Spot(name, corner, gray, (column - corner[0], row - corner[1]), outward, False)


def within_eighth(turn: float) -> float:
    """A rotation less its quarter turns."""
    return float((turn + np.pi / 4) % (np.pi / 2) - np.pi / 4)


def _all_places(found: Constellation) -> Mapping[str, tuple[float, float]]:
    """Where each mark was found, or where a similarity through the found ones puts it."""
    names = found.layout.names
    film = found.layout.lying(found.way)
    at = {name: i for i, name in enumerate(names)}
    fit = fit_similarity(film[[at[n] for n in found.names]], found.pixels, mirrored=True)
    places = dict(found.predicted)
    if isinstance(fit, PlaneTransform):
        for name, (column, row) in zip(names, apply_affine(fit.matrix, film).tolist(), strict=True):
            places[name] = (column, row)
    for name, (column, row) in zip(found.names, found.pixels.tolist(), strict=True):
        places[name] = (column, row)
    return places
