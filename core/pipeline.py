"""The stages in their order: the table of contents of the engine.

Each stage takes the block as its owner describes it and what earlier stages made, and returns a
value. Nothing here knows of folders, sessions or screens; `app.run` walks this list.
"""

from dataclasses import replace

import numpy as np

from core.block.assembly import Assembly, assemble_block
from core.block.block import Block
from core.block.published import CHAINS, assemble_published
from core.block.registration.patches import OpenPhoto
from core.block.registration.reference_points import ReferenceFeatures, gather_reference_points
from core.block.registration.standing import Site
from core.block.tie_points import match_ties
from core.doubts import Doubt
from core.errors import PhotogrammetryError
from core.geometry.camera import Camera
from core.geometry.crs import read_crs
from core.reference.junctions import JunctionOptions, find_junctions
from core.reference.planar import planar_graph
from core.reference.roads import read_roads
from core.reference.vectors import read_mask_polygons
from core.scan.family import settle_family
from core.scan.look import same_photo
from core.scan.orientation import ScanOrientation, orient_scan
from core.stages import BlockInput, Georeferenced, Made, ScanInput, ScanSet, Stage, Tied, Work
from core.whereabouts import (
    georeference_photos,
    open_reference,
    orient_photos,
    place_blocks,
    random_for,
    scan_of,
    search_bounds,
)


def orient_scans(given: BlockInput, made: Made, work: Work) -> ScanSet:
    """Read every scan, find picture area and fiducials, fit its interior orientation.

    A scan that cannot be used is set aside with its reason; the rest goes on.

    Raises:
        PhotogrammetryError: No scan can be used.
    """

    def one(scan: ScanInput) -> ScanOrientation | PhotogrammetryError:
        try:
            return orient_scan(
                scan.path, given.cameras[scan.camera], scan.scan_pixel_um, by_hand=scan.marks
            )
        except PhotogrammetryError as error:
            return error

    oriented: dict[str, ScanOrientation] = {}
    failed: dict[str, PhotogrammetryError] = {}
    results = zip(given.scans, work.mapper(one, given.scans), strict=True)
    for done, (scan, result) in enumerate(results):
        work.progress.report(done + 1, len(given.scans), scan.path.name)
        if isinstance(result, PhotogrammetryError):
            failed[scan.path.stem] = result
        else:
            oriented[result.photo_id] = result
    if not oriented:
        raise next(iter(failed.values()))
    oriented, cameras, doubts = _by_camera(given, oriented)
    masked = work.mapper(ScanOrientation.masked, oriented.values())
    oriented = dict(zip(oriented, masked, strict=True))
    doubts += [doubt for result in oriented.values() for doubt in result.doubts]
    doubts += same_photo({name: scan.look for name, scan in oriented.items()})
    doubts += [Doubt("scan-set-aside", name, str(error), 0.8) for name, error in failed.items()]
    reasons = {name: str(error) for name, error in failed.items()}
    return ScanSet(dict(sorted(oriented.items())), reasons, tuple(doubts), cameras)


def _by_camera(
    given: BlockInput, oriented: dict[str, ScanOrientation]
) -> tuple[dict[str, ScanOrientation], dict[str, Camera], list[Doubt]]:
    """The scans of each camera settled together; cameras as their photos show them; doubts."""
    settled: dict[str, ScanOrientation] = {}
    cameras: dict[str, Camera] = dict(given.cameras)
    doubts: list[Doubt] = []
    scans = {scan.path.stem: scan for scan in given.scans}
    for name, camera in given.cameras.items():
        own = {photo: one for photo, one in oriented.items() if scans[photo].camera == name}
        pixels_mm = {photo: scans[photo].scan_pixel_um / 1000 for photo in own}
        family = settle_family(own, camera, pixels_mm)
        settled |= family.oriented
        cameras[name] = family.camera
        doubts += family.doubts
    return settled, cameras, doubts


def find_reference_points(given: BlockInput, made: Made, work: Work) -> ReferenceFeatures:
    """Junctions of the roads, and salient points of the ortho where those are few."""
    placed: Georeferenced = made["georeference"]
    block, bounds = placed.block, search_bounds(placed.block)
    reference = open_reference(given, bounds)
    crs = read_crs(given.crs, "block.toml")
    mask = read_mask_polygons(given.mask, crs, bounds) if given.mask else None
    bridges = read_mask_polygons(given.bridges, crs, bounds) if given.bridges else None
    options = JunctionOptions(ortho_sigma_m=given.ortho_sigma_m, dem_sigma_m=given.dem_sigma_m)
    roads = read_roads(given.roads, given.crs, bounds)
    graph = planar_graph(roads)
    junctions = find_junctions(graph, reference.dem, options, bounds, mask, bridges)
    sizes = [
        (opened.width_m, opened.ground_pixel_m)
        for photo in block.photos.values()
        for opened in [OpenPhoto(photo, block.cameras[photo.camera], scan_of(made, photo))]
    ]
    width, pixel = np.median(np.array(sizes), axis=0)
    features = gather_reference_points(
        reference, junctions, bounds, float(width), float(pixel), mask, work.progress
    )
    return replace(features, doubts=roads.notes)


def tie_photos(given: BlockInput, made: Made, work: Work) -> Tied:
    """Tie points between all photos that may overlap."""
    placed: Georeferenced = made["georeference"]
    scans: ScanSet = made["scans"]
    areas = {name: scans.oriented[name].scan.usable for name in placed.block.photos}
    usable = {name: area.at for name, area in areas.items() if area is not None}
    rng = random_for(given.name, "ties")
    open_ways = {name: found.hypotheses for name, found in placed.approximations.items()}
    ties, _, doubts = match_ties(placed.block, given.ties, work.progress, rng, usable, open_ways)
    return Tied(ties, doubts)


def find_control(given: BlockInput, made: Made, work: Work) -> Assembly:
    """Bring the block together and propose control until it agrees with itself."""
    placed: Georeferenced = made["georeference"]
    features: ReferenceFeatures = made["reference"]
    tied: Tied = made["ties"]
    block = Block(
        given.crs,
        placed.block.cameras,
        placed.block.photos,
        {point.point_id: point for point in given.surveyed},
        {},
        tied.ties,
    )
    site = Site(
        open_reference(given, search_bounds(placed.block)),
        {name: scan_of(made, photo) for name, photo in block.photos.items()},
        features.points,
        features.sources,
    )
    if given.preset != "gruber":
        chain, rng = CHAINS[given.preset], random_for(given.name, given.preset)
        return Assembly(*assemble_published(block, site, chain, given.adjustment, rng, work.mapper))
    return assemble_block(
        block,
        site,
        made["orientation"],
        given.assembly,
        random_for(given.name, "assembly"),
        work.mapper,
        work.progress,
    )


STAGES: tuple[Stage, ...] = (
    Stage(
        "scans",
        "Interior orientation of the scans",
        (),
        lambda given: (given.scans, given.cameras, [scan.path for scan in given.scans]),
        orient_scans,
        version=5,
    ),
    Stage(
        "georeference",
        "Approximate exterior orientation",
        ("scans",),
        lambda given: (given.crs, given.georeference, given.ortho, given.dem),
        georeference_photos,
    ),
    Stage(
        "reference",
        "Junctions and salient points",
        ("georeference",),
        lambda given: (
            given.roads,
            given.mask,
            given.bridges,
            given.ortho_sigma_m,
            given.dem_sigma_m,
        ),
        find_reference_points,
        version=2,
    ),
    Stage(
        "ties",
        "Tie points between the scans",
        ("georeference",),
        lambda given: (given.ties,),
        tie_photos,
        version=3,
    ),
    Stage(
        "placement",
        "The whole block on the reference",
        ("ties",),
        lambda given: (given.placement, given.assembly.adjustment),
        place_blocks,
        version=2,
    ),
    Stage(
        "orientation",
        "Single photos on the reference",
        ("reference", "placement"),
        lambda given: (given.orientation,),
        orient_photos,
        version=7,
    ),
    Stage(
        "control",
        "Control points and the block",
        ("orientation", "ties"),
        lambda given: (given.assembly, given.surveyed, given.preset),
        find_control,
        version=7,
    ),
)
"""What is computed before any decision; the adjustment with decisions, the orthos and the mosaic
follow in `app.run`, because they depend on the session."""
