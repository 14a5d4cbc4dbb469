"""The sample of map sheets: what is shown of it, and what is said of one of its sheets."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely

from core.quality.job_rules import USUAL_RULES, JobRules
from core.sheets.acceptance import JudgedLot, JudgedSheet, bad_sheets
from sessions.decisions import JudgeSheet, Recorded
from sessions.sheet_samples import is_unchanged, sample_of, standing_samples, words_of_sheets
from ui.review.check_gestures import SheetJudged
from ui.review.judgement import lot_of_desk
from ui.review.snapshot import DeskSnapshot
from ui.review.state import Notice

Part = dict[str, Any]
CURVE_POINTS = 60
"""Points of the operating characteristic that are drawn, at most."""


def decided_sheet(
    gesture: SheetJudged, desk: DeskSnapshot
) -> tuple[tuple[JudgeSheet, ...], Notice | None]:
    """What is recorded of a word about a sheet; whoever finds one bad says why."""
    drawn, version = standing_samples(desk.recorded), desk.mosaic_version
    sample = sample_of(drawn[-1]) if drawn else None
    if sample is None or not version:
        return (), None
    if gesture.sheet not in {one.name for one in sample.sheets}:
        return (), Notice("notice.sheet-not-drawn", {"sheet": gesture.sheet}, grave=True)
    if not gesture.good and not gesture.words:
        return (), Notice("notice.sheet-words")
    return (JudgeSheet(gesture.sheet, gesture.good, version, gesture.words, sample.lot),), None


def sheets_part(desk: DeskSnapshot, *, blind: bool) -> Part:
    """How many sheets the block has, and the sample that is judged now, with its outlines.

    Args:
        desk: The desk.
        blind: Without readings, and without what follows for the lot: an observer still reads.
    """
    lot = lot_of_desk(desk, blind=blind)
    told: Part = {"count": len(desk.sheets), "sample": None}
    if lot is None:
        return told
    sample = lot_part(lot, desk.recorded, desk.mosaic_version, desk.rules)
    rings = {one.sheet.name: _rings(one) for one in lot.sheets}
    sample["sheets"] = [{**one, "rings": rings[one["name"]]} for one in sample["sheets"]]
    return told | {"sample": sample | ({"state": ""} if blind else {})}


def lot_part(
    lot: JudgedLot, recorded: Sequence[Recorded], version: str, rules: JobRules = USUAL_RULES
) -> Part:
    """A sample, its sheets, and what follows for the lot; for desk and report.

    Args:
        lot: The sample as it is judged.
        recorded: Everything decided.
        version: Of the mosaic.
        rules: Limits of the job.
    """
    item, plan = standing_samples(recorded)[-1], lot.plan
    sample = sample_of(item)
    words = words_of_sheets(recorded, sample.lot)
    good, bad = bad_sheets(plan.lot, rules)
    return {
        "when": item.when[:16].replace("T", " "),
        "who": item.who,
        "seed": sample.seed,
        "digest": sample.digest,
        "unchanged": is_unchanged(sample),
        "changed": lot.changed,
        "replaced": lot.replaced,
        "rejected": lot.rejected,
        "lot": plan.lot,
        "drawn": plan.sample,
        "accepted": plan.accepted,
        "bad": lot.count("bad"),
        "open": lot.count("open"),
        "state": "changed" if lot.changed else lot.state,
        # Shares of bad sheets in per cent, and how often such a lot is accepted, in per cent.
        "good_lot": [rules.sheets_good_percent, good, _percent(plan.acceptance(good))],
        "bad_lot": [rules.sheets_bad_percent, bad, _percent(plan.acceptance(bad))],
        "curve": [
            [_percent(one / plan.lot), _percent(plan.acceptance(one))] for one in _curve_counts(lot)
        ],
        "sheets": [_sheet(one, words.get(one.sheet.name, ()), version) for one in lot.sheets],
    }


def _curve_counts(lot: JudgedLot) -> list[int]:
    """Counts of bad sheets at which the curve is drawn, up to where no lot is accepted."""
    plan = lot.plan
    last = next((n for n in range(plan.lot) if plan.acceptance(n) < 1e-3), plan.lot)
    return sorted({round(one) for one in np.linspace(0, last, CURVE_POINTS).tolist()})


def _sheet(one: JudgedSheet, said: Sequence[tuple[Recorded, JudgeSheet]], version: str) -> Part:
    """One sheet of the sample, and why it is what it is."""
    low, high = one.read.m_p_interval
    return {
        "name": one.sheet.name,
        "state": one.state,
        "faults": one.faults,
        "read": one.read.count,
        "m_p": _metres(one.read.m_p),
        "interval": [_metres(low), _metres(high)],
        "by_readings": one.by_readings,
        "said": [_said(*word, version) for word in said],
    }


def _said(item: Recorded, said: JudgeSheet, version: str) -> Part:
    """Who said what of a sheet, and whether that was of this mosaic."""
    return {
        "id": item.decision_id,
        "who": item.who,
        "when": item.when[:16].replace("T", " "),
        "good": said.good,
        "words": said.words,
        "outdated": said.version != version,
    }


def _rings(one: JudgedSheet) -> list[list[list[float]]]:
    """Edges of a sheet, easting and northing, metres."""
    edges = shapely.get_parts(shapely.boundary(one.sheet.area))
    return [np.round(shapely.get_coordinates(edge), 2).tolist() for edge in edges]


def _percent(share: float) -> float:
    return round(100 * share, 2)


def _metres(value: float) -> float | None:
    return round(float(value), 3) if np.isfinite(value) else None
