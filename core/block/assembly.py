"""The block stands up: photos on the reference, photos carried by ties, control made sure of."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from core.arrays import locked
from core.block.adjusted import AdjustmentOptions, AdjustmentReport
from core.block.adjustment import adjust_block
from core.block.block import Block, Measurement, Photo, Source
from core.block.control import ControlOptions, measurements_of, surveyed_of, with_proposals
from core.block.datum import DatumOptions, lay_on_reference
from core.block.orientation import OrientationOptions, OrientedPhoto, ReferencePoints
from core.block.patches import OpenPhoto, object_on_ground
from core.block.placement import prior_covariance
from core.doubts import Doubt, Failure
from core.errors import OrientationError
from core.geometry.consensus import Candidates, ConsensusOptions
from core.geometry.resection import PhotoModel, Resection, resect_photo
from core.progress import Progress, Silent
from core.reference.reference import Reference
from core.scan.raster import ScanFile

MIN_TIES = 8
GROSS = 3.5
"""A control point is left out when its ground correction exceeds this many standard deviations."""


@dataclass(frozen=True, slots=True)
class AssemblyOptions:
    """Rounds of searching and adjusting."""

    rounds: int = 3
    """How often control is searched from the adjusted block."""
    first_control_m: float = 6.0
    """Standard deviation of the single photos' own control while the ties bring them together:
    it may be wrong together, and must not bend the block."""
    orientation: OrientationOptions = field(default_factory=OrientationOptions)
    """Sizes of the templates."""
    datum: DatumOptions = field(default_factory=DatumOptions)
    """How the whole block is laid on the reference."""
    control: ControlOptions = field(default_factory=ControlOptions)
    """Limits of proposals."""
    adjustment: AdjustmentOptions = field(default_factory=AdjustmentOptions)
    """The adjustment."""


@dataclass(frozen=True, slots=True, eq=False)
class Assembly:
    """A block that stands, and what is doubtful about it."""

    report: AdjustmentReport
    """The adjustment; its block has all proposals with their status."""
    doubts: tuple[Doubt, ...]
    """Photos left out, photos carried by ties alone."""


@dataclass(frozen=True, slots=True, eq=False)
class Site:
    """All that the rounds look at and that stays the same."""

    reference: Reference
    """Ortho and heights."""
    scans: Mapping[str, ScanFile]
    """Scans by photo."""
    points: ReferencePoints
    """Junctions and salient points."""
    sources: Mapping[str, Source]
    """Where each point comes from."""


def assemble_block(
    block: Block,
    site: Site,
    oriented: Mapping[str, OrientedPhoto | Failure],
    options: AssemblyOptions,
    rng: np.random.Generator,
    mapper: Callable[..., Iterable[Any]] = map,
    progress: Progress | None = None,
) -> Assembly:
    """Bring the photos together and propose control anew until the block agrees with itself.

    Args:
        block: Photos with approximate orientations, and the tie points.
        site: Reference, scans and reference points.
        oriented: What the single photos found.
        options: Limits.
        rng: Source of the samples.
        mapper: Runs a function over photos, such as the `map` of a thread pool.
        progress: Told after every round.

    Raises:
        OrientationError: No photo stands on the reference.
    """
    watch = progress or Silent()
    standing, doubts = stood_up(block, site, oriented, rng)
    watch.report(0, options.rounds + 2, "ties")
    standing = held_together(standing, site, oriented, options)
    watch.report(1, options.rounds + 2, "datum")
    laid = lay_on_reference(
        standing,
        site.scans,
        site.reference,
        site.points,
        options.orientation,
        options.datum,
        rng,
        mapper,
    )
    if isinstance(laid, Failure):
        doubts = (*doubts, Doubt("datum", "block", laid.reason, 0.9, laid.evidence))
    else:
        standing = laid
    report = None
    for turn in range(options.rounds):
        watch.report(turn + 2, options.rounds + 2, "control")
        proposed = proposals(standing, site, options, mapper)
        standing = with_proposals(standing, site.points, site.sources, proposed)
        report = adjusted_without_gross(standing, options.adjustment)
        standing = report.block
    assert report is not None
    return Assembly(report, doubts)


def stood_up(
    block: Block,
    site: Site,
    oriented: Mapping[str, OrientedPhoto | Failure],
    rng: np.random.Generator,
) -> tuple[Block, tuple[Doubt, ...]]:
    """Photos with their first orientations: found on the reference, or carried by ties."""
    photos = dict(block.photos)
    for photo_id, found in oriented.items():
        if isinstance(found, OrientedPhoto):
            photos[photo_id] = photos[photo_id].with_exterior(found.exterior, oriented=True)
    if not any(photo.oriented for photo in photos.values()):
        raise nothing_stands(block, oriented)
    doubts: list[Doubt] = []
    waiting = [name for name, photo in photos.items() if not photo.oriented]
    for photo_id in sorted(waiting):
        carried = carried_by_ties(block.with_photos(photos), photo_id, site, rng)
        failure = oriented.get(photo_id)
        why = failure.reason if isinstance(failure, Failure) else "it was not tried"
        if isinstance(carried, Photo):
            photos[photo_id] = carried
            said, gravity = "it is carried by tie points to its neighbours", 0.5
        else:
            said, gravity = f"it is left out: {carried.reason}", 0.9
        message = f"Photo {photo_id} did not stand on the reference ({why}); {said}."
        doubts.append(Doubt("photo-orientation", photo_id, message, gravity))
    return block.with_photos(photos), tuple(doubts)


def nothing_stands(
    block: Block, oriented: Mapping[str, OrientedPhoto | Failure]
) -> OrientationError:
    """The error of a block without a single photo on the reference, with the first one's reason."""
    first, count = min(block.photos), len(block.photos)
    failure = oriented.get(first)
    why = failure.reason.rstrip(".") if isinstance(failure, Failure) else "it was not tried"
    return OrientationError(
        block.photos[first].scan,
        f"neither this photo ({why}) nor any other of {count} stands on the reference ortho."
        if count > 1
        else f"the photo does not stand on the reference ortho: {why}.",
        "Check that ortho, DEM and roads cover the photos and that no mask hides them; then the "
        "georeference, the principal distance and the scan pixel size.",
    )


def held_together(
    block: Block,
    site: Site,
    oriented: Mapping[str, OrientedPhoto | Failure],
    options: AssemblyOptions,
) -> Block:
    """Adjust by the ties, with what the single photos agreed on as very weak control.

    Without ties, or where the adjustment does not converge, the photos stay as they are.
    """
    if block.ties.count < MIN_TIES:
        return block
    weak = replace(site.points, sigma_m=np.full_like(site.points.sigma_m, options.first_control_m))
    surveyed = surveyed_of(weak, site.sources)
    measured = [
        agreed_measurement(photo_id, site.points, found, int(point))
        for photo_id, found in oriented.items()
        if isinstance(found, OrientedPhoto) and block.photos[photo_id].oriented
        for point in found.agreeing
    ]
    first = replace(
        block,
        surveyed={name: surveyed[name] for name in {value.point_id for value in measured}},
        measurements={value.key: value for value in measured},
    )
    report = adjust_block(first, replace(options.adjustment, robust=False))
    return block.with_photos(report.block.photos) if report.converged else block


def agreed_measurement(
    photo_id: str, points: ReferencePoints, found: OrientedPhoto, point: int
) -> Measurement:
    """The best candidate of a point on which a single photo agreed."""
    match = next(match for match in found.found if match.point == point)
    peak = match.peaks[0]
    return Measurement(points.ids[point], photo_id, peak.column, peak.row, 2 * peak.sigma_px)


def carried_by_ties(
    block: Block, photo_id: str, site: Site, rng: np.random.Generator
) -> Photo | Failure:
    """Resect a photo on tie points that oriented neighbours see, laid on the reference heights."""
    ties, photo, camera = block.ties, block.photos[photo_id], block.camera_of(photo_id)
    if photo_id not in ties.photo_ids:
        return Failure("it has no tie points")
    own = ties.photo == ties.photo_ids.index(photo_id)
    ground: dict[int, np.ndarray] = {}
    for index, name in enumerate(ties.photo_ids):
        neighbour = block.photos[name]
        rays = (ties.photo == index) & np.isin(ties.point, ties.point[own])
        if name == photo_id or not neighbour.oriented or not rays.any():
            continue
        places = object_on_ground(
            neighbour, block.camera_of(name), ties.pixels[rays], site.reference.dem
        )
        ground.update(dict(zip(ties.point[rays].tolist(), places, strict=True)))
    rays = np.nonzero(own)[0]
    rays = rays[[int(ties.point[ray]) in ground for ray in rays]]
    points = np.array([ground[int(ties.point[ray])] for ray in rays]).reshape(-1, 3)
    seen = np.all(np.isfinite(points), axis=1)
    if seen.sum() < MIN_TIES:
        return Failure(f"only {int(seen.sum())} tie points to photos that stand")
    candidates = tie_candidates(ties.pixels[rays[seen]], photo)
    model = PhotoModel(photo.interior, camera, photo.atmosphere)
    result = resect_photo(
        model,
        photo.exterior,
        prior_covariance(photo),
        points[seen],
        candidates,
        ConsensusOptions(gate=4.0),
        rng,
    )
    if isinstance(result, Resection):
        return photo.with_exterior(result.exterior, oriented=True)
    return result


def tie_candidates(pixels: np.ndarray, photo: Photo) -> Candidates:
    """Tie points as candidates: one a point, found anywhere in the photo."""
    count = len(pixels)
    area = float(photo.size_px[0] * photo.size_px[1])
    return Candidates(
        np.arange(count),
        locked(pixels),
        np.full(count, 4.0),
        np.ones(count),
        np.ones(count),
        np.full(count, 1.0 / area),
    )


def proposals(
    block: Block,
    site: Site,
    options: AssemblyOptions,
    mapper: Callable[..., Iterable[Any]],
) -> tuple[Measurement, ...]:
    """Search the reference points in every oriented photo."""

    def searched(photo: Photo) -> tuple[Measurement, ...]:
        opened = OpenPhoto(photo, block.cameras[photo.camera], site.scans[photo.photo_id])
        return measurements_of(
            opened, site.reference, site.points, options.orientation, options.control
        )

    photos = [photo for photo in block.photos.values() if photo.oriented]
    return tuple(value for values in mapper(searched, photos) for value in values)


def adjusted_without_gross(block: Block, options: AdjustmentOptions) -> AdjustmentReport:
    """Adjust, leave out control whose ground position the block contradicts, adjust again."""
    report = adjust_block(block, options)
    for _ in range(4):
        gross = gross_points(report)
        rejected = set(report.rejected)
        changed = {
            key: replace(value, status="unused", reason=why)
            for key, value in block.measurements.items()
            if value.status == "auto" and (why := gross.get(key[0], report.rejected.get(key, "")))
        }
        if not gross and not rejected:
            break
        block = replace(
            block,
            photos=report.block.photos,
            cameras=block.cameras,
            measurements={**block.measurements, **changed},
        )
        report = adjust_block(block, options)
    return report


def gross_points(report: AdjustmentReport) -> dict[str, str]:
    """Control points that the block moves further than their accuracy allows, worst tenth first."""
    sizes: dict[str, float] = {}
    for name, position in report.surveyed_positions.items():
        point = report.block.surveyed[name]
        if point.source != "surveyed":
            moved = (position - point.position)[:2] / point.sigma_m[:2]
            sizes[name] = float(np.hypot(*moved)) / np.sqrt(2)
    gross = sorted((name for name in sizes if sizes[name] > GROSS), key=lambda name: -sizes[name])
    worst = gross[: max(1, len(sizes) // 10)]
    return {
        name: f"the block contradicts its ground position ({sizes[name]:.1f} sigma)"
        for name in worst
    }
