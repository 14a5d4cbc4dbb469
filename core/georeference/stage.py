"""Stage georeference: a rough exterior orientation of each photo from the archive.

A reference that covers too little of the block is reported here.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from core.block import Block, Photo, footprint
from core.doubts import Doubt
from core.errors import OrientationError, PhotogrammetryError, ReferenceDataError
from core.formats.eo_list import read_eo_list
from core.geometry.camera import Camera
from core.geometry.crs import Bounds, distance_m, shared_bounds
from core.geometry.map_in_space import check_scale
from core.georeference.approximation import Approximation
from core.georeference.archive import (
    Archive,
    Georeference,
    georeference_photo,
    mean_height_under,
    open_archive,
)
from core.georeference.principal_distance import by_flying_heights
from core.matching.reference import Reference, ReferenceFiles, open_reference
from core.progress import Work
from core.raster.dem import LARGEST_GAP_PX, Dem
from core.raster.grid import Grid
from core.raster.holes import Hole, find_height_holes, find_noughts
from core.raster.ortho import LEAST_COVERAGE, Ortho
from core.raster.sheets import block_outline
from core.said import say
from core.scans.interior_orientation import ScanOrientation
from core.scans.stage import ScanSet

# design: as far as that, tie points may still join it to photos that lie inside.
FAR_FOOTPRINTS = 2.0
"""A photo may lie so many of its own footprints outside the reference."""
# design: a fifth of the photos can be oriented; less is another place, or a wrong CRS.
LEAST_SHARE = 0.2
"""With less of the block covered than this, nothing useful can be made."""
# design: rims of sheets and lakes of nodata take a percent or two of any reference.
FULL_SHARE = 0.98
"""Below this share the operator is told what is missing."""
# design: half a percent across and down, ten times finer than FULL_SHARE asks for.
SAMPLES = 200
"""The block is looked at in at most this many pixels across and down."""
# design: more than anybody looks up one by one; areas and places of the largest.
HOLES_TOLD = 20
"""So many holes of the DEM are kept with the doubt, the largest first."""
NO_ORTHO = (
    "The block has no reference ortho: no control is proposed, and nothing is compared with today. "
    "Measure your own surveyed points at the desk; until then the block lies where its exterior "
    "orientations put it."
)
"""What a block without an ortho does without."""
LEVEL_GROUND = (
    "The block has no DEM: the ground is taken as level ({why}). Orthos and mosaic are off by the "
    "relief times the distance from the nadir over the flying height."
)
"""What a block without a DEM does without."""


@dataclass(frozen=True, slots=True, eq=False)
class Georeferenced:
    """Photos with approximate orientations."""

    block: Block
    """The photos; nothing is measured yet."""
    approximations: Mapping[str, Approximation]
    """By photo, with every hypothesis."""
    set_aside: Mapping[str, str]
    """Reason by photo, for those nothing is known of."""
    doubts: tuple[Doubt, ...]
    """What is doubtful about the sources and the reference's coverage."""


def georeference_photos(
    scans: ScanSet,
    scan_cameras: Mapping[str, str],
    given_cameras: Mapping[str, Camera],
    source: Georeference,
    *,
    files: ReferenceFiles,
    work: Work,
) -> Georeferenced:
    """Approximate exterior orientation of every photo.

    A photo whose own sources are missing or cannot be used is set aside; the rest goes on.

    Args:
        scans: The scans with their interior orientation.
        scan_cameras: Name of the camera by photo.
        given_cameras: Cameras by name, as the block describes them.
        source: Where the photos are placed by.
        files: The reference.
        work: Progress.

    Raises:
        PhotogrammetryError: No usable source, the reference misses the block, or an unfit CRS.
    """
    level = 0.0 if files.knows_ground else presumed_level(source, given_cameras, scan_cameras)
    reference = open_reference(files, level_m=level)
    area = reference.ortho.bounds if files.ortho else files.area
    archive = open_archive(source, files.crs, scans.oriented, area)
    cameras = dict(scans.cameras or given_cameras)
    if files.knows_ground:
        cameras = by_flying_heights(cameras, scan_cameras, scans.oriented, archive, reference.dem)
    placed: dict[str, Approximation] = {}
    failed: dict[str, PhotogrammetryError] = {}
    for done, (name, scan) in enumerate(scans.oriented.items()):
        work.progress.report(done, len(scans.oriented), name)
        result = approximate_scan(scan, cameras[scan_cameras[name]], archive, reference.dem)
        if isinstance(result, PhotogrammetryError):
            failed[name] = result
        else:
            placed[name] = result
    if not placed:
        raise next(iter(failed.values()))
    photos = {
        name: approximate_photo(scans.oriented[name], scan_cameras[name], result, reference)
        for name, result in sorted(placed.items())
    }
    photos = {n: replace(photo, corrections=source.corrections) for n, photo in photos.items()}
    block = Block(files.crs, cameras, photos)
    lost = far_from_reference(block, reference) if files.ortho else {}
    set_aside = {name: error.told for name, error in failed.items()} | lost
    block = block.with_photos({n: photo for n, photo in photos.items() if n not in lost})
    coverage = without_ortho(files, level)
    if files.ortho:
        coverage = check_coverage(reference.dem, reference.ortho, block.bounds)
    doubts = [*check_scale(files.crs, block.bounds), *archive.doubts, *coverage]
    doubts += [doubt for result in placed.values() for doubt in result.doubts]
    doubts += [Doubt("scan-set-aside", name, why) for name, why in set_aside.items()]
    doubts += check_dem_holes(reference.dem, block) if files.dem else ()
    doubts += [*reference.ortho.notes, *reference.dem.notes]
    return Georeferenced(block, placed, set_aside, tuple(doubts))


def presumed_level(
    source: Georeference, cameras: Mapping[str, Camera], scan_cameras: Mapping[str, str]
) -> float:
    """Height of the ground where neither DEM nor surveyed points tell it, metres.

    It lies below the perspective centres by the scale of the photos, where that is given; nought
    otherwise, until tie points tell.

    Raises:
        ProjectError: The list of exterior orientations cannot be used.
    """
    if source.exterior is None or source.scale_number is None:
        return 0.0
    centres = [record.centre[2] for record in read_eo_list(source.exterior).values()]
    distances = [cameras[name].principal_distance_mm / 1000 for name in scan_cameras.values()]
    return float(np.median(centres) - source.scale_number * np.median(distances))


def without_ortho(files: ReferenceFiles, level_m: float) -> tuple[Doubt, ...]:
    """What a block does without that has no ortho, and perhaps no DEM."""
    told = [Doubt("no-ortho", "block", NO_ORTHO)]
    if not files.dem:
        if files.level_m is not None:
            why = say("the mean of the surveyed points, {level:.1f} m", level=files.level_m)
        elif level_m:
            why = say("by the scale of the photos, {level:.0f} m at first", level=level_m)
        else:
            why = say("the mean of the tie points")
        told.append(Doubt("no-dem", "block", say(LEVEL_GROUND, why=why)))
    return tuple(told)


def approximate_scan(
    scan: ScanOrientation, camera: Camera, archive: Archive, dem: Dem
) -> Approximation | PhotogrammetryError:
    """Where a photo roughly is, or why nobody can say: that concerns this one scan alone."""
    try:
        placed = georeference_photo(scan, camera, archive, dem)
    except PhotogrammetryError as error:
        return error
    if isinstance(placed, Approximation):
        return placed
    remedy = (
        "Give a world file, a footprint, QGIS .points or an EO list under [scans], or the scale of "
        "the photos (scale_number = 15000), to have them sought all over the reference ortho."
    )
    return OrientationError(scan.scan.path, placed.reason, remedy)


def approximate_photo(
    scan: ScanOrientation, camera: str, placed: Approximation, reference: Reference
) -> Photo:
    """A photo at its approximate orientation, with the mean height of the ground under it."""
    east, north = (float(value) for value in placed.exterior.centre[:2])
    height = mean_height_under(reference.dem, east, north)
    return Photo(
        scan.photo_id,
        scan.scan.path,
        scan.size_px,
        camera,
        scan.interior,
        placed.exterior,
        placed.exterior,
        placed.prior,
        height,
    )


def far_from_reference(block: Block, reference: Reference) -> dict[str, str]:
    """Photos that lie far outside ortho or DEM, where others do not, with the reason."""
    far: dict[str, str] = {}
    for name, photo in block.photos.items():
        west, south, east, north = footprint(photo, block.camera_of(name)).bounds
        room = FAR_FOOTPRINTS * max(east - west, north - south)
        for what, area in (("ortho", reference.ortho.bounds), ("DEM", reference.dem.bounds)):
            apart = distance_m((west, south, east, north), area)
            if apart > room:
                far[name] = (
                    f"{photo.scan}: By its georeference it lies {apart / 1000:.1f} km outside the "
                    f"{what}. Correct its world file, points, footprint or row in the EO list."
                )
    return far if len(far) < len(block.photos) else {}


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
        _judge_share("DEM", first[0], float(height.mean()), dem.bounds, bounds),
        _judge_share("ortho", first[1], float(picture.mean()), ortho.bounds, bounds),
    )
    return tuple(doubt for doubt in doubts if doubt is not None)


def check_dem_holes(dem: Dem, block: Block) -> tuple[Doubt, ...]:
    """Doubts about ground under the photos of which the DEM has no height, or says nought instead.

    Args:
        dem: Terrain.
        block: Photos where the archive puts them.
    """
    outlines = [footprint(photo, block.camera_of(name)) for name, photo in block.photos.items()]
    ground = shapely.union_all([outline.buffer(0) for outline in outlines])
    doubts: list[Doubt] = []
    if holes := find_height_holes(dem, ground):
        file, told, evidence = _told(dem, holes)
        message = say(
            "{name} has no heights in {count:# place|# places} under the photos, {area:,.0f} m² "
            "together; the largest, {largest:,.0f} m², is about E {east:.0f} N {north:.0f}. "
            "Nothing is put there: orthos and mosaic stay empty, and no control is taken. Add a "
            "DEM that has heights there to [reference] dem, a coarser one too: it fills what the "
            "finer leaves open. Gaps of at most {closed} cells are closed from their rim.",
            closed=LARGEST_GAP_PX,
            **told,
        )
        doubts.append(Doubt("dem-holes", file, message, evidence=evidence))
    if noughts := find_noughts(dem, ground):
        file, told, evidence = _told(dem, noughts)
        message = say(
            "{name} says 0 m between steep walls in {count:# place|# places} under the photos, "
            "{area:,.0f} m² together; the largest, {largest:,.0f} m², is about E {east:.0f} "
            "N {north:.0f}. That looks like heights that are not known: orthos will be displaced "
            "there. Declare it: gdal_edit.py -a_nodata 0 FILE.",
            **told,
        )
        doubts.append(Doubt("dem-noughts", file, message, evidence=evidence))
    return tuple(doubts)


def _told(dem: Dem, holes: Sequence[Hole]) -> tuple[str, dict[str, Any], dict[str, Any]]:
    """The file of the largest of some holes, what a sentence says of all, and where they lie."""
    largest = holes[0]
    file = _file_at(dem, largest.east, largest.north)
    told = {
        "name": Path(file).name,
        "count": len(holes),
        "area": sum(hole.area_m2 for hole in holes),
        "largest": largest.area_m2,
        "east": largest.east,
        "north": largest.north,
    }
    places = [(hole.east, hole.north, hole.area_m2) for hole in holes[:HOLES_TOLD]]
    return file, told, {"holes": places}


def _file_at(dem: Dem, east: float, north: float) -> str:
    """The finest file whose outline holds a place; the finest of all where none does."""
    sheets = dem.sheets.sheets
    place = shapely.Point(east, north)
    here = (s for s in sheets if shapely.Polygon(block_outline(s)).contains(place))
    return next(here, sheets[0]).path


def _sampling(bounds: Bounds, finest_m: float) -> Grid:
    """A coarse grid over the block."""
    west, south, east, north = bounds
    gsd = max(finest_m, (east - west) / SAMPLES, (north - south) / SAMPLES)
    columns, rows = max(1, int((east - west) / gsd)), max(1, int((north - south) / gsd))
    return Grid(west, north, gsd, columns, rows)


def _judge_share(what: str, file: str, share: float, own: Bounds, block: Bounds) -> Doubt | None:
    """An error, a doubt, or nothing."""
    if share >= FULL_SHARE:
        return None
    cause = say(
        "the {what} covers {share:.0f} % of the block: it lies at {own}, the block at {block}.",
        what=what,
        share=100 * share,
        own=_words(own),
        block=_words(block),
    )
    if share < LEAST_SHARE:
        if _overlap(own, block) > LEAST_SHARE:
            cause = say(
                "the {what} is nodata over {share:.0f} % of the block.",
                what=what,
                share=100 * (1 - share),
            )
        raise ReferenceDataError(
            file,
            cause,
            say(
                "Add {what} files for the rest of the block under [reference], or check the "
                "CRS and the scans' georeference.",
                what=what,
            ),
        )
    return Doubt(
        kind=f"{what.lower()}-coverage",
        subject=file,
        message=say(
            "The {what} covers {share:.0f} % of the block; there will be no control and "
            "no mosaic in the rest.",
            what=what,
            share=100 * share,
        ),
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
    west, south, east, north = bounds
    return say(
        "E {west:.0f} to {east:.0f}, N {south:.0f} to {north:.0f}",
        west=west, south=south, east=east, north=north
    )  # fmt: skip
