"""Figures of readings: those of the printed tables, and those that were put in."""

from dataclasses import replace

import numpy as np
import pytest

from core.quality.job_rules import USUAL_RULES
from core.quality.judged_rules import RULES, judge_rules
from core.quality.readings import (
    Reading,
    ReadingFigures,
    compare_with_prediction,
    plan_figures,
    position_error_m,
    reading_figures,
    reading_findings,
    thesis_mean_m,
    unplanned_findings,
)
from core.quality.rules import DOUBTFUL, POOR, SOUND, Finding
from core.quality.sentences import SENTENCES

# m_X, m_Y and m_p as printed: report on the Czech orthophoto, tables 5, 6 and 7.
TABLE_5 = (
    ("Horusice", "0.18", "0.14", "0.23"),
    ("Libějice", "0.09", "0.14", "0.17"),
    ("Pořín", "0.19", "0.19", "0.27"),
    ("Nemyšl", "0.18", "0.12", "0.22"),
    ("Prudice", "0.17", "0.12", "0.21"),
    ("Řípec", "0.20", "0.15", "0.25"),
    ("Sudoměřice", "0.13", "0.10", "0.16"),
    ("Rojšín", "0.14", "0.19", "0.24"),
    ("Tchořovice", "0.50", "0.24", "0.55"),
    ("Střítež", "0.16", "0.20", "0.26"),
)
TABLE_6 = (
    ("before mosaicking", "0.214", "0.181", "0.280"),
    ("2012, first", "0.269", "0.229", "0.353"),
    ("2012, second", "0.232", "0.195", "0.303"),
)
TABLE_7 = (
    ("all 2017", "0.096", "0.091", "0.132"),
    ("all 2018", "0.067", "0.093", "0.115"),
    ("control 2017", "0.062", "0.059", "0.086"),
    ("control 2018", "0.041", "0.045", "0.061"),
    ("check 2017", "0.161", "0.123", "0.203"),
    ("check 2018", "0.122", "0.126", "0.176"),
)
ROUNDED_OTHERWISE = {"check 2018"}
"""0.122 and 0.126 give 0.1754: printed is 0.176, so the table rounded its components last."""
# m_X, m_Y, the mean that is printed: table 7 of the thesis; the last figure is that of METHODS 1.2.
THESIS = (
    ("Kobylí 1938", 1.21, 2.20, 1.70, 2.51),
    ("Kobylí 1984", 0.60, 0.88, 0.74, 1.07),
    ("Milovice 1938", 3.52, 7.57, 5.55, 8.35),
    ("Milovice 1989", 1.30, 1.56, 1.43, 2.03),
)


@pytest.mark.parametrize("row", [*TABLE_5, *TABLE_6, *TABLE_7], ids=lambda row: row[0])
def test_m_p_of_printed_components_is_the_printed_one__paper(row: tuple[str, ...]) -> None:
    name, m_x, m_y, printed = row
    digits = len(printed.split(".")[1])
    found = position_error_m(float(m_x), float(m_y))
    assert abs(found - float(printed)) <= 10.0**-digits
    assert (f"{found:.{digits}f}" == printed) is (name not in ROUNDED_OTHERWISE)


def test_the_mean_of_table_5_is_that_of_its_rows__paper() -> None:
    """0.256 is printed below m_X 0.21 and m_Y 0.16, which together would be 0.264."""
    found = [round(position_error_m(float(row[1]), float(row[2])), 2) for row in TABLE_5]
    assert np.mean(found) == pytest.approx(0.256)
    assert position_error_m(0.21, 0.16) == pytest.approx(0.264, abs=1e-3)


@pytest.mark.parametrize("row", THESIS, ids=lambda row: row[0])
def test_the_thesis_prints_the_mean_of_its_axes_and_not_m_p__paper(row: tuple) -> None:
    _, m_x, m_y, printed, m_p = row
    assert thesis_mean_m(m_x, m_y) == pytest.approx(printed, abs=0.0051)
    assert position_error_m(m_x, m_y) == pytest.approx(m_p, abs=0.0051)


def test_two_observers_of_table_6_say_what_share_is_theirs__paper() -> None:
    """m of their differences 0.104 and 0.102 m: one reading is good to 0.103 m in plan."""
    rng = np.random.default_rng(0)
    off = rng.normal(size=(90, 2))
    off *= np.array([0.104, 0.102]) / np.sqrt(np.mean(off**2, axis=0))
    both = [
        Reading(f"{n}", who, (side * x / 2, side * y / 2))
        for who, side in (("Ka.", 1), ("Šv.", -1))
        for n, (x, y) in enumerate(off)
    ]
    (pair,) = reading_figures(both, 90).pairs
    assert pair.figures.rms_m == pytest.approx((0.104, 0.102))
    assert pair.observer_m == pytest.approx(0.103, abs=5e-4)
    # Of the 0.303 m that table 6 gives to one of them, that is an eighth.
    assert (pair.observer_m / 0.303) ** 2 == pytest.approx(0.116, abs=1e-3)


BIAS, MOSAIC, OBSERVER = np.array([0.3, -0.2]), np.array([0.6, 0.9]), 0.25
TRUE_M_P = float(np.sqrt(np.sum(BIAS**2) + np.sum(MOSAIC**2) + 2 * OBSERVER**2))


def simulated(seed: int, observers: tuple[str, ...] = ("ada",), count: int = 30) -> ReadingFigures:
    """Thirty places of a mosaic with bias and scatter, read with an error of the observer's own."""
    rng = np.random.default_rng(seed)
    errors = BIAS + rng.normal(size=(count, 2)) * MOSAIC
    readings = [
        Reading(f"{number}", who, tuple((error + rng.normal(0, OBSERVER, 2)).tolist()))
        for who in observers
        for number, error in enumerate(errors)
    ]
    return reading_figures(readings, count)


def test_m_p_lies_within_its_interval_as_often_as_it_says__truth() -> None:
    """Forty sets of thirty readings; 38 are expected, fewer than 36 by chance one time in 30."""
    hits = 0
    for seed in range(40):
        low, high = simulated(seed).together.m_p_interval
        hits += low <= TRUE_M_P <= high
    assert hits >= 36


def test_intervals_hold_in_the_long_run__truth() -> None:
    """95 of 100 with 1,000 sets; 1.4 is twice the standard deviation of that count."""
    found = [simulated(seed).together for seed in range(1000)]
    share = np.mean([one.m_p_interval[0] <= TRUE_M_P <= one.m_p_interval[1] for one in found])
    assert 0.936 <= share <= 0.985


def test_bias_is_significant_where_there_is_one_and_rarely_where_not__truth() -> None:
    rng = np.random.default_rng(7)
    # Eight standard errors of the mean: missed less than once in ten million.
    shifted = [plan_figures(rng.normal((1.5, 0.0), size=(30, 2))).shifted for _ in range(200)]
    assert all(one[0] for one in shifted)
    # 5 of 100 are expected; 20 of 200 lie more than three standard deviations above.
    assert sum(one[1] for one in shifted) < 20


def test_scatter_and_share_of_observers_are_recovered__truth() -> None:
    found = simulated(1, ("ada", "bob"), count=2000)
    assert found.observer_m == pytest.approx(np.sqrt(2) * OBSERVER, rel=0.05)
    assert found.doubled == found.read == 2000
    assert found.by_observer["ada"].mean_m == pytest.approx(tuple(BIAS), abs=0.06)
    # The mean of two readings has half the observer's variance in it.
    m_p = np.sqrt(TRUE_M_P**2 - OBSERVER**2)
    assert found.together.m_p == pytest.approx(m_p, rel=0.04)
    assert found.observer_share == pytest.approx(OBSERVER**2 / m_p**2, rel=0.15)


def test_extremes_keep_their_sign_and_few_readings_give_no_test__truth() -> None:
    found = plan_figures(np.array([[0.1, -0.9], [-0.4, 0.2]]))
    assert found.extreme_m == (-0.4, -0.9)
    assert np.isnan(found.chance).all()
    assert found.shifted == (False, False)
    assert plan_figures(np.zeros((0, 2))).count == 0


@pytest.mark.parametrize(
    ("orientation_m", "said"), [(1.14, "as-predicted"), (0.4, "worse"), (3.0, "better")]
)
def test_readings_bear_a_prediction_out_or_not__truth(orientation_m: float, said: str) -> None:
    found = simulated(3, ("ada", "bob"))
    assert compare_with_prediction(found, orientation_m, 0.0, 60.0).said == said


def test_readings_that_share_the_orientations_error_are_as_predicted_95_times__truth() -> None:
    """One shift for all places, and readings of their own; half of the places by two observers.

    With 2 n independent errors it was as predicted in 101 of 400.
    """
    rng, said = np.random.default_rng(0), []
    for _ in range(400):
        error = rng.normal(0, 0.5, 2)
        hand = rng.normal(0, 0.2, (40, 2, 2))
        readings = [
            Reading(f"{n}", who, tuple((error + hand[n, number]).tolist()))
            for n in range(40)
            for number, who in enumerate(("ada", "bob")[: 1 + n % 2])
        ]
        found = reading_figures(readings, 40)
        said.append(compare_with_prediction(found, 0.5 * 2**0.5, 0.0, 2.0).said)
    # 380 are expected; 360 is four and a half standard deviations below.
    assert said.count("as-predicted") >= 360
    assert found.observer_part == 0.75


def test_a_surveyed_point_knows_nothing_of_the_references_error__law() -> None:
    rng = np.random.default_rng(0)
    off = [tuple(one) for one in rng.normal(size=(30, 2)).tolist()]
    read = reading_figures([Reading(f"{n}", "a", one) for n, one in enumerate(off)], 30)
    known = reading_figures([Reading(f"{n}", "a", one, 0.3) for n, one in enumerate(off)], 30)
    assert compare_with_prediction(read, 1.0, 5.0, 60.0).predicted_m == 1.0
    predicted = compare_with_prediction(known, 1.0, 5.0, 60.0).predicted_m
    assert predicted == pytest.approx(np.sqrt(1 + 25 + 2 * 0.09))
    assert compare_with_prediction(reading_figures([], 30), 1.0, 0.0, 60.0).said == "unknown"


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


def test_late_places_are_doubted_and_readings_of_an_earlier_mosaic_told__law() -> None:
    for count, doubt in ((30, SOUND), (0, DOUBTFUL)):
        told = reading_findings(figures(count, 0.3), 0.8, outdated=12, late=True)
        graves = {one.kind: one.grave for one in told}
        assert graves["read-late"] == DOUBTFUL
        assert graves["read-outdated"] == doubt


def test_of_a_shift_nothing_is_said_before_there_is_a_scatter__law() -> None:
    assert not {"read-shifted", "read-unshifted"} & kinds(figures(1, 1.0, shift=-28.8)).keys()
    assert not {"read-shifted", "read-unshifted"} & kinds(figures(2, 1.0, shift=-28.8)).keys()
    assert "read-shifted" in kinds(figures(3, 1.0, shift=-28.8))


def test_what_is_said_of_readings_lies_in_its_interval__law() -> None:
    """The error of the survey was in the figure, and neither in its interval nor in the verdict."""
    rng = np.random.default_rng(2)
    off = [tuple(one) for one in rng.normal(0, 0.3, (40, 2)).tolist()]
    found = reading_figures([Reading(f"{n}", "a", one, 0.6) for n, one in enumerate(off)], 40)
    told = next(one.values for one in reading_findings(found, 0.8) if one.kind == "read-within")
    assert float(told["low"]) < float(told["value"]) < float(told["high"])
    assert found.together.product_m == pytest.approx(np.hypot(found.together.m_p, 0.6 * 2**0.5))


def test_a_mosaic_off_by_more_than_the_limit_is_not_good_enough__truth() -> None:
    assert kinds(figures(30, 3.0))["read-over"] == POOR


@pytest.mark.parametrize(
    ("orientation_m", "kind"),
    [(0.42, "read-as-predicted"), (0.1, "read-worse"), (2.0, "read-better")],
)
def test_predicted_against_observed_is_said_in_words__truth(
    orientation_m: float, kind: str
) -> None:
    found = figures(30, 0.3, doubled=9)
    foretold = compare_with_prediction(found, orientation_m, 0.0, 60.0)
    said = [one for one in reading_findings(found, 0.8, foretold) if one.kind == kind]
    assert len(said) == 1
    assert "{" not in str(said[0].sentence)


def test_without_a_second_observer_the_prediction_is_not_judged__law() -> None:
    """One observer's own scatter was taken for an error of the mosaic."""
    foretold = compare_with_prediction(figures(30, 0.3), 0.1, 0.0, 60.0)
    assert foretold.said == "unknown"
    assert not any(
        one.kind.startswith(("read-as", "read-worse", "read-better"))
        for one in reading_findings(figures(30, 0.3), 0.8, foretold)
    )


def test_a_limit_within_the_interval_is_not_proved__truth() -> None:
    found = figures(30, 0.3)
    low, high = found.together.m_p_interval
    for limit, kind, grave in (
        (1.01 * high, "read-within", SOUND),
        (found.together.m_p, "read-unsure", DOUBTFUL),
        (0.99 * low, "read-over", POOR),
    ):
        assert kinds(found, limit)[kind] == grave


def test_a_new_plan_does_not_make_a_mosaic_good__law() -> None:
    good, bad = figures(30, 0.3), figures(33, 3.0)
    graves = {one.kind: one.grave for one in reading_findings(good, 0.8, None, [bad])}
    assert (graves["read-replaced"], graves["read-over-before"]) == (DOUBTFUL, POOR)
    assert "read-over-before" not in {
        one.kind for one in reading_findings(good, 0.8, None, [figures(30, 0.2)])
    }


def test_nothing_planned_is_told_where_readings_are_asked_for__law() -> None:
    assert [one.kind for one in unplanned_findings()] == ["read-unplanned"]
    assert unplanned_findings(replace(USUAL_RULES, readings=0)) == ()


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
