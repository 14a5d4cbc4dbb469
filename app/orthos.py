"""The stage `orthos` of a block on disk: one file for each photo, made where it is not fresh."""

import hashlib
from pathlib import Path

import numpy as np

from app.project import Project
from app.surface import chosen_ground, usable_parts
from core.block import Block, Photo
from core.errors import ScanError
from core.orthos.rectification import OrthoProduct, ortho_grid, rectify_photo
from core.orthos.scan_places import LARGEST_SPACING
from core.progress import Part, Progress
from core.raster.dem import RIM_PX, Dem
from core.raster.grid import Grid
from core.raster.stand_in import NO_PICTURES, is_stand_in
from sessions.atomic_write import whole_file
from sessions.checks import keep_version
from sessions.session import Session

FOLDER = "ortho"
"""Of the results."""


def make_orthos(
    session: Session,
    project: Project,
    block: Block,
    dem: Dem,
    progress: Progress,
    anew: bool = False,
    only: frozenset[str] | None = None,
) -> list[OrthoProduct]:
    """Orthos of all oriented photos; those that are fresh stay as they are; raises as `pictured`.

    Those of photos that no longer take part are removed.

    Args:
        session: Where they are kept.
        project: For the ground sample distance.
        block: The adjusted block.
        dem: Heights.
        progress: Told per photo.
        anew: Make all of them again.
        only: Make no others than these; the rest stays as it is on disk.
    """
    digest_of = session.products.digest_of
    photos = pictured(block)
    gsd = project.ortho.gsd_m or default_gsd_m(block)
    usable = usable_parts(session)
    heights, corrections = chosen_ground(session, project, dem, block.search_bounds)
    orthos: list[OrthoProduct] = []
    wanted = len(photos) if only is None else max(len(only), 1)
    made_now = 0
    for photo in photos:
        camera = block.camera_of(photo.photo_id)
        stage = f"ortho/{photo.photo_id}"
        ground = ground_under(ortho_grid(photo, camera, heights, gsd), dem, project)
        inputs = digest_of(stage, 5, photo, camera, gsd, (*ground, *corrections), photo.scan)
        target = session.results / FOLDER / f"{photo.photo_id}.tif"
        # The file itself counts as well: one that was cut, replaced or removed is made again.
        kept = None if anew else session.products.load_value(stage, digest_of(inputs, target))
        if only is not None and photo.photo_id not in only:
            kept = session.products.latest_value(stage) or kept
        if kept is None or not target.is_file():
            part = Part(progress, made_now / wanted, min((made_now + 1) / wanted, 1.0))
            part.report(0, 1, photo.photo_id)
            keep_version(session.products)
            with whole_file(target) as temporary:
                shown = usable(photo.photo_id)
                made = rectify_photo(
                    photo, camera, heights, gsd, temporary, block.crs, usable=shown, progress=part
                )
            kept = OrthoProduct(made.photo_id, target, made.grid, made.covered_share, made.nadir)
            session.products.save_value(f"made-with/{photo.photo_id}", inputs, (photo, camera))
            session.products.save_value(stage, digest_of(inputs, target), kept)
            made_now += 1
        elif only is None:
            made_now += 1
        orthos.append(kept)
    progress.report(1, 1)
    if only is None:
        _remove_others(session, {photo.photo_id for photo in photos})
    return orthos


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
