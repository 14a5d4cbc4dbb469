"""Two states of a block side by side: what differs between two reports, worst first; JSON-able."""

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from math import degrees, hypot, isfinite, radians
from pathlib import Path
from typing import Any, cast

import numpy as np

from core.errors import PhotogrammetryError
from core.geometry.exterior import rotation_from_angles, turn_between
from core.said import say
from ui.words.catalogue import Teller

Figures = Mapping[str, Any]
REPORT = Path("results") / "report.json"
NEEDED = ("adjustment", "block", "certificate", "checked", "checks", "control", "decisions",
          "exterior", "ties", "verdict")  # fmt: skip
"""Parts of a report that are compared."""
LOGGED = ("decision", "after", "reason", "pixel", "place", "withdrawn_by")
"""What the list of decisions did not tell in reports of earlier versions."""
ROUNDING = 1e-9
"""Figures that differ by less of themselves are the same."""
SAME_M, SAME_ARCSEC = 1e-4, 1e-2
"""What moves by less stays where it is: a tenth of a millimetre, a hundredth of a second of arc."""
ARCSEC = 3600.0
"""Seconds of arc of a degree."""


def read_earlier(path: Path, scans: Collection[str]) -> Figures:
    """The report of an earlier state, or of a copy of the block.

    Args:
        path: A report.json, or the folder of a block that has one.
        scans: Photos of the block that is compared with it.

    Raises:
        PhotogrammetryError: There is none, it is none, it is of another block or too old.
    """
    file = path / REPORT if path.is_dir() else path
    if not file.is_file():
        cause = "has no report." if path.is_dir() else "does not exist."
        remedy = (
            "Name the folder of a block that `gruber report` was run on, or a report.json that was "
            "kept."
        )
        raise PhotogrammetryError(path, cause, remedy)
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        remedy = "Name a report.json that `gruber report` wrote."
        raise PhotogrammetryError(file, "is no report.", remedy) from error
    _check(file, found, scans)
    return found


def _check(file: Path, found: object, scans: Collection[str]) -> None:
    """That what was read is a report, of this block, with all that is compared."""
    held = cast("Figures", found) if isinstance(found, dict) else {}
    if not {"verdict", "adjustment", "block"} <= held.keys():
        remedy = "Name a report.json that `gruber report` wrote."
        raise PhotogrammetryError(file, "is no report.", remedy)
    decided = held.get("decisions")
    log = decided.get("log", []) if isinstance(decided, dict) else []
    missing = [name for name in NEEDED if name not in held]
    missing += [name for name in LOGGED for one in log[:1] if name not in one]
    if missing:
        raise PhotogrammetryError(
            file,
            "was written by an earlier version: it lacks {names}.",
            "Write it anew with `gruber report`, on a copy of the block in its earlier state.",
            names=", ".join(missing),
        )
    try:
        compare_states(held, held)
        theirs = [row["scan"] for row in held["exterior"]]
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        cause = say("is no whole report ({error!r}).", error=error)
        remedy = "Write it anew with `gruber report`, or name another."
        raise PhotogrammetryError(file, cause, remedy) from error
    if not set(theirs) & set(scans):
        raise PhotogrammetryError(
            file,
            "is of another block: none of its photos ({names}) is in this one.",
            "Name an earlier state of the same block.",
            names=", ".join(theirs[:3]) or "\u2013",
        )


def compare_states(now: Figures, earlier: Figures) -> Figures:
    """What differs between two reports of a block; an empty list where nothing does.

    Args:
        now: Figures of the report.
        earlier: Those it is compared with.
    """
    return {
        "name": earlier["block"]["name"],
        "written": earlier.get("written"),
        "figures": [row for row in _key_figures(now, earlier) if _differs(row)],
        "rules": _rules(now, earlier),
        "photos": _photos(now, earlier),
        "points": _points(now, earlier),
        "decisions": _decisions(now, earlier),
    }


def _key_figures(now: Figures, earlier: Figures) -> Iterator[Figures]:
    """Each key figure before and after, in the order of the report."""
    before, after = _figures_of(earlier), _figures_of(now)
    for name, (value, interval) in after.items():
        old, old_interval = before[name]
        yield {
            "name": name,
            "before": old,
            "after": value,
            "difference": None if value is None or old is None else value - old,
            "before_interval": old_interval,
            "after_interval": interval,
        }


def _figures_of(report: Figures) -> Mapping[str, tuple[float | None, list[float] | None]]:
    """Key figures of one report, with their interval where they have one."""
    certificate, checks = report["certificate"] or {}, report["checks"]
    read = (report["checked"]["figures"] or {}).get("together", {})
    status = report["control"]["by_status"]
    used = sum(status.get(name, 0) for name in ("auto", "accepted"))
    alone: dict[str, float | None] = {
        "verdict": max((one["grave"] for one in report["verdict"]), default=0),
        "sigma": report["adjustment"]["sigma_nought"],
        "predicted": certificate.get("predicted_m"),
        "relative": certificate.get("relative_m"),
        "checks": checks["count"],
        "check-plan": checks.get("rmse_plan_m"),
        "check-heights": checks.get("rmse_height_m"),
        "read": (report["checked"]["figures"] or {}).get("read"),
        "control": used,
        "control-points": report["control"]["points_used"],
        "left-out": sum(status.values()) - used,
        "ties": report["ties"]["points"],
        "rays": report["ties"]["rays"],
        "oriented": report["block"]["oriented"],
        "faults": sum(one["open"] is True for one in report["checked"]["remarks"]),
    }
    interval = read.get("m_p_interval")
    known = {"m_p": (read.get("m_p"), interval if interval and None not in interval else None)}
    return {**{name: (value, None) for name, value in alone.items()}, **known}


def _differs(row: Figures) -> bool:
    if row["difference"] is None:
        return row["before"] != row["after"]
    return abs(row["difference"]) > ROUNDING * max(1.0, abs(row["before"]))


def _rules(now: Figures, earlier: Figures) -> list[Figures]:
    """Rules judged otherwise: broken ones first; a rule that only one report judges has no grade.

    Grades: 0 kept, 1 doubtful, 2 broken.
    """
    before, after = (
        {one["rule"]: one for one in report["checked"]["rules"]} for report in (earlier, now)
    )
    rows = [
        {
            "rule": name,
            "before": before[name]["grave"] if name in before else None,
            "after": after[name]["grave"] if name in after else None,
            "sentence": after.get(name, before.get(name, {}))["sentence"],
        }
        for name in dict.fromkeys([*after, *before])
    ]
    rows = [row for row in rows if row["before"] != row["after"]]
    return sorted(rows, key=lambda row: (row["before"] or 0) - (row["after"] or 0))


def _photos(now: Figures, earlier: Figures) -> list[Figures]:
    """Photos that moved, the largest movement in standard deviations first; then all others."""
    before, after = ({row["scan"]: row for row in one["exterior"]} for one in (earlier, now))
    rows: list[Figures] = []
    for scan in dict.fromkeys([*after, *before]):
        old, new = before.get(scan), after.get(scan)
        stood, stands = (bool(one and one["oriented"]) for one in (old, new))
        moved = _movement(old, new) if old and new and stood and stands else None
        if stood != stands or (moved and _moved(moved)):
            row = {"scan": scan, "oriented_before": stood, "oriented_after": stands}
            rows.append({**row, **(moved or NO_MOVEMENT)})
    return sorted(rows, key=_worst_photo)


NO_MOVEMENT: Mapping[str, None] = dict.fromkeys(
    ("shift_m", "plan_m", "height_m", "plan_sigmas", "height_sigmas", "turn_arcsec", "turn_sigmas")
)
"""Of a photo that only one of both reports orients."""


def _movement(old: Figures, new: Figures) -> Figures:
    """How far the perspective centre and the attitude moved, also in standard deviations of now."""
    shift = np.subtract(new["centre_m"], old["centre_m"])
    one, other = (
        rotation_from_angles(*(radians(angle) for angle in row["angles_deg"])) for row in (old, new)
    )
    turn = degrees(float(np.linalg.norm(turn_between(one, other))))
    centre, angles = (new["sigma_centre_m"], new["sigma_angles_deg"])
    off = [(b - a + 180) % 360 - 180
           for a, b in zip(old["angles_deg"], new["angles_deg"], strict=True)]  # fmt: skip
    return {
        "shift_m": shift.tolist(),
        "plan_m": float(np.hypot(*shift[:2])),
        "height_m": float(shift[2]),
        "plan_sigmas": _in_sigmas(shift[:2].tolist(), centre and centre[:2]),
        "height_sigmas": _in_sigmas([float(shift[2])], centre and centre[2:]),
        "turn_arcsec": ARCSEC * turn,
        "turn_sigmas": _in_sigmas(off, angles),
    }


def _in_sigmas(values: Sequence[float], sigmas: Sequence[float | None] | None) -> float | None:
    """Length of a vector whose parts are measured in their own standard deviations."""
    if not sigmas or not all(sigmas):
        return None
    known = cast("Sequence[float]", sigmas)
    return hypot(*(value / sigma for value, sigma in zip(values, known, strict=True)))


def _moved(row: Figures) -> bool:
    away = hypot(row["plan_m"], row["height_m"])
    return away > SAME_M or row["turn_arcsec"] > SAME_ARCSEC


def _worst_photo(row: Figures) -> tuple[bool, float, float]:
    """Photos that came or went first, then by standard deviations, then by metres."""
    sigmas = [row[f"{name}_sigmas"] or 0.0 for name in ("plan", "height", "turn")]
    return row["oriented_before"] == row["oriented_after"], -max(sigmas), -(row["plan_m"] or 0.0)


def _points(now: Figures, earlier: Figures) -> list[Figures]:
    """Points whose differences to their given coordinates changed, the largest change first.

    A point that took part in one state only comes first.
    """
    before, after = _differences(earlier), _differences(now)
    rows: list[Figures] = []
    for role, point in dict.fromkeys([*after, *before]):
        old, new = before.get((role, point)), after.get((role, point))
        change = None if old is None or new is None else _length(np.subtract(new, old).tolist())
        if change is None or change > SAME_M:
            row = {"point_id": point, "role": role, "before_m": old, "after_m": new}
            rows.append({**row, "change_m": change})
    largest = float("inf")
    return sorted(rows, key=lambda row: -largest if row["change_m"] is None else -row["change_m"])


def _differences(report: Figures) -> Mapping[tuple[str, str], list[float]]:
    """Adjusted minus given coordinates of each control and check point in use."""
    rows = [("control", row) for row in report["control"]["in_use"]]
    rows += [("check", row) for row in report["checks"]["points"]]
    told = {(role, row["point_id"]): row["difference_m"] for role, row in rows}
    return {key: [value or 0.0 for value in values] for key, values in told.items()}


def _length(values: Sequence[float]) -> float:
    length = hypot(*values)
    return length if isfinite(length) else 0.0


def _decisions(now: Figures, earlier: Figures) -> list[Figures]:
    """Decisions of one report only, and those that stand in one only; the newest first."""
    before, after = ({_key_of(row): row for row in one["decisions"]["log"]} for one in
                     (earlier, now))  # fmt: skip
    rows: list[Figures] = []
    for key in dict.fromkeys([*after, *before]):
        old, new = before.get(key), after.get(key)
        stood, stands = (bool(one and one["stands"]) for one in (old, new))
        if old is None or new is None:
            rows.append({"against": "made" if old is None else "missing", **(new or old or {})})
        elif stood != stands:
            rows.append({"against": "restored" if stands else "withdrawn", **new})
    return sorted(rows, key=lambda row: row["when"], reverse=True)


def _key_of(row: Figures) -> tuple[object, ...]:
    """What tells a decision from all others, whatever its number in the session."""
    named = (row[name] for name in ("who", "when", "decision", "about", "after", "reason"))
    return (*named, *map(tuple, (row["pixel"] or (), row["place"] or ())))


def against_told(found: Figures, tell: Teller) -> str:
    """What differs, in one sentence."""
    written = (found["written"] or {}).get("at", "")
    counts = {name: len(found[name]) for name in ("photos", "points", "rules", "decisions")}
    if not any(counts.values()) and not found["figures"]:
        return tell("report.against.none", name=found["name"], at=written)
    return tell("report.against", name=found["name"], at=written, **counts)
