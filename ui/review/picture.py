"""The picture of a page as JSON-able values: the loop makes it, the page draws it."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np

from core.adjustment.adjusted import AdjustmentReport
from core.block import Measurement
from core.quality.check_points import independent_checks, kept_out
from core.quality.job_rules import USUAL_RULES, JobRules
from sessions.decisions import NOT_VISIBLE
from ui.review.compare import Drawn, HeightSource, Overlay, ground_from_pixel, overlay_of
from ui.review.drafts import apply_draft, by_hand
from ui.review.grounds import grounds_of
from ui.review.looks import round_all, short
from ui.review.misfit import misfits, without_pull
from ui.review.photo_points import letters_of, special_part
from ui.review.queue import coming
from ui.review.rows import Row
from ui.review.scene import ground_level_m
from ui.review.second_reading import readings_part
from ui.review.state import LAYERS, POINT_KINDS, DeskState, DoubtReason, Key, Notice, Remaking, Seat
from ui.review.to_measure import by_view
from ui.review.trial import Trial

IN_USE = ("auto", "accepted")
"""States in which a measurement of a control point takes part in the adjustment."""
DIGITS = {
    "doubt.peaks": 0, "doubt.misfit": 1, "doubt.tie": 1, "doubt.rays": 0, "doubt.fiducial": 0,
}  # fmt: skip
"""Digits behind the point of the figure in a reason for doubt; 2 by default."""
# design: one in ninety lies outside, of two coordinates together.
ELLIPSE_SIGMAS = 3.0
"""The ellipse about a predicted place has so many standard deviations."""
FINE_PLACES = 4
"""Of parts whose length the page tells with two, as the queue does."""
AHEAD = 2
"""Measurements whose pictures are fetched before they are needed."""
Part = dict[str, Any] | list[Any] | int | None


def order_part(seat: Seat, places: Mapping[Key, int]) -> Part:
    """The seat's order as places in the rows; the page filters by itself."""
    return [places[key] for key in seat.order if key in places]


def queue_part(
    seat: Seat, places: Mapping[Key, int], others: Iterable[tuple[Key, str]] = ()
) -> Part:
    """Where one seat is in the table, and what others are looking at."""
    return {
        "current": places.get(seat.current, -1) if seat.current else -1,
        "taken": [[places[key], name] for key, name in others if key in places],
        "filter": {
            "state": seat.filter.state,
            "photo": seat.filter.photo_id,
            "role": seat.filter.role,
            "text": seat.filter.text,
            "area": [list(corner) for corner in seat.filter.area],
        },
        "sort": {"column": seat.sorting.column, "descending": seat.sorting.descending},
        "explaining": [list(key) for key in seat.explaining],
        "turning": notice_part(seat.turning[1]) if seat.turning else None,
        "drafts": [places[draft.key] for draft in seat.drafts if draft.key in places],
    }


def notice_part(notice: Notice) -> Part:
    """A message; the page puts the values into the sentence of its language."""
    return {
        "text": notice.text,
        "values": dict(notice.values),
        "grave": notice.grave,
        "draft": notice.draft,
    }


def scene_part(seat: Seat, state: DeskState, top_m: float) -> Part:
    """The switches of the 3D scene, and what its legend and its scale bar are drawn from."""
    scene = seat.scene
    return {
        "layers": {layer: layer not in scene.hidden for layer in LAYERS},
        "rays": scene.rays,
        "scale": scene.vector_scale,
        "relief": scene.relief,
        "light": scene.light,
        "photo": scene.photo,
        "letters": letters_of(state.oriented),
        "inside": scene.inside,
        "top": top_m,
        "level": short(ground_level_m(state.oriented), 1),
    }


def status_part(
    state: DeskState,
    rows: Mapping[Key, Row],
    stale: tuple[str, ...],
    seat: Seat,
    others: Sequence[Seat] = (),
    *,
    rules: JobRules = USUAL_RULES,
) -> Part:
    """The status line; `others` sit at the desk as well."""
    report, before = state.report, state.before
    states = [row.state for row in rows.values() if row.role in POINT_KINDS]
    tally = {name: states.count(name) for name in ("auto", "accepted", "dubious", "rejected")}
    return {
        "sigma": short(report.sigma_nought, 4),
        "sigma_before": short(before.sigma_nought, 4) if before else None,
        "mp": short(position_error_m(report), 3),
        "mp_before": short(position_error_m(before), 3) if before else None,
        "checks": checks_told(report, rules),
        "converged": report.converged,
        "redundancy": report.redundancy,
        "counts": tally,
        "decided": state.decided,
        "drafts": len(seat.drafts) + len(seat.marks),
        "operator": seat.operator,
        "people": [[other.operator, list(other.current or ())] for other in others],
        "adjusting": state.adjusting,
        "stale": list(stale),
        "written": state.written,
        "written_ms": state.written_ms,
        "remaking": _making_part(state.remaking),
        "filling": _making_part(state.filling),
    }


def _making_part(making: Remaking | None) -> Part:
    """How far long work is; None while nobody asked for it."""
    if making is None:
        return None
    return {
        "share": short(making.done / making.total if making.total else 0.0, 3),
        "what": making.what,
        "left": short(making.seconds_left, 0),
        "cancelling": making.cancelling,
    }


def position_error_m(report: AdjustmentReport) -> float | None:
    """RMSE of the independent check points in plan, metres; None without any.

    The error of the survey is in it, as the ASPRS standard (edition 2) wants.
    """
    found = independent_checks(report)
    return found.plan_m if found.count else None


def checks_told(report: AdjustmentReport, rules: JobRules = USUAL_RULES) -> Part:
    """How many check points are independent, how many enough; proposals kept out, their RMSE."""
    own, proposals = independent_checks(report, rules), kept_out(report)
    return {
        "count": own.count,
        "least": own.least,
        "kept": proposals.count,
        "kept_rmse": short(proposals.plan_m, 3) if proposals.count else None,
    }


@dataclass(frozen=True, slots=True, eq=False)
class Pictured:
    """What the numbers of a point are drawn from, beside the state."""

    drawn: Drawn
    """Photos as their tiles are drawn."""
    dem: HeightSource
    """Heights."""
    trial: Trial | None = None
    """What turning the current measurement would do, once that is known."""
    history: Sequence[Part] = ()
    """What was decided about it."""
    opponent: str = ""
    """Who else took it out of use last."""
    beside: Sequence[Key] = ()
    """The same point in every scan, the current one among them."""


def point_part(state: DeskState, seat: Seat, rows: Mapping[Key, Row], pictured: Pictured) -> Part:
    """Everything about the current measurement: marks on the pictures, numbers, other scans."""
    key = seat.current
    row = rows.get(key) if key else None
    if key is None or row is None:
        return None
    drawn = pictured.drawn
    overlay = overlay_of(state, drawn, pictured.dem, key)
    if overlay is None:
        return None
    measurement = state.measurement_of(key)
    assert measurement is not None, "there is no overlay without one"
    oriented, draft = state.oriented, seat.draft_of(key)
    shown = apply_draft(state, draft) if draft else state
    figures = _figures(state, shown, row, pictured.trial)
    grounds = row.grounds if draft is None else _draft_grounds(shown, row, figures["ratio"])
    return {
        "key": list(key),
        "role": row.role,
        "state": row.state,
        "human": row.human,
        "scan": {
            "size": list(drawn[key[1]].photo.size_px),
            "version": overlay.version,
            "pixel": short(oriented.photos[key[1]].ground_pixel_m(oriented.camera_of(key[1])), 4),
        },
        "marks": _marks(overlay),
        "specials": special_part(drawn[key[1]], pictured.dem),
        "ellipse": _ellipse(state, key),
        "readings": readings_part(measurement),
        "raw": _raw(overlay),
        "draft": None
        if draft is None
        else {
            **_draft(overlay_of(shown, drawn, pictured.dem, key)),
            "asking": seat.asking == draft,
            "opponent": pictured.opponent,
        },
        "figures": figures,
        "why": [[ground.text, _value_of(ground.text, ground.value)] for ground in grounds],
        "peaks": _peaks(measurement, shown.measurement_of(key) or measurement),
        "others": _others(state, rows, pictured, pictured.beside or (key,)),
        "ahead": _ahead(state, seat, rows, drawn),
        "idle": state.is_idle(key),
        "fixed": key in state.extra.measurements,
        "trial": _trial(state, pictured.trial),
        "history": list(pictured.history),
    }


def _draft(overlay: Overlay | None) -> dict[str, Any]:
    """Where a draft lies: on the ground, and in the raw scan."""
    assert overlay is not None, "a draft is about a measurement that is shown"
    return {
        "place": round_all(overlay.measured[0], 4),
        "raw": round_all(overlay.measured_px[0], 3),
    }


def _draft_grounds(shown: DeskState, row: Row, ratio: float | None) -> tuple[DoubtReason, ...]:
    """Why a draft is doubtful where it lies, by the misfit that is shown of it."""
    placed, misfit = shown.measurement_of(row.key), misfits(shown, (row.key,)).get(row.key)
    assert placed is not None, "a draft is about a measurement"
    if misfit and ratio is not None:
        misfit = replace(misfit, ratio=ratio)
    return grounds_of(placed, misfit, row.controlled, math.nan)


def _trial(state: DeskState, trial: Trial | None) -> Part:
    """What rejecting, or accepting, would do."""
    if trial is None:
        return None
    return {
        "rejects": trial.rejects,
        "sigma": short(trial.sigma_nought, 3),
        "now": short(state.report.sigma_nought, 3),
        "shift": short(trial.shift_m, 2),
        "photo": trial.photo_id,
        "out": trial.left_out,
        "neighbours": [
            [*other.key, short(other.now_px, 2), short(other.then_px, 2)]
            for other in trial.neighbours
        ],
    }


def _marks(overlay: Overlay) -> Part:
    """Places on the ground, metres east and north."""
    return {
        "surveyed": round_all(overlay.surveyed[0], 4),
        "predicted": round_all(overlay.predicted[0], 4),
        "measured": round_all(overlay.measured[0], 4),
        "peaks": [round_all(place, 4) for place in overlay.peaks],
    }


def _ellipse(state: DeskState, key: Key) -> Part:
    """Where a point of the user lies in all likelihood: what a unit circle becomes, scan pixels."""
    expected = state.to_measure.predictions.get(key)
    if expected is None:
        return None
    root = ELLIPSE_SIGMAS * np.linalg.cholesky(expected.covariance)
    return [[short(value, 3) for value in line] for line in root]


def _raw(overlay: Overlay) -> Part:
    """The same places in pixels of the raw scan, and how ground maps into it nearby."""
    return {
        "predicted": round_all(overlay.predicted_px[0], 3),
        "measured": round_all(overlay.measured_px[0], 3),
        "peaks": [round_all(place, 3) for place in overlay.peaks_px],
        "matrix": [[short(value, 6) for value in line] for line in overlay.pixel_from_ground],
    }


def _figures(state: DeskState, shown: DeskState, row: Row, trial: Trial | None) -> dict[str, Any]:
    """The figures of a measurement, or those of the draft about it beside the measured ones.

    Args:
        state: The desk.
        shown: The same, with the draft kept where there is one.
        row: The measurement.
        trial: What keeping the draft would do, once that is known.
    """
    drafted = shown is not state
    measurement, point = shown.measurement_of(row.key), shown.point_of(row.key[0])
    assert measurement is not None, "rows are about measurements"
    assert point is not None, "rows are about points"
    unplaced = row.state == "predicted" and not drafted
    now = None if unplaced else misfits(shown, (row.key,)).get(row.key)
    before = state.report if drafted else state.before
    old = misfits(state, (row.key,), before).get(row.key) if before else None
    if now and drafted and trial and trial.against is not None:
        now = without_pull(now, trial.against)
    return {
        "misfit": round_all(now.pixels if now else None, FINE_PLACES),
        "misfit_before": round_all(old.pixels if old else None, FINE_PLACES),
        "ground": round_all(now.metres if now else None, FINE_PLACES),
        "ratio": short(now.ratio if now else None, 1),
        "residual": round_all(state.residual_px(row.key), 2) if row.state in IN_USE else None,
        "sigma": short(measurement.sigma_px, 2),
        "score": None if by_hand(measurement) else short(row.score, 2),
        "hand": by_hand(measurement),
        "redundancy": short(row.controlled, 2),
        "place": [short(measurement.column, 1), short(measurement.row, 1)],
        "source": point.source if row.role in POINT_KINDS else row.role,
        "surveyed": [short(value, 2) for value in point.position],
        "surveyed_sigma": [short(value, 2) for value in point.sigma_m],
        "remark": "" if drafted else state.remark(measurement),
    }


def _peaks(measurement: Measurement, shown: Measurement) -> Part:
    """Score, operator and distance of every candidate from the measured or drafted place."""
    return [
        {
            "score": short(peak.score, 2),
            "operator": peak.operator,
            "away": short(np.hypot(peak.column - shown.column, peak.row - shown.row), 1),
        }
        for peak in measurement.peaks
    ]


def _others(
    state: DeskState, rows: Mapping[Key, Row], pictured: Pictured, keys: Iterable[Key]
) -> Part:
    """Every scan that shows the point, the current one among them; the best view first."""
    drawn, dem = pictured.drawn, pictured.dem
    return [
        {
            "photo": key[1],
            "state": rows[key].state,
            "at": _place_in(state, drawn, dem, key),
            "hidden": is_hidden(state.block.measurements.get(key)),
            "score": short(rows[key].score, 2),
            "misfit": short(rows[key].misfit_px, 2),
            "version": drawn[key[1]].version,
        }
        for key in by_view(state.to_measure, keys)
        if key in rows and key[1] in drawn
    ]


def _place_in(state: DeskState, drawn: Drawn, dem: HeightSource, key: Key) -> Part:
    """Where a warped scan shows a point of the user, metres east and north; None of others."""
    measurement, point = state.measurement_of(key), state.point_of(key[0])
    if key not in state.to_measure.predictions or measurement is None or point is None:
        return None
    height_m = float(point.position[2])
    place = ground_from_pixel(measurement.pixel, drawn[key[1]], dem, height_m)[0, :2]
    return round_all(place, 2) if np.isfinite(place).all() else None


def is_hidden(measurement: Measurement | None) -> bool:
    """True where somebody said that the point cannot be seen."""
    return measurement is not None and measurement.reason == NOT_VISIBLE


def _ahead(state: DeskState, seat: Seat, rows: Mapping[Key, Row], drawn: Drawn) -> Part:
    """Photo, version and place of what comes next, so that its pictures are there in time."""
    ahead = [(key, state.point_of(key[0])) for key in islice(coming(rows, seat), AHEAD)]
    return [
        [key[1], drawn[key[1]].version, *_places(point.position[:2])]
        for key, point in ahead
        if key[1] in drawn and point is not None
    ]


def _places(position: Any) -> list[float | None]:
    return [short(float(value), 2) for value in position]


def _value_of(text: str, value: float) -> str:
    digits = DIGITS.get(text, 2)
    return f"{value:.{digits}f}"
