"""Initial orientation: which photos are found on the reference, and which are carried by ties."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.arrays import Indices, ObjectPoints, PixelPoints, locked
from core.block import Block, ExteriorPrior, Measurement, Photo, Source, SurveyedPoint
from core.doubts import Doubt, Failure
from core.errors import OrientationError
from core.geometry.consensus import Candidates, ConsensusOptions
from core.geometry.exterior import ExteriorOrientation
from core.geometry.resection import PhotoModel, Resection, resect_photo
from core.geometry.transforms import fit_similarity, rotation_and_scale
from core.localisation.block_placement import prior_covariance
from core.localisation.photo_orientation import OrientedPhoto
from core.matching.patches import object_on_ground
from core.matching.reference import Reference
from core.raster.scan_file import ScanFile
from core.reference.stage import ReferencePoints
from core.said import say

# design: twice what a resection needs to be checked by each of its points.
MIN_TIES = 8
"""With fewer tie points no photo is carried or contradicted."""
# design: tilts of a degree, which single photos of little relief do not see, add up to this.
APART = 0.02
"""Two photos contradict each other when the same details lie further apart on the ground than this
share of the flying height: more than two single photos on one reference ever do."""
# design: photos called vertical are tilted by less, as a rule.
TILT_SIGMA = float(np.radians(4.0))
# design: two neighbours that stand by themselves are off by some pixels each.
CARRIED_SIGMA_PX = 6.0
"""How well a tie point on the reference heights is known in the photo it carries, scan pixels."""


# design: crowns lean and shadows turn together by this much, so that single photos may be wrong
# together; they must not bend the block.
WEAK_M = 6.0
"""Standard deviation of what single photos agree on while ties bring them together, metres."""
# design: peaks of a first pass are broader than those of control, and shared errors hide in them.
WEAK_SCALE = 2.0
"""Their measurements count with so many times the standard deviation that their peaks have."""


@dataclass(frozen=True, slots=True, eq=False)
class WeakControl:
    """Points that single photos agreed on."""

    surveyed: Mapping[str, SurveyedPoint]
    """The points by name."""
    measurements: tuple[Measurement, ...]
    """Where the photos show them."""

    @staticmethod
    def none() -> "WeakControl":
        """No such points."""
        return WeakControl({}, ())


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


def stand_up(
    block: Block,
    site: Site,
    oriented: Mapping[str, OrientedPhoto | Failure],
    rng: np.random.Generator,
) -> tuple[Block, tuple[Doubt, ...]]:
    """Photos with their first orientations, and a doubt for each that did not stand by itself.

    Raises:
        OrientationError: No photo stands on the reference.
    """
    why = {name: found.reason for name, found in oriented.items() if isinstance(found, Failure)}
    placed = {
        name: photo.with_exterior(found.exterior, oriented=True)
        if isinstance(found := oriented.get(name), OrientedPhoto)
        else photo
        for name, photo in block.photos.items()
    }
    standing = block.with_photos(placed)
    for name in contradicted(standing, site, oriented):
        why[name] = "where it seemed to lie, its tie points contradict the other photos"
        standing = standing.with_photos(
            {**standing.photos, name: replace(block.photos[name], oriented=False)}
        )
    if not any(photo.oriented for photo in standing.photos.values()):
        raise nothing_stands(block, oriented)
    return carry_the_rest(standing, site, why, rng)


def nothing_stands(
    block: Block, oriented: Mapping[str, OrientedPhoto | Failure]
) -> OrientationError:
    """The error of a block without a single photo on the reference, with the first one's reason."""
    first, count = min(block.photos), len(block.photos)
    failure = oriented.get(first)
    why = failure.reason if isinstance(failure, Failure) else "it was not tried"
    return OrientationError(
        block.photos[first].scan,
        say(
            "neither this photo ({why}) nor any other of {count} stands on the reference ortho.",
            why=why,
            count=count,
        )
        if count > 1
        else say("the photo does not stand on the reference ortho: {why}.", why=why),
        "Check that ortho, DEM and roads cover the photos and that no mask hides them; then the "
        "principal distance and the scan pixel size. If all is right, click two places far apart "
        "in one photo: gruber review shows it beside the ortho (a .points file of the QGIS "
        "Georeferencer does as well). Tie points carry them to the others.",
    )


def contradicted(
    block: Block, site: Site, oriented: Mapping[str, OrientedPhoto | Failure]
) -> list[str]:
    """Photos whose tie points lie elsewhere than in most of their neighbours, worst first."""
    standing = [name for name, photo in block.photos.items() if photo.oriented]
    ground = {name: ties_on_ground(block, name, site) for name in standing}
    against: dict[str, set[str]] = {name: set() for name in standing}
    for one, other in combinations(standing, 2):
        shared = sorted(set(ground[one]) & set(ground[other]))
        if len(shared) >= MIN_TIES:
            apart = np.array([ground[one][tie] - ground[other][tie] for tie in shared])[:, :2]
            photo = block.photos[one]
            limit = APART * (float(photo.exterior.centre[2]) - photo.ground_height_m)
            if float(np.median(np.hypot(*apart.T))) > limit:
                against[one].add(other)
                against[other].add(one)
    removed: list[str] = []
    while any(against.values()):
        worst = max(
            against, key=lambda name: (len(against[name]), -e_value_of(oriented, name), name)
        )
        for other in against.pop(worst):
            against[other].discard(worst)
        removed.append(worst)
    return removed


def e_value_of(oriented: Mapping[str, OrientedPhoto | Failure], name: str) -> float:
    """How far a photo's own orientation is beyond chance: log10 of its e-value."""
    found = oriented.get(name)
    return found.log10_e_value if isinstance(found, OrientedPhoto) else 0.0


def carry_the_rest(
    block: Block, site: Site, why: Mapping[str, str], rng: np.random.Generator
) -> tuple[Block, tuple[Doubt, ...]]:
    """Carry photos by their ties to those that stand, until no more can be."""
    waiting = sorted(name for name, photo in block.photos.items() if not photo.oriented)
    doubts: list[Doubt] = []
    reasons: dict[str, str] = {}
    carried = True
    while carried:
        carried = False
        for name in [name for name in waiting if not block.photos[name].oriented]:
            result = carried_by_ties(block, name, site, rng)
            if isinstance(result, Photo):
                block = block.with_photos({**block.photos, name: result})
                carried = True
            else:
                reasons[name] = result.reason
    for name in waiting:
        if block.photos[name].oriented:
            said, gravity = "it is carried by tie points to its neighbours", 0.5
        else:
            # design: graver than a photo that is carried: nothing of it is used.
            said, gravity = say("it is left out: {reason}", reason=reasons[name]), 0.9
        own = why.get(name, "it was not tried")
        message = say(
            "Photo {name} did not stand on the reference ({own}); {said}.",
            name=name,
            own=own,
            said=said,
        )
        doubts.append(Doubt("photo-orientation", name, message, gravity))
    return block, tuple(doubts)


def ties_on_ground(block: Block, photo_id: str, site: Site) -> dict[int, np.ndarray]:
    """Where the tie points of one photo lie on the reference heights, by tie point."""
    ties = block.ties
    if photo_id not in ties.photo_ids:
        return {}
    rays = ties.photo == ties.photo_ids.index(photo_id)
    places = object_on_ground(
        block.photos[photo_id], block.camera_of(photo_id), ties.pixels[rays], site.reference.dem
    )
    seen = np.all(np.isfinite(places), axis=1)
    return dict(zip(ties.point[rays][seen].tolist(), places[seen], strict=True))


def carried_by_ties(
    block: Block, photo_id: str, site: Site, rng: np.random.Generator
) -> Photo | Failure:
    """Resect a photo on tie points that oriented neighbours see, laid on the reference heights."""
    ties = block.ties
    if photo_id not in ties.photo_ids:
        return Failure("it has no tie points")
    ground: dict[int, np.ndarray] = {}
    for name, neighbour in block.photos.items():
        if neighbour.oriented and name != photo_id:
            ground.update(ties_on_ground(block, name, site))
    own: Indices = np.nonzero(ties.photo == ties.photo_ids.index(photo_id))[0]
    own = own[[int(ties.point[ray]) in ground for ray in own]]
    if len(own) < MIN_TIES:
        return Failure(say("only {count} tie points to photos that stand", count=len(own)))
    points = np.array([ground[int(ties.point[ray])] for ray in own])
    start = vertical_over(block, photo_id, ties.pixels[own], points)
    if isinstance(start, Failure):
        return start
    camera = block.camera_of(photo_id)
    result = resect_photo(
        PhotoModel(start.interior, camera, start.atmosphere),
        start.exterior,
        prior_covariance(start),
        points,
        candidates=tie_candidates(ties.pixels[own], start),
        options=ConsensusOptions(gate=4.0),
        rng=rng,
    )
    if isinstance(result, Resection):
        return block.photos[photo_id].with_exterior(result.exterior, oriented=True)
    return result


def vertical_over(
    block: Block, photo_id: str, pixels: PixelPoints, points: ObjectPoints
) -> Photo | Failure:
    """The photo as a vertical one that sees the points where it does, with a prior to match."""
    photo, camera = block.photos[photo_id], block.camera_of(photo_id)
    film = photo.interior.film_from_pixel(pixels) - np.array(camera.principal_point_mm)
    fitted = fit_similarity(film, np.ascontiguousarray(points[:, :2]))
    if isinstance(fitted, Failure):
        return fitted
    kappa, metres_per_mm = rotation_and_scale(fitted.matrix)
    above = camera.principal_distance_mm * metres_per_mm
    height = float(np.mean(points[:, 2]))
    centre = np.array([fitted.matrix[0, 2], fitted.matrix[1, 2], height + above])
    sigma = TILT_SIGMA * above
    prior = ExteriorPrior(np.full(3, sigma), np.full(3, TILT_SIGMA))
    exterior = ExteriorOrientation(centre, 0.0, 0.0, kappa)
    return replace(photo, exterior=exterior, prior=prior)


def tie_candidates(pixels: PixelPoints, photo: Photo) -> Candidates:
    """Tie points as candidates: one a point, found anywhere in the photo."""
    count = len(pixels)
    area = float(photo.size_px[0] * photo.size_px[1])
    return Candidates(
        np.arange(count),
        locked(pixels),
        np.full(count, CARRIED_SIGMA_PX),
        np.ones(count),
        np.ones(count),
        np.full(count, 1.0 / area),
    )


def weak_control(
    block: Block,
    oriented: Mapping[str, OrientedPhoto | Failure],
    points: ReferencePoints,
    sources: Mapping[str, Source],
) -> WeakControl:
    """What the photos that stand by themselves agreed on.

    Args:
        block: The block; photos that do not stand have no say.
        oriented: What each photo found by itself.
        points: The reference points, in the order in which `oriented` counts them.
        sources: Where each comes from.
    """
    measurements = tuple(
        Measurement(points.ids[point], photo_id, peak.column, peak.row, WEAK_SCALE * peak.sigma_px)
        for photo_id, result in oriented.items()
        if isinstance(result, OrientedPhoto) and block.photos[photo_id].oriented
        for point, peak in zip(result.agreeing.tolist(), result.agreed, strict=True)
    )
    rows = {name: row for row, name in enumerate(points.ids)}
    surveyed = {
        name: SurveyedPoint(
            name, points.positions[rows[name]], np.full(3, WEAK_M), "control", sources[name]
        )
        for name in sorted({value.point_id for value in measurements})
    }
    return WeakControl(surveyed, measurements)


def join_photos(block: Block, weak: WeakControl, options: AdjustmentOptions) -> Block:
    """Adjust by the ties with weak control.

    Without ties, or where the adjustment does not converge, the photos stay as they are.
    """
    if block.ties.count < MIN_TIES:
        return block
    first = replace(
        block,
        surveyed=weak.surveyed,
        measurements={value.key: value for value in weak.measurements},
    )
    report = adjust_block(first, replace(options, robust=False))
    if not report.converged:
        return block
    # A certificate holds until control is found; a camera nobody knows is told by the block alone.
    told = {
        name: camera
        for name, camera in report.block.cameras.items()
        if camera.sigma_principal_distance_mm
    }
    return replace(block, photos=report.block.photos, cameras={**block.cameras, **told})
