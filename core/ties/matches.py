"""Matches of two photos: similar features that satisfy the relative orientation."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32
from scipy.spatial import KDTree

from core.arrays import Flags, Indices, PixelPoints, Scalars, locked
from core.block import Photo
from core.doubts import Failure
from core.geometry.camera import Camera
from core.geometry.collinearity import ideal_from_film
from core.geometry.relative import (
    OrientedPair,
    RayPairs,
    Rays,
    RelativeOptions,
    orient_relative,
    rays_from_ideal,
    relative_from_exteriors,
)
from core.geometry.transforms import apply_projectivity, fit_projectivity
from core.said import say
from core.ties.features import Features

Squares = Float32[np.ndarray, "_"]
"""Squared distances of descriptions."""
SAME_PHOTO = "same_photo"
"""Evidence of a refusal: so many matches that stay where they are."""
RELATIVE = RelativeOptions()
"""The geometric check."""

RATIO = 0.8  # source: Lowe 2004, section 7.1
"""The best distance over the second best must be below this, in both directions."""
BLOCK_ROWS = 256  # design: time; 16 MB beside a scan of 16,000 features stay in the cache
"""Features compared at a time."""
NEIGHBOURS = 10  # design: their median stands while four of them are wrong
"""A match must lie as this many matches about it."""
# design: relief moves neighbours by pixels: trees of 20 m at 1:15,000 and 100 um by five
UNLIKE_NEIGHBOURS_PX = 12.0
"""A match goes when off the median of its neighbours by more than this (reduced pixels) ..."""
UNLIKE_NEIGHBOURS = 6.0  # design: beyond any tail of relief; ground that is rough decides itself
"""... and by more than this many median deviations."""
STILL_MM = 1.0  # design: photos of one flight move by a tenth of the frame and more
"""A match that lies in the same place of both films is no ground: marks, notes, scratches of
the camera; three times as much where no fiducials tell where the film lies."""
SAME_SHARE = 0.15  # design: marks, notes and dust alone are far fewer, two scans share most
"""Two scans show the same photo when so many of the features of one stay in their place on the
film of the other."""


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """Features of two scans that belong together, as parallel arrays."""

    first: Indices
    """Index of the first photo's feature."""
    second: Indices
    """Index of the second photo's feature."""
    ratio: Scalars
    """Best over second best distance, the worse of both directions: small is distinct."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "first", locked(self.first, np.int64))
        object.__setattr__(self, "second", locked(self.second, np.int64))
        object.__setattr__(self, "ratio", locked(self.ratio))

    def chosen(self, which: Flags) -> "Matches":
        """Some of them."""
        return Matches(self.first[which], self.second[which], self.ratio[which])


@dataclass(frozen=True, slots=True, eq=False)
class VerifiedMatches:
    """The matches of a pair that stood the geometric check."""

    matches: Matches
    """The matches that agree."""
    parallax_px: Scalars
    """y-parallax of each, scan pixels (scaled so that noise of 1 px per coordinate gives 1)."""
    pair: OrientedPair
    """The relative orientation and its evidence, over all candidate matches."""

    @property
    def parallax_rms_px(self) -> float:
        """Root mean square of the y-parallaxes."""
        return float(np.sqrt(np.mean(self.parallax_px**2)))

    def in_whole(self, first: np.ndarray, second: np.ndarray) -> "VerifiedMatches":
        """The same when the features were only the given ones of a whole scan."""
        found = self.matches
        whole = Matches(first[found.first], second[found.second], found.ratio)
        return VerifiedMatches(whole, self.parallax_px, self.pair)


def match_features(first: Features, second: Features, block_rows: int = BLOCK_ROWS) -> Matches:
    """Features that are each other's nearest, and clearly nearer than the second nearest.

    Distances are exact: descriptions are whole numbers whose products stay below 2^24, so the
    result does not depend on the order in which a BLAS adds.
    """
    count = len(first.pixels)
    if count < 2 or len(second.pixels) < 2:
        none = np.zeros(0, dtype=np.int64)
        return Matches(none, none, np.zeros(0))
    theirs = _with_squares(second, 1.0)
    # One product gives (a - b)^2 = -2 ab + b^2 + a^2 without another pass over the table.
    theirs[:, -1], ours = 1.0, _with_squares(first, -2.0)
    ours[:, -2] = 1.0
    transposed = np.ascontiguousarray(theirs.T)
    chosen = np.empty(count, dtype=np.int64)
    best, runner_up = np.empty((2, count), dtype=np.float32)
    unchosen = np.full(len(theirs), np.inf, dtype=np.float32)
    for start in range(0, count, block_rows):
        distance = ours[start : start + block_rows] @ transposed
        block, rows = slice(start, start + len(distance)), np.arange(len(distance))
        chosen[block] = distance.argmin(axis=1)
        best[block] = distance[rows, chosen[block]]
        distance[rows, chosen[block]] = np.inf
        runner_up[block] = distance.min(axis=1)
        np.minimum(unchosen, distance.min(axis=0), out=unchosen)
    return _mutual(chosen, best, runner_up, unchosen)


def _with_squares(features: Features, factor: float) -> Float32[np.ndarray, "n 130"]:
    """Descriptions times a factor, and twice their own square beside them."""
    values = features.described().astype(np.float32)
    square = np.sum(values * values, axis=1)
    return np.column_stack([factor * values, square, square]).astype(np.float32, copy=False)


def _mutual(chosen: Indices, best: Squares, runner_up: Squares, unchosen: Squares) -> Matches:
    """Pairs that choose each other, distinct in both directions.

    Args:
        chosen: For each of our features, the nearest of theirs.
        best: Its squared distance.
        runner_up: That of the second nearest.
        unchosen: For each of theirs, the least squared distance from ours that did not choose it.
    """
    order = np.lexsort((best, chosen))
    again = np.append(chosen[order][1:] == chosen[order][:-1], False)
    first = np.insert(~again[:-1], 0, True)
    after = np.where(again, np.roll(best[order], -1), np.float32(np.inf))[first]
    ours = order[first]
    theirs = np.minimum(after, unchosen[chosen[ours]])
    ratio = np.maximum(_ratio(best[ours], runner_up[ours]), _ratio(best[ours], theirs))
    good = np.flatnonzero(ratio < RATIO)
    good = good[np.argsort(ours[good])]
    return Matches(ours[good], chosen[ours[good]], ratio[good])


def _ratio(best: Squares, second: Squares) -> Scalars:
    """Best over second best distance, of squared distances."""
    # Squared distances are whole numbers; where the second is nought, so is the best.
    wide = np.maximum(second, 1.0).astype(np.float64)
    return np.sqrt(np.maximum(best, 0.0).astype(np.float64) / wide)


def rays_of(photo: Photo, camera: Camera, pixels: PixelPoints) -> Rays:
    """Rays in image space of scan pixels, with lens and refraction undone."""
    film = photo.interior.film_from_pixel(pixels)
    ideal = ideal_from_film(film, camera, photo.atmosphere)
    return rays_from_ideal(ideal, camera.principal_distance_mm)


def ray_pairs(
    photos: tuple[Photo, Photo],
    cameras: tuple[Camera, Camera],
    first: PixelPoints,
    second: PixelPoints,
    *,
    reduction: int = 1,
) -> RayPairs:
    """Rays of scan pixels of two photos; parallaxes will be in pixels of the reduced scan."""
    angles = [
        photo.interior.pixel_size_mm / camera.principal_distance_mm * reduction
        for photo, camera in zip(photos, cameras, strict=True)
    ]
    return RayPairs(
        rays_of(photos[0], cameras[0], first),
        rays_of(photos[1], cameras[1], second),
        (angles[0], angles[1]),
    )


def verify_matches(
    photos: tuple[Photo, Photo],
    cameras: tuple[Camera, Camera],
    features: tuple[Features, Features],
    matches: Matches,
    *,
    rng: np.random.Generator,
) -> VerifiedMatches | Failure:
    """Keep the matches that agree with one relative orientation and with their neighbours."""
    still = _still(photos, features, matches)
    if _same_photo(features, still):
        reason = "They are two scans of one photo: nothing moves from one to the other."
        return Failure(reason, {SAME_PHOTO: float(still.sum(axis=1).max())})
    matches = matches.chosen(~still[0])
    first = features[0].pixels[matches.first]
    second = features[1].pixels[matches.second]
    # Tolerances hold at the scale of matching; the larger reduction of the two decides.
    reduction = max(features[0].reduction, features[1].reduction)
    found = orient_relative(
        ray_pairs(photos, cameras, first, second, reduction=reduction),
        _window(features[1].pixels, reduction),
        relative_from_exteriors(photos[0].exterior, photos[1].exterior),
        RELATIVE,
        rng=rng,
    )
    if isinstance(found, Failure):
        return found
    kept = np.flatnonzero(found.agrees)
    like = like_neighbours(first[kept] / reduction, second[kept] / reduction)
    kept = kept[like]
    if len(kept) < RELATIVE.min_inliers:
        reason = say(
            "Only {count} of {all} matches lie as their neighbours do.",
            count=len(kept),
            all=len(matches.first),
        )
        return Failure(reason, {"matches": len(matches.first), "agreeing": len(kept)})
    flags = np.zeros(len(matches.first), dtype=np.bool_)
    flags[kept] = True
    return VerifiedMatches(matches.chosen(flags), found.parallax_px[flags] * reduction, found)


def like_neighbours(first: PixelPoints, second: PixelPoints) -> Flags:
    """True for matches that are moved as those about them.

    Coplanarity is blind along the epipolar line; terrain is not: after a projectivity over the
    whole pair, what is left is relief, which changes slowly from match to match.
    """
    if len(first) <= NEIGHBOURS:
        return np.ones(len(first), dtype=np.bool_)
    left: PixelPoints = second - apply_projectivity(fit_projectivity(first, second), first)
    _, about = KDTree(first).query(first, k=NEIGHBOURS + 1)
    usual = np.median(left[np.asarray(about)[:, 1:]], axis=1)
    off = np.linalg.norm(left - usual, axis=1)
    limit = max(UNLIKE_NEIGHBOURS_PX, UNLIKE_NEIGHBOURS * float(np.median(off)))
    return off <= limit


def _still(
    photos: tuple[Photo, Photo], features: tuple[Features, Features], matches: Matches
) -> Bool[np.ndarray, "turns matches"]:
    """Matches that stay in their place on the film, laid upon each other in each quarter turn."""
    here = photos[0].interior.film_from_pixel(features[0].pixels[matches.first])
    there = photos[1].interior.film_from_pixel(features[1].pixels[matches.second])
    unsure = any(photo.interior.model == "nominal" for photo in photos)
    turned = [there, there[:, ::-1] * [-1, 1], -there, there[:, ::-1] * [1, -1]]
    apart = np.linalg.norm(here - np.stack(turned), axis=2)
    return apart <= STILL_MM * (3.0 if unsure else 1.0)


def _same_photo(
    features: tuple[Features, Features], still: Bool[np.ndarray, "turns matches"]
) -> bool:
    """True when the greater part of the matches, and a good part of all features, stays."""
    staying = int(still.sum(axis=1).max(initial=0))
    fewer = min(len(side.pixels) for side in features)
    enough = max(RELATIVE.min_inliers, SAME_SHARE * fewer)
    return staying >= enough and 2 * staying > still.shape[1]


def _window(pixels: PixelPoints, reduction: int) -> tuple[float, float]:
    """Sides of the area the features cover, reduced pixels."""
    extent = np.ptp(pixels, axis=0) / reduction if len(pixels) else np.ones(2)
    return float(extent[0]), float(extent[1])
