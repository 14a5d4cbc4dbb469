"""Seams: which photo shows which part of the mosaic, as polygons in the block's CRS.

They divide exactly what the photos show: neighbours share the vertices of their border.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pyogrio.raw
import rasterio.features
import shapely
from shapely.geometry import MultiPolygon, Polygon, shape
from shapely.geometry.base import BaseGeometry

from core.formats.vectors import write_polygons
from core.mosaic.burning import RASTERIZING
from core.mosaic.seam_cut import LabelledGround, Labels

Area = Polygon | MultiPolygon
# design: takes away the steps of cells, whose triangles are half a cell, and little more
SMOOTHING_CELLS = 1.0
"""Vertices whose triangle is smaller than the square of this are left out, cells."""
LAYER = "seams"


@dataclass(frozen=True, slots=True, eq=False)
class Seam:
    """The part of the mosaic that one photo shows."""

    photo_id: str
    """The photo."""
    date: str
    """When it was taken, as far as known; empty otherwise."""
    area: Area
    """Its part, in the block's CRS."""


def outline_seams(
    ground: LabelledGround, photo_ids: Sequence[str], dates: Mapping[str, str] | None = None
) -> tuple[Seam, ...]:
    """Polygons of what each photo shows, in the order of the photos.

    Args:
        ground: Which photo shows which cell.
        photo_ids: The photo of each number.
        dates: When photos were taken.

    Returns:
        One seam per photo that shows anything; they do not overlap and leave no gap.
    """
    numbers, areas = _coverage(_grown(ground.labels))
    grid, dates = ground.grid, dates or {}
    gsd = grid.ground_sample_distance_m

    def on_ground(cells: np.ndarray) -> np.ndarray:
        return np.array([grid.west, grid.north]) + cells * np.array([gsd, -gsd])

    seams: list[Seam] = []
    for number, area in zip(numbers, areas, strict=True):
        name = photo_ids[number]
        placed = only_polygons(shapely.transform(area, on_ground))
        if not placed.is_empty:
            seams.append(Seam(name, dates.get(name, ""), placed))
    return tuple(seams)


def _grown(labels: Labels) -> Labels:
    """Labels grown by a cell to the outside, so that smoothing cuts off nothing that is shown."""
    wide = np.pad(labels, 1, constant_values=-1)
    near = np.asarray(cv2.dilate(wide, np.ones((3, 3), np.uint8)))
    return np.where(wide < 0, near, wide)


def _coverage(labels: Labels) -> tuple[list[int], list[BaseGeometry]]:
    """Smooth outlines of the labels in cells of the ground, by number."""
    with RASTERIZING:
        found = list(rasterio.features.shapes(labels, mask=labels >= 0))
    pieces: dict[int, list[Polygon]] = {}
    for outline, number in found:
        # Each cell's corner along a border is a vertex of both neighbours.
        polygon = shapely.segmentize(shape(outline), 1.0)
        assert isinstance(polygon, Polygon)
        pieces.setdefault(int(number), []).append(polygon)
    numbers = sorted(pieces)
    whole = [MultiPolygon(pieces[number]) for number in numbers]
    noded = [shapely.transform(area, lambda xy: np.rint(xy) - 1) for area in whole]
    smooth = shapely.coverage_simplify(noded, SMOOTHING_CELLS, simplify_boundary=True)
    return numbers, list(smooth)


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
    write_polygons(path, LAYER, areas, fields, crs=crs)


def read_seams(path: Path) -> tuple[Seam, ...]:
    """Seams that were written; those edited since in a GIS `read_edited` reads with its checks."""
    # A GIS may have put its own layers beside.
    meta, _, geometry, fields = pyogrio.raw.read(path, LAYER, columns=["scan", "date"])
    named = dict(zip(meta["fields"].tolist(), fields, strict=True))
    return tuple(
        Seam(str(scan), str(date or ""), only_polygons(shapely.from_wkb(wkb)))
        for scan, date, wkb in zip(named["scan"], named["date"], geometry, strict=True)
    )


def only_polygons(geometry: BaseGeometry) -> Area:
    """Only the areas of a geometry: differences leave lines and points behind."""
    parts = [part for part in shapely.get_parts(geometry) if isinstance(part, Polygon)]
    nested = [part for part in shapely.get_parts(geometry) if isinstance(part, MultiPolygon)]
    parts += [part for group in nested for part in group.geoms]
    parts = [part for part in parts if part.area > 0]
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)
