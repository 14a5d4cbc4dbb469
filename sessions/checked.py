"""What readings say of the mosaic and its sheets, beside what the adjustment lets expect."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from jaxtyping import Float64

from core.adjustment.adjusted import AdjustmentReport
from core.adjustment.influence import Influence
from core.mosaic.misfit import photos_shown
from core.mosaic.seams import Seam
from core.quality.job_rules import USUAL_RULES, JobRules
from core.quality.readings import (
    Foretold,
    PlanFigures,
    Reading,
    ReadingFigures,
    compare_with_prediction,
    reading_figures,
    reading_findings,
    unplanned_findings,
)
from core.quality.rules import Finding, release_limit_m
from core.sheets.acceptance import DrawnSheet, JudgedLot, JudgedSheet, smallest_plan
from core.sheets.map_sheets import MapSheet
from sessions.checks import (
    StandingPlan,
    checked_figures,
    outdated_readings,
    plan_readings,
    readings_of,
    replaced_readings,
    standing_plans,
)
from sessions.decisions import DrawSheets, Recorded
from sessions.remarks import standing_faults
from sessions.sheet_samples import (
    is_unchanged,
    lot_digest,
    sample_of,
    standing_samples,
    words_of_sheets,
)


@dataclass(frozen=True, slots=True, eq=False)
class Checked:
    """Readings of the plan that is read now, and what they come to."""

    figures: ReadingFigures
    """The figures."""
    foretold: Foretold
    """What was predicted of them."""
    findings: tuple[Finding, ...]
    """What follows."""


@dataclass(frozen=True, slots=True, eq=False)
class Predicted:
    """What the adjustment lets expect of readings."""

    relative_m: float
    """RMS in plan of the block relative to the reference, metres; NaN: not known."""
    ortho_sigma_m: float
    """Standard deviation of the reference per axis, metres."""
    influence: Influence | None
    """Equations of the adjusted block; None: not known."""
    seams: Sequence[Seam]
    """Which photo the mosaic shows where."""

    def freedom_at(self, places: Float64[np.ndarray, "n 2"]) -> float:
        """So many independent errors the orientation is worth at places; NaN where not known."""
        if self.influence is None:
            return float("nan")
        photos = self.influence.block.photos
        shown = zip(photos_shown(places, self.seams), places.tolist(), strict=True)
        return self.influence.ground_freedom(
            [
                (name, np.array([east, north, photos[name].ground_height_m]))
                for name, (east, north) in shown
                if name in photos
            ]
        )


def checked_by_hand(
    report: AdjustmentReport,
    decisions: Sequence[Recorded],
    version: str,
    predicted: Predicted,
    *,
    rules: JobRules = USUAL_RULES,
) -> Checked | None:
    """What readings say of a mosaic; None without a plan.

    Args:
        report: The adjustment.
        decisions: Everything recorded.
        version: Of the mosaic; empty where there is none.
        predicted: What they are compared with.
        rules: Limits of the job.
    """
    plans = standing_plans(decisions)
    if not plans:
        return None
    newest = plans[-1]
    figures = checked_figures(decisions, newest, version)
    freedom = predicted.freedom_at(_places_read(decisions, newest, version))
    reference_m = float(2**0.5) * predicted.ortho_sigma_m
    foretold = compare_with_prediction(figures, predicted.relative_m, reference_m, freedom)
    limit = release_limit_m(report.block, rules)
    replaced = replaced_readings(decisions, version)
    findings = reading_findings(
        figures,
        limit,
        foretold,
        replaced,
        outdated=outdated_readings(decisions, newest, version),
        late=not newest.plan.beforehand and not newest.plan.source,
        rules=rules,
    )
    return Checked(figures, foretold, tuple(findings))


def readings_found(
    checked: Checked | None, version: str, rules: JobRules = USUAL_RULES
) -> tuple[Finding, ...]:
    """What readings say; that nothing was planned where there is a mosaic to be read.

    Args:
        checked: As `checked_by_hand` found it.
        version: Of the mosaic; empty where there is none.
        rules: Limits of the job.
    """
    if checked is not None:
        return checked.findings
    return unplanned_findings(rules) if version else ()


def figures_by(
    readings: Sequence[Reading], group_of: Mapping[str, str]
) -> Mapping[str, PlanFigures]:
    """Figures of each group of places, every place once; groups in the order of their names.

    Args:
        readings: Of one plan.
        group_of: The group of each place, by its name; places without one count in none.
    """
    groups: dict[str, list[Reading]] = defaultdict(list)
    for reading in readings:
        if group := group_of.get(reading.place_id):
            groups[group].append(reading)
    return {name: reading_figures(groups[name], len(groups[name])).together
            for name in sorted(groups)}  # fmt: skip


def judged_lot(
    decisions: Sequence[Recorded],
    sheets: Sequence[MapSheet],
    version: str,
    limit_m: float,
    *,
    rules: JobRules = USUAL_RULES,
    blind: bool = False,
) -> JudgedLot | None:
    """The sample of sheets that was drawn last, judged as all is now; None where none was drawn.

    Args:
        decisions: Everything recorded.
        sheets: Map sheets of the block as they are now.
        version: Of the mosaic.
        limit_m: Position error on the ground up to which a sheet is good, metres.
        rules: Limits of the job.
        blind: Without readings, for an observer who still reads.
    """
    drawn = standing_samples(decisions)
    if not drawn:
        return None
    evidence = _Evidence.of(decisions, "" if blind else version)
    lots = [
        _judged(sample_of(one), decisions, version, limit_m, evidence=evidence) for one in drawn
    ]
    newest, sample = lots[-1], sample_of(drawn[-1])
    earlier = [
        lot for one, lot in zip(drawn[:-1], lots, strict=False) if sample_of(one).lot == sample.lot
    ]
    names = {one.sheet.name for one in newest.sheets}
    judged = {one.sheet.name for lot in earlier for one in lot.sheets if one.state != "open"}
    as_drawn = sample.lot == lot_digest(sheets) and is_unchanged(sample)
    return replace(
        newest,
        changed=not as_drawn or sample.plan != smallest_plan(sample.plan.lot, rules),
        replaced=len(judged - names),
        rejected=sum(lot.state == "rejected" for lot in earlier),
    )


def _judged(
    sample: DrawSheets,
    decisions: Sequence[Recorded],
    version: str,
    limit_m: float,
    *,
    evidence: "_Evidence",
) -> JudgedLot:
    """One sample by what is known of its sheets."""
    said = {
        name: all(word.good for _, word in words if word.version == version)
        for name, words in words_of_sheets(decisions, sample.lot).items()
        if any(word.version == version for _, word in words)
    }
    sheets = (
        JudgedSheet(one, *evidence.on(one), said.get(one.name), limit_m) for one in sample.sheets
    )
    return JudgedLot(sample.plan, tuple(sheets), changed=False)


@dataclass(frozen=True, slots=True, eq=False)
class _Evidence:
    """What was marked and read anywhere in a mosaic."""

    faults: Sequence[tuple[float, float]]
    """Places of open faults."""
    readings: Sequence[tuple[tuple[float, float], Reading]]
    """Readings of the newest plan with their places."""

    @classmethod
    def of(cls, decisions: Sequence[Recorded], version: str) -> "_Evidence":
        """The evidence of one version of the mosaic."""
        marked = [one.said.place for one in standing_faults(decisions) if one.is_open]
        plans = standing_plans(decisions)[-1:]
        where = {p.place_id: (p.east, p.north) for plan in plans for p in plan.plan.places}
        read = [one for plan in plans for one in plan_readings(decisions, plan, version)]
        return cls(
            [place for place in marked if place is not None],
            [(where[one.place_id], one) for one in read],
        )

    def on(self, sheet: DrawnSheet) -> tuple[int, PlanFigures]:
        """How many faults are open on a sheet, and what readings on it say together."""
        read = [one for place, one in self.readings if _shows(sheet, place)]
        faults = sum(_shows(sheet, place) for place in self.faults)
        return faults, reading_figures(read, len(read)).together


def _shows(sheet: DrawnSheet, place: tuple[float, float]) -> bool:
    """Whether a sheet shows a place; one on an edge is of both sheets."""
    return bool(shapely.intersects_xy(sheet.area, *place))


def _places_read(
    decisions: Sequence[Recorded], plan: StandingPlan, version: str
) -> Float64[np.ndarray, "n 2"]:
    """Places of a plan that somebody read in a mosaic, metres."""
    read = {
        place_id
        for (place_id, _), (_, one) in readings_of(decisions).items()
        if one.version == version and one.mosaic is not None
    }
    places = [(one.east, one.north) for one in plan.plan.places if one.place_id in read]
    return np.array(places, dtype=np.float64).reshape(-1, 2)
