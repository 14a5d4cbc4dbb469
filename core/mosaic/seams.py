"""Seams: which photo shows which part of the mosaic, as polygons in the block's CRS.

They divide exactly what the photos show: neighbours share the vertices of their border. Seams that
somebody edited in a GIS are read, checked, and mended where what is meant is plain.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pyogrio
import pyogrio.raw
import rasterio.features
import shapely
from shapely.geometry import MultiPolygon, Polygon, shape
from shapely.geometry.base import BaseGeometry

from core.errors import ReferenceDataError
from core.formats.records import status_of
from core.formats.vectors import GDAL_ERRORS, VectorLayer, no_remarks, read_layers, write_polygons
from core.geometry.crs import parse_crs, same_coordinates
from core.mosaic.seam_cut import LabelledGround, Labels
from core.raster.grid import RASTERIZING
from core.said import say

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


# design: less than a pixel of most mosaics; vertices drawn by hand never meet exactly
LEAST_TOLD_M2 = 1.0
"""Overlaps and gaps smaller than this are mended without a word, square metres."""
FORGET = "To have seams drawn again, delete or rename the file."


@dataclass(frozen=True, slots=True, eq=False)
class EditedSeams:
    """Seams as they were edited, without overlaps, and what was mended."""

    seams: tuple[Seam, ...]
    """The seams, in the order of the file."""
    notes: tuple[str, ...]
    """A sentence for each kind of thing that was mended."""


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


def read_edited(path: Path, crs: str, photo_ids: Sequence[str]) -> EditedSeams:
    """Read seams that somebody edited.

    Polygons of unknown scans are left out, invalid ones made valid, those in another CRS
    transformed. Where two overlap, the later one in the file holds.

    Args:
        path: The file, with a layer `seams` or a single layer, and an attribute `scan`.
        crs: The block's CRS.
        photo_ids: Photos that have an ortho.

    Raises:
        ReferenceDataError: Nothing in it can be used.
    """
    layer, notes = _layer(path, crs)
    dates = layer.columns.get("date", np.full(len(layer.geometries), ""))
    rows: list[tuple[str, str, Area]] = []
    unknown: set[str] = set()
    mended = 0
    for scan, date, drawn in zip(layer.columns["scan"], dates, layer.geometries, strict=True):
        mended += not drawn.is_valid
        area = only_polygons(shapely.make_valid(drawn))
        if str(scan) not in photo_ids:
            unknown.add(str(scan))
        elif not area.is_empty:
            rows.append((str(scan), str(date or ""), area))
    if not rows:
        raise ReferenceDataError(path, "no polygon of it belongs to a photo of the block.", FORGET)
    if unknown:
        names = ", ".join(sorted(unknown))
        notes.append(
            say("Edited seams of scans without an ortho were left out: {names}.", names=names)
        )
    if mended:
        notes.append(
            say("{count:# edited seam was|# edited seams were} not valid and mended.", count=mended)
        )
    seams, doubled = _apart(rows)
    if doubled > LEAST_TOLD_M2:
        notes.append(
            say(
                "Edited seams overlapped over {area:.0f} m²; the later one in the file holds.",
                area=doubled,
            )
        )
    return EditedSeams(seams, tuple(notes))


def fill_gaps(
    edited: EditedSeams, drawn: Sequence[Seam], shown: Mapping[str, Area] | None = None
) -> EditedSeams:
    """Edited seams, with what they leave open given to the photo that usual seams give it to.

    So is what they give to a photo that does not show it.

    Args:
        edited: Seams that do not overlap.
        drawn: Seams over all that the photos show.
        shown: The ground that each photo shows; one that is not there shows all it is given.
    """
    claimed = shapely.union_all([seam.area for seam in edited.seams])
    edited = _only_shown(edited, drawn, shown or {})
    taken = shapely.union_all([seam.area for seam in edited.seams])
    parts = {seam.photo_id: seam for seam in edited.seams}
    gaps: list[Polygon] = []
    for seam in drawn:
        left = only_polygons(seam.area.difference(taken))
        if left.is_empty:
            continue
        gaps.extend(shapely.get_parts(only_polygons(left.difference(claimed))))
        own = parts.get(seam.photo_id)
        whole = left if own is None else only_polygons(own.area.union(left))
        date = seam.date if own is None else own.date
        parts[seam.photo_id] = Seam(seam.photo_id, date, whole)
    notes = edited.notes
    area = sum(part.area for part in gaps)
    if area > LEAST_TOLD_M2:
        largest = max(gaps, key=lambda part: part.area)
        place = largest.representative_point()
        told = say(
            "Edited seams left {area:.0f} m² open, the largest part about E {east:.0f} "
            "N {north:.0f}; the photo with the nearest nadir shows it.",
            area=area,
            east=place.x,
            north=place.y,
        )
        notes = (*notes, told)
    return EditedSeams(tuple(parts.values()), notes)


def _unseen(seam: Seam, drawn: Sequence[Seam], shown: Mapping[str, Area]) -> Area:
    """Ground that a seam gives to its photo though only other photos show it."""
    ground = shown.get(seam.photo_id, seam.area)
    beyond = seam.area.difference(ground)
    return only_polygons(beyond.intersection(shapely.union_all([one.area for one in drawn])))


def _only_shown(
    edited: EditedSeams, drawn: Sequence[Seam], shown: Mapping[str, Area]
) -> EditedSeams:
    """Edited seams without what their photos do not show; told where other photos show it."""
    kept: list[Seam] = []
    notes = edited.notes
    for seam in edited.seams:
        ground = shown.get(seam.photo_id)
        if ground is None or ground.covers(seam.area):
            kept.append(seam)
            continue
        area = only_polygons(seam.area.intersection(ground))
        if not area.is_empty:
            kept.append(Seam(seam.photo_id, seam.date, area))
        wrong = _unseen(seam, drawn, shown)
        if wrong.area > LEAST_TOLD_M2:
            place = max(shapely.get_parts(wrong), key=lambda part: part.area).representative_point()
            told = say(
                "Edited seams gave {name} {area:.0f} m² that it does not show, the largest part "
                "about E {east:.0f} N {north:.0f}; a photo that shows it has it.",
                name=seam.photo_id,
                area=wrong.area,
                east=place.x,
                north=place.y,
            )
            notes = (*notes, told)
    return EditedSeams(tuple(kept), notes)


def _layer(path: Path, crs: str) -> tuple[VectorLayer, list[str]]:
    """The layer of seams in the block's CRS."""
    try:
        status_of(path)
        with no_remarks():
            names = [str(name) for name, kind in pyogrio.list_layers(path) if kind is not None]
            wanted = LAYER if LAYER in names or len(names) != 1 else names[0]
            info = pyogrio.read_info(path, wanted) if wanted in names else None
    except (*GDAL_ERRORS, OSError) as error:
        raise ReferenceDataError(
            path, "the seams cannot be read: the file is damaged.", FORGET
        ) from error
    if info is None:
        raise ReferenceDataError(path, "it has no layer `seams`.", FORGET)
    if "scan" not in list(info["fields"]):
        remedy = say("It has {names}.", names=", ".join(info["fields"]) or "none at all")
        raise ReferenceDataError(path, 'the seams have no attribute "scan".', remedy)
    layer = read_layers(f"{path}|layername={wanted}", parse_crs(crs, path))[0]
    if not len(layer.geometries):
        raise ReferenceDataError(path, "it has no polygons.", FORGET)
    notes: list[str] = []
    stated = info["crs"]
    extent = np.array(shapely.total_bounds(layer.geometries)).reshape(2, 2)
    if stated and not same_coordinates(stated, crs, extent):
        notes.append(say("Edited seams were transformed from {crs}.", crs=stated))
    return layer, notes


def _apart(rows: Sequence[tuple[str, str, Area]]) -> tuple[tuple[Seam, ...], float]:
    """One seam a photo, none over another; the area that was claimed twice."""
    doubled, taken = 0.0, shapely.Polygon()
    kept: dict[str, tuple[str, list[Area]]] = {}
    for scan, date, area in reversed(rows):
        alone = area if taken.is_empty else only_polygons(area.difference(taken))
        doubled += area.area - alone.area
        kept.setdefault(scan, (date, []))[1].append(alone)
        taken = area if taken.is_empty else taken.union(area)
    order = list(dict.fromkeys(scan for scan, _, _ in rows))
    seams = (Seam(n, kept[n][0], only_polygons(shapely.union_all(kept[n][1]))) for n in order)
    return tuple(seam for seam in seams if not seam.area.is_empty), doubled
