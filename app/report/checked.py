"""What people found: plans of checks, readings, rules, signatures and remarks; JSON-able."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from app.report.decisions import minute
from app.report.protocol_figures import PLACES
from app.report.tables import Cell
from core.adjustment.adjusted import AdjustmentReport
from core.geometry.crs import Bounds
from core.mosaic.misfit import photos_shown
from core.mosaic.seams import Seam
from core.quality.check_plan import CheckPlace
from core.quality.job_rules import USUAL_RULES, JobRules
from core.quality.judged_rules import JudgedRule
from core.quality.readings import (
    Foretold,
    PlanFigures,
    Reading,
    ReadingFigures,
)
from core.sheets.map_sheets import MapSheet
from sessions.checked import Checked, figures_by
from sessions.checks import (
    StandingPlan,
    checked_figures,
    difference_m,
    judged_parts,
    outdated_readings,
    plan_readings,
    readings_of,
    standing_plans,
    standing_signatures,
)
from sessions.decisions import Recorded
from sessions.remarks import standing_faults, standing_remarks
from ui.review.rule_rows import source_of
from ui.words.catalogue import Teller

Figures = dict[str, Any]


REMARKS = "remarks.csv"
REMARK_COLUMNS = "number,when,who,subject,name,X,Y,fault,words,assigned,state"


def checked_part(
    report: AdjustmentReport,
    decisions: Sequence[Recorded],
    version: str,
    checked: Checked | None,
    judged: Sequence[JudgedRule],
    *,
    seams: Sequence[Seam],
    bounds: Bounds,
    rules: JobRules = USUAL_RULES,
    sheets: Sequence[MapSheet] = (),
) -> Figures:
    """Everything about checks that the report tells.

    Args:
        report: The adjustment.
        decisions: Everything recorded.
        version: Of the mosaic.
        checked: What readings say; None without a plan.
        judged: Every rule that concerns the block.
        seams: Which photo, taken when, the mosaic shows where.
        bounds: Of the block's footprints, metres.
        rules: Limits of the job.
        sheets: Map sheets of the block.
    """
    plans = standing_plans(decisions)
    read = plan_readings(decisions, plans[-1], version) if plans else ()
    now = judged_parts(decisions, report, version, rules, sheets)
    return {
        "plans": [_plan(one, decisions, version) for one in plans],
        "figures": None if checked is None else _figures(checked.figures, rules),
        "groups": _groups(read, plans[-1].plan.places, seams, bounds) if read else {},
        "prediction": None if checked is None else _prediction(checked.foretold),
        "readings": _readings(plans, decisions, version),
        "rules": [
            {
                "rule": one.rule.name,
                "grave": one.finding.grave,
                "kind": one.finding.kind,
                "sentence": one.finding.sentence,
                "values": dict(one.finding.values),
                "more": one.more,
                "source": source_of(one),
            }
            for one in judged
        ],
        "signatures": signature_figures(decisions, now),
        "remarks": remark_figures(decisions),
    }


def signature_figures(decisions: Sequence[Recorded], now: Mapping[str, str]) -> list[Figures]:
    """Signatures that stand, the newest first."""
    return [
        {
            "who": one.recorded.who,
            "when": minute(one.recorded.when),
            "verdict": one.said.verdict,
            "remark": one.said.remark,
            "digest": one.digest,
            "holds": one.holds,
            "changed": list(one.changed),
        }
        for one in standing_signatures(decisions, now)
    ]


def remark_figures(decisions: Sequence[Recorded]) -> list[Figures]:
    """Everything that was said of places, photos, points and decisions, in order.

    A fault is a remark with a kind; it is `open` or not, and its answers are about its number.
    """
    faults = {one.recorded.decision_id: one for one in standing_faults(decisions)}
    return [
        {
            "number": item.decision_id,
            "when": minute(item.when),
            "who": item.who,
            "subject": said.subject,
            "name": said.name,
            "place": said.place,
            "fault": said.fault,
            "words": said.words,
            "assigned": fault.assigned if fault else said.assigned,
            "open": fault.is_open if fault else None,
            "closed_by": closing.who if closing else "",
            "closed_when": minute(closing.when) if closing else "",
            "closes": said.closes,
        }
        for item, said in standing_remarks(decisions)
        for fault in [faults.get(item.decision_id)]
        for closing in [fault.closing if fault else None]
    ]


def remark_rows(decisions: Sequence[Recorded]) -> list[tuple[Cell, ...]]:
    """Rows of the table of remarks."""
    state = {True: "open", False: "closed", None: ""}
    return [
        (
            one["number"],
            one["when"],
            one["who"],
            one["subject"],
            one["name"],
            *(one["place"] or (None, None)),
            one["fault"],
            one["words"],
            one["assigned"],
            state[one["open"] if one["closes"] is None else not one["closes"]],
        )
        for one in remark_figures(decisions)
    ]


def observer_rows(figures: Figures | None) -> list[tuple[str, Figures]]:
    """Rows of the table of observers: each alone, then the differences of every two."""
    if figures is None:
        return []
    return [(one["who"], one) for one in (*figures["observers"], *figures["pairs"])]


def readings_told(checked: Figures, tell: Teller, short: Mapping[str, str]) -> Figures:
    """Title of the chapter of readings, its table of observers, and one for each grouping.

    Everything in one group is what all places say: such a grouping is left out.
    """
    names = {"parts": "report.place.", "kinds": "report.readings.kind."}

    def title(name: str, group: str) -> str:
        return tell(names[name] + group) if name in names else short.get(group, group)

    groups = {
        name: [(title(name, row["group"]), row) for row in rows]
        for name, rows in checked["groups"].items()
        if len(rows) > 1
    }
    return {
        "readings_title": readings_title(checked, tell),
        "by_observer": observer_rows(checked["figures"]),
        "by_group": groups,
    }


def readings_title(checked: Figures, tell: Teller) -> str:
    """What readings say, in one sentence."""
    found = checked["figures"]
    if found is None or not found["read"]:
        return tell("report.readings.none")
    together = found["together"]
    low, high = together["m_p_interval"]
    return tell("report.readings", count=found["read"], m_p=together["m_p"], low=low, high=high)


def _plan(one: StandingPlan, decisions: Sequence[Recorded], version: str) -> Figures:
    """A plan, with m_p of its readings where there are some."""
    found = checked_figures(decisions, one, version)
    return {
        "when": minute(one.recorded.when),
        "who": one.recorded.who,
        "places": one.plan.count,
        "spares": len(one.plan.places) - one.plan.count,
        "passed_over": found.unreadable,
        "cells": list(one.plan.cells),
        "seed": one.plan.seed,
        "source": one.plan.source,
        "digest": one.plan.digest,
        "unchanged": one.unchanged,
        "before_control": one.plan.beforehand,
        "read": found.read,
        "outdated": outdated_readings(decisions, one, version),
        "m_p": found.together.m_p,
    }


def _figures(found: ReadingFigures, rules: JobRules) -> Figures:
    return {
        "planned": found.planned,
        "read": found.read,
        "unreadable": found.unreadable,
        "doubled": found.doubled,
        "enough": found.enough(rules),
        "together": plan_row(found.together),
        "observers": [{"who": who, **plan_row(one)} for who, one in found.by_observer.items()],
        "pairs": [
            {
                "who": f"{one.first} / {one.second}",
                **plan_row(one.figures),
                "observer_m": one.observer_m,
            }
            for one in found.pairs
        ],
        "observer_m": found.observer_m,
        "observer_share": found.observer_share,
    }


def _groups(
    read: Sequence[Reading], places: Sequence[CheckPlace], seams: Sequence[Seam], bounds: Bounds
) -> Figures:
    """Figures by part of the block, kind of place, photo that is shown there, and its year."""
    grounds = np.array([(place.east, place.north) for place in places]).reshape(-1, 2)
    names = [place.place_id for place in places]
    photos = dict(zip(names, photos_shown(grounds, seams), strict=True))
    years = {seam.photo_id: seam.date[:4] for seam in seams}
    west, south, east, north = bounds
    size = np.maximum((east - west, north - south), 1e-9)
    cells = np.clip(((grounds - (west, south)) / size * 3).astype(int), 0, 2)
    parts = [PLACES[3 * (2 - row) + column] for column, row in cells.tolist()]
    kinds = ["surveyed" if place.sigma_m > 0 else "reference" for place in places]
    groups = {
        "parts": dict(zip(names, parts, strict=True)),
        "kinds": dict(zip(names, kinds, strict=True)),
        "photos": photos,
        "years": {name: years.get(photo, "") for name, photo in photos.items()},
    }
    told = {
        name: [{"group": group, **plan_row(row)} for group, row in figures_by(read, of).items()]
        for name, of in groups.items()
    }
    return told | {"parts": sorted(told["parts"], key=lambda row: PLACES.index(row["group"]))}


def plan_row(one: PlanFigures) -> Figures:
    """Figures in the order of tables 5 and 6 of the report on the Czech orthophoto, and more."""
    return {
        "count": one.count,
        "c": list(one.mean_m),
        "chance": list(one.chance),
        "shifted": list(one.shifted),
        "s": list(one.deviation_m),
        "m": list(one.rms_m),
        "m_interval": [list(pair) for pair in one.rms_interval_m],
        "m_p": one.m_p,
        "m_p_interval": list(one.m_p_interval),
        "extreme": list(one.extreme_m),
        "nmad": list(one.nmad_m),
        "circular_error_90": one.circular_error_90,
        "survey_m": one.survey_m,
        "rmse_plan_m": one.product_m,
        "thesis_mean_m": one.thesis_mean_m,
    }


def _prediction(one: Foretold) -> Figures:
    return {
        "predicted_m": one.predicted_m,
        "ratio": one.ratio,
        "interval": list(one.interval),
        "said": one.said,
    }


def _readings(
    plans: Sequence[StandingPlan], decisions: Sequence[Recorded], version: str
) -> list[Figures]:
    """Every standing reading of every plan, place by place."""
    names = [place.place_id for one in plans for place in one.plan.places]
    newest = {place.place_id for one in plans[-1:] for place in one.plan.places}
    read = readings_of(decisions)
    return [
        {
            "place": one.place_id,
            "who": who,
            "when": minute(item.when),
            "reference": None if one.reference is None else list(one.reference),
            "difference_m": None if one.mosaic is None else list(difference_m(one)),
            "reason": one.reason,
            "of_this_mosaic": one.version == version,
            "of_newest_plan": one.place_id in newest,
        }
        for (_, who), (item, one) in sorted(read.items())
        if one.place_id in names
    ]
