"""Change single keys of a `block.toml` and keep everything else as the owner wrote it."""

import re
from collections.abc import Mapping
from typing import Any, cast

import tomlkit
from tomlkit.container import OutOfOrderTableProxy
from tomlkit.items import InlineTable, Item, Table, Whitespace

Values = Mapping[tuple[str, str], Any]
"""New values by table and key; None takes a key out."""


def toml_value(value: Any) -> str:
    """A value as TOML writes it, mappings on one line."""
    return _item(value).as_string()


def with_values(text: str, changes: Values) -> str:
    """The text of a `block.toml` with other values; comments and the order of lines stay.

    A line that asks for a key (`# FILL IN: ...`, `# key =`) makes room for it.
    """
    for (table, key), value in changes.items():
        if value is not None:
            text = _answered(text, table, key)
    document = tomlkit.parse(text)
    for (table, key), value in changes.items():
        _change(document, table, key, value)
    return document.as_string().rstrip() + "\n"


def _item(value: Any) -> Item:
    if not isinstance(value, Mapping):
        return tomlkit.item(value)
    inline = tomlkit.inline_table()
    inline.update({name: _item(one) for name, one in cast("Mapping[str, Any]", value).items()})
    return inline


def _answered(text: str, table: str, key: str) -> str:
    """The text with a nought where a comment of the table asks for the key."""
    header, name = re.escape(f"[{table}]"), re.escape(key)
    asking = r"(?:# FILL IN.*\n(?:# (?!\w+ *=).*\n)*)?"
    asks = rf"(?m)^({header}.*\n(?:(?!\[).*\n)*?){asking}# *{name} *=.*$"
    return re.sub(asks, rf"\1{key} = 0", text, count=1)


def _change(document: tomlkit.TOMLDocument, table: str, key: str, value: Any) -> None:
    holder: Any = document
    for part in table.split("."):
        if part not in holder and value is None:
            return
        holder = holder.setdefault(part, tomlkit.table())
    if value is None:
        holder.pop(key, None)
    elif key in holder or isinstance(holder, InlineTable | OutOfOrderTableProxy):
        holder[key] = _item(value)
    else:
        _add(cast("Table", holder), key, value)


def _add(table: Table, key: str, value: Any) -> None:
    """A new key below the last line of a table, before the gap to the next one."""
    body, gaps = table.value.body, 0
    while body and isinstance(body[-1][1], Whitespace):
        body.pop()
        gaps += 1
    table.append(key, _item(value))
    for _ in range(gaps):
        table.add(tomlkit.nl())
