"""Rows of rules: every finding and every rule has its texts, and what fills them."""

from dataclasses import replace
from string import Formatter

from core.quality.job_rules import USUAL_RULES
from core.quality.judged_rules import RULES, judge_rules
from core.quality.rules import Finding
from core.quality.sentences import SENTENCES
from ui.review.rule_rows import JOB, LIMIT_TEXTS, VALUE_TEXTS, rules_part
from ui.words.catalogue import words


def places(text: str) -> set[str]:
    return {name for _, name, _, _ in Formatter().parse(text) if name}


def test_every_rule_has_a_limit_and_every_finding_a_value__law() -> None:
    known = words()
    assert set(LIMIT_TEXTS) == {rule.name for rule in RULES}
    assert set(VALUE_TEXTS) == {kind for rule in RULES for kind in rule.kinds} <= set(SENTENCES)
    assert {*LIMIT_TEXTS.values(), *VALUE_TEXTS.values()} <= set(known)
    assert {f"rule.{rule.name}" for rule in RULES} <= set(known)
    assert {f"rules.source.{rule.source}" for rule in RULES} <= set(known)


def test_a_rule_that_the_job_changed_is_asked_by_the_job__truth() -> None:
    found = [Finding("tilt", 0, {"value": "1.0", "limit": "3"}), Finding("crab", 0, {})]
    usual = {row[0]: row for row in rules_part(judge_rules(found))}
    own = {row[0]: row for row in rules_part(judge_rules(found, replace(USUAL_RULES, tilt_deg=2)))}
    assert usual["tilt"][-1] == own["crab"][-1] == "survey"
    assert own["tilt"][-1] == JOB
    assert own["tilt"][4:6] == ["rules.value.degrees", "rules.limit.degrees"]
    assert places(words()["rules.limit.degrees"]) <= set(found[0].values)
