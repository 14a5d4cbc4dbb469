"""All pairs of a block matched: where they should overlap first, then wherever they may."""

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np
from shapely import Polygon

from core.arrays import PixelPoints
from core.block.block import Block, Photo
from core.block.ties.chains import PairKey
from core.block.ties.features import Features
from core.block.ties.matches import (
    SAME_PHOTO,
    MatchOptions,
    VerifiedMatches,
    match_features,
    verify_matches,
)
from core.block.ties.pairs import CandidatePair, PairOptions, find_pairs, ground_of, within
from core.doubts import Failure
from core.geometry.camera import Camera
from core.progress import Progress, tracked


@dataclass(frozen=True, slots=True)
class SearchOptions:
    """Which photos are compared, and how."""

    pairs: PairOptions = field(default_factory=PairOptions)
    """Pairs that may overlap by their approximate orientations."""
    matches: MatchOptions = field(default_factory=MatchOptions)
    """Matching and its geometric check."""
    whole_overlap: float = 0.1
    """A pair that should overlap by this share and does not match is tried again without regard to
    where the photos should be."""
    rescue_partners: int = 30
    """A photo that nothing ties is tried against so many of the nearest photos."""
    threads: int = 2
    """Pairs at work at the same time."""


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
    options: SearchOptions,
    progress: Progress,
    rng: np.random.Generator,
) -> dict[PairKey, PairResult]:
    """Match all pairs of photos that may overlap.

    Photos that nothing ties are then tried against their nearest neighbours without regard to
    their approximate position, which may be grossly wrong.
    """
    pairs = find_pairs(block, options.pairs)
    results: dict[PairKey, PairResult] = {}

    def expected(pair: CandidatePair, rng: np.random.Generator) -> PairResult:
        result = match_pair(block, pair, features, options.matches, rng)
        if isinstance(result.found, Failure) and pair.overlap >= options.whole_overlap:
            result = _better(result, _match_whole(block, pair, features, options, rng))
        return result

    def anywhere(pair: CandidatePair, rng: np.random.Generator) -> PairResult:
        return _match_whole(block, pair, features, options, rng)

    with _at_work(expected, pairs, options, rng) as found:
        for result in tracked(found, len(pairs), progress, "matching photos"):
            results[result.pair.first, result.pair.second] = result
    rescues = list(_rescues(block, results, options))
    with _at_work(anywhere, rescues, options, rng) as found:
        for result in tracked(found, len(rescues), progress, "matching loose photos"):
            key = result.pair.first, result.pair.second
            if _telling(result):
                results[key] = replace(result, unexpected=key not in results)
    return dict(sorted(results.items()))


@contextmanager
def _at_work(
    match: Callable[[CandidatePair, np.random.Generator], PairResult],
    pairs: Sequence[CandidatePair],
    options: SearchOptions,
    rng: np.random.Generator,
) -> Generator[Iterator[PairResult]]:
    """Results of pairs in their order; each has a generator of its own, whoever comes first."""
    pool = ThreadPoolExecutor(options.threads)
    try:
        yield pool.map(match, pairs, rng.spawn(len(pairs)))
    finally:
        pool.shutdown(cancel_futures=True)


def match_pair(
    block: Block,
    pair: CandidatePair,
    features: Mapping[str, Features],
    options: MatchOptions,
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
    matches = match_features(*parts, options)
    found = verify_matches(photos, cameras, parts, matches, options, rng)
    if isinstance(found, VerifiedMatches):
        found = found.in_whole(chosen[0], chosen[1])
    return PairResult(pair, len(matches.first), found)


def _match_whole(
    block: Block,
    pair: CandidatePair,
    features: Mapping[str, Features],
    options: SearchOptions,
    rng: np.random.Generator,
) -> PairResult:
    """Match all features of two photos."""
    anywhere = CandidatePair(pair.first, pair.second, pair.overlap, None, None)
    return match_pair(block, anywhere, features, options.matches, rng)


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


def _rescues(
    block: Block, results: Mapping[PairKey, PairResult], options: SearchOptions
) -> Iterator[CandidatePair]:
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
        if result.pair.overlap >= options.whole_overlap or result.pair.first_region is None
    }
    for name in sorted(set(block.photos) - tied):
        here = block.photos[name].exterior.centre
        others = sorted(
            (float(np.linalg.norm(photo.exterior.centre - here)), other)
            for other, photo in block.photos.items()
            if other != name
        )
        for _, other in others[: options.rescue_partners]:
            key = (min(name, other), max(name, other))
            if key not in tried:
                tried.add(key)
                overlap = results[key].pair.overlap if key in results else 0.0
                yield CandidatePair(*key, overlap, None, None)
