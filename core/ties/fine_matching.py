"""Match the rays of a tie point finely on the raw scans, each against one fixed ray."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from core.arrays import Indices, PixelPoints, Scalars
from core.block import Block, TiePoints
from core.geometry.relative import RelativeOrientation
from core.progress import Progress, tracked
from core.raster.scan_file import open_scan
from core.ties.chains import PairKey, common_rays
from core.ties.refinement import (
    MOST_SHIFT,
    PatchSize,
    local_affinities,
    patch_centres,
    read_patches,
    refine_rays,
)


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


@dataclass(frozen=True, slots=True, eq=False)
class GivenTies:
    """Tie points as their features give them, with what is known of the pairs."""

    block: Block
    """Photos and cameras."""
    ties: TiePoints
    """The tie points."""
    pairs: Mapping[PairKey, PairGeometry]
    """Pairs that have been tied."""
    reductions: Mapping[str, int]
    """Scan pixels per pixel of the reduced scan the features come from, by photo."""


@dataclass(slots=True)
class FineRays:
    """Rays while they are measured, as parallel arrays."""

    pixels: PixelPoints
    """Scan pixels."""
    fixed: Indices
    """The ray each ray was matched to; itself for the fixed ray, -1 where matching failed."""
    formal: Scalars
    """Formal deviation of the match, pixels; nought for the fixed ray."""


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """Rays of one photo that are matched to fixed rays of another, row by row."""

    photos: tuple[int, int]
    """Photo of the fixed rays, and of the others."""
    fixed: Indices
    others: Indices


def match_to_fixed(given: GivenTies, progress: Progress) -> FineRays:
    """Choose a fixed ray in each point and match the others to it, photo by photo."""
    size = PatchSize.at_reduction(max(given.reductions.values(), default=1))
    ties, fixed = given.ties, _fixed_rays(given)
    count = len(ties.point)
    fine = FineRays(np.array(ties.pixels), np.full(count, -1), np.zeros(count))
    fine.fixed[fixed] = fixed
    fine.pixels[fixed] = patch_centres(ties.pixels[fixed])
    work = _groups_to_match(given, fixed)
    cut: dict[int, np.ndarray] = {}
    for done, group in enumerate(tracked(work, len(work), progress, "measuring tie points")):
        for number in group.photos:
            if number not in cut:
                cut[number] = _patches_of(given, number, size)
        _match_group(given, fine, group, cut, size=size)
        needed = {number for later in work[done + 1 :] for number in later.photos}
        cut = {number: patches for number, patches in cut.items() if number in needed}
    return fine


def _fixed_rays(given: GivenTies) -> Indices:
    """The ray of each point that the others are matched to: tied to most of them, then middlemost.

    Returns:
        One ray per point.
    """
    block, ties = given.block, given.ties
    partners = np.zeros(len(ties.point))
    for first, second in given.pairs:
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


def _groups_to_match(given: GivenTies, fixed: Indices) -> list[_Group]:
    """The rays to match, for each ordered pair of photos."""
    ties = given.ties
    is_fixed = np.zeros(len(ties.point), dtype=np.bool_)
    is_fixed[fixed] = True
    found: list[_Group] = []
    for first, second in sorted(given.pairs):
        numbers = ties.photo_ids.index(first), ties.photo_ids.index(second)
        ours, theirs = common_rays(ties, *numbers)
        for chosen, group in (
            (is_fixed[ours], _Group(numbers, ours, theirs)),
            (is_fixed[theirs], _Group((numbers[1], numbers[0]), theirs, ours)),
        ):
            if chosen.any():
                found.append(_Group(group.photos, group.fixed[chosen], group.others[chosen]))
    return sorted(found, key=lambda group: group.photos)


def _patches_of(given: GivenTies, number: int, size: PatchSize) -> np.ndarray:
    """The patches about all rays of one photo, in the order of the rays, as small as the scan's."""
    ties = given.ties
    scan = open_scan(given.block.photos[ties.photo_ids[number]].scan)
    patches = read_patches(scan, ties.pixels[ties.photo == number], size.searched_radius_px)
    return np.rint(patches).astype(scan.dtype)


def _match_group(
    given: GivenTies,
    fine: FineRays,
    group: _Group,
    cut: Mapping[int, np.ndarray],
    *,
    size: PatchSize,
) -> None:
    """Match the rays of one photo to fixed rays of another; what is found goes into `fine`."""
    ties, photos, ours, theirs = given.ties, group.photos, group.fixed, group.others
    here, there = (ties.photo_ids[number] for number in photos)
    first, second = _matches_of(given.pairs, here, there)
    linear = local_affinities(ties.pixels[ours], first, second)
    moved = fine.pixels[ours] - ties.pixels[ours]
    middle = patch_centres(ties.pixels[theirs])
    offset = ties.pixels[theirs] - middle + (linear @ moved[:, :, None])[:, :, 0]
    fixed = cut[photos[0]][_place(ties, photos[0], ours)].astype(np.float32)
    searched = cut[photos[1]][_place(ties, photos[1], theirs)].astype(np.float32)
    margin = size.searched_radius_px - size.radius_px
    found = refine_rays(
        fixed[:, margin:-margin, margin:-margin],
        searched,
        np.concatenate([linear, offset[:, :, None]], axis=2),
        max_shift_px=MOST_SHIFT * max(given.reductions[here], given.reductions[there]),
        size=size,
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
