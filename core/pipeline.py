"""The stages in their order: the table of contents of the engine.

Each stage takes the block as its owner describes it and what earlier stages made, and returns a
value. Nothing here knows of folders, sessions or screens; `app.run` walks this list.
"""

from dataclasses import replace
from hashlib import sha256
from typing import Any

import numpy as np

from core.block.approximation import Approximation
from core.block.assembly import Assembly, assemble_block
from core.block.block import Block, Photo
from core.block.features import usable_from_mask
from core.block.georeference import Archive, georeference_photo, open_archive
from core.block.orientation import OrientedPhoto, orient_photo
from core.block.pairs import footprint
from core.block.patches import OpenPhoto
from core.block.reference_points import ReferenceFeatures, gather_reference_points
from core.block.standing import Site
from core.block.tie_points import match_ties
from core.doubts import Doubt, Failure
from core.errors import OrientationError, PhotogrammetryError
from core.geometry.camera import Camera
from core.geometry.crs import Bounds, distance_m, read_crs
from core.reference.coverage import check_coverage
from core.reference.dem import Dem, open_dem
from core.reference.junctions import JunctionOptions, find_junctions
from core.reference.ortho import open_ortho
from core.reference.planar import planar_graph
from core.reference.reference import Reference
from core.reference.roads import read_roads
from core.reference.vectors import read_mask_polygons
from core.scan.family import settle_family
from core.scan.look import same_photo
from core.scan.orientation import ScanOrientation, orient_scan
from core.stages import BlockInput, Georeferenced, Made, ScanInput, ScanSet, Stage, Tied, Work

BEYOND_DOUBT = -15.0
"""A hypothesis that stands with so few expected false alarms (log10) needs no rival."""


def random_for(*names: str) -> np.random.Generator:
    """A generator that depends on names alone, so that the same run gives the same result."""
    digest = sha256("/".join(names).encode()).digest()
    return np.random.default_rng(int.from_bytes(digest[:8], "big"))


def open_reference(given: BlockInput, bounds: Bounds | None = None) -> Reference:
    """The reference of a block, its files opened; heights within bounds held in memory."""
    dem = open_dem(given.dem, given.crs)
    return Reference(
        open_ortho(given.ortho, given.crs),
        dem if bounds is None else dem.cropped(bounds),
        given.ortho_sigma_m,
        given.dem_sigma_m,
    )


def orient_scans(given: BlockInput, made: Made, work: Work) -> ScanSet:
    """Read every scan, find picture area and fiducials, fit its interior orientation.

    A scan that cannot be used is set aside with its reason; the rest goes on.

    Raises:
        PhotogrammetryError: No scan can be used.
    """

    def one(scan: ScanInput) -> ScanOrientation | PhotogrammetryError:
        try:
            return orient_scan(scan.path, given.cameras[scan.camera], scan.scan_pixel_um)
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


def georeference_photos(given: BlockInput, made: Made, work: Work) -> Georeferenced:
    """Give every photo its approximate exterior orientation.

    A photo whose own sources are missing or cannot be used is set aside; the rest goes on.

    Raises:
        PhotogrammetryError: No photo has a source that can be used, the reference misses the
            block, or the CRS does not fit.
    """
    scans: ScanSet = made["scans"]
    reference = open_reference(given)
    archive = open_archive(given.georeference, given.crs, scans.oriented)
    cameras = {scan.path.stem: scan.camera for scan in given.scans}
    found: dict[str, Approximation] = {}
    failed: dict[str, PhotogrammetryError] = {}
    for done, (name, scan) in enumerate(scans.oriented.items()):
        work.progress.report(done, len(scans.oriented), name)
        result = approximated(scan, given.cameras[cameras[name]], archive, reference.dem)
        if isinstance(result, PhotogrammetryError):
            failed[name] = result
        else:
            found[name] = result
    if not found:
        raise next(iter(failed.values()))
    photos = {
        name: approximate_photo(scans.oriented[name], cameras[name], result, reference)
        for name, result in sorted(found.items())
    }
    set_aside = {name: str(error) for name, error in failed.items()}
    block = Block(given.crs, scans.cameras or given.cameras, photos)
    lost = far_from_reference(block, reference)
    set_aside |= lost
    block = block.with_photos({n: photo for n, photo in photos.items() if n not in lost})
    coverage = check_coverage(reference.dem, reference.ortho, block_bounds(block))
    doubts = [doubt for result in found.values() for doubt in result.doubts]
    doubts += [Doubt("scan-set-aside", name, why, 0.8) for name, why in set_aside.items()]
    doubts += [*archive.doubts, *coverage, *reference.ortho.notes, *reference.dem.notes]
    return Georeferenced(block, found, set_aside, tuple(doubts))


def approximated(
    scan: ScanOrientation, camera: Camera, archive: Archive, dem: Dem
) -> Approximation | PhotogrammetryError:
    """Where a photo roughly is, or why nobody can say: that concerns this one scan alone."""
    try:
        found = georeference_photo(scan, camera, archive, dem)
    except PhotogrammetryError as error:
        return error
    if isinstance(found, Approximation):
        return found
    remedy = "Give a world file, a footprint, QGIS .points or an EO list under [scans]."
    return OrientationError(scan.scan.path, found.reason, remedy)


def far_from_reference(block: Block, reference: Reference) -> dict[str, str]:
    """Photos that lie far outside ortho or DEM, where others do not, with the reason.

    As far as two footprints beside it a photo may still be joined to the others by tie points.
    """
    far: dict[str, str] = {}
    for name, photo in block.photos.items():
        own = footprint(photo, block.camera_of(name)).bounds
        room = 2 * max(own[2] - own[0], own[3] - own[1])
        for what, area in (("ortho", reference.ortho.bounds), ("DEM", reference.dem.bounds)):
            apart = distance_m((own[0], own[1], own[2], own[3]), area)
            if apart > room:
                far[name] = (
                    f"{photo.scan}: By its georeference it lies {apart / 1000:.1f} km outside the "
                    f"{what}. Correct its world file, points, footprint or row in the EO list."
                )
    return far if len(far) < len(block.photos) else {}


def approximate_photo(
    scan: ScanOrientation, camera: str, found: Approximation, reference: Reference
) -> Photo:
    """A photo at its approximate orientation, with the mean height of the ground under it."""
    centre = found.exterior.centre
    reach = 1500.0
    under = (centre[0] - reach, centre[1] - reach, centre[0] + reach, centre[1] + reach)
    height = reference.dem.mean_height(tuple(float(side) for side in under))  # type: ignore[arg-type]
    if np.isnan(height):
        height = reference.dem.mean_height()
    return Photo(
        scan.photo_id,
        str(scan.scan.path),
        scan.size_px,
        camera,
        scan.interior,
        found.exterior,
        found.exterior,
        found.prior,
        float(height),
    )


def block_bounds(block: Block) -> Bounds:
    """West, south, east, north of all footprints, metres."""
    areas = [
        footprint(photo, block.cameras[photo.camera]).bounds for photo in block.photos.values()
    ]
    low, high = np.min(areas, axis=0), np.max(areas, axis=0)
    return float(low[0]), float(low[1]), float(high[2]), float(high[3])


def search_bounds(block: Block) -> Bounds:
    """The block's bounds with room for what its approximate orientations may be off."""
    west, south, east, north = block_bounds(block)
    room = max(
        3 * float(np.max(photo.prior.sigma_centre_m[:2]))
        + float(photo.approximate.centre[2] - photo.ground_height_m)
        * float(np.tan(min(3 * np.max(photo.prior.sigma_angles[:2]), 0.3)))
        for photo in block.photos.values()
    )
    return west - room, south - room, east + room, north + room


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


def scan_of(made: Made, photo: Photo) -> Any:
    """The scan of a photo, as the first stage opened it."""
    return made["scans"].oriented[photo.photo_id].scan


def tie_photos(given: BlockInput, made: Made, work: Work) -> Tied:
    """Tie points between all photos that may overlap."""
    placed: Georeferenced = made["georeference"]
    scans: ScanSet = made["scans"]
    usable = {
        name: usable_from_mask(scans.oriented[name].usable(), scans.oriented[name].size_px)
        for name in placed.block.photos
    }
    rng = random_for(given.name, "ties")
    ties, _, doubts = match_ties(placed.block, given.ties, work.progress, rng, usable)
    return Tied(ties, doubts)


def orient_photos(given: BlockInput, made: Made, work: Work) -> dict[str, OrientedPhoto | Failure]:
    """Orient every photo on the reference by itself, each of its hypotheses tried."""
    placed: Georeferenced = made["georeference"]
    features: ReferenceFeatures = made["reference"]
    block = placed.block
    reference = open_reference(given, search_bounds(block))

    def one(photo: Photo) -> OrientedPhoto | Failure:
        camera = block.cameras[photo.camera]
        best: OrientedPhoto | Failure = Failure("it was not tried")
        for number, start in enumerate(placed.approximations[photo.photo_id].hypotheses):
            opened = OpenPhoto(photo, camera, scan_of(made, photo)).at(start)
            rng = random_for(given.name, photo.photo_id, str(number))
            found = orient_photo(opened, reference, features.points, given.orientation, rng)
            best = likelier(best, found)
            if isinstance(best, OrientedPhoto) and best.log10_nfa < BEYOND_DOUBT:
                break
        return best

    photos = list(block.photos.values())
    oriented: dict[str, OrientedPhoto | Failure] = {}
    for photo, found in zip(photos, work.mapper(one, photos), strict=True):
        oriented[photo.photo_id] = found
        work.progress.report(len(oriented), len(photos), photo.photo_id)
    return oriented


def likelier(
    one: OrientedPhoto | Failure, other: OrientedPhoto | Failure
) -> OrientedPhoto | Failure:
    """The one of two results that is less likely chance; the later of two failures."""
    if isinstance(one, Failure):
        return other
    if isinstance(other, Failure):
        return one
    return min(one, other, key=lambda found: found.log10_nfa)


def find_control(given: BlockInput, made: Made, work: Work) -> Assembly:
    """Bring the block together and propose control until it agrees with itself."""
    placed: Georeferenced = made["georeference"]
    features: ReferenceFeatures = made["reference"]
    tied: Tied = made["ties"]
    block = Block(
        given.crs,
        given.cameras,
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
        version=2,
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
    ),
    Stage(
        "ties",
        "Tie points between the scans",
        ("georeference",),
        lambda given: (given.ties,),
        tie_photos,
    ),
    Stage(
        "orientation",
        "Single photos on the reference",
        ("reference",),
        lambda given: (given.orientation,),
        orient_photos,
        version=2,
    ),
    Stage(
        "control",
        "Control points and the block",
        ("orientation", "ties"),
        lambda given: (given.assembly, given.surveyed),
        find_control,
    ),
)
"""What is computed before any decision; the adjustment with decisions, the orthos and the mosaic
follow in `app.run`, because they depend on the session."""
