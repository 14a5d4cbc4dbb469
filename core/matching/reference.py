"""The reference in one value: ortho, heights and roads, with their accuracy.

Roads are centre lines in space that can be drawn into a photo: templates independent of the ortho.
Where everything around a road has changed, the map still predicts strips of its width, of whatever
tone.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import shapely
from jaxtyping import Bool, Float64, Int64

from core.arrays import ObjectPoints, locked
from core.block import REFERENCE, Block, ShiftedReference
from core.formats.roads import Roads, read_roads
from core.geometry.crs import Bounds, shared_bounds
from core.raster.dem import Dem, PlanePoints, dems_laid_over, level_ground, open_dem
from core.raster.ortho import Ortho, no_ortho, open_ortho, orthos_laid_over

# design: the spacing of usual terrain models.
STEP_M = 10.0
"""No two vertices of a road are further apart, so that lines follow the terrain."""
# design: a road of two narrow lanes.
USUAL_WIDTH_M = 5.0
"""Width of a road of which the map does not tell any."""
# design: a track, and a road of three lanes.
WIDTHS_M = (2.5, 12.0)
"""Narrower and wider ones are drawn as these: lanes of a motorway are no edge of one strip."""
# design: any that is not empty.
NOWHERE: Bounds = (0.0, 0.0, 1.0, 1.0)
"""Bounds of an ortho that is not there, where nothing tells any, metres."""


@dataclass(frozen=True, slots=True)
class SigmaRule:
    """What accuracy a reference of a pixel size can have, where nobody says more."""

    usual_m: float
    """Standard deviation of usual national data; nothing better is expected, metres."""
    expected_px: float
    """Standard deviation to expect, pixels."""
    least_px: float
    """What is stated finer than this is asked about, pixels."""

    def expected_m(self, pixel_m: float) -> float:
        """Standard deviation to expect, metres, of two digits."""
        return max(self.usual_m, float(f"{self.expected_px * pixel_m:.2g}"))


# design: a pixel of usual national orthos; `block.toml` states it.
# source: ASPRS Positional Accuracy Standards (2014), table B.5: an RMSE of one pixel per axis is
# the best work, two are usual. 1/sqrt(12) = 0.29 pixels is what a place known to the pixel has.
ORTHO_SIGMA = SigmaRule(0.25, 1.0, 0.25)
"""Of an ortho, per axis."""
# source: SRTM, cells of 30 m: 3.4 to 5.5 m (Rodriguez et al. 2006), ASTER 8.7 m, Copernicus 2.4 m:
# 0.08 to 0.29 cells. It is what a shift by one cell makes on a slope of 1 : 5; a quarter of a cell
# on 1 : 10 is the least.
DEM_SIGMA = SigmaRule(0.5, 0.2, 0.025)
"""Of the heights of a terrain model, whose cells are the pixels."""


SigmasAt = Callable[[PlanePoints], Float64[np.ndarray, "n 2"]]
"""Standard deviations of a reference at places, of the ortho per axis and of the height, metres."""


def usual_sigmas_m(plan: PlanePoints) -> Float64[np.ndarray, "n 2"]:
    """Those of usual national data at places, metres."""
    return np.tile((ORTHO_SIGMA.usual_m, DEM_SIGMA.usual_m), (len(plan), 1))


@dataclass(frozen=True, slots=True)
class ReferenceLayer:
    """Ortho and heights of one time, and how good they are."""

    name: str
    """What the report calls it."""
    ortho: tuple[Path, ...]
    """Sheets of the ortho."""
    dem: tuple[Path, ...]
    """Files of the heights."""
    ortho_sigma_m: float
    """Standard deviation of the ortho per axis, metres."""
    dem_sigma_m: float
    """Standard deviation of a height, metres."""
    datum: bool = False
    """Whether it says where the block lies: others may lie off against it as a whole."""

    @property
    def shifted(self) -> ShiftedReference | None:
        """What all its points may be off together; None for the one that defines the datum."""
        if self.datum:
            return None
        own_m = self.ortho_sigma_m
        return ShiftedReference(self.name, (own_m, own_m, self.dem_sigma_m if self.dem else 0.0))


@dataclass(frozen=True, slots=True)
class ReferenceFiles:
    """The files of a reference, and how good they are: keys of [reference] in `block.toml`."""

    crs: str
    """CRS of the block, in which the reference is read."""
    ortho: tuple[Path, ...]
    """Sheets of the ortho; without any, nothing is proposed."""
    dem: tuple[Path, ...]
    """Files of the heights; without any, the ground is level."""
    roads: tuple[Path, ...] = ()
    """Road layers."""
    mask: Path | None = None
    """Polygons in which nothing may be matched."""
    bridges: Path | None = None
    """Polygons of bridges."""
    ortho_sigma_m: float = ORTHO_SIGMA.usual_m
    """Standard deviation of the ortho per axis, metres."""
    dem_sigma_m: float = DEM_SIGMA.usual_m
    """Standard deviation of a height, metres."""
    level_m: float | None = None
    """Mean height of the user's surveyed points, metres: the ground where there is no DEM."""
    area: Bounds | None = None
    """West, south, east, north of those points, metres: where the block lies without an ortho."""
    roads_drawn: bool = field(default=True, metadata={"later": True})
    """Whether roads are drawn into templates besides giving junctions."""
    layers: tuple[ReferenceLayer, ...] = ()
    """Where photos are tied to more than `ortho` and `dem`: all of it, these among it, in the order
    of preference; while photos are brought into place, each serves where those before it have
    nothing, and each gives control of its own."""

    @property
    def knows_ground(self) -> bool:
        """Whether a DEM or surveyed points tell the height of the ground."""
        return bool(self.dem) or self.level_m is not None

    @property
    def shifted(self) -> ShiftedReference:
        """What all its points may be off together, where surveyed points tell."""
        own_m = self.ortho_sigma_m
        heights_m = self.dem_sigma_m if self.dem else 0.0
        return ShiftedReference(REFERENCE, (own_m, own_m, heights_m))

    @property
    def each_alone(self) -> "tuple[tuple[ReferenceLayer, ReferenceFiles], ...]":
        """Every ortho of `layers` by itself, over its own heights where it has them.

        Roads stay with the one that defines the datum: they are of today, and would be found twice.
        """
        return tuple(
            (one, replace(self, roads_drawn=one.datum, layers=(one, *self._heights_but(one))))
            for one in self.layers
            if one.ortho
        )

    def _heights_but(self, layer: ReferenceLayer) -> "tuple[ReferenceLayer, ...]":
        return tuple(replace(one, ortho=()) for one in self.layers if one is not layer)


@dataclass(frozen=True, slots=True, eq=False)
class RoadLines:
    """Roads as one array of vertices."""

    points: ObjectPoints
    """Vertices of all lines, one line after the other, metres."""
    first: Int64[np.ndarray, "lines"]
    """Index of the first vertex of each line."""
    width_m: Float64[np.ndarray, "lines"]
    """Width of each road, metres."""
    boxes: Float64[np.ndarray, "lines 4"]
    """West, south, east, north of each line, metres."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", locked(self.points))
        object.__setattr__(self, "first", locked(self.first, np.int64))
        object.__setattr__(self, "width_m", locked(self.width_m))
        object.__setattr__(self, "boxes", locked(self.boxes))

    def within(self, bounds: Bounds) -> list[tuple[ObjectPoints, float]]:
        """Vertices and width of every line that comes near an area."""
        west, south, east, north = bounds
        near = (self.boxes[:, 0] <= east) & (self.boxes[:, 2] >= west)
        near &= (self.boxes[:, 1] <= north) & (self.boxes[:, 3] >= south)
        last = np.append(self.first[1:], len(self.points))
        return [
            (self.points[self.first[line] : last[line]], float(self.width_m[line]))
            for line in np.flatnonzero(near)
        ]


@dataclass(frozen=True, slots=True, eq=False)
class OpenLayer:
    """Ortho and heights of one time, opened."""

    name: str
    """What the report calls it."""
    ortho: Ortho | None
    """None where it has heights alone."""
    dem: Dem | None
    """None where it has an ortho alone."""
    sigmas_m: tuple[float, float]
    """Standard deviations of the ortho per axis, and of a height, metres."""

    def knows(self, plan: PlanePoints) -> Bool[np.ndarray, "n 2"]:
        """Whether its ortho shows places, easting and northing, and its DEM has their heights."""
        known = np.zeros((len(plan), 2), dtype=bool)
        if self.ortho is not None:
            known[:, 0] = self.ortho.shows(plan)
        if self.dem is not None:
            known[:, 1] = np.isfinite(self.dem.heights(plan))
        return known


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The reference a block is oriented on."""

    ortho: Ortho
    """Ortho, seamless; one that is not there where the block has none."""
    dem: Dem
    """Bare earth; level ground where the block has no DEM."""
    ortho_sigma_m: float
    """Standard deviation of the ortho per axis, metres."""
    dem_sigma_m: float
    """Standard deviation of a height, metres."""
    roads: RoadLines | None = None
    """Roads to be drawn into the photos; None where there are none."""
    layers: tuple[OpenLayer, ...] = ()
    """What ortho and heights are made up of, where that is more than one of each."""

    def layers_at(self, plan: PlanePoints) -> Int64[np.ndarray, "n 2"]:
        """Number of the layer that ortho and height of each place come from; -1 for none."""
        found = np.full((len(plan), 2), -1, dtype=np.int64)
        for number, layer in enumerate(self.layers):
            found = np.where((found < 0) & layer.knows(plan), number, found)
        return found

    @property
    def largest_m(self) -> tuple[float, float]:
        """The largest standard deviations of ortho and heights, metres."""
        all_m = [layer.sigmas_m for layer in self.layers]
        ortho, dem = np.max([(self.ortho_sigma_m, self.dem_sigma_m), *all_m], axis=0).tolist()
        return ortho, dem

    def sigmas_m(self, plan: PlanePoints) -> Float64[np.ndarray, "n 2"]:
        """Standard deviations at places, of the ortho per axis and of the height, metres."""
        usual = (self.ortho_sigma_m, self.dem_sigma_m)
        if not self.layers:
            return np.tile(usual, (len(plan), 1))
        # What no layer knows has those of the last row.
        sigmas = np.array([*(layer.sigmas_m for layer in self.layers), usual])
        return np.take_along_axis(sigmas, self.layers_at(plan), axis=0)


def open_reference(
    files: ReferenceFiles, bounds: Bounds | None = None, level_m: float = 0.0
) -> Reference:
    """Open the files of a reference; heights and roads within bounds are held in memory.

    Args:
        files: What to open.
        bounds: West, south, east, north, metres; None opens everything and reads no roads.
        level_m: Height of the ground where neither DEM nor surveyed points tell it, metres.

    Raises:
        PhotogrammetryError: A file is missing, damaged, or of another place.
    """
    if bounds is not None:
        files = replace(files, layers=layers_near(files, bounds))
    dem = open_heights(files, level_m)
    if bounds is not None:
        dem = dem.cropped(bounds)
    drawn = bounds is not None and files.roads_drawn
    roads = read_roads(files.roads, files.crs, bounds) if drawn else None
    area = bounds or files.area or NOWHERE
    orthos = [one.ortho for one in files.layers] or [files.ortho]
    laid = [open_ortho(sheets, files.crs) for sheets in orthos if sheets]
    return Reference(
        orthos_laid_over(laid) if laid else no_ortho(files.crs, area),
        dem,
        files.ortho_sigma_m,
        files.dem_sigma_m,
        None if roads is None else lines_on_ground(roads, dem),
        tuple(_opened(one, files.crs) for one in files.layers),
    )


def layers_near(files: ReferenceFiles, bounds: Bounds) -> tuple[ReferenceLayer, ...]:
    """The layers of which something lies within bounds (west, south, east, north, metres)."""
    near: list[ReferenceLayer] = []
    for one in files.layers:
        opened = _opened(one, files.crs)
        given = [part.bounds for part in (opened.ortho, opened.dem) if part is not None]
        shared = [shared_bounds(bounds, part) for part in given]
        if any(west < east and south < north for west, south, east, north in shared):
            near.append(one)
    return tuple(near)


def _opened(layer: ReferenceLayer, crs: str) -> OpenLayer:
    ortho = open_ortho(layer.ortho, crs) if layer.ortho else None
    dem = open_dem(layer.dem, crs) if layer.dem else None
    return OpenLayer(layer.name, ortho, dem, (layer.ortho_sigma_m, layer.dem_sigma_m))


def open_heights(files: ReferenceFiles, level_m: float = 0.0) -> Dem:
    """The DEM; without one, level ground at the mean height of surveyed points, or at `level_m`."""
    given = [one.dem for one in files.layers if one.dem] or [files.dem]
    if any(given):
        return dems_laid_over([open_dem(dem, files.crs) for dem in given])
    return level_ground(level_m if files.level_m is None else files.level_m, files.crs)


def level_of(block: Block) -> float:
    """Mean height of the ground under a block's photos, metres; nought without photos."""
    heights = [photo.ground_height_m for photo in block.photos.values()]
    return float(np.mean(heights)) if heights else 0.0


def lines_on_ground(roads: Roads, dem: Dem) -> RoadLines:
    """The roads that can be seen from above, laid on the terrain.

    Args:
        roads: Centre lines; tunnels are left out.
        dem: Terrain; where it is unknown a line takes the height it had before.
    """
    seen = np.asarray(roads.level >= 0)
    lines = shapely.segmentize(roads.lines[seen], STEP_M) if seen.any() else roads.lines[seen]
    plan, owner = shapely.get_coordinates(lines, return_index=True)
    first = np.searchsorted(owner, np.arange(len(lines)))
    heights = dem.heights(plan) if len(plan) else np.zeros(0)
    known = np.isfinite(heights)
    if known.any():
        last_known = np.maximum.accumulate(np.where(known, np.arange(len(heights)), -1))
        heights = heights[np.where(last_known < 0, int(np.argmax(known)), last_known)]
    width = np.where(np.isfinite(roads.width_m[seen]), roads.width_m[seen], USUAL_WIDTH_M)
    return RoadLines(
        np.column_stack([plan, np.nan_to_num(heights)]),
        first.astype(np.int64),
        np.clip(width, *WIDTHS_M),
        np.asarray(shapely.bounds(lines), dtype=np.float64).reshape(-1, 4),
    )
