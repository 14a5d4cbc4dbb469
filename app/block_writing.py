"""Change single keys of a `block.toml` and leave everything else as its owner wrote it."""

import json
import re
import tomllib
from collections.abc import Mapping
from typing import Any, cast

from core.errors import ProjectError

HEADER = re.compile(r"^\s*(?P<open>\[\[?)\s*(?P<name>[^\]]+?)\s*\]")
BARE = re.compile(r"[A-Za-z0-9_-]+")
Values = Mapping[tuple[str, str], Any]
"""New values by table and key; None takes a key out."""


def toml_value(value: Any) -> str:
    """A value as TOML writes it; JSON strings, numbers and lists are TOML as well."""
    if isinstance(value, Mapping):
        items = cast("Mapping[str, Any]", value).items()
        inner = ", ".join(f"{_key(name)} = {toml_value(item)}" for name, item in items)
        return f"{{ {inner} }}" if inner else "{}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(toml_value(item) for item in cast('list[Any]', value))}]"
    return json.dumps(value, ensure_ascii=False)


def with_values(text: str, changes: Values, where: str) -> str:
    """The text of a `block.toml` with other values; comments and the order of lines stay.

    A line that asks for a key (`# FILL IN: ...`, `# key =`) makes room for it.

    Raises:
        ProjectError: The file is written in a way that this cannot change, such as dotted keys.
    """
    wanted: dict[str, Any] = tomllib.loads(text)
    lines = text.split("\n")
    for (table, key), value in changes.items():
        _put(wanted, table, key, value)
        lines = _changed(lines, table, key, value)
    changed = "\n".join(lines).rstrip() + "\n"
    try:
        same = tomllib.loads(changed) == wanted
    except tomllib.TOMLDecodeError:
        same = False
    if not same:
        cause = "is written in a way that cannot be changed from here."
        raise ProjectError(where, cause, "Change it in an editor: a [table], its keys below it.")
    return changed


def _put(values: dict[str, Any], table: str, key: str, value: Any) -> None:
    """The same change to what the text says."""
    for part in table.split("."):
        values = values.get(part, {}) if value is None else values.setdefault(part, {})
    if value is None:
        values.pop(key, None)
    else:
        values[key] = json.loads(json.dumps(value))


def _changed(lines: list[str], table: str, key: str, value: Any) -> list[str]:
    span = _table_span(lines, table)
    if span is None:
        if value is None:
            return lines
        gap = [""] if lines and lines[-1].strip() else []
        return [*lines, *gap, f"[{table}]", f"{_key(key)} = {toml_value(value)}"]
    found = _key_span(lines, span, key)
    if found is not None:
        first, last = found
        kept = [] if value is None else [_line(lines[first:last], key, value)]
        return [*lines[:first], *kept, *lines[last:]]
    if value is None:
        return lines
    first, last = _room_for(lines, span, key)
    return [*lines[:first], f"{_key(key)} = {toml_value(value)}", *lines[last:]]


def _table_span(lines: list[str], table: str) -> tuple[int, int] | None:
    """First line below a table's header, and the line past its last."""
    begun = None
    for number, line in enumerate(lines):
        found = HEADER.match(line)
        if found is None:
            continue
        if begun is not None:
            return begun, number
        if found["open"] == "[" and found["name"].replace('"', "") == table:
            begun = number + 1
    return None if begun is None else (begun, len(lines))


def _key_span(lines: list[str], span: tuple[int, int], key: str) -> tuple[int, int] | None:
    """Lines of a key and its value, which may go on over several."""
    name = re.compile(rf"""^\s*(["']?){re.escape(key)}\1\s*=""")
    for first in range(*span):
        if not name.match(lines[first]):
            continue
        for last in range(first + 1, span[1] + 1):
            if _is_whole("\n".join(lines[first:last])):
                return first, last
    return None


def _is_whole(text: str) -> bool:
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return False
    return True


def _line(old: list[str], key: str, value: Any) -> str:
    """The key with its new value, and the comment behind the old one."""
    last, new = old[-1], f"{_key(key)} = {toml_value(value)}"
    before = tomllib.loads("\n".join(old))
    for place in (at for at, letter in enumerate(last) if letter == "#"):
        head = "\n".join([*old[:-1], last[:place]])
        if _is_whole(head) and tomllib.loads(head) == before:
            return f"{new}  {last[place:]}"
    return new


def _room_for(lines: list[str], span: tuple[int, int], key: str) -> tuple[int, int]:
    """Lines that a new key takes the place of: those that ask for it, else none at the end."""
    asks = re.compile(rf"^\s*#\s*{re.escape(key)}\s*=")
    for number in range(*span):
        if asks.match(lines[number]):
            told = number > span[0] and lines[number - 1].lstrip().startswith("# FILL IN")
            return number - told, number + 1
    end = span[1]
    while end > span[0] and not lines[end - 1].strip():
        end -= 1
    return end, end


def _key(name: str) -> str:
    return name if BARE.fullmatch(name) else json.dumps(name, ensure_ascii=False)
