"""The Python door: its examples run, and it says what tables and session say."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import gruber
from app.bring_points import OpenQuestionsError
from app.cli import main
from sessions.decisions import BringPoints
from sessions.session import Session
from tests.tiny import Tiny

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "python" / "examples.md"


def test_the_examples_run__law(
    tiny_run: Tiny, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    (tmp_path / "gruber-demo").symlink_to(tiny_run.folder)
    monkeypatch.chdir(tmp_path)
    pieces = re.findall(r"```python\n(.*?)```", EXAMPLES.read_text(encoding="utf-8"), re.DOTALL)
    assert len(pieces) == 5
    known: dict[str, object] = {}
    for piece in pieces:
        exec(compile(piece, str(EXAMPLES), "exec"), known)
    said = capsys.readouterr().out
    assert "6 photos" in said
    assert "sigma nought" in said


def test_tables_are_those_of_the_results__law(tiny_run: Tiny) -> None:
    block = gruber.open_block(tiny_run.folder, quiet=True)
    report = block.adjust()
    photos = block.orientations()
    for row in photos:
        assert np.array_equal(
            [row[axis] for axis in "XYZ"], report.block.photos[row["photo"]].exterior.centre
        )
    assert len(block.measurements()) == len(report.block.measurements)
    ties = block.ties()
    assert ties["rays"].sum() == len(report.block.ties.point)


def test_a_decision_is_on_the_disk_and_undone__law(tiny_run: Tiny) -> None:
    block = gruber.open_block(tiny_run.folder, operator="door", quiet=True)
    measured = block.measurements()
    row = measured[measured["status"] == "auto"][0]
    recorded = block.reject(str(row["point"]), str(row["photo"]), "blurred")
    with Session.open(tiny_run.folder, "another") as session:
        assert recorded in session.decisions()
    after = block.measurements()
    same = after[(after["point"] == row["point"]) & (after["photo"] == row["photo"])]
    assert same["status"] == "rejected"
    block.undo()
    assert np.array_equal(block.measurements()["status"], measured["status"])


def test_what_no_decision_may_say_is_refused_and_leaves_the_session_readable__law(
    tiny_run: Tiny,
) -> None:
    """Such words were recorded; then neither a run nor an undo could read the session again."""
    block = gruber.open_block(tiny_run.folder, operator="door", quiet=True)
    row = block.measurements()[0]
    point, photo = str(row["point"]), str(row["photo"])
    before = block.decisions()
    for wrong, match in (
        (lambda: block.reject(point, photo, "because"), "Reject: reason"),
        (lambda: block.set_role(point, "banana"), "SetRole: role"),
        (lambda: block.place(point, photo, float("nan"), 5.0), "columns and"),
        (lambda: block.place(point, photo, 1e9, -5.0), "columns and"),
        (lambda: block.reject("nope", photo), "no point 'nope'"),
        (lambda: block.accept(point, "nope"), "no photo 'nope'"),
    ):
        with pytest.raises(ValueError, match=match):
            wrong()
    assert block.decisions() == before


def test_an_unknown_format_is_named__law() -> None:
    with pytest.raises(ValueError, match="one of"):
        gruber.read("a.txt", "no such format")


def brought_by_both(
    folder: Path, path: Path, answers: list[str]
) -> tuple[BringPoints | str, BringPoints | str]:
    """What the door records of a table of points, and what `gruber import` does, each undone."""
    made: list[BringPoints | str] = []
    said = [word for one in answers for word in ("--answer", one)]
    for way in ("door", "command"):
        block = gruber.open_block(folder, operator="door", quiet=True)
        before = len(block.decisions())
        if way == "door":
            try:
                block.bring("points", path, answers=answers)
            except OpenQuestionsError as asked:
                made.append(asked.cause)
                continue
        elif main(["import", str(folder), "--from", "points", str(path), *said]):
            made.append("no point was taken over.")
            continue
        decisions = block.decisions()[before:]
        if not decisions:
            made.append("nothing")
            continue
        (one,) = decisions
        assert isinstance(one.decision, BringPoints)
        made.append(one.decision)
        with Session.open(folder, one.who) as session:
            session.undo()
    return made[0], made[1]


def test_points_come_in_as_by_the_command__law(tiny_run: Tiny, tmp_path: Path) -> None:
    """No CRS in the list, a refused row, an answer; and our own export read again."""
    listed = tmp_path / "list.csv"
    listed.write_text("id;X;Y;Z\nA;-577300,5;-1193400,25;250\nB;-577310;-1193410;here\n")
    assert brought_by_both(tiny_run.folder, listed, []) == ("no point was taken over.",) * 2
    door, command = brought_by_both(tiny_run.folder, listed, ["refused=leave out"])
    assert door == command
    assert isinstance(door, BringPoints)
    assert [point.point_id for point in door.points] == ["A"]
    out = gruber.open_block(tiny_run.folder, quiet=True).export("points", tmp_path / "own.csv")
    door, command = brought_by_both(tiny_run.folder, out.path, [])
    assert door == command
    assert isinstance(door, BringPoints)
    assert {point.point_id[:3] for point in door.points} == {"CHK"}


def test_what_a_list_leaves_open_is_told_at_the_door__truth(tiny_run: Tiny, tmp_path: Path) -> None:
    listed = tmp_path / "list.csv"
    listed.write_text("id,X,Y,Z\nA,-577300,-1193400,here\nB,-577300,-1193400,250\n")
    block = gruber.open_block(tiny_run.folder, quiet=True)
    with pytest.raises(gruber.PhotogrammetryError) as asked:
        block.bring("points", listed)
    assert any("refused='leave out'" in line for line in asked.value.__notes__)


def test_an_unknown_stage_is_named__law(tiny_run: Tiny) -> None:
    block = gruber.open_block(tiny_run.folder, quiet=True)
    with pytest.raises(ValueError, match=r"'nonsense' is no stage; it is one of scans, .*report"):
        block.run(last="nonsense")
    with pytest.raises(ValueError, match="'nonsense' is no stage"):
        block.run(first="nonsense")
    with pytest.raises(ValueError, match="'scans' comes before 'ties'"):
        block.run(first="ties", last="scans")


def test_cameras_and_interiors_are_those_of_the_block__law(tiny_run: Tiny) -> None:
    block = gruber.open_block(tiny_run.folder, quiet=True)
    ours = block.adjust().block
    for row in block.cameras():
        camera = ours.cameras[row["camera"]]
        assert row["principal_distance_mm"] == camera.principal_distance_mm
        assert [row["k1"], row["k2"], row["k3"]] == [*camera.radial_distortion]
    pixel = np.array([[1000.0, 700.0]])
    rows = block.interiors()
    assert {*rows["photo"]} == {*ours.photos}
    for row in rows:
        photo = ours.photos[row["photo"]]
        film = [
            row[f"{axis}_0"] + pixel[0] @ (row[f"{axis}_col"], row[f"{axis}_row"]) for axis in "xy"
        ]
        assert film == pytest.approx(photo.interior.film_from_pixel(pixel)[0], abs=1e-6)
        assert (row["columns"], row["rows"]) == photo.size_px
        assert row["fiducials"] == len(photo.interior.names)


def test_a_block_says_what_it_is__law(tiny_run: Tiny, tiny_block: Path, tmp_path: Path) -> None:
    told = repr(gruber.open_block(tiny_run.folder, quiet=True))
    assert "6 scans" in told
    assert "EPSG:5514" in told
    assert "run as far as" in told
    # Others look at the block they share, which leaves an empty folder of results.
    bare = shutil.ignore_patterns("results", ".gruber")
    shutil.copytree(tiny_block, tmp_path / "new", ignore=bare)
    assert "not run yet" in repr(gruber.open_block(tmp_path / "new", quiet=True))
    assert not (tmp_path / "new" / "results").exists()


def test_the_program_loads_linear_algebra_with_one_thread__law() -> None:
    """Its own threads are as many as there are processors; more only wait for each other."""
    told = "import gruber.__main__, json, numpy, threadpoolctl; "
    told += "print(json.dumps(threadpoolctl.threadpool_info()))"
    environment = {name: value for name, value in os.environ.items() if "NUM_THREADS" not in name}
    done = subprocess.run(
        [sys.executable, "-c", told], env=environment, capture_output=True, text=True, check=True
    )
    blas = [one for one in json.loads(done.stdout) if one["user_api"] == "blas"]
    assert blas
    assert all(one["num_threads"] == 1 for one in blas)
