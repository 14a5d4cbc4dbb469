"""`gruber check plan`: places on disk before control, and nothing of the block moved by them."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from app.check_plan import PlanWish, plan_checks
from app.cli import main
from app.project import read_project
from app.run import Run, RunOptions
from core.errors import PhotogrammetryError, ProjectError
from sessions.checks import standing_plans
from sessions.session import Session
from tests.app.test_run import Listener
from tests.tiny import Tiny, check_points


@pytest.fixture
def folder(tiny_run: Tiny, tmp_path: Path) -> Path:
    """A copy of the block that was run, with what its stages made."""
    copied = tmp_path / "block"
    shutil.copytree(tiny_run.folder, copied)
    return copied


def test_a_plan_is_recorded_with_date_operator_and_digest__truth(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", "plan", str(folder), "--operator", "ada", "--seed", "3"]) == 0
    told = capsys.readouterr().out
    with Session.open(folder, "bob") as session:
        (plan,) = standing_plans(session.decisions())
    assert (plan.recorded.who, plan.plan.seed) == ("ada", 3)
    assert plan.recorded.when
    assert plan.unchanged
    assert plan.plan.digest in told
    assert len(plan.plan.places) >= 30
    assert not plan.plan.beforehand
    assert "searched already" in told


def test_a_plan_before_control_says_so__law(folder: Path) -> None:
    shutil.rmtree(folder / ".gruber" / "products" / "control")
    with Session.open(folder, "ada") as session:
        made = plan_checks(read_project(folder), session, PlanWish())
    assert made.plan.beforehand


def test_plans_and_their_removal_leave_every_byte_of_the_orientation__law(folder: Path) -> None:
    """Digest and bytes of the adjustment with a plan, without it, and as it was before."""
    kept = folder / ".gruber" / "products" / "adjustment"

    def adjusted() -> dict[str, bytes]:
        for path in kept.iterdir():
            path.unlink()
        with Session.open(folder, "ada") as session:
            options = RunOptions(last="adjustment")
            Run(read_project(folder), session, Listener(), options).walk()
        return {path.name: path.read_bytes() for path in kept.iterdir()}

    before = adjusted()
    with Session.open(folder, "ada") as session:
        plan_checks(read_project(folder), session, PlanWish(seed=4))
    planned = adjusted()
    with Session.open(folder, "ada") as session:
        session.undo()
        assert not standing_plans(session.decisions())
    assert before == planned == adjusted()


def test_places_of_a_list_are_checked_instead_but_never_control__law(
    folder: Path, tiny_run: Tiny
) -> None:
    rows = ["id,X,Y,Z,sigma_xy,sigma_z,role"]
    for name, place in check_points(tiny_run).items():
        rows.append(f"S{name},{place[0]:.3f},{place[1]:.3f},{place[2]:.3f},0.04,0.05,check")
    rows.append("far,-500000,-1100000,200,0.04,0.05,check")
    listed = folder / "survey.csv"
    listed.write_text("\n".join([*rows, ""]), encoding="utf-8")
    with Session.open(folder, "ada") as session:
        made = plan_checks(read_project(folder), session, PlanWish(points=listed))
    assert [place.place_id for place in made.plan.places] == [f"1-SCHK{n}" for n in range(1, 7)]
    assert {place.sigma_m for place in made.plan.places} == {0.04}
    assert made.plan.source == "survey.csv"
    assert made.plan.cells == (0, 0)
    assert not made.enough
    assert len(made.remarks) == 3
    listed.write_text(rows[0] + "\n", encoding="utf-8")
    with Session.open(folder, "ada") as session, pytest.raises(ProjectError, match="lists no poi"):
        plan_checks(read_project(folder), session, PlanWish(points=listed))


def test_a_block_of_which_nothing_is_known_cannot_be_planned__truth(
    tiny_block: Path, tmp_path: Path
) -> None:
    with (
        Session.open(tmp_path, "ada") as session,
        pytest.raises(PhotogrammetryError, match="where the photos lie"),
    ):
        plan_checks(read_project(tiny_block), session, PlanWish())


@pytest.mark.parametrize("cells", ["6", "0x5", "6x5x4", "ax5"])
def test_a_grid_that_is_none_is_wrong_use__truth(cells: str) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["check", "plan", "block", "--cells", cells])
    assert ended.value.code == 2


def test_places_keep_away_from_control_in_use__law(folder: Path) -> None:
    with Session.open(folder, "ada") as session:
        made = plan_checks(read_project(folder), session, PlanWish())
        found = session.products.latest_value("adjustment").block
    used = {key[0] for key, item in found.measurements.items() if found.steers(item)}
    control = np.array([found.surveyed[name].position[:2] for name in sorted(used)])
    plan = np.array([(place.east, place.north) for place in made.plan.places])
    assert np.linalg.norm(plan[:, None] - control[None], axis=2).min() > 20.0
