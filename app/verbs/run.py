"""The automatic stages of one block or of many, and the report."""

import argparse
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from app.batch import Batch, listed
from app.block_tasks import BlockTask
from app.project import read_project
from app.report.against import against_told
from app.run import PAGE, RunOptions
from app.runners import run_block
from app.terminal import Voice
from core.errors import OrientationError
from ui.words.catalogue import Teller


def run(given: argparse.Namespace, voice: Voice) -> None:
    """The automatic stages; `local` is an earlier word for `threads`."""
    if given.executor in ("threads", "local"):
        options = RunOptions(given.first, given.last, given.workers, given.language)
        run_block(given.block, voice, options)
        return
    folder = read_project(given.block).folder
    task = BlockTask(folder, 0.0, given.last or "", given.first or "", given.language)
    Batch((task,), None, voice).run(given.executor, given.workers, given.scheduler)


def batch(given: argparse.Namespace, voice: Voice) -> None:
    """The automatic stages of many blocks."""
    every = listed(given.list, voice, given.language)
    every.run(given.executor, given.workers, given.scheduler)


def report(given: argparse.Namespace, voice: Voice) -> None:
    """The accuracy report of the block as it stands; what is not fresh is computed first.

    Raises:
        OrientationError: No photo is oriented, or none has a picture: there is nothing to report.
    """
    walk = run_block(given.block, voice, replace(run_options(given), against=given.against))
    page = walk.session.results / PAGE
    if walk.ended_early:
        raise OrientationError(page, "was not written.", walk.ended_early)
    voice.say(str(page))
    figures = walk.session.results / "report.json"
    for line in (*signed_lines(figures, voice.tell), *against_lines(figures, voice.tell)):
        voice.say(line)


def run_options(given: argparse.Namespace) -> RunOptions:
    """All stages, as a verb asks that is no run."""
    return RunOptions(workers=given.workers, language=given.language)


def against_lines(figures: Path, tell: Teller) -> Iterator[str]:
    """What differs from the earlier state that a report is compared with; none without one."""
    found = json.loads(figures.read_text(encoding="utf-8"))["against"]
    if found is not None:
        yield against_told(found, tell)


def signed_lines(figures: Path, tell: Teller) -> Iterator[str]:
    """Who has signed the block of a report, and what has changed since."""
    if not figures.is_file():
        return
    written = json.loads(figures.read_text(encoding="utf-8"))
    for one in written["checked"]["signatures"]:
        verdict = tell(f"accepted.{one['verdict']}")
        values = {"verdict": verdict, "who": one["who"], "when": one["when"]}
        values["changed"] = ", ".join(tell(f"signed.part.{name}") for name in one["changed"])
        key = "signed.line.outdated" if one["changed"] else "signed.line"
        yield tell(key, **values, digest=one["digest"])
