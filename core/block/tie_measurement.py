"""Tie points measured finely on the raw scans, with deviations that the y-parallaxes confirm."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from core.arrays import Flags, Indices, PixelPoints, Scalars
from core.block.block import Block, TiePoints
from core.block.chains import PairKey, common_rays, pair_parallax
from core.block.matches import pixel_angle, rays_of
from core.block.refinement import (
    RefinementOptions,
    local_affinities,
    patch_centres,
    read_patches,
    refine_rays,
)
from core.geometry.relative import RelativeOrientation, adjust_relative
from core.progress import Progress
from core.scan.raster import open_scan

ROBUST = 1.4826
"""Standard deviation over median deviation, normal distribution."""
TRIMMED = 0.7588
"""Mean square of the smaller 95 % of a normal distribution, over its variance."""


@dataclass(frozen=True, slots=True, eq=False)
class PairGeometry:
    """What is known of a pair that has been tied."""

    orientation: RelativeOrientation
    """Relative orientation, second photo in the image space of the first."""
    first: PixelPoints
    """All matches of the pair, scan pixels of the first photo."""
    second: PixelPoints
    """The same in the second photo."""
    parallax_rms_px: float
    """RMS y-parallax of these matches, scan pixels."""


@dataclass(frozen=True, slots=True)
class MeasurementOptions:
    """How tie points are measured and judged."""

    refinement: RefinementOptions = field(default_factory=RefinementOptions)
    """Least squares matching."""
    max_parallax_sigmas: float = 4.0
    """A ray goes when its y-parallax exceeds this many of its own standard deviations ..."""
    max_parallax_px: float = 2.0
    """... or this many pixels of the reduced scan."""
    floor_px: float = 0.005
    """No ray is believed better than this, scan pixels."""


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredTies:
    """Tie points after fine measurement."""

    ties: TiePoints
    """All rays, with new pixels and standard deviations."""
    good: Bool[np.ndarray, "rays"]
    """Rays that may stay."""
    coarse: Bool[np.ndarray, "points"]
    """Points whose fine measurement failed: they rest on their features alone."""


@dataclass(slots=True)
class _Fine:
    """Rays while they are measured."""

    pixels: PixelPoints
    fixed: Indices
    """The ray each ray was matched to; itself for the fixed ray, -1 where matching failed."""
    formal: Scalars
    """Formal deviation of the match, pixels; nought for the fixed ray."""


def measure_ties(
    block: Block,
    ties: TiePoints,
    pairs: Mapping[PairKey, PairGeometry],
    reductions: Mapping[str, int],
    options: MeasurementOptions,
    progress: Progress,
) -> MeasuredTies:
    """Measure every ray finely and say how well.

    In each point one ray is fixed and the others are matched to it. A match's variance is a
    power of the formal one times a factor; both are found from the y-parallaxes of all pairs, so
    that lens and film errors that no stage has modelled yet are in the figure too. It is shared
    equally between the two rays of the match.
    """
    refinement = options.refinement.at_reduction(max(reductions.values(), default=1))
    fine = _match_to_fixed(block, ties, pairs, reductions, refinement, progress)
    measured = replace(ties, pixels=fine.pixels)
    orientations = {
        pair: _adjusted(block, measured, pair, known.orientation, fine)
        for pair, known in pairs.items()
    }
    squares, formal, coarse = _observed_variances(block, measured, orientations, fine)
    if not np.isfinite(coarse):
        # Places that could not be measured finely are worse than features commonly are.
        coarse = 2.0 * float(
            np.median([known.parallax_rms_px for known in pairs.values()] or [0.5])
        )
    sigma = _sigmas(ties, fine, _variance_law(squares, formal), coarse, options)
    measured = replace(measured, sigma_px=sigma)
    failed = np.bincount(ties.point[fine.fixed >= 0], minlength=ties.count) < 2
    # Where matching worked for some rays of a point, those it failed for are not worth keeping.
    good = _bearable(block, measured, orientations, reductions, fine, options)
    return MeasuredTies(measured, good & ((fine.fixed >= 0) | failed[ties.point]), failed)


def _match_to_fixed(
    block: Block,
    ties: TiePoints,
    pairs: Mapping[PairKey, PairGeometry],
    reductions: Mapping[str, int],
    options: RefinementOptions,
    progress: Progress,
) -> _Fine:
    """Choose a fixed ray in each point and match the others to it, photo by photo."""
    fixed = _fixed_rays(block, ties, pairs)
    fine = _Fine(np.array(ties.pixels), np.full(len(ties.point), -1), np.zeros(len(ties.point)))
    fine.fixed[fixed] = fixed
    fine.pixels[fixed] = patch_centres(ties.pixels[fixed])
    work = _work(ties, fixed, pairs)
    cut: dict[int, np.ndarray] = {}
    for done, (photo, other, ours, theirs) in enumerate(work):
        progress.report(
            float(done), float(len(work)), f"measuring tie points of {ties.photo_ids[photo]}"
        )
        for number in (photo, other):
            if number not in cut:
                cut[number] = _cut(block, ties, number, options)
        _match_group(ties, fine, (ours, theirs), (photo, other), cut, pairs, reductions, options)
        needed = {number for entry in work[done + 1 :] for number in entry[:2]}
        cut = {number: patches for number, patches in cut.items() if number in needed}
    progress.report(float(len(work)), float(len(work)), "measuring tie points")
    return fine


def _fixed_rays(block: Block, ties: TiePoints, pairs: Mapping[PairKey, PairGeometry]) -> Indices:
    """The ray of each point that the others are matched to: tied to most of them, then middlemost.

    Returns:
        One ray per point.
    """
    partners = np.zeros(len(ties.point))
    for first, second in pairs:
        ours, theirs = common_rays(ties, ties.photo_ids.index(first), ties.photo_ids.index(second))
        partners[ours] += 1
        partners[theirs] += 1
    off = np.zeros(len(ties.point))
    for number, name in enumerate(ties.photo_ids):
        rays = ties.photo == number
        film = block.photos[name].interior.film_from_pixel(ties.pixels[rays])
        off[rays] = np.linalg.norm(film, axis=1) / np.linalg.norm(block.camera_of(name).frame_mm)
    order = np.lexsort((off, -partners, ties.point))
    _, first_of_point = np.unique(ties.point[order], return_index=True)
    return order[first_of_point]


def _work(
    ties: TiePoints, fixed: Indices, pairs: Mapping[PairKey, PairGeometry]
) -> list[tuple[int, int, np.ndarray, np.ndarray]]:
    """Photo of the fixed rays, photo of the others, and their rays, for each ordered pair."""
    is_fixed = np.zeros(len(ties.point), dtype=np.bool_)
    is_fixed[fixed] = True
    found: list[tuple[int, int, np.ndarray, np.ndarray]] = []
    for first, second in sorted(pairs):
        numbers = ties.photo_ids.index(first), ties.photo_ids.index(second)
        ours, theirs = common_rays(ties, *numbers)
        for here, there, photo, other in (
            (ours, theirs, *numbers),
            (theirs, ours, *reversed(numbers)),
        ):
            chosen = is_fixed[here]
            if chosen.any():
                found.append((photo, other, here[chosen], there[chosen]))
    return sorted(found, key=lambda entry: entry[:2])


def _cut(block: Block, ties: TiePoints, number: int, options: RefinementOptions) -> np.ndarray:
    """The patches about all rays of one photo, in the order of the rays, as small as the scan's."""
    scan = open_scan(Path(block.photos[ties.photo_ids[number]].scan))
    patches = read_patches(scan, ties.pixels[ties.photo == number], options.searched_radius_px)
    return np.rint(patches).astype(scan.dtype)


def _match_group(
    ties: TiePoints,
    fine: _Fine,
    rays: tuple[Indices, Indices],
    photos: tuple[int, int],
    cut: Mapping[int, np.ndarray],
    pairs: Mapping[PairKey, PairGeometry],
    reductions: Mapping[str, int],
    options: RefinementOptions,
) -> None:
    """Match the rays of one photo to fixed rays of another; what is found goes into `fine`."""
    ours, theirs = rays
    here, there = (ties.photo_ids[number] for number in photos)
    first, second = _matches_of(pairs, here, there)
    linear = local_affinities(ties.pixels[ours], first, second)
    moved = fine.pixels[ours] - ties.pixels[ours]
    middle = patch_centres(ties.pixels[theirs])
    offset = ties.pixels[theirs] - middle + (linear @ moved[:, :, None])[:, :, 0]
    fixed = cut[photos[0]][_place(ties, photos[0], ours)].astype(np.float32)
    searched = cut[photos[1]][_place(ties, photos[1], theirs)].astype(np.float32)
    margin = options.searched_radius_px - options.radius_px
    found = refine_rays(
        fixed[:, margin:-margin, margin:-margin],
        searched,
        np.concatenate([linear, offset[:, :, None]], axis=2),
        options.max_shift * max(reductions[here], reductions[there]),
        options,
    )
    good = np.flatnonzero(found.good)
    fine.pixels[theirs[good]] = middle[good] + found.pixels[good]
    fine.fixed[theirs[good]] = ours[good]
    fine.formal[theirs[good]] = found.sigma_px[good]


def _matches_of(
    pairs: Mapping[PairKey, PairGeometry], here: str, there: str
) -> tuple[PixelPoints, PixelPoints]:
    """All matches of two photos, in the order asked for."""
    if (here, there) in pairs:
        return pairs[here, there].first, pairs[here, there].second
    return pairs[there, here].second, pairs[there, here].first


def _place(ties: TiePoints, number: int, rays: Indices) -> Indices:
    """Place of rays among all rays of their photo."""
    return np.searchsorted(np.flatnonzero(ties.photo == number), rays)


def _adjusted(
    block: Block, ties: TiePoints, pair: PairKey, start: RelativeOrientation, fine: _Fine
) -> RelativeOrientation:
    """The pair's relative orientation from its fine rays, where there are enough of them."""
    first, second = pair
    ours, theirs = common_rays(ties, ties.photo_ids.index(first), ties.photo_ids.index(second))
    good = (fine.fixed[ours] >= 0) & (fine.fixed[theirs] >= 0)
    if good.sum() < 12:
        return start
    photos, cameras = (
        [block.photos[name] for name in pair],
        [block.camera_of(name) for name in pair],
    )
    return adjust_relative(
        rays_of(photos[0], cameras[0], ties.pixels[ours[good]]),
        rays_of(photos[1], cameras[1], ties.pixels[theirs[good]]),
        (pixel_angle(photos[0], cameras[0]), pixel_angle(photos[1], cameras[1])),
        start,
        1.0,
    )


def _observed_variances(
    block: Block,
    ties: TiePoints,
    orientations: Mapping[PairKey, RelativeOrientation],
    fine: _Fine,
) -> tuple[Scalars, Scalars, float]:
    """Squared parallaxes of direct matches as variances, their formal variances, and the coarse.

    Returns:
        Variance of a match (sum of both rays) seen in each parallax; the formal one; and the
        standard deviation of a ray that was not measured finely, pixels.
    """
    squares, formal, coarse = [np.zeros(0)], [np.zeros(0)], [np.zeros(0)]
    for pair, orientation in sorted(orientations.items()):
        ours, theirs, residual = pair_parallax(block, ties, pair, orientation)
        seen = np.isfinite(residual)
        direct = (fine.fixed[theirs] == ours) | (fine.fixed[ours] == theirs)
        direct &= seen
        # Five unknowns per pair were fitted to these very parallaxes.
        freedom = max(int(direct.sum()), 6) / max(int(direct.sum()) - 5, 1)
        squares.append(2 * residual[direct] ** 2 * freedom)
        formal.append(np.maximum(fine.formal[ours], fine.formal[theirs])[direct] ** 2)
        failed = ((fine.fixed[theirs] < 0) | (fine.fixed[ours] < 0)) & seen
        coarse.append(np.abs(residual[failed]))
    rough = np.concatenate(coarse)
    sigma = ROBUST * float(np.median(rough)) if len(rough) >= 10 else float("nan")
    return np.concatenate(squares), np.concatenate(formal), sigma


def _variance_law(squares: Scalars, formal: Scalars) -> tuple[float, float]:
    """Factor and exponent of variance = factor * formal ** exponent, exponent between 0 and 2.

    Fitted to ten classes; the largest twentieth of each is left out, for it holds wrong matches.
    """
    if len(squares) == 0:
        return 1.0, 1.0
    classes = np.array_split(np.argsort(formal, kind="stable"), 10 if len(squares) >= 200 else 1)
    seen = np.log([max(_trimmed_variance(squares[members]), 1e-12) for members in classes])
    given = np.log([max(float(np.mean(formal[members])), 1e-12) for members in classes])
    exponent = 1.0
    if len(classes) > 1:
        spread = given - given.mean()
        slope = float(spread @ (seen - seen.mean())) / max(float(spread @ spread), 1e-9)
        exponent = float(np.clip(slope, 0.0, 2.0))
    return float(np.exp(seen.mean() - exponent * given.mean())), exponent


def _trimmed_variance(squares: Scalars) -> float:
    """Mean square without the largest twentieth, set right for what a normal law would lose."""
    kept = np.sort(squares)[: max(1, int(np.ceil(0.95 * len(squares))))]
    return float(np.mean(kept)) / TRIMMED


def _sigmas(
    ties: TiePoints,
    fine: _Fine,
    law: tuple[float, float],
    coarse: float,
    options: MeasurementOptions,
) -> Scalars:
    """Standard deviation of every ray: half of a match's variance belongs to each of its rays."""
    matched = (fine.fixed >= 0) & (fine.formal > 0)
    variance = np.maximum(law[0] * fine.formal ** (2 * law[1]), 2 * options.floor_px**2)
    sigma = np.full(len(ties.point), coarse)
    least = np.full(len(ties.point), np.inf)
    np.minimum.at(least, fine.fixed[matched], variance[matched] / 2)
    fixed = np.isfinite(least)
    sigma[fixed] = np.sqrt(least[fixed])
    sigma[matched] = np.sqrt(variance[matched] - least[fine.fixed[matched]])
    return sigma


def _bearable(
    block: Block,
    ties: TiePoints,
    orientations: Mapping[PairKey, RelativeOrientation],
    reductions: Mapping[str, int],
    fine: _Fine,
    options: MeasurementOptions,
) -> Flags:
    """False for rays whose y-parallaxes are too large in the sum over their pairs."""
    count, wrong = np.zeros(len(ties.point)), np.zeros(len(ties.point))
    for pair, orientation in orientations.items():
        ours, theirs, residual = pair_parallax(block, ties, pair, orientation)
        expected = np.sqrt((ties.sigma_px[ours] ** 2 + ties.sigma_px[theirs] ** 2) / 2)
        limit = options.max_parallax_px * max(reductions[name] for name in pair)
        limits = np.minimum(options.max_parallax_sigmas * expected, limit)
        bad = np.abs(residual) > limits
        for rays in (ours, theirs):
            count[rays] += 1
            wrong[rays] += bad
    # A wrong ray disagrees with all its partners, a right one only with the wrong ray.
    worst = np.zeros(ties.count)
    share = wrong / np.maximum(count, 1)
    np.maximum.at(worst, ties.point, share)
    return (share == 0) | ((share < worst[ties.point]) & (fine.fixed >= 0))
