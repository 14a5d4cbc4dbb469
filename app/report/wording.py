"""Sentences of the accuracy report, chosen from the catalogue by its figures.

The short summary after a run is here too: scans set aside, and the gravest doubts.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from statistics import median
from typing import Any

from pyproj import CRS

from core.adjustment.significance import CONSTANT_NAMES
from core.doubts import Doubt
from core.geometry.crs import short_name
from core.said import say
from ui.words.catalogue import Teller

Figures = dict[str, Any]
WORST = 40
"""Rows of a table that only shows the worst."""
LINES = 8
"""No more than this; the report has them all."""
GRAVE = 0.5
"""Doubts of at least this gravity are told."""
SET_ASIDE = "scan-set-aside"
"""The doubts that repeat why a scan was set aside."""


def findings(figures: Figures, tell: Teller) -> dict[str, str]:
    """Headings that say what was found, by section."""
    block, adjustment, control = figures["block"], figures["adjustment"], figures["control"]
    settled = "report.converged" if adjustment["converged"] else "report.not-converged"
    return {
        "title": tell("report.title", **block),
        "subtitle": tell("report.subtitle.heights" if block["heights"] else "report.subtitle",
                         crs=short_name(CRS(block["crs"])), heights=block["heights"]),
        "headline": _headline(figures, tell),
        "sigma": _sigma(adjustment, tell),
        "settled": tell(settled, **adjustment),
        "doubts": _doubts(figures["doubts"], tell),
        "checks": _checks(figures["checks"], tell),
        "asprs": _asprs(figures["checks"], tell),
        "kept_out": _kept_out(figures["checks"], tell),
        "verdict": _verdict(figures["verdict"], tell),
        "decisions": _decisions(figures["decisions"], tell),
        "control": _control(control, tell),
        "in_use": tell("report.in-use", shown=min(len(control["in_use"]), WORST),
                       all=len(control["in_use"])),
        "left_out": _left_out(control, tell),
        "residuals": _residuals(adjustment["rms_px"], tell),
        "holes": _holes(figures["mosaic"], tell),
        "area_shown": _area_shown(figures["mosaic"], tell),
        "coverage": tell(
            "report.coverage",
            good=sum(photo["control_cells"] >= 5 for photo in figures["coverage"]),
            photos=len(figures["coverage"]),
        ),
        "ties": _ties(figures["ties"], tell),
        "overlaps": _overlaps(figures["overlaps"], tell),
        "exterior": _exterior(figures["exterior"], tell),
        "georeference": _georeference(figures["exterior"], tell),
        "interior": _interior(figures["interior"], tell),
        "cameras": _cameras(figures["cameras"], tell),
        "set_aside": _set_aside(len(figures["set_aside"]), tell),
    }  # fmt: skip


def certificate(figures: Figures, tell: Teller) -> list[str]:
    """What is predicted of the ground, or why the block is not released; sentences.

    Those of the findings are the engine's: in English, to be told again.
    """
    found = figures["certificate"]
    if found is None:
        return []
    if found["predicted_m"] is None:
        return [tell("report.not-certified"), tell("report.not-certified.nothing")]
    if found["reasons"]:
        return [tell("report.not-certified"), *found["sentences"]]
    verdict = figures["verdict"]
    disputed = [one for one in verdict if one["kind"].startswith("contradicted")]
    against = [one["sentence"] for one in disputed]
    count = sum(one["stands_for"] for one in disputed) - 1
    more = [tell("report.against-more", count=count)] if count > 0 else []
    block = figures["block"]
    alone = block["surveyed_datum"] or block["reference_ortho_sigma_m"] is None
    told = tell("report.predicted.alone" if alone else "report.predicted", **found)
    return [_borne_out(told, found, figures["checks"], tell), *against[:1], *more]


def _borne_out(told: str, found: Figures, checks: Figures, tell: Teller) -> str:
    """What is told of a block that may be given out; certified where check points say so."""
    if not checks["count"]:
        return tell("report.uncertified.none", told=told, least=checks["least"])
    low, high = checks["ratio_interval"]
    values = {name: checks[name] for name in ("count", "ratio", "rmse_plan_m", "least")}
    key = "certified" if found["certified"] else "uncertified.against"
    if not checks["enough"]:
        key = "uncertified.few"
    return tell(f"report.{key}", told=told, low=low, high=high, **values)


def _set_aside(count: int, tell: Teller) -> str:
    return tell("report.set-aside" if count else "report.set-aside.none", count=count)


def _residuals(rms_px: Figures, tell: Teller) -> str:
    told = {name: tell.number(rms_px.get(name), ".2f") for name in ("tie", "control")}
    return tell("report.residuals", **told)


def _headline(figures: Figures, tell: Teller) -> str:
    checks, block = figures["checks"], figures["block"]
    if checks["count"] and checks["enough"]:
        low, high = checks["m_p_interval"]
        told = {"m_p": checks["m_p"], "count": checks["count"]}
        return tell("report.headline.checks", low=low, high=high, **told)
    ortho, dem = block["reference_ortho_sigma_m"], block["reference_dem_sigma_m"]
    known = ortho is not None and dem is not None
    told = {"count": checks["count"], "m_p": checks.get("m_p"), "ortho": ortho, "dem": dem}
    if checks["count"]:
        return tell("report.headline.few.sigma" if known else "report.headline.few", **told)
    return tell("report.headline.relative.sigma" if known else "report.headline.relative", **told)


def parameter_told(name: str, tell: Teller) -> str:
    """A parameter of the adjustment in words; that of another camera has its name behind."""
    first, _, owner = name.partition(" ")
    if found := re.fullmatch(r"(gnss_shift|gnss_drift|misalignment|shift)_(\w)_\w+", first):
        said = tell(f"parameter.{found[1].replace('_', '-')}", axis=found[2])
    elif found := re.fullmatch(r"slope_(\w)_(east|north)_m", first):
        said = tell(f"parameter.slope.{found[2]}", axis=found[1])
    elif first in CONSTANT_NAMES:
        said = tell(f"parameter.{first}")
    else:
        return tell.again(name)
    return f"{said} {owner}".strip()


def _verdict(verdict: list[Figures], tell: Teller) -> str:
    worst = max((one["grave"] for one in verdict), default=0)
    return tell(f"report.verdict.{worst}", count=sum(one["grave"] > 0 for one in verdict))


def _decisions(decisions: Figures, tell: Teller) -> str:
    people = decisions["operators"]
    if not people:
        return tell("report.decisions.none")
    first, last = min(one["first"] for one in people), max(one["last"] for one in people)
    return tell(
        "report.decisions",
        count=decisions["count"],
        operators=[one["who"] for one in people],
        first=first,
        last=last,
        back=decisions["taken_back"],
    )


def _left_out(control: Figures, tell: Teller) -> str:
    if not control["left_out"]:
        return tell("report.left-out.none")
    statuses = [one["status"] for one in control["left_out"]]
    counts = {name: statuses.count(name) for name in sorted(set(statuses))}
    by_status = status_counts(counts, tell)
    return tell("report.left-out", count=len(statuses), by_status=by_status)


def status_counts(counts: Mapping[str, int], tell: Teller) -> list[str]:
    """How many measurements have each status."""
    names = {name: tell(f"report.status.{name}") for name in counts}
    return [tell("report.status", status=names[name], count=n) for name, n in counts.items()]


def _holes(mosaic: Figures | None, tell: Teller) -> str:
    if mosaic is None or not mosaic["holes"]:
        return tell("report.holes.none")
    area = sum(hole["area_m2"] for hole in mosaic["holes"])
    return tell("report.holes", count=len(mosaic["holes"]), area=area)


def _area_shown(mosaic: Figures | None, tell: Teller) -> str:
    """How much of the area asked for is there; empty where none was."""
    if mosaic is None or mosaic["area_shown"] is None:
        return ""
    return tell("report.area-shown", share=100 * mosaic["area_shown"])


def _sigma(adjustment: Figures, tell: Teller) -> str:
    value = adjustment["sigma_nought"]
    if value is None or adjustment["redundancy"] <= 0:
        return tell("report.sigma.none")
    low, high = adjustment["sigma_nought_range"]
    if value > high:
        return tell("report.sigma.large", value=value)
    return tell("report.sigma.small" if value < low else "report.sigma.fits", value=value)


def _doubts(doubts: list[Figures], tell: Teller) -> str:
    if not doubts:
        return tell("report.doubts.none")
    key = "report.doubts.one" if len(doubts) == 1 else "report.doubts.many"
    return tell(key, count=len(doubts), subject=doubts[0]["subject"])


def _checks(checks: Figures, tell: Teller) -> str:
    if not checks["count"]:
        return tell("report.checks.none")
    if not checks["enough"]:
        key = "report.checks.one" if checks["count"] == 1 else "report.checks.few"
        return tell(key, m_p=checks["m_p"], count=checks["count"])
    east, north = checks["mean_shift"]
    key = "report.checks.shifted" if any(checks["mean_significant"]) else "report.checks.level"
    return tell(key, m_p=checks["m_p"], east=east, north=north)


def checks_told(checks: Figures, tell: Teller) -> str:
    """The figures of all check points together."""
    low, high = checks["m_p_interval"]
    return tell(
        "report.checks.told.heights" if checks["heights"] else "report.checks.told",
        m_p=checks["m_p"], low=low, high=high, mean=checks["mean_length"],
        largest=checks["largest"], ce90=checks["circular_error_90"],
        le95=checks["linear_error_95"],
    )  # fmt: skip


def beyond_told(bars: Figures, tell: Teller, unit: str) -> str:
    """How many values lie outside a histogram; nothing where it shows them all."""
    if not bars["beyond"]:
        return ""
    told = {name: tell.number(bars[name], ",.3g") for name in (f"reach_{unit}", "largest")}
    reach, largest = told.values()
    return tell("report.beyond", count=bars["beyond"], reach=reach, largest=largest, unit=unit)


def comparison_told(one: Figures, tell: Teller) -> str:
    """The figures of a mosaic against another ortho."""
    low, high = one["m_p_interval"]
    return tell(
        "report.comparison.told", m_p=one["m_p"], low=low, high=high,
        all=one["m_p_with_mismatches"], largest=one["largest"],
        ce90=one["circular_error_90"], gsd=one["ground_sample_distance_m"],
    )  # fmt: skip


def refused_told(refused: Mapping[str, int], tell: Teller) -> str:
    """Why how many places were not counted."""
    told = [
        tell("report.comparison.refused.count", count=count, reason=tell.again(reason))
        for reason, count in refused.items()
    ]
    return tell("report.comparison.refused", reasons=told)


def _asprs(checks: Figures, tell: Teller) -> str:
    if not checks["count"]:
        return ""
    told = tell(
        "report.asprs.figures.heights" if checks["heights"] else "report.asprs.figures",
        total=checks["rmse_plan_m"],
        survey=checks["survey_rms_horizontal"],
        height=checks["rmse_height_m"],
        survey_height=checks["survey_rms_vertical"],
        space=checks["rmse_space_m"],
    )
    # What the standard asks for holds whatever the job asks for.
    enough = checks["count"] >= checks["asprs_least"]
    key = "report.asprs.enough" if enough else "report.asprs.few"
    return tell(key, count=checks["count"], least=checks["asprs_least"], told=told)


def _kept_out(checks: Figures, tell: Teller) -> str:
    """The proposals that were turned into check points; empty without any."""
    apart = checks["kept_out"]
    if not apart["count"]:
        return ""
    return tell("report.kept-out", count=apart["count"], rmse=apart["rmse_plan_m"])


def _control(control: Figures, tell: Teller) -> str:
    used = sum(control["by_status"].get(status, 0) for status in ("auto", "accepted"))
    if not used:
        return tell("report.control.none")
    points, left = control["points_used"], len(control["left_out"])
    return tell("report.control", used=used, points=points, left=left)


def _ties(ties: Figures, tell: Teller) -> str:
    if not ties["points"]:
        return tell("report.ties.none")
    several = sum(count for rays, count in ties["points_by_rays"].items() if int(rays) >= 3)
    return tell("report.ties", points=ties["points"], share=100 * several / ties["points"])


def _overlaps(overlaps: list[Figures], tell: Teller) -> str:
    untied = sum(pair["common_ties"] == 0 for pair in overlaps)
    key = "report.overlaps" if untied else "report.overlaps.all"
    return tell(key, pairs=len(overlaps), untied=untied)


def _georeference(rows: list[Figures], tell: Teller) -> str:
    off = {row["scan"]: row["georeference_off"]["rms_m"] for row in rows if row["oriented"]}
    if not off:
        return tell("report.georeference.plain")
    worst = max(off, key=lambda scan: off[scan])
    middle = median(off.values())
    return tell("report.georeference", median=middle, scan=worst, worst=off[worst])


def _exterior(rows: list[Figures], tell: Teller) -> str:
    known = [
        (max(row["sigma_centre_m"]), row["scan"])
        for row in rows
        if row["sigma_centre_m"] is not None and None not in row["sigma_centre_m"]
    ]
    if not known:
        return tell("report.exterior.plain")
    worst, scan = max(known)
    middle = median(value for value, _ in known)
    return tell("report.exterior", median=middle, worst=worst, scan=scan)


def _interior(rows: list[Figures], tell: Teller) -> str:
    fitted = [(row["rms_um"], row["scan"]) for row in rows if row["residuals_um"]]
    if not fitted:
        return tell("report.interior.none")
    worst, scan = max(fitted)
    places = film_places(rows)
    middle = fine(median(value for value, _ in fitted), tell, places)
    return tell("report.interior", median=middle, worst=fine(worst, tell, places), scan=scan)


def film_places(rows: list[Figures]) -> int:
    """Decimals of residuals on the film: one more for every power of ten below ten micrometres."""
    worst = max((row["rms_um"] for row in rows if row["residuals_um"]), default=0.0)
    return 0 if worst >= 10 else 1 if worst >= 1 else 2


def fine(value: float | None, tell: Teller, places: int = 2, sign: str = "") -> str:
    """A number with fixed places; what is not nought is never told as nought."""
    smallest = 10.0**-places
    if value and abs(value) < smallest / 2:
        return f"<\u202f{tell.number(smallest, f'.{places}f')}"
    return tell.number(value, f"{sign}.{places}f")


def _cameras(cameras: list[Figures], tell: Teller) -> str:
    changes = [
        abs(row["adjusted"]["principal_distance_mm"] - row["before"]["principal_distance_mm"])
        for row in cameras
        if "before" in row
    ]
    if not changes:
        return tell("report.cameras.plain")
    return tell("report.cameras", change=fine(max(changes), tell, 3))


def remarks(set_aside: Mapping[str, str], doubts: Sequence[Doubt], where: str) -> list[str]:
    """One line for each scan set aside, and for each kind of grave doubt.

    Args:
        set_aside: Reason by photo.
        doubts: Gravest first.
        where: The file that has all of it, for what there is no room for.
    """
    lines: list[str] = [say("Set aside: {reason}", reason=reason) for reason in set_aside.values()]
    lines += list(_of_kinds([doubt for doubt in doubts if doubt.gravity >= GRAVE]))
    hidden = len(lines) - LINES
    if hidden <= 0:
        return lines
    return [*islice(lines, LINES), say("... {count} more in {file}", count=hidden, file=where)]


def _of_kinds(doubts: Sequence[Doubt]) -> Iterator[str]:
    """The first doubt of each kind, and how many others are like it."""
    kinds: dict[str, list[Doubt]] = {}
    for doubt in doubts:
        if doubt.kind != SET_ASIDE:
            kinds.setdefault(doubt.kind, []).append(doubt)
    for first, *others in kinds.values():
        named = first.subject in first.message
        doubt = "Doubt: {message}" if named else "Doubt: {subject}: {message}"
        told = say(doubt, subject=first.subject, message=first.message)
        alike = "{told} ({count} more like this)"
        yield say(alike, told=told, count=len(others)) if others else told
