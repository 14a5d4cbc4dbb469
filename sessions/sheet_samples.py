"""Samples of the block's map sheets, and what was said of their sheets, as they stand now."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import cast

from core.quality.job_rules import USUAL_RULES, JobRules
from core.sheets.acceptance import draw_sheets, smallest_plan
from core.sheets.delivery import Delivery
from core.sheets.map_sheets import MapSheet
from sessions.decisions import DrawSheets, JudgeSheet, Recorded, standing
from sessions.products import DIGEST_SIGNS, Products, digest_of

LARGEST_SEED = 10**9
"""Seeds lie below: as many as anybody types."""


def sheets_of(delivery: Delivery | None, version: str) -> tuple[MapSheet, ...]:
    """The sheets of a delivery, each once, in the order of their names.

    Args:
        delivery: As it was cut last; None where none was.
        version: Of the mosaic: sheets that were cut from another are none of it.
    """
    files = () if delivery is None or delivery.mosaic != version else delivery.files
    areas = {one.name: one.area for one in reversed(files)}
    return tuple(MapSheet(name, areas[name]) for name in sorted(areas))


def sheets_on_disk(products: Products, version: str) -> tuple[MapSheet, ...]:
    """The map sheets of a version of the mosaic; none where none were cut of it."""
    return sheets_of(cast("Delivery | None", products.latest_value("sheets")), version)


def lot_digest(sheets: Sequence[MapSheet]) -> str:
    """Digest of names and areas of all sheets, whatever their order."""
    said = [(one.name, one.area) for one in sorted(sheets, key=lambda sheet: sheet.name)]
    return digest_of("lot of sheets", said)[:DIGEST_SIGNS]


def new_sample(sheets: Sequence[MapSheet], seed: int, rules: JobRules = USUAL_RULES) -> DrawSheets:
    """A sample of a lot by the limits of a job.

    Args:
        sheets: Every sheet of the lot, one at least.
        seed: What they are drawn with.
        rules: Limits of the job.
    """
    plan, lot = smallest_plan(len(sheets), rules), lot_digest(sheets)
    drawn = draw_sheets(sheets, plan, seed)
    sample = DrawSheets(plan, drawn, seed, lot, "")
    return replace(sample, digest=_digest(sample))


def is_unchanged(sample: DrawSheets) -> bool:
    """Whether the sheets are those that the digest was made of."""
    return _digest(sample) == sample.digest


def _digest(sample: DrawSheets) -> str:
    return digest_of("sample", replace(sample, digest=""))[:DIGEST_SIGNS]


def standing_samples(decisions: Sequence[Recorded]) -> tuple[Recorded, ...]:
    """Every sample that stands, in the order they were drawn; the last one is judged now."""
    return tuple(one for one in standing(decisions) if isinstance(one.decision, DrawSheets))


def sample_of(recorded: Recorded) -> DrawSheets:
    """The sample that was recorded."""
    assert isinstance(recorded.decision, DrawSheets)
    return recorded.decision


def words_of_sheets(
    decisions: Sequence[Recorded], lot: str
) -> Mapping[str, tuple[tuple[Recorded, JudgeSheet], ...]]:
    """What everybody said last of every sheet of a lot, by its name."""
    newest = {
        (one.decision.sheet, one.who): (one, one.decision)
        for one in standing(decisions)
        if isinstance(one.decision, JudgeSheet) and one.decision.lot == lot
    }
    found: dict[str, tuple[tuple[Recorded, JudgeSheet], ...]] = {}
    for (name, _), said in newest.items():
        found[name] = (*found.get(name, ()), said)
    return found
