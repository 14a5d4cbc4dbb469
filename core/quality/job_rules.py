"""The rules of a job in one table: what each asks, and who asks it.

Limits stand where findings are made (`core.quality.rules`, `core.quality.reading_rules`). Here
every rule has the findings that tell of it and its source, and is judged by itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from core.quality.rules import Finding


@dataclass(frozen=True, slots=True)
class Rule:
    """One rule."""

    name: str
    """Key of its text."""
    kinds: tuple[str, ...]
    """Findings that tell of it, kept or broken."""
    source: str
    """Key of the text that says who asks it."""


@dataclass(frozen=True, slots=True)
class JudgedRule:
    """A rule with what a block makes of it."""

    rule: Rule
    """The rule."""
    finding: Finding
    """The gravest finding about it."""
    more: int
    """Further findings about it that are not sound."""


# source: the authority of each rule: ASPRS Positional Accuracy Standards, edition 2 (2023); Czech
# instruction for the renewal of cadastral maps; national specifications for aerial survey; the
# parameters of the Czech orthophoto (m_p, two observers); and what Gruber itself promises.
ASPRS, INSTRUCTION, SURVEY, ORTHOPHOTO, GRUBER = (
    "asprs",
    "instruction",
    "survey",
    "orthophoto",
    "gruber",
)
RULES: tuple[Rule, ...] = (
    Rule("read", ("read", "read-few"), ASPRS),
    Rule("position", ("read-within", "read-over", "predicted"), GRUBER),
    Rule("shift", ("read-shifted", "read-unshifted"), ORTHOPHOTO),
    Rule("second", ("second", "second-few", "second-none"), ORTHOPHOTO),
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
    ),
    Rule("against", ("contradicted", "contradicted-far", "contradicted-check", "agreed"), GRUBER),
    Rule("sigma", ("sigma", "sigma-off", "sigma-far", "diverged"), GRUBER),
    Rule("oriented", ("oriented", "loose"), GRUBER),
    Rule("control", ("control", "control-gaps", "control-few", "control-on-a-line"), INSTRUCTION),
    Rule("strips", ("strip-few",), INSTRUCTION),
    Rule("edge", ("edge-plan", "edge-gap-plan", "edge-heights", "edge-gap-heights"), INSTRUCTION),
    Rule("inside", ("inside-few-plan", "inside-few-heights"), INSTRUCTION),
    Rule("rays", ("rays", "rays-few", "no-ties", "in-parts", "one-photo"), GRUBER),
    Rule("pattern", ("no-pattern", "systematic"), GRUBER),
    Rule("tilt", ("tilt", "tilt-over"), SURVEY),
    Rule("crab", ("crab", "crab-over"), SURVEY),
    Rule("along", ("along", "along-small"), SURVEY),
    Rule("across", ("across", "across-small"), SURVEY),
    Rule("holes", ("no-holes", "holes"), SURVEY),
)
"""In the order in which a reviewer reads them; one without findings does not concern the block."""


def judge_rules(findings: Sequence[Finding]) -> tuple[JudgedRule, ...]:
    """Every rule that concerns a block, with the gravest finding about it."""
    judged: list[JudgedRule] = []
    for rule in RULES:
        about = sorted(
            (one for one in findings if one.kind in rule.kinds), key=lambda one: -one.grave
        )
        if about:
            judged.append(JudgedRule(rule, about[0], sum(one.grave > 0 for one in about[1:])))
    return tuple(judged)
