"""The archive's sources of georeferences: opened once, then queried photo by photo."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
import shapely

from core.doubts import Doubt, Failure
from core.errors import PhotogrammetryError
from core.formats.eo_list import EoRecord, read_eo_list
from core.formats.outlines import Footprint, Footprints, read_footprints
from core.formats.qgis_points import QgisPoints, find_qgis_points, read_scan_points
from core.formats.world_file import read_georeference
from core.geometry.camera import Camera
from core.geometry.collinearity import CORRECTIONS
from core.geometry.crs import Bounds, check_range, infer_crs, operation_between, read_crs
from core.georeference.approximation import (
    Approximation,
    Ground,
    approximate_from_eo,
    approximate_from_footprint,
    approximate_from_points,
    approximate_from_world_file,
    approximate_in_area,
    flight_directions,
    world_file_centre,
    world_in_block,
)
from core.raster.dem import Dem
from core.said import say
from core.scans.interior_orientation import ScanOrientation

Pairs = tuple[tuple[float, float, float, float], ...]
"""The same places clicked in a scan and on the map: column, row, easting, northing."""
GeoreferenceKind = Literal["world-file", "points", "footprints", "none"]
NAMED = {"world-file": "world file", "points": ".points file", "footprints": "footprint"}
"""The sources in the words of a sentence."""
NOWHERE = (
    "Nothing says where {photo_id} was taken: no world file or points beside it, no row in the EO "
    "list, no footprint."
)
NO_SOURCE = (
    "Nothing says where {photo_id} was taken: no points beside it, no row in the EO list. World "
    'files and footprints are not read, because [scans] georeference is "none".'
)
"""Why a photo cannot be placed, the second where block.toml wants no source to be read."""
# design: about the ground of one photo 1 : 15 000; only a mean height is taken from it.
UNDER_M = 1500.0
"""The ground under a photo is what lies within this of its perspective centre, metres."""


@dataclass(frozen=True, slots=True)
class Georeference:
    """What the photos of a block are placed by at first: keys of [scans] in `block.toml`."""

    source: GeoreferenceKind = "world-file"
    """What to begin from; `exterior`, where a scan is in it, comes before."""
    footprints: Path | None = None
    """Vector file of footprints."""
    footprint_name: str = "LMS_TIF_UP"
    """Its attribute with the scan's file name."""
    exterior: Path | None = None
    """EO list."""
    scale_number: float | None = None
    """Scale of photos that no source places: they are sought all over the reference ortho."""
    flying_height_m: float | None = None
    """Height of the perspective centres above sea, where a principal distance is to be told by
    it, metres."""
    corrections: tuple[str, ...] = CORRECTIONS
    """What the rays of the photos are corrected for."""
    clicked: Mapping[str, Pairs] = field(default_factory=dict[str, Pairs])
    """By photo, in the block's CRS: what an operator clicked at the desk goes before all else."""


@dataclass(frozen=True, slots=True, eq=False)
class Archive:
    """The block-wide sources, read."""

    georeference: Georeference
    """Where they come from."""
    crs: str
    """CRS of the block."""
    footprints: Mapping[str, Footprint]
    """By photo, in the block's CRS."""
    exterior: Mapping[str, EoRecord]
    """Rows of the EO list by photo."""
    directions: Mapping[str, float]
    """Directions of flight by photo, radians from grid east, where positions give them."""
    area: Bounds | None
    """West, south, east, north of the reference ortho, else of the surveyed points, metres."""
    doubts: tuple[Doubt, ...] = ()
    """Sources that say nothing of any photo of the block."""


def open_archive(
    georeference: Georeference, crs: str, photo_ids: Collection[str], area: Bounds | None
) -> Archive:
    """Read the EO list and the footprints of a block that lies in an area.

    Raises:
        ProjectError: One of the files is missing, unreadable, or lacks a column or attribute.
        CrsError: The footprints name no CRS and do not give it away, or one they cannot be in.
    """
    doubts: list[Doubt] = []
    footprints: Mapping[str, Footprint] = {}
    if georeference.footprints is not None:
        read = read_footprints(georeference.footprints, georeference.footprint_name, photo_ids)
        footprints = footprints_in_block(read, crs)
        if not footprints:
            doubts.append(_names_none(georeference.footprints, "footprints", photo_ids))
    records: dict[str, EoRecord] = {}
    if georeference.exterior is not None:
        listed = {
            name.lower(): record for name, record in read_eo_list(georeference.exterior).items()
        }
        records = {name: listed[name.lower()] for name in photo_ids if name.lower() in listed}
        if not records:
            doubts.append(_names_none(georeference.exterior, "rows", photo_ids))
    centres = {name: np.array(record.centre) for name, record in records.items()}
    directions = flight_directions(centres)
    return Archive(georeference, crs, footprints, records, directions, area, tuple(doubts))


def georeference_photo(
    oriented: ScanOrientation, camera: Camera, archive: Archive, dem: Dem
) -> Approximation | Failure:
    """Approximate exterior orientation of one photo.

    What an operator clicked at the desk comes first, then the EO list where it has the scan, then
    points that somebody clicked in this very scan in QGIS, then the source that was asked for;
    where that has nothing for it, any other that does, with a doubt, unless none is asked for; at
    last the whole area, where the scale of the photos is given. A .points file that was not asked
    for and cannot be used is passed over, with a doubt, where another source serves.

    Args:
        oriented: The scan with its interior orientation.
        camera: Its camera.
        archive: The block-wide sources.
        dem: Terrain, for the height of the ground.

    Raises:
        PhotogrammetryError: A source of this scan is there and cannot be used.
    """
    photo_id, wanted = oriented.photo_id, archive.georeference.source
    clicked = photo_id in archive.georeference.clicked
    record = archive.exterior.get(photo_id)
    if record is not None and not clicked:
        return _from_list(photo_id, record, archive, dem)
    try:
        found = _from_source("points", oriented, camera, archive, dem=dem)
    except PhotogrammetryError as error:
        other = None
        if not clicked and wanted != "points":
            other = _from_other_sources(oriented, camera, archive, dem)
        if other is None:
            raise
        return replace(other, doubts=(*other.doubts, _passed_over(photo_id, error)))
    if found is None:
        found = _from_other_sources(oriented, camera, archive, dem)
    reason = NO_SOURCE if wanted == "none" else NOWHERE
    return Failure(say(reason, photo_id=photo_id)) if found is None else found


def _from_other_sources(
    oriented: ScanOrientation, camera: Camera, archive: Archive, dem: Dem
) -> Approximation | None:
    """What says where a photo is that has no row in the list and no points."""
    wanted = archive.georeference.source
    every: tuple[GeoreferenceKind, ...] = (wanted, "world-file", "footprints")
    for kind in () if wanted == "none" else every:
        found = None if kind == "points" else _from_source(kind, oriented, camera, archive, dem=dem)
        if found is not None and kind == wanted:
            return found
        if found is not None:
            doubt = _other_source(oriented.photo_id, wanted, kind)
            return replace(found, doubts=(*found.doubts, doubt))
    scale_number, area = archive.georeference.scale_number, archive.area
    if scale_number is not None and area is not None:
        return _from_area(scale_number, area, camera, archive, dem=dem)
    return None


def footprints_in_block(footprints: Footprints, crs: str) -> Mapping[str, Footprint]:
    """Footprints in the block's CRS; a missing CRS is told by the coordinates (METHODS 10).

    Raises:
        CrsError: No CRS and none that fits, or coordinates that cannot be in theirs.
    """
    if not footprints.by_photo:
        return {}
    path, block = footprints.path, read_crs(crs, footprints.path)
    outlines = [footprint.polygon for footprint in footprints.by_photo.values()]
    vertices = shapely.get_coordinates(outlines)
    own = read_crs(footprints.crs, path) if footprints.crs else infer_crs(vertices, block, path)
    check_range(own, vertices, path)
    if own == block:
        return footprints.by_photo
    operation = operation_between(own.to_wkt(), crs, vertices, path)

    return {
        name: replace(footprint, polygon=shapely.transform(footprint.polygon, operation.forward))
        for name, footprint in footprints.by_photo.items()
    }


def _from_source(
    kind: str, oriented: ScanOrientation, camera: Camera, archive: Archive, *, dem: Dem
) -> Approximation | None:
    """What one kind of source says of a photo; None when it says nothing."""
    if kind == "world-file":
        return _from_world_file(oriented, camera, archive, dem)
    if kind == "points":
        return _from_points(oriented, camera, archive, dem)
    footprint = archive.footprints.get(oriented.photo_id) if kind == "footprints" else None
    if footprint is None:
        return None
    middle = footprint.polygon.centroid
    ground = _ground(dem, archive.crs, middle.x, middle.y)
    return approximate_from_footprint(footprint, camera, ground)


def _from_list(photo_id: str, record: EoRecord, archive: Archive, dem: Dem) -> Approximation:
    """The row of the EO list."""
    ground = _ground(dem, archive.crs, *record.centre[:2])
    file = archive.georeference.exterior or Path()
    direction = archive.directions.get(photo_id)
    return approximate_from_eo(record, file, ground, direction)


def _from_world_file(
    oriented: ScanOrientation, camera: Camera, archive: Archive, dem: Dem
) -> Approximation | None:
    """The world file beside the scan, or the georeference inside it."""
    world = read_georeference(oriented.scan.path)
    if world is None:
        return None
    world = world_in_block(world, oriented.scan.size_px, archive.crs)
    ground = _ground(dem, archive.crs, *world_file_centre(world, oriented.interior, camera))
    return approximate_from_world_file(world, oriented.interior, camera, ground)


def _from_points(
    oriented: ScanOrientation, camera: Camera, archive: Archive, dem: Dem
) -> Approximation | None:
    """What was clicked at the desk, else the .points file beside the scan."""
    pairs = archive.georeference.clicked.get(oriented.photo_id)
    scan = oriented.scan.path
    path = scan if pairs else find_qgis_points(scan)
    if path is None:
        return None
    points = (
        clicked_points(path, archive.crs, pairs)
        if pairs
        else read_scan_points(path, scan, oriented.size_px)
    )
    if not points.enabled.any():
        # All switched off: as good as no file.
        return None
    # The points' own middle is near enough to look up the ground; it may be in another CRS.
    first = approximate_from_points(points, oriented.interior, camera, Ground(archive.crs, 0.0))
    ground = _ground(dem, archive.crs, *first.exterior.centre[:2].tolist())
    return approximate_from_points(points, oriented.interior, camera, ground)


def clicked_points(scan: Path, crs: str, pairs: Pairs) -> QgisPoints:
    """Pairs clicked at the desk in the form of those clicked in QGIS."""
    values = np.array(pairs, dtype=np.float64).reshape(-1, 4)
    enabled = np.ones(len(values), dtype=np.bool_)
    return QgisPoints(scan, crs, values[:, 2:], values[:, :2], enabled)


def _from_area(
    scale_number: float, area: Bounds, camera: Camera, archive: Archive, *, dem: Dem
) -> Approximation:
    """Somewhere on the reference ortho, or among the surveyed points."""
    west, south, east, north = area
    ground = _ground(dem, archive.crs, (west + east) / 2, (south + north) / 2)
    return approximate_in_area(area, scale_number, camera, ground)


def _ground(dem: Dem, crs: str, east: float, north: float) -> Ground:
    """The ground about a place."""
    height = mean_height_under(dem, east, north)
    bounds = dem.bounds if np.isfinite(dem.bounds).all() else None
    return Ground(crs, height if np.isfinite(height) else 0.0, bounds)


def mean_height_under(dem: Dem, east: float, north: float) -> float:
    """Mean height about a place; of all the DEM where it has none there, NaN where it is empty."""
    height = dem.mean_height((east - UNDER_M, north - UNDER_M, east + UNDER_M, north + UNDER_M))
    return float(height if np.isfinite(height) else dem.mean_height())


def _other_source(photo_id: str, wanted: str, used: str) -> Doubt:
    """The doubt of a photo that had to be placed by something else."""
    return Doubt(
        "georeference-missing",
        photo_id,
        say(
            "There is no {wanted} for this scan; it was placed by its {used} instead.",
            wanted=NAMED[wanted],
            used=NAMED[used],
        ),
        evidence={"wanted": wanted, "used": used},
    )


def _passed_over(photo_id: str, error: PhotogrammetryError) -> Doubt:
    """The doubt of a photo whose .points file cannot be used and was not needed."""
    message = say("{why} The scan was placed by another source.", why=error.told)
    return Doubt("georeference-unused", photo_id, message, evidence={"file": error.file})


def _names_none(file: Path, what: str, photo_ids: Collection[str]) -> Doubt:
    """The doubt of a source in which no scan of the block is found by its name."""
    example = next(iter(sorted(photo_ids)), "")
    return Doubt(
        "georeference-unused",
        str(file),
        say(
            "The {what} in {name} name no scan of this block and were not used. The "
            "names must be those of the scan files, such as {example}.",
            what=what,
            name=file.name,
            example=example,
        ),
        evidence={"scans": len(photo_ids)},
    )
