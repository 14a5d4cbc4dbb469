"""Match all pairs of a block: first those that should overlap, then others."""

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from shapely import Polygon, contains_xy, prepare

from core.arrays import Flags, ObjectPoints, PixelPoints
from core.block import Block, Photo, footprint, ground_of, position_sigma_m
from core.doubts import Failure
from core.geometry.camera import Camera
from core.progress import Progress, tracked
from core.ties.chains import PairKey
from core.ties.features import Features
from core.ties.matches import (
    SAME_PHOTO,
    VerifiedMatches,
    match_features,
    verify_matches,
)

# design: strips overlap by 20 to 35 %: half of that, and the pair should have matched
WHOLE_OVERLAP = 0.1
"""A pair that should overlap by this share and does not match is tried again without regard to
where the photos should be."""
RESCUE_PARTNERS = 30  # design: time; two photos either way along five strips, and as many more
"""A photo that nothing ties is tried against so many of the nearest photos."""
THREADS = 2  # design: memory; a table of distances takes 16 MB
"""Pairs at work at the same time."""
# design: neighbouring strips overlap by 20 to 35 %; heights and tilts may leave a quarter of that
LEAST_OVERLAP = 0.05
"""Share of the smaller footprint that two footprints must have in common."""
# design: 95 of 100 good georeferences; photos left loose are tried everywhere later
GROWTH_SIGMAS = 2.0
"""Footprints grow by this many standard deviations of the photos' relative position."""
MOST_GROWTH = 0.5  # design: more would pair every photo with its neighbours' neighbours
"""Footprints never grow by more than this share of the smaller footprint's side."""


@dataclass(frozen=True, slots=True, eq=False)
class CandidatePair:
    """Two photos that may overlap."""

    first: str
    """Photo whose name comes first."""
    second: str
    """The other photo."""
    overlap: float
    """Expected common share of the smaller footprint, 0 to 1, without any growth."""
    first_region: Polygon | None
    """Where the second photo may be seen on the ground of the first one, metres; None: anywhere."""
    second_region: Polygon | None
    """Where the first photo may be seen on the ground of the second one, metres; None: anywhere."""


@dataclass(frozen=True, slots=True, eq=False)
class PairResult:
    """What the matching of one pair gave."""

    pair: CandidatePair
    """The pair."""
    matches: int
    """Features that look alike."""
    found: VerifiedMatches | Failure
    """Those that stood the geometric check, or why the pair was refused."""
    unexpected: bool = False
    """True when the approximate positions, within their deviations, exclude any overlap."""


def match_pairs(
    block: Block,
    features: Mapping[str, Features],
    rng: np.random.Generator,
    progress: Progress,
) -> dict[PairKey, PairResult]:
    """Match all pairs of photos that may overlap.

    Photos that nothing ties are then tried against their nearest neighbours without regard to
    their approximate position, which may be grossly wrong.
    """
    pairs = find_pairs(block)
    results: dict[PairKey, PairResult] = {}

    def expected(pair: CandidatePair, rng: np.random.Generator) -> PairResult:
        result = match_pair(block, pair, features, rng)
        if isinstance(result.found, Failure) and pair.overlap >= WHOLE_OVERLAP:
            result = _better(result, _match_whole(block, pair, features, rng))
        return result

    def anywhere(pair: CandidatePair, rng: np.random.Generator) -> PairResult:
        return _match_whole(block, pair, features, rng)

    with _matched_together(expected, pairs, rng) as found:
        for result in tracked(found, len(pairs), progress, "matching photos"):
            results[result.pair.first, result.pair.second] = result
    rescues = list(_rescue_pairs(block, results))
    with _matched_together(anywhere, rescues, rng) as found:
        for result in tracked(found, len(rescues), progress, "matching loose photos"):
            key = result.pair.first, result.pair.second
            if _telling(result):
                results[key] = replace(result, unexpected=key not in results)
    return dict(sorted(results.items()))


@contextmanager
def _matched_together(
    match: Callable[[CandidatePair, np.random.Generator], PairResult],
    pairs: Sequence[CandidatePair],
    rng: np.random.Generator,
) -> Generator[Iterator[PairResult]]:
    """Results of pairs in their order; each has a generator of its own, whoever comes first."""
    pool = ThreadPoolExecutor(THREADS)
    try:
        yield pool.map(match, pairs, rng.spawn(len(pairs)))
    finally:
        pool.shutdown(cancel_futures=True)


def match_pair(
    block: Block,
    pair: CandidatePair,
    features: Mapping[str, Features],
    rng: np.random.Generator,
) -> PairResult:
    """Match the features of two photos that lie where the other photo may see them."""
    photos = block.photos[pair.first], block.photos[pair.second]
    cameras = block.camera_of(pair.first), block.camera_of(pair.second)
    regions = pair.first_region, pair.second_region
    chosen = [
        _in_region(photo, camera, features[photo.photo_id].pixels, region)
        for photo, camera, region in zip(photos, cameras, regions, strict=True)
    ]
    parts = (features[pair.first].chosen(chosen[0]), features[pair.second].chosen(chosen[1]))
    matches = match_features(*parts)
    found = verify_matches(photos, cameras, parts, matches, rng=rng)
    if isinstance(found, VerifiedMatches):
        found = found.in_whole(chosen[0], chosen[1])
    return PairResult(pair, len(matches.first), found)


def _match_whole(
    block: Block,
    pair: CandidatePair,
    features: Mapping[str, Features],
    rng: np.random.Generator,
) -> PairResult:
    """Match all features of two photos."""
    anywhere = CandidatePair(pair.first, pair.second, pair.overlap, None, None)
    return match_pair(block, anywhere, features, rng)


def _better(first: PairResult, second: PairResult) -> PairResult:
    """The second if it says more."""
    return second if _telling(second) else first


def _telling(result: PairResult) -> bool:
    """True when a pair was accepted, or is one photo scanned twice."""
    return isinstance(result.found, VerifiedMatches) or SAME_PHOTO in result.found.evidence


def _in_region(
    photo: Photo, camera: Camera, pixels: PixelPoints, region: Polygon | None
) -> np.ndarray:
    """Indices of the pixels whose ground lies in a region; of all of them where there is none."""
    if region is None:
        return np.arange(len(pixels))
    return np.flatnonzero(within(region, ground_of(photo, camera, pixels)))


def _rescue_pairs(block: Block, results: Mapping[PairKey, PairResult]) -> Iterator[CandidatePair]:
    """Pairs of loose photos with the nearest photos, except those that were matched whole."""
    tied = {
        name
        for pair, result in results.items()
        if isinstance(result.found, VerifiedMatches)
        for name in pair
    }
    tried = {
        key
        for key, result in results.items()
        if result.pair.overlap >= WHOLE_OVERLAP or result.pair.first_region is None
    }
    for name in sorted(set(block.photos) - tied):
        here = block.photos[name].exterior.centre
        others = sorted(
            (float(np.linalg.norm(photo.exterior.centre - here)), other)
            for other, photo in block.photos.items()
            if other != name
        )
        for _, other in others[:RESCUE_PARTNERS]:
            key = (min(name, other), max(name, other))
            if key not in tried:
                tried.add(key)
                overlap = results[key].pair.overlap if key in results else 0.0
                yield CandidatePair(*key, overlap, None, None)


def find_pairs(block: Block) -> tuple[CandidatePair, ...]:
    """All pairs of a block whose footprints may overlap, by name.

    Positions may be hundreds of metres off: a pair is tried when its footprints, grown by the
    standard deviations of the photos' positions, have the wanted share in common. Where positions
    are not known to a footprint every pair is tried, and no overlap is expected of it.
    """
    prints = {name: footprint(photo, block.camera_of(name)) for name, photo in block.photos.items()}
    found: list[CandidatePair] = []
    for first, second in combinations(sorted(block.photos), 2):
        ours, theirs = prints[first], prints[second]
        smaller = min(ours.area, theirs.area)
        if smaller <= 0:
            continue
        if _sigma_m(block, first, second) > np.sqrt(smaller):
            found.append(CandidatePair(first, second, 0.0, None, None))
            continue
        growth = _growth_m(block, first, second, float(np.sqrt(smaller)))
        if ours.distance(theirs) > growth:
            continue
        second_grown, first_grown = theirs.buffer(growth), ours.buffer(growth)
        if ours.intersection(second_grown).area / smaller < LEAST_OVERLAP:
            continue
        found.append(
            CandidatePair(
                first,
                second,
                float(ours.intersection(theirs).area / smaller),
                second_grown,
                first_grown,
            )
        )
    return tuple(found)


def within(region: Polygon, points: ObjectPoints) -> Flags:
    """True for ground points inside a region."""
    prepare(region)
    return np.asarray(contains_xy(region, points[:, 0], points[:, 1]), dtype=np.bool_)


def _growth_m(block: Block, first: str, second: str, side_m: float) -> float:
    """By how much footprints grow before they are compared."""
    return min(GROWTH_SIGMAS * _sigma_m(block, first, second), MOST_GROWTH * side_m)


def _sigma_m(block: Block, first: str, second: str) -> float:
    """Standard deviation of the relative position of two footprints, metres."""
    one, other = (position_sigma_m(block.photos[name]) for name in (first, second))
    return float(np.hypot(one, other))
