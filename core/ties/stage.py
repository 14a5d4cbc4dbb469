"""Stage ties: tie points measured finely in several scans."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from core.block import Block, TiePoints
from core.doubts import Doubt
from core.formats.tie_list import read_ties
from core.geometry.exterior import ExteriorOrientation
from core.kept_arrays import KeptArrays
from core.progress import Progress, Work, tracked
from core.raster.scan_file import open_scan
from core.raster.stand_in import is_stand_in
from core.ties.chains import PairKey, chain_matches, drop_contradicted, with_rays
from core.ties.features import FeatureOptions, Features, Usable, detect_features, picture_area
from core.ties.fine_matching import GivenTies, PairGeometry
from core.ties.matches import RELATIVE, VerifiedMatches
from core.ties.pair_search import PairResult, match_pairs
from core.ties.thinning import ThinningOptions, thin_ties
from core.ties.tie_measurement import measure_ties
from core.ties.tie_report import PairReport, assess_ties, misplaced_photos, report_pair

# design: what two photos have in common then changes by as much; features are the same.
REMATCH_SHARE = 0.02
"""Ties are matched again where a photo has moved by more than this share of its width."""


SPARE = 1.6  # design: time; leaves a choice after fine measurement has refused some
"""So many times the wanted points are measured, to choose the best of them."""
PARALLAX_TOLERANCES = 1.5  # design: two links in a row scatter by root two as much as one
"""Rays of one point agree in a pair while their y-parallax stays below this many tolerances."""


@dataclass(frozen=True, slots=True)
class TieOptions:
    """All settings of the stage."""

    features: FeatureOptions = field(default_factory=FeatureOptions)
    """Detection."""
    thinning: ThinningOptions = field(default_factory=ThinningOptions)
    """How many points are kept, and where."""


@dataclass(frozen=True, slots=True, eq=False)
class Tied:
    """The tie points of the block."""

    ties: TiePoints
    """All rays."""
    doubts: tuple[Doubt, ...]
    """Photos and pairs that tie badly."""
    matched_at: Mapping[str, ExteriorOrientation]
    """Where the photos lay when their ties were matched."""

    def still_hold(self, block: Block) -> bool:
        """Whether photos lie close enough to where they were matched for the same ties."""
        for name, photo in block.photos.items():
            then = self.matched_at.get(name)
            if then is None:
                return False
            away = np.hypot(*(photo.exterior.centre - then.centre)[:2])
            if away > REMATCH_SHARE * photo.width_m(block.camera_of(name)):
                return False
        return True


def ties_of_list(lists: Sequence[Path], block: Block) -> TiePoints | None:
    """Tie points of another program's list; None where there is no list."""
    if not lists:
        return None
    read = read_ties(lists[0], block.photos)
    assert read.sigma_px is not None, "every ray of a list has a weight"
    return TiePoints(read.photo_ids, read.point, read.photo, read.pixels, read.sigma_px)


def tie_photos(
    block: Block, features: Mapping[str, Features], options: TieOptions, work: Work
) -> Tied:
    """Tie points between all photos that overlap where they were localised.

    Args:
        block: Photos where they lie.
        features: Their features, as localisation saw them.
        options: Settings.
        work: Progress, and the source of chance.
    """
    ties, _, doubts = match_block_features(
        block, features, options, work.progress, work.random("ties")
    )
    places = {name: photo.exterior for name, photo in block.photos.items()}
    return Tied(ties, doubts, places)


def detect_block_features(
    block: Block,
    options: TieOptions,
    progress: Progress,
    usable: Mapping[str, Usable],
    mapper: Callable[..., Iterable[Features]] = map,
) -> dict[str, Features]:
    """Features of every photo, by name; `mapper` runs a function over photos."""
    store = KeptArrays()

    def detected(name: str) -> Features:
        photo = block.photos[name]
        if is_stand_in(photo.scan):
            return Features.none(photo.size_px)
        area = usable.get(name) or picture_area(photo, block.camera_of(name))
        return detect_features(open_scan(photo.scan), area, options.features).laid_by(store)

    names = sorted(block.photos)
    found = tracked(mapper(detected, names), len(names), progress, "finding features")
    return dict(zip(names, found, strict=True))


def match_block_features(
    block: Block,
    features: Mapping[str, Features],
    options: TieOptions,
    progress: Progress,
    rng: np.random.Generator,
) -> tuple[TiePoints, tuple[PairReport, ...], tuple[Doubt, ...]]:
    """Tie points from features, with what each pair tells and what is doubtful."""
    results = match_pairs(block, features, rng, progress)
    ties, verified = _chain_and_thin(block, features, results, options.thinning)
    given = _given_ties(block, ties, features, verified)
    ties = _measure_and_thin(given, options.thinning, progress)
    reports = tuple(report_pair(result, ties) for result in results.values())
    return ties, reports, assess_ties(block, ties, reports)


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
    results = match_pairs(block, features, rng, progress)
    ties, _ = _chain_and_thin(block, features, results, options.thinning)
    return ties, misplaced_photos([report_pair(result, ties) for result in results.values()])


def _chain_and_thin(
    block: Block,
    features: Mapping[str, Features],
    results: Mapping[PairKey, PairResult],
    thinning: ThinningOptions,
) -> tuple[TiePoints, dict[PairKey, VerifiedMatches]]:
    """Chains whose rays agree in all pairs, thinned to somewhat more than is wanted; the pairs."""
    verified = {
        pair: result.found
        for pair, result in results.items()
        if isinstance(result.found, VerifiedMatches)
    }
    limit = PARALLAX_TOLERANCES * RELATIVE.tolerance_px
    ties = drop_contradicted(
        block,
        chain_matches(features, verified),
        {pair: found.pair.orientation for pair, found in verified.items()},
        {pair: limit * max(features[name].reduction for name in pair) for pair in verified},
    )
    kept = thin_ties(block, ties, thinning.times(SPARE))
    return with_rays(ties, kept[ties.point]), verified


def _given_ties(
    block: Block,
    ties: TiePoints,
    features: Mapping[str, Features],
    verified: Mapping[PairKey, VerifiedMatches],
) -> GivenTies:
    """Tie points with what is known of their pairs before they are measured."""
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
    return GivenTies(block, ties, pairs, reductions)


def _measure_and_thin(given: GivenTies, thinning: ThinningOptions, progress: Progress) -> TiePoints:
    """The points measured finely, and the best of them kept."""
    point, count = given.ties.point, given.ties.count
    measured = measure_ties(given, progress)
    enough = np.bincount(point[measured.good], minlength=count) >= 2
    ties = with_rays(measured.ties, measured.good)
    kept = thin_ties(given.block, ties, thinning, reserve=measured.coarse[enough])
    return with_rays(ties, kept[ties.point])
