"""The list of blocks in a folder: how good each is, and who has vouched for it."""

import json
import math
import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

from app.block_toml import FILE
from app.project import read_project
from app.report.against import REPORT
from core.adjustment.adjusted import AdjustmentReport
from core.errors import PhotogrammetryError, StorageError
from core.quality.job_rules import USUAL_RULES
from sessions.checks import (
    checked_figures,
    judged_parts,
    standing_plans,
    standing_signatures,
    version_on_disk,
)
from sessions.remarks import standing_faults
from sessions.session import HIDDEN, Session
from sessions.sheet_samples import sheets_on_disk

MOST_LISTED = 500
"""Folders that a page lists at once."""
BLOCKS_DEPTH = 2
"""How deep a folder is looked through for blocks."""


def blocks_in(folder: Path) -> list[str]:
    """Paths of the blocks below a folder, from there; none in a block's own folder."""
    if (folder / FILE).is_file():
        return []
    found: list[Path] = []
    for depth in range(1, BLOCKS_DEPTH + 1):
        with suppress(OSError):
            found += folder.glob("/".join(["*"] * depth + [FILE]))
    return [path.relative_to(folder).as_posix() for path in each_once(p.parent for p in found)]


def each_once(folders: Iterable[Path]) -> list[Path]:
    """Folders in the order of their names, without links to one that is there itself."""
    found = {os.path.realpath(path): path for path in sorted(folders, key=_is_link)[::-1]}
    return sorted(found.values())


def _is_link(folder: Path) -> bool:
    return os.path.realpath(folder) != os.path.abspath(folder)


def block_told(folder: Path) -> dict[str, Any]:
    """How good a block is by its last report and its readings, its open faults, and who signed it.

    `why` is why it cannot be opened; empty where it can.
    """
    told: dict[str, Any] = {
        "why": "", "sigma": None, "predicted": None, "m_p": None, "open": 0, "signed": []
    }  # fmt: skip
    rules = USUAL_RULES
    try:
        rules = read_project(folder).rules
    except PhotogrammetryError as error:
        told["why"] = error.told if (folder / FILE).is_file() else ""
    if not was_made(folder, "control"):
        return told
    with suppress(OSError, ValueError, KeyError, TypeError):
        figures = json.loads((folder / REPORT).read_text(encoding="utf-8"))
        told["sigma"] = figures["adjustment"]["sigma_nought"]
        told["predicted"] = figures["certificate"]["predicted_m"]
    # A session that cannot be read is told of when its desk is opened.
    with suppress(StorageError), Session.open(folder, "gruber") as session:
        decisions = session.decisions()
        told["m_p"] = _read_m(session)
        told["open"] = sum(one.is_open for one in standing_faults(decisions))
        if not standing_signatures(decisions, {}):
            return told
        report = cast("AdjustmentReport | None", session.products.latest_value("adjustment"))
        version = version_on_disk(session.products)
        sheets = sheets_on_disk(session.products, version)
        now = {} if report is None else judged_parts(decisions, report, version, rules, sheets)
        told["signed"] = [
            [one.recorded.who, one.said.verdict, one.holds]
            for one in standing_signatures(decisions, now)
        ]
    return told


def _read_m(session: Session) -> float | None:
    """m_p of the readings of the plan that is read now, metres; None without readings."""
    decisions = session.decisions()
    plans = standing_plans(decisions)
    if not plans:
        return None
    found = checked_figures(decisions, plans[-1], version_on_disk(session.products))
    return found.together.m_p if math.isfinite(found.together.m_p) else None


def was_made(folder: Path, stage: str) -> bool:
    """True when a stage has a product in the block of a folder."""
    return any((folder / HIDDEN / "products" / stage).rglob("*.value"))
