"""The first page of the report: every requirement with its value, its limit and what came of it.

Nothing is judged here: value, limit and result are those of the findings of `core.quality.rules`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

Figures = dict[str, Any]
RESULTS = ("passed", "doubtful", "not passed")
"""By how grave a finding is."""


@dataclass(frozen=True, slots=True)
class _Requirement:
    """One row: findings that tell of it, and how value and limit are told."""

    name: str
    limit: str
    values: Mapping[str, str]
    """Value as told, by kind of finding."""


def _either(value: str, *kinds: str) -> dict[str, str]:
    return dict.fromkeys(kinds, value)


REQUIREMENTS = (
    _Requirement(
        "Measurements accepted by hand, contradicted by the block",
        "none",
        {
            **_either("{metres} m: {worst}", "contradicted", "contradicted-far"),
            **_either("{metres} m: {worst}", "contradicted-check"),
            "agreed": "none of {count}",
        },
    ),
    _Requirement(
        "Sigma nought", "{low} to {high}", _either("{value}", "sigma", "sigma-off", "sigma-far")
    ),
    _Requirement("Photos that are not oriented", "none", {"oriented": "none", "loose": "{count}"}),
    _Requirement(
        "Control points",
        "at least {least}, in {parts} of nine parts of the block",
        _either("{count} in {cells} parts", "control", "control-gaps", "control-few"),
    ),
    _Requirement(
        "Gap of control along the edge, plan",
        "{most} bases",
        _either("{bases} bases", "edge-plan", "edge-gap-plan"),
    ),
    _Requirement(
        "Gap of known heights along the edge",
        "{most} bases",
        _either("{bases} bases", "edge-heights", "edge-gap-heights"),
    ),
    _Requirement(
        "Check points",
        "at least {least}",
        {
            "no-checks": "none", "one-check": "1 ({value} m off)",
            **_either("{count} (m_p {value} m)", "checks-few", "checks"),
        },
    ),
    _Requirement(
        "Tie points in three photos or more", "at least {least} %",
        _either("{share} %", "rays", "rays-few"),
    ),
    _Requirement(
        "Systematic residuals on the film", "none that stand out",
        _either("at most {value} px", "no-pattern", "systematic"),
    ),
    _Requirement("Tilt", "{limit}°", _either("{value}°", "tilt", "tilt-over")),
    _Requirement("Crab", "{limit}°", _either("{value}°", "crab", "crab-over")),
    _Requirement(
        "Overlap along the strips", "at least {least} %",
        _either("{low} to {high} %", "along", "along-small"),
    ),
    _Requirement(
        "Overlap between strips", "at least {least} %",
        _either("{low} to {high} %", "across", "across-small"),
    ),
    _Requirement(
        "Holes inside the mosaic", "none",
        {"no-holes": "none", "holes": "{count} ({area} m²)"},
    ),
)  # fmt: skip


def requirements(figures: Figures) -> list[Figures]:
    """Rows of the table: requirement, value, limit, result and how grave it is.

    Args:
        figures: Those of the report, with `verdict` and `certificate`.
    """
    rows = [*_position(figures["certificate"])]
    for wanted in REQUIREMENTS:
        told = [one for one in figures["verdict"] if one["kind"] in wanted.values]
        if not told:
            continue
        first = told[0]
        more = f" and {len(told) - 1} more" if len(told) > 1 else ""
        value = wanted.values[first["kind"]].format(**first) + more
        rows.append(_row(wanted.name, value, wanted.limit.format(**first), first["grave"]))
    return rows


def remaining(figures: Figures) -> list[Figures]:
    """Findings to be read in full: what is not sound, gravest first."""
    return [one for one in figures["verdict"] if one["grave"]]


def _position(certificate: Figures | None) -> Sequence[Figures]:
    """What is predicted of the ground; nothing where that was not asked."""
    if certificate is None:
        return ()
    predicted, limit = certificate["predicted_m"], certificate["limit_m"]
    known = predicted is not None
    good = known and "predicted" not in certificate["reasons"]
    value = f"{predicted:.2f} m" if known else "not known"
    name = "Position on the ground, predicted standard deviation"
    return [_row(name, value, f"{limit:.2f} m", 0 if good else 2)]


def _row(name: str, value: str, limit: str, grave: int) -> Figures:
    return {
        "name": name, "value": value, "limit": limit, "grave": grave, "result": RESULTS[grave]
    }  # fmt: skip
