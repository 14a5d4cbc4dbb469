"""Edits of seams that stand: in order, without those that were withdrawn."""

from dataclasses import replace
from pathlib import Path

from core.mosaic.seam_edits import SeamArea, SeamLine
from sessions.decisions import Accept, Withdraw
from sessions.seam_decisions import standing_seam_edits, standing_seams
from sessions.session import Session

LINE = SeamLine("A", "B", ((1.0, 2.0), (3.5, 4.0)))
AREA = SeamArea("A", ((1.0, 2.0), (3.5, 4.0), (0.1, 9.0)))


def test_what_stands_is_told_in_order_through_undo_and_redo__law(tmp_path: Path) -> None:
    with Session.open(tmp_path, "ada") as session:
        for decision in (LINE, Accept("P1", "A"), AREA):
            session.record(decision)
        assert standing_seam_edits(session.decisions()) == (LINE, AREA)
        session.undo()
        assert standing_seam_edits(session.decisions()) == (LINE,)
        session.redo()
        assert standing_seam_edits(session.decisions()) == (LINE, AREA)


def test_a_line_laid_anew_keeps_its_turn_and_comes_back_when_that_is_undone__law(
    tmp_path: Path,
) -> None:
    with Session.open(tmp_path, "ada") as session:
        first = session.record(LINE).decision_id
        session.record(AREA)
        moved = replace(LINE, line=((1.0, 2.0), (3.5, 4.5)), replaces=first)
        second = session.record(moved).decision_id
        again = replace(moved, line=((1.0, 2.0), (3.5, 5.0)), replaces=second)
        session.record(again)
        assert standing_seam_edits(session.decisions()) == (again, AREA)
        assert [one.decision_id for one, _ in standing_seams(session.decisions())] == [4, 2]
        session.undo()
        assert standing_seam_edits(session.decisions()) == (moved, AREA)
        session.undo()
        assert standing_seam_edits(session.decisions()) == (LINE, AREA)
        # What was replaced is taken back itself: its successor is a line of its own.
        session.redo()
        session.record_all([Withdraw(first)])
        assert standing_seam_edits(session.decisions()) == (AREA, moved)
