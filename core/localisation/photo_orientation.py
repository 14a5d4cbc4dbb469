"""One photo oriented on the reference: placed, then resected in passes of growing sharpness."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from core.arrays import Indices, Matrix, ObjectPoints, Scalars
from core.block import Peak
from core.doubts import Failure
from core.geometry.consensus import ConsensusOptions
from core.geometry.exterior import ExteriorOrientation
from core.geometry.resection import PhotoModel, Resection, resect_photo
from core.localisation.block_placement import NARROW, WIDE, Placement, PlacementOptions, place_photo
from core.matching.local_search import (
    MATCH_FLOOR_PX,
    Found,
    MatchingOptions,
    candidates_of,
    match_points,
    predict_pixels,
    reduction_for,
)
from core.matching.operators import USUAL, Operator
from core.matching.patches import OpenPhoto
from core.matching.reference import Reference
from core.progress import Progress
from core.reference.stage import ReferencePoints


@dataclass(frozen=True, slots=True)
class OrientationOptions:
    """The passes over one photo."""

    # design: time; a frame of 1 km is seen in metres, as roads are.
    coarse_width_px: int = 1400
    """Width of the photo in pixels in the first pass."""
    # design: a crossing with the fields about it.
    coarse_template_half_px: int = 45
    """Half the template of the first pass, pixels of that pass."""
    # design: as much ground as the coarse one has, and more of it where pixels are finer.
    template_half_px: int = 60
    """Half the template of the later passes, pixels of that pass."""
    # design: half a crown, and the shadow of a tree at noon.
    crown_shift_m: float = 6.0
    """Standard deviation of what woods and shadows do to the first pass, metres: crowns lean and
    shadows turn with the hour, all the same way, so that no covariance tells of it."""
    operators: tuple[Operator, ...] = USUAL
    """What is compared in all passes."""
    # design: film of these scales resolves no more.
    finest_gsd_m: float = 0.35
    """Finer detail than this is grain rather than ground."""
    placements: tuple[PlacementOptions, ...] = (NARROW, WIDE)
    """The searches before the first pass, until one leads to an orientation."""
    resection: ConsensusOptions = field(
        # design: of ten passes that chance agrees with, one moves the photo.
        default_factory=lambda: ConsensusOptions(least_log10_e_value=1.0)
    )
    """The judgement after every fine pass; the coarse one only says where to look finely."""
    # design: of a thousand photos that lie elsewhere one is let through.
    sure_log10_e_value: float = 3.0
    """A photo of which no pass reaches this e-value (log10), shared by all places that were tried,
    is refused."""


@dataclass(frozen=True, slots=True, eq=False)
class OrientedPhoto:
    """A photo that stands on the reference by itself."""

    exterior: ExteriorOrientation
    """Exterior orientation."""
    covariance: Matrix
    """6 x 6 of X, Y, Z (m), omega, phi, kappa (rad)."""
    found: tuple[Found, ...]
    """Candidates of the reference points of the last pass."""
    agreeing: Indices
    """Reference points of which a candidate agrees with the orientation."""
    agreed: tuple[Peak, ...]
    """The candidate of each of them that agrees; not always the best of its point."""
    log10_e_value: float
    """How many times likelier than chance the agreement is (e-value), log10."""


def orient_photo(
    opened: OpenPhoto,
    reference: Reference,
    points: ReferencePoints,
    options: OrientationOptions,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> OrientedPhoto | Failure:
    """Place a photo on the reference and resect it on the reference points.

    Args:
        opened: The photo with its approximate orientation and prior.
        reference: Ortho and heights.
        points: Junctions and salient points.
        options: Passes and limits.
        rng: Source of the samples.
        progress: Told as the work goes on.

    Returns:
        The orientation with all candidates of the last pass, or why none stands.
    """
    failure = Failure("the photo could not be placed on the reference at all")
    for search in options.placements:
        if search.most_turn < float(opened.photo.prior.sigma_angles[2]) / 2:
            continue
        placements = place_photo(opened, reference, search)
        coarse = [
            coarse_pass(opened, reference, placed, points, options, rng) for placed in placements
        ]
        failure = next((found for found in coarse if isinstance(found, Failure)), failure)
        standing = [found for found in coarse if isinstance(found, Resection)]
        if standing:
            best = max(standing, key=lambda found: found.log10_e_value)
            sure = sure_of(len(placements), options)
            oriented = fine_passes(opened, best, reference, points, sure, rng, progress)
            if isinstance(oriented, OrientedPhoto):
                return oriented
            failure = oriented
    return failure


def orient_placed_photo(
    opened: OpenPhoto,
    reference: Reference,
    points: ReferencePoints,
    placements: Sequence[Placement],
    options: OrientationOptions,
    rng: np.random.Generator,
    tried: int = 0,
) -> OrientedPhoto | Failure:
    """Orient a photo that was placed with others, from the first placement on which it stands.

    Args:
        opened: The photo.
        reference: Ortho and heights.
        points: Junctions and salient points.
        placements: Where it may lie, likeliest first.
        options: Settings.
        rng: Source of the samples.
        tried: So many of them were tried before, in vain.
    """
    failure = Failure("its block could not be placed on the reference")
    for placed in placements[tried:]:
        found = coarse_pass(opened, reference, placed, points, options, rng)
        if isinstance(found, Resection):
            sure = sure_of(len(placements), options)
            oriented = fine_passes(opened, found, reference, points, sure, rng, None)
            if isinstance(oriented, OrientedPhoto):
                return oriented
            failure = oriented
        else:
            failure = found
    return failure


def coarse_pass(
    opened: OpenPhoto,
    reference: Reference,
    placed: Placement,
    points: ReferencePoints,
    options: OrientationOptions,
    rng: np.random.Generator,
) -> Resection | Failure:
    """Resect on the reference points at a middle resolution, as far as the placement may be off.

    Whatever agrees best is looked at finely: the evidence is judged when all passes have spoken.
    """
    at_place = opened.at(placed.exterior)
    gsd = max(opened.width_m / options.coarse_width_px, finest_gsd_m(opened, reference, options))
    matching = MatchingOptions(
        reduction=reduction_for(at_place, gsd),
        template_half_px=options.coarse_template_half_px,
        operators=options.operators,
    )
    any_agreement = replace(options.resection, least_log10_e_value=-np.inf)
    first = replace(options, resection=any_agreement)
    outcome, _ = resected(at_place, reference, points, placed.covariance, matching, first, rng)
    return outcome


def sure_of(places: int, options: OrientationOptions) -> OrientationOptions:
    """Options that ask so much more as places were tried: one of them may agree by chance.

    Args:
        places: Number of places from which the photo was oriented.
        options: Those for a single place.
    """
    shared = float(np.log10(max(places, 1)))
    return replace(options, sure_log10_e_value=options.sure_log10_e_value + shared)


def resected(
    opened: OpenPhoto,
    reference: Reference,
    points: ReferencePoints,
    prior: Matrix,
    matching: MatchingOptions,
    options: OrientationOptions,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> tuple[Resection | Failure, tuple[Found, ...]]:
    """One pass: predict, search, resect."""
    prediction = predict_pixels(opened, prior, points.positions, points.sigma_m)
    found = match_points(opened, reference, prediction, matching, progress)
    if not found:
        return Failure("no reference point could be searched in this photo"), ()
    candidates = candidates_of(
        found, ground_sigma_px(opened, points.sigma_m), floor_px=MATCH_FLOOR_PX * matching.reduction
    )
    model = PhotoModel(opened.photo.interior, opened.camera, opened.photo.atmosphere)
    result = resect_photo(
        model,
        opened.photo.exterior,
        prior,
        points.positions,
        candidates=candidates,
        options=options.resection,
        rng=rng,
    )
    return result, tuple(found)


def ground_sigma_px(opened: OpenPhoto, sigma_m: ObjectPoints) -> Scalars:
    """Horizontal standard deviation of reference points in scan pixels."""
    return np.hypot(sigma_m[:, 0], sigma_m[:, 1]) / np.sqrt(2) / opened.ground_pixel_m


def fine_passes(
    opened: OpenPhoto,
    start: Resection,
    reference: Reference,
    points: ReferencePoints,
    options: OrientationOptions,
    rng: np.random.Generator,
    progress: Progress | None,
) -> OrientedPhoto | Failure:
    """Resect at the finest resolution that serves, then once closer.

    Where that says nothing more, the orientation of the pass before stands, if any pass is sure.
    """
    reduction = finest_reduction(opened, reference, options)
    result: Resection = start
    found: tuple[Found, ...] = ()
    e_value = start.log10_e_value
    for shift in (options.crown_shift_m, 2.0 * reduction * opened.ground_pixel_m):
        matching = MatchingOptions(
            reduction=reduction,
            template_half_px=options.template_half_px,
            min_search_px=10,
            operators=options.operators,
        )
        at_result = opened.at(result.exterior)
        outcome, seen = resected(
            at_result,
            reference,
            points,
            widened(result.covariance, at_result, shift),
            matching,
            options,
            rng,
            progress,
        )
        if isinstance(outcome, Failure):
            break
        result, found = outcome, seen
        e_value = max(e_value, result.log10_e_value)
    if e_value < options.sure_log10_e_value:
        return Failure(
            "what agreed at first could be chance, and finer detail does not confirm it",
            {"log10_e_value": round(e_value, 2)},
        )
    every = [(match.point, peak) for match in found for peak in match.peaks]
    agreed = [every[candidate] for candidate in result.chosen.tolist()] if found else []
    return OrientedPhoto(
        result.exterior,
        result.covariance,
        found,
        np.array([point for point, _ in agreed], dtype=np.int64),
        tuple(peak for _, peak in agreed),
        e_value,
    )


def finest_reduction(opened: OpenPhoto, reference: Reference, options: OrientationOptions) -> int:
    """Reduction at which scan and ortho both still show ground rather than grain."""
    return reduction_for(opened, finest_gsd_m(opened, reference, options))


def finest_gsd_m(opened: OpenPhoto, reference: Reference, options: OrientationOptions) -> float:
    """The finest ground sample distance that scan and ortho share, metres."""
    return max(
        options.finest_gsd_m, opened.ground_pixel_m, reference.ortho.ground_sample_distance_m
    )


def widened(covariance: Matrix, opened: OpenPhoto, shift_m: float) -> Matrix:
    """A covariance with room for a shift on the ground that the last pass could not know of."""
    above = float(opened.photo.exterior.centre[2]) - opened.photo.ground_height_m
    tilt = 0.5 * shift_m / above
    extra = np.array([shift_m, shift_m, shift_m, tilt, tilt, tilt])
    return 4.0 * covariance + np.diag(extra**2)
