"""Products on disk, named by a digest of their inputs: up to date, or missing."""

import hashlib
import json
import os
import re
import shutil
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import quote

from core.formats.vectors import LAYER_MARK
from sessions.atomic_write import whole_file, whole_folder
from sessions.codec import CodecError, canonical, decode, encode, path_to_json
from sessions.disk import explain_disk_errors

COMPANIONS = (".tfw", ".jgw", ".pgw", ".wld", ".j2w", ".tifw", ".prj", ".dbf", ".shx", ".points")
"""Suffixes of files beside a file that change what it means."""
SAMPLE_BYTES = 1 << 16
"""How much of the beginning and of the end of a file enters its digest."""
DIGEST_SIGNS = 16
"""So much of a digest tells plans and samples apart."""
_MAGIC = b"gruber-product-1"
_DIGEST_NAME = re.compile(r"^[0-9a-f]{64}(\.value)?$")
_MANIFEST = "product.json"
_LAST = "last"
"""File of a repeated stage that names the product it ended with."""


def digest_of(*parts: Any, here: Path | None = None) -> str:
    """SHA-256 of values and files, 64 hexadecimal digits.

    Args:
        parts: Anything the codec can hold, and dataclasses it does not know. A path, wherever it
            stands in them, counts by its name and, where there is a file, by its size, time, first
            and last 64 KiB, and those of its companions (world file, parts of a shapefile).
        here: Paths inside this folder count as seen from it.
    """
    total = hashlib.sha256()
    for part in parts:
        total.update(hashlib.sha256(canonical(part, lambda path: _stamps(path, here))).digest())
    return total.hexdigest()


class Products:
    """The folder of products: for each stage the newest, whole or not there.

    A stage is a word, or words joined by `/` where a stage has a product for each photo:
    `ortho/1953_014`.
    """

    def __init__(self, folder: Path, here: Path | None = None) -> None:
        """Look into a folder.

        Args:
            folder: That of the products.
            here: The block's folder: it may be moved with all that lies in it.
        """
        self.folder, self._here = folder, here
        self.saved = 0
        """Products saved since the folder was opened."""

    def digest_of(self, *parts: Any) -> str:
        """`digest_of` that stays the same when the block's folder is moved."""
        return digest_of(*parts, here=self._here)

    def fresh(self, stage: str, digest: str) -> Path | None:
        """The value file or folder made from these inputs; None when it must be made."""
        value, folder = self._value_path(stage, digest), self._folder_path(stage, digest)
        if _is_whole_value(value):
            return value
        return folder if _is_whole_folder(folder) else None

    def save_value(self, stage: str, digest: str, value: Any) -> Path:
        """Keep a value; products of the stage from other inputs are then removed."""
        payload = encode(value, self._here)
        header = f"{len(payload)} {hashlib.sha256(payload).hexdigest()}".encode()
        path = self._value_path(stage, digest)
        with whole_file(path) as temporary:
            temporary.write_bytes(b" ".join([_MAGIC, header]) + b"\n" + payload)
        self.saved += 1
        self._prune(path)
        return path

    def load_value(self, stage: str, digest: str) -> Any | None:
        """The value made from these inputs, arrays read-only; None when it must be made."""
        return _value_in(self._value_path(stage, digest), self._here)

    def count_as_last(self, stage: str, product: str, digest: str) -> None:
        """Count the value of one pass as the last of its stage, whatever the times of its files.

        A copy of a block has files of other times.
        """
        path, told = self._stage_path(stage) / _LAST, f"{product}/{digest}"
        if not path.is_file() or path.read_text(encoding="utf-8", errors="replace") != told:
            with whole_file(path) as temporary:
                temporary.write_text(told, encoding="utf-8")

    def latest_value(self, stage: str) -> Any | None:
        """The value of the stage that was made last, from whatever inputs; None if there is none.

        For showing what was, until what is has been made. A repeated stage has a product for each
        pass, in folders below its own; the one that a walk ended with counts.
        """
        newest = self._newest(stage)
        return None if newest is None else _value_in(newest, self._here)

    def latest_digest(self, stage: str) -> str:
        """The digest of `latest_value`; empty if there is none."""
        newest = self._newest(stage)
        return "" if newest is None else newest.stem

    @contextmanager
    def making(self, stage: str, digest: str) -> Generator[Path]:
        """A temporary folder for rasters, which is the product when the block ends well.

        Products of the stage from other inputs are then removed.
        """
        path = self._folder_path(stage, digest)
        with whole_folder(path) as temporary:
            yield temporary
            sizes = {name: size for name, size in _sizes(temporary).items() if name != _MANIFEST}
            with explain_disk_errors(path):
                (temporary / _MANIFEST).write_text(json.dumps(sizes), encoding="utf-8")
        self.saved += 1
        self._prune(path)

    def _newest(self, stage: str) -> Path | None:
        last = self._stage_path(stage) / _LAST
        if last.is_file():
            product, _, digest = last.read_text(encoding="utf-8", errors="replace").rpartition("/")
            path = self._value_path(product, digest)
            if path.is_file():
                return path
        found = (path for path in self._stage_path(stage).rglob("*.value") if path.is_file())
        return max(found, key=lambda path: path.stat().st_mtime_ns, default=None)

    def _stage_path(self, stage: str) -> Path:
        return self.folder.joinpath(*(quote(part, safe=" ") for part in stage.split("/")))

    def _value_path(self, stage: str, digest: str) -> Path:
        return self._stage_path(stage) / f"{digest}.value"

    def _folder_path(self, stage: str, digest: str) -> Path:
        return self._stage_path(stage) / digest

    def _prune(self, kept: Path) -> None:
        """Remove the products beside a new one; what is still being read stays until closed."""
        for path in kept.parent.iterdir():
            if path.stem == kept.stem or not _DIGEST_NAME.match(path.name):
                continue
            # A product that cannot be removed only takes up room.
            with suppress(OSError):
                if path.is_dir():
                    shutil.rmtree(path)
                else:
                    path.unlink()


def _is_whole_value(path: Path) -> bool:
    """True for a value file as long as its first line says."""
    try:
        with path.open("rb") as file:
            magic, length, _ = file.readline(200).split()
            return magic == _MAGIC and path.stat().st_size == file.tell() + int(length)
    except (OSError, ValueError):
        return False


def _value_in(path: Path, here: Path | None) -> Any | None:
    """The value of a file; None when it is not there, damaged, or of another version."""
    try:
        header, _, payload = path.read_bytes().partition(b"\n")
        magic, length, digest = header.split()
        whole = magic == _MAGIC and int(length) == len(payload)
        if whole and hashlib.sha256(payload).hexdigest() == digest.decode():
            return decode(payload, here)
    except (OSError, ValueError, CodecError):
        return None
    return None


def _is_whole_folder(path: Path) -> bool:
    """True for a folder that holds every file of its manifest at its size."""
    try:
        expected = json.loads((path / _MANIFEST).read_text(encoding="utf-8"))
        return all((path / name).stat().st_size == size for name, size in expected.items())
    except (OSError, ValueError, AttributeError):
        return False


def _sizes(folder: Path) -> dict[str, int]:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.stat().st_size for path in sorted(files)}


def _stamps(path: Path, here: Path | None) -> Any:
    """What stands for a path in a digest; one layer of a file is as new as the file."""
    named = path_to_json(path, here)
    path = Path(str(path).partition(LAYER_MARK)[0])
    beside = [path.with_suffix(suffix) for suffix in COMPANIONS] if path.suffix else []
    stamps = [stamp_of(file) for file in (path, path.with_name(f"{path.name}.points"), *beside)]
    return named | {"@stamps": [stamp for stamp in stamps if stamp is not None]}


def stamp_of(path: Path) -> list[Any] | None:
    """Name, size, time and a sample of the content of a file; None where there is none."""
    try:
        with path.open("rb") as file:
            found = os.fstat(file.fileno())
            return [path.name, found.st_size, found.st_mtime_ns, _sample(file, found.st_size)]
    except OSError:
        return None


def content_of(path: Path) -> tuple[int, str] | None:
    """Bytes of a file and a digest of its first and last 64 KiB; None where it cannot be read.

    Copies of one file have the same, whatever they are called and whenever they were made.
    """
    try:
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            return size, _sample(file, size)
    except OSError:
        return None


def _sample(file: BinaryIO, size: int) -> str:
    sample = hashlib.sha256(file.read(SAMPLE_BYTES))
    file.seek(max(size - SAMPLE_BYTES, 0))
    sample.update(file.read(SAMPLE_BYTES))
    return sample.hexdigest()
