"""The block stands up: photos on the reference, photos carried by ties, control made sure of."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from core.block.adjusted import AdjustmentOptions, AdjustmentReport
from core.block.adjustment import SILENT, adjust_block
from core.block.block import Block, Measurement, Photo
from core.block.common_shift import common_shift, weighed
from core.block.control import borne_out, judged, surveyed_of, with_proposals
from core.block.least_squares.terrain import Terrain
from core.block.registration.borne_out import Bin
from core.block.registration.datum import DatumOptions, lay_on_reference
from core.block.registration.joint_surfaces import joint_searches
from core.block.registration.kept_surfaces import KeptSurfaces
from core.block.registration.orientation import OrientationOptions, OrientedPhoto
from core.block.registration.patches import OpenPhoto
from core.block.registration.searches import ControlOptions, Search, search_points
from core.block.registration.standing import MIN_TIES, Site, stand_up
from core.doubts import Doubt, Failure
from core.progress import Progress, Silent

GROSS = 3.5
"""A control point is left out when its ground correction exceeds this many standard deviations."""


@dataclass(frozen=True, slots=True)
class AssemblyOptions:
    """Rounds of searching and adjusting."""

    rounds: int = 3
    """How often control is searched from the adjusted block."""
    first_control_m: float = 6.0
    """Standard deviation of the single photos' own control while the ties bring them together:
    it may be wrong together, and must not bend the block."""
    orientation: OrientationOptions = field(default_factory=OrientationOptions)
    """Sizes of the templates."""
    datum: DatumOptions = field(default_factory=DatumOptions)
    """How the whole block is laid on the reference."""
    control: ControlOptions = field(default_factory=ControlOptions)
    """Limits of proposals."""
    adjustment: AdjustmentOptions = field(default_factory=AdjustmentOptions)
    """The adjustment."""


@dataclass(frozen=True, slots=True, eq=False)
class Assembly:
    """A block that stands, and what is doubtful about it."""

    report: AdjustmentReport
    """The adjustment; its block has all proposals with their status."""
    doubts: tuple[Doubt, ...]
    """Photos left out, photos carried by ties alone."""
    reliability: tuple[Bin, ...] = ()
    """How far the probabilities of the proposals are borne out; empty where none were told."""


def assemble_block(
    block: Block,
    site: Site,
    oriented: Mapping[str, OrientedPhoto | Failure],
    options: AssemblyOptions,
    rng: np.random.Generator,
    mapper: Callable[..., Iterable[Any]] = map,
    progress: Progress | None = None,
) -> Assembly:
    """Bring the photos together and propose control anew until the block agrees with itself.

    Args:
        block: Photos with approximate orientations, and the tie points.
        site: Reference, scans and reference points.
        oriented: What the single photos found.
        options: Limits.
        rng: Source of the samples.
        mapper: Runs a function over photos, such as the `map` of a thread pool.
        progress: Told after every round.

    Raises:
        OrientationError: No photo stands on the reference.
    """
    watch = progress or Silent()
    standing, doubts = stand_up(block, site, oriented, rng)
    watch.report(0, options.rounds + 2, "ties")
    standing = held_together(standing, site, oriented, options)
    watch.report(1, options.rounds + 2, "datum")
    laid = lay_on_reference(
        standing,
        site.scans,
        site.reference,
        site.points,
        options.orientation,
        options.datum,
        rng,
        mapper,
    )
    if isinstance(laid, Failure):
        doubts = (*doubts, Doubt("datum", "block", laid.reason, 0.9, laid.evidence))
    else:
        standing = laid
    report, reliability = proposed_in_rounds(standing, site, options, mapper, watch)
    report, told = with_true_worth(report, options.adjustment)
    return Assembly(report, (*doubts, *told), reliability)


def proposed_in_rounds(
    standing: Block,
    site: Site,
    options: AssemblyOptions,
    mapper: Callable[..., Iterable[Any]],
    watch: Progress,
) -> tuple[AdjustmentReport, tuple[Bin, ...]]:
    """Control searched, judged and adjusted again and again; how far it was borne out."""
    report, searches, seen, resting = None, (), (), {}
    with KeptSurfaces() as kept:
        for turn in range(options.rounds):
            watch.report(turn + 2, options.rounds + 2, "control")
            searches = seen = searched(standing, site, options, mapper, searches, kept)
            # Before the first adjustment photos do not agree well enough to be laid together.
            if turn > 0:
                seen = joint_searches(
                    standing, site, options.orientation, options.control, searches, kept, mapper
                )
            proposed, resting = judged(seen, site.sources, options.control)
            standing = with_proposals(standing, site.points, site.sources, proposed)
            report = adjusted_without_gross(standing, options.adjustment)
            standing = report.block
    assert report is not None
    return report, borne_out(seen, site.sources, resting)


def with_true_worth(
    report: AdjustmentReport, options: AdjustmentOptions
) -> tuple[AdjustmentReport, tuple[Doubt, ...]]:
    """Adjusted again where the salient points share a shift, with what there is to tell of it."""
    shift = common_shift(report.block, options)
    if shift is None or not shift.shared_m.any():
        return report, ()
    block, told = weighed(report.block, shift)
    return adjusted_without_gross(block, options), told


def held_together(
    block: Block,
    site: Site,
    oriented: Mapping[str, OrientedPhoto | Failure],
    options: AssemblyOptions,
) -> Block:
    """Adjust by the ties, with what the single photos agreed on as very weak control.

    Without ties, or where the adjustment does not converge, the photos stay as they are.
    """
    if block.ties.count < MIN_TIES:
        return block
    weak = replace(site.points, sigma_m=np.full_like(site.points.sigma_m, options.first_control_m))
    surveyed = surveyed_of(weak, site.sources)
    measured = [
        Measurement(site.points.ids[point], photo_id, peak.column, peak.row, 2 * peak.sigma_px)
        for photo_id, found in oriented.items()
        if isinstance(found, OrientedPhoto) and block.photos[photo_id].oriented
        for point, peak in zip(found.agreeing.tolist(), found.agreed, strict=True)
    ]
    first = replace(
        block,
        surveyed={name: surveyed[name] for name in {value.point_id for value in measured}},
        measurements={value.key: value for value in measured},
    )
    report = adjust_block(first, replace(options.adjustment, robust=False))
    return block.with_photos(report.block.photos) if report.converged else block


def searched(
    block: Block,
    site: Site,
    options: AssemblyOptions,
    mapper: Callable[..., Iterable[Any]],
    before: Sequence[Search] = (),
    kept: KeptSurfaces | None = None,
) -> tuple[Search, ...]:
    """Search the reference points in every oriented photo, or look again at what was found.

    Surfaces are laid by where `kept` is given.
    """
    known: dict[str, list[Search]] = {}
    for search in before:
        known.setdefault(search.photo_id, []).append(search)

    def one(photo: Photo) -> tuple[Search, ...]:
        opened = OpenPhoto(photo, block.cameras[photo.camera], site.scans[photo.photo_id])
        return search_points(
            opened,
            site.reference,
            site.points,
            options.orientation,
            options.control,
            before=known.get(photo.photo_id, ()),
            keep=None if kept is None else kept.keep,
        )

    photos = [photo for photo in block.photos.values() if photo.oriented]
    return tuple(search for found in mapper(one, photos) for search in found)


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
        block = replace(
            block,
            photos=report.block.photos,
            cameras=block.cameras,
            measurements={**block.measurements, **changed},
        )
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
        name: f"the block contradicts its ground position ({sizes[name]:.1f} sigma)"
        for name in worst
    }
