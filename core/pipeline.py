"""The stages in their order: the table of contents of the engine.

Each stage takes the block as its owner describes it and what earlier stages made, and returns a
value. Nothing here knows of folders, sessions or screens; `app.run` walks this list.
"""

from dataclasses import replace

from core.block.assembly import Assembly, assemble_block
from core.block.published import CHAINS, assemble_published
from core.block.tie_points import detect_block_features, match_block_features, match_roughly
from core.doubts import Doubt
from core.errors import PhotogrammetryError
from core.geometry.camera import Camera
from core.progress import Part
from core.scan.family import settle_family
from core.scan.look import same_photo
from core.scan.orientation import ScanOrientation, orient_scan
from core.stages import BlockInput, Georeferenced, Made, ScanInput, ScanSet, Stage, Tied, Work
from core.whereabouts import (
    find_reference_points,
    first_look,
    georeference_photos,
    orient_photos,
    place_blocks,
    random_for,
    site_of,
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


def tie_photos(given: BlockInput, made: Made, work: Work) -> Tied:
    """Tie points between all photos that may overlap, looked for twice.

    The archive's georeference only leads a first look; what follows begins where that found the
    photos, so that its faults leave no traces.
    """
    placed: Georeferenced = made["georeference"]
    scans: ScanSet = made["scans"]
    areas = {name: scans.oriented[name].scan.usable for name in placed.block.photos}
    usable = {name: area.at for name, area in areas.items() if area is not None}
    seeing, first, looking, last = (
        Part(work.progress, *share)
        for share in ((0.0, 0.15), (0.15, 0.3), (0.3, 0.85), (0.85, 1.0))
    )
    features = detect_block_features(placed.block, given.ties, seeing, usable, work.mapper)
    rough, told = match_roughly(
        placed.block, features, given.ties, first, random_for(given.name, "rough ties")
    )
    start = first_look(
        given, {**made, "ties": Tied(rough, (), placed)}, replace(work, progress=looking)
    )
    ties, _, doubts = match_block_features(
        start.block, features, given.ties, last, random_for(given.name, "ties")
    )
    return Tied(ties, (*told, *doubts), start)


def find_control(given: BlockInput, made: Made, work: Work) -> Assembly:
    """Bring the block together and propose control until it agrees with itself."""
    tied: Tied = made["ties"]
    # The published chains look no further than a repaired georeference may be off.
    begun: Georeferenced = tied.start if given.preset == "gruber" else made["georeference"]
    surveyed = {point.point_id: point for point in given.surveyed}
    block = replace(begun.block, surveyed=surveyed, ties=tied.ties)
    site = site_of(given, made)
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
        version=6,
    ),
    Stage(
        "georeference",
        "Approximate exterior orientation",
        ("scans",),
        lambda given: (given.crs, given.georeference, given.ortho, given.dem),
        georeference_photos,
    ),
    Stage(
        "ties",
        "Tie points between the scans",
        ("georeference",),
        lambda given: (
            given.ties,
            given.roads,
            given.mask,
            given.bridges,
            given.ortho_sigma_m,
            given.dem_sigma_m,
            given.placement,
            given.orientation,
            given.assembly,
        ),
        tie_photos,
        version=6,
    ),
    Stage(
        "reference",
        "Junctions and salient points",
        ("ties",),
        lambda given: (
            given.roads,
            given.mask,
            given.bridges,
            given.ortho_sigma_m,
            given.dem_sigma_m,
            given.orientation.finest_gsd_m,
        ),
        find_reference_points,
        version=3,
    ),
    Stage(
        "placement",
        "The whole block on the reference",
        ("ties",),
        lambda given: (given.placement, given.assembly.adjustment),
        place_blocks,
        version=4,
    ),
    Stage(
        "orientation",
        "Single photos on the reference",
        ("reference", "placement"),
        lambda given: (given.orientation,),
        orient_photos,
        version=8,
    ),
    Stage(
        "control",
        "Control points and the block",
        ("orientation", "ties", "georeference"),
        lambda given: (given.assembly, given.surveyed, given.preset),
        find_control,
        version=9,
    ),
)
"""What is computed before any decision; the adjustment with decisions, the orthos and the mosaic
follow in `app.run`, because they depend on the session."""
