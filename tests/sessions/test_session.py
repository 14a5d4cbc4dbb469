"""The folder of a block and its door."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pyogrio
import pytest
from pyogrio import raw
from shapely.geometry import box

from core.adjustment.adjusted import AdjustmentReport
from core.block import Block, Measurement
from core.errors import StorageError
from core.formats.listed_point import ListedPoint
from core.mosaic.seam_edits import SeamArea, SeamLine
from core.quality.check_plan import CheckPlace
from core.scans.judging import FiducialMeasurement
from core.sheets.acceptance import DrawnSheet, SamplingPlan
from sessions.codec import to_json
from sessions.decisions import (
    DECISIONS,
    Accept,
    AddPoint,
    BringPoints,
    ChoosePeak,
    Decision,
    DrawMask,
    DrawSheets,
    FillMarks,
    JudgeFiducial,
    JudgePhoto,
    JudgeSheet,
    JudgeTie,
    MarkDubious,
    MarkNotVisible,
    Place,
    PlaceFiducial,
    PlacePhoto,
    PlanChecks,
    ReadCheck,
    Reject,
    Remark,
    SetRole,
    SignBlock,
    Withdraw,
    standing,
)
from sessions.session import FILE, Session
from sessions.store import Store

REPOSITORY = Path(__file__).resolve().parents[2]
EVERY: tuple[Decision, ...] = (
    SeamLine("A", "B", ((1.0, 2.0), (3.5, 4.0))),
    SeamArea("A", ((1.0, 2.0), (3.5, 4.0), (0.1, 9.0))),
    Accept("P1", "A"),
    Accept("P1", "A", 1.5, 2.5),
    Reject("P1", "A", "wrong object"),
    MarkDubious("P1", "A"),
    MarkNotVisible("P1", "A"),
    Place("P1", "A", 0.1, 2 / 3),
    ChoosePeak("P1", "A", 1),
    SetRole("Křižovatka 1", "check"),
    AddPoint("H1", 1.5, 2.5, 3.5, (0.25, 0.25, 0.5), (Measurement("H1", "A", 7.5, 8.5, 0.5),)),
    BringPoints((ListedPoint("Sv. Jiří", 1.5, 2.5, 3.5, (0.1, 0.1, 0.2), "plan", "věž"),), "a.csv"),
    JudgeTie("A", 10.25, 11.5, use=False),
    JudgePhoto("A", use=True),
    JudgeFiducial("A", "3", use=False),
    FillMarks(
        "rmk",
        "A",
        12.0,
        7.0,
        {"A": (FiducialMeasurement("UL", 12.25, 7.5, 0.03, 0.9, 0.01, "example"),), "B": ()},
        {"UL": (-110.0, 110.5)},
        0.01,
    ),
    DrawMask("A", ((1.0, 2.0), (3.0, 4.0), (5.0, 1.0)), 0.0, hides=True),
    PlacePhoto("A", ((10.0, 20.0, 500000.5, 5400000.5),)),
    PlaceFiducial("A", "3", 10.25, 2 / 3),
    PlanChecks((CheckPlace("1-01", 1.5, 2 / 3, 0.04),), (6, 5), 1, "", True, "abc"),
    ReadCheck("1-01", (1.5, 2 / 3), (1.25, 0.5), "abc"),
    DrawSheets(SamplingPlan(9, 1, 0), (DrawnSheet("HUST25", box(0, 0, 2 / 3, 1)),), 7, "l", "abc"),
    JudgeSheet("HUST25", good=False, version="abc", words="šmouha", lot="abcd"),
    SignBlock("accept-with-remarks", "roh", {"mosaic": "abc"}),
    Remark("place", "", "tmavé", (1.5, 2 / 3), "tone", "eva", None),
    Withdraw(3),
)


def test_every_kind_of_decision_is_found_again__truth(tmp_path: Path) -> None:
    assert {type(item) for item in EVERY} == set(DECISIONS)
    with Session.open(tmp_path, "ada") as session:
        recorded = tuple(session.record(item) for item in EVERY)
    with Session.open(tmp_path, "bob") as session:
        assert session.decisions() == recorded
        assert [item.decision for item in session.decisions()] == list(EVERY)
        assert {item.who for item in session.decisions()} == {"ada"}


def test_time_of_recording_is_utc__truth(tmp_path: Path) -> None:
    with Session.open(tmp_path, "ada") as session:
        assert session.record(Accept("P1", "A")).when.endswith("+00:00")


def test_what_is_recorded_at_once_is_undone_and_redone_at_once__law(tmp_path: Path) -> None:
    with Session.open(tmp_path, "ada") as session:
        alone = session.record(Accept("P1", "A"))
        both = session.record_all((Reject("P1", "B", "hidden"), Reject("P2", "B", "hidden")))
        assert both[0].when == both[1].when > alone.when
        session.undo()
        assert [item.decision for item in standing(session.decisions())][:1] == [alone.decision]
        assert not set(both) & set(standing(session.decisions()))
        session.redo()
        assert set(both) < set(standing(session.decisions()))
        session.undo()
        session.undo()
        assert alone not in standing(session.decisions())


def test_two_operators_see_each_other__truth(tmp_path: Path, block: Block) -> None:
    with Session.open(tmp_path, "ada") as ada, Session.open(tmp_path, "bob") as bob:
        first = ada.record(Accept("P1", "A"))
        assert bob.since(0) == (first,)
        second = bob.record(Reject("P1", "A", "hidden"))
        assert ada.since(first.decision_id) == (second,)
        assert ada.replayed(block).measurements["P1", "A"].status == "rejected"
        ada.undo()
        assert bob.replayed(block).measurements["P1", "A"].status == "rejected"
        bob.undo()
        assert ada.replayed(block).measurements["P1", "A"].status == "auto"
        assert bob.undo() is None
        bob.redo()
        ada.redo()
        assert ada.redo() is None
        assert ada.replayed(block).measurements["P1", "A"].status == "rejected"


def test_what_was_seen_is_recorded_with_the_decision__truth(tmp_path: Path, block: Block) -> None:
    seen = block.measurements["P1", "A"]
    with Session.open(tmp_path, "ada") as session:
        recorded = session.record(Accept("P1", "A"), seen=block)
    assert recorded.decision == Accept("P1", "A", seen.column, seen.row)


def test_layers_stand_beside_the_decisions__oracle(
    tmp_path: Path, block: Block, report_of: Callable[[Block], AdjustmentReport]
) -> None:
    with Session.open(tmp_path, "ada") as session:
        session.record(Accept("P1", "A"))
        session.write_layers(block, report_of(block), {})
    meta, _, _, fields = raw.read(tmp_path / "session.gpkg", layer="decisions")
    assert list(fields[list(meta["fields"]).index("who")]) == ["ada"]
    assert "points" in pyogrio.list_layers(tmp_path / "session.gpkg")[:, 0]


def test_decision_of_a_newer_program_is_told_and_kept__truth(tmp_path: Path) -> None:
    with Session.open(tmp_path, "ada") as session:
        store = Store.open(tmp_path / "session.gpkg")
        store.append("2026-01-01", "eve", [("Merge", '{"@":"Merge"}')])
        store.close()
        with pytest.raises(StorageError, match="decision 1, which this Gruber cannot read"):
            session.decisions()


@pytest.mark.parametrize(
    ("decision", "field"),
    [
        (SignBlock("accepted", "", {}), "verdict"),
        (Remark("place", "", "tmavé", (1.0, 2.0), "hole"), "fault"),
        (ReadCheck("1-01", (float("nan"), 2.0), (1.0, 2.0), "abc"), "mosaic"),
        (ReadCheck("1-01", (1.0, 2.0, 3.0), (1.0, 2.0), "abc"), "mosaic"),
        (Place("P1", "A", float("inf"), 1.0), "column"),
        (ReadCheck("1-01", (1e300, 2.0), (1.0, 2.0), "abc"), "mosaic"),
        (JudgePhoto("A", use="yes"), "use"),
        (SignBlock("reject", "", {"mosaic": 3}), "judged"),
    ],
)
def test_a_decision_whose_values_cannot_be_is_told__truth(
    tmp_path: Path, decision: Decision, field: str
) -> None:
    with Session.open(tmp_path, "ada") as session:
        store = Store.open(tmp_path / "session.gpkg")
        text = json.dumps(to_json(decision))
        store.append("2026-01-01", "eve", [(type(decision).__name__, text)])
        store.close()
        with pytest.raises(
            StorageError, match=rf"cannot read \({type(decision).__name__}: {field}"
        ):
            session.decisions()


def test_a_time_that_is_none_is_told__truth(tmp_path: Path) -> None:
    with Session.open(tmp_path, "ada") as session:
        store = Store.open(tmp_path / "session.gpkg")
        text = json.dumps(to_json(JudgePhoto("A", use=True)))
        store.append("yesterday", "eve", [("JudgePhoto", text)])
        store.close()
        with pytest.raises(StorageError, match=r"'yesterday'.*changed by another program"):
            session.decisions()


def test_opening_cleans_up_after_a_killed_process__truth(tmp_path: Path) -> None:
    script = """
import os, sys
from pathlib import Path
from sessions.session import Session
session = Session.open(Path(sys.argv[1]), "ada")
with session.products.making("ortho", "0" * 64) as folder:
    (folder / "ortho.tif").write_text("half")
    os.kill(os.getpid(), 9)
"""
    subprocess.run([sys.executable, "-c", script, str(tmp_path)], cwd=REPOSITORY, check=False)
    stage = tmp_path / ".gruber" / "products" / "ortho"
    assert len(list(stage.iterdir())) == 1
    with Session.open(tmp_path, "ada") as session:
        assert session.products.fresh("ortho", "0" * 64) is None
    assert list(stage.iterdir()) == []


HOLD_THE_LOCK = """
import subprocess, sys
from pathlib import Path
from sessions.session import Session
with Session.open(Path(sys.argv[1]), "ada").running():
    # What it starts lives on when it is killed, and must not keep the lock.
    waits = [sys.executable, "-c", "import time; time.sleep(9)"]
    subprocess.Popen(waits, stdout=subprocess.DEVNULL)
    print("running", flush=True)
    sys.stdin.read()
"""


def test_one_run_at_a_time_and_the_lock_dies_with_its_process__truth(tmp_path: Path) -> None:
    other = subprocess.Popen(
        [sys.executable, "-c", HOLD_THE_LOCK, str(tmp_path)],
        cwd=REPOSITORY,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert other.stdout is not None
    assert other.stdout.readline() == "running\n"
    with Session.open(tmp_path, "bob") as session:
        with (
            pytest.raises(StorageError, match=rf"ada \(process {other.pid}, since .*Wait for that"),
            session.running(),
        ):
            pass
        other.kill()
        other.communicate()
        with (
            session.running(),
            pytest.raises(StorageError, match=rf"bob \(process {os.getpid()}, since "),
            session.running(),
        ):
            pass
        with session.running():
            pass


def test_a_folder_that_cannot_be_written_is_told__truth(tmp_path: Path) -> None:
    (tmp_path / ".gruber").write_text("a file in the way")
    with pytest.raises(StorageError, match="a file stands where a folder is needed"):
        Session.open(tmp_path, "ada")


def test_a_folder_of_ours_that_links_to_one_about_the_block_is_told__law(tmp_path: Path) -> None:
    """Leftovers of others would be tended there."""
    block = tmp_path / "block"
    block.mkdir()
    (block / ".gruber").symlink_to("..")
    with pytest.raises(StorageError, match="link to a folder that holds the block"):
        Session.open(block, "ada")
    assert [path.name for path in tmp_path.iterdir()] == ["block"]


def test_an_emptied_session_of_a_block_with_products_is_told_and_not_begun_anew__law(
    tmp_path: Path,
) -> None:
    Session.open(tmp_path, "anna").close()
    file = tmp_path / FILE
    # Nothing was made yet: a process was killed as it began the file.
    file.write_bytes(b"")
    with Session.open(tmp_path, "anna") as session:
        session.products.save_value("scans", session.products.digest_of("scans"), [1])
    file.write_bytes(b"")
    with pytest.raises(StorageError, match="decisions of this block are lost"):
        Session.open(tmp_path, "anna")
    assert file.read_bytes() == b""
    file.unlink()
    Session.open(tmp_path, "anna").close()


def test_a_session_that_is_looked_at_is_read_and_never_written__law(tmp_path: Path) -> None:
    with Session.open(tmp_path / "block", "ada") as session:
        session.record(Remark("place", "", "dark", (1.0, 2.0), "tone"))

    def files() -> dict[Path, int]:
        return {path: path.stat().st_mtime_ns for path in (tmp_path / "block").rglob("*")}

    before = files()
    with Session.look(tmp_path / "block", "bob") as session:
        assert [item.who for item in session.decisions()] == ["ada"]
        with pytest.raises(StorageError):
            session.record(Remark("place", "", "again", (1.0, 2.0), "tone"))
    assert files() == before
    (tmp_path / "empty").mkdir()
    with Session.look(tmp_path / "empty", "bob") as session:
        assert session.decisions() == ()
    assert list((tmp_path / "empty").iterdir()) == []


def test_a_folder_of_products_that_may_not_be_read_is_named__law(tmp_path: Path, monkeypatch):
    def forbidden(folder: Path):
        raise PermissionError(13, "Permission denied", str(folder))

    monkeypatch.setattr(Path, "iterdir", forbidden)
    with pytest.raises(StorageError, match="products"):
        Session.open(tmp_path, "anna")
