"""One block by one runner: how its end is told, and how workers of a cluster are stopped."""

import pickle
import shutil
import signal
import subprocess
import sys
import time

import pytest
from distributed import KilledWorker, LocalCluster

from app.block_tasks import BlockState, BlockTask
from app.block_toml import BATCH_TABLE, FieldError
from app.cli import DONE, main
from app.project import read_project
from app.runners import Apart, OnCluster
from core.errors import ProjectError
from tests.app.test_batch import block, rows
from ui.words.catalogue import Teller


def test_why_a_block_failed_is_told_in_every_language__law(tmp_path):
    """A terminal in Czech told of the failures of a batch in English."""
    task, tell = BlockTask(block(tmp_path / "broken")), Teller("cs")
    apart = Apart(1, lambda *_: None).run(task)
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

    def subscribe_topic(self, *_):
        """Nobody tells of stages."""

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

    def ended(*ways):
        return OnCluster(Ends(*ways), lambda *_: None, [task]).run(task)

    task = BlockTask(tmp_path)
    died, done = KilledWorker("block", None, 3), BlockState(task, "done")
    assert ended(died, done) == done
    failed = ended(died, died, done)
    assert (failed.state, failed.message.split(";")[0]) == (
        "failed",
        "every worker that ran it died",
    )
    broken = ended(ValueError("no such thing"), done)
    assert (broken.state, broken.message) == ("failed", "no such thing")
    with pytest.raises(ProjectError, match="answers no longer"):
        ended("cancelled")


def test_who_stops_a_batch_on_a_cluster_stops_its_workers_too__law(tiny_block, tmp_path):
    """The blocks stayed locked until the workers had run them to their end."""
    for name in ("one", "two"):
        shutil.copytree(tiny_block, tmp_path / name)
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
        process = begun(tmp_path, cluster.scheduler_address)
        found = rows(tmp_path)
        assert [found[name]["state"] for name in ("one", "two")] == ["running", "waiting"]
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=90) == 130
        assert [row["state"] for row in rows(tmp_path).values()] == ["waiting"] * 2
        # The worker lives, and holds none of them.
        for name in ("one", "two"):
            assert main(["run", str(tmp_path / name), "--until", "scans"]) == DONE
        process = begun(tmp_path, cluster.scheduler_address)
        process.kill()
        process.wait()
        given_up = time.monotonic() + 90
        while main(["run", str(tmp_path / "one"), "--until", "scans"]) != DONE:
            assert time.monotonic() < given_up
            time.sleep(0.5)


def begun(folder, scheduler):
    """A batch on a cluster, whose first block has begun."""
    (folder / BATCH_TABLE).unlink(missing_ok=True)
    command = [sys.executable, "-m", "gruber", "batch", str(folder), "--executor", "dask"]
    process = subprocess.Popen([*command, "--scheduler", scheduler])
    while not (folder / BATCH_TABLE).exists() or rows(folder)["one"]["stage"] == "":
        assert process.poll() is None
        time.sleep(0.1)
    return process
