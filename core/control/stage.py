"""Stage control: which reference points are seen in which photo, and the block adjusted on them.

One pass searches the reference points at their predicted places, judges the candidates, and
adjusts. The first pass begins by laying the block on the reference as one body. From the second on
the photos agree to a pixel, so all photos of a point are judged together. The walk repeats passes
until the photos no longer move.
"""

from collections import ChainMap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from core.adjustment.adjusted import SETTLED, AdjustmentOptions, AdjustmentReport
from core.adjustment.block_adjustment import adjust_block
from core.adjustment.weights import Terrain
from core.block import Block, Measurement, Photo, SurveyedPoint, TiePoints
from core.control.calibration_check import Bin, Sightings, diagram
from core.control.common_shift import common_shifts, weigh_salient_points
from core.control.datum import lay_on_reference
from core.control.multi_photo import KeptSurfaces, joint_searches, keeping_surfaces
from core.control.proposals import judge_searches, sightings_of, surveyed_of, with_proposals
from core.control.search import Search, on_photograph, search_points
from core.doubts import Doubt, Failure
from core.localisation.initial_orientation import Site, join_photos
from core.localisation.photo_orientation import OrientationOptions
from core.localisation.stage import Localised
from core.matching.patches import OpenPhoto
from core.matching.reference import ReferenceFiles, open_reference
from core.progress import SILENT, Progress, Work
from core.raster.scan_file import ScanFile
from core.reference.stage import ReferenceFeatures
from core.said import say

# design: of a thousand good points one has a correction as large in either axis.
GROSS = 3.5
"""A control point is left out when its ground correction exceeds this many standard deviations."""
# design: a round costs seconds, for score maps are kept; the third seldom moves anything.
ROUNDS = 5
"""So often one pass judges what it found and adjusts at most."""
# design: as many rounds as control always had; each costs as much as the last.
MOST_PASSES = 3
"""So often localisation, ties and control are walked at most."""


@dataclass(frozen=True, slots=True)
class ControlStageOptions:
    """Settings of the stage."""

    orientation: OrientationOptions = field(default_factory=OrientationOptions)
    """Sizes of the templates."""
    adjustment: AdjustmentOptions = field(default_factory=AdjustmentOptions)
    """The adjustment."""


@dataclass(frozen=True, slots=True, eq=False)
class ControlFound:
    """A block with control, and what is doubtful about it."""

    report: AdjustmentReport
    """The adjustment; its block has all proposals with their status."""
    doubts: tuple[Doubt, ...]
    """What the datum and the control leave open."""
    reliability: tuple[Bin, ...] = ()
    """How far the probabilities of the proposals are borne out; empty where none were told."""
    passes: int = 1
    """How often control was searched from the adjusted block."""
    moved: float = float("inf")
    """How far the photos moved in the last pass, RMS in their own standard deviations."""

    @property
    def final(self) -> bool:
        """Whether the walk goes on: the photos have settled, or were given all passes."""
        return self.moved < SETTLED or self.passes >= MOST_PASSES


def find_control(
    localised: Localised,
    ties: TiePoints,
    scans: Mapping[str, ScanFile],
    features: ReferenceFeatures,
    files: ReferenceFiles,
    surveyed: Sequence[SurveyedPoint],
    before: ControlFound | None,
    options: ControlStageOptions,
    work: Work,
) -> ControlFound:
    """Search, judge and adjust control once.

    Without an ortho nothing is proposed: the block is adjusted by its ties and by what is known of
    its exterior orientations.

    Args:
        localised: The photos where they lie.
        ties: Their fine ties.
        scans: Scans by photo.
        features: Junctions and salient points.
        files: The reference.
        surveyed: The user's own points.
        before: What the pass before found; None in the first pass.
        options: Settings.
        work: Progress, threads and the source of chance.
    """
    points = {point.point_id: point for point in surveyed}
    block = replace(localised.block, ties=ties, surveyed=points, measurements={})
    if not files.ortho:
        report = adjusted_without_gross(block, options.adjustment)
        return _found(report, (), (), before)
    block = replace(block, reference=files.shifted)
    site = Site(
        open_reference(files, block.search_bounds), scans, features.points, features.sources
    )
    doubts: tuple[Doubt, ...] = ()
    if before is None:
        # design: shares of the time, for the bar alone.
        block, doubts = first_datum(block, localised, site, options, work.part(0.0, 0.4))
    else:
        doubts = tuple(doubt for doubt in before.doubts if doubt.kind == "datum")
    # design: the rest of the time.
    rest = work.part(0.4, 1.0)
    sites = [
        Site(open_reference(own, block.search_bounds), scans, each.points, each.sources)
        for (_, own), each in zip(files.each_alone, features.each_alone, strict=True)
    ] or [site]
    report, reliability = propose_and_adjust(block, sites, options, before is not None, rest)
    report, told = with_true_worth(report, options.adjustment)
    return _found(report, (*doubts, *told), reliability, before)


def _found(
    report: AdjustmentReport,
    doubts: tuple[Doubt, ...],
    reliability: tuple[Bin, ...],
    before: ControlFound | None,
) -> ControlFound:
    """What one pass found, with how far the photos moved since the one before."""
    passes = 1 if before is None else before.passes + 1
    moved = float("inf") if before is None else movement(before.report.block, report)
    if not report.exterior_sigmas:
        # Nothing stands, so nothing moves.
        moved = 0.0
    if passes >= MOST_PASSES and moved >= SETTLED:
        doubts = (*doubts, doubt_unsettled(moved))
    return ControlFound(report, doubts, reliability, passes, moved)


def doubt_unsettled(moved: float) -> Doubt:
    """The doubt about a block whose photos still move after the last pass."""
    return Doubt(
        "unsettled",
        "block",
        say(
            "After {passes} passes the photos still move by {moved:.2f} of their "
            "standard deviations (RMS): from another start the block may end about that "
            "much elsewhere.",
            passes=MOST_PASSES,
            moved=moved,
        ),
    )


def first_datum(
    block: Block, localised: Localised, site: Site, options: ControlStageOptions, work: Work
) -> tuple[Block, tuple[Doubt, ...]]:
    """The block joined by its fine ties and laid on the reference by a vote of all photos."""
    standing = join_photos(block, localised.weak, options.adjustment)
    work.progress.report(1, 2, "datum")
    laid = lay_on_reference(
        standing,
        site.scans,
        site.reference,
        site.points,
        options.orientation,
        work.random("assembly"),
        work.mapper,
    )
    if isinstance(laid, Failure):
        return standing, (Doubt("datum", "block", laid.reason, evidence=laid.evidence),)
    return laid, ()


def propose_and_adjust(
    block: Block, sites: Sequence[Site], options: ControlStageOptions, agrees: bool, work: Work
) -> tuple[AdjustmentReport, tuple[Bin, ...]]:
    """Control searched, judged and adjusted in rounds until the photos no longer move.

    Before the first adjustment (`agrees` is False) photos do not agree well enough for all photos
    of a point to be judged together. Each reference is searched and judged by itself, for chance is
    not as high in one as in the other; all are adjusted together.

    Returns:
        The last adjustment, and how far its probabilities are borne out.
    """
    found: list[tuple[Search, ...]] = [()] * len(sites)
    report, told = None, list[Sightings]()
    with keeping_surfaces() as kept:
        for done in range(ROUNDS):
            together, proposed, told = agrees or done > 0, list[Measurement](), []
            for number, site in enumerate(sites):
                share = done + np.array([number, number + 1]) / len(sites)
                part = work.part(*(share / ROUNDS).tolist())
                seen = search_photos(block, site, options, found[number], kept, part)
                found[number] = seen
                if together:
                    seen = joint_searches(block, site, options.orientation, seen, kept, work.mapper)
                believed = on_photograph(seen, site.scans)
                measured, resting = judge_searches(believed, site.sources)
                proposed += measured
                told += sightings_of(believed, site.sources, resting)
            points = [surveyed_of(site.points, site.sources) for site in sites]
            before = with_proposals(block, dict(ChainMap(*points)), proposed)
            report = adjusted_without_gross(before, options.adjustment)
            moved, block = movement(before, report), report.block
            if moved < SETTLED and together:
                break
    assert report is not None
    return report, diagram(told)


def search_photos(
    block: Block,
    site: Site,
    options: ControlStageOptions,
    before: Sequence[Search],
    kept: KeptSurfaces,
    work: Work,
) -> tuple[Search, ...]:
    """Search the reference points in every oriented photo, or look again at what was found.

    Args:
        block: The block as it stands.
        site: Reference, scans and reference points.
        options: Settings.
        before: What was found in the round before.
        kept: Where score maps are laid by.
        work: Progress and threads.
    """
    known: dict[str, list[Search]] = {}
    for search in before:
        known.setdefault(search.photo_id, []).append(search)

    def search_photo(photo: Photo) -> tuple[Search, ...]:
        opened = OpenPhoto(photo, block.cameras[photo.camera], site.scans[photo.photo_id])
        return search_points(
            opened,
            site.reference,
            site.points,
            options.orientation,
            before=known.get(photo.photo_id, ()),
            keep=kept.keep,
        )

    photos = [photo for photo in block.photos.values() if photo.oriented]
    every: list[Search] = []
    for done, one in enumerate(work.mapper(search_photo, photos)):
        every.extend(one)
        work.progress.report(done + 1, len(photos), "control")
    return tuple(every)


def movement(before: Block, report: AdjustmentReport) -> float:
    """How far photos moved since an earlier adjustment, RMS in their own standard deviations."""
    moved: list[np.ndarray] = []
    for name, sigmas in report.exterior_sigmas.items():
        now, then = report.block.photos[name], before.photos.get(name)
        if then is None or not then.oriented:
            return float("inf")
        centre = now.exterior.centre - then.exterior.centre
        angles = now.exterior.angles - then.exterior.angles
        turned = np.arctan2(np.sin(angles), np.cos(angles))
        moved.append(np.concatenate([centre / sigmas.centre_m, turned / sigmas.angles]))
    return float(np.sqrt(np.mean(np.square(moved)))) if moved else float("inf")


def with_true_worth(
    report: AdjustmentReport, options: AdjustmentOptions
) -> tuple[AdjustmentReport, tuple[Doubt, ...]]:
    """Adjusted again where salient points share a shift, with what there is to tell of it."""
    block, told, lesser = report.block, list[Doubt](), False
    for shift in common_shifts(block, options):
        if shift.shared_m.any():
            block, more = weigh_salient_points(block, shift)
            told, lesser = [*told, *more], True
    return (adjusted_without_gross(block, options) if lesser else report), tuple(told)


def adjusted_without_gross(
    block: Block,
    options: AdjustmentOptions,
    progress: Progress = SILENT,
    terrain: Terrain | None = None,
) -> AdjustmentReport:
    """Adjust, leave out control whose ground position the block contradicts, adjust again.

    `progress` is told of every step of every adjustment; may raise `Cancelled`.
    """
    report = adjust_block(block, options, progress, terrain)
    for _ in range(4):
        gross = gross_points(report)
        rejected = set(report.rejected)
        changed = {
            key: replace(value, status="unused", reason=why)
            for key, value in block.measurements.items()
            if value.status == "auto" and (why := gross.get(key[0], report.rejected.get(key, "")))
        }
        if not gross and not rejected:
            break
        # Each photo may have come back with a camera of its own, which begins anew.
        moved = {
            name: replace(photo, camera=block.photos[name].camera)
            for name, photo in report.block.photos.items()
        }
        block = replace(block, photos=moved, measurements={**block.measurements, **changed})
        report = adjust_block(block, options, progress, terrain)
    return report


def gross_points(report: AdjustmentReport) -> dict[str, str]:
    """Control points that the block moves further than their accuracy allows, worst tenth first."""
    sizes: dict[str, float] = {}
    for name, position in report.surveyed_positions.items():
        point = report.block.surveyed[name]
        if point.source != "surveyed":
            moved = (position - point.position)[:2] / point.sigma_m[:2]
            sizes[name] = float(np.hypot(*moved)) / np.sqrt(2)
    gross = sorted((name for name in sizes if sizes[name] > GROSS), key=lambda name: -sizes[name])
    worst = gross[: max(1, len(sizes) // 10)]
    return {
        name: say(
            "the block contradicts its ground position ({sigmas:.1f} sigma)", sigmas=sizes[name]
        )
        for name in worst
    }
