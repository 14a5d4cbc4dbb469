"""What a run says: before it begins, one line for each stage, and what ends it."""

from collections.abc import Callable, Collection, Mapping, Sequence

from app.mosaic import check_guides
from app.orthos import check_area
from app.project import Project
from app.report.wording import remarks
from app.sheets import check_sheets, sheet_notes, unasked_sheets
from app.surface import check_surface
from core.adjustment.adjusted import AdjustmentReport
from core.doubts import Doubt
from core.pipeline import made
from core.quality.job_rules import JobRules
from core.quality.rules import human_findings
from core.results import StageResults
from core.said import Said, say

ABOUT_REFERENCE = ("dem-coverage", "dem-holes", "dem-noughts", "ortho-coverage")
"""Doubts that are told as soon as they are known: their remedy is another reference, and a run on
this one takes minutes."""


def scans_line(results: StageResults) -> Said:
    """How many scans, and how well their fiducials fit."""
    scans = made(results.scans)
    rms = [scan.interior.rms_um for scan in scans.oriented.values() if scan.interior.names]
    told = {"count": len(scans.oriented), "aside": len(scans.set_aside)}
    if not rms:
        return say("{count:# scan|# scans}, {aside} set aside, no fiducials", **told)
    return say(
        "{count:# scan|# scans}, {aside} set aside, fiducials {rms:.1f} µm rms",
        rms=sum(rms) / len(rms),
        **told,
    )


def georeference_line(results: StageResults) -> Said:
    """How many photos have a place."""
    placed = made(results.georeference)
    count, aside = len(placed.block.photos), len(placed.set_aside)
    return say("{count:# photo|# photos} placed, {aside} set aside", count=count, aside=aside)


def localisation_line(results: StageResults) -> Said:
    """How many photos stand on the reference."""
    photos = made(results.localisation).block.photos.values()
    found = sum(photo.oriented for photo in photos)
    return say("{found} of {count:# photo|# photos} found", found=found, count=len(photos))


def ties_line(results: StageResults) -> Said:
    """How many tie points."""
    ties = made(results.ties).ties
    return say(
        "{points:# tie point|# tie points}, {rays:# ray|# rays}",
        points=ties.count,
        rays=len(ties.point),
    )


def adjusted_line(report: AdjustmentReport) -> Said:
    """What became of an adjustment."""
    block, photos = report.block, report.block.photos.values()
    used = sum(block.steers(item) for item in block.measurements.values())
    standing = sum(photo.oriented for photo in photos)
    return say(
        "{oriented} of {count:# photo|# photos} oriented, {used:# control measurement|"
        "# control measurements}, sigma nought {sigma:.2f}",
        oriented=standing, count=len(photos), used=used, sigma=report.sigma_nought,
    )  # fmt: skip


STAGE_LINES: Mapping[str, Callable[[StageResults], Said]] = {
    "scans": scans_line,
    "georeference": georeference_line,
    "reference": lambda results: say(
        "{count:# point|# points}", count=len(made(results.reference).sources)
    ),
    "localisation": localisation_line,
    "ties": ties_line,
    "control": lambda results: adjusted_line(made(results.control).report),
}
"""One line about what each stage of the engine made."""


def notes_ahead(names: Collection[str], project: Project) -> list[str]:
    """What is to be told before a walk over some stages.

    Raises:
        PhotogrammetryError: What one of them would stumble over after minutes.
    """
    if "surface" in names:
        check_surface(project)
    if "orthos" in names:
        check_area(project)
    notes = [*check_guides(project)] if "mosaic" in names else []
    if "sheets" in names:
        notes += sheet_notes(project, check_sheets(project))
    elif "mosaic" in names:
        notes += unasked_sheets(project)
    return notes


def lines_at_once(name: str, results: StageResults) -> list[str]:
    """What is to be told as soon as a stage has ended: what the reference lacks."""
    if name != "georeference":
        return []
    doubts = made(results.georeference).doubts
    return remarks({}, [doubt for doubt in doubts if doubt.kind in ABOUT_REFERENCE], "")


def last_lines(
    results: StageResults, doubts: Sequence[Doubt], rules: JobRules, where: str
) -> list[str]:
    """What ends a walk: scans set aside, doubts not told yet, and findings that are grave.

    Args:
        results: What the stages made.
        doubts: Gravest first.
        rules: Limits of the job.
        where: The file that has all of it, for what there is no room for.
    """
    left = [doubt for doubt in doubts if doubt.kind not in ABOUT_REFERENCE]
    report = results.adjustment
    grave = [] if report is None else human_findings(report, rules)
    lines = remarks(results.set_aside, left, where)
    return [*lines, *(finding.sentence for finding in grave if finding.grave)]
