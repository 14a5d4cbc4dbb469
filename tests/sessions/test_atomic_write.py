"""Files that are whole or not there."""

import errno
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import rasterio

from core.errors import StorageError
from sessions.atomic_write import clean_leftovers, whole_file, whole_folder
from sessions.processes import this_process

REPOSITORY = Path(__file__).resolve().parents[2]

WRITE_FOR_EVER = """
import sys, time
from pathlib import Path
from sessions.atomic_write import whole_file

path = Path(sys.argv[1])
while True:
    with whole_file(path) as temporary, temporary.open("wb") as file:
        for _ in range(50):
            file.write(b"new " * 1000)
            file.flush()
            print("writing", flush=True)
"""


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_file_appears_when_the_block_ends__truth(tmp_path: Path) -> None:
    path = tmp_path / "results" / "report.html"
    with whole_file(path) as temporary:
        temporary.write_text("whole")
        assert not path.exists()
        assert temporary.parent == path.parent
        assert temporary.suffix == ".html"
    assert path.read_text() == "whole"
    assert names(path.parent) == ["report.html"]


def test_an_error_leaves_the_old_file_and_nothing_else__law(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError), whole_file(path) as temporary:  # noqa: PT012
        temporary.write_text("half")
        _ = 1 / 0
    assert path.read_text() == "old"
    assert names(tmp_path) == ["report.html"]


def test_companions_of_a_raster_move_along__oracle(tmp_path: Path) -> None:
    path = tmp_path / "LMSA08.1984.00150.tif"
    profile = {"driver": "GTiff", "width": 4, "height": 4, "count": 1, "dtype": "uint8"}
    transform = rasterio.Affine(0.5, 0, 100, 0, -0.5, 200)
    with (
        whole_file(path) as temporary,
        rasterio.open(temporary, "w", **profile, transform=transform, tfw="YES") as raster,
    ):
        raster.write(np.ones((1, 4, 4), np.uint8))
    assert names(tmp_path) == ["LMSA08.1984.00150.tfw", "LMSA08.1984.00150.tif"]
    with rasterio.open(path) as raster:
        assert raster.transform == transform


def test_killed_in_the_middle_leaves_the_old_file__law(tmp_path: Path) -> None:
    path = tmp_path / "mosaic.tif"
    path.write_text("old")
    process = subprocess.Popen(
        [sys.executable, "-c", WRITE_FOR_EVER, str(path)],
        cwd=REPOSITORY,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    process.stdout.readline()
    process.kill()
    process.communicate()
    content = path.read_text()
    assert content == "old" or content == "new " * 50_000
    left = [name for name in names(tmp_path) if name != "mosaic.tif"]
    assert len(left) <= 1
    # The next write of the same file takes it away.
    with whole_file(path) as temporary:
        temporary.write_text("newer")
    assert names(tmp_path) == ["mosaic.tif"]


def test_left_over_folders_go_and_work_in_progress_stays__truth(tmp_path: Path) -> None:
    host, number, start = this_process().split("-")
    dead = tmp_path / "deep" / f".a.part-{host}-{number}-{int(start or 0) + 1}-0123456789ab"
    dead.mkdir(parents=True)
    (dead / "tile.tif").write_text("half")
    elsewhere = tmp_path / f".b.part-00000000-{number}-{start}-0123456789ab.tif"
    elsewhere.write_text("of another machine")
    (tmp_path / ".hidden.part-one").write_text("the user's own")
    with whole_file(tmp_path / "c.tif") as temporary:
        temporary.write_text("in work")
        assert clean_leftovers(tmp_path) == (dead,)
        old = time.time() - 2 * 24 * 3600
        os.utime(elsewhere, (old, old))
        assert clean_leftovers(tmp_path) == (elsewhere,)
    assert names(tmp_path) == [".hidden.part-one", "c.tif", "deep"]


def test_folder_takes_the_place_of_the_old_one__truth(tmp_path: Path) -> None:
    path = tmp_path / "sheets"
    for content in ("old", "new"):
        with whole_folder(path) as temporary:
            (temporary / content).write_text(content)
    assert names(path) == ["new"]
    with pytest.raises(ZeroDivisionError), whole_folder(path) as temporary:  # noqa: PT012
        (temporary / "half").write_text("half")
        _ = 1 / 0
    assert names(path) == ["new"]
    assert names(tmp_path) == ["sheets"]


def test_two_writers_of_one_folder_do_not_disturb_each_other__law(tmp_path: Path) -> None:
    path = tmp_path / "sheets"
    with whole_folder(path) as first, whole_file(tmp_path / "seams") as file:
        (first / "first").touch()
        file.touch()
        with whole_folder(path) as second, whole_file(tmp_path / "seams") as other:
            (second / "second").touch()
            other.touch()
        assert names(path) == ["second"]
        assert (first / "first").exists()
        assert file.exists()
    assert names(path) == ["first"]
    assert names(tmp_path) == ["seams", "sheets"]


def test_a_full_disk_is_told_with_file_and_remedy__truth(tmp_path: Path) -> None:
    """The limit on the size of a file stands in for a full disk."""
    script = """
import resource, sys
from pathlib import Path
from core.errors import StorageError
from sessions.atomic_write import whole_file

resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
try:
    with whole_file(Path(sys.argv[1])) as temporary:
        temporary.write_bytes(bytes(5000))
except StorageError as error:
    print(error)
"""
    path = tmp_path / "mosaic.tif"
    path.write_text("old")
    output = subprocess.run(
        [sys.executable, "-c", script, str(path)],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert output.startswith(f"{path}: could not be written: the disk is full. Free some space")
    assert path.read_text() == "old"
    assert names(tmp_path) == ["mosaic.tif"]


def test_a_library_that_hides_the_full_disk_is_understood__truth(tmp_path: Path) -> None:
    with (
        pytest.raises(StorageError, match="the disk is full"),
        whole_file(tmp_path / "mosaic.tif"),
    ):
        raise RuntimeError("TIFFAppendToStrip: Write error: No space left on device")


def test_a_read_only_folder_is_told__truth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def forbidden(*_: object) -> None:
        raise OSError(30, "Read-only file system", str(tmp_path))

    monkeypatch.setattr(os, "replace", forbidden)
    with (
        pytest.raises(StorageError, match=r"read-only. Give yourself the right"),
        whole_file(tmp_path / "a.csv") as temporary,
    ):
        temporary.write_text("whole")


def test_a_file_where_the_folder_should_be_is_told__truth(tmp_path: Path) -> None:
    (tmp_path / "results").write_text("not a folder")
    with (
        pytest.raises(StorageError, match="a file stands where a folder is needed"),
        whole_file(tmp_path / "results" / "a.csv"),
    ):
        pass


def test_a_folder_that_cannot_be_made_is_told__truth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As below `/proc`, where nothing can be made and the system says that there is no folder."""

    def nowhere(*_: object, **__: object) -> None:
        raise FileNotFoundError(errno.ENOENT, "No such file or directory", "x")

    monkeypatch.setattr(Path, "mkdir", nowhere)
    for whole in (whole_file, whole_folder):
        with (
            pytest.raises(StorageError, match="cannot be made") as told,
            whole(tmp_path / "nope" / "a.csv"),
        ):
            pass
        assert told.value.file.endswith("nope")
        assert told.value.remedy == "Name another folder, or make this one yourself."


def test_an_error_about_another_file_passes__truth(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), whole_file(tmp_path / "a.csv"):
        (tmp_path / "missing.tif").read_bytes()
