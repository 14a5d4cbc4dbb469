"""Stage localisation: the true positions of the photos, found for all of them together.

Rough ties join the photos, each connected part is found on the reference as one body, and from
there every photo is oriented by itself. Photos without evidence of their own are carried by their
ties. A later pass starts from the block that control has adjusted, and only carries photos that
are still waiting.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise

from core.adjustment.adjusted import AdjustmentOptions
from core.block import Block, Photo, TiePoints, position_sigma_m
from core.doubts import Doubt, Failure
from core.georeference.stage import Georeferenced
from core.localisation.block_placement import PlacedBlock, Placement, PlacementOptions, place_block
from core.localisation.free_block import free_blocks
from core.localisation.initial_orientation import (
    Site,
    WeakControl,
    carry_the_rest,
    join_photos,
    stand_up,
    weak_control,
)
from core.localisation.photo_orientation import (
    OrientationOptions,
    OrientedPhoto,
    orient_photo,
    orient_placed_photo,
    sure_of,
)
from core.localisation.priors import at_distances, free_from_archive
from core.localisation.tied_block import on_tied_ground, stand_by_ties
from core.matching.patches import OpenPhoto
from core.matching.reference import Reference, ReferenceFiles, open_reference
from core.progress import Work
from core.raster.scan_file import ScanFile
from core.reference.stage import ReferenceFeatures, ReferencePoints
from core.said import say
from core.ties.features import Features
from core.ties.stage import TieOptions, detect_block_features, match_roughly

# design: only saves time; a hypothesis this sure is never beaten by another of the same photo.
BEYOND_DOUBT = 25.0
"""A hypothesis that stands with this e-value (log10) needs no rival."""


@dataclass(frozen=True, slots=True)
class LocalisationOptions:
    """Settings of the stage."""

    ties: TieOptions = field(default_factory=TieOptions)
    """How features and rough ties are found."""
    placement: PlacementOptions = field(default_factory=PlacementOptions)
    """How a whole block is found on the reference."""
    orientation: OrientationOptions = field(default_factory=OrientationOptions)
    """How single photos are oriented."""
    adjustment: AdjustmentOptions = field(default_factory=AdjustmentOptions)
    """How photos are brought together by their ties."""


@dataclass(frozen=True, slots=True, eq=False)
class Localised:
    """The photos where they lie, without control yet."""

    block: Block
    """The photos; those that stand are `oriented`. The ties are rough."""
    weak: WeakControl
    """What single photos agreed on; it may be wrong together, and steers only weakly."""
    doubts: tuple[Doubt, ...]
    """Parts that could not be placed, photos that are carried or left out."""
    features: Mapping[str, Features] = field(
        default_factory=dict[str, Features], metadata={"stored": False}
    )
    """Features by photo for the ties; too many to be kept on disk, empty after a restart."""


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """Photos oriented one by one."""

    placed: Georeferenced
    """The photos and their cameras before."""
    parts: tuple[PlacedBlock, ...]
    """Connected parts where they were found on the reference."""
    oriented: Mapping[str, OrientedPhoto | Failure]
    """What each photo found by itself."""
    doubts: tuple[Doubt, ...]
    """Parts that could not be placed."""

    def sureness(self, camera: str) -> float:
        """How far the photos of a camera are beyond chance together: log10 of their e-values."""
        return sum(
            found.log10_e_value
            for name, found in self.oriented.items()
            if isinstance(found, OrientedPhoto) and self.placed.block.photos[name].camera == camera
        )


def localise_photos(
    placed: Georeferenced,
    scans: Mapping[str, ScanFile],
    features: ReferenceFeatures,
    files: ReferenceFiles,
    options: LocalisationOptions,
    work: Work,
    *,
    ties: TiePoints | None = None,
) -> Localised:
    """Find the photos of a block on the reference, or without one, bring them together by ties.

    Args:
        placed: Where the archive puts them.
        scans: Scans by photo.
        features: Junctions and salient points.
        files: The reference.
        options: Settings.
        work: Progress, threads and the source of chance.
        ties: Tie points that are taken over; None to find them.

    Raises:
        OrientationError: No photo stands on the reference.
    """
    block = placed.block
    # design: shares of the time, for the bar alone.
    shares = [0.2, 0.35, 0.6, 0.95]
    first, rough, placing, orienting = (
        work.part(start, end) for start, end in pairwise([0.0, *shares])
    )
    seen: dict[str, Features] = {}
    told: tuple[Doubt, ...] = ()
    if ties is None:
        seen = dict(detect_features(block, scans, options, first))
        chance = work.random("rough ties")
        ties, told = match_roughly(block, seen, options.ties, rough.progress, chance)
    block = replace(block, ties=ties)
    if not files.ortho:
        hypotheses = {name: known.hypotheses for name, known in placed.approximations.items()}
        block, loose = stand_by_ties(block, hypotheses, options.adjustment)
        block = block if files.knows_ground else on_tied_ground(block, options.adjustment)
        return Localised(block, WeakControl.none(), (*told, *loose), seen)
    reference = open_reference(files, block.search_bounds)
    site = Site(reference, scans, features.points, features.sources)
    found = orient_at_distances(replace(placed, block=block), site, options, placing, orienting)
    block, oriented = found.placed.block, found.oriented
    standing, doubts = stand_up(block, site, oriented, work.random("localisation"))
    weak = weak_control(standing, oriented, features.points, features.sources)
    joined = join_photos(standing, weak, options.adjustment)
    clicked = frozenset(
        name for name, known in placed.approximations.items() if known.source == "points"
    )
    freed = free_from_archive(joined, clicked, reference.dem.mean_height)
    return Localised(freed, weak, (*told, *found.doubts, *doubts), seen)


def localise_again(
    before: Localised,
    adjusted: Block,
    scans: Mapping[str, ScanFile],
    features: ReferenceFeatures,
    files: ReferenceFiles,
    work: Work,
) -> Localised:
    """The photos where control put them; those that do not stand yet are carried by fine ties.

    Args:
        before: What was localised before.
        adjusted: The block with its fine ties, as control found it.
        scans: Scans by photo.
        features: Junctions and salient points.
        files: The reference.
        work: The source of chance.
    """
    waiting = [name for name, photo in adjusted.photos.items() if not photo.oriented]
    block, doubts = replace(adjusted, measurements={}), before.doubts
    if waiting and files.ortho:
        reference = open_reference(files, adjusted.search_bounds)
        site = Site(reference, scans, features.points, features.sources)
        block, told = carry_the_rest(block, site, {}, work.random("carried"))
        subjects = {doubt.subject for doubt in told}
        kept = (
            doubt
            for doubt in doubts
            if doubt.kind != "photo-orientation" or doubt.subject not in subjects
        )
        doubts = (*kept, *told)
    return replace(before, block=block, weak=WeakControl.none(), doubts=doubts)


def detect_features(
    block: Block, scans: Mapping[str, ScanFile], options: LocalisationOptions, work: Work
) -> dict[str, Features]:
    """Features of every photo within what of its scan is photograph."""
    areas = {name: scans[name].usable for name in block.photos}
    usable = {name: area.at for name, area in areas.items() if area is not None}
    return detect_block_features(block, options.ties, work.progress, usable, work.mapper)


def orient_at_distances(
    placed: Georeferenced, site: Site, options: LocalisationOptions, placing: Work, orienting: Work
) -> Standing:
    """Place and orient all photos, at each principal distance an unknown camera may have.

    Of each camera the distance is kept at which its photos stand furthest beyond chance.

    Args:
        placed: The photos with their rough ties.
        site: The reference.
        options: Settings.
        placing: Progress of the placement.
        orienting: Progress of the orientation.
    """
    cameras = placed.block.cameras
    unknown = {n: len(camera.distances_mm) for n, camera in cameras.items() if camera.distances_mm}
    count = max(unknown.values(), default=1)

    def at(chosen: Mapping[str, int], number: int) -> Standing:
        one, share = at_distances(placed, chosen), (number / count, (number + 1) / count)
        parts, unplaced = place_parts(one.block, one, site, options, placing.part(*share))
        oriented = orient_photos(one, parts, site, options, orienting.part(*share))
        return Standing(one, parts, oriented, unplaced)

    trials = [
        {name: min(number, most - 1) for name, most in unknown.items()} for number in range(count)
    ]
    tried = [at(chosen, number) for number, chosen in enumerate(trials)]
    best = {
        name: max(range(most), key=lambda number: tried[number].sureness(name))
        for name, most in unknown.items()
    }
    return tried[trials.index(best)] if best in trials else at(best, count - 1)


def place_parts(
    block: Block, placed: Georeferenced, site: Site, options: LocalisationOptions, work: Work
) -> tuple[tuple[PlacedBlock, ...], tuple[Doubt, ...]]:
    """Bring the photos together by their ties, and find each connected part on the reference."""
    hypotheses = {name: known.hypotheses for name, known in placed.approximations.items()}
    free = [part for part in free_blocks(block, hypotheses, options.adjustment) if part.tied]
    parts: list[PlacedBlock] = []
    doubts: list[Doubt] = []
    for done, part in enumerate(free):
        told = say("{count:# photo|# photos} together", count=len(part.block.photos))
        work.progress.report(done, len(free), told)
        own = {name: site.scans[name] for name in part.block.photos}
        result = place_block(part, own, site.reference, options.placement, work.mapper)
        if isinstance(result, Failure):
            names = ", ".join(part.block.photos)
            doubts.append(
                Doubt(
                    "block-placement",
                    names,
                    say("{names}: {reason}.", names=names, reason=result.reason),
                )
            )
        else:
            parts.append(result)
    return tuple(parts), tuple(doubts)


def orient_photos(
    placed: Georeferenced,
    parts: tuple[PlacedBlock, ...],
    site: Site,
    options: LocalisationOptions,
    work: Work,
) -> dict[str, OrientedPhoto | Failure]:
    """Orient every photo on the reference, from where its part of the block was placed.

    A photo is sought by itself, each of its hypotheses tried, only where no photo stands that is
    tied to it: others are brought to their place by tie points, which leaves less to chance. Before
    that, the less likely places of its block are tried.
    """
    photos = list(placed.block.photos.values())
    oriented: dict[str, OrientedPhoto | Failure] = {}

    def opened(photo: Photo) -> OpenPhoto:
        return OpenPhoto(photo, placed.block.cameras[photo.camera], site.scans[photo.photo_id])

    def orient_at(tried: int, count: int | None, photo: Photo) -> OrientedPhoto | Failure:
        places = placements_of(photo.photo_id, parts)[:count]
        rng = work.random(photo.photo_id, "elsewhere" if tried else "block")
        return orient_placed_photo(
            opened(photo), site.reference, site.points, places, options.orientation, rng, tried
        )

    def orient_alone(photo: Photo) -> OrientedPhoto | Failure:
        if position_sigma_m(photo) > opened(photo).width_m:
            return Failure("nothing says where it lies, and no tie points carry it there")
        hypotheses = placed.approximations[photo.photo_id].hypotheses
        starts = [opened(photo).at(start) for start in hypotheses]
        return orient_likeliest(starts, site.reference, site.points, options.orientation, work)

    def loose(tried: int) -> list[Photo]:
        return [
            photo
            for photo in photos
            if len(placements_of(photo.photo_id, parts)) > tried
            and not _is_held(photo.photo_id, parts, oriented)
        ]

    likeliest = options.placement.hypotheses
    # Alone, at last, also those that have no place with others: less than none were tried.
    for tried, orient in (
        (0, partial(orient_at, 0, likeliest)),
        (likeliest, partial(orient_at, likeliest, None)),
        (-1, orient_alone),
    ):
        wanted = loose(tried)
        for photo, result in zip(wanted, work.mapper(orient, wanted), strict=True):
            oriented[photo.photo_id] = result
            work.progress.report(len(oriented), len(photos), photo.photo_id)
    return {photo.photo_id: oriented[photo.photo_id] for photo in photos}


def orient_likeliest(
    starts: list[OpenPhoto],
    reference: Reference,
    points: ReferencePoints,
    options: OrientationOptions,
    work: Work,
) -> OrientedPhoto | Failure:
    """The orientation of a photo from the hypothesis that is least likely chance."""
    options = sure_of(len(starts), options)
    best: OrientedPhoto | Failure = Failure("it was not tried")
    for number, start in enumerate(starts):
        rng = work.random(start.photo.photo_id, str(number))
        best = likelier(best, orient_photo(start, reference, points, options, rng))
        if isinstance(best, OrientedPhoto) and best.log10_e_value > BEYOND_DOUBT:
            break
    return best


def likelier(
    one: OrientedPhoto | Failure, other: OrientedPhoto | Failure
) -> OrientedPhoto | Failure:
    """The one of two results that is less likely chance; the later of two failures."""
    if isinstance(one, Failure):
        return other
    if isinstance(other, Failure):
        return one
    return max(one, other, key=lambda result: result.log10_e_value)


def placements_of(photo_id: str, parts: tuple[PlacedBlock, ...]) -> tuple[Placement, ...]:
    """Where a photo may lie, likeliest first; none when nothing is tied to it."""
    return next((part.placements[photo_id] for part in parts if photo_id in part.placements), ())


def _is_held(
    photo_id: str, parts: tuple[PlacedBlock, ...], oriented: Mapping[str, OrientedPhoto | Failure]
) -> bool:
    """Whether a photo stands, or is tied to one that does."""
    names = next((part.photo_ids for part in parts if photo_id in part.photo_ids), ())
    return any(isinstance(oriented.get(name), OrientedPhoto) for name in names)
