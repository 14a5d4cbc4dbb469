"""Edits of seams that stand: in order, without those that were withdrawn."""

from pathlib import Path

from core.mosaic.seam_edits import SeamArea, SeamLine
from sessions.decisions import Accept, standing_seam_edits
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
