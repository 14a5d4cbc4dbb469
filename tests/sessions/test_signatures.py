"""Signatures: what each is of, and that any later change shows."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from core.adjustment.block_adjustment import adjust_block
from core.block import Block
from core.quality.check_plan import CheckPlace
from sessions.checks import new_plan
from sessions.decisions import ReadCheck, Reject, SignBlock
from sessions.session import Session
from sessions.signatures import judged_parts, standing_signatures
from tests.flights import FlightPlan, fly

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
