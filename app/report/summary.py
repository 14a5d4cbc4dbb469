"""The first page of the report: every requirement with its value, limit and result.

Nothing is judged here: value, limit and result are those of the findings of `core.quality.rules`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ui.words.catalogue import Teller

Figures = dict[str, Any]


@dataclass(frozen=True, slots=True)
class _Requirement:
    """One row: findings that tell of it, and the texts of name, limit and value."""

    name: str
    limit: str
    values: Mapping[str, str]
    """Text of the value, by kind of finding."""


def _either(value: str, *kinds: str) -> dict[str, str]:
    return dict.fromkeys(kinds, value)


NONE, PLAIN, COUNT = "report.value.none", "report.value.plain", "report.value.count"
REQUIREMENTS = (
    _Requirement(
        "report.want.against", "report.limit.none",
        {
            **_either("report.value.against", "contradicted", "contradicted-far"),
            "contradicted-check": "report.value.against", "agreed": "report.value.agreed",
        },
    ),
    _Requirement(
        "report.want.sigma", "report.limit.range",
        _either(PLAIN, "sigma", "sigma-off", "sigma-far"),
    ),
    _Requirement("report.want.oriented", "report.limit.none", {"oriented": NONE, "loose": COUNT}),
    _Requirement(
        "report.want.control", "report.limit.control",
        _either("report.value.control", "control", "control-gaps", "control-few"),
    ),
    _Requirement(
        "report.want.edge-plan", "report.limit.bases",
        _either("report.value.bases", "edge-plan", "edge-gap-plan"),
    ),
    _Requirement(
        "report.want.edge-heights", "report.limit.bases",
        _either("report.value.bases", "edge-heights", "edge-gap-heights"),
    ),
    _Requirement(
        "report.want.checks", "report.limit.least",
        {
            "no-checks": NONE, "one-check": "report.value.one-check",
            **_either(
                "report.value.checks", "checks-few", "checks", "checks-better", "checks-worse",
                "checks-over",
            ),
        },
    ),
    _Requirement(
        "report.want.rays", "report.limit.least-percent",
        _either("report.value.percent", "rays", "rays-few"),
    ),
    _Requirement(
        "report.want.pattern", "report.limit.stand-out",
        _either("report.value.pattern", "no-pattern", "systematic"),
    ),
    _Requirement(
        "report.want.tilt", "report.limit.degrees",
        _either("report.value.degrees", "tilt", "tilt-over"),
    ),
    _Requirement(
        "report.want.crab", "report.limit.degrees",
        _either("report.value.degrees", "crab", "crab-over"),
    ),
    _Requirement(
        "report.want.along", "report.limit.least-percent",
        _either("report.value.range", "along", "along-small"),
    ),
    _Requirement(
        "report.want.across", "report.limit.least-percent",
        _either("report.value.range", "across", "across-small"),
    ),
    _Requirement(
        "report.want.holes", "report.limit.none",
        {"no-holes": NONE, "holes": "report.value.holes"},
    ),
)  # fmt: skip


def requirements(figures: Figures, tell: Teller) -> list[Figures]:
    """Rows of the table: requirement, value, limit, result and how grave it is.

    Args:
        figures: Those of the report, with `verdict` and `certificate`.
        tell: The language.
    """
    rows = [*_position(figures["certificate"], tell)]
    for wanted in REQUIREMENTS:
        told = [one for one in figures["verdict"] if one["kind"] in wanted.values]
        if not told:
            continue
        first = told[0]
        value = tell(wanted.values[first["kind"]], **first)
        if len(told) > 1:
            value = tell("report.value.more", value=value, more=len(told) - 1)
        limit = tell(wanted.limit, **first)
        rows.append(_row(tell, wanted.name, value, limit, first["grave"]))
    return rows


def _position(certificate: Figures | None, tell: Teller) -> Sequence[Figures]:
    """What is predicted of the ground; nothing where that was not asked."""
    if certificate is None:
        return ()
    predicted, limit = certificate["predicted_m"], certificate["limit_m"]
    known = predicted is not None
    good = known and "predicted" not in certificate["reasons"]
    metres = "report.value.metres"
    value = tell(metres, value=predicted) if known else tell("report.value.unknown")
    limit = tell(metres, value=limit)
    return [_row(tell, "report.want.position", value, limit, 0 if good else 2)]


def _row(tell: Teller, name: str, value: str, limit: str, grave: int) -> Figures:
    result = tell(f"report.result.{grave}")
    return {"name": tell(name), "value": value, "limit": limit, "grave": grave, "result": result}
