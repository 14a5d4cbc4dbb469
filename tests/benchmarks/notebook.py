"""The notebook: measured figures kept as JSON and drawn as tables into the documents.

Run: python -m tests.benchmarks.notebook                draw all tables and samples
     python -m tests.benchmarks.notebook prove TABLE    run the table's program, keep its rows, draw
     python -m tests.benchmarks.notebook sample NAME    run a sample's command, keep its text, draw

`docs/measurements/PAGE.json` holds the tables of `PAGE.md`. Each row carries the commit and the
date that produced it. A program prints a Markdown table; its rows replace those with the same
first cells. A page shows a table between `<!-- table: NAME -->` and `<!-- /table -->`, the output
of a command between `<!-- sample: NAME -->` and `<!-- /sample -->`.
"""

import argparse
import json
import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import cache, partial
from pathlib import Path

HOME = Path(__file__).resolve().parents[2]
NOTEBOOK = HOME / "docs" / "measurements"
SAMPLES = "samples.json"
OLDER = " †"
OLDER_NOTE = "† older version of the code than that of the newest row."
CHANGED_NOTE = "The code has changed since the newest row."
MARKED = re.compile(r"(<!-- (table|sample): ([\w-]+) -->\n)(.*?)(<!-- /\2 -->)", re.DOTALL)
"""A place of a page that this program fills."""
REPEATED_PASS = re.compile(r"\(pass [2-9]\)")


@dataclass(frozen=True, slots=True)
class Row:
    """One row of a table and the version that produced it."""

    commit: str
    """Last commit of the measured code; `+` after it where changes were not committed."""
    date: str
    """Date and time, UTC, to the minute."""
    cells: tuple[str, ...]
    earlier: bool = False
    """The figures may be older than the commit, which is the first that shows them."""


@dataclass(frozen=True, slots=True)
class Table:
    """Figures of one program."""

    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    command: str = ""
    """What prints the rows; empty for figures that no program prints as a table."""
    keys: int = 1
    """So many first cells tell one row from another."""
    code: tuple[str, ...] = ("core",)
    """Folders whose change makes the figures old."""


@dataclass(frozen=True, slots=True)
class Sample:
    """What a command printed."""

    command: str
    commit: str
    date: str
    lines: tuple[str, ...]


def read_tables(path: Path) -> dict[str, Table]:
    """Tables of one page of the notebook by name."""
    held = json.loads(path.read_text(encoding="utf-8"))
    return {
        name: Table(
            tuple(table["columns"]),
            tuple(Row(**row | {"cells": tuple(row["cells"])}) for row in table["rows"]),
            table.get("command", ""),
            table.get("keys", 1),
            tuple(table.get("code", ["core"])),
        )
        for name, table in held.items()
    }


def write_tables(path: Path, tables: Mapping[str, Table]) -> None:
    """Write a page's tables, one row a line, so that a change shows which rows are new."""
    parts = []
    for name, table in tables.items():
        head = {
            "command": table.command,
            "code": table.code,
            "keys": table.keys,
            "columns": table.columns,
        }
        lines = [f'    "{key}": {_json(value)},\n' for key, value in head.items()]
        rows = ",\n".join(f"      {_json(_row_dict(row))}" for row in table.rows)
        parts.append(f'  "{name}": {{\n{"".join(lines)}    "rows": [\n{rows}\n    ]\n  }}')
    path.write_text("{\n" + ",\n".join(parts) + "\n}\n", encoding="utf-8")


def _row_dict(row: Row) -> dict[str, object]:
    held = asdict(row)
    return held if row.earlier else {key: held[key] for key in ("commit", "date", "cells")}


def _json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False)


def pages_of_tables() -> list[Path]:
    """The JSON files that hold tables."""
    return sorted(path for path in NOTEBOOK.glob("*.json") if path.name != SAMPLES)


def all_tables() -> dict[str, Table]:
    """Every table of the notebook by name."""
    return {name: table for path in pages_of_tables() for name, table in read_tables(path).items()}


def read_samples() -> dict[str, Sample]:
    """Sample outputs by name."""
    held = json.loads((NOTEBOOK / SAMPLES).read_text(encoding="utf-8"))
    return {name: Sample(**s | {"lines": tuple(s["lines"])}) for name, s in held.items()}


# ------------------------------------------------------------------ drawing


def draw_table(table: Table, same_code: Callable[[str, str], bool]) -> str:
    """The table as Markdown, with the version of each row in a last column.

    Args:
        table: What is to be drawn.
        same_code: Says of two commits whether the measured code is the same in both.
    """
    newest = max(table.rows, key=lambda row: row.date).commit
    lines = [_line([*table.columns, "measured"]), "|" + "---|" * (len(table.columns) + 1)]
    older = {row.commit for row in table.rows if not same_code(row.commit, newest)}
    for row in table.rows:
        version = f"{row.commit}{' or earlier' if row.earlier else ''}, {row.date[:10]}"
        lines.append(_line([*row.cells, version + OLDER * (row.commit in older)]))
    notes = [f"Printed by `{table.command}`."] * bool(table.command)
    notes += [OLDER_NOTE] * bool(older)
    notes += [CHANGED_NOTE] * (not same_code(newest, "HEAD"))
    return "\n".join(lines) + "\n" + ("\n" + " ".join(notes) + "\n" if notes else "")


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def draw_sample(sample: Sample) -> str:
    """The output as a block without repeated passes, with command and version that printed it."""
    lines = [line for line in sample.lines if not REPEATED_PASS.search(line)]
    told = f"Output of `{sample.command}`, version {sample.commit} of {sample.date[:10]}"
    told += "; the repeated passes are left out." if len(lines) < len(sample.lines) else "."
    return "```text\n" + "\n".join(lines) + f"\n```\n\n{told}\n"


@cache
def same_code(folders: tuple[str, ...], first: str, second: str) -> bool:
    """True when the folders hold the same in both commits; false where git does not know one."""
    if first == second:
        return True
    commits = (first.rstrip("+"), second.rstrip("+"))
    return not _git("diff", "--quiet", *commits, "--", *folders).returncode


def _git(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["git", *words], cwd=HOME, capture_output=True, text=True)


def draw_page(text: str, tables: Mapping[str, Table], samples: Mapping[str, Sample]) -> str:
    """The page with every marked place filled."""

    def filled(match: re.Match[str]) -> str:
        begin, kind, name, _, end = match.groups()
        if kind == "sample":
            return begin + draw_sample(samples[name]) + end
        return begin + draw_table(tables[name], partial(same_code, tables[name].code)) + end

    return MARKED.sub(filled, text)


def drawn_pages() -> list[Path]:
    """Pages that may hold a marked place."""
    return sorted([*(HOME / "docs").glob("*.md"), *NOTEBOOK.glob("*.md")])


def draw_all() -> None:
    """Fill all pages."""
    tables, samples = all_tables(), read_samples()
    for page in drawn_pages():
        text = page.read_text(encoding="utf-8")
        drawn = draw_page(text, tables, samples)
        if drawn != text:
            page.write_text(drawn, encoding="utf-8")
            say(f"{page.relative_to(HOME)} drawn")


# ------------------------------------------------------------------ measuring


def printed_tables(lines: Sequence[str]) -> list[tuple[list[str], list[list[str]]]]:
    """Head and rows of every Markdown table among printed lines."""
    found: list[tuple[list[str], list[list[str]]]] = []
    before: list[str] = []
    for line in lines:
        cells = _cells(line)
        if cells and set("".join(cells)) <= set("-: "):
            if found and before in found[-1][1][-1:]:
                found[-1][1].pop()  # the line before was the head of this one
            found.append((before, []))
        elif cells and found:
            found[-1][1].append(cells)
        before = cells
    return found


def _cells(line: str) -> list[str]:
    if not line.startswith("|"):
        return []
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def with_printed(table: Table, lines: Sequence[str], commit: str, date: str) -> Table:
    """The table with the rows that were printed, under the version that printed them.

    A printed table belongs here when it has the columns that tell rows apart. A column that is not
    printed keeps what it held.
    """
    rows = {row.cells[: table.keys]: row for row in table.rows}
    for head, printed in printed_tables(lines):
        if (
            set(table.columns[: table.keys]) <= set(head)
            and len(set(head) & set(table.columns)) > 1
        ):
            for cells in printed:
                new = dict(zip(head, cells, strict=False))
                key = tuple(new[column] for column in table.columns[: table.keys])
                held = rows[key].cells if key in rows else ("",) * len(table.columns)
                kept = [new.get(c, old) for c, old in zip(table.columns, held, strict=True)]
                rows[key] = Row(commit, date, tuple(kept))
    return replace(table, rows=tuple(rows.values()))


def output_of(words: Sequence[str], folder: Path) -> list[str]:
    """Lines that a command prints; they are shown as they come."""
    lines: list[str] = []
    paths = os.pathsep.join([str(HOME), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {"PYTHONPATH": paths}
    with subprocess.Popen(
        words, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True
    ) as running:
        assert running.stdout is not None
        for line in running.stdout:
            say(line.rstrip("\n"))
            lines.append(line.rstrip())
    return lines


def version_now(folders: Sequence[str]) -> tuple[str, str]:
    """Last commit of the folders, and date, of a measurement made now."""
    commit = _git("log", "-1", "--format=%h", "--abbrev=7", "--", *folders).stdout.strip()
    changed = _git("status", "--porcelain", "--", *folders).stdout.strip()
    return commit + "+" * bool(changed), f"{datetime.now(UTC):%Y-%m-%d %H:%M}"


def prove(name: str) -> None:
    """Run the program of a table, and keep the rows of every table that it prints."""
    command = all_tables()[name].command
    words = [os.path.expandvars(word) for word in shlex.split(command)]
    if any("$" in word for word in words):
        say(f"{name} not measured: `{command}` needs its variable set")
        return
    commit, date = version_now(all_tables()[name].code)
    lines = output_of([sys.executable, *words[1:]], HOME)
    for path in pages_of_tables():
        tables = read_tables(path)
        new = {
            own: with_printed(table, lines, commit, date) if table.command == command else table
            for own, table in tables.items()
        }
        if new != tables:
            write_tables(path, new)


def take_sample(name: str) -> None:
    """Run the command of a sample in an empty folder, and keep what it prints."""
    samples = read_samples()
    words = [sys.executable, "-m", "gruber", *shlex.split(samples[name].command)[1:]]
    commit, date = version_now(("core", "app"))
    with tempfile.TemporaryDirectory() as folder:
        lines = output_of(words, Path(folder))
    samples[name] = replace(
        samples[name], commit=commit, date=date, lines=tuple("\n".join(lines).rstrip().split("\n"))
    )
    held = {own: asdict(sample) for own, sample in samples.items()}
    text = json.dumps(held, ensure_ascii=False, indent=1)
    (NOTEBOOK / SAMPLES).write_text(text + "\n", encoding="utf-8")


def say(line: str) -> None:
    """One line, at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure what is asked for, then draw all pages."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("what", nargs="?", choices=["prove", "sample"])
    parser.add_argument("names", nargs="*", help="all, if none is given")
    given = parser.parse_args(arguments)
    if given.what == "sample":
        for name in given.names or read_samples():
            take_sample(name)
    elif given.what == "prove":
        commands = {table.command: name for name, table in all_tables().items() if table.command}
        for name in given.names or commands.values():
            prove(name)
    draw_all()
    return 0


if __name__ == "__main__":
    sys.exit(main())
