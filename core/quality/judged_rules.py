"""Every rule of a job with the findings that tell of it, judged by itself."""

from collections.abc import Sequence
from dataclasses import dataclass

from core.quality.job_rules import (
    ASPRS,
    GRUBER,
    INSTRUCTION,
    ORTHOPHOTO,
    SAMPLING,
    SURVEY,
    USUAL_RULES,
    JobRules,
    set_by_job,
)
from core.quality.rules import MANY_AGAINST, Finding


@dataclass(frozen=True, slots=True)
class Rule:
    """One rule."""

    name: str
    """Key of its text."""
    kinds: tuple[str, ...]
    """Findings that tell of it, kept or broken."""
    source: str
    """Who asks it: a key of `AUTHORITIES`."""
    limits: tuple[str, ...] = ()
    """Limits of `JobRules` that are told as its own."""


@dataclass(frozen=True, slots=True)
class JudgedRule:
    """A rule with what a block makes of it."""

    rule: Rule
    """The rule."""
    finding: Finding
    """The gravest finding about it."""
    more: int
    """Further findings about it that are not sound; measurements that one tells of count each."""
    by_job: bool
    """Whether the job set one of its limits."""


POSITION = ("position_m", "position_px")
PREDICTED = ("predicted-within", "predicted", "predicted-alone-within", "predicted-alone")
"""Findings that tell what is predicted: against the reference with its own error, or alone."""
READ = ("read", "read-few", "read-replaced", "read-late", "read-outdated")
"""Findings that tell how many places of the plan were read, and what weakens them."""
RULES: tuple[Rule, ...] = (
    Rule("position", (*PREDICTED, "predicted-unknown"), GRUBER, POSITION),
    Rule("read", ("read-unplanned", *READ), ASPRS, ("readings",)),
    Rule(
        "read-position",
        ("read-within", "read-unsure", "read-over", "read-over-before"),
        GRUBER,
        POSITION,
    ),
    Rule("shift", ("read-shifted", "read-unshifted"), ORTHOPHOTO),
    Rule(
        "second",
        ("second", "second-few", "second-none"),
        ORTHOPHOTO,
        ("second_readings_percent",),
    ),
    Rule("prediction", ("read-as-predicted", "read-worse", "read-better"), GRUBER),
    Rule(
        "checks",
        (
            "no-checks",
            "one-check",
            "checks-few",
            "checks",
            "checks-better",
            "checks-worse",
            "checks-over",
        ),
        ASPRS,
        ("check_points",),
    ),
    Rule(
        "check-share",
        ("check-share", "check-share-few"),
        ORTHOPHOTO,
        ("check_share_percent",),
    ),
    Rule(
        "against",
        ("contradicted", "contradicted-far", "contradicted-check", MANY_AGAINST, "agreed"),
        GRUBER,
    ),
    Rule(
        "sigma",
        ("sigma", "sigma-off", "sigma-far", "sigma-none", "diverged"),
        GRUBER,
        ("sigma_nought_low", "sigma_nought_high", "sigma_nought_least", "sigma_nought_most"),
    ),
    Rule("oriented", ("oriented", "loose"), GRUBER),
    Rule(
        "control",
        ("control", "control-gaps", "control-few", "control-on-a-line"),
        INSTRUCTION,
        ("control_points", "control_parts"),
    ),
    Rule("strips", ("strip", "strip-few"), INSTRUCTION, ("strip_points",)),
    Rule("edge-plan", ("edge-plan", "edge-gap-plan"), INSTRUCTION, ("edge_plan_bases",)),
    Rule(
        "edge-heights",
        ("edge-heights", "edge-gap-heights"),
        INSTRUCTION,
        ("edge_heights_bases",),
    ),
    Rule("inside-plan", ("inside-plan", "inside-few-plan"), INSTRUCTION, ("inside_plan",)),
    Rule(
        "inside-heights",
        ("inside-heights", "inside-few-heights"),
        INSTRUCTION,
        ("inside_heights",),
    ),
    Rule(
        "rays",
        ("rays", "rays-few", "no-ties", "in-parts", "one-photo"),
        GRUBER,
        ("rays_percent",),
    ),
    Rule("bare", ("bare",), GRUBER, ("photo_parts",)),
    Rule("pattern", ("no-pattern", "systematic"), GRUBER),
    Rule("tilt", ("tilt", "tilt-over"), SURVEY, ("tilt_deg", "tilt_most_deg")),
    Rule("crab", ("crab", "crab-over"), SURVEY, ("crab_deg", "crab_most_deg")),
    Rule("along", ("along", "along-small"), SURVEY, ("along_percent",)),
    Rule("across", ("across", "across-small"), SURVEY, ("across_percent",)),
    Rule("sun", ("sun", "sun-noon", "sun-low"), SURVEY, ("sun_deg",)),
    Rule("holes", ("no-holes", "holes"), SURVEY),
    Rule("misfit", ("misfit-places",), GRUBER),
    Rule("faults", ("faults", "faults-open"), GRUBER),
    Rule(
        "sheets",
        (
            "sheets-accepted",
            "sheets-open",
            "sheets-rejected",
            "sheets-changed",
            "sheets-rejected-before",
            "sheets-replaced",
        ),
        SAMPLING,
        (
            "sheets_good_percent",
            "sheets_bad_percent",
            "producer_risk_percent",
            "consumer_risk_percent",
        ),
    ),
)
"""In the order in which a reviewer reads them; one without findings does not concern the block."""
OF_READINGS = frozenset({"read", "read-position", "shift", "second", "prediction", "sheets"})
"""Rules that tell of readings."""


def judge_rules(
    findings: Sequence[Finding], rules: JobRules = USUAL_RULES
) -> tuple[JudgedRule, ...]:
    """Every rule that concerns a block, with the gravest finding about it.

    Args:
        findings: What was found of the block.
        rules: Limits of the job by which it was judged.
    """
    judged: list[JudgedRule] = []
    changed = frozenset(set_by_job(rules))
    for rule in RULES:
        about = sorted(
            (one for one in findings if one.kind in rule.kinds), key=lambda one: -one.grave
        )
        if about:
            more = max(sum(one.stands_for for one in about if one.grave) - 1, 0)
            judged.append(JudgedRule(rule, about[0], more, not changed.isdisjoint(rule.limits)))
    return tuple(judged)
