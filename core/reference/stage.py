"""Stage reference: the junctions and salient points of today's ground that photos may show."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from core.block import Block
from core.formats.roads import read_roads
from core.formats.vectors import read_mask_polygons
from core.geometry.crs import read_crs
from core.matching.patches import OpenPhoto
from core.matching.reference import ReferenceFiles, open_reference
from core.progress import Work
from core.raster.scan_file import ScanFile
from core.reference.junctions import find_junctions
from core.reference.points import ReferenceFeatures, gather_reference_points
from core.reference.road_graph import planar_graph


def find_reference_points(
    block: Block,
    scans: Mapping[str, ScanFile],
    files: ReferenceFiles,
    finest_gsd_m: float,
    work: Work,
) -> ReferenceFeatures:
    """Junctions of the roads, and salient points of the ortho where those are few.

    Args:
        block: Photos where the archive puts them, with what that may be off.
        scans: Scans by photo.
        files: The reference.
        finest_gsd_m: Finer detail is not looked at, metres.
        work: Progress and threads.

    Raises:
        PhotogrammetryError: A file of the reference cannot be used.
    """
    bounds = block.search_bounds
    reference = open_reference(files, bounds)
    crs = read_crs(files.crs, "block.toml")
    mask = read_mask_polygons(files.mask, crs, bounds) if files.mask else None
    bridges = read_mask_polygons(files.bridges, crs, bounds) if files.bridges else None
    roads = read_roads(files.roads, files.crs, bounds)
    junctions = find_junctions(
        planar_graph(roads), reference.dem,
        ortho_sigma_m=files.ortho_sigma_m, dem_sigma_m=files.dem_sigma_m,
        bounds=bounds, mask=mask, bridges=bridges,
    )  # fmt: skip
    sizes = [
        (opened.width_m, opened.ground_pixel_m)
        for name, photo in block.photos.items()
        for opened in [OpenPhoto(photo, block.camera_of(name), scans[name])]
    ]
    width, pixel = np.median(np.array(sizes), axis=0)
    gsd = max(float(pixel), finest_gsd_m)
    features = gather_reference_points(
        reference, junctions, bounds, float(width), gsd, mask, work.progress, work.mapper
    )
    return replace(features, doubts=roads.notes)
