"""One line that sums up the result of each stage of a run."""

from collections.abc import Callable, Mapping

from core.adjustment.adjusted import AdjustmentReport
from core.pipeline import made
from core.results import StageResults
from core.said import Said, say


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
