"""Coordinates that cannot belong to their CRS: S-JTSK with positive signs or swapped axes."""

from pathlib import Path

import numpy as np
from jaxtyping import Float64
from pyproj import CRS
from pyproj.exceptions import CRSError as ProjCrsError

from core.errors import CrsError

KROVAK = ((-905_000.0, -430_000.0), (-1_335_000.0, -935_000.0))
"""Easting and northing of S-JTSK / Krovak East North over Czechia and Slovakia, metres."""
UTM33 = ((290_000.0, 790_000.0), (5_380_000.0, 5_660_000.0))
"""Easting and northing of WGS 84 / UTM 33N over Czechia, metres."""
FAR_M = 50_000.0
"""An approximate position further than this outside the DEM is a mistake, not a poor start."""

PlanePoints = Float64[np.ndarray, "n 2"]


def crs_from_text(crs: str, file: str | Path) -> CRS:
    """A CRS from `EPSG:n` or WKT; what PROJ does not know is a CrsError naming the file."""
    try:
        return CRS.from_user_input(crs)
    except ProjCrsError as error:
        raise CrsError(
            file, f"The CRS '{crs}' is not known.", "Write it as `EPSG:n`, such as EPSG:5514."
        ) from error


def is_krovak_east_north(crs: str) -> bool:
    """True for EPSG:5514 and its like (X east, Y north, both negative in Czechia)."""
    if crs.strip().upper().replace(" ", "") in ("EPSG:5514", "EPSG:5221", "EPSG:8353"):
        return True
    return "krovak east north" in CRS.from_user_input(crs).name.lower()


def check_coordinates(points: PlanePoints, crs: str, file: str | Path) -> None:
    """Refuse S-JTSK coordinates with positive signs or exchanged axes in a Krovak East North block.

    Args:
        points: Easting, northing as read, metres.
        crs: CRS they are said to be in.
        file: Where they were read.
    """
    if not is_krovak_east_north(crs) or not len(points):
        return
    middle = np.median(points, axis=0)
    if _within(middle, KROVAK):
        return
    told = f"({middle[0]:.0f}, {middle[1]:.0f})"
    if _within(-middle, KROVAK):
        raise CrsError(
            file,
            f"The coordinates {told} are S-JTSK with positive signs; {crs} is negative.",
            "Put a minus before both, in the order easting, northing.",
        )
    if _within(middle[::-1], KROVAK):
        raise CrsError(
            file,
            f"The coordinates {told} are S-JTSK with the two axes exchanged.",
            f"Write easting (about -750000) first and northing (about -1100000) second, as {crs}.",
        )
    if _within(-middle[::-1], KROVAK):
        raise CrsError(
            file,
            f"The coordinates {told} are S-JTSK as X south, Y west (EPSG:5513): positive and with "
            "the axes exchanged.",
            f"Write minus Y first and minus X second, as {crs}.",
        )
    raise CrsError(
        file,
        f"The coordinates {told} do not lie in the area of {crs}.",
        "Check the CRS of the file and `crs` in [block].",
    )


def check_within_reach(
    points: PlanePoints, bounds: tuple[float, float, float, float], file: str | Path
) -> None:
    """Refuse positions more than 50 km outside bounds (west, south, east, north), metres."""
    low, high = np.array(bounds[:2]), np.array(bounds[2:])
    outside = np.linalg.norm(np.maximum(np.maximum(low - points, points - high), 0), axis=1)
    if len(outside) and float(outside.max()) > FAR_M:
        worst = points[int(outside.argmax())]
        raise CrsError(
            file,
            f"The position ({worst[0]:.0f}, {worst[1]:.0f}) lies {outside.max() / 1000:.0f} km "
            "outside the DEM.",
            "Check its CRS, the signs and the order of its axes against `crs` in [block].",
        )


def crs_by_range(points: PlanePoints) -> str | None:
    """The CRS that points without one can only be in (METHODS 10), or None."""
    middle = np.median(points, axis=0)
    if _within(middle, KROVAK):
        return "EPSG:5514"
    if _within(middle, UTM33):
        return "EPSG:32633"
    return None


def _within(point: np.ndarray, area: tuple[tuple[float, float], tuple[float, float]]) -> bool:
    """True when a point lies in an area."""
    return all(low <= value <= high for value, (low, high) in zip(point, area, strict=True))
