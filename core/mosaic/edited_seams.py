"""Seams that somebody edited in a GIS: read, checked, and mended where what is meant is plain."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyogrio
import shapely
from pyogrio.errors import DataLayerError, DataSourceError

from core.errors import ReferenceDataError
from core.formats.vectors import VectorLayer, read_layers
from core.geometry.crs import parse_crs, same_coordinates
from core.mosaic.seams import LAYER, Area, Seam, only_polygons
from core.said import say

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


def fill_gaps(edited: EditedSeams, drawn: Sequence[Seam]) -> EditedSeams:
    """Edited seams, with what they leave open given to the photo that usual seams give it to.

    Args:
        edited: Seams that do not overlap.
        drawn: Seams over all that the photos show.
    """
    taken = shapely.union_all([seam.area for seam in edited.seams])
    parts = {seam.photo_id: seam for seam in edited.seams}
    gaps = 0.0
    for seam in drawn:
        left = only_polygons(seam.area.difference(taken))
        if left.is_empty:
            continue
        gaps += left.area
        own = parts.get(seam.photo_id)
        whole = left if own is None else only_polygons(own.area.union(left))
        date = seam.date if own is None else own.date
        parts[seam.photo_id] = Seam(seam.photo_id, date, whole)
    notes = edited.notes
    if gaps > LEAST_TOLD_M2:
        told = say(
            "Edited seams left {area:.0f} m² open; the photo with the nearest nadir shows them.",
            area=gaps,
        )
        notes = (*notes, told)
    return EditedSeams(tuple(parts.values()), notes)


def _layer(path: Path, crs: str) -> tuple[VectorLayer, list[str]]:
    """The layer of seams in the block's CRS."""
    try:
        names = [str(name) for name, kind in pyogrio.list_layers(path) if kind is not None]
        wanted = LAYER if LAYER in names or len(names) != 1 else names[0]
        info = pyogrio.read_info(path, wanted) if wanted in names else None
    except (DataSourceError, DataLayerError) as error:
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
