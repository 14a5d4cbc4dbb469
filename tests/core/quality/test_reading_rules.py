"""Findings of readings, and the rules of a job judged one by one."""

import numpy as np
import pytest

from core.quality.job_rules import RULES, judge_rules
from core.quality.reading_rules import reading_findings
from core.quality.readings import Reading, ReadingFigures, compare_with_prediction, reading_figures
from core.quality.rules import DOUBTFUL, POOR, SOUND, Finding
from core.quality.sentences import SENTENCES


def figures(count: int, scatter: float, shift: float = 0.0, doubled: int = 0) -> ReadingFigures:
    rng = np.random.default_rng(2)
    errors = rng.normal(shift, scatter, (count, 2))
    read = [Reading(f"{n}", "ada", (float(x), float(y))) for n, (x, y) in enumerate(errors)]
    again = [Reading(f"{n}", "bob", (x + 0.05, y)) for n, (x, y) in enumerate(errors[:doubled])]
    return reading_figures([*read, *again], max(count, 30))


def kinds(found: ReadingFigures, limit_m: float = 0.8) -> dict[str, int]:
    return {one.kind: one.grave for one in reading_findings(found, limit_m)}


def test_enough_good_readings_by_two_are_sound__truth() -> None:
    assert kinds(figures(30, 0.3, doubled=9)) == {
        "read": SOUND,
        "read-within": SOUND,
        "read-unshifted": SOUND,
        "second": SOUND,
    }


def test_few_readings_a_shift_and_a_single_observer_are_doubted__truth() -> None:
    found = kinds(figures(20, 0.1, shift=0.3))
    assert found["read-few"] == found["read-shifted"] == found["second-none"] == DOUBTFUL
    assert kinds(figures(30, 0.3, doubled=8))["second-few"] == DOUBTFUL
    assert kinds(figures(0, 1.0)) == {"read-few": DOUBTFUL}


def test_a_mosaic_off_by_more_than_the_limit_is_not_good_enough__truth() -> None:
    assert kinds(figures(30, 3.0))["read-over"] == POOR


@pytest.mark.parametrize(
    ("orientation_m", "kind"),
    [(0.42, "read-as-predicted"), (0.1, "read-worse"), (2.0, "read-better")],
)
def test_predicted_against_observed_is_said_in_words__truth(
    orientation_m: float, kind: str
) -> None:
    found = figures(30, 0.3)
    foretold = compare_with_prediction(found, orientation_m, 0.0)
    said = [one for one in reading_findings(found, 0.8, foretold) if one.kind == kind]
    assert len(said) == 1
    assert "{" not in str(said[0].sentence)


def test_every_rule_takes_the_gravest_finding_about_it__law() -> None:
    findings = [
        Finding("tilt", SOUND, {}),
        Finding("class-large", DOUBTFUL, {}),
        Finding("control", SOUND, {}),
        Finding("control-on-a-line", POOR, {}),
    ]
    judged = {one.rule.name: one for one in judge_rules(findings)}
    assert set(judged) == {"tilt", "control"}
    assert judged["control"].finding.grave == POOR


def test_rules_name_findings_that_there_are_and_each_in_one_rule__law() -> None:
    named = [kind for rule in RULES for kind in rule.kinds]
    assert set(named) <= set(SENTENCES)
    assert len(named) == len(set(named))
