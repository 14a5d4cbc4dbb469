"""The stage `surface` of a block on disk: made where it is asked for, and not twice."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import cast

from app.project import Project
from core.adjustment.adjusted import AdjustmentReport
from core.arrays import Mask
from core.doubts import Failure
from core.formats.vectors import read_mask_polygons
from core.geometry.areas import Area, only_areas
from core.geometry.crs import Bounds, parse_crs
from core.orthos.bridges import with_bridges
from core.orthos.scan_places import Heights
from core.progress import Work
from core.raster.dem import Dem
from core.said import Said, say
from core.scans.stage import ScanSet
from core.surface.cloud import check_cloud_writer, write_cloud
from core.surface.contours import write_contours
from core.surface.ground import GroundKind, choose_ground, read_ground
from core.surface.stage import (
    SurfaceFiles,
    SurfaceOptions,
    SurfaceProduct,
    make_surface,
    with_files,
)
from sessions.atomic_write import whole_file
from sessions.session import Session

CLASSES, CORRECTIONS = "ground.tif", "ground_correction.tif"
CLOUD, CONTOURS = "surface.copc.laz", "surface_contours.gpkg"
# design: shares of the bar on the screen; nothing is computed from them.
MATCHED, CLOUDED = 0.9, 0.5
VERSION = 4
"""Counted up when the same inputs give another surface than before."""
CLOUD_VERSION = CONTOURS_VERSION = 1
"""The same of the point cloud and the contour lines of the same surface."""


class _NothingMatched(Exception):
    """Carries a failure past the files that are then not written."""

    def __init__(self, failure: Failure) -> None:
        super().__init__(failure.reason)
        self.failure = failure


def check_surface(project: Project) -> None:
    """Find out before the walk what its surface would stumble over.

    Raises:
        ProjectError: A point cloud is asked for, and no library that writes one is installed.
    """
    if project.surface is not None and project.surface.point_cloud:
        check_cloud_writer(project.file)


def make_block_surface(
    session: Session,
    project: Project,
    report: AdjustmentReport,
    dem: Dem,
    work: Work,
    anew: bool = False,
) -> SurfaceProduct | Failure:
    """The surface of an adjusted block, unless it is fresh.

    Args:
        session: Where results are kept.
        project: For the size of its cells.
        report: The adjusted block.
        dem: Heights to begin from.
        work: Told per tile; runs tiles side by side.
        anew: Make it again.

    Returns:
        The surface, or why there is none; files of an earlier one are then removed.
    """
    digest_of, options = session.products.digest_of, project.surface or SurfaceOptions()
    water = _water(project, report.block.bounds)
    inputs = digest_of("surface", VERSION, *_looked_at(project, report, dem, water))
    files = SurfaceFiles.within(session.results)
    kept = None if anew else session.products.load_value("surface", digest_of(inputs, files.paths))
    if kept is not None and all(path.is_file() for path in files.paths):
        make_layers(session, project, kept, work)
        return kept
    more = options.point_cloud or options.contours_m is not None
    share = MATCHED if more else 1.0
    try:
        with ExitStack() as stack:
            parts = [stack.enter_context(whole_file(path)) for path in files.paths]
            made = make_surface(
                report.block,
                dem,
                SurfaceFiles(*parts),
                usable_parts(session),
                ties=report.tie_positions,
                options=options,
                work=work.part(0.0, share),
                water=water,
            )
            if isinstance(made, Failure):
                raise _NothingMatched(made)
    except _NothingMatched as nothing:
        for path in files.paths:
            path.unlink(missing_ok=True)
        make_layers(session, project, nothing.failure, work)
        return nothing.failure
    product = with_files(made, files)
    session.products.save_value("surface", digest_of(inputs, files.paths), product)
    make_layers(session, project, product, work.part(share, 1.0))
    return product


def _looked_at(
    project: Project, report: AdjustmentReport, dem: Dem, water: Area | None
) -> tuple[object, ...]:
    """What a surface hangs on."""
    photos = [
        (photo, report.block.camera_of(name), photo.scan)
        for name, photo in report.block.photos.items()
        if photo.oriented
    ]
    cell_m = (project.surface or SurfaceOptions()).cell_m
    ground = project.reference.dem or (dem.mean_height(),)
    wet = () if water is None else (project.reference.water,)
    return photos, cell_m, ground, report.tie_positions, *wet


def _water(project: Project, bounds: Bounds) -> Area | None:
    """Where no surface is sought: water in the block, if a layer of it is given."""
    file = project.reference.water
    if file is None:
        return None
    crs = parse_crs(project.block.crs, project.file)
    found = only_areas(read_mask_polygons(file, crs, bounds))
    return None if found.is_empty else found


def make_layers(
    session: Session, project: Project, surface: SurfaceProduct | Failure, work: Work
) -> None:
    """Point cloud and contour lines of the surface: made where they are asked for and not fresh.

    Files that nobody asks for any more are removed.
    """
    options, crs = project.surface or SurfaceOptions(), project.block.crs
    interval_m, products = options.contours_m, session.products
    made = None if isinstance(surface, Failure) else surface

    def cloud(part: Path, made: SurfaceProduct) -> None:
        write_cloud(part, made.files, made.grid, crs, work.part(0.0, CLOUDED))

    def contours(part: Path, made: SurfaceProduct) -> None:
        assert interval_m is not None, "only then they are asked for"
        write_contours(
            part, made.files.surface, made.grid, interval_m,
            crs=crs, work=work.part(CLOUDED, 1.0),
        )  # fmt: skip

    for name, file, version, wanted, write in (
        ("cloud", CLOUD, CLOUD_VERSION, options.point_cloud or None, cloud),
        ("contours", CONTOURS, CONTOURS_VERSION, interval_m, contours),
    ):
        path = session.results / file
        if made is None or wanted is None:
            path.unlink(missing_ok=True)
            continue
        inputs = products.digest_of(name, version, wanted, crs, *made.files.paths)
        if products.load_value(name, products.digest_of(inputs, path)) is None:
            with whole_file(path) as part:
                write(part, made)
            products.save_value(name, products.digest_of(inputs, path), True)


def make_ground(session: Session, project: Project, surface: SurfaceProduct | Failure) -> None:
    """Choose what orthos stand on, unless that is the DEM or the choice is fresh."""
    kind, crs = cast("GroundKind", project.ortho.ground), project.block.crs
    classes, corrections = session.results / CLASSES, session.results / CORRECTIONS
    if kind == "dem" or isinstance(surface, Failure):
        for path in (classes, corrections):
            path.unlink(missing_ok=True)
        return
    digest_of, sigma_m = session.products.digest_of, project.reference.sigmas_m(crs)[1]
    inputs = digest_of("ground", VERSION, kind, sigma_m, *surface.files.paths)
    kept = session.products.load_value("ground", digest_of(inputs, classes, corrections))
    if kept is not None and classes.is_file() and corrections.is_file():
        return
    with whole_file(classes) as first, whole_file(corrections) as second:
        made = choose_ground(
            surface.files.difference,
            surface.files.sigma,
            kind,
            sigma_m,
            classes=first,
            corrections=second,
        )
    made = replace(made, classes=classes, corrections=corrections)
    session.products.save_value("ground", digest_of(inputs, classes, corrections), made)


def chosen_ground(
    session: Session, project: Project, dem: Dem, bounds: Bounds
) -> tuple[Heights, tuple[Path, ...]]:
    """Heights for the orthos, bridges over them, and the files they hang on besides the DEM.

    Args:
        session: Where corrections are kept.
        project: Says what the orthos stand on.
        dem: The DEM.
        bounds: The block's ground, metres.
    """
    corrections, bridges = session.results / CORRECTIONS, project.reference.bridges
    heights: Heights = dem
    files: tuple[Path, ...] = ()
    if project.ortho.ground != "dem" and corrections.is_file():
        heights, files = read_ground(corrections, dem), (corrections,)
    if bridges is not None:
        heights = with_bridges(heights, bridges, project.block.crs, bounds)
        files = (*files, bridges)
    return heights, files


def usable_parts(session: Session) -> Callable[[str], Mask | None]:
    """Which part of a photo's scan is photograph, without housings, data strip and marks."""
    scans: ScanSet | None = session.products.latest_value("scans")

    def usable(photo_id: str) -> Mask | None:
        if scans is None or photo_id not in scans.oriented:
            return None
        area = scans.oriented[photo_id].scan.usable
        return None if area is None else area.mask

    return usable


def surface_line(surface: SurfaceProduct | Failure) -> Said:
    """What became of the surface."""
    if isinstance(surface, Failure):
        return say("no surface: {reason}", reason=surface.reason)
    return say(
        "cells of {cell:.2f} m, {share:.0f} % of what two photos show, standard deviation "
        "{sigma:.2f} m, scatter about the DEM {nmad:.2f} m",
        cell=surface.grid.ground_sample_distance_m,
        share=100 * surface.completeness,
        sigma=surface.median_sigma_m,
        nmad=surface.trend.nmad_m,
    )
