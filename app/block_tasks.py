"""Blocks that are to run: lists of every kind, and how far each block is."""

import csv
import glob
import json
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from app.block_list import blocks_in, each_once
from app.block_toml import FILE, folder_of
from app.report.against import REPORT
from app.run import STAGE_NAMES
from core.errors import ProjectError
from core.formats.records import plain_bytes

State = Literal["waiting", "running", "done", "failed"]
LISTED = ("block", "priority", "until")
DELIMITERS = ",;\t"
"""Of a table: what spreadsheets write, by their language."""


@dataclass(frozen=True, slots=True)
class BlockTask:
    """One block of a list."""

    block: Path
    """Its folder."""
    priority: float = 0.0
    """Blocks of a higher priority run first."""
    until: str = ""
    """Last stage to run; empty for all."""
    first: str = ""
    """Stage to make anew with all after it; empty for none."""
    language: str = ""
    """Of its report; that of the last one when left out."""

    @property
    def options(self) -> dict[str, str]:
        """What `gruber run` is asked for it, by option."""
        asked = {"--from": self.first, "--until": self.until, "--language": self.language}
        return {name: value for name, value in asked.items() if value}


@dataclass(frozen=True, slots=True)
class BlockState:
    """How far one block is."""

    task: BlockTask
    """The block."""
    state: State = "waiting"
    """What is happening to it."""
    stage: str = ""
    """The stage it is in, or was in when it ended."""
    seconds: float = 0.0
    """How long its run took."""
    message: str = ""
    """Why it failed."""
    ended_early: bool = False
    """Whether its run was sound, and the rest of it cannot be made."""

    @property
    def findings(self) -> str:
        """Grave findings of its report, by number and first sentence; empty without a report."""
        report = self.task.block / REPORT
        if self.state != "done" or not report.is_file():
            return ""
        verdict = json.loads(report.read_text(encoding="utf-8"))["verdict"]
        grave = [finding["sentence"] for finding in verdict if finding["grave"] > 1]
        return f"{len(grave)}: {grave[0]}" if grave else "0"


def read_list(*sources: Path) -> tuple[BlockTask, ...]:
    """The blocks of folders, patterns, files with a path a line, or tables, in the order to run.

    A table is a CSV file whose head names `block` and, where wanted, `priority` and `until`.
    Paths are relative to the list.

    Raises:
        ProjectError: A list cannot be read, is empty, or names something that is no block.
    """
    tasks = [task for source in sources for task in _tasks(source)]
    folders = [os.path.realpath(task.block) for task in tasks]
    twice = sorted(
        {str(task.block) for task in tasks if folders.count(os.path.realpath(task.block)) > 1}
    )
    if twice:
        cause = "names {block} more than once."
        raise ProjectError(sources[-1], cause, "Name every block once.", block=twice[0])
    return tuple(sorted(tasks, key=lambda task: -task.priority))


def _tasks(source: Path) -> list[BlockTask]:
    """The blocks of one folder, pattern, file or table."""
    if (source / FILE).is_file():
        return [BlockTask(source)]
    if source.is_dir():
        tasks = [BlockTask(source / path) for path in blocks_in(source)]
    elif glob.has_magic(str(source)) and not source.exists():
        found = (Path(path) for path in glob.glob(str(source), recursive=True))
        tasks = [BlockTask(path) for path in each_once(p for p in found if (p / FILE).is_file())]
    else:
        tasks = [_task(source, row) for row in _rows(source)]
    if not tasks:
        remedy = "Name a folder with blocks in it, or a file with the path of a block a line."
        raise ProjectError(source, "lists no block.", remedy)
    return tasks


def _rows(source: Path) -> list[dict[str, str]]:
    """Rows of a list, by column."""
    if not source.exists():
        remedy = "Name a folder with blocks in it, or a file with the path of a block a line."
        raise ProjectError(source, "does not exist.", remedy)
    try:
        text = plain_bytes(source).decode("utf-8-sig")
        lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
        tables = ([*csv.reader(lines, delimiter=sign)] for sign in DELIMITERS)
        table = next((rows for rows in tables if rows and "block" in map(_head, rows[0])), None)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        remedy = "Name a folder, or a text file in UTF-8 with the path of a block a line."
        raise ProjectError(source, "cannot be read.", remedy) from error
    if table is None:
        return [{"block": line.strip()} for line in lines]
    head = [_head(cell) for cell in table[0]]
    if unknown := [name for name in head if name not in LISTED]:
        cause, remedy = "has an unknown column {name}.", "Its columns are {names}."
        raise ProjectError(source, cause, remedy, name=unknown[0], names=LISTED)
    rows = [dict(zip(head, row, strict=False)) for row in table[1:]]
    if any(not row.get("block", "").strip() for row in rows):
        raise ProjectError(source, "has a row without a block.", "Give every row the path of one.")
    return rows


def _head(cell: str) -> str:
    """A column's name."""
    return cell.strip().lower()


def _task(source: Path, row: dict[str, str]) -> BlockTask:
    """One row of a list."""
    block = folder_of(source.parent / os.path.expanduser(row["block"].strip()))
    if not os.path.isfile(block / FILE):
        cause = "names {block}, where there is no block.toml."
        remedy = "Correct the path, or make the block with `gruber new`."
        raise ProjectError(source, cause, remedy, block=row["block"].strip())
    until, priority = row.get("until", "").strip(), row.get("priority", "").strip()
    if until and until not in STAGE_NAMES:
        cause, remedy = "names an unknown stage {name}.", "Stages are {names}."
        raise ProjectError(source, cause, remedy, name=until, names=", ".join(STAGE_NAMES))
    try:
        weight = float(priority or 0)
    except ValueError:
        weight = math.nan
    if not math.isfinite(weight):
        cause = "gives {block} the priority {value}, which is no number."
        values = {"block": row["block"].strip(), "value": priority}
        raise ProjectError(source, cause, "Use a number; higher runs first.", **values)
    return BlockTask(block, weight, until)
