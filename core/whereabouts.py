"""Where the photos are: the archive's word, the whole block on the reference, then photo by photo.

Three stages of `core.pipeline`, each narrowing what the one before left open.
"""

from dataclasses import replace
from hashlib import sha256
from typing import Any

import numpy as np

from core.block.approximation import Approximation
from core.block.assembly import held_together
from core.block.block import Block, Photo
from core.block.block_placement import PlacedBlock, place_block
from core.block.free_block import free_blocks
from core.block.fresh_start import started_anew
from core.block.georeference import Archive, georeference_photo, open_archive
from core.block.registration.orientation import OrientedPhoto, orient_photo, orient_placed_photo
from core.block.registration.patches import OpenPhoto
from core.block.registration.reference_points import ReferenceFeatures, gather_reference_points
from core.block.registration.standing import Site, stand_up
from core.block.ties.pairs import footprint, position_sigma_m
from core.doubts import Doubt, Failure
from core.errors import OrientationError, PhotogrammetryError
from core.geometry.camera import Camera
from core.geometry.crs import Bounds, distance_m, read_crs
from core.progress import Part
from core.reference.coverage import check_coverage
from core.reference.dem import Dem, open_dem
from core.reference.junctions import JunctionOptions, find_junctions
from core.reference.ortho import open_ortho
from core.reference.planar import planar_graph
from core.reference.reference import Reference
from core.reference.road_lines import lines_on_ground
from core.reference.roads import read_roads
from core.reference.vectors import read_mask_polygons
from core.scan.orientation import ScanOrientation
from core.scan.raster import ScanFile
from core.stages import BlockInput, Georeferenced, Made, PlacedBlocks, ScanSet, Tied, Work

BEYOND_DOUBT = -25.0
"""A hypothesis that stands with so few expected false alarms (log10) needs no rival."""


def random_for(*names: str) -> np.random.Generator:
    """A generator that depends on names alone, so that the same run gives the same result."""
    digest = sha256("/".join(names).encode()).digest()
    return np.random.default_rng(int.from_bytes(digest[:8], "big"))


def open_reference(given: BlockInput, bounds: Bounds | None = None) -> Reference:
    """The reference of a block, its files opened; heights and roads within bounds in memory."""
    dem = open_dem(given.dem, given.crs)
    if bounds is not None:
        dem = dem.cropped(bounds)
    roads = None if bounds is None else read_roads(given.roads, given.crs, bounds)
    return Reference(
        open_ortho(given.ortho, given.crs),
        dem,
        given.ortho_sigma_m,
        given.dem_sigma_m,
        None if roads is None else lines_on_ground(roads, dem),
    )


def georeference_photos(given: BlockInput, made: Made, work: Work) -> Georeferenced:
    """Give every photo its approximate exterior orientation.

    A photo whose own sources are missing or cannot be used is set aside; the rest goes on.

    Raises:
        PhotogrammetryError: No photo has a source that can be used, the reference misses the
            block, or the CRS does not fit.
    """
    scans: ScanSet = made["scans"]
    reference = open_reference(given)
    archive = open_archive(given.georeference, given.crs, scans.oriented, reference.ortho.bounds)
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
    remedy = (
        "Give a world file, a footprint, QGIS .points or an EO list under [scans], or the scale of "
        "the photos (scale_number = 15000), to have them sought all over the reference ortho."
    )
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
        scan.scan.path,
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


def scan_of(made: Made, photo: Photo) -> ScanFile:
    """The scan of a photo, as the first stage opened it."""
    return made["scans"].oriented[photo.photo_id].scan


def first_look(given: BlockInput, made: Made, work: Work) -> Georeferenced:
    """Where the photos stand by a first look, in coarse steps; all that follows begins there.

    Args:
        given: The block.
        made: The scans, and rough ties with the archive's word as their start.
        work: Progress and threads.

    Returns:
        The archive's word itself where nothing stands: the stages that follow say why.
    """
    tied: Tied = made["ties"]
    given = coarsely(given, tied.start.block)
    look: dict[str, Any] = dict(made)
    steps = (
        ("reference", find_reference_points),
        ("placement", place_blocks),
        ("orientation", orient_photos),
    )
    for done, (name, step) in enumerate(steps):
        part = Part(work.progress, done / len(steps), (done + 1) / len(steps))
        look[name] = step(given, look, replace(work, progress=part))
    block, site = replace(tied.start.block, ties=tied.ties), site_of(given, look)
    oriented = look["orientation"]
    try:
        standing, _ = stand_up(block, site, oriented, random_for(given.name, "first look"))
    except OrientationError:
        return tied.start
    standing = held_together(standing, site, oriented, given.assembly)
    heights = open_reference(given).dem.mean_height
    photos, found = started_anew(standing, tied.start.approximations, heights)
    return replace(tied.start, block=tied.start.block.with_photos(photos), approximations=found)


def coarsely(given: BlockInput, block: Block) -> BlockInput:
    """The description of a block of which no finer detail is looked at than in a first pass."""
    widths = [photo.width_m(block.camera_of(name)) for name, photo in block.photos.items()]
    coarse = float(np.median(widths)) / given.orientation.coarse_width_px
    finest = max(given.orientation.finest_gsd_m, coarse)
    return replace(given, orientation=replace(given.orientation, finest_gsd_m=finest))


def site_of(given: BlockInput, made: Made) -> Site:
    """All that the photos are compared with, as far as it was made."""
    block, features = made["ties"].start.block, made["reference"]
    return Site(
        open_reference(given, search_bounds(block)),
        {name: scan_of(made, photo) for name, photo in block.photos.items()},
        features.points,
        features.sources,
    )


def find_reference_points(given: BlockInput, made: Made, work: Work) -> ReferenceFeatures:
    """Junctions of the roads, and salient points of the ortho where those are few."""
    placed: Georeferenced = made["ties"].start
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
    gsd = max(float(pixel), given.orientation.finest_gsd_m)
    features = gather_reference_points(
        reference, junctions, bounds, float(width), gsd, mask, work.progress, work.mapper
    )
    return replace(features, doubts=roads.notes)


def place_blocks(given: BlockInput, made: Made, work: Work) -> PlacedBlocks:
    """Bring the photos together by their ties, and find each connected part on the reference."""
    tied: Tied = made["ties"]
    placed = tied.start
    block = Block(given.crs, placed.block.cameras, placed.block.photos, ties=tied.ties)
    reference = open_reference(given, search_bounds(placed.block))
    hypotheses = {name: found.hypotheses for name, found in placed.approximations.items()}
    parts = free_blocks(block, hypotheses, given.assembly.adjustment)
    found: list[PlacedBlock] = []
    doubts: list[Doubt] = []
    for done, free in enumerate(parts):
        work.progress.report(done, len(parts), f"{len(free.block.photos)} photos together")
        if not free.tied:
            continue
        scans = {name: scan_of(made, photo) for name, photo in free.block.photos.items()}
        result = place_block(free, scans, reference, given.placement, work.mapper)
        if isinstance(result, Failure):
            names = ", ".join(free.block.photos)
            doubts.append(Doubt("block-placement", names, f"{names}: {result.reason}.", 0.6))
        else:
            found.append(result)
    return PlacedBlocks(tuple(found), tuple(doubts))


def orient_photos(given: BlockInput, made: Made, work: Work) -> dict[str, OrientedPhoto | Failure]:
    """Orient every photo on the reference, from where its block was placed.

    A photo is sought by itself, each of its hypotheses tried, only where no photo stands that is
    tied to it: others are brought to their place by tie points, which leaves less to chance.
    """
    placed: Georeferenced = made["ties"].start
    features: ReferenceFeatures = made["reference"]
    together: PlacedBlocks = made["placement"]
    photos = list(placed.block.photos.values())
    reference = open_reference(given, search_bounds(placed.block))
    oriented: dict[str, OrientedPhoto | Failure] = {}

    def opened(photo: Photo) -> OpenPhoto:
        return OpenPhoto(photo, placed.block.cameras[photo.camera], scan_of(made, photo))

    def from_block(photo: Photo) -> OrientedPhoto | Failure:
        rng = random_for(given.name, photo.photo_id, "block")
        places = together.placements(photo.photo_id)
        return orient_placed_photo(
            opened(photo), reference, features.points, places, given.orientation, rng
        )

    def alone(photo: Photo) -> OrientedPhoto | Failure:
        if position_sigma_m(photo) > opened(photo).width_m:
            return Failure("nothing says where it lies, and no tie points carry it there")
        best: OrientedPhoto | Failure = Failure("it was not tried")
        for number, start in enumerate(placed.approximations[photo.photo_id].hypotheses):
            rng = random_for(given.name, photo.photo_id, str(number))
            found = orient_photo(
                opened(photo).at(start), reference, features.points, given.orientation, rng
            )
            best = likelier(best, found)
            if isinstance(best, OrientedPhoto) and best.log10_nfa < BEYOND_DOUBT:
                break
        return best

    for search, chosen in (
        (from_block, lambda photo: bool(together.placements(photo.photo_id))),
        (alone, lambda photo: not _held(photo.photo_id, together, oriented)),
    ):
        wanted = [photo for photo in photos if chosen(photo)]
        for photo, found in zip(wanted, work.mapper(search, wanted), strict=True):
            oriented[photo.photo_id] = found
            work.progress.report(len(oriented), len(photos), photo.photo_id)
    return {photo.photo_id: oriented[photo.photo_id] for photo in photos}


def _held(
    photo_id: str, together: PlacedBlocks, oriented: dict[str, OrientedPhoto | Failure]
) -> bool:
    """Whether a photo stands, or is tied to one that does."""
    names = next((p.photo_ids for p in together.found if photo_id in p.photo_ids), ())
    return any(isinstance(oriented.get(name), OrientedPhoto) for name in names)


def likelier(
    one: OrientedPhoto | Failure, other: OrientedPhoto | Failure
) -> OrientedPhoto | Failure:
    """The one of two results that is less likely chance; the later of two failures."""
    if isinstance(one, Failure):
        return other
    if isinstance(other, Failure):
        return one
    return min(one, other, key=lambda found: found.log10_nfa)
