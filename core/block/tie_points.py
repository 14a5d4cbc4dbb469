"""Tie points of a block: features, matches, chains, thinning and fine measurement in turn."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from core.block.block import Block, TiePoints
from core.block.chains import PairKey, chain_matches, common_rays, consistent, with_rays
from core.block.features import FeatureOptions, Features, Usable, detect_features, picture_area
from core.block.matches import (
    MatchOptions,
    VerifiedMatches,
    match_features,
    verify_matches,
)
from core.block.pairs import CandidatePair, PairOptions, find_pairs, ground_of, within
from core.block.thinning import ThinningOptions, thin_ties
from core.block.tie_measurement import MeasurementOptions, PairGeometry, measure_ties
from core.doubts import Doubt, Failure
from core.progress import Progress, Silent, tracked
from core.scan.raster import open_scan


@dataclass(frozen=True, slots=True)
class TieOptions:
    """All settings of the stage."""

    features: FeatureOptions = field(default_factory=FeatureOptions)
    """Detection."""
    pairs: PairOptions = field(default_factory=PairOptions)
    """Which photos are compared."""
    matches: MatchOptions = field(default_factory=MatchOptions)
    """Matching and its geometric check."""
    thinning: ThinningOptions = field(default_factory=ThinningOptions)
    """How many points are kept, and where."""
    measurement: MeasurementOptions = field(default_factory=MeasurementOptions)
    """Fine measurement on the raw scans."""
    spare: float = 1.6
    """So many times the wanted points are measured, to choose the best of them."""
    few_ties: int = 20
    """A photo or pair with fewer points is a doubt."""


@dataclass(frozen=True, slots=True)
class PairReport:
    """How the matching of one pair went."""

    first: str
    """Photo whose name comes first."""
    second: str
    """The other photo."""
    overlap: float
    """Expected common share of the smaller footprint, 0 to 1."""
    matches: int
    """Features that look alike."""
    agreeing: int
    """Those that agree with one relative orientation."""
    log10_nfa: float
    """log10 of how many such agreements chance would give; nought when refused."""
    parallax_rms_px: float
    """RMS y-parallax of the agreeing matches before fine measurement, pixels; NaN if refused."""
    ties: int
    """Tie points kept between the two photos."""
    reason: str = ""
    """Why the pair was refused; empty when it was not."""

    @property
    def tied(self) -> bool:
        """True when the pair was accepted."""
        return not self.reason


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
    block: Block, options: TieOptions, progress: Progress, usable: Mapping[str, Usable]
) -> dict[str, Features]:
    """Features of every photo, by name."""
    found: dict[str, Features] = {}
    for name in tracked(sorted(block.photos), len(block.photos), progress, "finding features"):
        photo = block.photos[name]
        area = usable.get(name) or picture_area(photo, block.camera_of(name))
        found[name] = detect_features(open_scan(Path(photo.scan)), area, options.features)
    return found


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
    pairs = find_pairs(block, options.pairs)
    results = {
        (pair.first, pair.second): match_pair(block, pair, features, options.matches, rng)
        for pair in tracked(pairs, len(pairs), progress, "matching photos")
    }
    verified = {
        pair: found for pair, (_, found) in results.items() if isinstance(found, VerifiedMatches)
    }
    ties = _chained(block, features, verified, options)
    ties = _measured(block, ties, features, verified, options, progress)
    reports = tuple(_report(pair, *results[pair.first, pair.second], ties) for pair in pairs)
    return ties, reports, assess_ties(block, ties, reports, options)


def match_pair(
    block: Block,
    pair: CandidatePair,
    features: Mapping[str, Features],
    options: MatchOptions,
    rng: np.random.Generator,
) -> tuple[int, VerifiedMatches | Failure]:
    """Number of features that look alike, and those of them that stand the geometric check."""
    photos = block.photos[pair.first], block.photos[pair.second]
    cameras = block.camera_of(pair.first), block.camera_of(pair.second)
    chosen: list[np.ndarray] = []
    regions = (pair.first_region, pair.second_region)
    for photo, camera, region in zip(photos, cameras, regions, strict=True):
        ground = ground_of(photo, camera, features[photo.photo_id].pixels)
        chosen.append(np.flatnonzero(within(region, ground)))
    parts = (features[pair.first].chosen(chosen[0]), features[pair.second].chosen(chosen[1]))
    matches = match_features(*parts, options)
    found = verify_matches(photos, cameras, parts, matches, options, rng)
    if isinstance(found, Failure):
        return len(matches.first), found
    return len(matches.first), found.in_whole(chosen[0], chosen[1])


def assess_ties(
    block: Block, ties: TiePoints, reports: tuple[PairReport, ...], options: TieOptions
) -> tuple[Doubt, ...]:
    """What is doubtful about the tie points: loose photos, few ties, a block in parts."""
    doubts = [*_photo_doubts(block, ties, reports, options), *_pair_doubts(reports, options)]
    parts = connected_parts(block, reports)
    if len(parts) > 1:
        sizes = ", ".join(str(len(part)) for part in parts)
        doubts.append(
            Doubt(
                "block-in-parts",
                "block",
                f"The tie points leave the block in {len(parts)} parts ({sizes} photos): each part "
                "must be oriented by control of its own.",
                0.6,
                {"parts": [list(part) for part in parts]},
            )
        )
    return tuple(doubts)


def connected_parts(block: Block, reports: tuple[PairReport, ...]) -> tuple[tuple[str, ...], ...]:
    """Groups of photos that tie points hold together, the largest first."""
    part = {name: name for name in block.photos}
    for report in reports:
        if report.tied and report.ties:
            old, new = part[report.second], part[report.first]
            part = {name: new if group == old else group for name, group in part.items()}
    groups = [tuple(n for n in sorted(part) if part[n] == g) for g in sorted(set(part.values()))]
    return tuple(sorted(groups, key=lambda group: (-len(group), group)))


def _chained(
    block: Block,
    features: Mapping[str, Features],
    verified: Mapping[PairKey, VerifiedMatches],
    options: TieOptions,
) -> TiePoints:
    """Chains whose rays agree in all pairs, thinned to somewhat more than is wanted."""
    limit = options.matches.relative.tolerance_px
    ties = consistent(
        block,
        chain_matches(features, verified),
        {pair: found.pair.orientation for pair, found in verified.items()},
        {pair: 1.5 * limit * max(features[name].reduction for name in pair) for pair in verified},
    )
    return with_rays(
        ties, thin_ties(block, ties, options.thinning.times(options.spare))[ties.point]
    )


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
        )
        for (first, second), found in verified.items()
    }
    reductions = {name: found.reduction for name, found in features.items()}
    measured, good, failed = measure_ties(
        block, ties, pairs, reductions, options.measurement, progress
    )
    enough = np.bincount(ties.point[good], minlength=ties.count) >= 2
    ties = with_rays(measured, good)
    kept = thin_ties(block, ties, options.thinning, reserve=failed[enough])
    return with_rays(ties, kept[ties.point])


def _report(
    pair: CandidatePair, matches: int, found: VerifiedMatches | Failure, ties: TiePoints
) -> PairReport:
    """The figures of one pair."""
    if isinstance(found, Failure):
        agreeing = int(found.evidence.get("agreeing", 0))
        return PairReport(
            pair.first, pair.second, pair.overlap, matches, agreeing, 0.0, float("nan"), 0,
            found.reason,
        )  # fmt: skip
    numbers = ties.photo_ids.index(pair.first), ties.photo_ids.index(pair.second)
    return PairReport(
        pair.first,
        pair.second,
        pair.overlap,
        matches,
        len(found.matches.first),
        found.pair.log10_nfa,
        float(np.sqrt(np.mean(found.parallax_px**2))),
        len(common_rays(ties, *numbers)[0]),
    )


def _photo_doubts(
    block: Block, ties: TiePoints, reports: tuple[PairReport, ...], options: TieOptions
) -> list[Doubt]:
    """Photos without ties, or with few."""
    doubts: list[Doubt] = []
    for name in sorted(block.photos):
        number = ties.photo_ids.index(name) if name in ties.photo_ids else -1
        count = int(np.sum(ties.photo == number))
        if count >= options.few_ties:
            continue
        tried = [report for report in reports if name in (report.first, report.second)]
        evidence = {
            "ties": count,
            "pairs": [[r.first, r.second, r.overlap, r.matches, r.agreeing] for r in tried],
        }
        if count:
            message = f"Only {count} tie points hold {name} to its neighbours."
            doubts.append(Doubt("few-ties", name, message, 0.5, evidence))
            continue
        why = "no other photo seems to overlap it" if not tried else "no overlap could be matched"
        message = f"{name} is not tied to the block: {why}. It can only be oriented by control."
        doubts.append(Doubt("photo-not-tied", name, message, 0.6, evidence))
    return doubts


def _pair_doubts(reports: tuple[PairReport, ...], options: TieOptions) -> list[Doubt]:
    """Pairs that should have tied and did not, or hardly did."""
    doubts: list[Doubt] = []
    for report in reports:
        subject = f"{report.first} {report.second}"
        evidence = {
            "overlap": report.overlap,
            "matches": report.matches,
            "agreeing": report.agreeing,
            "ties": report.ties,
        }
        share = f"{100 * report.overlap:.0f} %"
        if not report.tied and report.overlap >= 0.15:
            message = f"The photos should overlap by {share}, but did not tie. {report.reason}"
            doubts.append(Doubt("pair-not-tied", subject, message, 0.4, evidence))
        elif report.tied and report.ties < options.few_ties:
            message = f"Only {report.ties} tie points; the expected overlap is {share}."
            doubts.append(Doubt("pair-few-ties", subject, message, 0.2, evidence))
    return doubts
