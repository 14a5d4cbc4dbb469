"""Many blocks: failures that stay where they are, and stopping."""

import csv
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from app.batch import batch_told
from app.block_tasks import read_list
from app.block_toml import BATCH_TABLE
from app.cli import DONE, UNUSABLE, main
from app.run import NOTHING_STANDS


def block(folder: Path) -> Path:
    folder.mkdir(parents=True)
    (folder / "block.toml").write_text("[block]\n", encoding="utf-8")
    return folder


def rows(folder: Path) -> dict[str, dict[str, str]]:
    with (folder / BATCH_TABLE).open(encoding="utf-8") as file:
        return {Path(row["block"]).name: row for row in csv.DictReader(file)}


@pytest.fixture
def three(tmp_path):
    return [block(tmp_path / "archive" / name) for name in ("a", "b", "c")]


def test_blocks_that_the_shell_spelt_out_have_their_table_above_them__truth(three):
    assert main(["batch", *map(str, three)]) == UNUSABLE
    told = rows(three[0].parent)
    assert [told[name]["state"] for name in ("a", "b", "c")] == ["failed"] * 3


def test_every_block_is_run_however_many_there_are_and_whatever_their_names__law(tmp_path, capsys):
    names = [f"b{number:03d}" for number in range(505)]
    for name in names:
        block(tmp_path / name)
    assert len(read_list(tmp_path)) == len(names)
    odd = tmp_path / "few" / os.fsdecode(b"bad\xff")
    block(odd)
    assert main(["batch", str(odd.parent)]) == UNUSABLE
    assert "1 of 1 blocks failed" in capsys.readouterr().err
    assert rows(odd.parent)["bad\\udcff"]["state"] == "failed"


def test_a_table_tells_how_far_its_blocks_are_and_another_program_s_tells_nothing__law(tmp_path):
    assert batch_told(tmp_path) is None
    table = tmp_path / BATCH_TABLE
    table.write_text("block,state\none,done\n", encoding="utf-8")
    assert batch_told(tmp_path) is None
    head = "block,state,stage,seconds,findings,message\n"
    table.write_text(f"{head}1938/one,failed,control,2.5,,'=1 is no CRS.\n", encoding="utf-8")
    (tmp_path / "spoilt").mkdir()
    for spoilt in ("one,done", "one,gone,ties,0,,", "one,done,landing,0,,", "a\rb,done,,0,,"):
        (tmp_path / "spoilt" / BATCH_TABLE).write_bytes(f"{head}{spoilt}\n".encode())
        assert batch_told(tmp_path / "spoilt") is None
    told = batch_told(tmp_path)
    assert told["blocks"] == {"1938/one": ["failed", "control", "=1 is no CRS."]}
    assert told["written"].endswith("+00:00")


def test_a_block_that_was_run_after_its_batch_had_been_killed_is_done__truth(tmp_path):
    head = "block,state,stage,seconds,findings,message\n"
    table = tmp_path / BATCH_TABLE
    table.write_text(f"{head}one,running,ties,0,,\ntwo,waiting,,0,,\n", encoding="utf-8")
    os.utime(table, (0, 0))
    (tmp_path / "one" / "results").mkdir(parents=True)
    (tmp_path / "one" / "results" / "report.json").write_text("{}", encoding="utf-8")
    blocks = batch_told(tmp_path)["blocks"]
    assert [blocks[name][0] for name in ("one", "two")] == ["done", "left"]


def test_a_list_that_its_table_would_replace_is_refused__law(tmp_path, three, capsys):
    source = tmp_path / BATCH_TABLE
    source.write_text("block\narchive/a\n", encoding="utf-8")
    assert main(["batch", str(source)]) == UNUSABLE
    assert "Rename it" in capsys.readouterr().err
    assert source.read_text(encoding="utf-8") == "block\narchive/a\n"


@pytest.mark.parametrize("executor", ["threads", "processes", "dask"])
def test_a_block_that_fails_stops_no_other__truth(tiny_run, tmp_path, capsys, executor):
    for name in ("one", "two"):
        shutil.copytree(tiny_run.folder, tmp_path / name)
    block(tmp_path / "broken")
    listed = "block,until\nbroken,\none,scans\ntwo,georeference\n"
    (tmp_path / "list.csv").write_text(listed, encoding="utf-8")
    command = ["batch", str(tmp_path / "list.csv"), "--executor", executor, "--workers", "2"]
    assert main(command) == UNUSABLE
    told = capsys.readouterr().err
    assert "1 of 3 blocks failed" in told
    assert "broken" in told
    found = rows(tmp_path)
    assert set(batch_told(tmp_path)["blocks"]) == {"broken", "one", "two"}
    states = {name: (row["state"], row["stage"]) for name, row in found.items()}
    assert states["one"] == ("done", "scans")
    assert states["two"] == ("done", "georeference")
    assert states["broken"][0] == "failed"
    assert "block.toml" in found["broken"]["message"]
    assert found["one"]["findings"].split(":")[0].isdecimal()


def test_a_block_in_which_no_photo_stands_is_not_done__truth(tiny_block, tmp_path, capsys):
    """The list said "done" where `gruber report` ends with an error."""
    folder = tmp_path / "archive" / "one"
    shutil.copytree(tiny_block, folder)
    for scan in sorted((folder / "scans").glob("*.tif"))[1:]:
        scan.unlink()
    text = (folder / "block.toml").read_text(encoding="utf-8")
    points = '[control]\npoints = "points.csv"\n'
    text = re.sub(r"\[reference\]\n(.+\n)+", points, text)
    (folder / "block.toml").write_text(text, encoding="utf-8")
    (folder / "points.csv").write_text("id,X,Y,Z\nA,-577500,-1192900,300\n", encoding="utf-8")
    assert main(["batch", str(tmp_path / "archive")]) == UNUSABLE
    assert NOTHING_STANDS in capsys.readouterr().err
    row = rows(tmp_path / "archive")["one"]
    assert (row["state"], row["stage"]) == ("failed", "adjustment")
    assert row["message"] == NOTHING_STANDS
    for executor in ("threads", "processes", "dask"):
        assert main(["run", str(folder), "--executor", executor]) == DONE
        assert NOTHING_STANDS in capsys.readouterr().out


@pytest.mark.parametrize("executor", ["local", "processes", "dask"])
def test_run_takes_the_same_executors__truth(tiny_block, tmp_path, capsys, executor):
    folder = tmp_path / "one"
    shutil.copytree(tiny_block, folder)
    command = ["run", str(folder), "--executor", executor, "--from", "scans", "--until", "scans"]
    assert main(command) == DONE
    products = folder / ".gruber" / "products"
    assert (products / "scans").exists()
    assert not (products / "georeference").exists()
    assert not list(tmp_path.rglob(BATCH_TABLE))
    (folder / "dem.tif").unlink()
    assert main(["run", str(folder / "block.toml"), "--executor", executor]) == UNUSABLE
    assert "dem.tif" in capsys.readouterr().err


def test_the_language_reaches_the_report_of_every_block__truth(tiny_run, tmp_path):
    shutil.copytree(tiny_run.folder, tmp_path / "one")
    assert main(["batch", str(tmp_path), "--language", "cs"]) == DONE
    report = (tmp_path / "one" / "results" / "report.html").read_text(encoding="utf-8")
    assert 'lang="cs"' in report


def test_modules_that_lie_beside_the_blocks_are_not_run__law(three, monkeypatch):
    beside = three[0].parent
    (beside / "calendar.py").write_text("open('hijacked', 'w')", encoding="utf-8")
    monkeypatch.chdir(beside)
    assert main(["batch", str(three[0]), "--executor", "processes"]) == UNUSABLE
    assert "describes no camera" in rows(beside)["a"]["message"]
    assert not (beside / "hijacked").exists()


@pytest.fixture
def begun(tiny_block, tmp_path):
    """A batch over one block, begun; its scans are measured."""
    shutil.copytree(tiny_block, tmp_path / "one")
    command = [sys.executable, "-m", "gruber", "batch", str(tmp_path)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL) as process:
        while not (tmp_path / "one" / ".gruber" / "products" / "scans").exists():
            assert process.poll() is None
            time.sleep(0.1)
        yield process


@pytest.mark.parametrize("asked", [signal.SIGINT, signal.SIGTERM])
def test_who_stops_it_stops_the_runs_under_way_and_the_next_call_resumes__law(
    begun, tmp_path, asked
):
    assert batch_told(tmp_path)["blocks"]["one"][0] == "running"
    begun.send_signal(asked)
    _, told = begun.communicate(timeout=90)
    assert begun.returncode == 130
    assert b"stopped" in told
    assert rows(tmp_path)["one"]["state"] == "waiting"
    assert batch_told(tmp_path)["blocks"]["one"][0] == "left"
    (tmp_path / "list.csv").write_text("block,until\none,scans\n", encoding="utf-8")
    assert main(["batch", str(tmp_path / "list.csv")]) == DONE
    assert rows(tmp_path)["one"]["state"] == "done"


def test_the_runs_of_a_killed_batch_end_too__law(begun, tmp_path, capsys):
    """They held their blocks until they had run them to their end."""
    command = ["run", str(tmp_path / "one"), "--until", "scans"]
    assert main(command) == UNUSABLE  # another one is at work
    assert main(["batch", str(tmp_path)]) == UNUSABLE
    assert "is running this batch" in capsys.readouterr().err
    assert rows(tmp_path)["one"]["state"] == "running"
    begun.kill()
    begun.wait()
    assert batch_told(tmp_path)["blocks"]["one"][0] == "left"
    given_up = time.monotonic() + 90
    while main(command) != DONE:
        assert time.monotonic() < given_up
        time.sleep(0.5)
