"""The adjustment's protocol as files: `adjustment.txt` to read, `adjustment.json` for machines."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

from app.report.protocol_figures import json_value, protocol_figures
from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.adjustment.influence import Influence
from core.quality.job_rules import USUAL_RULES, JobRules
from sessions.atomic_write import whole_file

CLASSES = {
    "tie": "tie points, image",
    "control_image": "control, image",
    "control_plan": "control, plan",
    "control_height": "control, height",
    "dem": "terrain heights",
    "centre": "measured centres",
    "angles": "measured angles",
}
WIDTH = 100


def write_protocol(
    folder: Path,
    name: str,
    report: AdjustmentReport,
    options: AdjustmentOptions,
    influence: Influence | None,
    *,
    rules: JobRules = USUAL_RULES,
) -> tuple[Path, Path]:
    """Write the protocol of an adjustment, each file whole or not at all.

    Args:
        folder: The results folder of the block.
        name: Name of the block.
        report: The adjusted block.
        options: What it was adjusted with.
        influence: Its equations; None where no photo took part.
        rules: Limits of the job.
    """
    told = protocol_figures(name, report, options, influence, rules=rules)
    figures = cast("dict[str, Any]", json_value(told))
    text_path, json_path = folder / "adjustment.txt", folder / "adjustment.json"
    with whole_file(json_path) as temporary:
        text = json.dumps(figures, indent=1, ensure_ascii=False, allow_nan=False)
        temporary.write_text(text, encoding="utf-8")
    with whole_file(text_path) as temporary:
        temporary.write_text(protocol_text(figures), encoding="utf-8")
    return text_path, json_path


def protocol_text(figures: Mapping[str, Any]) -> str:
    """The protocol as text, from the figures of `adjustment.json`."""
    parts: tuple[Callable[[Mapping[str, Any]], Iterable[str]], ...] = (
        _heading,
        _options,
        _quality,
        _doubts,
        _classes,
        _parameters,
        _ties,
        _photos,
        _ground,
        _control,
        _spread,
        _checks,
        _methods,
        _exterior,
        _excluded,
    )
    return "\n".join(line.rstrip() for part in parts for line in part(figures)) + "\n"


def _heading(f: Mapping[str, Any]) -> list[str]:
    b, o = f["block"], f["options"]
    applied = ("on" if o[key] else "off" for key in ("refraction", "earth_curvature"))
    return [
        f"ADJUSTMENT OF {b['name']}",
        "=" * WIDTH,
        f"CRS                     {b['crs']}",
        f"photos                  {b['photos_adjusted']} of {b['photos']}, {b['strips']} strips",
        f"mean scale              1 : {_n(b['mean_scale_number'], 0)}",
        f"height over ground      {_n(b['mean_height_over_ground_m'], 1)} m",
        f"mean ground height      {_n(b['mean_ground_height_m'], 1)} m",
        f"refraction, curvature   {', '.join(applied)}",
        "",
    ]


def _options(f: Mapping[str, Any]) -> list[str]:
    o, s = f["options"], f["options"]["a_priori_sigmas"]
    sets = ", ".join(o["self_calibration"]) or "none"
    tests = "none" if o["gross_errors"] == "none" else (
        f"{o['gross_errors']} test, risk {o['risk']:g}, critical value {_n(o['critical_value'])}"
    )  # fmt: skip
    control = ", ".join(_n(s[f"control_{axis}_m"], 3) for axis in "XYZ")
    return [
        "A-PRIORI STANDARD DEVIATIONS (medians) AND OPTIONS",
        f"tie points              {_n(s['tie_px'], 3)} px",
        f"control in the photos   {_n(s['control_px'], 3)} px",
        f"control X, Y, Z         {control} m",
        f"terrain heights         {_n(s['dem_m'])} m",
        f"camera constants        {'estimated' if o['cameras_estimated'] else 'held'}, priors "
        f"c {s['principal_distance_mm']:g} mm, x0 y0 {s['principal_point_mm']:g} mm, "
        f"radial {s['distortion_um']:g} um",
        f"self-calibration        {sets}, per {o['self_calibration_per']}, "
        f"prior {s['additional_um']:g} um",
        f"GNSS shift, drift       {o['gnss_shift']}, {'on' if o['gnss_drift'] else 'off'}; "
        f"misalignment {'on' if o['imu_misalignment'] else 'off'}",
        f"network                 {o['network']}",
        f"gross errors            {tests}",
        f"variance components     {'estimated' if o['variance_components'] else 'as stated'}",
        "",
    ]


def _quality(f: Mapping[str, Any]) -> list[str]:
    q = f["quality"]
    return [
        "RESULT",
        f"sigma nought            {_n(q['sigma_nought'], 4)} "
        f"= {_n(q['sigma_nought_px'], 3)} px = {_n(q['sigma_nought_um'], 2)} um (tie points)",
        f"redundancy              {q['redundancy']}",
        f"steps                   {q['iterations']}, "
        + ("settled" if q["converged"] else "NOT SETTLED: the last sound orientations are given"),
        f"condition               {_n(q['condition'], 0)}",
        "",
    ]


def _doubts(f: Mapping[str, Any]) -> list[str]:
    if not f["doubts"]:
        return []
    lines = [f"- {d['kind']} ({d['subject']}): {d['message']}" for d in f["doubts"]]
    return ["DOUBTS", *lines, ""]


def _classes(f: Mapping[str, Any]) -> list[str]:
    rows = [
        f"{CLASSES[name]:<22}{c['observations']:>10}{c['redundancy']:>12.1f}"
        f"{c['mean_redundancy_number']:>9.2f}{_n(c['sigma_ratio'], 3):>14}"
        f"{c['weight_factor']:>12.3f}"
        for name, c in f["classes"].items()
    ]
    head = "class                 observations  redundancy   mean r  found/stated   factor"
    return ["CLASSES OF OBSERVATIONS", head, *rows, ""]


def _parameters(f: Mapping[str, Any]) -> list[str]:
    rows = [
        f"{p['owner']:<16}{p['name']:<26}{p['value']:>12.5f}{p['sigma']:>12.5f}{p['test']:>9.1f}"
        f"{p['correlation']:>8.2f} {p['partner']}{'  HELD' if p['held'] else ''}"
        for p in f["parameters"]
    ]
    head = (
        "owner           parameter                      change       sigma     t    "
        "largest correlation with"
    )
    return ["CAMERAS AND SHARED PARAMETERS", head, *rows, ""] if rows else []


def _ties(f: Mapping[str, Any]) -> list[str]:
    t = f["ties"]
    numbers = sorted({int(n) for n in (*t["within_strips"], *t["across_strips"])})
    rows = [
        f"{n:>4}-fold{t['within_strips'].get(str(n), 0):>14}{t['across_strips'].get(str(n), 0):>14}"
        for n in numbers
    ]
    return [
        "TIE POINTS",
        f"points {t['points']}, rays {t['rays']}, accepted {_n(t['accepted_percent'], 1)} %",
        f"RMS column, row {_list(t['rms_px'], 3)} px; largest {_list(t['largest_px'], 2)} px",
        "rays       within strip  across strips",
        *rows,
        "",
    ]


def _photos(f: Mapping[str, Any]) -> list[str]:
    rows = [
        f"{p['scan']:<24}{p['strip']:>5}{p['tie_points']:>8}{_n(p['accepted_percent'], 1):>10}"
        f"{p['multi_ray_points']:>11}{p['control']:>9}{_list(p['rms_px'], 2):>16}"
        f"{_n(p['largest_px'], 2):>9}"
        for p in f["photos"]
    ]
    head = (
        "scan                    strip    ties  accepted %  multi-ray  control   RMS col, row px"
        "  largest"
    )
    return ["PHOTOS", head, *rows, ""]


def _ground(f: Mapping[str, Any]) -> list[str]:
    """Standard deviations of the ground at the nine places of each photo."""
    rows = [
        f"{p['scan']:<24}"
        + "".join(
            f"{(e * e + n * n) ** 0.5:>8.2f}" if e is not None and n is not None else f"{'-':>8}"
            for e, n in p["ground_sigma_m"].values()
        )
        for p in f["photos"]
        if p["ground_sigma_m"]
    ]
    head = (
        "scan                          NW       N      NE       W  centre       E      SW"
        "       S      SE"
    )
    return [
        "STANDARD DEVIATION OF POSITION ON THE GROUND (m), from the orientation",
        head,
        *rows,
        "",
    ]


def _control(f: Mapping[str, Any]) -> list[str]:
    c = f["control"]
    points = [
        f"{p['point_id']:<20}{_list(p['difference_m'], 3):>27}{_list(p['sigma_m'], 3):>23}"
        f"{_list(p['left_out_m'] or [None] * 3, 3):>27}{_n(p['left_out_test'], 1):>7}"
        for p in c["points"]
    ]
    rays = [
        f"{m['point_id']:<20}{m['scan']:<20}{_list(m['residual_px'], 2):>15}"
        f"{m['redundancy_number']:>6.2f}{_n(m['test'], 1):>6}"
        f"{_n(m['smallest_detectable_px'], 1):>9}"
        f"{_n(m['its_effect_on_the_ground_m'], 2):>9}{_n(m['shift_if_rejected_m'], 3):>9}  "
        f"{m['says']}"
        for m in c["measurements"]
    ]
    return [
        "CONTROL POINTS",
        f"RMS X, Y, Z {_list(c['rms_m'], 3)} m; largest {_list(c['largest_m'], 3)} m; "
        f"each without itself {_list(c['left_out_rms_m'], 3)} m",
        "point                     adjusted - known (m)              sigma (m)"
        "         without itself (m)      t",
        *points,
        "",
        "point               scan                residual px     r     t  smallest   effect"
        "    shift if rejected",
        *rays,
        "",
    ]


def _spread(f: Mapping[str, Any]) -> list[str]:
    """Is control enough, and where would more help most."""
    rules, lines = f["control_spread"]["rules"], ["CONTROL: ENOUGH AND WELL SPREAD?"]
    if rules is None:
        lines.append("no two photos follow one another in a strip: the rules say nothing")
    else:
        poorest = rules["poorest_strip"]
        lines += [
            f"base {rules['base_m']:.0f} m, {rules['models']} stereo models; the poorest strip "
            f"({poorest['scan']}) shows {poorest['points']} points, "
            f"at least {rules['strip_points_least']}",
            *(_spread_line(name, rules[name]) for name in ("plan", "heights")),
        ]
    lines += [
        f"{number}. a point in {want['scan']}, {want['place']} (E {want['at'][0]:.0f}, "
        f"N {want['at'][1]:.0f}): {want['sigma_now_m']:.2f} m now, {want['sigma_then_m']:.2f} m "
        f"then; the worst of the block {want['worst_then_m']:.2f} m"
        for number, want in enumerate(f["control_spread"]["wanted"], 1)
    ]
    return [*lines, ""]


def _spread_line(name: str, spread: Mapping[str, Any]) -> str:
    return (
        f"{name:<8}{spread['points']:>5} points; along the edge at most "
        f"{spread['edge_gap_bases']:.1f} bases apart (rule {spread['edge_gap_most']:g}; widest by "
        f"{spread['edge_gap_scan']}); inside {spread['per_model']:.1f} a model "
        f"(rule {spread['per_model_least']:g})"
    )


def _checks(f: Mapping[str, Any]) -> list[str]:
    c = f["checks"]
    if not c["points"]:
        return ["CHECK POINTS", "none", ""]
    rows = [
        f"{p['point_id']:<20}{_list(p['difference_m'], 3):>27}"
        f"{_list(p['predicted_sigma_m'] or [None] * 3, 3):>27}{p['used_scans']:>7}"
        f"  {'independent' if p['independent'] else 'was a proposal'}"
        for p in c["points"]
    ]
    return [
        "CHECK POINTS",
        f"RMS X, Y, Z {_list(c['rms_m'], 3)} m; predicted {_list(c['predicted_rms_m'], 3)} m; "
        f"largest {_list(c['largest_m'], 3)} m",
        "point                      found - known (m)              predicted (m)  photos  kind",
        *rows,
        "",
    ]


def _methods(f: Mapping[str, Any]) -> list[str]:
    if not f["methods"]:
        return []
    rows = [
        f"{m['method']:<8}"
        + (
            f"not done: {m['reason']}"
            if m["reason"]
            else "".join(
                f"{_list(m[key] or [None] * 3, 3):>27}"
                for key in ("joint_m", "control_m", "check_m", "centres_m")
            )
        )
        for m in f["methods"]
    ]
    return [
        "METHODS COMPARED (RMS of X, Y, Z, metres)",
        "                        at joints                    control               check points"
        "        centres - bundle's",
        *rows,
        "",
    ]


def _exterior(f: Mapping[str, Any]) -> list[str]:
    e = f["exterior"]
    rows = [
        f"{p['scan']:<24}"
        + "".join(f"{value:>15.4f}" for value in p["centre_m"])
        + "".join(f"{value:>12.6f}" for value in p["angles_deg"])
        for p in e["photos"]
    ]
    sigmas = [
        f"{p['scan']:<24}"
        + "".join(f"{_n(value, 4):>15}" for value in p["sigma_centre_m"])
        + "".join(f"{_n(value, 6):>12}" for value in p["sigma_angles_deg"])
        for p in e["photos"]
    ]
    head = (
        "scan                              X (m)          Y (m)          Z (m)"
        "   omega (deg)   phi (deg) kappa (deg)"
    )
    return [
        "EXTERIOR ORIENTATION",
        head,
        *rows,
        "",
        "STANDARD DEVIATIONS OF THE EXTERIOR ORIENTATION",
        f"RMS {_list(e['rms_sigma_centre_m'], 3)} m, {_list(e['rms_sigma_angles_deg'], 5)} deg; "
        f"largest {_list(e['largest_sigma_centre_m'], 3)} m, "
        f"{_list(e['largest_sigma_angles_deg'], 5)} deg",
        head,
        *sigmas,
        "",
    ]


def _excluded(f: Mapping[str, Any]) -> list[str]:
    x = f["excluded"]
    control = [
        f"{c['point_id']:<20}{c['scan']:<20}{c['status']:<10}{_list(c['residual_px'], 1):>16} px  "
        f"{c['reason']}"
        for c in x["control"]
    ]
    rays = [f"{r['tie_point']:<20}{r['scan']:<20}{r['reason']}" for r in x["tie_rays"]]
    return [
        f"OBSERVATIONS LEFT OUT: {len(control)} of control, {len(rays)} tie rays",
        *control,
        *rays,
    ]


def _n(value: float | None, places: int = 2) -> str:
    """A number with fixed places; a dash where there is none."""
    return "-" if value is None else f"{value:.{places}f}"


def _list(values: Sequence[float | None], places: int) -> str:
    return ", ".join(_n(value, places) for value in values)
