"""Tie points of a block: features, matches, chains, thinning and fine measurement in turn."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from core.block.block import Block, TiePoints
from core.block.ties.chains import PairKey, chain_matches, consistent, with_rays
from core.block.ties.features import FeatureOptions, Features, Usable, detect_features, picture_area
from core.block.ties.fine_matching import GivenTies, PairGeometry
from core.block.ties.matches import VerifiedMatches
from core.block.ties.pair_search import PairResult, SearchOptions, match_pairs
from core.block.ties.thinning import ThinningOptions, thin_ties
from core.block.ties.tie_measurement import MeasurementOptions, measure_ties
from core.block.ties.tie_report import (
    PairReport,
    assess_ties,
    misplaced,
    report_pair,
)
from core.doubts import Doubt
from core.progress import Progress, Silent, tracked
from core.scan.raster import open_scan


@dataclass(frozen=True, slots=True)
class TieOptions:
    """All settings of the stage."""

    features: FeatureOptions = field(default_factory=FeatureOptions)
    """Detection."""
    search: SearchOptions = field(default_factory=SearchOptions)
    """Which photos are compared, matching, and its geometric check."""
    thinning: ThinningOptions = field(default_factory=ThinningOptions)
    """How many points are kept, and where."""
    measurement: MeasurementOptions = field(default_factory=MeasurementOptions)
    """Fine measurement on the raw scans."""
    spare: float = 1.6
    """So many times the wanted points are measured, to choose the best of them."""
    few_ties: int = 20
    """A photo or pair with fewer points is a doubt."""


def match_ties(
    block: Block,
    options: TieOptions | None = None,
    progress: Progress | None = None,
    rng: np.random.Generator | None = None,
    usable: Mapping[str, Usable] | None = None,
) -> tuple[TiePoints, tuple[PairReport, ...], tuple[Doubt, ...]]:
    """Tie points of all photos of a block.

    Args:
        block: Photos with interior and approximate exterior orientation.
        options: Settings.
        progress: Is told how far the stage is.
        rng: Seeds the random searches; the same seed gives the same tie points.
        usable: By photo, where features may lie (scan pixels); the camera's picture area without
            fiducials for photos that are not in it.
    """
    options, progress = options or TieOptions(), progress or Silent()
    features = detect_block_features(block, options, progress, usable or {})
    return match_block_features(block, features, options, progress, rng)


def detect_block_features(
    block: Block,
    options: TieOptions,
    progress: Progress,
    usable: Mapping[str, Usable],
    mapper: Callable[..., Iterable[Features]] = map,
) -> dict[str, Features]:
    """Features of every photo, by name; `mapper` runs a function over photos."""

    def detected(name: str) -> Features:
        photo = block.photos[name]
        area = usable.get(name) or picture_area(photo, block.camera_of(name))
        return detect_features(open_scan(photo.scan), area, options.features)

    names = sorted(block.photos)
    found = tracked(mapper(detected, names), len(names), progress, "finding features")
    return dict(zip(names, found, strict=True))


def match_block_features(
    block: Block,
    features: Mapping[str, Features],
    options: TieOptions | None = None,
    progress: Progress | None = None,
    rng: np.random.Generator | None = None,
) -> tuple[TiePoints, tuple[PairReport, ...], tuple[Doubt, ...]]:
    """Tie points from features that have been detected before (see `match_ties`)."""
    options, progress = options or TieOptions(), progress or Silent()
    rng = rng or np.random.default_rng(0)
    results = match_pairs(block, features, options.search, progress, rng)
    ties, verified = _chained(block, features, results, options)
    ties = _measured(block, ties, features, verified, options, progress)
    reports = tuple(report_pair(result, ties) for result in results.values())
    return ties, reports, assess_ties(block, ties, reports, options.few_ties)


def match_roughly(
    block: Block,
    features: Mapping[str, Features],
    options: TieOptions,
    progress: Progress,
    rng: np.random.Generator,
) -> tuple[TiePoints, tuple[Doubt, ...]]:
    """Tie points as their features have them, which places photos that may lie elsewhere.

    Returns:
        The points, and photos that share ground though by their sources they should not.
    """
    results = match_pairs(block, features, options.search, progress, rng)
    ties, _ = _chained(block, features, results, options)
    return ties, misplaced([report_pair(result, ties) for result in results.values()])


def _chained(
    block: Block,
    features: Mapping[str, Features],
    results: Mapping[PairKey, PairResult],
    options: TieOptions,
) -> tuple[TiePoints, dict[PairKey, VerifiedMatches]]:
    """Chains whose rays agree in all pairs, thinned to somewhat more than is wanted; the pairs."""
    verified = {
        pair: result.found
        for pair, result in results.items()
        if isinstance(result.found, VerifiedMatches)
    }
    limit = options.search.matches.relative.tolerance_px
    ties = consistent(
        block,
        chain_matches(features, verified),
        {pair: found.pair.orientation for pair, found in verified.items()},
        {pair: 1.5 * limit * max(features[name].reduction for name in pair) for pair in verified},
    )
    kept = thin_ties(block, ties, options.thinning.times(options.spare))
    return with_rays(ties, kept[ties.point]), verified


def _measured(
    block: Block,
    ties: TiePoints,
    features: Mapping[str, Features],
    verified: Mapping[PairKey, VerifiedMatches],
    options: TieOptions,
    progress: Progress,
) -> TiePoints:
    """The points measured finely, and the best of them kept."""
    pairs = {
        (first, second): PairGeometry(
            found.pair.orientation,
            features[first].pixels[found.matches.first],
            features[second].pixels[found.matches.second],
            found.parallax_rms_px,
        )
        for (first, second), found in verified.items()
    }
    reductions = {name: found.reduction for name, found in features.items()}
    given = GivenTies(block, ties, pairs, reductions)
    measured = measure_ties(given, options.measurement, progress)
    enough = np.bincount(ties.point[measured.good], minlength=ties.count) >= 2
    ties = with_rays(measured.ties, measured.good)
    kept = thin_ties(block, ties, options.thinning, reserve=measured.coarse[enough])
    return with_rays(ties, kept[ties.point])
