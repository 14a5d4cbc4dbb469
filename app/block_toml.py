"""`block.toml` as tables that know their place: typed values, units, files, and plain errors."""

import difflib
import glob
import itertools
import math
import os
import re
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from core.errors import ProjectError
from core.formats.vectors import LAYER_MARK

FILE = "block.toml"
"""Name of the file in a block's folder."""
RASTERS = frozenset({".tif", ".tiff", ".jp2", ".j2k", ".jpg", ".jpeg", ".png", ".vrt", ".img"})
"""Suffixes a glob for rasters keeps: `scans/*` also meets world files and statistics."""
_HEADER = re.compile(r"^\s*(?P<open>\[\[?)\s*(?P<name>[^\]]+?)\s*\]")


@dataclass(frozen=True, slots=True)
class Unit:
    """The range a number must lie in, and the mistakes that leave it."""

    name: str
    """Unit in words."""
    low: float
    """Smallest value that makes sense."""
    high: float
    """Largest value that makes sense."""
    taken_for: Sequence[tuple[str, float]] = ()
    """Units that are often mistaken for it, with the factor to this one; a factor of 0 stands for
    dots per inch."""

    def advice(self, value: float) -> str:
        """What the value probably was meant to be."""
        for other, factor in self.taken_for:
            meant = value * factor if factor else 25_400.0 / value if value else 0.0
            if self.low <= meant <= self.high:
                return f"{value:g} looks like {other}: write {meant:.6g}."
        return f"Write it in {self.name}, from {self.low:g} to {self.high:g}."


MILLIMETRES = Unit("millimetres", 10, 2000, (("metres", 1000), ("micrometres", 0.001)))
"""Principal distances and sides of a picture."""
MICROMETRES = Unit("micrometres", 3, 500, (("millimetres", 1000), ("dots per inch", 0)))
"""Scan pixels."""
SCALE_NUMBERS = Unit("ones (15000 for 1 : 15 000)", 500, 500_000)
"""Scales of photos."""
METRES = Unit("metres", 0.001, 1000, (("millimetres", 0.001),))
"""Standard deviations and ground sample distances."""


class Document:
    """The text of a `block.toml` and what it says."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self.text = path.read_text(encoding="utf-8-sig")
            self.values: dict[str, Any] = tomllib.loads(self.text)
        except FileNotFoundError as error:
            remedy = "Name the block's folder, or its block.toml."
            if path.parent.is_dir() and path.suffix == ".toml":
                remedy = f"`gruber new {path.parent}` writes one."
            raise ProjectError(path, "is not there.", remedy) from error
        except (OSError, UnicodeDecodeError) as error:
            remedy = "Save it as a UTF-8 text file that you may read."
            raise ProjectError(path, f"cannot be read ({error}).", remedy) from error
        except tomllib.TOMLDecodeError as error:
            remedy = "Mend that line; words and paths stand in double quotes."
            raise ProjectError(path, f"is not valid TOML: {error}.", remedy) from error

    def place(self, table: str, key: str = "", nth: int = 0) -> str:
        """File, line and key, as an error names them."""
        line = self._line(table, key, nth)
        where = f"{self.path}:{line}" if line else str(self.path)
        return f"{where} [{table}] {key}".rstrip() if table else f"{where} {key}"

    def table(self, *path: str, keys: Sequence[str], required: bool = False) -> "Table":
        """A table by its names from the top; empty when it is left out and not required."""
        name, values = ".".join(path), cast("Any", self.values)
        for part in path:
            values = values.get(part, {}) if isinstance(values, dict) else values
        if required and not values:
            raise ProjectError(self.path, f"has no [{name}].", f"Add it; see {MANUAL}.")
        return Table(self, name, values, keys)

    def root(self, keys: Sequence[str]) -> "Table":
        """The file itself as a table of tables."""
        return Table(self, "", self.values, keys)

    def tables(self, name: str, keys: Sequence[str]) -> "list[Table]":
        """The `[[...]]` tables of a dotted name, in order."""
        outer, _, inner = name.rpartition(".")
        parent: Any = self.values.get(outer, {})
        found: Any = parent.get(inner, []) if isinstance(parent, dict) else []
        if not isinstance(found, list):
            remedy = f"Write [[{name}]], with two brackets on each side."
            raise ProjectError(self.place(name), "is a list of tables.", remedy)
        return [Table(self, name, item, keys, nth) for nth, item in enumerate(found)]

    def _line(self, table: str, key: str, nth: int) -> int | None:
        """Line of a key, else of its table, counted from 1; None when neither is found."""
        begun, seen, header = None, -1, ""
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


MANUAL = "docs/block-toml.md"
"""The manual page of the file."""


class Table:
    """One table: every reader names the line and the remedy when the value cannot be used."""

    def __init__(
        self, document: Document, name: str, values: Any, keys: Sequence[str], nth: int = 0
    ) -> None:
        self.document, self.name, self.nth = document, name, nth
        if not isinstance(values, dict):
            remedy = f"Write [{name}] on a line of its own and its keys below."
            raise ProjectError(document.place(name), "is not a table.", remedy)
        self.values = cast("dict[str, Any]", values)
        for key in self.values:
            if key not in keys:
                raise self.error(key, "is no key of this table.", _nearest(key, keys))

    def error(self, key: str, cause: str, remedy: str) -> ProjectError:
        """An error about one key."""
        return ProjectError(self.document.place(self.name, key, self.nth), cause, remedy)

    def has(self, key: str) -> bool:
        """True when the key is given."""
        return key in self.values

    def text(self, key: str, default: str | None = None) -> str:
        """A word or sentence; required when there is no default."""
        value = self._value(key, default)
        if not isinstance(value, str):
            raise self.error(key, f"must be text, not {value!r}.", "Write it in double quotes.")
        return value

    def flag(self, key: str, default: bool) -> bool:
        """True or false."""
        value = self._value(key, default)
        if not isinstance(value, bool):
            raise self.error(key, f"must be true or false, not {value!r}.", "Without quotes.")
        return value

    def number(self, key: str, unit: Unit, default: float | None = None) -> float:
        """A number within the range of its unit; required when there is no default."""
        return self._checked(key, self._value(key, default), unit)

    def numbers(
        self, key: str, count: int, default: tuple[float, ...] | None = None
    ) -> tuple[float, ...]:
        """As many finite numbers as asked for; fewer only where the default says so."""
        value = self._value(key, list(default) if default is not None else None)
        return self.sequence(key, value, count)

    def sequence(self, key: str, value: Any, count: int) -> tuple[float, ...]:
        """A list of numbers that stands somewhere under a key."""
        good = isinstance(value, list) and len(cast("list[Any]", value)) == count
        if not good or not all(_is_number(item) for item in cast("list[Any]", value)):
            example = ", ".join(["0.0"] * count)
            raise self.error(key, f"must be {count} numbers, not {value!r}.", f"Write [{example}].")
        return tuple(float(item) for item in cast("list[Any]", value))

    def measures(self, key: str, count: int, unit: Unit) -> tuple[float, ...]:
        """As many required numbers as asked for, each within the range of its unit."""
        return tuple(self._checked(key, item, unit) for item in self.numbers(key, count))

    def choice(self, key: str, choices: Sequence[str], default: str | None = None) -> str:
        """One of several words; required when there is no default."""
        value = self.text(key, default)
        if value not in choices:
            raise self.error(key, f'"{value}" is not known.', _nearest(value, choices))
        return value

    def file(self, key: str) -> Path | None:
        """One file, None when the key is left out."""
        if not self.has(key):
            return None
        found = self.files(key)
        if len(found) != 1:
            names = ", ".join(path.name for path in found[:4])
            raise self.error(key, f"must be one file but matches {len(found)}: {names}.", _ONE_FILE)
        return found[0]

    def files(self, key: str, rasters: bool = False, required: bool = False) -> tuple[Path, ...]:
        """Files of one path or glob or a list of them, in the order given.

        Args:
            key: The key.
            rasters: Whether globs keep only rasters.
            required: Whether the key may not be left out.
        """
        value = self._value(key, None if required else [])
        patterns = [value] if isinstance(value, str) else value
        if not isinstance(patterns, list) or not all(isinstance(item, str) for item in patterns):
            raise self.error(key, f"must be a path or a list of paths, not {value!r}.", _IN_QUOTES)
        found: dict[Path, None] = {}
        for pattern in cast("list[str]", patterns):
            found.update(dict.fromkeys(self._matches(key, pattern, rasters)))
        return tuple(found)

    def _matches(self, key: str, pattern: str, rasters: bool) -> list[Path]:
        folder = self.document.path.parent
        pattern, mark, layer = pattern.partition(LAYER_MARK)
        literal = (folder / pattern).is_file()
        names = (
            [pattern] if literal else sorted(glob.glob(pattern, root_dir=folder, recursive=True))
        )
        paths = [Path(os.path.normpath(folder / name)) for name in names]
        kept = [path for path in paths if path.is_file() and not path.name.startswith(".")]
        if rasters and not literal:
            kept = [path for path in kept if path.suffix.lower() in RASTERS]
        if not kept:
            verb = "matches no file." if glob.has_magic(pattern) else "is not there."
            raise self.error(key, f'"{pattern}" {verb}', _what_is_there(folder, pattern))
        return [Path(f"{path}{mark}{layer}") for path in kept]

    def _value(self, key: str, default: Any) -> Any:
        value = self.values.get(key, default)
        if value is None:
            raise self.error(key, "is missing.", f"Add it; {MANUAL} says what it means.")
        return value

    def _checked(self, key: str, value: Any, unit: Unit) -> float:
        if not _is_number(value):
            remedy = "Write it without quotes, with a point."
            raise self.error(key, f"must be a number, not {value!r}.", remedy)
        if not unit.low <= value <= unit.high:
            cause = f"{value:g} {unit.name} cannot be."
            raise self.error(key, cause, unit.advice(float(value)))
        return float(value)


_ONE_FILE = "Name the one that is meant."
_IN_QUOTES = "Write each path in double quotes."


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _key_of(text: str) -> str:
    """The key a line begins with, without quotes; empty when it begins with none."""
    found = re.match(r"""^\s*(["']?)(?P<key>[^"'=#\[\]]+?)\1\s*=""", text)
    return found["key"] if found else ""


def _nearest(word: str, choices: Sequence[str]) -> str:
    """Advice for a word that is not among the choices."""
    near = difflib.get_close_matches(word, choices, n=1, cutoff=0.5)
    if near:
        return f"Did you mean `{near[0]}`?"
    return f"Use one of {', '.join(choices)}."


def _what_is_there(folder: Path, pattern: str) -> str:
    """What the operator finds where the pattern looked."""
    plain = itertools.takewhile(lambda part: not glob.has_magic(part), Path(pattern).parent.parts)
    parent = folder.joinpath(*plain)
    if not parent.is_dir():
        return f"There is no folder {parent}. Correct the path; it is relative to {FILE}."
    names = list(_visible(parent))
    listed = ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
    return f"{parent} holds {listed or 'nothing'}. Correct the path; it is relative to {FILE}."


def _visible(folder: Path) -> Iterator[str]:
    return (path.name for path in sorted(folder.iterdir()) if not path.name.startswith("."))
