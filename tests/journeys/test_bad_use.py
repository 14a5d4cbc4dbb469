"""Where and how the program is used: no room, no right to write, a taken port, two runs, Ctrl-C."""

import json
import resource
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from core.synthetic.truth import read_truth
from tests.forked import Forked
from tests.journeys.copies import (
    REPOSITORY,
    BlockCopy,
    Told,
    copied,
    gruber,
    nearly_placed,
    run_alone,
    stages_walked,
    started,
)
from tests.journeys.spoiling import cut_off, pixels_changed
from ui.words.catalogue import words

CopyOf = Callable[..., BlockCopy]
Capsys = pytest.CaptureFixture[str]


def test_a_file_where_the_results_belong_is_told__truth(copy_of: CopyOf, capsys: Capsys) -> None:
    copy = copy_of(1)
    copy.replace("results", "here")
    told = gruber(capsys, "run", copy.folder)
    told.refuses(copy.results, "a file stands where a folder is needed", "Rename or remove")
    assert Path(copy.results).read_text() == "here"


def test_a_session_that_is_none_is_told__truth(copy_of: CopyOf, capsys: Capsys) -> None:
    copy = copy_of(1)
    copy.replace("session.gpkg", b"garbage " * 999)
    told = gruber(capsys, "run", copy.folder)
    told.refuses("session.gpkg", "is not a session", "Move it out")
    (copy.folder / "session.gpkg").unlink()
    (copy.folder / "session.gpkg").mkdir()
    told = gruber(capsys, "run", copy.folder)
    told.refuses("session.gpkg", "is a folder", "Rename it")


def test_folders_without_a_block_are_told__truth(tmp_path: Path, capsys: Capsys) -> None:
    gruber(capsys, "run", tmp_path).refuses("block.toml", "is not there", f"gruber new {tmp_path}")
    told = gruber(capsys, "run", tmp_path / "nowhere")
    told.refuses("nowhere", "is not there", "Name the block's folder")
    gruber(capsys, "new", tmp_path / "nowhere").refuses(
        "nowhere", "is no folder", "Name the folder"
    )
    gruber(capsys, "report", tmp_path).refuses("block.toml", "is not there")
    gruber(capsys, "review", tmp_path / "nowhere").refuses("nowhere", "is not there")


def test_a_demo_that_cannot_be_written_is_told__truth(tmp_path: Path, capsys: Capsys) -> None:
    (tmp_path / "file").write_text("here")
    told = gruber(capsys, "demo", "--size", "tiny", "--headless", "--out", tmp_path / "file")
    told.refuses(tmp_path / "file", "a file stands where a folder is needed", "Rename or remove")


@pytest.mark.parametrize(
    "wrong",
    [
        ("run", "BLOCK", "--from", "ties", "--until", "scans"),
        ("run", "BLOCK", "--until", "nowhere"),
        ("run", "BLOCK", "--workers", "0"),
        ("run", "BLOCK", "--workers", "two"),
        ("review", "BLOCK", "--port", "99999"),
        ("demo", "--seed", "-1"),
        ("demo", "--relief", "nan"),
        ("check", "plan", "BLOCK", "--operator", "  "),
        ("fly",),
        (),
    ],
)
def test_wrong_use_is_told_with_code_two__truth(
    wrong: tuple[str, ...], tmp_path: Path, capsys: Capsys
) -> None:
    told = gruber(capsys, *(str(tmp_path) if word == "BLOCK" else word for word in wrong))
    assert told.code == 2
    assert told.err.splitlines()[-1].startswith("gruber")
    assert "Traceback" not in told.err


def test_machines_read_the_error_as_well__truth(copy_of: CopyOf, capsys: Capsys) -> None:
    copy = copy_of(1)
    copy.setting("files", '"scan/*.tif"')
    told = gruber(capsys, "--log-json", "run", copy.folder)
    said = json.loads(told.out)
    assert said["event"] == "error"
    assert told.message == f"gruber: {said['file']}: {said['cause']} {said['remedy']}"


@dataclass(frozen=True)
class SpoiltRun:
    """A block that was run to its end with four of its six scans spoilt."""

    copy: BlockCopy
    said: Told
    bad: tuple[str, ...]


@pytest.fixture(scope="module")
def spoilt(tiny_block: Path, tmp_path_factory: pytest.TempPathFactory) -> SpoiltRun:
    """Four scans that cannot be used, and two that show nothing in common."""
    copy = copied(tiny_block, tmp_path_factory.mktemp("spoilt") / "block", 6)
    first, *bad = copy.scans
    del bad[2]
    cut_off(copy, f"scans/{bad[0].name}")
    copy.replace(bad[1], b"no image " * 99)
    pixels_changed(copy, f"scans/{bad[2].name}", lambda values: values[:, :600, :600])
    copy.replace(bad[3].with_suffix(".tfw"), "1 2 three")
    pixels_changed(copy, f"scans/{first.name}", common_corner_blank)
    return SpoiltRun(copy, run_alone("run", copy.folder), tuple(path.stem for path in bad))


def common_corner_blank(values: np.ndarray) -> np.ndarray:
    """Nothing in the south east, where the first photo overlaps the fourth."""
    rows, columns = values.shape[1:]
    values[:, int(0.66 * rows) :, int(0.7 * columns) :] = 128
    return values


def test_scans_set_aside_are_in_the_report_and_told__truth(spoilt: SpoiltRun) -> None:
    assert (spoilt.said.code, spoilt.said.err) == (0, "")
    reasons = spoilt.copy.report()["set_aside"]
    assert set(reasons) == set(spoilt.bad)
    for name in spoilt.bad:
        assert name in reasons[name]
        assert f"Set aside: {reasons[name]}" in spoilt.said.out
    page = (spoilt.copy.results / "report.html").read_text(encoding="utf-8")
    assert all(name in page for name in spoilt.bad)


def test_scans_that_do_not_overlap_go_on_by_control_alone__truth(spoilt: SpoiltRun) -> None:
    report = spoilt.copy.report()
    untied = [doubt for doubt in report["doubts"] if "is not tied to the block" in doubt["message"]]
    assert len(untied) == 2
    assert "is not tied to the block: no overlap could be matched" in spoilt.said.out
    assert len((spoilt.copy.results / "tie_points.csv").read_text().splitlines()) == 1
    # A photo stands by its own control, or is left out with the reason.
    fallen = [doubt for doubt in report["doubts"] if doubt["kind"] == "photo-orientation"]
    assert report["block"]["oriented"] == 2 - len(fallen) >= 1
    assert all("did not stand on the reference" in doubt["message"] for doubt in fallen)


def test_a_second_run_makes_nothing_again__law(spoilt: SpoiltRun, capsys: Capsys) -> None:
    told = gruber(capsys, "run", spoilt.copy.folder, "--until", "mosaic")
    assert told.code == 0
    assert told.out.count("(as before)") == stages_walked(spoilt.copy.folder)


def test_a_raster_that_was_cut_is_made_again__law(spoilt: SpoiltRun, capsys: Capsys) -> None:
    path = spoilt.copy.results / "mosaic.tif"
    gruber(capsys, "run", spoilt.copy.folder, "--until", "mosaic")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert gruber(capsys, "run", spoilt.copy.folder, "--until", "mosaic").code == 0
    assert path.read_bytes() == whole


def test_a_port_that_is_taken_is_told__truth(spoilt: SpoiltRun, capsys: Capsys) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        told = gruber(capsys, "review", spoilt.copy.folder, "--port", port, "--no-browser")
    told.refuses(f"127.0.0.1:{port}", "cannot be listened on", "Choose another port")


def test_one_scan_alone_goes_all_the_way__truth(copy_of: CopyOf) -> None:
    copy = copy_of(1)
    told = run_alone("run", copy.folder)
    assert (told.code, told.err) == (0, "")
    assert copy.report()["block"]["oriented"] == 1
    assert (copy.results / "mosaic.tif").is_file()


def test_ctrl_c_ends_at_once_and_the_next_run_goes_on__law(
    tiny_block: Path, copy_of: CopyOf, capsys: Capsys
) -> None:
    copy = copy_of(2)
    nearly_placed(copy, read_truth(tiny_block))
    process = started("--log-json", "run", copy.folder)
    assert process.stdout is not None
    for line in process.stdout:
        if json.loads(line) == {"event": "stage", "stage": "ties"}:
            break
    # Meanwhile nobody else may run the same block.
    told = gruber(capsys, "run", copy.folder)
    told.refuses("run.lock", f"(process {process.pid}", "is working on this block", "Wait")
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=20)
    assert process.returncode == 130
    assert err == f"gruber: {words()['terminal.cancelled.stages']}\n"
    assert not left_over(copy)
    told = gruber(capsys, "run", copy.folder, "--until", "ties")
    assert told.code == 0
    assert told.out.count("(as before)") == 4


def left_over(copy: BlockCopy) -> list[Path]:
    """Temporaries in the block's folder."""
    return list(copy.folder.rglob(".*part-*"))


def run_on_a_full_disk(size: int, *arguments: str) -> int:
    """The command line where no file may grow beyond a size."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
    return main(["run", *arguments])


def told_on_a_full_disk(size: int, *arguments: object) -> Told:
    with Forked(run_on_a_full_disk, size, *map(str, arguments)) as process:
        return without_libtiff(process.ended())


def without_libtiff(told: Told) -> Told:
    """It speaks for itself when a write fails."""
    lines = [line for line in told.err.splitlines() if not line.startswith("_tiffWriteProc")]
    return replace(told, err="\n".join(lines))


MAY_NOT_WRITE = """
import ctypes, os, sys
if os.geteuid() == 0:
    # Without these two capabilities the rights of files hold for root as well.
    for capability in (1, 2):
        assert ctypes.CDLL(None).prctl(24, capability, 0, 0, 0) == 0
os.execv(sys.executable, [sys.executable, "-m", "gruber", *sys.argv[1:]])
"""
"""Starts the program where it may not write."""


def told_where_it_may_not_write(*arguments: object) -> Told:
    process = subprocess.run(
        [sys.executable, "-c", MAY_NOT_WRITE, *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=REPOSITORY,
        check=False,
    )
    return without_libtiff(Told(process.returncode, process.stdout, process.stderr))


@pytest.mark.parametrize(
    ("size", "first", "file"),
    [
        (20_000, "adjustment", ".gruber/products/adjustment/"),
        (60_000, "orthos", "results/ortho/"),
        (500_000, "orthos", "results/ortho/"),
        (90_000, "mosaic", "results/mosaic.tif"),
        (500_000, "mosaic", "results/mosaic.tif"),
        (2_000, "report", ".gruber/products/misfit/"),
        (200_000, "report", "results/origin_sigma.tif"),
        (500_000, "report", "results/report.html"),
    ],
)
def test_a_full_disk_is_told_and_leaves_nothing_half__truth(
    size: int, first: str, file: str, spoilt: SpoiltRun, capsys: Capsys
) -> None:
    copy = spoilt.copy
    assert gruber(capsys, "run", copy.folder, "--until", "mosaic").code == 0
    told = told_on_a_full_disk(size, copy.folder, "--from", first)
    told.refuses(copy.folder, file, "full", "free")
    assert not left_over(copy)


def test_a_session_on_a_full_disk_is_told__truth(copy_of: CopyOf) -> None:
    copy = copy_of(1)
    told = told_on_a_full_disk(20_000, copy.folder)
    told.refuses("session.gpkg", "is full", "Check the free space")


@pytest.mark.parametrize("place", ["results/ortho", "results", ".gruber/products/mosaic"])
def test_a_place_that_may_not_be_written_is_told__truth(
    place: str, spoilt: SpoiltRun, capsys: Capsys
) -> None:
    folder = spoilt.copy.folder
    assert gruber(capsys, "run", folder, "--until", "mosaic").code == 0
    (folder / place).chmod(0o555)
    try:
        told = told_where_it_may_not_write("run", folder, "--from", "orthos", "--until", "mosaic")
    finally:
        (folder / place).chmod(0o755)
    told.refuses(folder, place, "may not be written", "Give yourself the right to write")


def test_a_block_that_may_not_be_written_is_told__truth(copy_of: CopyOf) -> None:
    copy = copy_of(1)
    copy.folder.chmod(0o555)
    told = told_where_it_may_not_write("run", copy.folder)
    copy.folder.chmod(0o755)
    told.refuses(copy.folder, "may not be written", "Give yourself the right to write")


def test_a_block_on_a_read_only_medium_is_told__truth(spoilt: SpoiltRun) -> None:
    folder = spoilt.copy.folder
    everything = [folder, *folder.rglob("*")]
    for path in everything:
        path.chmod(path.stat().st_mode & ~0o222)
    try:
        told = told_where_it_may_not_write("run", folder)
    finally:
        for path in everything:
            path.chmod(path.stat().st_mode | 0o200)
    told.refuses(folder, "may not be written", "Give yourself the right to write")
