"""How much of the block the reference covers: what is said when it is too little."""

import numpy as np

from core.doubts import Doubt
from core.errors import ReferenceDataError
from core.geometry.crs import Bounds, shared_bounds
from core.raster.dem import Dem
from core.raster.grid import Grid
from core.raster.ortho import LEAST_COVERAGE, Ortho

# design: a fifth of the photos can be oriented; less is another place, or a wrong CRS.
LEAST_SHARE = 0.2
"""With less of the block covered than this, nothing useful can be made."""
# design: rims of sheets and lakes of nodata take a percent or two of any reference.
FULL_SHARE = 0.98
"""Below this share the operator is told what is missing."""
# design: half a percent across and down, ten times finer than FULL_SHARE asks for.
SAMPLES = 200
"""The block is looked at in at most this many pixels across and down."""


def check_coverage(dem: Dem, ortho: Ortho, bounds: Bounds) -> tuple[Doubt, ...]:
    """Doubts about a reference that covers only part of the block.

    Args:
        dem: Terrain.
        ortho: Reference ortho.
        bounds: West, south, east, north of the photos' approximate footprints, metres.

    Raises:
        ReferenceDataError: DEM or ortho misses the block, or nearly so, or is all nodata there.
    """
    grid = _sampling(bounds, min(dem.ground_sample_distance_m, ortho.ground_sample_distance_m))
    height = np.isfinite(dem.on(grid))
    picture = ortho.read_coverage(grid) >= LEAST_COVERAGE
    first = dem.sheets.sheets[0].path, ortho.sheets.sheets[0].path
    doubts = (
        _judged("DEM", first[0], float(height.mean()), dem.bounds, bounds),
        _judged("ortho", first[1], float(picture.mean()), ortho.bounds, bounds),
    )
    return tuple(doubt for doubt in doubts if doubt is not None)


def _sampling(bounds: Bounds, finest_m: float) -> Grid:
    """A coarse grid over the block."""
    west, south, east, north = bounds
    gsd = max(finest_m, (east - west) / SAMPLES, (north - south) / SAMPLES)
    columns, rows = max(1, int((east - west) / gsd)), max(1, int((north - south) / gsd))
    return Grid(west, north, gsd, columns, rows)


def _judged(what: str, file: str, share: float, own: Bounds, block: Bounds) -> Doubt | None:
    """An error, a doubt, or nothing."""
    if share >= FULL_SHARE:
        return None
    cause = (
        f"the {what} covers {100 * share:.0f} % of the block: it lies at {_words(own)}, "
        f"the block at {_words(block)}."
    )
    if share < LEAST_SHARE:
        if _overlap(own, block) > LEAST_SHARE:
            cause = f"the {what} is nodata over {100 * (1 - share):.0f} % of the block."
        raise ReferenceDataError(
            file,
            cause,
            f"Add {what} files for the rest of the block under [reference], or check the CRS and "
            "the scans' georeference.",
        )
    return Doubt(
        kind=f"{what.lower()}-coverage",
        subject=file,
        message=f"The {what} covers {100 * share:.0f} % of the block; there will be no control "
        "and no mosaic in the rest.",
        gravity=1 - share,
        evidence={"share": round(share, 4), "bounds": list(own), "block": list(block)},
    )


def _overlap(own: Bounds, block: Bounds) -> float:
    """Share of the block within the outer bounds."""
    west, south, east, north = shared_bounds(own, block)
    shared = max(east - west, 0.0) * max(north - south, 0.0)
    whole = (block[2] - block[0]) * (block[3] - block[1])
    return shared / whole if whole > 0 else 0.0


def _words(bounds: Bounds) -> str:
    """Bounds for a message."""
    return f"E {bounds[0]:.0f} to {bounds[2]:.0f}, N {bounds[1]:.0f} to {bounds[3]:.0f}"
