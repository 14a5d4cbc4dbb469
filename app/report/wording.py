"""Every sentence of the accuracy report, in one place, so that it can be told in Czech as well.

What is told after a run stands here too: scans set aside, and the gravest doubts, in a few lines.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from statistics import median
from typing import Any

from core.doubts import Doubt
from core.quality.rules import SIGMA_NOUGHT

Figures = dict[str, Any]
WORST = 40
"""Rows of a table that only shows the worst."""
LINES = 8
"""No more than this; the report has them all."""
GRAVE = 0.5
"""Doubts of at least this gravity are told."""
SET_ASIDE = "scan-set-aside"
"""The doubts that repeat why a scan was set aside."""

TEXT = {
    "title": "{name}: {oriented} of {photos} photos oriented",
    "subtitle": "Accuracy report of the block · {crs}{heights}",
    "written": "Written {at} by {operator} with Gruber {version}.",
    "headline_few": (
        "{points} in plan: m_p = {m_p:.2f} m, too few to judge. What follows says how well the "
        "block fits the reference ortho{sigma}."
    ),
    "headline_checks": (
        "m_p = {m_p:.2f} m in plan at {count} check points "
        "(95 % interval {low:.2f} to {high:.2f} m)."
    ),
    "headline_relative": (
        "There are no check points: what follows says how well the block fits the reference "
        "ortho{sigma}, not how well the mosaic lies on the ground."
    ),
    "certified": (
        "Position is predicted to {relative_m:.2f} m relative to the reference ortho, and to "
        "{predicted_m:.2f} m on the ground with the reference's own error, at worst "
        "{worst_m:.2f} m ({worst_photo}); up to {limit_m:.2f} m a block is certified."
    ),
    "against_more": "Others like it are in the verdict: {count}.",
    "not_certified": "This block is not certified. {sentences}",
    "not_certified_nothing": "No photo took part in an adjustment.",
    "sigma_of_reference": " (sigma {ortho:g} m, DEM {dem:g} m)",
    "sigma_fits": (
        "Sigma nought {value:.2f}: residuals are as large as the a-priori standard deviations say."
    ),
    "sigma_large": (
        "Sigma nought {value:.2f}: residuals are larger than expected. Measurements are worse than "
        "stated, or something systematic is left (film, DEM, a false control point)."
    ),
    "sigma_small": (
        "Sigma nought {value:.2f}: residuals are smaller than expected. The a-priori standard "
        "deviations are too cautious; all sigmas below are scaled with sigma nought."
    ),
    "sigma_none": "Sigma nought cannot be stated: there are no redundant measurements.",
    "converged": "The adjustment settled after {iterations} steps with {redundancy} redundant "
    "observations.",
    "not_converged": "The adjustment did not settle: orientations are the last sound ones. Do not "
    "use the mosaic before the doubts are decided.",
    "doubts_none": "No doubts are open",
    "doubts_one": "One doubt is open: {subject}",
    "doubts_many": "{count} doubts are open, the gravest about {subject}",
    "map": "Where the photos, the control and the ties lie",
    "map_caption": (
        "Residual vectors of control (adjusted minus known) and of check points (computed minus "
        "known), enlarged {scale:,.0f} times. Grey dots are tie points."
    ),
    "map_caption_plain": "Footprints, photo centres, control points; grey dots are tie points.",
    "checks": "Check points: m_p {m_p:.2f} m, {bias}",
    "checks_one": "One check point, {m_p:.2f} m off: too few to judge",
    "checks_few": "{points}, m_p {m_p:.2f} m: too few to judge",
    "bias_none": "no systematic shift",
    "bias_some": "shifted by {east:+.2f} m east, {north:+.2f} m north",
    "checks_none": "No check points: accuracy is relative to the reference ortho",
    "checks_none_text": (
        "The figures of this report say how well the block fits what it was fitted to. For a "
        "statement of accuracy, measure at least {least} independent points with role = check."
    ),
    "asprs_enough": (
        "{count} check points allow a statement by ASPRS Ed. 2 (2023): RMSE_H = {total:.2f} m, the "
        "error of the check points themselves ({survey:.2f} m) included."
    ),
    "asprs_few": (
        "ASPRS Ed. 2 (2023) asks for {least} check points; {points} allow no statement by that "
        "standard."
    ),
    "asprs_one": (
        "ASPRS Ed. 2 (2023) asks for {least} check points; one allows no statement by that "
        "standard."
    ),
    "comparison": "Against {name}: m_p {m_p:.2f} m at {count} places",
    "map_small": "Photos, control and check points with their residuals.",
    "mosaic_small": "The mosaic, its seams and its holes.",
    "mosaic_caption": (
        "{file} with its seams (each place is shown by the photo whose nadir is nearest) and, "
        "ringed, its holes."
    ),
    "no_holes": "There are no holes inside the mosaic.",
    "holes": (
        "{holes} inside the mosaic, {area} m² together: no photo shows the ground there. Take in a "
        "photo that does, or fill the place from another source."
    ),
    "verdict_0": "The block is good",
    "verdict_1": "The block can be used; {doubtful} to be looked at",
    "verdict_2": "The block is not good enough",
    "residuals": "Residuals: ties {tie} px, control {control} px",
    "histogram_tie": "Tie points: {count:,} residual coordinates, RMS {rms_px:.2f} px; the curve "
    "is the normal distribution of that RMS.",
    "histogram_control": "Control points: {count:,} residual coordinates, RMS {rms_px:.2f} px.",
    "films": "Residuals of each photo by parts of its film",
    "films_text": (
        "Mean residual (computed minus measured) of ties and control in each of 36 parts, three "
        "residuals at least; the longest arrow of all is {longest:.2f} px. What is alike in many "
        "photos belongs to lens or film."
    ),
    "parameters": "What was estimated with the photos, and what each is mixed up with",
    "control": "{used} at {points} {steer} the block; {left} left out",
    "in_use": "Measurements in use, worst first: {shown} of {all}",
    "in_use_text": (
        "dX, dY, dZ: adjusted minus known coordinates of the point. Without it: how far the "
        "measurement lies from where all others put it, in standard deviations. Redundancy: the "
        "share of an error in it that others would show. All of them are in control_points.csv."
    ),
    "left_out": (
        "Measurements left out: {count} ({by_status}). control_points.csv has each of them with "
        "its residual and the reason."
    ),
    "left_out_none": "No measurement was left out.",
    "decisions": "Decisions: {count}, by {operators}, {first} to {last} UTC; taken back: {back}",
    "decisions_none": "No decision was made at the desk",
    "control_none": "No control steers the block: it lies where its approximate orientation put it",
    "unchecked": (
        "Control measurements with a redundancy number below 0.1, which no other would show "
        "wrong: {count}."
    ),
    "reliability": (
        "How far the heights of peaks can be believed, without a label: across, the probability "
        "that their height alone states for the highest peak of each of {count} searches; up, the "
        "share that lies where the block expects it, less what chance brings there. Dots below the "
        "line: heights promise too much, and the place must decide, as it does before a proposal "
        "is used. Mean difference {error:.3f}."
    ),
    "coverage": "{good} of {photos} photos have control in at least five of nine cells",
    "coverage_text": (
        "Each square is the picture area of a photo, divided as the Gruber points lie; figures are "
        "used control measurements, bars below them tie points. Empty cells are marked."
    ),
    "spread": (
        "Along the block's edge known points are at most {rules[plan][edge_gap_bases]:.1f} bases "
        "apart in plan and {rules[heights][edge_gap_bases]:.1f} in height (rule: "
        "{rules[plan][edge_gap_most]:g} and {rules[heights][edge_gap_most]:g}); "
        "inside lie {rules[plan][per_model]:.1f} and "
        "{rules[heights][per_model]:.1f} for each stereo model (rule: "
        "{rules[plan][per_model_least]:g} and {rules[heights][per_model_least]:g})."
    ),
    "wanted": "Where one more control point would help most",
    "wanted_text": (
        "Standard deviation of position on the ground now, and with this point and those above it "
        "measured in all photos that show it."
    ),
    "ties": "{points} tie points, {share:.0f} % of them in three photos or more",
    "ties_none": "No tie points: every photo stands on its control alone",
    "overlaps": "Overlapping pairs of photos: {pairs}; without a common tie point: {untied}",
    "overlaps_all": "Overlapping pairs of photos: {pairs}, all of them tied",
    "exterior": (
        "Perspective centres are known to {median:.2f} m, the worst ({scan}) to {worst:.2f} m"
    ),
    "exterior_plain": "Exterior orientation",
    "georeference": (
        "Georeferences were off by {median:.0f} m, half of them by less, the worst ({scan}) by "
        "{worst:.0f} m"
    ),
    "georeference_plain": "Georeference",
    "interior": "Fiducials fit to {median} µm, the worst scan ({scan}) to {worst} µm",
    "interior_none": "No fiducials: interior orientation is nominal, from the middle of the scans",
    "cameras": "Cameras: principal distance changed by at most {change} mm",
    "cameras_plain": "Cameras",
    "set_aside": "{count} scans were set aside",
    "set_aside_one": "One scan was set aside",
    "set_aside_none": "No scan was set aside",
    "change": (
        "{same:.0f} % of the ground is recognised in the ortho of today, {different:.0f} % shows "
        "another; of the rest nobody can tell (change.gpkg, layers same and different)."
    ),
    "mosaic": "The mosaic: {columns} × {rows} pixels of {gsd:g} m from {photos} photos",
    "provenance": "How this was made",
}


def counted(number: int, thing: str) -> str:
    """`1 scan`, `2 scans`."""
    return f"{number:,} {thing}{'' if number == 1 else 's'}".replace(",", "\u202f")


def tell(key: str, **values: Any) -> str:
    """One sentence with its figures filled in."""
    return TEXT[key].format(**values)


def findings(figures: Figures) -> dict[str, str]:
    """Headings that say what was found, by section."""
    block = figures["block"]
    heights = f" · {block['heights']}" if block["heights"] else ""
    return {
        "title": tell("title", **block),
        "subtitle": tell("subtitle", crs=block["crs"], heights=heights),
        "headline": _headline(figures),
        "certificate": _certificate(figures["certificate"], figures["verdict"]),
        "sigma": _sigma(figures["adjustment"]),
        "settled": tell(
            "converged" if figures["adjustment"]["converged"] else "not_converged",
            **figures["adjustment"],
        ),
        "doubts": _doubts(figures["doubts"]),
        "checks": _checks(figures["checks"]),
        "asprs": _asprs(figures["checks"]),
        "verdict": _verdict(figures["verdict"]),
        "decisions": _decisions(figures["decisions"]),
        "control": _control(figures["control"]),
        "in_use": tell(
            "in_use",
            shown=min(len(figures["control"]["in_use"]), WORST),
            all=len(figures["control"]["in_use"]),
        ),
        "left_out": _left_out(figures["control"]),
        "residuals": tell(
            "residuals",
            **{
                name: "–" if rms is None else f"{rms:.2f}"
                for name in ("tie", "control")
                for rms in [figures["adjustment"]["rms_px"].get(name)]
            },
        ),
        "holes": _holes(figures["mosaic"]),
        "coverage": tell(
            "coverage",
            good=sum(photo["control_cells"] >= 5 for photo in figures["coverage"]),
            photos=len(figures["coverage"]),
        ),
        "ties": _ties(figures["ties"]),
        "overlaps": _overlaps(figures["overlaps"]),
        "exterior": _exterior(figures["exterior"]),
        "georeference": _georeference(figures["exterior"]),
        "interior": _interior(figures["interior"]),
        "cameras": _cameras(figures["cameras"]),
        "set_aside": _set_aside(len(figures["set_aside"])),
    }


def _set_aside(count: int) -> str:
    key = {0: "set_aside_none", 1: "set_aside_one"}.get(count, "set_aside")
    return tell(key, count=count)


def _headline(figures: Figures) -> str:
    checks, block = figures["checks"], figures["block"]
    if checks["count"] and checks["enough"]:
        low, high = checks["m_p_interval"]
        return tell("headline_checks", m_p=checks["m_p"], count=checks["count"], low=low, high=high)
    ortho, dem = block["reference_ortho_sigma_m"], block["reference_dem_sigma_m"]
    known = ortho is not None and dem is not None
    sigma = tell("sigma_of_reference", ortho=ortho, dem=dem) if known else ""
    if checks["count"]:
        points = counted(checks["count"], "check point")
        return tell("headline_few", points=points, m_p=checks["m_p"], sigma=sigma)
    return tell("headline_relative", sigma=sigma)


def _verdict(verdict: list[Figures]) -> str:
    doubtful = counted(sum(one["grave"] > 0 for one in verdict), "finding")
    return tell(f"verdict_{max((one['grave'] for one in verdict), default=0)}", doubtful=doubtful)


def _decisions(decisions: Figures) -> str:
    people = decisions["operators"]
    if not people:
        return tell("decisions_none")
    first, last = min(one["first"] for one in people), max(one["last"] for one in people)
    return tell(
        "decisions",
        count=decisions["count"],
        operators=", ".join(one["who"] for one in people),
        first=first[:16].replace("T", " "),
        last=last[:16].replace("T", " "),
        back=decisions["taken_back"],
    )


def _left_out(control: Figures) -> str:
    if not control["left_out"]:
        return tell("left_out_none")
    statuses = [one["status"] for one in control["left_out"]]
    by_status = ", ".join(f"{name} {statuses.count(name)}" for name in sorted(set(statuses)))
    return tell("left_out", count=len(statuses), by_status=by_status)


def _holes(mosaic: Figures | None) -> str:
    if mosaic is None or not mosaic["holes"]:
        return tell("no_holes")
    area = sum(hole["area_m2"] for hole in mosaic["holes"])
    return tell("holes", holes=counted(len(mosaic["holes"]), "hole"), area=f"{area:.0f}")


def _certificate(certificate: Figures | None, verdict: list[Figures]) -> str:
    if certificate is None:
        return ""
    against = [one["sentence"] for one in verdict if one["kind"].startswith("contradicted")]
    if certificate["predicted_m"] is None:
        return tell("not_certified", sentences=tell("not_certified_nothing"))
    if not certificate["reasons"]:
        more = [tell("against_more", count=len(against) - 1)] if len(against) > 1 else []
        return " ".join([tell("certified", **certificate), *against[:1], *more])
    return tell("not_certified", sentences=" ".join(certificate["sentences"]))


def _sigma(adjustment: Figures) -> str:
    value = adjustment["sigma_nought"]
    if value is None or adjustment["redundancy"] <= 0:
        return tell("sigma_none")
    low, high = SIGMA_NOUGHT
    if value > high:
        return tell("sigma_large", value=value)
    return tell("sigma_small" if value < low else "sigma_fits", value=value)


def _doubts(doubts: list[Figures]) -> str:
    if not doubts:
        return tell("doubts_none")
    key = "doubts_one" if len(doubts) == 1 else "doubts_many"
    return tell(key, count=len(doubts), subject=doubts[0]["subject"])


def _checks(checks: Figures) -> str:
    if not checks["count"]:
        return tell("checks_none")
    if not checks["enough"]:
        points = counted(checks["count"], "check point")
        key = "checks_one" if checks["count"] == 1 else "checks_few"
        return tell(key, m_p=checks["m_p"], points=points)
    east, north = checks["mean_shift"]
    shifted = any(checks["mean_significant"])
    bias = tell("bias_some", east=east, north=north) if shifted else tell("bias_none")
    return tell("checks", m_p=checks["m_p"], bias=bias)


def _asprs(checks: Figures) -> str:
    if not checks["count"]:
        return ""
    survey = checks["survey_rms_horizontal"]
    total = (checks["m_p"] ** 2 + survey**2) ** 0.5
    key = "asprs_one" if checks["count"] == 1 else "asprs_few"
    return tell(
        "asprs_enough" if checks["asprs_enough"] else key,
        count=checks["count"],
        points=counted(checks["count"], "check point"),
        least=checks["asprs_least"],
        total=total,
        survey=survey,
    )


def _control(control: Figures) -> str:
    used = sum(control["by_status"].get(status, 0) for status in ("auto", "accepted"))
    if not used:
        return tell("control_none")
    return tell(
        "control",
        used=counted(used, "measurement"),
        points=counted(control["points_used"], "control point"),
        steer="steers" if used == 1 else "steer",
        left=len(control["left_out"]),
    )


def _ties(ties: Figures) -> str:
    if not ties["points"]:
        return tell("ties_none")
    several = sum(count for rays, count in ties["points_by_rays"].items() if int(rays) >= 3)
    return tell("ties", points=ties["points"], share=100 * several / ties["points"])


def _overlaps(overlaps: list[Figures]) -> str:
    untied = sum(pair["common_ties"] == 0 for pair in overlaps)
    key = "overlaps" if untied else "overlaps_all"
    return tell(key, pairs=len(overlaps), untied=untied)


def _georeference(rows: list[Figures]) -> str:
    off = {row["scan"]: row["georeference_off"]["rms_m"] for row in rows if row["oriented"]}
    if not off:
        return tell("georeference_plain")
    worst = max(off, key=lambda scan: off[scan])
    return tell("georeference", median=median(off.values()), scan=worst, worst=off[worst])


def _exterior(rows: list[Figures]) -> str:
    known = [
        (max(row["sigma_centre_m"]), row["scan"])
        for row in rows
        if row["sigma_centre_m"] is not None and None not in row["sigma_centre_m"]
    ]
    if not known:
        return tell("exterior_plain")
    worst, scan = max(known)
    middle = median(value for value, _ in known)
    return tell("exterior", median=middle, worst=worst, scan=scan)


def _interior(rows: list[Figures]) -> str:
    fitted = [(row["rms_um"], row["scan"]) for row in rows if row["residuals_um"]]
    if not fitted:
        return tell("interior_none")
    worst, scan = max(fitted)
    middle, places = median(value for value, _ in fitted), film_places(rows)
    return tell("interior", median=fine(middle, places), worst=fine(worst, places), scan=scan)


def film_places(rows: list[Figures]) -> int:
    """Decimals of residuals on the film: one more for every power of ten below ten micrometres."""
    worst = max((row["rms_um"] for row in rows if row["residuals_um"]), default=0.0)
    return 0 if worst >= 10 else 1 if worst >= 1 else 2


def fine(value: float | None, places: int = 2, sign: str = "") -> str:
    """A number with fixed places; what is not nought is never told as nought."""
    if value is None:
        return "–"
    smallest = 10.0**-places
    if value and abs(value) < smallest / 2:
        return f"<\u202f{smallest:.{places}f}"
    return f"{value:{sign}.{places}f}".replace("-", "−")


def _cameras(cameras: list[Figures]) -> str:
    changes = [
        abs(row["adjusted"]["principal_distance_mm"] - row["before"]["principal_distance_mm"])
        for row in cameras
        if "before" in row
    ]
    return tell("cameras", change=fine(max(changes), 3)) if changes else tell("cameras_plain")


def remarks(set_aside: Mapping[str, str], doubts: Sequence[Doubt], where: str) -> list[str]:
    """One line for each scan set aside, and for each kind of grave doubt.

    Args:
        set_aside: Reason by photo.
        doubts: Gravest first.
        where: The file that has all of it, for what there is no room for.
    """
    lines = [f"Set aside: {reason}" for reason in set_aside.values()]
    lines += list(_of_kinds([doubt for doubt in doubts if doubt.gravity >= GRAVE]))
    hidden = len(lines) - LINES
    return lines if hidden <= 0 else [*islice(lines, LINES), f"... {hidden} more in {where}"]


def _of_kinds(doubts: Sequence[Doubt]) -> Iterator[str]:
    """The first doubt of each kind, and how many others are like it."""
    kinds: dict[str, list[Doubt]] = {}
    for doubt in doubts:
        if doubt.kind != SET_ASIDE:
            kinds.setdefault(doubt.kind, []).append(doubt)
    for first, *others in kinds.values():
        named = "" if first.subject in first.message else f"{first.subject}: "
        like = f" ({len(others)} more like this)" if others else ""
        yield f"Doubt: {named}{first.message}{like}"
