"""A plan drawn at the desk: a decision for the loop, or the words why there is none."""

import shutil
from pathlib import Path

import pytest

from app.desk.messages import Measured
from app.desk.planning import hand_in_plan
from core.errors import ProjectError
from sessions.decisions import PlanChecks
from sessions.session import Session
from tests.tiny import Tiny


def test_a_plan_goes_to_the_loop_and_is_not_recorded_beside_it__law(
    tiny_run: Tiny, tmp_path: Path
) -> None:
    folder = tmp_path / "block"
    shutil.copytree(tiny_run.folder, folder)
    handed: list[Measured] = []
    told = hand_in_plan(folder, "seat-1", handed.append)
    (one,) = handed
    assert one.seat_id == "seat-1"
    assert isinstance(one.decision, PlanChecks)
    assert len(one.decision.places) == told["places"] >= 20
    with Session.open(folder, "reader") as session:
        assert not any(isinstance(item.decision, PlanChecks) for item in session.decisions())


def test_a_block_that_was_never_run_has_no_plan__truth(tiny_block: Path) -> None:
    with pytest.raises(ProjectError, match="nothing says yet where the photos lie"):
        hand_in_plan(tiny_block, "seat-1", lambda _: pytest.fail("handed in"))
