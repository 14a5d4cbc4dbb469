"""Plans of checks in the session: each by its name, none erased by the next."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from shapely.geometry import box

from core.adjustment.block_adjustment import adjust_block
from core.block import Block
from core.quality.check_plan import CheckPlace
from core.quality.job_rules import USUAL_RULES
from core.sheets.map_sheets import MapSheet
from sessions.checks import (
    checked_figures,
    digest_of_plan,
    judged_parts,
    new_plan,
    readings_of,
    replaced_readings,
    standing_plans,
    standing_signatures,
)
from sessions.decisions import (
    Accept,
    JudgeSheet,
    PlanChecks,
    ReadCheck,
    Recorded,
    Reject,
    SignBlock,
    Withdraw,
    changing,
)
from sessions.replay import replay
from sessions.session import Session
from sessions.sheet_samples import lot_digest, new_sample
from tests.flights import FlightPlan, fly

PLACES = (CheckPlace("01", 10.0, 20.0), CheckPlace("02", 30.0, 40.0, 0.04))


def plan(session: Session, seed: int = 1) -> PlanChecks:
    said = session.decisions()
    return new_plan(PLACES, (6, 5), seed, "", beforehand=True, decisions=said)


def test_a_later_plan_stands_beside_the_first_under_other_names__law(tmp_path: Path) -> None:
    with Session.open(tmp_path, "ada") as session:
        first = session.record(plan(session))
        second = session.record(plan(session, seed=2))
        plans = standing_plans(session.decisions())
    assert [one.recorded for one in plans] == [first, second]
    names = [[place.place_id for place in one.plan.places] for one in plans]
    assert names == [["1-01", "1-02"], ["2-01", "2-02"]]
    assert plans[0].plan.digest != plans[1].plan.digest


def test_a_plan_that_was_changed_is_seen_by_its_digest__law(tmp_path: Path) -> None:
    with Session.open(tmp_path, "ada") as session:
        made = plan(session)
        session.record(replace(made, places=made.places[1:]))
        session.record(plan(session))
        plans = standing_plans(session.decisions())
    assert [one.unchanged for one in plans] == [False, True]


def test_plans_drawn_at_the_same_time_have_numbers_of_their_own__law(tmp_path: Path) -> None:
    """Each knew nothing of the other: a reading of one counted for both."""
    with Session.open(tmp_path, "ada") as one, Session.open(tmp_path, "bob") as other:
        drawn = plan(one), plan(other, seed=2)
        one.record(drawn[0])
        later = other.record(drawn[1]).decision
        plans = [item.plan for item in standing_plans(one.decisions())]
    assert plans == [drawn[0], later]
    assert [place.place_id for place in later.places] == ["2-01", "2-02"]
    assert later.digest == digest_of_plan(later)


def test_readings_of_a_plan_that_another_replaced_are_counted_until_it_is_withdrawn__law(
    tmp_path: Path,
) -> None:
    """A new plan silently made readings that nobody liked disappear from the verdict."""
    with Session.open(tmp_path, "ada") as session:
        first = session.record(plan(session))
        session.record(ReadCheck("1-01", (11.0, 20.0), (10.0, 20.0), "m1"))
        assert replaced_readings(session.decisions(), "m1") == ()
        session.record(plan(session, seed=2))
        assert [one.read for one in replaced_readings(session.decisions(), "m1")] == [1]
        assert replaced_readings(session.decisions(), "m2") == (), "of a mosaic that is no more"
        session.record(Withdraw(first.decision_id))
        assert replaced_readings(session.decisions(), "m1") == ()


def test_a_plan_without_spares_has_the_digest_that_it_had_before_there_were_any__law() -> None:
    made = new_plan(PLACES, (6, 5), 1, "", beforehand=True, decisions=())
    assert made.digest == "fccaeeeff150295f"


def test_spares_are_of_the_plan_s_digest_and_names__law() -> None:
    places = (*PLACES, CheckPlace("02a", 31.0, 41.0, after="02"))
    made = new_plan(places, (6, 5), 1, "", beforehand=True, decisions=())
    assert (made.places[2].place_id, made.places[2].after, made.count) == ("1-02a", "1-02", 2)
    others = (*PLACES, CheckPlace("02a", 31.0, 41.0, after="01"))
    assert digest_of_plan(made) == made.digest
    assert new_plan(others, (6, 5), 1, "", beforehand=True, decisions=()).digest != made.digest


def test_the_newest_reading_of_each_observer_counts__law(tmp_path: Path) -> None:
    with Session.open(tmp_path, "ada") as session:
        for place, who in (((1.0, 1.0), "ada"), ((2.0, 2.0), "bob"), ((3.0, 3.0), "ada")):
            session.record(ReadCheck("1-01", place, place, "m"), operator=who)
        session.record(ReadCheck("1-02", None, None, "m", "changed"), operator="bob")
        session.undo("bob")
        read = readings_of(session.decisions())
    assert {key: one[1].mosaic for key, one in read.items()} == {
        ("1-01", "ada"): (3.0, 3.0),
        ("1-01", "bob"): (2.0, 2.0),
    }


def test_a_spare_that_was_read_counts_for_its_cell_and_what_was_passed_over_is_told__law(
    tmp_path: Path,
) -> None:
    places = (*PLACES, CheckPlace("02a", 31.0, 41.0, after="02"))
    with Session.open(tmp_path, "ada") as session:
        made = new_plan(places, (6, 5), 1, "", beforehand=True, decisions=())
        session.record(made)
        session.record(ReadCheck("1-02", None, None, "m", "changed"))
        session.record(ReadCheck("1-02a", (31.5, 41.0), (31.0, 41.0), "m"))
        said = session.decisions()
    found = checked_figures(said, standing_plans(said)[0], "m")
    assert (found.planned, found.read, found.unreadable) == (2, 1, 1)


def test_plans_and_readings_change_nothing_of_the_block__law(tmp_path: Path, block: Block) -> None:
    with Session.open(tmp_path, "ada") as session:
        session.record(Accept("P1", "A"))
        alone, before = session.changing(), replay(block, session.decisions())
        session.record(plan(session))
        session.record(ReadCheck("1-01", (1.0, 1.0), (1.5, 1.0), "m"))
        session.undo()
        session.redo()
        after = replay(block, session.decisions())
        assert session.changing() == alone
        assert [item.decision_id for item in alone] == [1]
        session.record(Accept("P1", "B"))
        assert len(session.changing()) == 2
    assert before.block.measurements == after.block.measurements
    assert not after.unmatched


def test_records_that_judge_are_told_from_those_that_change__law() -> None:
    said = [
        Recorded(1, "t", "ada", Accept("P1", "A")),
        Recorded(2, "t", "ada", ReadCheck("1-01", None, None, "m", "blurred")),
    ]
    assert [item.decision_id for item in changing(said)] == [1]


REPORT = adjust_block(fly(FlightPlan(ties=60, control=8, check=2), np.random.default_rng(0)).block)


def changed(session: Session, report=REPORT, mosaic: str = "m1") -> list[tuple[str, ...]]:
    said = session.decisions()
    now = judged_parts(said, report, mosaic)
    return [one.changed for one in standing_signatures(said, now)]


def test_a_signature_holds_until_something_is_changed__law(tmp_path: Path) -> None:
    with Session.open(tmp_path, "ada") as session:
        parts = judged_parts(session.decisions(), REPORT, "m1")
        session.record(SignBlock("accept", "", parts))
        assert changed(session) == [()]
        assert changed(session, mosaic="m2") == [("mosaic",)]
        session.record(Reject("P1", "A", "changed"), operator="bob")
        assert changed(session) == [("decisions",)]
        session.undo("bob")
        assert changed(session) == [()]
        said = session.decisions()
        places = (CheckPlace("01", 1.0, 2.0),)
        plan = new_plan(places, (1, 1), 1, "", beforehand=True, decisions=said)
        session.record(plan, operator="bob")
        session.record(ReadCheck("1-01", (1.0, 1.0), (1.0, 1.0), "m1"), operator="bob")
        assert changed(session) == [("readings",)]


def test_a_signature_made_under_other_limits_is_outdated__law() -> None:
    before = judged_parts([], REPORT, "m1")
    after = judged_parts([], REPORT, "m1", replace(USUAL_RULES, tilt_deg=2.0))
    assert [part for part in before if before[part] != after[part]] == ["rules"]
    signed = Recorded(1, "2026-01-02T12:00:00", "eva", SignBlock("accept", "", before))
    assert standing_signatures([signed], before)[0].holds
    assert standing_signatures([signed], after)[0].changed == ("rules",)


def test_a_signature_is_of_the_sample_of_sheets_its_words_and_its_lot__law() -> None:
    """Without a sample sheets are no part of it: signatures of earlier versions hold."""
    sheets = tuple(MapSheet(f"S{n}", box(n, 0, n + 1, 1)) for n in range(9))
    sample, word = (
        new_sample(sheets, 3),
        JudgeSheet("S1", good=True, version="m1", lot=lot_digest(sheets)),
    )
    said = [Recorded(n, "t", "ada", one) for n, one in enumerate((sample, word), 1)]
    assert judged_parts([], REPORT, "m1", sheets=sheets) == judged_parts([], REPORT, "m1")
    one, both = (judged_parts(said[:n], REPORT, "m1", sheets=sheets) for n in (1, 2))
    fewer = judged_parts(said, REPORT, "m1", sheets=sheets[1:])
    none = judged_parts([], REPORT, "m1")
    for before, after in ((none, one), (one, both), (both, fewer)):
        assert [part for part in after if before.get(part) != after[part]] == ["sheets"]
    signed = Recorded(9, "2026-01-02T12:00:00", "eva", SignBlock("accept", "", one))
    assert standing_signatures([signed], both)[0].changed == ("sheets",)


def test_a_signature_is_of_what_was_decided_and_not_of_its_number__law() -> None:
    signed = Recorded(1, "t", "ada", Accept("P1", "A"))
    other = replace(signed, decision=Reject("P1", "A", "changed"))
    before, after = (judged_parts([one], REPORT, "m1") for one in (signed, other))
    assert [part for part in before if before[part] != after[part]] == ["decisions"]


def test_a_photo_that_moves_by_a_millimetre_outdates__law(tmp_path: Path) -> None:
    name, photo = next(iter(REPORT.block.photos.items()))
    off = replace(photo.exterior, centre=photo.exterior.centre + np.array([1e-3, 0.0, 0.0]))
    photos = {**REPORT.block.photos, name: replace(photo, exterior=off)}
    moved = replace(REPORT, block=REPORT.block.with_photos(photos))
    with Session.open(tmp_path, "ada") as session:
        session.record(SignBlock("accept", "", judged_parts((), REPORT, "m1")))
        assert changed(session) == [()]
        assert changed(session, moved) == [("adjustment",)]


def test_two_reviewers_sign_beside_each_other__law(tmp_path: Path, block: Block) -> None:
    with Session.open(tmp_path, "ada") as session:
        parts = judged_parts((), REPORT, "m1")
        session.record(SignBlock("reject", "a shift", parts))
        session.record(SignBlock("accept", "", parts), operator="bob")
        session.record(SignBlock("accept-with-remarks", "better", parts))
        said = session.decisions()
        found = standing_signatures(said, parts)
        assert session.replayed_all(block).unmatched == ()
    assert [(one.recorded.who, one.said.verdict) for one in found] == [
        ("ada", "accept-with-remarks"),
        ("bob", "accept"),
    ]
    assert found[0].digest == found[1].digest
    assert all(one.holds for one in found)
