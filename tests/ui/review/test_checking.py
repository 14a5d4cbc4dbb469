"""Readings and signatures at the desk: what is decided, and what an observer does not see."""

import json
from dataclasses import replace

import numpy as np
import pytest

from core.quality.assessment import assess_block
from core.quality.check_plan import CheckPlace
from core.quality.job_rules import USUAL_RULES
from core.quality.judged_rules import OF_READINGS, judge_rules
from core.quality.rules import judge_block
from sessions.checks import checked_figures, new_plan, results_digest, standing_plans
from sessions.decisions import (
    Acceptance,
    Decision,
    PlanChecks,
    ReadCheck,
    Recorded,
    Remark,
    SignBlock,
    Withdraw,
)
from tests.ui.desk_block import tiny_snapshot
from ui.review.check_gestures import BlockSigned, CheckRead, Remarked
from ui.review.checking import (
    checks_part,
    decided_judgement,
    decided_reading,
    parts_now,
    signatures_part,
)
from ui.review.judgement import judge_desk
from ui.review.mosaic import faults_part
from ui.review.pages import seat_quality
from ui.review.rule_rows import rules_part
from ui.review.snapshot import DeskSnapshot
from ui.review.state import Notice, Seat

PLACES = tuple(CheckPlace(f"{n:02d}", 100.0 * n, 50.0 * n, 0.04 * (n == 3)) for n in range(1, 9))
VERSION = "m1"


def recorded(*more: tuple[str, Decision]) -> list[Recorded]:
    plan = new_plan(PLACES, (4, 2), 1, "", beforehand=True, decisions=())
    said: list[tuple[str, Decision]] = [("ada", plan), *more]
    return [Recorded(n, f"2026-01-01T10:00:0{n}", *one) for n, one in enumerate(said, 1)]


def read(place: str, east: float, version: str = VERSION) -> ReadCheck:
    return ReadCheck(place, (east, 0.0), (0.0, 0.0), version)


def test_a_reading_is_of_a_planned_place_in_the_mosaic_on_disk__law() -> None:
    seen = CheckRead("s", "1-01", (1.0, 2.0), (1.5, 2.0), "", 7)
    assert decided_reading(seen, recorded(), VERSION) == (
        ReadCheck("1-01", (1.0, 2.0), (1.5, 2.0), VERSION),
    )
    assert decided_reading(replace(seen, place_id="9-01"), recorded(), VERSION) == ()
    assert decided_reading(seen, recorded(), "") == ()
    assert decided_reading(seen, [], VERSION) == ()


def test_a_surveyed_point_stays_where_it_was_surveyed__law() -> None:
    seen = CheckRead("s", "1-03", (301.0, 151.0), (999.0, 999.0), "", 7)
    (decided,) = decided_reading(seen, recorded(), VERSION)
    assert decided.reference == (300.0, 150.0)


def test_no_observer_is_told_where_another_read__law() -> None:
    """The places of others stand nowhere in what the page gets, nor how many there are."""
    said = recorded(("bob", read("1-01", 123.456)), ("ada", read("1-02", 7.0)))
    shown = checks_part(said, "ada", VERSION, 0.5)
    assert "123.456" not in json.dumps(shown)
    by_name = {one["place"]: one for one in shown["places"]}
    # A place that only others read looks like one that nobody read.
    shape = by_name["1-01"].keys()
    assert by_name["1-01"]["state"] == "open"
    assert shape == by_name["1-04"].keys()
    assert by_name["1-02"]["marks"] == [[7.0, 0.0], [0.0, 0.0]]
    assert "bob" not in json.dumps(shown["places"])


def test_order_and_views_differ_between_observers_and_last__law() -> None:
    ada, bob, again = (checks_part(recorded(), who, VERSION, 0.5) for who in ("ada", "bob", "ada"))
    orders = [[one["place"] for one in part["places"]] for part in (ada, bob)]
    assert orders[0] != orders[1]
    assert sorted(orders[0]) == sorted(orders[1])
    assert ada == again
    views = {one["place"]: one["views"] for one in ada["places"]}
    others = {one["place"]: one["views"] for one in bob["places"]}
    assert all(views[name] != others[name] for name in views)
    for one in ada["places"]:
        off = np.abs(np.array(one["views"]) - one["at"])
        assert off.max() <= 0.2 * one["width"]
        # Enough around it to know the place again: 300 pixels of half a metre.
        assert one["width"] == 150.0
        # Neither view lies like the other: their middles say nothing of the misfit.
        assert one["views"][0] != one["views"][1]


def test_a_second_observer_is_led_to_what_one_other_has_read__law() -> None:
    """Of eight places three are wanted twice: the first three that were read, in an own order."""

    def order(who: str, *said: tuple[str, Decision]) -> list[str]:
        return [one["place"] for one in checks_part(recorded(*said), who, VERSION, 0.5)["places"]]

    by_ada = [("ada", read(f"1-0{n}", 1.0)) for n in (7, 2, 5, 8, 1)]
    plain, led = order("bob"), order("bob", *by_ada)
    assert set(led[:3]) == {"1-07", "1-02", "1-05"}
    assert led[:3] != order("eve", *by_ada)[:3]
    # Everything else, what ada read later among it, stays in the order it had.
    assert led[3:] == [name for name in plain if name not in led[:3]]
    # Their own readings move nothing, and whoever was first is led nowhere.
    by_bob = [("bob", read(name, 1.0)) for name in (led[0], led[5], led[1])]
    assert order("bob", *by_ada, *by_bob) == led
    assert order("ada", *by_ada, *by_bob[:1]) == order("ada")
    # Once three are read twice, a third observer is led nowhere.
    assert order("eve", *by_ada, *(("bob", read(name, 1.0)) for name in led[:3])) == order("eve")
    # What was read in another mosaic, or could not be read, is not to be read twice.
    other = (
        ("ada", read("1-03", 1.0, "m0")),
        ("ada", ReadCheck("1-04", None, None, VERSION, "hidden")),
    )
    assert order("bob", *other) == plain


def test_a_spare_is_asked_for_once_its_place_cannot_be_read__law() -> None:
    """By that observer alone, right after the place; nobody is shown one to choose from."""
    spares = (CheckPlace("02a", 201.0, 101.0, after="02"), CheckPlace("02b", 9.0, 9.0, after="02a"))
    places = (*PLACES[:2], *spares, *PLACES[2:])
    plan = new_plan(places, (4, 2), 1, "", beforehand=True, decisions=())

    def shown(who: str, *said: Decision) -> list[str]:
        made = [
            Recorded(n, "2026-01-01T10:00", "ada", one) for n, one in enumerate((plan, *said), 1)
        ]
        return [one["place"] for one in checks_part(made, who, VERSION, 0.5)["places"]]

    passed = ReadCheck("1-02", None, None, VERSION, "changed")
    assert len(shown("ada")) == len(shown("bob", passed)) == 8
    names = shown("ada", passed)
    assert names[names.index("1-02") + 1] == "1-02a"
    assert "1-02b" not in names
    hidden = ReadCheck("1-02a", None, None, VERSION, "hidden")
    assert "1-02b" in shown("ada", passed, hidden)
    # What was said of a spare stays when its place is opened again; no further one is asked for.
    kept = shown("ada", passed, read("1-02a", 1.0), Withdraw(2))
    assert kept[kept.index("1-02") + 1] == "1-02a"
    left = shown("ada", passed, hidden, Withdraw(2))
    assert "1-02a" in left
    assert "1-02b" not in left


def test_a_reading_of_an_earlier_mosaic_is_open_again_and_counts_for_nothing__law() -> None:
    said = recorded(("ada", read("1-01", 1.0, "m0")))
    shown = {one["place"]: one for one in checks_part(said, "ada", VERSION, 0.5)["places"]}
    assert shown["1-01"]["state"] == "outdated"
    assert "marks" not in shown["1-01"]
    figures = checked_figures(said, standing_plans(said)[-1], VERSION)
    assert (figures.read, figures.planned) == (0, 8)


@pytest.fixture(scope="module")
def desk() -> DeskSnapshot:
    desk = tiny_snapshot()
    state = replace(desk.state, written_of=results_digest(desk.state.report))
    return replace(desk, state=state, mosaic_version=VERSION, stale=())


def signatures_of(desk: DeskSnapshot) -> list[dict[str, object]]:
    return signatures_part(desk, parts_now(desk))


def test_a_signature_is_of_all_that_was_judged_and_says_when_that_changed__law(
    desk: DeskSnapshot,
) -> None:
    shown = parts_now(desk)
    (signed,), notice = decided_judgement(BlockSigned("s", "accept", "seen", shown), desk, "ada")
    assert isinstance(signed, SignBlock)
    assert notice is not None
    kept = replace(desk, recorded=[Recorded(1, "2026-01-01T10:00", "ada", signed)])
    (line,) = signatures_of(kept)
    assert (line["who"], line["changed"]) == ("ada", [])
    (line,) = signatures_of(replace(kept, mosaic_version="m2"))
    assert line["changed"] == ["mosaic"]
    plan = PlanChecks(PLACES, (1, 1), 1, "", True, "x")
    more = [*kept.recorded, Recorded(2, "2026-01-01T10:01", "bob", plan)]
    (line,) = signatures_of(replace(kept, recorded=more))
    assert line["changed"] == ["readings"]


def test_who_still_reads_is_told_nothing_of_what_readings_say__law(desk: DeskSnapshot) -> None:
    all_places = [("ada", read(f"1-{n:02d}", 1.0)) for n in range(1, 9)]

    def reads(who: str, *said: tuple[str, Decision]) -> bool:
        at = replace(desk, recorded=recorded(*said), mosaic_version=VERSION)
        told = seat_quality(Seat("s", who), at)
        of_readings = OF_READINGS & {row[0] for row in told["rules"]}
        assert told["reads"] == (told["read"] is None) == (not of_readings)
        assert not told["reads"] or "ada" not in json.dumps(told)
        return told["reads"]

    assert reads("ada", *all_places[:3])
    assert not reads("ada", *all_places)
    # Whoever has read nothing may be the second, until three of eight are read a second time.
    second = [("bob", said) for _, said in all_places[:3]]
    assert [reads("bob", *all_places, *second[:n]) for n in range(4)] == [True, True, True, False]
    assert [reads("carl", *all_places, *second[:n]) for n in range(4)] == [True, True, True, False]
    # Whoever began first is not done with it because another has begun.
    assert reads("ada", *all_places[:4], *second[:1])
    assert not reads("ada", *all_places, *second[:1])


def test_a_place_of_a_plan_that_was_replaced_is_not_read_in_silence__law(
    desk: DeskSnapshot,
) -> None:
    first = recorded()
    plan = new_plan(PLACES, (4, 2), 2, "", beforehand=True, decisions=first)
    more = [*first, Recorded(2, "2026-01-01T10:01", "bob", plan)]
    seen = CheckRead("s", "1-01", (1.0, 2.0), (1.5, 2.0), "", 7)
    at = replace(desk, recorded=more, mosaic_version=VERSION)
    told = Notice("notice.check-replanned", grave=True)
    assert decided_judgement(seen, at, "ada") == ((), told)
    (kept,), notice = decided_judgement(seen, replace(at, recorded=first), "ada")
    assert (kept.place_id, notice) == ("1-01", None)


def test_nobody_signs_what_does_not_stand__law(desk: DeskSnapshot) -> None:
    busy = replace(desk, state=replace(desk.state, adjusting=True))
    stale = replace(desk, stale=("A",))
    unwritten = replace(desk, state=replace(desk.state, written_of=""))

    def signed(verdict: Acceptance, remark: str, at: DeskSnapshot) -> tuple[object, ...]:
        gesture = BlockSigned("s", verdict, remark, parts_now(at))
        decided, notice = decided_judgement(gesture, at, "ada")
        assert notice is not None
        return decided

    assert not signed("accept", "seen", unwritten)
    assert not signed("accept", "seen", stale)
    assert not signed("accept", "", busy)
    assert not signed("accept", "", stale)
    assert not signed("accept", "", replace(desk, mosaic_version=""))
    assert not signed("accept", "", desk)  # not good enough
    assert not signed("reject", "", desk)
    assert not signed("reject", "a shifted corner", replace(desk, rules_stand=False))
    assert not signed("accept-with-remarks", "", desk)
    assert signed("reject", "a shifted corner", stale)
    # One vouched for readings that were not shown to who still read.
    reading = replace(desk, recorded=recorded(("ada", read("1-01", 0.1, desk.mosaic_version))))
    assert not signed("accept", "seen", reading)
    chief = replace(desk, recorded=recorded(("bob", read("1-01", 0.1, desk.mosaic_version))))
    assert signed("accept", "seen", chief)
    assert signed("reject", "a shifted corner", reading)


def test_nobody_signs_what_was_not_shown__law(desk: DeskSnapshot) -> None:
    """Somebody else has said something since the page was told."""
    plan = Recorded(1, "2026-01-01T10:01", "bob", PlanChecks(PLACES, (1, 1), 1, "", True, "x"))
    for later in (replace(desk, recorded=[plan]), replace(desk, mosaic_version="m2")):
        gesture = BlockSigned("s", "reject", "a shifted corner", parts_now(desk))
        assert decided_judgement(gesture, later, "ada") == (
            (),
            Notice("notice.sign-renewed", grave=True),
        )
        assert decided_judgement(replace(gesture, judged=parts_now(later)), later, "ada")[0]


def test_limits_of_the_job_change_verdict_and_what_is_signed__law(desk: DeskSnapshot) -> None:
    own = replace(desk, rules=replace(USUAL_RULES, control_points=5000, tilt_deg=0.001))
    usual, changed = judge_desk(desk), judge_desk(own)
    assert "control-few" in {one.kind for one in changed.findings}
    assert "control-few" not in {one.kind for one in usual.findings}
    assert {one.rule.name for one in changed.rules if one.by_job} == {"control", "tilt"}
    before, after = parts_now(desk), parts_now(own)
    assert [part for part in before if before[part] != after[part]] == ["rules"]


def test_rules_are_told_with_their_source__truth(desk: DeskSnapshot) -> None:
    report = desk.state.report
    rules = rules_part(judge_rules(judge_block(assess_block(report), report)))
    assert {line[0] for line in rules} >= {"sigma", "oriented", "checks"}
    assert all(
        line[6] in ("asprs", "instruction", "survey", "orthophoto", "gruber") for line in rules
    )


def test_words_about_what_is_not_there_are_not_kept__law(desk: DeskSnapshot) -> None:
    photo = next(iter(desk.base.photos))
    for said, kept in (
        (Remark("photo", photo, "scratched"), True),
        (Remark("photo", "nobody's", "scratched"), False),
        (Remark("point", "nowhere", "?"), False),
        (Remark("decision", "77", "?"), False),
        (Remark("place", "", "dark", (1.0, 2.0), "tone"), True),
    ):
        assert decided_judgement(Remarked("s", said), desk, "ada") == (
            ((said,) if kept else ()),
            None,
        )


def test_what_was_said_of_a_fault_on_another_page_is_told_and_not_said_twice__law(
    desk: DeskSnapshot,
) -> None:
    fault = Remark("place", "", "dark", (1.0, 2.0), "tone")

    def said(remark: Remark, *before: tuple[str, Decision]) -> tuple[object, object]:
        at = replace(desk, recorded=recorded(("ada", fault), *before))
        decided, notice = decided_judgement(Remarked("s", remark), at, "ada")
        return decided, notice and (notice.text, dict(notice.values))

    close, words = Remark("decision", "2", "", closes=True), Remark("decision", "2", "new seam")
    opens = replace(close, closes=False)
    assert said(close) == ((close,), None)
    assert said(close, ("eve", close)) == ((), ("notice.fault-closed", {"who": "eve"}))
    # Words that came with it are kept, as an answer.
    both = replace(words, closes=True)
    assert said(both, ("eve", close)) == ((words,), ("notice.fault-closed-said", {"who": "eve"}))
    assert said(opens, ("eve", close)) == ((opens,), None)
    twice = ("eve", close), ("bob", opens)
    assert said(opens, *twice) == ((), ("notice.fault-open", {"who": "bob"}))
    assert said(words, ("eve", words)) == ((), ("notice.fault-said", {"who": "eve"}))
    assert said(words, ("eve", Remark("decision", "2", "a house"))) == ((words,), None)
    assert said(close, ("ada", Withdraw(2))) == ((), ("notice.fault-withdrawn", {}))


def test_a_fault_is_shown_with_who_said_what__law(desk: DeskSnapshot) -> None:
    fault = Remark("place", "", "dark", (1.0, 2.0), "tone", "eve")
    said = recorded(("ada", fault), ("eve", Remark("decision", "2", "done", closes=True)))
    (line,) = faults_part(said)
    assert (line["kind"], line["open"], line["assigned"]) == ("tone", False, "eve")
    said_by = [(one["who"], one["words"]) for one in line["said"]]
    assert said_by == [("ada", "dark"), ("eve", "done")]
    assert line["photo"] == ""
    (line,) = faults_part(
        recorded(("ada", Remark("photo", "1938_01_016", "", (1.0, 2.0), "smear")))
    )
    assert (line["photo"], line["place"]) == ("1938_01_016", (1.0, 2.0))
