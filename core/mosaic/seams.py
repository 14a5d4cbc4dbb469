"""Seams: every place of the mosaic is shown by the photo that looks down on it most steeply.

The nearest nadir among the photos that show a place (METHODS 8), as polygons in the block's CRS.
They are exact partitions: straight bisectors between nadirs, cut by what each photo shows.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyogrio.raw
import rasterio.features
import shapely
from affine import Affine
from shapely import STRtree
from shapely.geometry import MultiPolygon, Polygon, shape
from shapely.geometry.base import BaseGeometry

from core.arrays import Mask
from core.formats.vectors import write_polygons
from core.mosaic.overview import Overview
from core.raster.grid import Grid

Area = Polygon | MultiPolygon
# design: rounding of metres
SAME_NADIR_M = 1e-6
# design: clear of the rim, where the mask is known to a cell of some metres
KEEP_INSIDE_M = 10.0
"""A seam keeps this distance from the edge of a photo's picture where another photo shows the
place as well, metres: room to feather."""
# design: eight by eight cells; smaller ones are marks and scratches
SMALLEST_HOLE_CELLS = 64.0
"""Holes in a photo smaller than this are left to the composition, cells."""


@dataclass(frozen=True, slots=True, eq=False)
class PhotoArea:
    """What one photo shows of the ground."""

    photo_id: str
    """The photo."""
    nadir: tuple[float, float]
    """Easting and northing straight below the perspective centre, metres."""
    shown: Area
    """Where it shows anything, generously."""
    inner: Area
    """Where it shows everything, away from its edge."""


@dataclass(frozen=True, slots=True, eq=False)
class Seam:
    """The part of the mosaic that one photo shows."""

    photo_id: str
    """The photo."""
    date: str
    """When it was taken, as far as known; empty otherwise."""
    area: Area
    """Its part, in the block's CRS."""


def area_of(overview: Overview, keep_inside_m: float = KEEP_INSIDE_M) -> PhotoArea:
    """Outlines of what an ortho shows, from its overview; steps of cells are straightened."""
    cell = overview.grid.ground_sample_distance_m
    shown = _outline(overview.touched, overview.grid)
    full = _outline(overview.full, overview.grid)
    return PhotoArea(
        overview.photo_id,
        overview.nadir,
        _only_polygons(shown.buffer(cell / 2, join_style="mitre").simplify(cell)),
        _only_polygons(full.simplify(cell).buffer(-keep_inside_m, join_style="mitre")),
    )


def draw_seams(
    areas: Sequence[PhotoArea],
    dates: Mapping[str, str] | None = None,
    keep_inside_m: float = KEEP_INSIDE_M,
) -> tuple[Seam, ...]:
    """Divide what the photos show among them by nearest nadir; nothing shown is left out.

    Args:
        areas: What each photo shows.
        dates: Date of each photo.
        keep_inside_m: Distance of seams from the edge of a picture where others show it too.

    Returns:
        One seam per photo that shows anything, in the order given; they do not overlap.
    """
    nadirs = [area.nadir for area in areas]
    shown = [area.shown for area in areas]
    parts = [_divide([area.inner for area in areas], nadirs)]
    # Slivers along the edge of a neighbour and the rim go to the part they border, so that seams
    # run straight on to the edge.
    parts[0] = [_without_slivers(part, keep_inside_m) for part in parts[0]]
    reach = 3 * keep_inside_m
    grown = [part.buffer(reach, join_style="mitre") for part in parts[0]]
    for wanted in ([a.intersection(b) for a, b in zip(grown, shown, strict=True)], shown):
        taken = shapely.union_all([area for share in parts for area in share])
        parts.append(_divide([area.difference(taken) for area in wanted], nadirs))
    dates = dates or {}
    merged = (shapely.union_all(list(shares)) for shares in zip(*parts, strict=True))
    seams = (
        Seam(area.photo_id, dates.get(area.photo_id, ""), _only_polygons(part))
        for area, part in zip(areas, merged, strict=True)
    )
    return tuple(seam for seam in seams if not seam.area.is_empty)


def write_seams(seams: Iterable[Seam], path: Path, crs: str) -> None:
    """Write `seams.gpkg` (scan, date, polygon) as CONTRACT 4 promises.

    Raises:
        OSError: The disk is full.
    """
    seams = tuple(seams)
    areas = [MultiPolygon(shapely.get_parts(seam.area).tolist()) for seam in seams]
    fields = {
        "scan": np.array([seam.photo_id for seam in seams], dtype=object),
        "date": np.array([seam.date for seam in seams], dtype=object),
    }
    write_polygons(path, "seams", areas, fields, crs=crs)


def read_seams(path: Path) -> tuple[Seam, ...]:
    """Seams that were written, or edited since in a GIS."""
    meta, _, geometry, fields = pyogrio.raw.read(path, columns=["scan", "date"])
    named = dict(zip(meta["fields"].tolist(), fields, strict=True))
    return tuple(
        Seam(str(scan), str(date or ""), _only_polygons(shapely.from_wkb(wkb)))
        for scan, date, wkb in zip(named["scan"], named["date"], geometry, strict=True)
    )


def _outline(mask: Mask, grid: Grid) -> Area:
    """Outline of the true cells of a mask, without its small holes."""
    transform = Affine.from_gdal(*grid.geotransform)
    outlines = rasterio.features.shapes(mask.astype(np.uint8), mask=mask, transform=transform)
    least = SMALLEST_HOLE_CELLS * grid.ground_sample_distance_m**2
    parts: list[Polygon] = []
    for outline, _ in outlines:
        polygon = shape(outline)
        assert isinstance(polygon, Polygon)
        holes = [ring for ring in polygon.interiors if Polygon(ring).area >= least]
        parts.append(Polygon(polygon.exterior, holes))
    return _only_polygons(shapely.union_all(parts))


def _divide(areas: Sequence[BaseGeometry], nadirs: Sequence[tuple[float, float]]) -> list[Area]:
    """Give every place to the nearest nadir among the areas that hold it."""
    tree = STRtree(areas)
    shares: list[Area] = []
    for index, area in enumerate(areas):
        others = [int(j) for j in tree.query(area) if int(j) != index]
        lost = [_nearer_part(areas[j], nadirs[j], area, nadirs[index], j < index) for j in others]
        shares.append(_only_polygons(area.difference(shapely.union_all(lost))))
    return shares


def _without_slivers(area: Area, width: float) -> Area:
    """An area without what is narrower than twice a width."""
    wide = area.buffer(-width, join_style="mitre").buffer(width, join_style="mitre")
    return _only_polygons(wide.intersection(area))


def _nearer_part(
    other: BaseGeometry,
    its_nadir: tuple[float, float],
    area: BaseGeometry,
    nadir: tuple[float, float],
    wins_tie: bool,
) -> BaseGeometry:
    """The part of another area that is nearer to its own nadir than to this one."""
    here, there = np.array(nadir), np.array(its_nadir)
    distance = float(np.linalg.norm(there - here))
    if distance < SAME_NADIR_M:
        return other if wins_tie else Polygon()
    along = (there - here) / distance
    across = np.array([-along[1], along[0]])
    bounds = np.array([area.bounds, other.bounds])
    far = 2 * float(np.ptp(bounds[:, [0, 2]]) + np.ptp(bounds[:, [1, 3]])) + distance
    middle = (here + there) / 2
    # Round the middle onto the areas: the half-plane must reach past both, wherever the nadirs are.
    far += float(np.abs(bounds[:, :2] - middle).max())
    corners = [middle - far * across, middle + far * across]
    corners += [corners[1] + far * along, corners[0] + far * along]
    return other.intersection(Polygon(np.array(corners)))


def _only_polygons(geometry: BaseGeometry) -> Area:
    """Only the areas of a geometry: differences leave lines and points behind."""
    parts = [part for part in shapely.get_parts(geometry) if isinstance(part, Polygon)]
    nested = [part for part in shapely.get_parts(geometry) if isinstance(part, MultiPolygon)]
    parts += [part for group in nested for part in group.geoms]
    parts = [part for part in parts if part.area > 0]
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)
