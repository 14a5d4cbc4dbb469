"""The stage `orthos` of a block on disk: one file for each photo, made where it is not fresh."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from shutil import disk_usage

import numpy as np
from shapely.geometry import box

from app.block_sections import OrthoSection
from app.project import Project
from app.surface import chosen_ground, usable_parts
from core.block import Block, Photo
from core.errors import ProjectError, ScanError, StorageError
from core.formats.vectors import read_mask_polygons
from core.geometry.areas import Area, only_areas
from core.geometry.crs import parse_crs
from core.orthos.rectification import (
    OrthoOptions,
    OrthoProduct,
    area_within,
    ortho_grid,
    rectify_photo,
)
from core.orthos.scan_places import LARGEST_SPACING, Heights
from core.progress import Part, Progress
from core.raster.dem import RIM_PX, Dem
from core.raster.grid import Grid
from core.raster.ortho import open_ortho
from core.raster.stand_in import NO_PICTURES, is_stand_in
from sessions.atomic_write import whole_file
from sessions.checks import keep_version
from sessions.session import Session

FOLDER = "ortho"
"""Of the results."""
LEAST_BYTES = 0.1  # design: smooth film, enlarged and deflated, takes more
"""A pixel of an ortho takes on the disk."""
SIGHT_VERSION = 1
"""Counted up when the same heights hide other pixels than before."""


def make_orthos(
    session: Session,
    project: Project,
    block: Block,
    dem: Dem,
    progress: Progress,
    anew: bool = False,
    only: frozenset[str] | None = None,
) -> list[OrthoProduct]:
    """Orthos of all oriented photos that reach the area asked for; fresh ones stay as they are.

    Those of other photos are removed.

    Args:
        session: Where they are kept.
        project: For pixel, area, edge and kernel.
        block: The adjusted block.
        dem: Heights.
        progress: Told per photo.
        anew: Make all of them again.
        only: Make no others than these; the rest stays as it is.

    Raises:
        PhotogrammetryError: As `pictured` and `read_polygons`; no photo reaches the area, no room.
    """
    digest_of, usable = session.products.digest_of, usable_parts(session)
    options = _options(project.ortho)
    heights, corrections = chosen_ground(session, project, dem, block.search_bounds)
    orthos, places = list[OrthoProduct](), _with_room(session, project, block, heights)
    wanted, made_now = len(places) if only is None else max(len(only), 1), 0
    for photo, grid, part in places:
        camera, stage = block.camera_of(photo.photo_id), f"ortho/{photo.photo_id}"
        ground = (*_heights_for(photo, grid, dem, project), *corrections)
        gsd, asked = grid.ground_sample_distance_m, _asked(options, part)
        inputs = digest_of(stage, 5, photo, camera, gsd, ground, photo.scan, *asked)
        target = session.results / FOLDER / f"{photo.photo_id}.tif"
        # The file itself counts as well: one that was cut, replaced or removed is made again.
        kept = None if anew else session.products.load_value(stage, digest_of(inputs, target))
        if only is not None and photo.photo_id not in only:
            kept = session.products.latest_value(stage) or kept
        new = kept is None or not target.is_file()
        if kept is None or new:
            share = Part(progress, made_now / wanted, min((made_now + 1) / wanted, 1.0))
            share.report(0, 1, photo.photo_id)
            keep_version(session.products)
            with whole_file(target) as temporary:
                kept = rectify_photo(
                    photo, camera, heights, grid, temporary, block.crs, area=part,
                    usable=usable(photo.photo_id), options=options, progress=share,
                )  # fmt: skip
            kept = replace(kept, path=target)
            session.products.save_value(f"made-with/{photo.photo_id}", inputs, (photo, camera))
            session.products.save_value(stage, digest_of(inputs, target), kept)
        made_now += new or only is None
        orthos.append(kept)
    progress.report(1, 1)
    _check_any(orthos, project)
    if only is None:
        _remove_others(session, {ortho.photo_id for ortho in orthos})
    return orthos


def _heights_for(
    photo: Photo, grid: Grid, dem: Dem, project: Project
) -> tuple[Path | Grid | float | str, ...]:
    """What names the heights under an ortho and, for visibility, those up to its nadir."""
    if not project.ortho.visibility:
        return ground_under(grid, dem, project)
    west, south, right, top = grid.bounds
    east, north = photo.exterior.centre[:2].tolist()
    bounds = (min(west, east), min(south, north), max(right, east), max(top, north))
    wide = Grid.over(bounds, grid.ground_sample_distance_m)
    return (*ground_under(wide, dem, project), "visibility", SIGHT_VERSION)


def read_area(project: Project) -> Area | None:
    """Where orthos and mosaic are made, in the block's CRS; None for everywhere."""
    file = project.ortho.area
    return None if file is None else read_polygons(file, project)


def check_area(project: Project) -> None:
    """Find out before the walk what an area would stop it by; raises as `make_orthos`."""
    area, files = read_area(project), project.reference.ortho
    if area is not None and files:
        bounds = open_ortho(files, project.block.crs).bounds
        if not area.intersects(box(*bounds)):
            raise _nowhere(project.ortho.area)


def read_polygons(file: Path, project: Project) -> Area:
    """The area of all polygons of a file, in the block's CRS.

    Raises:
        ProjectError: It holds none.
        ReferenceDataError: It cannot be read.
        CrsError: It lies in a CRS that PROJ cannot bring to the block's.
    """
    found = only_areas(read_mask_polygons(file, parse_crs(project.block.crs, project.file)))
    if found.is_empty:
        raise ProjectError(file, "holds no polygons.", "Give the area as polygons.")
    return found


def _places(
    session: Session, project: Project, block: Block, heights: Heights
) -> Iterator[tuple[Photo, Grid, Area | None]]:
    """The photos that reach the area asked for, each with its grid and what of it is shown."""
    photos, area = pictured(block), read_area(project)
    gsd = project.ortho.gsd_m or default_gsd_m(block)
    for photo in photos:
        camera = block.camera_of(photo.photo_id)
        grid = ortho_grid(photo, camera, heights, gsd)
        part = area_within(area, photo, camera, heights, grid, project.ortho.edge_mm)
        if part is None or not part.is_empty:
            yield photo, grid if part is None else grid.covering(part.bounds), part
            continue
        # It was looked at as well: it is no more stale than the others.
        stage = f"made-with/{photo.photo_id}"
        digest = session.products.digest_of(stage, photo, camera)
        if session.products.load_value(stage, digest) is None:
            session.products.save_value(stage, digest, (photo, camera))


def _check_any(orthos: Sequence[OrthoProduct], project: Project) -> None:
    """Make sure that some photo reaches the area that was asked for."""
    if project.ortho.area is not None and not orthos:
        raise _nowhere(project.ortho.area)


def _nowhere(area: Path | None) -> ProjectError:
    cause = "lies where no photo of the block shows anything."
    return ProjectError(str(area), cause, "Give an area in the block, and check its CRS.")


def _with_room(
    session: Session, project: Project, block: Block, heights: Heights
) -> list[tuple[Photo, Grid, Area | None]]:
    """As `_places`; refuses at once what will not fit on the disk, as with a pixel of 1 mm."""
    folder, places = session.results / FOLDER, list(_places(session, project, block, heights))
    missing = [
        grid for photo, grid, _ in places if not (folder / f"{photo.photo_id}.tif").is_file()
    ]
    pixels = float(sum(grid.rows * grid.columns for grid in missing))
    free = disk_usage(folder.parent).free
    if pixels * LEAST_BYTES > free:
        cause = "has room for {free:.1f} GB, too little for {count:.0f} Gpx of orthos at {gsd:g} m."
        values = {"free": free / 1e9, "gsd": missing[0].ground_sample_distance_m}
        remedy = "Give a larger gsd_m or an area in [ortho], or make room."
        raise StorageError(folder, cause, remedy, count=pixels / 1e9, **values)
    return places


def _options(section: OrthoSection) -> OrthoOptions:
    """What `[ortho]` says of how photos are rectified."""
    return OrthoOptions(
        edge_mm=section.edge_mm, resampling=section.resampling, visibility=section.visibility
    )


def _asked(options: OrthoOptions, part: Area | None) -> tuple[object, ...]:
    """What an ortho hangs on besides photo and ground; nothing where it is made as by default."""
    usual = options == OrthoOptions() and part is None
    return () if usual else (options.edge_mm, options.resampling, part)


def ground_under(grid: Grid, dem: Dem, project: Project) -> tuple[Path | Grid | float | str, ...]:
    """What names the heights that an ortho stands on: those under it where they are in memory.

    A DEM that was changed elsewhere, or only written again, leaves the ortho as it is. One that is
    not held counts by its files.
    """
    if dem.window is None:
        return project.reference.dem or (dem.mean_height(),)
    held = dem.window.grid
    reach_m = LARGEST_SPACING * grid.ground_sample_distance_m
    part = held.covering(grid.bounds, RIM_PX + int(np.ceil(reach_m / dem.ground_sample_distance_m)))
    corner = held.grid_from_object(np.array([[part.west, part.north]]))[0]
    column, row = np.rint(corner).astype(int).tolist()
    here = np.s_[row : row + part.rows, column : column + part.columns]
    total = hashlib.sha256(dem.window.heights[here].tobytes())
    total.update(dem.window.filled[here].tobytes())
    return part, total.hexdigest()


def pictured(block: Block) -> list[Photo]:
    """The oriented photos whose scan has a picture.

    Raises:
        ScanError: Photos are oriented, and none has one.
    """
    oriented = [photo for photo in block.photos.values() if photo.oriented]
    photos = [photo for photo in oriented if not is_stand_in(photo.scan)]
    if oriented and not photos:
        raise ScanError(oriented[0].scan, "is a stand-in without picture.", NO_PICTURES)
    return photos


def _remove_others(session: Session, names: set[str]) -> None:
    """Delete orthos made of other photos; files that nobody made here stay."""
    for path in (session.results / FOLDER).glob("*.tif"):
        if path.stem not in names and session.products.latest_value(f"ortho/{path.stem}"):
            path.unlink(missing_ok=True)


def default_gsd_m(block: Block) -> float:
    """The scans' own ground sample distance, rounded up to a round figure, metres."""
    sizes = [photo.ground_pixel_m(block.camera_of(name)) for name, photo in block.photos.items()]
    mean = sum(sizes) / len(sizes)
    return next((step for step in (0.1, 0.2, 0.25, 0.5, 1.0, 2.0, 5.0) if step >= mean), 10.0)
