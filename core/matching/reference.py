"""What is known of the ground today, in one value: ortho, heights, roads, and how good they are."""

from dataclasses import dataclass
from pathlib import Path

from core.formats.roads import read_roads
from core.geometry.crs import Bounds
from core.matching.road_lines import RoadLines, lines_on_ground
from core.raster.dem import Dem, open_dem
from core.raster.ortho import Ortho, open_ortho


@dataclass(frozen=True, slots=True)
class ReferenceFiles:
    """The files of a reference, and how good they are: keys of [reference] in `block.toml`."""

    crs: str
    """CRS of the block, in which the reference is read."""
    ortho: tuple[Path, ...]
    """Sheets of the ortho."""
    dem: tuple[Path, ...]
    """Files of the heights."""
    roads: tuple[Path, ...] = ()
    """Road layers."""
    mask: Path | None = None
    """Polygons in which nothing may be matched."""
    bridges: Path | None = None
    """Polygons of bridges."""
    ortho_sigma_m: float = 0.25
    """Standard deviation of the ortho per axis, metres."""
    dem_sigma_m: float = 0.5
    """Standard deviation of a height, metres."""


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


def open_reference(files: ReferenceFiles, bounds: Bounds | None = None) -> Reference:
    """Open the files of a reference; heights and roads within bounds are held in memory.

    Args:
        files: What to open.
        bounds: West, south, east, north, metres; None opens everything and reads no roads.

    Raises:
        PhotogrammetryError: A file is missing, damaged, or of another place.
    """
    dem = open_dem(files.dem, files.crs)
    if bounds is not None:
        dem = dem.cropped(bounds)
    roads = None if bounds is None else read_roads(files.roads, files.crs, bounds)
    return Reference(
        open_ortho(files.ortho, files.crs),
        dem,
        files.ortho_sigma_m,
        files.dem_sigma_m,
        None if roads is None else lines_on_ground(roads, dem),
    )
