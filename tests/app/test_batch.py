"""Many blocks: lists of every kind, failures that stay where they are, and stopping."""

import csv
import pickle
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from distributed import KilledWorker

from app.batch import TABLE, BlockTask, read_list, run_apart, run_on_cluster, run_silently
from app.block_toml import FieldError
from app.cli import DONE, UNUSABLE, main
from app.project import read_project
from app.run import NOTHING_STANDS
from core.errors import ProjectError
from ui.words.catalogue import Teller


def block(folder: Path) -> Path:
    folder.mkdir(parents=True)
    (folder / "block.toml").write_text("[block]\n", encoding="utf-8")
    return folder


def rows(folder: Path) -> dict[str, dict[str, str]]:
    with (folder / TABLE).open(encoding="utf-8") as file:
        return {Path(row["block"]).name: row for row in csv.DictReader(file)}


@pytest.fixture
def three(tmp_path):
    return [block(tmp_path / "archive" / name) for name in ("a", "b", "c")]


def test_a_folder_a_file_and_a_table_list_the_same_blocks__truth(tmp_path, three):
    listed = tmp_path / "list.txt"
    listed.write_text("# rolls\n\narchive/a\narchive/b/block.toml\narchive/c\n", encoding="utf-8")
    table = tmp_path / "list.csv"
    table.write_text("block,until\narchive/a,\narchive/b,ties\narchive/c,\n", encoding="utf-8")
    for source in (tmp_path / "archive", tmp_path / "arch*" / "[abc]", listed, table):
        assert [task.block.resolve() for task in read_list(source)] == three
    assert [task.until for task in read_list(table)] == ["", "ties", ""]


def test_blocks_that_the_shell_spelt_out_have_their_table_above_them__truth(three):
    assert main(["batch", *map(str, three)]) == UNUSABLE
    told = rows(three[0].parent)
    assert [told[name]["state"] for name in ("a", "b", "c")] == ["failed"] * 3


def test_a_list_that_its_table_would_replace_is_refused__law(tmp_path, three, capsys):
    source = tmp_path / TABLE
    source.write_text("block\narchive/a\n", encoding="utf-8")
    assert main(["batch", str(source)]) == UNUSABLE
    assert "Rename it" in capsys.readouterr().err
    assert source.read_text(encoding="utf-8") == "block\narchive/a\n"


def test_a_higher_priority_runs_first__truth(tmp_path, three):
    table = tmp_path / "list.csv"
    table.write_text("priority,block\n1,archive/a\n,archive/b\n7.5,archive/c\n", encoding="utf-8")
    assert [task.block.name for task in read_list(table)] == ["c", "a", "b"]


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("", "lists no block"),
        ("archive/a\narchive/nowhere\n", "archive/nowhere"),
        ("archive/a\narchive/a/block.toml\n", "more than once"),
        ("block,until\narchive/a,landing\n", "landing"),
        ("block,colour\narchive/a,red\n", "colour"),
        ("block,priority\narchive/a,high\n", "no number"),
        ("priority,block\n3\n", "row without a block"),
        (b"\xff\xfe\x00", "cannot be read"),
    ],
)
def test_a_list_that_cannot_be_used_is_refused_by_name__law(tmp_path, three, text, cause):
    source = tmp_path / "list.csv"
    source.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ProjectError, match=cause):
        read_list(source)
    assert not (tmp_path / TABLE).exists()


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
    states = {name: (row["state"], row["stage"]) for name, row in found.items()}
    assert states["one"] == ("done", "scans")
    assert states["two"] == ("done", "georeference")
    assert states["broken"][0] == "failed"
    assert "block.toml" in found["broken"]["message"]
    assert found["one"]["findings"].split(":")[0].isdecimal()


def test_why_a_block_failed_is_told_in_every_language__law(tmp_path):
    """A terminal in Czech told of the failures of a batch in English."""
    task, tell = BlockTask(block(tmp_path / "broken")), Teller("cs")
    apart = run_apart(task, 1, lambda *_: None, set())
    with pytest.raises(ProjectError) as error:
        read_project(task.block)
    assert apart.message == error.value.told
    assert tell.again(apart.message) == tell.again(error.value.told) != apart.message
    # A worker of a cluster sends the error itself, of whatever kind.
    field = FieldError(
        "scans", "folder", "block.toml: [scans] folder", "is no folder.", "Name one."
    )
    for told in (error.value, field):
        sent = pickle.loads(pickle.dumps(told))
        assert (type(sent), vars(sent)) == (type(told), vars(told))
        assert tell.again(sent.told) == tell.again(told.told)


class Ends:
    """A future of a cluster that ended in one way; a client that hands out one after another."""

    def __init__(self, *ways):
        self.ways = list(ways)

    def submit(self, *_, pure, priority):
        assert (pure, priority) == (False, 0.0)
        return Ends(self.ways.pop(0))

    def exception(self):
        return self.ways[0] if isinstance(self.ways[0], Exception) else None

    def cancelled(self):
        return self.ways[0] == "cancelled"

    def result(self):
        return self.ways[0]


def test_a_cluster_runs_a_block_again_when_workers_die_and_not_when_it_fails__law(tmp_path):
    """A block that could not be used was run six times, and one of four dead workers given up."""
    task = BlockTask(tmp_path)
    died = KilledWorker("block", None, 3)
    assert run_on_cluster(Ends(died, ""), task).state == "done"
    failed = run_on_cluster(Ends(died, died, ""), task)
    assert (failed.state, failed.message.split(";")[0]) == (
        "failed",
        "every worker that ran it died",
    )
    cannot = run_on_cluster(Ends(ProjectError("a.tif", "is cut off.", "Scan it."), ""), task)
    assert (cannot.state, cannot.message) == ("failed", "a.tif: is cut off. Scan it.")
    with pytest.raises(ProjectError, match="answers no longer"):
        run_on_cluster(Ends("cancelled"), task)


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
    assert run_silently(BlockTask(folder)) == NOTHING_STANDS
    for executor in ("threads", "processes"):
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
    assert not list(tmp_path.rglob(TABLE))
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
    assert "describes no camera" in rows(three[0])["a"]["message"]
    assert not (beside / "hijacked").exists()


@pytest.mark.parametrize("asked", [signal.SIGINT, signal.SIGTERM])
def test_who_stops_it_stops_the_runs_under_way_and_the_next_call_resumes__law(
    tiny_block, tmp_path, asked
):
    shutil.copytree(tiny_block, tmp_path / "one")
    command = [sys.executable, "-m", "gruber", "batch", str(tmp_path)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL)
    products = tmp_path / "one" / ".gruber" / "products" / "scans"
    while not products.exists():
        assert process.poll() is None
        time.sleep(0.1)
    process.send_signal(asked)
    _, told = process.communicate(timeout=90)
    assert process.returncode == 130
    assert b"stopped" in told
    assert rows(tmp_path)["one"]["state"] == "waiting"
    (tmp_path / "list.csv").write_text("block,until\none,scans\n", encoding="utf-8")
    assert main(["batch", str(tmp_path / "list.csv")]) == DONE
    assert rows(tmp_path)["one"]["state"] == "done"
