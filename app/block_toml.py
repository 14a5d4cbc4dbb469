"""`block.toml` as tables that know their place: typed values, units, files, and plain errors."""

import difflib
import glob
import itertools
import math
import os
import re
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, cast
from unicodedata import category

from app.block_schema import SECTIONS, Key, Kind, keys_of
from core.errors import ProjectError
from core.formats.records import plain_bytes
from core.formats.vectors import LAYER_MARK
from core.said import say

FILE = "block.toml"
"""Name of the file in a block's folder."""
BATCH_TABLE = "batch.csv"
"""Name of the table that tells how far the blocks of a batch are."""
RASTERS = frozenset({".tif", ".tiff", ".jp2", ".j2k", ".jpg", ".jpeg", ".png", ".vrt", ".img"})
"""Suffixes a glob for rasters keeps: `scans/*` also meets world files and statistics."""
_HEADER = re.compile(r"^\s*(?P<open>\[\[?)\s*(?P<name>[^\]]+?)\s*\]")


def folder_of(block: Path) -> Path:
    """The folder of a block that is named by it or by its `block.toml`."""
    return block.parent if block.name == FILE and not block.is_dir() else block


class FieldError(ProjectError):
    """One key of `block.toml` that cannot be used.

    Attributes:
        table: Name of its table, such as `camera.wide`.
        key: The key.
        numbers: How many numbers belong there, where something else stands; else 0.
    """

    def __init__(
        self, table: str, key: str, place: str, cause: str, remedy: str, numbers: int = 0
    ) -> None:
        super().__init__(place, cause, remedy)
        self.table, self.key, self.numbers = table, key, numbers


class Document:
    """The text of a `block.toml` and what it says."""

    def __init__(self, path: Path, text: str | None = None) -> None:
        """Read a file, or text that is to become one."""
        self.path = path
        try:
            self.text = _read(path) if text is None else text
            self.values: dict[str, Any] = tomllib.loads(self.text)
        except FileNotFoundError as error:
            remedy = "Name the block's folder, or its block.toml."
            if path.parent.is_dir() and path.suffix == ".toml":
                remedy = say("`gruber new {parent}` writes one.", parent=path.parent)
            raise ProjectError(path, "is not there.", remedy) from error
        except (OSError, UnicodeDecodeError) as error:
            remedy = "Save it as a UTF-8 text file that you may read."
            raise ProjectError(
                path,
                say("cannot be read ({error}).", error=error),
                remedy,
            ) from error
        except (ValueError, RecursionError) as error:
            remedy = "Mend that line; words and paths stand in double quotes."
            raise ProjectError(
                path,
                say("is not valid TOML: {error}.", error=error),
                remedy,
            ) from error

    def place(self, table: str, key: str = "", nth: int = 0) -> str:
        """File, line and key, as an error names them."""
        line = self._line(table, key, nth)
        where = f"{self.path}:{line}" if line else str(self.path)
        return f"{where} [{table}] {key}".rstrip() if table else f"{where} {key}"

    def table(self, *path: str, required: bool = False) -> "Table":
        """A table by its names from the top; empty when it is left out and not required."""
        name, values = ".".join(path), cast("Any", self.values)
        for part in path:
            values = values.get(part, {}) if isinstance(values, dict) else values
        if required and not values:
            raise ProjectError(
                self.path,
                say("has no [{name}].", name=name),
                say("Add it; see {manual}.", manual=MANUAL),
            )
        return Table(self, name, values, keys_of(name))

    def check_sections(self) -> None:
        """Refuse a misspelt table as a misspelt key is."""
        for name in self.values:
            if name not in SECTIONS:
                cause, remedy = "is no key of this table.", _nearest(name, SECTIONS)
                raise ProjectError(self.place("", name), cause, remedy)

    def tables(self, name: str) -> "list[Table]":
        """The `[[...]]` tables of a dotted name, in order."""
        outer, _, inner = name.rpartition(".")
        parent: Any = self.values.get(outer, {})
        found: Any = parent.get(inner, []) if isinstance(parent, dict) else []
        if not isinstance(found, list):
            remedy = say("Write [[{name}]], with two brackets on each side.", name=name)
            raise ProjectError(self.place(name), "is a list of tables.", remedy)
        return [Table(self, name, item, keys_of(name), nth) for nth, item in enumerate(found)]

    def _line(self, table: str, key: str, nth: int) -> int | None:
        """Line of a key, else of its table, counted from 1; None when neither is found."""
        # Before the first header stand the keys of no table.
        begun, seen, header = None, -1 if table else 0, ""
        for number, text in enumerate(self.text.splitlines(), start=1):
            found = _HEADER.match(text)
            if found:
                header = found["name"].replace('"', "")
                if not table and header.partition(".")[0] == key:
                    return number
                seen += header == table
                begun = number if header == table and seen == nth else begun
            elif key and _key_of(text) == key and (header, seen) == (table, nth):
                return number
        return begun


MOST_NUMBERS = 3
"""Terms of a radial distortion."""
MANUAL = "docs/block-toml.md"
"""The manual page of the file."""


class Table:
    """One table: every reader names the line and the remedy when the value cannot be used."""

    def __init__(
        self, document: Document, name: str, values: Any, keys: Mapping[str, Key], nth: int = 0
    ) -> None:
        self.document, self.name, self.keys, self.nth = document, name, keys, nth
        if not isinstance(values, dict):
            remedy = say("Write [{name}] on a line of its own and its keys below.", name=name)
            raise ProjectError(document.place(name), "is not a table.", remedy)
        self.values = cast("dict[str, Any]", values)
        for key in self.values:
            if key not in keys:
                raise self.error(key, "is no key of this table.", _nearest(key, tuple(keys)))

    def error(self, key: str, cause: str, remedy: str, numbers: int = 0) -> FieldError:
        """An error about one key; `numbers` as in `FieldError`."""
        place = self.document.place(self.name, key, self.nth)
        return FieldError(self.name, key, place, cause, remedy, numbers=numbers)

    def has(self, key: str) -> bool:
        """True when the key is given."""
        return key in self.values

    def text(self, key: str, default: str | None = None) -> str:
        """A word or sentence; required when there is no default."""
        value = self._value(key, default)
        if not isinstance(value, str):
            raise self.error(
                key,
                say("must be text, not {value!r}.", value=value),
                "Write it in double quotes.",
            )
        if any(category(sign) == "Cc" for sign in value):
            raise self.error(
                key, "contains a line break or control character.", "Write it on one line."
            )
        return value

    def flag(self, key: str) -> bool:
        """True or false."""
        value = self._value(key)
        if not isinstance(value, bool):
            raise self.error(
                key,
                say("must be true or false, not {value!r}.", value=value),
                "Without quotes.",
            )
        return value

    def number(self, key: str, default: float | None = None) -> float:
        """A number within the range of its unit; required when there is no default."""
        return self._checked(key, self._value(key, default))

    def numbers(self, key: str) -> tuple[float, ...]:
        """Finite numbers, as many as the key has; up to three where it does not say."""
        value = self._value(key)
        given = len(cast("list[Any]", value)) if isinstance(value, list) else MOST_NUMBERS
        return self.sequence(key, value, self.keys[key].count or min(given, MOST_NUMBERS))

    def sequence(self, key: str, value: Any, count: int) -> tuple[float, ...]:
        """A list of numbers that stands somewhere under a key."""
        good = isinstance(value, list) and len(cast("list[Any]", value)) == count
        if not good or not all(_is_number(item) for item in cast("list[Any]", value)):
            example = ", ".join(["0.0"] * count)
            raise self.error(
                key,
                say("must be {count} numbers, not {value!r}.", count=count, value=value),
                say("Write [{example}].", example=example),
                numbers=count,
            )
        return tuple(float(item) for item in cast("list[Any]", value))

    def measures(self, key: str) -> tuple[float, ...]:
        """As many numbers as the key has, each within the range of its unit."""
        return tuple(self._checked(key, item) for item in self.numbers(key))

    def choice(self, key: str, choices: Sequence[str] = (), default: str | None = None) -> str:
        """One of the words of the key, or of some others; required when there is no default."""
        value, choices = self.text(key, default), choices or self.keys[key].choices
        if value not in choices:
            raise self.error(
                key,
                say('"{value}" is not known.', value=value),
                _nearest(value, choices),
            )
        return value

    def words(self, key: str) -> tuple[str, ...]:
        """A list of words, each once; of those of the key, where it has some."""
        value, choices = self._value(key), self.keys[key].choices
        words = [value] if isinstance(value, str) else value
        if not isinstance(words, list) or not all(isinstance(word, str) for word in words):
            raise self.error(
                key,
                say("must be a list of words, not {value!r}.", value=value),
                'Write each in double quotes: ["one", "other"].',
            )
        for word in cast("list[str]", words):
            if choices and word not in choices:
                cause = say('"{value}" is not known.', value=word)
                raise self.error(key, cause, _nearest(word, choices))
        return tuple(dict.fromkeys(cast("list[str]", words)))

    def file(self, key: str) -> Path | None:
        """One file, None when the key is left out."""
        if not self.has(key):
            return None
        found = self.files(key)
        if len(found) != 1:
            names = ", ".join(path.name for path in found[:4])
            raise self.error(
                key,
                say(
                    "must be one file but matches {count}: {names}.", count=len(found), names=names
                ),
                _ONE_FILE,
            )
        return found[0]

    def files(self, key: str) -> tuple[Path, ...]:
        """Files of one path or glob or a list of them, in the order given."""
        known = self.keys[key]
        value, rasters = self._value(key, None if known.required else []), known.kind == "rasters"
        patterns = [value] if isinstance(value, str) else value
        if not isinstance(patterns, list) or not all(isinstance(item, str) for item in patterns):
            raise self.error(
                key,
                say("must be a path or a list of paths, not {value!r}.", value=value),
                _IN_QUOTES,
            )
        found: dict[Path, None] = {}
        for pattern in cast("list[str]", patterns):
            found.update(dict.fromkeys(self._matches(key, pattern, rasters)))
        return tuple(found)

    def _matches(self, key: str, pattern: str, rasters: bool) -> list[Path]:
        folder = self.document.path.parent
        pattern, mark, layer = pattern.partition(LAYER_MARK)
        if "\0" in pattern:
            raise self.error(key, say('"{pattern}" is no path.', pattern=pattern), _IN_QUOTES)
        # os.path takes what may not be looked at for what is not there.
        literal = os.path.isfile(folder / pattern)
        names = (
            [pattern] if literal else sorted(glob.glob(pattern, root_dir=folder, recursive=True))
        )
        paths = [Path(os.path.normpath(folder / name)) for name in names]
        paths = [path for path in paths if not path.name.startswith(".")]
        if rasters and not literal:
            paths = [path for path in paths if path.suffix.lower() in RASTERS]
            self._refuse_folders(key, pattern, paths)
        kept = [path for path in paths if os.path.isfile(path)]
        if not kept:
            there = "is a folder." if os.path.isdir(folder / pattern) else "is not there."
            verb = "matches no file." if glob.has_magic(pattern) else there
            raise self.error(
                key,
                say('"{pattern}" {verb}', pattern=pattern, verb=verb),
                _what_is_there(folder, pattern),
            )
        return [Path(f"{path}{mark}{layer}") for path in kept]

    def _refuse_folders(self, key: str, pattern: str, paths: Sequence[Path]) -> None:
        """A folder or a broken link that a pattern matches would silently be one image fewer."""
        for path in paths:
            if not os.path.isfile(path):
                cause = say(
                    '"{pattern}" matches {path}, which is not a file.', pattern=pattern, path=path
                )
                raise self.error(key, cause, "Remove it, or put the image there.")

    def checked(self, key: str) -> None:
        """Read a key as its kind says, for the error it may hold; tables are read elsewhere.

        Raises:
            FieldError: It cannot be used.
        """
        known = self.keys[key]
        if not self.has(key) and not known.required:
            return
        readers: dict[Kind, Callable[[str], object]] = {
            "text": self.text, "number": self.number, "numbers": self.numbers,
            "measures": self.measures, "choice": self.choice, "flag": self.flag,
            "file": self.file, "files": self.files, "rasters": self.files, "words": self.words,
        }  # fmt: skip
        if known.kind in readers:
            readers[known.kind](key)

    def _value(self, key: str, default: Any = None) -> Any:
        default = self.keys[key].default if default is None else default
        value = self.values.get(key, default)
        if value is None:
            raise self.error(
                key,
                "is missing.",
                say("Add it; {manual} says what it means.", manual=MANUAL),
            )
        return value

    def _checked(self, key: str, value: Any) -> float:
        unit = self.keys[key].unit
        assert unit is not None, f"{key} has no unit"
        if not _is_number(value):
            remedy = "Write it without quotes, with a point."
            raise self.error(
                key,
                say("must be a number, not {value!r}.", value=value),
                remedy,
                numbers=1,
            )
        if not unit.low <= value <= unit.high:
            cause = say("{value:g} is outside what it can be.", value=value)
            raise self.error(key, cause, unit.advice(float(value)))
        if unit.whole and value % 1:
            cause = say("{value:g} is no whole number.", value=value)
            raise self.error(key, cause, unit.advice(float(value)))
        return float(value)


_ONE_FILE = "Name the one that is meant."
_IN_QUOTES = "Write each path in double quotes."


def _read(path: Path) -> str:
    return plain_bytes(path).decode("utf-8-sig").replace("\r\n", "\n")


def _is_number(value: Any) -> bool:
    if isinstance(value, int):
        return not isinstance(value, bool) and abs(value) < sys.maxsize
    return isinstance(value, float) and math.isfinite(value)


def _key_of(text: str) -> str:
    """The key a line begins with, without quotes; empty when it begins with none."""
    found = re.match(r"""^\s*(["']?)(?P<key>[^"'=#\[\]]+?)\1\s*=""", text)
    return found["key"] if found else ""


def _nearest(word: str, choices: Sequence[str]) -> str:
    """Advice for a word that is not among the choices."""
    near = difflib.get_close_matches(word, choices, n=1, cutoff=0.5)
    if near:
        return say("Did you mean `{word}`?", word=near[0])
    return say("Use one of {words}.", words=[*choices])


def _what_is_there(folder: Path, pattern: str) -> str:
    """What the operator finds where the pattern looked."""
    plain = itertools.takewhile(lambda part: not glob.has_magic(part), Path(pattern).parent.parts)
    parent = folder.joinpath(*plain)
    if not os.path.isdir(parent) or not os.access(parent, os.R_OK):
        missing = "There is no folder {folder}. Correct the path; it is relative to {file}."
        return say(missing, folder=parent, file=FILE)
    names = list(_visible(parent))
    if not names:
        empty = "{folder} is empty. Correct the path; it is relative to {file}."
        return say(empty, folder=parent, file=FILE)
    listed = names[:5] + ["..."] * (len(names) > 5)
    there = "{folder} holds {names}. Correct the path; it is relative to {file}."
    return say(there, folder=parent, names=listed, file=FILE)


def _visible(folder: Path) -> Iterator[str]:
    return (path.name for path in sorted(folder.iterdir()) if not path.name.startswith("."))
