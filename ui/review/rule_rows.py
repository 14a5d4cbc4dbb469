"""The rules of a job as rows for desk and report: what was found, its limit, and who asks it."""

from collections.abc import Mapping, Sequence

from core.quality.judged_rules import PREDICTED, READ, JudgedRule
from core.quality.rules import MANY_AGAINST

NONE, PLAIN = "rules.value.none", "rules.value.plain"
LIMIT_TEXTS: Mapping[str, str] = {
    **dict.fromkeys(("position", "read-position"), "rules.limit.metres"),
    **dict.fromkeys(
        ("read", "second", "checks", "check-share", "strips", "inside-plan", "inside-heights"),
        "rules.limit.least",
    ),
    "shift": "rules.limit.chance",
    **dict.fromkeys(("prediction", "sigma"), "rules.limit.range"),
    **dict.fromkeys(("against", "oriented", "holes", "misfit"), "rules.limit.none"),
    "control": "rules.limit.control",
    **dict.fromkeys(("edge-plan", "edge-heights"), "rules.limit.bases"),
    **dict.fromkeys(("rays", "along", "across"), "rules.limit.least-percent"),
    "bare": "rules.limit.bare",
    "pattern": "rules.limit.stand-out",
    **dict.fromkeys(("tilt", "crab"), "rules.limit.degrees"),
    "sun": "rules.limit.least-degrees",
    "faults": "rules.limit.none-open",
    "sheets": "rules.limit.sheets",
}
"""Text of the limit, by rule."""
VALUE_TEXTS: Mapping[str, str] = {
    **dict.fromkeys(PREDICTED, "rules.value.metres"),
    **dict.fromkeys(("predicted-unknown", "diverged"), "rules.value.unknown"),
    **dict.fromkeys(READ, "rules.value.read"),
    **dict.fromkeys(
        ("read-within", "read-unsure", "read-over", "read-over-before"), "rules.value.interval"
    ),
    **dict.fromkeys(("read-shifted", "read-unshifted"), "rules.value.shift"),
    **dict.fromkeys(("second", "second-few"), "rules.value.doubled"),
    **dict.fromkeys(
        ("read-unplanned", "second-none", "no-checks", "oriented", "no-holes", "no-ties"), NONE
    ),
    **dict.fromkeys(("read-as-predicted", "read-worse", "read-better"), "rules.value.ratio"),
    "one-check": "rules.value.one-check",
    **dict.fromkeys(
        ("checks-few", "checks", "checks-better", "checks-worse", "checks-over"),
        "rules.value.checks",
    ),
    **dict.fromkeys(("check-share", "check-share-few"), "rules.value.check-share"),
    **dict.fromkeys(
        ("contradicted", "contradicted-far", "contradicted-check", MANY_AGAINST),
        "rules.value.against",
    ),
    "agreed": "rules.value.agreed",
    **dict.fromkeys(("sigma", "sigma-off", "sigma-far", "sigma-none"), PLAIN),
    "loose": "rules.value.count",
    **dict.fromkeys(("control", "control-gaps", "control-few"), "rules.value.control"),
    "control-on-a-line": "rules.value.line",
    **dict.fromkeys(("strip", "strip-few"), "rules.value.at"),
    **dict.fromkeys(
        ("edge-plan", "edge-gap-plan", "edge-heights", "edge-gap-heights"), "rules.value.bases"
    ),
    **dict.fromkeys(
        ("inside-plan", "inside-few-plan", "inside-heights", "inside-few-heights"), PLAIN
    ),
    **dict.fromkeys(("rays", "rays-few"), "rules.value.percent"),
    "in-parts": "rules.value.parts",
    "one-photo": "rules.value.one-photo",
    "bare": "rules.value.at",
    **dict.fromkeys(("no-pattern", "systematic"), "rules.value.pattern"),
    **dict.fromkeys(("tilt", "tilt-over", "crab", "crab-over", "sun", "sun-low"),
                    "rules.value.degrees"),
    "sun-noon": "rules.value.noon",
    **dict.fromkeys(("along", "along-small", "across", "across-small"), "rules.value.range"),
    "holes": "rules.value.holes",
    "misfit-places": "rules.value.misfit",
    **dict.fromkeys(("faults", "faults-open"), "rules.value.open"),
    **dict.fromkeys(
        ("sheets-accepted", "sheets-open", "sheets-rejected", "sheets-changed",
         "sheets-rejected-before", "sheets-replaced"),
        "rules.value.sheets",
    ),
}  # fmt: skip
"""Text of what was found, by kind of finding."""
JOB = "job"
"""Who asks a limit that the job set."""


def rules_part(judged: Sequence[JudgedRule]) -> list[list[object]]:
    """Every rule: name, gravity, kind and values of its finding, texts of both, who asks it.

    `more` among the values is how many further findings there are about it, where there are any.
    """
    return [
        [
            one.rule.name,
            one.finding.grave,
            f"verdict.{one.finding.kind}",
            {**one.finding.values, **({"more": str(one.more)} if one.more else {})},
            VALUE_TEXTS[one.finding.kind],
            LIMIT_TEXTS[one.rule.name],
            source_of(one),
        ]
        for one in judged
    ]


def source_of(one: JudgedRule) -> str:
    """Who asks a rule: the job where it set one of its limits."""
    return JOB if one.by_job else one.rule.source
