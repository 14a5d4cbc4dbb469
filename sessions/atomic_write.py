"""Files and folders that appear whole or not at all, whenever the process is killed."""

import glob
import os
import re
import shutil
import time
import uuid
from collections.abc import Generator, Iterable
from contextlib import contextmanager, suppress
from pathlib import Path

from sessions.disk import explain_disk_errors, is_about_disk, make_folder_of, storage_error
from sessions.processes import is_alive, this_process

OLD_SECONDS = 24 * 3600.0
"""A temporary of another machine is taken for left over after this time."""
_TEMPORARY = re.compile(
    r"^\..*\.part-(?P<process>[0-9a-f]{8}-\d+-\d+)-(?P<token>[0-9a-f]{12})(\.[^.]*)*$"
)
_in_work: set[str] = set()
"""Tokens of the temporaries this process is writing at the moment."""


@contextmanager
def whole_file(path: Path) -> Generator[Path]:
    """A temporary beside `path` that takes its place when the block ends well.

    The temporary keeps the suffix, so that GDAL picks the same driver; companions it writes (a
    world file, the parts of a shapefile) move along, before the file itself.

    Raises:
        StorageError: The disk is full or may not be written; `path` is then as it was.
    """
    make_folder_of(path)
    with _temporary(path) as temporary:
        with explain_disk_errors(path):
            # Whether one may write here is asked first: later a library may hide the answer.
            temporary.touch()
            temporary.unlink()
        yield temporary
        assert temporary.exists(), f"nothing was written to {temporary}"
        with explain_disk_errors(path):
            name = temporary.name.removesuffix(path.suffix)
            for part in sorted(
                _parts(temporary.with_name(name)), key=lambda part: part == temporary
            ):
                _sync(part)
                os.replace(part, path.with_name(path.stem + part.name.removeprefix(name)))
            _sync(path.parent)


@contextmanager
def whole_folder(path: Path) -> Generator[Path]:
    """A temporary folder beside `path` that takes its place when the block ends well.

    A folder that stood there is moved aside first, so a kill in that very moment leaves none.
    """
    make_folder_of(path)
    with _temporary(path) as temporary:
        with explain_disk_errors(path):
            temporary.mkdir()
        yield temporary
        with explain_disk_errors(path), _temporary(path) as former:
            for part in (*temporary.rglob("*"), temporary):
                _sync(part)
            with suppress(FileNotFoundError):
                os.replace(path, former)
            os.replace(temporary, path)
            _sync(path.parent)


def clean_leftovers(folder: Path) -> tuple[Path, ...]:
    """Remove the temporaries of processes that were killed, in a folder and below.

    Returns:
        What was removed.
    """
    return _cleaned(folder.rglob(".*.part-*"))


def _cleaned(paths: Iterable[Path]) -> tuple[Path, ...]:
    """Those of some paths that were left over; they are removed."""
    removed = tuple(path for path in paths if _is_left_over(path))
    for path in removed:
        with suppress(OSError):
            _remove(path)
    return removed


@contextmanager
def _temporary(path: Path) -> Generator[Path]:
    """A free name beside `path`; whatever bears it afterwards is removed.

    What was left over of an earlier write of `path` is removed, too.
    """
    _cleaned(path.parent.glob(f".{glob.escape(path.stem)}.part-*"))
    token = uuid.uuid4().hex[:12]
    name = path.with_name(f".{path.stem}.part-{this_process()}-{token}")
    temporary = name.with_name(name.name + path.suffix)
    _in_work.add(token)
    try:
        yield temporary
    except Exception as error:
        if is_about_disk(temporary, error):
            raise storage_error(path, error) from error
        raise
    finally:
        for part in _parts(name):
            with suppress(OSError):
                _remove(part)
        _in_work.discard(token)


def _parts(name: Path) -> list[Path]:
    """Everything whose name begins like this one: a temporary and its companions."""
    return [part for part in name.parent.glob(".*.part-*") if part.name.startswith(name.name)]


def _is_left_over(path: Path) -> bool:
    found = _TEMPORARY.match(path.name)
    if found is None or found["token"] in _in_work:
        return False
    process = found["process"]
    with suppress(OSError):
        if time.time() - path.stat().st_mtime > OLD_SECONDS and process != this_process():
            return True
    return process == this_process() or not is_alive(process)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _sync(path: Path) -> None:
    """Wait until a file's content, or a folder's list of names, is on the disk."""
    if os.name == "nt" and path.is_dir():
        return  # Windows opens no folder, and writes its list of names by itself
    descriptor = os.open(path, os.O_RDWR if os.name == "nt" else os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
