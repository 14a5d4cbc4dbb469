"""The keys of `block.toml`: the manual has each with its default and its range, and no other."""

import json
import re
from pathlib import Path

import pytest

from app.block_schema import TABLES, Key, keys_of

MANUAL = Path(__file__).resolve().parents[2] / "docs" / "block-toml.md"
ROW = re.compile(r"(?m)^\| `(\w+)` \| (.*?) \| (.*) \|$")
RANGE = re.compile(r"\(([\d. ]+) to ([\d. ]+)\)")


def manual() -> dict[str, dict[str, tuple[str, str]]]:
    """Default and meaning of each key of each table, as the manual has them."""
    pages = re.split(r"(?m)^##+ \[+([a-zA-Z.]+)\]+$", MANUAL.read_text(encoding="utf-8"))[1:]
    rows = {
        name.removesuffix(".NAME"): ROW.findall(page)
        for name, page in zip(pages[::2], pages[1::2], strict=True)
    }
    return {
        name: {key: (default, says) for key, default, says in found} for name, found in rows.items()
    }


def number(text: str) -> float:
    return float(text.replace(" ", ""))


def test_the_manual_describes_every_key_and_no_other__law():
    told = {name: list(keys) for name, keys in manual().items()}
    has = {name: [k.name for k in keys if k.kind != "tables"] for name, keys in TABLES.items()}
    assert {name: set(keys) for name, keys in told.items()} == {
        name: set(keys) for name, keys in has.items()
    }


@pytest.mark.parametrize(
    ("table", "key"), [(name, key) for name, keys in TABLES.items() for key in keys]
)
def test_default_and_range_in_the_manual_are_those_that_hold__law(table: str, key: Key):
    if key.kind == "tables":
        return
    default, says = manual()[table][key.name]
    if key.required:
        assert default == "*required*"
    elif key.default is not None:
        assert json.loads(default.strip("`")) == key.default
    else:
        assert "`" not in default.replace("`[scans]`", "")
    for low, high in RANGE.findall(says):
        assert key.unit is not None
        assert (number(low), number(high)) == (key.unit.low, key.unit.high)


def test_keys_of_a_camera_are_found_by_its_name__law():
    assert keys_of("camera.wide") == keys_of("camera.other")
    assert "principal_distance_mm" in keys_of("camera.wide")
