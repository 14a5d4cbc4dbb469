"""Errors of a full, forbidden or broken disk as messages with file, cause and remedy."""

import errno
import os
import shutil
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from core.errors import StorageError
from core.said import say

SCARCE_BYTES = 1 << 20
"""With less free space than this, a failed write is blamed on the full disk."""
_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_FORBIDDEN = {errno.EROFS, errno.EACCES, errno.EPERM}
_NO_FOLDER = {errno.ENOTDIR, errno.EEXIST, errno.EISDIR}


@contextmanager
def explain_disk_errors(path: Path) -> Generator[None]:
    """Turn every OSError about a file of ours into a `StorageError`."""
    try:
        yield
    except OSError as error:
        raise storage_error(path, error) from error


def make_folder_of(path: Path) -> None:
    """Make the folder of a file that is to be written, with those above it.

    Raises:
        StorageError: It cannot be made.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        if is_full(path, error) or error.errno in _FORBIDDEN | _NO_FOLDER:
            raise storage_error(path, error) from error
        raise StorageError(
            path.parent,
            "cannot be made ({error}).",
            "Name another folder, or make this one yourself.",
            error=error.strerror or error,
        ) from error


def may_be_written(*places: Path) -> bool:
    """True when each of these files and folders, as far as they are there, may be written."""
    return all(os.access(place, os.W_OK) for place in places if place.exists())


def storage_error(path: Path, error: BaseException) -> StorageError:
    """The message for a failed access to a file of ours."""
    number = error.errno if isinstance(error, OSError) else None
    if is_full(path, error):
        return StorageError(
            path,
            "could not be written: the disk is full.",
            say(
                "Free some space ({left} left on the disk, less where you have a quota) and "
                "start again; what was finished before is kept.",
                left=_free(path),
            ),
        )
    if number in _FORBIDDEN:
        return StorageError(
            path,
            "may not be written: the folder is read-only.",
            "Give yourself the right to write there, or copy the block elsewhere.",
        )
    if number in _NO_FOLDER:
        return StorageError(
            path,
            "cannot be made: a file stands where a folder is needed, or the other way round.",
            "Rename or remove what stands in the way.",
        )
    return StorageError(
        path,
        say("could not be read or written ({error}).", error=error),
        "Check the disk and start again.",
    )


def is_full(path: Path, error: BaseException) -> bool:
    """True when an error comes from a full disk, also where a library hides the number."""
    if isinstance(error, OSError) and error.errno is not None:
        return error.errno in _FULL
    if "No space left" in str(error) or "File too large" in str(error):
        return True
    return isinstance(error, OSError) and _free_bytes(path) < SCARCE_BYTES


def is_about_disk(path: Path, error: BaseException) -> bool:
    """True when an error raised while `path` was written is about that disk."""
    if is_full(path, error):
        return True
    if not isinstance(error, OSError) or error.errno not in _FORBIDDEN | {errno.EIO}:
        return False
    # The work may also have failed to read some other file.
    return error.filename in (None, str(path))


def _free_bytes(path: Path) -> int:
    folder = path if path.is_dir() else path.parent
    return shutil.disk_usage(folder).free if folder.is_dir() else SCARCE_BYTES


def _free(path: Path) -> str:
    return f"{_free_bytes(path) / 1e6:.1f} MB"
